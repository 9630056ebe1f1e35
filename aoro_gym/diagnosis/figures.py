"""Key figures of the full turns among recordings, as measured and as predicted without and with a cause."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from aoro_gym.diagnosis.arrival import arrival_of
from aoro_gym.diagnosis.noise import Floats
from aoro_gym.diagnosis.recording import TICK, Recording
from aoro_gym.diagnosis.result import Curve
from aoro_gym.machine import Machine
from aoro_gym.sensors.chain import STANDSTILL
from aoro_gym.simulation.key_figures import FIGURES, key_figures_batch

NEAR_STOP = np.radians(2.0)
"""Angle [rad] from the stop within which a full turn begins."""
COLUMNS = ("measured", "before", "after")


def key_figures(
    recordings: Sequence[Recording], curves: Sequence[Curve], machine: Machine
) -> Mapping[str, Mapping[str, Mapping[str, float | None]]]:
    """By turn and figure: measured, before, after; means over repeats, in the units of
    :mod:`aoro_gym.simulation.key_figures`.

    The stop is where each angle comes to rest. None where a log does not show a figure.

    Args:
        recordings: That are looked through for full turns.
        curves: Their angles as measured, and as predicted without and with the cause.
        machine: Whose geometry turns angles into flows.
    """
    reach = float(np.asarray(machine.joint.range))
    angles = {one.manoeuvre: one for one in curves if one.signal == "joint_angle"}
    turns: dict[str, list[Mapping[str, Floats]]] = {}
    for recording in recordings:
        curve = angles.get(recording.name)
        arrival = arrival_of(recording.channels["joint_angle"], recording.commands[:, 0])
        level = full_turn(recording, arrival, reach)
        if curve is None or not level:
            continue
        angle = np.stack([curve.measured, curve.before, curve.after], axis=1)
        stop = np.mean(angle[-round(STANDSTILL / TICK) :], axis=0)
        figures = key_figures_batch(curve.time, angle, machine, stop=stop)
        title = f"{'left' if level > 0.0 else 'right'}, {100.0 * abs(level):.3g} %"
        turns.setdefault(title, []).append(figures)
    means = {title: {name: _means([one[name] for one in rows]) for name in FIGURES} for title, rows in turns.items()}
    return {
        title: {name: dict(zip(COLUMNS, values, strict=True)) for name, values in figures.items()}
        for title, figures in means.items()
        if any(values[0] is not None for values in figures.values())
    }


def _means(rows: list[Floats]) -> list[float | None]:
    """Mean of every column, of what there is."""
    columns = [column[np.isfinite(column)] for column in np.array(rows).T]
    return [float(np.mean(column)) if column.size else None for column in columns]


def full_turn(recording: Recording, arrival: float, reach: float) -> float:
    """Signal of a full turn at standstill, positive to the left; 0.0 for any other recording.

    Args:
        recording: One constant signal between standstills, from one stop to the other.
        arrival: Instant at which it came to a stop, negative if nowhere.
        reach: Angle [rad] of the stops.
    """
    steering, drive = recording.commands.T
    levels = np.unique(np.round(steering[steering != 0.0], 3))
    if len(levels) != 1 or np.any(drive) or arrival < 0:
        return 0.0
    level = float(levels[0])
    to_go = reach + np.sign(level) * recording.start_angle  # from the opposite stop
    return level if abs(to_go) < NEAR_STOP and np.ptp(np.flatnonzero(steering)) < np.count_nonzero(steering) else 0.0
