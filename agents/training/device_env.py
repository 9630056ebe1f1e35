"""The batched twin as learning on a GPU takes it: tensors that never leave the device, normalised as they are learned from.

Normalisation is that of Stable-Baselines3's ``VecNormalize``, so that a policy is the same few numbers whatever trained it.
Needs torch and nothing else.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import torch  # pyright: ignore[reportMissingImports]
from gymnasium import Space
from gymnasium.vector import AutoresetMode

from aoro_gym.agents.policies.networks import KNOWN
from aoro_gym.agents.policies.policy import Normalisation
from aoro_gym.envs.core.vector import TwinVectorEnv, contributions

FIRST_COUNT = 1e-4
"""Observations that the first mean 0 and variance 1 count for."""


class Moments:
    """Running mean and variance over batches, float64 on the device.

    Args:
        shape: Of one sample.
        device: Where they live.
    """

    def __init__(self, shape: tuple[int, ...], device: torch.device):
        self.mean = torch.zeros(shape, dtype=torch.float64, device=device)
        self.variance = torch.ones(shape, dtype=torch.float64, device=device)
        self.count = FIRST_COUNT

    def update(self, samples: torch.Tensor) -> None:
        """Take in a batch (N, …): Chan, Golub and LeVeque's formula for two sets."""
        variance, mean = torch.var_mean(samples.double(), dim=0, correction=0)
        count, delta = self.count + len(samples), mean - self.mean
        share = len(samples) / count
        self.variance = (1.0 - share) * self.variance + share * variance + (1.0 - share) * share * delta.square()
        self.mean = self.mean + share * delta
        self.count = count

    def state(self) -> dict[str, Any]:
        """Tensors and plain values."""
        return {"mean": self.mean, "variance": self.variance, "count": self.count}

    def restore(self, state: Mapping[str, Any]) -> None:
        """Take up what :meth:`state` gave."""
        self.mean, self.variance = (state[name].to(self.mean.device) for name in ("mean", "variance"))
        self.count = state["count"]


@dataclass(frozen=True)
class Transition:
    """A step of N sub-environments, on their device."""

    observations: torch.Tensor
    """To act on next (N, O), float32: of a new episode where one has ended."""
    reached: torch.Tensor
    """Where the step itself has led (N, O): the last of its episode where one has ended, to bootstrap time limits from."""
    rewards: torch.Tensor
    """(N, 1), float32."""
    terminated: torch.Tensor
    """Ends for a reason in the task (N, 1): nothing is to be won after them."""
    truncated: torch.Tensor
    """Time limits (N, 1)."""


