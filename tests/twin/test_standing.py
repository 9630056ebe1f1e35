"""Standing still: the start, parking brakes on slopes, the limit of friction, the disc brake's own hold, drop-tight arms."""

import numpy as np
import pytest

from aoro_gym.terrains.plane import Plane
from aoro_gym.twin.records import WHEELS, State
from aoro_gym.twin.twin import Twin
from tests.twin.rig import Log, drive, states

DIRECTIONS = np.arange(0.0, 360.0, 45.0)
"""Of ascent [deg]: 0 stands uphill, 180 downhill, 90 and 270 sideways."""
SETTLE = 60.0
"""Time [s] to settle. Across the slope the joint folds by half a degree, as fast as oil leaks past its pistons, until
the tires hold it."""
GRAVITY = 9.81


def positions(log: Log):
    """Hinge in the world [m], (frames, 3, twins)."""
    return np.stack([log[f"position_{axis}"] for axis in "xyz"], axis=1)


def moved(log: Log):
    """Distance [m] (twins,) between first and last frame."""
    path = positions(log)
    return np.linalg.norm(path[-1] - path[0], axis=0)


def parked(machine, slope):
    """Twins in all ``DIRECTIONS`` on a slope [deg], parked and settled, with the log of that."""
    twin = Twin(len(DIRECTIONS), machine=machine, terrain=Plane(slope_deg=slope, direction_deg=DIRECTIONS))
    log = drive(twin, (SETTLE, {"parking_brake": 1.0}), sample_every=1.0)
    assert not twin.diverged
    return twin, log


# ------------------------------------------------------------------------------------------------------------ the start
ANGLES = np.radians(np.linspace(-35.0, 35.0, 8))
"""Of the joint at a reset [rad]; none is zero, where everything is symmetric."""


def rounding(machine):
    """What float32 leaves of an equilibrium: heights of the wheels [m], loads [N] by the tires' springs.

    A quaternion turns by its last digit, over the wheelbase; eight of them for a pose that is the sum of Newton steps, and
    twice that way, as what is out of balance is released and a spring overshoots by what it was released from.
    """
    height = 2.0 * 8.0 * float(np.finfo(np.float32).eps) * machine.frame.wheelbase
    return height, machine.tire.stiffness * height


@pytest.mark.parametrize(("slope", "direction"), [(0.0, 0.0), (3.0, 0.0), (3.0, 90.0), (15.0, 180.0)])
def test_a_reset_is_an_equilibrium(machine, slope, direction):
    """Parked from the start at any joint angle, on tires of several stiffnesses: what moves or changes its pressure within
    a second is rounding. The joint's bearing is stiff enough to hold it on all of these slopes."""
    machine = machine.scale(
        {"tire.stiffness": np.linspace(0.6, 1.4, len(ANGLES)), "joint.friction_torque": np.full(len(ANGLES), 20.0)}
    )
    twin = Twin(len(ANGLES), machine=machine, terrain=Plane(slope_deg=slope, direction_deg=direction))
    twin.reset(joint_angle=ANGLES, position=(3.0, -2.0), heading=0.4)
    start = states(twin)
    log = drive(twin, (1.0, {"parking_brake": 1.0}), sample_every=1e-2)
    height, load = (np.max(bound) for bound in rounding(machine))
    lever = machine.arm.length
    begin = positions(log)[0]
    assert np.all(np.abs(begin - start[State.X : State.Z + 1]) < height)
    assert np.all(np.abs(positions(log) - begin) < height)
    for name in ("roll", "pitch", "joint_angle"):
        assert np.all(np.ptp(log[name], axis=0) < height / (0.5 * machine.frame.track)), name
    assert np.all(np.ptp(log.wheels("arm_angle"), axis=0) < height / lever)
    assert np.all(np.ptp(log.wheels("wheel_load"), axis=0) < load)
    # oil: what turns an arm by a load at its end, and the joint by one at the wheels
    cylinder = machine.arm.cylinder
    arm_lever = cylinder.linkage.lever(-log.wheels("arm_angle")[0]).min()
    assert np.all(np.ptp(log.wheels("arm_pressure_bore"), axis=0) < load * lever / (arm_lever * cylinder.bore_area))
    steering = machine.steering.cylinder
    displacement = (steering.bore_area + steering.annulus_area) * steering.linkage.lever(np.abs(ANGLES)).min()
    for port in ("pressure_a", "pressure_b"):
        assert np.all(np.ptp(log[port], axis=0) < load * machine.frame.wheelbase / displacement), port


def test_where_friction_does_not_hold_the_joint_its_oil_does(machine):
    """Across a slope of 15° a bent machine's rear half pulls more than the joint's bearing and seals bear. The oil's
    pressure holds the rest from the start; it leaks, so it falls, and the joint folds no faster than the leak at the
    start's pressure lets it."""
    twin = Twin(len(ANGLES), machine=machine, terrain=Plane(slope_deg=15.0, direction_deg=30.0))
    twin.reset(joint_angle=ANGLES)
    log = drive(twin, (1.0, {"parking_brake": 1.0}), sample_every=1e-2)
    back = machine.steering.tank_line.back_pressure
    valve, cylinder = machine.steering.valve, machine.steering.cylinder
    loaded = np.maximum(log["pressure_a"], log["pressure_b"])
    assert np.any(loaded[0] > back + 10e5)
    assert np.any(np.isclose(loaded[0], back))
    assert np.all(loaded[-1] <= loaded[0])
    leak = (2.0 * cylinder.leakage + valve.leakage) * (loaded[0] - back)
    displacement = cylinder.bore_area * cylinder.linkage.lever(np.abs(ANGLES))
    height, _ = rounding(machine)
    assert np.all(np.ptp(log["joint_angle"], axis=0) < leak * log.time[-1] / displacement + height)


