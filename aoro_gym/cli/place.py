"""Where a twin stands: options of its ground, its path and its start, and what they stand for."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from aoro_gym.cli.options import option
from aoro_gym.reporting import terminal

if TYPE_CHECKING:
    from aoro_gym.machine import Machine
    from aoro_gym.terrains import Path as Line
    from aoro_gym.terrains import Plane, Terrain
    from aoro_gym.twin import Twin

TerrainOption = Annotated[
    Path | None, option("--terrain", "FILE", "Ground, see 'aoro-gym terrain'. Default: level asphalt.")
]
GroundOption = Annotated[
    str, option("--ground", "raster|mesh", "How the twin feels a terrain; mesh: its very triangles.")
]
TrackOption = Annotated[str | None, option("--track", "N|NAME", "Which of the file's tracks.")]
StartOption = Annotated[
    tuple[float, float, float] | None,
    option("--start", "X Y DEG", "Or start here: hinge in m, heading from x to the left."),
]


def load_terrain(file: Path) -> Terrain:
    """The ground of a file, under a progress bar; what was doubtful is warned of."""
    from aoro_gym.terrains import load

    with terminal.progress(f"loading {file.name}") as tell:
        loaded = load(file, progress=lambda share: tell(f"loading {file.name}", share))
    for warning in loaded.report.warnings:
        terminal.warn(warning)
    return loaded.terrain


def load_ground(file: Path | None) -> Terrain | Plane:
    """The ground of a file, or level asphalt."""
    from aoro_gym.terrains import Plane

    return Plane() if file is None else load_terrain(file)


def load_line(file: Path, track: str | None, terrain: Terrain | Plane) -> Line:
    """The path of a file; what was doubtful is warned of."""
    from aoro_gym.terrains import Plane, load_path

    loaded = load_path(file, None if isinstance(terrain, Plane) else terrain, track=track)
    for warning in loaded.report.warnings:
        terminal.warn(warning)
    return loaded.path


def put(twin: Twin, machine: Machine, line: Line | None, start: tuple[float, float, float] | None) -> None:
    """Put the twins at rest on the path, as ``machine`` fits on it; at ``start`` (x, y in m, heading in degrees); or where
    a reset puts them."""
    from aoro_gym.cosimulation.server.starting import start_on_path

    if line is not None:
        start_on_path(twin, machine, line)
    elif start is not None:
        twin.reset(position=start[:2], heading=math.radians(start[2]))
    else:
        twin.reset()


def check_start(path: Path | None, start: tuple[float, float, float] | None) -> None:
    """ValueError if both are given."""
    if path is not None and start is not None:
        raise ValueError("--path and --start both say where to start; drop one of them")
