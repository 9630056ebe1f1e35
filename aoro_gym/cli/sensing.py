"""What commands of sensors have in common: where the machine stands or drives on, and in what weather."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from aoro_gym.cli.options import option
from aoro_gym.cli.place import check_one_ground, load_ground
from aoro_gym.reporting import terminal

if TYPE_CHECKING:
    from aoro_gym.sensors.lidar import Motion, Weather
    from aoro_gym.sensors.raytrace import Scene
    from aoro_gym.terrains.terrain import Terrain
    from aoro_gym.terrains.world.world import World

TerrainOption = Annotated[
    Path | None, option("--terrain", "FILE", "Ground of 'aoro-gym terrain'. Default: a made forest.")
]
PlaceOption = Annotated[
    tuple[float, float] | None,
    option(
        "--at",
        "X Y",
        "Where the machine stands, in metres. Default: 0 0, in a --world its middle's nearest free place.",
    ),
]
HeadingOption = Annotated[
    float | None,
    option("--heading", "DEG", "Of the machine, from east to north. Default: 0, or that of the free place."),
]
SpeedOption = Annotated[float, option("--speed", "M/S", "At which it drives on, for motion while a sensor looks.")]
WeatherOption = Annotated[
    str | None, option("--weather", "KIND=AMOUNT", "rain=MM/H, fog=METRES of visibility, or snow=MM/H.")
]
IdealOption = Annotated[bool, option("--ideal-sensors", None, "Without noise.")]
ORIGIN = (0.0, 0.0, 0.0)
"""Place and heading."""


def surroundings(
    terrain: Path | None, folder: Path | None, seed: int, **changes: Any
) -> tuple[Terrain | World, tuple[float, float, float]]:
    """The world of a folder, the ground of a file, or a made forest, and where the machine stands if nothing is said.

    Args:
        terrain: Value of --terrain.
        folder: Value of --world.
        seed: Of a made forest.
        changes: Its settings.

    Returns:
        The ground, and x, y [m] and heading [rad].
    """
    from aoro_gym.terrains.generate.world import world
    from aoro_gym.terrains.terrain import Terrain
    from aoro_gym.terrains.world.places import free_place
    from aoro_gym.terrains.world.world import World

    check_one_ground(terrain, folder)
    if terrain is None and folder is None:
        with terminal.progress("making a forest"):
            return world(seed, **changes), ORIGIN
    ground = load_ground(terrain, folder)
    if isinstance(ground, World):
        return ground, free_place(ground)
    assert isinstance(ground, Terrain)
    return ground, ORIGIN


def weather_of(text: str | None, **options: Any) -> Weather:
    """Value of --weather; ``options`` are those of the kinds of :class:`~aoro_gym.sensors.lidar.Weather`."""
    from aoro_gym.sensors.lidar import CLEAR, Weather

    if text is None:
        return CLEAR
    kind, _, amount = text.partition("=")
    try:
        number = float(amount)
    except ValueError:
        raise ValueError(f"--weather is {text!r}, but must be KIND=AMOUNT, such as rain=10 or fog=60") from None
    return Weather.named(kind, number, **options)


def straight_on(scene: Scene, at: tuple[float, float], yaw: float, speed: float, duration: float) -> Motion:
    """A motion straight on, upright, on the ground at every tenth of a second.

    Args:
        scene: With the ground.
        at: x, y [m] where it begins.
        yaw: [rad].
        speed: [m/s], constant.
        duration: [s].

    Raises ``ValueError`` where there is no ground.
    """
    import numpy as np

    from aoro_gym.sensors.height_map import HeightMapSensor
    from aoro_gym.sensors.lidar import Motion

    top = float(scene.extent[1][2])
    time: Any = np.arange(0.0, duration + 0.1, 0.1)
    way = np.asarray(at) + np.outer(speed * time, [np.cos(yaw), np.sin(yaw)])
    below = HeightMapSensor(scene, forward=(0.0, 0.0), left=(0.0, 0.0), above=1.0)
    ground: Any = top + below.measure(np.column_stack([way, np.full(len(time), top)]), np.zeros(len(time)))[:, 0, 0]
    if np.isnan(ground).any():
        x, y = way[np.argmax(np.isnan(ground))]
        raise ValueError(
            f"there is no ground at x = {x:.1f} m, y = {y:.1f} m; choose another --at, --heading or --speed"
        )
    return Motion(time, np.column_stack([way, ground]), 0 * time, 0 * time, 0 * time + yaw)
