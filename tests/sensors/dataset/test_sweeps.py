"""Sweeps beside pictures: what a lidar's points belong to is what the picture shows there, or is hidden there."""

from pathlib import Path

import numpy as np
import pytest

from aoro_gym.sensors.dataset import CATEGORIES, Shapes
from aoro_gym.sensors.dataset.sweeps import CLASSES, read_sweep, write_sweep
from aoro_gym.sensors.dataset.taking import machine_at, matrix_of, pose_of
from aoro_gym.sensors.lidar import Lidar, Motion, Mounting
from tests.sensors.dataset.scenes import LENS, camera_in, lying, passing, standing_at

MOTIONS = {"still": passing(0.0, 0.0), "driving": passing(2.0, 0.4)}


@pytest.fixture(scope="module", params=sorted(MOTIONS))
def swept(request, tmp_path_factory):
    """Points (K, 4) and labels of a file, the pose of the lidar, and what the camera and its pose say."""
    motion: Motion = MOTIONS[request.param]
    world, machines = lying(), (standing_at(12.0, 3.0, 2.2, 0.2),)
    camera = camera_in(world, machines)
    lidar = Lidar(camera.scene, "os1-128", mounting=Mounting(position=(0.0, 0.0, 2.4)), ideal=True, subrays=1)
    [points] = lidar.sweep(motion, start=0.45)
    pose = machine_at(motion, 0.5) @ matrix_of(lidar.mounting.transform())
    folder: Path = tmp_path_factory.mktemp("sweep")
    write_sweep(folder, "train", "000000", points, pose, Shapes(world, machines))
    rows, label = read_sweep(folder / "velodyne/train/000000.bin")
    truth = {name: part[0] for name, part in camera.truth(motion, start=0.5).items()}
    return rows, label, pose, truth, pose_of(camera, motion, 0.5)


def test_points_lie_on_what_they_met(swept):
    """In the world's axes, whatever the machine did while it was swept: the ground is at 0, within float32 of 100 m."""
    rows, label, pose, _, _ = swept
    height = rows[:, :3].astype(np.float64) @ pose[2, :3] + pose[2, 3]
    ground = (label & 0xFFFF) == CLASSES["ground"]
    assert ground.sum() > 5000
    assert np.abs(height[ground]).max() < 2e-3
    machine = (label & 0xFFFF) == CLASSES["machine"]
    assert machine.sum() > 100 and set(label[machine] >> 16) == {4}
    assert {int(kind) for kind in np.unique(label & 0xFFFF)} <= set(CLASSES.values())


def test_points_in_the_picture_are_on_the_same_object_or_hidden(swept):
    """Off edges, which are a pixel wide: a point is a surface's, so that the camera sees that surface at its depth, or
    something nearer. Depths of the neighbouring pixels hold that of the point between them."""
    rows, label, pose, truth, camera_pose = swept
    to_camera = np.linalg.inv(camera_pose) @ pose
    own = rows[:, :3].astype(np.float64) @ to_camera[:3, :3].T + to_camera[:3, 3]
    ahead = own[:, 2] > 1.0
    own, label = own[ahead], label[ahead]
    pixel = np.rint(LENS.project(own)).astype(int)
    inside = ((pixel > 0) & (pixel < [LENS.width - 1, LENS.height - 1])).all(axis=1)
    own, label, (column, row) = own[inside], label[inside], pixel[inside].T
    shift = np.stack(np.meshgrid([-1, 0, 1], [-1, 0, 1]), axis=-1).reshape(-1, 2)
    around = row[:, None] + shift[:, 0], column[:, None] + shift[:, 1]
    instance, depth = truth["instance"][around], truth["depth"][around]
    even = (instance == instance[:, :1]).all(axis=1) & (instance[:, 0] >= 0)
    same = (instance[:, 0] == np.where((label & 0xFFFF) == CLASSES["ground"], 0, label >> 16)) & even
    hidden = depth.max(axis=1) < own[:, 2]
    assert even.sum() > 3000
    assert (same | hidden)[even].all()
    assert same[even].mean() > 0.9
    # on the ground, which is flat, the depth lies between those of the pixels around
    flat = same & (instance[:, 0] == 0)
    near, far = depth.min(axis=1) - 2e-3, depth.max(axis=1) + 2e-3
    assert ((own[:, 2] >= near) & (own[:, 2] <= far))[flat].all()
    for name in ("stump", "boulder", "log", "machine"):
        of_it = even & ((label & 0xFFFF) == 1 + CATEGORIES.index(name))
        assert same[of_it].sum() > 0
