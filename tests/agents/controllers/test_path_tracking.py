"""Controllers that follow paths: their formulas against closed forms, and the twin that they steer."""

import math
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import solve_discrete_lyapunov

from aoro_gym import Machine
from aoro_gym.agents.controllers.path_tracking import (
    VALVE_RATE_LEFT,
    VALVE_RATE_RIGHT,
    VALVE_SIGNAL,
    FullSpeedSteering,
    PreviewRegulator,
    PurePursuit,
    Stanley,
    Vehicle,
    preview_gains,
    preview_model,
    pursued_angle,
    turn_angle,
    turn_curvature,
)
from aoro_gym.envs.path_tracking.config import PathTrackingRandomisation
from aoro_gym.envs.path_tracking.courses import Course
from aoro_gym.envs.path_tracking.environment import PathTrackingEnv, PathTrackingVectorEnv
from aoro_gym.terrains import Plane
from aoro_gym.terrains.paths.planning import turning_radius
from tests.envs.path_tracking.paths import LINE, circle

LAYOUT = {
    "cross_track": slice(0, 1),
    "heading_error": slice(1, 2),
    "preview": slice(2, 12),
    "curvature": slice(12, 18),
    "speed": slice(18, 19),
    "joint_angle": slice(19, 20),
    "joint_rate": slice(20, 21),
}
VEHICLE = Vehicle(LAYOUT)
LONG_REAR = Vehicle(LAYOUT, front=1.5, rear=1.9)
KINDS = [PurePursuit, Stanley, PreviewRegulator, FullSpeedSteering]
SPEED = 0.75


def on_circle(
    curvature: Any,
    *,
    cross_track: Any = 0.0,
    heading_error: Any = 0.0,
    joint_angle: Any = 0.0,
    joint_rate: Any = 0.0,
    speed: Any = SPEED,
) -> Any:
    """Observations (N, 21) of vehicles at a path of constant curvature; what is given broadcasts."""
    curvature, offset, turned, *rest = np.broadcast_arrays(
        *map(np.atleast_1d, (curvature, cross_track, heading_error, speed, joint_angle, joint_rate))
    )
    ahead = np.array([VEHICLE.preview])
    bend = np.where(curvature == 0.0, 1e-12, curvature)[:, None]
    x, y = np.sin(bend * ahead) / bend, (1.0 - np.cos(bend * ahead)) / bend - offset[:, None]
    c, s = np.cos(turned)[:, None], np.sin(turned)[:, None]
    preview = np.stack([c * x + s * y, c * y - s * x], axis=-1).reshape(len(offset), -1)
    return np.column_stack([offset, turned, preview, np.repeat(curvature[:, None], 6, axis=1), *rest])


# ---- geometry --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("front", "rear"), [(1.7, 1.7), (1.9, 1.5)])
def test_a_bent_joint_turns_where_the_axles_lines_meet(front, rear):
    for degrees in (5.0, 20.0, 40.0):
        radius = 1.0 / turn_curvature(math.radians(degrees), front, rear)
        behind = 1.0 / turn_curvature(math.radians(degrees), rear, front)
        assert max(radius, behind) == pytest.approx(turning_radius(degrees, front, rear), rel=1e-12)
        # the hinge is equally far from the centre, seen from either axle
        assert math.hypot(radius, front) == pytest.approx(math.hypot(behind, rear), rel=1e-12)


@pytest.mark.parametrize(("front", "rear"), [(1.7, 1.7), (1.5, 1.9), (1.9, 1.5)])
def test_angle_of_a_turn_is_the_inverse(front, rear):
    angles = np.radians(np.linspace(-60.0, 60.0, 25))
    np.testing.assert_allclose(turn_angle(turn_curvature(angles, front, rear), front, rear), angles, atol=1e-12)


def test_tighter_than_the_tightest_turn_is_the_tightest():
    # κ(θ) is largest where f + r cos θ = 0
    tightest = math.acos(-1.5 / 1.9)
    most = float(turn_curvature(tightest, 1.5, 1.9))
    assert turn_angle(most, 1.5, 1.9) == pytest.approx(tightest, abs=1e-6)  # a square root's end
    assert np.isfinite(turn_angle(2.0 * most, 1.5, 1.9))


@pytest.mark.parametrize("curvature", [0.12, -0.12, 0.0])
@pytest.mark.parametrize("distance", VEHICLE.preview)
def test_pure_pursuit_of_its_own_circle_stays_on_it(curvature, distance):
    seen = VEHICLE.see(on_circle(curvature))
    np.testing.assert_allclose(pursued_angle(seen, distance), turn_angle(curvature, 1.7, 1.7), atol=1e-9)


