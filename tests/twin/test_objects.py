"""Shapes of objects on the device beside their meshes, and the boxes and cells that find them."""

# pyright: reportInvalidTypeForm=false, reportGeneralTypeIssues=false, reportCallIssue=false, reportArgumentType=false
import numpy as np
import pytest

from aoro_gym.terrains.world.meshes import BUMPS, SWELL, mesh
from aoro_gym.terrains.world.objects import Boulder, Branch, Log, Stump, Tree, along, is_solid, upright
from aoro_gym.twin.kernels.solids import Grid
from aoro_gym.twin.objects import EDGE, REACH, fill_grid, shapes
from aoro_gym.twin.physics.solids import Part
from tests.twin.physics.launch import launch, record
from tests.twin.physics.test_solids import gap_kernel

LEAN = upright(0.2, 0.8, 0.3)
TREE = Tree((3.0, 1.0, 0.4), LEAN, "spruce", 0.25, 18.0, 8.0, 1.5, 1)
STUMP = Stump((-2.0, 5.0, 0.1), LEAN, "pine", 0.18, 0.3)
BOULDER = Boulder((1.0, -4.0, 0.2), LEAN, (0.9, 0.6, 0.5), 0.6, 7)
LOG = Log((6.0, 2.0, 0.2), along((1.0, -2.0, 0.05)), "birch", 5.0, 0.16, 0.11, 0.4, 0)
BRANCH = Branch((0.0, 0.0, 0.0), along((1.0, 0.0, 0.0)), "pine", 2.0, 0.02)
SAPLING = Tree((0.0, 0.0, 0.0), upright(), "pine", 0.04, 4.0, 2.0, 0.5, 1)


def depths(one, points):
    """Depth [m] of world ``points`` (N, 3) in the device's shape of an object."""
    point = record(Part, centre=np.asarray(points, dtype=np.float32), half=(0.0, 0.0, 0.0), margin=0.0, round=0)
    return launch(gap_kernel, point, shapes([one])[0]).depth


@pytest.mark.parametrize(
    ("one", "least", "most"),
    [
        # corners of polygons as large as circles stand out by 3 % of the radius
        (LOG, -2e-3, 0.45 * LOG.radius),  # its ends are round, so the rim of the cut stands out by 0.41 r
        (STUMP, -2e-3, 1.25 * SWELL * STUMP.radius + 5e-3),  # wider at the ground
        (BOULDER, -BUMPS * 0.9, BUMPS * 0.9),  # in the middle of its bumps
        (TREE, -0.02, 0.06),  # without the swell of its butt
    ],
    ids=["log", "stump", "boulder", "tree"],
)
def test_shapes_lie_where_the_meshes_do(one, least, most):
    """How far the mesh's vertices lie outside of the shape [m]; crowns and tops of trees apart."""
    vertices = mesh(one, leaves=False).vertices
    if isinstance(one, Tree):
        vertices = vertices[:120]
        vertices = vertices[vertices[:, 2] < REACH - 0.3]
    outside = -depths(one, vertices)
    assert len(vertices) > 20
    assert least < outside.min() and outside.max() < most


def test_a_stump_is_as_high_and_as_wide_as_its_cut():
    top = np.array([0.0, 0.0, STUMP.height])
    stump = Stump((0.0, 0.0, 0.0), upright(), "pine", STUMP.radius, STUMP.height)
    found = depths(stump, [top, 1.05 * top, (STUMP.radius, 0, 0.1), (STUMP.radius + 0.05, 0, 0.1)])
    np.testing.assert_allclose(found, [0.0, -0.05 * STUMP.height, 0.0, -0.05], atol=1e-6)
    rim = depths(stump, [(STUMP.radius, 0.0, STUMP.height)])
    assert rim[0] == pytest.approx(-EDGE * (np.sqrt(2.0) - 1.0), abs=1e-6)


def test_what_is_solid():
    assert [is_solid(one) for one in (TREE, STUMP, BOULDER, LOG, BRANCH, SAPLING)] == 4 * [True] + 2 * [False]
    rows, boxes, numbers = shapes((BRANCH, LOG, SAPLING, TREE))
    assert numbers.tolist() == [2, 4] and len(rows) == len(boxes) == 2


def empty_grid():
    return np.zeros(1, dtype=Grid.numpy_dtype())[0]


def test_boxes_enclose_shapes_and_cells_hold_boxes():
    """Random points on or in a shape lie in its box; every object stands in all cells that its box meets, in no other."""
    everything = [TREE, STUMP, BOULDER, LOG]
    rng = np.random.default_rng(4)
    rows, boxes, _ = shapes(everything)
    for one, box in zip(everything, boxes, strict=True):
        points = rng.uniform(box["low"] - 1.0, box["high"] + 1.0, (4000, 3))
        inside = points[depths(one, points) >= 0.0]
        assert len(inside) > 5
        assert (inside >= box["low"] - 1e-5).all() and (inside <= box["high"] + 1e-5).all()
    grid = empty_grid()
    counts, order = fill_grid(boxes, grid)
    ends = np.cumsum(counts)
    for number, box in enumerate(boxes):
        low, high = ((box[side][:2] - (grid["x"], grid["y"])) * grid["inverse_cell"] for side in ("low", "high"))
        cells = {
            (row, column)
            for row in range(int(low[1]), int(high[1]) + 1)
            for column in range(int(low[0]), int(high[0]) + 1)
        }
        at = np.searchsorted(ends, np.flatnonzero(order == number), side="right")
        assert {(c // grid["columns"], c % grid["columns"]) for c in at.tolist()} == cells
    assert len(rows) == len(everything)


def test_a_wide_world_has_larger_cells():
    """Two stumps 9 km apart: no more than 4 million cells."""
    _, boxes, _ = shapes([Stump((x, x, 0.0), upright(), "pine", 0.2, 0.3) for x in (-4900.0, 4900.0)])
    grid = empty_grid()
    counts, order = fill_grid(boxes, grid)
    assert len(counts) < 4.1e6 and counts.sum() == len(order) >= 2
    assert 1.0 / grid["inverse_cell"] > 4.0
