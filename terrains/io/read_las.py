"""LAS and LAZ: headers held against the file, coordinate system, classes and flags; points chunk by chunk.

Fields, offsets, classes and flags: LAS Specification 1.4 R15 (ASPRS). It fixes that z points up.
"""

from __future__ import annotations

import logging
import struct
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from aoro_gym.terrains.extras import import_extra
from aoro_gym.terrains.georeference import horizontal
from aoro_gym.terrains.io.check import Report, TerrainError
from aoro_gym.terrains.io.cloud_survey import Chunk, Cloud
from aoro_gym.terrains.io.elevation_model import ElevationModel
from aoro_gym.terrains.io.frame import LoadOptions
from aoro_gym.terrains.io.ground_filter import suppressed_output
from aoro_gym.terrains.io.laz_chunks import Points, check_chunks
from aoro_gym.terrains.io.read_cloud import CHUNK, Array, read_cloud, reading_errors
from aoro_gym.terrains.length_units import UNITS, LengthUnit

LENGTHS = (20, 28, 26, 34, 57, 63, 30, 36, 38, 59, 67)
"""Shortest record [bytes] of each point format."""
COMPRESSED = 0x80
"""Bit of the point format that marks LAZ."""
WKT, GEO_KEYS = 2112, 34735
"""Records of the coordinate system."""
LINEAR_UNITS, VERTICAL_UNITS = 3076, 4099
"""GeoTIFF keys of the units of the plan and of heights."""
KEY_UNITS = {9001: "m", 9002: "ft", 9003: "us-ft"}


@dataclass(frozen=True)
class Header:
    """What the head of a LAS file declares, as far as it is held against the file."""

    minor: int
    compressed: bool
    start: int
    """First byte of the points, and the one after the last."""
    end: int
    length: int
    """Of a record [bytes]."""
    count: int
    scales: Array
    """(3,) steps of the coordinates."""
    low: Array
    """(3,) bounds of the coordinates."""
    high: Array

    @property
    def held(self) -> int:
        """How many whole records the file has room for (uncompressed)."""
        return max(0, self.end - self.start) // self.length


def read_las(path: Path, request: LoadOptions, report: Report) -> ElevationModel:
    """A cloud of LAS or LAZ; noise and withheld points are left out."""
    laspy = import_extra("laspy", f"the point cloud {path.name}")
    import_extra("lazrs", f"the point cloud {path.name}")
    logging.getLogger("laspy").addHandler(logging.NullHandler())  # its errors are raised here, not printed
    with reading_errors(path, "a point cloud (LAS)"):
        head = _header(path)
        count = head.count if head.compressed else _count(path, head, report)
        with laspy.open(path) as file:
            if head.compressed:
                _check_chunks(path, head, file.header, report)
            system, unit, z_unit = _system(file.header, request, report)

    def chunks() -> Iterator[Chunk]:
        read = 0
        with reading_errors(path, "a point cloud (LAS)"), laspy.open(path) as file:
            file.header.point_count = count
            parts = file.chunk_iterator(CHUNK)
            while True:
                with suppressed_output(2):  # lazrs tells of its panics there
                    points = next(parts, None)
                if points is None or not len(points):
                    break
                read += len(points)
                yield _chunk(points)
        if read < count:
            raise TerrainError(f"{path}: {read:,} of {count:,} points, so it is cut off; get it again")

    bounds = head.low, head.high
    cloud = Cloud(count, chunks, up="z", crs=system, unit=unit, z_unit=z_unit, steps=head.scales, bounds=bounds)
    return read_cloud(cloud, request, report)


def _chunk(points: Any) -> Chunk:
    with np.errstate(over="ignore"):  # what is infinite is left out, and counted
        xyz = np.stack([points.x, points.y, points.z], axis=1)
    classes = np.asarray(points.classification, dtype=np.uint8)
    flags = {
        name: np.asarray(getattr(points, name, np.zeros(len(xyz))), dtype=bool) for name in ("withheld", "synthetic")
    }
    flags["overlap"] = np.asarray(points.overlap, dtype=bool) if hasattr(points, "overlap") else classes == 12
    return Chunk(xyz, classes, flags)


def _header(path: Path) -> Header:
    """The header; ``TerrainError`` where it cannot be true. laspy would look for what is not there for hours."""
    size = path.stat().st_size
    with path.open("rb") as file:
        head = file.read(375)
    if len(head) < 227 or head[:4] != b"LASF":
        raise TerrainError(f"{path}: it does not begin as a point cloud (LAS) does")
    minor, point_format = head[25], head[104]
    start, records, length, count = struct.unpack_from("<II", head, 96) + struct.unpack_from("<HI", head, 105)
    end = size
    if minor >= 4 and len(head) >= 255:
        first, extended, wide = struct.unpack_from("<QIQ", head, 235)
        count = max(count, wide)
        if extended and first + 60 * extended > size:
            raise TerrainError(
                f"{path}: its header promises {extended:,} extended records, but it is cut off or broken"
            )
        end = first if extended and first >= start else size
    if start > size or 54 * records > size:
        raise TerrainError(
            f"{path}: its header declares {records:,} records and {count:,} points from byte {start:,} on, but it holds"
            f" {size:,} bytes, so it is cut off or broken; get it again"
        )
    known = point_format & 0x3F
    if known < len(LENGTHS) and length < LENGTHS[known]:
        raise TerrainError(
            f"{path}: its header gives a point of format {known} {length} bytes, but it takes {LENGTHS[known]}"
        )
    numbers = np.array(struct.unpack_from("<12d", head, 131))
    scales, bounds = numbers[:3], numbers[6:].reshape(3, 2)
    for axis, scale, offset in zip("xyz", scales, numbers[3:6], strict=True):
        if not (np.isfinite(scale) and scale > 0.0 and np.isfinite(offset)):
            raise TerrainError(
                f"{path}: its header scales {axis} by {scale:g} from {offset:g} on; a scale is positive, and both finite"
            )
    compressed = bool(point_format & COMPRESSED)
    return Header(minor, compressed, start, end, max(length, 1), count, scales, bounds[:, 1], bounds[:, 0])


