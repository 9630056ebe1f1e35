"""The tracking task: signs, measurements, endings, judgement, options."""

import math
from dataclasses import replace
from typing import Any

import gymnasium
import numpy as np
import pytest

from aoro_gym.envs import register_envs
from aoro_gym.envs.path_tracking.config import FIXED, MILD, PathTrackingConfig, PathTrackingRandomisation
from aoro_gym.envs.path_tracking.courses import Course
from aoro_gym.envs.path_tracking.environment import PathTrackingEnv, PathTrackingVectorEnv
from aoro_gym.envs.path_tracking.task import END_OF_PATH, TERMINATION_REASONS
from aoro_gym.sensors import FixLoss, GpsNoise, JointAngleNoise, WheelSpeedNoise
from aoro_gym.terrains import Path, Plane, Terrain
from aoro_gym.twin.records import COMMAND_BOUNDS, State
from tests.envs.path_tracking.paths import LEVEL, LINE, arc, circle

register_envs()
NAME = "AORO/PathTracking-v0"
EXACT = PathTrackingRandomisation(
    sensor_noise=(0.0, 0.0), joint_angle=(0.0, 0.0), lateral_offset=(0.0, 0.0), heading_offset=(0.0, 0.0)
)


def make(num_envs=1, *, courses=(LEVEL,), randomisation=EXACT, autoreset_mode="Disabled", **arguments) -> Any:
    return PathTrackingVectorEnv(
        num_envs, courses=courses, randomisation=randomisation, autoreset_mode=autoreset_mode, **arguments
    )


def drive(env, steering=0.0, speed=0.0, steps=1):
    action = np.zeros(env.action_space.shape, dtype=np.float32)
    action[:, 0], action[:, 1] = steering, speed
    for _ in range(steps):
        result = env.step(action)
        if (result[2] | result[3]).any():
            break
    return result


def pursue(env, observations, signal=0.8):
    """Action of a plain pursuit of the preview's third place."""
    layout = env.observation_layout
    x, y = observations[:, layout["preview"]].reshape(env.num_envs, -1, 2)[:, 2].T
    error = 2.0 * y / (x * x + y * y) * 3.4 - observations[:, layout["joint_angle"]][:, 0]
    action = np.zeros(env.action_space.shape, dtype=np.float32)
    action[:, 0] = np.where(np.abs(error) > 0.01, np.sign(error) * np.clip(0.12 + 3.0 * np.abs(error), 0.0, 1.0), 0.0)
    action[:, 1] = signal
    return action


def term(env, observations, name):
    return observations[0, env.observation_layout[name]]


# ---- what is seen ----------------------------------------------------------------------------------------------------


def test_errors_are_positive_to_the_left():
    env = make()
    for offset, turned in ((0.4, 0.0), (-0.3, 0.1), (0.0, -0.2)):
        options = {"path": 0, "start": 10.0, "lateral_offset": offset, "heading_offset": turned, "joint_angle": 0.0}
        observations, infos = env.reset(seed=0, options=options)
        # float32 of the pose; the reference point is 1.7 m ahead of the hinge
        assert infos["cross_track"][0] == pytest.approx(offset, abs=1e-4)
        assert infos["heading_error"][0] == pytest.approx(turned, abs=1e-5)
        assert infos["remaining"][0] == pytest.approx(30.0, abs=1e-4)
        np.testing.assert_allclose(term(env, observations, "cross_track"), offset, atol=1e-4)
        np.testing.assert_allclose(term(env, observations, "heading_error"), turned, atol=1e-5)
        preview = term(env, observations, "preview").reshape(-1, 2)
        ahead = np.array(PathTrackingConfig().preview)
        s, c = math.sin(turned), math.cos(turned)
        np.testing.assert_allclose(preview[:, 0], c * ahead - s * offset, atol=1e-3)
        np.testing.assert_allclose(preview[:, 1], -s * ahead - c * offset, atol=1e-3)
        np.testing.assert_array_equal(term(env, observations, "actions"), 0.0)


