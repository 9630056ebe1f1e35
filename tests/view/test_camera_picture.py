"""Pictures of a camera in the panel: what is before the machine, rendered beside the view as time goes on."""

import time

import numpy as np
import pytest

from aoro_gym.machine.kinematics import Pose
from aoro_gym.sensors.camera import MODELS
from aoro_gym.sensors.camera.camera import CAMERA_MOUNTING
from aoro_gym.terrains import Plane, Terrain
from aoro_gym.terrains.world.objects import Log, along
from aoro_gym.terrains.world.world import World
from aoro_gym.view.camera_picture import EVERY, SKY, WIDTH, CameraPicture
from aoro_gym.view.lidar_cloud import colours
from aoro_gym.view.server import start

pytest.importorskip("viser", reason="[view] is not installed")
LEVEL = np.array([1.0, 0.0, 0.0, 0.0])
START = Pose(np.zeros(3), LEVEL)


@pytest.fixture(scope="module")
def server():
    running = start(0)
    yield running
    running.stop()


@pytest.fixture(scope="module")
def on_plane(server):
    return CameraPicture(server, Plane(), "stereo")


def shown(picture, at, pose=START):
    """The number of pictures, once that of the time ``at`` is shown."""
    end = time.monotonic() + 60.0
    while picture._seen != at or picture._rendering is not None:
        assert time.monotonic() < end
        picture._due = 0.0
        picture.show(at, pose)
        time.sleep(0.01)
    return picture.pictures


def taken(picture, pose=START):
    """A picture, which there is."""
    image = picture.take(pose)
    assert image is not None
    return image


def test_depths_are_those_of_the_plane_below_the_camera(on_plane):
    image = taken(on_plane)
    lens = MODELS["stereo"].resized(WIDTH).intrinsics
    assert image.shape == (lens.height, 2 * WIDTH, 3) and image.dtype == np.uint8
    # a ray through a row's middle goes down by the mounting's pitch and the row's slope, and meets the plane where it must
    down, height = np.radians(CAMERA_MOUNTING.angles_deg[1]), CAMERA_MOUNTING.position[2]
    for row in (100, 119):
        slope = (row - lens.centre[1]) / lens.focal[1]
        depth = height / (np.sin(down) + slope * np.cos(down))
        drawn = image[row, WIDTH + int(lens.centre[0])].astype(int)
        assert np.abs(drawn - colours(np.array(depth, dtype=np.float32)).astype(int)).max() <= 1  # rounded; float32
    assert tuple(image[0, -1]) == SKY  # above the horizon
    assert image[0, 0, 2] > image[0, 0, 0]  # and blue
    ground = image[-1, :WIDTH].astype(int)
    assert np.ptp(ground.mean(axis=0)) < 20.0  # asphalt is grey


def test_it_sees_what_lies_in_a_world_before_the_machine_and_turns_with_it(server):
    field = Terrain.from_heights(np.zeros((41, 41)), cell=1.0, corner=(-20.0, -20.0))
    log = Log((6.0, -3.0, 0.4), along((0.0, 1.0, 0.0)), "pine", 6.0, 0.4, 0.4, 0.8, 0)
    picture = CameraPicture(server, World(field, (log,)), "stereo")
    bare = CameraPicture(server, field, "stereo")
    depths = [taken(one)[:, WIDTH:] for one in (picture, bare)]
    assert (depths[0] != depths[1]).any(axis=-1).mean() > 0.02  # the log is nearer than the ground behind it
    behind = Pose(np.zeros(3), np.array([0.0, 0.0, 0.0, 1.0]))  # turned about z by half a turn
    depths = [taken(one, behind)[:, WIDTH:] for one in (picture, bare)]
    assert (depths[0] == depths[1]).all()


def test_pictures_follow_as_time_goes_on_and_the_view_does_not_wait(on_plane, monkeypatch):
    first = shown(on_plane, 1.0)
    image = on_plane._image
    assert image.visible and image.image.any()
    on_plane._due = 0.0
    on_plane.show(1.0, START)
    assert on_plane._rendering is None  # time stands still
    assert shown(on_plane, 2.0) == first + 1
    take = on_plane._camera.take_left
    monkeypatch.setattr(on_plane._camera, "take_left", lambda *a, **k: (time.sleep(0.5), take(*a, **k))[1])
    on_plane._due = 0.0
    began = time.monotonic()
    for i in range(10):
        on_plane.show(3.0 + i, START)  # one is being rendered; nothing waits
    assert time.monotonic() - began < 0.4
    assert on_plane._rendering is not None
    monkeypatch.undo()
    assert shown(on_plane, 20.0) == first + 3  # of ten looks one


def test_no_more_than_four_a_second_are_begun(on_plane):
    shown(on_plane, 30.0)
    on_plane._due = 0.0
    began = time.monotonic()
    on_plane.show(30.5, START)
    assert began + EVERY <= on_plane._due <= time.monotonic() + EVERY
    count = shown(on_plane, 30.5)
    on_plane._due = time.monotonic() + 60.0
    on_plane.show(31.0, START)
    assert on_plane._rendering is None and on_plane.pictures == count


def test_a_box_leaves_it_out_and_a_camera_in_the_ground_sees_nothing(on_plane):
    shown(on_plane, 40.0)
    on_plane._wanted.value = False
    on_plane.show(41.0, START)
    assert not on_plane._image.visible
    on_plane._wanted.value = True
    shown(on_plane, 41.0)
    assert on_plane._image.visible
    shown(on_plane, 42.0, Pose(np.array([0.0, 0.0, -9.0]), LEVEL))
    assert not on_plane._image.visible
    shown(on_plane, 43.0)
    assert on_plane._image.visible


def test_an_unknown_model_is_refused(server):
    with pytest.raises(ValueError, match="camera model is 'mono'; choose one of"):
        CameraPicture(server, Plane(), "mono")
