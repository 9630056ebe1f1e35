"""The height map is the ground: on a plane, on bare terrain, under trees, and as a lidar sees it."""

import numpy as np
import pytest

from aoro_gym.sensors.height_map import HeightMapSensor
from aoro_gym.sensors.lidar import Lidar, Motion
from aoro_gym.sensors.raytrace import Scene
from aoro_gym.terrains import Terrain
from aoro_gym.terrains.generate.world import world

FLOAT = 2.0**-23


def bumpy() -> Terrain:
    x, y = np.meshgrid(np.arange(-20.0, 20.5, 0.5), np.arange(-20.0, 20.5, 0.5))
    return Terrain.from_heights(0.4 * np.sin(0.7 * x) * np.cos(0.5 * y), cell=0.5, corner=(-20.0, -20.0))


def nodes(sensor: HeightMapSensor, position, heading) -> np.ndarray:
    """(forward, left, 2) places of the grid in the world."""
    f, s = np.meshgrid(sensor.forward, sensor.left, indexing="ij")
    c, n = np.cos(heading), np.sin(heading)
    return np.stack([position[0] + c * f - n * s, position[1] + n * f + c * s], axis=-1)


def test_a_tilted_plane_in_the_heading_frame():
    corners = np.array([[-99, -99, 0], [99, -99, 0], [99, 99, 0], [-99, 99, 0]], dtype=float)
    corners[:, 2] = corners[:, :2] @ [0.1, -0.2]
    sensor = HeightMapSensor(Scene(corners, [[0, 1, 2], [0, 2, 3]]))
    position, heading = np.array([[3.0, 1.0, 0.7], [-5.0, 2.0, -1.0]]), np.array([0.8, -2.0])
    heights = sensor.measure(position, heading)
    for k in range(2):
        expected = nodes(sensor, position[k], heading[k]) @ [0.1, -0.2] - position[k, 2]
        np.testing.assert_allclose(heights[k], expected, atol=20 * FLOAT * 20)


def test_bare_terrain():
    terrain = bumpy()
    sensor = HeightMapSensor(Scene.of_terrain(terrain), forward=(-4.0, 8.0), left=(-4.0, 4.0), cell=0.5)
    heights = sensor.measure([[1.0, -2.0, 0.3]], [0.0])[0]
    expected = 0.4 * np.sin(0.7 * (1.0 + sensor.forward))[:, None] * np.cos(0.5 * (sensor.left - 2.0)) - 0.3
    np.testing.assert_allclose(heights, expected, atol=20 * FLOAT * 10)  # at the terrain's own vertices


def test_it_is_the_ground_that_a_lidar_sees():
    scene = Scene.of_terrain(bumpy())
    [points] = Lidar(scene, "os1-64", subrays=1, ideal=True).sweep(Motion.still([0.0, 0.0, 0.3], yaw=0.4))
    seen = points.world[np.hypot(*points.world[:, :2].T) < 12.0].astype(float)[::50]
    assert len(seen) > 100
    c, s = np.cos(0.4), np.sin(0.4)
    for place in seen:
        ahead, left = c * place[0] + s * place[1], c * place[1] - s * place[0]
        sensor = HeightMapSensor(scene, forward=(ahead, ahead), left=(left, left))
        # a grazing ray's place rounds along the ray: slope of the ground times 1e-5 m, and 12 m in float32
        assert sensor.measure([[0.0, 0.0, 0.3]], [0.4])[0, 0, 0] == pytest.approx(place[2] - 0.3, abs=5e-5)


def test_through_what_stands_on_the_ground_or_not():
    made = world(2, size=(40.0, 40.0))
    scene, bare = Scene.of_world(made), Scene.of_terrain(made.terrain)
    place = [[0.0, 0.0, float(made.terrain.vertices[:, 2].max()) + 1.0]]
    given = {"forward": (-12.0, 12.0), "left": (-12.0, 12.0), "above": 40.0}
    ground, objects, expected = (
        HeightMapSensor(one, ground_only=only, **given).measure(place, [0.2])
        for one, only in ((scene, True), (scene, False), (bare, True))
    )
    np.testing.assert_array_equal(ground, expected)
    assert ((objects - expected) > 0.1).mean() > 0.02 and (objects >= expected - 1e-4).all()


def test_beyond_the_ground_there_is_nothing():
    sensor = HeightMapSensor(Scene.of_terrain(bumpy()))
    assert np.isnan(sensor.measure([[500.0, 0.0, 0.0]], [0.0])).all()


def test_noise():
    corners = [[-99, -99, 0], [99, -99, 0], [99, 99, 0], [-99, 99, 0]]
    sensor = HeightMapSensor(Scene(corners, [[0, 1, 2], [0, 2, 3]]), noise=0.05)
    heights = sensor.measure(np.zeros((10, 3)), np.zeros(10))
    assert heights.std() == pytest.approx(0.05, rel=5.0 / np.sqrt(2 * heights.size))


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"cell": 0.0}, "cell is 0 m"),
        ({"forward": (2.0, 1.0)}, "second number of forward is 1 m"),
        ({"cell": 0.001}, "take larger cells"),
        ({"noise": -1.0}, "noise is -1 m"),
    ],
)
def test_wrong_input(options, message):
    with pytest.raises(ValueError, match=message):
        HeightMapSensor(Scene.of_terrain(bumpy()), **options)


def test_wrong_places():
    with pytest.raises(ValueError, match=r"must be \(N, 3\) and \(N,\)"):
        HeightMapSensor(Scene.of_terrain(bumpy())).measure([0.0, 0.0, 0.0], [0.0])
