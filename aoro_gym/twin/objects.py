"""The solid objects of worlds on the device: their shapes, and a grid that finds those near a part of the machine.

What a contact does stands in ``aoro_gym/twin/physics/solids.py``, how a part finds its objects in
``aoro_gym/twin/kernels/solids.py``.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
import warp as wp

from aoro_gym.terrains.world.meshes import BUMPS, BURIED
from aoro_gym.terrains.world.objects import Boulder, Log, Object, Stump, Tree, is_solid, matrix
from aoro_gym.twin.kernels import solid_start
from aoro_gym.twin.kernels.solids import BRISTLE_ROWS, OBJECT_GROUNDS, TOUCH_ROWS, Box, Grid, Objects, ObjectSite
from aoro_gym.twin.physics.solids import STEM, STONE, STUMP, Solid
from aoro_gym.twin.records import OBJECT_PARTS, WHEELS

REACH = 4.0
"""Height [m] up to which stems are solid: more than the machine's. (E)"""
CELL = 2.0
"""Least width [m] of the grid's cells: about that of a wheel or a chassis."""
MOST_CELLS = 4_000_000
"""Of one grid; wider worlds have larger cells."""
WOOD_FRICTION = 0.7
"""Of a tire on bark, against that on dry asphalt. (E)"""
STONE_FRICTION = 0.9
"""Of a tire on rock, against that on dry asphalt. (E)"""
EDGE = 0.03
"""Radius [m] of the edge of a stump's cut, at most half the stump's radius. (E)"""
STONE_CORE = 0.5
"""Share of a boulder's least half axis by which its core is smaller."""
MEASURED_AT = 0.5
"""Height [m] above which a tree's stem tapers linearly up to the machine's height, and below which goes on so: without the
butt swell, which no chassis reaches."""
DEEP = 0.05
"""Depth [m] in an object up to which a part may start."""

PART_NAMES = (*(f"the {wheel} wheel" for wheel in WHEELS), "the front chassis", "the rear chassis")


def solid(one: Object) -> dict[str, Any]:
    """Fields of the device's shape of an object (``Solid`` in ``aoro_gym/twin/physics/solids.py``).

    Trees are cones up to the machine's height, logs cones with round ends, stumps cylinders, and boulders ellipsoids in the
    middle of their bumps.
    """
    axis, start = matrix(one.rotation)[:, 2], np.asarray(one.position)
    if isinstance(one, Boulder):
        half = (1.0 - BUMPS) * np.asarray(one.half_axes)
        margin = STONE_CORE * half.min()
        shape = {"half": half - margin, "rotation": one.rotation, "friction": STONE_FRICTION}
        return shape | {"kind": STONE, "start": start, "end": start, "start_margin": margin, "end_margin": margin}
    shape = {"half": np.zeros(3), "rotation": (0.0, 0.0, 0.0, 1.0), "friction": WOOD_FRICTION}
    if isinstance(one, Stump):
        edge = min(EDGE, 0.5 * one.radius)
        low, high, margins = -BURIED, one.height - edge, (edge, edge)
        shape |= {"kind": STUMP, "half": np.array([one.radius - edge, 0.0, 0.0])}
    else:
        if isinstance(one, Tree):
            low, high = -BURIED, min(REACH, one.height)
            at = min(MEASURED_AT, 0.5 * high)
            radius, top = 0.5 * one.diameter_at([at, high])
            margins = (float(radius + (radius - top) / (high - at) * (at - low)), float(top))
        else:
            assert isinstance(one, Log)
            high, margins = one.length - one.top_radius, (one.radius, one.top_radius)
            low = min(one.radius, 0.5 * high)
        shape |= {"kind": STEM}
    ends = {"start": start + low * axis, "end": start + high * axis}
    return shape | ends | dict(zip(("start_margin", "end_margin"), margins, strict=True))


