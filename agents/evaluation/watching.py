"""The same episodes under several policies, side by side, while somebody looks."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from aoro_gym.agents.controllers.reference import Factory
from aoro_gym.agents.evaluation.tasks import TASKS
from aoro_gym.checks import check_choice
from aoro_gym.envs import ENVIRONMENTS
from aoro_gym.envs.path_tracking.courses import Course
from aoro_gym.machine import Machine


class WatchedEpisodes:
    """A sub-environment for each policy, episode after episode; episode k has the seed ``seed`` + k for all of them.

    Args:
        env: Id of the environment, a key of ``TASKS``.
        policies: What makes each policy, by name.
        machine: That they drive.
        courses: Where; by default the environment's own.
        seed: Of the first episode.
    """

    def __init__(
        self,
        env: str,
        policies: Mapping[str, Factory],
        *,
        machine: Machine,
        courses: Sequence[Course] | None = None,
        seed: int = 0,
    ):
        check_choice("env", env, TASKS)
        count = len(policies)
        self.env = TASKS[env].make(
            count,
            courses=courses,
            machine=machine,
            autoreset_mode="Disabled",
            max_episode_steps=ENVIRONMENTS[env].max_episode_steps,
        )
        self.names = tuple(policies)
        self._policies = [make(self.env) for make in policies.values()]
        self._next = np.full(count, seed)
        self._begin(np.ones(count, dtype=bool))

    def _begin(self, where: np.ndarray) -> None:
        seeds = [int(seed) if begins else None for seed, begins in zip(self._next, where, strict=True)]
        self._observations, _ = self.env.reset(seed=seeds, options={"reset_mask": where})
        for policy in self._policies:
            policy.reset(where)
        self._next = self._next + where

    def step(self) -> None:
        """A control step; where an episode ends the next one begins."""
        actions = np.stack([policy(self._observations)[i] for i, policy in enumerate(self._policies)])
        self._observations, _, terminated, truncated, _ = self.env.step(actions)
        done = np.asarray(terminated) | np.asarray(truncated)
        if done.any():
            self._begin(done)
