"""The machine that carries a camera: posed as it is, not in view, and its shadow where Embree has it."""

from typing import Any

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation
from trimesh.ray.ray_pyembree import RayMeshIntersector

from aoro_gym.machine import Machine
from aoro_gym.machine.kinematics import Pose
from aoro_gym.machine.solids import machine_solids
from aoro_gym.sensors.camera import (
    Appearance,
    CameraModel,
    Intrinsics,
    Picture,
    Request,
    StereoCamera,
    daylight,
    take_together,
)
from aoro_gym.sensors.dataset import DatasetSettings
from aoro_gym.sensors.dataset.carrier import carrier
from aoro_gym.sensors.dataset.machines import StandingMachine, with_machines
from aoro_gym.sensors.dataset.sites import Site
from aoro_gym.sensors.dataset.taking import pose_of
from aoro_gym.sensors.lidar import Motion, Mounting
from aoro_gym.terrains.world.world import World
from tests.sensors.dataset.scenes import FLAT

LENS = Intrinsics.of_view(120, 90, 75.0)
LOW_SUN = daylight("summer", hour=18.5)
POSTURE = np.array([0.4, -0.1, -0.2, -0.15, -0.25, 0.3, 0.2, 0.1, 0.0])


def front_of(position: Any, yaw: float) -> np.ndarray:
    out = np.eye(4)
    out[:3, :3], out[:3, 3] = Rotation.from_euler("z", yaw).as_matrix(), position
    return out


def posed(position: Any, yaw: float, posture: np.ndarray) -> StandingMachine:
    """Its triangles by another way: all of the machine at once, in the world's axes."""
    wxyz = Rotation.from_euler("z", yaw).as_quat(scalar_first=True)
    pose = Pose(np.array(position), wxyz, posture[0], tuple(posture[1:5]), tuple(posture[5:]))
    return StandingMachine.at(Machine.load("aoro"), pose)


def test_parts_are_where_the_machine_has_them() -> None:
    found, place = [], ([3.0, -2.0, 0.4], 0.8)
    solids = machine_solids(Machine.load("aoro")).values()
    for solid, pose in zip(solids, carrier().poses(front_of(*place), POSTURE), strict=True):
        found.append(Rotation.from_quat(pose[3:]).apply(solid.triangles()[0]) + pose[:3])
    np.testing.assert_allclose(np.concatenate(found), posed(*place, POSTURE).vertices, atol=1e-9)


@pytest.fixture(scope="module")
def site() -> Site:
    return Site(DatasetSettings(machines=0), 0, World(FLAT), None, "cpu", 2)


def test_its_shadow_is_embrees(site: Site) -> None:
    """Before the machine, with the sun behind: of places on the ground, those from which Embree's rays towards the sun meet
    its triangles are those in the shade. A place is float32 at 10 m, 1 µm: rays that pass edges so closely are few. The
    picture of the other machine, which stands elsewhere, has none of it, and none sees either machine."""
    behind = LOW_SUN.towards_sun
    yaw = float(np.arctan2(-behind[1], -behind[0]))
    lit = site.carry([front_of([9.0, 9.0, 0.0], yaw), front_of([0.0, 0.0, 0.0], yaw)], [carrier().rest, POSTURE])
    camera = StereoCamera(
        site.scene, with_machines(Appearance.of_world(site.world)), LOW_SUN, CameraModel("small", LENS), samples=1,
        sky_rays=1, mounting=Mounting(position=(1.7, 0.06, 2.4), angles_deg=(0.0, 18.0, 0.0)), undergrowth=False,
    )  # fmt: skip
    motion = Motion.still([0.0, 0.0, 0.0], yaw=yaw)
    own, others, none = (
        taken[0][0]
        for taken in take_together([Request(camera, motion, lit=k) for k in (lit[1], lit[0], 0)], left_only=True)
    )
    assert none.sunlit[none.instance == 0].all() and others.sunlit[others.instance == 0].all()
    assert set(np.unique(own.instance)) <= {-1, 0}
    np.testing.assert_array_equal(own.depth, none.depth)
    places = _on_ground(own, pose_of(camera, motion))
    machine = posed([0.0, 0.0, 0.0], yaw, POSTURE)
    mesh = trimesh.Trimesh(machine.vertices, machine.faces, process=False)
    towards = np.tile(behind, (len(places), 1))
    theirs = RayMeshIntersector(mesh, scale_to_box=False).intersects_any(places, towards)
    shaded = ~own.sunlit[own.instance == 0]
    assert theirs.sum() > 300
    assert (shaded == theirs).mean() >= 0.999
    assert own.rgb[own.instance == 0][shaded].mean() < 0.7 * none.rgb[none.instance == 0][shaded].mean()


def _on_ground(picture: Picture, pose: np.ndarray) -> np.ndarray:
    """(K, 3) [m] a millimetre above the ground that pixels show."""
    rows, columns = np.nonzero(picture.instance == 0)
    ahead = LENS.unproject(np.column_stack([columns, rows])) * picture.depth[rows, columns, None]
    return ahead @ pose[:3, :3].T + pose[:3, 3] + np.array([0.0, 0.0, 1e-3])