def shapes(objects: Sequence[Object]) -> tuple[Any, Any, Any]:
    """Shapes (S,), boxes (S,) and numbers (S,) of the solid ones among the objects of a world, structured arrays."""
    found = [(number, solid(one)) for number, one in enumerate(objects, start=1) if is_solid(one)]
    rows, boxes = _records(Solid, len(found)), _records(Box, len(found))
    for row, (_, shape) in zip(rows, found, strict=True):
        for name, value in shape.items():
            row[name] = value
    reach = (
        np.maximum(rows["start_margin"], rows["end_margin"])[:, None]
        + rows["half"][:, :1] * (rows["kind"] == STUMP)[:, None]
    )
    ends = np.stack([rows["start"], rows["end"]])
    turned = np.array([matrix(tuple(row)) for row in rows["rotation"]]).reshape(-1, 3, 3)
    stones = (rows["kind"] == STONE)[:, None] * np.sqrt(np.einsum("nij,nj->ni", turned**2, rows["half"] ** 2))
    boxes["low"] = ends.min(axis=0) - reach - stones
    boxes["high"] = ends.max(axis=0) + reach + stones
    return rows, boxes, np.array([number for number, _ in found], dtype=np.int32)


def _records(struct: Any, count: int) -> Any:
    """Zeros (count,) of the layout of a device's ``struct``."""
    return np.zeros(count, dtype=struct.numpy_dtype())


