"""Forests to run through: generated worlds with starts and goals, by seed and difficulty, each with a route that leads
there.

>>> from aoro_gym.envs.forest_run.courses import forest_run_course
>>> course = forest_run_course(3, difficulty=0.5)
>>> len(course.paths), len(course.world.objects) > 100
(5, True)

How worlds are grown and routes are found: :mod:`aoro_gym.envs.forest_run.growing`.
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
from aoro_gym.execution.cache import is_kept as kept
from aoro_gym.execution.digest import digest
from aoro_gym.terrains import Path, Terrain
from aoro_gym.terrains.world.entries import object_entry, object_of
from aoro_gym.terrains.world.world import Undergrowth, World

Floats = NDArray[np.float64]


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
        # generators take a second to import, and most courses come from the disk
        from aoro_gym.envs.forest_run.growing import grown_world, routes

        grown = grown_world(seed, difficulty)
        return Course.over(grown, routes(grown, seed, difficulty), name=f"forest run {seed}, difficulty {difficulty:g}")

    return cached(KIND, _parts(seed, difficulty), make, _packed, _unpacked)


def is_kept(seed: int, difficulty: float) -> bool:
    """Whether the disk has the world of :func:`forest_run_course`."""
    return kept(KIND, _parts(seed, difficulty))


SPLITS = Splits(forest_run_course, least_difficulty=0.1, validation_seed=5_000, held_out_seed=10_000)
"""Worlds to learn in, to evaluate trainings in, and held out: the last ones have 200 routes."""
learned_courses = SPLITS.learned
validation_courses = SPLITS.validation
held_out_courses = SPLITS.held_out


# ---- on disk ---------------------------------------------------------------------------------------------------------


KIND = "forest_runs"
"""Folder of the cache."""


def _parts(seed: int, difficulty: float) -> tuple[Any, ...]:
    return seed, difficulty, _code()


@cache
def _code() -> str:
    """Digest of what a course depends on beside its arguments."""
    here = Folder(__file__).resolve()
    return digest(*computed_with(here, here.with_name("growing.py"), Folder(terrains.__file__).parent))


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
