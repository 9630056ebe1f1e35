"""How a scene looks to a camera: albedo and texture of each class, axes of objects, season, wetness and snow."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, cast

import numpy as np
import warp as wp
from numpy.typing import ArrayLike, NDArray

from aoro_gym.checks import check_choice, check_finite, check_range
from aoro_gym.sensors.camera.kernels.surfaces import PLAIN, Look
from aoro_gym.sensors.camera.light import SEASONS
from aoro_gym.sensors.raytrace import Scene
from aoro_gym.terrains.world.materials import Surface, material_table
from aoro_gym.terrains.world.world import World

LEAVES = {
    Surface.PINE_NEEDLES: 0.4,
    Surface.SPRUCE_NEEDLES: 0.35,
    Surface.BIRCH_LEAVES: 0.9,
    Surface.DWARF_SHRUBS: 0.6,
}
"""Transmittance over albedo: broad leaves let about as much light through as they send back, shoots of needles less. (E)"""
BACKLIT = np.array([1.1, 1.15, 0.6])
"""Of it in red, green and blue: what comes through is more yellow. (E)"""


@dataclass(frozen=True, eq=False)
class Appearance:
    """Raises ``ValueError`` naming the field."""

    albedo: NDArray[np.float64]
    """(C, 3) linear, of each class."""
    texture: NDArray[np.int32]
    """(C,) :class:`~aoro_gym.terrains.world.materials.Surface` whose texture it has; -1: even."""
    poses: NDArray[np.float32]
    """(K, 7) position [m] and quaternion x, y, z, w of instances 0 to K - 1, for textures along the wood."""
    season: str = "summer"
    snow: float = 0.0
    """Cover of what faces up, 0 to 1."""
    wetness: float = 0.0
    """0 dry to 1 wet."""
    horizon_deg: float | None = None
    """Mean elevation [deg] of a far tree line round the scene; None: a bare horizon."""

    def __post_init__(self) -> None:
        check_range("albedo", self.albedo, ge=0.0, le=1.0)
        if self.albedo.ndim != 2 or self.albedo.shape[1] != 3 or self.texture.shape != self.albedo.shape[:1]:
            raise ValueError(
                f"albedo and texture have the shapes {self.albedo.shape} and {self.texture.shape}, but must be"
                " (C, 3) and (C,)"
            )
        check_range("texture", self.texture, ge=-1, le=int(max(Surface)))
        check_finite("poses", self.poses)
        check_choice("season", self.season, SEASONS)
        check_range("snow", self.snow, ge=0.0, le=1.0)
        check_range("wetness", self.wetness, ge=0.0, le=1.0)
        if self.horizon_deg is not None:
            check_range("horizon_deg", self.horizon_deg, "deg", ge=0.0, le=45.0)

    @classmethod
    def plain(cls, albedo: ArrayLike) -> Appearance:
        """Even colours, of each class ``albedo`` (C, 3) linear or (C,) grey."""
        colours = np.asarray(albedo, dtype=np.float64)
        if colours.ndim == 1:
            colours = np.repeat(colours[:, None], 3, axis=1)
        return cls(colours, np.full(len(colours), -1, dtype=np.int32), np.zeros((0, 7), dtype=np.float32))

    @classmethod
    def of_world(cls, world: World, season: str = "summer", *, wetness: float = 0.0) -> Appearance:
        """Of a world's surfaces; where it has snow, that lies on its objects, too."""
        snowy = world.ground is not None and bool((world.ground == Surface.SNOW).all())
        poses = [(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0), *((*one.position, *one.rotation) for one in world.objects)]
        made = cls.of_surfaces(season, wetness=wetness)
        return replace(made, poses=np.array(poses, dtype=np.float32), snow=0.75 if snowy else 0.0, horizon_deg=6.0)

    @classmethod
    def of_surfaces(cls, season: str = "summer", *, wetness: float = 0.0) -> Appearance:
        """Of classes that are surfaces, without objects."""
        albedo = material_table().albedo.astype(np.float64)
        return cls(
            albedo, np.arange(len(albedo), dtype=np.int32), np.zeros((0, 7), dtype=np.float32), season, 0.0, wetness
        )

    def on_device(self, scene: Scene, *, undergrowth: bool) -> Any:
        """As device code has it, for a ``scene`` whose classes all have an albedo."""
        if scene.num_classes > len(self.albedo):
            raise ValueError(f"the scene has {scene.num_classes} classes, but the appearance {len(self.albedo)}")
        look: Any = Look()
        device, vec3, transform = scene.device, cast(Any, wp.vec3), cast(Any, wp.transform)
        through = np.zeros_like(self.albedo)
        for surface, share in LEAVES.items():
            of_it = self.texture == surface
            through[of_it] = share * BACKLIT * self.albedo[of_it]
        look.texture = wp.array(self.texture, dtype=wp.int32, device=device)
        look.albedo = wp.array(self.albedo, dtype=vec3, device=device)
        look.transmittance = wp.array(np.minimum(through, 1.0 - self.albedo), dtype=vec3, device=device)
        look.poses = wp.array(self.poses, dtype=transform, device=device)
        look.undergrowth = undergrowth and self.snow == 0.0 and scene.data.leaves.tallest > 0.0  # snow buries it
        look.densest = scene.densest if look.undergrowth else 0.0
        look.gaps = scene.fine
        look.bare = self.season == "winter"
        look.autumn = 0.85 if self.season == "autumn" else 0.0
        look.snow, look.wetness = self.snow, self.wetness
        return look


assert PLAIN == -1
