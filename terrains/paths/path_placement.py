"""From a track's coordinates to the local frame of a terrain, with the checks that the terrain makes possible."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from aoro_gym.terrains.extras import import_extra
from aoro_gym.terrains.georeference import (
    GEOGRAPHIC,
    axis_unit,
    from_world,
    horizontal,
    scale_factors,
    terrain_crs,
    to_geographic,
    utm_zone,
)
from aoro_gym.terrains.length_units import UNITS
from aoro_gym.terrains.paths.tracks import Track, metres
from aoro_gym.terrains.terrain import LARGEST_COORDINATE, Terrain

Array = NDArray[Any]

SURE = 0.9
"""Share of the points that another reading must bring onto the terrain to be named."""
SCALE_TOLERANCE = 0.01
"""By how much a length in a terrain's system may differ from that on the ground before it is named."""


class Notes(Protocol):
    """What is noted on the way."""

    frame: str
    tangent_point: tuple[float, float] | None
    warnings: list[str]

    def change(self, what: str, count: int, text: str) -> None: ...


def check_reading(track: Track, terrain: Terrain | None, crs: str | None) -> None:
    """``ValueError`` where degrees are none, or metres lie nowhere near the terrain, so that their unit is another one."""
    if "latitude" in track.columns:
        _check_degrees(track, track.columns["latitude"], track.columns["longitude"])
    elif terrain is not None and crs is None and track.crs is None:
        _metres(track.columns["x"], track.columns["y"], terrain)


def place(track: Track, terrain: Terrain | None, crs: str | None, notes: Notes) -> Array:
    """(P, 2) local points of a track whose coordinates are finite; raises ``ValueError`` without the file's name.

    Args:
        track: In degrees, or in metres, or in the unit of its ``crs`` or of ``crs``.
        terrain: Whose frame is meant; without one, or without its crs, degrees lie around the track's first point.
        crs: Of the track's coordinates; wins over the track's.
        notes: Gets the frame, changes and warnings.
    """
    system = crs if crs is not None else track.crs
    if "latitude" in track.columns:
        if system is not None and not horizontal(system).is_geographic:
            raise ValueError(f"crs = {system!r} counts in metres, but the file is in degrees; drop crs")
        latitude, longitude = track.columns["latitude"], track.columns["longitude"]
        points = _from_degrees(latitude, longitude, system or GEOGRAPHIC, terrain, notes)
    elif system is not None:
        points = _from_system(track.columns["x"], track.columns["y"], system, terrain, notes)
    else:
        points = _from_metres(track.columns["x"], track.columns["y"], terrain, notes)
    farthest = int(np.argmax(np.abs(points).max(axis=1)))
    if not np.abs(points[farthest]).max() <= LARGEST_COORDINATE:
        raise ValueError(
            f"{track.place(farthest)} lies {metres(float(np.hypot(*points[farthest])))} from the local origin, but a path"
            f" may reach {LARGEST_COORDINATE:.0f} m at most; cut the recording, or leave that point out"
        )
    if terrain is not None and terrain.crs is not None:
        _check_scale(terrain, points, notes)
    return points


def _check_degrees(track: Track, latitude: Array, longitude: Array) -> None:
    for key, values, bound in (("latitude", latitude, 90.0), ("longitude", longitude, 180.0)):
        worst = int(np.argmax(np.abs(values)))
        if abs(values[worst]) <= bound:
            continue
        text = f"{key} at {track.place(worst)} is {values[worst]:.9g} deg, but must be in [-{bound:g}, {bound:g}] deg"
        if np.abs(latitude).min() > 90.0 and np.abs(latitude).max() <= 180.0 and np.abs(longitude).max() <= 90.0:
            text += ": latitude and longitude look interchanged; exchange the two"
        elif 9e6 < np.median(np.abs(values)) <= bound * 1e7:
            text += ": degrees times ten million?"
        elif np.abs(values[worst]) > 360.0:
            text += "; if the file is in metres, say crs='EPSG:...' (--path-crs)"
        raise ValueError(text)


