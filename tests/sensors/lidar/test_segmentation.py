"""Ground and trunks of clouds whose parts are known, and of a made forest."""

import numpy as np
import pytest

from aoro_gym.sensors.lidar.segmentation import Label, SegmentationSettings, height_over_ground, segment
from studies.lidar_segmentation import mean, score, scores, seen_points, surface_error


def floor(slope: float, *, size: float = 8.0, spacing: float = 0.1) -> np.ndarray:
    x, y = (grid.ravel() for grid in np.meshgrid(*2 * [np.arange(-size, size, spacing)]))
    return np.column_stack([x, y, slope * x])


def stem(x: float, y: float, z: float, radius: float, top: float, lean: float = 0.0) -> np.ndarray:
    height, turn = (grid.ravel() for grid in np.meshgrid(np.arange(0.2, top, 0.05), np.arange(0.0, 6.2, 0.6)))
    return np.column_stack([x + radius * np.cos(turn) + lean * height, y + radius * np.sin(turn), z + height])


def crown(x: float, y: float, z: float, count: int = 3000) -> np.ndarray:
    """Points in a bush 2.5 m wide from the ground up."""
    rng = np.random.default_rng(0)
    return np.column_stack(
        [rng.uniform([x - 1.25, y - 1.25], [x + 1.25, y + 1.25], (count, 2)), rng.uniform(0.2, 4.5, count) + z]
    )


@pytest.mark.parametrize("slope", [0.0, 0.35])
def test_ground_trunk_and_bush_are_told_apart(slope):
    parts = {
        Label.GROUND: floor(slope),
        Label.TRUNK: np.concatenate(
            [stem(3.0, 2.0, 3.0 * slope, 0.12, 5.0), stem(-4.0, 0.0, -4.0 * slope, 0.2, 4.5, 0.05)]
        ),
        Label.OTHER: crown(-3.0, -5.0, -3.0 * slope),
    }
    found = segment(np.concatenate(list(parts.values())))
    ends = np.cumsum([0, *map(len, parts.values())])
    for label, begin, end in zip(parts, ends, ends[1:], strict=False):
        assert (found[begin:end] == label).mean() > 0.95, label


def test_heights_are_over_the_ground_below_a_roof():
    """A table 3 m wide and 1 m over a slope hides nothing but itself: the slope is its surface."""
    ground = floor(0.2)
    table = ground[(np.abs(ground[:, :2]) < 1.5).all(axis=1)] + [0.0, 0.0, 1.0]
    open_ground = ground[~(np.abs(ground[:, :2]) < 1.5).all(axis=1)]
    above = height_over_ground(np.concatenate([open_ground, table]))
    # beyond the last of the cells' lowest points, by a cell of 0.5 m at most, the surface goes on level
    assert np.abs(above[: len(open_ground)]).max() < 0.2 * 0.5
    np.testing.assert_allclose(above[len(open_ground) :], 1.0, atol=1e-6)


def test_a_cloud_that_was_moved_is_told_alike():
    cloud = np.concatenate([floor(0.1), stem(2.0, 1.0, 0.2, 0.15, 5.0)])
    np.testing.assert_array_equal(segment(cloud), segment(cloud + np.array([400.0, -200.0, 30.0])))


def test_scores_are_those_of_their_definitions():
    found, truth = np.array([1, 1, 1, 0, 0], dtype=bool), np.array([1, 1, 0, 1, 0], dtype=bool)
    assert score(found, truth) == {"precision": 2 / 3, "recall": 2 / 3, "iou": 2 / 4}
    row = {"ground": score(found, truth), "trunk": score(truth, truth)}
    assert mean([row, {"ground": score(truth, truth), "trunk": score(truth, truth)}])["ground"]["iou"] == 0.75
    points = floor(0.1, spacing=0.5)
    error = surface_error(points, np.full(len(points), 0.4), np.ones(len(points), dtype=bool))
    assert error["rms_m"] == pytest.approx(0.4) and error["share_beyond_0.3_m"] == 1.0


def test_a_made_forest_is_told():
    """One of the seeds that the settings were chosen on; both ways far above what guessing gives."""
    found = scores(*seen_points(100, "pine", turns=(0,)))
    assert found["ground"]["iou"] > 0.75 and found["trunk"]["iou"] > 0.6


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: segment(np.zeros((0, 3))), r"points have the shape \(0, 3\), but must be \(N, 3\) with at least 10"),
        (lambda: segment(np.full((20, 3), np.nan)), "points.*must be finite"),
        (lambda: segment(np.random.default_rng(0).uniform(0, 1e4, (50, 3))), "number of cells below .*leave out far"),
        (lambda: SegmentationSettings(cell=0.0), "cell is 0"),
        (lambda: SegmentationSettings(filled=1.5), "filled is 1.5"),
    ],
)
def test_what_cannot_be_is_said(make, message):
    with pytest.raises(ValueError, match=message):
        make()
