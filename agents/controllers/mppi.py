"""Model-predictive path integral control with the twin itself as its model: for every task, by its own rewards.

The plan of H controls u is renewed every control step. K sequences v = u + ε, ε ~ N(0, Σ), are tried on copies of the
running episode (:class:`aoro_gym.envs.core.rollouts.Rollouts`), K times the environment's twins in one launch a step, and

    w_k = exp(−(S_k − min S) / λ) / Σ_j exp(−(S_j − min S) / λ),    u ← u + Σ_k w_k ε_k,

with S_k = −(rewards to come) + γ uᵀ Σ⁻¹ ε_k. The first control is given out; shifted by a step, with its last one held, the
plan is the next one's start (G. Williams et al., "Information-theoretic model predictive control: theory and applications to
autonomous driving", IEEE Trans. Robotics 34, 2018, algorithm 2; ``control_cost`` is γ / λ, their 1 − α). ε is a first-order
autoregressive sequence: smooth as the valves' own lag, so that fewer sequences suffice.

For costs that are quadratic in v, with the Hessian A and the minimum at v*, all is Gaussian, and with γ = λ the mean of the
update is that of N(v | v*, λ A⁻¹) N(v | 0, Σ) from wherever it begins: it minimises S + ½ λ vᵀ Σ⁻¹ v. For a linear model
that is the linear-quadratic regulator whose weight of the controls is λ Σ⁻¹.

This planner is told the truth: it knows the machine's state, the ground, the path and the sensors' errors, none of which
the observation has. It shows what is to be had, not what a controller on the machine would do.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import softmax

from aoro_gym.agents.policies.policy import Actions, Observations
from aoro_gym.checks import check_integer, check_range
from aoro_gym.envs.core.rollouts import Rollouts

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class PathIntegral:
    """The update of plans by sampled controls; numbers of control steps. Raises ValueError naming what is out of bounds."""

    noise: tuple[float, ...]
    """Standard deviation of each of the A controls [-]."""
    horizon: int
    """H."""
    samples: int = 64
    """K."""
    temperature: float = 1.0
    """λ, in the unit of the costs."""
    correlation: float = 0.0
    """Of the noise, time [control steps] in which it falls to 1/e; 0: white."""
    control_cost: float = 0.0
    """γ / λ in [0, 1]: what draws the controls to 0; at 0 they cost only what the costs say."""

    def __post_init__(self) -> None:
        check_integer("horizon", self.horizon)
        check_integer("samples", self.samples, ge=2)
        check_range("temperature", self.temperature, gt=0.0, lt=math.inf)
        check_range("correlation", self.correlation, ge=0.0, lt=math.inf)
        check_range("control_cost", self.control_cost, ge=0.0, le=1.0)
        for each in self.noise:
            check_range("noise", each, gt=0.0, lt=math.inf)

    @cached_property
    def _correlations(self) -> Floats:
        """Of the noise (H, H): its powers of the time between two controls."""
        apart = np.abs(np.subtract.outer(np.arange(self.horizon), np.arange(self.horizon)))
        return np.exp(-apart / self.correlation) if self.correlation > 0.0 else np.eye(self.horizon)

    @cached_property
    def _factor(self) -> Floats:
        return np.asarray(np.linalg.cholesky(self._correlations), dtype=np.float64)

    @cached_property
    def _precision(self) -> Floats:
        return np.asarray(np.linalg.inv(self._correlations), dtype=np.float64)

    def drawn(self, generator: np.random.Generator) -> Floats:
        """Noise (K, H, A); the first sequence is without, so that a good plan stays."""
        white = generator.standard_normal((self.samples, self.horizon, len(self.noise)))
        white[0] = 0.0
        return np.einsum("ij,kja->kia", self._factor, white) * self.noise

    def updated(
        self,
        plans: Floats,
        costs: Callable[[Floats], Floats],
        generator: np.random.Generator,
        low: float | NDArray[Any] = -math.inf,
        high: float | NDArray[Any] = math.inf,
    ) -> Floats:
        """Plans (N, H, A) after one update.

        Args:
            plans: Before it (N, H, A).
            costs: Of sequences of controls (N, K, H, A), without the controls' own cost: (N, K).
            generator: Draws the noise, the same for all plans: none depends on how many others there are.
            low: Least controls (A,).
            high: Largest ones.
        """
        controls = np.clip(plans[:, None] + self.drawn(generator), low, high)
        noise = controls - plans[:, None]
        total = costs(controls)
        if self.control_cost > 0.0:
            pull = np.einsum("ij,nja->nia", self._precision, plans / np.square(self.noise))
            total = total + self.control_cost * self.temperature * np.einsum("nia,nkia->nk", pull, noise)
        weights = softmax(-total / self.temperature, axis=1)
        return plans + np.einsum("nk,nkia->nia", weights, noise)


SETTINGS: Mapping[str, PathIntegral] = {
    "AORO/Turning-v0": PathIntegral((0.5,), horizon=50, temperature=0.05, correlation=10.0),
    "AORO/PathTracking-v0": PathIntegral((0.4, 0.2), horizon=20, temperature=0.1, correlation=6.0),
    "AORO/PathTracking-v1": PathIntegral((0.4, 0.2), horizon=20, temperature=0.1, correlation=6.0),
    "AORO/Levelling-v0": PathIntegral((0.2, 0.2, 0.2, 0.2), horizon=15, temperature=0.2, correlation=3.0),
    "AORO/ForestRun-v0": PathIntegral((0.4, 0.2), horizon=20, temperature=0.1, correlation=6.0),
    "AORO/Loading-v0": PathIntegral((0.4, 0.4, 0.4, 0.4, 0.4, 0.4), horizon=15, temperature=0.1, correlation=4.0),
}
"""By the environment's id."""


