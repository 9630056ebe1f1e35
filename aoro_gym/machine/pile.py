"""Logs piled in a bunk as one rigid body: solid cylinders that touch, joined by parallel axes.

The lower row holds as many logs side by side as the bunk is wide, each log of the next row lies in a gap of the one below
it, and so on up (closest packing). The logs that are left for the uppermost row share its places evenly, so that the pile is
symmetric and grows smoothly with its count, which need not be whole.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from aoro_gym.machine.quantities import Quantity, as_quantity

MOST_LOGS = 1000
"""Logs that a bunk may hold: more than any of forestry's."""
_EXACT = 1e-9  # of a diameter: a bunk just as wide as its logs holds them
_ROW = math.sqrt(3.0) / 2.0  # of a diameter: from row to row


@dataclass(frozen=True, eq=False)
class Pile:
    """A pile of logs along x; floats or arrays of shape (N,)."""

    mass: Quantity  # [kg]
    cog_height: Quantity  # [m] over the bunk's floor
    inertia_xx: Quantity  # [kg m²] about the CoG
    inertia_yy: Quantity
    inertia_zz: Quantity


def rows(count: Quantity, diameter: Quantity, width: Quantity) -> Iterator[tuple[NDArray[np.float64], ...]]:
    """Rows of a pile from the lowest up, each for all piles (N,).

    Args:
        count: Logs.
        diameter: Of a log [m].
        width: Of the bunk [m], at least two logs'.

    Yields:
        Logs in the row, its places, and the height [m] of their axes over the floor.
    """
    left, d, across = (np.atleast_1d(np.asarray(one, dtype=np.float64)) for one in (count, diameter, width))
    wide = np.floor(across / d + _EXACT)
    row = 0
    while np.any(left > 0.0):
        places = wide - row % 2
        laid = np.minimum(left, places)
        yield laid, places, d * (0.5 + _ROW * row)
        left = left - laid
        row += 1


def pile_of(count: Quantity, length: Quantity, diameter: Quantity, density: Quantity, width: Quantity) -> Pile:
    """Pile of ``count`` logs in a bunk of ``width`` [m].

    A solid cylinder of mass m has m d²/8 about its axis and m (L²/12 + d²/16) across it.

    Args:
        count: Logs, at most :data:`MOST_LOGS` [-].
        length: Of a log [m].
        diameter: Of a log [m].
        density: Of the wood [kg/m³].
        width: Of the bunk between its stakes [m].
    """
    if np.any(np.asarray(count) > MOST_LOGS) or np.any(np.asarray(width) < (2.0 - _EXACT) * np.asarray(diameter)):
        nothing = as_quantity(np.full(np.broadcast(count, length, diameter, density, width).shape, np.nan))
        return Pile(nothing, nothing, nothing, nothing, nothing)
    laid = high = high_squared = across_squared = 0.0
    for logs, places, height in rows(count, diameter, width):
        laid = laid + logs
        high = high + logs * height
        high_squared = high_squared + logs * height**2
        # places d apart about the middle: their mean square is d² (k² − 1)/12
        across_squared = across_squared + logs * np.asarray(diameter) ** 2 * (places**2 - 1.0) / 12.0
    shape = np.broadcast(count, length, diameter, density, width).shape
    one = np.asarray(density) * np.pi / 4.0 * np.asarray(diameter) ** 2 * np.asarray(length)
    cog = high / np.maximum(laid, 1e-300)
    tall = high_squared - laid * cog**2
    axial, transverse = (
        np.asarray(diameter) ** 2 / 8.0,
        np.asarray(length) ** 2 / 12.0 + np.asarray(diameter) ** 2 / 16.0,
    )

    def quantity(values: NDArray[np.float64]) -> Quantity:
        return as_quantity(np.broadcast_to(values, shape) if shape else float(np.ravel(values)[0]))

    return Pile(
        mass=quantity(one * laid),
        cog_height=quantity(cog),
        inertia_xx=quantity(one * (laid * axial + tall + across_squared)),
        inertia_yy=quantity(one * (laid * transverse + tall)),
        inertia_zz=quantity(one * (laid * transverse + across_squared)),
    )
