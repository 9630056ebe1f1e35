"""Networks from nothing, and what is written of them."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

pytest.importorskip("torch")

from aoro_gym.diagnosis.network.dataset import Amount
from aoro_gym.diagnosis.network.forward import Weights
from aoro_gym.diagnosis.network.program import Program, run
from aoro_gym.diagnosis.network.shape import Shape
from aoro_gym.diagnosis.network.training import SENSORS, Course


def test_networks_are_written_with_how_well_they_do(tmp_path: Path) -> None:
    out = tmp_path / "made" / "anew"
    small = Shape(width=12, heads=1, within=1, across=1, kept=1, rank=1)
    amount = Amount(machines=4, later=1, manoeuvres=1)
    told: list[float] = []
    result = run(
        Program(amount, 2, Course(steps=2, batch=2), shape=small), "cpu", out, lambda _, share: told.append(share)
    )
    written = json.loads((out / "training.json").read_text())
    assert written["machines"] == 4 and written["course"]["steps"] == 2 and len(written["networks"]) == 2
    assert set(written["together"]) == set(SENSORS) == set(result["networks"][0]["rates"])
    assert written["together"]["angle"]["cases"] == 2
    first, second = (Weights.load(out / f"network_{number}.safetensors") for number in range(2))
    assert first.shape == small
    assert (first.scales == second.scales).all() and (first.arrays["place"] != second.arrays["place"]).any()
    run(Program(amount, 1, Course(steps=1, batch=2), shape=small), "cpu", out)
    assert [one.name for one in out.glob("network_*")] == ["network_0.safetensors"]
    assert told == sorted(told) and 0.0 < told[-1] < 1.0