@dataclass
class Mppi:
    """The policy for the episodes of an environment, wrapped or not, single or vector.

    Raises ValueError if the noise is not of the environment's actions.
    """

    env: Any
    settings: PathIntegral
    seed: int = 0
    """Of the noise."""
    plans: Floats = field(init=False)
    """(N, H, A)"""

    def __post_init__(self) -> None:
        env = self.env.unwrapped
        self.env = getattr(env, "vector", env)
        space = self.env.single_action_space
        if len(self.settings.noise) != space.shape[0]:
            raise ValueError(f"noise has {len(self.settings.noise)} entries, but the actions are {space.shape[0]}")
        self._low, self._high = space.low, space.high
        self._rollouts = Rollouts(self.env, self.settings.samples)
        self.plans = np.zeros((self.env.num_envs, self.settings.horizon, space.shape[0]))
        self.reset()

    def watching(self, env: Any) -> Mppi:
        """This planner, for the episodes of another environment of the same task, whose machines may be others: those of
        its model stay."""
        self.env = env
        return self

    def reset(self, mask: NDArray[np.bool_] | None = None) -> None:
        """Forget plans."""
        if mask is None:
            self._generator = np.random.default_rng(self.seed)
        self.plans[slice(None) if mask is None else mask] = 0.0

    def __call__(self, observations: Observations) -> Actions:
        """Actions (N, A); the observations are not looked at."""
        self.plans = self.settings.updated(self.plans, self.costs, self._generator, self._low, self._high)
        actions = self.plans[:, 0].astype(np.float32)
        self.plans = np.concatenate([self.plans[:, 1:], self.plans[:, -1:]], axis=1)
        return actions

    def costs(self, controls: Floats) -> Floats:
        """What controls (N, K, H, A) cost from now on (N, K): the rewards until their episode ends, negative."""
        count, samples, horizon, acts = controls.shape
        self._rollouts.load(self.env)
        tried = controls.reshape(count * samples, horizon, acts).astype(np.float32)
        return -self._rollouts.returns(tried).reshape(count, samples)
