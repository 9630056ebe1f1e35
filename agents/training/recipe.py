"""What a training is made of: hyper-parameters and a curriculum, as YAML files have them, and the policy it starts from."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from aoro_gym.agents.policies.files import policy_file
from aoro_gym.agents.policies.policy import LearnedPolicy
from aoro_gym.agents.training.curriculum import curriculum
from aoro_gym.agents.training.plan import TrainingPlan


@dataclass(frozen=True)
class Recipe:
    """What YAML says of an environment: hyper-parameters in the RL Zoo's format, and a curriculum."""

    hyperparams: Mapping[str, Any]
    stages: Sequence[Mapping[str, Any]]


def first_policy(plan: TrainingPlan) -> LearnedPolicy:
    """The policy that ``plan`` starts from: a file, or one that comes with the package, by its name.

    Raises ValueError if there is none of this name, the file holds none, or the algorithm cannot train it; OSError if
    there is no file.
    """
    assert plan.start is not None
    policy = LearnedPolicy.load(policy_file(plan.env, plan.start))
    if policy.memory is not None and plan.algo != "dagger" and plan.trainer != "resident":
        raise ValueError(
            f"--start: {plan.start} has a memory, which --algo dagger learns on from, and --algo ppo with "
            "--trainer resident; give one of these"
        )
    return policy


def read_recipe(plan: TrainingPlan) -> Recipe:
    """What the plan's files say.

    Raises ValueError naming the file and what is missing or wrong, OSError if there is no such file.
    """
    entry = entry_of(plan.hyperparams_file, plan.env)
    if not isinstance(entry, Mapping):
        raise ValueError(f"{plan.hyperparams_file}: {plan.env} is {entry!r}; give it hyper-parameters by name")
    hyperparams = dict(entry)
    for text in plan.param or []:
        name, equals, value = (part.strip() for part in text.partition("="))
        if not (name and equals):
            raise ValueError(f"param is {text!r}, but must be NAME=VALUE, such as learning_rate=1e-4")
        hyperparams[name] = _number(value)
    for name, value in (("n_timesteps", plan.steps), ("n_envs", plan.n_envs)):
        if value is not None:
            hyperparams[name] = value
        if not isinstance(hyperparams.get(name), int | float):
            raise ValueError(
                f"{plan.hyperparams_file}: {name} of {plan.env} is {hyperparams.get(name)!r}; give a number"
            )
    stages = _plain(plan.curriculum_file, entry_of(plan.curriculum_file, plan.env))
    curriculum(plan.env, stages)
    return Recipe(_plain(plan.hyperparams_file, hyperparams), stages)


def entry_of(file: Path, name: str) -> Any:
    """What a YAML file says of an environment, or of an algorithm.

    Raises ValueError naming the file and what is missing or wrong, OSError if there is no such file.
    """
    try:
        import yaml  # pyright: ignore[reportMissingModuleSource]
    except ImportError as error:
        raise ValueError(f"training needs {error.name}: pip install 'aoro-gym[agents]'") from error
    try:
        content = yaml.safe_load(file.read_text(encoding="utf-8"))
    except yaml.YAMLError as error:
        raise ValueError(f"{file} is no YAML: {error}") from error
    if not isinstance(content, Mapping) or name not in content:
        raise ValueError(f"{file} says nothing of {name}; it needs an entry of this name")
    return content[name]


def check_positive_integers(hyperparams: Any, *names: str) -> None:
    """Raise ValueError that names an attribute of ``hyperparams`` which is no positive integer."""
    for name in names:
        value = getattr(hyperparams, name)
        if value != int(value) or value < 1:
            raise ValueError(f"{name} is {value!r}, but must be a positive integer")


def _plain(file: Path, entry: Any) -> Any:
    """What a YAML file says, as JSON gives it back; ValueError if JSON has nothing like it."""
    try:
        return json.loads(json.dumps(entry, allow_nan=False))
    except (TypeError, ValueError) as error:
        raise ValueError(f"{file} holds what JSON has not: {error}; write numbers, texts, lists and tables") from None


def _number(text: str) -> Any:
    """A value as YAML has it, and numbers such as 1e-4, which YAML takes for words."""
    import yaml  # pyright: ignore[reportMissingModuleSource]

    value = yaml.safe_load(text)
    try:
        return float(value) if isinstance(value, str) else value
    except ValueError:
        return value
