"""Levelling: what the arms can do, what is seen, how it is judged, how it ends."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from aoro_gym.agents.controllers.path_tracking import Stanley, Vehicle
from aoro_gym.envs.levelling import rewards
from aoro_gym.envs.levelling.config import FIXED, MILD, LevellingConfig, LevellingRandomisation
from aoro_gym.envs.levelling.courses import obstacle_course
from aoro_gym.envs.levelling.driving import PathDriver
from aoro_gym.envs.levelling.environment import LevellingEnv, LevellingVectorEnv
from aoro_gym.envs.path_tracking.courses import Course
from aoro_gym.envs.path_tracking.task import END_OF_PATH
from aoro_gym.sensors import ImuNoise, JointAngleNoise, PressureNoise, WheelSpeedNoise
from aoro_gym.terrains import Path, Plane
from aoro_gym.units import BAR, GRAVITY, LITRE_PER_MINUTE
from tests.envs.path_tracking.paths import LEVEL

EXACT = LevellingRandomisation(sensor_noise=(0.0, 0.0), lateral_offset=(0.0, 0.0), heading_offset=(0.0, 0.0))
PARKED = LevellingConfig(driver=PathDriver(drive_signal=0.0), randomisation=EXACT)
SHORT = Path(np.array([[0.0, 0.0], [7.0, 0.0]]))


def make(num_envs=1, *, courses=(LEVEL,), config=PARKED, **arguments) -> Any:
    env = LevellingVectorEnv(num_envs, courses=courses, config=config, autoreset_mode="Disabled", **arguments)
    env.reset(seed=0, options={"path": 0})
    return env


def hold(env, signals, steps):
    """The last step's results, and everybody's arm angles (steps, 4, N)."""
    actions = np.broadcast_to(np.asarray(signals, dtype=np.float32), env.action_space.shape)
    angles = []
    for _ in range(steps):
        result = env.step(actions)
        angles.append(env.task._outputs.group("arm_angle_fl", 4)[-1].copy())
    return result, np.array(angles)


# ---- what the arms can do --------------------------------------------------------------------------------------------


def test_actions_are_valves_that_meter_their_flow():
    """Behind the compensator a valve at full signal passes its nominal flow, Q: the cylinder moves at Q / A, and the arm
    turns at that over its lever."""
    env = make()
    arm = env.twin.machine.arm
    _, angles = hold(env, [1.0, 1.0, 1.0, 1.0], 14)
    rate = (angles[-1, :, 0] - angles[-5, :, 0]) / (4 * 0.05)
    lever = arm.cylinder.linkage.lever(-angles[-3, :, 0])
    speed = arm.valve.nominal_flow / arm.cylinder.bore_area
    # the cylinder's end gives to the oil's pressure by 0.1 mm while it moves by 30 mm, and the lever turns by 1 %
    np.testing.assert_allclose(rate * lever, -speed, rtol=0.03)


def test_half_a_signal_opens_half_of_what_is_beyond_the_dead_band():
    env = make()
    arm = env.twin.machine.arm
    band = float(arm.valve.dead_band)
    _, angles = hold(env, [0.9 * band] * 4, 20)
    np.testing.assert_allclose(angles[-1], angles[0], atol=1e-4)  # the ground gives on by micrometres
    _, angles = hold(env, [band + 0.5 * (1.0 - band)] * 4, 16)
    rate = (angles[-1, :, 0] - angles[-5, :, 0]) / (4 * 0.05)
    lever = arm.cylinder.linkage.lever(-angles[-3, :, 0])
    np.testing.assert_allclose(rate * lever, -0.5 * arm.valve.nominal_flow / arm.cylinder.bore_area, rtol=0.03)


def test_the_pump_is_shared_and_so_is_the_engine():
    """Valves that ask for more than pump 2 gives get its full flow together, at the speed to which it loads the engine."""
    env = make()
    wide = 80.0  # [L/min] each; the pump gives 140 cm³/rev at 1595 rpm
    env.reset(seed=0, options={"path": 0, "machine": {"arm.valve.nominal_flow": wide}})
    arm, pump, engine = env.twin.machine.arm, env.twin.machine.steering.pump, env.twin.machine.engine
    assert pump.displacement * engine.set_speed < 4 * wide * LITRE_PER_MINUTE
    hold(env, [1.0] * 4, 4)
    angles, speeds, pressures = [env.task._outputs.group("arm_angle_fl", 4)[-1].copy()], [], []
    for _ in range(8):
        _, after = hold(env, [1.0] * 4, 1)
        angles.append(after[0])
        speeds.append(env.task._outputs.samples("engine_speed").mean())
        pressures.append(env.task._outputs.samples("pump_pressure").mean())
    rate = (angles[-1] - angles[0])[:, 0] / (8 * 0.05)
    flow = -(rate * arm.cylinder.linkage.lever(-np.mean(angles, axis=0)[:, 0])).sum() * arm.cylinder.bore_area
    # the hoses swell by 0.1 % of what flows; the lever's mean over the way is that of its middle up to 1 %
    leaks = pump.leakage * np.mean(pressures)
    assert flow == pytest.approx(pump.displacement * np.mean(speeds) - leaks, rel=0.02)
    assert np.mean(speeds) < 0.9 * engine.set_speed  # 50 kW more, all at once


def test_lifting_takes_the_work_that_it_must():
    """Pump 2 gives at least the weight's rise in energy; pressures of the arms times their volume are that and friction."""
    env = make()
    before = float(env.output("position_z")[0])
    (_, _, _, _, infos), _ = hold(env, [1.0] * 4, 12)
    rise = float(env.output("position_z")[0]) - before
    mass = env.twin.machine.frame.front.mass + env.twin.machine.frame.rear.mass
    assert rise > 0.08
    assert infos["pump_work"][0] > mass * GRAVITY * rise
    idle = make()
    (_, _, _, _, rested), _ = hold(idle, [0.0] * 4, 12)
    assert rested["pump_work"][0] < 0.1 * infos["pump_work"][0]


