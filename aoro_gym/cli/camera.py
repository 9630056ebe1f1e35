"""Command that takes pictures with a stereo camera."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

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

    from aoro_gym.sensors.camera import Appearance, CameraModel, Stereo, StereoCamera
    from aoro_gym.sensors.lidar import Motion
    from aoro_gym.sensors.raytrace import Scene
    from aoro_gym.terrains.terrain import Terrain
    from aoro_gym.terrains.world.world import World

ModelOption = Annotated[str, option("--model", "NAME", "stereo, stereo-wide, stereo-rolling or stereo-hd.")]
WidthOption = Annotated[int | None, option("--width", "PIXELS", "Of a picture, seeing as much. Default: the model's.")]
SeasonOption = Annotated[str, option("--season", "NAME", "spring, summer, autumn or winter.")]
HourOption = Annotated[float, option("--hour", "H", "Solar time; 12 is noon.")]
CloudOption = Annotated[float | None, option("--cloud", "SHARE", "Of the sky. Default: 0, in any --weather 1.")]
ExposureOption = Annotated[float | None, option("--exposure", "MS", "Default: automatic.")]
SamplesOption = Annotated[int, option("--samples", "N", "Rays a pixel, over its area and its exposure.")]
FramesOption = Annotated[int, option("--frames", "N", "Pairs of pictures, one after the other.")]
OutOption = Annotated[Path, option("--out -o", "FOLDER", "Folder to write to.")]
VISIBLE_NM = 550.0
"""Wavelength at which weather is that of a camera."""


def camera(
    out: OutOption = Path("camera"),
    model: ModelOption = "stereo",
    width: WidthOption = None,
    terrain: TerrainOption = None,
    world: WorldOption = None,
    at: PlaceOption = None,
    heading: HeadingOption = None,
    speed: SpeedOption = 0.0,
    frames: FramesOption = 1,
    season: SeasonOption = "summer",
    hour: HourOption = 10.0,
    cloud: CloudOption = None,
    weather: WeatherOption = None,
    exposure: ExposureOption = None,
    samples: SamplesOption = 6,
    ideal: IdealOption = False,
    seed: options.SeedOption = 0,
    device: options.DeviceOption = "cpu",
    json_to: options.JsonOption = None,
    quiet: options.QuietOption = False,
) -> None:
    """Take pictures with a stereo camera, from a machine that stands or drives on.

    The machine is in a --world, on a --terrain, or else in a made forest, by --seed. Writes into FOLDER what both cameras
    see (left_0000.png, right_0000.png), what is true of each pixel (.npz: depth, disparity, instance, class, normals,
    flow, whether the sun shines on it), a sheet of all this (sheet.png) and the calibration (calibration.json).

    [bold]Examples[/]

      aoro-gym camera
      aoro-gym camera --season autumn --hour 16 --at 10 -30 --heading 80
      aoro-gym camera --season winter --hour 11 --out winter
      aoro-gym camera --weather fog=60 --model stereo-wide --out fog
      aoro-gym camera --speed 2 --frames 10 --width 320 --out drive
      aoro-gym camera --world forest --device cuda:0 --samples 64
    """
    with checking_input():
        from aoro_gym.checks import check_integer
        from aoro_gym.execution.files import write_json
        from aoro_gym.sensors.camera import StereoCamera, daylight
        from aoro_gym.sensors.camera.figures import calibration, draw_outputs

        options.check_folder(out, "sheet.png")
        check_integer("--frames", frames, le=10_000)
        check_integer("--samples", samples, le=4096)
        check_range("--speed", speed, "m/s", ge=-10.0, le=10.0)
        check_range("--heading", 0.0 if heading is None else heading, "deg", ge=-360.0, le=360.0)
        options.check_seed(seed)
        options.check_device(device, simd=False)
        chosen = _model(model, width)
        air = weather_of(weather, wavelength_nm=VISIBLE_NM)
        light = daylight(season, hour=hour, cloud=float(weather is not None) if cloud is None else cloud)
        shutter = None if exposure is None else exposure / 1000.0
        ground, place = surroundings(terrain, world, seed, snow=season == "winter")
        scene, appearance = _scene(ground, season, weather, device)
        sensor = StereoCamera(
            scene, appearance, light, chosen, exposure=shutter, samples=samples, weather=air, ideal=ideal, seed=seed
        )
        turned = place[2] if heading is None else math.radians(heading)
        lasts = (frames + 1) / chosen.rate + 1.1
        motion = straight_on(scene, place[:2] if at is None else at, turned, speed, lasts)
        sensor.check_outside(motion)
    with running():
        out.mkdir(parents=True, exist_ok=True)
        first, written = _taken(sensor, motion, frames, out)
        title = f"{model}, {season}, {hour:g} h, exposure {1000.0 * first.left.exposure:.3g} ms"
        draw_outputs(first, title=title).savefig(out / "sheet.png", dpi=90)
        write_json(out / "calibration.json", calibration(chosen))
        written += [out / "sheet.png", out / "calibration.json"]
    found = _summary(first)
    conclude(found, [_table(found)], written, json_to=json_to, highlight=False)


def _model(name: str, width: int | None) -> CameraModel:
    from aoro_gym.checks import check_choice, check_integer
    from aoro_gym.sensors.camera import MODELS

    check_choice("--model", name, MODELS)
    if width is None:
        return MODELS[name]
    check_integer("--width", width, ge=16, le=8192)
    return MODELS[name].resized(width)


def _scene(ground: Terrain | World, season: str, weather: str | None, device: str) -> tuple[Scene, Appearance]:
    """What rays meet and how it looks; what rain falls on is wet."""
    from aoro_gym.sensors.camera import Appearance
    from aoro_gym.sensors.raytrace import Scene
    from aoro_gym.terrains.world.world import World

    wetness = 1.0 if weather is not None and weather.startswith("rain") else 0.0
    with terminal.progress("growing crowns"):
        if isinstance(ground, World):
            return Scene.of_world(ground, fine=True, device=device), Appearance.of_world(
                ground, season, wetness=wetness
            )
        bare = replace(Appearance.of_surfaces(season, wetness=wetness), horizon_deg=6.0)
        return Scene.of_terrain(ground, device=device), bare


def _taken(sensor: StereoCamera, motion: Motion, frames: int, out: Path) -> tuple[Stereo, list[Path]]:
    """The first pair, and the files of all."""
    from aoro_gym.sensors.camera.figures import save_picture

    doing, written, first = "rendering", [], None
    with terminal.progress(doing) as tell:
        for number in range(frames):
            [pair] = sensor.take(
                motion,
                start=number / sensor.model.rate,
                number=number,
                progress=lambda share, number=number: tell(doing, (number + share) / frames),
            )
            first = pair if first is None else first
            for name, picture in zip(("left", "right"), pair, strict=True):
                path = out / f"{name}_{number:04d}.png"
                written += [path, save_picture(picture, path)]
    assert first is not None
    return first, written


def _summary(pair: Stereo) -> dict[str, Any]:
    import numpy as np

    from aoro_gym.sensors.camera import NOTHING, UNDERGROWTH

    left = pair.left
    seen = np.isfinite(left.depth)
    return {
        "exposure_ms": 1000.0 * left.exposure,
        "objects": len(np.unique(left.instance[left.instance > 0])),
        "share_of_ground": float((left.instance == 0).mean()),
        "share_of_undergrowth": float((left.instance == UNDERGROWTH).mean()),
        "share_of_sky": float((left.instance == NOTHING).mean()),
        "share_in_the_sun": float(left.sunlit[seen].mean()) if seen.any() else 0.0,
        "median_depth_m": float(np.median(left.depth[seen])) if seen.any() else 0.0,
    }


def _table(found: dict[str, Any]) -> Table:
    from rich.table import Table

    table = Table("", "seen", title="Left picture", title_justify="left")
    table.add_row("exposure", f"{found['exposure_ms']:.3g} ms")
    table.add_row("objects", f"{found['objects']:,}")
    table.add_row("of the ground", f"{found['share_of_ground']:.0%}")
    table.add_row("of undergrowth", f"{found['share_of_undergrowth']:.0%}")
    table.add_row("of sky", f"{found['share_of_sky']:.0%}")
    table.add_row("of surfaces in the sun", f"{found['share_in_the_sun']:.0%}")
    table.add_row("median depth", f"{found['median_depth_m']:.1f} m")
    return table