def test_bends_are_seen_ahead_and_the_joint_starts_bent():
    env = make()
    observations, _ = env.reset(seed=0, options={"path": 1, "start": 8.0})
    np.testing.assert_allclose(term(env, observations, "curvature"), 0.1, rtol=0.02)
    frames = env.twin.machine.frame
    wheelbase = float(frames.front.axle_distance + frames.rear.axle_distance)
    assert env.output("joint_angle")[0] == pytest.approx(0.1 * wheelbase, rel=0.02)
    preview = term(env, observations, "preview").reshape(-1, 2)
    for (x, y), along in zip(preview, PathTrackingConfig().preview, strict=True):
        assert (x, y) == pytest.approx((10 * math.sin(along / 10), 10 - 10 * math.cos(along / 10)), abs=0.01)


def test_steering_left_leads_left_and_driving_forward_gains_path():
    env = make()
    env.reset(seed=0, options={"path": 0})
    infos = drive(env, 0.6, 0.8, 60)[4]
    assert infos["cross_track"][0] > 0.1
    assert infos["heading_error"][0] > 0.05
    assert 40.0 - 4.0 - infos["remaining"][0] > 1.0


def test_exact_sensors_show_the_true_motion():
    noiseless = PathTrackingConfig(
        joint_angle_noise=JointAngleNoise(), gps_noise=GpsNoise(), wheel_speed_noise=WheelSpeedNoise()
    )
    env = make(config=noiseless)
    env.reset(seed=0, options={"path": 0})
    drive(env, 0.0, 0.7, 60)
    observations, _, _, _, infos = drive(env, 0.3, 0.7, 40)
    view = env.task.view()
    np.testing.assert_allclose(term(env, observations, "joint_angle"), env.output("joint_angle"), atol=1e-6)
    np.testing.assert_allclose(term(env, observations, "yaw_rate"), env.output("yaw_rate"), atol=1e-6)
    assert term(env, observations, "speed")[0] == pytest.approx(float(view.speed[0]), rel=0.05)  # slip and turn
    # dead reckoning over at most 0.2 s since the shown instant
    np.testing.assert_allclose(term(env, observations, "cross_track"), infos["cross_track"], atol=0.02)
    np.testing.assert_allclose(term(env, observations, "heading_error"), infos["heading_error"], atol=0.01)


@pytest.mark.slow
def test_typical_sensors_err_by_centimetres_and_a_lost_fix_by_more():
    errors = {}
    for name, loss in (("fixed", FixLoss()), ("lost", FixLoss(interval=1.0, float_duration=20.0, none_share=0.0))):
        env = make(16, config=PathTrackingConfig(gps_noise=GpsNoise.typical(loss)), randomisation=FIXED)
        env.reset(seed=0, options={"path": 0})
        difference = []
        for _ in range(200):
            observations, *_, infos = drive(env, 0.0, 0.5)
            difference.append(observations[:, env.observation_layout["cross_track"]][:, 0] - infos["cross_track"])
        errors[name] = float(np.sqrt(np.mean(np.square(difference[100:]))))
        assert (infos["gps_quality"] == (2 if name == "fixed" else 1)).mean() > 0.7
    assert 0.005 < errors["fixed"] < 0.04
    assert errors["lost"] > 2 * errors["fixed"]


def test_options_add_actions_and_observations():
    env = make(
        act_arms=True, act_traction=True, act_gear=True, observe_inertial=True, scan_x=(0.0, 4.0),
        courses=[Course(Plane(slope_deg=5.0), (LINE,))],
    )  # fmt: skip
    assert env.single_action_space.shape == (11,)
    assert list(env.action_layout) == ["steering_signal", "drive_signal", "arms", "traction", "gear"]
    observations, _ = env.reset(seed=0)
    np.testing.assert_allclose(
        term(env, observations, "heights"), np.repeat([0.0, 4.0], 5) * math.tan(math.radians(5)), atol=0.02
    )
    inertial = term(env, observations, "inertial")
    # nose up by 5°: gravity pushes forward
    np.testing.assert_allclose(inertial[2:], [math.sin(math.radians(5)), 0.0, math.cos(math.radians(5))], atol=0.02)
    action = np.zeros((1, 11), dtype=np.float32)
    action[0, env.action_layout["arms"]] = [1.0, -1.0, 0.5, 0.0]
    action[0, env.action_layout["traction"]] = [1.0, 0.0, -0.5, -1.0]
    action[0, env.action_layout["gear"]] = 1.0
    observations, *_ = env.step(action)
    rows = {name: env.twin.commands.numpy()[i, 0] for i, name in enumerate(COMMAND_BOUNDS)}
    assert [rows[f"arm_{w}"] for w in ("fl", "fr", "rl", "rr")] == [1.0, -1.0, 0.5, 0.0]
    assert [rows[f"traction_{w}"] for w in ("fl", "fr", "rl", "rr")] == [1.0, 1.0, 0.5, 0.0]
    assert rows["gear"] == 3.0
    assert term(env, observations, "gear") == 3.0


