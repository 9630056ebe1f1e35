"""A load on the whole twin: statics, tip-over, sliding, energy, the joint's natural frequency; and what it leaves alone."""

import pickle

import numpy as np
import pytest
from scipy.linalg import eigh

from aoro_gym import Machine, Twin
from aoro_gym.envs.core.randomisation import Randomisation
from aoro_gym.terrains import Plane
from aoro_gym.twin.driveline import Driveline
from aoro_gym.twin.hub_driven import HubDrivenTwin
from aoro_gym.twin.records import CHANNELS, WHEELS, LoadRow, State
from tests.oracles.bodies import BodyModel
from tests.twin.rig import states
from tests.twin.test_conservation import HEIGHT, LOSSLESS, fly, generalised, oil_energy

LOADED = {"payload.count": 30.0}


@pytest.fixture(scope="module")
def bundled():
    return Machine.load("aoro")


# statics


def test_the_twin_stands_where_statics_say(bundled):
    """Loads of both axles (tests/machine/test_pile.py has their closed form), to float32's rounding of 12 t: 1e-4."""
    laden = bundled.set({"payload.count": np.array([0.0, 10.0, 30.0, 55.0])})
    twin = Twin(4, machine=laden)
    twin.step({}, 1.0)
    for wheel, load in zip(WHEELS, [laden.rest.wheel_load_front] * 2 + [laden.rest.wheel_load_rear] * 2, strict=True):
        assert twin.output(f"wheel_load_{wheel}") == pytest.approx(load, rel=1e-4)
    assert np.abs(twin.load_slide).max() < 1e-6


def tipping_slope(machine) -> np.ndarray:
    """Cross slope [deg] at which the last of the upper wheels lifts.

    All weight W then stands on the lower wheels, whose tires press in by W_r cos α/k at the rear, so that the frames lean
    by φ = asin(W_r cos α/(2 k w)) against the ground, and the CoG lies above the wheels' lowest points, where the tire's law
    has its forces act, if tan(α + φ) = w/h: half the track over the height above them.
    """
    frame, corner, arm, rest, load = machine.frame, machine.corner, machine.arm, machine.rest, machine.payload
    sines = np.sin(rest.arm_angle_front), np.sin(rest.arm_angle_rear)
    moment = frame.front.mass * frame.front.cog_height + frame.rear.mass * frame.rear.cog_height
    moment += load.mass * load.cog_height + 2.0 * corner.mass * (2.0 * arm.pivot_height + corner.rho * sum(sines))
    rear = rest.wheel_load_rear / (rest.wheel_load_front + rest.wheel_load_rear)
    axle = arm.pivot_height + arm.length * (sines[0] * (1.0 - rear) + sines[1] * rear)
    lever = np.arctan(0.5 * frame.track / (moment / machine.mass - axle + machine.tire.radius))
    slope = lever
    for _ in range(50):
        slope = lever - np.arcsin(machine.mass * 9.81 * np.cos(slope) * rear / machine.tire.stiffness / frame.track)
    return np.degrees(slope)


def test_it_tips_over_at_the_slope_of_statics(machine):
    """On a plane that is tilted by half a degree a second; thin tires, so that what they stand on does not wander.

    Expected deviation: what arms and tires lean, up to 4.5°, is 8 % more with the oil in the arms' cylinders (E: its
    stiffness at a wheel is twelve times the tire's), 0.36°; the machine follows the tilt by 0.1 s, 0.05°.
    """
    counts = np.array([0.0, 15.0, 40.0])
    thin = {"tire.disc_drop_inner": 0.30, "tire.disc_drop_outer": 0.31, "payload.slide_range": 0.0}
    laden = machine.set({"payload.count": counts, **thin}, check_ranges=False)
    twin = Twin(3, machine=laden, terrain=Plane(slope_deg=np.full(3, 28.0), direction_deg=90.0, friction=2.0))
    twin.step({"parking_brake": 1.0}, 1.0)
    slopes = np.arange(28.0, 43.0, 0.05)
    lifted = []
    for slope in slopes:
        rows = twin.ground.twins.numpy().copy()
        rows["normal"] = 0.0, -np.sin(np.radians(slope)), np.cos(np.radians(slope))
        twin.ground.twins.assign(rows)
        twin.step({}, 0.1)
        lifted.append((twin.output("wheel_load_fl") == 0.0) & (twin.output("wheel_load_rl") == 0.0))
    expected, found = tipping_slope(laden), slopes[np.argmax(lifted, axis=0)]
    assert np.all(np.diff(expected) < -2.0)
    assert found == pytest.approx(expected, abs=0.41)
    assert np.all(np.abs(np.degrees(twin.output("roll"))) > 60.0) or twin.diverged


