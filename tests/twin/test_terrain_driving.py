"""Driving on terrain: no edges felt, turning radius, climbing and tipping limits, and no divergence without a name."""

import numpy as np
import pytest
from scipy.optimize import root_scalar

from aoro_gym.terrains.plane import Plane
from aoro_gym.terrains.terrain import Terrain
from aoro_gym.twin.records import State
from aoro_gym.twin.twin import STATUS, Twin
from tests.oracles.bodies import BodyModel
from tests.twin.landscapes import AVERAGED, MIDDLE, inclined, landscape, rough
from tests.twin.rig import drive, states
from tests.twin.test_terrain_stance import AT, PARKED, centred, contacts, poses, weight


# -------------------------------------------------------------------------------------------------------------- no edges
def heaving(twin, **pose) -> np.ndarray:
    """Vertical acceleration of the hinge [m/s²] (steps, twins) over 4 s of driving, after 4 s of getting there."""
    twin.reset(**pose)
    twin.step({"drive_signal": 0.6}, 4.0)
    record = []
    for _ in range(400):
        twin.step({}, 0.01)
        record.append(twin.state.numpy()[State.AVZ].copy())
    return np.array(record)


@pytest.mark.parametrize("kind", AVERAGED)
def test_wheels_feel_no_edges_on_a_triangulated_plane(machine, kind):
    """Up a plane of 4° in triangles of 1 m: the heave is that on the analytic plane. Heights out of float32 rays, or
    interpolated, are good to 8 roundings of 40 m, 20 µm; on four tires of 450 kN/m that shakes 10 t by 4 mm/s². A single
    edge of 2° is felt."""
    noise = 8.0 * 2.0**-24 * 2.0 * MIDDLE * 4.0 * machine.tire.stiffness / machine.mass
    slope = np.radians(4.0)
    smooth = heaving(Twin(1, machine=machine, terrain=Plane(slope_deg=4.0)))
    cut = heaving(Twin(1, machine=machine, terrain=inclined(slope), ground=kind), position=(10.0, MIDDLE))
    assert np.abs(cut - smooth).max() < noise
    edge = landscape(lambda x, y: np.tan(slope) * x + np.radians(2.0) * np.maximum(x + 6.0, 0.0) + 0.0 * y)
    felt = heaving(Twin(1, machine=machine, terrain=edge, ground=kind), position=(10.0, MIDDLE))
    assert np.abs(felt - smooth).max() > 10.0 * noise


# --------------------------------------------------------------------------------------------------------------- turning
@pytest.mark.parametrize("kind", AVERAGED)
def test_steady_turning_radius(machine, kind):
    """At walking pace, all wheels roll about one centre, where the axles' lines meet: the front axle at
    (l_r + l_f cos θ)/sin θ from it. 2 %, as slip angles of rolling resistance and centripetal force (below 1 % of the
    load, over the tires' stiffness) turn each axle by no more."""
    angle = np.radians([10.0, 20.0, 35.0, -20.0])
    twin = Twin(4, machine=machine, terrain=inclined(0.0), ground=kind)
    twin.reset(position=[(MIDDLE, 8.0), (MIDDLE, 12.0), AT, (MIDDLE, 30.0)], joint_angle=angle)
    log = drive(twin, (6.0, {"drive_signal": 0.3}), (2.0, {}), sample_every=0.1)
    last = slice(-15, None)
    arm = log.wheels("arm_angle")[last].mean(axis=0)
    reach = machine.arm.length * (np.cos(arm) - 1.0)
    front = machine.frame.front.axle_distance + reach[:2].mean(axis=0)
    rear = machine.frame.rear.axle_distance + reach[2:].mean(axis=0)
    joint = log["joint_angle"][last].mean(axis=0)
    expected = (rear + front * np.cos(joint)) / np.sin(joint)
    radius = log["speed"][last].mean(axis=0) / log["yaw_rate"][last].mean(axis=0)
    assert np.all(log["speed"][-1] > 0.2)
    np.testing.assert_allclose(radius, expected, rtol=0.02)


