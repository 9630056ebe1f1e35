"""Command that makes a sweep of a lidar."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from aoro_gym.checks import check_range
from aoro_gym.cli import options
from aoro_gym.cli.options import option
from aoro_gym.cli.outcome import checking_input, conclude, running
from aoro_gym.cli.place import WorldOption
from aoro_gym.cli.sensing import (
    HeadingOption,
    IdealOption,
    PlaceOption,
    SpeedOption,
    TerrainOption,
    WeatherOption,
    straight_on,
    surroundings,
    weather_of,
)
from aoro_gym.reporting import terminal

if TYPE_CHECKING:
    from rich.table import Table

    from aoro_gym.sensors.lidar import Lidar, Motion, Points
    from aoro_gym.sensors.raytrace import Scene
    from aoro_gym.terrains.terrain import Terrain
    from aoro_gym.terrains.world.world import World

ModelOption = Annotated[str, option("--model", "NAME", "os1-64, os1-128, vlp-16 or mid-360.")]
SweepsOption = Annotated[int, option("--sweeps", "N", "One after the other.")]
ReturnOption = Annotated[
    list[str] | None, option("--return", "WHICH", "first, strongest or last echo. Repeatable. Default: strongest.")
]
TOPIC = "/lidar/points"
"""Of a bag."""
PointsOption = Annotated[
    Path, option("--out -o", "FILE", "Points to write: .npz, .pcd, .laz, .las, .mcap or .rosbag2 (a folder).")
]


def lidar(
    out: PointsOption = Path("sweep.npz"),
    model: ModelOption = "os1-64",
    terrain: TerrainOption = None,
    world: WorldOption = None,
    at: PlaceOption = None,
    heading: HeadingOption = None,
    speed: SpeedOption = 0.0,
    sweeps: SweepsOption = 1,
    weather: WeatherOption = None,
    returns: ReturnOption = None,
    ideal: IdealOption = False,
    seed: options.SeedOption = 0,
    device: options.DeviceOption = "cpu",
    json_to: options.JsonOption = None,
    quiet: options.QuietOption = False,
) -> None:
    """Let a lidar look around, from a machine that stands or drives on.

    The machine is in a --world, on a --terrain, or else in a made forest, by --seed: trees, stumps, boulders, logs and
    branches, each with its number and material. Writes FILE with ring, time, intensity, object and class of every point,
    and a picture (.png). A bag holds a PointCloud2 a sweep, on the topic /lidar/points.

    [bold]Examples[/]

      aoro-gym lidar
      aoro-gym lidar --model mid-360 --sweeps 5 --out mid.laz
      aoro-gym lidar --speed 3 --return first --return last --out drive.pcd
      aoro-gym lidar --weather fog=60 --out fog.npz
      aoro-gym lidar --speed 1 --sweeps 20 --out drive.mcap
      aoro-gym lidar --terrain ground.ply --at 10 4 --heading 90
      aoro-gym lidar --world forest --out forest.npz
    """
    with checking_input():
        from aoro_gym.checks import check_choice, check_integer
        from aoro_gym.recording.bag_writing import WRITTEN, check_bag_path
        from aoro_gym.sensors.lidar import MODELS, Lidar
        from aoro_gym.sensors.lidar.figures import draw_sweep
        from aoro_gym.sensors.lidar.points import SUFFIXES, joined

        check_choice("suffix of --out", out.suffix.lower(), (*SUFFIXES, *WRITTEN))
        check_bag_path(out)
        check_choice("--model", model, MODELS)
        check_integer("--sweeps", sweeps, le=1000)
        check_range("--speed", speed, "m/s", ge=-10.0, le=10.0)
        check_range("--heading", 0.0 if heading is None else heading, "deg", ge=-360.0, le=360.0)
        options.check_seed(seed)
        options.check_device(device, simd=False)
        air = weather_of(weather)
        ground, place = surroundings(terrain, world, seed)
        scene = _scene(ground, device)
        sensor = Lidar(scene, model, returns=returns or ["strongest"], weather=air, ideal=ideal, seed=seed)
        at = place[:2] if at is None else at
        turned = place[2] if heading is None else math.radians(heading)
        motion = straight_on(scene, at, turned, speed, sweeps / sensor.model.rate + 0.01)
        first = sensor.sweep(motion)[0]  # what is wrong with the place shows here
    with running():
        each = [first, *_later(sensor, motion, sweeps)]
        points = joined(each, 1.0 / sensor.model.rate)
        if out.suffix.lower() in WRITTEN:
            _write_bag(each, 1.0 / sensor.model.rate, out)
        else:
            points.save(out)
        written = [out]
        if len(points):
            written.append(out.with_suffix(".png"))
            draw_sweep(points, at, title=f"{model}, {len(points):,} points").savefig(written[-1], dpi=110)
    conclude(_summary(points), [_table(points)], written, json_to=json_to, highlight=False)


def _scene(ground: Terrain | World, device: str) -> Scene:
    from aoro_gym.sensors.raytrace import Scene
    from aoro_gym.terrains.world.world import World

    if isinstance(ground, World):
        return Scene.of_world(ground, device=device)
    return Scene.of_terrain(ground, device=device)


def _later(sensor: Lidar, motion: Motion, sweeps: int) -> list[Points]:
    """Sweeps after the first one, under a progress bar."""
    if sweeps == 1:
        return []
    doing, later = "sweeping", []
    with terminal.progress(doing) as tell:
        for n in range(1, sweeps):
            later.append(sensor.sweep(motion, start=n / sensor.model.rate, number=n)[0])
            tell(doing, (n + 1) / sweeps)
    return later


def _write_bag(sweeps: Sequence[Points], period: float, out: Path) -> None:
    """A PointCloud2 a sweep, in the sensor's axes; times of points count from their sweep's beginning."""
    from aoro_gym.recording.sensor_bags import Cloud, write_sensors

    clouds = []
    for number, points in enumerate(sweeps):
        names = ("intensity", "time", "ring", "range", "instance", "class_id", "echo")
        places = {axis: points.points[:, column] for column, axis in enumerate("xyz")}
        clouds.append(Cloud(number * period, places | {name: getattr(points, name) for name in names}))
    write_sensors(out, {TOPIC: clouds})


def _summary(points: Points) -> dict[str, float | int]:
    import numpy as np

    from aoro_gym.sensors.lidar.device import PRECIPITATION, UNDERGROWTH

    return {
        "points": len(points),
        "objects": len(np.unique(points.instance[points.instance > 0])),
        "share_of_ground": float((points.instance == 0).mean()) if len(points) else 0.0,
        "share_of_undergrowth": float((points.instance == UNDERGROWTH).mean()) if len(points) else 0.0,
        "share_of_precipitation": float((points.instance == PRECIPITATION).mean()) if len(points) else 0.0,
        "median_range_m": float(np.median(points.range)) if len(points) else 0.0,
    }


def _table(points: Points) -> Table:
    from rich.table import Table

    table = Table("", "seen", title="Sweep", title_justify="left")
    found = _summary(points)
    table.add_row("points", f"{found['points']:,}")
    table.add_row("objects", f"{found['objects']:,}")
    table.add_row("of the ground", f"{found['share_of_ground']:.0%}")
    table.add_row("of undergrowth", f"{found['share_of_undergrowth']:.0%}")
    table.add_row("of rain, fog or snow", f"{found['share_of_precipitation']:.0%}")
    table.add_row("median range", f"{found['median_range_m']:.1f} m")
    return table
