"""Real families behind the protocol: machines, days, effects and logs."""

import numpy as np
import pytest

from aoro_gym.diagnosis_benchmark.cases import Excitation
from aoro_gym.diagnosis_benchmark.judge.features import CHANNELS
from aoro_gym.diagnosis_benchmark.judge.plants import IndependentPlants, LayeredPlants, PlantRun, Plants

STEERING = np.r_[np.zeros(45), np.full(30, 0.8), np.zeros(25)]
EXCITATION = Excitation("pulse", 0.1, STEERING)
FAMILIES: list[Plants] = [IndependentPlants("alder"), LayeredPlants(1)]


@pytest.mark.parametrize("plants", FAMILIES, ids=lambda one: one.name)
def test_a_run_is_repeated_and_an_effect_changes_it(plants: Plants) -> None:
    rng = np.random.default_rng(0)
    machine = plants.machine(rng)
    delayed = {"sensor_delay": plants.effects["sensor_delay"][0].size(1.0)}
    runs = [
        PlantRun(machine, EXCITATION),
        PlantRun(machine, EXCITATION, delayed),
        PlantRun(plants.another_day(machine, rng), EXCITATION),
        PlantRun(machine, EXCITATION, outside=(plants.outside[0], 1.0), seed=1),
    ]
    first, second = plants.record([*runs, runs[0]], exact=True), plants.record(runs, exact=False)
    for channel in CHANNELS:
        assert first[0][channel].shape == STEERING.shape
        np.testing.assert_array_equal(first[0][channel], first[-1][channel])
        assert np.any(first[0][channel] != second[0][channel])
        assert np.any(first[0][channel] != first[2][channel])
    moved = first[0]["joint_angle"] - first[0]["joint_angle"][0]
    assert moved[-1] > 0.05  # to the left
    late = first[1]["joint_angle"] - first[1]["joint_angle"][0]
    delay = delayed["sensor_delay"][0]
    whole = round(delay / 0.01)
    shifted = np.interp(np.arange(len(moved)) * 0.01 - delay, np.arange(len(moved)) * 0.01, moved)
    # between samples a delayed angle is a straight line: off by at most (10 ms)²/8 of an acceleration of some 10 rad/s²
    assert np.max(np.abs(late - shifted)[45 + whole :]) < 0.01**2 / 8 * 20 + 1e-6
    assert plants.magnitude("sensor_delay", machine, delayed["sensor_delay"])["magnitude"][0] == pytest.approx(delay)


@pytest.mark.parametrize("plants", FAMILIES, ids=lambda one: one.name)
def test_sizes_lead_from_weak_to_strong(plants: Plants) -> None:
    assert len(plants.effects) == 33
    for paths in plants.effects.values():
        for path in paths:
            assert 0.0 < path.weak < path.strong
            assert np.linalg.norm(path.direction) == pytest.approx(1.0)
            assert np.linalg.norm(path.size(0.0)) == pytest.approx(path.weak)
            assert np.linalg.norm(path.size(0.5)) == pytest.approx(np.sqrt(path.weak * path.strong))
            assert np.linalg.norm(path.size(1.0)) == pytest.approx(path.strong)


def test_a_relative_size_is_a_logarithm_of_the_levels_and_a_share_of_the_independent_plants() -> None:
    rng = np.random.default_rng(0)
    independent, layered = FAMILIES
    path = independent.effects["valve_gain"][0]
    assert independent.magnitude("valve_gain", independent.machine(rng), path.size(1.0))["magnitude"] == pytest.approx(
        [path.strong]
    )
    machine = layered.machine(rng)
    double, four = (layered.magnitude("valve_gain", machine, (np.log(n),))["magnitude"][0] for n in (2.0, 4.0))
    assert four == pytest.approx(3.0 * double)