def test_automatic_gear_shifts_on_a_straight():
    env = make(gear="automatic")
    env.reset(seed=0, options={"path": 0})
    gears, speeds = [], []
    for _ in range(160):
        *_, infos = drive(env, 0.0, 1.0)
        gears.append(int(infos["gear"][0]))
        speeds.append(env.output("speed")[0])
    assert gears[0] == 1 and max(gears) == 3
    assert speeds[-1] > 1.5 * max(speed for speed, gear in zip(speeds, gears, strict=True) if gear == 1)


# ---- how episodes end ------------------------------------------------------------------------------------------------


def ending(env, options, *, steering=0.0, speed=0.0, steps=400):
    env.reset(seed=0, options=options)
    _, _, terminated, truncated, infos = drive(env, steering, speed, steps)
    return bool(terminated[0]), bool(truncated[0]), infos.get("termination", [None])[0], infos


def test_the_end_of_the_path_is_a_success():
    terminated, truncated, reason, infos = ending(make(), {"path": 0, "start": 37.0}, speed=0.8)
    assert (terminated, truncated, reason) == (True, False, END_OF_PATH)
    assert infos["is_success"][0]
    assert infos["reward/finish"][0] == 20.0
    assert infos["reward/failure"][0] == 0.0
    assert infos["remaining"][0] <= PathTrackingConfig().end_tolerance


def test_time_is_up_after_its_margin():
    config = PathTrackingConfig(time_margin=2.0, working_speed=0.75, stuck_time=1e3)
    terminated, truncated, reason, infos = ending(make(config=config), {"path": 0, "start": 37.0})
    assert (terminated, truncated, reason) == (False, True, None)
    assert not infos["is_success"][0]
    env = make(config=config)
    env.reset(seed=0, options={"path": 0, "start": 37.0})
    steps = 0
    while not drive(env)[3][0]:
        steps += 1
    assert (steps + 1) * 0.05 == pytest.approx(2.0 * 3.0 / 0.75)


def test_standing_still_is_being_stuck():
    terminated, _, reason, infos = ending(make(config=PathTrackingConfig(stuck_time=2.0)), {"path": 0})
    assert (terminated, reason) == (True, "stuck")
    assert infos["reward/failure"][0] == -50.0
    assert not infos["is_success"][0]


def test_a_path_can_be_lost():
    terminated, _, reason, _ = ending(make(), {"path": 0, "lateral_offset": 2.5}, steering=1.0, speed=1.0)
    assert (terminated, reason) == (True, "lost the path")


def square(half=15.0, height=0.0):
    corners = np.array([[x, y, height] for x, y in ((-half, -half), (half, -half), (half, half), (-half, half))])
    return Terrain(corners, np.array([[0, 1, 2], [0, 2, 3]]))


def test_a_terrain_can_be_left():
    path = Path(np.stack([np.arange(-10.0, 25.0), np.zeros(35)], axis=1))  # leads over the edge
    terminated, _, reason, infos = ending(make(courses=[Course(square(), (path,))]), {"start": 20.0}, speed=1.0)
    assert (terminated, reason) == (True, "left the terrain")
    assert infos["remaining"][0] == pytest.approx(34.0 - 25.0, abs=0.1)


