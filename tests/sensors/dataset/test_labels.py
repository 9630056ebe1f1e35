"""Labels beside what they stand for: masks and rays, boxes and projected triangles, run lengths and pycocotools'."""

from typing import Any, cast

import numpy as np
import pytest
from PIL import Image, ImageDraw
from pycocotools import mask as coco_mask

from aoro_gym.sensors.camera import MODELS, Appearance, CameraModel, Intrinsics, Picture, StereoCamera, daylight
from aoro_gym.sensors.dataset import CATEGORIES, Label, Shapes, labels
from aoro_gym.sensors.dataset.formats import described, kitti_line, run_lengths
from aoro_gym.sensors.dataset.labels import _drawn, categories
from aoro_gym.sensors.dataset.taking import pose_of
from aoro_gym.sensors.lidar import Motion, Mounting
from aoro_gym.sensors.raytrace import Scene
from aoro_gym.terrains.generate.world import world
from aoro_gym.terrains.world.objects import Boulder, Stump, upright
from aoro_gym.terrains.world.world import World
from tests.sensors.dataset.scenes import FLAT, LENS, lying

pytestmark = pytest.mark.filterwarnings(
    "ignore:__array__ implementation:DeprecationWarning"
)  # pycocotools with numpy 2


def seen(
    made: World, at: tuple[float, float], *, yaw: float = 0.0, pitch: float = 10.0
) -> tuple[Picture, Any, list[Label]]:
    model = CameraModel("small", LENS)
    camera = StereoCamera(
        Scene.of_world(made, fine=True),
        Appearance.of_world(made),
        daylight(),
        model,
        samples=1,
        sky_rays=1,
        mounting=Mounting(position=(0.0, 0.0, 2.0), angles_deg=(0.0, pitch, 0.0)),
    )
    motion = Motion.still([*at, 0.0], yaw=yaw)
    truth = {name: part[0] for name, part in camera.truth(motion).items()}
    rgb = np.zeros((*truth["depth"].shape, 3), dtype=np.uint8)
    picture = Picture(rgb=rgb, numbers=rgb.astype(np.uint16), exposure=0.0, time=0.0, **truth)
    pose = pose_of(camera, motion)
    return picture, pose, labels(picture, Shapes(made), LENS, pose)


@pytest.mark.parametrize("seed", range(8))
def test_run_lengths_are_pycocotools(seed):
    mask = np.random.default_rng(seed).random((7, 11)) < 0.4 if seed else np.ones((7, 11), dtype=bool)
    told: Any = {"size": [7, 11], "counts": run_lengths(mask)}
    encoded: Any = cast(Any, coco_mask).frPyObjects(told, 7, 11)
    np.testing.assert_array_equal(coco_mask.decode(encoded).astype(bool), mask)


def test_silhouettes_are_those_of_each_triangle():
    """Triangles left out because they are drawn already, or lie beyond an edge, change nothing."""
    rng, lens = np.random.default_rng(2), Intrinsics.of_view(40, 30, 75.0)
    middles = rng.uniform([-20.0, -20.0], [60.0, 50.0], (400, 1, 2))
    pixels = (middles + rng.normal(0.0, rng.choice([0.3, 3.0, 30.0], (400, 1, 1)), (400, 3, 2))).reshape(-1, 2)
    image = Image.new("1", (lens.width, lens.height))
    for triangle in pixels.reshape(-1, 3, 2)[::4] - 0.5:
        ImageDraw.Draw(image).polygon([(float(x), float(y)) for x, y in triangle], fill=1)
    faces = np.arange(len(pixels)).reshape(-1, 3)[::4]
    found = _drawn(pixels, np.concatenate([faces, faces]), lens)
    np.testing.assert_array_equal(found, np.array(image))
    assert 100 < found.sum() < found.size - 100


@pytest.mark.parametrize("name", sorted(MODELS))
def test_what_is_unprojected_is_drawn_at_its_pixel(name):
    lens = MODELS[name].intrinsics
    axes = np.linspace(0, lens.width - 1, 21), np.linspace(0, lens.height - 1, 17)
    pixels = np.stack(np.meshgrid(*axes), axis=-1).reshape(-1, 2)
    np.testing.assert_allclose(lens.project(lens.unproject(pixels)), pixels, atol=1e-6)


@pytest.fixture(scope="module")
def forest() -> tuple[World, Picture, Any, list[Label]]:
    made = world(5, size=(40.0, 40.0))
    return made, *seen(made, (0.0, 0.0), yaw=0.4)


def test_masks_are_the_visible_pixels_of_their_objects(forest):
    made, picture, pose, found = forest
    category = categories(picture, Shapes(made), LENS, pose)
    taken = np.zeros(picture.instance.shape, dtype=int)
    for label in found:
        taken += label.mask
        np.testing.assert_array_equal(
            label.mask, (picture.instance == label.instance) & (category == CATEGORIES.index(label.category))
        )
        rows, columns = np.nonzero(label.mask)
        assert label.box == (columns.min(), rows.min(), columns.max() + 1, rows.max() + 1)
    assert taken.max() == 1 and {label.category for label in found} >= {"trunk", "crown"}
    # every object that 60 pixels show has a label, but branches on the ground
    shown = {n for n in np.unique(picture.instance) if n > 0 and (category[picture.instance == n] >= 0).sum() >= 60}
    assert shown <= {label.instance for label in found}