def test_arms_end_at_their_stops():
    env = make()
    _, angles = hold(env, [1.0] * 4, 60)
    swing = float(env.twin.machine.arm.swing)
    np.testing.assert_allclose(angles[-1], -swing, atol=0.02)  # the stop gives by millimetres


# ---- what is seen and judged -----------------------------------------------------------------------------------------


def test_one_arm_tilts_and_twists_as_it_should():
    """Extending the left arms raises the left side: positive roll. Extending the front ones raises the nose."""
    env = make()
    hold(env, [0.6, 0.0, 0.6, 0.0], 16)
    assert env.output("roll")[0] > np.radians(1.0)
    env.reset(seed=0, options={"path": 0})
    hold(env, [0.6, 0.6, 0.0, 0.0], 16)
    assert env.output("pitch")[0] < -np.radians(0.7)
    env.reset(seed=0, options={"path": 0})
    (_, _, _, _, infos), _ = hold(env, [0.4, 0.0, 0.0, 0.4], 8)
    fl, fr, rl, rr = env.task._loads[:, 0]
    assert fl + rr > 1.2 * (fr + rl)
    assert infos["unevenness"][0] > 0.1


def test_unevenness_and_tilt_by_their_definitions():
    env = make()
    (observations, *_, infos), _ = hold(env, [0.5, 0.1, -0.3, 0.3], 10)
    loads = env.task._outputs.group("wheel_load_fl", 4).mean(axis=0)[:, 0].astype(np.float64)
    rest = env.twin.machine.rest
    share = np.array([rest.wheel_load_front] * 2 + [rest.wheel_load_rear] * 2)
    off = loads - loads.sum() * share / share.sum()
    assert infos["unevenness"][0] == pytest.approx(np.sqrt(np.mean(off**2)) / loads.mean(), rel=1e-5)
    roll, pitch = (float(env.output(name)[0]) for name in ("roll", "pitch"))
    # a cosine near 1 rounds by 1e-16, and so the square of the angle by twice that
    tilt = np.arccos(np.cos(roll) * np.cos(pitch))
    assert infos["tilt"][0] == pytest.approx(tilt, abs=4e-16 / tilt)
    layout = env.observation_layout
    assert observations[0, layout["signals"]] == pytest.approx([0.5, 0.1, -0.3, 0.3] * 2)


