"""The planner that knows the world: its arcs are circles, its costs those of the map, it backs out of what it stands at."""

import numpy as np
import pytest

from aoro_gym.agents.controllers.forest_arcs import ARC, BACK, HINDERED, REAR, ArcPlanner, ArcTree, Maps, arc
from aoro_gym.agents.controllers.forest_run import ForestDriver
from aoro_gym.envs.forest_run.environment import ForestRunVectorEnv
from aoro_gym.envs.path_tracking.courses import Course
from aoro_gym.execution.array_api import HOST, Arrays
from aoro_gym.terrains import Path, Plane
from aoro_gym.terrains.paths.pose_search import TIGHTEST
from tests.envs.forest_run.worlds import AHEAD, course

GOAL = np.array([[25.0, 0.0]])


@pytest.fixture(scope="module")
def maps():
    return Maps([course()], 1.6, HOST)


def compared(tree, maps, x, y, heading=0.0, bend=0.0):
    numbers = maps.of(np.zeros(1, dtype=int), GOAL)
    places = np.column_stack([maps.nodes(np.array([[x, y]])), [heading]])
    return tree.compared(maps, numbers, places, maps.nodes(GOAL), np.array([bend]))[0]


def test_arcs_are_parts_of_circles():
    way = np.linspace(-3.0, 3.0, 7)
    x, y = arc(np.array([[0.2], [0.0]]), way)
    np.testing.assert_allclose(np.hypot(x[0], y[0] - 5.0), 5.0, rtol=1e-12)
    np.testing.assert_allclose(np.arctan2(x[0], 5.0 - y[0]), 0.2 * way, atol=1e-12)
    np.testing.assert_array_equal(x[1], way)


def test_a_tree_has_all_ways_of_its_arcs():
    tree = ArcTree.grown((3, 2))
    assert [len(places) for places in tree.places] == [3, 6]
    np.testing.assert_allclose(tree.curvatures * TIGHTEST, [-1.0, 0.0, 1.0])
    ends = tree.places[1][:, -1].reshape(3, 2, 2)
    # to the left on the right bend's end is the same angle as at the beginning; float32 of places of some metres
    x, y = arc(np.array(-1.0 / TIGHTEST), ARC)
    turned = -ARC / TIGHTEST
    dx, dy = arc(np.array(1.0 / TIGHTEST), ARC)
    expected = x + np.cos(turned) * dx - np.sin(turned) * dy, y + np.sin(turned) * dx + np.cos(turned) * dy
    np.testing.assert_allclose(ends[0, 1], expected, atol=8 * 2.0**-23)
    back = ArcTree.grown(BACK, back=True)
    np.testing.assert_allclose(back.places[0][1, :, 0], [*REAR, -ARC])


def test_on_open_ground_straight_ahead_costs_its_length(maps):
    """No room is lacked beside y = -8 m: a metre costs 1, so what remains is the distance, along a straight line exactly."""
    goal = np.array([[15.0, -8.0]])
    numbers, at = maps.of(np.zeros(1, dtype=int), goal), maps.nodes(np.array([[-5.0, -8.0]]))
    ahead = ArcTree.grown((3, 3, 3))
    total = ahead.compared(maps, numbers, np.column_stack([at, [0.0]]), maps.nodes(goal), np.zeros(1))[0]
    assert np.argmin(total) == 1
    # sums of some ten float32 of at most 20
    assert total[1] == pytest.approx(20.0, abs=10 * 20 * 2.0**-23)
    assert maps.remaining(numbers, at)[0] == pytest.approx(20.0, abs=20 * 2.0**-23)


def test_before_a_stem_every_way_ahead_is_hindered_and_back_is_not(maps):
    stem = 4.0 + AHEAD
    ahead, back = ArcTree.grown((7, 5, 5)), ArcTree.grown(BACK, back=True)
    free, close = compared(ahead, maps, stem - 8.0, 0.0), compared(ahead, maps, stem - 2.0, 0.0)
    left = maps.remaining(maps.of(np.zeros(1, dtype=int), GOAL), maps.nodes(np.array([[stem - 2.0, 0.0]])))[0]
    assert free.min() < 25.0 - (stem - 8.0) + HINDERED
    assert close.min() > left + HINDERED
    assert compared(back, maps, stem - 2.0, 0.0).min() < close.min()


def test_tensors_give_the_same():
    torch = pytest.importorskip("torch")
    assert torch
    rng = np.random.default_rng(0)
    x, y, heading = rng.uniform(-20.0, 20.0, (3, 20))
    found = []
    for arrays in (HOST, Arrays.torch("cpu")):
        known = Maps([course()], 1.6, arrays)
        numbers = known.of(np.zeros(20, dtype=int), np.repeat(GOAL, 20, axis=0))
        places = np.column_stack([known.nodes(np.column_stack([x, y])), heading])
        found.append(
            ArcTree.grown((3, 3)).compared(known, numbers, places, known.nodes(np.repeat(GOAL, 20, axis=0)), 0.0 * x)
        )
    # sines and cosines of two libraries, and 100 of float32
    np.testing.assert_allclose(found[0], found[1], rtol=100 * 2.0**-23)


def test_whose_map_is_planned_on_can_be_changed():
    env = ForestRunVectorEnv(2, courses=[course()], autoreset_mode="Disabled")
    policy = ArcPlanner(ForestDriver.of(env), None).watching(env)
    observations, _ = env.reset(seed=3, options={"path": 0})
    assert policy(observations).shape == (2, 2)


def test_maps_that_are_drawn_beforehand_are_the_same():
    env = ForestRunVectorEnv(2, courses=[course(), course()], autoreset_mode="Disabled")
    observations, _ = env.reset(seed=3)
    late, early = (ArcPlanner(ForestDriver.of(env), env) for _ in range(2))
    shares = []
    early.prepare(shares.append)
    early.prepare(shares.append)  # once
    assert shares == [0.0, 0.5]
    np.testing.assert_array_equal(late(observations), early(observations))


def test_what_is_no_world_is_named():
    path = Path(np.array([[0.0, 0.0], [9.0, 0.0]]))
    with pytest.raises(ValueError, match="course 0 is no world"):
        Maps([Course(Plane(), (path,))], 1.6, HOST)
