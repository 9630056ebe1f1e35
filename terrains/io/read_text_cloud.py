"""Point clouds as text (XYZ, CSV, PTS, TXT) in whatever dialect: columns by their names, in the units these carry."""

from __future__ import annotations

import itertools
import re
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from aoro_gym.recording.cells import THOUSANDS, is_number, listed
from aoro_gym.recording.dialects import Dialect, number_rows, sniff_file
from aoro_gym.recording.units import NamedQuantity, parse_name
from aoro_gym.terrains.georeference import GEOGRAPHIC, horizontal
from aoro_gym.terrains.io.check import Report, TerrainError
from aoro_gym.terrains.io.cloud_survey import Chunk, Cloud
from aoro_gym.terrains.io.elevation_model import ElevationModel
from aoro_gym.terrains.io.frame import LoadOptions
from aoro_gym.terrains.io.read_cloud import CHUNK, read_cloud, reading_errors
from aoro_gym.terrains.length_units import UNITS, LengthUnit
from aoro_gym.units import DEGREE

PLACE = r"(?:gps|gnss|utm|rtk|world|global|local|point|pos|position|coord|coordinate|centre|center|ground|mean)"
AFTER = r"(?:coord|coordinate|coordinates|koordinate|pos|position|value|wert|utm|wgs84|local|global|world)"
NAMES = {
    role: re.compile(rf"(?:{PLACE}_)?(?:{words})(?:_{AFTER})?", re.IGNORECASE)
    for role, words in {
        "x": r"x|e|east|easting|eastings|ost|ostwert|rechts|rechtswert|rw|est",
        "y": r"y|n|north|northing|northings|nord|nordwert|hoch|hochwert|hw",
        "z": r"z|h|hgt|height|elev|elevation|alt|altitude|hoehe|höhe|hohe|kote|level|rl|msl|up|"
        r"(?:ellipsoidal|orthometric|geoid|ellips?|ortho|antenna|terrain|surface|dem|dtm)_(?:h|hgt|height|elevation)|"
        r"(?:height|elevation|altitude)_(?:msl|asl|amsl|ellipsoidal|orthometric|above_sea_level)",
        "latitude": r"lat|latitude|breite|breitengrad|geographische_breite",
        "longitude": r"lon|lng|long|longitude|länge|laenge|längengrad|laengengrad|geographische_länge",
        "class": r"class|classification|klasse|scalar_classification|las_class|point_class",
    }.items()
}
"""Names of columns in canonical form, by what they hold."""
SURE = re.compile(r"x|y|z|easting|northing|elevation|height|latitude|longitude", re.IGNORECASE)
"""Those that win where several columns hold the same."""
COUNT_LINE = re.compile(r"\s*[0-9]{1,15}\s*")
NUMBERED = 20
"""Rows from which whole numbers one after another are points' numbers, not a coordinate."""


@dataclass(frozen=True)
class Layout:
    """Which columns hold what."""

    columns: tuple[int, int, int]
    """Indices of x (or longitude), y (or latitude) and height."""
    classes: int | None = None
    scales: tuple[float, float, float] = (1.0, 1.0, 1.0)
    """Of each column, to bring the plan to one unit and degrees to degrees."""
    up: str | None = None
    is_geographic: bool = False
    unit: str | None = None
    """Of the plan, where the names tell it."""
    z_unit: LengthUnit | None = None


def read_text(path: Path, request: LoadOptions, report: Report) -> ElevationModel:
    """A cloud of lines with x, y and z; by the names of its columns, or else its first three numbers."""
    with reading_errors(path, "lines of x, y, z"):
        dialect = sniff_file(path)
        layout = _find_layout(path, dialect, report)
    crs = None
    if layout.is_geographic:
        crs = _geographic(path, request, report)

    def chunks() -> Iterator[Chunk]:
        wanted = (*layout.columns, *(() if layout.classes is None else (layout.classes,)))
        for values in _numbers(path, dialect, wanted, report):
            classes = None if layout.classes is None else _classes(values[:, 3])
            yield Chunk(values[:, :3] * layout.scales if layout.scales != (1.0, 1.0, 1.0) else values[:, :3], classes)

    cloud = Cloud(dialect.count or 0, chunks, up=layout.up, crs=crs, unit=layout.unit, z_unit=layout.z_unit)
    return read_cloud(cloud, request, report)