def test_two_wheels_that_carry_everything_are_uneven_by_one():
    """The definition at its ends, with a machine whose wheels bear alike at rest."""
    env = make()
    task = env.task
    task._rest_share[:] = 0.25
    outputs = task._outputs
    for loads, expected in (([1.0, 1.0, 1.0, 1.0], 0.0), ([2.0, 0.0, 0.0, 2.0], 1.0), ([4.0, 0.0, 0.0, 0.0], 3.0**0.5)):
        outputs.group("wheel_load_fl", 4)[:] = 2e4 * np.array(loads)[None, :, None]
        view = task.advance(outputs, np.ones(1)).view
        assert view.unevenness[0] == pytest.approx(expected, abs=1e-6)
        assert view.lifted[0] == pytest.approx(np.mean(np.array(loads) == 0.0))


def test_exact_sensors_show_the_true_motion():
    config = LevellingConfig(
        randomisation=LevellingRandomisation(lateral_offset=(0.0, 0.0)), arm_angle_noise=JointAngleNoise(),
        pressure_noise=PressureNoise(), imu_noise=ImuNoise(), joint_angle_noise=JointAngleNoise(),
        wheel_speed_noise=WheelSpeedNoise(),
    )  # fmt: skip
    env = make(config=config)
    (observations, *_), angles = hold(env, [0.5, -0.2, 0.3, 0.4], 20)
    rest = env.twin.machine.rest
    level = np.array([rest.arm_angle_front] * 2 + [rest.arm_angle_rear] * 2)
    seen = {name: observations[0, columns] for name, columns in env.observation_layout.items()}
    np.testing.assert_allclose(seen["arm_angles"], angles[-1, :, 0] - level, atol=1e-6)
    np.testing.assert_allclose(seen["arm_rates"], (angles[-1] - angles[-2])[:, 0] / 0.05, atol=1e-4)
    cylinder = env.twin.machine.arm.cylinder
    bore, rod = (
        np.array([env.output(f"arm_pressure_{end}_{wheel}")[0] for wheel in ("fl", "fr", "rl", "rr")])
        for end in ("bore", "rod")
    )
    borne = bore - rod * cylinder.annulus_area / cylinder.bore_area
    np.testing.assert_allclose(seen["supports"], borne / (100.0 * BAR), atol=1e-5)
    assert seen["roll"][0] == pytest.approx(float(env.output("roll")[0]), abs=1e-6)
    assert seen["supply"][0] == pytest.approx(float(env.output("pump_pressure")[0]) / (100.0 * BAR), abs=1e-5)


def test_the_ground_is_seen_under_and_ahead_of_both_tracks():
    """On a plane that rises by 3° to the left each track of the exact map is level, half a track · tan 3° off the mean."""
    course = Course(Plane(slope_deg=3.0, direction_deg=90.0), (SHORT,), name="side slope")
    env = make(courses=[course], config=LevellingConfig(driver=PathDriver(drive_signal=0.0), randomisation=EXACT))
    observations, _ = env.reset(seed=0)
    left, right = observations[0, env.observation_layout["ground"]].reshape(2, -1)
    half_track = 0.5 * float(env.twin.machine.frame.track)
    np.testing.assert_allclose(left, half_track * np.tan(np.radians(3.0)), atol=1e-4)
    np.testing.assert_allclose(right, -left, atol=1e-4)
    uphill = make(
        courses=[Course(Plane(slope_deg=3.0, direction_deg=0.0), (SHORT,), name="uphill")], config=env.task.config
    )
    observations, _ = uphill.reset(seed=0)
    ahead = np.array(env.task.config.ground_ahead)
    left, right = observations[0, uphill.observation_layout["ground"]].reshape(2, -1)
    np.testing.assert_allclose(left, (ahead - ahead.mean()) * np.tan(np.radians(3.0)), atol=1e-4)
    np.testing.assert_array_equal(left, right)


def test_the_map_of_the_ground_errs_by_its_noise():
    config = LevellingConfig(driver=PathDriver(drive_signal=0.0), ground_noise=0.03)
    env = make(64, config=config)
    seen = [env.step(np.zeros((64, 4), dtype=np.float32))[0][:, env.observation_layout["ground"]] for _ in range(4)]
    values = np.array(seen)
    # 6656 values less their means over 26: the standard deviation of 0.03 is known to 1 %
    assert values.std() == pytest.approx(0.03 * np.sqrt(25 / 26), rel=0.04)
    assert abs(np.corrcoef(values[0].ravel(), values[1].ravel())[0, 1]) < 0.1  # 1664 pairs


