"""Component families and a mixture behind the judge's protocol."""

import numpy as np
import pytest

from aoro_gym.diagnosis_benchmark import component_families as component
from aoro_gym.diagnosis_benchmark.cases import Excitation
from aoro_gym.diagnosis_benchmark.judge.features import CHANNELS
from aoro_gym.diagnosis_benchmark.judge.plants import ComponentPlants, PlantRun, Plants

STEERING = np.r_[np.zeros(10), np.full(30, 0.8)]


@pytest.mark.parametrize("family", [*component.ALL_FAMILIES, "mixed_elm_fir_hazel_0002"])
def test_a_family_records_what_the_judge_asks(family: str) -> None:
    plants: Plants = ComponentPlants(family)
    machine = plants.machine(np.random.default_rng(1))
    left = Excitation("left", -0.5, STEERING, None)
    path = plants.effects["back_pressure"][0]
    runs = [
        PlantRun(machine, left, seed=1),
        PlantRun(machine, left, {"back_pressure": path.size(1.0)}, seed=1),
        PlantRun(machine, left, outside=("kind_02", 1.0), seed=1),
        PlantRun(plants.another_day(machine, np.random.default_rng(2)), left, seed=1),
    ]
    noisy, exact = plants.record(runs, exact=False), plants.record(runs, exact=True)
    again = plants.record(runs[:1], exact=False)
    for channel in CHANNELS:
        assert noisy[0][channel].shape == STEERING.shape
        np.testing.assert_array_equal(noisy[0][channel], again[0][channel])
    assert all(np.any(log["pressure_a"] != exact[0]["pressure_a"]) for log in (noisy[0], *exact[1:]))
    assert np.diff(exact[0]["joint_angle"])[-1] > 0.0  # to the left
    answer = plants.magnitude("back_pressure", machine, path.size(1.0))
    assert answer["magnitude"] == pytest.approx(path.size(1.0), rel=1e-6)
    assert answer["unit"] == component.EFFECTS["back_pressure"].unit
