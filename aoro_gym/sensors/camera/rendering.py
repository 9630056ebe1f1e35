"""Rendering of many pictures at once: each step is one launch for all of them, and one copy brings them home.

On the CPU a step is a launch for each band of rows, which the cores share out.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, cast

import numpy as np
import warp as wp
from numpy.typing import NDArray

from aoro_gym.execution.launches import RecordedLaunch
from aoro_gym.execution.together import Together
from aoro_gym.sensors.camera.film import SensorModel, developed, metered
from aoro_gym.sensors.camera.kernels.film import Film, expose
from aoro_gym.sensors.camera.kernels.render import Shot, Shutter, render
from aoro_gym.sensors.camera.kernels.smoothing import add, smooth
from aoro_gym.sensors.camera.kernels.truth import annotate
from aoro_gym.sensors.camera.models import CameraModel
from aoro_gym.sensors.camera.picture import LAYERS, Picture
from aoro_gym.sensors.lidar import Motion
from aoro_gym.twin.recorded import cores

METERED = 48
"""Columns of the picture that automatic exposure looks at."""
BAND = 24
"""Rows of a launch on the CPU: between two of them progress is told, and a core is shared out. A GPU takes all at once."""
BLOCK_DIM = 256
"""Threads a block on CUDA, Warp's own number: another one would compile the kernels again."""
RENDERED: tuple[Any, ...] = (wp.vec3, wp.vec3, wp.vec3, wp.vec4)
"""Types of what the renderer writes."""
TRUE: tuple[Any, ...] = (wp.float32, wp.float32, wp.int32, wp.uint8, wp.vec3, wp.vec2, wp.uint8)
"""Types of :data:`LAYERS`."""

Tell = Callable[[float], Any]
"""Told the share that is done."""


@dataclass(frozen=True, eq=False)
class View:
    """What a camera, or each of two, takes in each world of a motion; structs are those of device code."""

    rays: Any
    look: Any
    sky: Any
    mounted: tuple[Any, ...]
    """``wp.transform`` from the axes of each camera to the front frame's."""
    motion: Motion
    begin: float
    """Time [s] of the motion at which the first row's exposure begins."""
    exposure: float | None
    """[s]; None: automatic, by the first camera."""
    gains: NDArray[np.float64]
    """(3,) white balance."""
    seed: int
    """Of the rays by which exposure is found."""
    salts: tuple[int, ...]
    """Of rays and noise of each camera."""
    lit: int = 0
    """World of the moving things that light meets less that of those that a camera sees."""

    @property
    def worlds(self) -> int:
        """Of its motion."""
        return self.motion.position.shape[1]


