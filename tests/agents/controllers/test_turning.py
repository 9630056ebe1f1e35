"""Reference controllers do as their formula says, and reach their targets."""

import doctest
import math

import numpy as np
import pytest

import aoro_gym.agents
from aoro_gym.agents import BangBang, Policy, ProportionalDerivative
from aoro_gym.agents.evaluation.responses import responses, rollout
from aoro_gym.envs.turning.config import TurningConfig
from aoro_gym.envs.turning.environment import TurningVectorEnv

LAYOUT = {"joint_rate": slice(0, 1), "error": slice(1, 2)}
CONTROLLERS = [BangBang, ProportionalDerivative]


def observe(rate, error):
    return np.stack(np.broadcast_arrays(np.float32(rate), np.float32(error)), axis=-1)


def test_example_of_the_package():
    tried = doctest.testmod(aoro_gym.agents)
    assert tried.attempted > 0
    assert tried.failed == 0


def test_bang_bang_switches_at_its_threshold():
    policy = BangBang(LAYOUT, threshold=0.02, lead_time=0.1)
    actions = policy(observe([0.0, 0.0, 0.0, 0.0, 0.5, -0.5, 0.5], [0.03, -0.03, 0.01, -0.01, 0.06, -0.06, 0.02]))
    np.testing.assert_array_equal(actions[:, 0], [1.0, -1.0, 0.0, 0.0, 0.0, 0.0, -1.0])


def test_proportional_derivative_lifts_the_signal_over_the_dead_band():
    policy = ProportionalDerivative(
        LAYOUT, gain=2.0, lead_time=0.1, dead_band_left=0.1, dead_band_right=0.2, rest_error=0.01
    )
    actions = policy(observe([0.0, 0.0, 0.5, 0.0, 0.0], [0.25, -0.25, 0.05, 0.005, 3.0]))
    np.testing.assert_allclose(actions[:, 0], [0.1 + 0.9 * 0.5, -(0.2 + 0.8 * 0.5), 0.0, 0.0, 1.0], rtol=1e-6)


@pytest.mark.parametrize("kind", CONTROLLERS)
def test_gains_may_differ_between_sub_environments(kind):
    policy: Policy = kind(LAYOUT, lead_time=np.array([0.0, 0.2]))
    policy.reset()
    actions = policy(observe([0.5, 0.5], [0.05, 0.05]))
    assert actions.shape == (2, 1)
    assert actions.dtype == np.float32
    assert actions[0] > 0.0 > actions[1]


@pytest.mark.parametrize("kind", CONTROLLERS)
def test_missing_observations_are_named(kind):
    with pytest.raises(ValueError, match="needs the observation term 'joint_rate', but the environment observes error"):
        kind({"error": slice(0, 1)})


@pytest.mark.parametrize("kind", CONTROLLERS)
def test_controllers_reach_their_targets(kind):
    """The proportional one all of them. Full signal or none lets the joint swing on its oil, by half a degree to two: one
    target in ten may be left for good before it rests within the tolerance of 1°."""
    env = TurningVectorEnv(12, autoreset_mode="Disabled")
    run = rollout(env, kind(env.observation_layout), seed=100)
    found = responses(run, tolerance=TurningConfig().tolerance)
    assert len(found["step"]) >= 30
    settled = np.isfinite(found["settling_time"])
    if kind is BangBang:
        assert settled.mean() > 0.85
    else:
        assert run.success.all() and settled.all()
    # the largest step takes about 2 s at full signal, and a controller needs little more
    assert np.quantile(found["settling_time"][settled], 0.9) < 2.5
    assert found["overshoot"].mean() < math.radians(2.0)
    assert np.median(run.returns) > 250.0  # of 500


def test_a_rollout_needs_an_environment_that_waits():
    env = TurningVectorEnv(1)
    with pytest.raises(ValueError, match="autoreset_mode is 'NextStep', but a rollout needs 'Disabled'"):
        rollout(env, BangBang(env.observation_layout), seed=0)


def test_a_lost_twin_stops_a_rollout():
    env = TurningVectorEnv(2, autoreset_mode="Disabled")

    class Saboteur:
        def __call__(self, observations):
            env.twin.state.numpy()[:, 1] = np.nan
            return np.zeros((2, 1), dtype=np.float32)

        def reset(self, mask=None):
            pass

    with pytest.raises(RuntimeError, match="sub-environment 1 ended early: simulation diverged"):
        rollout(env, Saboteur(), seed=0)
