"""A stereo camera on the front frame: pictures of a scene, on the device of the scene."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any, cast

import numpy as np
import warp as wp
from numpy.typing import NDArray

from aoro_gym.checks import check_choice, check_integer, check_range
from aoro_gym.execution.launches import RecordedLaunch
from aoro_gym.sensors.camera.appearance import Appearance
from aoro_gym.sensors.camera.film import developed, metered, white_balance
from aoro_gym.sensors.camera.kernels.film import expose
from aoro_gym.sensors.camera.kernels.render import Shutter, render
from aoro_gym.sensors.camera.kernels.smoothing import add, smooth
from aoro_gym.sensors.camera.kernels.truth import annotate
from aoro_gym.sensors.camera.light import Light
from aoro_gym.sensors.camera.models import MODELS, CameraModel
from aoro_gym.sensors.camera.picture import LAYERS, Picture, Stereo
from aoro_gym.sensors.lidar import CLEAR, Motion, Mounting, Weather
from aoro_gym.sensors.raytrace import Scene
from aoro_gym.twin.recorded import cores

OPTICAL = (0.5, -0.5, 0.5, -0.5)
"""Quaternion x, y, z, w from a camera's axes (right, down, ahead) to those of its mounting (ahead, left, up)."""
METERED = 48
"""Columns of the picture that automatic exposure looks at."""
BAND = 24
"""Rows of a launch on the CPU: between two of them progress is told, and a core is shared out. A GPU takes all at once."""
BLOCK_DIM = 256
"""Threads a block on CUDA, Warp's own number: another one would compile the kernels again."""
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
        self.mounting, self.exposure, self.ideal, self.seed = mounting, exposure, ideal, seed
        self.samples, self.sky_rays, self.smoothing = samples, sky_rays, smoothing
        self._look = appearance.on_device(scene, undergrowth=undergrowth)
        self._sky = light.on_device(weather, trees_deg=appearance.horizon_deg)
        self._lens = model.intrinsics.on_device()

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
        eyes = (0.0, self.model.baseline)
        return [Stereo(*pair) for pair in zip(*self._taken(motion, start, number, eyes, progress), strict=True)]

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
        return self._taken(motion, start, number, (0.0,), progress)[0]

    def _taken(
        self,
        motion: Motion,
        start: float | None,
        number: int,
        eyes: tuple[float, ...],
        progress: Callable[[float], None] | None,
    ) -> list[list[Picture]]:
        """Pictures of each world, for each of the ``eyes``, which are so far [m] to the right of the left camera."""
        check_integer("number", number, ge=0)
        worlds = motion.position.shape[1]
        if worlds > self.scene.num_worlds:
            raise ValueError(f"the motion is of {worlds} worlds, but the scene has {self.scene.num_worlds}")
        begin = float(motion.time[0]) if start is None else start
        interval = 1.0 / self.model.rate
        longest = self.model.exposures[1] if self.exposure is None else self.exposure
        lasts = interval + self.model.intrinsics.height * self.model.line_time + longest
        if len(motion.time) > 1:
            bounds = {"ge": motion.time[0], "le": motion.time[-1] - lasts}
            check_range("start", begin, "s", **bounds, note=": the motion has to last until the next picture, too")
        times, poses = self._moved(motion, begin)
        self.check_outside(motion, begin)
        exposure = self.exposure
        if exposure is None:
            exposure = metered(self.model.sensor, self._metered(times, poses, worlds), self.model.exposures)
        taken = []
        for eye, offset in enumerate(eyes):
            tell = None if progress is None else (lambda share, eye=eye: progress((eye + share) / len(eyes)))
            salt = int(np.random.SeedSequence([self.seed, number, eye]).generate_state(1)[0] >> 2)
            radiance = self._rendered(times, poses, worlds, offset, exposure, salt, tell)
            numbers = self._exposed(radiance, exposure, salt)
            truth = self._annotated(times, poses, worlds, offset, exposure)
            taken.append(
                [self._picture(numbers[w], [part[w] for part in truth], exposure, begin) for w in range(worlds)]
            )
        return taken

    def radiance(self, motion: Motion, *, number: int = 0) -> NDArray[np.float32]:
        """(N, H, W, 3) [W/(m² sr)] in red, green and blue that the left cameras of N worlds see as the motion begins."""
        times, poses = self._moved(motion, float(motion.time[0]))
        exposure = self.model.exposures[0] if self.exposure is None else self.exposure
        worlds, salt = motion.position.shape[1], 2 * number + self.seed
        rendered: Any = self._rendered(times, poses, worlds, 0.0, exposure, salt, None).numpy()
        return rendered

    def truth(self, motion: Motion, *, start: float | None = None) -> dict[str, NDArray[Any]]:
        """What is true of the pixels of the left cameras of N worlds, each (N, H, W, ...) by the names of :class:`Picture`'s
        fields, without rendering; at the shortest exposure where it is automatic.

        Args:
            motion: Of the front frames.
            start: Time [s] of the motion at which the first row's exposure begins; by default its first.
        """
        times, poses = self._moved(motion, float(motion.time[0]) if start is None else start)
        exposure = self.model.exposures[0] if self.exposure is None else self.exposure
        found = self._annotated(times, poses, motion.position.shape[1], 0.0, exposure)
        return dict(zip(LAYERS, found, strict=True))

    def pose(self, offset: float = 0.0) -> Any:
        """``wp.transform`` to the front frame's axes from those of a camera ``offset`` [m] to the right of the left one."""
        to_mounting = wp.transform(wp.vec3(0.0, -offset, 0.0), wp.quat(*OPTICAL))
        return self.mounting.transform() * to_mounting

    def _moved(self, motion: Motion, begin: float) -> tuple[wp.array, wp.array]:
        device = self.scene.device
        times = wp.array(motion.time - begin, dtype=wp.float32, device=device)
        return times, wp.array(motion.poses, dtype=cast(Any, wp.transform), device=device)

    def check_outside(self, motion: Motion, start: float = 0.0) -> None:
        """ValueError where a camera lies inside the ground or an object at a time [s] of the motion."""
        at = int(np.clip(np.searchsorted(motion.time, start), 0, len(motion.time) - 1))
        for name, offset in (("the left camera", 0.0), ("the right camera", self.model.baseline)):
            places: list[Any] = [wp.transform(*map(float, pose)) * self.pose(offset) for pose in motion.poses[at]]
            self.scene.check_outside(name, [list(place)[:3] for place in places])

    def _shutter(self, exposure: float, samples: int, sky_rays: int) -> Any:
        shutter: Any = Shutter()
        shutter.exposure, shutter.line = exposure, self.model.line_time
        shutter.samples, shutter.sky_rays = samples, sky_rays
        return shutter

    def _metered(self, times: wp.array, poses: wp.array, worlds: int) -> NDArray[Any]:
        """Radiance of every n-th pixel."""
        every = max(self.model.intrinsics.width // METERED, 1)
        lens = self.model.intrinsics
        layers = self._layers((worlds, lens.height // every, lens.width // every))
        shutter = self._shutter(self.model.exposures[0], 1, 4)
        self._launch(times, poses, shutter, self.pose(), self.seed, (0, lens.height // every), every, layers)()
        return self._summed(layers, 0).numpy()

    def _rendered(
        self,
        times: wp.array,
        poses: wp.array,
        worlds: int,
        offset: float,
        exposure: float,
        salt: int,
        progress: Callable[[float], None] | None,
    ) -> wp.array:
        """Radiance (W, H, W) of a camera, by bands of rows."""
        lens = self.model.intrinsics
        layers = self._layers((worlds, lens.height, lens.width))
        shutter = self._shutter(exposure, self.samples, self.sky_rays)
        band = BAND if self.scene.device == "cpu" else lens.height
        launches = [
            self._launch(
                times, poses, shutter, self.pose(offset), salt, (first, min(band, lens.height - first)), 1, layers
            )
            for first in range(0, lens.height, band)
        ]
        pool = ThreadPoolExecutor(cores() if self.scene.device == "cpu" else 1)  # a launch on the CPU takes one core
        try:
            waiting = [pool.submit(launch) for launch in launches]
            for number, one in enumerate(waiting, start=1):
                one.result()
                if progress is not None:
                    progress(number / len(waiting))
        finally:
            pool.shutdown(cancel_futures=True)
        return self._summed(layers, self.smoothing)

    def _layers(self, shape: tuple[int, int, int]) -> list[wp.array]:
        """What the renderer writes."""
        kinds: list[Any] = [wp.vec3, wp.vec3, wp.vec3, wp.vec4]
        return [wp.empty(shape, dtype=kind, device=self.scene.device) for kind in kinds]

    def _launch(
        self,
        times: wp.array,
        poses: wp.array,
        shutter: Any,
        pose: Any,
        salt: int,
        rows: tuple[int, int],
        every: int,
        layers: list[wp.array],
    ) -> Callable[[], Any]:
        """What renders some ``rows``, first and count."""
        inputs = [self.scene.data, self._look, self._sky, self._lens, shutter, pose, self.model.reach]
        inputs += [salt, rows[0], every, times, poses, *layers]
        shape: Any = (layers[0].shape[0], rows[1], layers[0].shape[2])
        return RecordedLaunch(render, shape, inputs, device=self.scene.device, block_dim=BLOCK_DIM).launch

    def _summed(self, layers: list[wp.array], passes: int) -> wp.array:
        """Radiance (W, H, W), its light smoothed so many times."""
        direct, reflected, light, guide = layers
        device, other = self.scene.device, wp.empty_like(light)
        for number in range(passes):
            wp.launch(smooth, dim=light.shape, inputs=[light, guide, 2**number], outputs=[other], device=device)
            light, other = other, light
        wp.launch(add, dim=light.shape, inputs=[direct, reflected, light], outputs=[other], device=device)
        return other

    def _exposed(self, radiance: wp.array, exposure: float, salt: int) -> NDArray[Any]:
        """Numbers (W, H, W, 3) of the converter."""
        numbers = wp.empty_like(radiance)
        film = self.model.sensor.on_device(exposure, not self.ideal)
        inputs = [radiance, film, salt + 1]
        wp.launch(expose, dim=radiance.shape, inputs=inputs, outputs=[numbers], device=self.scene.device)
        return numbers.numpy()

    def _annotated(
        self, times: wp.array, poses: wp.array, worlds: int, offset: float, exposure: float
    ) -> list[NDArray[Any]]:
        """All that is true of the pixels of a camera, each (W, H, W, ...)."""
        shape = (worlds, self.model.intrinsics.height, self.model.intrinsics.width)
        kinds: Any = (wp.float32, wp.float32, wp.int32, wp.uint8, wp.vec3, wp.vec2, wp.uint8)
        outputs: list[Any] = [wp.empty(shape, dtype=kind, device=self.scene.device) for kind in kinds]
        shutter = self._shutter(exposure, 1, 1)
        inputs = [self.scene.data, self._look, self._sky, self._lens, shutter, self.pose(offset), self.model.reach]
        inputs += [self.model.baseline, 1.0 / self.model.rate, times, poses]
        wp.launch(annotate, dim=shape, inputs=inputs, outputs=outputs, device=self.scene.device)
        *found, sunlit = (output.numpy() for output in outputs)
        return [*found, sunlit.astype(bool)]

    def _picture(self, numbers: NDArray[Any], truth: list[NDArray[Any]], exposure: float, time: float) -> Picture:
        sensor = self.model.sensor
        rgb = developed(sensor, numbers, white_balance(sensor, self.light))
        layers: dict[str, Any] = dict(zip(LAYERS, truth, strict=True))
        return Picture(rgb=rgb, numbers=numbers.astype(np.uint16), exposure=exposure, time=time, **layers)
