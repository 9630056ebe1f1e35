"""A lidar on the front frame: sweeps of a scene, on the device of the scene."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, cast

import numpy as np
import warp as wp
from numpy.typing import ArrayLike, NDArray

from aoro_gym.checks import check_choice, check_finite, check_integer, check_range
from aoro_gym.sensors.attitude import quaternion_of
from aoro_gym.sensors.lidar import device as device_code
from aoro_gym.sensors.lidar.models import MODELS, Firings, LidarModel
from aoro_gym.sensors.lidar.points import FIRST, LAST, STRONGEST, Points
from aoro_gym.sensors.lidar.weather import CLEAR, Weather
from aoro_gym.sensors.raytrace import Scene

Array = NDArray[np.float64]
MOST_SUBRAYS = 16
THRESHOLD_TO_NOISE = 5.0
"""Detection threshold over the noise of the received power (E): one false alarm in 3.5 million samples of noise."""
NINE_OF_TEN = 1.2816
"""Standard deviations by which a mean lies above a threshold that nine of ten samples pass."""
RETURNS = {"first": FIRST, "strongest": STRONGEST, "last": LAST}


@dataclass(frozen=True, eq=False)
class Motion:
    """Poses of front frames over time; positions and rotations in between are interpolated linearly.

    Raises ``ValueError`` naming the value and its bound.
    """

    time: Array
    """(T,) [s], rising."""
    position: Array
    """(T, 3), or (T, W, 3) for W worlds [m], of the origin of the front frame's axes, as the twin's ``position_x`` ..."""
    roll: Array
    """(T,) or (T, W) [rad] as the twin's output."""
    pitch: Array
    yaw: Array

    def __post_init__(self) -> None:
        for name in ("time", "position", "roll", "pitch", "yaw"):
            object.__setattr__(self, name, np.asarray(getattr(self, name), dtype=np.float64))
            check_finite(f"motion {name}", getattr(self, name))
        if self.position.ndim == 2:
            object.__setattr__(self, "position", self.position[:, None])
        count = len(self.time)
        if self.time.ndim != 1 or not count or self.position.shape[:1] + self.position.shape[2:] != (count, 3):
            shapes = f"{self.time.shape} and {self.position.shape}"
            raise ValueError(
                f"motion time and position have the shapes {shapes}, but must be (T,) and (T, 3) or (T, W, 3)"
            )
        check_range("step of motion time", np.diff(self.time), "s", gt=0.0)
        for name in ("roll", "pitch", "yaw"):
            values = getattr(self, name)
            values = values[:, None] if values.ndim == 1 else values
            if values.shape != self.position.shape[:2]:
                raise ValueError(
                    f"motion {name} has the shape {values.shape}, but must be {self.position.shape[:2]} as the position"
                )
            object.__setattr__(self, name, values)

    @classmethod
    def still(cls, position: ArrayLike, *, roll: float = 0.0, pitch: float = 0.0, yaw: float = 0.0) -> Motion:
        """One machine that stands at ``position`` (3,) [m] with its angles [rad]."""
        return cls(*(np.atleast_1d(np.asarray(part, dtype=float)) for part in (0.0, [position], roll, pitch, yaw)))

    @property
    def poses(self) -> NDArray[np.float32]:
        """(T, W, 7) position and quaternion x, y, z, w."""
        turned = quaternion_of(self.roll, self.pitch, self.yaw)
        return np.concatenate([self.position, turned], axis=-1).astype(np.float32)


