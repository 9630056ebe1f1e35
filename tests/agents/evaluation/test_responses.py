"""Metrics of step responses, on responses that are known."""

from dataclasses import replace

import numpy as np

from aoro_gym.agents.evaluation.responses import Rollout, flow_curves, flow_overshoot, responses
from aoro_gym.machine import Machine
from aoro_gym.sensors.chain import turn_flow

STEP = 0.02
CYLINDER = Machine.load("aoro").steering.cylinder


def run_of(angle, target, start=0.0):
    shape = np.shape(angle)
    return Rollout(
        control_step=STEP,
        joint_angle=np.asarray(angle, dtype=np.float32)[:, None],
        target=np.broadcast_to(np.float32(target), shape)[:, None],
        start_angle=np.array([start], dtype=np.float32),
        steering_signal=np.zeros((*shape, 1), dtype=np.float32),
        reward=np.full((*shape, 1), 0.5, dtype=np.float32),
        success=np.array([True]),
        sampled_angle=np.repeat(np.asarray(angle, dtype=np.float32), 2)[:, None],
        cylinder=CYLINDER,
    )


def test_second_order_response_has_its_textbook_figures():
    time = STEP * np.arange(1, 301)
    damping, pulse = 0.5, 4.0
    damped = pulse * np.sqrt(1 - damping**2)
    decay = np.exp(-damping * pulse * time)
    angle = 0.5 * (1 - decay * (np.cos(damped * time) + damping * pulse / damped * np.sin(damped * time)))
    found = responses(run_of(angle, 0.5), tolerance=0.01)
    np.testing.assert_allclose(found["step"], 0.5)
    # to the sampling of the peak
    np.testing.assert_allclose(found["overshoot"], 0.5 * np.exp(-np.pi * damping / np.sqrt(1 - damping**2)), rtol=2e-3)
    crossing = time[np.argmax(angle >= 0.45)]
    np.testing.assert_allclose(found["rise_time"], crossing, atol=1e-9)
    last = time[np.flatnonzero(np.abs(angle - 0.5) > 0.01)[-1]]
    np.testing.assert_allclose(found["settling_time"], last + STEP, atol=1e-9)
    assert found["final_error"] < 1e-3


def test_each_target_counts_from_where_the_joint_stood():
    angle = np.concatenate([np.full(150, 0.3), np.full(150, -0.2), np.full(50, 0.1)])
    target = np.concatenate([np.full(150, 0.3), np.full(150, -0.2), np.full(50, 0.1)])
    found = responses(run_of(angle, target, start=0.1), tolerance=0.01)
    np.testing.assert_allclose(found["step"], [0.2, -0.5], rtol=1e-6)  # the last one is too short
    np.testing.assert_allclose(found["rise_time"], STEP)
    np.testing.assert_allclose(found["overshoot"], 0.0, atol=1e-7)


def test_what_is_never_reached_has_no_time():
    found = responses(run_of(np.zeros(200), 0.5), tolerance=0.01)
    assert np.isnan(found["rise_time"]).all()
    assert np.isnan(found["settling_time"]).all()
    assert np.isnan(found["overshoot"]).all()
    np.testing.assert_allclose(found["held"], 4.0)
    np.testing.assert_allclose(found["final_error"], 0.5)


def test_a_joint_that_stands_where_the_next_target_is_has_not_settled_on_it():
    """It never moves; the second target happens to lie where it stands."""
    target = np.concatenate([np.full(150, 0.5), np.full(150, 0.004)])
    found = responses(run_of(np.zeros(300), target), tolerance=0.01)
    np.testing.assert_allclose(found["step"], [0.5])
    assert np.isnan(found["settling_time"]).all()


def test_whoever_comes_within_the_tolerance_has_an_overshoot():
    for last, overshoot in ((0.489, np.nan), (0.491, 0.0), (0.5, 0.0), (0.52, 0.02)):
        found = responses(run_of(np.linspace(0.0, last, 200), 0.5), tolerance=0.01)
        np.testing.assert_allclose(found["overshoot"], overshoot, atol=1e-7)


def test_returns_sum_the_rewards():
    np.testing.assert_allclose(run_of(np.zeros(200), 0.5).returns, 100.0)


def test_a_flow_curve_with_a_known_peak_has_that_overshoot():
    # 10 at first, then 8: the steady period [0.48 T, 0.92 T] sees the 8 only
    flow = np.concatenate([np.full(30, 10.0), np.full(70, 8.0), np.zeros(50)])
    turned = np.concatenate([np.linspace(0.0, 0.5, 101)[1:], np.full(50, 0.5)])
    assert flow_overshoot(flow, turned, 0.5, 0.01) == 0.25
    # what comes after the target does not count
    flow[120] = 100.0
    assert flow_overshoot(flow, turned, 0.5, 0.01) == 0.25
    # a curve without a peak has none, a joint that does not arrive no metric
    assert flow_overshoot(np.full(150, 8.0), turned, 0.5, 0.01) == 0.0
    assert np.isnan(flow_overshoot(flow, 0.5 * turned, 0.5, 0.01))


def test_flow_curve_is_the_joint_rate_through_the_cylinders():
    """A slow swing, which a 7 Hz filter and differences over 10 ms pass: at 0.5 Hz they take 2e-4 of it."""
    time = 0.01 * np.arange(1, 601)
    swing = 0.3 * (1 - np.cos(np.pi * time))
    run = run_of(swing[1::2], 0.6)
    run = replace(run, sampled_angle=swing.astype(np.float32)[:, None])
    assert run.sample_step == 0.01
    rate = 0.3 * np.pi * np.sin(np.pi * time)
    for direction, flow in flow_curves(run).items():
        exact = turn_flow(CYLINDER, swing, rate, direction)
        middle = slice(50, -50)
        np.testing.assert_allclose(flow[middle, 0], exact[middle], atol=1e-3 * np.abs(exact).max())


def test_flow_overshoot_of_a_turn_left_and_right():
    """0.2 rad/s with a swell to 0.4 at 0.8 s, slow enough for the chain, whose gain at 3 Hz is 0.999: the exact flow at the
    swell over that of the steady period tells."""
    time = 0.01 * np.arange(1, 501)
    rate = np.where(time < 4.0, 0.2, 0.0) + 0.2 * np.exp(-(((time - 0.8) / 0.2) ** 2))
    angle = np.cumsum(0.01 * rate) - 0.01 * rate[0]
    end = angle[-1]
    arrives = time[np.argmax(angle >= end - 0.01)]
    flow = turn_flow(CYLINDER, angle, rate, 1.0)
    steady = flow[(time > 0.48 * arrives) & (time < 0.92 * arrives)].mean()
    for side in (1.0, -1.0):
        run = replace(run_of(side * angle[1::2], side * end), sampled_angle=(side * angle).astype(np.float32)[:, None])
        found = responses(run, tolerance=0.01)
        np.testing.assert_allclose(found["flow_overshoot"], flow.max() / steady - 1.0, rtol=0.02)
