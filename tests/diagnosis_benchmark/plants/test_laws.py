"""The plants' laws against closed forms."""

from pathlib import Path

import numpy as np
import pytest

from aoro_gym.diagnosis_benchmark import plants
from aoro_gym.diagnosis_benchmark.plants.bodies import FRONT, PITCH, REAR, ROLL, Bodies, X, Y, Z
from aoro_gym.diagnosis_benchmark.plants.circuits import (
    PORT_A,
    RETURN,
    SLOW_SHARE,
    SUPPLY,
    VALVES,
    WALLS,
    Chebyshev,
    Circuits,
)
from aoro_gym.diagnosis_benchmark.plants.constants import constants_of
from aoro_gym.diagnosis_benchmark.plants.fluid import ATMOSPHERE, Oil, check_valve, orifice, viscosity
from aoro_gym.diagnosis_benchmark.plants.friction import CREEP, brown_mcphee, dahl, makkar, prandtl_force
from aoro_gym.diagnosis_benchmark.plants.linkage import Linkage, SteeringCylinders
from aoro_gym.diagnosis_benchmark.plants.plant import STAGES, delay
from aoro_gym.diagnosis_benchmark.plants.tires import NOMINAL_LOAD, PARKING, Tires


@pytest.fixture(scope="module")
def constants(machine):
    return constants_of([machine.entries])


# ---------------------------------------------------------------------------------------------------------------- oil
def test_an_orifice_is_turbulent_above_its_laminar_drop_and_linear_below():
    flow = orifice(2e-6, np.array([4e5, 1e5, 0.5e5, -0.5e5]), 1e5)
    assert flow == pytest.approx([2e-6 * np.sqrt(4e5), 2e-6 * np.sqrt(1e5), 1e-6 * np.sqrt(1e5), -1e-6 * np.sqrt(1e5)])
    assert check_valve(2e-6, np.array([0.3e5, -5e5]), 0.3e5, 1e5) == pytest.approx([0.0, 0.0])


@pytest.mark.parametrize("level", [0, 1])
def test_compressing_oil_with_air_follows_its_volume(constants, level):
    """∫ dp/β from 0 to p is the logarithm of the volumes' ratio, where no air dissolves (below 1 % of p_c, say)."""
    share = np.array([0.02])
    oil = Oil({**constants, "oil.bulk_modulus_slope": np.zeros(1)}, level, share)
    pressures = np.linspace(0.0, 0.3e5, 20001)[:, None]
    shrunk = np.trapezoid(oil.compressibility(pressures)[:, 0], pressures[:, 0])
    end, n, beta = pressures[-1, 0], constants["oil.polytropic_exponent"][0], constants["oil.bulk_modulus"][0]
    gas = share[0] * (ATMOSPHERE / (ATMOSPHERE + end)) ** (1.0 / n)
    liquid = (1.0 - share[0]) * (np.exp(-end / beta) if level else 1.0)
    # level 0 leaves out of the volume, level 1 out of the air's amount, what is at most 1 % of either's share here
    allowed = (1.0 - share[0]) * end / beta * share[0] if level == 0 else 0.0
    dissolved = 3.0 * (end / 30e5) ** 2 * share[0] if level else 0.0
    exact = -np.log(gas + liquid) if level else -np.log(gas + liquid * np.exp(-end / beta))
    assert shrunk == pytest.approx(exact, abs=1e-9 + allowed + dissolved)


def test_air_is_found_that_gives_a_modulus(constants):
    for level in (0, 1):
        share = Oil(constants, level).air_for(4e8, 10e5)
        assert 1.0 / Oil(constants, level, share).compressibility(np.array([10e5])) == pytest.approx(4e8, rel=1e-12)
        assert 0.0 < share[0] < 0.05


def test_dissolved_air_leaves_the_liquid(constants):
    oil = Oil(constants, 1, np.array([0.03]))
    assert 1.0 / oil.compressibility(np.array([50e5])) == pytest.approx(oil.liquid_modulus(50e5), rel=1e-12)


