"""What simulated machines are told to do: full turns, steps, pulses, ramps, drives, as a user might record them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from aoro_gym.recording.logs import TICK

CHANNELS = ("joint_angle", "pressure_a", "pressure_b", "pump_pressure")
"""Signals of a log, SI: [rad] and [Pa]."""
SAMPLES = 512
"""Samples of a log, the first at rest; a longer manoeuvre is cut off."""
REST = 0.5
"""Time [s] without a command at the beginning."""


@dataclass(frozen=True)
class Manoeuvre:
    """Commands (SAMPLES − 1, 2), steering and drive signal, each held for a tick, from rest at ``start`` of the joint's
    range."""

    name: str
    start: float
    commands: NDArray[np.float32]


def _held(start: float, name: str, *pieces: tuple[float, float], drive: float = 0.0) -> Manoeuvre:
    """``pieces`` of (signal, time [s]) after a rest, and zero after them; with ``drive`` from the end of the rest until
    the last piece ends."""
    commands = np.zeros((SAMPLES - 1, 2), dtype=np.float32)
    begin = first = round(REST / TICK)
    for signal, time in pieces:
        end = begin + round(time / TICK)
        commands[begin:end, 0] = signal
        begin = end
    commands[first:begin, 1] = drive
    return Manoeuvre(name, start, commands)


def full_turn(rng: np.random.Generator, side: float, level: float) -> Manoeuvre:
    """From one stop to the other: the published test."""
    signal = side * min(level * rng.uniform(0.97, 1.03), 1.0)
    return _held(
        -side * rng.uniform(0.96, 1.0), f"{'left' if side > 0 else 'right'}_{100 * level:.0f}",
        (signal, rng.uniform(1.05, 1.25) * 2.5 / level**1.3),
    )  # fmt: skip


def steps(rng: np.random.Generator) -> Manoeuvre:
    """Two steps to one side and one to the other."""
    side, first, second = rng.choice([-1.0, 1.0]), rng.uniform(0.4, 1.0), rng.uniform(0.4, 1.0)
    share = rng.uniform(0.4, 0.8)
    return _held(
        side * rng.uniform(-0.8, -0.2), "steps", (side * first, rng.uniform(0.3, 0.8)),
        (side * share * first, rng.uniform(0.3, 0.8)), (-side * second, rng.uniform(0.5, 1.2)),
    )  # fmt: skip


def pulse(rng: np.random.Generator) -> Manoeuvre:
    """A short pulse to either side."""
    side, height, time = rng.choice([-1.0, 1.0]), rng.uniform(0.4, 1.0), rng.uniform(0.12, 0.45)
    return _held(
        rng.uniform(-0.4, 0.4), "pulse", (side * height, time), (0.0, rng.uniform(0.4, 0.9)), (-side * height, time)
    )


def ramp(rng: np.random.Generator) -> Manoeuvre:
    """A rising, then a falling signal, and sometimes its like to the other side."""
    side, peak = rng.choice([-1.0, 1.0]), rng.uniform(0.5, 1.0)
    rise, fall = (np.linspace(0.0, 1.0, round(rng.uniform(*ends) / TICK)) for ends in ((1.0, 2.5), (0.6, 1.5)))
    shape = peak * side * np.concatenate([rise, fall[::-1]])
    commands = np.zeros((SAMPLES - 1, 2), dtype=np.float32)
    begin = round(REST / TICK)
    commands[begin : begin + len(shape), 0] = shape[: SAMPLES - 1 - begin]
    return Manoeuvre("ramp", -side * rng.uniform(0.5, 0.95), commands)


def sine(rng: np.random.Generator) -> Manoeuvre:
    """A swept sine about the middle."""
    time = TICK * np.arange(SAMPLES - 1 - round(REST / TICK))
    low, rate = rng.uniform(0.2, 0.5), rng.uniform(0.0, 0.4)
    commands = np.zeros((SAMPLES - 1, 2), dtype=np.float32)
    phase = 2.0 * np.pi * (low * time + 0.5 * rate * time**2)
    commands[-len(time) :, 0] = rng.choice([-1.0, 1.0]) * rng.uniform(0.4, 0.9) * np.sin(phase)
    return Manoeuvre("sine", rng.uniform(-0.2, 0.2), commands)


def drive(rng: np.random.Generator) -> Manoeuvre:
    """Roll, steer to one side and to the other."""
    side, turning = rng.choice([-1.0, 1.0]), rng.uniform(0.4, 0.9)
    pieces = (
        (0.0, rng.uniform(0.6, 1.2)),
        (side * turning, rng.uniform(0.4, 0.9)),
        (-side * turning, rng.uniform(0.4, 0.9)),
    )
    return _held(0.0, "drive", *pieces, drive=float(rng.choice([-1.0, 1.0], p=[0.25, 0.75]) * rng.uniform(0.1, 0.4)))


OTHERS: Mapping[str, Callable[[np.random.Generator], Manoeuvre]] = {
    "steps": steps, "pulse": pulse, "ramp": ramp, "sine": sine, "drive": drive,
}  # fmt: skip
TURNS = tuple((side, level) for side in (1.0, -1.0) for level in (1.0, 0.75, 0.5))


def draw(rng: np.random.Generator, count: int) -> list[Manoeuvre]:
    """``count`` manoeuvres of one machine: in a third of the cases full turns first, else in any order."""
    turns = [full_turn(rng, side, level) for side, level in TURNS]
    others = [make(rng) for make in OTHERS.values()]
    if rng.random() < 1.0 / 3.0:
        both = turns + others
    else:
        both = [(turns + others)[i] for i in rng.permutation(len(turns) + len(others))]
    return both[:count]
