"""Reader of paths in tables: columns by header, with their units; two columns without a header are x and y [m]."""

from __future__ import annotations

import re
from pathlib import Path as File

import numpy as np

from aoro_gym.recording.cells import listed
from aoro_gym.recording.dialects import Dialect, number_rows, sniff_file
from aoro_gym.recording.tables import Table, read_table
from aoro_gym.recording.units import NamedQuantity, parse_name
from aoro_gym.terrains.paths.read_tracks import read_document
from aoro_gym.terrains.paths.tracks import Track, TrackFile, display_text
from aoro_gym.terrains.paths.xml_tree import looks_like_xml
from aoro_gym.units import DEGREE

MOST_POINTS = 1_000_000
"""Rows of a table: a day at 20 Hz."""
NARROWEST = 0.5
"""Extent of two columns without a header below which they are degrees rather than metres."""

_PLACE = r"(?:(?:gps|rtk|gnss|local|true|map|world|utm|vehicle)_)?(?:(?:position|pos)_)?"
ROLES: dict[str, tuple[re.Pattern[str], str]] = {
    "latitude": (re.compile(_PLACE + r"(?:lat(?:itude)?(?:_wgs_?84)?|(?:geographische_)?breite(?:ngrad)?)"), "angle"),
    "longitude": (
        re.compile(_PLACE + r"(?:(?:lon|lng|long|longitude)(?:_wgs_?84)?|(?:geographische_)?l(?:ä|ae)nge(?:ngrad)?)"),
        "angle",
    ),
    "x": (re.compile(_PLACE + r"(?:x(?:_coord(?:inate)?)?|e|east(?:ing)?|ostwert|rechtswert)"), "length"),
    "y": (re.compile(_PLACE + r"(?:y(?:_coord(?:inate)?)?|n|north(?:ing)?|nordwert|hochwert)"), "length"),
    "speed": (
        re.compile(
            r"(?:(?:target|reference|ref|desired|set|gps|gnss|rtk|ground|vehicle|driving|drive|travel|forward)_)*"
            r"(?:speed|velocity|vel|v|sog|speed_over_ground|geschwindigkeit|fahrgeschwindigkeit|vitesse)"
        ),
        "speed",
    ),
}
"""Names of columns (words joined by underscores, without their unit) and what they measure."""
WANTED = re.compile(r"(?:target|reference|ref|desired|set)_.*")
"""Speeds that are to be driven, rather than those that were."""
PAIRS = (("latitude", "longitude"), ("x", "y"))
_COUNTERPART = {
    "lat": "lon lng long",
    "latitude": "longitude",
    "x": "y",
    "e": "n",
    "east": "north",
    "easting": "northing",
    "ostwert": "nordwert",
    "rechtswert": "hochwert",
}


def read_table_of_places(file: File) -> TrackFile:
    """The line in a table: ``latitude`` and ``longitude``, or ``x`` and ``y``, and ``speed`` if there is one.

    Raises ``ValueError`` in one sentence without the file's name; ``OSError`` if it cannot be opened.
    """
    with file.open("rb") as opened:
        start = opened.read(200)
    if not start.strip():
        raise ValueError("it has no lines")
    if looks_like_xml(start):
        return read_document(file)
    try:
        dialect = sniff_file(file)
        table = read_table(file) if dialect.names else None
        roles = {} if table is None else _roles(table)
        complete = any(set(pair) <= roles.keys() for pair in PAIRS)
        if table is None or (dialect.is_header_comment and not complete):
            return _read_bare(file, dialect)
        if not complete:
            raise ValueError(
                f"its header is {listed(table.names)}, but must name latitude and longitude [deg], or x and y [m]"
            )
        return _read_named(table, roles)
    except ValueError as error:
        raise ValueError(re.sub(rf"^{re.escape(str(file))}[:,]? ?", "", str(error))) from None


def _roles(table: Table) -> dict[str, list[tuple[str, NamedQuantity]]]:
    """Columns that each role could have, in the file's order."""
    found: dict[str, list[tuple[str, NamedQuantity]]] = {}
    for name in table.names:
        for role, (pattern, dimension) in ROLES.items():
            quantity = parse_name(name, pattern, dimension)
            if quantity is not None:
                found.setdefault(role, []).append((name, quantity))
                break
    return found