def test_viscosity_passes_the_data_sheet_s_points():
    assert viscosity(np.array([30.0, 75.0])) == pytest.approx([80e-6, 12e-6])
    assert viscosity(40.0) == pytest.approx(46e-6, rel=0.03)  # VG 46 is 46 ± 10 %


# ----------------------------------------------------------------------------------------------------------- friction
def test_brown_and_mcphee_break_away_at_the_static_level():
    speeds = np.linspace(0.0, 0.1, 100001)
    force = -brown_mcphee(speeds, 300.0, 400.0)
    assert force.max() == pytest.approx(400.0, rel=2e-3)  # tanh 4 is 0.9993
    assert speeds[np.argmax(force)] == pytest.approx(CREEP, rel=0.05)
    assert force[-1] == pytest.approx(300.0, rel=2e-3)
    assert brown_mcphee(np.array([-0.05]), 300.0, 400.0) == pytest.approx(-brown_mcphee(np.array([0.05]), 300.0, 400.0))


def test_makkar_s_law_breaks_away_at_the_static_level():
    speeds = np.linspace(0.0, 0.2, 200001)
    force = -makkar(speeds, 300.0, 400.0)
    assert force.max() == pytest.approx(300.0 + 0.87 * 100.0, rel=2e-3)
    assert speeds[np.argmax(force)] == pytest.approx(1.1 * CREEP, rel=0.05)
    assert force[-1] == pytest.approx(300.0, rel=2e-3)
    assert makkar(np.array([-0.05]), 300.0, 400.0) == pytest.approx(-makkar(np.array([0.05]), 300.0, 400.0))


def test_sticking_friction_is_a_spring_up_to_its_capacity():
    stretch = np.array([1e-4, 1.0, -1.0])
    assert prandtl_force(stretch, np.zeros(3), 1e6, 1e3, 200.0) == pytest.approx([-100.0, -200.0, 200.0])
    share = dahl(np.zeros(1), np.array([1e-3]), np.array([500.0]))
    assert share == pytest.approx(1.0 - np.exp(-0.5))
    in_two = dahl(dahl(np.zeros(1), np.array([4e-4]), np.array([500.0])), np.array([6e-4]), np.array([500.0]))
    assert in_two == pytest.approx(share)


# ------------------------------------------------------------------------------------------------------------ linkage
def test_the_stroke_spans_the_range(constants):
    p = "steering.cylinder."
    reach = constants["joint.range"]
    link = Linkage(constants[p + "dead_length"], constants[p + "stroke"], constants[p + "mount_ratio"], reach)
    assert link.length(-reach) == pytest.approx(constants[p + "dead_length"])
    assert link.length(reach) == pytest.approx(constants[p + "dead_length"] + constants[p + "stroke"])


def test_levers_are_the_derivatives_of_lengths_and_volumes(constants):
    cylinders, step = SteeringCylinders(constants), 1e-5
    for angle in (-0.6, 0.0, 0.45):
        at, before, after = (cylinders.at(np.array([angle + d])) for d in (0.0, -step, step))
        for volume, slope, curve in (("volume_a", "slope_a", "curve_a"), ("volume_b", "slope_b", "curve_b")):
            change = (getattr(after, volume) - getattr(before, volume)) / (2.0 * step)
            assert getattr(at, slope) == pytest.approx(change, rel=1e-7)
            bend = (getattr(after, slope) - getattr(before, slope)) / (2.0 * step)
            assert getattr(at, curve) == pytest.approx(bend, rel=1e-6)


def test_a_full_turn_takes_both_cylinders_oil(constants):
    cylinders, reach = SteeringCylinders(constants), constants["joint.range"]
    oil = cylinders.at(reach).volume_a - cylinders.at(-reach).volume_a
    assert oil == pytest.approx(2.3311e-3, rel=1e-4)  # published bore, rod and stroke