# ------------------------------------------------------------------------------------------------------- steps and walls
@pytest.mark.parametrize("kind", AVERAGED)
def test_a_step_is_climbed_and_a_wall_stops(machine, kind):
    """At full speed against a step of 10 cm and a wall of 3 m: over the one; at the other the hull's four front corners
    take the impact, no harder than all their springs take all the kinetic energy, v √(k m), and the machine stays before
    it. A wheel's force grows over the 40 cm of its patch, no further than its own spring takes the same energy."""
    walls = [landscape(lambda x, y, h=h: h * (x > 0.0) + 0.0 * y) for h in (0.1, 3.0)]
    twin = Twin(2, machine=machine, terrain=walls, ground=kind)
    twin.reset(position=(8.0, MIDDLE), terrain=(0, 1))
    log = drive(twin, (9.0, {"drive_signal": 1.0, "gear": 3}), sample_every=0.005)
    assert log["position_x"][-1, 0] > MIDDLE + 3.0
    assert log["position_z"][-1, 0] == pytest.approx(0.1, abs=0.02)
    front = machine.frame.front
    reach = front.axle_distance - front.cog_offset + 0.5 * front.hull_length
    assert log["position_x"][:, 1].max() < MIDDLE - 0.8 * reach
    fastest = log["speed"].max()
    assert fastest > 2.0
    assert 0.1 < log["hull_force"][:, 1].max() / (fastest * np.sqrt(4.0 * machine.hull.stiffness * machine.mass)) < 1.0
    assert log["hull_force"][:, 0].max() == 0.0
    assert log.wheels("wheel_load").max() < fastest * np.sqrt(machine.tire.stiffness * machine.mass)


# --------------------------------------------------------------------------------------------------------------- climbing
def front_share(machine, slope: float) -> float:
    """Share of a front wheel in the load normal to the ground, uphill, by the lever rule."""
    twin = Twin(1, machine=machine)
    pose = poses(states(twin))[0]
    normal = np.array([0.0, 0.0, 1.0])
    points = contacts(machine, pose, normal)
    front, rear = points[:2, 0].mean(), points[2:, 0].mean()
    centre = BodyModel(machine).center_of_mass(pose)
    height = centre[2] - points[:, 2].mean()
    return 0.5 * (centre[0] - height * np.tan(slope) - rear) / (front - rear)


def climbing_limit(machine, friction: float) -> float:
    """Slope [rad] that four motors on one pressure climb: each pulls what the lightest wheel, a front one, can hold."""
    rolling = machine.tire.rolling_resistance

    def surplus(slope: float) -> float:
        return 4.0 * friction * front_share(machine, slope) - rolling - np.tan(slope)

    return float(root_scalar(surplus, bracket=(0.0, 0.5)).root)


def test_climbing_ends_where_the_light_wheels_spin(machine):
    """On slippery ground the open differential gives all wheels the pull of the front ones, which the slope unloads: below
    the limit with kinetic friction the machine drives up, above the one with static friction the front wheels spin and it
    does not get on. 5 % of slope on either side for the brakes' drag, the bent tires and the front wheels' own slip."""
    grip = 0.25
    tire = machine.tire
    lower = 0.95 * climbing_limit(machine, grip * tire.friction_coulomb)
    upper = 1.05 * climbing_limit(machine, grip * tire.friction_static)
    assert lower < upper < 0.2
    slopes = [inclined(lower, friction=grip), inclined(upper, friction=grip)]
    twin = Twin(2, machine=machine, terrain=slopes)
    twin.reset(position=(8.0, MIDDLE), terrain=(0, 1))
    log = drive(twin, (15.0, {"drive_signal": 0.3}), sample_every=0.5)
    gained = log["position_x"][-1] - log["position_x"][-11]
    rolled = log.wheels("wheel_rate")[-11:, :2].mean(axis=(0, 1)) * tire.radius * 5.0
    assert gained[0] > 0.9 * rolled[0] > 1.0
    assert gained[1] < 0.5 * rolled[1]


