"""Shapes enclose the triangles of what they stand for, and are no larger than they must."""

import numpy as np
import pytest

from aoro_gym.terrains import Terrain
from aoro_gym.terrains.generate.world import populate
from aoro_gym.terrains.world.meshes import FOLIAGE, SIDES, mesh
from aoro_gym.terrains.world.objects import Branch, Kind, matrix
from aoro_gym.terrains.world.shapes import REACH, ShapeKind, collision_shapes
from aoro_gym.terrains.world.world import World


@pytest.fixture(scope="module")
def made() -> World:
    x, y = np.meshgrid(np.arange(0.0, 30.5, 0.5), np.arange(0.0, 20.5, 0.5))
    return populate(Terrain.from_heights(0.1 * x + np.sin(0.3 * y), cell=0.5), 2, boulders=300.0, piles=60.0)


def test_every_object_but_branches_has_one(made):
    wanted = [n for n, one in enumerate(made.objects, start=1) if not isinstance(one, Branch)]
    shapes = collision_shapes(made)
    assert list(shapes.instance) == wanted
    assert {made.objects[n - 1].kind for n in wanted} == {Kind.TREE, Kind.STUMP, Kind.BOULDER, Kind.LOG}


def test_shapes_enclose_and_touch(made):
    shapes = collision_shapes(made)
    for k, number in enumerate(shapes.instance):
        one = made.objects[number - 1]
        own = mesh(one)
        solid = ~np.isin(own.surfaces, list(FOLIAGE.values()))
        used = np.unique(own.faces[solid])
        rotation = tuple(float(v) for v in shapes.rotation[k])
        points = (own.vertices[used] - shapes.position[k]) @ matrix(rotation)  # pyright: ignore[reportArgumentType]
        half = shapes.half_size[k]
        if one.kind == Kind.TREE:
            points = points[points[:, 2] <= half[2] + 1e-4]
            assert half[2] * 2.0 == pytest.approx(REACH + 0.3, abs=1e-4)
        # corners of polygons of a circle's area lie outside of it; float32 rounds 50 m to 4 µm
        over = 1e-4
        if shapes.kind[k] == ShapeKind.BOX:
            assert (np.abs(points) <= half + over).all()
            continue
        sides = SIDES[one.kind]
        corner = np.sqrt(2.0 * np.pi / sides / np.sin(2.0 * np.pi / sides))
        widest = np.hypot(*points[:, :2].T).max()
        assert widest <= half[0] * corner + over
        assert widest >= half[0] - over
        assert np.abs(points[:, 2]).max() <= half[2] + over


def test_a_bare_world_has_none(made):
    shapes = collision_shapes(World(made.terrain))
    assert [len(column) for column in shapes] == [0, 0, 0, 0, 0]
    assert shapes.half_size.shape == (0, 3)
