"""Figures of step responses, on responses that are known."""

import numpy as np

from aoro_gym.agents.responses import Rollout, responses

STEP = 0.02


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
    np.testing.assert_allclose(found["final_error"], 0.5)


def test_returns_sum_the_rewards():
    np.testing.assert_allclose(run_of(np.zeros(200), 0.5).returns, 100.0)
