"""An imperfect scan of a terrain, as a survey from the air would bring it home: noise, shadows, holes, vegetation.

To try loading and repair on ground whose truth is known, and to show it: never to model a certain sensor.

>>> from aoro_gym.terrains.generate.forest import PUBLISHED_SIZE, forest
>>> cloud = scan(forest(0, PUBLISHED_SIZE), seed=1, density=5.0)
>>> bool((cloud.classes == PointClass.GROUND).any()), bool((cloud.classes == PointClass.HIGH_VEGETATION).any())
(True, True)
"""

from __future__ import annotations

import os
from dataclasses import dataclass
from enum import IntEnum
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from aoro_gym.checks import check_range
from aoro_gym.execution.files import write_bytes, written_whole
from aoro_gym.terrains.extras import import_extra
from aoro_gym.terrains.generate.forest import Forest
from aoro_gym.terrains.terrain import Terrain

Array = NDArray[Any]


class PointClass(IntEnum):
    """What a point is of, in the numbers of the LAS standard."""

    GROUND = 2
    LOW_VEGETATION = 3
    MEDIUM_VEGETATION = 4
    HIGH_VEGETATION = 5
    LOW_NOISE = 7


CLASS_COLOURS = {
    PointClass.GROUND: (160, 134, 100),
    PointClass.LOW_VEGETATION: (168, 190, 106),
    PointClass.MEDIUM_VEGETATION: (104, 148, 78),
    PointClass.HIGH_VEGETATION: (44, 92, 58),
    PointClass.LOW_NOISE: (214, 50, 42),
}
LONGEST_EDGE = 4.0
"""Edges of the mesh's triangles beyond this many times the usual distance of points bridge a hole."""
MEDIUM_FROM, HIGH_FROM = 0.5, 2.0
"""Heights above the ground [m] from which vegetation is medium, and high."""


