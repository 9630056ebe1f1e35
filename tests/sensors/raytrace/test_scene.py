"""Rays against closed forms, worlds that do not see one another, and what is wrong input."""

import numpy as np
import pytest
import trimesh

from aoro_gym.sensors.raytrace import NO_CLASS, Bodies, Body, Scene
from aoro_gym.terrains import Terrain
from aoro_gym.terrains.generate.world import world
from aoro_gym.terrains.world.materials import MATERIALS, Surface
from aoro_gym.terrains.world.objects import Tree

FLOAT = 2.0**-23
"""Distance of float32 numbers near 1."""
SQUARE = ([[-50, -50, 0], [50, -50, 0], [50, 50, 0], [-50, 50, 0]], [[0, 1, 2], [0, 2, 3]])


def directions(count: int, seed: int = 0) -> np.ndarray:
    vectors = np.random.default_rng(seed).normal(size=(count, 3))
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)


def test_a_tilted_plane():
    slope = np.array([0.2, -0.1])
    vertices = np.array(SQUARE[0], dtype=float)
    vertices[:, 2] = vertices[:, :2] @ slope
    scene = Scene.of_terrain(Terrain(vertices, np.array(SQUARE[1])))
    to = directions(2000)
    to[:, 2] = -np.abs(to[:, 2]) - 0.2
    to /= np.linalg.norm(to, axis=1, keepdims=True)
    hits = scene.cast([0.3, -0.7, 5.0], to)
    normal = np.array([*-slope, 1.0]) / np.hypot(1.0, np.hypot(*slope))
    expected = -(normal @ [0.3, -0.7, 5.0]) / (to @ normal)
    inside = (np.abs([0.3, -0.7] + expected[:, None] * to[:, :2]) < 49.9).all(axis=1)
    assert inside.sum() > 1000
    np.testing.assert_allclose(hits.distance[inside], expected[inside], rtol=20 * FLOAT)
    np.testing.assert_allclose(hits.normal[inside], np.tile(normal, (inside.sum(), 1)), atol=20 * FLOAT)
    assert (hits.instance[inside] == 0).all() and hits.front.all()


def test_a_sphere_of_triangles():
    ball = trimesh.creation.icosphere(5, radius=2.0)
    hits = Scene(ball.vertices, ball.faces).cast([0.0, 0.0, 0.0], directions(2000))
    edge = ball.edges_unique_length.max()
    # a chord's middle lies edge² / 8 R inside; a triangle's centre at most edge² / 6 R
    assert (hits.distance <= 2.0 + 1e-6).all() and (hits.distance >= 2.0 - edge**2 / 12.0).all()
    assert not hits.front.any()  # from inside
    cosine = -(hits.normal * directions(2000)).sum(axis=1)
    assert (np.arccos(np.clip(cosine, -1, 1)) <= edge / np.sqrt(3.0) / 2.0).all()


def pose(position, axis, angle) -> list[float]:
    axis = np.asarray(axis) / np.linalg.norm(axis)
    return [*position, *(np.sin(angle / 2) * axis), np.cos(angle / 2)]


@pytest.mark.parametrize("kind", ["box", "cylinder", "capsule"])
def test_bodies_are_as_their_triangles(kind):
    size = {"box": (0.7, 0.4, 0.3), "cylinder": (0.4, 0.9), "capsule": (0.4, 0.6)}[kind]
    made = {
        "box": lambda: trimesh.creation.box(extents=2 * np.array(size)),
        "cylinder": lambda: trimesh.creation.cylinder(size[0], 2 * size[-1], sections=720),
        "capsule": lambda: trimesh.creation.capsule(2 * size[-1], size[0], count=[256, 256]),
    }[kind]()
    if kind == "capsule":
        made.apply_translation([0, 0, -made.bounds.mean(axis=0)[2]])
    bodies = Bodies(
        [Body(kind, 1, 0, size), Body("mesh", 2, 0, vertices=made.vertices, faces=made.faces, world=1)], num_worlds=2
    )
    bodies.move([pose([40.0, 3.0, 2.0], [1, 2, 3], 0.8)] * 2)
    scene = Scene(*SQUARE, bodies=bodies)
    to = directions(4000)
    start = np.float32([40.0, 3.0, 2.0] - 30.0 * to + np.random.default_rng(1).uniform(-0.5, 0.5, to.shape))
    solid, mesh = (scene.cast(start, to, worlds=np.full(len(to), world)) for world in range(2))
    both = (solid.instance == 1) & (mesh.instance == 2)
    assert both.sum() > 1000
    assert ((solid.instance == 1) != (mesh.instance == 2)).mean() < 0.01  # sagitta of the triangles at the outline
    # grazing rays see the sagitta r (1 - cos(pi / n)) magnified by 1 / cos
    cosine = -(solid.normal * to).sum(axis=1)
    sagitta = size[0] * (1.0 - np.cos(np.pi / 128)) if kind != "box" else 0.0
    gap = np.abs(solid.distance[both] - mesh.distance[both]) * np.maximum(cosine[both], 0.05)
    assert np.quantile(gap, 0.99) <= sagitta + 60.0 * FLOAT * 40.0
    agreement = (solid.normal * mesh.normal).sum(axis=1)[both & (cosine > 0.1)]
    assert np.quantile(agreement, 0.01) > np.cos(2.5 * np.pi / 128)


