"""A world and its scene: instances, classes, bounds."""

import numpy as np
import pytest

from aoro_gym.terrains import Terrain
from aoro_gym.terrains.world import world as module
from aoro_gym.terrains.world.materials import Surface
from aoro_gym.terrains.world.meshes import mesh
from aoro_gym.terrains.world.objects import Boulder, Kind, Stump, Tree, upright
from aoro_gym.terrains.world.species import SPECIES
from aoro_gym.terrains.world.world import Undergrowth, World

STUMP = Stump((1.0, 1.0, 0.0), upright(), "pine", 0.15, 0.3)
BOULDER = Boulder((3.0, 2.0, 0.0), upright(), (1.5, 1.4, 1.3), 1.0, 4)
TREE = Tree((2.0, 2.0, 0.0), upright(), "birch", 0.2, 15.0, 8.0, 1.7, 3)


@pytest.fixture
def ground() -> Terrain:
    x, y = np.meshgrid(np.arange(6.0), np.arange(5.0))
    return Terrain.from_heights(np.where(x > 4.0, 3.0, 0.1 * y), cell=1.0)


def test_scene(ground):
    made = World(ground, (STUMP, BOULDER, TREE), np.full(len(ground.faces), Surface.GRASS))
    scene = made.scene()
    assert (scene.vertices.dtype, scene.faces.dtype) == (np.float32, np.int32)
    assert (scene.face_instance.dtype, scene.face_class.dtype) == (np.int32, np.uint8)
    assert len(scene.faces) == len(scene.face_instance) == len(scene.face_class)
    assert scene.faces.min() == 0 and scene.faces.max() == len(scene.vertices) - 1
    assert list(scene.instance_kind) == [Kind.GROUND, Kind.STUMP, Kind.BOULDER, Kind.TREE]
    np.testing.assert_array_equal(scene.faces[scene.face_instance == 0], ground.faces)
    assert set(scene.face_class[scene.face_instance == 0]) == {Surface.GRASS}
    for number, one in enumerate(made.objects, start=1):
        own = mesh(one)
        faces = scene.faces[scene.face_instance == number]
        np.testing.assert_array_equal(scene.vertices[faces], own.vertices[own.faces].astype(np.float32))
        np.testing.assert_array_equal(scene.face_class[scene.face_instance == number], own.surfaces)
    assert scene.face_class.max() < len(scene.materials.roughness)


def test_bare_ground_is_a_scene(ground):
    scene = World(ground).scene()
    assert set(scene.face_class) == {Surface.FOREST_FLOOR}
    assert set(scene.face_instance) == {0}


def test_figures(ground):
    made = World(ground, (STUMP, BOULDER, TREE))
    assert made.counts == {"tree": 1, "stump": 1, "boulder": 1, "log": 0, "branch": 0}
    assert made.area == pytest.approx(20.0)
    assert made.stem_volume == pytest.approx(float(SPECIES["birch"].stem_volume(0.2, 15.0)))
    assert list(made.drivable()) == [True, False, False]
    steep = ~made.drivable_ground()  # the step between x = 4 and 5
    middles = ground.vertices[ground.faces].mean(axis=1)
    np.testing.assert_array_equal(steep, middles[:, 0] > 4.0)


def test_a_bare_birch(ground):
    assert Surface.BIRCH_LEAVES not in World(ground, (TREE,), leaves=False).scene().face_class


def test_refuses(ground, monkeypatch):
    with pytest.raises(ValueError, match=r"world ground has the shape \(3,\), but must have \(40,\)"):
        World(ground, ground=np.zeros(3, dtype=np.uint8))
    with pytest.raises(ValueError, match="world ground holds 200, but the last surface is 18"):
        World(ground, ground=np.full(40, 200))
    with pytest.raises(ValueError, match="undergrowth height has the shape"):
        Undergrowth((0.0, 0.0), 1.0, np.full((1, 1), np.nan, np.float32), np.ones((1, 1), np.float32))
    with pytest.raises(ValueError, match="the shapes must be equal"):
        Undergrowth((0.0, 0.0), 1.0, np.zeros((2, 2), np.float32), np.zeros((2, 3), np.float32))
    monkeypatch.setattr(module, "MOST_OBJECTS", 2)
    with pytest.raises(ValueError, match="world holds 3 objects, but a world at most 2; take a part of the ground"):
        World(ground, (STUMP, BOULDER, TREE))


def test_ten_million_objects_are_refused():
    with pytest.raises(ValueError, match="10,000,000 objects, but a world at most 200,000"):
        module.check_count(10_000_000, "world.json")