def test_a_machine_can_roll_over():
    env = make()
    env.reset(seed=0)
    half = math.radians(60.0) / 2
    state = env.twin.state.numpy()
    state[int(State.QX) : int(State.QX) + 4, 0] = [math.sin(half), 0.0, 0.0, math.cos(half)]
    state[State.Z, 0] += 1.0
    _, rewards, terminated, _, infos = drive(env)
    assert terminated[0]
    assert infos["termination"][0] == "rolled over"
    assert rewards[0] < -40.0


def test_a_lost_twin_ends_its_episode():
    env = make(2)
    env.reset(seed=0)
    env.twin.state.numpy()[State.JOINT_RATE, 1] = np.nan
    observations, rewards, terminated, _, infos = drive(env)
    assert terminated.tolist() == [False, True]
    assert infos["termination"][1] == "simulation diverged: non-finite state"
    assert not infos["is_success"][1]
    assert np.isfinite(observations).all() and rewards[1] == 0.0
    observations, _ = env.reset(options={"reset_mask": terminated})
    assert np.isfinite(observations).all()


def test_every_ending_has_its_test():
    # what hits an object is tested in tests/envs/core/test_solid_objects.py
    bad = {"rolled over", "left the terrain", "lost the path", "stuck", "hit an object"}
    assert set(TERMINATION_REASONS) == {"", END_OF_PATH, *bad}


# ---- whole episodes --------------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_a_closed_path_is_driven_around():
    env = make(courses=[Course(Plane(), (circle(8.0),))])
    observations, infos = env.reset(seed=0, options={"start": 0.0})
    assert infos["remaining"][0] == pytest.approx(2 * math.pi * 8.0, rel=1e-3)
    for _ in range(1400):
        observations, _, terminated, truncated, infos = env.step(pursue(env, observations, 0.9))
        if terminated[0] or truncated[0]:
            break
    assert infos["termination"][0] == END_OF_PATH
    assert infos["cross_track_rms"][0] < 0.5


def test_reward_is_the_sum_of_its_logged_terms_in_their_closed_forms():
    env = make()
    env.reset(seed=0, options={"path": 0, "lateral_offset": 0.3})
    before = env.task._s.copy()
    _, rewards, *_, infos = drive(env, 0.5, 1.0)
    view = env.task.view()
    expected = {
        "progress": (env.task._s - before)[0] / (0.05 * 0.75),
        "cross_track": -0.5 * (infos["cross_track"][0] / 0.5) ** 2,
        "signal_change": -0.2 * (0.5**2 + 1.0**2),
        "tipping": 0.0,
        "energy": -0.1 * view.engine_power[0] / 1e5,
        "time": -0.1,
        "finish": 0.0,
        "failure": 0.0,
    }
    for name, value in expected.items():
        assert infos[f"reward/{name}"][0] == pytest.approx(value, rel=1e-5), name
    assert rewards[0] == pytest.approx(sum(expected.values()), rel=1e-5)
    assert infos["engine_work"][0] == pytest.approx(view.engine_power[0] * 0.05)
    assert 1e3 < view.engine_power[0] < 1e5


def test_tipping_margin_is_the_share_of_the_lighter_side():
    env = make(
        courses=[Course(Plane(slope_deg=12.0, direction_deg=90.0), (LINE,))], config=PathTrackingConfig(arms=None)
    )
    env.reset(seed=0)
    *_, infos = drive(env, steps=100)
    loads = {w: float(env.output(f"wheel_load_{w}")[0]) for w in ("fl", "fr", "rl", "rr")}
    left, right = loads["fl"] + loads["rl"], loads["fr"] + loads["rr"]
    assert left < right  # the left side is up
    assert infos["tipping_margin"][0] == pytest.approx(1 - (right - left) / (right + left), abs=0.01)