@dataclass(frozen=True)
class Mounting:
    """Where a sensor sits in the front frame's axes, and the errors that nobody knows of."""

    position: tuple[float, float, float] = (1.6, 0.0, 2.6)
    """[m] from the point on the ground under the hinge at rest. E: at the cab's front edge, above the roof."""
    angles_deg: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Roll, pitch (positive: nose down) and yaw [deg]."""
    position_error: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """[m] by which it truly sits elsewhere."""
    angle_errors_deg: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """[deg] by which it is truly turned further."""

    def __post_init__(self) -> None:
        for name in ("position", "angles_deg", "position_error", "angle_errors_deg"):
            check_finite(f"mounting {name}", getattr(self, name))

    def transform(self, *, true: bool = True) -> Any:
        """From the sensor's axes to the front frame's, as a ``wp.transform``; with its errors, or as one believes it."""
        share = 1.0 if true else 0.0
        place = np.add(self.position, np.multiply(share, self.position_error))
        turned = quaternion_of(*np.radians(np.add(self.angles_deg, np.multiply(share, self.angle_errors_deg))))
        return wp.transform(*map(float, place), *map(float, turned))


class Lidar:
    """A lidar in a scene; one a world, all alike.

    Args:
        scene: What it sees.
        model: Name in ``MODELS``, or a model.
        mounting: On the front frame.
        subrays: Rays across a beam, 1 to 16, each with the same share of a Gaussian beam's energy.
        returns: Which echoes of a pulse are reported: of ``first``, ``strongest``, ``last``.
        weather: On the way.
        ideal: Without noise of range and power, and with ranges as fine as they come.
        seed: Of the noise; sweeps of other numbers have other noise.

    Raises ``ValueError`` naming the argument, its value and its bound.
    """

    def __init__(
        self,
        scene: Scene,
        model: str | LidarModel = "os1-64",
        *,
        mounting: Mounting | None = None,
        subrays: int = 5,
        returns: Sequence[str] = ("strongest",),
        weather: Weather = CLEAR,
        ideal: bool = False,
        seed: int = 0,
    ):
        if isinstance(model, str):
            check_choice("lidar model", model, MODELS)
            model = MODELS[model]
        check_integer("subrays", subrays, le=MOST_SUBRAYS)
        check_integer("seed", seed, ge=0)
        if isinstance(returns, str) or not returns:
            raise ValueError(f"returns is {returns!r}; give at least one of {', '.join(RETURNS)}, as a list")
        for name in returns:
            check_choice("returns", name, RETURNS)
        self.scene, self.model, self.weather, self.seed = scene, model, weather, seed
        self.mounting = Mounting() if mounting is None else mounting
        self.returns = sum({RETURNS[name] for name in returns})
        self._sensor = device_sensor(model, self.mounting, subrays, ideal)
        self._air = device_air(model, weather, self.threshold)

    @property
    def threshold(self) -> float:
        """Received power, in the unit of :attr:`Points.intensity`, from which an echo is detected."""
        return detection_threshold(self.model)

    def sweep(self, motion: Motion, *, start: float | None = None, number: int = 0) -> list[Points]:
        """Points of one sweep, for each world of the motion.

        Args:
            motion: Of the front frames; a single pose stands still.
            start: Time [s] of the motion at which the sweep begins; by default its first.
            number: Of the sweep, for its noise and for patterns that do not repeat.

        Raises ``ValueError`` where a sensor lies inside the ground or an object, or the motion is too short.
        """
        check_integer("number", number, ge=0)
        worlds = motion.position.shape[1]
        if worlds > self.scene.num_worlds:
            raise ValueError(f"the motion is of {worlds} worlds, but the scene has {self.scene.num_worlds}")
        begin = motion.time[0] if start is None else start
        firings = self.model.firings(number)
        if len(motion.time) > 1:
            bounds = {"ge": motion.time[0], "le": motion.time[-1] - firings.time[-1]}
            check_range("start", begin, "s", **bounds, note=": the motion has to last for the whole sweep")
        outputs = self._fire(firings, motion, begin, number)
        counts, ranges, powers, instances, kinds, origins, axes = (output.numpy() for output in outputs)
        self.scene.check_outside("the lidar", origins[:, [0, -1]].reshape(-1, 3))
        return [
            self._points(firings, counts[w], ranges[w], powers[w], instances[w], kinds[w], origins[w], axes[w])
            for w in range(worlds)
        ]

    def _fire(self, firings: Firings, motion: Motion, begin: float, number: int) -> list[Any]:
        """Device arrays that the kernel wrote."""
        device, worlds, count = self.scene.device, motion.position.shape[1], len(firings.time)
        vec2, vec3, transform = cast(Any, (wp.vec2, wp.vec3, wp.transform))
        integer: Any = wp.int32
        kinds: list[Any] = [wp.float32, wp.float32, integer, wp.uint8]
        outputs: list[Any] = [wp.empty((worlds, count), dtype=integer, device=device)]
        outputs += [wp.empty((worlds, count, 3), dtype=kind, device=device) for kind in kinds]
        outputs += [wp.empty((worlds, count), dtype=vec3, device=device) for _ in range(2)]
        seed = int(np.random.SeedSequence([self.seed, number]).generate_state(1)[0] >> 2)
        angles = np.column_stack([firings.azimuth, firings.elevation])
        inputs = [
            self.scene.data,
            self._sensor,
            self._air,
            seed,
            wp.array(firings.time, dtype=wp.float32, device=device),
            wp.array(angles, dtype=vec2, device=device),
            wp.array(motion.time - begin, dtype=wp.float32, device=device),
            wp.array(motion.poses, dtype=transform, device=device),
        ]
        wp.launch(device_code.fire, dim=(worlds, count), inputs=inputs, outputs=outputs, device=device)
        return outputs

    def _points(
        self,
        firings: Firings,
        counts: NDArray[Any],
        ranges: NDArray[Any],
        powers: NDArray[Any],
        instances: NDArray[Any],
        kinds: NDArray[Any],
        origins: NDArray[Any],
        axes: NDArray[Any],
    ) -> Points:
        """Echoes that are to be reported, each once."""
        bits = np.zeros(ranges.shape, dtype=np.uint8)
        for column, bit in enumerate((FIRST, STRONGEST, LAST)):
            # an echo that is of several kinds stands in the first of its columns
            same = ranges == ranges[:, column : column + 1]
            bits[np.arange(len(bits)), np.argmax(same, axis=1)] |= bit
        wanted = (bits & self.returns).astype(bool) & (counts > 0)[:, None]
        pulse, column = np.nonzero(wanted)
        distance = ranges[pulse, column]
        a, e = firings.azimuth[pulse], firings.elevation[pulse]
        towards = np.column_stack([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)])
        return Points(
            points=(distance[:, None] * towards).astype(np.float32),
            world=origins[pulse] + distance[:, None] * axes[pulse],
            time=firings.time[pulse],
            ring=firings.ring[pulse].astype(np.uint16),
            range=distance,
            intensity=powers[pulse, column],
            instance=instances[pulse, column],
            class_id=kinds[pulse, column],
            echo=bits[pulse, column],
            echoes=np.minimum(counts[pulse], 255).astype(np.uint8),
        )


def detection_threshold(model: LidarModel) -> float:
    """Power that 10 % of reflectance gives at ``range_10``, less what lets nine of ten such echoes through."""
    return 0.1 / model.range_10**2 / (1.0 + NINE_OF_TEN / THRESHOLD_TO_NOISE)


def beam(model: LidarModel, subrays: int) -> Array:
    """Angles (K, 2) [rad] of sub-rays off the beam's axis, left and up, each with 1/K of a Gaussian beam's energy.

    Within a radius r there is 1 - 2^-(2 r / w)² of the energy, w the full width at half maximum; the directions are a
    spiral by the golden angle (Vogel 1979, Math. Biosci. 44). A single ray is the axis.
    """
    if subrays == 1:
        return np.zeros((1, 2))
    index = np.arange(subrays)
    radius = 0.5 * np.sqrt(-np.log2(1.0 - (index + 0.5) / subrays))
    turn = index * math.pi * (3.0 - math.sqrt(5.0))
    return radius[:, None] * np.column_stack([np.cos(turn), np.sin(turn)]) * np.radians(model.divergence_deg)


def device_sensor(model: LidarModel, mounting: Mounting, subrays: int, ideal: bool) -> Any:
    """A lidar as device code has it; see :class:`Lidar`."""
    sensor: Any = device_code.Sensor()
    sensor.mounting = mounting.transform()
    sensor.min_range, sensor.max_range, sensor.gate = model.min_range, model.max_range, model.gate
    sensor.overlap = wp.vec2(*map(float, model.overlap))
    sensor.resolution = 1e-6 if ideal else model.resolution
    pairs = [*model.noise, *[model.noise[-1]] * (4 - len(model.noise))]
    sensor.noise_range = wp.vec4(*(float(pair[0]) for pair in pairs))
    sensor.noise_deviation = wp.vec4(*(0.0 if ideal else float(pair[1]) for pair in pairs))
    sensor.threshold = detection_threshold(model)
    sensor.power_noise = 0.0 if ideal else sensor.threshold / THRESHOLD_TO_NOISE
    sensor.band, sensor.subrays = model.band, subrays
    spread = np.zeros((MOST_SUBRAYS, 2))
    spread[:subrays] = np.tan(beam(model, subrays))
    sensor.across = device_code.LEVELS(*map(float, spread[:, 0]))
    sensor.up = device_code.LEVELS(*map(float, spread[:, 1]))
    return sensor


def device_air(model: LidarModel, weather: Weather, threshold: float) -> Any:
    """Weather as device code has it, for a lidar that detects powers from ``threshold`` on."""
    air: Any = device_code.Air()
    air.extinction = weather.extinction
    air.volume = math.pi * weather.backscatter * model.gate
    across, up = np.radians(model.divergence_deg)
    # particles in the ellipse of half power, a pulse long, over the range squared
    air.drops = weather.number * model.gate * math.pi / 4.0 * across * up
    if air.volume > 0.0:
        distance = np.linspace(model.min_range, model.max_range, 2000)
        mean = air.drops * distance**2
        most = air.volume * (1.0 + 6.0 / np.sqrt(mean) + 6.0 / mean) / distance**2  # all but never exceeded
        seen = most * np.exp(-2.0 * weather.extinction * distance) >= 0.5 * threshold
        air.reach = float(distance[seen].max()) if seen.any() else 0.0
    return air
