"""What the parted machine is driven through beside the whole one."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from aoro_gym.terrains.plane import Plane
from aoro_gym.terrains.terrain import Terrain

KERB = 0.12
"""Height [m] of the kerb, a common one (E)."""
KERB_WAY = 0.5
"""From where the front wheels' axle stands to the kerb's edge [m], a choice."""


@dataclass(frozen=True)
class Manoeuvre:
    """Commands over time, and the ground."""

    text: str
    duration: float
    """[s]"""
    commands: Callable[[float], Mapping[str, float]]
    """At a time [s]."""
    ground: Callable[[], Plane | Terrain] = Plane


def _drive(time: float) -> dict[str, float]:
    return {"drive_signal": 0.6 if time < 4.0 else 0.0, "gear": 1.0 if time < 2.0 else 2.0}


def _turn(time: float) -> dict[str, float]:
    return {"drive_signal": 0.6, "steering_signal": 0.0 if time < 1.0 else 0.6 if time < 3.5 else -0.6}


def _kerb(time: float) -> dict[str, float]:
    return {"drive_signal": 0.5}


def _park(time: float) -> dict[str, float]:
    return {"drive_signal": 0.5 if time < 1.5 else 0.0, "parking_brake": 0.0 if time < 2.0 else 1.0}


def kerb() -> Terrain:
    """Level ground 24 m long that rises by :data:`KERB` over one cell of 5 cm, ahead of a machine at its origin."""
    cell = 0.05
    x = -8.0 + cell * np.arange(round(24.0 / cell) + 1)
    edge = 1.7 + KERB_WAY
    heights = np.broadcast_to(np.where(x > edge, KERB, 0.0), (round(8.0 / cell) + 1, len(x)))
    return Terrain.from_heights(heights, cell=cell, corner=(-8.0, -4.0))


MANOEUVRES: dict[str, Manoeuvre] = {
    "drive": Manoeuvre("drive off, shift up, roll out", 6.0, _drive),
    "turn": Manoeuvre("turn to the left and to the right while driving", 6.0, _turn),
    "kerb": Manoeuvre(f"over a kerb of {100 * KERB:.0f} cm with all wheels", 8.0, _kerb, kerb),
    "park": Manoeuvre("drive off, stop, set the parking brake", 4.0, _park),
}
