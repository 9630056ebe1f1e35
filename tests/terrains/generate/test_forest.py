"""Generated ground: what its settings promise, found again in its triangles."""

import doctest
from dataclasses import fields, replace

import numpy as np
import pytest

import aoro_gym.terrains.generate.forest as module
from aoro_gym.terrains.generate.forest import (
    COVERS,
    CROWN,
    PUBLISHED_SIZE,
    TIGHTEST_BEND,
    TIGHTEST_TRAIL,
    Forest,
    ForestSettings,
    Zone,
    forest,
)
from aoro_gym.terrains.paths.path import Path
from aoro_gym.terrains.paths.planning import drivable_path

BARE = ForestSettings(relief=0.0, roughness=0.0, tilt_deg=0.0, hummocks=0.0, boulders=0.0, stumps=0.0, trees=0.0)


@pytest.fixture(scope="module")
def ground() -> Forest:
    return forest(3)


def way(path: Path | None) -> Path:
    assert path is not None
    return path


def height_near(ground: Forest, xy: np.ndarray) -> np.ndarray:
    """Height at the vertices nearest to (K, 2) places."""
    step = ground.settings.cell
    columns = round(ground.settings.size[0] / step) + 1
    low = ground.terrain.vertices[0, :2]
    column, row = np.rint((xy - low) / step).astype(int).T
    return ground.terrain.vertices[row * columns + column, 2]


def test_published_size():
    ground = forest(1, PUBLISHED_SIZE)
    assert len(ground.terrain.faces) == pytest.approx(25_633, rel=0.01)
    low, high = ground.terrain.extent
    assert tuple((high - low)[:2]) == pytest.approx((57.0, 103.0), abs=0.679)
    assert drivable_path(ground.terrain, 0, obstacles=ground.circles("tree")).length == pytest.approx(60.0, rel=1e-3)


def test_lies_around_the_origin(ground):
    low, high = ground.terrain.extent
    np.testing.assert_allclose((low + high)[:2], 0.0, atol=1e-9)
    assert 1.0 < (high - low)[2] < 15.0
    assert len(ground.zones) == len(ground.terrain.vertices)


def test_same_seed_same_ground(ground):
    again = forest(3)
    np.testing.assert_array_equal(again.terrain.vertices, ground.terrain.vertices)
    assert again.obstacles == ground.obstacles
    other = forest(4)
    assert np.abs(other.terrain.vertices[:, 2] - ground.terrain.vertices[:, 2]).max() > 1.0


def test_cell_only_samples(ground):
    coarse = forest(3, cell=0.5)
    assert coarse.obstacles == ground.obstacles
    # upright sides of stumps stand over a cell: away from them the grids share every other node
    fine = ground.terrain.vertices[:, 2].reshape(413, 229)[::2, ::2].ravel()
    apart = np.abs(coarse.terrain.vertices[:, 2] - fine)
    assert np.mean(apart < 1e-9) > 0.97
    assert apart.max() < 0.5


def test_one_part_leaves_the_others(ground):
    without = forest(3, boulders=0.0)
    trees = {o for o in ground.obstacles if o.kind == "tree"}
    assert len(trees & set(without.obstacles)) > 0.9 * len(trees)  # those behind boulders were left out
    assert not without.circles("boulder").size


def test_covers_lie_on_their_zones(ground):
    for zone, cover in COVERS.items():
        here = ground.zones == zone
        assert here.any()
        assert set(ground.terrain.friction[here]) == {cover.friction}
        assert set(ground.terrain.rolling_resistance[here]) == {cover.rolling_resistance}
    assert COVERS[Zone.ASPHALT] == (1.0, 1.0)


def test_road_is_asphalt_with_a_crown_and_a_gentle_grade(ground):
    assert np.abs(way(ground.road).curvatures[2:-2]).max() < 1.2 / TIGHTEST_BEND
    s = np.linspace(2.0, way(ground.road).length - 2.0, 200)
    middle, heading = way(ground.road).position(s), way(ground.road).heading(s)
    left = np.stack([-np.sin(heading), np.cos(heading)], axis=1)
    step = ground.settings.cell
    z = height_near(ground, middle)
    for side in (-1.7, 1.7):
        fall = z - height_near(ground, middle + side * left)
        assert np.median(fall) == pytest.approx(CROWN * 1.7, abs=CROWN * step)
    assert np.abs(np.diff(z)).max() / (s[1] - s[0]) < 0.3
    nodes = ground.terrain.vertices[:, :2]
    on_road = np.abs(way(ground.road).project(nodes[::7])[1]) < 1.5
    assert np.mean(ground.zones[::7][on_road] == Zone.ASPHALT) > 0.95  # the rest lies beyond its ends


