"""Next experiments: information in closed form, conditions that act, and what the twin itself can and cannot tell apart."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.stats import norm

from aoro_gym.diagnosis import experiments
from aoro_gym.diagnosis.experiments import (
    OUTCOMES,
    SLIPPERY,
    ExperimentSimulator,
    Prediction,
    _drawn,
    _family,
    catalogue,
    information,
    next_experiments,
)
from aoro_gym.diagnosis.linear import Hypothesis, Linear
from aoro_gym.diagnosis.noise import ModelError
from aoro_gym.diagnosis.nuisances import Nuisances
from aoro_gym.diagnosis.problem import Problem
from aoro_gym.diagnosis.recording import REST, TICK
from aoro_gym.diagnosis.replay import Replay, Simulator, Variants
from aoro_gym.effects.catalogue import EFFECTS
from aoro_gym.machine import Machine
from tests.diagnosis.manoeuvres import FULL, blank, turn

MACHINE = Machine.load("aoro")
CANDIDATES = {candidate.name: candidate for candidate in catalogue(MACHINE)}


@pytest.mark.parametrize("apart", [0.3, 1.0, 2.0, 4.0])
@pytest.mark.parametrize("first", [0.5, 0.9])
def test_information_of_two_normals(apart, first):
    """∫ p(y | h) log₂ p(y | h) / p(y) by quadrature, within four standard errors of the Monte Carlo."""
    weights = np.array([first, 1.0 - first])
    means = np.array([0.0, apart])
    exact, error = 0.0, 0.0
    for weight, mean in zip(weights, means, strict=True):

        def ratio(y, mean=mean):
            return float(np.log2(norm.pdf(y, mean) / (weights @ norm.pdf(y, means))))

        first_moment, second_moment = (
            quad(lambda y, k=k, mean=mean, ratio=ratio: norm.pdf(y, mean) * ratio(y) ** k, mean - 8.0, mean + 8.0)[0]
            for k in (1, 2)
        )
        exact += weight * first_moment
        error += weight * np.sqrt(second_moment - first_moment**2)
    assert information(means[:, None], weights) == pytest.approx(exact, abs=4.0 * error / np.sqrt(OUTCOMES))


def test_information_is_nothing_at_least_and_entropy_at_most():
    weights = np.array([0.5, 0.3, 0.2])
    assert information(np.ones((3, 2)), weights) == pytest.approx(0.0, abs=1e-12)
    entropy = -float(weights @ np.log2(weights))
    assert information(100.0 * np.eye(3), weights) == pytest.approx(entropy, abs=1e-12)


def test_means_are_as_far_apart_as_noise_and_spread_have_it():
    """Mahalanobis' distances with I + B Bᵀ, dense; of one signal and of two."""
    rng = np.random.default_rng(1)
    differences = {name: rng.standard_normal((20, 3)) for name in ("a", "b")}
    spread = {name: rng.standard_normal((20, 4)) * [0.1, 1.0, 10.0, 100.0] for name in ("a", "b")}
    prediction = Prediction(differences, spread)
    for signals in (["a"], ["a", "b"]):
        B = np.concatenate([spread[name] for name in signals])
        means, plain = prediction.means(signals), np.concatenate([differences[name] for name in signals])
        for i, j in ((0, 1), (0, 2), (1, 2)):
            between = plain[:, i] - plain[:, j]
            exact = between @ np.linalg.solve(np.eye(len(B)) + B @ B.T, between)
            assert np.sum((means[i] - means[j]) ** 2) == pytest.approx(exact, rel=1e-9)


def test_catalogue_can_be_recorded():
    reach = float(np.asarray(MACHINE.joint.range))
    assert len(CANDIDATES) == len(catalogue(MACHINE))
    for candidate in CANDIDATES.values():
        recording = candidate.blank(FULL)
        assert recording.rest * TICK >= REST - 1e-9
        assert not np.any(recording.commands[: recording.rest])
        assert np.max(np.abs(recording.commands)) <= 1.0
        assert np.any(recording.commands[:, 0])
        assert abs(candidate.start_angle) <= reach
        assert {len(values) for values in recording.channels.values()} == {recording.ticks + 1}


