"""What past sweeps have shown around a machine: a map of its own for each episode, looked at from where the machine is.

One sweep of ``obstacles`` shows a fifth of the directions in which something stands; who remembers sweeps knows more, as
``lidar-planner`` does. Here the environment remembers, so that a network need not. The map lies in the axes of the goal and
is drawn at the pose that is measured, so that it shifts as that drifts. A cell of it is one in which something stood up in a
sweep, as ``obstacles`` shows it (:mod:`aoro_gym.envs.forest_run.obstacles`). What was seen free clears nothing: rings pass
over what they showed from farther away.

It says, from the front axle's middle, how far away the nearest cell is in each of some directions, and how far the machine
comes along arcs until a cell is within half a width of the axle's middle. Both are those of
:func:`aoro_gym.envs.forest_run.kernels.obstacle_map.look_at_grids`."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from aoro_gym.checks import check_integer, check_range
from aoro_gym.envs.core.terms import ObservationTerm
from aoro_gym.envs.forest_run.kernels import obstacle_map as kernels
from aoro_gym.envs.forest_run.obstacles import ObstacleView
from aoro_gym.execution.array_api import Array
from aoro_gym.terrains.paths.pose_search import TIGHTEST

EXTENT = 64.0
"""[m] after which the map repeats: twice the farthest that one looks and what a run is long."""
AXLE = 1.7
"""Hinge to the front axle [m]."""


@dataclass(frozen=True)
class ObstacleMap:
    """Distances [m] to what stood in each of ``directions``, from behind by the left to the front and on by the right, then
    ways [m] along arcs from the right to the left, for each of ``half_widths``; ``reach`` where there is nothing (N, K)."""

    seen: ObstacleView = field(default_factory=ObstacleView)
    """What a sweep shows."""
    cell: float = 0.25
    """[m]"""
    mapped: float = 10.0
    """[m] from the lidar up to which echoes are put into the map: farther ones are too uncertain in place."""
    reach: float = 12.0
    """[m] up to which is looked."""
    directions: int = 72
    """Sectors."""
    arcs: int = 11
    """From the tightest bend to the right to that to the left."""
    half_widths: tuple[float, ...] = (1.3, 1.8)
    """[m] of what is driven along arcs: that of the machine, and with what it sweeps in bends and room. (E)"""

    @property
    def least_deviation(self) -> float:
        """[m] by which a training normalises at least: in an episode's first steps nothing is in the map yet."""
        return 0.25 * self.reach

    def __post_init__(self) -> None:
        check_range("cell", self.cell, "m", ge=0.1, le=1.0)
        check_range("mapped", self.mapped, "m", gt=0.0, le=0.25 * EXTENT)
        check_range("reach", self.reach, "m", gt=0.0, le=0.25 * EXTENT)
        check_integer("directions", self.directions, ge=4, le=720)
        check_integer("arcs", self.arcs, ge=2, le=101)
        for number, width in enumerate(self.half_widths):
            check_range(f"half_widths[{number}]", width, "m", gt=0.0, lt=TIGHTEST)

    @property
    def oldest(self) -> float:
        """Age [s] of the oldest pose that is asked for."""
        return self.seen.oldest

    @property
    def curvatures(self) -> NDArray[np.float64]:
        """(A,) of the arcs [1/m]."""
        return np.linspace(-1.0, 1.0, self.arcs) / TIGHTEST

    @property
    def columns(self) -> int:
        """Of what is shown."""
        return self.directions + len(self.half_widths) * self.arcs

    def __call__(self, view: Any) -> Array:
        rays, lidar, n = view.rays, self.seen.lidar, view.rays.num_envs
        shared, single = rays.arrays.shared, rays.arrays.xp.float32
        grids, poses = self._grids(view), _poses(view)
        azimuths, sight = rays.made(self, lambda: self._settings(rays.device))
        standing = shared(view.xp.astype(self.seen(view), single))
        shown = rays.arrays.full((n, self.columns), self.reach, single)
        ahead, around = lidar.mounting.position[0] - AXLE, math.ceil(self.reach / self.cell)
        for kernel, threads, inputs in (
            (kernels.forget, grids.stood.shape[1], [grids]),
            (kernels.remember_sweep, lidar.model.columns, [grids, poses, ahead, self.mapped, standing, azimuths]),
            (kernels.look_at_grids, 2 * around + 1, [grids, poses, sight, shared(shown)]),
        ):
            wp.launch(kernel, dim=(n, threads), inputs=inputs, device=rays.device)
        return shown

    def _grids(self, view: Any) -> Any:
        rays, size = view.rays, round(EXTENT / self.cell)
        grids: Any = kernels.Grids()
        grids.cell, grids.step = self.cell, rays.arrays.shared(view.step)
        stood = rays.remembered(self, (rays.num_envs, size, size), rays.arrays.xp.uint8)
        grids.stood = rays.arrays.shared(stood)
        return grids

    def _settings(self, device: str) -> tuple[Any, ...]:
        """Azimuths of the sectors, and how the map is looked at, on the device."""
        sight: Any = kernels.Sight()
        sight.reach, sight.directions = self.reach, self.directions
        sight.curvatures = wp.array(self.curvatures, dtype=wp.float32, device=device)
        sight.widths = wp.array(self.half_widths, dtype=wp.float32, device=device)
        return wp.array(self.seen.azimuths, dtype=wp.float32, device=device), sight


def _poses(view: Any) -> Any:
    """As measured; places are those from the goal, in the axes that the heading is measured in."""
    xp, arrays = view.xp, view.rays.arrays
    s, c = xp.sin(view.measured_heading), xp.cos(view.measured_heading)
    ahead, left = view.measured_goal[:, 0], view.measured_goal[:, 1]
    poses: Any = kernels.Poses()
    for name, values in (
        ("x", s * left - c * ahead), ("y", -s * ahead - c * left), ("heading", view.measured_heading),
    ):  # fmt: skip
        setattr(poses, name, arrays.shared(xp.astype(values, xp.float32)))
    return poses


def obstacle_map(**settings: Any) -> ObservationTerm:
    """The term ``obstacle_map``; ``settings`` are fields of :class:`ObstacleMap`.

    Raises ``ValueError`` naming the field, its value and its bound.
    """
    found = ObstacleMap(**settings)
    return ObservationTerm(found, 0.0, found.reach)
