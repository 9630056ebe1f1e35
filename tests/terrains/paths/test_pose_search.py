"""Ways over costs: what remains is as brute force finds it, bends are bounded, ways are as cheap as without a guide."""

import math

import numpy as np
import pytest

from aoro_gym.terrains.paths.pose_search import PIECE, SPACING, TIGHTEST, CostMap, steerable_way

CELL = 0.5
START, GOAL = (2.0, 10.0, 0.0), (18.0, 10.0)


def random_ground(seed, blocked=0.15):
    """Open at both ends of a way through the middle."""
    rng = np.random.default_rng(seed)
    cost = 1.0 + 2.0 * rng.random((41, 41))
    for row, column in rng.integers(0, 41, (round(blocked * 40), 2)):
        cost[row : row + 3, column : column + 3] = np.inf
    cost[18:23, :10] = cost[18:23, -8:] = 1.0
    return CostMap(cost, (0.0, 0.0), CELL)


def relaxed(ground, goal):
    """Costs to a goal by relaxing all steps until nothing changes any more (Bellman and Ford)."""
    cost = np.pad(ground.cost, 1, constant_values=np.inf)
    found = np.full(cost.shape, np.inf)
    row, column = ground.node(*goal)
    found[row + 1, column + 1] = 0.0
    while True:
        before = found.copy()
        for dr in (-1, 0, 1):
            for dc in (-1, 0, 1):
                if dr or dc:
                    there = np.roll(found, (dr, dc), axis=(0, 1))
                    price = 0.5 * CELL * math.hypot(dr, dc) * (cost + np.roll(cost, (dr, dc), axis=(0, 1)))
                    found = np.minimum(found, there + price)
        if np.array_equal(found, before):
            return found[1:-1, 1:-1]


def price(ground, way):
    """What a way costs by the nodes nearest to its points, bends apart."""
    nodes = [ground.node(x, y) for x, y in way[1:]]
    return SPACING * sum(ground.cost[node] for node in nodes)


@pytest.mark.parametrize("seed", range(3))
def test_what_remains_is_as_brute_force_finds_it(seed):
    ground = random_ground(seed)
    found, expected = ground.cost_to_go(GOAL), relaxed(ground, GOAL)
    np.testing.assert_array_equal(np.isinf(found), np.isinf(expected))
    known = np.isfinite(found)
    # sums of at most a hundred steps, in another order
    np.testing.assert_allclose(found[known], expected[known], rtol=1e-12)


@pytest.mark.parametrize("seed", range(3))
def test_the_guide_makes_no_way_dearer(seed):
    """Dijkstra's algorithm over poses, A* that expects nothing to remain, is the oracle. Poses of a cell count as one, whose
    places differ by up to 0.4 m: costs may differ by what a tenth of a cell's side costs a piece."""
    ground = random_ground(seed)
    guided = steerable_way(ground, START, GOAL)
    blind = steerable_way(ground, START, GOAL, to_go=np.zeros_like(ground.cost), most=10**6)
    assert guided is not None and blind is not None
    assert price(ground, guided) == pytest.approx(price(ground, blind), rel=0.1)
    # both are worth at least what the grid says: eight directions are at most 1 / 0.92 as long
    assert price(ground, guided) > 0.85 * (ground.cost_to_go(GOAL)[ground.node(*START[:2])] - 1.0)


@pytest.mark.parametrize("seed", range(3))
def test_ways_bend_no_tighter_and_cross_nothing(seed):
    ground = random_ground(seed)
    way = steerable_way(ground, START, GOAL)
    assert way is not None
    np.testing.assert_allclose(way[0], START[:2])
    assert np.hypot(*(way[-1] - GOAL)) <= 1.0
    steps = np.diff(way, axis=0)
    # chords of the tightest arc are shorter than it by (spacing / radius)² / 24 of it
    np.testing.assert_allclose(np.hypot(*steps.T), SPACING, rtol=1e-4)
    turns = np.diff(np.unwrap(np.arctan2(steps[:, 1], steps[:, 0])))
    assert np.abs(turns).max() <= SPACING / TIGHTEST + 1e-9
    assert all(np.isfinite(ground.cost[ground.node(x, y)]) for x, y in way)
    # the joint takes time: between full bends to either side lies a piece at least
    assert np.abs(turns[round(PIECE / SPACING) :] - turns[: -round(PIECE / SPACING)]).max() < 1.5 * SPACING / TIGHTEST


def test_who_stands_the_wrong_way_round_turns():
    ground = CostMap(np.ones((81, 81)), (0.0, 0.0), CELL)
    way = steerable_way(ground, (20.0, 20.0, math.pi), (30.0, 20.0))
    assert way is not None
    assert way[5, 0] < 20.0  # forward first
    assert np.abs(way[:, 1] - 20.0).max() > TIGHTEST


def test_walls_end_ways():
    cost = np.ones((41, 41))
    cost[:, 20] = np.inf
    ground = CostMap(cost, (0.0, 0.0), CELL)
    assert steerable_way(ground, START, GOAL) is None
    part = steerable_way(ground, START, GOAL, partial=True)
    assert part is None  # nothing is nearer than the start where no way leads to the goal
    dear = np.where(np.isinf(cost), 100.0, cost)
    through = steerable_way(CostMap(dear, (0.0, 0.0), CELL), START, GOAL)
    assert through is not None and through[-1, 0] > 16.0
    few = steerable_way(CostMap(dear, (0.0, 0.0), CELL), START, GOAL, partial=True, most=5)
    assert few is not None and 2.0 < few[-1, 0] < 10.0


def test_what_is_wrong_is_named():
    with pytest.raises(ValueError, match="least cost is 0, but must be above 0"):
        CostMap(np.zeros((3, 3)), (0.0, 0.0), CELL)
    with pytest.raises(ValueError, match=r"goal is \(30, 0\) m, but must lie in the map"):
        CostMap(np.ones((3, 3)), (0.0, 0.0), CELL).cost_to_go((30.0, 0.0))
