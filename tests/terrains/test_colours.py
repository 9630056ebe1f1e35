"""Colours of the ground: a scan's own, on the ground that was read from it."""

import numpy as np
import pytest
import trimesh

from aoro_gym.terrains import load
from aoro_gym.terrains.colours import ground_colours, scan_colours

CELL = 0.5
"""Distance [m] of the scan's points."""


@pytest.fixture(scope="module")
def scan() -> trimesh.Trimesh:
    """Ground of 20 m by 20 m that rises to the east, red in its western and blue in its eastern half."""
    x, y = (axis.ravel() for axis in np.meshgrid(np.arange(0.0, 20.1, CELL), np.arange(0.0, 20.1, CELL), indexing="ij"))
    count = round(len(x) ** 0.5)
    corner = (np.arange(count - 1)[:, None] * count + np.arange(count - 1)).ravel()
    faces = np.concatenate(
        [
            np.stack([corner, corner + count, corner + 1], 1),
            np.stack([corner + 1, corner + count, corner + count + 1], 1),
        ]
    )
    colours = np.where((x < 10.0)[:, None], [200, 20, 20, 255], [20, 20, 200, 255]).astype(np.uint8)
    return trimesh.Trimesh(np.stack([x, y, 0.1 * x], axis=1), faces, vertex_colors=colours, process=False)


@pytest.mark.parametrize("suffix", ["ply", "glb"])
def test_ground_has_the_colours_of_its_scan(scan, suffix, tmp_path):
    file = tmp_path / f"scan.{suffix}"
    scan.export(file)
    terrain, _ = load(file)
    colours = scan_colours(file, terrain)
    assert colours is not None and colours.shape == terrain.vertices.shape
    there = np.asarray(terrain.vertices) + np.asarray(terrain.origin)
    # a vertex of the ground lies at most a cell from a point of the scan
    west, east = there[:, 0] < 10.0 - CELL, there[:, 0] > 10.0 + CELL
    assert west.sum() > 100 and east.sum() > 100
    np.testing.assert_allclose(colours[west], np.broadcast_to([200 / 255, 20 / 255, 20 / 255], colours[west].shape))
    np.testing.assert_allclose(colours[east], np.broadcast_to([20 / 255, 20 / 255, 200 / 255], colours[east].shape))


def test_a_scan_elsewhere_or_without_colours_has_none(scan, tmp_path):
    file, plain, moved = (tmp_path / f"{name}.ply" for name in ("scan", "plain", "moved"))
    scan.export(file)
    terrain, _ = load(file)
    trimesh.Trimesh(scan.vertices, scan.faces, process=False).export(plain)
    assert scan_colours(plain, terrain) is None
    scan.copy().apply_translation([500.0, 0.0, 0.0]).export(moved)
    assert scan_colours(moved, terrain) is None
    assert scan_colours(tmp_path / "cloud.laz", terrain) is None


def test_other_ground_is_coloured_by_height_and_grip(scan, tmp_path):
    file = tmp_path / "plain.ply"
    trimesh.Trimesh(scan.vertices, scan.faces, process=False).export(file)
    terrain, _ = load(file)
    colours = ground_colours(terrain)
    low, high = (colours[index(terrain.vertices[:, 2])] for index in (np.argmin, np.argmax))
    assert not np.allclose(low, high) and colours.min() >= 0.0 and colours.max() <= 1.0
