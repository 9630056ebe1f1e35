"""Digits that a file has lost: steps of its coordinates against the distance of its points."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from aoro_gym.terrains.io.check import Report

FEWEST = 50
"""Points from which lost digits show."""
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
    points: Array, spacing: float, metre: float, report: Report, steps: Array | None = None, names: str = "xy"
) -> None:
    """Warn where coordinates go in steps that displace the points.

    A grid whose lines lie on the steps is none of these: it is whole, however few digits it has.

    Args:
        points: (N, 3) neighbouring points in the file's units, the last axis up.
        spacing: Their typical distance in plan, in the same unit.
        metre: Metres a unit.
        report: Where to warn.
        steps: (2,) steps that the format declares.
        names: Of the two horizontal axes.
    """
    points = np.unique(points, axis=0)
    if len(points) < FEWEST or not spacing > 0.0:
        return
    found = [_step(values) for values in points[:, :2].T]
    if steps is not None:
        found = [(max(step, float(given)), single) for (step, single), given in zip(found, steps, strict=True)]
    axis = int(np.argmax([step for step, _ in found]))
    step, single = found[axis]
    if step < COARSE * spacing or not (_has_coincident_points(points, step) or (single and _is_irregular(points))):
        return
    farthest = float(np.abs(points[:, axis]).max())
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


def _has_coincident_points(points: Array, step: float) -> bool:
    """Whether many points share their place with another, about as high: no wall, but two places that became one."""
    order = np.lexsort((points[:, 2], points[:, 1], points[:, 0]))
    rises = np.diff(points[order], axis=0)
    same = np.all(rises[:, :2] == 0.0, axis=1)
    return int(same.sum()) > TWICE * len(points) and float(np.median(rises[same, 2])) <= 2.0 * step


def _is_irregular(points: Array) -> bool:
    """Whether the places are no rows and columns."""
    rows, columns = (len(np.unique(values)) for values in points[:, :2].T)
    return rows * columns > REGULAR * len(points)
