"""Standing on terrain: at rest from the first step, loads by the lever rule, wheels in the air, the belly on a mound."""

import numpy as np
import pytest

from aoro_gym.terrains.plane import Plane
from aoro_gym.twin.records import WHEELS, State
from aoro_gym.twin.twin import Twin
from tests.oracles.bodies import BodyModel
from tests.twin.landscapes import AVERAGED, MIDDLE, inclined, landscape, raised, rough
from tests.twin.rig import drive, states

GRAVITY = 9.81
PARKED = {"parking_brake": 1.0}
AT = (MIDDLE, MIDDLE)


def weight(machine) -> float:
    return GRAVITY * machine.mass


def wheel_plan(machine) -> np.ndarray:
    """Wheels around the hinge of a straight machine at its rest pose [m], (4, 2)."""
    reach = machine.arm.length * (np.cos([machine.rest.arm_angle_front, machine.rest.arm_angle_rear]) - 1.0)
    front, rear = machine.frame.front.axle_distance + reach[0], -machine.frame.rear.axle_distance - reach[1]
    side = 0.5 * machine.frame.track
    return np.array([[front, side], [front, -side], [rear, side], [rear, -side]])


def poses(state) -> np.ndarray:
    """Pose of every twin in the reference's order, (twins, 16)."""
    names = ["X", "Y", "Z", "QW", "QX", "QY", "QZ", "JOINT"]
    names += [f"{kind}_{wheel.upper()}" for kind in ("ARM", "WHEEL") for wheel in WHEELS]
    return np.array([state[State[name]] for name in names]).T


def contacts(machine, pose, normal) -> np.ndarray:
    """Where the middle discs meet the ground [m], (4, 3): at the unloaded radius, in the wheels' own planes."""
    kinematics = BodyModel(machine).kinematics(pose, np.zeros(15))
    points = []
    for wheel, half in enumerate((0, 0, 1, 1)):
        rotation = kinematics.rotation[:, :, half]
        down = -(rotation.T @ normal) * (1.0, 0.0, 1.0)
        points.append(kinematics.wheel_center[:, wheel] + machine.tire.radius * rotation @ down / np.linalg.norm(down))
    return np.array(points)


def centred(machine):
    """``machine`` whose tires touch with their middle disc only, so that the contact is where the wheel is."""
    return machine.set({"tire.disc_drop_inner": 0.05, "tire.disc_drop_outer": 0.1}, si=True)


# ------------------------------------------------------------------------------------------------------------ rest pose
@pytest.mark.parametrize("kind", AVERAGED)
def test_level_triangles_are_stood_on_like_a_plane(machine, kind):
    """Pose, arms and oil of the rest pose, wherever on the terrain, also of a machine that sinks into softer tires than
    its frames were made for; float32 keeps 1e-5 of each."""
    machine = machine.scale({"tire.stiffness": np.array([1.0, 0.6])})
    place = np.array([[MIDDLE, MIDDLE], [12.3, 27.1]])
    options = {"position": place, "heading": (0.3, -2.0)}
    on_plane, on_terrain = Twin(2, machine=machine), Twin(2, machine=machine, terrain=inclined(0.0), ground=kind)
    for twin in (on_plane, on_terrain):
        twin.reset(**options)
    expected, found = states(on_plane), states(on_terrain)
    np.testing.assert_allclose(found[: State.VX], expected[: State.VX], atol=2e-5)
    bore = slice(int(State.ARM_BORE_FL), int(State.ARM_BORE_RR) + 1)
    np.testing.assert_allclose(found[bore], expected[bore], rtol=5e-4)
    rest = [*range(int(State.SUPPLY), int(State.ARM_BORE_FL)), *range(int(State.ARM_ROD_FL), len(State))]
    np.testing.assert_array_equal(found[rest], expected[rest])


@pytest.mark.parametrize("kind", AVERAGED)
def test_a_machine_starts_at_rest_on_rough_ground(machine, kind):
    """32 random poses on bumps and hills, parked. What the stance leaves out of balance (arms far from their angles at rest,
    ground that is no plane under a wheel) is released at once, and a spring overshoots by no more than what it was
    released from: no load strays further from where it ends than it began, twice for several modes at a time.
    After 1 s nothing moves any more: 1 cm/s is what a release of 1 % of the weight leaves after half a period of the
    bristles, √(g σ₀)."""
    rng = np.random.default_rng(7)
    count = 32
    twin = Twin(count, machine=machine, terrain=rough(1, bumps=0.05, hills=0.08), ground=kind)
    twin.reset(
        position=rng.uniform(8.0, 32.0, (count, 2)),
        heading=rng.uniform(-np.pi, np.pi, count),
        joint_angle=rng.uniform(-0.6, 0.6, count),
    )
    log = drive(twin, (1.0, PARKED), sample_every=1e-3)
    assert not twin.diverged
    load = log.wheels("wheel_load")
    begun = np.abs(load[0] - load[-1]).max()
    assert np.abs(load - load[-1]).max() < 2.0 * begun
    assert begun < 0.05 * weight(machine)
    assert log["hull_force"].max() == 0.0
    assert np.abs(log["speed"][-1]).max() < 0.01
    # it is rough: arms are spread over a good part of their swing, frames tilt
    assert np.ptp(log.wheels("arm_angle")[-1], axis=0).max() > 0.15
    assert np.abs(log["roll"][-1]).max() > 0.1
    assert np.all(log["wheels_off_map"] == 0.0)