def test_friction_holds_the_logs_up_to_its_angle(bundled):
    """Logs of μ = 0.3 along slopes either side of arctan μ = 16.7°: below they creep less than a micrometre a second, above
    they slide to the gate, which is 0.1 m away, and come to rest in its spring where friction and weight hold them: in by no
    more than m g (sin α + μ cos α)/k. Across the slope, where they press on the stakes, too, they hold in either case."""
    laden = bundled.set({**LOADED, "payload.friction": 0.3})
    slope = np.array([16.0, 17.5, 17.5])
    twin = Twin(3, machine=laden, terrain=Plane(slope_deg=slope, direction_deg=np.array([0.0, 0.0, 90.0])))
    twin.step({"parking_brake": 1.0}, 0.5)
    before = twin.load_slide
    twin.step({}, 3.0)
    after = twin.load_slide
    assert np.abs(after - before)[[0, 2]].max() < 3e-6
    assert np.abs(after)[[0, 2]].max() < laden.payload.presliding_distance
    pitch = np.radians(17.5)
    most = laden.payload.mass * 9.81 * (np.sin(pitch) + 0.3 * np.cos(pitch))
    assert -0.1 - most / laden.payload.stop_stiffness < after[1] < -0.1


# motion


def test_energy_and_momentum_with_logs_that_slide_without_friction():
    """Ten seconds of tumbling without gravity or loss: logs run into a stop of their bunk again and again, whose spring
    gives back what they take. The bounds are those of the machine alone (tests/twin/test_conservation.py); the impacts stay
    within them, with ω = √(k/m) = 29 rad/s and (ωh)²/24 = 4e-5 of what is in the springs."""
    free = {"payload.friction": 0.0, "payload.stop_damping": 0.0, "payload.slide_range": 0.05}
    laden = Machine.load("aoro_datasheet").set(LOSSLESS, si=True)
    laden = laden.set({"driveline.motor.displacement": 1e-9, **LOADED, **free}, check_ranges=False)
    found = fly(laden, 1e-3, 10.0, 200)
    load, body = laden.payload, BodyModel(laden.set({"payload.count": 0.0}, check_ranges=False), gravity=0.0)
    q, v = generalised(found)
    rate = found[LoadRow.LOAD_RATE]
    slide = found[LoadRow.LOAD_SLIDE] + 0.5e-3 * rate
    assert np.sum(np.diff(np.sign(rate)) != 0) > 10 and np.abs(slide).max() > 0.06, "into its stops"
    kin = body.kinematics(q, v)
    turned, omega = kin.rotation[:, :, 1], kin.frame_angular[:, 1]
    arm = np.einsum("ijk,jk->ik", turned, np.stack([load.cog_x + slide, 0.0 * slide, 0.0 * slide + load.cog_height]))
    velocity = kin.hinge_velocity + np.cross(omega, arm, axis=0) + turned[:, 0] * rate
    local = np.einsum("jik,jk->ik", turned, omega)
    inertia = np.array([load.inertia_xx, load.inertia_yy, load.inertia_zz])[:, None]
    spinning = np.sum(inertia * local**2, axis=0)
    beyond = np.maximum(np.abs(slide) - load.slide_range, 0.0)
    kinetic = body.energy(q, v) + 0.5 * load.mass * np.sum(velocity**2, axis=0) + 0.5 * spinning
    energy = kinetic + oil_energy(laden, found) + 0.5 * load.stop_stiffness * beyond**2
    assert np.abs(energy - energy[0]).max() < 2e-4 * kinetic[0]
    momentum = body.linear_momentum(q, v) + load.mass * velocity
    assert np.linalg.norm(momentum - momentum[:, :1], axis=0).max() < 1e-4 * np.linalg.norm(momentum[:, 0])


