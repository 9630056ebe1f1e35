"""Machines that stand in a world: as the twin rests there, seen as they are, and labelled."""

from itertools import product
from typing import Any

import numpy as np
import pytest
import warp as wp
from scipy.spatial.transform import Rotation

from aoro_gym.machine import Machine
from aoro_gym.machine.kinematics import Kinematics
from aoro_gym.machine.solids import machine_solids
from aoro_gym.machine.vehicle_crane import GRAPPLE_DROP
from aoro_gym.sensors.camera import (
    CAMERA_MOUNTING,
    MODELS,
    Appearance,
    CameraModel,
    Picture,
    StereoCamera,
    daylight,
)
from aoro_gym.sensors.camera.camera import OPTICAL
from aoro_gym.sensors.dataset import CATEGORIES, Shapes, labels
from aoro_gym.sensors.dataset.labels import categories
from aoro_gym.sensors.dataset.machines import (
    BESIDE_PATH,
    StandingMachine,
    is_beside,
    scene_of,
    standing,
    with_held_logs,
    with_machines,
)
from aoro_gym.sensors.dataset.taking import matrix_of, pose_of
from aoro_gym.sensors.lidar import Motion, Mounting
from aoro_gym.terrains.world.objects import Log, matrix
from aoro_gym.terrains.world.places import HALF_LENGTH, HALF_WIDTH, stands_free
from aoro_gym.terrains.world.world import World
from tests.sensors.dataset.scenes import FLAT, LENS, camera_in, lying, standing_at


def pictured(world: World, machines: tuple[StandingMachine, ...]) -> tuple[Picture, Any]:
    camera, motion = camera_in(world, machines), Motion.still([0.0, 0.0, 0.0])
    truth = {name: part[0] for name, part in camera.truth(motion).items()}
    rgb = np.zeros((*truth["depth"].shape, 3), dtype=np.uint8)
    picture = Picture(rgb=rgb, numbers=rgb.astype(np.uint16), exposure=0.0, time=0.0, **truth)
    return picture, pose_of(camera, motion)


def test_it_stands_on_its_wheels():
    """Its lowest points are the lugs, the tires' deflection below the ground, as the twin at rest has it."""
    machine, one = Machine.load("aoro"), standing_at(3.0, -2.0, 0.7, 0.3)
    sunk = max(float(machine.rest.deflection_front), float(machine.rest.deflection_rear))
    assert -sunk - 0.02 < one.vertices[:, 2].min() <= 0.0
    assert one.heading == pytest.approx(0.7, abs=1e-5)
    np.testing.assert_allclose(one.position[:2], [3.0, -2.0], atol=1e-5)
    count = sum(len(solid.triangles()[1]) for solid in machine_solids(machine).values())
    assert len(one.faces) == len(one.colours) == count


def test_its_mask_is_its_visible_pixels_and_its_boxes_hold_it():
    world, one = lying(), standing_at(12.0, 3.0, 2.2, 0.2)
    picture, pose = pictured(world, (one,))
    shapes = Shapes(world, (one,))
    found = labels(picture, shapes, LENS, pose)
    [label] = [each for each in found if each.category == "machine"]
    assert label.instance == 4
    np.testing.assert_array_equal(label.mask, picture.instance == 4)
    category = categories(picture, shapes, LENS, pose)
    np.testing.assert_array_equal(label.mask, category == CATEGORIES.index("machine"))
    assert label.mask.sum() > 500 and label.truncation == 0.0
    # as long, wide and high as the machine is, which is bent: 4.4 m to 5 m, 2.5 m to 3.5 m, 2 m to 3.5 m
    length, width, height = label.size
    assert 4.0 < length < 5.5 and 2.4 < width < 3.6 and 2.0 < height < 3.5
    # the pixels lie in space within the box around its triangles, up to the rounding of single precision
    rows, columns = np.nonzero(label.mask)
    places = LENS.unproject(np.column_stack([columns, rows])) * picture.depth[rows, columns, None]
    in_world = places @ pose[:3, :3].T + pose[:3, 3]
    assert (in_world >= one.vertices.min(axis=0) - 1e-3).all() and (in_world <= one.vertices.max(axis=0) + 1e-3).all()


def test_without_machines_the_picture_is_that_of_the_world():
    world = lying()
    bare, _ = pictured(world, ())
    seen, _ = pictured(world, (standing_at(12.0, 3.0, 2.2),))
    np.testing.assert_array_equal(bare.depth[seen.instance != 4], seen.depth[seen.instance != 4])


def test_places_are_free_and_off_the_way():
    way = np.column_stack([np.linspace(-20.0, 20.0, 81), *np.zeros((3, 81))])
    found = standing(World(FLAT), 3, np.random.default_rng(5), way=way)
    assert len(found) == 3
    for number, one in enumerate(found):
        assert np.linalg.norm(way[:, :2] - one.position[:2], axis=1).min() >= BESIDE_PATH
        others = np.array([[*other.position[:2], 2.5] for k, other in enumerate(found) if k != number])
        assert stands_free(others, one.position[None, :2], np.array([one.heading]), np.zeros(1)).all()
    again = standing(World(FLAT), 3, np.random.default_rng(5), way=way)
    np.testing.assert_array_equal(again[2].vertices, found[2].vertices)


