"""Twins that are observed through a memory which no longer learns: what lies behind it learns as if it had none."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import torch  # pyright: ignore[reportMissingImports]
from gymnasium.spaces import Box

from aoro_gym.agents.policies.memory import GatedMemory
from aoro_gym.agents.training.device_env import DeviceEnv, Transition
from aoro_gym.agents.training.memory_network import Memory
from aoro_gym.envs.core.vector import TwinVectorEnv


class RememberingEnv(DeviceEnv):
    """A :class:`DeviceEnv` that gives, for what it observes, what a ``memory`` of that and of all before makes of it.

    To what learns behind it the memory is a part of the world: its state follows from what was observed alone, so that
    observation and state together are as much of a Markov process as they were where the memory learned.

    Args:
        envs: See there, as for ``normalised``, further arguments.
        memory: Of the policy that is learned on from; it takes O numbers and gives K + U.
    """

    def __init__(self, envs: TwinVectorEnv, memory: GatedMemory, **normalised: Any):
        super().__init__(envs, **normalised)
        observed, encoded, units = memory.sizes
        if envs.single_observation_space.shape != (observed,):
            raise ValueError(
                f"the memory takes {observed} numbers, but the environment gives {envs.single_observation_space.shape}"
            )
        self._memory = Memory(observed, units).to(self.device).requires_grad_(False)
        self._memory.take_memory(memory)
        self._state = self._memory.beginning(envs.num_envs)
        self._space = Box(-np.inf, np.inf, (encoded + units,), np.float32)

    @property
    def observation_space(self) -> Box:
        return self._space

    def reset(self, seed: int) -> torch.Tensor:
        self._state = self._memory.beginning(self.envs.num_envs)
        remembered, self._state = self._memory.remember(super().reset(seed), self._state)
        return remembered

    def step(self, actions: torch.Tensor) -> Transition:
        made = super().step(actions)
        reached, _ = self._memory.remember(made.reached, self._state)
        begins = made.terminated | made.truncated
        remembered, self._state = self._memory.remember(
            made.observations, torch.where(begins, torch.zeros_like(self._state), self._state)
        )
        return replace(made, observations=remembered, reached=reached)