def joint_frequency(machine) -> float:
    """Natural frequency [rad/s] of the joint of a machine that floats, linearised: (K − ω² M) x = 0 with the float64 mass
    matrix at rest and, on joint and arms, the stiffness of shut-in oil, Σ D² / (V/β + c) over both sides."""
    oil, st, arm, rest = machine.oil, machine.steering, machine.arm, machine.rest

    def stiffness(cylinder, angle, hoses, walls, sides):
        step, total = 1e-5, 0.0
        for side in sides:
            volume, change = hoses, 0.0
            for area, sign in side:
                out = [cylinder.linkage.extension(sign * (angle + d)) for d in (0.0, step, -step)]
                reach = [one if area == cylinder.bore_area else cylinder.stroke - one for one in out]
                volume = volume + area * reach[0] + cylinder.dead_volume
                change = change + area * (reach[1] - reach[2]) / (2.0 * step)
            total += change**2 / (volume / oil.bulk_modulus + walls)
        return total

    bore, rod = st.cylinder.bore_area, st.cylinder.annulus_area
    spring = np.zeros((15, 15))
    sides = (((bore, 1.0), (rod, -1.0)), ((bore, -1.0), (rod, 1.0)))
    spring[6, 6] = stiffness(st.cylinder, 0.0, st.hose_volume, st.hose_compliance, sides)
    for wheel in range(4):
        angle = rest.arm_angle_front if wheel < 2 else rest.arm_angle_rear
        sides = (((arm.cylinder.bore_area, -1.0),), ((arm.cylinder.annulus_area, -1.0),))
        spring[7 + wheel, 7 + wheel] = stiffness(arm.cylinder, angle, arm.hose_volume, arm.hose_compliance, sides)
    q = np.zeros(16)
    q[3], q[8:10], q[10:12] = 1.0, rest.arm_angle_front, rest.arm_angle_rear
    squared, modes = eigh(spring, BodyModel(machine).mass_matrix(q))
    joint = np.argmax(np.abs(modes[6]) * (squared > 1.0))  # of the modes with a frequency, the one that bends the joint
    return float(np.sqrt(squared[joint]))


@pytest.mark.parametrize("count", [0.0, 20.0, 50.0])
def test_the_joints_natural_frequency_falls_with_the_load_as_linearised(count):
    """Of a machine that floats without gravity and losses: half a second of a milliradian, against the closed form.

    The zero crossings of 1 kHz samples, interpolated, resolve 1e-4; the leapfrog step lowers no frequency by more than
    (ωh)²/24 = 1e-4, a milliradian's change of the lever less; 3e-3 leaves room for the oil of 30 substeps.
    """
    lossless = Machine.load("aoro_datasheet").set(LOSSLESS, si=True)
    laden = lossless.set(
        {"driveline.motor.displacement": 1e-9, "payload.count": count, "payload.slide_range": 0.0}, check_ranges=False
    )
    twin = Twin(1, machine=laden, gravity=0.0)
    state = twin.state.numpy()
    state[State.Z] = HEIGHT
    state[State.JOINT_RATE] = 0.05
    state[State.PORT_A : State.PORT_B + 1] = 60e5
    bore, annulus = laden.arm.cylinder.bore_area, laden.arm.cylinder.annulus_area
    state[State.ARM_ROD_FL : State.ARM_ROD_RR + 1] = 120e5
    state[State.ARM_BORE_FL : State.ARM_BORE_RR + 1] = 120e5 * annulus / bore
    twin.state.assign(state)
    trace = twin.step({}, 0.8, sample_every=1e-3)
    angle = trace["joint_angle"][:, 0].astype(float)
    up = np.flatnonzero((angle[:-1] < 0.0) & (angle[1:] >= 0.0))
    at = up - angle[up] / (angle[up + 1] - angle[up])
    found = 2.0 * np.pi * (len(at) - 1) / (1e-3 * (at[-1] - at[0]))
    assert found == pytest.approx(joint_frequency(laden), rel=3e-3)


