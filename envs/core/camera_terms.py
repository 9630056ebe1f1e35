"""Observation terms of cameras: ``depth``, as of a stereo camera, and ``camera``, colours in the light of sun and sky.

They are asked for by name as those of :mod:`aoro_gym.envs.core.ray_terms` are, whose age, errors and noise they share:

    gymnasium.make(
        "AORO/PathTracking-v0",
        observation_terms={"depth": True, "camera": camera(width=48, height=36, light=daylight("autumn", hour=16.0))},
    )
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any, cast

import numpy as np
import warp as wp

from aoro_gym.checks import check_integer, check_range
from aoro_gym.envs.core.kernels import cameras as kernels
from aoro_gym.envs.core.ray_scenes import Ground
from aoro_gym.envs.core.ray_sensing import RaySensing
from aoro_gym.envs.core.ray_terms import MOST_VALUES, RayTerm
from aoro_gym.envs.core.terms import ObservationTerm
from aoro_gym.execution.array_api import Array
from aoro_gym.sensors.camera import CAMERA_MOUNTING, Appearance, Intrinsics, Light, daylight
from aoro_gym.sensors.camera.camera import OPTICAL
from aoro_gym.sensors.camera.kernels.render import Shutter
from aoro_gym.sensors.camera.kernels.surfaces import Look
from aoro_gym.sensors.lidar import CLEAR, Mounting
from aoro_gym.terrains import Plane
from aoro_gym.terrains.world.materials import Surface, material_table
from aoro_gym.terrains.world.world import World

HORIZON_DEG = 6.0
"""Mean elevation of the far tree line."""


@dataclass(frozen=True)
class EyeTerm(RayTerm):
    """What both have in common: a lens without distortion, at one instant."""

    width: int = 64
    """[pixels]"""
    height: int = 48
    across_deg: float = 90.0
    """Field of view from left to right."""
    mounting: Mounting = field(default_factory=lambda: CAMERA_MOUNTING)
    noise: float = 0.0

    def __post_init__(self) -> None:
        super().__post_init__()
        self.lens  # noqa: B018  its own checks
        check_range("noise", self.noise, ge=0.0, lt=math.inf)
        check_range("number of the picture's pixels", self.width * self.height, le=MOST_VALUES, note="; take fewer")

    @property
    def lens(self) -> Intrinsics:
        """Intrinsics of the picture."""
        return Intrinsics.of_view(self.width, self.height, self.across_deg)

    def _eye(self) -> list[Any]:
        """Lens, and mounting and camera's axes, as device code has them."""
        return [self.lens.on_device(), self.mounting.transform(), wp.transform(wp.vec3(), wp.quat(*OPTICAL))]


@dataclass(frozen=True)
class DepthView(EyeTerm):
    """Depths [m] along the camera's axis, (N, height x width): rows from the top, each from the left; ``max_depth`` where
    nothing is nearer. ``noise`` is the standard deviation [pixels] of the disparity, from which a depth is found."""

    max_depth: float = 20.0
    baseline: float = 0.12
    """[m] of the two cameras, for the noise: depths scatter by depth² / (f b) times it."""
    kind = 2**40

    def __post_init__(self) -> None:
        super().__post_init__()
        check_range("max_depth", self.max_depth, "m", gt=0.0, lt=math.inf)
        check_range("baseline", self.baseline, "m", gt=0.0, lt=math.inf)

    def __call__(self, view: Any) -> Array:
        rays: RaySensing = view.rays
        shape = (rays.num_envs, self.width * self.height)
        depths = rays.made(self, lambda: rays.arrays.zeros(shape, rays.arrays.xp.float32))
        episodes = rays.episodes(view.step, view.outputs, self.oldest)
        settings = [self.latency, self.max_depth, self.lens.focal[0] * self.baseline, self.noise]
        inputs = [episodes, self._errors(), rays.rays(), *self._eye(), *settings, rays.arrays.shared(depths)]
        wp.launch(kernels.look_far, dim=shape, inputs=inputs, device=rays.device)
        return depths