# ----------------------------------------------------------------------------------------------------------- wheel loads
@pytest.mark.parametrize("kind", AVERAGED)
@pytest.mark.parametrize("slope", [0.0, 12.0])
def test_wheel_loads_are_the_lever_rules(machine, slope, kind):
    """Uphill, downhill and across, parked for 20 s: loads sum to the weight along the ground's normal, and each axle and
    each side carries what the lever rule gives it about the other, from the CoG over the contacts. Contacts lie at the
    unloaded radius, and their friction, up to 20 % of the weight, up to 1 cm above or below their mean: 1e-3 of the weight
    over a track of 2 m. On level ground only the CoG's place counts."""
    headings = np.radians([0.0, 180.0, 90.0, -90.0])
    machine = centred(machine)
    twin = Twin(4, machine=machine, terrain=inclined(np.radians(slope)), ground=kind)
    twin.reset(position=AT, heading=headings)
    log = drive(twin, (20.0, PARKED), sample_every=20.0)
    normal = np.array([-np.sin(np.radians(slope)), 0.0, np.cos(np.radians(slope))])
    body = BodyModel(machine)
    carried = weight(machine) * normal[2]
    for case, pose in enumerate(poses(states(twin))):
        load = log.wheels("wheel_load")[-1, :, case]
        assert load.sum() == pytest.approx(carried, rel=1e-3)
        wheels = contacts(machine, pose, normal)
        centre = body.center_of_mass(pose)
        # the CoG plumb down onto the contacts' mean plane
        middle = wheels.mean(axis=0)
        centre = centre - np.array([0.0, 0.0, ((centre - middle) @ normal) / normal[2]])
        for first, second in (((0, 1), (2, 3)), ((0, 2), (1, 3))):
            way = wheels[list(first)].mean(axis=0) - wheels[list(second)].mean(axis=0)
            way -= (way @ normal) * normal
            share = (centre - wheels[list(second)].mean(axis=0)) @ way / (way @ way)
            assert load[list(first)].sum() == pytest.approx(share * carried, abs=1e-3 * carried)
    front = log.wheels("wheel_load")[-1, :2].sum(axis=0)
    left = log.wheels("wheel_load")[-1, [0, 2]].sum(axis=0)
    if slope:
        assert front[1] > front[0] + 0.1 * carried
        assert left[3] > left[2] + 0.1 * carried or left[2] > left[3] + 0.1 * carried


def test_an_arm_reaches_into_a_shallow_pit(machine):
    """A pit of 16 cm under one wheel: frames lie on the mean of the four, arms take the rest, and both diagonals carry
    half the weight as on level ground; a rigid machine of the tires' stiffness k would put k·8 cm, more than a third of the
    weight, from one on the other. 2 %: a diagonal bears 1 % more per 4 mm of warp, and the pit's rim is no plane."""
    plan = wheel_plan(machine)
    for wheel in range(4):
        pit = raised(plan[wheel], -0.16, radius=0.7)
        twin = Twin(1, machine=machine, terrain=landscape(pit))
        twin.reset(position=AT)
        log = drive(twin, (2.0, PARKED), sample_every=1e-3)
        arm = log.wheels("arm_angle")[-1, :, 0]
        diagonal = [wheel, 3 - wheel]
        other = [one for one in range(4) if one not in diagonal]
        load = log.wheels("wheel_load")[-1, :, 0]
        assert load[diagonal].sum() == pytest.approx(load[other].sum(), abs=0.02 * weight(machine))
        # warp of 16 cm: a quarter up or down at each wheel
        spread = machine.arm.length * (np.sin(arm[other]).mean() - np.sin(arm[diagonal]).mean())
        assert spread == pytest.approx(0.08, abs=0.01)


def test_a_wheel_over_a_deep_pit_hangs(machine):
    """No ground under the left front wheel for 2 m: it hangs from the start, and the other three, which is statically
    determinate, carry by moments about them, 1e-3 of the weight. A heavier tail puts the CoG inside their triangle."""
    machine = centred(machine).set({"frame.front.cog_offset": 0.6}, si=True)
    twin = Twin(1, machine=machine, terrain=landscape(raised(wheel_plan(machine)[0], -2.0, radius=1.2, shoulder=0.1)))
    twin.reset(position=AT)
    log = drive(twin, (15.0, PARKED), sample_every=1e-2)
    load = log.wheels("wheel_load")[:, :, 0]
    assert np.all(load[:, 0] == 0.0)
    assert log["arm_angle_fl"][:, 0] == pytest.approx(-machine.arm.swing, abs=0.02)
    assert load.max() < 1.5 * load[-1].max()
    assert log["hull_force"].max() == 0.0
    pose = poses(states(twin))[0]
    wheels = contacts(machine, pose, np.array([0.0, 0.0, 1.0]))[1:]
    lever = np.vstack([np.ones(3), wheels[:, :2].T])
    expected = np.linalg.solve(lever, weight(machine) * np.array([1.0, *BodyModel(machine).center_of_mass(pose)[:2]]))
    np.testing.assert_allclose(load[-1, 1:], expected, atol=1e-3 * weight(machine))


