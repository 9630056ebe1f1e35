"""Made worlds: numbers asked for, room kept, ground met, the same by seed to the bit; scans are worlds, too."""

import doctest
from dataclasses import fields, replace

import numpy as np
import pytest

import aoro_gym.terrains.generate.world as module
from aoro_gym.terrains import Terrain
from aoro_gym.terrains.generate.forest import Zone, forest
from aoro_gym.terrains.generate.placing import Site
from aoro_gym.terrains.generate.world import WorldSettings, populate, world
from aoro_gym.terrains.paths.path import Path
from aoro_gym.terrains.world.materials import Surface
from aoro_gym.terrains.world.objects import Boulder, Branch, Log, Object, Stump, Tree
from aoro_gym.terrains.world.world import World


@pytest.fixture(scope="module")
def hectare() -> World:
    return world(3)


@pytest.fixture(scope="module")
def field() -> Terrain:
    x, y = np.meshgrid(np.arange(0.0, 40.5, 0.5), np.arange(0.0, 30.5, 0.5))
    return Terrain.from_heights(0.1 * x + np.sin(0.3 * y), cell=0.5, origin=(430_000.0, 7.2e6, 12.0), crs="EPSG:32635")


def places(objects: tuple[Object, ...], *kinds: type) -> np.ndarray:
    return np.array([one.position for one in objects if isinstance(one, kinds)])


def test_a_hectare_holds_more_than_500_objects(hectare):
    assert sum(hectare.counts.values()) >= 500
    assert all(hectare.counts.values())
    scene = hectare.scene()
    assert scene.face_instance.max() == sum(hectare.counts.values())
    assert len(scene.faces) < 2_000_000
    kinds = set(scene.face_class)
    assert {Surface.ASPHALT, Surface.GRASS, Surface.WET_SOIL, Surface.END_GRAIN, Surface.PINE_NEEDLES} <= kinds


def test_ground_is_the_forests_with_ruts_on_strip_roads(hectare):
    """Where trees may grow, two ruts as deep as asked for and 1.97 m apart lead on every 20 m; the rest is as it was."""
    bare = forest(3, size=(100.0, 100.0), boulders=0.0, stumps=0.0, trees=0.0)
    np.testing.assert_array_equal(hectare.terrain.vertices[:, :2], bare.terrain.vertices[:, :2])
    lower = (bare.terrain.vertices - hectare.terrain.vertices)[:, 2]
    standing = np.isin(bare.zones, [Zone.FOREST, Zone.WET])
    np.testing.assert_array_equal(lower[~standing], 0.0)
    assert lower.min() > -1e-9 and lower.max() == pytest.approx(0.06, abs=0.01)
    x = hectare.terrain.vertices[:, 0]
    profile = np.array([lower[standing & (x == column)].mean() for column in np.unique(x)])
    deep = np.unique(x)[profile > 0.5 * profile.max()]
    middles = np.array([part.mean() for part in np.split(deep, np.flatnonzero(np.diff(deep) > 0.5) + 1)])
    middles = middles[np.abs(middles) < 49.0]  # whole ruts
    apart = np.diff(middles)
    assert len(middles) == 9
    # columns are 0.25 m apart: a mean of two to three of them is off by less than one
    assert (np.minimum(np.abs(apart - 1.97), np.abs(apart - (20.0 - 1.97))) < 0.25).all()
    np.testing.assert_array_equal(world(3, rut_depth=0.0).terrain.vertices, bare.terrain.vertices)
    on_strips = np.abs(places(hectare.objects, Tree)[:, :1] - middles).min(axis=1)
    assert on_strips.min() > 0.5 * (4.2 - 1.97) - 0.25
    trees = places(hectare.objects, Tree)
    for path, room in bare.ways:
        assert np.abs(path.project(trees[:, :2])[1]).min() > room - 0.05


def test_as_many_as_asked_for(field):
    made = populate(field, 5, stems=800.0, stumps=300.0, boulders=100.0, branches=200.0, fallen=20.0, piles=0.0)
    site = Site(field, np.ones(len(field.vertices), dtype=bool), [])
    hectares = site.hectares
    assert hectares == pytest.approx(0.12, rel=0.1)
    for name, asked in {"tree": 800.0, "stump": 300.0, "boulder": 100.0, "branch": 200.0}.items():
        assert made.counts[name] == pytest.approx(asked * hectares, rel=0.05, abs=1.0)


def test_what_stands_meets_the_ground_and_keeps_apart(field):
    made = populate(field, 5, stems=1500.0)
    site = Site(field, np.ones(len(field.vertices), dtype=bool), [])
    for kind in (Tree, Stump):
        at = places(made.objects, kind)
        np.testing.assert_allclose(at[:, 2], site.height(at[:, :2]), atol=1e-9)
        exact = 0.1 * at[:, 0] + np.sin(0.3 * at[:, 1])
        np.testing.assert_allclose(at[:, 2], exact, atol=0.3**2 * 0.5**2 / 8.0 * 2.0)  # chords of the sine
    for one in made.objects:
        if isinstance(one, Boulder):
            top = one.position[2] + one.half_axes[2] - site.height(np.array([one.position[:2]]))[0]
            assert top == pytest.approx(one.above)
    trees = places(made.objects, Tree)[:, :2]
    radii = np.array([0.5 * one.diameter for one in made.objects if isinstance(one, Tree)])
    apart = np.linalg.norm(trees[:, None] - trees, axis=2) - radii[:, None] - radii + 9.0 * np.eye(len(trees))
    assert apart.min() >= 1.2