# what it leaves alone, and what users meet


def test_an_unloaded_machine_runs_in_its_own_kernel_and_equals_one_among_loaded_ones(bundled):
    """Another kernel may fuse other products: 1e-7 a step in 1,000 steps of a smooth motion."""
    plain, among = Twin(machine=bundled), Twin(machine=bundled, carry_load=True)
    assert plain.state.shape[0] == len(State) and among.state.shape[0] == len(State) + len(LoadRow)
    assert plain._advance_kernel is not among._advance_kernel
    traces = [
        twin.step({"drive_signal": 0.4, "steering_signal": 0.3}, 1.0, sample_every=0.1) for twin in (plain, among)
    ]
    for name in CHANNELS:
        spread = max(np.abs(traces[0][name]).max(), 1e-3)
        assert np.abs(traces[0][name] - traces[1][name]).max() < 1e-3 * spread, name


def test_a_copy_goes_on_to_the_bit_while_logs_slide(bundled):
    laden = bundled.set({**LOADED, "payload.friction": 0.2})
    twin = Twin(2, machine=laden, terrain=Plane(slope_deg=15.0))
    twin.step({"parking_brake": 1.0}, 0.3)
    assert np.all(twin.load_slide < -0.01)
    copy = pickle.loads(pickle.dumps(twin))
    for one in (twin, copy):
        one.step({"drive_signal": 0.5}, 0.5)
    assert states(twin).tobytes() == states(copy).tobytes()
    twin.reset([True, False])
    assert twin.load_slide[0] == 0.0 and twin.load_slide[1] < -0.05


def test_a_driveline_apart_turns_the_wheels_of_a_laden_machine(bundled):
    """Half a second ahead, hub by hub, as the whole twin goes; that parting them changes nothing is tested elsewhere."""
    laden = bundled.set(LOADED)
    whole, bodies, loop = Twin(machine=laden), HubDrivenTwin(machine=laden), Driveline(machine=laden)
    for twin in (whole, bodies):
        twin.reset()
    loop.set_commands({"drive_signal": 0.3})
    whole.step({"drive_signal": 0.3}, 0.5)
    for _ in range(500):
        torques, speed = loop.step(bodies.wheel_rates, bodies.pump_torque)
        bodies.set_hubs(torques, speed)
        bodies.step({}, 1e-3)
    moved = [twin.output("position_x")[0] for twin in (whole, bodies)]
    assert moved[1] == pytest.approx(moved[0], rel=0.05) and moved[0] > 0.01


def test_twins_that_carry_no_load_refuse_one(bundled):
    twin = Twin(2, machine=bundled, own_machines=True)
    with pytest.raises(ValueError, match="these twins carry no load; construct them with a machine that has logs"):
        twin.set_machines([0], bundled.set(LOADED))
    assert not Twin(machine=bundled).load_slide.any()


def test_loads_are_randomised_as_any_parameter_is(bundled):
    assert not Randomisation(machine_scale={"oil.bulk_modulus": (0.9, 1.1)}).varies_load
    spread = Randomisation(machine={"payload.count": (0.0, 40.0), "payload.density": (800.0, 950.0)})
    assert spread.varies_load
    drawn = spread.draw([np.random.default_rng(i) for i in range(8)]).apply(bundled)
    twin = Twin(8, machine=bundled, own_machines=True, carry_load=spread.varies_load)
    twin.set_machines(np.arange(8), drawn)
    twin.reset()
    twin.step({}, 0.5)
    borne = sum(twin.output(f"wheel_load_{wheel}") for wheel in WHEELS)
    assert borne == pytest.approx(9.81 * drawn.mass, rel=1e-4)
    assert np.ptp(drawn.payload.mass) > 1000.0
