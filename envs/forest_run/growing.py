"""How the forests of forest runs are grown, and how routes through them are found.

A route is a cheapest way over the world's truth, by A* over poses (:mod:`aoro_gym.terrains.paths.pose_search`): it bends no
tighter than the machine can, and keeps :data:`ROOM` from all that stops one, its footprint inflated. So every course can be
driven. Whoever drives does not see it.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from aoro_gym.terrains import Path
from aoro_gym.terrains.generate.forest import ForestSettings
from aoro_gym.terrains.generate.world import world
from aoro_gym.terrains.paths.pose_search import SPACING, TIGHTEST, CostMap, steerable_way
from aoro_gym.terrains.world.places import circles, stands_free
from aoro_gym.terrains.world.traversability import HALF_WIDTH, traversability
from aoro_gym.terrains.world.world import World

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


def grown_world(seed: int, difficulty: float) -> World:
    """The world of :func:`~aoro_gym.envs.forest_run.courses.forest_run_course`: a thinned pine heath, whose crowns hang
    higher than the machine."""
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
