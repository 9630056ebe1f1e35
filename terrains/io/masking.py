"""Values that stand for "unknown": those that the caller or the file declares, and those that nobody declares.

An undeclared mark is a value that many files use for "unknown", a limit of the number format or an end of the range of
values, and its pixels stand apart: far beyond the rest, and with a step to every neighbour that the ground has nowhere
else. A lake or the sea at 0 m within ground near 0 m is none.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from aoro_gym.terrains.io.check import Report

HIGHEST = 9000.0
"""Largest height [m] either way on Earth's land; a thousand times that, in millimetres, is in no unit."""
CERTAIN = (-9999.0, -32768.0, -32767.0, -99999.0, -999999.0, -9999999.0, -3.4e38, 65535.0, 32767.0)
"""Undeclared values that mean "unknown" wherever they stand apart."""
USUAL = (0.0, -999.0, -99.0, -1.0, -9998.0, -1000.0, -1e4, -1e5, 999.0, 9999.0, 99999.0, 999999.0, 1e4, 1e5, 1e6, 255.0)
"""Undeclared values that often do, and may be heights."""
STEP = 10.0
"""How many times larger the step to a mark is than the largest percent of steps of the rest."""
APART = 10.0
"""Distance [m] of a mark from the rest, at least."""
SEA = 25.0
"""The same for 0, at which the sea stands: few coasts are steeper all along."""
FAR = 50.0
"""The same where the rest is of few different values, as steps and platforms that somebody drew, or the value is no usual
mark."""
FEW_VALUES = 20
FEW_SHARE = 0.1
"""Largest share of pixels that an unusual value may take from the rest."""
BLENDED = 3.0
"""How many times the range of the rest beyond it what was interpolated between a mark and the ground is unknown, too."""
MOST_MARKS = 6

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]


@dataclass
class NodataValues:
    """What is unknown among the raw values of a band."""

    values: list[float] = field(default_factory=list)
    low: float = -HIGHEST * 1e3
    """Lowest value that may be a height, and highest."""
    high: float = HIGHEST * 1e3
    doubtful: list[float] = field(default_factory=list)
    """Those of ``values`` that may be heights, and values that were left as heights though they may be marks."""
    suspects: list[tuple[float, float]] = field(default_factory=list)
    """Values that were left as heights though they may be marks, and their distance from the pixels around them."""

    def unknown(self, z: Array) -> Mask:
        """Which of ``z`` is no height; NaN are none."""
        with np.errstate(invalid="ignore"):
            found = ~((z >= self.low) & (z <= self.high))
        for value in self.values:
            found |= equals_value(z, value)
        return found


def equals_value(z: Array, value: float) -> Mask:
    """Which of ``z`` is ``value``, as single or double precision has it."""
    if np.isnan(value):
        return np.isnan(z)
    with np.errstate(over="ignore"):
        return (z == value) | (z == float(np.float32(value)))


def find_nodata(z: Array, metre: float = 1.0, limits: tuple[float, float] | None = None) -> NodataValues:
    """The undeclared marks of a band.

    Args:
        z: (rows, columns) raw values, as neighbours; NaN where they are known to be unknown.
        metre: Metres a raw unit, as far as it is known.
        limits: Least and largest value of the number format, where these are whole numbers.

    Returns:
        The marks, to be applied to the whole band.
    """
    marks = NodataValues()
    z = np.where(marks.unknown(z), np.nan, z)
    if limits is not None and limits[1] > 255:  # saturated: it would be more
        full = [limit for limit in limits if limit != 0.0 and (z == limit).any()]
        marks.values += full
        marks.doubtful += [limit for limit in full if limit > 0.0]
        z = np.where(marks.unknown(z), np.nan, z)
    for _ in range(MOST_MARKS):
        values = z[np.isfinite(z)]
        if len(values) < 4:
            break
        ends = float(values.min()), float(values.max())
        usual = [value for value in (*CERTAIN, *USUAL) if ends[0] <= value <= ends[1]]
        found = next((value for value in dict.fromkeys((*usual, *ends)) if _is_nodata(z, value, metre, marks)), None)
        if found is None:
            break
        marks.values.append(found)
        if not any(equals_value(np.array([found]), value)[0] for value in CERTAIN):
            marks.doubtful.append(found)
        z = np.where(equals_value(z, found), np.nan, z)
    rest = z[np.isfinite(z)]
    if marks.values and len(rest) >= 4:
        low, high = (float(v) for v in np.percentile(rest, [1, 99]))
        margin = BLENDED * (high - low) + APART / metre
        near = ndimage.binary_dilation(~np.isfinite(z), iterations=3) & np.isfinite(z)
        if any(value < low for value in marks.values) and (z[near] < low - margin).any():
            marks.low = max(marks.low, low - margin)
        if any(value > high for value in marks.values) and (z[near] > high + margin).any():
            marks.high = min(marks.high, high + margin)
    return marks


