"""Where a terrain lies on the Earth: between its local frame, projected coordinates, and latitude and longitude.

Local x and y are the axes of the terrain's coordinate reference system in metres, less its origin: grid north, not true
north, and grid distances, which in UTM are up to 0.4 ‰ shorter than those on the ground. A system whose metres are off
those of the ground by more than 1 % (Web Mercator away from the equator) is brought to its UTM zone on loading. Heights
stay as they are.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from aoro_gym.checks import check_finite, check_range
from aoro_gym.terrains.extras import import_extra
from aoro_gym.terrains.terrain import Terrain

MOST_SCALE_ERROR = 0.01
"""Share by which lengths of a projection may be off those on the ground."""
GEOGRAPHIC = "EPSG:4326"
"""Latitude and longitude as satellite receivers give them (WGS 84)."""

Plan = tuple[NDArray[np.float64], NDArray[np.float64]]


def to_local(terrain: Terrain, latitude: ArrayLike, longitude: ArrayLike) -> Plan:
    """Local x, y [m] of WGS 84 ``latitude`` and ``longitude`` [deg], which broadcast.

    Raises ``ValueError`` if the terrain has no coordinate reference system, or a value cannot be projected into it.
    """
    return from_world(terrain, longitude, latitude, crs=GEOGRAPHIC)


def to_geographic(terrain: Terrain, x: ArrayLike, y: ArrayLike) -> Plan:
    """WGS 84 latitude and longitude [deg] of local ``x``, ``y`` [m], which broadcast; raises as :func:`to_local`."""
    system = terrain_crs(terrain)
    x, y = np.broadcast_arrays(np.asarray(x, dtype=np.float64), np.asarray(y, dtype=np.float64))
    metre = axis_unit(system)
    first, second = (x + terrain.origin[0]) / metre, (y + terrain.origin[1]) / metre
    longitude, latitude = _transform(system, horizontal(GEOGRAPHIC), first, second)
    return latitude, longitude


def from_world(terrain: Terrain, first: ArrayLike, second: ArrayLike, *, crs: str | None = None) -> Plan:
    """Local x, y [m] of coordinates in ``crs``, which broadcast.

    Args:
        terrain: Gives the local frame.
        first: Easting, or longitude [deg], in the unit of ``crs``.
        second: Northing, or latitude [deg], in the unit of ``crs``.
        crs: Anything that pyproj reads, such as ``"EPSG:32633"``; None for the terrain's own.

    Raises ``ValueError`` naming the system or the value and its bound.
    """
    target = terrain_crs(terrain)
    source = target if crs is None else horizontal(crs)
    first, second = np.broadcast_arrays(np.asarray(first, dtype=np.float64), np.asarray(second, dtype=np.float64))
    if source.is_geographic:
        for name, value, bound in (("longitude", first, 180.0), ("latitude", second, 90.0)):
            check_range(name, value, "deg", ge=-bound, le=bound)
    else:
        check_finite(f"first coordinate in {crs or terrain.crs}", first)
        check_finite(f"second coordinate in {crs or terrain.crs}", second)
    x, y = _transform(source, target, first, second)
    metre = axis_unit(target)
    return x * metre - terrain.origin[0], y * metre - terrain.origin[1]


def terrain_crs(terrain: Terrain) -> Any:
    """The terrain's horizontal system (``pyproj.CRS``); ``ValueError`` if it has none."""
    if terrain.crs is None:
        raise ValueError(
            f"terrain {terrain.name!r} has no coordinate reference system, so nobody knows where on Earth it lies;"
            " load it with crs='EPSG:...' (--crs of 'aoro-gym terrain')"
        )
    return horizontal(terrain.crs)


@lru_cache(maxsize=64)
def horizontal(crs: str, name: str = "crs") -> Any:
    """``crs`` as a ``pyproj.CRS`` without its vertical part; ``ValueError``, by its ``name``, if it says nothing of places
    on Earth."""
    pyproj = import_extra("pyproj", f"the coordinate reference system {crs!r}")
    try:
        system = pyproj.CRS.from_user_input(crs)
    except pyproj.exceptions.CRSError:
        raise ValueError(f"{name} is {_short(crs)}, which is unknown; give a code such as 'EPSG:32633'") from None
    flat = system.sub_crs_list[0] if system.is_compound else system
    flat = flat.to_2d()
    if not (flat.is_projected or flat.is_geographic):
        raise ValueError(
            f"{name} is {_short(crs)} ({flat.name}), which is neither projected nor geographic; give a code such as"
            " 'EPSG:32633'"
        )
    return flat


def utm_zone(latitude: float, longitude: float) -> Any:
    """The projected system (``pyproj.CRS``, WGS 84) of the UTM zone around a place [deg]."""
    zone = int(np.floor((longitude + 180.0) / 6.0)) % 60 + 1
    return horizontal(f"EPSG:{32600 + zone if latitude >= 0.0 else 32700 + zone}")


def scale_factors(system: Any, x: float, y: float) -> tuple[float, float] | None:
    """Lengths in a projected ``system`` by those on its ellipsoid, around a place in its own unit: least and most.

    Measured with geodesics in eight directions, as a projection may stretch one and not the other. None where the place
    has no latitude and longitude.
    """
    pyproj = import_extra("pyproj", "the scale of a projection")
    metre = axis_unit(system)
    back = pyproj.Transformer.from_crs(system, system.geodetic_crs, always_xy=True)
    angle = np.arange(0.0, np.pi, np.pi / 8.0)
    step = 50.0 / metre
    ends = [back.transform(x + sign * step * np.cos(angle), y + sign * step * np.sin(angle)) for sign in (-1.0, 1.0)]
    if not np.isfinite(ends).all():
        return None
    degree = np.degrees(system.geodetic_crs.axis_info[0].unit_conversion_factor)
    (a, b), (c, d) = np.asarray(ends) * degree
    length = system.get_geod().inv(a, b, c, d)[2]
    if not np.all(length > 0.0):
        return None
    return float(100.0 / length.max()), float(100.0 / length.min())


def axis_unit(system: Any) -> float:
    """Size [m] of the unit of a projected system's axes."""
    if not system.is_projected:
        raise ValueError(f"crs {system.name} counts in degrees; a terrain needs a projected one, such as its UTM zone")
    return float(system.axis_info[0].unit_conversion_factor)


def _short(text: Any) -> str:
    """What was given, as far as a message bears it."""
    said = repr(str(text))
    return said if len(said) <= 80 else f"{said[:77]}...'"


def _transform(source: Any, target: Any, first: NDArray[np.float64], second: NDArray[np.float64]) -> Plan:
    """Coordinates (x or longitude first) from one system in the other."""
    pyproj = import_extra("pyproj", "a change of coordinates")
    if source != target:
        change = pyproj.Transformer.from_crs(source, target, always_xy=True)
        first, second = (np.asarray(part) for part in change.transform(first, second))
        lost = ~(np.isfinite(first) & np.isfinite(second))
        if lost.any():
            raise ValueError(f"{int(lost.sum())} of {lost.size} points of {source.name} lie outside of {target.name}")
    return first, second
