"""Trainings that take seconds."""

from pathlib import Path

import numpy as np
import pytest

from aoro_gym.agents.training.plan import TrainingPlan

SMALL = {
    "ppo": {"n_steps": 25, "batch_size": 50, "n_epochs": 2, "learning_rate": "lin_1e-3"},
    "sac": {"buffer_size": 240, "learning_starts": 60, "batch_size": 16, "train_freq": 5, "gradient_steps": 2},
    "dagger": {"n_steps": 25, "buffer_size": 120, "batch_size": 50, "n_epochs": 2},
}
"""Hyper-parameters of trainings that take seconds: 100 steps in parts of 50, on two sub-environments."""


def plan_of(algo: str = "ppo", **changes) -> TrainingPlan:
    if changes.get("trainer") == "resident":
        pytest.importorskip("skrl")
        pytest.importorskip("array_api_compat")
    values = {"steps": 200, "n_envs": 2, "checkpoint_every": 50, "eval_episodes": 1, "seed": 5, **changes}
    return TrainingPlan(algo=algo, param=[f"{name}={value}" for name, value in SMALL[algo].items()], **values)


def weights(folder: Path) -> dict[str, np.ndarray]:
    from safetensors.numpy import load

    return load((folder / "policy.safetensors").read_bytes())
