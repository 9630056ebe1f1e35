"""Policies side by side in the same episodes."""

import numpy as np

from aoro_gym.agents.evaluation.evaluate import policy_factory
from aoro_gym.agents.evaluation.watching import WatchedEpisodes
from aoro_gym.machine import Machine
from aoro_gym.twin.records import State

TURNING = "AORO/Turning-v0"
MACHINE = Machine.load("aoro")


def watched(*names: str, seed: int = 3) -> WatchedEpisodes:
    return WatchedEpisodes(TURNING, {name: policy_factory(TURNING, name) for name in names}, machine=MACHINE, seed=seed)


def angles(episodes: WatchedEpisodes, steps: int) -> np.ndarray:
    """Joint angles (steps, policies) [rad]."""
    found = []
    for _ in range(steps):
        episodes.step()
        found.append(np.array(episodes.env.output("joint_angle")))
    return np.array(found)


def test_each_policy_drives_the_episode_as_if_it_were_alone():
    names, steps = ("proportional-derivative", "bang-bang"), 60
    together = angles(watched(*names), steps)
    assert np.ptp(together[:, 0] - together[:, 1]) > 0.01
    for column, name in enumerate(names):
        np.testing.assert_array_equal(together[:, column], angles(watched(name), steps)[:, 0])


def test_the_next_episode_has_the_next_seed():
    begun, earlier, row = watched("bang-bang", seed=4), watched("bang-bang", seed=3), int(State.JOINT)
    start = begun.env.twin.state.numpy()[row]
    angles(earlier, 499)
    assert earlier.env.twin.state.numpy()[row] != start
    earlier.step()  # 10 s
    np.testing.assert_array_equal(earlier.env.twin.state.numpy()[row], start)
    earlier.step()
    begun.step()
    np.testing.assert_array_equal(earlier.env.output("joint_angle"), begun.env.output("joint_angle"))
