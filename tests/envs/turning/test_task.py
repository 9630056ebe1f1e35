"""The turning task: targets, measurements, judgement, terms."""

import math
from typing import Any

import gymnasium
import numpy as np
import pytest

from aoro_gym.envs import register_envs
from aoro_gym.envs.core.randomisation import Randomisation
from aoro_gym.envs.core.task import Outputs, channel_row
from aoro_gym.envs.turning.config import TurningConfig
from aoro_gym.envs.turning.environment import TurningVectorEnv
from aoro_gym.envs.turning.rewards import FULL_FLOW, flow_oscillation, precision, tracking
from aoro_gym.envs.turning.task import TARGETS_DRAWN, Turning, spaced_targets
from aoro_gym.sensors.joint_angle import slope_weights
from aoro_gym.terrains import Plane, Terrain
from aoro_gym.twin.records import Output

register_envs()
EXACT = Randomisation(sensor_noise=(0.0, 0.0))


def drive(env, signal, steps):
    """Steps with one signal for all; returns what the last one gave."""
    action = np.full((env.num_envs, 1), signal, dtype=np.float32)
    for _ in range(steps):
        result = env.step(action)
    return result


def test_positive_signals_turn_left():
    env = TurningVectorEnv(2, randomisation=EXACT)
    env.reset(options={"joint_angle": 0.0})
    for _ in range(30):
        observations, *_ = env.step(np.array([[1.0], [-1.0]], dtype=np.float32))
    angle = observations[:, env.observation_layout["joint_angle"]][:, 0]
    rate = observations[:, env.observation_layout["joint_rate"]][:, 0]
    assert angle[0] > math.radians(8.0)
    assert angle[1] < math.radians(-8.0)
    assert rate[0] > 0.3 > -0.3 > rate[1]
    np.testing.assert_array_equal(angle, env.output("joint_angle"))


def test_observation_before_the_first_step_is_that_of_a_machine_at_rest():
    env = TurningVectorEnv(2, randomisation=EXACT, observe_pressures=True)
    observations, infos = env.reset(seed=1, options={"joint_angle": [0.2, -0.1], "targets": [0.5]})
    layout = env.observation_layout
    np.testing.assert_allclose(observations[:, layout["joint_angle"]][:, 0], [0.2, -0.1], rtol=1e-6)
    np.testing.assert_array_equal(observations[:, layout["target"]], np.float32(0.5))
    np.testing.assert_allclose(observations[:, layout["error"]][:, 0], [0.3, 0.6], rtol=1e-6)
    np.testing.assert_allclose(observations[:, layout["joint_rate"]], 0.0, atol=1e-5)
    np.testing.assert_array_equal(observations[:, layout["signals"]], 0.0)
    machine = env.twin.machine.steering
    rest = np.array([machine.tank_line.back_pressure, machine.tank_line.back_pressure, machine.pump.margin]) / 1e7
    np.testing.assert_allclose(observations[:, layout["pressures"]], [rest, rest], rtol=1e-6)
    np.testing.assert_array_equal(infos["target"], np.float32(0.5))
    first, *_ = env.step(np.zeros((2, 1), dtype=np.float32))
    # after 20 ms at rest little has changed
    np.testing.assert_allclose(first[:, layout["joint_angle"]], observations[:, layout["joint_angle"]], atol=1e-3)
    np.testing.assert_allclose(first[:, layout["pressures"]], observations[:, layout["pressures"]], atol=0.05)


def test_sensor_noise_can_be_switched_off_and_does_not_move_the_machine():
    noisy, exact = TurningVectorEnv(1), TurningVectorEnv(1, randomisation=EXACT)
    options = {"joint_angle": 0.1, "targets": [0.3]}
    seen, _ = noisy.reset(seed=4, options=options)
    true, _ = exact.reset(seed=4, options=options)
    assert true[0, 0] == np.float32(0.1)
    assert 0.0 < abs(seen[0, 0] - true[0, 0]) < math.radians(1.0)
    for env in (noisy, exact):
        drive(env, 0.5, 5)
    assert noisy.output("joint_angle") == exact.output("joint_angle")


def outputs(angles, flow=0.0, rate=0.0):
    """Outputs of one sub-environment whose joint angle [rad] is sampled over a step."""
    values = np.zeros((len(angles), len(Output), 1), dtype=np.float32)
    values[:, channel_row("joint_angle"), 0] = angles
    values[:, channel_row("joint_flow"), 0] = flow
    values[:, channel_row("joint_rate"), 0] = rate
    return Outputs(values)


def task(machine, *, angle=0.0, targets=(0.5,), hold=1.0, **config):
    """One turning task at rest, without sensor noise."""
    turning = Turning(TurningConfig(randomisation=EXACT, **config))
    turning.allocate(1, Plane())
    generators = [np.random.default_rng(0)]
    turning.start(
        np.arange(1),
        generators,
        EXACT.draw(generators),
        machine,
        {"joint_angle": angle, "targets": targets, "hold": hold},
    )
    turning.rest(np.arange(1), outputs([angle] * 2))
    return turning