def _numbers(path: Path, dialect: Dialect, columns: tuple[int, ...], report: Report) -> Iterator[NDArray[np.float64]]:
    """(n, C) numbers of the file's rows, some at a time; as many as are declared."""
    declared, found, number = dialect.count, 0, dialect.skip + 1
    with reading_errors(path, "lines of x, y, z"), path.open(encoding=dialect.encoding, errors="replace") as file:
        for _ in range(dialect.skip):
            next(file, None)
        while lines := list(itertools.islice(file, CHUNK)):
            if declared is not None and dialect.columns > 1:  # another station of a scanner begins with its own number
                for index, line in enumerate(lines):
                    if COUNT_LINE.fullmatch(line):
                        declared, lines[index] = declared + int(line), "\n"
            values = number_rows(lines, dialect, columns, where=str(path), first_line=number)
            number += len(lines)
            found += len(values)
            if len(values):
                yield values
    if declared is None or found == declared:
        return
    if found < declared:
        raise TerrainError(
            f"{path}: it declares {declared:,} points, but {found:,} follow; it is cut off, get it again"
        )
    more = f"it declares {declared:,} points, but {found:,} follow: all are read"
    if more not in report.warnings:
        report.warnings.append(more)


def _classes(values: NDArray[np.float64]) -> NDArray[np.uint8]:
    """Classes, 0 (never classified) where none is said."""
    return np.where((values >= 0.0) & (values <= 255.0), np.nan_to_num(values), 0.0).astype(np.uint8)


def _geographic(path: Path, request: LoadOptions, report: Report) -> str | None:
    """The system of latitude and longitude; None if the caller said it."""
    if request.crs is None:
        text = (
            f"latitude and longitude taken as WGS 84 ({GEOGRAPHIC}), as nothing is said of them; crs=... (--crs) says"
            " otherwise"
        )
        report.change("crs", 1, text)
        return GEOGRAPHIC
    if not horizontal(request.crs).is_geographic:
        raise TerrainError(
            f"{path}: its columns are latitude and longitude, but crs = {request.crs[:60]!r} counts in metres; leave crs"
            " away, or give that of the degrees"
        )
    return None


def _find_layout(path: Path, dialect: Dialect, report: Report) -> Layout:
    """Columns by the header; without one, the first three numbers of a row."""
    sample = _sample(path, dialect)
    if any(mark in line for line in _first_lines(path, dialect) for mark in "\u00a0\u202f"):
        _refuse_thousands(path, dialect)
    if not sample:
        names = f"; its first line names {listed(dialect.names)}" if dialect.names else ""
        raise TerrainError(f"{path}: no line of numbers x, y, z among the first 200{names}")
    # A word here and there is a fault, named with its line when it is met; a column of words is none of numbers.
    numeric = [i for i in range(dialect.columns) if 2 * sum(_may_be_number(row, i) for row in sample) > len(sample)]
    if dialect.names:
        layout = _columns_by_name(path, dialect, numeric, report)
        if layout is not None:
            return layout
        if not dialect.is_header_comment:
            raise TerrainError(
                f"{path}: its columns are named {listed(dialect.names)}, which are not x, y and z (easting, northing and"
                " elevation; latitude, longitude and height); name them so, or take the header away if the first three are"
                " x, y, z"
            )
    return _by_position(path, dialect, numeric, sample, report)


def _sample(path: Path, dialect: Dialect) -> list[list[str]]:
    """Cells of the first rows."""
    lines = [line.strip() for line in _first_lines(path, dialect)]
    rows = [line for line in lines if line and not line.startswith(("#", "//", "%")) and not COUNT_LINE.fullmatch(line)]
    cells = [row.split(dialect.separator) for row in rows]
    cells = [[cell.strip().strip('"') for cell in row] for row in cells]
    return [row for row in cells if sum(map(is_number, row)) > 0]


def _first_lines(path: Path, dialect: Dialect) -> list[str]:
    with path.open(encoding=dialect.encoding, errors="replace") as file:
        return list(itertools.islice(file, dialect.skip, dialect.skip + 200))


def _may_be_number(cells: list[str], index: int) -> bool:
    return index >= len(cells) or not cells[index] or is_number(cells[index])


def _columns_by_name(path: Path, dialect: Dialect, numeric: list[int], report: Report) -> Layout | None:
    """Columns by their names; None if these are not of places."""
    found: dict[str, list[tuple[int, NamedQuantity]]] = {role: [] for role in NAMES}
    for index, name in enumerate(dialect.names):
        for role, pattern in NAMES.items():
            quantity = parse_name(name, pattern, "angle" if role in ("latitude", "longitude") else "length")
            if quantity is not None:
                found[role].append((index, quantity))
                break
    chosen = {role: _best_column(candidates, numeric) for role, candidates in found.items() if candidates}
    is_geographic = not {"x", "y"} <= set(chosen) and {"latitude", "longitude"} <= set(chosen)
    roles = ("longitude", "latitude", "z") if is_geographic else ("x", "y", "z")
    if not set(roles) <= set(chosen):
        return None
    if len(dialect.names) != dialect.columns and [chosen[role][0] for role in roles] != [0, 1, 2]:
        raise TerrainError(
            f"{path}: {len(dialect.names)} columns are named ({listed(dialect.names)}), but its rows have"
            f" {dialect.columns} values"
        )
    for role in roles:
        others = [dialect.names[index] for index, _ in found[role] if index != chosen[role][0]]
        if others:
            text = f"{role} is read from column {dialect.names[chosen[role][0]]}, not from {listed(others)}"
            report.change("columns", len(others), text)
    classes = chosen.get("class")
    if classes is not None and classes[0] not in numeric:
        classes = None
    used = {chosen[role][0] for role in roles} | ({classes[0]} if classes is not None else set())
    _note_unread(report, [name or f"column {i + 1}" for i, name in enumerate(dialect.names) if i not in used])
    layout = _with_units(path, dialect, [chosen[role] for role in roles], is_geographic)
    named = chosen[roles[2]][1].base != "z" or is_geographic
    return replace(layout, classes=None if classes is None else classes[0], up="z" if named else None)


