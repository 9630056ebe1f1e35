"""What differs from episode to episode while a policy learns, and when, as data.

A curriculum is a list of stages. A stage holds from a share of the steps on, and says which spread of machines, grounds,
sensors and starts it draws from, and which weights of the reward terms differ from the task's:

    AORO/Turning-v0:
      - from: 0.0
        randomisation: {base: mild, sensor_noise: [0.0, 1.0]}
      - from: 0.5
        randomisation: mild
        reward_terms: {overshoot: -20.0}

``fixed`` and ``mild`` are the task's own spreads; other fields are those of its class of randomisation. Reward terms are the
task's own and those of :data:`FURTHER_TERMS`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

from aoro_gym.checks import check_choice
from aoro_gym.envs.core.randomisation import Randomisation
from aoro_gym.envs.core.task import Task
from aoro_gym.envs.core.terms import RewardTerm, changed_rewards
from aoro_gym.envs.forest_run import config as forest_run
from aoro_gym.envs.forest_run import rewards as forest_run_rewards
from aoro_gym.envs.levelling import config as levelling
from aoro_gym.envs.levelling import rewards as levelling_rewards
from aoro_gym.envs.limit_tracking import config as limit_tracking
from aoro_gym.envs.loading import config as loading
from aoro_gym.envs.loading import rewards as loading_rewards
from aoro_gym.envs.path_tracking import config as path_tracking
from aoro_gym.envs.path_tracking import rewards as path_tracking_rewards
from aoro_gym.envs.turning import config as turning
from aoro_gym.envs.turning import rewards as turning_rewards
from aoro_gym.execution.array_api import Array

SPREADS: Mapping[str, Mapping[str, Randomisation]] = {
    "AORO/Turning-v0": {"fixed": turning.FIXED, "mild": turning.MILD},
    "AORO/PathTracking-v0": {"fixed": path_tracking.FIXED, "mild": path_tracking.MILD},
    "AORO/PathTracking-v1": {"fixed": limit_tracking.FIXED, "mild": limit_tracking.MILD},
    "AORO/Levelling-v0": {"fixed": levelling.FIXED, "mild": levelling.MILD},
    "AORO/ForestRun-v0": {"fixed": forest_run.FIXED, "mild": forest_run.MILD},
    "AORO/Loading-v0": {"fixed": loading.FIXED, "mild": loading.MILD},
}
"""By the environment's id, then by name."""
TERMS: Mapping[str, Mapping[str, RewardTerm]] = {
    "AORO/Turning-v0": turning_rewards.REWARD_TERMS,
    "AORO/PathTracking-v0": path_tracking_rewards.REWARD_TERMS,
    "AORO/PathTracking-v1": path_tracking_rewards.REWARD_TERMS,
    "AORO/Levelling-v0": levelling_rewards.REWARD_TERMS,
    "AORO/ForestRun-v0": forest_run_rewards.REWARD_TERMS,
    "AORO/Loading-v0": loading_rewards.REWARD_TERMS,
}
"""The tasks' own reward terms, likewise."""
FURTHER_TERMS: Mapping[str, Mapping[str, Callable[[Any], Array]]] = {
    "AORO/Turning-v0": turning_rewards.FURTHER_REWARD_TERMS,
    "AORO/PathTracking-v0": path_tracking_rewards.FURTHER_REWARD_TERMS,
    "AORO/PathTracking-v1": path_tracking_rewards.FURTHER_REWARD_TERMS,
    "AORO/Levelling-v0": levelling_rewards.FURTHER_REWARD_TERMS,
    "AORO/ForestRun-v0": forest_run_rewards.FURTHER_REWARD_TERMS,
    "AORO/Loading-v0": loading_rewards.FURTHER_REWARD_TERMS,
}
"""Reward terms that a task can do without, by the environment's id, then by name."""


@dataclass(frozen=True)
class Stage:
    """A part of a training."""

    start: float
    """Share of the steps from which it holds."""
    randomisation: Randomisation
    reward_terms: Mapping[str, Any]
    """Changes by name; see :mod:`aoro_gym.envs.core.terms`."""

    def apply(self, task: Task, rewards: Mapping[str, RewardTerm]) -> None:
        """Let the task's next episodes be of this stage; ``rewards`` are the terms that it was made with."""
        task.randomisation = self.randomisation  # pyright: ignore[reportAttributeAccessIssue]
        task.reward_terms = changed_rewards(rewards, self.reward_terms)


def curriculum(env: str, entries: Any) -> tuple[Stage, ...]:
    """The stages of a list as YAML has it.

    Raises ValueError naming the stage and what is wrong in it.
    """
    if not isinstance(entries, Sequence) or isinstance(entries, str) or not entries:
        raise ValueError(f"the curriculum of {env} is {entries!r}, but must be a list of at least one stage")
    stages = []
    for k, entry in enumerate(entries):
        try:
            stages.append(_stage(env, entry))
        except (TypeError, ValueError) as error:
            raise ValueError(f"stage {k} of the curriculum of {env}: {error}") from error
    starts = [stage.start for stage in stages]
    if starts[0] != 0.0 or starts != sorted(set(starts)) or starts[-1] >= 1.0:
        raise ValueError(f"the stages of {env} begin at {starts}, but must begin at 0 and rise, below 1")
    return tuple(stages)


def stage_at(stages: Sequence[Stage], share: float) -> Stage:
    """The stage that holds at this share of the steps."""
    return [stage for stage in stages if stage.start <= share][-1]


def _stage(env: str, entry: Any) -> Stage:
    known = ("from", "randomisation", "reward_terms")
    if not isinstance(entry, Mapping) or not set(entry) <= set(known) or "from" not in entry:
        raise ValueError(f"{entry!r} must have 'from', and may have 'randomisation' and 'reward_terms'")
    asked = entry.get("randomisation", "fixed")
    values = {"base": asked} if isinstance(asked, str) else dict(asked)
    base = values.pop("base", "fixed")
    spreads = SPREADS[env]
    check_choice("randomisation", base, spreads)
    names = [one.name for one in fields(spreads[base])]
    for name in values:
        check_choice("field of randomisation", name, names)
    spread = replace(spreads[base], **{name: _tuples(value) for name, value in values.items()})
    further = FURTHER_TERMS[env]
    rewards = {
        name: (weight, further[name]) if name in further else weight
        for name, weight in entry.get("reward_terms", {}).items()
    }
    changed_rewards(TERMS[env], rewards)
    return Stage(float(entry["from"]), spread, rewards)


def _tuples(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {key: _tuples(item) for key, item in value.items()}
    return tuple(value) if isinstance(value, list) else value
