"""Forests to run through: generated worlds with starts and goals, by seed and difficulty, each with a route that leads
there.

>>> from aoro_gym.envs.forest_run.courses import forest_run_course
>>> course = forest_run_course(3, difficulty=0.5)
>>> len(course.paths), len(course.world.objects) > 100
(5, True)

A route is a cheapest way over the world's truth, by A* over poses (:mod:`aoro_gym.terrains.paths.pose_search`): it bends no
tighter than the machine can, and keeps :data:`ROOM` from all that stops one, its footprint inflated. So every course can be
driven. Whoever drives does not see it.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import fields
from functools import cache
from pathlib import Path as Folder
from typing import Any

import numpy as np
from numpy.typing import NDArray

from aoro_gym import terrains
from aoro_gym.checks import check_integer, check_range
from aoro_gym.envs.core.splits import Splits
from aoro_gym.envs.path_tracking.courses import Course
from aoro_gym.execution.cache import cached, computed_with
from aoro_gym.execution.digest import digest
from aoro_gym.terrains import Path, Terrain
from aoro_gym.terrains.generate.forest import ForestSettings
from aoro_gym.terrains.generate.world import world
from aoro_gym.terrains.paths.pose_search import SPACING, TIGHTEST, CostMap, steerable_way
from aoro_gym.terrains.world.files import object_entry, object_of
from aoro_gym.terrains.world.places import circles, stands_free
from aoro_gym.terrains.world.traversability import HALF_WIDTH, traversability
from aoro_gym.terrains.world.world import Undergrowth, World

Floats = NDArray[np.float64]

SIZE = (64.0, 64.0)
"""Of a world [m]."""
RUNS = 5
"""Routes through a world."""
GROUND = ForestSettings(size=SIZE, cell=0.5, road_width=0.0, trail=False, meadow=False, wet_share=0.1)
"""Forest everywhere, a tenth of it wet."""
AXLE = 1.7
"""Hinge to either axle [m]."""
ROOM = HALF_WIDTH + float(np.hypot(TIGHTEST, AXLE) - TIGHTEST) + 0.2
"""Least distance [m] of a route to what stops a machine: half of its width, what it sweeps besides in the tightest bend, and
0.2 m."""
STAND = 4.0
"""Length [m] of a route behind its start, on which the machine stands."""

_TRIES = 3000
_MOST = 3000  # poses of a search: those that take more lead far around
_DETOUR = 1.4  # length of a route over its distance, at most
_ASIDE = 0.8  # [rad] off the goal's direction at the start, at most


def forest_run_course(seed: int, difficulty: float = 1.0) -> Course:
    """A world of 64 m x 64 m with five routes; the same for the same seed and difficulty, and kept on disk.

    Args:
        seed: Of the world, at least 0.
        difficulty: From 0, 100 stems a hectare and goals 15 m to 22 m away, to 1, 300 stems and 25 m to 35 m. Stumps,
            boulders and fallen stems become more likewise.

    Raises ValueError naming the argument and its bound, or if no route is found.
    """
    check_integer("seed", seed, ge=0)
    check_range("difficulty", difficulty, ge=0.0, le=1.0)

    def make() -> Course:
        grown = grown_world(seed, difficulty)
        return Course.over(grown, routes(grown, seed, difficulty), name=f"forest run {seed}, difficulty {difficulty:g}")

    return cached("forest_runs", (seed, difficulty, _code()), make, _packed, _unpacked)


def grown_world(seed: int, difficulty: float) -> World:
    """The world of :func:`forest_run_course`: a thinned pine heath, whose crowns hang higher than the machine."""
    return world(
        seed, ground=GROUND, size=SIZE, stand="pine", stems=100.0 + 200.0 * difficulty, stumps=100.0 + 150.0 * difficulty,
        boulders=20.0 + 60.0 * difficulty, fallen=10.0 + 20.0 * difficulty, piles=2.0 * difficulty, branches=100.0,
        strip_roads=0.0, undergrowth=0.0,
    )  # fmt: skip


def routes(grown: World, seed: int, difficulty: float) -> tuple[Path, ...]:
    """:data:`RUNS` routes through a world.

    Raises ValueError if there are fewer.
    """
    rng = np.random.default_rng([seed, 1])
    ground, solid = traversability(grown), circles(grown)
    cost = CostMap(ground.cost(ROOM), ground.corner, ground.cell)
    open_nodes = np.argwhere(np.isfinite(cost.cost))
    nearest, farthest = 15.0 + 10.0 * difficulty, 22.0 + 13.0 * difficulty
    found: list[Path] = []
    for _ in range(_TRIES if len(open_nodes) else 0):
        start, goal = ground.places(open_nodes[rng.integers(len(open_nodes), size=2)])
        towards = float(np.arctan2(*(goal - start)[::-1])) + rng.uniform(-_ASIDE, _ASIDE)
        if nearest <= float(np.hypot(*(goal - start))) <= farthest and _stands(start, towards, cost, solid):
            way = steerable_way(cost, (*start, towards), tuple(goal), most=_MOST)
            if way is not None and SPACING * len(way) <= _DETOUR * np.hypot(*(goal - start)):
                behind = start - STAND * np.array([np.cos(towards), np.sin(towards)])
                found.append(Path(np.concatenate([behind[None], way]), name=f"run {len(found)}"))
        if len(found) == RUNS:
            return tuple(found)
    raise ValueError(
        f"world {seed} of difficulty {difficulty:g} has {len(found)} routes, but {RUNS} are asked for; take another seed"
    )


def _stands(start: Floats, heading: float, cost: CostMap, solid: Floats) -> bool:
    """Whether a machine can stand straight with its front axle at ``start`` [m], with ground and room behind it."""
    direction = np.array([np.cos(heading), np.sin(heading)])
    rear = cost.node(*(start - 2.0 * AXLE * direction))
    inside = all(0 <= place < size for place, size in zip(rear, cost.cost.shape, strict=True))
    hinge = (start - AXLE * direction)[None]
    free = stands_free(solid, hinge, np.array([heading]), np.zeros(1))[0]
    return bool(inside and np.isfinite(cost.cost[rear]) and free)


SPLITS = Splits(forest_run_course, least_difficulty=0.1, validation_seed=5_000, held_out_seed=10_000)
"""Worlds to learn in, to evaluate trainings in, and held out: the last ones have 200 routes."""
learned_courses = SPLITS.learned
validation_courses = SPLITS.validation
held_out_courses = SPLITS.held_out


# ---- on disk ---------------------------------------------------------------------------------------------------------


@cache
def _code() -> str:
    """Digest of what a course depends on beside its arguments."""
    return digest(*computed_with(Folder(__file__).resolve(), Folder(terrains.__file__).parent))


def _packed(course: Course) -> dict[str, Any]:
    """Arrays that hold a course in a world."""
    made = course.world
    assert made is not None and made.undergrowth is not None
    text = json.dumps([object_entry(one) for one in made.objects]).encode()
    arrays = {
        **{f"terrain.{entry.name}": getattr(made.terrain, entry.name) for entry in fields(Terrain)},
        **{f"undergrowth.{entry.name}": getattr(made.undergrowth, entry.name) for entry in fields(Undergrowth)},
        **{f"route.{number}": path.points for number, path in enumerate(course.paths)},
        "objects": np.frombuffer(text, dtype=np.uint8),
        "ground": made.ground,
        "name": course.name,
        "world": made.name,
    }
    return {name: value for name, value in arrays.items() if value is not None}


def _unpacked(arrays: Mapping[str, Any]) -> Course:
    ground = {name.removeprefix("terrain."): value for name, value in arrays.items() if name.startswith("terrain.")}
    ground |= {name: str(ground[name]) for name in ("name", "crs") if name in ground}
    ground["origin"] = tuple(ground["origin"].tolist())
    plants = Undergrowth(
        tuple(arrays["undergrowth.corner"].tolist()), float(arrays["undergrowth.cell"]),
        arrays["undergrowth.height"], arrays["undergrowth.density"],
    )  # fmt: skip
    entries = json.loads(arrays["objects"].tobytes())
    objects = tuple(object_of(f"objects[{number}]", entry) for number, entry in enumerate(entries))
    made = World(Terrain(**ground), objects, arrays["ground"], plants, name=str(arrays["world"]))
    count = sum(key.startswith("route.") for key in arrays)
    paths = tuple(Path(arrays[f"route.{number}"], name=f"run {number}") for number in range(count))
    return Course.over(made, paths, name=str(arrays["name"]))
