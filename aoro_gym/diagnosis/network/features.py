"""What the network is shown of a log: commands, signals of the healthy and of the later day, and their differences.

One function for NumPy and for torch, so that training and diagnosis cannot differ.
"""

from __future__ import annotations

from types import ModuleType
from typing import Any

from aoro_gym.diagnosis.simulation.manoeuvres import CHANNELS, SAMPLES, TICK

__all__ = ["CHANNELS", "FEATURES", "SAMPLES", "features"]

RATE_SPAN = 2
"""Samples to either side from which the joint's rate is taken."""
ANGLE, ANGLE_CHANGE = 0.7, 0.01  # [rad]
RATE, RATE_CHANGE = 0.4, 0.03  # [rad/s]
PRESSURE, PRESSURE_CHANGE = 100e5, 2e5  # [Pa]
FEATURES = 2 + 6 + 3 * (len(CHANNELS) - 1) + len(CHANNELS) + 3
"""Rows of :func:`features`."""


def features(xp: ModuleType, commands: Any, healthy: Any, later: Any, has: Any, days: Any, repeat: Any) -> Any:
    """Rows (..., FEATURES, SAMPLES) that the network's first layer takes.

    Args:
        xp: ``numpy`` or ``torch``, whose arrays the others are.
        commands: Steering and drive signal (..., 2, SAMPLES).
        healthy: Signals [SI] of the healthy day (..., channels, SAMPLES); anything finite where there are none.
        later: The same of the day that is in question.
        has: Which channels there are (..., channels), 0 or 1.
        days: Whether there is a healthy and a later day (..., 2), 0 or 1.
        repeat: Whether the later day is a healthy one, too (...), 0 or 1: it shows what changes while nothing is wrong.
    """
    both = days[..., 0] * days[..., 1]
    rows = [commands]
    known = [days[..., 0], days[..., 1], both]
    rate = [_rate(xp, healthy[..., :1, :]), _rate(xp, later[..., :1, :])]
    for signals, part, size, change in (
        ((healthy[..., :1, :], later[..., :1, :]), has[..., :1], ANGLE, ANGLE_CHANGE),
        (rate, has[..., :1], RATE, RATE_CHANGE),
        ((healthy[..., 1:, :], later[..., 1:, :]), has[..., 1:], PRESSURE, PRESSURE_CHANGE),
    ):
        shown = [signals[0] / size, signals[1] / size, xp.arcsinh((signals[1] - signals[0]) / change)]
        rows += [values * (part * present[..., None])[..., None] for values, present in zip(shown, known, strict=True)]
    flags = xp.concatenate([has, days, repeat[..., None]], axis=-1)[..., None]
    rows.append(flags + 0.0 * commands[..., :1, :])
    return xp.concatenate(rows, axis=-2)


def _rate(xp: ModuleType, angle: Any) -> Any:
    """Joint rate [rad/s] (..., SAMPLES) as a central difference; zero at the ends."""
    span = 2 * RATE_SPAN
    middle = (angle[..., span:] - angle[..., :-span]) / (span * TICK)
    end = 0.0 * angle[..., :RATE_SPAN]
    return xp.concatenate([end, middle, end], axis=-1)
