"""Episodes of ``AORO/Turning-v0`` and their metrics."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from aoro_gym.agents.evaluation.episodes import TIME_IS_UP, Episodes, reset_arguments
from aoro_gym.agents.evaluation.metrics import SUCCESS
from aoro_gym.agents.evaluation.responses import EPISODE_STEPS, responses, rollout
from aoro_gym.agents.evaluation.statistics import Floats
from aoro_gym.agents.policies.policy import Policy
from aoro_gym.envs.path_tracking.courses import Course
from aoro_gym.envs.turning.environment import TurningVectorEnv

RESPONSE = 2.0
"""Time [s] after a new target over which the error is kept: every target is held for as long."""


def make_turning(num_envs: int, courses: Sequence[Course] | None, **arguments: Any) -> TurningVectorEnv:
    if courses is not None:
        raise ValueError("courses are for AORO/PathTracking-v0; AORO/Turning-v0 turns on level ground")
    return TurningVectorEnv(num_envs, **arguments)


def turn_joints(
    env: TurningVectorEnv,
    policy: Policy,
    seeds: list[int],
    tell: Callable[[float], Any] = lambda share: None,
    *,
    asked: list[int] | None = None,
) -> Episodes:
    """Steer every sub-environment through one episode.

    Args:
        env: Made with ``autoreset_mode="Disabled"``.
        policy: Who steers; reset first.
        seeds: One each.
        tell: Called with the share that is done.
        asked: Seeds of what is asked for, where ``seeds`` draw the sensors' errors alone.
    """
    film: list[NDArray[np.float32]] = []

    def callback() -> None:
        film.append(np.array(env.traces()[:, 0], dtype=np.float32))
        tell((len(film) - 1) / EPISODE_STEPS)

    run = rollout(env, policy, **reset_arguments(seeds, asked), steps=EPISODE_STEPS, callback=callback)
    found = responses(run, tolerance=env.task.config.tolerance)
    mine = [found["episode"] == i for i in range(env.num_envs)]

    def mean(values: NDArray[Any]) -> Floats:
        return np.array([_mean(values[rows]) for rows in mine])

    settled = np.isfinite(found["settling_time"])
    metrics = {
        SUCCESS: run.success.astype(np.float64),
        "settling_time_s": mean(np.where(settled, found["settling_time"], found["held"])),
        "settled_share": mean(settled * 1.0),
        "rise_time_s": mean(found["rise_time"]),
        "overshoot_deg": mean(np.degrees(found["overshoot"])),
        "worst_overshoot_deg": np.array([_worst(np.degrees(found["overshoot"][rows])) for rows in mine]),
        "flow_overshoot_share": mean(found["flow_overshoot"]),
        "final_error_deg": mean(np.degrees(found["final_error"])),
        "return": run.returns,
    }
    error = np.degrees(np.abs(run.target.astype(np.float64) - run.joint_angle))
    fresh = np.diff(run.target, axis=0, prepend=np.nan) != 0.0
    count = round(RESPONSE / run.control_step)
    # the mean over the targets of an episode that stood so long
    errors = np.array(
        [
            np.mean(
                [error[start : start + count, i] for start in np.flatnonzero(fresh[: len(error) - count, i])], axis=0
            )
            for i in range(env.num_envs)
        ]
    )
    return Episodes(
        metrics,
        [TIME_IS_UP] * env.num_envs,
        np.zeros((env.num_envs, 2), dtype=np.intp),
        errors,
        np.zeros((env.num_envs, 0, 2)),
        np.array(film),
    )


def _worst(values: Floats) -> float:
    """The largest of those that are not NaN; NaN if all are."""
    finite = values[np.isfinite(values)]
    return float(finite.max()) if finite.size else math.nan


def _mean(values: Floats) -> float:
    """Of those that are not NaN; NaN if all are."""
    finite = values[np.isfinite(values)]
    return float(finite.mean()) if finite.size else math.nan
