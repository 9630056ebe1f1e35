"""Twins among the solid objects of worlds: forces, energy and momentum, climbing, the broad phase, and bad input."""

# pyright: reportInvalidTypeForm=false, reportGeneralTypeIssues=false, reportCallIssue=false, reportArgumentType=false
import pickle

import numpy as np
import pytest
import warp as wp
from scipy.optimize import brentq

from aoro_gym.machine import Machine
from aoro_gym.terrains.generate.world import world
from aoro_gym.terrains.terrain import Terrain
from aoro_gym.terrains.world.objects import Boulder, Branch, Log, Stump, Tree, along, upright
from aoro_gym.terrains.world.world import World
from aoro_gym.twin import Twin
from aoro_gym.twin.hub_driven import HubDrivenTwin
from aoro_gym.twin.kernels.solids import Objects, next_object, search
from aoro_gym.twin.objects import WOOD_FRICTION, WorldObjects
from aoro_gym.twin.records import CHANNELS, OBJECT_PARTS, WHEELS, State
from aoro_gym.units import GRAVITY
from tests.oracles.bodies import BodyModel
from tests.twin.rig import states
from tests.twin.test_conservation import generalised

FLAT = Terrain.from_heights(np.zeros((61, 61)), cell=1.0, corner=(-30.0, -30.0))


def log_across(x, radius):
    """A log of 4 m on the ground, across the way along x."""
    return Log((x, -2.0, radius), along((0.0, 1.0, 0.0)), "pine", 4.0, radius, radius, 2.0 * radius, 0)


def tree(x, y, diameter=0.3):
    return Tree((x, y, 0.0), upright(), "pine", diameter, 15.0, 8.0, 1.5, 1)


def moved(twin, **values):
    """Set rows of all twins' states."""
    state = twin.state.numpy()
    for row, value in values.items():
        state[State[row]] = value
    twin.state.assign(state)


def object_forces(trace):
    """(frames, parts, 3, twins) [N] in float64."""
    return np.stack(
        [np.stack([trace[f"object_force_{axis}_{part}"] for axis in "xyz"], axis=1) for part in OBJECT_PARTS], axis=1
    ).astype(float)


@pytest.fixture(scope="module")
def bundled():
    return Machine.load("aoro")


# forces, momentum and energy


def test_a_machine_at_rest_on_logs_stands_on_its_tires_springs(bundled):
    """Each wheel stands on a log, F·n = k (R + r − distance); all of them bear the machine; and its kinetic energy does not
    come back in ten seconds.

    Deflections of 7 cm are differences of metres in float32, exact to some 1e-6 m, 0.3 N; what still moves at 1 mm/s adds
    c v = 3 N.
    """
    front, rear = bundled.frame.front.axle_distance, -bundled.frame.rear.axle_distance
    twin = Twin(machine=bundled, terrain=World(FLAT, (log_across(front + 8.0, 0.15), log_across(rear + 8.0, 0.2))))
    twin.reset()
    moved(twin, X=8.0, Z=0.35)
    twin.step({"parking_brake": 1.0}, 12.0)
    body = BodyModel(bundled, gravity=0.0)
    kinetic = []
    for _ in range(20):
        trace = twin.step({}, 0.5, sample_every=0.5)
        kinetic.append(body.energy(*generalised(states(twin)))[0])
    assert max(kinetic[10:]) <= max(kinetic[:10]) < 1.0
    centres = body.kinematics(*generalised(states(twin))).wheel_center[:, :, 0]
    forces = object_forces(trace)[-1, :, :, 0]
    for wheel, (number, x, r) in enumerate(2 * [(1, front + 8.0, 0.15)] + 2 * [(2, rear + 8.0, 0.2)]):
        apart = centres[:, wheel] - (x, centres[1, wheel], r)
        distance = np.linalg.norm(apart)
        pressed = bundled.tire.stiffness * (bundled.tire.radius + r - distance)
        assert forces[wheel] @ apart / distance == pytest.approx(pressed, abs=5.0)
        assert trace[f"touched_object_{WHEELS[wheel]}"][-1, 0] == number
        assert trace[f"wheel_load_{WHEELS[wheel]}"][-1, 0] == 0.0
    mass = sum(one.mass for one in body.bodies)
    assert forces[:, 2].sum() == pytest.approx(mass * GRAVITY, rel=1e-3)
    assert np.abs(forces[:, :2].sum(axis=0)).max() < 20.0


