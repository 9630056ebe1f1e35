"""A world: a terrain, what stands and lies on it, and how dense the undergrowth is; and its scene of triangles."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from aoro_gym.terrains.terrain import Terrain
from aoro_gym.terrains.world.crowns import fine_mesh
from aoro_gym.terrains.world.materials import MaterialTable, Surface, material_table
from aoro_gym.terrains.world.meshes import mesh
from aoro_gym.terrains.world.objects import CLEARANCE, Kind, Object, Tree
from aoro_gym.terrains.world.species import SPECIES

MOST_OBJECTS = 200_000
"""Of one world: about 70 million triangles, 2 GB."""
STEEPEST_DEG = 45.0
"""Steepest ground [deg] that counts as drivable, as of a terrain that is loaded."""


@dataclass(frozen=True, eq=False)
class Undergrowth:
    """Dwarf shrubs, grass and saplings below the trees, too many to be objects: how much of a beam they stop."""

    corner: tuple[float, float]
    """x, y [m] of the first node."""
    cell: float
    """Distance [m] of neighbouring nodes."""
    height: NDArray[np.float32]
    """(rows, columns) [m] above the ground; 0 where nothing grows; row 0 in the south."""
    density: NDArray[np.float32]
    """(rows, columns) [1/m] area of leaves, one side counted, in a volume: a beam of length s gets through with the
    probability exp(-density s / 2), leaves pointing anywhere."""

    def __post_init__(self) -> None:
        for name in ("height", "density"):
            value = np.ascontiguousarray(getattr(self, name), dtype=np.float32)
            if value.ndim != 2 or not value.size or not np.isfinite(value).all() or value.min() < 0.0:
                raise ValueError(
                    f"undergrowth {name} has the shape {value.shape}; give finite (rows, columns), none below 0"
                )
            value.flags.writeable = False
            object.__setattr__(self, name, value)
        if self.height.shape != self.density.shape or not self.cell > 0.0:
            raise ValueError(
                f"undergrowth height {self.height.shape}, density {self.density.shape}, cell {self.cell} m; the shapes must"
                " be equal and the cell above 0"
            )


class Scene(NamedTuple):
    """All triangles of a world, the ground's first, and what each belongs to."""

    vertices: NDArray[np.float32]
    """(V, 3) [m] in the terrain's local frame."""
    faces: NDArray[np.int32]
    """(F, 3)."""
    face_instance: NDArray[np.int32]
    """(F,) 0 for the ground, k for ``World.objects[k - 1]``."""
    face_class: NDArray[np.uint8]
    """(F,) :class:`~aoro_gym.terrains.world.materials.Surface`, the row of ``materials``."""
    instance_kind: NDArray[np.uint8]
    """(N + 1,) :class:`~aoro_gym.terrains.world.objects.Kind` of each instance."""
    materials: MaterialTable
    """Optical properties of the classes."""


@dataclass(frozen=True, eq=False)
class World:
    """A terrain and the objects on it. Raises ``ValueError`` naming the value, its bound and the fix."""

    terrain: Terrain
    objects: tuple[Object, ...] = ()
    """Instance k of the scene is ``objects[k - 1]``."""
    ground: NDArray[np.uint8] | None = None
    """(F,) :class:`~aoro_gym.terrains.world.materials.Surface` of each of the terrain's faces; None: forest floor."""
    undergrowth: Undergrowth | None = None
    leaves: bool = True
    """Whether birches have their leaves."""
    name: str = "world"

    def __post_init__(self) -> None:
        check_count(len(self.objects), self.name)
        object.__setattr__(self, "objects", tuple(self.objects))
        if self.ground is None:
            return
        ground = np.array(self.ground, dtype=np.uint8)
        if ground.shape != (len(self.terrain.faces),):
            raise ValueError(
                f"world ground has the shape {ground.shape}, but must have ({len(self.terrain.faces)},), one surface for"
                " each of the terrain's faces"
            )
        if ground.max() >= len(Surface):
            raise ValueError(f"world ground holds {ground.max()}, but the last surface is {len(Surface) - 1}")
        ground.flags.writeable = False
        object.__setattr__(self, "ground", ground)

    def __deepcopy__(self, memo: dict[int, Any]) -> World:
        return self  # immutable

    def __repr__(self) -> str:
        return f"World({self.name!r}, {len(self.objects):,} objects)"

    @property
    def counts(self) -> dict[str, int]:
        """Number of objects of every kind, by its name."""
        found = Counter(one.kind for one in self.objects)
        return {kind.name.lower(): found[kind] for kind in Kind if kind is not Kind.GROUND}

    @property
    def area(self) -> float:
        """Of the ground in plan [m²]."""
        return plan_area(self.terrain)

    @property
    def stem_volume(self) -> float:
        """Of all trees [m³], by their species' volume functions."""
        trees = [one for one in self.objects if isinstance(one, Tree)]
        return float(sum(SPECIES[tree.species].stem_volume(tree.diameter, tree.height) for tree in trees))

    def drivable(self, clearance: float = CLEARANCE) -> NDArray[np.bool_]:
        """(N,) whether a machine with a ground ``clearance`` [m] gets over each object."""
        return np.array([one.drivable(clearance) for one in self.objects], dtype=bool)

    def drivable_ground(self, steepest_deg: float = STEEPEST_DEG) -> NDArray[np.bool_]:
        """(F,) whether each of the terrain's faces is at most so steep."""
        corners = self.terrain.vertices[self.terrain.faces]
        normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        return np.abs(normal[:, 2]) >= np.cos(np.radians(steepest_deg)) * np.linalg.norm(normal, axis=1)

    def scene(self, *, fine: bool = False) -> Scene:
        """Triangles of the ground and of all objects, the same for the same world to the bit.

        ``fine`` crowns have branches and twigs, for cameras: about ten times as many triangles.
        """
        parts = [(fine_mesh if fine else mesh)(one, leaves=self.leaves) for one in self.objects]
        ground = self.ground if self.ground is not None else np.zeros(len(self.terrain.faces), dtype=np.uint8)
        counts = [len(self.terrain.vertices), *(len(part.vertices) for part in parts)]
        starts = np.cumsum([0, *counts])
        faces = [part.faces + start for part, start in zip(parts, starts[1:-1], strict=True)]
        sizes = [len(self.terrain.faces), *(len(part.faces) for part in parts)]
        return Scene(
            np.concatenate([self.terrain.vertices, *(part.vertices for part in parts)]).astype(np.float32),
            np.concatenate([self.terrain.faces, *faces]).astype(np.int32),
            np.repeat(np.arange(len(sizes), dtype=np.int32), sizes),
            np.concatenate([ground, *(part.surfaces for part in parts)]),
            np.array([Kind.GROUND, *(one.kind for one in self.objects)], dtype=np.uint8),
            material_table(),
        )


def plan_area(terrain: Terrain) -> float:
    """Area [m²] of a terrain in plan."""
    corners = terrain.vertices[terrain.faces][:, :, :2]
    ab, ac = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    return float(0.5 * np.abs(ab[:, 0] * ac[:, 1] - ab[:, 1] * ac[:, 0]).sum())


def check_count(count: int, name: str) -> None:
    """``ValueError`` if a world would hold too many objects."""
    if count > MOST_OBJECTS:
        raise ValueError(
            f"{name} holds {count:,} objects, but a world at most {MOST_OBJECTS:,}; take a part of the ground, or fewer a"
            " hectare"
        )
