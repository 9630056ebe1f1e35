"""Where a twin stands: options of its ground, its path and its start, and what they stand for."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from aoro_gym.cli.options import option
from aoro_gym.execution.device_names import SIMD
from aoro_gym.reporting import terminal

if TYPE_CHECKING:
    from aoro_gym.machine import Machine
    from aoro_gym.machine.vehicle_crane import VehicleCrane
    from aoro_gym.terrains import Path as Line
    from aoro_gym.terrains import Plane, Terrain
    from aoro_gym.terrains.soil import Soil
    from aoro_gym.terrains.world.world import World
    from aoro_gym.twin import Twin

TerrainOption = Annotated[
    Path | None, option("--terrain", "FILE", "Ground, see 'aoro-gym terrain'. Default: level asphalt.")
]
WorldOption = Annotated[
    Path | None, option("--world", "FOLDER", "World with its solid objects, see 'aoro-gym world', as ground.")
]
GroundOption = Annotated[
    str,
    option("--ground", "raster|mesh|discs", "How tires feel a terrain; mesh: its very triangles; discs: each disc."),
]
SoilOption = Annotated[
    str | None,
    option(
        "--soil",
        "NAME[:WATER]",
        "Soft ground: peat, moraine, snow, sand, sandy_loam, clay or loam; +passes: ruts deepen with every wheel;"
        " +slip_sinkage. Default: hard.",
    ),
]
TrackOption = Annotated[str | None, option("--track", "N|NAME", "Which of the file's tracks.")]
CranePoseOption = Annotated[
    tuple[float, float, float, float] | None,
    option("--crane-pose", "DEG DEG DEG M", "Its slew, lift, fold and telescope at the start. Default: folded."),
]
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


def load_ground(file: Path | None, world: Path | None = None) -> Terrain | Plane | World:
    """The ground of a file, the ``world`` of a folder, or level asphalt.

    Raises ValueError if both are given.
    """
    from aoro_gym.terrains import Plane
    from aoro_gym.terrains.world.files import load_world

    if world is None:
        return Plane() if file is None else load_terrain(file)
    check_one_ground(file, world)
    with terminal.progress(f"loading {world.name}"):
        return load_world(world)


def load_soil(name: str | None, world: Path | None, device: str = "cpu") -> Soil | None:
    """What the ground is made of by the value of --soil, in a --world and on a --device that may not go with it."""
    from aoro_gym.terrains.soil import Soil

    if name is None:
        return None
    if world is not None:
        raise ValueError(f"--soil {name} is without solid objects, but --world {world} has some; drop one of them")
    if device == SIMD:
        raise ValueError(f"--device {SIMD} cannot run twins on --soil {name}; take cpu, or drop --soil")
    try:
        return Soil.named(name)
    except ValueError as error:
        raise ValueError(f"--{error}") from None


def posed_crane(pose: tuple[float, float, float, float]) -> VehicleCrane:
    """The crane that begins with the joints of --crane-pose [deg, deg, deg, m]."""
    from aoro_gym.machine.vehicle_crane import VehicleCrane

    slew, lift, fold = (math.radians(angle) for angle in pose[:3])
    try:
        return VehicleCrane(start=(slew, lift, fold, pose[3]))
    except ValueError as error:
        raise ValueError(f"--crane-pose: {error}") from None


def bare(ground: Terrain | Plane | World) -> Terrain | Plane:
    """The ground without its objects."""
    from aoro_gym.terrains.world.world import World

    return ground.terrain if isinstance(ground, World) else ground


def check_one_ground(file: Path | None, world: Path | None) -> None:
    """ValueError if both are given."""
    if file is not None and world is not None:
        raise ValueError(f"--world {world} has its own ground, and --terrain {file} is another; drop one of them")


def load_line(file: Path, track: str | None, terrain: Terrain | Plane) -> Line:
    """The path of a file; what was doubtful is warned of."""
    from aoro_gym.terrains import Plane, load_path

    loaded = load_path(file, None if isinstance(terrain, Plane) else terrain, track=track)
    for warning in loaded.report.warnings:
        terminal.warn(warning)
    return loaded.path


def put(twin: Twin, machine: Machine, line: Line | None, start: tuple[float, float, float] | None) -> None:
    """Put the twins at rest on the path, as ``machine`` fits on it; at ``start`` (x, y in m, heading in degrees); or where
    a reset puts them, in a world at the free place nearest to its middle."""
    from aoro_gym.cosimulation.server.starting import start_on_path
    from aoro_gym.terrains.world.places import free_place
    from aoro_gym.terrains.world.world import World

    if line is not None:
        start_on_path(twin, machine, line)
    elif start is not None:
        twin.reset(position=start[:2], heading=math.radians(start[2]))
    elif isinstance(twin.terrain, World):
        place = free_place(twin.terrain)
        twin.reset(position=place[:2], heading=place.heading)
    else:
        twin.reset()


def check_track(path: Path | None, track: str | None) -> None:
    """ValueError for a track of no path."""
    if track is not None and path is None:
        raise ValueError(f"--track {track} is one of a path's tracks; give its file with --path, or drop --track")


def check_start(path: Path | None, start: tuple[float, float, float] | None) -> None:
    """ValueError if both are given."""
    if path is not None and start is not None:
        raise ValueError("--path and --start both say where to start; drop one of them")
