"""What learns from a teacher that sees more: a network does, by what the machine measures, as a reference controller does
that is told the truth.

The teacher is told exact errors, so it is quicker than noise would let it be; the middle of what it does, given a
measurement, is what the network comes to (D. Chen et al., "Learning by cheating", CoRL 2019), so it trusts each sensor by
how much it tells. The middle is the median, by least absolute deviations: where left and right are as likely the mean would
be a signal within the valve's dead band, at which nothing moves. Pairs of observation and teacher's action are gathered
where the network itself leads (S. Ross, G. Gordon and D. Bagnell, "A reduction of imitation learning and structured
prediction to no-regret online learning", AISTATS 2011): the teacher drives the first rollout, the network, disturbed by
``action_noise``, all others, and after each of them the network is fitted to all pairs that are kept. There is no reward in
it; PPO can learn on from where it ends (``--start``).
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import torch  # pyright: ignore[reportMissingImports]
from numpy.typing import NDArray

from aoro_gym.agents.controllers.exact import EXACT, exact_observations
from aoro_gym.agents.controllers.forest_arcs import ArcPlanner
from aoro_gym.agents.controllers.levelling import ModalController
from aoro_gym.agents.controllers.privileged import PRIVILEGED_POLICIES
from aoro_gym.agents.controllers.reference import reference_policy
from aoro_gym.agents.policies.networks import into_network, of_network
from aoro_gym.agents.policies.policy import LearnedPolicy, Normalisation, Policy
from aoro_gym.agents.training.callbacks import ProgressCallback, StepCounter
from aoro_gym.agents.training.checkpoints import random_states, restore_random_states
from aoro_gym.agents.training.perceptron import perceptron
from aoro_gym.agents.training.plan import TrainingPlan
from aoro_gym.agents.training.recipe import check_positive_integers
from aoro_gym.agents.training.vec_env import make_vec_env
from aoro_gym.checks import check_integer, check_range
from aoro_gym.envs.core.vector import TwinVectorEnv
from aoro_gym.execution.device_names import on_cpu

EPSILON, CLIP = 1e-8, 10.0
"""Of the normalisation, as ``VecNormalize`` has them."""
PART = 50_000
"""Observations that are normalised at once."""
EPISODES = 100
"""The last ones that are told of."""


@dataclass(frozen=True, kw_only=True)
class Hyperparams:
    """Raises ValueError naming one, its value and its bound."""

    n_timesteps: float
    n_envs: int
    teacher: str
    """Name of a reference controller, or of one that is told more than the observation."""
    teacher_kwargs: Mapping[str, float] = field(default_factory=dict)
    """Gains other than its own, which are tuned for noisy sensors."""
    n_steps: int = 1000
    """Of each sub-environment between two fits."""
    buffer_size: int = 256_000
    """Pairs that are kept, the newest ones. Where the teacher drives, errors are small beside the noise of what is measured,
    and a measurement means little; the sooner that is forgotten, the sooner the network trusts its own ones."""
    action_noise: float = 0.1
    """Standard deviation by which the network's actions are disturbed while it drives."""
    n_epochs: int = 5
    """Of a fit, over all pairs that are kept."""
    batch_size: int = 1024
    learning_rate: float | str = "lin_2e-3"
    """At which a fit begins, to fall to 0 in its course; ``lin_NUMBER`` also falls from fit to fit."""
    net_arch: tuple[int, ...] = (64, 64)
    memory: int = 0
    """Gated recurrent units before these layers, see :mod:`aoro_gym.agents.training.recurrent_dagger`; 0: none."""
    error_weight: float = 0.2
    """With a memory: of telling the errors of what is measured, beside the teacher's actions."""

    def __post_init__(self) -> None:
        check_positive_integers(self, "n_envs", "n_steps", "buffer_size", "n_epochs", "batch_size")
        check_integer("memory", self.memory, ge=0)
        check_range("error_weight", self.error_weight, ge=0.0, lt=math.inf)
        if self.buffer_size < self.n_envs * self.n_steps:
            raise ValueError(
                f"buffer_size is {self.buffer_size}, but must hold a rollout, n_envs * n_steps = "
                f"{self.n_envs * self.n_steps}"
            )
        check_range("action_noise", self.action_noise, ge=0.0, lt=math.inf)

    @classmethod
    def of(cls, plan: TrainingPlan, values: Mapping[str, Any]) -> Hyperparams:
        """Those of a recipe; raises ValueError naming one that there is not, too."""
        try:
            return cls(**values)
        except TypeError as error:
            raise ValueError(f"hyper-parameters of {plan.env} that dagger does not take: {error}") from error


