"""Environments on soft ground: ruts in infos and rewards."""

from typing import Any

import gymnasium
import numpy as np
import pytest

from aoro_gym.envs.core.rollouts import Rollouts
from aoro_gym.envs.core.ruts import DEEP_RUT, RUT_ROWS
from aoro_gym.terrains.soil import Soil
from aoro_gym.twin.records import WHEELS


@pytest.fixture(scope="module")
def steps():
    """Three environments that turn alike for 10 steps: on peat with the term, on peat without it, on hard ground with
    it; and their rewards and infos."""
    out = []
    charged = {"rut_depth": -2.0}
    cases: list[dict[str, Any]] = [
        {"soil": "peat", "reward_terms": charged},
        {"soil": "peat"},
        {"reward_terms": charged},
    ]
    for arguments in cases:
        env: Any = gymnasium.make_vec("AORO/Turning-v0", num_envs=2, **arguments)
        env.reset(seed=3)
        taken = [env.step(np.full(env.action_space.shape, 0.5, dtype=np.float32)) for _ in range(10)]
        out.append((env.unwrapped, [step[1] for step in taken], [step[4] for step in taken]))
    return out


def test_ruts_are_told_and_rewarded(steps):
    (soft, charged, infos), (_, free, _), (_, hard, hard_infos) = steps
    depth = np.mean([soft.output(f"rut_depth_{wheel}") for wheel in WHEELS], axis=0)
    assert (depth > 0.1).all()
    np.testing.assert_allclose(infos[-1]["rut_depth"], depth, rtol=1e-6)
    for step in range(10):
        cost = 2.0 * infos[step]["rut_depth"] / DEEP_RUT
        np.testing.assert_allclose(free[step] - charged[step], cost, atol=1e-5)
        assert "rut_depth" not in hard_infos[step] and np.isfinite(hard[step]).all()


def test_channels_of_soil_are_those_of_twins_on_soil(steps):
    soft, hard = steps[0][0], steps[2][0]
    assert len(RUT_ROWS) == 4
    assert (soft.output("sinkage_fl") > 0.1).all()
    with pytest.raises(ValueError, match="only twins on soil have it"):
        hard.output("sinkage_fl")
    with pytest.raises(ValueError, match="only twins in a world with solid objects have it"):
        soft.output("touched_object_fl")


def test_copies_of_episodes_have_their_ruts():
    """What is tried on copies comes to what the episodes then come to, to the bit: they stand in the same ruts of
    their own soil."""
    soil = Soil.preset("peat", cohesion=[2e3, 9e3])
    env: Any = gymnasium.make_vec("AORO/Turning-v0", num_envs=2, soil=soil, reward_terms={"rut_depth": -1.0}).unwrapped
    env.reset(seed=1)
    left = np.full((2, 1), 0.7, dtype=np.float32)
    for _ in range(5):
        env.step(left)
    tried = Rollouts(env, copies=2)
    tried.load(env)
    for _ in range(3):
        rewards, _ = tried.step(np.repeat(left, 2, axis=0))
        _, expected, *_ = env.step(left)
        np.testing.assert_array_equal(rewards, np.repeat(expected, 2))
