"""Recordings that a twin makes of itself, for tests."""

import numpy as np
from numpy.typing import NDArray

from aoro_gym.diagnosis.recording import TICK, Recording
from aoro_gym.diagnosis.replay import Replay, Simulator, Variants
from aoro_gym.sensors.joint_angle import JointAngleSensor

FULL = ("joint_angle", "pressure_a", "pressure_b", "pump_pressure")
REST = 0.6


def turn(level: float, duration: float) -> NDArray[np.float64]:
    """Commands of a turn at ``level``, between two standstills."""
    commands = np.zeros((round(duration / TICK), 2))
    commands[round(REST / TICK) : round((duration - 0.4) / TICK), 0] = level
    return commands


def blank(name: str, commands: NDArray[np.float64], start: float) -> Recording:
    channels = {channel: np.zeros(len(commands) + 1) for channel in FULL}
    return Recording(name, commands, channels, round(REST / TICK), start)


def record(variants: Variants, blanks: list[Recording], rng: np.random.Generator) -> list[Recording]:
    """What one variant logs, with the published noise of the angle and 0.3 bar of noise on pressures."""
    out = []
    for one, found in zip(blanks, Simulator().run([Replay(variants, one) for one in blanks]), strict=True):
        time = TICK * np.arange(one.ticks + 1)
        channels = {name: values[:, 0].astype(np.float64) for name, values in found.items()}
        channels["joint_angle"] = JointAngleSensor().record(channels["joint_angle"], time, rng)[1]
        for name in FULL[1:]:
            channels[name] = channels[name] + rng.normal(0.0, 0.3e5, len(time))
        start = float(np.mean(channels["joint_angle"][: one.rest]))
        out.append(Recording(one.name, one.commands, channels, one.rest, start))
    return out
