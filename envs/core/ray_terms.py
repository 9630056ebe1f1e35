"""Observation terms that cast rays: ``lidar``, the ranges of a lidar, and ``height_map``, the ground around the machine.

They are asked for by name when an environment is made, with their defaults or with others:

    gymnasium.make(
        "AORO/PathTracking-v0",
        observation_terms={"lidar": True, "height_map": height_map(cell=0.5, latency=0.1, noise=0.02)},
    )

Both are functions of a task's view, and run on the device of its arrays. What is drawn anew each episode, by the sensors'
seed, are the errors of their mounting; noise is that seed's and the step's. The machine itself is not seen.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar, cast

import numpy as np
import warp as wp
from numpy.typing import NDArray

from aoro_gym.checks import check_choice, check_integer, check_range
from aoro_gym.envs.core.kernels import rays as kernels
from aoro_gym.envs.core.ray_sensing import RaySensing
from aoro_gym.envs.core.terms import ObservationTerm
from aoro_gym.execution.array_api import Array
from aoro_gym.sensors.height_map import grid_points
from aoro_gym.sensors.lidar import CLEAR, MODELS, LidarModel, Mounting, Weather
from aoro_gym.sensors.lidar.lidar import MOST_SUBRAYS, detection_threshold, device_air, device_sensor

MOST_VALUES = 100_000
"""Of one term and sub-environment."""
HEIGHT_BOUND = 5.0
"""[m] that heights are clipped to, over and under the machine; what is missing is a hole of this depth."""


@dataclass(frozen=True)
class RayTerm:
    """What both have in common: age and errors."""

    latency: float = 0.05
    """Age [s] of the newest part of what is shown. E: one control step."""
    position_error: float = 0.0
    """Standard deviation [m] of each axis of the mounting's position, drawn anew each episode."""
    angle_error_deg: float = 0.0
    """Likewise [deg] of each component of the rotation vector of its orientation."""
    seed: int = 0
    """Of noise and errors, beside the episode's: several lidars need different ones."""
    kind: ClassVar[int]

    def __post_init__(self) -> None:
        check_range("latency", self.latency, "s", ge=0.0, lt=math.inf)
        check_range("position_error", self.position_error, "m", ge=0.0, lt=math.inf)
        check_range("angle_error_deg", self.angle_error_deg, "deg", ge=0.0, le=180.0)
        check_integer("seed", self.seed, ge=0, le=2**31)

    @property
    def oldest(self) -> float:
        """Age [s] of the oldest pose that is asked for."""
        return self.latency

    def _errors(self) -> Any:
        errors: Any = kernels.Errors()
        errors.position, errors.angle = self.position_error, math.radians(self.angle_error_deg)
        errors.channel = 2 * self.seed + self.kind
        return errors


@dataclass(frozen=True)
class LidarView(RayTerm):
    """Ranges [m] of a lidar's last sweep, (N, K): of each pulse the strongest echo, ``max_range`` where there is none.

    Rings come from the highest to the lowest, each from left to right; of a rosette all pulses come in their order of time.
    """

    model: LidarModel = MODELS["vlp-16"]
    mounting: Mounting = field(default_factory=Mounting)
    subrays: int = 1
    noise: bool = True
    """Whether ranges have the noise that the maker gives."""
    weather: Weather = CLEAR
    kind = 0

    def __post_init__(self) -> None:
        super().__post_init__()
        check_integer("subrays", self.subrays, le=MOST_SUBRAYS)
        count = len(self.model.firings().time)
        check_range("number of the lidar's pulses", count, le=MOST_VALUES, note="; take fewer columns")

    @property
    def oldest(self) -> float:
        return self.latency + float(self.model.firings().time[-1])

    @property
    def directions(self) -> NDArray[np.float64]:
        """(K, 2) azimuth and elevation [rad] of each range in the sensor's axes, in their order."""
        firings = self.model.firings()
        angles = np.column_stack([firings.azimuth, firings.elevation])
        return angles[self._order()]

    def _order(self) -> NDArray[np.intp]:
        firings = self.model.firings()
        if self.model.pattern == "rosette":
            return np.arange(len(firings.time))
        return np.lexsort([-firings.azimuth, -firings.elevation])

    def _pulses(self, rays: RaySensing) -> tuple[Any, ...]:
        """Sensor, air, ages, angles, columns and ranges, on the device."""
        firings, order = self.model.firings(), self._order()
        places = np.empty(len(order), dtype=np.int32)
        places[order] = np.arange(len(order))
        angles = np.column_stack([firings.azimuth, firings.elevation])
        ages = self.latency + firings.time[-1] - firings.time
        ranges = rays.arrays.zeros((rays.num_envs, len(order)), rays.arrays.xp.float32)
        return (
            device_sensor(self.model, self.mounting, self.subrays, not self.noise),
            device_air(self.model, self.weather, detection_threshold(self.model)),
            wp.array(ages, dtype=wp.float32, device=rays.device),
            wp.array(angles, dtype=cast(Any, wp.vec2), device=rays.device),
            wp.array(places, dtype=wp.int32, device=rays.device),
            ranges,
        )

    def __call__(self, view: Any) -> Array:
        rays: RaySensing = view.rays
        *pulses, ranges = rays.made(self, lambda: self._pulses(rays))
        episodes = rays.episodes(view.step, view.outputs, self.oldest)
        inputs = [episodes, self._errors(), rays.rays(), *pulses, rays.arrays.shared(ranges)]
        wp.launch(kernels.look_around, dim=ranges.shape, inputs=inputs, device=rays.device)
        return ranges