def test_full_boxes_hold_the_visible_ones(forest):
    for label in forest[3]:
        x0, y0, x1, y1 = label.box
        u0, v0, u1, v1 = label.full_box
        assert u0 <= x0 and v0 <= y0 and u1 >= x1 and v1 >= y1
        assert 0.0 <= label.truncation < 1.0 and 0.0 <= label.occlusion < 1.0
        if label.truncation == 0.0:
            assert u0 >= 0.0 and v0 >= 0.0 and u1 <= LENS.width and v1 <= LENS.height


def test_what_stands_free_is_whole_and_its_box_in_space_is_drawn_around_it():
    """Occlusion is what the border of the silhouette leaves: a perimeter over an area, 2 (w + h) / (w h) of half a pixel."""
    _, pose, found = seen(lying(), (0.0, 0.0))
    by_kind = {label.category: label for label in found}
    assert set(by_kind) >= {"stump", "boulder", "log"}
    for name in ("stump", "boulder", "log"):
        label = by_kind[name]
        x0, y0, x1, y1 = label.box
        if name != "log":  # whose silhouette is thin
            assert label.occlusion < (x1 - x0 + y1 - y0) / ((x1 - x0) * (y1 - y0)) + 0.05
        assert label.truncation == 0.0
        length, width, height = label.size
        up = pose[:3, :3].T @ [0.0, 0.0, 1.0]
        heading = np.array([np.cos(label.turn), 0.0, -np.sin(label.turn)])
        level = heading - up * (heading @ up)
        level /= np.linalg.norm(level)
        aside = np.cross(up, level)
        corners = [
            np.array(label.location) + a * length * level + b * width * aside + c * height * up
            for a in (-0.5, 0.5)
            for b in (-0.5, 0.5)
            for c in (0.0, 1.0)
        ]
        drawn = LENS.project(np.array(corners)) + 0.5
        assert (drawn.min(axis=0) <= np.array([x0, y0]) + 1.5).all()
        assert (drawn.max(axis=0) >= np.array([x1, y1]) - 1.5).all()
    assert by_kind["log"].size[0] == pytest.approx(4.0, abs=0.05)


def kitti_corners(line: str) -> tuple[np.ndarray, np.ndarray]:
    """Corners (8, 3) [m] of the 3-D box of a line of label_2, in the camera's axes, as the benchmark's own tools make them;
    and the box in the picture (4,)."""
    words = line.split()
    height, width, length, *place, turn = map(float, words[8:15])
    x = 0.5 * length * np.array([1, 1, -1, -1, 1, 1, -1, -1])
    y = -height * np.array([0, 0, 0, 0, 1, 1, 1, 1])
    z = 0.5 * width * np.array([1, -1, -1, 1, 1, -1, -1, 1])
    c, s = np.cos(turn), np.sin(turn)
    return np.column_stack([c * x + s * z, y, -s * x + c * z]) + place, np.array(words[4:8], dtype=float)


def test_kittis_boxes_in_space_project_around_the_full_ones(forest):
    """Every side of a box touches what it is around, so that the full box of the picture ends between the box's edge and
    that of the side which reaches least far: up to half a pixel, as masks are whole pixels, and to the file's two digits.
    Masks of trees hold fine twigs that their triangles lack."""
    sides = [(0, 1, 2, 3), (4, 5, 6, 7), (0, 1, 4, 5), (2, 3, 6, 7), (0, 3, 4, 7), (1, 2, 5, 6)]
    compared = 0
    for label in [*forest[3], *seen(lying(), (0.0, 0.0))[2], *seen(lying(), (0.0, 3.0), yaw=-0.3, pitch=15.0)[2]]:
        corners, box = kitti_corners(kitti_line(described(label)))
        np.testing.assert_allclose(box, label.box, atol=0.01)
        if corners[:, 2].min() < 1.0 or label.category in ("trunk", "crown"):
            continue
        compared += 1
        pixels = LENS.project(corners) + 0.5
        reach = np.abs(corners[:, :2]).max() / corners[:, 2].min()
        off = 0.02 * LENS.focal[0] * (1.0 + reach) / corners[:, 2].min() + 0.5
        for axis in (0, 1):
            edges = np.array([pixels[list(side), axis] for side in sides])
            low, high = label.full_box[axis], label.full_box[axis + 2]
            assert pixels[:, axis].min() - off <= low <= edges.max(axis=1).min() + off
            assert edges.min(axis=1).max() - off <= high <= pixels[:, axis].max() + off
    assert compared > 4


def test_what_another_hides_is_hidden():
    """A boulder before a stump: less of it is seen than alone, and its occlusion says so."""
    alone = World(FLAT, (Stump((8.0, 0.0, 0.0), upright(), "pine", 0.4, 0.8),))
    hidden = World(FLAT, (*alone.objects, Boulder((6.0, 0.35, 0.4), upright(), (0.5, 0.5, 0.5), 0.9, 3)))
    whole, part = ({one.instance: one for one in seen(made, (0.0, 0.0))[2]}[1] for made in (alone, hidden))
    share = part.mask.sum() / whole.mask.sum()
    assert 0.2 < share < 0.9
    assert part.occlusion == pytest.approx(1.0 - share * (1.0 - whole.occlusion), abs=0.02)
    np.testing.assert_allclose(part.full_box, whole.full_box, atol=1.0)