# ---------------------------------------------------------------------------------------------------------------- tipping
def tipping_angle(machine) -> float:
    """Sideways slope [rad] on which the upper wheels come off: the CoG stands plumb over the lower contacts. The frames,
    and the contacts with them, lean further than the ground by the lower tires' deflection over the track."""
    twin = Twin(1, machine=machine)
    pose = poses(states(twin))[0]
    points = contacts(machine, pose, np.array([0.0, 0.0, 1.0]))
    height = BodyModel(machine).center_of_mass(pose)[2] - points[:, 2].mean()
    half = 0.5 * machine.frame.track

    def surplus(slope: float) -> float:
        lean = 0.5 * weight(machine) * np.cos(slope) / machine.tire.stiffness / machine.frame.track
        return np.arctan(half / height) - lean - slope

    return float(root_scalar(surplus, bracket=(0.1, 1.2)).root)


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_tipping_sideways(machine, side):
    """On grippy slopes across, 1.5° less steep than the closed form it stands for 10 s on its upper wheels, 1.5° steeper it
    goes over. The closed form takes the mean of both axles: the lighter one's wheel lifts half a degree earlier, and the
    last degree is within reach of the start's own swing, 2 % of the weight at 1 m over half the track."""
    machine = centred(machine)
    limit = tipping_angle(machine)
    terrains = [
        inclined(limit + np.radians(offset), direction=side * np.pi / 2.0, friction=2.0) for offset in (-1.5, 1.5)
    ]
    twin = Twin(2, machine=machine, terrain=terrains)
    twin.reset(position=AT, terrain=(0, 1))
    log = drive(twin, (10.0, PARKED), sample_every=0.05)
    upper = log.wheels("wheel_load")[:, [0, 2]] if side > 0 else log.wheels("wheel_load")[:, [1, 3]]
    assert upper[-1, :, 0].max() > 0.0
    lean = np.abs(log["roll"])
    assert np.ptp(lean[:, 0]) < np.radians(5.0)
    assert lean[:, 1].max() > np.radians(75.0)
    assert not twin.diverged  # on its side, on the hull


# --------------------------------------------------------------------------------------------------------- random driving
@pytest.mark.slow
def test_random_driving_loses_nothing_without_a_name(machine):
    """64 twins for 30 s on rough ground, half of them steeper than machines should go, with commands at random: all
    outputs stay finite, what diverges is named, and no twin is where it cannot be."""
    rng = np.random.default_rng(11)
    terrains = [rough(seed, bumps=bumps, hills=hills) for seed, bumps, hills in ((1, 0.05, 0.1), (2, 0.2, 0.25))]
    count = 64
    twin = Twin(count, machine=machine, terrain=terrains)
    twin.reset(
        position=rng.uniform(10.0, 30.0, (count, 2)),
        heading=rng.uniform(-np.pi, np.pi, count),
        joint_angle=rng.uniform(-0.6, 0.6, count),
        terrain=np.arange(count) % 2,
    )
    names = ("steering_signal", "drive_signal", "arm_fl", "arm_fr", "arm_rl", "arm_rr")
    for _ in range(30):
        commands = {name: rng.uniform(-1.0, 1.0, count) for name in names}
        trace = twin.step({**commands, "gear": rng.integers(1, 4, count)}, 1.0, sample_every=0.1)
        assert trace is not None
        assert np.all(np.isfinite(trace.samples))
    frozen = np.flatnonzero(twin.status)
    assert [(index, STATUS[int(twin.status[index])]) for index in frozen] == twin.diverged
    assert len(frozen) == 0
    assert np.all(np.isfinite(twin.state.numpy()))
    height = twin.output("position_z")
    low, high = (np.array([bound[2] for bound in ends]) for ends in zip(*(t.extent for t in terrains), strict=True))
    assert np.all(height > low[np.arange(count) % 2] - 3.0)
    assert np.all(height < high[np.arange(count) % 2] + 3.0)
    assert np.abs(twin.output("roll")[1::2]).max() > np.radians(20.0)


def test_a_broken_twin_is_named_and_its_neighbours_drive_on(machine):
    """A state that is not a number: that twin is frozen with its reason, the query of the ground survives it."""
    for kind in AVERAGED:
        twin = Twin(3, machine=machine, terrain=rough(1, bumps=0.05, hills=0.1), ground=kind)
        twin.reset(position=AT)
        state = twin.state.numpy().copy()
        state[State.X, 1] = np.nan
        twin.state.assign(state)
        twin.step({"drive_signal": 0.5}, 1.0)
        assert twin.diverged == [(1, "non-finite state")]
        assert np.all(np.isfinite(twin.state.numpy()[:, [0, 2]]))


def test_a_terrain_of_one_triangle_is_ground(machine):
    """The smallest terrain."""
    triangle = Terrain(
        vertices=np.array([[0.0, 0.0, 1.0], [9.0, 0.0, 1.0], [0.0, 9.0, 1.0]]), faces=np.array([[0, 1, 2]])
    )
    for kind in AVERAGED:
        twin = Twin(1, machine=machine, terrain=triangle, ground=kind)
        twin.reset(position=(3.0, 3.0))
        twin.step(PARKED, 0.1)
        assert twin.output("position_z")[0] == pytest.approx(1.0, abs=1e-3)