def test_an_engine_speed_that_is_asked_for_is_run():
    found = _run("low_engine_speed", [Variants(MACHINE)])
    assert np.mean(found[0]["engine_speed"][150:200]) == pytest.approx(1200.0 * 2.0 * np.pi / 60.0, rel=0.01)


def test_lifted_wheels_hide_the_ground_and_nothing_else():
    """Mean pressure difference that a turn takes more because of an effect. Soft ground acts through the tires' friction, of
    which 2 % are left; friction in the joint takes what its torque takes anywhere, but for a path that the ground shares."""

    def more(candidate, effect, magnitude):
        with_it = Variants.of(MACHINE, [(EFFECTS[effect], (magnitude,))], 1)
        found = _run(candidate, [Variants(MACHINE), with_it])
        without, having = (np.mean(one["pressure_a"][60:] - one["pressure_b"][60:]) for one in found)
        return having - without

    assert abs(more("wheels_lifted", "soft_ground", 0.15)) < 2.0 * SLIPPERY * more("turn_60", "soft_ground", 0.15)
    on_ground, lifted = (more(candidate, "joint_friction", 5000.0) for candidate in ("turn_60", "wheels_lifted"))
    assert lifted == pytest.approx(on_ground, rel=0.1)


def _run(name, variants):
    """What machines do under a candidate."""
    candidate = CANDIDATES[name]
    recording = candidate.blank((*FULL, "engine_speed"))
    return ExperimentSimulator(Simulator(), [candidate]).run([Replay(one, recording) for one in variants])


@pytest.fixture
def linear(monkeypatch):
    """A problem with nothing felt, and a short catalogue."""
    monkeypatch.setattr(experiments, "catalogue", lambda machine: [CANDIDATES["slow_ramp"], CANDIDATES["pulses"]])
    effects = {name: EFFECTS[name] for name in ("spool_lag", "command_delay")}
    recordings = [blank("left", turn(0.6, 2.0), 0.0)]
    problem = Problem(recordings, Nuisances(MACHINE, "day"), effects, error=ModelError(0.003, 0.015, 0.15))
    problem.felt = problem.felt[:0]
    problem.predicted = np.zeros(len(problem.measured))
    problem.slopes = np.zeros((len(problem.measured), 0))
    problem.centre = np.zeros(problem.own(problem.predicted).shape[1])
    problem.shifts = {
        (name, axis.index): np.zeros((len(problem.measured), len(axis.nodes)))
        for name, axes in problem.axes.items()
        for axis in axes
    }
    return Linear(problem, problem.error)


def hypothesis(linear, effects, magnitudes, probability):
    axes = [axis for name in effects for axis in linear.problem.axes[name]]
    places = tuple(float(axis.place(m)) for axis, m in zip(axes, magnitudes, strict=True))
    nuisances = np.zeros(len(linear.problem.centre))
    covariance = 1e-6 * np.eye(len(places))
    return Hypothesis(effects, 0.0, places, nuisances, covariance, refined=True, probability=probability)


def test_causes_that_differ_are_told_apart_and_others_are_not(linear):
    """Dead times of the command that differ by a tenth of the standard deviation of a recording's clock tell nothing, those
    that differ by fifty of these all that there is: the entropy of 0.6 and 0.4."""
    short, alike, late = (
        hypothesis(linear, ("command_delay",), (delay,), p) for delay, p in ((0.01, 0.6), (0.0101, 0.4), (0.06, 0.4))
    )
    assert next_experiments(linear, [short]) == ()
    assert next_experiments(linear, [short, alike]) == ()
    found = next_experiments(linear, [short, late])
    assert [one.gain for one in found] == sorted((one.gain for one in found), reverse=True)
    assert found[0].gain == pytest.approx(0.971, abs=0.02)
    assert found[0].apart == (("command_delay", "command_delay"),)
    assert {one.name for one in found} <= {"slow_ramp", "pulses"}  # pressures are logged: none are to be added