@pytest.mark.slow
def test_parking_brakes_hold_on_twenty_degrees(machine):
    """Up, down, across and between: less than a millimetre in a minute."""
    twin, settling = parked(machine, 20.0)
    log = drive(twin, (60.0, {}), sample_every=1.0)
    assert np.all(moved(settling.then(log)) < 1e-3)
    # it is a slope: the wheels below carry more, and the parking brakes are needed
    front, rear = log.wheels("wheel_load")[-1, :2].sum(axis=0), log.wheels("wheel_load")[-1, 2:].sum(axis=0)
    assert rear[0] > 1.5 * front[0]
    assert front[4] > 1.2 * rear[4]
    free = Twin(1, machine=machine, terrain=Plane(slope_deg=20.0))
    assert moved(drive(free, (60.0, {}), sample_every=1.0))[0] > 1.0


# ------------------------------------------------------------------------------------------------------------- friction
SLOPE = 17.0
MARGIN = 0.05


@pytest.fixture(scope="module")
def nudged(machine):
    """State of machines settled on grip and given a nudge of 1 mm/s downhill.

    The nudge matters: a bristle that is bent beyond what slippery ground can hold lets go once it moves.
    """
    twin, _ = parked(machine, SLOPE)
    state = twin.state.numpy()
    heading = np.radians(DIRECTIONS)
    state[State.VX] -= 1e-3 * np.cos(heading)
    state[State.VY] -= 1e-3 * np.sin(heading)
    return state


def on_ice(machine, state, margin: float, duration: float):
    """Friction with a ``margin`` over the slope's, and the log of machines that are put on such ice."""
    friction = np.tan(np.radians(SLOPE)) / machine.tire.friction_static * (1.0 + margin)
    icy = Twin(
        len(DIRECTIONS),
        machine=machine,
        terrain=Plane(slope_deg=SLOPE, direction_deg=DIRECTIONS, friction=friction),
    )
    icy.set_commands({"parking_brake": 1.0})
    icy.state.assign(state)
    return friction, drive(icy, (duration, {}), sample_every=0.5)


def test_holds_below_the_friction_angle(machine, nudged):
    """5 % of grip to spare: it stays within a fraction of what its bristles bend before they let go, 20 mm and more."""
    friction, log = on_ice(machine, nudged, MARGIN, 20.0)
    stiffness = max(machine.tire.sigma0_longitudinal, machine.tire.sigma0_lateral)
    assert np.all(moved(log) < 0.25 * friction * machine.tire.friction_static / stiffness)


@pytest.mark.slow
def test_slides_above_the_friction_angle(machine, nudged):
    """5 % of grip missing: it goes, up to the speed at which Coulomb and viscous friction balance the slope.

    The speed is approached with the time constant 1/(σ₂ g cos α), 5 s along and 11 s across: 75 s leave 0.1 %.
    """
    friction, log = on_ice(machine, nudged, -MARGIN, 75.0)
    assert np.all(moved(log) > 50.0)
    path = positions(log)
    speed = np.linalg.norm(path[-1] - path[-3], axis=0) / (log.time[-1] - log.time[-3])
    excess = np.tan(np.radians(SLOPE)) - friction * machine.tire.friction_coulomb
    along, across = [0, 4], [2, 6]
    assert speed[along] == pytest.approx(excess / machine.tire.sigma2_longitudinal, rel=5e-3)
    assert speed[across] == pytest.approx(excess / machine.tire.sigma2_lateral, rel=2e-2)


# ------------------------------------------------------------------------------------------------------------ the disc
def test_disc_brake_holds_its_share_of_slope(machine):
    """With the pump at zero and no parking brake, the disc holds up to m g sin α = 4 T/r, about 1.4°; steeper, the
    machine creeps against the loop's leaks. Across the slope the wheels do not matter."""
    tire, brake = machine.tire, machine.driveline.brake
    limit = np.degrees(np.arcsin(4.0 * brake.disc_torque / tire.radius / (machine.mass * GRAVITY)))
    assert limit == pytest.approx(1.4, abs=0.1)
    slope = np.array([0.95, 0.95, 1.05, 1.05, 1.05]) * limit
    direction = np.array([0.0, 180.0, 0.0, 180.0, 90.0])
    twin = Twin(5, machine=machine, terrain=Plane(slope_deg=slope, direction_deg=direction))
    settling = drive(twin, (20.0, {}), sample_every=1.0)
    crept = moved(settling.then(drive(twin, (60.0, {}), sample_every=1.0)))
    assert np.all(crept[[0, 1, 4]] < 1e-3)
    assert np.all(crept[[2, 3]] > 2e-3)


# ------------------------------------------------------------------------------------------------------------- the arms
@pytest.mark.slow
def test_arms_are_drop_tight(machine):
    """Valves shut for ten minutes: less than a millimetre of sink at the wheels; so, too, with no seal to hold it."""
    keys = ("arm.cylinder.seal_preload", "arm.cylinder.seal_pressure_coefficient")
    twin = Twin(2, machine=machine.scale(dict.fromkeys(keys, np.array([1.0, 0.0]))))
    start = drive(twin, (10.0, {}), sample_every=10.0)
    log = start.then(drive(twin, (600.0, {}), sample_every=60.0))
    assert np.all(machine.arm.length * np.ptp(log.wheels("arm_angle"), axis=0) < 1e-3)
    assert np.all(np.ptp(log["position_z"], axis=0) < 1e-3)
    # the second carries itself on oil alone: the bore's pressure is there
    assert all(log[f"arm_pressure_bore_{wheel}"][-1, 1] > 50e5 for wheel in WHEELS)
