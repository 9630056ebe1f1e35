"""Points of a lidar in the scene: where the ground is, swept anew as time goes on."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from aoro_gym.machine.kinematics import Pose
from aoro_gym.terrains import Plane, Terrain
from aoro_gym.terrains.world.objects import Log, along
from aoro_gym.terrains.world.world import World
from aoro_gym.view.lidar_cloud import EVERY, LidarCloud, angles, colours
from aoro_gym.view.server import start

pytest.importorskip("viser", reason="[view] is not installed")
LEVEL = np.array([1.0, 0.0, 0.0, 0.0])


@pytest.fixture
def server():
    running = start(0)
    yield running
    running.stop()


def test_points_lie_on_the_ground_where_the_machine_is(server):
    plane = Plane(slope_deg=5.0)
    cloud = LidarCloud(server, plane, "vlp-16")
    node = server.scene.get_handle_by_name("/world/lidar")
    assert not node.visible
    place = np.array([40.0, 10.0, float(plane.height(40.0, 10.0))])
    cloud.show(0.0, Pose(place, LEVEL))
    assert node.visible and len(node.points) > 1000
    points = np.asarray(node.points, dtype=np.float64)
    # its range is known to 3 cm (one standard deviation), and rays come down steeper than 1 : 20
    assert np.abs(points[:, 2] - plane.height(points[:, 0], points[:, 1])).max() < 6 * 0.03
    assert np.linalg.norm(points[:, :2].mean(axis=0) - place[:2]) < 40.0
    before = node.points
    cloud.show(0.5 * EVERY, Pose(place, LEVEL))
    assert node.points is before
    cloud.show(1.5 * EVERY, Pose(np.add(place, [1.0, 0.0, 0.1]), LEVEL))
    assert node.points is not before


def test_it_sees_what_lies_in_a_world(server):
    field = Terrain.from_heights(np.zeros((41, 41)), cell=1.0, corner=(-20.0, -20.0))
    log = Log((13.0, -3.0, 0.4), along((0.0, 1.0, 0.0)), "pine", 6.0, 0.4, 0.4, 0.8, 0)
    cloud = LidarCloud(server, World(field, (log,)), "vlp-16")
    points = cloud.sweep(Pose(np.zeros(3), LEVEL))
    assert points is not None and np.sum(points.instance == 1) > 20


def test_a_box_leaves_it_out_and_a_sensor_in_the_ground_sees_nothing(server):
    cloud = LidarCloud(server, Plane(), "vlp-16")
    node = server.scene.get_handle_by_name("/world/lidar")
    cloud.show(0.0, Pose(np.zeros(3), LEVEL))
    cloud._wanted.value = False
    cloud.show(1.0, Pose(np.zeros(3), LEVEL))
    assert not node.visible
    cloud._wanted.value = True
    cloud.show(2.0, Pose(np.array([0.0, 0.0, -9.0]), LEVEL))
    assert not node.visible


def test_angles_are_those_of_the_rotation():
    turned = Rotation.from_euler("ZYX", [0.4, -0.2, 0.1])
    found = angles(Pose(np.zeros(3), turned.as_quat(scalar_first=True)))
    np.testing.assert_allclose(found, (0.1, -0.2, 0.4), atol=1e-12)


def test_near_and_far_differ_in_colour():
    near, far = colours(np.array([0.0, 100.0], dtype=np.float32)).astype(int)
    assert near[0] > 200 > far[0]


def test_an_unknown_model_is_refused(server):
    with pytest.raises(ValueError, match="lidar model is 'sick'; choose one of"):
        LidarCloud(server, Plane(), "sick")