@pytest.mark.parametrize(
    "arguments",
    [
        {},
        {"randomisation": MILD, "gear": "automatic", "arms": "level", "observe_inertial": True, "scan_x": (2.0,)},
    ],
    ids=["default", "all"],
)
def test_sub_environment_is_the_single_one_to_the_bit(arguments):
    """On the default forests; with autoreset."""
    count, steps = 3, 24
    actions = np.random.default_rng(0).uniform(-1.0, 1.0, (steps, count, 2)).astype(np.float32)
    vector: Any = gymnasium.make_vec(NAME, num_envs=count, max_episode_steps=10, autoreset_mode="SameStep", **arguments)
    log = [vector.reset(seed=7), *(vector.step(action) for action in actions)]
    for i in range(count):
        env: Any = gymnasium.make(NAME, max_episode_steps=10, **arguments)
        observation, info = env.reset(seed=7 + i)
        np.testing.assert_array_equal(observation, log[0][0][i])
        for step, (observations, rewards, terminated, truncated, infos) in enumerate(log[1:]):
            observation, reward, end, cut, info = env.step(actions[step, i])
            assert (reward, end, cut) == (rewards[i], terminated[i], truncated[i])
            where = infos["final_info"] if cut else infos
            if cut:
                np.testing.assert_array_equal(observation, infos["final_obs"][i])
            for name, value in info.items():
                assert where[name][i] == value, name
            if cut:
                observation, info = env.reset()
            np.testing.assert_array_equal(observation, observations[i])


def test_same_seed_same_trajectory_and_another_seed_another():
    env = make(2, randomisation=MILD)
    trajectories = []
    for seed in (5, 5, 6):
        observations, _ = env.reset(seed=seed)
        rows = [observations]
        rows += [drive(env, 0.3, 0.6)[0] for _ in range(10)]
        trajectories.append(np.array(rows))
    np.testing.assert_array_equal(trajectories[0], trajectories[1])
    np.testing.assert_array_equal(trajectories[0][:, 1], trajectories[2][:, 0])  # seed + i
    assert np.any(trajectories[0][:, 0] != trajectories[2][:, 0])


def test_courses_and_paths_are_drawn_by_each_ones_generator_and_shared():
    env = PathTrackingVectorEnv(24)
    _, infos = env.reset(seed=0)
    assert set(infos["terrain"]) == {0, 1, 2}
    assert len(set(zip(infos["terrain"], infos["path"], strict=True))) > 6
    assert PathTrackingVectorEnv(1).task.courses[0].terrain is env.task.courses[0].terrain
    alone = PathTrackingVectorEnv(1)
    _, one = alone.reset(seed=11)
    assert (one["terrain"][0], one["path"][0]) == (infos["terrain"][11], infos["path"][11])


# ---- options ---------------------------------------------------------------------------------------------------------


def test_a_path_can_be_brought_along():
    env = make(2)
    own = arc(12.0, 1.5)
    env.reset(seed=0, options={"path": own})
    assert len(env.task.table) == 3
    env.reset(options={"path": own, "reset_mask": np.array([True, False])})
    assert len(env.task.table) == 3
    env.reset(options={"path": arc(9.0, 1.5), "reset_mask": np.array([True, False])})
    assert len(env.task.table) == 4  # the other still drives on the first
    env.reset(options={"path": arc(7.0, 2.0)})
    assert len(env.task.table) == 3
    _, infos = env.reset(options={"path": np.array([1, 0])})
    np.testing.assert_array_equal(infos["path"], [1, 0])


def test_machines_and_terrains_can_be_asked_for():
    env = PathTrackingVectorEnv(
        2, courses=[Course(square(30.0), (LINE_FROM_LEFT,)), Course(square(30.0, 2.0), (LINE_FROM_LEFT,))]
    )
    _, infos = env.reset(seed=0, options={"terrain": np.array([1, 0]), "machine": {"frame.front.mass": 4100.0}})
    np.testing.assert_array_equal(infos["terrain"], [1, 0])
    np.testing.assert_allclose(env.output("position_z"), [2.0, 0.0], atol=0.05)


def test_one_terrain_gets_paths_of_its_own():
    env: Any = PathTrackingEnv(terrain=square(40.0))
    assert len(env.vector.task.courses[0].paths) == 4
    env = PathTrackingEnv(path=LINE)
    assert env.vector.task.courses[0].paths == (LINE,)
    env.reset(seed=0)
    assert env.action_layout == {"steering_signal": slice(0, 1), "drive_signal": slice(1, 2)}