def test_objects_take_momentum_and_energy_but_give_none_back(bundled):
    """A machine that flies without gravity into a tree, a boulder, a log and a leaning stump at 2 m/s: the sum of
    their forces is the change of its momentum in every step. Float32 holds 2e4 N s to 2e-3, over 600 steps."""
    objects = (
        tree(3.0, 0.3),
        Boulder((1.0, -1.9, 1.7), upright(), (0.6, 0.5, 0.7), 1.0, 3),
        Log((-2.0, 2.4, 1.4), along((1.0, -0.4, 0.1)), "pine", 6.0, 0.2, 0.15, 1.6, 0),
        Stump((2.2, 1.5, 1.1), upright(0.25, 1.0), "pine", 0.2, 0.5),
    )
    twin = Twin(machine=bundled, terrain=World(FLAT, objects), gravity=0.0)
    twin.reset(position=(-2.0, 0.0))
    moved(twin, Z=1.0, VX=2.0, VY=0.2, WZ=0.2, WX=0.05, SPIN_FL=3.0, SPIN_FR=3.0, SPIN_RL=3.0, SPIN_RR=3.0)
    body = BodyModel(bundled, gravity=0.0)
    momentum, energy, forces = [], [], []
    for _ in range(600):
        q, v = generalised(states(twin))
        momentum.append(body.linear_momentum(q, v)[:, 0])
        energy.append(body.energy(q, v)[0])
        trace = twin.step({}, 1e-3, sample_every=1e-3)
        assert trace is not None and not trace["hull_force"].any()
        assert sum(trace[f"wheel_load_{wheel}"][0, 0] for wheel in WHEELS) == 0.0
        forces.append(object_forces(trace)[0, :, :, 0])
    impulse = 1e-3 * np.cumsum(np.sum(forces, axis=1), axis=0)[:-1]
    error = np.abs(np.array(momentum)[1:] - momentum[0] - impulse)
    assert np.abs(impulse).max() > 5000.0
    assert error.max() < 0.2
    assert max(energy) < energy[0] * (1.0 + 1e-5)
    assert energy[-1] < 0.8 * energy[0]


def test_a_machine_that_drives_into_a_tree_stops(bundled):
    """Its front wheels slip, and the rear ones, whose motors hang on the same pressure, pull as much: twice the front ones'
    friction is on the stem, but for rolling resistance and what brakes and motors rub, some 5 %. Without drive it stays, and
    its energy never exceeds what it stood there with, that in the chassis' spring included."""
    branch = Branch((1.0, 0.0, 0.0), along((0, 1, 0)), "pine", 1.0, 0.05)
    twin = Twin(machine=bundled, terrain=World(FLAT, (branch, tree(5.0, 0.1))))
    twin.reset()
    trace = twin.step({"drive_signal": 0.5}, 8.0, sample_every=0.02)
    assert trace is not None
    touching = trace["touched_object_front"][:, 0] == 2
    reach = twin.machines.numpy()["frame_front"]["cog_x"][0] + 0.5 * bundled.frame.front.hull_length
    radius = 0.5 * tree(5.0, 0.1).diameter_at(1.0)
    assert trace["position_x"][np.argmax(touching), 0] == pytest.approx(5.0 - radius - reach, abs=0.03)
    assert touching[-100:].all() and np.abs(trace["speed"][-100:]).max() < 0.02
    push = -trace["object_force_x_front"][-1, 0]
    tire = bundled.tire
    slip = [trace[f"wheel_rate_{wheel}"][-1, 0] * tire.radius for wheel in WHEELS]
    assert min(slip[:2]) > 0.3 and np.abs(slip[2:]).max() < 0.02
    loads = [trace[f"wheel_load_{wheel}"][-1, 0] for wheel in WHEELS[:2]]
    grip = sum(
        load * (tire.friction_coulomb + tire.sigma2_longitudinal * v) for load, v in zip(loads, slip, strict=False)
    )
    assert push == pytest.approx(2.0 * grip, rel=0.1)
    body = BodyModel(bundled, gravity=0.0)
    before = body.energy(*generalised(states(twin)))[0] + 0.5 * push**2 / bundled.hull.stiffness
    kinetic = []
    for _ in range(50):
        twin.step({"drive_signal": 0.0}, 0.1)
        kinetic.append(body.energy(*generalised(states(twin)))[0])
    assert max(kinetic) < before and max(kinetic[-10:]) < 0.01 * before