@dataclass(frozen=True)
class Rendering:
    """How pictures are rendered that are taken together."""

    device: str
    model: CameraModel
    samples: int
    """Rays of a pixel."""
    sky_rays: int
    """Of each of them."""
    smoothing: int
    """Passes over the light of the sky."""
    ideal: bool
    """Without noise."""

    def pictures(self, views: Sequence[View], progress: Tell | None = None) -> list[list[list[Picture]]]:
        """Pictures by view, camera and world."""
        moved = _moved(views, self.device)
        exposures = self._exposures(views, moved)
        shots = self._shots(views, moved, exposures)
        shape = (len(shots), self.model.intrinsics.height, self.model.intrinsics.width)
        home = Together([(*shape, 3), *[shape] * len(TRUE)], [wp.uint16, *TRUE], device=self.device)
        radiance = self._rendered(shots, shape, progress)
        self._expose(radiance, views, exposures, home.arrays[0])
        self._annotate(shots, shape, home.arrays[1:])
        numbers, *truth = home.home()
        taken = iter(range(len(shots)))
        return [
            [
                [
                    self._picture(numbers[n], [part[n] for part in truth], view, exposure)
                    for _, n in zip(range(view.worlds), taken, strict=False)
                ]
                for _ in view.mounted
            ]
            for view, exposure in zip(views, exposures, strict=True)
        ]

    def radiance(self, view: View) -> NDArray[np.float32]:
        """(N, H, W, 3) [W/(m² sr)] of the cameras, at the shortest exposure where it is automatic."""
        shots = self._shots([view], _moved([view], self.device), [self._shortest(view)])
        found: Any = self._rendered(
            shots, (len(shots), self.model.intrinsics.height, self.model.intrinsics.width)
        ).numpy()
        return found

    def truth(self, view: View) -> dict[str, NDArray[Any]]:
        """What is true, each (N, H, W, ...), at the shortest exposure where it is automatic."""
        shots = self._shots([view], _moved([view], self.device), [self._shortest(view)])
        shape = (len(shots), self.model.intrinsics.height, self.model.intrinsics.width)
        home = Together([shape] * len(TRUE), TRUE, device=self.device)
        self._annotate(shots, shape, home.arrays)
        *found, sunlit = home.home()
        return dict(zip(LAYERS, [*found, sunlit.astype(bool)], strict=True))

    def _shortest(self, view: View) -> float:
        return self.model.exposures[0] if view.exposure is None else view.exposure

    def _exposures(self, views: Sequence[View], moved: list[tuple[Any, Any]]) -> list[float]:
        """Of each view, automatic ones by every n-th pixel of its first cameras."""
        chosen = [k for k, view in enumerate(views) if view.exposure is None]
        out = [self._shortest(view) for view in views]
        if not chosen:
            return out
        lens = self.model.intrinsics
        every = max(lens.width // METERED, 1)
        shots = [
            shot
            for k in chosen
            for shot in self._shots_of(views[k], moved[k], self.model.exposures[0], (views[k].seed,))
        ]
        layers = self._render(shots, (len(shots), lens.height // every, lens.width // every), 1, 4, every, None)
        seen = self._summed(layers, 0).numpy()
        begin = 0
        for k in chosen:
            of_it = seen[begin : begin + views[k].worlds]
            out[k] = metered(self.model.sensor, of_it, self.model.exposures)
            begin += views[k].worlds
        return out

    def _shots(self, views: Sequence[View], moved: list[tuple[Any, Any]], exposures: Sequence[float]) -> list[Any]:
        return [
            shot
            for view, arrays, exposure in zip(views, moved, exposures, strict=True)
            for shot in self._shots_of(view, arrays, exposure, view.salts)
        ]

    def _shots_of(self, view: View, moved: tuple[Any, Any], exposure: float, salts: tuple[int, ...]) -> list[Any]:
        """Structs for device code, worlds within cameras, as many cameras as ``salts``."""
        out = []
        for mounting, salt in zip(view.mounted, salts, strict=False):
            for world in range(view.worlds):
                shot: Any = Shot()
                shot.rays, shot.look, shot.sky, shot.mounting = view.rays, view.look, view.sky, mounting
                shot.times, shot.poses = moved
                shot.world, shot.bodies, shot.lit = world, world, world + view.lit
                shot.exposure, shot.salt = exposure, salt
                out.append(shot)
        return out

    def _shutter(self, samples: int, sky_rays: int) -> Any:
        shutter: Any = Shutter()
        shutter.line, shutter.samples, shutter.sky_rays = self.model.line_time, samples, sky_rays
        return shutter

    def _rendered(self, shots: list[Any], shape: tuple[int, int, int], progress: Tell | None = None) -> wp.array:
        """Radiance of shots of a shape (S, H, W)."""
        return self._summed(self._render(shots, shape, self.samples, self.sky_rays, 1, progress), self.smoothing)

    def _render(
        self,
        shots: list[Any],
        shape: tuple[int, int, int],
        samples: int,
        sky_rays: int,
        every: int,
        progress: Tell | None,
    ) -> list[wp.array]:
        """What the renderer writes of every n-th pixel.

        Args:
            shots: Structs.
            shape: (S, H, W) of what is rendered.
            samples: Rays of a pixel.
            sky_rays: Of each of them.
            every: Pixels from a rendered one to the next.
            progress: Told the share that is done.
        """
        layers = [wp.empty(shape, dtype=kind, device=self.device) for kind in RENDERED]
        lens, shutter = self.model.intrinsics.on_device(), self._shutter(samples, sky_rays)
        structs = wp.array(shots, dtype=cast(Any, Shot), device=self.device)
        before = [structs, lens, shutter, self.model.reach]
        self._by_rows(render, shape, lambda first: [*before, first, every, *layers], progress)
        return layers

    def _annotate(self, shots: list[Any], shape: tuple[int, int, int], layers: Sequence[wp.array]) -> None:
        """Write what is true of all pixels."""
        structs = wp.array(shots, dtype=cast(Any, Shot), device=self.device)
        before = [structs, self.model.intrinsics.on_device(), self._shutter(1, 1), self.model.reach]
        before += [self.model.baseline, 1.0 / self.model.rate]
        self._by_rows(annotate, shape, lambda first: [*before, first, *layers], None)

    def _by_rows(
        self, kernel: Any, shape: tuple[int, int, int], inputs: Callable[[int], list[Any]], progress: Tell | None
    ) -> None:
        """Launch a kernel over shots, rows and columns; ``inputs`` are for the first row of a launch."""
        count, height, width = shape
        band = BAND if self.device == "cpu" else height
        launches = [
            RecordedLaunch(
                kernel,
                cast(Any, (count, min(band, height - first), width)),
                inputs(first),
                device=self.device,
                block_dim=BLOCK_DIM,
            ).launch
            for first in range(0, height, band)
        ]
        pool = ThreadPoolExecutor(cores() if self.device == "cpu" else 1)  # a launch on the CPU takes one core
        try:
            waiting = [pool.submit(launch) for launch in launches]
            for number, one in enumerate(waiting, start=1):
                one.result()
                if progress is not None:
                    progress(number / len(waiting))
        finally:
            pool.shutdown(cancel_futures=True)

    def _summed(self, layers: list[wp.array], passes: int) -> wp.array:
        """Radiance (S, H, W), its light smoothed so many times."""
        direct, reflected, light, guide = layers
        other = wp.empty_like(light)
        for number in range(passes):
            wp.launch(smooth, dim=light.shape, inputs=[light, guide, 2**number], outputs=[other], device=self.device)
            light, other = other, light
        wp.launch(add, dim=light.shape, inputs=[direct, reflected, light], outputs=[other], device=self.device)
        return other

    def _expose(self, radiance: wp.array, views: Sequence[View], exposures: Sequence[float], numbers: wp.array) -> None:
        """Write the converter's numbers (S, H, W, 3)."""
        films = []
        for view, exposure in zip(views, exposures, strict=True):
            for salt in view.salts:
                for world in range(view.worlds):
                    film = self.model.sensor.on_device(exposure, not self.ideal)
                    film.seed, film.world = salt + 1, world
                    films.append(film)
        inputs = [radiance, wp.array(films, dtype=cast(Any, Film), device=self.device)]
        wp.launch(expose, dim=radiance.shape, inputs=inputs, outputs=[numbers], device=self.device)

    def _picture(self, numbers: NDArray[Any], truth: list[NDArray[Any]], view: View, exposure: float) -> Picture:
        *found, sunlit = truth
        layers: dict[str, Any] = dict(zip(LAYERS, [*found, sunlit.view(bool)], strict=True))
        rgb = _curve(self.model.sensor, tuple(view.gains.tolist()))[numbers, np.arange(3)]
        return Picture(rgb=rgb, numbers=numbers, exposure=exposure, time=view.begin, **layers)


def _moved(views: Sequence[View], device: str) -> list[tuple[Any, Any]]:
    """Times and poses of each view's motion on the device, all of them by two copies."""
    counts = [len(view.motion.time) for view in views]
    ends = np.cumsum([0, *counts])
    places = np.cumsum([0, *(count * view.worlds for count, view in zip(counts, views, strict=True))])
    transform = cast(Any, wp.transform)
    times = wp.array(np.concatenate([view.motion.time - view.begin for view in views]), dtype=wp.float32, device=device)
    every = np.concatenate([view.motion.poses.reshape(-1, 7) for view in views])
    poses: Any = wp.array(every, dtype=transform, device=device)
    return [
        (
            times[int(ends[k]) : int(ends[k + 1])],
            poses[int(places[k]) : int(places[k + 1])].reshape((counts[k], view.worlds)),
        )
        for k, view in enumerate(views)
    ]


@lru_cache(maxsize=64)
def _curve(sensor: SensorModel, gains: tuple[float, ...]) -> NDArray[np.uint8]:
    """(M, 3) colours of all numbers of the converter."""
    every = np.repeat(np.arange(sensor.most + 1, dtype=np.float32)[:, None], 3, axis=1)
    return developed(sensor, every, np.array(gains))