def _count(path: Path, head: Header, report: Report) -> int:
    """How many points to read of an uncompressed file: its header's number unless the records say otherwise."""
    held, rest = head.held, (head.end - head.start) % head.length
    if head.count > held:
        if rest or not held:
            raise TerrainError(f"{path}: {held:,} of {head.count:,} points, so it is cut off or broken; get it again")
        report.warnings.append(
            f"the header declares {head.count:,} points, but the file ends after {held:,}, which are read; if it was cut"
            " off, get it again"
        )
        return held
    if not rest and held == head.count:
        return held
    if rest or _is_blank(path, head):
        report.warnings.append(
            f"{head.end - head.start - head.count * head.length:,} bytes after the {head.count:,} points that the header"
            " declares are not read"
        )
        return head.count
    text = f"the header declares {head.count:,} points, but the file holds {held:,}: all are read"
    report.change("point_count", held, text)
    return held


def _is_blank(path: Path, head: Header) -> bool:
    """Whether nothing but zeros follows the points that the header declares."""
    with path.open("rb") as file:
        file.seek(head.start + head.count * head.length)
        left = head.end - file.tell()
        while left > 0:
            block = file.read(min(left, 1 << 20))
            if not block or block.count(0) != len(block):
                return False
            left -= len(block)
    return True


def _check_chunks(path: Path, head: Header, header: Any, report: Report) -> None:
    records = header.vlrs.get("LasZipVlr")
    if not records:
        raise TerrainError(f"{path}: its points are compressed, but no record says how, so it is broken; get it again")
    with suppressed_output(2):  # lazrs tells of its panics there
        check_chunks(Points(path, head.start, head.count, head.length), records[0].record_data, report)


def _system(header: Any, request: LoadOptions, report: Report) -> tuple[str | None, str | None, LengthUnit | None]:
    """Coordinate system that the records tell (WKT before GeoTIFF keys), and units of the plan and of heights beside it.

    What is broken, or no place on Earth, is a warning: the points can be read without.
    """
    records = [*header.vlrs, *(header.evlrs or [])]
    records = [record for record in records if record.user_id == "LASF_Projection"]
    records = sorted((r for r in records if r.record_id in (WKT, GEO_KEYS)), key=lambda r: r.record_id)
    keys = {key.id: key.value_offset for r in records for key in getattr(r, "geo_keys", ())}
    unit, height = (KEY_UNITS.get(keys.get(key, 0)) for key in (LINEAR_UNITS, VERTICAL_UNITS))
    system, faults = None, []
    for record in records:
        name = "WKT" if record.record_id == WKT else "GeoTIFF keys"
        try:
            found = _parsed(record)
        except Exception as error:  # whatever pyproj finds wrong with it
            faults.append(f"its record of the coordinate system ({name}) is broken: {_short(error)}")
            continue
        if found is None:
            continue
        if found.is_geocentric and request.crs is None:
            raise TerrainError(
                f"{report.source}: its coordinates are geocentric ({found.name}), so no axis points up; convert it to a"
                " projected system first"
            )
        try:
            horizontal(found.to_wkt())
        except Exception:  # local, or of another planet
            faults.append(f"its record of the coordinate system ({name}) is {found.name!r}, which is no place on Earth")
            unit = unit or _unit_of(found)
            continue
        system = system or found
    if system is None and not faults and GEO_KEYS in [r.record_id for r in records]:
        faults.append("its GeoTIFF keys name no coordinate system by its EPSG code")
    if faults and request.crs is None:
        rest = f"{system.name} is taken from the other record" if system is not None else "its crs is unknown"
        report.warnings.append(f"{'; '.join(faults)}; {rest}; crs='EPSG:...' (--crs) says it")
    return (
        (None if system is None else system.to_wkt()),
        unit,
        None if height is None else LengthUnit(height, UNITS[height]),
    )


def _parsed(record: Any) -> Any:
    """A record's ``pyproj.CRS``, or None where it names none; raises whatever is wrong with it."""
    parse = getattr(record, "parse_crs", None)
    if parse is None:  # laspy itself could not take it apart
        raise ValueError("it cannot be decoded")
    return parse()


def _short(error: Exception) -> str:
    """The first words of what a library says, without the content that it repeats."""
    text = " ".join(str(error).split()) or type(error).__name__
    return text if len(text) <= 80 else text[:77] + "..."


def _unit_of(system: Any) -> str | None:
    """Name of the unit of a local system's axes, if it is one of ours."""
    factor = float(system.axis_info[0].unit_conversion_factor) if system.axis_info else 0.0
    return next((name for name, size in UNITS.items() if np.isclose(size, factor, rtol=1e-7)), None)