# --------------------------------------------------------------------------------------------------------- integrator
@pytest.mark.parametrize("stages", [2, 4, 5])
def test_chebyshev_is_of_second_order_and_stable_to_its_bound(stages):
    first, rest, _ = Chebyshev(stages).steps()

    def amplification(z):
        older, newer = np.ones_like(z), 1.0 + first * z
        for constant, mu, nu, slope, back in rest:
            older, newer = newer, constant + mu * newer + nu * older + slope * z * newer + back * z
        return newer

    z = -np.logspace(-3, -2, 5)
    error = np.abs(amplification(z) - np.exp(z))
    order = np.diff(np.log(error)) / np.diff(np.log(-z))
    assert order == pytest.approx(3.0, abs=0.02)  # of a step's error: one more than of the method
    bound = 0.65 * (stages**2 - 1.0)
    assert np.abs(amplification(-np.linspace(0.0, bound, 400))).max() <= 1.0 + 1e-12


def still(circuits, y, duration, steps, angle=0.0):
    """State after ``duration`` [s] with frames, wheels and commands at rest."""
    zero = np.zeros(circuits.runs)
    wheels = np.zeros((4, circuits.runs))
    return circuits.advance(y, zero, zero + angle, zero, wheels, zero, zero, duration, steps)[0]


def test_a_volume_discharges_through_an_orifice_as_its_closed_form(constants):
    """Turbulent: √Δp falls as a straight line, d√Δp/dt = −C/(2 C_h)."""
    p = {**constants, "oil.bulk_modulus_slope": np.zeros(1), "steering.cylinder.leakage": np.zeros(1)}
    p = {**p, "steering.valve.leakage": np.zeros(1), "steering.valve.cross_orifice": np.array([1e-8])}
    circuits = Circuits(p, 0, STAGES)
    y = circuits.at_rest(np.zeros(1))
    y[PORT_A] = 150e5
    y[[PORT_A + 1, RETURN]] = 50e5  # so that no suction valve opens
    circuits.volume[PORT_A + 1] = 1.0  # a large vessel: its pressure stays
    after = still(circuits, y.copy(), 2e-3, 40)
    at = circuits.cylinders.at(np.zeros(1))
    capacity = (circuits.volume[PORT_A] + at.volume_a) / p["oil.bulk_modulus"] + circuits.wall[PORT_A]
    root = np.sqrt(100e5) - 1e-8 / (2.0 * capacity) * 2e-3
    assert np.sqrt(after[PORT_A] - 50e5) == pytest.approx(root, rel=1e-5)


def test_turning_against_shut_ports_compresses_their_oil(constants):
    p = {**constants, "oil.bulk_modulus_slope": np.zeros(1), "steering.cylinder.leakage": np.zeros(1)}
    p = {**p, "steering.valve.leakage": np.zeros(1)}
    circuits, rate, duration = Circuits(p, 0, STAGES), -0.05, 0.02
    y = circuits.at_rest(np.zeros(1))
    y[PORT_A] = y[PORT_A + 1] = 100e5
    zero = np.zeros(1)
    after, _ = circuits.advance(y, zero, zero, zero + rate, np.zeros((4, 1)), zero, zero, duration, 40)
    # V(1/β) dp = −dV, walls yield by C_w dp: ∫ dp = −ΔV/(V̄/β + C_w); second order in ΔV/V, here 0.3 %
    start, end = circuits.cylinders.at(zero), circuits.cylinders.at(zero + rate * duration)
    middle = circuits.volume[PORT_A] + 0.5 * (start.volume_a + end.volume_a)
    rise = (start.volume_a - end.volume_a) / (middle / p["oil.bulk_modulus"] + circuits.wall[PORT_A])
    assert after[PORT_A] - 100e5 == pytest.approx(rise, rel=1e-4)


def test_idle_circuits_stay_at_rest(constants):
    """No pressure moves by more than leaks of a tenth of a second can explain."""
    circuits = Circuits(constants, 0, STAGES)
    y = circuits.at_rest(np.zeros(1))
    after = still(circuits, y.copy(), 0.05, 400)
    assert after[SUPPLY] == pytest.approx(y[SUPPLY], rel=1e-3)
    assert after[4:11] == pytest.approx(y[4:11], rel=1e-3)


