"""The update finds what closed forms say; the planner predicts what then happens, and gains by planning."""

from typing import Any

import gymnasium
import numpy as np
import pytest
from scipy.linalg import solve_discrete_are

from aoro_gym.agents.controllers.mppi import SETTINGS, Mppi, PathIntegral
from aoro_gym.agents.controllers.privileged import PRIVILEGED_POLICIES
from aoro_gym.envs import ENVIRONMENTS, register_envs
from tests.envs.path_tracking.paths import LEVEL

register_envs()

STEP = 0.2
A, B = np.array([[1.0, STEP], [0.0, 1.0]]), np.array([0.5 * STEP**2, STEP])  # a mass, pushed
Q, HORIZON = np.diag([1.0, 0.1]), 12
DEVIATION, TEMPERATURE = 0.8, 2.0
WEIGHT = TEMPERATURE / DEVIATION**2  # what the law gives the controls: ½ λ uᵀ Σ⁻¹ u, with costs of ½ xᵀ Q x


def riccati() -> list[np.ndarray]:
    """Gains (2,) of the optimum over ``HORIZON`` steps with the stationary cost to go at their end, the first one first."""
    cost = terminal()
    gains = []
    for _ in range(HORIZON):
        gain = B @ cost @ A / (WEIGHT + B @ cost @ B)
        cost = Q + A.T @ cost @ (A - np.outer(B, gain))
        gains.insert(0, gain)
    return gains


def terminal() -> np.ndarray:
    return solve_discrete_are(A, B[:, None], Q, np.array([[WEIGHT]]))


def costs(start: np.ndarray):
    """Of the states after each control, for plans from ``start`` (N, 2)."""

    def of(controls: np.ndarray) -> np.ndarray:
        state = np.broadcast_to(start[:, None], (*controls.shape[:2], 2))
        total = np.zeros(controls.shape[:2])
        for step in range(controls.shape[2]):
            state = state @ A.T + controls[:, :, step] * B
            weight = Q if step < controls.shape[2] - 1 else terminal()
            total += 0.5 * np.einsum("nki,ij,nkj->nk", state, weight, state)
        return total

    return of


def optimum(start: np.ndarray) -> np.ndarray:
    """Controls (N, H) of the regulator."""
    state, out = start, []
    for gain in riccati():
        out.append(-state @ gain)
        state = state @ A.T + out[-1][:, None] * B
    return np.stack(out, axis=1)


def test_the_regulator_is_found():
    """Where the update is at rest, it scatters by the spread of the best sequences over the root of how many count.

    The spread of N(v | v*, λ A⁻¹) N(v | 0, Σ) is at most that of the noise. By the weights at the optimum 1 / Σ w² count;
    four standard deviations of the mean of as many, for each of the numbers that are compared, are let.
    """
    start = np.array([[1.0, 0.0], [-0.5, 0.6]])
    law = PathIntegral((DEVIATION,), HORIZON, 10_000, temperature=TEMPERATURE, control_cost=1.0)
    generator, plans = np.random.default_rng(0), np.zeros((2, HORIZON, 1))
    for _ in range(8):
        plans = law.updated(plans, costs(start), generator)
    counted = []

    def watched(controls: np.ndarray) -> np.ndarray:
        found = costs(start)(controls) + WEIGHT * np.einsum("nia,nkia->nk", plans, controls - plans[:, None])
        weights = np.exp(-(found - found.min(axis=1, keepdims=True)) / TEMPERATURE)
        weights /= weights.sum(axis=1, keepdims=True)
        counted.append(1.0 / np.square(weights).sum(axis=1))
        return costs(start)(controls)

    law.updated(plans, watched, generator)
    tolerance = 4.0 * DEVIATION / np.sqrt(counted[0].min())
    assert tolerance < 0.15  # of commands of about 1
    best = optimum(start)
    np.testing.assert_allclose(plans[:, :, 0], best, atol=tolerance)
    # the cost to go at the end is the stationary one: the first command is that of the regulator without an end
    endless = -start @ (B @ terminal() @ A / (WEIGHT + B @ terminal() @ B))
    np.testing.assert_allclose(best[:, 0], endless, rtol=1e-9)
    assert np.abs(best[:, 0]).min() > 2.0 * tolerance  # so that doing nothing would not pass


