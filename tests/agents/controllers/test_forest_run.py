"""Controllers of forest runs: they drive to the goal, planners round what stands in the way, each by what it knows."""

from typing import Any

import numpy as np
import pytest

from aoro_gym.agents.controllers.forest_arcs import ArcPlanner
from aoro_gym.agents.controllers.forest_run import (
    BACKING_TIME,
    STOPPED_TIME,
    ForestDriver,
    LidarMap,
    LidarPlanner,
    MapPlanner,
    StraightAhead,
)
from aoro_gym.agents.policies.files import shipped_policies
from aoro_gym.agents.policies.policy import LearnedPolicy
from aoro_gym.envs.forest_run.environment import ForestRunVectorEnv
from aoro_gym.terrains.world.traversability import CELL
from tests.envs.forest_run.worlds import AHEAD, course

LAYOUT = {
    "goal": slice(0, 2), "heading": slice(2, 4), "speed": slice(4, 5), "joint_angle": slice(5, 6),
    "joint_rate": slice(6, 7), "obstacles": slice(7, 11),
}  # fmt: skip


def driver():
    return ForestDriver(LAYOUT, azimuths=np.radians([180.0, 90.0, 0.0, -90.0]))


def observed(place, heading=0.0, *, speed=0.7, joint=0.0, obstacles=(15.0,) * 4):
    """A machine at a place [m] from its goal."""
    c, s = np.cos(heading), np.sin(heading)
    x, y = -np.asarray(place, dtype=float)
    return np.array([[c * x + s * y, c * y - s * x, c, s, speed, joint, 0.0, *obstacles]], dtype=np.float32)


def test_places_follow_from_goal_and_heading():
    seen = driver().see(observed((-12.0, 3.0), 0.8))
    np.testing.assert_allclose(seen.place, [[-12.0, 3.0]], atol=1e-5)
    np.testing.assert_allclose(seen.heading, [0.8], atol=1e-6)


def test_the_joint_turns_towards_the_goal():
    policy = StraightAhead(driver())
    for y, sign in ((-5.0, 1.0), (5.0, -1.0), (0.0, 0.0)):
        steering, drive = policy(observed((-10.0, y)))[0]
        assert np.sign(steering) == sign and drive == pytest.approx(0.66)
    # what lies behind is reached in the tightest turn
    assert policy(observed((10.0, -0.1)))[0, 0] > 0.5


def test_who_is_stopped_backs_out_and_goes_on():
    policy, step = StraightAhead(driver()), driver().control_step
    still = observed((-10.0, 0.0), speed=0.0)
    signals = [float(policy(still)[0, 1]) for _ in range(round((STOPPED_TIME + 1.0) / step))]
    backs = np.flatnonzero(np.array(signals) < 0.0)
    assert backs[0] * step == pytest.approx(STOPPED_TIME, abs=2.1 * step)
    moving = observed((-10.0, 0.0), speed=-0.5)
    signals = [float(policy(moving)[0, 1]) for _ in range(round(BACKING_TIME / step) + 2)]
    assert signals[0] < 0.0 and signals[-1] > 0.0
    for _ in range(round(STOPPED_TIME / step) + 2):
        policy(still)
    policy.reset(np.array([True]))
    assert policy(still)[0, 1] > 0.0


def test_a_map_of_echoes_knows_where_something_stood():
    known = LidarMap(np.array([-10.0, 0.0]))
    known.add(np.array([[-5.0, 1.0]]))
    assert np.isinf(known.measured(2.0).room).all()
    known.add(np.array([[-5.0, 1.0], [200.0, 0.0]]))  # what lies off the map is left out
    line = np.array([[x, 1.0] for x in np.arange(-9.0, -1.0, 0.5)])
    # nodes stand for places half a cell around them
    assert known.measured(2.0).min_along(line) <= 0.5 * CELL
    assert known.min_along(np.array([[-5.0, 5.0]])) == pytest.approx(4.0, abs=CELL)
    assert known.min_along(np.zeros((0, 2))) == np.inf


def test_the_way_is_planned_anew_where_something_stands_in_it():
    policy = LidarPlanner(driver(), hits=1.0)
    free = observed((-12.0, 0.0))
    policy(free)
    straight = policy._ways[0].copy()
    assert np.abs(straight[:, 1]).max() < 0.3
    blocked = observed((-12.0, 0.0), obstacles=(15.0, 15.0, 6.0, 15.0))
    for _ in range(4):
        policy(blocked)
    way = policy._ways[0]
    stem = np.array([-12.0 + 0.7 + 6.0, 0.0])
    assert np.hypot(*(way - stem).T).min() > 1.6 - CELL
    policy.reset(np.array([True]))
    policy(free)
    np.testing.assert_array_equal(policy._ways[0], straight)  # nothing is remembered


@pytest.fixture(scope="module")
def env():
    return ForestRunVectorEnv(3, courses=[course()], autoreset_mode="Disabled")


def endings(env: Any, policy: Any) -> list[str]:
    policy.reset()
    observations, _ = env.reset(seed=3, options={"path": np.array([0, 1, 0])})
    found = [""] * env.num_envs
    for _ in range(500):
        observations, _, terminated, truncated, infos = env.step(policy(observations))
        ended = terminated | truncated
        for i in np.flatnonzero(ended):
            found[i] = found[i] or (infos["termination"][i] if terminated[i] else "time")
        if all(found):
            break
        if ended.any():
            observations, _ = env.reset(options={"reset_mask": ended})
            policy.reset(ended)
    return found


def test_planners_go_round_the_stem_that_stops_who_does_not_look(env):
    known = ForestDriver.of(env)
    assert AHEAD < 21.0  # it stands between start and goal
    assert endings(env, StraightAhead(known)) == ["hit an object", "goal reached", "hit an object"]
    seen = endings(env, LidarPlanner(known))  # by what the lidar's noise shows it may be late
    assert seen.count("goal reached") >= 2 and "hit an object" not in seen
    assert endings(env, MapPlanner(known, env)) == ["goal reached"] * 3
    assert endings(env, ArcPlanner(known, env)) == ["goal reached"] * 3
    learned = LearnedPolicy.load(shipped_policies("AORO/ForestRun-v0")["forest-dagger"]).made_for(env)
    assert endings(env, learned) == ["goal reached"] * 3


def test_whose_map_is_planned_on_can_be_changed(env):
    policy = MapPlanner(ForestDriver.of(env), None).watching(env)
    observations, _ = env.reset(seed=3, options={"path": 0})
    assert policy(observations).shape == (3, 2)


def test_terms_that_are_missing_are_named():
    without = {name: where for name, where in LAYOUT.items() if name != "obstacles"}
    with pytest.raises(ValueError, match="obstacles"):
        LidarPlanner(ForestDriver(without))
    with pytest.raises(ValueError, match="goal"):
        ForestDriver({"speed": slice(0, 1)})