def advance(turning, angles, *, signal=0.0, **motion):
    turning.commands(np.full((1, 1), signal, dtype=np.float32))
    turning.advance(outputs(angles, **motion), (turning._step + 1) * turning.control_step)


def test_rate_estimate_is_exact_on_a_ramp(machine):
    turning = task(machine)
    rate = 0.4
    for step in range(5):
        advance(turning, rate * (0.02 * step + np.array([0.01, 0.02])))
    # the twin's angles, up to 0.04 rad, are float32: their rounding goes through the weights of the slope
    weights = slope_weights(turning.config.rate_samples, turning.config.sample_step)
    atol = np.abs(weights).sum() * 0.04 * 2**-24
    np.testing.assert_allclose(turning.view().measured_rate, rate, atol=atol)


def test_overshoot_counts_beyond_the_target_only(machine):
    for sign in (1.0, -1.0):
        turning = task(machine, targets=[0.5 * sign])
        for angle, expected in ((0.3, 0.0), (0.5, 0.0), (0.54, 0.04), (0.49, 0.0)):
            advance(turning, [sign * angle] * 2)
            np.testing.assert_allclose(turning.view().overshoot, expected, atol=1e-6)
        np.testing.assert_allclose(turning.info()["largest_overshoot"], 0.04, atol=1e-6)


def test_targets_are_judged_when_they_are_replaced(machine):
    turning = task(machine, targets=[0.1, 0.3, 0.2], hold=0.5)
    verdicts = []
    for step in range(60):
        advance(turning, [0.1] * 2)  # stays at the first target
        info = turning.info()
        verdicts.append((int(info["targets_settled"][0]), int(info["targets_missed"][0]), bool(info["is_success"][0])))
        assert info["target"] == np.float32(0.1 if step < 24 else 0.3 if step < 49 else 0.2)
    assert verdicts[13] == (0, 0, False)
    assert verdicts[14] == (1, 0, True)  # inside for 0.3 s
    assert verdicts[24] == (1, 0, True)
    assert verdicts[48] == (1, 0, True)  # the second one might still be reached
    assert verdicts[49] == (1, 1, False)
    assert verdicts[59] == (1, 1, False)


def test_a_target_held_for_long_is_missed_after_the_shortest_hold(machine):
    turning = task(machine, targets=[0.3])
    for step in range(126):
        advance(turning, [0.0] * 2)
        assert turning.info()["targets_missed"] == (1 if step >= 124 else 0)
    assert not turning.info()["is_success"]


def test_terms_have_their_closed_forms(machine):
    turning = task(machine, targets=[0.2])
    for flow, rate in ((0.0, 0.0), (4e-4, 0.3), (6e-4, -0.3)):
        advance(turning, [0.2 - math.radians(1.0)] * 2, flow=flow, rate=rate)
    view = turning.view()
    np.testing.assert_allclose(tracking(view), math.exp(-math.radians(1.0) / 0.2), rtol=1e-5)
    np.testing.assert_allclose(precision(view), math.exp(-1.0), rtol=1e-4)
    # left 4e-4, right 6e-4: second difference -6e-4 - 2*4e-4 + 0
    np.testing.assert_allclose(flow_oscillation(view), 14e-4 / FULL_FLOW, rtol=1e-6)
    np.testing.assert_allclose(view.target_age, 0.06)


def test_drawn_targets_are_apart_and_spread_over_the_range():
    rng = np.random.default_rng(1)
    start, reach = rng.uniform(-0.6, 0.6, 500), np.full(500, 0.6)
    targets = spaced_targets(start, reach, 0.14, rng.random((500, TARGETS_DRAWN)))
    assert np.abs(targets).max() <= 0.6
    assert np.abs(np.diff(targets, axis=1, prepend=start[:, None])).min() >= 0.14 - 1e-12
    counts, _ = np.histogram(targets, bins=6, range=(-0.6, 0.6))
    assert counts.min() > 0.1 * targets.size  # of 1/6 each; the ends are a little more frequent


def test_targets_follow_their_schedule():
    env = TurningVectorEnv(1)
    env.reset(seed=0, options={"targets": [0.1, -0.2, 0.3], "hold": 0.1})
    seen = [drive(env, 0.0, 1)[4]["target"][0] for _ in range(14)]
    np.testing.assert_allclose(seen, [0.1] * 4 + [-0.2] * 5 + [0.3] * 5, rtol=1e-6)


def test_drawn_episodes_have_several_targets():
    env: Any = TurningVectorEnv(16)
    env.reset(seed=0)
    first = env.task._until[:, 0]
    assert first.min() >= 125 and first.max() <= 200
    ends = env.task._until[:, :3]
    assert (ends[:, 1] <= 400).all()  # at least three targets in 500 steps


