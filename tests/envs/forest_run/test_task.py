"""Forest runs: what is seen, what objects do, how episodes end."""

from typing import Any

import numpy as np
import pytest

from aoro_gym.envs.forest_run import rewards
from aoro_gym.envs.forest_run.config import FIXED, ForestRunConfig, ForestRunRandomisation
from aoro_gym.envs.forest_run.environment import ForestRunEnv, ForestRunVectorEnv
from aoro_gym.envs.forest_run.obstacles import ObstacleView
from aoro_gym.envs.path_tracking.courses import Course
from aoro_gym.terrains import Path, Terrain
from aoro_gym.terrains.world.world import World
from tests.envs.forest_run.worlds import AHEAD, BESIDE, course

EXACT = ForestRunRandomisation(sensor_noise=(0.0, 0.0), lateral_offset=(0.0, 0.0), heading_offset=(0.0, 0.0))


def make(num_envs=1, path: Any = 0, *, config=None, **arguments) -> Any:
    config = ForestRunConfig(randomisation=EXACT) if config is None else config
    env = ForestRunVectorEnv(num_envs, courses=[course()], config=config, autoreset_mode="Disabled", **arguments)
    env.reset(seed=0, options={"path": path})
    return env


def drive(env, steering=0.0, signal=0.66, steps=300):
    """Observations, rewards, infos and whether it ended, until the first one ends."""
    actions = np.broadcast_to(np.array([steering, signal], dtype=np.float32), env.action_space.shape)
    kept = []
    for _ in range(steps):
        observation, reward, terminated, truncated, infos = env.step(actions)
        kept.append((observation, reward, infos))
        if terminated[0] or truncated[0]:
            break
    return kept


# ---- what is seen ----------------------------------------------------------------------------------------------------


def test_the_goal_is_seen_in_the_machines_axes():
    config = ForestRunConfig(randomisation=ForestRunRandomisation(sensor_noise=(0.0, 0.0), lateral_offset=(0.0, 0.0)))
    env = make(config=config)
    observation, infos = env.reset(seed=0, options={"path": 0, "heading_offset": 0.3})
    columns = env.observation_layout
    # antennas are at their places, errors are none
    np.testing.assert_allclose(observation[0, columns["heading"]], [np.cos(0.3), np.sin(0.3)], atol=1e-3)
    np.testing.assert_allclose(observation[0, columns["goal"]], [21 * np.cos(0.3), -21 * np.sin(0.3)], atol=0.02)
    assert infos["remaining"][0] == pytest.approx(21.0, abs=1e-3)
    assert infos["route_length"][0] == pytest.approx(21.0, abs=1e-3)


def test_stems_stand_up_and_the_ground_does_not():
    env = make()
    view: Any = env.task.observation_terms["obstacles"].function
    shown = env.task.observation_terms["obstacles"].function(env.task.view())[0]
    near = np.flatnonzero(shown < view.lidar.model.max_range)
    lidar_ahead = view.lidar.mounting.position[0] - 1.7
    x, y = 8.0 - lidar_ahead, BESIDE
    assert len(near) >= 1
    beside = near[np.argmin(shown[near])]
    # a sector is 4° wide, the stem 0.3 m and more at its foot; the mounting's errors are those of its typical spread
    assert np.degrees(view.azimuths[beside]) == pytest.approx(np.degrees(np.arctan2(y, x)), abs=5.0)
    assert shown[beside] == pytest.approx(np.hypot(x, y) - 0.15, abs=0.3)
    # nothing else stands within reach but the stem ahead
    for sector in near:
        assert any(
            abs(np.degrees(view.azimuths[sector] - np.arctan2(b, a))) < 6.0
            for a, b in ((x, y), (AHEAD - lidar_ahead, 0.0))
        )


def test_ground_on_a_slope_does_not_stand_up():
    """Heights of 10 % along and 10 % across: the inertial unit takes the tilt off."""
    x = np.arange(-30.0, 31.0)
    slope = Terrain.from_heights(0.1 * x[None] + 0.1 * x[:, None], cell=1.0, corner=(-30.0, -30.0))
    run = Path(np.array([[0.0, 0.0], [20.0, 0.0]]))
    env = ForestRunVectorEnv(
        1, courses=[Course.over(World(slope), (run,))], config=ForestRunConfig(randomisation=EXACT)
    )
    observation, _ = env.reset(seed=0)
    shown = observation[0, env.observation_layout["obstacles"]]
    assert np.all(shown == shown.max())


# ---- what happens ----------------------------------------------------------------------------------------------------


def test_the_free_run_ends_at_the_goal():
    env = make(path=1)
    kept = drive(env)
    infos = kept[-1][2]
    assert infos["termination"][0] == "goal reached" and infos["is_success"][0]
    assert infos["remaining"][0] <= 1.5 and infos["damage"][0] == 0.0
    # straight on, at some 0.07 m a step
    assert infos["way"][0] == pytest.approx(21.0 - 1.5, abs=0.15)