def friction_to_climb(machine, radius, loads):
    """Multiplier of the ground's friction from which four driven wheels climb a log of ``radius`` with the front ones.

    A rigid wheel about to leave the ground stands at R over it and touches the log at the angle α from its top, cos α =
    (R − r)/(R + r − δ), with δ the tire's deflection. Rear wheels push by μ W_r; the log's friction φ = arctan μ_log lets
    the front ones bear W_f at α ≤ φ + arctan(μ W_r/W_f).
    """
    tire = machine.tire
    front, rear = loads

    def spare(factor):
        cone = np.arctan(WOOD_FRICTION * factor * tire.friction_coulomb)
        steepest = cone + np.arctan(factor * tire.friction_coulomb * rear / front)
        normal = 0.5 * front * np.cos(cone) / np.cos(steepest - cone)
        return steepest - np.arccos((tire.radius - radius) / (tire.radius + radius - normal / tire.stiffness))

    return brentq(spare, 0.05, 2.0)


def test_wheels_climb_a_log_or_do_not_as_friction_and_diameter_let_them(bundled):
    """Logs of 20 cm to 50 cm, with a fifth less and a fifth more friction than a rigid machine needs by
    :func:`friction_to_climb`: what that leaves out, rolling resistance, soft tires beside the log and load that moves to
    the rear, is less."""
    radii, x = (0.1, 0.15, 0.2, 0.25), 2.6
    twin = Twin(2 * len(radii), machine=bundled, terrain=[World(FLAT, (log_across(x, r),)) for r in radii])
    twin.reset(terrain=np.repeat(np.arange(len(radii)), 2))
    twin.step({}, 0.2)
    loads = [sum(twin.output(f"wheel_load_{wheel}")[0] for wheel in axle) for axle in (WHEELS[:2], WHEELS[2:])]
    needed = np.array([friction_to_climb(bundled, r, loads) for r in radii])
    assert (np.diff(needed) > 0.05).all()
    twin.set_ground(np.arange(2 * len(radii)), friction=np.outer(needed, (0.8, 1.2)).ravel())
    twin.step({"drive_signal": 0.25}, 12.0)
    over = twin.output("position_x") > x - bundled.frame.front.axle_distance
    assert over.tolist() == len(radii) * [False, True]


# which objects are near


@wp.kernel(enable_backward=False)
def found_kernel(
    objects: Objects, low: wp.array(dtype=wp.vec3), high: wp.array(dtype=wp.vec3), met: wp.array2d(dtype=int)
):
    i = wp.tid()
    at = search(objects.grids[0], low[i], high[i])
    while at.row <= at.last_row:
        at = next_object(objects.starts, objects.order, objects.boxes, at)
        if at.found >= 0:
            met[i, at.found] += 1


def test_the_grid_finds_every_object_whose_box_meets_a_part_once():
    """In a forest of more than 500 objects, against all pairs; boxes of parts inside, at the edges, far outside, and around
    all of it."""
    made = world(5, size=(60.0, 60.0), stumps=2000.0, boulders=800.0)
    objects = WorldObjects([made.objects], 1, gravity=GRAVITY, device="cpu")
    boxes = objects.device_struct.boxes.numpy()
    assert len(boxes) > 500
    rng = np.random.default_rng(2)
    lowest, highest = boxes["low"].min(axis=0), boxes["high"].max(axis=0)
    middle = rng.uniform(lowest - 5.0, highest + 5.0, (3000, 3))
    half = rng.uniform(0.1, 1.5, (3000, 3))
    middle[:2000] = 0.5 * (boxes["low"] + boxes["high"])[rng.integers(0, len(boxes), 2000)] + rng.normal(
        0.0, 1.0, (2000, 3)
    )
    half[:5], middle[5:9] = 200.0, [[1e9, 0, 0], [-1e9, 0, 0], [0, 1e9, 0], [0, -1e9, 0]]
    low, high = (middle - half).astype(np.float32), (middle + half).astype(np.float32)
    met = wp.zeros((len(low), len(boxes)), dtype=int, device="cpu")
    wp.launch(
        found_kernel,
        len(low),
        [objects.device_struct, *(wp.array(one, dtype=wp.vec3, device="cpu") for one in (low, high)), met],
        device="cpu",
    )
    pairs = np.all((boxes["low"] <= high[:, None]) & (low[:, None] <= boxes["high"]), axis=2)
    assert pairs[9:].sum() > 1500 and pairs[:5].all()
    np.testing.assert_array_equal(met.numpy(), pairs)


# what users meet


def test_worlds_without_solid_objects_are_terrains_to_the_bit(bundled):
    """Neither another kernel nor other outputs: branches, and trees that bend, do not count."""
    thin = (tree(3.0, 0.0, 0.04), Branch((2.0, 0.0, 0.0), along((0, 1, 0)), "pine", 2.0, 0.05))
    bare, scenery = (Twin(machine=bundled, terrain=ground) for ground in (FLAT, World(FLAT, thin)))
    assert scenery._advance_kernel is bare._advance_kernel
    assert scenery.channels == bare.channels == CHANNELS
    traces = [twin.step({"drive_signal": 0.4}, 1.0, sample_every=0.1) for twin in (bare, scenery)]
    assert traces[0].samples.tobytes() == traces[1].samples.tobytes()


