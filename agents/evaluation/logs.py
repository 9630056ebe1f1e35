"""Logs of single episodes: what a policy commanded and what the machine did, for plots and replays."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from aoro_gym.agents.evaluation.episodes import Episodes
from aoro_gym.agents.evaluation.result import Evaluation
from aoro_gym.recording.commands import COMMAND_BOUNDS, WHEELS
from aoro_gym.simulation.log import IDEAL, field_unit, write_log

STATE = {
    **{axis: f"position_{axis}" for axis in "xyz"},
    **{name: name for name in ("roll", "pitch", "yaw", "joint_angle", "speed", "joint_flow")},
    **{f"arm_{wheel}": f"arm_angle_{wheel}" for wheel in WHEELS},
}
"""Channels of the twin by those of a film."""
MORE = {
    "target": "target_joint_angle_rad",
    "cross_track": "true_cross_track_m",
    "measured_cross_track": "measured_cross_track_m",
}
"""Columns of further channels of a film."""


def write_episode(result: Evaluation, policy: str, path: Path) -> list[Path]:
    """Write the first episode of a policy as a log, a row each control step, with a manifest; returns the files.

    Sensors are without errors: columns hold what the machine did. A command holds from its row on.

    Args:
        result: Of the evaluation.
        policy: Who drove.
        path: Log to write, as :func:`~aoro_gym.simulation.log.write_log`.
    """
    about = {"sensors": IDEAL, "environment": result.env, "policy": policy, "seed": result.seed}
    about |= {"machine": {"name": result.machine.name}}
    return write_log(path, episode_columns(result, result.runs[policy]), about)


def episode_columns(result: Evaluation, run: Episodes) -> dict[str, NDArray[np.float64]]:
    """Columns (F,) of the log of a first episode."""
    film = dict(zip(result.task.channels, run.film.T.astype(np.float64), strict=True))
    # single precision of the film's clock; steps are whole milliseconds
    columns = {"time_s": np.round(film["time"] - film["time"][0], 6)}
    for name in COMMAND_BOUNDS:
        if name in film and name not in STATE:  # a film has the command that led to its row
            columns[name] = np.append(film[name][1:], film[name][-1])
    columns["joint_angle_rad"] = film["joint_angle"]
    for name, channel in STATE.items():
        if name in film:
            unit, size = field_unit(channel)
            columns[f"true_{channel}_{unit}"] = film[name] / size
    return columns | {column: film[name] for name, column in MORE.items() if name in film}
