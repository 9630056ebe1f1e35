"""Terrains: what they hold, heights into triangles, and errors that name the fix."""

import re

import numpy as np
import pytest

from aoro_gym.terrains.terrain import LARGEST_COORDINATE, Terrain

CORNERS = np.array([[0.0, 0.0, 0.0], [2.0, 0.0, 1.0], [0.0, 2.0, 2.0]])
FACE = np.array([[0, 1, 2]])


def area(terrain: Terrain) -> np.ndarray:
    """Twice the signed plan area of every triangle, positive counter-clockwise."""
    a, b, c = (terrain.vertices[terrain.faces[:, i], :2] for i in range(3))
    return (b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]


def test_heights_become_two_triangles_a_cell():
    """All face up, together they cover the plan, and every height is where it was given."""
    rng = np.random.default_rng(0)
    heights = rng.uniform(-1.0, 1.0, (4, 6))
    terrain = Terrain.from_heights(heights, cell=0.5, corner=(10.0, -20.0), name="field", crs="EPSG:3006")
    assert len(terrain.faces) == 2 * 3 * 5
    assert np.all(area(terrain) > 0.0)
    assert area(terrain).sum() / 2.0 == pytest.approx(1.5 * 2.5)
    column = np.round((terrain.vertices[:, 0] - 10.0) / 0.5).astype(int)
    row = np.round((terrain.vertices[:, 1] + 20.0) / 0.5).astype(int)
    np.testing.assert_array_equal(terrain.vertices[:, 2], heights[row, column])
    low, high = terrain.extent
    np.testing.assert_allclose(low, [10.0, -20.0, heights.min()])
    np.testing.assert_allclose(high, [12.5, -18.5, heights.max()])
    assert (terrain.name, terrain.crs) == ("field", "EPSG:3006")


def test_unknown_heights_stay_open_and_multipliers_follow_their_vertices():
    heights = np.zeros((4, 4))
    heights[1, 1] = np.nan
    friction = np.linspace(0.1, 1.6, 16).reshape(4, 4)
    terrain = Terrain.from_heights(heights, cell=1.0, friction=friction, rolling_resistance=3.0)
    assert area(terrain).sum() / 2.0 == pytest.approx(9.0 - 4.0)
    assert len(terrain.vertices) == 12  # the south-western corner hangs on the unknown height alone
    x, y = terrain.vertices[:, :2].astype(int).T
    np.testing.assert_array_equal(terrain.friction, friction[y, x])
    assert terrain.rolling_resistance == 3.0


def test_a_terrain_is_shown_in_a_line():
    terrain = Terrain.from_heights(np.zeros((3, 5)), cell=0.5, name="yard")
    assert repr(terrain) == "Terrain('yard', 16 triangles, 2 m x 1 m)"


def test_a_terrain_is_read_only():
    terrain = Terrain(vertices=CORNERS, faces=FACE, friction=np.ones(3))
    for array in (terrain.vertices, terrain.faces, terrain.friction):
        with pytest.raises(ValueError, match="read-only"):
            np.asarray(array)[0] = 0


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"vertices": CORNERS[:2]}, "terrain vertices have the shape (2, 3); give (V, 3) with at least 3 points"),
        ({"vertices": CORNERS * (1.0, np.nan, 1.0)}, "terrain vertex 0 is [0.0, nan, 0.0], but must be finite"),
        ({"faces": FACE[:0]}, "terrain faces have the shape (0, 3); give (F, 3) with at least one triangle"),
        ({"faces": FACE + 1}, "terrain faces reach vertex 3, but there are 3"),
        ({"vertices": CORNERS * 4e3}, "a terrain vertex lies 8000 m from the local origin"),
        ({"friction": 0.0}, "terrain friction is 0, but must be in [0.01, 2] x asphalt"),
        ({"friction": np.ones(2)}, "terrain friction has the shape (2,); give one number or (3,), one a vertex"),
        (
            {"rolling_resistance": [1.0, 99.0, 1.0]},
            "terrain rolling_resistance[1] is 99, but must be in [0, 50] x asphalt",
        ),
    ],
)
def test_errors_name_the_fix(change, message):
    with pytest.raises(ValueError, match=re.escape(message)):
        Terrain(**({"vertices": CORNERS, "faces": FACE} | change))


@pytest.mark.parametrize(
    ("heights", "cell", "message"),
    [
        (np.zeros(3), 1.0, "terrain heights have the shape (3,); give at least 2 rows and 2 columns"),
        (np.zeros((2, 2)), 0.0, "terrain cell is 0 m, but must be above 0"),
        (np.full((3, 3), np.nan), 1.0, "terrain heights have no cell with four finite corners"),
    ],
)
def test_errors_of_heights_name_the_fix(heights, cell, message):
    with pytest.raises(ValueError, match=re.escape(message)):
        Terrain.from_heights(heights, cell=cell)


def test_float32_keeps_a_millimetre_at_the_largest_coordinate():
    assert np.spacing(np.float32(LARGEST_COORDINATE)) < 1e-3
