"""A training for tests that kill it, and whether two came to the same."""

import json
from pathlib import Path

TRAINING = """
import torch
from aoro_gym import Machine
from aoro_gym.agents.training import train as training
from aoro_gym.agents.training.plan import TrainingPlan
from aoro_gym.agents.training.run_folder import continued
from aoro_gym.cli import app
import aoro_gym.agents.training.stable_baselines

out, mode = Path(sys.argv[1]), sys.argv[2]
machine = Machine.load("aoro")
values = {"steps": int(sys.argv[4]), "n_envs": 2, "checkpoint_every": 25, "eval_episodes": 1, "seed": 5}
plan = TrainingPlan(param=["n_steps=25", "batch_size=50", "n_epochs=2"], **values)

def work_in(folder):
    return lambda: training.train(plan, continued(plan, folder), folder, machine=machine)
"""


def assert_same_training(one: Path, other: Path) -> None:
    for name in ("policy.safetensors", "best.safetensors", "policy.json", "best.json"):
        assert (one / name).read_bytes() == (other / name).read_bytes(), name
    evaluations = [json.loads((folder / "evaluations.json").read_text())["evaluations"] for folder in (one, other)]
    assert [[part["steps"], part["figures"]] for part in evaluations[0]] == [
        [part["steps"], part["figures"]] for part in evaluations[1]
    ]
    assert not [file for file in other.rglob("*") if "partial" in file.name]
