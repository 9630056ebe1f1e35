"""Imitation by a network that remembers: dataset aggregation (:mod:`aoro_gym.agents.training.dagger`) of whole sequences.

What a machine measures at one instant does not say by how much its estimate of the pose has drifted; what it measured
before does. Here the network has a memory, learns from sequences of ``n_steps`` control steps, by back-propagation through
them from the state that the memory had at their beginning, and beside the teacher's actions it learns to tell the errors of
what is measured (true less measured, in units of the term's own deviation): the truth is known while it learns, and the
layer that tells them is dropped afterwards. All arrays stay on the device, but for what the teacher is told.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any

import gymnasium
import numpy as np
import torch  # pyright: ignore[reportMissingImports]
from gymnasium.vector import AutoresetMode

from aoro_gym.agents.controllers.exact import EXACT, exact_observations
from aoro_gym.agents.policies.policy import LearnedPolicy, Normalisation
from aoro_gym.agents.training.callbacks import ProgressCallback, StepCounter
from aoro_gym.agents.training.checkpoints import random_states, restore_random_states
from aoro_gym.agents.training.dagger import CLIP, EPSILON, Hyperparams, least_deviations, prepare, teacher_of
from aoro_gym.agents.training.device_env import DeviceEnv
from aoro_gym.agents.training.memory_network import MemoryNetwork
from aoro_gym.agents.training.plan import TrainingPlan
from aoro_gym.envs import register_envs
from aoro_gym.envs.core.vector import TwinVectorEnv

LARGEST_GRADIENT = 0.5
"""Norm of a gradient beyond which it is shortened."""
LARGEST_ERROR = 5.0
"""Of what is measured, in deviations of its term, that is still learned to be told."""


@dataclass(frozen=True)
class Rollout:
    """T steps of N sub-environments, on their device."""

    observations: torch.Tensor
    """Normalised (T, N, O)."""
    actions: torch.Tensor
    """The teacher's (T, N, A)."""
    errors: torch.Tensor
    """Of the terms that have true values (T, N, K); see :data:`LARGEST_ERROR`."""
    begins: torch.Tensor
    """Whether an episode begins with the observation (T, N)."""
    state: torch.Tensor
    """Of the memory before the first observation (N, U)."""

    @property
    def pairs(self) -> int:
        """Observations with an action."""
        return self.begins.numel()