def test_success_is_told_apart_from_truncation():
    env: Any = gymnasium.make("AORO/Turning-v0", max_episode_steps=30)
    still = np.zeros(1, dtype=np.float32)
    for target, expected in ((0.1, True), (0.4, False)):
        env.reset(seed=0, options={"joint_angle": 0.1, "targets": [target]})
        for _ in range(30):
            _, _, terminated, truncated, info = env.step(still)
        assert truncated and not terminated
        assert info["is_success"] is expected


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"control_step": 0.0}, "control_step is 0 s, but must be above 0"),
        ({"sample_step": 0.015}, "sample_step is 0.015 s, but must divide control_step = 0.02 s"),
        ({"hold": (3.0, 2.0)}, "hold is \\(3.0, 2.0\\) s"),
        ({"tolerance": 0.0}, "tolerance is 0 rad, but must be finite and above 0"),
        ({"dwell": 5.0}, "dwell is 5 s, but must be in \\[0, 2.5\\] s"),
        ({"rate_samples": 1}, "rate_samples is 1, but must be an integer of at least 2"),
        ({"signal_memory": 1}, "signal_memory is 1, but must be an integer of at least 2"),
        ({"target_change": -1.0}, "target_change is -1 rad"),
        ({"target_clearance": -1.0}, "target_clearance is -1 rad"),
    ],
)
def test_wrong_configurations_are_named(arguments, message):
    with pytest.raises(ValueError, match=message):
        TurningConfig(**arguments)


def test_targets_that_cannot_be_apart_are_named():
    env = TurningVectorEnv(1, config=TurningConfig(target_change=1.0))
    with pytest.raises(ValueError, match=r"target_change is 1\.000 rad, but targets span only"):
        env.reset()


def test_other_rates_of_control_and_sampling_work():
    env = TurningVectorEnv(2, config=TurningConfig(control_step=0.05, sample_step=0.01, rate_samples=3))
    assert env.metadata["render_fps"] == 20
    env.reset(seed=0)
    observations, *_ = drive(env, 1.0, 4)
    assert env.time == pytest.approx(0.2)
    assert observations.shape == env.observation_space.shape


def hill(slope, *, half=12.0):
    """A terrain that rises toward x by ``slope``, centred at x = 20 m."""
    corners = np.array([[x, y, slope * x] for x, y in ((8.0, -half), (32.0, -half), (32.0, half), (8.0, half))])
    return Terrain(corners, np.array([[0, 1, 2], [0, 2, 3]]))


def test_turning_on_a_terrain_stands_in_its_middle_or_where_it_is_asked_to():
    slopes = (0.0, math.tan(math.radians(10.0)))
    env = TurningVectorEnv(2, terrain=[hill(slope) for slope in slopes])
    env.reset(seed=0, options={"terrain": np.array([0, 1])})
    np.testing.assert_allclose(env.output("position_x"), 20.0, atol=1e-5)
    # nose up where the ground rises ahead; the arms' springs leave a small rest
    np.testing.assert_allclose(env.output("pitch"), [0.0, -math.radians(10.0)], atol=math.radians(0.5))
    drive(env, 0.5, 5)
    assert np.isfinite(env.output("joint_angle")).all()
    env.reset(options={"terrain": 1, "position": (14.0, 3.0), "heading": 1.0})
    np.testing.assert_allclose(env.output("position_y"), 3.0, atol=1e-5)
    np.testing.assert_allclose(env.output("yaw"), 1.0, atol=0.1)  # headings and yaw differ on a slope
    drawn = set()
    for seed in range(0, 20, 2):
        env.reset(seed=seed)
        drawn |= set(np.round(env.output("pitch"), 2))
    assert len(drawn) == 2


def test_wrong_places_are_named():
    env = TurningVectorEnv(2, terrain=[hill(0.0), hill(0.1)])
    for options, message in (
        ({"terrain": 2}, r"options\['terrain'\] is 2, but must be in \[0, 1\]"),
        ({"terrain": 0.5}, r"options\['terrain'\] is 0\.5, but must be a whole number"),
        ({"position": (1.0, 2.0, 3.0)}, r"options\['position'\] is"),
        ({"heading": np.nan}, r"options\['heading'\] is nan"),
    ):
        with pytest.raises(ValueError, match=message):
            env.reset(options=options)
    with pytest.raises(ValueError, match="the twins stand on a plane"):
        TurningVectorEnv(1).reset(options={"terrain": 0})


def test_each_sub_environment_has_its_targets():
    env = TurningVectorEnv(2)
    _, infos = env.reset(seed=0, options={"targets": [[0.1, 0.3], [-0.2, 0.2]]})
    np.testing.assert_array_equal(infos["target"], np.array([0.1, -0.2], dtype=np.float32))
