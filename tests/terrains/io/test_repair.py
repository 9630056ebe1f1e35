"""Heights between scattered points: linear, exact at the points, and quick on grids, however many share the processor."""

import time

import numpy as np
from scipy.interpolate import LinearNDInterpolator
from scipy.spatial import Delaunay

from aoro_gym.terrains.heights import Heights
from aoro_gym.terrains.io.ground_filter import ground_points
from aoro_gym.terrains.io.repair import _triangles, interpolate, remove_small_components


def scattered(count=400, seed=0) -> np.ndarray:
    return np.random.default_rng(seed).uniform(0.0, 50.0, (count, 2))


def test_transforms_are_those_of_scipy():
    for plan in (scattered(), np.stack(np.meshgrid(np.arange(9.0), np.arange(7.0)), axis=-1).reshape(-1, 2)):
        mine, theirs = _triangles(plan), Delaunay(plan)
        np.testing.assert_array_equal(mine.simplices, theirs.simplices)
        np.testing.assert_allclose(mine.transform, theirs.transform, rtol=1e-9, atol=1e-12)


def test_heights_are_linear_between_points_and_exact_at_them():
    plan = scattered()
    z = np.sin(plan[:, 0] / 7.0) + plan[:, 1] / 9.0
    wanted = scattered(300, seed=1)
    expected = np.asarray(LinearNDInterpolator(plan, z)(wanted))
    inside = np.isfinite(expected)
    np.testing.assert_allclose(interpolate(plan, z, wanted)[inside], expected[inside], atol=1e-9)
    np.testing.assert_array_equal(interpolate(plan, z, plan), z)
    beyond = np.array([[-30.0, -30.0], [90.0, 20.0]])
    nearest = [z[np.argmin(np.linalg.norm(plan - place, axis=1))] for place in beyond]
    np.testing.assert_array_equal(interpolate(plan, z, beyond), nearest)


def test_points_on_a_line_give_the_nearest_height():
    plan = np.column_stack([np.arange(10.0), np.zeros(10)])
    np.testing.assert_array_equal(interpolate(plan, plan[:, 0], np.array([[3.2, 5.0], [8.9, -1.0]])), [3.0, 9.0])


def test_a_large_grid_takes_no_quadratic_time():
    x, y = np.meshgrid(np.arange(200.0), np.arange(200.0))
    plan = np.column_stack([x.ravel(), y.ravel()])
    started = time.process_time()
    np.testing.assert_array_equal(interpolate(plan, plan @ [0.1, 0.2], plan), plan @ [0.1, 0.2])
    interpolate(plan, plan @ [0.1, 0.2], plan[:-200] + 0.25)
    assert time.process_time() - started < 5.0  # it took 10 s for the first half of it, and grew with the square


def test_few_points_over_kilometres_take_no_cloth_of_their_whole_width():
    rng = np.random.default_rng(0)
    points = np.column_stack([rng.uniform(0.0, 30_000.0, (3000, 2)), rng.uniform(0.0, 5.0, 3000)])
    started = time.process_time()
    ground_points(points)
    assert time.process_time() - started < 20.0  # 5,600 tiles of 0.8 million particles would take an hour


def test_small_pieces_go_and_their_areas_are_told():
    z = np.full((9, 12), np.nan)
    z[:, :6] = 1.0  # 8 x 5 cells
    z[:3, 8:] = 2.0  # 2 x 3
    z[5:7, 9:11] = 3.0  # 1
    heights = Heights(z, 0.5)
    for smallest, areas in ((0.2, []), (0.3, [0.25]), (1.6, [1.5, 0.25]), (100.0, [1.5, 0.25])):
        kept, gone = remove_small_components(heights, smallest)
        assert gone == areas
        assert kept.known.sum() == 54 + 12 * (1.5 not in areas) + 4 * (0.25 not in areas)