LINE_FROM_LEFT = Path(np.stack([np.arange(-20.0, 21.0), np.zeros(41)], axis=1))


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"path": 2}, r"options\['path'\] is 2, but must be in \[0, 1\]"),
        ({"path": 0, "start": 39.0}, r"options\['start'\] is 39 m, but that path is 40\.00 m long"),
        ({"start": -1.0}, r"options\['start'\] is -1 m, but must be in \[0, inf\] m"),
        ({"heading_offset": 4.0}, r"options\['heading_offset'\] is 4 rad"),
        ({"joint_angle": 1.0}, r"options\['joint_angle'\] is 1 rad"),
        ({"path": Path(np.array([[0.0, 0.0], [3.0, 0.0]]))}, r"is 3\.00 m long, but must be at least 6\.00 m"),
        ({"terrain": 1}, r"options\['terrain'\] is 1, but must be in \[0, 0\]"),
        ({"speed": 1.0}, "unknown key 'speed'"),
    ],
)
def test_wrong_options_are_named(options, message):
    with pytest.raises(ValueError, match=message):
        make().reset(options=options)


def test_a_path_that_starts_beyond_its_terrain_is_named():
    with pytest.raises(ValueError, match="terrain 0 has no ground for both axles"):
        make(courses=[Course(square(5.0), (LINE,))]).reset(options={"start": 20.0})


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"control_step": 0.2}, "control_step is 0.2 s"),
        ({"sample_step": 0.03}, "sample_step is 0.03 s, but must divide"),
        ({"time_margin": 0.5}, "time_margin is 0.5, but must be at least 1"),
        ({"preview": ()}, "preview is \\(\\) m"),
        ({"action_memory": 1}, "action_memory is 1"),
        ({"rollover": 2.0}, "rollover is 2 rad"),
        ({"gear": 4}, "gear is 4; choose 1, 2, 3 or 'automatic'"),
        ({"gear": "automatic", "act_gear": True}, "act_gear is set and gear is 'automatic'"),
        ({"path_limit": 0.0}, "path_limit is 0, but must be finite and above 0"),
    ],
)
def test_wrong_configurations_are_named(arguments, message):
    with pytest.raises(ValueError, match=message):
        PathTrackingConfig(**arguments)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"courses": [LEVEL], "path": LINE}, "courses is given, and terrain or path, too"),
        ({"courses": []}, "courses is empty"),
        ({"courses": [LEVEL, LEVEL]}, "courses holds a plane beside others"),
        ({"courses": [LINE]}, "give aoro_gym.envs.Course"),
        ({"arms": "up"}, "arms is 'up'; choose one of: 'hold', 'share', 'level'"),
    ],
)
def test_wrong_arguments_are_named(arguments, message):
    with pytest.raises(ValueError, match=message):
        PathTrackingVectorEnv(1, **arguments)


def test_randomisation_draws_the_start():
    spread = replace(EXACT, start=(0.0, 1.0), lateral_offset=(-1.0, 1.0))
    env = make(200, randomisation=spread, own_machines=False)
    _, infos = env.reset(seed=0, options={"path": 0})
    assert infos["remaining"].min() < 4.0 and infos["remaining"].max() > 34.0
    assert infos["cross_track"].min() < -0.9 and infos["cross_track"].max() > 0.9
    with pytest.raises(ValueError, match=r"randomisation\.lateral_offset is \(-9, 1\)"):
        PathTrackingRandomisation(lateral_offset=(-9.0, 1.0))


def test_traces_show_the_end_of_the_step():
    env = make()
    env.reset(seed=0)
    drive(env, 0.5, 1.0, 5)  # it nods and leans
    arms = np.array([env.output(f"arm_angle_{wheel}") for wheel in ("fl", "fr", "rl", "rr")])
    before = env.task._outputs.group("arm_angle_fl", 4)[-2]
    assert (before != arms).any()
    traces = env.task.traces()
    np.testing.assert_array_equal(traces[11:15], arms)
