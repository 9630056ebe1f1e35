"""Manoeuvres by their names, and command files, as a person asks for them."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path

import numpy as np

from aoro_gym.machine import Machine
from aoro_gym.machine.vehicle_crane import crane_mount
from aoro_gym.recording.cells import listed
from aoro_gym.simulation.manoeuvres import Manoeuvre, crane_work, from_file, standing_turn, straight_drive

NAMES = ("left", "right", "drive", "crane")
"""Of manoeuvres that are no file."""
FULL_SIGNAL_V = 2.0
"""Distance [V] of the full steering signal from the middle."""


def named_manoeuvre(
    name: str,
    machine: Machine,
    *,
    signal: float | None = None,
    duration: float | None = None,
    start_angle: float | None = None,
    warn: Callable[[str], None],
) -> Manoeuvre:
    """Manoeuvre of a name or a command file.

    Args:
        name: left, right, drive, crane, or a file (.csv or .parquet).
        machine: Machine that runs it.
        signal: Share of the full signal [%], of all but a file; None: 100, 50 to drive, or 60 of the crane's sections.
        duration: Simulated time [s]; None: that of the manoeuvre.
        start_angle: Joint angle [deg] at the start of a file; None: 0.
        warn: Called with what is doubtful.

    Raises ValueError naming what is wrong.
    """
    joint_range = float(machine.joint.range)
    if name in NAMES:
        if start_angle is not None:
            raise ValueError(f"--start-angle serves a command file only; {name} starts at its own angle")
        if name == "drive":
            _check_percent(signal, 1.0, warn)
            return straight_drive(0.5 if signal is None else signal / 100.0, duration=duration)
        if name == "crane":
            if duration is not None:
                raise ValueError(f"--duration is {duration:g} s, but crane takes as long as its steps do; leave it out")
            _check_percent(signal, 100.0 * float(np.max(crane_mount().valves.dead_band)), warn, "crane")
            return crane_work(0.6 if signal is None else signal / 100.0)
        valve = machine.steering.valve
        dead_band = valve.dead_band_left if name == "left" else valve.dead_band_right
        _check_percent(signal, 100.0 * float(dead_band) / FULL_SIGNAL_V, warn)
        share = 1.0 if signal is None else signal / 100.0
        return standing_turn(1 if name == "left" else -1, share, joint_range, duration=duration)
    if signal is not None:
        raise ValueError(
            f"--signal is {signal:g} %, but serves {', '.join(NAMES)}; a command file holds its own signals"
        )
    path = Path(name)
    if path.suffix not in (".csv", ".parquet"):
        raise ValueError(f"--manoeuvre is {name!r}; choose one of: {', '.join(NAMES)}, or give a .csv or .parquet file")
    angle = 0.0 if start_angle is None else math.radians(start_angle)
    if not abs(angle) <= joint_range:
        limit = math.degrees(joint_range)
        raise ValueError(
            f"--start-angle is {start_angle:g} deg, but must be in [{-limit:g}, {limit:g}] deg (joint.range)"
        )
    manoeuvre = from_file(path, start_angle=angle, duration=duration)
    if manoeuvre.unread:
        warn(f"{path}: unknown columns were not read: {listed(manoeuvre.unread)}")
    return manoeuvre


def _check_percent(signal: float | None, dead_band: float, warn: Callable[[str], None], what: str = "joint") -> None:
    """ValueError for a share where per cent are meant; a warning for a signal [%] within the valve's dead band [%]."""
    if signal is None:
        return
    if 0.0 < abs(signal) <= 1.0:
        raise ValueError(f"--signal is {signal:g} %, which would move nothing; did you mean {100.0 * signal:g}?")
    if 0.0 < signal <= dead_band:
        warn(f"--signal is {signal:g} %, within the valve's dead band, {dead_band:.3g} %; the {what} will not move")