def _from_degrees(latitude: Array, longitude: Array, system: str, terrain: Terrain | None, notes: Notes) -> Array:
    if terrain is not None and terrain.crs is not None:
        notes.frame = f"brought to {terrain.name!r} through {terrain.crs.splitlines()[0][:60]}"

        def swapped() -> Array:
            if np.abs(longitude).max() > 90.0:
                raise ValueError
            return np.stack(from_world(terrain, latitude, longitude, crs=system), axis=1)

        return _on_terrain(
            lambda: np.stack(from_world(terrain, longitude, latitude, crs=system), axis=1),
            terrain,
            [("latitude and longitude look interchanged: exchange the two in the file", swapped)],
            "is it another place, or has the terrain another crs?",
        )
    pyproj = import_extra("pyproj", "a path in latitude and longitude")
    first = (float(latitude[0]), float(longitude[0]))
    plane = pyproj.Proj(proj="aeqd", lat_0=first[0], lon_0=first[1], datum="WGS84")
    notes.tangent_point = first
    north, east = "N" if first[0] >= 0.0 else "S", "E" if first[1] >= 0.0 else "W"
    notes.frame = (
        f"x east, y north [m] from its first point at latitude {abs(first[0]):.7f}° {north},"
        f" longitude {abs(first[1]):.7f}° {east}"
    )
    if terrain is not None:
        notes.warnings.append(
            f"terrain {terrain.name!r} has no coordinate reference system: the path starts at its local origin;"
            " load the terrain with crs='EPSG:...' to lay it where it was driven"
        )
    return np.stack(plane(longitude, latitude), axis=1)


def _from_system(x: Array, y: Array, system: str, terrain: Terrain | None, notes: Notes) -> Array:
    """Of coordinates in a projected system."""
    if terrain is not None and terrain.crs is not None:
        notes.frame = f"brought from {system} to {terrain.name!r}"
        return _on_terrain(
            lambda: np.stack(from_world(terrain, x, y, crs=system), axis=1),
            terrain,
            [
                (
                    "easting and northing look interchanged: exchange the two in the file",
                    lambda: np.stack(from_world(terrain, y, x, crs=system), axis=1),
                )
            ],
            f"is crs = {system!r} the right one?",
        )
    latitude, longitude = _geographic(x, y, system)
    points = _from_degrees(latitude, longitude, GEOGRAPHIC, terrain, notes)
    notes.frame += f"; from {system}"
    return points


def _geographic(x: Array, y: Array, system: str) -> tuple[Array, Array]:
    """Latitude and longitude of coordinates whose system covers them."""
    pyproj = import_extra("pyproj", "a change of coordinates")
    source = horizontal(system)
    change = pyproj.Transformer.from_crs(source, GEOGRAPHIC, always_xy=True)

    def covered(first: Array, second: Array) -> tuple[bool, Array, Array]:
        longitude, latitude = (np.asarray(part) for part in change.transform(first, second))
        if not (np.isfinite(longitude).all() and np.isfinite(latitude).all()):
            return False, latitude, longitude
        area = source.area_of_use
        if area is None:
            return True, latitude, longitude
        within = (area.south - 1.0 <= latitude) & (latitude <= area.north + 1.0)
        width = (area.east - area.west) % 360.0 or 360.0
        within &= (longitude - area.west + 5.0) % 360.0 <= width + 10.0  # zones are used beyond their edges
        return bool(within.all()), latitude, longitude

    fits, latitude, longitude = covered(x, y)
    if fits:
        return latitude, longitude
    if covered(y, x)[0]:
        raise ValueError(
            f"easting and northing look interchanged: as they are they lie outside of the area of {system}; exchange the two"
        )
    raise ValueError(
        f"its coordinates, such as {x[0]:.9g}, {y[0]:.9g}, lie outside of the area of {system}; give the right crs=..."
        " (--path-crs)"
    )


def _from_metres(x: Array, y: Array, terrain: Terrain | None, notes: Notes) -> Array:
    points = np.stack([x, y], axis=1)
    notes.frame = "local x, y [m]"
    if terrain is not None:
        shift = _metres(x, y, terrain)
        notes.change("shifted", int(shift.any()), f"world coordinates, brought to {terrain.name!r} by its origin")
        return points - shift
    largest = float(np.abs(points).max())
    if largest > LARGEST_COORDINATE:
        raise ValueError(
            f"its coordinates reach {largest:.9g} m, which are no local ones; give the terrain they belong to, or"
            " crs='EPSG:...' (--path-crs)"
        )
    return points


def _metres(x: Array, y: Array, terrain: Terrain) -> Array:
    """(2,) what brings x, y [m] to the terrain's frame: nothing, or its origin; ``ValueError`` where neither does."""
    points = np.stack([x, y], axis=1)
    origin = np.asarray(terrain.origin[:2])
    shifts = [np.zeros(2), origin] if origin.any() else [np.zeros(2)]
    found = [
        text
        for text, reading in _other_readings(points, shifts, terrain)
        if _share_on_terrain(reading, terrain) >= SURE
    ]
    for shift in shifts:
        reading = points - shift
        if _share_on_terrain(reading, terrain) > 0.0 or (not found and _distance_to_terrain(reading, terrain) == 0.0):
            return shift
    apart = min(_distance_to_terrain(points - shift, terrain) for shift in shifts)
    advice = " or ".join(found) + ("; say which" if len(found) > 1 else "")
    if not found:
        advice = "if its coordinates are in another system or unit, say crs='EPSG:...' (--path-crs)"
    raise ValueError(f"it lies {metres(apart)} from terrain {terrain.name!r}: {advice}")


