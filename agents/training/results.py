"""Policies and evaluations of a training, kept in its checkpoint."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from aoro_gym.agents.policies.description import shortened
from aoro_gym.agents.policies.policy import LearnedPolicy
from aoro_gym.agents.training.learner import Learner
from aoro_gym.agents.training.run_folder import CHECKPOINT, EVALUATIONS
from aoro_gym.execution.files import write_json


class TrainingResults:
    """What a training has come to: kept in its checkpoint, and written from there to files of their own.

    Args:
        folder: Of the training.
        env: Id of its environment.
        origin: Digest of what it follows from.
    """

    def __init__(self, folder: Path, env: str, origin: str):
        self._folder, self._env, self._origin = folder, env, origin
        self._policies: dict[str, LearnedPolicy] = {}
        self.evaluations: list[dict[str, Any]] = []
        self.elapsed = 0.0
        """Time [s] that the training has taken."""

    @property
    def exist(self) -> bool:
        """Whether there is a checkpoint."""
        return (self._folder / CHECKPOINT).exists()

    def add(self, evaluation: dict[str, Any], policy: LearnedPolicy, elapsed: float) -> None:
        """Add an evaluation of the policy as it is."""
        best = max((one["figures"]["return"]["mean"] for one in self.evaluations), default=-np.inf)
        self._policies["policy"] = policy
        if evaluation["figures"]["return"]["mean"] > best:
            self._policies["best"] = policy
        self.evaluations.append(evaluation)
        self.elapsed = elapsed

    def save(self, learner: Learner) -> None:
        """Write the checkpoint."""
        import torch  # pyright: ignore[reportMissingImports]

        from aoro_gym.agents.training.checkpoints import save_checkpoint

        policies = {
            name: {key: torch.from_numpy(np.array(array)) for key, array in policy.arrays().items()}
            for name, policy in self._policies.items()
        }
        notes = {
            "evaluations": self.evaluations,
            "elapsed_s": self.elapsed,
            "policies": {name: policy.description() for name, policy in self._policies.items()},
            "origin": self._origin,
        }
        save_checkpoint(self._folder / CHECKPOINT, {**learner.state(), "policies": policies}, notes)

    def restore(self, learner: Learner) -> None:
        """Take up the checkpoint; ValueError if it is damaged, or another training's."""
        from aoro_gym.agents.training.checkpoints import load_checkpoint

        file = self._folder / CHECKPOINT
        state, notes = load_checkpoint(file)
        if notes.get("origin") != self._origin:
            raise ValueError(f"{file} is another training's; restore it, or begin anew with --restart")
        try:
            policies = state.pop("policies")
            learner.restore(state)
            self.evaluations, self.elapsed = notes["evaluations"], notes["elapsed_s"]
            self._policies = {
                name: LearnedPolicy.of(about, {key: array.numpy() for key, array in policies[name].items()})
                for name, about in notes["policies"].items()
            }
        except (KeyError, TypeError, AttributeError, RuntimeError, ValueError) as error:  # written by other code
            reason = f"{type(error).__name__}: {shortened(error)}"
            raise ValueError(f"{file} does not fit this version ({reason}); begin anew with --restart") from error

    def publish(self) -> None:
        """Write policies and evaluations as the checkpoint has them."""
        for name, policy in self._policies.items():
            policy.save(self._folder / name)
        write_json(self._folder / EVALUATIONS, {"env": self._env, "evaluations": self.evaluations})
