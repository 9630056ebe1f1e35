"""Grounds that a twin can stand on: the inclined plane, and terrains of triangles; paths over them.

:func:`load` reads what people have (meshes, elevation rasters, point clouds), repairs it and reports on it;
:func:`to_local` brings latitude and longitude into a terrain's frame. These load on first use.
"""

from typing import TYPE_CHECKING

import lazy_loader

from aoro_gym.terrains.paths.path import Path
from aoro_gym.terrains.plane import Plane
from aoro_gym.terrains.terrain import Terrain

if TYPE_CHECKING:
    from aoro_gym.terrains.georeference import from_world, to_geographic, to_local
    from aoro_gym.terrains.io.check import Report, TerrainError
    from aoro_gym.terrains.io.loading import Loaded, load
    from aoro_gym.terrains.paths.path_files import LoadedPath, PathReport, load_path, save_path
    from aoro_gym.terrains.paths.planning import drivable_path

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

__getattr__, _, _ = lazy_loader.attach(
    __name__,
    submod_attrs={
        "io.check": ("Report", "TerrainError"),
        "georeference": ("from_world", "to_geographic", "to_local"),
        "io.loading": ("Loaded", "load"),
        "paths.path_files": ("LoadedPath", "PathReport", "load_path", "save_path"),
        "paths.planning": ("drivable_path",),
    },
)


def __dir__() -> list[str]:
    return list(__all__)