def test_pure_pursuit_aims_at_places_between_those_of_the_preview():
    seen = VEHICLE.see(on_circle(0.0, cross_track=[0.3, -0.3], heading_error=0.2))
    for distance in (0.0, 0.5, 1.0, 1.6, 8.0):
        x, y = seen.place(distance)
        offset = np.array([0.3, -0.3])
        np.testing.assert_allclose(x, math.cos(0.2) * distance - math.sin(0.2) * offset, atol=1e-9)
        np.testing.assert_allclose(y, -math.sin(0.2) * distance - math.cos(0.2) * offset, atol=1e-9)


def test_stanley_closes_the_error_and_bends_with_the_path():
    policy = Stanley(VEHICLE, heading_gain=2.0, cross_track_gain=0.5)
    np.testing.assert_allclose(policy.joint_angle(VEHICLE.see(on_circle(0.1))), turn_angle(0.1, 1.7, 1.7), atol=1e-9)
    wanted = policy.joint_angle(VEHICLE.see(on_circle(0.0, cross_track=0.3, heading_error=-0.1)))
    np.testing.assert_allclose(wanted, -2.0 * (-0.1 + math.atan(0.5 * 0.3 / SPEED)), atol=1e-9)


# ---- the regulator ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("vehicle", [VEHICLE, LONG_REAR])
def test_the_regulators_model_is_the_kinematics_at_small_errors(vehicle):
    lag, small = 0.12, 1e-4
    rng = np.random.default_rng(0)
    x, (u, kappa) = small * rng.uniform(-1.0, 1.0, 4), small * rng.uniform(-1.0, 1.0, 2)
    f, r = vehicle.front, vehicle.rear
    angle = float(turn_angle(x[2] / (f + r), f, r))

    def motion(_, state):
        e, heading, theta, rate = state
        yaw_rate = (SPEED * math.sin(theta) + r * rate) / (f * math.cos(theta) + r)
        along = SPEED * math.cos(heading) / (1.0 - kappa * e)
        return [SPEED * math.sin(heading), yaw_rate - kappa * along, rate, (u - rate) / lag]

    end = solve_ivp(motion, (0.0, vehicle.control_step), [x[0], x[1], angle, x[3]], rtol=1e-10, atol=1e-14).y[:, -1]
    end[2] = (f + r) * turn_curvature(end[2], f, r)
    a, b, d = preview_model(vehicle, SPEED, lag)
    np.testing.assert_allclose(a @ x + b * u + d * kappa, end, atol=10 * small**2)


@pytest.mark.parametrize("speed", [0.3, 0.75, 2.0])
def test_feedback_solves_the_riccati_equation(speed):
    """By policy iteration: the cost P of the gains K is that of which K is the best."""
    heading_weight, rate_weight, lag = 0.5, 0.1, 0.12
    a, b, _ = preview_model(VEHICLE, speed, lag)
    k, _ = preview_gains(VEHICLE, speed, heading_weight, rate_weight, lag)
    closed = a - np.outer(b, k)
    assert np.abs(np.linalg.eigvals(closed)).max() < 1.0
    cost = np.diag([1.0, heading_weight, 0.0, 0.0]) + rate_weight * np.outer(k, k)
    p = solve_discrete_lyapunov(closed.T, cost)
    np.testing.assert_allclose(b @ p @ a / (rate_weight + b @ p @ b), k, rtol=1e-6)


def test_feed_forward_is_the_optimum_over_the_previewed_curvature():
    """Against least squares over all inputs of 40 s, after which nothing is left to correct."""
    weights, steps = (0.5, 0.1, 0.12), 800
    a, b, d = preview_model(VEHICLE, SPEED, weights[2])
    curvatures = np.array([0.0, 0.05, 0.1, 0.1, -0.05, 0.08])
    kappa = np.interp(SPEED * VEHICLE.control_step * np.arange(steps), [0.0, *VEHICLE.preview], curvatures)
    scale = np.sqrt([1.0, weights[0]])
    x, response = np.zeros(4), np.zeros((4, steps))
    free, forced = np.zeros((steps, 2)), np.zeros((steps, 2, steps))
    for i in range(steps):
        x, response = a @ x + d * kappa[i], a @ response
        response[:, i] = b
        free[i], forced[i] = scale * x[:2], scale[:, None] * response[:2]
    forced = forced.reshape(-1, steps)
    best = np.linalg.solve(forced.T @ forced + weights[1] * np.eye(steps), -forced.T @ free.ravel())
    _, forward = preview_gains(VEHICLE, SPEED, *weights)
    assert best[0] == pytest.approx(-forward @ curvatures, rel=1e-6)


