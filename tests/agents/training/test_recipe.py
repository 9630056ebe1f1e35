"""Recipes of trainings: their hyper-parameters, and what is wrong in them."""

from pathlib import Path

import pytest

from aoro_gym import Machine
from aoro_gym.agents.training.plan import HYPERPARAMS, TrainingPlan
from aoro_gym.agents.training.recipe import read_recipe
from aoro_gym.agents.training.run_folder import begin
from aoro_gym.envs import ENVIRONMENTS

TURNING, TRACKING = "AORO/Turning-v0", "AORO/PathTracking-v0"


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"env": "AORO/Flying-v0"}, "env is 'AORO/Flying-v0'; choose one of: AORO/Turning-v0"),
        ({"perturbation": "odd"}, "perturbation is 'odd'; choose one of: as calibrated, perturbed, with an effect"),
        ({"param": ["learning_rate"]}, "param is 'learning_rate', but must be NAME=VALUE"),
        ({"param": ["learning_rate=fast_1"]}, "learning_rate is 'fast_1', but must be a number, or lin_NUMBER"),
        (
            {"param": ["policy_kwargs=dict(net_arch=[8])"]},
            "policy_kwargs is 'dict.*', which is code; write what it says",
        ),
        ({"param": ["n_stepz=8"]}, "that PPO does not take: .*n_stepz"),
        ({"param": ["n_envs=many"]}, "n_envs of AORO/Turning-v0 is 'many'; give a number"),
        ({"hyperparams": "mine.yml"}, r"mine\.yml says nothing of AORO/Turning-v0"),
        ({"hyperparams": "broken.yml"}, r"broken\.yml is no YAML"),
        ({"curriculum": "late.yml"}, r"begin at \[0\.5\], but must begin at 0 and rise"),
    ],
)
def test_wrong_recipes_are_named(changes, message, training, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("mine.yml").write_text("CartPole-v1:\n  n_envs: 1\n")
    Path("broken.yml").write_text("a: [\n")
    Path("late.yml").write_text(f"{TURNING}:\n  - from: 0.5\n")
    plan = TrainingPlan(n_envs=None if "param" in changes and "n_envs" in changes["param"][0] else 2, **changes)
    with pytest.raises(ValueError, match=message):
        training.train(plan, begin(plan, tmp_path / "out"), tmp_path / "out", machine=Machine.load("aoro"))


def test_numbers_of_parameters_are_numbers(training):
    plan = TrainingPlan(
        param=["learning_rate=1e-4", "n_steps=8", "policy_kwargs={net_arch: [8, 4]}", "policy=MlpPolicy"]
    )
    hyperparams = read_recipe(plan).hyperparams
    assert hyperparams["learning_rate"] == 1e-4
    assert hyperparams["n_steps"] == 8
    assert hyperparams["policy_kwargs"] == {"net_arch": [8, 4]}
    assert hyperparams["policy"] == "MlpPolicy"


def test_packaged_hyperparams_are_of_the_zoos_format(training):
    import yaml  # pyright: ignore[reportMissingModuleSource]

    for file in set(HYPERPARAMS.glob("*.yml")) - {HYPERPARAMS / "spaces.yml"}:
        content = yaml.safe_load(file.read_text(encoding="utf-8"))
        assert set(content) == ({"AORO/Loading-v0"} if file.stem == "loading_sway" else set(ENVIRONMENTS))
        if file.stem in ("curricula", "perturbed", "fixed", "mild", "loading_sway"):
            continue
        own = {"teacher"} if file.stem == "dagger" else {"policy", "normalize"}
        for entry in content.values():
            assert {"n_envs", "n_timesteps", *own} <= set(entry)
            if "ppo" in file.stem:  # no truncated batches
                assert entry["n_envs"] * entry["n_steps"] % entry["batch_size"] == 0
