"""Stable-Baselines3's PPO, updating without waiting for the device."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
import torch  # pyright: ignore[reportMissingImports]
from numpy.typing import NDArray
from stable_baselines3 import PPO  # pyright: ignore[reportMissingImports]
from stable_baselines3.common.callbacks import BaseCallback, ConvertCallback  # pyright: ignore[reportMissingImports]
from stable_baselines3.common.utils import explained_variance, obs_as_tensor  # pyright: ignore[reportMissingImports]
from torch.distributions import Distribution  # pyright: ignore[reportMissingImports]

from aoro_gym.agents.training.minibatches import Figures, Minibatches, Samples, uploaded

ADAM = {"eps": 1e-5, "fused": True}
"""Stable-Baselines3's own, in one launch a step."""


@contextmanager
def _unchecked_distributions() -> Iterator[None]:
    checked = Distribution._validate_args
    Distribution.set_default_validate_args(False)
    try:
        yield
    finally:
        Distribution.set_default_validate_args(checked)


class StablePPO(PPO):
    """``stable_baselines3.PPO`` for many environments with boxes of actions and observations: the same algorithm, rounded
    otherwise, and the same draws.

    - The rollout is uploaded once, its minibatches are gathered on the device, and of a minibatch the host learns nothing,
      unless ``target_kl`` is given, until all are done.
    - Values that follow time limits are asked for together.
    - Distributions do not check their parameters, for which they would wait; environments refuse what is not finite.

    What it saves loads as ``stable_baselines3.PPO``, too.
    """

    _minibatches: Minibatches | None = None
    _samples: Samples | None = None

    def _setup_model(self) -> None:
        if "optimizer_class" not in self.policy_kwargs:
            self.policy_kwargs = {"optimizer_kwargs": dict(ADAM), **self.policy_kwargs}
        super()._setup_model()

    def _excluded_save_params(self) -> list[str]:
        return [*super()._excluded_save_params(), "_minibatches", "_samples"]

    def _init_callback(self, callback: Any, progress_bar: bool = False) -> BaseCallback:
        one = callback if isinstance(callback, BaseCallback) else ConvertCallback(callback)
        given = callback if isinstance(callback, list) else [one]
        return super()._init_callback([*given, _TimeLimits()], progress_bar)

    @_unchecked_distributions()
    def collect_rollouts(self, *args: Any, **kwargs: Any) -> bool:
        return super().collect_rollouts(*args, **kwargs)

    def _update_info_buffer(self, infos: list[dict[str, Any]], dones: NDArray[np.bool_] | None = None) -> None:
        """Of episodes that have ended: infos of others are empty."""
        if dones is None:
            return super()._update_info_buffer(infos, dones)
        ended = np.flatnonzero(dones)
        return super()._update_info_buffer([infos[i] for i in ended], dones[ended])

    @_unchecked_distributions()
    def train(self) -> None:
        self.policy.set_training_mode(True)
        optimizer: Any = self.policy.optimizer
        self._update_learning_rate(optimizer)
        left = self._current_progress_remaining
        clip_range: float = self.clip_range(left)  # pyright: ignore[reportCallIssue, reportAssignmentType]
        clip_values: Any = None if self.clip_range_vf is None else self.clip_range_vf(left)  # pyright: ignore[reportCallIssue]
        samples, minibatches = self._uploaded(), self._minibatches_of_policy()
        minibatches.clip(clip_range, clip_values)
        epochs: list[list[torch.Tensor]] = []
        diverged = False
        while len(epochs) < self.n_epochs and not diverged:
            epochs.append([])
            order = uploaded(np.random.permutation(len(samples.values)), self.device)  # noqa: NPY002, the draws of PPO
            for rows in order.split(self.batch_size):
                epochs[-1].append(minibatches.gradients(samples, rows))
                if self.target_kl is not None:
                    diverged = Figures(*epochs[-1][-1].tolist()).approx_kl > 1.5 * self.target_kl
                    if diverged:
                        break
                optimizer.step()
            self._n_updates += 1
        self._log_update(epochs, clip_range, clip_values)

    def _uploaded(self) -> Samples:
        """The rollout, those of one environment after those of the other, as Stable-Baselines3 counts them."""
        buffer: Any = self.rollout_buffer
        names = ("observations", "actions", "values", "log_probs", "advantages", "returns")
        here = [uploaded(getattr(buffer, name), self.device).transpose(0, 1) for name in names]
        if self._samples is None:
            count = buffer.buffer_size * buffer.n_envs
            self._samples = Samples(*(torch.empty((count, *one.shape[2:]), device=self.device) for one in here))
        for one, values in zip(self._samples, here, strict=True):
            one.view(values.shape).copy_(values)
        return self._samples

    def _minibatches_of_policy(self) -> Minibatches:
        if self._minibatches is None:
            self._minibatches = Minibatches(
                self._evaluate,
                self.policy.parameters(),
                value_weight=self.vf_coef,
                entropy_weight=self.ent_coef,
                max_norm=self.max_grad_norm,
                normalised=self.normalize_advantage,
            )
        return self._minibatches

    def _evaluate(
        self, observations: torch.Tensor, actions: torch.Tensor
    ) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
        values, log_probs, entropies = self.policy.evaluate_actions(observations, actions)
        return values.flatten(), log_probs, -log_probs if entropies is None else entropies

    def _log_update(self, epochs: list[list[torch.Tensor]], clip_range: float, clip_values: float | None) -> None:
        buffer = self.rollout_buffer
        numbers = torch.stack([one for epoch in epochs for one in epoch]).numpy(force=True)  # waits for the update
        means, last = Figures(*numbers.astype(np.float64).mean(axis=0)), Figures(*numbers[-len(epochs[-1]) :].T)
        self.logger.record("train/entropy_loss", means.entropy_loss)
        self.logger.record("train/policy_gradient_loss", means.policy_loss)
        self.logger.record("train/value_loss", means.value_loss)
        self.logger.record("train/approx_kl", np.mean(last.approx_kl))
        self.logger.record("train/clip_fraction", means.clip_fraction)
        self.logger.record("train/loss", float(last.loss[-1]))
        self.logger.record(
            "train/explained_variance", explained_variance(buffer.values.flatten(), buffer.returns.flatten())
        )
        if hasattr(self.policy, "log_std"):
            self.logger.record("train/std", torch.exp(self.policy.log_std).mean().item())
        self.logger.record("train/n_updates", self._n_updates, exclude="tensorboard")
        self.logger.record("train/clip_range", clip_range)
        if clip_values is not None:
            self.logger.record("train/clip_range_vf", clip_values)


class _TimeLimits(BaseCallback):
    """Adds to the rewards of episodes that a time limit cut the value of what would have followed, of all together; PPO
    asks for that of one after the other where this has not been done."""

    def _on_step(self) -> bool:
        infos, model = self.locals["infos"], self.model
        assert isinstance(model, PPO)
        cut = [i for i in np.flatnonzero(self.locals["dones"]) if infos[i].get("TimeLimit.truncated")]
        if cut:
            last = np.stack([infos[i]["terminal_observation"] for i in cut])
            with torch.no_grad():
                values = model.policy.predict_values(obs_as_tensor(last, model.device))  # pyright: ignore[reportArgumentType]
            self.locals["rewards"][cut] += model.gamma * values.numpy(force=True).flatten()
            for i in cut:
                infos[i]["TimeLimit.truncated"] = False
        return True