def test_a_cylinder_in_closed_form():
    bodies = Bodies([Body("cylinder", 7, 3, (0.25, 5.0))])
    bodies.move([[50.0, 0.0, 5.0, 0.0, 0.0, 0.0, 1.0]])
    scene = Scene(*SQUARE, bodies=bodies, reflectance=[[0.1, 0.1]] * 4)
    angle = np.linspace(-0.0049, 0.0049, 99)
    hits = scene.cast([0.0, 0.0, 3.0], np.column_stack([np.cos(angle), np.sin(angle), 0 * angle]))
    expected = 50.0 * np.cos(angle) - np.sqrt(0.25**2 - (50.0 * np.sin(angle)) ** 2)
    # rounding of the ray's offset from the axis, 50 m in float32, moves the hit by that over the cosine of incidence
    cosine = np.sqrt(0.25**2 - (50.0 * np.sin(angle)) ** 2) / 0.25
    assert (np.abs(hits.distance - expected) < 4.0 * FLOAT * 50.0 / cosine + 2e-5).all()
    assert (hits.instance == 7).all() and (hits.class_id == 3).all() and (hits.face == -1).all()


def test_along_the_axes():
    # zero components of directions: no infinities in the hierarchy of boxes
    bodies = Bodies([Body("box", index + 1, 0, (0.1, 0.1, 0.1)) for index in range(6)])
    ways = np.concatenate([np.eye(3), -np.eye(3)])
    bodies.move(np.column_stack([3.0 * ways + [0, 0, 10.0], np.tile([0.0, 0.0, 0.0, 1.0], (6, 1))]))
    hits = Scene(*SQUARE, bodies=bodies).cast([0.0, 0.0, 10.0], ways)
    np.testing.assert_array_equal(hits.instance, np.arange(6) + 1)
    np.testing.assert_allclose(hits.distance, 2.9, rtol=4 * FLOAT)


def test_worlds_do_not_see_one_another_nor_does_an_empty_one():
    bodies = Bodies([Body("box", world + 1, 0, (0.5, 0.5, 0.5), world=world) for world in (0, 2, 2, 5)], num_worlds=7)
    place = np.tile([0.0, 0.0, 3.0, 0.0, 0.0, 0.0, 1.0], (4, 1))
    place[:, 0] = [0.0, 0.0, 4.0, 8.0]
    bodies.move(place)
    scene = Scene(*SQUARE, bodies=bodies)
    for x, seen in ((0.0, {0: 1, 2: 3}), (4.0, {2: 3}), (8.0, {5: 6})):
        found = scene.cast([x, 0.0, 9.0], np.tile([0.0, 0.0, -1.0], (7, 1)), worlds=np.arange(7)).instance
        assert found.tolist() == [seen.get(world, 0) for world in range(7)]
    place[:, 0] += 20.0
    bodies.move(place)
    assert scene.cast([0.0, 0.0, 9.0], [[0.0, 0.0, -1.0]], worlds=2).instance[0] == 0
    assert scene.cast([20.0, 0.0, 9.0], [[0.0, 0.0, -1.0]], worlds=2).instance[0] == 3


def test_nothing_is_met_beyond_the_range():
    hits = Scene(*SQUARE).cast([0.0, 0.0, 5.0], [[0.0, 0.0, -1.0], [0.0, 0.0, 1.0]], max_range=4.9)
    assert np.isinf(hits.distance).all() and (hits.instance == -1).all()
    assert (hits.class_id == NO_CLASS).all() and (hits.face == -1).all() and (hits.normal == 0.0).all()


def test_a_sensor_below_ground_or_in_an_object():
    ball = trimesh.creation.icosphere(2, radius=1.0)
    vertices = np.concatenate([SQUARE[0], np.add(ball.vertices, [5.0, 0.0, 3.0])])
    faces = np.concatenate([SQUARE[1], ball.faces + 4])
    scene = Scene(vertices, faces, face_instance=np.repeat([0, 8], [2, len(ball.faces)]))
    scene.check_outside("lidar", [[0, 0, 0.1], [5, 0, 1.0], [5, 0, 4.2]])
    with pytest.raises(ValueError, match=r"lidar at .* z = -0.20 m lies inside the ground, whose .* 0.20 m higher"):
        scene.check_outside("lidar", [[0, 0, 1], [0, 0, -0.2]])
    with pytest.raises(ValueError, match="inside object 8"):
        scene.check_outside("lidar", [5.0, 0.0, 3.1])


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"faces": np.zeros((0, 3), int)}, "at least one triangle"),
        ({"vertices": [[0, 0, 0], [1, 0, 0], [0, np.nan, 0]], "faces": [[0, 1, 2]]}, r"scene vertices\[2, 1\] is nan"),
        ({"vertices": [[0, 0, 0], [1, 0, 0], [0, 6000.0, 0]], "faces": [[0, 1, 2]]}, "at most|in .*5000"),
        ({"faces": [[0, 1, 4]]}, r"scene faces\[0, 2\] is 4, but must be in \[0, 3\]"),
        ({"faces": [[0.0, 1.0, 2.0]]}, "must be integers"),
        ({"face_class": [0, 1]}, "class 1 has no reflectance"),
        ({"face_class": [0]}, "face_class has the shape"),
        ({"face_instance": [0, -1]}, r"face_instance\[1\] is -1"),
        ({"reflectance": [[0.1, 1.2]]}, r"reflectance\[0, 1\] is 1.2"),
        ({"reflectance": [0.1, 0.2]}, "a row a class"),
    ],
)
def test_what_is_no_scene(change, message):
    with pytest.raises(ValueError, match=message):
        Scene(**{"vertices": SQUARE[0], "faces": SQUARE[1], **change})