def test_a_machine_that_drives_touches_none_that_stands():
    """A machine's ends reach beyond both ends of its way: where the hinge alone is far enough from the way, some standing
    ones would have points in its rectangles; of those that are let stand none has."""
    share = np.linspace(0.0, 1.0, 31)
    way = np.column_stack([-3.0 + 6.0 * share, np.zeros(31), 0.4 * share, 0.5 * share])
    rng, touching, beside = np.random.default_rng(4), 0, 0
    for place in rng.uniform([-9.0, -6.0, -np.pi, -0.5], [9.0, 6.0, np.pi, 0.5], (300, 4)):
        if np.linalg.norm(way[:, :2] - place[:2], axis=1).min() < BESIDE_PATH:
            continue
        points = np.concatenate([_rectangle(*end, 15) for end in _ends(*place)])
        touches = any(_inside(points, *end) for at in way for end in _ends(*at))
        stands = is_beside(place, way)
        assert not (touches and stands)
        touching, beside = touching + touches, beside + stands
    assert touching > 5 and beside > 50


def _inside(points: np.ndarray, hinge: tuple[float, float], direction: float) -> bool:
    apart = points - hinge
    along = apart @ [np.cos(direction), np.sin(direction)]
    across = apart @ [-np.sin(direction), np.cos(direction)]
    return bool(((along >= 0.0) & (along <= HALF_LENGTH) & (np.abs(across) <= HALF_WIDTH)).any())


def _ends(x: float, y: float, heading: float, joint: float) -> list[tuple[tuple[float, float], float]]:
    """Hinge, and direction from it [rad], of both frames."""
    return [((x, y), heading), ((x, y), heading - joint + np.pi)]


def _rectangle(hinge: tuple[float, float], direction: float, count: int) -> np.ndarray:
    """Points (K, 2) of a frame."""
    along, across = np.meshgrid(np.linspace(0.0, HALF_LENGTH, count), np.linspace(-HALF_WIDTH, HALF_WIDTH, count))
    turn = np.array([[np.cos(direction), np.sin(direction)], [-np.sin(direction), np.cos(direction)]])
    return np.column_stack([along.ravel(), across.ravel()]) @ turn + hinge


@pytest.mark.parametrize("name", sorted(MODELS))
def test_nothing_of_the_own_machine_is_in_view(name):
    """At the camera's place, whatever the arms do, each corner of the machine's parts lies below the picture, at all angles
    that are drawn (the wide one at its own): rays of a camera need not look for it, rays of light do. So it is of
    ``aoro_least_squares``; of `aoro` and of the data sheets, whose chassis reach 0.4 m farther ahead, corners of the nose
    would be in the lowest rows."""
    machine, lens = Machine.load("aoro_least_squares"), MODELS[name].intrinsics
    solids, kinematics = machine_solids(machine), Kinematics(machine)
    _, y, z = lens.unproject(np.column_stack([np.arange(lens.width), np.full(lens.width, lens.height)])).T
    steepest, drawn = (y / z).max(), list(product((-2.0, 2.0), (2.0, 8.0, 18.0), (-5.0, 5.0)))
    for arms in np.linspace(-1.0, 1.0, 3) * float(machine.arm.swing):
        placed = kinematics.placed(0.0, [arms] * 4, [0.0] * 4)
        parts = [
            Rotation.from_quat(wxyz, scalar_first=True).apply(solids[part].triangles()[0]) + origin
            for part, (origin, wxyz) in placed.items()
        ]
        for angles in [CAMERA_MOUNTING.angles_deg] if name == "stereo-wide" else drawn:
            mounted = Mounting(position=CAMERA_MOUNTING.position, angles_deg=angles)
            pose = matrix_of(mounted.transform() * wp.transform(wp.vec3(0.0, 0.0, 0.0), wp.quat(*OPTICAL)))
            _, down, ahead = ((np.concatenate(parts) - pose[:3, 3]) @ pose[:3, :3]).T
            assert (down > steepest * ahead).all()


def test_cranes_are_unfolded_clear_of_trees_and_logs_in_them_are_labelled():
    """Of eight machines some hold logs; a held log is a world's object in the grapple, a metre below the tip."""
    world = lying()
    folded = standing(world, 8, np.random.default_rng(3))
    machines = standing(world, 8, np.random.default_rng(3), cranes=True)
    assert [one.position.tolist() for one in machines] == [one.position.tolist() for one in folded]
    out = [one for one in machines if one.pose.crane is not None]
    assert len(out) > 5
    with_logs, held = with_held_logs(world, machines)
    assert 0 < len(held) < len(out)
    assert with_logs.objects[: len(world.objects)] == world.objects
    assert list(held.values()) == list(range(4, 4 + len(held)))
    for number, instance in held.items():
        log = with_logs.objects[instance - 1]
        assert isinstance(log, Log)
        middle = np.asarray(log.position) + 0.5 * log.length * matrix(log.rotation)[:, 2]
        tip = machines[number].crane_in_world()["crane_grapple"][0]
        assert np.linalg.norm(middle - tip) == pytest.approx(GRAPPLE_DROP)
        assert middle[2] < tip[2]
    number, instance = next(iter(held.items()))
    one = machines[number]
    away = Rotation.from_quat(one.pose.wxyz, scalar_first=True).apply([0.0, 12.0, 0.0]) + one.position
    camera = StereoCamera(
        scene_of(with_logs, (one,), device="cpu"),
        with_machines(Appearance.of_world(with_logs)),
        daylight(),
        CameraModel("small", LENS),
        samples=1,
        sky_rays=1,
        mounting=Mounting(position=(0.0, 0.0, 2.0), angles_deg=(0.0, 0.0, 0.0)),
    )
    towards = one.position - away
    motion = Motion.still(away.tolist(), yaw=float(np.arctan2(towards[1], towards[0])))
    truth = {name: part[0] for name, part in camera.truth(motion).items()}
    assert (truth["instance"] == instance).sum() > 20
