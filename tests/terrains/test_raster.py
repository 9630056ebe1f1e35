"""Rasters: nodes and holes, the grid's extent, ceilings, and errors that name the fix."""

import re
from typing import Any

import numpy as np
import pytest
import warp as wp

from aoro_gym.terrains.raster import Raster, rasterise
from aoro_gym.terrains.survey import HEADROOM, PATCH
from aoro_gym.terrains.terrain import Terrain


def raster_of(terrain: Terrain, **options: Any) -> Raster:
    points: Any = wp.array(terrain.vertices, dtype=wp.vec3, device="cpu")
    return rasterise(terrain, wp.Mesh(points, wp.array(terrain.faces.ravel(), dtype=int, device="cpu")), **options)


def plane(rows: int = 21, columns: int = 31, **options: Any) -> Terrain:
    """0.1 up to the east and 0.2 to the north, 0.5 m between its heights, from (-3, 7) on."""
    x, y = 0.5 * np.arange(columns), 0.5 * np.arange(rows)
    return Terrain.from_heights(0.1 * x[None, :] + 0.2 * y[:, None], cell=0.5, corner=(-3.0, 7.0), **options)


@pytest.mark.parametrize("cell", [0.25, 0.4, 1.0])
def test_nodes_cover_the_extent_and_hold_the_plane(cell):
    """15 m x 10 m: the last node lies on or beyond the edge, by less than a cell; heights and slopes are the plane's up
    to roundings of 17 m, over the chord for the slopes."""
    raster = raster_of(plane(), cell=cell)
    rows, columns = raster.ceilings.shape
    assert raster.corner == (-3.0, 7.0)
    assert 15.0 <= (columns - 1) * cell + 1e-9 < 15.0 + cell
    assert 10.0 <= (rows - 1) * cell + 1e-9 < 10.0 + cell
    x, y = cell * np.arange(columns), cell * np.arange(rows)
    inside = np.ix_((y > PATCH) & (y < 10.0 - PATCH), (x > PATCH) & (x < 15.0 - PATCH))
    nodes = raster.nodes[inside].astype(float)
    expected = (0.1 * x[None, :] + 0.2 * y[:, None])[inside]
    tolerance = 16.0 * 2.0**-24 * 17.0
    np.testing.assert_allclose(nodes[..., 0], expected, atol=tolerance)
    np.testing.assert_allclose(nodes[..., 1], 0.1, atol=tolerance / PATCH)
    np.testing.assert_allclose(nodes[..., 2], 0.2, atol=tolerance / PATCH)
    assert np.all(nodes[..., 3] == 1.0)
    np.testing.assert_array_equal(raster.cover[inside], 1.0)


def test_a_hole_takes_the_nearest_ground():
    """A hole between an icy low and a dry high bank: each node in it has the height and the grip of the bank nearer to
    it, level, and is not known."""
    heights = np.where(np.arange(41) < 20, 1.0, 3.0) * np.ones((41, 1))
    friction = np.where(np.arange(41) < 20, 0.2, 1.0) * np.ones((41, 1))
    heights[:, 15:26] = np.nan
    raster = raster_of(Terrain.from_heights(heights, cell=0.5, friction=friction), cell=0.5)
    hole = slice(16, 25)
    nodes, grip = raster.nodes[20, hole], raster.cover[20, hole, 0]
    np.testing.assert_allclose(nodes[:, 0], [1.0] * 4 + [nodes[4, 0]] + [3.0] * 4, rtol=1e-6)
    assert np.all(nodes[:, 1:] == 0.0)
    np.testing.assert_allclose(grip[:4], 0.2, rtol=1e-6)
    np.testing.assert_allclose(grip[5:], 1.0, rtol=1e-6)


def test_the_lowest_level_with_headroom_counts():
    """A shelf at every height over level ground: below ``HEADROOM`` it is the ground, from there on the ground below is;
    of two shelves the upper one only if there is no room under it."""
    ground = plane(5, 5)
    for gap, expected in ((0.5 * HEADROOM, 0.5 * HEADROOM), (1.01 * HEADROOM, 0.0)):
        flat = ground.vertices * (1.0, 1.0, 0.0)
        shelf = flat + np.array([0.0, 0.0, gap])
        terrain = Terrain(np.concatenate([flat, shelf]), np.concatenate([ground.faces, ground.faces + len(flat)]))
        raster = raster_of(terrain)
        np.testing.assert_allclose(raster.nodes[2:-2, 2:-2, 0], expected, atol=1e-5)
        assert np.all(raster.ceilings >= gap - 1e-6)


@pytest.mark.parametrize(
    ("cell", "message"),
    [
        (0.0, "cell is 0 m, but must be finite and above 0"),
        (np.nan, "cell is nan m, but must be finite"),
        (1e-4, "cell is 0.0001 m, which makes 1.5e+10 nodes over 15 m x 10 m, but a raster has at most 2e+08"),
    ],
)
def test_errors_name_the_fix(cell, message):
    with pytest.raises(ValueError, match=re.escape(message)):
        raster_of(plane(), cell=cell)


def test_a_terrain_that_no_node_meets_is_an_error():
    """A sliver between the nodes."""
    corners = np.array([[0.0, 9.0, 0.0], [4.5, 4.4, 0.0], [9.0, 0.0, 0.0]])
    sliver = Terrain(vertices=corners, faces=np.array([[0, 1, 2]]))
    with pytest.raises(ValueError, match=r"cell is 4\.0 m, so wide that no node lies over terrain 'terrain'"):
        raster_of(sliver, cell=4.0)