def _read_named(table: Table, roles: dict[str, list[tuple[str, NamedQuantity]]]) -> TrackFile:
    found = TrackFile()
    columns = {}
    for pair in PAIRS:
        if not set(pair) <= roles.keys():
            continue
        chosen = _pair(roles[pair[0]], roles[pair[1]])
        others = [name for role in pair for name, _ in roles[role] if name not in (one[0] for one in chosen)]
        if others:
            found.warnings.append(
                f"{listed([name for name, _ in chosen])} are taken for its places, not {listed(others)}"
            )
        for role, (name, quantity) in zip(pair, chosen, strict=True):
            if quantity.is_unknown:
                usual = "deg" if pair == PAIRS[0] else "m"
                raise ValueError(
                    f"the unit of {display_text(name)} is not known; convert it, and name the column {role}_{usual}"
                )
            size = 1.0 if quantity.unit is None else quantity.unit.factor / _size(role)
            columns[role] = table.numbers_or_blank(name) * size
    speed = _speed(roles.get("speed", []), found)
    if speed is not None:
        name, quantity = speed
        columns["speed"] = table.numbers_or_blank(name) * (1.0 if quantity.unit is None else quantity.unit.factor)
    found.other = f"columns {listed(table.unread)}" if table.unread else ""
    kind = " and ".join(", ".join(pair) for pair in PAIRS if set(pair) <= columns.keys())
    found.append(_track(kind, columns, table.lines))
    return found


def _pair(first: list[tuple[str, NamedQuantity]], second: list[tuple[str, NamedQuantity]]) -> tuple:
    """The first two columns that belong together; a simulator's true ones last."""
    pairs = [(a, b) for a in first for b in second if _belong(a[1].base, b[1].base)] or [(first[0], second[0])]
    return min(pairs, key=lambda pair: pair[0][1].base.startswith("true"))


def _belong(first: str, second: str) -> bool:
    one, other = first.split("_"), second.split("_")
    return len(one) == len(other) and all(
        a == b or b in _COUNTERPART.get(a, "").split() for a, b in zip(one, other, strict=True)
    )


def _speed(candidates: list[tuple[str, NamedQuantity]], found: TrackFile) -> tuple[str, NamedQuantity] | None:
    """The speed to drive, of several: one that is named as wanted, else the first."""
    known = [one for one in candidates if not one[1].is_unknown]
    for name, quantity in candidates:
        if quantity.is_unknown:
            found.warnings.append(
                f"{display_text(name)} is not read: its unit {display_text(quantity.unit_text)} is no known speed"
            )
    if not known:
        return None
    chosen = min(known, key=lambda one: WANTED.fullmatch(one[1].base) is None)
    if len(known) > 1:
        others = [name for name, _ in known if name != chosen[0]]
        found.warnings.append(f"{display_text(chosen[0])} is taken for the speed to drive, not {listed(others)}")
    if chosen[1].unit is None:
        found.assumed.append(f"{display_text(chosen[0])} names no unit: taken for m/s")
    elif chosen[1].unit.factor != 1.0:
        found.assumed.append(f"{display_text(chosen[0])} brought from {chosen[1].unit.symbol} to m/s")
    return chosen


def _read_bare(file: File, dialect: Dialect) -> TrackFile:
    """Two columns without a header."""
    if dialect.columns < 2:
        raise ValueError("it has one column; it must have latitude and longitude [deg], or x and y [m], under a header")
    with file.open(encoding=dialect.encoding, newline=None) as opened:
        lines = opened.read().splitlines()[dialect.skip :]
    places = number_rows(lines, dialect, (0, 1), where=str(file), first_line=dialect.skip + 1)
    if len(places) > 2 and np.all(np.nanmax(places, axis=0) - np.nanmin(places, axis=0) < NARROWEST):
        raise ValueError("its columns have no header and look like degrees; add latitude,longitude or x,y")
    found = TrackFile()
    if dialect.columns > 2:
        found.other = f"columns {listed([str(number) for number in range(3, dialect.columns + 1)])}"
    kind = "two columns without a header, taken for x and y [m]"
    found.append(_track(kind, {"x": places[:, 0], "y": places[:, 1]}, None))
    return found


def _track(kind: str, columns: dict[str, np.ndarray], lines: np.ndarray | None) -> Track:
    count = len(next(iter(columns.values())))
    if count > MOST_POINTS:
        raise ValueError(
            f"it has {count:,} rows, more than {MOST_POINTS:,}; thin it, or cut it into shorter recordings"
        )
    return Track(kind, "", columns, lines=lines)


def _size(role: str) -> float:
    """SI value of the unit in which a role is kept."""
    return DEGREE if role in ("latitude", "longitude") else 1.0
