"""Projections and places of many vehicles on many paths agree with the paths' own, one by one."""

import numpy as np
import pytest

from aoro_gym.envs.path_tracking.path_table import PathTable
from aoro_gym.terrains import Path

LINE = Path(np.stack([np.arange(0.0, 41.0), np.zeros(41)], axis=1))


def wavy(seed):
    rng = np.random.default_rng(seed)
    return Path.spline(np.cumsum(rng.uniform(4.0, 9.0, (7, 2)) * [1.0, rng.choice([-0.5, 0.5])], axis=0))


def ring(radius=8.0, count=200):
    angle = 2.0 * np.pi * np.arange(count) / count
    return Path(radius * np.stack([np.sin(angle), 1.0 - np.cos(angle)], axis=1), closed=True)


def test_projection_is_the_paths_own():
    paths = [wavy(1), wavy(2), ring()]
    table = PathTable(paths)
    rng = np.random.default_rng(0)
    row = rng.integers(0, 3, 300)
    s = rng.uniform(1.0, table.lengths[row] - 1.0)
    place, heading, _ = table.at(row, s)
    offset = rng.uniform(-1.5, 1.5, 300)
    xy = place + offset[:, None] * np.stack([-np.sin(heading), np.cos(heading)], axis=1)
    found, cross = table.project(row, xy, s + rng.uniform(-0.6, 0.6, 300), reach=1.5)
    for i in range(300):
        own_s, own_cross = paths[row[i]].project(xy[i], near=s[i])
        # chords of the table and of the path each cut κ·spacing²/8 ≤ 8e-3 off the tightest bend (1 m)
        assert found[i] == pytest.approx(float(own_s), abs=0.03)
        assert cross[i] == pytest.approx(float(own_cross), abs=0.01)
        assert np.sign(cross[i]) == np.sign(offset[i]) or abs(offset[i]) < 0.01


def test_places_headings_and_curvatures_are_the_paths_own():
    paths = [wavy(3), ring(6.0)]
    table = PathTable(paths)
    for row, path in enumerate(paths):
        s = np.linspace(0.0, path.length, 57)
        place, heading, curvature = table.at(np.full(57, row), s)
        np.testing.assert_allclose(place, path.position(s), atol=0.01)
        np.testing.assert_allclose(np.cos(heading - path.heading(s)), 1.0, atol=1e-3)
        assert np.abs(curvature - path.curvature(s)).max() < 0.05
    np.testing.assert_allclose(table.at(np.ones(5, dtype=np.intp), np.linspace(1, 9, 5))[2], 1 / 6.0, rtol=0.01)


def test_open_paths_go_on_straight_and_closed_ones_around():
    table = PathTable([LINE, ring(5.0)], ahead=10.0)
    both = np.array([0, 0, 1, 1])
    length = table.lengths
    place, heading, _ = table.at(both, np.array([-3.0, 47.0, -2.0, length[1] + 2.0]))
    np.testing.assert_allclose(place[:2], [[-3.0, 0.0], [47.0, 0.0]], atol=1e-9)
    np.testing.assert_allclose(heading[:2], 0.0, atol=1e-9)
    np.testing.assert_allclose(
        place[2], table.at(both[2:3], length[1:] - 2.0)[0][0], atol=3e-3
    )  # chords: 0.25² / 8 / 5
    np.testing.assert_allclose(place[3], table.at(both[2:3], np.array([2.0]))[0][0], atol=3e-3)
    s, cross = table.project(np.zeros(1, dtype=np.intp), np.array([[43.0, -0.5]]), np.array([42.5]), reach=1.5)
    np.testing.assert_allclose([s[0], cross[0]], [43.0, -0.5], atol=1e-9)


def test_a_vehicle_stays_on_its_branch():
    eight = np.linspace(0.0, 2 * np.pi, 200, endpoint=False)
    path = Path(np.stack([12.0 * np.sin(eight), 8.0 * np.sin(2 * eight)], axis=1), closed=True)
    table = PathTable([path])
    second = 0.5 * path.length  # the crossing, the second time
    s, _ = table.project(np.zeros(2, dtype=np.intp), np.zeros((2, 2)), np.array([0.3, second + 0.3]), reach=1.5)
    np.testing.assert_allclose(s, [0.0, second], atol=0.1)


def test_rows_can_be_added_and_dropped():
    table = PathTable([LINE])
    table.add([ring()])
    assert len(table) == 2
    before = table.at(np.zeros(1, dtype=np.intp), np.array([39.9]))[0]
    table.shortened(1)
    assert len(table) == len(table.lengths) == 1
    np.testing.assert_array_equal(table.at(np.zeros(1, dtype=np.intp), np.array([39.9]))[0], before)
    with pytest.raises(ValueError, match="there is no path"):
        PathTable([])
