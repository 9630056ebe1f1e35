"""Serpentines over hills, by seed and difficulty.

What makes a course difficult is how much of the machine's limits it asks for:

- **Steering.** A path whose curvature changes by κ′ [1/m²] along its length asks, at the speed v, for the joint rate
  (f + r) v κ′, with f and r from the hinge to the axles (small angles). The joint turns at 0.65 rad/s at most, and bends of
  0.19 /m leave little beyond themselves to come back by: the tightest turn of all is 0.21 /m.
- **Power.** On a grade of the angle γ the weight W takes W v sin γ: too fast uphill the engine stalls, too fast downhill it
  does not brake any more.
- **Grip.** Up, down or across, the tires bear tan γ of the weight, besides what speeding up and bends (v² κ) ask for, and
  slide at μ: on 25° 0.47 of 0.49.
- **Reception.** Without satellites the pose is reckoned from wheels and yaw rate, as if nothing slipped: see
  :data:`aoro_gym.envs.limit_tracking.config.CANOPY`.

>>> from aoro_gym.envs.limit_tracking.courses import hilly_course
>>> course = hilly_course(3, difficulty=0.5)
>>> len(course.paths), round(course.paths[0].length)
(5, 44)
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from aoro_gym.checks import check_integer, check_range
from aoro_gym.envs.core.splits import Splits
from aoro_gym.envs.path_tracking.courses import Course
from aoro_gym.terrains import Path, Terrain
from aoro_gym.terrains.generate.random_field import RandomField
from aoro_gym.units import DEGREE

Floats = NDArray[np.float64]

PATHS, LENGTH = 5, 44.0
"""Paths over the hills of a course, and the length [m] of each."""
FRICTION, ROLLING_RESISTANCE = 0.7, 3.0
"""Of the ground, against dry asphalt (E: between grass and a forest's floor)."""
STEEPEST = (8.0, 25.0)
"""Of the smoothed ground [deg], at difficulty 0 and 1."""
TIGHTEST = (0.12, 0.19)
"""Curvature [1/m] of the bends, likewise."""
RAMP = (2.0, 0.8)
"""Way [m] over which a bend begins and ends, likewise."""
SWING = (40.0, 65.0)
"""Angle [deg] to either side of a path's direction that its bends turn to."""

_HALF, _CELL, _STEP = 34.0, 0.25, 0.25  # [m] of the ground's side, of its raster, between the points of a path


def hilly_course(seed: int, difficulty: float = 1.0) -> Course:
    """Hills with five paths over them in all directions; the same for the same seed and difficulty.

    Args:
        seed: Of the ground, at least 0.
        difficulty: In [0, 1], from the first to the second values of :data:`STEEPEST`, :data:`TIGHTEST` and :data:`RAMP`.

    Raises ValueError naming the argument and its bound.
    """
    check_integer("seed", seed, ge=0)
    check_range("difficulty", difficulty, ge=0.0, le=1.0)
    rng = np.random.default_rng([seed, round(1000 * difficulty)])
    axis = np.arange(-_HALF, _HALF + 0.5 * _CELL, _CELL)
    heights = RandomField(rng, 12, 14.0, 40.0).grid(axis, axis)
    slope = np.hypot(*np.gradient(heights, _CELL)).max()
    heights *= math.tan(_between(STEEPEST, difficulty) * DEGREE) / slope
    heights += 0.012 * RandomField(rng, 32, 0.8, 4.0).grid(axis, axis)
    name = f"hills {seed}, difficulty {difficulty:g}"
    terrain = Terrain.from_heights(
        heights, cell=_CELL, corner=(-_HALF, -_HALF), friction=FRICTION, rolling_resistance=ROLLING_RESISTANCE,
        name=name,
    )  # fmt: skip
    directions = rng.uniform(-math.pi, math.pi) + 2.0 * math.pi / PATHS * np.arange(PATHS)
    paths = [
        _through_the_middle(serpentine(rng, difficulty), float(way), f"path {k}") for k, way in enumerate(directions)
    ]
    return Course(terrain, tuple(paths), name=name)


def serpentine(rng: np.random.Generator, difficulty: float) -> Floats:
    """Curvature [1/m] every 0.25 m of a path that bends to one side, then as far to the other, with straights between."""
    tightest, ramp = _between(TIGHTEST, difficulty), _between(RAMP, difficulty)
    ways, bends = [4.5], [0.0]  # from node to node [m], and the curvature there
    side, before = float(rng.choice([-1.0, 1.0])), 0.0
    while sum(ways) < LENGTH:
        after = float(rng.uniform(*SWING)) * DEGREE  # heading off the path's direction
        arc = max((before + after) / tightest - ramp, 0.5)
        ways += [ramp, arc, ramp, float(rng.uniform(1.0, 4.0))]
        bends += [side * tightest, side * tightest, 0.0, 0.0]
        side, before = -side, after
    return np.interp(np.arange(0.0, LENGTH + 0.5 * _STEP, _STEP), np.cumsum(ways), bends)


def _between(ends: tuple[float, float], share: float) -> float:
    return ends[0] + share * (ends[1] - ends[0])


def _through_the_middle(curvature: Floats, direction: float, name: str) -> Path:
    """The path of this curvature whose ends lie about the middle of the ground, the line between them in ``direction``
    [rad]."""
    heading = np.concatenate([[0.0], np.cumsum(0.5 * _STEP * (curvature[1:] + curvature[:-1]))])
    middle = 0.5 * (heading[1:] + heading[:-1])
    points = np.concatenate(
        [[[0.0, 0.0]], np.cumsum(_STEP * np.stack([np.cos(middle), np.sin(middle)], axis=1), axis=0)]
    )
    turn = direction - math.atan2(points[-1, 1], points[-1, 0])
    c, s = math.cos(turn), math.sin(turn)
    points = (points - 0.5 * (points[0] + points[-1])) @ np.array([[c, s], [-s, c]])
    return Path(points, name=name)


SPLITS = Splits(hilly_course, least_difficulty=0.5)
"""Courses to learn on, to evaluate trainings on, and held out: the last ones have 200 paths."""
learned_courses = SPLITS.learned
validation_courses = SPLITS.validation
held_out_courses = SPLITS.held_out