@dataclass(frozen=True)
class HeightView(RayTerm):
    """Heights [m] of the ground in the axes of the machine's heading, over the origin of its front frame, (N, K).

    Rows from back to front, each from right to left, as :class:`~aoro_gym.sensors.height_map.HeightMapSensor` has them.
    """

    forward: tuple[float, float] = (-4.0, 8.0)
    left: tuple[float, float] = (-4.0, 4.0)
    cell: float = 0.5
    above: float = 5.0
    """[m] over the machine from which it looks down."""
    ground_only: bool = True
    """Whether it looks through trees, boulders and logs at the ground."""
    noise: float = 0.0
    """Standard deviation [m] of each height."""
    kind = 1

    def __post_init__(self) -> None:
        super().__post_init__()
        check_range("above", self.above, "m", gt=0.0, le=1000.0)
        check_range("noise", self.noise, "m", ge=0.0, lt=math.inf)
        count = len(self.points)
        check_range("number of points of the height map", count, le=MOST_VALUES, note="; take larger cells")

    @property
    def points(self) -> NDArray[np.float64]:
        """(K, 2) [m] forward and left of the machine."""
        return grid_points(self.forward, self.left, self.cell)

    def _grid(self, rays: RaySensing) -> tuple[Any, Array]:
        points = self.points
        heights = rays.arrays.zeros((rays.num_envs, len(points)), rays.arrays.xp.float32)
        return wp.array(points, dtype=cast(Any, wp.vec2), device=rays.device), heights

    def __call__(self, view: Any) -> Array:
        rays: RaySensing = view.rays
        points, heights = rays.made(self, lambda: self._grid(rays))
        episodes = rays.episodes(view.step, view.outputs, self.oldest)
        meshes = rays.meshes(ground_only=self.ground_only)
        settings = [self.latency, self.noise, self.above, points, -HEIGHT_BOUND]
        inputs = [episodes, self._errors(), meshes, *settings, rays.arrays.shared(heights)]
        wp.launch(kernels.look_at_ground, dim=heights.shape, inputs=inputs, device=rays.device)
        return heights


def lidar(
    model: str | LidarModel = "vlp-16", *, columns: int | None = 60, max_range: float = 30.0, **settings: Any
) -> ObservationTerm:
    """The term ``lidar``.

    Args:
        model: Name in ``MODELS``, or a model.
        columns: Pulses of each laser a sweep; None: the model's, which are thousands.
        max_range: [m] at most the model's.
        settings: Fields of :class:`LidarView`.

    Raises ``ValueError`` naming the argument, its value and its bound.
    """
    if isinstance(model, str):
        check_choice("lidar model", model, MODELS)
        model = MODELS[model]
    check_range("max_range", max_range, "m", gt=model.min_range, le=model.max_range)
    model = replace(model, columns=model.columns if columns is None else columns, max_range=max_range)
    return ObservationTerm(LidarView(model=model, **settings), 0.0, max_range)


def height_map(**settings: Any) -> ObservationTerm:
    """The term ``height_map``; ``settings`` are fields of :class:`HeightView`.

    Raises ``ValueError`` naming the field, its value and its bound.
    """
    return ObservationTerm(HeightView(**settings), -HEIGHT_BOUND, HEIGHT_BOUND)
