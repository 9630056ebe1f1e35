"""Polygons drawn by pycocotools are the masks that they were made of, to the pixel."""

from typing import Any, cast

import numpy as np
import pytest
from pycocotools import mask as coco_mask
from scipy import ndimage

from aoro_gym.sensors.dataset.formats import mask_of, run_lengths
from aoro_gym.sensors.dataset.polygons import polygons

pytestmark = pytest.mark.filterwarnings(
    "ignore:__array__ implementation:DeprecationWarning"
)  # pycocotools with numpy 2


def drawn(outlines: list[list[int]], shape: tuple[int, ...]) -> np.ndarray:
    tool = cast(Any, coco_mask)
    pieces = tool.frPyObjects([[float(x) for x in outline] for outline in outlines], *shape)
    return tool.decode(tool.merge(pieces)).astype(bool)


def test_random_masks_with_holes_and_touching_corners():
    """Corners lie on the pixels' corners, where no rounding is left: not a pixel may differ."""
    rng = np.random.default_rng(0)
    for number in range(400):
        mask: Any = rng.random(rng.integers(1, 24, 2)) < rng.uniform(0.2, 0.9)
        if number % 3 == 0:
            mask = ndimage.binary_closing(mask)
        if mask.any():
            np.testing.assert_array_equal(drawn(polygons(mask), mask.shape), mask)


def test_a_hole_in_a_hole():
    mask = np.ones((9, 11), dtype=bool)
    mask[1:8, 1:10] = False
    mask[2:7, 2:9] = True
    mask[4, 4:6] = False
    mask[4, 7] = False
    found = polygons(mask)
    assert len(found) == 2
    np.testing.assert_array_equal(drawn(found, mask.shape), mask)


def test_outlines_are_as_long_as_their_edges():
    """Of a square without holes: four corners, its own."""
    mask = np.zeros((6, 7), dtype=bool)
    mask[2:5, 1:6] = True
    assert polygons(mask) == [[1, 2, 6, 2, 6, 5, 1, 5]]


def test_masks_come_back_from_their_run_lengths():
    rng = np.random.default_rng(1)
    for _ in range(20):
        mask = rng.random((5, 8)) < 0.5
        np.testing.assert_array_equal(mask_of(run_lengths(mask), 5, 8), mask)