def test_a_steady_turn_needs_no_rate():
    angle = turn_angle(0.1, 1.7, 1.7)
    rates = PreviewRegulator(VEHICLE).joint_rate(VEHICLE.see(on_circle(0.1, joint_angle=angle)))
    np.testing.assert_allclose(rates, 0.0, atol=1e-9)


def test_published_rates_get_the_published_signals():
    class Asked(PreviewRegulator):
        def joint_rate(self, seen):
            return np.array([*VALVE_RATE_LEFT, *np.negative(VALVE_RATE_RIGHT), 2.0, -2.0, 0.009, 0.011])

    policy = Asked(VEHICLE, rest_rate=0.01, dead_band_left=0.135)
    signals = policy(on_circle(np.zeros(10)))[:, 0]
    np.testing.assert_allclose(signals[:8], [*VALVE_SIGNAL, *np.negative(VALVE_SIGNAL), 1.0, -1.0], rtol=1e-6)
    assert signals[8] == 0.0
    assert signals[9] == pytest.approx(0.135 + 0.365 * 0.011 / VALVE_RATE_LEFT[0])


# ---- all of them -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", KINDS)
def test_signs_are_right_and_mirror(kind):
    policy = kind(VEHICLE, dead_band_left=0.15, dead_band_right=0.15)
    seen = {
        "cross_track": [0.5, -0.5, 0.0, 0.0, 0.0, 0.0],
        "heading_error": [0.0, 0.0, 0.3, -0.3, 0.0, 0.0],
        "joint_angle": [0.0, 0.0, 0.0, 0.0, 0.4, -0.4],
    }
    actions = policy(on_circle(0.0, **seen))
    policy.reset()
    assert actions.shape == (6, 2)
    assert actions.dtype == np.float32
    np.testing.assert_array_equal(np.sign(actions[:, 0]), [-1.0, 1.0] * 3)
    if kind is not PreviewRegulator:  # the valve's two sides differ
        np.testing.assert_array_equal(actions[::2, 0], -actions[1::2, 0])
    np.testing.assert_array_equal(actions[:, 1], np.float32(policy.drive_signal))


@pytest.mark.parametrize(
    ("kind", "gain"),
    list(zip(KINDS, ["look_ahead", "heading_gain", "rate_weight", "look_ahead"], strict=True)),
)
def test_gains_may_differ_between_sub_environments(kind, gain):
    values = np.array([0.8, 1.9, 0.8])
    observations = on_circle(0.05, cross_track=0.02, heading_error=[-0.05, -0.05, 0.04])
    each = [kind(VEHICLE, **{gain: value})(observations[i : i + 1])[0] for i, value in enumerate(values)]
    np.testing.assert_allclose(kind(VEHICLE, **{gain: values})(observations), each, rtol=1e-6)


def test_missing_observations_are_named():
    with pytest.raises(ValueError, match="needs the observation term 'joint_rate'"):
        Vehicle({name: columns for name, columns in LAYOUT.items() if name != "joint_rate"})


def test_the_vehicle_of_machines_that_differ_is_their_mean():
    lengths = np.array([1.6, 1.7, 1.7])
    machine = Machine.load("aoro").set({"frame.front.axle_distance": lengths})
    vehicle = Vehicle.of(PathTrackingVectorEnv(3, courses=[Course(Plane(), (LINE,))], machine=machine))
    assert vehicle.front == pytest.approx(lengths.mean())
    assert vehicle.rear == Vehicle.of(PathTrackingEnv(courses=[Course(Plane(), (LINE,))])).rear


def test_actions_that_nobody_gives_are_named():
    env = PathTrackingEnv(courses=[Course(Plane(), (LINE,))], act_gear=True)
    with pytest.raises(ValueError, match="the environment acts on steering_signal, drive_signal, gear, but"):
        Vehicle.of(env)


# ---- on the twin -----------------------------------------------------------------------------------------------------

