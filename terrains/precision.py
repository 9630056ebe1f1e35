"""Digits that a file has lost: steps of its coordinates against the distance of its points."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from aoro_gym.terrains.check import Report

COARSE = 0.1
"""Share of the distance of neighbouring points from which a step of their coordinates is large."""
TWICE = 0.02
"""Share of points in a place that is taken already, from which places have fallen together."""
REGULAR = 4.0
"""Rows times columns of places over the number of points up to which these are a grid, which loses nothing to steps."""
DECIMALS = tuple(10.0**power for power in range(4, -4, -1))
"""Steps of numbers written with few digits, coarsest first."""

Array = NDArray[np.float64]


def note_lost_precision(
    plan: Array, spacing: float, metre: float, report: Report, steps: Array | None = None, names: str = "xy"
) -> None:
    """Warn where coordinates go in steps that displace the points.

    A grid whose lines lie on the steps is none of these: it is whole, however few digits it has.

    Args:
        plan: (N, 2) horizontal coordinates of neighbouring points, as in the file.
        spacing: Their typical distance, in the same unit.
        metre: Metres a unit.
        report: Where to warn.
        steps: (2,) steps that the format declares.
        names: Of the two axes.
    """
    if len(plan) < 3 or not spacing > 0.0:
        return
    found = [_step(values) for values in plan.T]
    if steps is not None:
        found = [(max(step, float(given)), single) for (step, single), given in zip(found, steps, strict=True)]
    axis = int(np.argmax([step for step, _ in found]))
    step, single = found[axis]
    if step < COARSE * spacing or not _displaced(plan):
        return
    farthest = float(np.abs(plan[:, axis]).max())
    kind = "are single precision (float32)" if single else "have few digits"
    report.warnings.append(
        f"coordinates {kind}: steps of {step * metre:.3g} m at {names[axis]} = {farthest:,.0f}, where points are"
        f" {spacing * metre:.3g} m apart, so the ground is rougher than in truth; export them in double precision with all"
        " digits, or shifted towards 0"
    )


def _step(values: Array) -> tuple[float, bool]:
    """Step that all ``values`` lie on (0 where none is seen), and whether it is that of single precision."""
    size = float(np.abs(values).max())
    decimal = 0.0
    for step in DECIMALS:
        if step > size:
            continue
        ratio = values / step
        if np.all(np.abs(ratio - np.rint(ratio)) <= 1e-6 + 4.0 * np.finfo(np.float64).eps * np.abs(ratio)):
            decimal = step
            break
    short = values.astype(np.float32)
    if np.array_equal(short.astype(np.float64), values):
        binary = float(np.spacing(np.float32(size)))
        if binary > decimal:
            return binary, True
    return decimal, False


def _displaced(plan: Array) -> bool:
    """Whether places have fallen together, or are no grid."""
    places = len(np.unique(plan, axis=0))
    if places < (1.0 - TWICE) * len(plan):
        return True
    rows, columns = (len(np.unique(values)) for values in plan.T)
    return rows * columns > REGULAR * len(plan)