def test_objects_out_of_reach_change_nothing_but_the_last_bits(bundled):
    """Another kernel may fuse other products: 1e-7 a step in 1,000 steps of a smooth motion."""
    bare, among = (Twin(machine=bundled, terrain=ground) for ground in (FLAT, World(FLAT, (tree(20.0, 0.0),))))
    traces = [twin.step({"drive_signal": 0.4}, 1.0, sample_every=0.1) for twin in (bare, among)]
    assert len(traces[1].channels) == len(CHANNELS) + 4 * len(OBJECT_PARTS)
    for name in CHANNELS:
        spread = max(np.abs(traces[0][name]).max(), 1e-3)
        assert np.abs(traces[0][name] - traces[1][name]).max() < 1e-3 * spread, name
    assert not object_forces(traces[1]).any()


def test_a_copy_goes_on_to_the_bit_in_the_middle_of_a_contact(bundled):
    twin = Twin(2, machine=bundled, terrain=[World(FLAT, (log_across(2.6, 0.15),)), World(FLAT, (tree(3.0, 0.0),))])
    twin.reset(terrain=[0, 1])
    twin.step({"drive_signal": 0.4}, 3.0)
    assert twin.output("touched_object_fl")[0] == 1 or twin.output("touched_object_front")[1] == 1
    copy = pickle.loads(pickle.dumps(twin))
    after = [one.step({}, 1.0, sample_every=0.1) for one in (twin, copy)]
    assert after[0].samples.tobytes() == after[1].samples.tobytes()


def test_a_start_in_an_object_is_refused(bundled):
    twin = Twin(2, machine=bundled, terrain=World(FLAT, (tree(10.0, 1.0),)))
    words = (
        r"twin 1 would stand in an object: the \w+ (wheel|chassis) 0\.\d\d m deep in object 1, a tree at x = 10\.0 m"
    )
    with pytest.raises(ValueError, match=words):
        twin.reset(position=[(0.0, 0.0), (9.0, 0.5)])
    twin.reset(position=[(0.0, 0.0), (10.0, 3.0)])


@pytest.mark.parametrize(
    ("terrain", "words"), [([World(FLAT), 3], "holds a int"), ([], "is empty"), (["forest"], "holds a str")]
)
def test_what_is_no_ground_is_refused(bundled, terrain, words):
    with pytest.raises(ValueError, match=f"terrain {words}; give a Plane, a Terrain or World, or a sequence of them"):
        Twin(machine=bundled, terrain=terrain)


def test_an_unknown_channel_among_objects_is_told(bundled):
    twin = Twin(machine=bundled, terrain=World(FLAT, (tree(20.0, 0.0),)))
    assert twin.output("touched_object_rear").tolist() == [0.0]
    with pytest.raises(ValueError, match="there is no output 'touched_object_roof'"):
        twin.output("touched_object_roof")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("kind", "options"),
    [(Twin, {"ground": "mesh"}), (Twin, {"choose_laws": True}), (HubDrivenTwin, {})],
    ids=["triangles", "laws", "hubs"],
)
def test_objects_push_in_every_kernel(bundled, kind, options):
    """On triangles, with laws by choice, and with a driveline outside: a log under the front wheels bears them, and a tree
    stops a machine that rolls."""
    world = World(FLAT, (log_across(bundled.frame.front.axle_distance + 8.0, 0.15), tree(2.5, 10.0)))
    twin = kind(2, machine=bundled, terrain=world, **options)
    twin.reset()
    moved(twin, X=np.array([8.0, 0.0]), Y=np.array([0.0, 10.0]), Z=np.array([0.35, 0.01]), VX=np.array([0.0, 2.0]))
    rates = np.array([0.0, 2.0 / bundled.tire.radius])
    moved(twin, **{f"SPIN_{wheel.upper()}": rates for wheel in WHEELS})
    if kind is HubDrivenTwin:
        twin.set_hubs(np.zeros(4), 160.0)
    trace = twin.step({}, 6.0, sample_every=0.01)
    assert trace is not None and twin.diverged == []
    assert (trace["touched_object_fl"][:, 0] == 1).any() and trace["object_force_z_fl"][:, 0].max() > 1e4
    hit = trace["touched_object_front"][:, 1] == 2
    assert hit.any() and trace["object_force_x_front"][:, 1].min() < -2e4
    assert trace["speed"][np.argmax(hit) + 100 :, 1].max() < 0.5
