"""A stereo camera on the front frame: pictures of a scene, on the device of the scene."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from aoro_gym.checks import check_choice, check_integer, check_range
from aoro_gym.sensors.camera.appearance import Appearance
from aoro_gym.sensors.camera.film import white_balance
from aoro_gym.sensors.camera.light import Light
from aoro_gym.sensors.camera.models import MODELS, CameraModel
from aoro_gym.sensors.camera.picture import Picture, Stereo
from aoro_gym.sensors.camera.rendering import Rendering, View
from aoro_gym.sensors.lidar import CLEAR, Motion, Mounting, Weather
from aoro_gym.sensors.raytrace import Scene

OPTICAL = (0.5, -0.5, 0.5, -0.5)
"""Quaternion x, y, z, w from a camera's axes (right, down, ahead) to those of its mounting (ahead, left, up)."""
CAMERA_MOUNTING = Mounting(position=(1.7, 0.06, 2.4), angles_deg=(0.0, 8.0, 0.0))
"""Of the left camera. E: below the cab's roof, looking a little down."""


class StereoCamera:
    """Two cameras in a scene; a pair a world, all alike.

    Args:
        scene: What they see.
        appearance: Of its classes and objects.
        light: Sun and sky.
        model: Name in ``MODELS``, or a model.
        mounting: Of the left camera on the front frame, which looks along x of the mounting; the right one is farther right.
        exposure: [s]; None: automatic, by the first picture of a motion.
        samples: Sub-frames of an exposure, each with a ray of its own in a pixel.
        sky_rays: Rays of each of them for the light of the sky.
        smoothing: Passes that smooth this light over neighbouring pixels; the light of the sun is not smoothed.
        weather: On the way; its extinction is meant at 550 nm.
        undergrowth: Whether its leaves are seen.
        ideal: Without noise.
        seed: Of the noise and of the rays; pictures of other numbers have others.

    Raises ``ValueError`` naming the argument, its value and its bound.
    """

    def __init__(
        self,
        scene: Scene,
        appearance: Appearance,
        light: Light,
        model: str | CameraModel = "stereo",
        *,
        mounting: Mounting = CAMERA_MOUNTING,
        exposure: float | None = None,
        samples: int = 6,
        sky_rays: int = 2,
        smoothing: int = 3,
        weather: Weather = CLEAR,
        undergrowth: bool = True,
        ideal: bool = False,
        seed: int = 0,
    ):
        if isinstance(model, str):
            check_choice("camera model", model, MODELS)
            model = MODELS[model]
        if exposure is not None:
            check_range("exposure", exposure, "s", gt=0.0, le=1.0)
        check_integer("samples", samples, le=4096)
        check_integer("sky_rays", sky_rays, le=256)
        check_integer("smoothing", smoothing, ge=0, le=6)
        check_integer("seed", seed, ge=0)
        self.scene, self.light, self.model = scene, light, model
        self.mounting, self.exposure, self.seed = mounting, exposure, seed
        self.rendering = Rendering(scene.device, model, samples, sky_rays, smoothing, ideal)
        self._look = appearance.on_device(scene, undergrowth=undergrowth)
        self._sky = light.on_device(weather, trees_deg=appearance.horizon_deg)

    def take(
        self,
        motion: Motion,
        *,
        start: float | None = None,
        number: int = 0,
        progress: Callable[[float], None] | None = None,
    ) -> list[Stereo]:
        """Pictures of both cameras, for each world of the motion.

        Args:
            motion: Of the front frames; a single pose stands still.
            start: Time [s] of the motion at which the first row's exposure begins; by default its first.
            number: Of the picture, for its noise.
            progress: Told the share that is done.

        Raises ``ValueError`` where a camera lies inside the ground or an object, or the motion ends before the next picture.
        """
        [pictures] = take_together([Request(self, motion, start, number)], progress=progress)
        return [Stereo(*pair) for pair in zip(*pictures, strict=True)]

    def take_left(
        self,
        motion: Motion,
        *,
        start: float | None = None,
        number: int = 0,
        progress: Callable[[float], None] | None = None,
    ) -> list[Picture]:
        """Pictures of the left cameras alone, in half the time: those of :meth:`take`.

        Args:
            motion: Of the front frames.
            start: Time [s] of the motion at which the first row's exposure begins; by default its first.
            number: Of the picture, for its noise.
            progress: Told the share that is done.
        """
        [pictures] = take_together([Request(self, motion, start, number)], left_only=True, progress=progress)
        return pictures[0]

    def radiance(self, motion: Motion, *, number: int = 0) -> NDArray[np.float32]:
        """(N, H, W, 3) [W/(m² sr)] in red, green and blue that the left cameras of N worlds see as the motion begins."""
        salts = (2 * number + self.seed,)
        return self.rendering.radiance(self._view(motion, float(motion.time[0]), salts))

    def truth(self, motion: Motion, *, start: float | None = None) -> dict[str, NDArray[Any]]:
        """What is true of the pixels of the left cameras of N worlds, each (N, H, W, ...) by the names of :class:`Picture`'s
        fields, without rendering; at the shortest exposure where it is automatic.

        Args:
            motion: Of the front frames.
            start: Time [s] of the motion at which the first row's exposure begins; by default its first.
        """
        return self.rendering.truth(self._view(motion, float(motion.time[0]) if start is None else start, (0,)))

    def view(self, motion: Motion, start: float | None, number: int, cameras: int, lit: int = 0) -> View:
        """What is rendered of a motion, checked but for whether a camera lies in something.

        Args:
            motion: Of the front frames.
            start: Time [s] of the motion at which the first row's exposure begins; None: its first.
            number: Of the picture.
            cameras: 1, the left one, or 2.
            lit: See :class:`Request`.
        """
        check_integer("number", number, ge=0)
        worlds = motion.position.shape[1]
        if worlds + lit > self.scene.num_worlds:
            behind = f", {lit} behind the first," if lit else ""
            raise ValueError(
                f"the motion is of {worlds} worlds{behind or ','} but the scene has {self.scene.num_worlds}"
            )
        begin = float(motion.time[0]) if start is None else start
        interval = 1.0 / self.model.rate
        longest = self.model.exposures[1] if self.exposure is None else self.exposure
        lasts = interval + self.model.intrinsics.height * self.model.line_time + longest
        if len(motion.time) > 1:
            bounds = {"ge": motion.time[0], "le": motion.time[-1] - lasts}
            check_range("start", begin, "s", **bounds, note=": the motion has to last until the next picture, too")
        seeds = [np.random.SeedSequence([self.seed, number, eye]).generate_state(1)[0] for eye in range(cameras)]
        return self._view(motion, begin, tuple(int(seed >> 2) for seed in seeds), lit)

    def _view(self, motion: Motion, begin: float, salts: tuple[int, ...], lit: int = 0) -> View:
        mounted = tuple(self.pose(offset) for offset in (0.0, self.model.baseline)[: len(salts)])
        gains = white_balance(self.model.sensor, self.light)
        return View(
            self.scene.data, self._look, self._sky, mounted, motion, begin, self.exposure, gains, self.seed, salts, lit
        )

    def pose(self, offset: float = 0.0) -> Any:
        """``wp.transform`` to the front frame's axes from those of a camera ``offset`` [m] to the right of the left one."""
        to_mounting = wp.transform(wp.vec3(0.0, -offset, 0.0), wp.quat(*OPTICAL))
        return self.mounting.transform() * to_mounting

    def check_outside(self, motion: Motion, start: float = 0.0) -> None:
        """ValueError where a camera lies inside the ground or an object at a time [s] of the motion."""
        left, right = np.moveaxis(self.places(motion, start), 1, 0)
        self.scene.check_outside("the left camera", left)
        self.scene.check_outside("the right camera", right)

    def places(self, motion: Motion, start: float = 0.0) -> NDArray[np.float64]:
        """(W, 2, 3) [m] of the left and the right camera in each world at a time [s] of a motion."""
        at = int(np.clip(np.searchsorted(motion.time, start), 0, len(motion.time) - 1))
        poses = [wp.transform(*map(float, pose)) for pose in motion.poses[at]]
        offsets = (0.0, self.model.baseline)
        return np.array([[list(pose * self.pose(offset))[:3] for offset in offsets] for pose in poses])


