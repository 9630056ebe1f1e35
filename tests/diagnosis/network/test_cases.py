"""Recordings as the network takes them: aligned, paired by command, with what is missing left out."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from aoro_gym.diagnosis.network import hypotheses
from aoro_gym.diagnosis.network.cases import BEGIN, case_of, posterior, posteriors, tokens_of
from aoro_gym.diagnosis.network.features import CHANNELS, FEATURES, SAMPLES
from aoro_gym.diagnosis.network.forward import Weights, trained
from aoro_gym.diagnosis.network.shape import QUANTILES, Shape
from aoro_gym.diagnosis.recording import TICK, Recording
from aoro_gym.effects.catalogue import IDS


def recording(
    name: str, level: float, rest: int = 70, *, offset: float = 0.0, channels: tuple[str, ...] = CHANNELS
) -> Recording:
    """A turn at a steering ``level`` after ``rest`` ticks; its signals are ramps beside their ``offset`` [rad] and [bar]."""
    ticks = 400
    commands = np.zeros((ticks, 2))
    commands[rest : rest + 200, 0] = level
    ramp = TICK * np.clip(np.arange(ticks + 1) - rest, 0, 200)
    angle, pressure = -0.5 + level * ramp + offset, 1e6 * (1.0 + ramp) + 1e5 * offset
    kept = {
        channel: np.array(angle if channel == "joint_angle" else pressure, dtype=np.float64) for channel in channels
    }
    return Recording(name, commands, kept, rest, -0.5)


DIFFERENCE = 4  # of the angle: after two commands, the healthy and the later angle
FLAGS = FEATURES - len(CHANNELS) - 3


def test_logs_of_the_same_command_are_compared_however_long_they_rested() -> None:
    later = [recording("left", 0.9, rest=40), recording("right", -0.9, offset=0.01)]
    healthy = [recording("before right", -0.9, rest=90), recording("before left", 0.9), recording("slow", 0.4)]
    case = case_of(later, healthy)
    assert case.names == (("before left", "left"), ("before right", "right"), ("slow", ""))
    assert case.rows.shape == (3, FEATURES, SAMPLES)
    np.testing.assert_allclose(case.rows[:2, 0, BEGIN - 1 : BEGIN + 1], [[0.0, 0.9], [0.0, -0.9]], rtol=1e-6)
    np.testing.assert_allclose(case.rows[0, DIFFERENCE], 0.0, atol=1e-6)
    # in units of 0.01 rad; single precision of angles of 2 rad is 2.4e-7 rad
    np.testing.assert_allclose(np.sinh(case.rows[1, DIFFERENCE]), 1.0, atol=2.4e-5)
    days = case.rows[:, FLAGS + len(CHANNELS) :, 0]
    np.testing.assert_array_equal(days, [[1, 1, 0], [1, 1, 0], [1, 0, 0]])


def test_a_channel_that_either_day_lacks_is_not_compared() -> None:
    few = [recording("left", 0.9, channels=CHANNELS[:1])]
    case = case_of(few, [recording("before", 0.9)])
    np.testing.assert_array_equal(case.rows[0, FLAGS : FLAGS + len(CHANNELS), 0], [1, 0, 0, 0])
    assert np.isfinite(case.rows).all()


def test_without_healthy_logs_each_stands_alone() -> None:
    case = case_of([recording("left", 0.9)])
    assert case.names == (("", "left"),)
    np.testing.assert_array_equal(case.rows[0, FLAGS + len(CHANNELS) :, 0], [0, 1, 0])


def test_the_same_command_from_elsewhere_is_another_manoeuvre() -> None:
    elsewhere = replace(recording("other", 0.9), start_angle=0.4)
    assert case_of([recording("left", 0.9)], [elsewhere]).names == (("", "left"), ("other", ""))


def test_healthy_logs_that_repeat_a_command_show_what_changes_by_itself() -> None:
    healthy = [recording("first", 0.9), recording("slow", 0.4), recording("again", 0.9), recording("slow again", 0.4)]
    case = case_of([recording("left", 0.9, offset=0.01)], healthy)
    assert case.names == (("first", "left"), ("slow", ""), ("first", "again"), ("slow", "slow again"))
    assert case.repeats == (False, False, True, True)
    np.testing.assert_array_equal(case.rows[2:, FLAGS + len(CHANNELS) :, 0], [[1, 1, 1]] * 2)


def test_nothing_to_explain_is_refused() -> None:
    with pytest.raises(ValueError, match="no recording given"):
        case_of([], [recording("left", 0.9)])


def network(scale: float, told: int) -> Weights:
    """One that always says the same: hypothesis ``told``, and quantiles 0, 1, 2, 3, 4 of a size whose scale is ``scale``."""
    pytest.importorskip("torch")
    from aoro_gym.diagnosis.network.model import Network

    weights = Network(Shape(width=8, heads=1, within=1, across=1, kept=1, rank=1)).weights(np.full(len(IDS), scale))
    arrays = {name: np.zeros_like(values) for name, values in weights.arrays.items()}
    arrays["single.bias"][told] = 9.0
    arrays["size.2.bias"] = np.tile(np.arange(float(len(QUANTILES)), dtype=np.float32), len(IDS))
    return replace(weights, arrays=arrays)


def test_networks_are_averaged_and_sizes_are_in_their_units() -> None:
    """Each is sure: of nothing, and of effect 5; its odds against each of the 561 others are e⁹."""
    found = posterior([network(2.0, 0), network(4.0, hypotheses.SINGLE + 5)], case_of([recording("left", 0.9)]))
    sure = np.exp(9.0) / (np.exp(9.0) + hypotheses.HYPOTHESES - 1)
    other = (1.0 - sure) / (hypotheses.HYPOTHESES - 1)
    assert found.probabilities.sum() == pytest.approx(1.0)
    np.testing.assert_allclose(found.probabilities[[0, hypotheses.SINGLE + 5]], 0.5 * (sure + other), rtol=1e-5)
    assert found.effects.argmax() == 5
    np.testing.assert_allclose(found.quantiles[7], 3.0 * np.sinh(np.arange(len(QUANTILES))), rtol=1e-6)


def test_cases_that_are_asked_about_together_are_answered_as_each_alone() -> None:
    """The networks that come with the package; single precision of other sums differs in the sixth digit of a logit."""
    networks = trained()
    cases = [case_of([recording("left", level), recording("right", -level, offset=0.01)]) for level in (0.5, 0.9)]
    tokens = tokens_of(networks, np.concatenate([case.rows for case in cases]))
    probabilities, quantiles = posteriors(networks, [kept.reshape(2, 2, *kept.shape[1:]) for kept in tokens])
    for case, shares, sizes in zip(cases, probabilities, quantiles, strict=True):
        alone = posterior(networks, case)
        np.testing.assert_allclose(shares, alone.probabilities, rtol=1e-3, atol=1e-9)
        np.testing.assert_allclose(sizes, alone.quantiles, rtol=1e-3, atol=1e-4 * np.abs(alone.quantiles).max())
    assert not np.allclose(probabilities[0], probabilities[1], rtol=1e-2)