def fill_grid(boxes: Any, grid: Any) -> tuple[npt.NDArray[Any], npt.NDArray[Any]]:
    """Lay a ``grid`` over ``boxes`` (S,), both of which it completes.

    Returns:
        Number of objects in each cell (C,), row by row from the south-west, and the objects of all cells in this order.
    """
    low, high = boxes["low"][:, :2].astype(np.float64), boxes["high"][:, :2].astype(np.float64)
    corner, extent = low.min(axis=0), np.ptp(np.concatenate([low, high]), axis=0)
    cell = max(CELL, float(np.sqrt(extent.prod() / MOST_CELLS)), float(extent.max() / MOST_CELLS))
    grid["x"], grid["y"], grid["inverse_cell"] = *corner, 1.0 / cell
    # in float32, as the device looks them up
    inverse = np.float32(1.0 / cell)
    origin = corner.astype(np.float32)
    first = np.maximum(np.floor((boxes["low"][:, :2] - origin) * inverse).astype(np.int64), 0)
    last = np.floor((boxes["high"][:, :2] - origin) * inverse).astype(np.int64)
    columns, rows = last.max(axis=0) + 1
    grid["columns"], grid["rows"] = columns, rows
    boxes["column"], boxes["row"] = first.T
    wide, tall = (last - first + 1).T
    count = wide * tall
    index = np.repeat(np.arange(len(boxes)), count)
    within = np.arange(count.sum()) - np.repeat(np.cumsum(count) - count, count)
    cells = (first[index, 1] + within // wide[index]) * columns + first[index, 0] + within % wide[index]
    order = np.argsort(cells, kind="stable")
    return np.bincount(cells, minlength=int(columns * rows)), index[order]


class WorldObjects:
    """The solid objects of the worlds that twins may stand in.

    Args:
        worlds: Objects of each ground to choose from.
        num_twins: Twins; in the first world, to begin with.
        gravity: [m/s²].
        device: Warp device.
    """

    def __init__(self, worlds: Sequence[Sequence[Object]], num_twins: int, *, gravity: float, device: Any):
        grids = _records(Grid, len(worlds))
        parts, counts, orders, cells, first = [], [], [], 0, 0
        for grid, things in zip(grids, worlds, strict=True):
            part = shapes(things)
            parts.append(part)
            grid["first"], grid["inverse_cell"] = cells, 1.0 / CELL
            if len(part[0]):
                count, order = fill_grid(part[1], grid)
                counts.append(count)
                orders.append(order + first)
                cells += len(count)
                first += len(part[0])
        self._worlds = tuple(worlds)
        self.device_struct: Any = Objects()
        """What kernels take as their ``objects``."""
        starts = np.concatenate([[0], np.cumsum(np.concatenate(counts))])
        rows, boxes, numbers = (np.concatenate(kind) for kind in zip(*parts, strict=True))
        for name, values, kind in (
            ("grids", grids, Grid), ("starts", starts, int), ("order", np.concatenate(orders), int), ("boxes", boxes, Box),
            ("shapes", rows, Solid), ("numbers", numbers, int), ("worlds", np.zeros(num_twins), int),
        ):  # fmt: skip
            setattr(self.device_struct, name, wp.array(values, dtype=kind, device=device))
        for name, height in (("touches", TOUCH_ROWS * len(OBJECT_PARTS)), ("bristles", BRISTLE_ROWS * len(WHEELS))):
            setattr(self.device_struct, name, wp.zeros((height, num_twins), dtype=float, device=device))
        sites = _records(ObjectSite, num_twins)
        sites["gravity"], sites["twin"] = gravity, np.arange(num_twins)
        self._sites = wp.array(sites, dtype=ObjectSite, device=device)

    def on(self, ground: Any) -> Any:
        """A ``ground`` with these objects on it, as ``advance`` takes it."""
        out: Any = OBJECT_GROUNDS[type(ground)._cls]()
        out.twins, out.ground, out.objects = self._sites, ground, self.device_struct
        return out

    def clear(self, mask: wp.array, numbers: wp.array) -> None:
        """Twins of the ``mask`` begin anew, in other worlds where ``numbers`` are not negative."""
        wp.launch(solid_start.clear, dim=len(mask), inputs=[self.device_struct, mask, numbers], device=mask.device)

    def overlaps(self, machines: wp.array, state: wp.array) -> tuple[npt.NDArray[Any], ...]:
        """How each part of each twin lies among the objects.

        Returns:
            By part (``OBJECT_PARTS``) and twin: number of objects whose boxes overlap the part's, greatest depth [m] in any,
            and that object's number in its world (0: none).
        """
        shape = (len(OBJECT_PARTS), state.shape[1])
        out = [wp.zeros(shape, dtype=kind, device=state.device) for kind in (int, float, int)]
        wp.launch(
            solid_start.overlaps, dim=shape, inputs=[machines, self.device_struct, state, *out], device=state.device
        )
        return tuple(array.numpy() for array in out)

    def check_start(self, machines: wp.array, state: wp.array, chosen: npt.NDArray[np.bool_]) -> None:
        """ValueError if a ``chosen`` twin stands in an object by more than :data:`DEEP`."""
        _, depths, numbers = self.overlaps(machines, state)
        depths = np.where(chosen, depths, 0.0)
        if depths.max(initial=0.0) <= DEEP:
            return
        part, twin = np.unravel_index(int(np.argmax(depths)), depths.shape)
        number = int(numbers[part, twin])
        one = self._worlds[int(self.device_struct.worlds.numpy()[twin])][number - 1]
        x, y, _ = one.position
        raise ValueError(
            f"twin {twin} would stand in an object: {PART_NAMES[part]} {depths[part, twin]:.2f} m deep in object {number}, a"
            f" {one.kind.name.lower()} at x = {x:.1f} m, y = {y:.1f} m, but at most {DEEP:g} m are let; choose another"
            " position or heading"
        )

    def standing(self) -> dict[str, npt.NDArray[Any]]:
        """What twins have to do with the objects, for :meth:`stand`."""
        return {name: getattr(self.device_struct, name).numpy().copy() for name in ("worlds", "touches", "bristles")}

    def stand(self, standing: Mapping[str, npt.NDArray[Any]]) -> None:
        """Inverse of :meth:`standing`."""
        for name, values in standing.items():
            array = getattr(self.device_struct, name)
            wp.copy(array, wp.array(values, dtype=array.dtype, device=array.device))
