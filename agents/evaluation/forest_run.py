"""Episodes of ``AORO/ForestRun-v0`` and their metrics."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from aoro_gym.agents.evaluation.drives import drive_to_ends, every_path
from aoro_gym.agents.evaluation.episodes import Episodes, reset_arguments
from aoro_gym.agents.evaluation.metrics import OVER, SUCCESS
from aoro_gym.agents.policies.policy import Policy
from aoro_gym.envs.forest_run.courses import held_out_courses
from aoro_gym.envs.forest_run.environment import ForestRunVectorEnv
from aoro_gym.envs.path_tracking.courses import Course

CHANNELS = ("reference_x", "reference_y", "roll", "pitch", "remaining", "chassis_force", "way")
"""Channels of a drive that its metrics and plots need."""
LAST = ("is_success", "damage", "contact_time", "way", "route_length", "engine_work", "remaining")
"""What the infos of an episode's last step give."""


def make_forest_run(num_envs: int, courses: Sequence[Course] | None, **arguments: Any) -> ForestRunVectorEnv:
    return ForestRunVectorEnv(num_envs, courses=held_out_courses() if courses is None else courses, **arguments)


def run_forests(
    env: ForestRunVectorEnv,
    policy: Policy,
    seeds: list[int],
    tell: Callable[[float], Any] = lambda share: None,
    *,
    asked: list[int] | None = None,
) -> Episodes:
    """Drive every sub-environment through one episode, each on the run of its seed.

    ``success_by_length_share`` is a success times the length of the route over that of the way, at most 1, 0 for a failure
    (P. Anderson et al., "On evaluation of embodied navigation agents", arXiv:1807.06757, 2018).

    Args:
        env: Made with ``autoreset_mode="Disabled"``.
        policy: Who drives; reset first.
        seeds: One each.
        tell: Called with the share that is done.
        asked: Seeds of what is asked for, where ``seeds`` draw the sensors' errors alone.

    Raises ValueError if the environment resets by itself.
    """
    arguments = reset_arguments(seeds, asked, every_path(env.task.courses, asked or seeds))
    drives = drive_to_ends(env, policy, arguments, tell, channels=CHANNELS, last=LAST)
    last, data, tilt, parts = drives.last, drives.data, drives.tilt, drives.parts
    arrived = last["is_success"].astype(bool)
    metrics = {
        SUCCESS: last["is_success"],
        "success_by_length_share": arrived * last["route_length"] / np.maximum(last["way"], last["route_length"]),
        "damage_kNs": last["damage"] / 1e3,
        "contact_time_s": last["contact_time"],
        "largest_force_kN": np.array([data["chassis_force"][i, part].max() for i, part in enumerate(parts)]) / 1e3,
        "duration_s": drives.steps * env.task.control_step,
        "energy_kJ": last["engine_work"] / 1e3,
        "worst_tilt_deg": np.array([tilt[i, part].max() for i, part in enumerate(parts)]),
        "way_m": last["way"],
        "left_m": last["remaining"],
        "return": drives.returns,
    }
    metrics |= {name: np.where(arrived, values, np.nan) for name, values in metrics.items() if name in OVER}
    errors, places = drives.at_stations([data["remaining"][i, part] for i, part in enumerate(parts)], along="way")
    return Episodes(metrics, drives.endings, drives.course, errors, places, drives.film)