EXACT = PathTrackingRandomisation(
    sensor_noise=(0.0, 0.0), joint_angle=(0.0, 0.0), lateral_offset=(0.0, 0.0), heading_offset=(0.0, 0.0)
)
RADIUS = 8.0
SLIP = 0.02
"""Share [-] by which tires that scrub may change a turn's curvature: ``test_the_twin_turns_as_the_kinematics_says``."""
DELAY = 0.15
"""A control step, the valve's delay and the oil's until the joint follows a signal [s]."""
ROCKING = SPEED * 0.5 * max(VALVE_RATE_LEFT) * DELAY / math.pi
"""Amplitude [m] of the front axle where the joint rocks by what it turns within that delay, about once in 2 s: the front
frame swings by half of the joint angle."""
LOCALISATION = 0.005
"""Error [m] of what is measured without noise: latency, dead reckoning."""


@pytest.fixture(scope="module")
def env():
    return PathTrackingVectorEnv(
        len(KINDS), courses=[Course(Plane(), (LINE, circle(RADIUS)))], randomisation=EXACT, autoreset_mode="Disabled"
    )


def driven(env, options, steps):
    """Cross-track errors (steps, N), sub-environment i under the controller KINDS[i], and those."""
    policies = [kind(Vehicle.of(env)) for kind in KINDS]
    observations, _ = env.reset(seed=0, options=options)
    errors = []
    for _ in range(steps):
        actions = np.concatenate([policy(observations[i : i + 1]) for i, policy in enumerate(policies)])
        observations, _, terminated, _, infos = env.step(actions)
        assert not terminated.any(), infos["termination"]
        errors.append(infos["cross_track"])
    return np.array(errors), policies


def test_the_twin_turns_as_the_kinematics_says(env):
    env.reset(seed=0, options={"path": 1, "joint_angle": np.array([0.2, 0.4, 0.6, 0.42])})
    action = np.tile(np.array([0.0, 0.65], dtype=np.float32), (env.num_envs, 1))
    rows = []
    for _ in range(80):
        env.step(action)
        rows.append([env.output(name) for name in ("yaw_rate", "speed", "joint_angle")])
    yaw_rate, speed, angle = np.mean(rows[40:], axis=0)
    vehicle = Vehicle.of(env)
    np.testing.assert_allclose(yaw_rate / speed, turn_curvature(angle, vehicle.front, vehicle.rear), rtol=SLIP)


def offset(policy):
    """Cross-track error [m] at which a controller's steering balances the tires' slip and its own dead zone.

    The slip needs the joint angle off by SLIP of the turn's, and the inner loop leaves ``rest_error``, to which a joint at
    full signal adds what it turns in the delay.
    """
    gains: Any = policy
    vehicle = policy.vehicle
    wheelbase = vehicle.front + vehicle.rear
    slip = SLIP * wheelbase / RADIUS
    if isinstance(policy, PreviewRegulator):
        feedback, _ = preview_gains(vehicle, SPEED, gains.heading_weight, gains.rate_weight, gains.lag)
        return (feedback[2] * slip + gains.rest_rate) / feedback[0]
    angle = slip + gains.rest_error
    if isinstance(policy, Stanley):
        return SPEED * math.tan(angle / gains.heading_gain) / gains.cross_track_gain
    if isinstance(policy, FullSpeedSteering):
        angle += max(VALVE_RATE_LEFT) * max(DELAY - gains.lead_time, 0.0)
    # a circle of another curvature through the place ahead; that place is on a chord between two of the preview's
    nodes = (0.0, *vehicle.preview)
    gap = np.diff(nodes)[np.searchsorted(nodes, gains.look_ahead) - 1]
    return angle / wheelbase * gains.look_ahead**2 / 2.0 + gap**2 / (8.0 * RADIUS)


def test_every_controller_stays_on_a_circle(env):
    errors, policies = driven(env, {"path": 1, "start": 0.0}, 500)  # 1.4 quarters around
    for error, policy in zip(errors[200:].T, policies, strict=True):
        assert np.sqrt(np.mean(error**2)) < offset(policy) + ROCKING + LOCALISATION, type(policy).__name__


def test_every_controller_comes_back_to_a_line(env):
    errors, policies = driven(env, {"path": 0, "lateral_offset": 0.5}, 560)  # 20 m
    for error, policy in zip(errors.T, policies, strict=True):
        assert error[0] > 0.4
        # no turn, no slip: even less is left than on a circle
        assert np.abs(error[-100:]).max() < offset(policy) + ROCKING + LOCALISATION, type(policy).__name__
        assert error.min() > -0.25  # overshoots by less than half