@dataclass(frozen=True)
class ColourView(EyeTerm):
    """Colours in [0, 1], (N, height x width x 3): rows from the top, each from the left, red, green and blue.

    A colour is the square root of radiance over that of a white surface on open ground, over ``brightness``; ``noise`` is
    the standard deviation of each.
    """

    light: Light = field(default_factory=daylight)
    brightness: float = 2.0
    season: str = "summer"
    sky_rays: int = 2
    """Of a pixel: the fewer, the more its shade scatters."""
    reach: float = 200.0
    """[m]"""
    kind = 2**40 + 1

    def __post_init__(self) -> None:
        super().__post_init__()
        check_range("brightness", self.brightness, gt=0.0, lt=math.inf)
        check_range("reach", self.reach, "m", gt=0.0, lt=math.inf)
        check_integer("sky_rays", self.sky_rays, le=64)

    def _made(self, rays: RaySensing) -> tuple[Any, Any, Any, Any, Array]:
        """Looks of the scenes on the host, whose arrays live as long, and on the device; sky, shutter, colours."""
        struct: Any = Look
        looks = [
            look_of(ground, self.season).on_device(scene, undergrowth=True)
            for ground, scene in zip(rays.grounds, map(rays.scene, range(len(rays.grounds))), strict=True)
        ]
        shutter: Any = Shutter()
        shutter.samples, shutter.sky_rays = 1, self.sky_rays
        sky = self.light.on_device(CLEAR, trees_deg=HORIZON_DEG)
        colours = rays.arrays.zeros((rays.num_envs, 3 * self.width * self.height), rays.arrays.xp.float32)
        return looks, wp.array(looks, dtype=struct, device=rays.device), sky, shutter, colours

    def __call__(self, view: Any) -> Array:
        rays: RaySensing = view.rays
        _, looks, sky, shutter, colours = rays.made(self, lambda: self._made(rays))
        episodes = rays.episodes(view.step, view.outputs, self.oldest)
        white = wp.vec3(*(float(each) / (math.pi * self.brightness) for each in self.light.total))
        inputs = [episodes, self._errors(), rays.rays(), looks, *self._eye(), self.latency, self.reach, sky, shutter]
        inputs += [white, self.noise, rays.arrays.shared(colours)]
        dim = (rays.num_envs, self.width * self.height)
        wp.launch(kernels.look_at_colours, dim=dim, inputs=inputs, device=rays.device)
        return colours


def look_of(ground: Ground, season: str) -> Appearance:
    """How a ground of a task looks: a world by its surfaces, trees of a forest as bark and needles, a plane as asphalt."""
    if isinstance(ground, World):
        return Appearance.of_world(ground, season)
    surfaces = [Surface.ASPHALT] if isinstance(ground, Plane) else [Surface.FOREST_FLOOR]
    surfaces += [Surface.PINE_BARK, Surface.SPRUCE_NEEDLES]  # of scene_with_trees
    albedo = material_table().albedo.astype(np.float64)[surfaces]
    return Appearance(albedo, np.array(surfaces, dtype=np.int32), np.zeros((0, 7), dtype=np.float32), season)


def depth(**settings: Any) -> ObservationTerm:
    """The term ``depth``; ``settings`` are fields of :class:`DepthView`.

    Raises ``ValueError`` naming the field, its value and its bound.
    """
    view = DepthView(**settings)
    return ObservationTerm(view, 0.0, view.max_depth)


def camera(**settings: Any) -> ObservationTerm:
    """The term ``camera``; ``settings`` are fields of :class:`ColourView`.

    Raises ``ValueError`` naming the field, its value and its bound.
    """
    return ObservationTerm(cast(Any, ColourView(**settings)), 0.0, 1.0)
