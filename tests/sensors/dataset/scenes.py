"""A small world for tests of data sets, with a machine in it, and a machine that drives straight past it."""

import numpy as np

from aoro_gym.machine import Machine
from aoro_gym.sensors.camera import Appearance, CameraModel, Intrinsics, StereoCamera, daylight
from aoro_gym.sensors.dataset.machines import StandingMachine, scene_of, with_machines
from aoro_gym.sensors.lidar import Motion, Mounting
from aoro_gym.terrains import Terrain
from aoro_gym.terrains.world.objects import Boulder, Log, Stump, along, upright
from aoro_gym.terrains.world.world import World
from aoro_gym.twin import Twin
from aoro_gym.twin.poses import pose_of_state

LENS = Intrinsics.of_view(240, 180, 75.0)
FLAT = Terrain.from_heights(np.zeros((61, 61)), cell=1.0, corner=(-30.0, -30.0))


def lying() -> World:
    stump = Stump((6.0, 1.5, 0.0), upright(), "pine", 0.3, 0.5)
    boulder = Boulder((7.0, -1.5, 0.3), upright(), (0.7, 0.6, 0.5), 0.8, 3)
    log = Log((9.0, -1.0, 0.2), along((0.6, 0.8, 0.0)), "spruce", 4.0, 0.2, 0.18, 0.4, 1)
    return World(FLAT, (stump, boulder, log))


def standing_at(x: float, y: float, heading: float, joint_angle: float = 0.0) -> StandingMachine:
    machine = Machine.load("aoro")
    twin = Twin(1, machine=machine, terrain=FLAT)
    twin.reset(position=(x, y), heading=heading, joint_angle=joint_angle)
    return StandingMachine.at(machine, pose_of_state(twin.state.numpy()[:, 0]))


def camera_in(world: World, machines: tuple[StandingMachine, ...] = (), *, pitch: float = 10.0) -> StereoCamera:
    return StereoCamera(
        scene_of(world, machines, device="cpu"),
        with_machines(Appearance.of_world(world)),
        daylight(),
        CameraModel("small", LENS),
        samples=1,
        sky_rays=1,
        mounting=Mounting(position=(0.0, 0.0, 2.0), angles_deg=(0.0, pitch, 0.0)),
    )


def passing(speed: float, turning: float) -> Motion:
    """Straight on at ``speed`` [m/s], while it turns at ``turning`` [rad/s], through the origin at 0.5 s."""
    time = np.linspace(0.0, 1.0, 21)
    position = np.column_stack([speed * (time - 0.5), 0 * time, 0 * time])
    return Motion(time, position, 0 * time, 0 * time, turning * (time - 0.5))
