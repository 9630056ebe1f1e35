"""One place of a made forest in six lights, and how fast a camera is: the figures and the picture of docs/howto/camera.md.

python -m studies.camera_pictures --picture lights.jpg
python -m studies.camera_pictures --device cuda:0 --worlds 64
"""

from __future__ import annotations

import argparse
import time
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from aoro_gym.cli.sensing import straight_on
from aoro_gym.sensors.camera import MODELS, Appearance, StereoCamera, daylight
from aoro_gym.sensors.lidar import CLEAR, Motion, Weather
from aoro_gym.sensors.raytrace import Scene
from aoro_gym.terrains.generate.world import world

SEED, AT, HEADING_DEG = 3, (-30.2, 29.8), 247.5
"""Of the forest and of the place in it."""


@dataclass(frozen=True)
class View:
    """A light and a weather."""

    season: str
    hour: float
    cloud: float = 0.0
    weather: Weather = CLEAR
    wetness: float = 0.0


VIEWS = (
    View("summer", 10.0),
    View("summer", 19.5),
    View("autumn", 14.0),
    View("winter", 12.0),
    View("summer", 9.0, cloud=1.0, weather=Weather.fog(60.0, 550.0)),
    View("autumn", 12.0, cloud=1.0, weather=Weather.rain(10.0), wetness=1.0),
)


def main() -> None:
    parser = argparse.ArgumentParser(description="Pictures of a forest, and their speed")
    parser.add_argument("--device", default="cpu")
    parser.add_argument("--width", type=int, default=400)
    parser.add_argument("--samples", type=int, default=8)
    parser.add_argument("--worlds", type=int, default=1, help="cameras at once, for the speed")
    parser.add_argument("--picture", help="file to write")
    asked = parser.parse_args()
    scenes = {snow: _scene(snow, asked.device) for snow in (False, True)}
    if asked.picture:
        from PIL import Image

        panels = [_seen(*scenes[view.season == "winter"], view, asked.width, asked.samples) for view in VIEWS]
        sheet = np.vstack([np.hstack(panels[:3]), np.hstack(panels[3:])])
        Image.fromarray(sheet).save(asked.picture, quality=88)
    measure(*scenes[False], asked.device, asked.worlds)


def _scene(snow: bool, device: str) -> tuple[Any, Scene]:
    made = world(SEED, snow=snow)
    return made, Scene.of_world(made, fine=True, num_worlds=4096, device=device)


def _seen(made: Any, scene: Scene, view: View, width: int, samples: int) -> NDArray[np.uint8]:
    camera = StereoCamera(
        scene,
        Appearance.of_world(made, view.season, wetness=view.wetness),
        daylight(view.season, hour=view.hour, cloud=view.cloud),
        MODELS["stereo"].resized(width),
        samples=samples,
        weather=view.weather,
    )
    [[left, _]] = camera.take(straight_on(scene, AT, np.radians(HEADING_DEG), 0.0, 1.0))
    return left.rgb


def measure(made: Any, scene: Scene, device: str, worlds: int) -> None:
    """Pictures a second of 160 x 120 pixels on the host: in colour, and of what is true of their pixels.

    A ray of a pixel in colour takes one to the sun and two to the sky, each of which takes one more to the sun where it
    meets something: six at most, those that go on behind gaps of foliage not counted. On the CPU, seconds are those of CPU
    time on a core, which other work hardly changes.
    """
    camera = StereoCamera(scene, Appearance.of_world(made), daylight(), MODELS["stereo"].resized(160), exposure=2e-3)
    one = straight_on(scene, AT, np.radians(HEADING_DEG), 0.0, 1.0)
    motion = Motion(one.time, *(np.repeat(a, worlds, axis=1) for a in (one.position, one.roll, one.pitch, one.yaw)))
    for name, call, rays in (
        ("colours", lambda: camera.radiance(motion), 6 * camera.rendering.samples),
        ("truth", lambda: camera.truth(motion), 2),
    ):
        call()
        clock = time.process_time if device == "cpu" else time.perf_counter
        begun = clock()
        call()
        seconds = clock() - begun
        rate = rays * worlds * 160 * 120 / seconds
        print(f"{device} {name}: {worlds / seconds:.3g} pictures/s, {rate / 1e6:.3g} M rays/s at most")


if __name__ == "__main__":
    main()
