"""Whether heights are ground, and in which unit: by the steepness of the ground, and by what neighbours have in common.

What the caller says is believed. What a file declares must make a ground; where it is silent, heights are in the unit of
the plan if that makes a ground, in the only other unit that does, or else the caller is asked.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from aoro_gym.terrains.heights import Heights
from aoro_gym.terrains.io.check import Report, TerrainError
from aoro_gym.terrains.io.elevation_model import ElevationModel
from aoro_gym.terrains.io.frame import Known, LoadOptions
from aoro_gym.terrains.length_units import UNITS, unit_named

GUESSES = ("km", "m", "ft", "dm", "cm", "mm")
"""Units that heights without a word are tried in."""
UPRIGHT = 60.0
"""Median slope [deg] at which heights are in another unit than the plan, rather than ground."""
STEEP = 45.0
"""Median slope [deg] up to which another unit makes a ground."""
LEVEL = 0.1
"""Median slope [deg] from which it does."""
DOUBTFUL = 35.0
"""Median slope [deg] of undeclared heights from which other units are named."""
TERRACED = 0.2
"""Least share of inclined cells that tells a slope, where the median cell is level."""

UNRELATED = 1.2
"""Mean difference of next-but-one neighbours by that of neighbours up to which they have nothing in common: 1 for white
noise, 2 for a smooth surface, 1.3 to 1.8 for natural ground, 1.3 for a natural photograph."""
NOISE, NOISE_SHARE = 0.25, 0.1
"""Standard deviation [m], and by the distance of neighbours, of the noise of a survey."""
MUCH_NOISE = 0.1
"""Standard deviation [m] of noise that is said where there is nothing else."""
ENOUGH = 1_000_000
"""Heights whose neighbours are looked at."""
BYTES = 1.4
"""The same as ``UNRELATED`` where heights are bytes, as of most pictures."""

Array = NDArray[np.float64]


STEEP_STEP = 0.25
"""Rounding of heights, by the width of a cell, from which its steps are named."""
LEAST_STEP = 0.2
"""And in metres: below it a wheel rolls over them."""


@dataclass(frozen=True)
class HeightsInUnit:
    """Heights in one unit."""

    unit: str
    slope_deg: float
    """Median slope."""


def plausible_units(steepness: float) -> list[HeightsInUnit]:
    """The units that make a ground of heights whose median gradient is ``steepness`` [raw unit of height / m]."""
    found = [HeightsInUnit(unit, float(np.degrees(np.arctan(steepness * UNITS[unit])))) for unit in GUESSES]
    return [reading for reading in found if LEVEL <= reading.slope_deg <= STEEP]


def settle_heights(
    found: ElevationModel, request: LoadOptions, report: Report, *, of_bytes: bool = False
) -> ElevationModel:
    """``found`` with heights in metres for sure.

    To be called before anything that compares heights with metres (ground filter, spikes); a second call does nothing.

    Args:
        found: Heights in the unit that its frame takes them for.
        request: ``z_units`` ends all doubt.
        report: Told what was taken, and what is doubtful.
        of_bytes: Whether heights are whole numbers of one byte, as pictures have.

    Raises:
        TerrainError: the heights are no ground in the declared unit, in none or in several, or neighbours have nothing
            to do with each other.
    """
    frame, heights = found.frame, found.heights
    if frame.z_known in ("asked", "format", "settled"):
        return found
    unit = _short(frame.z_unit)
    _refuse_images(heights, request, report, of_bytes)
    settled = replace(found, frame=replace(frame, z_known="settled"))
    _note_terraces(heights, report)
    steepness = median_steepness(heights)
    if steepness is None:
        return settled
    slope = float(np.degrees(np.arctan(steepness)))
    others = [
        reading
        for reading in plausible_units(steepness / frame.z_scale)
        if not np.isclose(UNITS[reading.unit], frame.z_scale, rtol=1e-3)
    ]
    if slope <= UPRIGHT:
        if report.kind != "heights":  # an array is in metres, as load says
            _note_doubt(report, frame.z_known, unit, slope, others)
            if of_bytes and frame.z_known == "assumed":
                report.warnings.append(
                    f"its values are bytes, as those of pictures and maps of classes; taken as heights in {unit}:"
                    " z_units=... says it"
                )
        return settled
    if frame.z_known == "assumed" and report.kind != "mesh" and len(others) == 1:
        return _taken(settled, report, unit, slope, others[0])
    if not others:
        return settled  # refused with the other figures
    said = (
        f"its heights are declared as {unit}"
        if frame.z_known == "declared"
        else "nothing is said of the unit of its heights"
    )
    raise TerrainError(
        f"{report.source}: {said}, and half of the ground would be steeper than {slope:.0f}° in {unit}; by median slope,"
        f" {_listed(others)} would make a ground: say z_units=... (--z-units)" + _other_reasons(report, unit, of_bytes)
    )


def _note_terraces(heights: Heights, report: Report) -> None:
    """A warning where heights are rounded so coarsely that their steps are obstacles."""
    levels = np.unique(heights.z[heights.known])
    if report.kind not in ("raster", "heights") or not 4 <= len(levels) <= 10_000:
        return
    step = float(np.diff(levels).min())
    if step < max(STEEP_STEP * heights.cell, LEAST_STEP):
        return
    counts = (levels - levels[0]) / step
    if np.allclose(counts, np.rint(counts), atol=1e-3):
        report.warnings.append(
            f"its heights are rounded to {step:.3g} m, on cells of {heights.cell:.3g} m: the terrain has steps of"
            f" {step:.3g} m where the ground is smooth; smooth them, or get finer heights"
        )


def median_steepness(heights: Heights) -> float | None:
    """Median gradient of the cells [-]; of the inclined ones alone where most are level steps. None without cells."""
    steepness = heights.gradient()
    steepness = steepness[np.isfinite(steepness)]
    if not len(steepness):
        return None
    median = float(np.median(steepness))
    if median > 0.0:
        return median
    known = heights.known
    weight = ndimage.uniform_filter(known.astype(np.float64), 9, mode="constant")
    smooth = ndimage.uniform_filter(np.where(known, heights.z, 0.0), 9, mode="constant") / np.maximum(weight, 1e-9)
    steepness = heights.replaced(np.where(known, smooth, np.nan)).gradient()
    inclined = steepness[np.isfinite(steepness) & (steepness > 1e-9)]
    return float(np.median(inclined)) if len(inclined) >= TERRACED * np.isfinite(steepness).sum() else 0.0


def neighbour_statistics(z: Array) -> tuple[float, float] | None:
    """What neighbours have in common, and the mean difference of neighbours; None where there are too few, or none differ.

    The first is the mean difference of next-but-one neighbours by that of neighbours. The largest twentieth of differences
    is cut to the next lower one, so that spikes and voids do not decide.
    """
    near, far = [], []
    step = 1 + z.size // ENOUGH
    for lines in (z[::step], z[:, ::step].T):
        a, b, c = lines[:, :-2], lines[:, 1:-1], lines[:, 2:]
        whole = np.isfinite(a) & np.isfinite(b) & np.isfinite(c)
        near.append(np.abs(b - a)[whole])
        far.append(np.abs(c - a)[whole])
    one, two = np.concatenate(near), np.concatenate(far)
    if len(one) < 50:
        return None
    mean = float(np.minimum(one, np.percentile(one, 95)).mean())
    if mean == 0.0:
        return None
    return float(np.minimum(two, np.percentile(two, 95)).mean()) / mean, mean


def _refuse_images(heights: Heights, request: LoadOptions, report: Report, of_bytes: bool) -> None:
    """``TerrainError`` where neighbours have nothing to do with each other beyond the noise of a survey."""
    if report.kind not in ("raster", "heights") or request.ground == "filter":
        return
    found = neighbour_statistics(heights.z)
    if found is None:
        return
    ratio, difference = found
    noise = difference * np.sqrt(np.pi) / 2.0  # of two values of the same normal distribution
    if ratio > (BYTES if of_bytes else UNRELATED):
        return
    if noise <= max(NOISE, NOISE_SHARE * heights.cell):
        spread = float(np.subtract(*np.percentile(heights.z[heights.known], [84.0, 16.0]))) / 2.0
        if noise > max(MUCH_NOISE, NOISE_SHARE * heights.cell) and spread < 1.2 * noise:
            report.warnings.append(
                f"neighbouring heights have nothing to do with each other: level ground under {noise:.2g} m of noise, or a"
                " picture"
            )
        return
    text = (
        f"neighbouring pixels have nothing to do with each other: they differ by {difference:.3g} m on average, those two"
        f" apart by {ratio * difference:.3g} m, so it is a picture or noise"
    )
    if report.kind == "heights":
        report.warnings.append(text.replace("pixels", "heights").replace("so it is", "as of"))
        return
    raise TerrainError(
        f"{report.source}: {text}; if they are heights, say z_units=... (--z-units), or ground='filter' where trees and"
        " buildings are left in"
    )


def _taken(found: ElevationModel, report: Report, unit: str, slope: float, reading: HeightsInUnit) -> ElevationModel:
    """``found`` in the only other unit that makes a ground."""
    report.change(
        "z_units",
        1,
        f"heights read as {reading.unit}: in {unit} half of the ground would be steeper than {slope:.0f}°, in"
        f" {reading.unit} than {reading.slope_deg:.1f}°, and no other unit makes a ground",
    )
    report.warnings.append(f"the unit of heights is recognised by their slope: {reading.unit}; z_units=... says it")
    report.units += f"; heights in {reading.unit} (recognised by their slope)"
    return found.with_heights_scaled(UNITS[reading.unit] / found.frame.z_scale)


def _note_doubt(report: Report, known: Known, unit: str, slope: float, others: list[HeightsInUnit]) -> None:
    """A warning where the unit makes a ground, but not one that is common."""
    silent = f"nothing is said of the unit of heights: {unit}"
    gentler = [reading for reading in others if reading.slope_deg < slope]
    if known == "assumed" and slope >= DOUBTFUL and gentler:
        report.warnings.append(
            f"{silent}, which makes half of the ground steeper than {slope:.0f}°; {_listed(gentler)} would be gentler:"
            " z_units=... says it"
        )
    likely = "km" if known == "assumed" else "m"  # a level ground in metres is common
    if 0.0 < slope < LEVEL and any(reading.unit == likely for reading in others):
        said = silent if known == "assumed" else f"heights are declared as {unit}"
        report.warnings.append(
            f"{said}, in which the ground is level (median slope {slope:.2g}°); {_listed(others)} would be steeper:"
            " z_units=... says it"
        )


def _other_reasons(report: Report, unit: str, of_bytes: bool) -> str:
    if report.kind == "mesh":
        return f"; or is another axis up (up=...)? z_units={unit!r} keeps it"
    if of_bytes:
        return "; its values are bytes, as those of a picture or a hillshade, which holds no heights"
    return f"; z_units={unit!r} if trees and buildings are left in"


def _listed(found: list[HeightsInUnit]) -> str:
    texts = [f"{reading.unit} ({reading.slope_deg:.2g}°)" for reading in found]
    return texts[0] if len(texts) == 1 else f"{', '.join(texts[:-1])} and {texts[-1]}"


def _short(name: str) -> str:
    found = unit_named(name)
    return name if found is None else found.name
