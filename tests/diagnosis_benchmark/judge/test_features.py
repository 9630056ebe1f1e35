"""Features of paired differences: what they pass, and what they stop."""

import numpy as np
import pytest

from aoro_gym.diagnosis_benchmark.judge.features import (
    CHANNELS,
    LEAST,
    PERIOD,
    before_arrival,
    features,
    means,
    paired,
    windows,
)

SAMPLES = 300
TIME = PERIOD * np.arange(SAMPLES)


def command() -> np.ndarray:
    return np.where((TIME >= 0.7) & (TIME < 2.4), 0.8, 0.0)


def log(angle: np.ndarray | float = 0.0, pressure: np.ndarray | float = 0.0) -> dict[str, np.ndarray]:
    return {name: np.zeros(SAMPLES) + (angle if name == "joint_angle" else pressure) for name in CHANNELS}


def test_a_mean_passes_a_course_and_stops_sway() -> None:
    weights = windows(command())
    sway = np.abs(means([log(np.sin(2 * np.pi * 6.0 * TIME))], weights).values[0, 0])
    # a raised cosine of length W passes sin(πfW)/(πfW)/(1 − (fW)²) of a frequency f
    passed = abs(np.sin(np.pi * 6.0 * 0.8) / (np.pi * 6.0 * 0.8) / (1.0 - (6.0 * 0.8) ** 2))
    inside = sway[1:-1]
    assert inside.max() <= 1.05 * passed + 1e-4
    assert means([log(3.0)], weights).values[0, 0] == pytest.approx(3.0)


def test_pressures_at_the_stop_are_not_compared() -> None:
    moving = np.minimum(0.5 * np.maximum(TIME - 0.7, 0.0), 0.7)
    assert before_arrival(moving)[: round(1.9 / PERIOD)].all()
    assert not before_arrival(moving)[round(2.1 / PERIOD) :].any()
    assert before_arrival(0.5 * moving).all()
    weights = windows(command())
    found = means([log(moving, 1e5), log(moving, 2e5)], weights)
    change = paired(found[1], found[0])
    compared = found.share[0] >= LEAST
    assert 0 < compared.sum() < len(compared)
    assert change[1:, compared] == pytest.approx(1e5)
    assert np.all(change[1:, ~compared] == 0.0)


def test_pressures_of_the_stop_do_not_enter_means_before_it() -> None:
    moving = np.minimum(0.5 * np.maximum(TIME - 0.7, 0.0), 0.7)
    stopped = np.where(moving < 0.7, 5e6, 2e7)
    found = means([log(moving, stopped)], windows(command()))
    compared = found.share[0] >= LEAST
    assert found.values[0, 1:, compared] == pytest.approx(5e6)


def test_features_are_those_of_the_channels_one_manoeuvre_after_the_other() -> None:
    first, second = np.arange(8.0).reshape(4, 2), 10.0 + np.arange(12.0).reshape(4, 3)
    assert features([first, second], (0, 2)).tolist() == [0, 1, 4, 5, 10, 11, 12, 16, 17, 18]


def test_a_command_of_nothing_has_no_features() -> None:
    with pytest.raises(ValueError, match="nought throughout"):
        windows(np.zeros(100))
