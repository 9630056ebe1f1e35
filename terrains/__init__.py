"""Grounds that a twin can stand on: the inclined plane, and terrains of triangles; paths over them.

:func:`load` reads what people have (meshes, elevation rasters, point clouds), repairs it and reports on it;
:func:`to_local` brings latitude and longitude into a terrain's frame. These load on first use.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from aoro_gym.terrains.path import Path
from aoro_gym.terrains.plane import Plane
from aoro_gym.terrains.planning import drivable_path
from aoro_gym.terrains.terrain import Terrain

if TYPE_CHECKING:
    from aoro_gym.terrains.check import Report, TerrainError
    from aoro_gym.terrains.georeference import from_world, to_geographic, to_local
    from aoro_gym.terrains.loading import Loaded, load
    from aoro_gym.terrains.path_files import LoadedPath, PathReport, load_path, save_path

__all__ = [
    "Loaded",
    "LoadedPath",
    "Path",
    "PathReport",
    "Plane",
    "Report",
    "Terrain",
    "TerrainError",
    "drivable_path",
    "from_world",
    "load",
    "load_path",
    "save_path",
    "to_geographic",
    "to_local",
]

_HOME = {
    "Loaded": "loading",
    "LoadedPath": "path_files",
    "PathReport": "path_files",
    "Report": "check",
    "TerrainError": "check",
    "from_world": "georeference",
    "load": "loading",
    "load_path": "path_files",
    "save_path": "path_files",
    "to_geographic": "georeference",
    "to_local": "georeference",
}


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(import_module(f"aoro_gym.terrains.{_HOME[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
