"""A grid of ground heights around the machine in its heading frame: the cheap view that learners use.

>>> from aoro_gym.sensors.raytrace import Scene
>>> scene = Scene([[-99, -99, 0], [99, -99, 0], [99, 99, 0], [-99, 99, 0]], [[0, 1, 2], [0, 2, 3]])
>>> sensor = HeightMapSensor(scene, forward=(-2.0, 6.0), left=(-2.0, 2.0), cell=1.0)
>>> sensor.measure([[0.0, 0.0, 1.5]], [0.3]).shape, float(sensor.measure([[0.0, 0.0, 1.5]], [0.3])[0, 0, 0])
((1, 9, 5), -1.5)
"""

from __future__ import annotations

import math
from typing import Any, cast

import numpy as np
import warp as wp
from numpy.typing import ArrayLike, NDArray

from aoro_gym.checks import check_finite, check_integer, check_range
from aoro_gym.sensors.raytrace import Scene
from aoro_gym.sensors.raytrace.downward import look_down

MOST_POINTS = 1_000_000
"""Of one grid."""


class HeightMapSensor:
    """Heights around machines in a scene, on its device. Moving bodies are not seen.

    Args:
        scene: What lies around.
        forward: Least and greatest distance ahead of the machine's position [m].
        left: Likewise to its left.
        cell: Distance of neighbouring heights [m].
        above: Height over the machine's position [m] from which it looks down: what is higher is not seen.
        ground_only: Whether it looks through trees, boulders and logs at the ground.
        noise: Standard deviation [m] of each height.
        seed: Of the noise.

    Raises ``ValueError`` naming the argument, its value and its bound.
    """

    def __init__(
        self,
        scene: Scene,
        *,
        forward: tuple[float, float] = (-4.0, 8.0),
        left: tuple[float, float] = (-4.0, 4.0),
        cell: float = 0.25,
        above: float = 5.0,
        ground_only: bool = True,
        noise: float = 0.0,
        seed: int = 0,
    ):
        points = grid_points(forward, left, cell)
        check_range("above", above, "m", gt=0.0, le=1000.0)
        check_range("noise", noise, "m", ge=0.0, lt=math.inf)
        check_integer("seed", seed, ge=0)
        self.forward, self.left = _nodes(forward, cell), _nodes(left, cell)
        self.scene, self.above, self.noise = scene, above, noise
        self._mesh = scene.ground if ground_only else scene.mesh
        self._rng = np.random.default_rng(seed)
        self._points = wp.array(points, dtype=cast(Any, wp.vec2), device=scene.device)

    def measure(self, position: ArrayLike, heading: ArrayLike) -> NDArray[np.float32]:
        """Heights (N, forward, left) [m] over the machines' positions; NaN where there is nothing below.

        Args:
            position: (N, 3) [m], as the twin's ``position_x``, ``position_y``, ``position_z``.
            heading: (N,) [rad].
        """
        places = np.asarray(position, dtype=np.float32)
        yaw = np.asarray(heading, dtype=np.float32)
        if places.ndim != 2 or places.shape[1] != 3 or not len(places) or yaw.shape != (len(places),):
            raise ValueError(
                f"position and heading have the shapes {places.shape} and {yaw.shape}, but must be (N, 3) and (N,)"
            )
        check_finite("position", places, "m")
        check_finite("heading", yaw, "rad")
        frames = wp.array(np.column_stack([places, yaw]), dtype=cast(Any, wp.vec4), device=self.scene.device)
        heights: Any = self.measure_on_device(frames).numpy().reshape(len(places), len(self.forward), len(self.left))
        if self.noise > 0.0:
            heights = heights + self._rng.normal(0.0, self.noise, heights.shape).astype(np.float32)
        return heights

    def measure_on_device(self, frames: wp.array, heights: wp.array | None = None) -> wp.array:
        """Heights (N, forward x left) [m] without noise, from ``frames`` (N,) of ``vec4``: x, y, z [m], heading [rad].

        ``heights`` is written in place where it is given.
        """
        device = self.scene.device
        out = wp.empty((len(frames), len(self._points)), dtype=float, device=device) if heights is None else heights
        inputs = [self._mesh.id, frames, self._points, float(self.above)]
        wp.launch(look_down, dim=out.shape, inputs=inputs, outputs=[out], device=device)
        return out


def grid_points(forward: tuple[float, float], left: tuple[float, float], cell: float) -> NDArray[np.float64]:
    """(forward x left, 2) [m] points of a grid, see :class:`HeightMapSensor`, which names what it raises."""
    check_range("cell", cell, "m", gt=0.0, lt=math.inf)
    for name, (low, high) in {"forward": forward, "left": left}.items():
        check_finite(name, (low, high), "m")
        check_range(f"second number of {name}", high, "m", ge=low, note=", the first one")
    count = math.prod(int((high - low) / cell + 1e-6) + 1 for low, high in (forward, left))
    check_range("number of points of the height map", count, le=MOST_POINTS, note="; take larger cells")
    return np.stack(np.meshgrid(_nodes(forward, cell), _nodes(left, cell), indexing="ij"), axis=-1).reshape(-1, 2)


def _nodes(bounds: tuple[float, float], cell: float) -> NDArray[np.float64]:
    """From the first bound on, as far as whole cells go."""
    low, high = bounds
    steps: Any = np.arange(int((high - low) / cell + 1e-6) + 1)
    return low + cell * steps
