"""Ground to level on: lanes over waves, half-sunken logs, steps, side slopes and mounds, by seed and difficulty.

>>> from aoro_gym.envs.levelling.courses import obstacle_course
>>> course = obstacle_course(3, difficulty=0.5)
>>> len(course.paths), round(course.paths[0].length)
(5, 40)
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from aoro_gym.checks import check_integer, check_range
from aoro_gym.envs.core.splits import Splits
from aoro_gym.envs.path_tracking.courses import Course
from aoro_gym.terrains import Path, Terrain
from aoro_gym.terrains.generate.random_field import RandomField

Floats = NDArray[np.float64]

LANES, LANE_WIDTH = 5, 10.0
"""Lanes of a ground, side by side, and the distance [m] of their middles."""
LENGTH = 40.0
"""Of a lane's path along x [m]."""
FIRST, SECTION = 8.0, 6.0
"""Where the first section begins [m], behind the ground that a machine starts on, and the length [m] of each."""
KINDS = ("waves", "log", "step", "side slope", "mounds")
"""Of sections; every lane has each of them once, in an order of its own."""
FRICTION, ROLLING_RESISTANCE = 0.7, 3.0
"""Of the ground, against dry asphalt (E: between grass and a forest's floor)."""

_CELL, _MARGIN = 0.25, 5.0  # [m]
_FLAT, _OUT = 2.6, 4.4  # [m] off a lane's middle: where a section is whole, and where nothing of it is left


def obstacle_course(seed: int, difficulty: float = 1.0) -> Course:
    """Five lanes of 40 m; the same for the same seed and difficulty.

    Args:
        seed: Of the ground, at least 0.
        difficulty: In [0, 1]: at 0 logs and steps are 0.10 m high and side slopes 3°, at 1 0.35 m, 0.40 m and 15°.

    Raises ValueError naming the argument and its bound.
    """
    check_integer("seed", seed, ge=0)
    check_range("difficulty", difficulty, ge=0.0, le=1.0)
    rng = np.random.default_rng([seed, round(1000 * difficulty)])
    x = np.arange(-_MARGIN, LENGTH + _MARGIN + 0.5 * _CELL, _CELL)
    half = 0.5 * LANES * LANE_WIDTH + 1.0
    y = np.arange(-half, half + 0.5 * _CELL, _CELL)
    heights = (0.01 + 0.01 * difficulty) * RandomField(rng, 32, 0.8, 4.0).grid(x, y)
    heights += 0.25 * difficulty * RandomField(rng, 12, 12.0, 40.0).grid(x, y)
    paths = []
    for lane in range(LANES):
        middle = (lane - 0.5 * (LANES - 1)) * LANE_WIDTH
        rows = np.abs(y - middle) < _OUT
        heights[rows] += lane_heights(rng, x, y[rows] - middle, difficulty)
        paths.append(_path(rng, middle, f"lane {lane}"))
    terrain = Terrain.from_heights(
        heights, cell=_CELL, corner=(float(x[0]), float(y[0])), friction=FRICTION,
        rolling_resistance=ROLLING_RESISTANCE, name=f"obstacles {seed}, difficulty {difficulty:g}",
    )  # fmt: skip
    return Course(terrain, tuple(paths), name=terrain.name)


def lane_heights(rng: np.random.Generator, x: Floats, across: Floats, difficulty: float) -> Floats:
    """Heights [m] (rows, columns) of a lane's sections over the axes ``x`` (columns,) and ``across`` (rows,), the distance
    left of the lane's middle; beside the lane they fade away."""
    heights = np.zeros((len(across), len(x)))
    beside = (across[:, None], _fade(np.abs(across), _FLAT, _OUT)[:, None])
    for place, kind in enumerate(rng.permutation(len(KINDS))):
        along = x - (FIRST + place * SECTION)
        heights += _SECTIONS[KINDS[kind]](rng, along[None], beside[0], difficulty) * beside[1]
    return heights


def _fade(distance: Floats, whole: float, none: float) -> Floats:
    """1 up to ``whole``, 0 from ``none`` on, smooth between."""
    return 0.5 + 0.5 * np.cos(np.pi * np.clip((distance - whole) / (none - whole), 0.0, 1.0))


def _window(along: Floats, ramp: float) -> Floats:
    """1 within a section, 0 outside, with ramps of the length ``ramp`` [m] inside of it."""
    return _fade(np.abs(along - 0.5 * SECTION), 0.5 * SECTION - ramp, 0.5 * SECTION)


def _waves(rng: np.random.Generator, along: Floats, across: Floats, difficulty: float) -> Floats:
    field = RandomField(rng, 16, 1.8, 5.0)
    return (0.03 + 0.07 * difficulty) * field.grid(along[0], across[:, 0]) * _window(along, 1.0)


def _log(rng: np.random.Generator, along: Floats, across: Floats, difficulty: float) -> Floats:
    height, lean = 0.10 + 0.25 * difficulty, np.tan(rng.uniform(-0.6, 0.6))
    ridge = _fade(np.abs(along - 0.5 * SECTION - lean * across), 0.0, 0.6)
    side = rng.integers(-1, 2)  # right side, across the lane, left side
    return height * ridge * (1.0 if side == 0 else _fade(-side * across, 0.0, 0.6))


def _step(rng: np.random.Generator, along: Floats, across: Floats, difficulty: float) -> Floats:
    height, side = (0.10 + 0.30 * difficulty) * rng.choice([-1.0, 1.0]), rng.integers(-1, 2)
    up = 1.0 - _fade(along, 0.6, 1.2)
    down = _fade(along, SECTION - 1.8, SECTION)
    return height * up * down * (1.0 if side == 0 else _fade(-side * across, 0.0, 0.6))


def _side_slope(rng: np.random.Generator, along: Floats, across: Floats, difficulty: float) -> Floats:
    slope = np.tan(np.radians(3.0 + 12.0 * difficulty)) * rng.choice([-1.0, 1.0])
    return slope * across * _window(along, 1.6)


def _mounds(rng: np.random.Generator, along: Floats, across: Floats, difficulty: float) -> Floats:
    height, total = 0.08 + 0.22 * difficulty, np.zeros(np.broadcast_shapes(along.shape, across.shape))
    side = rng.choice([-1.0, 1.0])
    for place in (1.0, 2.7, 4.4):
        square = (along - place - rng.uniform(-0.3, 0.3)) ** 2 + (across - 0.95 * side) ** 2
        total = total + height * np.exp(-square / (2.0 * 0.35**2))
        side = -side
    return total


_SECTIONS: dict[str, Any] = dict(zip(KINDS, (_waves, _log, _step, _side_slope, _mounds), strict=True))


def _path(rng: np.random.Generator, middle: float, name: str) -> Path:
    """A path that weaves by up to 0.5 m about a lane's middle."""
    x = np.arange(0.0, LENGTH + 0.1, 0.5)
    sway = 0.5 * rng.uniform(-1.0, 1.0) * np.sin(2.0 * np.pi * (x / 26.0 + rng.random()))
    return Path(np.column_stack([x, middle + sway]), name=name)


SPLITS = Splits(obstacle_course, least_difficulty=0.3)
"""Grounds to learn on, to evaluate trainings on, and held out: the last ones have 200 lanes."""
learned_courses = SPLITS.learned
validation_courses = SPLITS.validation
held_out_courses = SPLITS.held_out