def test_default_sensors_err_by_their_noise_and_repeat():
    env = make(4, config=LevellingConfig(driver=PathDriver(drive_signal=0.0)))
    (first, *_), angles = hold(env, [0.0] * 4, 3)
    rest = env.twin.machine.rest
    level = np.array([rest.arm_angle_front] * 2 + [rest.arm_angle_rear] * 2)
    error = first[:, env.observation_layout["arm_angles"]] - (angles[-1] - level[:, None]).T
    # white noise of 0.022° and a quantiser of 0.088°, whose error is at most half a step
    assert 1e-6 < np.abs(error).max() < np.radians(0.044 + 5 * 0.022)
    assert np.abs(error).std() > 1e-5
    env.reset(seed=0, options={"path": 0})
    (again, *_), _ = hold(env, [0.0] * 4, 3)
    np.testing.assert_array_equal(first, again)


def test_rewards_fall_with_tilt_and_unevenness_and_their_sum_is_the_reward():
    env = make(config=LevellingConfig(randomisation=EXACT))
    calm, rough = [], []
    for values, signals in ((calm, [0.0] * 4), (rough, [0.5, -0.5, 0.5, -0.5])):
        env.reset(seed=0, options={"path": 0})
        for _ in range(30):
            _, reward, _, _, infos = env.step(np.array([signals], dtype=np.float32))
            parts = [infos[f"reward/{name}"][0] for name in rewards.REWARD_TERMS]
            assert reward[0] == pytest.approx(sum(parts), abs=1e-5)
            assert reward[0] < 1.5  # 1 at the working speed, more where it drives faster for a step
            values.append({name: infos[f"reward/{name}"][0] for name in ("level", "even", "energy", "signal_change")})
    assert calm[-1]["level"] > 0.5 and calm[-1]["even"] > 0.35
    assert rough[-1]["level"] < 0.5 * calm[-1]["level"]
    assert rough[15]["energy"] < calm[15]["energy"] < 0.0


# ---- driving, starts, ends -------------------------------------------------------------------------------------------


def test_the_driver_is_the_reference_controllers_law():
    """The same signals as :class:`Stanley` gives with the same gains, for whatever is observed."""
    from aoro_gym.envs.path_tracking.environment import PathTrackingVectorEnv

    env = PathTrackingVectorEnv(64, courses=[LEVEL])
    vehicle = Vehicle.of(env)
    rng = np.random.default_rng(3)
    space = env.single_observation_space
    seen = (rng.uniform(-1.0, 1.0, (64, space.shape[0])) * np.minimum(space.high, 0.4)).astype(np.float32)
    driver = PathDriver()
    gains = ("heading_gain", "cross_track_gain", "look_ahead", "gain", "rest_error")
    expected = Stanley(vehicle, **{name: getattr(driver, name) for name in gains})(seen)
    layout = env.observation_layout

    class View:
        xp = np
        curvature = seen[:, layout["curvature"]].astype(np.float64)
        measured_cross_track, measured_heading_error, measured_angle, measured_rate, measured_speed = (
            seen[:, layout[name]][:, 0].astype(np.float64)
            for name in ("cross_track", "heading_error", "joint_angle", "joint_rate", "speed")
        )

    view: Any = View()
    signals = driver.signals(view, vehicle.preview[0], vehicle.front, vehicle.rear, vehicle.largest_angle)
    np.testing.assert_allclose(signals, expected, atol=1e-6)
    assert np.abs(expected[:, 0]).std() > 0.1


def test_it_drives_to_the_end_and_succeeds_where_it_is_calm():
    course = Course(Plane(), (SHORT,), name="short")
    calm = LevellingConfig(randomisation=EXACT)
    strict = (replace(calm, unevenness_limit=1e-4), replace(calm, tilt_limit=1e-6))
    for config, success in ((calm, True), *((each, False) for each in strict)):
        env = make(courses=[course], config=config)
        for _ in range(200):
            _, _, terminated, truncated, infos = env.step(np.zeros((1, 4), dtype=np.float32))
            if terminated[0] or truncated[0]:
                break
        assert infos["termination"][0] == END_OF_PATH
        assert infos["is_success"][0] == success


def test_the_machine_rolls_over_with_a_reason():
    """On a side slope of 38° with the upper arms extended."""
    course = Course(Plane(slope_deg=38.0, direction_deg=90.0), (SHORT,), name="steep")
    env = make(courses=[course])
    reason = None
    for _ in range(200):
        _, _, terminated, _, infos = env.step(np.array([[1.0, -1.0, 1.0, -1.0]], dtype=np.float32))
        if terminated[0]:
            reason = infos["termination"][0]
            break
    assert reason == "rolled over"
    assert infos["reward/failure"][0] == -50.0