class Dagger:
    """A :class:`aoro_gym.agents.training.learner.Learner`: dataset aggregation with a teacher that knows the true errors.

    Args:
        plan: What to train; of it the environment, the seed and the device count here.
        hyperparams: See :class:`Hyperparams`.
        clock: That schedules follow.
        env_kwargs: Arguments of the environment.

    Raises ValueError naming a wrong hyper-parameter.
    """

    def __init__(
        self, plan: TrainingPlan, hyperparams: Mapping[str, Any], clock: StepCounter, env_kwargs: Mapping[str, Any]
    ):
        self._asked = asked = Hyperparams.of(plan, hyperparams)
        self._env: Any = make_vec_env(plan.env, int(asked.n_envs), plan.seed, device=plan.device, env_kwargs=env_kwargs)
        self.envs: TwinVectorEnv = self._env.unwrapped.envs
        self._device = torch.device("cpu" if on_cpu(plan.device) else plan.device)
        self._learning_rate = clock.schedule("learning_rate", asked.learning_rate)
        self._exact = EXACT[plan.env]
        self._teacher = teacher_of(plan.env, asked, self.envs)
        torch.manual_seed(plan.seed)
        seen, acts = self.envs.single_observation_space.shape[0], self.envs.single_action_space.shape[0]
        self._net = perceptron([seen, *asked.net_arch, acts]).to(self._device)
        self._mean: NDArray[np.float64] | None = None  # of the first rollout, as is the variance
        self._variance = np.ones(seen)
        self._observations = np.zeros((0, seen), dtype=np.float32)
        self._actions = np.zeros((0, acts), dtype=np.float32)
        self._last_observations: NDArray[np.float32] | None = None
        self._episodes: deque[tuple[float, float]] = deque(maxlen=EPISODES)
        self._logger: Any = None
        self.steps = 0

    def log_to(self, logger: Any) -> None:
        self._logger = logger

    def learn(self, steps: int, callback: ProgressCallback, *, seed: int | None) -> None:
        if seed is not None:
            self._env.seed(seed)
            self._last_observations = self._env.reset()
        if self._last_observations is None:
            raise ValueError("seed is None, but there are no running episodes to go on with; give a seed")
        prepare(self._teacher, callback)
        end = self.steps + steps
        while self.steps < end:
            rollout = min(self._asked.n_steps, math.ceil((end - self.steps) / self.envs.num_envs))
            rate = self._learning_rate(0.0)  # before the clock moves on, to its end at last
            self._gather(rollout, callback)
            callback.report("fitting")
            self._fit(rate)

    def _gather(self, rollout: int, callback: ProgressCallback) -> None:
        """Drive for so many control steps, and keep what was seen and what the teacher would have done."""
        led, space = self._mean is not None, self.envs.single_action_space
        seen, done = [], []
        observations = self._last_observations
        assert observations is not None
        for _ in range(rollout):
            wanted = self._teacher(exact_observations(self.envs, observations, self._exact)).astype(np.float32)
            seen.append(observations.copy())
            done.append(wanted)
            actions = self._led_by_network(observations) if led else wanted
            noise = self._asked.action_noise * torch.randn(actions.shape).numpy() if led else 0.0
            observations, _, dones, infos = self._env.step(np.clip(actions + noise, space.low, space.high))
            if dones.any():
                self._teacher.reset(dones)
            for info in infos:
                if "episode" in info:
                    self._episodes.append((info["episode"]["r"], float(info.get("is_success", math.nan))))
            self.steps += self.envs.num_envs
            callback.on_step(self.steps)
        self._last_observations = observations
        keep = int(self._asked.buffer_size)
        self._observations = np.concatenate([self._observations, *seen])[-keep:]
        self._actions = np.concatenate([self._actions, *done])[-keep:]
        if self._mean is None:
            self._mean = self._observations.mean(axis=0, dtype=np.float64)
            variance = self._observations.var(axis=0, dtype=np.float64)
            self._variance = np.maximum(variance, least_deviations(self.envs) ** 2)

    @torch.no_grad()
    def _led_by_network(self, observations: NDArray[np.float32]) -> NDArray[np.float32]:
        """What :meth:`policy` does (N, A) at ``observations`` (N, O), calculated on the device."""
        space: Any = self.envs.single_action_space
        return np.clip(self._net(self._normalised(observations)).numpy(force=True), space.low, space.high)

    def _normalised(self, observations: NDArray[np.float32]) -> torch.Tensor:
        """What the network takes (N, O) of ``observations`` (N, O), on the device."""
        assert self._mean is not None
        scales = self._mean, np.sqrt(self._variance + EPSILON)
        mean, deviation = (torch.from_numpy(values).to(self._device) for values in scales)
        wide = torch.from_numpy(observations).to(self._device).double()  # as a policy's file calculates it
        return wide.sub_(mean).div_(deviation).clip_(-CLIP, CLIP).float()

    def _fit(self, learning_rate: float) -> None:
        """Least absolute deviations from the teacher's actions, by Adam."""
        asked, seen = self._asked, self._observations
        # in parts: all at once in float64 they would take several times their memory
        inputs = torch.cat([self._normalised(seen[first : first + PART]) for first in range(0, len(seen), PART)])
        wanted = torch.from_numpy(self._actions).to(self._device)
        size = min(int(asked.batch_size), len(inputs))
        batches = len(inputs) // size * int(asked.n_epochs)
        optimizer = torch.optim.Adam(self._net.parameters(), lr=learning_rate)
        falling = torch.optim.lr_scheduler.LinearLR(optimizer, 1.0, 0.0, batches)
        left = torch.zeros((), device=self._device)
        for _ in range(int(asked.n_epochs)):
            left.zero_()
            order = torch.randperm(len(inputs))[: len(inputs) // size * size].to(self._device)
            for rows in order.split(size):
                loss = torch.nn.functional.l1_loss(self._net(inputs[rows]), wanted[rows])
                optimizer.zero_grad()
                loss.backward()
                optimizer.step()
                falling.step()
                left += loss.detach()
        if self._logger is not None:
            mean_return, success = self.episodes()
            for name, value in (
                ("train/absolute_error", float(left) * asked.n_epochs / batches),
                ("train/pairs", len(inputs)),
                ("rollout/ep_rew_mean", mean_return),
                ("rollout/success_rate", success),
                ("time/total_timesteps", self.steps),
            ):
                self._logger.record(name, value)
            self._logger.dump(self.steps)

    def _normalisation(self) -> Normalisation:
        assert self._mean is not None
        return Normalisation(self._mean, self._variance, EPSILON, CLIP)

    def episodes(self) -> tuple[float, float]:
        if not self._episodes:
            return math.nan, math.nan
        returns, success = np.mean(self._episodes, axis=0)
        return float(returns), float(success)

    def policy(self, **about: Any) -> LearnedPolicy:
        normalisation = None if self._mean is None else self._normalisation()
        return of_network(self._net, self.envs.single_action_space, normalisation=normalisation, **about)

    def start_from(self, policy: LearnedPolicy) -> None:
        into_network(policy, self._net, normalised=True)
        assert policy.normalisation is not None
        self._mean, self._variance = policy.normalisation.mean.copy(), policy.normalisation.variance.copy()

    def hold_actor(self, held: bool) -> None:
        """There is no critic."""

    def state(self) -> dict[str, Any]:
        mean = [] if self._mean is None else self._mean
        return {
            "network": self._net.state_dict(),
            "moments": [torch.tensor(values, dtype=torch.float64) for values in (mean, self._variance)],
            "pairs": [torch.from_numpy(values) for values in (self._observations, self._actions)],
            "episodes": [list(one) for one in self._episodes],
            "steps": self.steps,
            "random": random_states(self._device),
        }

    def restore(self, state: Mapping[str, Any]) -> None:
        self._net.load_state_dict(state["network"])
        mean, self._variance = (values.numpy() for values in state["moments"])
        self._mean = mean if len(mean) else None
        self._observations, self._actions = (values.numpy() for values in state["pairs"])
        self._episodes = deque(map(tuple, state["episodes"]), maxlen=EPISODES)
        self.steps = state["steps"]
        restore_random_states(state["random"], self._device)

    def close(self) -> None:
        self._env.close()


def least_deviations(envs: TwinVectorEnv) -> NDArray[np.float64]:
    """Deviations (O,) that observations are normalised by at least: 0, but for terms whose function says otherwise by its
    ``least_deviation``, as the first rollout does not show of them what comes later."""
    out = np.zeros(envs.single_observation_space.shape)
    for name, term in envs.task.observation_terms.items():
        out[envs.observation_layout[name]] = getattr(term.function, "least_deviation", 0.0)
    return out


def prepare(teacher: Policy, callback: ProgressCallback) -> None:
    """Let a teacher that has maps draw them, and tell of it."""
    if isinstance(teacher, ArcPlanner):
        teacher.prepare(lambda share: callback.report("drawing the teacher's maps", share))


def teacher_of(env: str, asked: Hyperparams, envs: TwinVectorEnv) -> Policy:
    """The controller of this name, with the gains that were asked for."""
    privileged = PRIVILEGED_POLICIES.get(env, {})
    known = asked.teacher in privileged
    teacher: Any = privileged[asked.teacher](envs) if known else reference_policy(env, asked.teacher, envs)
    if isinstance(teacher, ModalController):
        return teacher.with_gains(**asked.teacher_kwargs)
    try:
        return replace(teacher, **asked.teacher_kwargs)
    except TypeError as error:
        raise ValueError(f"teacher_kwargs {dict(asked.teacher_kwargs)} of {asked.teacher}: {error}") from error