def _is_nodata(z: Array, value: float, metre: float, marks: NodataValues) -> bool:
    """Whether the pixels of ``value`` stand apart from the rest."""
    here = equals_value(z, value)
    count = int(here.sum())
    rest = z[np.isfinite(z) & ~here]
    if not count or len(rest) < 4:
        return False
    steps, others = _steps(z, here)
    if not len(steps):
        return False
    gap = float(np.abs(rest - value).min())
    step = float(np.percentile(steps, 5))
    usual = any(equals_value(np.array([value]), known)[0] for known in (*CERTAIN, *USUAL))
    spread = float(np.subtract(*np.percentile(rest, [99.5, 0.5])))
    sharp = step > STEP * max(others, 1e-12) and gap > 0.0
    different = len(np.unique(rest[:: 1 + len(rest) // 10_000]))
    various = different > FEW_VALUES
    if not usual:
        few = 4 <= count <= FEW_SHARE * (count + len(rest))
        return few and sharp and gap > max(10.0 * spread, FAR / metre)
    outside = value < rest.min() or value > rest.max()
    certain = any(equals_value(np.array([value]), known)[0] for known in CERTAIN)
    if certain and outside and abs(value) * metre > 0.5 * HIGHEST and gap > max(spread, APART / metre):
        return True  # no height in metres, whatever its surroundings
    apart = (SEA if value == 0.0 else APART) if various else FAR
    picture = different <= 2 and count > FEW_SHARE * (count + len(rest))
    if sharp and not picture and gap > max(0.1 * spread, apart / metre):
        return True
    if sharp and count >= 4 and various and step > 2.0 / metre:
        marks.suspects.append((value, step * metre))
    return False


def _steps(z: Array, here: Mask) -> tuple[Array, float]:
    """Steps between pixels of a value and their neighbours, and the 99th percentile of steps among the rest."""
    across, among = [], []
    for a, b, p, q in (
        (z[:, :-1], z[:, 1:], here[:, :-1], here[:, 1:]),
        (z[:-1], z[1:], here[:-1], here[1:]),
    ):
        step = np.abs(b - a)
        known = np.isfinite(step)
        across.append(step[known & (p ^ q)])
        among.append(step[known & ~p & ~q])
    rest = np.concatenate(among)
    return np.concatenate(across), float(np.percentile(rest, 99)) if len(rest) else 0.0


def report_nodata(marks: NodataValues, counts: dict[float, int], beyond: int, report: Report) -> None:
    """Say which values were taken for "unknown" without being declared, and which may be.

    Args:
        marks: What was found.
        counts: How many pixels have each of its values and suspects, by value.
        beyond: How many lie beyond its range.
        report: Told.
    """
    for value in marks.values:
        count = counts.get(value, 0)
        report.change(
            "undeclared_nodata", count, f"{count:,} heights of exactly {value:.10g} taken as unknown (undeclared)"
        )
        if value in marks.doubtful and count:
            report.warnings.append(
                f"{count:,} pixels are exactly {value:.10g}, apart from all others, and taken as unknown; nodata=..."
                f" (--nodata) says which values are: --nodata {value:.10g}, or --nodata none to keep them"
            )
    report.change(
        "wild_heights",
        beyond,
        f"{beyond:,} heights beyond any on Earth taken as unknown"
        if marks.low == -HIGHEST * 1e3 and marks.high == HIGHEST * 1e3
        else f"{beyond:,} heights between the ground and a mark of unknown, or beyond any on Earth, taken as unknown",
    )
    for value, step in dict(marks.suspects).items():
        if count := counts.get(value, 0):
            report.warnings.append(
                f"{count:,} pixels are exactly {value:.10g}, {step:.3g} m from those around them, and taken as heights; if"
                f" they mean unknown, say nodata={value:.10g} (--nodata {value:.10g})"
            )