def test_ditches_are_as_deep_as_asked():
    ground = forest(5, BARE, size=(40.0, 50.0), trail=False, meadow=False, ditch_depth=0.6)
    nodes = ground.terrain.vertices
    s, offset = way(ground.road).project(nodes[:, :2])
    inside = (s > 1.0) & (s < way(ground.road).length - 1.0)
    half = ground.settings.road_width / 2
    edge = -CROWN * half - 0.05 * 0.75
    for side in (1.0, -1.0):
        deepest = nodes[inside & (offset * side > half) & (offset * side < half + 6.0), 2].min()
        assert deepest == pytest.approx(edge - 0.6, abs=0.06)  # rounded at its bottom
    far = inside & (np.abs(offset) > 12.0)
    np.testing.assert_allclose(nodes[far, 2], 0.0, atol=0.02)


def test_trail_can_be_driven():
    for seed in range(4):
        ground = forest(seed, cell=1.0)
        assert np.abs(way(ground.trail).curvatures).max() < 1.0 / TIGHTEST_TRAIL
        ends = way(ground.road).project(way(ground.trail).points[[0, -1]])[1]
        assert np.abs(ends).max() < 2.0
        circles = ground.circles()
        clear = np.linalg.norm(way(ground.trail).points[:, None] - circles[:, :2], axis=2) - circles[:, 2]
        assert clear.min() > 1.7


def test_ruts_lie_a_track_apart():
    bare = replace(BARE, road_width=0.0, meadow=False, wet_share=0.0, rut_depth=0.1, cell=0.12, size=(30.0, 40.0))
    ground = forest(2, bare)
    z = ground.terrain.vertices[:, 2]
    offset = way(ground.trail).project(ground.terrain.vertices[::3, :2])[1]
    assert z.min() == pytest.approx(-0.1, abs=0.005)
    deep = np.abs(offset[z[::3] < -0.095])
    assert deep.mean() == pytest.approx(1.97 / 2, abs=0.03)


def test_obstacles_stand_on_the_ground(ground):
    kinds = {kind: ground.circles(kind) for kind in ("boulder", "stump", "tree")}
    assert all(len(circles) > 15 for circles in kinds.values())
    assert len(ground.circles()) == sum(len(circles) for circles in kinds.values())
    without = forest(3, boulders=0.0, stumps=0.0)
    stand = [o for o in ground.obstacles if o.kind == "boulder"]
    places = np.array([(o.x, o.y) for o in stand])
    rise = height_near(ground, places) - height_near(without, places)
    # a node lies up to 0.18 m from the middle of a boulder of at least 0.4 m
    np.testing.assert_allclose(rise, [o.height for o in stand], rtol=0.1)
    road = np.abs(way(ground.road).project(ground.circles()[:, :2])[1])
    assert road.min() > ground.settings.road_width / 2 + 1.0


def test_wet_ground_lies_low():
    ground = forest(6, road_width=0.0, trail=False, meadow=False, wet_share=0.1)
    wet = ground.zones == Zone.WET
    assert wet.mean() == pytest.approx(0.1, abs=0.001)
    z = ground.terrain.vertices[:, 2]
    assert z[wet].mean() < z.mean() - 1.0


def test_every_setting_counts():
    usual = forest(8, cell=1.0)
    other = {
        "size": (60.0, 90.0), "cell": 0.8, "tilt_deg": 5.0, "relief": 0.5, "roughness": 0.05, "road_width": 3.0,
        "ditch_depth": 0.2, "trail": False, "rut_depth": 0.2, "meadow": False, "wet_share": 0.2, "hummocks": 100.0,
        "boulders": 0.0, "stumps": 0.0, "trees": 0.0,
    }  # fmt: skip
    assert set(other) == {field.name for field in fields(ForestSettings)}
    for name, value in other.items():
        changed = forest(8, replace(usual.settings, **{name: value}))
        same_ground = np.array_equal(changed.terrain.vertices, usual.terrain.vertices)
        same_cover = np.array_equal(changed.zones, usual.zones)
        assert not (same_ground and same_cover and changed.obstacles == usual.obstacles), name


def test_wide_ground():
    ground = forest(0, size=(90.0, 50.0), cell=0.5)
    low, high = ground.terrain.extent
    assert tuple((high - low)[:2]) == (90.0, 50.0)
    assert np.ptp(way(ground.road).points[:, 0]) > 85.0  # the road runs along the longer side


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"cell": 0.0}, r"^cell is 0, but must be in \[0.05, 2\]"),
        ({"wet_share": np.nan}, "^wet_share is nan"),
        ({"boulders": -1.0}, "^boulders is -1"),
        ({"size": (10.0, 50.0)}, r"^size\[0\] is 10 m, but must be in \[30, 500\] m"),
        ({"lakes": 3}, "forest has no lakes; choose one of: size, cell"),
    ],
)
def test_refuses(wrong, message):
    with pytest.raises(ValueError, match=message):
        forest(0, **wrong)


def test_example():
    tried = doctest.testmod(module)
    assert tried.attempted > 0
    assert tried.failed == 0