# ------------------------------------------------------------------------------------------------------ bodies, tires
def test_the_mass_matrix_is_that_of_two_bodies(constants):
    """Kinetic energy from point velocities of both frames, by finite differences of their places."""
    bodies = Bodies(constants, Oil(constants, 0))
    rng = np.random.default_rng(1)
    bodies.position[:] = rng.uniform(-0.4, 0.4, (7, 1)) * np.array([1, 1, 1, 1, 0, 0, 0])[:, None]
    u = rng.uniform(-1.0, 1.0, (7, 1))
    factor = bodies.mass_factor()[..., 0]
    energy = 0.5 * np.sum((factor.T @ u[:, 0]) ** 2)
    expected = 0.0
    for half, row in ((bodies.front, FRONT), (bodies.rear, REAR)):
        heading = bodies.position[row, 0]
        turn = np.array([[np.cos(heading), -np.sin(heading), 0], [np.sin(heading), np.cos(heading), 0], [0, 0, 1]])
        place = turn @ np.array([half.reach[0], 0.0, half.height[0]])
        rate = np.array([u[ROLL, 0], u[PITCH, 0], u[row, 0]])
        velocity = np.array([u[X, 0], u[Y, 0], u[Z, 0]]) + np.cross(rate, place)
        own = np.array([[half.roll[0], 0, half.product[0]], [0, half.pitch[0], 0], [half.product[0], 0, half.yaw[0]]])
        local = turn.T @ rate
        expected += 0.5 * half.mass[0] * velocity @ velocity + 0.5 * local @ own @ local
    assert energy == pytest.approx(expected, rel=1e-12)
    force = rng.uniform(-1.0, 1.0, (7, 1))
    matrix = factor @ factor.T
    assert matrix @ bodies.solve(factor[..., None], force)[:, 0] == pytest.approx(force[:, 0])


def test_tires_bear_the_machine_in_balance(constants, machine):
    bodies = Bodies(constants, Oil(constants, 0))
    bodies.stand(np.array([0.6]))
    load = bodies.loads(np.zeros((7, 1)))
    assert load.sum() == pytest.approx(9.81 * machine.mass, rel=1e-3)
    # in balance to a thousandth of what one wheel's moment is
    assert np.abs((bodies.weight() + bodies.lift(load))[Z:]).max() < 1e-3 * NOMINAL_LOAD


def test_level_frames_carry_the_design_loads(constants, machine):
    bodies = Bodies(constants, Oil(constants, 0))
    bodies.stand(np.zeros(1))
    rest = machine.rest
    loads = [rest.wheel_load_front] * 2 + [rest.wheel_load_rear] * 2
    assert bodies.loads(np.zeros((7, 1)))[:, 0] == pytest.approx(loads, rel=1e-6)


@pytest.mark.parametrize("level", [0, 2, 3])
def test_a_sliding_tire_resists_by_its_friction(constants, level):
    """Steady sliding: N g(v), with the viscous part; the patch's bristles all slide alike."""
    tires, speed = Tires(constants, level), 0.5
    zero = np.zeros((4, 1))
    tires.advance(zero, zero + speed, zero, zero, 5.0)  # bristles settle within g/(σ₀ v), 0.2 s
    _, lateral, torque = tires.forces(zero + NOMINAL_LOAD, zero, zero + speed, zero, zero)
    sticking = constants["tire.friction_coulomb" if level == 3 else "tire.friction_static"]
    grip = constants["tire.friction_coulomb"] + (sticking - constants["tire.friction_coulomb"]) * np.exp(
        -((speed / constants["tire.stribeck_velocity"]) ** 2)
    )
    expected = -NOMINAL_LOAD * (grip + constants["tire.sigma2_lateral"] * speed)
    assert lateral[:, 0] == pytest.approx(expected[0], rel=1e-9)
    assert torque[:, 0] == pytest.approx(0.0, abs=1e-6)