def test_a_stem_stops_the_machine_and_counts_as_damage():
    env = make()
    kept = drive(env)
    infos = kept[-1][2]
    assert infos["termination"][0] == "hit an object" and not infos["is_success"][0]
    assert infos["chassis_force"][0] > 50e3
    assert infos["damage"][0] >= infos["chassis_force"][0] * env.task.control_step * 0.999
    assert infos["contact_time"][0] > 0.0
    # the hull ends some 2.5 m before the hinge, 0.8 m before the axle
    assert 1.5 + AHEAD - 2.0 > infos["way"][0] > AHEAD - 2.0


def test_a_softer_push_may_last():
    env = make(config=ForestRunConfig(randomisation=EXACT, chassis_force_limit=1e9, stuck_time=3.0))
    kept = drive(env, steps=400)
    infos = kept[-1][2]
    assert infos["termination"][0] == "stuck"
    pushed = [float(k[2]["chassis_force"][0]) for k in kept]
    # impulse is the sum of the steps' forces
    assert infos["damage"][0] == pytest.approx(sum(pushed) * env.task.control_step, rel=1e-5)
    assert infos["contact_time"][0] == pytest.approx(sum(force > 0 for force in pushed) * env.task.control_step)


def test_time_is_up_after_that_of_the_route():
    config = ForestRunConfig(randomisation=EXACT, time_margin=1.0, stuck_time=1e6)
    env = make(config=config)
    actions = np.zeros(env.action_space.shape, dtype=np.float32)
    steps = 0
    truncated = np.zeros(1, dtype=bool)
    while not truncated.any():
        *_, terminated, truncated, _ = env.step(actions)
        steps += 1
        assert not terminated.any() and steps < 400
    assert steps == int(np.ceil(21.0 / 0.75 / 0.1))


def test_rewards_are_what_they_say():
    env = make(2)
    kept = drive(env, steps=5)
    view = env.task.view()
    step = 0.1 * 0.75
    np.testing.assert_allclose(rewards.progress(view), view.nearer / step)
    np.testing.assert_allclose(rewards.damage(view), 0.0)
    np.testing.assert_allclose(rewards.elapsed(view), 1.0)
    np.testing.assert_allclose(rewards.energy(view), view.engine_power / 1e5)
    assert not rewards.finish(view).any() and not rewards.failure(view).any()
    assert len(kept) == 5


def test_one_environment_is_the_first_of_many():
    single: Any = ForestRunEnv(courses=[course()])
    vector: Any = ForestRunVectorEnv(2, courses=[course()])
    one, many = single.reset(seed=5)[0], vector.reset(seed=5)[0]
    np.testing.assert_array_equal(one, many[0])
    action = np.array([0.5, 0.5], dtype=np.float32)
    for _ in range(3):
        one, many = single.step(action)[0], vector.step(np.stack([action] * 2))[0]
    np.testing.assert_array_equal(one, many[0])


def test_tensors_give_the_same():
    pytest.importorskip("torch")
    plain = make(2, path=np.array([0, 1]))
    tensors = make(2, path=np.array([0, 1]), output="torch")
    action = np.tile(np.array([0.4, 0.6], dtype=np.float32), (2, 1))
    for _ in range(3):
        expected, found = plain.step(action), tensors.step(tensors.arrays.asarray(action))
    np.testing.assert_allclose(found[0].numpy(), expected[0], rtol=1e-4, atol=1e-4)
    np.testing.assert_allclose(found[1].numpy(), expected[1], rtol=1e-4, atol=1e-4)


def test_difficulty_chooses_among_worlds():
    twice = [course(), Course.over(course().ground, course().paths[1:], name="free only")]
    env = ForestRunVectorEnv(
        4, courses=twice, randomisation=ForestRunRandomisation(difficulty=(0.5, 1.0)), autoreset_mode="Disabled"
    )
    _, infos = env.reset(seed=0)
    assert np.all(infos["terrain"] == 1)
    assert FIXED.difficulty == (0.0, 1.0)


@pytest.mark.parametrize(
    ("make_it", "message"),
    [
        (lambda: ForestRunConfig(goal_tolerance=0.0), "goal_tolerance is 0, but must be"),
        (lambda: ForestRunConfig(chassis_force_limit=-1.0), "chassis_force_limit is -1 N, but must be"),
        (lambda: ForestRunConfig(randomisation=None), "must be a ForestRunRandomisation"),  # type: ignore[arg-type]
        (lambda: ForestRunRandomisation(start=(0.0, 0.5)), "randomisation.start is"),
        (lambda: ObstacleView(steepest_deg=90.0), "steepest_deg is 90 deg, but must be"),
    ],
)
def test_what_is_wrong_is_named(make_it, message):
    with pytest.raises(ValueError, match=message):
        make_it()
