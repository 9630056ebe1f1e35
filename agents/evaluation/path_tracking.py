"""Episodes of ``AORO/PathTracking-v0`` and ``-v1`` and their metrics."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from aoro_gym.agents.evaluation.drives import drive_to_ends, every_path
from aoro_gym.agents.evaluation.episodes import Episodes, reset_arguments
from aoro_gym.agents.evaluation.metrics import OVER, SUCCESS
from aoro_gym.agents.policies.policy import Policy
from aoro_gym.envs.limit_tracking.courses import held_out_courses
from aoro_gym.envs.limit_tracking.environment import LimitTrackingVectorEnv
from aoro_gym.envs.path_tracking.courses import Course, library
from aoro_gym.envs.path_tracking.environment import PathTrackingVectorEnv

CHANNELS = ("s", "cross_track", "reference_x", "reference_y", "roll", "pitch")
"""Channels of a drive that its metrics and plots need."""
LAST = ("is_success", "mean_speed", "engine_work", "remaining")
"""What the infos of an episode's last step give."""


def make_tracking(num_envs: int, courses: Sequence[Course] | None, **arguments: Any) -> PathTrackingVectorEnv:
    return PathTrackingVectorEnv(num_envs, courses=library() if courses is None else courses, **arguments)


def make_limit_tracking(num_envs: int, courses: Sequence[Course] | None, **arguments: Any) -> LimitTrackingVectorEnv:
    return LimitTrackingVectorEnv(num_envs, courses=held_out_courses() if courses is None else courses, **arguments)


def drive_limits(
    env: LimitTrackingVectorEnv,
    policy: Policy,
    seeds: list[int],
    tell: Callable[[float], Any] = lambda share: None,
    *,
    asked: list[int] | None = None,
) -> Episodes:
    """What :func:`drive_paths` does, each seed on the path that is its own.

    Args:
        env: See there, as for ``policy``, ``seeds``, ``tell`` and ``asked``.
        policy: See there.
        seeds: See there.
        tell: See there.
        asked: See there.
    """
    return drive_paths(env, policy, seeds, tell, asked=asked, options=every_path(env.task.courses, asked or seeds))


def drive_paths(
    env: PathTrackingVectorEnv,
    policy: Policy,
    seeds: list[int],
    tell: Callable[[float], Any] = lambda share: None,
    *,
    asked: list[int] | None = None,
    options: Mapping[str, Any] | None = None,
) -> Episodes:
    """Drive every sub-environment through one episode.

    Args:
        env: Made with ``autoreset_mode="Disabled"``.
        policy: Who drives; reset first.
        seeds: One each.
        tell: Called with the share that is done.
        asked: Seeds of what is asked for, where ``seeds`` draw the sensors' errors alone.
        options: Of the reset.

    Raises ValueError if the environment resets by itself.
    """
    reset = reset_arguments(seeds, asked, options)
    drives = drive_to_ends(env, policy, reset, tell, channels=CHANNELS, last=LAST)
    last, data, tilt, parts = drives.last, drives.data, drives.tilt, drives.parts
    error = [np.abs(data["cross_track"][i, part]) for i, part in enumerate(parts)]
    arrived = last["is_success"].astype(bool)
    metrics = {
        SUCCESS: last["is_success"],
        "cross_track_rms_m": np.array([np.sqrt((e**2).mean()) for e in error]),
        "cross_track_mean_m": np.array([e.mean() for e in error]),
        "cross_track_p95_m": np.array([np.quantile(e, 0.95) for e in error]),
        "speed_m_per_s": last["mean_speed"],
        "energy_kJ": last["engine_work"] / 1e3,
        "worst_tilt_deg": np.array([tilt[i, part].max() for i, part in enumerate(parts)]),
        "driven_m": drives.whole - last["remaining"],
        "duration_s": drives.steps * env.task.control_step,
        "return": drives.returns,
        **drives.on_soil,
    }
    metrics |= {name: np.where(arrived, values, np.nan) for name, values in metrics.items() if name in OVER}
    errors, places = drives.at_stations(error)
    return Episodes(metrics, drives.endings, drives.course, errors, places, drives.film)