def _best_column(candidates: list[tuple[int, NamedQuantity]], numeric: list[int]) -> tuple[int, NamedQuantity]:
    """The column that holds numbers and has the plainest name."""
    return min(candidates, key=lambda item: (item[0] not in numeric, SURE.fullmatch(item[1].base) is None, item[0]))


def _with_units(path: Path, dialect: Dialect, chosen: list[tuple[int, NamedQuantity]], is_geographic: bool) -> Layout:
    """The layout of the three chosen columns, by the units that their names carry."""
    for index, quantity in chosen:
        if quantity.is_unknown:
            raise TerrainError(
                f"{path}: column {dialect.names[index][:40]!r} has the unit {quantity.unit_text[:20]!r}, which is unknown"
                f" for it; known are {', '.join(UNITS)}, and deg for latitude and longitude"
            )
    units = [quantity.unit for _, quantity in chosen]
    first, second, third = (None if unit is None else unit.factor for unit in units)
    columns = (chosen[0][0], chosen[1][0], chosen[2][0])
    z_unit = None if third is None else LengthUnit(_short(third), third)
    if is_geographic:
        scales = tuple(1.0 if factor is None else factor / DEGREE for factor in (first, second))
        return Layout(columns, scales=(scales[0], scales[1], 1.0), is_geographic=True, z_unit=z_unit)
    if first is None and second is None:
        return Layout(columns, z_unit=z_unit)
    first, second = first or second or 1.0, second or first or 1.0
    if first == second and _short(first) in UNITS:
        return Layout(columns, unit=_short(first), z_unit=z_unit)
    return Layout(columns, scales=(first, second, 1.0), unit="m", z_unit=z_unit or LengthUnit("m", 1.0))


def _short(metres: float) -> str:
    """Name of a unit of length."""
    return next((name for name, size in UNITS.items() if np.isclose(size, metres, rtol=1e-9)), f"{metres:g} m")


def _refuse_thousands(path: Path, dialect: Dialect) -> None:
    """``TerrainError`` that says so, where a row holds numbers with separators of thousands."""
    for line in _first_lines(path, dialect):
        if len(found := THOUSANDS.findall(line)) > 1:
            raise TerrainError(
                f"{path}: its numbers have separators of thousands ({found[0][:30]!r}); write it without them"
            )


def _by_position(path: Path, dialect: Dialect, numeric: list[int], sample: list[list[str]], report: Report) -> Layout:
    """The first three columns of numbers, after one that counts the points."""
    if len(numeric) < 3:
        _refuse_thousands(path, dialect)
        raise TerrainError(f"{path}, line {dialect.skip + 1}: {len(numeric)} numbers in a row; a point has x, y and z")
    if len(numeric) > 3 and _counts(path, dialect, numeric[0], sample, report):
        report.change("columns", 1, f"column {numeric[0] + 1} counts the points, so x, y and z are read after it")
        numeric = numeric[1:]
    columns = (numeric[0], numeric[1], numeric[2])
    if dialect.columns > 3:
        told = ", ".join(str(column + 1) for column in columns)
        report.change("columns", 1, f"no header: columns {told} are read as x, y and z")
        _note_unread(report, [f"column {i + 1}" for i in range(dialect.columns) if i not in columns])
    return Layout(columns)


def _counts(path: Path, dialect: Dialect, column: int, sample: list[list[str]], report: Report) -> bool:
    """Whether a column of whole numbers rises by one from row to row, in all of the file."""
    first = [cells[column] for cells in sample if column < len(cells)]
    if len(first) < NUMBERED or not all(re.fullmatch(r"[0-9]{1,15}", cell) for cell in first):
        return False
    last: float | None = None
    for values in _numbers(path, dialect, (column,), report):
        numbers = values[:, 0] if last is None else np.concatenate([[last], values[:, 0]])
        if not np.all(np.diff(numbers) == 1.0):
            return False
        last = float(values[-1, 0])
    return True


def _note_unread(report: Report, names: list[str]) -> None:
    report.change("unread_columns", len(names), f"columns not read: {listed(names)}")