def test_without_a_cost_of_their_own_controls_pay_nothing():
    """One control, cost ½ a (v − 3)²: the update moves by the share σ² a / (σ² a + λ) of the way, up to sampling."""
    law = PathIntegral((0.5,), 1, 50_000, temperature=1.0)
    found, share = np.zeros((1, 1, 1)), 0.25 * 4.0 / (0.25 * 4.0 + 1.0)
    for _ in range(3):
        after = law.updated(found, lambda v: 2.0 * (v[:, :, 0, 0] - 3.0) ** 2, np.random.default_rng(1))
        # the farther the goal, the fewer count: the standard error is that of the weighted mean
        np.testing.assert_allclose(after, found + share * (3.0 - found), atol=0.15)
        found = after
    for _ in range(40):
        found = law.updated(found, lambda v: 2.0 * (v[:, :, 0, 0] - 3.0) ** 2, np.random.default_rng(2))
    np.testing.assert_allclose(found, 3.0, atol=4.0 * 0.5 / np.sqrt(10_000))


def test_noise_is_as_smooth_and_as_large_as_asked_for():
    law = PathIntegral((0.5, 2.0), 30, 4000, correlation=5.0)
    noise = law.drawn(np.random.default_rng(0))
    assert not noise[0].any()
    # of the means of K draws: √(2 / K) of a variance, 1 / √K of a correlation
    np.testing.assert_allclose(noise.std(axis=0), np.broadcast_to([0.5, 2.0], (30, 2)), rtol=4.0 * np.sqrt(0.5 / 4000))
    apart = np.mean(noise[:, 0] * noise[:, 5], axis=0) / np.square(law.noise)
    np.testing.assert_allclose(apart, np.exp(-1.0), atol=4.0 * np.sqrt(1.2 / 4000))
    bounded = law.updated(np.zeros((1, 30, 2)), lambda v: -v.sum(axis=(2, 3)), np.random.default_rng(0), -0.1, 0.1)
    assert np.abs(bounded).max() <= 0.1


def made(environment: str, count: int) -> Any:
    options: dict[str, Any] = {"courses": [LEVEL]} if "Path" in environment else {}
    vector: Any = gymnasium.make_vec(environment, num_envs=count, autoreset_mode="Disabled", **options)
    return vector.unwrapped


def test_every_environment_can_be_planned_for():
    assert list(PRIVILEGED_POLICIES) == list(SETTINGS) == list(ENVIRONMENTS)


@pytest.mark.parametrize("environment", SETTINGS)
def test_a_plan_costs_what_it_then_costs(environment):
    env, settings = made(environment, 2), SETTINGS[environment]
    settings = PathIntegral(settings.noise, 6, 4, temperature=settings.temperature, correlation=2.0)
    planner = Mppi(env, settings)
    observations, _ = env.reset(seed=5)
    for _ in range(2):
        actions = planner(observations)
        assert env.action_space.contains(actions)
        observations, *_ = env.step(actions)
    foreseen = planner.costs(np.repeat(planner.plans[:, None], 4, axis=1))
    steps = [env.step(planner.plans[:, step].astype(np.float32))[1] for step in range(6)]
    then = -np.asarray(steps, dtype=np.float64).sum(axis=0)
    np.testing.assert_allclose(foreseen, np.repeat(then[:, None], 4, axis=1), rtol=0.0, atol=1e-12)
    planner.reset(np.array([True, False]))
    assert not planner.plans[0].any() and planner.plans[1].any()


def test_planning_alone_and_beside_others_is_the_same():
    several, alone = made("AORO/Turning-v0", 2), made("AORO/Turning-v0", 1)
    settings = PathIntegral((0.4,), 5, 4)
    planners = Mppi(several, settings), Mppi(alone, settings)
    seen = several.reset(seed=5)[0], alone.reset(seed=5)[0]
    for _ in range(2):
        both = [planner(each) for planner, each in zip(planners, seen, strict=True)]
        np.testing.assert_array_equal(both[0][:1], both[1])
        seen = several.step(both[0])[0], alone.step(both[1])[0]


def test_planning_brings_more_than_doing_nothing():
    """Along the line from rest: half a second ahead, by 16 sequences."""
    env = made("AORO/PathTracking-v0", 1)
    planner, total = Mppi(env, PathIntegral((0.3, 0.3), 10, 16, temperature=0.1, correlation=5.0)), 0.0
    observations, _ = env.reset(seed=1, options={"path": 0})
    for _ in range(25):
        observations, reward, *_ = env.step(planner(observations))
        total += float(reward[0])
    assert env.output("speed")[0] > 0.3
    assert total > 2.0  # at rest each step costs


def test_what_is_wrong_is_named():
    with pytest.raises(ValueError, match="temperature is 0"):
        PathIntegral((0.4,), 5, temperature=0.0)
    with pytest.raises(ValueError, match="noise has 2 entries, but the actions are 1"):
        Mppi(made("AORO/Turning-v0", 1), PathIntegral((0.4, 0.4), 5))
