"""Which band of a raster holds heights, what it declares of them, and its values with what is unknown left out."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from aoro_gym.recording.units import parse_name
from aoro_gym.terrains.io.check import Report, TerrainError
from aoro_gym.terrains.io.frame import LoadOptions
from aoro_gym.terrains.io.masking import NodataValues, equals_value, find_nodata, report_nodata
from aoro_gym.terrains.length_units import LengthUnit, is_unspecified, listed, unit_named

HEIGHTS = frozenset(
    re.findall(
        r"\w+",
        """
    elevation elevations elev dem dtm dsm dgm dom dhm mnt mns height heights altitude alt z hoehe hoehen hohe
    bathymetry topography terrain ground surface relief ndsm depth
""",
    )
)
"""Words in the description of a band of heights."""
OTHERS = frozenset(
    re.findall(
        r"\w+",
        """
    uncertainty error err sigma std stddev variance accuracy confidence quality count counts density number
    mask valid validity alpha intensity amplitude slope aspect hillshade curvature roughness class
    classification id red green blue nir weight coherence
""",
    )
)
"""Words in the description of a band that tells something else of the same place."""
_HEIGHT_NAME = re.compile(rf"(?:{'|'.join(HEIGHTS)})(?:_(?:{'|'.join(HEIGHTS)}|model|above_sea_level))*")
COLOURS = frozenset(("red", "green", "blue", "cyan", "magenta", "yellow", "black", "hue", "saturation", "lightness"))
STRIP = 4_000_000
"""Pixels that are read in one go, about."""
SAMPLE = 2_000_000
"""Pixels by which undeclared marks are told, at most."""

Array = NDArray[np.float64]


@dataclass
class Band:
    """Heights of one band."""

    data: Any
    number: int
    alpha: tuple[int, ...]
    """Bands that are 0 where this one is unknown."""
    nodata: tuple[float, ...] | None
    """What the caller says means unknown; None: undeclared marks are recognised."""
    unit: LengthUnit | None
    """As the band declares it."""
    marks: NodataValues = field(default_factory=NodataValues)
    declared_unknown: int = 0
    known: tuple[float, float] = (np.inf, -np.inf)
    """Least and largest raw value that is known, of those read."""
    beyond: int = 0
    counts: dict[float, int] = field(default_factory=dict)

    @property
    def of_bytes(self) -> bool:
        """Whether its values are whole numbers of one byte."""
        return np.dtype(self.data.dtypes[self.number - 1]).itemsize == 1

    @property
    def limits(self) -> tuple[float, float] | None:
        """Least and largest value of its number format, where that is of whole numbers."""
        dtype = np.dtype(self.data.dtypes[self.number - 1])
        return (float(np.iinfo(dtype).min), float(np.iinfo(dtype).max)) if dtype.kind in "iu" else None

    def heights(self, raw: Array) -> Array:
        """Raw values in the band's unit."""
        return raw * self.data.scales[self.number - 1] + self.data.offsets[self.number - 1]

    def recognise(self, window: Any, metre: float) -> None:
        """Find the undeclared marks of "unknown" in ``window``; the caller's word ends that."""
        if self.nodata is not None:
            return
        thin = max(1, int(np.ceil(np.sqrt(window.width * window.height / SAMPLE))))
        shape = (max(2, int(window.height) // thin), max(2, int(window.width) // thin))
        sample = self._declared(window, shape)[0]
        self.marks = find_nodata(sample, metre * abs(self.data.scales[self.number - 1]), self.limits)

    def read(self, window: Any, block: int = 1) -> Array:
        """Means of blocks of ``block`` x ``block`` raw values, row 0 first in the file; NaN where none is known."""
        from rasterio.windows import Window

        columns, rows = int(window.width), int(window.height)
        down = max(1, STRIP // max(columns * block, 1)) * block
        parts = []
        for start in range(0, rows, down):
            height = min(down, rows - start)
            strip: Any = Window(window.col_off, window.row_off + start, columns, height)  # pyright: ignore[reportCallIssue]
            z, unknown = self._declared(strip, None)
            self.declared_unknown += int(unknown.sum())
            self._leave_out(z, ~unknown)
            if np.isfinite(z).any():
                self.known = min(self.known[0], float(np.nanmin(z))), max(self.known[1], float(np.nanmax(z)))
            parts.append(_block_means(z, block))
        return np.concatenate(parts)

    def note(self, report: Report, total: int) -> None:
        """Say how many of the ``total`` pixels read were unknown, and why; ``TerrainError`` where all were."""
        names = [text for text in (self._nodata_text(), "alpha 0" if self.alpha else "") if text]
        report.change(
            "unknown",
            self.declared_unknown,
            f"{self.declared_unknown:,} heights unknown ({' or '.join(names) or 'masked'})",
        )
        report_nodata(self.marks, self.counts, self.beyond, report)
        mark = self.data.nodata
        if self.declared_unknown and mark is not None and self.known[0] < mark < self.known[1]:
            report.warnings.append(
                f"{self.declared_unknown:,} heights are unknown, as the file declares {mark:.10g} to mean that, but others"
                f" lie below and above it, from {self.known[0]:.6g} to {self.known[1]:.6g}; if they are heights, take the"
                " mark out of the file (gdal_edit.py -unsetnodata)"
            )
        left_out = sum(self.counts.get(value, 0) for value in self.marks.values)
        if self.declared_unknown + self.beyond + left_out >= total:
            raise TerrainError(f"{report.source}: none of its {total:,} heights is known; there is no ground in it")

    def _nodata_text(self) -> str:
        values = [*(() if self.data.nodata is None else (self.data.nodata,)), *(self.nodata or ())]
        return f"nodata {', '.join(f'{value:.10g}' for value in dict.fromkeys(values))}" if values else ""

    def _declared(self, window: Any, shape: tuple[int, int] | None) -> tuple[Array, NDArray[np.bool_]]:
        """Values with NaN where they are declared to be unknown, and where that is."""
        more: dict[str, Any] = {"window": window} if shape is None else {"window": window, "out_shape": shape}
        z = self.data.read(self.number, out_dtype="float64", **more)
        unknown = np.isnan(z)
        if "all_valid" not in {flag.name for flag in self.data.mask_flag_enums[self.number - 1]}:
            unknown |= self.data.read_masks(self.number, **more) == 0
        for alpha in self.alpha:
            unknown |= self.data.read(alpha, **more) == 0
        for value in self.nodata or ():
            unknown |= equals_value(z, value)
        z[unknown] = np.nan
        return z, unknown

    def _leave_out(self, z: Array, known: NDArray[np.bool_]) -> None:
        """Set and count what undeclared marks take."""
        for value in self.marks.values:
            here = equals_value(z, value)
            self.counts[value] = self.counts.get(value, 0) + int(here.sum())
            z[here] = np.nan
            known = known & ~here
        for value in dict(self.marks.suspects):
            self.counts[value] = self.counts.get(value, 0) + int(equals_value(z, value).sum())
        beyond = known & self.marks.unknown(z)
        self.beyond += int(beyond.sum())
        z[beyond] = np.nan


def choose_band(data: Any, request: LoadOptions, report: Report) -> Band:
    """The band of heights: as asked, the only one, or the one described so; the rest are named."""
    if data.count < 1:
        raise TerrainError(f"{report.source}: it has no band at all")
    interpretations = [colour.name for colour in data.colorinterp]
    alpha = tuple(
        number
        for number, name in enumerate(interpretations, 1)
        if name == "alpha" or (data.count > 1 and "alpha" in _words(data.descriptions[number - 1]))
    )
    number = _asked(data, request, report) if request.band is not None else _found(data, interpretations, alpha, report)
    if np.dtype(data.dtypes[number - 1]).kind == "c":
        raise TerrainError(f"{report.source}: its values are complex numbers, not heights")
    scale, offset = data.scales[number - 1], data.offsets[number - 1]
    if not (np.isfinite(scale) and np.isfinite(offset) and scale != 0.0):
        raise TerrainError(
            f"{report.source}: band {number} has the scale {scale:g} and the offset {offset:g}; it is broken"
        )
    unit = None if request.z_units is not None else _declared_unit(data, number, report)
    return Band(data, number, tuple(n for n in alpha if n != number), request.nodata, unit)


def _asked(data: Any, request: LoadOptions, report: Report) -> int:
    assert request.band is not None
    if request.band > data.count:
        raise TerrainError(f"{report.source}: band = {request.band}, but it has {_listed(data)}")
    if data.count > 1:
        report.change("band", 1, f"band {request.band} taken as asked, of {_listed(data)}")
    return request.band


def _found(data: Any, interpretations: list[str], alpha: tuple[int, ...], report: Report) -> int:
    candidates = [number for number in range(1, data.count + 1) if number not in alpha]
    ask = "band=... (--band) takes one as heights"
    if not candidates:
        raise TerrainError(f"{report.source}: it has {_listed(data)}, none of heights; {ask}")
    if len(candidates) == 1:
        if interpretations[candidates[0] - 1] == "palette":
            raise TerrainError(f"{report.source}: it is a picture or a map of classes, whose values are colours; {ask}")
        return candidates[0]
    described = {number: _words(data.descriptions[number - 1]) for number in candidates}
    heights = [number for number, words in described.items() if words & HEIGHTS and not words & OTHERS]
    if not heights:
        heights = [number for number, words in described.items() if not words & OTHERS]
        coloured = any(interpretations[number - 1] in COLOURS for number in candidates)
        if coloured or len(heights) != 1:
            picture = " so it is a picture;" if coloured or all(np.dtype(t).itemsize == 1 for t in data.dtypes) else ""
            raise TerrainError(f"{report.source}: it has {_listed(data)},{picture} none is described as heights; {ask}")
    if len(heights) > 1:
        raise TerrainError(f"{report.source}: several of its bands may be heights, of {_listed(data)}; {ask}")
    report.change("band", 1, f"band {heights[0]} taken, of {_listed(data)}")
    return heights[0]


def _words(description: str | None) -> set[str]:
    text = re.sub(r"(?<=[a-z])(?=[A-Z])", " ", description or "").casefold()
    return set(re.findall(r"[a-z]+", text.replace("ö", "oe")))


def _listed(data: Any) -> str:
    """The bands, for a message."""
    texts = []
    for number in range(1, min(data.count, 8) + 1):
        name = (data.descriptions[number - 1] or data.colorinterp[number - 1].name)[:40]
        texts.append(f"{number} '{name}' ({data.dtypes[number - 1]})")
    more = f" and {data.count - 8} more" if data.count > 8 else ""
    return f"{data.count} bands: {', '.join(texts)}{more}" if data.count > 1 else f"1 band: {texts[0]}"


def _declared_unit(data: Any, number: int, report: Report) -> LengthUnit | None:
    """The unit that the band declares; ``TerrainError`` where nobody knows its name."""
    tags = {key.casefold(): value for key, value in data.tags(number).items()}
    said = data.units[number - 1] or tags.get("units") or tags.get("unit") or tags.get("unittype") or ""
    if is_unspecified(said):
        return _unit_in_metadata(data, number, report)
    found = unit_named(said)
    if found is None:
        raise TerrainError(
            f"{report.source}: its heights are declared in {said[:40]!r}, which is no unit of length known here; say"
            f" z_units=... (--z-units): {listed()}"
        )
    return found


def _block_means(z: Array, block: int) -> Array:
    """Means of blocks of what is known."""
    if block == 1:
        return z
    rows, columns = (-(-n // block) for n in z.shape)
    z = np.pad(z, ((0, rows * block - z.shape[0]), (0, columns * block - z.shape[1])), constant_values=np.nan)
    z = z.reshape(rows, block, columns, block)
    known = np.isfinite(z)
    count = known.sum(axis=(1, 3))
    total = np.where(known, z, 0.0).sum(axis=(1, 3))
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)


def _unit_in_metadata(data: Any, number: int, report: Report) -> LengthUnit | None:
    """The unit that the description of the band (``elevation (dm)``, ``dtm_cm``) or a tag of heights tells, if any does."""
    described = parse_name(data.descriptions[number - 1] or "", _HEIGHT_NAME, "length")
    tags = {re.sub(r"[\W_]+", "", key.casefold()): value for key, value in {**data.tags(), **data.tags(number)}.items()}
    told = [("description", described.unit_text if described is not None and described.unit is not None else "")]
    told += [
        (f"tag {key}", tags.get(key, ""))
        for key in (
            "verticalunits",
            "verticalunit",
            "zunits",
            "zunit",
            "heightunits",
            "elevationunits",
            "units",
            "unit",
        )
    ]
    for where, text in told:
        found = unit_named(text)
        if found is not None:
            report.change("z_units", 1, f"heights in {found.name}, as its {where} says")
            return found
    return None