@dataclass(frozen=True, eq=False)
class Request:
    """A picture that is asked for."""

    camera: StereoCamera
    motion: Motion
    """Of the front frames."""
    start: float | None = None
    """Time [s] of the motion at which the first row's exposure begins; None: its first."""
    number: int = 0
    """Of the picture, for its noise."""
    lit: int = 0
    """How far the world of the moving things that light meets is behind that of those that the camera sees: what casts a
    shadow need not be in view."""


def take_together(
    requests: Sequence[Request],
    *,
    left_only: bool = False,
    check: bool = True,
    progress: Callable[[float], None] | None = None,
) -> list[list[list[Picture]]]:
    """Pictures by request, camera and world, rendered by the same launches; each is as it would be alone.

    Args:
        requests: At least one; cameras in any scenes of one device, with one model, and as many rays.
        left_only: Without the right cameras' pictures.
        check: Whether cameras that lie in something are refused.
        progress: Told the share that is rendered.

    Raises ``ValueError`` where cameras are unlike, or as :meth:`StereoCamera.take` does.
    """
    rendering = requests[0].camera.rendering
    for one in requests:
        if one.camera.rendering != rendering:
            raise ValueError(
                f"cameras that take pictures together must be alike, but one is {one.camera.rendering} and another"
                f" {rendering}; take their pictures one after the other"
            )
    eyes = 1 if left_only else 2
    views = [one.camera.view(one.motion, one.start, one.number, eyes, one.lit) for one in requests]
    if check:
        for one, view in zip(requests, views, strict=True):
            one.camera.check_outside(one.motion, view.begin)
    return rendering.pictures(views, progress)
