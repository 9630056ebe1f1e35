"""Policies and numbers of episodes that a person asks an evaluation for."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from aoro_gym.agents.controllers.reference import REFERENCE_POLICIES, Factory
from aoro_gym.agents.evaluation.evaluate import policy_factory
from aoro_gym.agents.evaluation.tasks import TASKS
from aoro_gym.agents.policies.files import shipped_policies
from aoro_gym.agents.policies.policy import LearnedPolicy
from aoro_gym.checks import check_choice, check_integer

MOST_EPISODES = 10_000
"""Of one evaluation."""


def named_policies(
    env: str, asked: Sequence[str] | None, *, trust_pickle: bool = False, localisation: str | None = None
) -> dict[str, Factory]:
    """Factories of policies, by their names in reports.

    Args:
        env: Id of the environment.
        asked: Names or files; None: all controllers and shipped policies.
        trust_pickle: Whether files that run code of their maker may be loaded.
        localisation: How the pose is estimated; None: as environments do by default. Which shipped policies are all.

    Raises ValueError if there is no such environment or policy, or one is named twice; OSError if a file is missing.
    """
    check_choice("--env", env, TASKS)
    names = asked or [*REFERENCE_POLICIES[env], *shipped_policies(env, localisation or "gains")]
    policies = {_label(name): policy_factory(env, name, trust_pickle=trust_pickle) for name in names}
    if len(policies) < len(names):
        twice = next(name for name in names if list(map(_label, names)).count(_label(name)) > 1)
        raise ValueError(f"--policy names {twice} twice; give each once")
    return policies


def strangers(policies: Mapping[str, Factory], localisation: str | None) -> list[str]:
    """Sentences on learned ``policies`` whose file names no localisation, where the pose is estimated otherwise than
    environments do by default: they drive, but with other errors of the pose than they learned with."""
    learned = {name: getattr(factory, "__self__", None) for name, factory in policies.items()}
    return [
        f"{name} has learned with the default localisation, 'gains', and drives with {localisation!r}"
        for name, policy in learned.items()
        if localisation not in (None, "gains")
        and isinstance(policy, LearnedPolicy)
        and "localisation" not in policy.training
    ]


def _label(name: str) -> str:
    """A policy's name in reports: its own, or that of its file without what file names cannot hold."""
    file = Path(name)
    return "-".join(part for part in file.with_suffix("").parts if part not in (file.anchor, ".", ".."))


def check_episodes(episodes: int, repeats: int = 1) -> None:
    """ValueError unless there is something to drive, and not too much of it."""
    for option, value in (
        ("episodes", episodes),
        ("repeats", repeats),
        ("episodes times --repeats", episodes * repeats),
    ):
        check_integer(f"--{option}", value, le=MOST_EPISODES)