def test_strip_roads_are_free_of_what_blocks(field):
    made = populate(field, 8, stems=1500.0, strip_roads=15.0, strip_road_width=4.0, piles=20.0)
    across = places(made.objects, Tree)[:, 1]  # the field is shorter along y
    offsets = np.sort((across[:, None] - np.linspace(0.0, 15.0, 300)) % 15.0, axis=0)
    gaps = [np.diff(np.append(column, column[0] + 15.0)).max() for column in offsets.T]
    assert max(gaps) >= 4.0
    empty = populate(field, 8, stems=1500.0, strip_roads=0.0)
    across = np.sort(places(empty.objects, Tree)[:, 1] % 15.0)
    assert np.diff(np.append(across, across[0] + 15.0)).max() < 4.0


def test_by_seed_to_the_bit(field):
    one, same, other = (populate(field, seed, stems=300.0) for seed in (1, 1, 2))
    assert one.objects == same.objects
    for a, b in zip(one.scene()[:4], same.scene()[:4], strict=True):
        np.testing.assert_array_equal(a, b)
    assert one.undergrowth is not None and same.undergrowth is not None
    np.testing.assert_array_equal(one.undergrowth.density, same.undergrowth.density)
    assert one.objects != other.objects


def test_scans_keep_their_place_and_paths_clear(field):
    path = Path(np.array([[2.0, 15.0], [20.0, 15.0], [38.0, 15.0]])).resample(0.5)
    made = populate(field, 4, clear=[(path, 3.0)])
    assert made.terrain is field
    assert np.abs(path.project(places(made.objects, Tree, Stump, Boulder)[:, :2])[1]).min() > 3.0
    holes = np.zeros((61, 81))
    holes[20:50, 20:50] = np.nan
    open_ground = populate(Terrain.from_heights(holes, cell=0.5), 4)
    inside = places(open_ground.objects, Tree, Stump, Boulder, Branch)
    assert not np.all((inside[:, :2] > [9.5, 9.5]) & (inside[:, :2] < [25.0, 25.0]), axis=1).any()


def test_trees_grow_where_the_ground_lets_them(field):
    surfaces = np.where(field.vertices[:, 0] < 20.0, Surface.GRAVEL, Surface.FOREST_FLOOR).astype(np.uint8)
    made = populate(field, 4, surfaces=surfaces)
    assert places(made.objects, Tree)[:, 0].min() > 19.7
    assert set(made.scene().face_class[: len(field.faces)]) == {Surface.GRAVEL, Surface.FOREST_FLOOR}


def test_snow(field):
    made = populate(field, 4, stand="birch", snow=True)
    classes = set(made.scene().face_class)
    assert Surface.SNOW in classes and not classes & {Surface.FOREST_FLOOR, Surface.BIRCH_LEAVES}


def test_undergrowth_covers_what_was_asked_for(field):
    made = populate(field, 4, undergrowth=0.3).undergrowth
    assert made is not None
    assert np.mean(made.density > 0.0) == pytest.approx(0.3, abs=0.05)  # but for the edges
    assert not ((made.height > 0.0) ^ (made.density > 0.0)).any()
    none = populate(field, 4, undergrowth=0.0).undergrowth
    assert none is not None and not none.density.any()


def test_logs_of_a_pile_are_one_length(hectare):
    piles: dict[int, list[Log]] = {}
    for one in hectare.objects:
        if isinstance(one, Log) and one.pile:
            piles.setdefault(one.pile, []).append(one)
    assert len(piles) >= 3
    for logs in piles.values():
        assert len(logs) == WorldSettings().logs
        assert len({log.length for log in logs}) == 1
        assert all(log.top_radius <= log.radius for log in logs)


def test_every_setting_counts():
    field = Terrain.from_heights(np.zeros((41, 41)), cell=0.5)
    usual = populate(field, 6, WorldSettings(piles=40.0, fallen=200.0))
    other = {
        "stand": "pine", "stems": 500.0, "mean_diameter": 0.2, "stumps": 100.0, "boulders": 0.0, "fallen": 0.0,
        "piles": 0.0, "logs": 3, "branches": 50.0, "strip_roads": 0.0, "strip_road_width": 5.0, "undergrowth": 0.2,
        "snow": True,
    }  # fmt: skip
    assert {*other, "size", "rut_depth"} == {one.name for one in fields(WorldSettings)}
    for name, value in other.items():
        changed = populate(field, 6, replace(WorldSettings(piles=40.0, fallen=200.0), **{name: value}))
        assert usual.undergrowth is not None and changed.undergrowth is not None
        same_plants = np.array_equal(usual.undergrowth.density, changed.undergrowth.density)
        assert changed.objects != usual.objects or not same_plants or changed.leaves != usual.leaves, name


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"stems": -1.0}, r"stems is -1, but must be in \[0, 4000\]"),
        ({"mean_diameter": np.nan}, "mean_diameter is nan"),
        ({"stand": "palms"}, "stand is 'palms'; choose one of: pine, spruce"),
        ({"lakes": 3}, "world has no lakes; choose one of: size, stand"),
    ],
)
def test_refuses(field, wrong, message):
    with pytest.raises(ValueError, match=message):
        populate(field, 0, **wrong)


def test_too_many_objects_are_refused_before_any_is_made():
    wide = Terrain.from_heights(np.zeros((41, 41)), cell=100.0)
    with pytest.raises(ValueError, match=r"the world asked for holds [\d,]+ objects, but a world at most 200,000"):
        populate(wide, 0, branches=10_000.0)


def test_example():
    tried = doctest.testmod(module)
    assert (tried.attempted > 0, tried.failed) == (True, 0)