def test_difficulty_chooses_the_grounds():
    courses = [obstacle_course(seed, 0.3) for seed in range(4)]
    env = LevellingVectorEnv(
        32, courses=courses, randomisation=LevellingRandomisation(difficulty=(0.5, 0.75)), autoreset_mode="Disabled"
    )
    _, infos = env.reset(seed=1)
    assert set(infos["terrain"]) == {2}
    assert len(set(infos["path"])) > 2
    env.task.randomisation = FIXED
    _, infos = env.reset(seed=1)
    assert set(infos["terrain"]) == {0, 1, 2, 3}
    _, infos = env.reset(seed=1, options={"terrain": 1, "path": 3})
    assert set(infos["terrain"]) == {1} and set(infos["path"]) == {3}


def test_single_and_vector_environments_agree_to_the_bit():
    courses = [obstacle_course(1, 0.8)]
    vector = LevellingVectorEnv(3, courses=courses, autoreset_mode="Disabled")
    many, _ = vector.reset(seed=5)
    rng = np.random.default_rng(0)
    actions = rng.uniform(-1.0, 1.0, (12, 3, 4)).astype(np.float32)
    rows = [many, *(vector.step(each)[0] for each in actions)]
    for i in range(3):
        single = LevellingEnv(courses=courses)
        one, _ = single.reset(seed=5 + i)
        mine = [one, *(single.step(each[i])[0] for each in actions)]
        np.testing.assert_array_equal(np.array(mine), np.array(rows)[:, i])


def test_wrong_configurations_are_named():
    from aoro_gym.envs.path_tracking.config import FIXED as PATHS

    wrong: Any = PATHS
    with pytest.raises(ValueError, match="must be a LevellingRandomisation"):
        LevellingConfig(randomisation=wrong)
    with pytest.raises(ValueError, match="signal_memory is 1"):
        LevellingConfig(signal_memory=1)
    with pytest.raises(ValueError, match="tilt_limit is 0 rad, but must be"):
        LevellingConfig(tilt_limit=0.0)
    with pytest.raises(ValueError, match="drive_signal is 2"):
        PathDriver(drive_signal=2.0)
    with pytest.raises(ValueError, match="no argument 'arms'"):
        LevellingVectorEnv(1, arms="level")


def test_tensors_say_what_arrays_say():
    """Through resets, too, to the bit: the same kernels compute both. What is float64 may differ by the machines' loads at
    rest, which are iterated until the last of those that begin together has converged."""
    torch = pytest.importorskip("torch")
    courses = [obstacle_course(1, 0.8)]
    host, device = (
        LevellingVectorEnv(3, courses=courses, randomisation=MILD, max_episode_steps=6, output=output)
        for output in ("numpy", "torch")
    )
    read = []
    seen, tensors = host.reset(seed=3)[0], device.reset(seed=3)[0]
    rng = np.random.default_rng(0)
    for _ in range(10):
        np.testing.assert_array_equal(tensors.numpy(), seen)
        actions = rng.uniform(-1.0, 1.0, (3, 4)).astype(np.float32)
        seen, rewards_seen, _, truncated, infos = host.step(actions)
        tensors, rewards_told, _, late, told = device.step(torch.from_numpy(actions))
        np.testing.assert_array_equal(rewards_told.numpy(), rewards_seen)
        np.testing.assert_array_equal(late.numpy(), truncated)
        read.append(bool(truncated.any()))
        for name in ("tilt", "unevenness", "pump_work"):
            np.testing.assert_allclose(told[name].numpy(), infos[name], rtol=1e-12)
    assert any(read)


def test_a_step_on_a_device_waits_for_its_flags_only(monkeypatch):
    torch = pytest.importorskip("torch")
    env = LevellingVectorEnv(3, courses=[LEVEL], output="torch")
    env.reset(seed=0)
    actions, read = torch.zeros((3, 4)), []
    env.step(actions)
    monkeypatch.setattr(env.arrays, "host", lambda tensor: read.append(tuple(tensor.shape)) or tensor.numpy())
    env.step(actions)
    assert read == [(5,)]