@pytest.mark.parametrize("kind", AVERAGED)
def test_a_mound_lifts_the_belly(machine, kind):
    """A table between the wheels, 10 cm higher than the belly, under the rear hull: it carries what the wheels give up,
    1e-3 of the weight. The start is no bang: nothing is pressed in, so no force exceeds that of a drop by those 10 cm,
    which is less than twice the weight plus √(2 m g k h) of all four tires."""
    rear = machine.frame.rear
    high = machine.frame.ground_clearance + 0.1
    beyond = -rear.axle_distance - rear.hull_length
    mound = landscape(lambda x, y: high * (np.abs(y) < 0.65) * (x > beyond) * (x < -0.15))
    twin = Twin(1, machine=machine.set({"frame.rear.hull_width": 0.8}, si=True), terrain=mound, ground=kind, cell=0.1)
    twin.reset(position=AT)
    log = drive(twin, (10.0, PARKED), sample_every=1e-2)
    hull, load = log["hull_force"][:, 0], log.wheels("wheel_load")[:, :, 0].sum(axis=1)
    dropped = np.sqrt(2.0 * weight(machine) * 4.0 * machine.tire.stiffness * 0.1)
    assert (hull + load).max() < 2.0 * weight(machine) + dropped
    assert hull[-1] > 0.1 * weight(machine)
    assert hull[-1] + load[-1] == pytest.approx(weight(machine), rel=1e-3)


# ---------------------------------------------------------------------------------------------------------- choosing
def test_twins_stand_on_the_terrain_they_are_put_on(machine):
    """Three terrains in one launch; a twin that is not asked keeps its own."""
    terrains = [landscape(lambda x, y, h=h: h + 0.0 * x + 0.0 * y, cell=1.0) for h in (0.0, 5.0, -3.0)]
    twin = Twin(3, machine=machine, terrain=terrains)
    twin.reset(position=AT, terrain=(0, 1, 2))
    twin.step(PARKED, 0.1)
    np.testing.assert_allclose(twin.output("position_z"), [0.0, 5.0, -3.0], atol=1e-3)
    twin.reset(np.array([True, False, False]), position=AT, terrain=2)
    twin.reset(np.array([False, True, False]), position=AT)
    twin.step({}, 0.1)
    np.testing.assert_allclose(twin.output("position_z"), [-3.0, 5.0, -3.0], atol=1e-3)


@pytest.mark.parametrize("terrain", [Plane(slope_deg=14.0), inclined(np.radians(14.0))])
def test_grip_is_changed_twin_by_twin_and_lasts(machine, terrain):
    """On a slope of 14° an icy twin slides and its neighbour stays, now and after a reset."""
    twin = Twin(2, machine=machine, terrain=terrain)
    twin.set_ground([1], friction=0.1)
    for _ in range(2):
        twin.reset(position=(0.0, 0.0) if isinstance(terrain, Plane) else AT)
        start = twin.state.numpy()[State.X].copy()
        twin.step(PARKED, 2.0)
        slid = start - twin.output("position_x")
        assert abs(slid[0]) < 0.05
        assert slid[1] > 1.0
    with pytest.raises(ValueError, match=r"indices\[\d\] is 2, but must be in \[0, 1\]"):
        twin.set_ground([2], friction=1.0)


def test_off_the_map_is_said_and_survived(machine):
    """Over the eastern edge the ground goes on level; the channel counts the wheels that are beyond it."""
    twin = Twin(3, machine=machine, terrain=inclined(0.0))
    edge = 2.0 * MIDDLE
    twin.reset(position=[[MIDDLE, MIDDLE], [edge, MIDDLE], [edge + 10.0, MIDDLE]])
    twin.step(PARKED, 1.0)
    assert twin.output("wheels_off_map").tolist() == [0.0, 2.0, 4.0]
    np.testing.assert_allclose(twin.output("position_z"), 0.0, atol=1e-3)
    assert not twin.diverged


@pytest.mark.parametrize(
    ("terrain", "asked", "message"),
    [
        (None, 0, "terrain is given, but these twins stand on a plane"),
        ([inclined(0.0)] * 2, 2, r"terrain is 2, but must be in \[0, 1\]"),
        ([inclined(0.0)] * 2, (0.0, 1.0), r"terrain has shape \(2,\) and type float64, but must be \(2,\) of integers"),
    ],
)
def test_errors_name_the_fix(machine, terrain, asked, message):
    twin = Twin(2, machine=machine, terrain=terrain)
    with pytest.raises(ValueError, match=message):
        twin.reset(terrain=asked)
