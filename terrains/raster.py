"""The raster of a terrain: the effective road plane of its triangles at the nodes of a grid.

What a node holds is defined in :mod:`aoro_gym.twin.physics.ground`, which interpolates it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, fields
from functools import cache
from pathlib import Path
from typing import Any, cast
from weakref import WeakKeyDictionary

import numpy as np
import warp as wp
from numpy.typing import NDArray

from aoro_gym.checks import check_range
from aoro_gym.execution import devices
from aoro_gym.execution.cache import cached, computed_with
from aoro_gym.execution.digest import digest
from aoro_gym.terrains.survey import bound, survey
from aoro_gym.terrains.terrain import Terrain

CELL = 0.25
"""Distance [m] of nodes, if not told otherwise. Bilinear interpolation errs by κ CELL²/4, 3 mm at 5 m of curvature."""
MOST_NODES = 200_000_000
"""Of one raster: 5.6 GB."""
LARGEST_SHARED = 128 * 2**20
"""Bytes of a raster that is remembered as long as its terrain lives, for all who ask; larger ones are made anew."""
MOST_SHARED = 4
"""Rasters of one terrain, by device and cell, that are remembered."""


@dataclass(frozen=True, eq=False)
class Raster:
    """Nodes of one terrain, rows from south to north, columns from west to east."""

    corner: tuple[float, float]
    """x, y [m] of the first node."""
    cell: float
    """Distance [m] of neighbouring nodes."""
    nodes: NDArray[np.float32]
    """(rows, columns, 4): height [m], slopes along x and y [-], share [-] of the patch that is known ground."""
    cover: NDArray[np.float32]
    """(rows, columns, 2): multipliers of friction and rolling resistance."""
    ceilings: NDArray[np.float32]
    """(rows, columns): a height [m] that no ground exceeds in the cell north-east of the node, be it asked from the nodes
    or from the triangles."""


_shared: WeakKeyDictionary[Terrain, dict[tuple[str, float], Raster]] = WeakKeyDictionary()


def surface(terrain: Terrain, device: str, *, cell: float = CELL, mesh: wp.Mesh | None = None) -> Raster:
    """Raster of ``terrain`` as the ``device`` makes it, on the host, read-only; remembered while the terrain lives.
    One of a CPU is also kept on disk.

    Args:
        terrain: Triangles.
        device: Warp device, ``"cpu"`` or ``"cuda:N"``.
        cell: Distance of the nodes [m].
        mesh: The triangles on the device, if they are there already.

    Raises:
        ValueError: the cell is not positive or too small for the extent.
    """
    shared = _shared.setdefault(terrain, {})
    raster = shared.get((device, cell))
    if raster is None:

        def make() -> Raster:
            return rasterise(terrain, mesh or triangles(terrain, device), cell)

        ground = (terrain.vertices, terrain.faces, terrain.friction, terrain.rolling_resistance)
        on_cpu = devices.find(device).is_cpu
        raster = cached("rasters", (ground, cell, _code()), make, _packed, _unpacked) if on_cpu else make()
        for values in (raster.nodes, raster.cover, raster.ceilings):
            values.flags.writeable = False
        if raster.nodes.nbytes + raster.cover.nbytes + raster.ceilings.nbytes <= LARGEST_SHARED:
            shared[device, cell] = raster
            if len(shared) > MOST_SHARED:
                del shared[next(iter(shared))]
    return raster


def triangles(terrain: Terrain, device: Any) -> wp.Mesh:
    """The terrain's triangles on ``device``."""
    return wp.Mesh(
        points=wp.array(terrain.vertices, dtype=wp.vec3, device=device),
        indices=wp.array(terrain.faces.ravel(), dtype=int, device=device),
    )


@cache
def _code() -> str:
    return digest(*computed_with(Path(__file__), Path(__file__).with_name("survey.py")))


def _packed(raster: Raster) -> dict[str, Any]:
    return {entry.name: getattr(raster, entry.name) for entry in fields(Raster)}


def _unpacked(arrays: Mapping[str, Any]) -> Raster:
    corner = (float(arrays["corner"][0]), float(arrays["corner"][1]))
    return Raster(corner, float(arrays["cell"]), arrays["nodes"], arrays["cover"], arrays["ceilings"])


def rasterise(terrain: Terrain, mesh: wp.Mesh, cell: float = CELL) -> Raster:
    """Raster of ``terrain``, whose triangles are ``mesh`` on its device.

    A node stands on the lowest surface with :data:`~aoro_gym.terrains.survey.HEADROOM` above it. Nodes without ground
    (over holes, beyond a ragged edge) take the height and cover of the nearest node that has some, level.

    Raises:
        ValueError: the cell is not positive or too small for the extent.
    """
    check_range("cell", cell, "m", gt=0.0, lt=math.inf)
    low, high = terrain.extent
    columns, rows = (max(int(np.ceil(round((high[i] - low[i]) / cell, 6))) + 1, 2) for i in range(2))
    if rows * columns > MOST_NODES:
        raise ValueError(
            f"cell is {cell} m, which makes {rows * columns:.3g} nodes over {high[0] - low[0]:.0f} m x"
            f" {high[1] - low[1]:.0f} m, but a raster has at most {MOST_NODES:.3g}; take larger cells"
        )
    device = mesh.device
    count = rows * columns
    vec2, vec4 = cast(Any, (wp.vec2, wp.vec4))
    nodes = wp.empty(count, dtype=vec4, device=device)
    cover = wp.empty(count, dtype=vec2, device=device)
    ceilings = wp.full(count, float(low[2]), dtype=float, device=device)
    here: Any = (vec2(float(low[0]), float(low[1])), float(cell), columns)
    wp.launch(
        survey,
        dim=count,
        inputs=[
            mesh.id,
            mesh.indices,
            wp.array(np.atleast_1d(terrain.friction), dtype=float, device=device),
            wp.array(np.atleast_1d(terrain.rolling_resistance), dtype=float, device=device),
            *here,
            float(low[2]),
            float(high[2]),
        ],
        outputs=[nodes, cover],
        device=device,
    )
    wp.launch(
        bound,
        dim=len(terrain.faces),
        inputs=[mesh.points, mesh.indices, *here, rows],
        outputs=[ceilings],
        device=device,
    )
    planes: Any = nodes.numpy().reshape(rows, columns, 4)
    covers: Any = cover.numpy().reshape(rows, columns, 2)
    unknown = planes[..., 3] == 0.0
    if unknown.all():
        raise ValueError(
            f"cell is {cell} m, so wide that no node lies over terrain '{terrain.name}'; take smaller cells"
        )
    if unknown.any():
        from scipy.ndimage import distance_transform_edt

        nearest: Any = distance_transform_edt(unknown, return_distances=False, return_indices=True)
        planes = planes[tuple(nearest)]
        planes[unknown, 1:] = 0.0
        covers = covers[tuple(nearest)]
    # interpolation between a cell's four nodes does not exceed them
    corners = np.pad(planes[..., 0], ((0, 1), (0, 1)), mode="edge")
    most = np.max([corners[:-1, :-1], corners[1:, :-1], corners[:-1, 1:], corners[1:, 1:]], axis=0)
    top = np.maximum(ceilings.numpy().reshape(rows, columns), most)
    return Raster((float(low[0]), float(low[1])), float(cell), planes, covers, top.astype(np.float32))