def test_an_uncertain_magnitude_tells_less(linear):
    """A dead time that may as well be that of the other hypothesis, within a standard deviation."""
    first, second = (hypothesis(linear, ("command_delay",), (delay,), 0.5) for delay in (0.01, 0.03))
    between = second.places[0] - first.places[0]
    vague = replace(second, covariance=np.array([[between**2]]))
    sharp, dull = (next_experiments(linear, [first, other]) for other in (second, vague))
    assert sharp[0].gain > 0.9
    # of two means d apart with a spread of d, which half of the weight counts: d/√(1 + d²/2) < √2
    assert all(one.gain < information(np.array([[0.0], [np.sqrt(2.0)]]), np.array([0.5, 0.5])) + 0.02 for one in dull)


def test_nuisances_follow_a_magnitude(linear):
    """Along an effect's axis the fit stays the best one: nuisances −(I + Jᵀ J)⁻¹ Jᵀ S dz beside dz."""
    problem = linear.problem
    count = len(problem.measured)
    problem.felt = np.array([3])
    problem.slopes = np.linspace(0.0, 0.01, count)[:, None]
    problem.centre = np.zeros(1 + len(problem.centre))
    axis = problem.axes["command_delay"][0]
    problem.shifts["command_delay", 0] = 0.02 * np.outer(np.linspace(0.0, 1.0, count), axis.nodes)
    felt = Linear(problem, problem.error)
    best = hypothesis(felt, ("command_delay",), (0.02,), 1.0)
    asked = {}

    class Blank:
        def at(self, points, effects, places):
            asked.update(points=points, places=places)

    _family(felt, Blank(), replace(best, covariance=np.array([[0.01]])), None)  # pyright: ignore[reportArgumentType]
    step = asked["places"][1, 0] - asked["places"][0, 0]
    assert abs(step) == pytest.approx(0.1)
    # the shift of one step is two slopes a unit of the place
    J = felt.tangent.jacobian
    exact = -np.linalg.solve(np.eye(J.shape[1]) + J.T @ J, J.T @ J[:, 0] * 2.0 * step)
    assert asked["points"][1, 3] == pytest.approx(exact[0], rel=1e-6)
    assert not np.any(np.delete(asked["points"], 3, axis=1))


def test_what_cannot_be_simulated_or_is_settled_is_left_out(linear):
    sure = hypothesis(linear, (), (), 0.995)
    unlikely = hypothesis(linear, ("command_delay",), (0.06,), 0.004)
    outside = Hypothesis(("unknown",), 0.0, probability=0.3)
    assert next_experiments(linear, [sure, unlikely]) == ()
    assert next_experiments(linear, [sure, outside]) == ()


def test_machines_are_drawn_from_the_posterior(linear, monkeypatch):
    """Of two nuisances that are felt: normal around the fit with (I + Jᵀ J)⁻¹; of all others the prior. Moments of 20,000
    draws have standard errors of 1 %."""
    monkeypatch.setattr(experiments, "DRAWS", 20_000)
    problem = linear.problem
    problem.felt = np.array([3, 5])
    problem.slopes = np.outer(np.linspace(0.0, 1.0, len(problem.measured)), [0.01, 0.02])
    problem.centre = np.zeros(2 + len(problem.centre))
    felt = Linear(problem, problem.error)
    best = np.zeros(len(problem.centre))
    best[:2] = 1.0, -2.0
    drawn = _drawn(felt, Hypothesis((), 0.0, nuisances=best, refined=True))
    covariance = np.linalg.inv(np.eye(len(best)) + felt.tangent.jacobian.T @ felt.tangent.jacobian)[:2, :2]
    assert covariance[1, 1] < 0.9  # the recordings say something
    np.testing.assert_allclose(np.cov(drawn[:, problem.felt].T), covariance, atol=0.05)
    np.testing.assert_allclose(np.mean(drawn[:, problem.felt], axis=0), [1.0, -2.0], atol=0.04)
    others = np.delete(drawn, problem.felt, axis=1)
    np.testing.assert_allclose(np.cov(others.T), np.eye(others.shape[1]), atol=0.05)