def _other_readings(points: Array, shifts: Sequence[Array], terrain: Terrain) -> Iterator[tuple[str, Array]]:
    """What the coordinates could be instead, with the points that this gives: as local and as world ones."""
    for crs in _systems_around(terrain):
        for text, (first, second) in (
            ("", points.T),
            ("interchanged and ", points.T[::-1]),
        ):
            with suppress(ValueError):  # outside of that system
                reading = np.stack(from_world(terrain, first, second, crs=crs), axis=1)
                what = "longitude and latitude" if crs == GEOGRAPHIC else crs
                yield (
                    f"they look like {text}{what}: {'exchange the two, and ' if text else ''}say crs={crs!r} (--path-crs)",
                    reading,
                )
    for shift in shifts:
        yield "x and y look interchanged: exchange the two in the file", points[:, ::-1] - shift
        for unit, size in UNITS.items():
            if unit != "m":
                name = unit.replace("-", "")
                yield f"they look like {unit}: name the columns x_{name} and y_{name}", points * size - shift


def _systems_around(terrain: Terrain) -> list[str]:
    """Systems in which people have coordinates there: degrees, Web Mercator, UTM zones."""
    if terrain.crs is None:
        return []
    low, high = terrain.extent
    latitude, longitude = (float(value) for value in to_geographic(terrain, *(0.5 * (low + high))[:2]))
    zones = [utm_zone(latitude, longitude + 6.0 * side) for side in range(-2, 3)]
    codes = [f"EPSG:{zone.to_epsg()}" for zone in zones]
    return [GEOGRAPHIC, "EPSG:3857", *(code for code in codes if code != terrain.crs)]


def _on_terrain(
    reading: Callable[[], Array], terrain: Terrain, others: list[tuple[str, Callable[[], Array]]], doubt: str
) -> Array:
    """The points of a reading, of which some lie on the terrain; ``ValueError`` that names another one that fits."""
    failed = None
    points = None
    try:
        points = reading()
        if _share_on_terrain(points, terrain) > 0.0:
            return points
    except ValueError as error:  # outside of the terrain's system
        failed = error
    for text, other in others:
        try:
            share = _share_on_terrain(other(), terrain)
        except ValueError:
            continue
        if share >= SURE:
            far = (
                ""
                if points is None
                else f"it lies {metres(_distance_to_terrain(points, terrain))} from terrain {terrain.name!r}, but "
            )
            raise ValueError(f"{far}{text} (then {share:.0%} of its points lie on the terrain)") from None
    if points is not None and _distance_to_terrain(points, terrain) == 0.0:
        return points
    if failed is not None or points is None:
        raise failed or ValueError(doubt)
    raise ValueError(f"it lies {metres(_distance_to_terrain(points, terrain))} from terrain {terrain.name!r}; {doubt}")


def _share_on_terrain(points: Array, terrain: Terrain) -> float:
    """Share of the points within the terrain's extent."""
    low, high = terrain.extent
    return float(np.mean(np.all((points >= low[:2]) & (points <= high[:2]), axis=1)))


def _distance_to_terrain(points: Array, terrain: Terrain) -> float:
    """Distance [m] between the rectangles around the points and around the terrain."""
    low, high = terrain.extent
    beyond = np.maximum(np.maximum(low[:2] - points.max(axis=0), points.min(axis=0) - high[:2]), 0.0)
    return float(np.hypot(*beyond))


def _check_scale(terrain: Terrain, points: Array, notes: Notes) -> None:
    """A warning where the terrain's system stretches lengths."""
    system = terrain_crs(terrain)
    metre = axis_unit(system)
    middle = points[len(points) // 2] + terrain.origin[:2]
    scales = scale_factors(system, float(middle[0]) / metre, float(middle[1]) / metre)
    if scales is not None and max(scales[1] - 1.0, 1.0 - scales[0]) > SCALE_TOLERANCE:
        notes.warnings.append(
            f"lengths in {(terrain.crs or '')[:60]} are {scales[0]:.2f} to {scales[1]:.2f} times those on the ground there,"
            " of terrain and path alike: bring the terrain to its UTM zone"
        )
