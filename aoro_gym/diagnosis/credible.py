"""Recordings beside the twin under the same commands: what no machine of its kind shows is a fault of the log, and no cause.

Effects of the catalogue make a machine turn slower, later or unsteadily. They do not make it stand where its twin turns,
turn where nothing is commanded, or take four fifths of a pressure away: there a sensor, a unit or a column is wrong.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from aoro_gym.diagnosis.arrival import AHEAD, NEVER, arrivals
from aoro_gym.diagnosis.noise import Floats
from aoro_gym.diagnosis.recording import TICK, Recording
from aoro_gym.diagnosis.replay import Replay, Signals, Simulator, Variants
from aoro_gym.machine import Machine

FAR = 5.0
"""Factor between machine and twin that no effect of the catalogue explains."""
PUSHED, LONG = 0.4, round(1.0 / TICK)
"""Signal, well beyond any dead band, and samples for which it is held, by which a joint must turn."""
SETTLED = round(1.0 / TICK)
"""Samples after a command by which a joint stands again."""
TURNED = np.radians(10.0)
"""Turn [rad] from which it is judged what the machine makes of a command."""
DRIFTED = np.radians(5.0)
"""Turn [rad] without a command beyond any creeping."""
BEYOND = np.radians(5.0)
"""Angle [rad] beyond the joint's range that no sensor's gain explains."""
SWING = 20e5
"""Swing [Pa] of a pressure of the twin from which it is judged what the machine shows of it."""
PORTS = "pressure_a", "pressure_b"
"""Which drive the joint to the left and to the right."""
EXTREMES = 0.01, 0.99
"""Quantiles between which a pressure swings."""


def credible(
    groups: Sequence[Sequence[Recording]], machine: Machine, simulator: Simulator
) -> tuple[list[list[Recording]], list[str]]:
    """Recordings as far as a machine of the twin's kind can have made them, and a sentence on all that was left out."""
    found = iter(simulator.run([Replay(Variants(machine), one) for group in groups for one in group]))
    said: list[str] = []
    kept = [[_believed(one, next(found), machine, said) for one in group] for group in groups]
    return [[one for one in group if one is not None] for group in kept], said


def _believed(recording: Recording, signals: Signals, machine: Machine, said: list[str]) -> Recording | None:
    """A recording with the channels that can be believed; None if its angle cannot."""
    twin = {name: values[:, 0].astype(np.float64) for name, values in signals.items()}
    wrong = _motion(recording, twin["joint_angle"], float(np.max(machine.joint.range)))
    if wrong:
        said.append(f"{recording.name} was left out: {wrong}.")
        return None
    unused = _pressures(recording, twin)
    if unused:
        said.append(
            f"{recording.name}: {' and '.join(unused)} swing otherwise than the twin's by a factor of {FAR:g} or more, and "
            "were not used: check units, ports and plugs."
        )
    return replace(recording, channels={k: v for k, v in recording.channels.items() if k not in unused})


def _motion(recording: Recording, twin: Floats, limit: float) -> str:
    """What is wrong with the motion of a recording, beside the angle (F,) of the twin, or nothing."""
    angle, steering = recording.channels["joint_angle"], recording.commands[:, 0]
    reached = float(np.max(np.abs(angle)))
    if reached > limit + BEYOND:
        return (
            f"its joint angle reaches {np.degrees(reached):.3g}°, but the joint ends at {np.degrees(limit):.3g}°: check its "
            "unit and its zero"
        )
    pushed = [part for sign in (1.0, -1.0) for part in _runs(sign * steering >= PUSHED) if part[1] - part[0] >= LONG]
    mine, its = (float(sum(_turns(values, part) for part in pushed)) for values in (angle, twin))
    if its > TURNED and mine < its / FAR:
        return (
            f"the joint turns by {np.degrees(mine):.2g}° where its commands turn the twin by {np.degrees(its):.3g}°: check "
            "the sensor, whether the angle is in radians or degrees, and whether these commands are those of this log"
        )
    for begin, end in _runs(steering == 0.0):
        part = begin + SETTLED if begin else 0, end
        mine, its = (_turns(values, part) for values in (angle, twin))
        if mine > DRIFTED and its < mine / FAR:
            return (
                f"the joint turns by {np.degrees(mine):.3g}° from {part[0] * TICK:.2f} to {end * TICK:.2f} s, where nothing "
                "is commanded: check whether these commands are those of this log"
            )
    return ""


def _pressures(recording: Recording, twin: Mapping[str, Floats]) -> list[str]:
    """Pressures of a recording that show next to nothing of what those of the twin do before either joint is at a stop. Both
    ports go with one of them, which may have the other's pressure, and all if none is right.

    A port is judged while it drives the joint: the surge in the one that lets go depends on how quick the spool is.
    """
    steering = np.append(0.0, recording.commands[:, 0])
    angles = np.column_stack([recording.channels["joint_angle"], twin["joint_angle"]])
    stops = arrivals(angles, steering[1:])
    begins = np.arange(len(steering)) < recording.rest
    counts = np.arange(len(steering)) < min([*stops[stops != NEVER], len(steering)]) - AHEAD
    drives = {PORTS[0]: begins | (steering > 0.0), PORTS[1]: begins | (steering < 0.0)}
    judged, small = [], []
    pressures = [name for name in recording.channels if "pressure" in name]
    for name in pressures:
        part = counts & drives.get(name, counts)
        both = recording.channels[name][part], twin[name][part]
        mine, its = (float(np.ptp(np.quantile(values, EXTREMES))) for values in both)
        if its > SWING:
            judged.append(name)
            small += [name] if mine < its / FAR else []
    if len(small) == len(judged):
        return pressures if small else []
    return [name for name in pressures if name in small or (name in PORTS and set(PORTS) & set(small))]


def _runs(flags: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Begin and end of every run of true flags."""
    edges = np.flatnonzero(np.diff(np.r_[False, flags, False].astype(np.int8)))
    return list(zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True))


def _turns(angle: Floats, part: tuple[int, int]) -> float:
    begin, end = part
    return abs(float(angle[end] - angle[begin])) if end > begin else 0.0
