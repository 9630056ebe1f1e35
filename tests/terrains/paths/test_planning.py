"""Generated paths against what they promise, measured on the ground that they were made for."""

import numpy as np
import pytest

from aoro_gym.machine.parameters import Machine
from aoro_gym.terrains import Path, Plane, Terrain
from aoro_gym.terrains.paths.planning import (
    HALF_WHEELBASE,
    JOINT_RANGE_DEG,
    PIECE,
    SHARPNESS,
    TRACK,
    TURNING_RADIUS,
    WIDTH,
    DrivableGround,
    drivable_ground,
    drivable_path,
    turning_radius,
)

SIZE, CELL = (57.0, 103.0), 0.5


def grid() -> tuple[np.ndarray, np.ndarray]:
    """x and y of the nodes, each (rows, columns)."""
    x, y = (np.arange(0.0, size + CELL / 2, CELL) for size in SIZE)
    return np.meshgrid(x, y)


def waves(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    return 2.0 * np.sin(x / 8.0) * np.cos(y / 8.0) + 0.1 * x


@pytest.fixture(scope="module")
def boulders() -> np.ndarray:
    """(K, 2) middles on nodes."""
    rng = np.random.default_rng(4)
    return np.round(rng.uniform([4.0, 4.0], [53.0, 99.0], (45, 2)) / CELL) * CELL


@pytest.fixture(scope="module")
def rolling(boulders) -> Terrain:
    """Waves of up to 19° with boulders of one cell around."""
    x, y = grid()
    z = waves(x, y)
    for bx, by in boulders:
        z[np.abs(x - bx) + np.abs(y - by) < 0.1] += 0.6
    return Terrain.from_heights(z, cell=CELL)


@pytest.fixture(scope="module")
def ground(rolling) -> DrivableGround:
    return drivable_ground(rolling)


@pytest.fixture(scope="module", params=range(4))
def path(ground, request) -> Path:
    return ground.path(request.param, length=100.0)


def test_turning_radius_of_equal_halves():
    for angle in (5.0, 20.0, 40.0):
        assert turning_radius(angle, 2.0, 2.0) == pytest.approx(2.0 / np.tan(np.radians(angle) / 2.0))
    # the shorter half steers wider: its axle's line meets the other's farther out
    assert turning_radius(30.0, 1.0, 2.0) == turning_radius(30.0, 2.0, 1.0) > turning_radius(30.0, 1.5, 1.5)


def test_vehicle_is_the_machine():
    machine = Machine.load("aoro_datasheet")
    assert machine.frame.front.axle_distance == machine.frame.rear.axle_distance == HALF_WHEELBASE
    assert np.degrees(machine.joint.range) == pytest.approx(JOINT_RANGE_DEG)
    assert machine.frame.track == TRACK
    assert machine.frame.track + 2.0 * machine.tire.disc_offset_outer <= WIDTH
    assert turning_radius(JOINT_RANGE_DEG) * 1.4 < TURNING_RADIUS < turning_radius(JOINT_RANGE_DEG) * 1.6


def test_curvature_is_bounded_and_continuous(path):
    assert path.length == pytest.approx(100.0, rel=1e-3)  # chords of arcs
    assert np.abs(path.curvatures).max() <= 1.0 / TURNING_RADIUS + 1e-6
    rate = np.abs(np.diff(path.curvatures)) / np.diff(path.stations)
    assert rate.max() <= SHARPNESS * (1.0 + 1e-4)
    assert np.abs(path.curvatures).max() > 0.5 / TURNING_RADIUS  # winds
    assert np.abs(path.curvature(np.linspace(0.0, PIECE - 0.5))).max() < 1e-6  # straight where the vehicle is put


def test_keeps_clear_of_boulders_and_edges(path, boulders):
    swept = WIDTH / 2 + np.hypot(TURNING_RADIUS, HALF_WHEELBASE) - TURNING_RADIUS + 0.3
    every = path.position(np.linspace(0.0, path.length, 2000))
    apart = np.linalg.norm(every[:, None] - boulders, axis=2).min()
    assert apart > swept  # a boulder is as wide as its cells, which more than makes up for the grid's coarseness
    edge = min(every.min(), (SIZE - every).min())
    assert edge > 3.5 - CELL


def test_slopes_stay_within_limits(path, ground):
    s = np.linspace(0.0, path.length, 1000)
    middle, heading = path.position(s), path.heading(s)
    ahead = np.stack([np.cos(heading), np.sin(heading)], axis=1)
    left = np.stack([-np.sin(heading), np.cos(heading)], axis=1)

    def rise(direction: np.ndarray, reach: float) -> np.ndarray:
        front, back = waves(*(middle + reach * direction).T), waves(*(middle - reach * direction).T)
        return np.abs(front - back) / (2.0 * reach)

    # either foot is looked up within half a diagonal of the grid, on ground as steep as 0.4
    slack = 0.4 * np.sqrt(0.5) * 0.25
    assert rise(ahead, HALF_WHEELBASE).max() < np.tan(np.radians(15.0)) + slack / HALF_WHEELBASE
    assert rise(left, TRACK / 2).max() < np.tan(np.radians(10.0)) + slack / (TRACK / 2)
    assert not ground.passable(*middle.T, heading + np.pi / 2).all()  # another heading would not do


def test_same_seed_same_path(rolling, ground):
    one = ground.path(5, length=60.0)
    np.testing.assert_array_equal(drivable_path(rolling, 5, length=60.0).points, one.points)
    assert not np.array_equal(ground.path(6, length=60.0).points[:50], one.points[:50])


def test_trees_are_kept_clear_of(rolling):
    rng = np.random.default_rng(1)
    trees = np.column_stack([rng.uniform([0, 0], SIZE, (25, 2)), np.full(25, 0.2)])
    path = drivable_path(rolling, 2, length=60.0, obstacles=trees)
    apart = np.linalg.norm(path.points[:, None] - trees[:, :2], axis=2).min()
    # half a node either way for the path and for the tree
    assert apart > WIDTH / 2 + np.hypot(TURNING_RADIUS, HALF_WHEELBASE) - TURNING_RADIUS + 0.3 - 0.25 * np.sqrt(2)


def test_holes_are_edges():
    x, _ = grid()
    z = np.zeros_like(x)
    z[100:120, 40:70] = np.nan
    path = drivable_path(Terrain.from_heights(z, cell=CELL), 0, length=150.0)
    outside = np.maximum(np.abs(path.points - [27.25, 54.75]) - [7.25, 4.75], 0.0)
    assert np.hypot(*outside.T).min() > 3.5 - CELL


def test_on_a_plane():
    path = drivable_path(Plane(), 3, length=200.0)
    assert path.length == pytest.approx(200.0, rel=1e-3)
    assert np.abs(path.points).max() <= 46.5
    # across a slope of 14° the vehicle leans too much: it keeps within 45° of the line of fall
    steep = drivable_path(Plane(slope_deg=14.0, direction_deg=90.0), 0, length=40.0)
    across = np.tan(np.radians(14.0)) * np.cos(steep.headings)
    assert np.abs(across).max() <= np.tan(np.radians(10.0)) + 1e-6


def test_says_why_there_is_none():
    with pytest.raises(ValueError, match=r"no drivable path of 60 m .* 0% is open .*slope 100%.*relax max_slope_deg"):
        drivable_path(Plane(slope_deg=25.0))
    small = Terrain.from_heights(np.zeros((20, 20)), cell=1.0)
    with pytest.raises(ValueError, match=r"the longest has \d+ m.*edge and holes"):
        drivable_path(small, length=500.0)
    rng = np.random.default_rng(0)
    with pytest.raises(ValueError, match=r"0% is open.*obstacles 100%"):
        drivable_path(Terrain.from_heights(rng.uniform(0, 1, (60, 60)), cell=0.5))


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        (
            {"turning_radius": 3.0},
            r"turning_radius is 3 m, but must be in \[4\.6\d+, 1000\] m: the joint's 40° turns no tighter",
        ),
        ({"max_slope_deg": 60.0}, r"max_slope_deg is 60 deg, but must be in \[0.1, 45\]"),
        ({"max_cross_slope_deg": 0.0}, "max_cross_slope_deg is 0"),
        ({"obstacle_height": np.nan}, "obstacle_height is nan"),
        ({"clearance": -1.0}, "clearance is -1"),
        ({"margin": -1.0}, "margin is -1"),
        ({"length": 1.0}, r"path length is 1 m, but must be in \[6, 10000\]"),
        ({"obstacles": [[1.0, 2.0]]}, r"obstacles have the shape \(1, 2\); give \(K, 3\)"),
    ],
)
def test_refuses(wrong, message):
    with pytest.raises(ValueError, match=message):
        drivable_path(Plane(), **wrong)


def test_refuses_many_planes():
    with pytest.raises(ValueError, match="one slope a twin has no one path"):
        drivable_path(Plane(slope_deg=np.array([1.0, 2.0])))
    with pytest.raises(ValueError, match="joint_angle_deg is 90"):
        turning_radius(90.0)