@dataclass(frozen=True, eq=False)
class Scan:
    """Points in the local frame of the terrain that was scanned."""

    points: Array
    """(N, 3) [m], float64."""
    classes: NDArray[np.uint8]
    """(N,) :class:`PointClass`."""
    holes: Array
    """(K, 3) x, y, radius [m] of the places that were not seen."""
    origin: tuple[float, float, float]
    """Of the terrain: world = local + origin."""
    crs: str | None
    density: float
    """Asked for [points/m²]."""

    def save(self, file: str | os.PathLike[str]) -> None:
        """Write the points: ``.las`` or ``.laz`` in world coordinates with classes, ``.ply`` in local ones, coloured.

        Raises ``ValueError`` for another suffix, or naming what to install.
        """
        target = Path(file)
        suffix = target.suffix.lower()
        if suffix in (".las", ".laz"):
            self._save_las(target)
        elif suffix == ".ply":
            import trimesh

            colours = np.zeros((len(self.points), 4), dtype=np.uint8)
            for kind, colour in CLASS_COLOURS.items():
                colours[self.classes == kind] = (*colour, 255)
            target.write_bytes(_bytes(trimesh.PointCloud(self.points, colors=colours).export(file_type="ply")))
        else:
            raise ValueError(f"{target}: scans are written as .las, .laz or .ply")

    def mesh(self, cell: float | None = None, *, surface: Literal["ground", "top"] = "ground") -> tuple[Array, Array]:
        """Vertices (V, 3) [m] and faces (F, 3) of a triangulation with open holes, one point a cell.

        Args:
            cell: [m]; by default such that about every fourth point counts.
            surface: The lowest points of class ground, or the highest of all classes, vegetation included.
        """
        from scipy.spatial import Delaunay

        width = float(2.0 / np.sqrt(self.density)) if cell is None else cell
        check_range("mesh cell", width, "m", gt=0.0)
        chosen = self.points[self.classes == PointClass.GROUND] if surface == "ground" else self.points
        if surface == "top":
            chosen = chosen[self.classes != PointClass.LOW_NOISE]
        order = chosen[np.argsort(chosen[:, 2] if surface == "ground" else -chosen[:, 2], kind="stable")]
        _, first = np.unique(np.floor(order[:, :2] / width).astype(np.int64), axis=0, return_index=True)
        vertices = order[np.sort(first)]
        faces = Delaunay(vertices[:, :2]).simplices
        corners = vertices[faces][:, :, :2]
        edges = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2)
        faces = faces[edges.max(axis=1) <= LONGEST_EDGE * width]
        a, b, c = (vertices[faces[:, i], :2] for i in range(3))
        turned = (b[:, 0] - a[:, 0]) * (c[:, 1] - a[:, 1]) < (b[:, 1] - a[:, 1]) * (c[:, 0] - a[:, 0])
        faces[turned] = faces[turned][:, ::-1]
        used, numbered = np.unique(faces, return_inverse=True)
        return vertices[used], numbered.reshape(-1, 3).astype(np.int32)

    def save_mesh(self, file: str | os.PathLike[str], **options: Any) -> None:
        """Write :meth:`mesh`, which explains ``options``, in whatever format trimesh knows by the suffix."""
        import trimesh

        vertices, faces = self.mesh(**options)
        target = Path(file)
        kind = target.suffix.lower().lstrip(".")
        try:
            data = trimesh.Trimesh(vertices, faces, process=False).export(file_type=kind)
        except (KeyError, ValueError) as error:
            raise ValueError(f"{target}: meshes are written as .ply, .obj, .stl or .glb ({error})") from None
        write_bytes(target, _bytes(data))

    def _save_las(self, target: Path) -> None:
        laspy = import_extra("laspy", f"the point cloud {target.name}")
        header = laspy.LasHeader(version="1.4", point_format=6)
        world = self.points + np.asarray(self.origin)
        header.offsets, header.scales = np.floor(world.min(axis=0)), np.full(3, 1e-3)
        if self.crs is not None:
            header.add_crs(import_extra("pyproj", "a coordinate reference system").CRS.from_user_input(self.crs))
        cloud = laspy.LasData(header)
        cloud.x, cloud.y, cloud.z = world.T
        cloud.classification = self.classes
        with written_whole(target) as temporary:
            cloud.write(str(temporary))