class RecurrentDagger:
    """A :class:`aoro_gym.agents.training.learner.Learner`: what ``memory`` above 0 makes of ``--algo dagger``.

    Args:
        plan: What to train; of it the environment, the seed and the device count here.
        asked: See :class:`aoro_gym.agents.training.dagger.Hyperparams`.
        clock: That schedules follow.
        env_kwargs: Arguments of the environment.

    Raises ValueError naming a wrong hyper-parameter.
    """

    def __init__(self, plan: TrainingPlan, asked: Hyperparams, clock: StepCounter, env_kwargs: Mapping[str, Any]):
        self._asked, self._learning_rate = asked, clock.schedule("learning_rate", asked.learning_rate)
        register_envs()
        made: Any = gymnasium.make_vec(
            plan.env, num_envs=int(asked.n_envs), device=plan.device, output="torch",
            autoreset_mode=AutoresetMode.SAME_STEP, **env_kwargs,
        )  # fmt: skip
        self.envs: TwinVectorEnv = made.unwrapped
        self._env = DeviceEnv(self.envs, norm_obs=False, norm_reward=False)
        self._device = self._env.device
        self._exact, self._teacher = EXACT[plan.env], teacher_of(plan.env, asked, self.envs)
        layout = self.envs.observation_layout
        self._measured = [column for name in self._exact if name in layout for column in _columns(layout[name])]
        torch.manual_seed(plan.seed)
        seen, acts = self.envs.single_observation_space.shape[0], self.envs.single_action_space.shape[0]
        self._net = MemoryNetwork(seen, asked.memory, asked.net_arch, acts, len(self._measured)).to(self._device)
        self._optimizer = torch.optim.Adam(self._net.parameters())
        self._moments: tuple[torch.Tensor, torch.Tensor] | None = None  # mean and deviation over the first rollout
        self._rollouts: list[Rollout] = []
        self._now: tuple[torch.Tensor, torch.Tensor, torch.Tensor] | None = None  # observations, begins, state
        self._last_episodes = (math.nan, math.nan)
        self._logger: Any = None
        self.steps = 0

    def log_to(self, logger: Any) -> None:
        self._logger = logger

    def learn(self, steps: int, callback: ProgressCallback, *, seed: int | None) -> None:
        if seed is not None:
            count = self.envs.num_envs
            begins = torch.ones(count, dtype=torch.bool, device=self._device)
            self._now = self._env.reset(seed), begins, self._net.beginning(count)
        if self._now is None:
            raise ValueError("seed is None, but there are no running episodes to go on with; give a seed")
        prepare(self._teacher, callback)
        end = self.steps + steps
        while self.steps < end:
            length = min(int(self._asked.n_steps), math.ceil((end - self.steps) / self.envs.num_envs))
            rate = self._learning_rate(0.0)  # before the clock moves on, to its end at last
            self._rollouts.append(self._driven(length, callback))
            while sum(one.pairs for one in self._rollouts) > self._asked.buffer_size:
                self._rollouts.pop(0)
            callback.report("fitting")
            self._fit(rate)

    @torch.no_grad()
    def _driven(self, length: int, callback: ProgressCallback) -> Rollout:
        """Drive for so many control steps, and keep what was seen and what the teacher would have done."""
        assert self._now is not None
        led, noise = self._moments is not None, self._asked.action_noise
        observations, begins, state = self._now
        first, kept = state, []
        for _ in range(length):
            measured = observations.numpy(force=True)
            told = exact_observations(self.envs, measured, self._exact)
            wanted = torch.from_numpy(self._teacher(told).astype(np.float32)).to(self._device)
            errors = torch.from_numpy((told - measured)[:, self._measured]).to(self._device)
            kept.append((observations, wanted, errors, begins))
            actions = wanted
            if led:
                state = torch.where(begins[:, None], 0.0, state)
                actions, state = self._net.step(self._normalised(observations), state)
                actions = actions + noise * torch.randn_like(actions)
            made = self._env.step(torch.clip(actions, *self._bounds()))
            observations, begins = made.observations, (made.terminated | made.truncated)[:, 0]
            ended = begins.numpy(force=True)
            if ended.any():
                self._teacher.reset(ended)
            self.steps += self.envs.num_envs
            callback.on_step(self.steps)
        self._now = observations, begins, state
        seen, wanted, errors, began = (torch.stack(column) for column in zip(*kept, strict=True))
        if self._moments is None:
            flat = seen.reshape(-1, seen.shape[-1]).double()
            least = torch.from_numpy(least_deviations(self.envs)).to(self._device)
            deviation = torch.sqrt(flat.var(dim=0, correction=0) + EPSILON)
            self._moments = flat.mean(dim=0), torch.maximum(deviation, least)
        deviations = (errors / self._moments[1][self._measured]).float()
        return Rollout(
            self._normalised(seen), wanted, torch.clip(deviations, -LARGEST_ERROR, LARGEST_ERROR), began, first
        )

    def _bounds(self) -> tuple[torch.Tensor, torch.Tensor]:
        space: Any = self.envs.single_action_space
        low, high = (torch.from_numpy(bound).to(self._device) for bound in (space.low, space.high))
        return low, high

    def _normalised(self, observations: torch.Tensor) -> torch.Tensor:
        assert self._moments is not None
        mean, deviation = self._moments
        return torch.clip((observations - mean) / deviation, -CLIP, CLIP).float()

    def _fit(self, rate: float) -> None:
        """Least absolute deviations from the teacher's actions, and from the errors of what is measured, by Adam."""
        for group in self._optimizer.param_groups:
            group["lr"] = rate
        wrong, batches = torch.zeros(2, device=self._device), self._batches()
        for rollout, columns in batches:
            actions, errors = self._net(
                rollout.observations[:, columns], rollout.state[columns], rollout.begins[:, columns]
            )
            loss = torch.nn.functional.l1_loss(actions, rollout.actions[:, columns])
            told = torch.zeros_like(loss)
            if errors is not None:
                told = torch.nn.functional.smooth_l1_loss(errors, rollout.errors[:, columns])
            self._optimizer.zero_grad()
            (loss + self._asked.error_weight * told).backward()
            torch.nn.utils.clip_grad_norm_(self._net.parameters(), LARGEST_GRADIENT)
            self._optimizer.step()
            wrong += torch.stack([loss.detach(), told.detach()])
        self._log(*(wrong / len(batches)).tolist())

    def _batches(self) -> list[tuple[Rollout, torch.Tensor]]:
        """All that is kept, ``n_epochs`` times, shuffled: rollouts, and which of their sub-environments."""
        found = []
        for _ in range(int(self._asked.n_epochs)):
            for rollout in self._rollouts:
                count = len(rollout.state)
                size = max(int(self._asked.batch_size) // len(rollout.begins), 1)
                order = torch.randperm(count).to(self._device)
                found += [(rollout, columns) for columns in order.split(size)]
        return [found[k] for k in torch.randperm(len(found)).tolist()]

    def _log(self, actions: float, errors: float) -> None:
        ended = self._env.ended()
        if ended:
            self._last_episodes = ended["return"], ended["success"]
        if self._logger is not None:
            for name, value in (
                ("train/absolute_error", actions),
                ("train/error_of_told_errors", errors),
                ("train/pairs", sum(one.pairs for one in self._rollouts)),
                ("rollout/ep_rew_mean", self._last_episodes[0]),
                ("rollout/success_rate", self._last_episodes[1]),
                ("time/total_timesteps", self.steps),
            ):
                self._logger.record(name, value)
            self._logger.dump(self.steps)

    def episodes(self) -> tuple[float, float]:
        return self._last_episodes

    def policy(self, **about: Any) -> LearnedPolicy:
        normalisation = None
        if self._moments is not None:
            mean, deviation = (values.numpy(force=True).copy() for values in self._moments)
            normalisation = Normalisation(mean, np.maximum(deviation**2 - EPSILON, 0.0), EPSILON, CLIP)
        return self._net.policy(self.envs.single_action_space, normalisation=normalisation, **about)

    def start_from(self, policy: LearnedPolicy) -> None:
        self._net.take(policy)
        assert policy.normalisation is not None
        deviation = np.sqrt(policy.normalisation.variance + policy.normalisation.epsilon)
        mean, deviation = (torch.from_numpy(one.copy()) for one in (policy.normalisation.mean, deviation))
        self._moments = mean.to(self._device), deviation.to(self._device)

    def hold_actor(self, held: bool) -> None:
        """There is no critic."""

    def state(self) -> dict[str, Any]:
        return {
            "network": self._net.state_dict(),
            "optimizer": self._optimizer.state_dict(),
            "moments": list(self._moments or ()),
            "rollouts": [{one.name: getattr(each, one.name) for one in fields(each)} for each in self._rollouts],
            "episodes": list(self._last_episodes),
            "steps": self.steps,
            "random": random_states(self._device),
        }

    def restore(self, state: Mapping[str, Any]) -> None:
        self._net.load_state_dict(state["network"])
        self._optimizer.load_state_dict(state["optimizer"])
        moments = [values.to(self._device) for values in state["moments"]]
        self._moments = (moments[0], moments[1]) if moments else None
        self._rollouts = [
            Rollout(**{name: values.to(self._device) for name, values in one.items()}) for one in state["rollouts"]
        ]
        self._last_episodes = tuple(state["episodes"])
        self.steps = state["steps"]
        restore_random_states(state["random"], self._device)

    def close(self) -> None:
        self._env.close()


def _columns(span: slice) -> range:
    return range(span.start, span.stop)