class DeviceEnv:
    """Steps a :class:`~aoro_gym.envs.core.vector.TwinVectorEnv` with tensors.

    Args:
        envs: Made with ``output="torch"`` and ``autoreset_mode="SameStep"``.
        norm_obs: Whether to normalise observations: (x − mean) / √(variance + epsilon), within ±``clip_obs``.
        norm_reward: Whether to divide rewards by the deviation of the discounted return, within ±``clip_reward``.
        clip_obs: See above.
        clip_reward: See above.
        gamma: Discount of that return.
        epsilon: See above.

    Raises ValueError if ``envs`` were made otherwise.
    """

    def __init__(
        self,
        envs: TwinVectorEnv,
        *,
        norm_obs: bool = True,
        norm_reward: bool = True,
        clip_obs: float = 10.0,
        clip_reward: float = 10.0,
        gamma: float = 0.99,
        epsilon: float = 1e-8,
    ):
        if envs.handed_out.on_host:
            raise ValueError("output is 'numpy', but learning on the device needs 'torch'")
        if envs.autoreset_mode is not AutoresetMode.SAME_STEP:
            raise ValueError(f"autoreset_mode is {envs.autoreset_mode.value!r}, but learning needs 'SameStep'")
        self.envs = envs
        self.device: torch.device = envs.arrays.device
        self._clip_obs, self._clip_reward, self._gamma, self._epsilon = clip_obs, clip_reward, gamma, epsilon
        self._seen = Moments(envs.single_observation_space.shape, self.device) if norm_obs else None
        self._returned = Moments((), self.device) if norm_reward else None
        self._discounted = torch.zeros(envs.num_envs, dtype=torch.float64, device=self.device)
        self._names: list[str] = []
        self._running = torch.zeros(0)
        self._ended = torch.zeros(0)

    @property
    def observation_space(self) -> Space[Any]:
        """Of what a sub-environment gives to act on."""
        return self.envs.single_observation_space

    def reset(self, seed: int) -> torch.Tensor:
        """Begin anew; sub-environment i gets ``seed`` + i. Gives observations (N, O)."""
        observations, _ = self.envs.reset(seed=seed)
        self._discounted.zero_()
        self._names = []
        return self._observed(observations)

    def step(self, actions: torch.Tensor) -> Transition:
        """Advance all by one control step with ``actions`` (N, A), which are clipped into the action space."""
        observations, rewards, terminated, truncated, infos = self.envs.step(actions)
        self._add_up(rewards, infos)
        observed = reached = self._observed(observations)
        if self._returned is not None:
            self._discounted = self._gamma * self._discounted + rewards
            self._returned.update(self._discounted)
            scale = torch.sqrt(self._returned.variance + self._epsilon)
            rewards = torch.clip(rewards / scale, -self._clip_reward, self._clip_reward).float()
        if "final_obs" in infos:
            ended = infos["_final_obs"]
            reached = torch.where(ended[:, None], self._normalised(infos["final_obs"]), observed)
            self._discounted = torch.where(ended, 0.0, self._discounted)
        return Transition(observed, reached, rewards[:, None], terminated[:, None], truncated[:, None])

    def ended(self) -> dict[str, float]:
        """Means over the episodes that have ended since this was called last, empty if there are none: ``return``,
        ``length``, ``success``, and as ``reward/NAME`` what each term gave. Waits for the device."""
        if not self._names:
            return {}
        *sums, count = self._ended.tolist()
        self._ended.zero_()
        return {name: total / count for name, total in zip(self._names, sums, strict=True)} if count else {}

    @property
    def normalisation(self) -> Normalisation | None:
        """Of the observations, as it is."""
        if self._seen is None:
            return None
        mean, variance = (values.numpy(force=True).copy() for values in (self._seen.mean, self._seen.variance))
        return Normalisation(mean, variance, self._epsilon, self._clip_obs)

    def start_from(self, normalisation: Normalisation | None) -> None:
        """Normalise observations as a policy that is learned on from has learned to, whatever is observed from now on."""
        if self._seen is not None and normalisation is not None:
            mean, variance = (torch.from_numpy(one.copy()) for one in (normalisation.mean, normalisation.variance))
            self._seen.restore({"mean": mean, "variance": variance, "count": KNOWN})

    def state(self) -> dict[str, Any]:
        """What the normalisation knows, as tensors and plain values."""
        return {name: one.state() for name, one in self._moments().items()}

    def restore(self, state: Mapping[str, Any]) -> None:
        """Take up what :meth:`state` gave to one that was made as this one was."""
        for name, one in self._moments().items():
            one.restore(state[name])

    def close(self) -> None:
        """Close the environments."""
        self.envs.close()

    def _moments(self) -> dict[str, Moments]:
        pairs = (("observations", self._seen), ("returns", self._returned))
        return {name: one for name, one in pairs if one is not None}

    def _observed(self, observations: torch.Tensor) -> torch.Tensor:
        if self._seen is not None:
            self._seen.update(observations)
        return self._normalised(observations)

    def _normalised(self, observations: torch.Tensor) -> torch.Tensor:
        if self._seen is None:
            return observations
        scaled = (observations - self._seen.mean) / torch.sqrt(self._seen.variance + self._epsilon)
        return torch.clip(scaled, -self._clip_obs, self._clip_obs).float()

    def _add_up(self, rewards: torch.Tensor, infos: Mapping[str, Any]) -> None:
        """Sums over running episodes, and from them over those that have ended; nothing waits for the device."""
        terms = contributions(dict(infos))
        values = torch.stack([rewards, torch.ones_like(rewards), *terms.values()]).double()
        if not self._names:
            self._names = ["return", "length", *terms, "success"]
            self._running = torch.zeros_like(values)
            self._ended = torch.zeros(len(self._names) + 1, dtype=torch.float64, device=self.device)
        self._running += values
        if "final_info" in infos:
            ended, success = infos["_final_info"], infos["final_info"]["is_success"]
            rows = torch.cat([self._running, success[None].double(), torch.ones_like(self._running[:1])])
            self._ended += torch.where(ended, rows, 0.0).sum(dim=1)
            self._running = torch.where(ended, 0.0, self._running)