def scan(
    ground: Terrain | Forest,
    seed: int = 0,
    *,
    density: float = 30.0,
    noise: float = 0.02,
    holes: float = 10.0,
    low_vegetation: float = 0.3,
    shrubs: float = 100.0,
    low_noise: float = 2e-4,
) -> Scan:
    """A scan; the same for the same seed.

    Args:
        ground: Triangles; a forest also shows its trees, under which there are fewer points.
        seed: Of numpy's generators.
        density: Points [1/m²].
        noise: Standard deviation of each coordinate [m].
        holes: Places that were not seen, 1 m to 3 m in radius [1/ha].
        low_vegetation: Share of points on grass or soil that hit what grows there, 0.1 m above it in the mean.
        shrubs: 0.5 m to 2 m high [1/ha].
        low_noise: Share of points that lie 1 m to 5 m below ground, as echoes do.

    Raises ``ValueError`` naming the value and its bound.
    """
    for key, value, low, high in (
        ("density", density, 0.1, 1000.0),
        ("noise", noise, 0.0, 1.0),
        ("holes", holes, 0.0, 200.0),
        ("low_vegetation", low_vegetation, 0.0, 1.0),
        ("shrubs", shrubs, 0.0, 5000.0),
        ("low_noise", low_noise, 0.0, 0.1),
    ):
        check_range(key, value, ge=low, le=high)
    terrain = ground.terrain if isinstance(ground, Forest) else ground
    trees = [o for o in ground.obstacles if o.kind == "tree"] if isinstance(ground, Forest) else []
    surface, plants, echoes, gaps = np.random.default_rng(seed).spawn(4)

    points, soil, area = _on_triangles(terrain, density, surface)
    low, high = terrain.extent
    unseen = _circles(gaps, holes * area / 1e4, low, high, 1.0, 3.0)
    classes = np.full(len(points), PointClass.GROUND, dtype=np.uint8)
    grown = plants.random(len(points)) < low_vegetation * soil
    points[grown, 2] += plants.exponential(0.1, int(grown.sum()))
    classes[grown] = PointClass.LOW_VEGETATION

    bushes = _circles(plants, shrubs * area / 1e4, low, high, 0.4, 1.0)
    for (x, y, radius), height in zip(bushes, plants.uniform(0.5, 2.0, len(bushes)), strict=True):
        near = np.hypot(points[:, 0] - x, points[:, 1] - y)
        hit = (near < radius) & (plants.random(len(points)) < 0.7)
        points[hit, 2] += height * np.sqrt(plants.random(int(hit.sum())) * (1.0 - (near[hit] / radius) ** 2))
        classes[hit] = PointClass.MEDIUM_VEGETATION
    for tree in trees:
        near = np.hypot(points[:, 0] - tree.x, points[:, 1] - tree.y)
        crown = 0.08 * tree.height
        # most of what falls on a crown is caught by its cone, higher up towards the stem
        hit = (near < crown) & (plants.random(len(points)) < 0.8)
        points[hit, 2] += tree.height * (1.0 - near[hit] / crown * plants.uniform(0.6, 1.0, int(hit.sum())))
        lifted = tree.height * (1.0 - near[hit] / crown)
        classes[hit] = np.where(lifted >= HIGH_FROM, PointClass.HIGH_VEGETATION, PointClass.MEDIUM_VEGETATION)

    below = echoes.random(len(points)) < low_noise
    points[below, 2] -= echoes.uniform(1.0, 5.0, int(below.sum()))
    classes[below] = PointClass.LOW_NOISE
    points += surface.normal(0.0, noise, points.shape)
    seen = np.ones(len(points), dtype=bool)
    for x, y, radius in unseen:
        seen &= np.hypot(points[:, 0] - x, points[:, 1] - y) > radius
    return Scan(points[seen], classes[seen], unseen, terrain.origin, terrain.crs, density)


def _on_triangles(terrain: Terrain, density: float, rng: np.random.Generator) -> tuple[Array, Array, float]:
    """(N, 3) places evenly spread over the plan, (N,) how overgrown they are in [0, 1], and the area [m²]."""
    corners = terrain.vertices[terrain.faces]
    ab, ac = corners[:, 1, :2] - corners[:, 0, :2], corners[:, 2, :2] - corners[:, 0, :2]
    areas = 0.5 * np.abs(ab[:, 0] * ac[:, 1] - ab[:, 1] * ac[:, 0])
    total = float(areas.sum())
    ends = np.cumsum(areas)
    face = np.minimum(np.searchsorted(ends, rng.random(round(density * total)) * ends[-1]), len(ends) - 1)
    u, v = rng.random((2, len(face)))
    over = u + v > 1.0
    u[over], v[over] = 1.0 - u[over], 1.0 - v[over]
    weights = np.stack([1.0 - u - v, u, v], axis=1)
    points = np.einsum("nk,nkc->nc", weights, corners[face])
    rolling = np.broadcast_to(terrain.rolling_resistance, len(terrain.vertices))[terrain.faces[face]]
    # asphalt and gravel are bare; what rolls four times as hard is grass or soil
    soil = np.clip((np.einsum("nk,nk->n", weights, rolling) - 2.0) / 2.0, 0.0, 1.0)
    return points, soil if np.ndim(terrain.rolling_resistance) else np.ones(len(face)), total


def _circles(rng: np.random.Generator, count: float, low: Array, high: Array, least: float, most: float) -> Array:
    """(K, 3) x, y, radius [m] anywhere over the extent."""
    number = round(count)
    return np.column_stack([rng.uniform(low[:2], high[:2], (number, 2)), rng.uniform(least, most, number)])


def _bytes(data: Any) -> bytes:
    """What trimesh exports, which is text for some formats."""
    return data.encode("utf-8") if isinstance(data, str) else bytes(data)
