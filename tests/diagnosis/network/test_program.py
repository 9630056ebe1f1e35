"""Networks from nothing, and what is written of them."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("torch")

import torch

from aoro_gym.diagnosis.network.dataset import Amount
from aoro_gym.diagnosis.network.features import FEATURES, SAMPLES
from aoro_gym.diagnosis.network.forward import Weights
from aoro_gym.diagnosis.network.model import Network
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


def test_what_an_earlier_run_finished_is_kept(tmp_path: Path) -> None:
    """A second network is trained beside the first, whose file stays to the bit; another program begins anew."""
    small = Shape(width=12, heads=1, within=1, across=1, kept=1, rank=1)
    amount = Amount(machines=4, later=1, manoeuvres=1)
    program = Program(amount, 1, Course(steps=2, batch=2), shape=small)
    run(program, "cpu", tmp_path)
    first, second = (tmp_path / f"network_{number}.safetensors" for number in range(2))
    bits = first.read_bytes()
    first.touch()
    stamp = first.stat().st_mtime_ns
    result = run(replace(program, networks=2), "cpu", tmp_path)
    assert second.exists() and len(result["networks"]) == 2 and set(result["together"]) == set(SENSORS)
    assert first.stat().st_mtime_ns == stamp and first.read_bytes() == bits
    told: list[str] = []
    assert run(replace(program, networks=2), "cpu", tmp_path, lambda text, _: told.append(text)) == result
    assert told == ["all networks are trained already"]
    run(replace(program, course=Course(steps=1, batch=2)), "cpu", tmp_path)
    assert first.read_bytes() != bits and not second.exists()


def test_a_network_is_made_of_its_weights() -> None:
    network = Network(Shape(width=12, heads=1, within=1, across=1, kept=1, rank=1))
    again = Network.of(network.weights(np.ones(33)))
    rows, present = torch.randn(2, 3, FEATURES, SAMPLES), torch.ones(2, 3, dtype=torch.bool)
    for one, other in zip(network(rows, present), again(rows, present), strict=True):
        assert torch.equal(one, other)


def test_training_goes_on_from_other_networks(tmp_path: Path) -> None:
    """No step of it leaves their weights, but for the halves that they are stored in; their sizes are taken over."""
    small = Shape(width=12, heads=1, within=1, across=1, kept=1, rank=1)
    amount = Amount(machines=4, later=1, manoeuvres=1)
    run(Program(amount, 1, Course(steps=2, batch=2), shape=small), "cpu", tmp_path / "before")
    start = (tmp_path / "before" / "network_0.safetensors",)
    still = Program(amount, 1, Course(steps=1, batch=2, rate=0.0), start=start)
    result = run(still, "cpu", tmp_path / "after")
    before, after = (Weights.load(tmp_path / name / "network_0.safetensors") for name in ("before", "after"))
    assert after.shape == small and result["shape"] == small.as_dict() and len(result["start"]) == 1
    for name, values in before.arrays.items():
        np.testing.assert_array_equal(after.arrays[name], values)
    moved = run(replace(still, course=Course(steps=2, batch=2, rate=1e-2)), "cpu", tmp_path / "after")
    assert len(moved["networks"]) == 1
    assert (Weights.load(tmp_path / "after" / "network_0.safetensors").arrays["place"] != before.arrays["place"]).any()


def test_training_does_not_take_over_what_came_from_another_network_of_the_same_name(tmp_path: Path) -> None:
    small = Shape(width=12, heads=1, within=1, across=1, kept=1, rank=1)
    amount = Amount(machines=4, later=1, manoeuvres=1)
    start = tmp_path / "network_0.safetensors"
    still = Program(amount, 1, Course(steps=1, batch=2, rate=0.0), start=(start,))
    for seed in range(2):
        torch.manual_seed(seed)
        Network(small).weights(np.ones(33)).save(start)
        run(still, "cpu", tmp_path / "after")
        found, given = (Weights.load(path) for path in (tmp_path / "after" / start.name, start))
        np.testing.assert_array_equal(found.arrays["place"], given.arrays["place"])