@pytest.mark.parametrize(
    ("arguments", "options", "message"),
    [
        (([0, 0, 1], np.zeros((0, 3))), {}, "at least one ray"),
        (([0, 0, 1], [[0, 0, 0]]), {}, r"length of directions\[0\] is 0"),
        (([0, 0, np.inf], [[0, 0, 1]]), {}, "origins"),
        (([[0, 0, 1]] * 2, [[0, 0, 1]] * 3), {}, "one a ray"),
        (([0, 0, 1], [[0, 0, 1]]), {"max_range": -1.0}, "max_range is -1 m"),
        (([0, 0, 1], [[0, 0, 1]]), {"worlds": 1}, "worlds"),
    ],
)
def test_what_are_no_rays(arguments, options, message):
    with pytest.raises(ValueError, match=message):
        Scene(*SQUARE).cast(*arguments, **options)


@pytest.mark.parametrize(
    ("body", "message"),
    [
        (lambda: Body("ball", 1, 0), "choose one of"),  # pyright: ignore[reportArgumentType]
        (lambda: Body("box", 0, 0, (1, 1, 1)), "body instance is 0"),
        (lambda: Body("box", 1, 0, (1, 1)), "size of a box has 2 numbers"),
        (lambda: Body("capsule", 1, 0, (1, -1)), r"size of a capsule\[1\] is -1 m"),
        (lambda: Body("mesh", 1, 0), "give both"),
        (lambda: Bodies([]), "bodies is empty"),
        (
            lambda: Bodies([Body("box", 1, 0, (1, 1, 1))] * 1_000_001),
            "number of bodies is 1000001, but must be at most",
        ),
        (lambda: Bodies([Body("box", 1, 0, (1, 1, 1), world=2)], num_worlds=2), r"body world\[0\] is 2"),
        (lambda: Bodies([Body("box", 1, 0, (1, 1, 1))]).move([[0, 0, 0, 0, 0, 0, 2]]), "length of the quaternion"),
        (lambda: Bodies([Body("box", 1, 0, (1, 1, 1))]).move([[0, 0, 0]]), r"must be \(1, 7\)"),
    ],
)
def test_what_are_no_bodies(body, message):
    with pytest.raises(ValueError, match=message):
        body()


def test_a_world_is_seen_with_its_objects_and_materials():
    made = world(2, size=(40.0, 40.0))
    scene = Scene.of_world(made)
    parts = made.scene()
    down = np.random.default_rng(0).uniform(-15, 15, (4000, 3))
    down[:, 2] = 60.0
    hits = scene.cast(down, np.tile([0.0, 0.0, -1.0], (4000, 1)))
    assert len(np.unique(hits.instance)) > 10
    np.testing.assert_array_equal(hits.instance, parts.face_instance[hits.face])
    np.testing.assert_array_equal(hits.class_id, parts.face_class[hits.face])
    snow = MATERIALS[Surface.SNOW]
    row = scene.data.reflectance.numpy()[Surface.SNOW]
    np.testing.assert_allclose(row, [snow.reflectance_905nm, snow.reflectance_1550nm], rtol=1e-6)


def test_a_sensor_below_leaves_is_not_inside_of_a_tree():
    """Triangles of foliage show their inner sides to half of the places below; in the stem is inside."""
    made = world(3, size=(40.0, 40.0))
    scene = Scene.of_world(made)
    tree = max((one for one in made.objects if isinstance(one, Tree)), key=lambda one: one.crown_radius)
    around = np.linspace(0.0, 2.0 * np.pi, 40)
    below = np.asarray(tree.position) + np.column_stack([0.7 * np.cos(around), 0.7 * np.sin(around), 0 * around + 1.5])
    seen = scene.cast(below, np.tile([0.0, 0.0, 1.0], (40, 1)))
    assert (~seen.front).any()
    scene.check_outside("the sensor", below)
    with pytest.raises(ValueError, match="lies inside object"):
        scene.check_outside("the sensor", np.add(tree.position, [0.0, 0.0, 1.0]))
