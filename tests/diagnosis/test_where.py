"""Where: phases of known commands, whitening in closed form, a probability that is uniform without a cause."""

import numpy as np
import pytest
from scipy.linalg import inv, sqrtm
from scipy.stats import kstest, norm

from aoro_gym.diagnosis.recording import Recording
from aoro_gym.diagnosis.result import PHASES
from aoro_gym.diagnosis.where import SIGNIFICANT, beyond, phases, places, probability
from tests.diagnosis.synthetic import STD, linear_of, problem_of

COUNT = 160


def named(steering, arrival=-1, drive=0.0):
    """Runs of phases: name and samples."""
    commands = np.stack([steering, np.full(len(steering), drive)], axis=1)
    found = phases(Recording("log", commands, {}, 1, 0.0), arrival)
    edges = np.flatnonzero(np.diff(found)) + 1
    return [(PHASES[part[0]], len(part)) for part in np.split(found, edges)]


MOTION = [("onset", 15), ("first_peak", 15), ("undershoot", 25), ("second_peak", 30)]


def test_phases_of_a_turn():
    """Standstill, the phases by the time since the signal's step, and the stop with the sample after the last command."""
    steering = np.r_[np.zeros(60), np.full(200, 0.6), np.zeros(40)]
    assert named(steering) == [("steady", 60), *MOTION, ("steady", 115), ("stop", 41)]
    assert named(steering, arrival=240) == [("steady", 60), *MOTION, ("steady", 95), ("stop", 61)]


def test_phases_begin_anew_with_every_change():
    reversal = np.r_[np.zeros(30), np.full(90, 0.6), np.full(90, -0.6)]
    again = [*MOTION[:3], ("second_peak", 25), ("stop", 11)]
    assert named(reversal, arrival=200) == [("steady", 30), *MOTION, ("steady", 5), *again]
    pause = np.r_[np.zeros(30), np.full(90, 0.6), np.zeros(50), np.full(10, 0.6)]
    assert named(pause) == [("steady", 30), *MOTION, ("steady", 5), ("stop", 50), ("onset", 11)]


def test_a_ramp_is_one_change():
    ramp = np.r_[np.zeros(30), np.linspace(0.0, 0.6, 201)[1:]]
    assert named(ramp) == [("steady", 30), *MOTION, ("steady", 116)]


def test_a_joint_that_stops_while_the_machine_drives_on():
    steering = np.r_[np.zeros(30), np.full(90, 0.6), np.zeros(50)]
    assert named(steering, drive=0.5) == [*MOTION[:1], ("first_peak", 15), *MOTION, ("steady", 5), ("stop", 51)]


def test_what_is_beyond_a_spread_is_white_and_symmetric():
    rng = np.random.default_rng(1)
    spread = rng.standard_normal((12, 4)) * [0.1, 1.0, 10.0, 1000.0]
    np.testing.assert_allclose(beyond(spread, np.eye(12)), inv(sqrtm(np.eye(12) + spread @ spread.T)), atol=1e-9)
    assert np.all(beyond(np.empty((12, 0)), np.eye(12)) == np.eye(12))


def test_probability_of_one_sample_is_that_of_a_normal():
    assert probability([np.array([1.7])]) == pytest.approx(2.0 * norm.sf(1.7))


def test_probability_of_two_samples_is_that_of_their_mean_and_difference():
    """(a + b)/√2 and (a − b)/√2 are independent normals; the less likely of two."""
    for a, b in ((1.2, 0.9), (-1.2, 0.9)):
        least = 2.0 * norm.sf(max(abs(a + b), abs(a - b)) / np.sqrt(2.0))
        assert probability([np.array([a, b])]) == pytest.approx(1.0 - (1.0 - least) ** 2)


def test_quiet_parts_take_nothing_away():
    loud = np.full(20, 2.0)
    assert probability([loud]) < 1e-15
    assert probability([loud, *(1e-3 * loud for _ in range(50))]) < 1e-13


def recorded(rng, slopes):
    """Two logs in noise, with a draw of the nuisances in ``slopes`` and of their own clocks and zeros."""
    noise = {k: {name: std * rng.standard_normal(COUNT) for name, std in STD.items()} for k in ("one", "two")}
    problem = problem_of(noise)
    linear_of(problem, slopes)
    own = problem.own(problem.predicted)
    drawn = slopes @ rng.standard_normal(slopes.shape[1]) + own @ rng.standard_normal(own.shape[1])
    moved = problem.split(drawn)
    for (index, name), part in zip(problem.blocks, moved, strict=True):
        noise[problem.recordings[index].name][name] += part
    return noise


def some_slopes(rng):
    """Smooth shifts of a few standard deviations of the noise, of both signals of both logs."""
    time = np.linspace(0.0, 1.0, COUNT)
    waves = [np.sin(k * np.pi * time) for k in range(1, 6)]
    stacked = [std * np.stack(waves, axis=1) @ rng.normal(0.0, 3.0, (5, 8)) for std in (*STD.values(), *STD.values())]
    return np.concatenate(stacked)


@pytest.mark.slow
def test_without_a_cause_the_probability_is_uniform():
    """Kolmogorov and Smirnov's test of 150 draws, which what is right fails with one seed of a thousand."""
    rng = np.random.default_rng(2)
    slopes = some_slopes(rng)
    found = []
    for _ in range(150):
        problem = problem_of(recorded(rng, slopes))
        found.append(places(problem, linear_of(problem, slopes))[1])
    assert kstest(found, "uniform").pvalue > 1e-3


def test_a_gap_is_found_where_it_is():
    """Three standard deviations of the noise up and down over a quarter of a second: an energy of 24 · 9 that averaging
    pairs keeps, and of which smooth nuisances explain little. All other parts have what χ² leaves above its mean."""
    rng = np.random.default_rng(3)
    slopes = some_slopes(rng)
    logs = recorded(rng, slopes)
    bump = np.repeat([3.0, -3.0], 4)
    logs["two"]["pressure_a"][90:114] += STD["pressure_a"] * np.r_[bump, bump, bump]
    problem = problem_of(logs)
    found, p = places(problem, linear_of(problem, slopes))
    assert p < 1e-6
    assert (found[0].manoeuvre, found[0].signal, found[0].phase) == ("two", "pressure_a", "undershoot")
    assert sum(place.share for place in found) == pytest.approx(1.0)
    assert all(place.share > 0.0 for place in found)
    assert [place.share for place in found] == sorted((place.share for place in found), reverse=True)
    assert found[0].share > 3.0 * found[1].share
    assert len(found) < 20  # of 24 parts, half of which have less than their mean


def test_what_calibration_explains_is_nowhere():
    """A residual along one nuisance, as large as its prior has it, though several times the noise: of 20 logs more than 4
    have a place with a probability of 0.003. Without that nuisance each is a gap."""
    rng = np.random.default_rng(4)
    slopes = some_slopes(rng)
    named = 0
    for _ in range(20):
        parts = iter(np.split(slopes[:, 0], 4))
        logs = {
            k: {name: next(parts) + std * rng.standard_normal(COUNT) for name, std in STD.items()}
            for k in ("one", "two")
        }
        problem = problem_of(logs)
        found, p = places(problem, linear_of(problem, slopes))
        assert bool(found) == (p < SIGNIFICANT)
        named += len(found) > 0
        assert places(problem, linear_of(problem, slopes[:, :0]))[1] < 1e-9
    assert named <= 4
