"""Episodes of ``AORO/Levelling-v0`` and their metrics."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from aoro_gym.agents.evaluation.drives import drive_to_ends, every_path
from aoro_gym.agents.evaluation.episodes import Episodes, reset_arguments
from aoro_gym.agents.evaluation.metrics import SUCCESS
from aoro_gym.agents.policies.policy import Policy
from aoro_gym.envs.levelling.courses import held_out_courses
from aoro_gym.envs.levelling.environment import LevellingVectorEnv
from aoro_gym.envs.path_tracking.courses import Course

CHANNELS = ("s", "reference_x", "reference_y", "roll", "pitch", "unevenness")
"""Channels of a drive that its metrics and plots need."""
LAST = (
    "is_success", "tilt_rms", "unevenness_rms", "lifted_share", "pump_work", "arm_way", "remaining",
)  # fmt: skip
"""What the infos of an episode's last step give."""


def make_levelling(num_envs: int, courses: Sequence[Course] | None, **arguments: Any) -> LevellingVectorEnv:
    return LevellingVectorEnv(num_envs, courses=held_out_courses() if courses is None else courses, **arguments)


def level_lanes(
    env: LevellingVectorEnv,
    policy: Policy,
    seeds: list[int],
    tell: Callable[[float], Any] = lambda share: None,
    *,
    asked: list[int] | None = None,
) -> Episodes:
    """Drive every sub-environment through one episode, each on the lane of its seed.

    Args:
        env: Made with ``autoreset_mode="Disabled"``.
        policy: Who levels; reset first.
        seeds: One each.
        tell: Called with the share that is done.
        asked: Seeds of what is asked for, where ``seeds`` draw the sensors' errors alone.

    Raises ValueError if the environment resets by itself.
    """
    arguments = reset_arguments(seeds, asked, every_path(env.task.courses, asked or seeds))
    drives = drive_to_ends(env, policy, arguments, tell, channels=CHANNELS, last=LAST)
    last, data, tilt, parts = drives.last, drives.data, drives.tilt, drives.parts
    driven = drives.whole - last["remaining"]
    metrics = {
        SUCCESS: last["is_success"],
        "tilt_rms_deg": np.degrees(last["tilt_rms"]),
        "tilt_p95_deg": np.array([np.quantile(tilt[i, part], 0.95) for i, part in enumerate(parts)]),
        "largest_tilt_deg": np.array([tilt[i, part].max() for i, part in enumerate(parts)]),
        "unevenness_rms": last["unevenness_rms"],
        "unevenness_p95": np.array([np.quantile(data["unevenness"][i, part], 0.95) for i, part in enumerate(parts)]),
        "lifted_share": last["lifted_share"],
        "pump_kJ_per_m": last["pump_work"] / 1e3 / np.maximum(driven, 0.1),
        "arm_way_m_per_m": last["arm_way"] / np.maximum(driven, 0.1),
        "driven_m": driven,
        "return": drives.returns,
        **drives.on_soil,
    }
    errors, places = drives.at_stations([tilt[i, part] for i, part in enumerate(parts)])
    return Episodes(metrics, drives.endings, drives.course, errors, places, drives.film)