def test_a_standing_tire_of_level_3_resists_swivelling_up_to_its_torque(constants):
    tires = Tires(constants, 3)
    zero = np.zeros((4, 1))
    for angle, share in ((0.1, 1.0 - np.exp(-1.0)), (0.9, 1.0 - np.exp(-10.0))):  # scrub angle 0.1 rad
        tires.advance(zero, zero, zero + angle, zero, 1.0)
        torque = tires.forces(zero + NOMINAL_LOAD, zero, zero, zero, zero)[2]
        assert torque[:, 0] == pytest.approx(-share * PARKING)


def test_a_hose_in_halves_gives_way_at_once_and_late(constants):
    """Pressed by a flow into its valve's end, cylinders and valve shut, it takes in what oil and all of the wall do once the
    wall has settled."""
    circuits = Circuits(constants, 3, STAGES)
    start = circuits.at_rest(np.zeros(1))
    state, stretch, zero = start.copy(), np.zeros(1), np.zeros(1)
    state[VALVES] += 1e3  # a charge into both ends, small as the modulus of oil with air rises with pressure
    for _ in range(300):
        state, stretch = circuits.advance(state, stretch, zero, zero, np.zeros((4, 1)), zero, zero, 1e-3, 4)
    fast = circuits.hose_volume * circuits.oil.compressibility(start[VALVES]) + 0.6 * circuits.hose_wall
    middle = circuits.cylinders.at(zero)
    chambers = np.stack([middle.volume_a, middle.volume_b]) + circuits.volume[PORT_A:RETURN]
    end = chambers * circuits.oil.compressibility(start[PORT_A:RETURN]) + circuits.wall[PORT_A:RETURN]
    rise = fast * 1e3 / (fast + 0.4 * circuits.hose_wall + end)
    # leaks of cylinders and valve take a little in 0.3 s
    assert state[PORT_A:RETURN] - start[PORT_A:RETURN] == pytest.approx(rise, rel=0.05)
    assert state[VALVES] == pytest.approx(state[PORT_A:RETURN], rel=1e-3)
    assert state[WALLS] == pytest.approx(SLOW_SHARE * circuits.hose_wall * state[VALVES], rel=1e-3)


def test_a_patch_that_rolls_sheds_its_swivel_torque(constants):
    tires = Tires(constants, 2)
    zero = np.zeros((4, 1))
    for _ in range(100):
        tires.advance(zero, zero, zero + 0.0035, zero, 1.0)
    standing = tires.forces(zero + NOMINAL_LOAD, zero, zero, zero, zero)[2]
    tires.advance(zero, zero, zero, zero + 1.0, 1.0)  # a metre straight on
    rolled = tires.forces(zero + NOMINAL_LOAD, zero, zero, zero, zero)[2]
    assert np.all(standing < -500.0)
    assert np.all(np.abs(rolled) < 0.1 * np.abs(standing))  # exp(−1 m / 0.4 m)


# --------------------------------------------------------------------------------------------------------------- delay
def test_a_dead_time_shifts_the_signal_and_nothing_else():
    signal = np.zeros((50, 3))
    signal[10:] = 1.0
    late = delay(signal, np.array([0.0, 0.0075, 0.02]), 1e-3)
    arrival = 0.5e-3 * np.argmax(late > 1e-9, axis=0)
    assert arrival == pytest.approx([0.010, 0.0175, 0.030])
    assert late[:, 0] == pytest.approx(np.repeat(signal[:, 0], 2))
    between = delay(signal, np.array([0.00725] * 3), 1e-3)  # within a half step its mean passes
    assert between[34] == pytest.approx(0.5)


# -------------------------------------------------------------------------------------------------------- independence
def test_plants_share_no_law_with_the_twin():
    """Of the package they see the format of the machine file, and nothing that steps."""
    folder = Path(plants.__file__).parent
    seen = {
        line.split()[1]
        for file in folder.glob("*.py")
        for line in file.read_text(encoding="utf-8").splitlines()
        if line.startswith(("from aoro_gym", "import aoro_gym"))
    }
    outside = {name for name in seen if not name.startswith("aoro_gym.diagnosis_benchmark.plants")}
    assert outside == {"aoro_gym.machine.machine_file"}
