"""The planar machine: power balance, modes against closed forms, its integrator, and its first tenth of a second."""

import numpy as np
import pytest

from aoro_gym import Machine
from aoro_gym.machine.laws import FAMILIES, OPTIONS
from aoro_gym.units import GRAVITY
from aoro_gym.validation.theory import hydraulics as module
from aoro_gym.validation.theory.circuit import chambers, hydraulic_frequency, modulus
from aoro_gym.validation.theory.half import joint_inertia
from aoro_gym.validation.theory.planar import LINEAR, Planar, oil_mode
from aoro_gym.validation.theory.states import (
    BRISTLE,
    COMPENSATOR,
    HINGE,
    HOSE_FLOW_A,
    JOINT_BRISTLE,
    LIMITS,
    LS,
    PHI,
    PORT_A,
    PORT_B,
    PUMP_VALVE,
    RATE,
    RETURN,
    ROLL,
    ROLL_RATE,
    SCALES,
    SPOOL,
    SPOOL_RATE,
    STATES,
    SUPPLY,
    SWASH,
    TWIST,
)

LOSSLESS = {
    "joint.friction_torque": 0.0,
    "steering.cylinder.seal_preload": 0.0,
    "steering.cylinder.seal_pressure_coefficient": 0.0,
    "steering.cylinder.seal_viscous": 0.0,
    "steering.cylinder.leakage": 0.0,
    "steering.valve.leakage": 0.0,
    "driveline.brake.disc_torque": 0.0,
    "tire.rolling_resistance": 0.0,
    "tire.sigma1_lateral": 0.0,
    "tire.sigma2_lateral": 0.0,
    "tire.damping": 0.0,
}
"""Parameters without which nothing dissipates but the valve."""


@pytest.fixture(scope="module")
def lossless(machine):
    return machine.set(LOSSLESS, check_ranges=False)


def _energy(planar, x):
    """Energy [J] of one half: its motion, and the springs of its tires."""
    half, rate, hinge, roll = planar.half, x[RATE], x[HINGE], x[ROLL_RATE]
    m11, m12, m22, m13, m23, m33 = half.mass_matrix(x[PHI])
    moving = 0.5 * (m11 * rate**2 + m22 * hinge**2 + m33 * roll**2)
    moving = moving + m12 * rate * hinge + m13 * rate * roll + m23 * hinge * roll
    tires = 0.5 * half.load * planar.machine.tire.sigma0_lateral * x[BRISTLE] ** 2
    return moving + tires + 0.5 * half.roll_stiffness * np.cos(x[PHI]) ** 2 * x[ROLL] ** 2


def test_bodies_neither_make_nor_lose_energy(lossless):
    """dE/dt along the motion, shut empty ports and tires that do not slide. Upright: the roll's spring turns with φ."""
    planar = Planar(lossless, np.zeros(5), without=[["tire grip"]] * 5)
    x = np.zeros((len(STATES), 5))
    rng = np.random.default_rng(3)
    x[PHI] = rng.uniform(-0.3, 0.3, 5)
    for state, size in ((RATE, 0.4), (HINGE, 0.5), (BRISTLE, 0.02), (ROLL_RATE, 0.1)):
        x[state] = size * rng.standard_normal(5)
    rise = planar.derivative(x, 0.0)
    step = 1e-6
    power = (_energy(planar, x + step * rise) - _energy(planar, x - step * rise)) / (2.0 * step)
    spring = planar.half.load * planar.machine.tire.sigma0_lateral * x[BRISTLE] * rise[BRISTLE]
    assert np.abs(spring).min() > 1.0
    np.testing.assert_allclose(power, 0.0, atol=1e-6 * float(np.abs(spring).max()))


def test_shut_columns_swing_at_the_hydraulic_frequency(lossless):
    """Valve in its dead band, tires and roll left out: eigenvalues of ports, joint and hinge are ± i ω_n and zeros."""
    planar, angle = Planar(lossless, 0.05), np.radians(-20.0)
    a, x = planar.linearised(angle)
    ports = chambers(lossless, angle)
    compliance = [
        volume / modulus(lossless, x[port]) + lossless.steering.hose_compliance
        for volume, port in ((ports.volume_a, PORT_A), (ports.volume_b, PORT_B))
    ]
    expected = hydraulic_frequency(ports, compliance[0], compliance[1], joint_inertia(planar.half, angle)[0])
    places = [LINEAR.index(state) for state in (PORT_A, PORT_B, RATE, HINGE)]
    poles = np.linalg.eigvals(a[0][np.ix_(places, places)])
    assert np.abs(poles.imag).max() == pytest.approx(expected[0], rel=1e-6)
    assert np.abs(poles.real).max() < 1e-6 * expected[0]


def test_a_series_spring_softens_the_oil(lossless):
    stiff, soft = Planar(lossless, 0.05), Planar(lossless.set({"joint.compliance": 2e-7}), 0.05)
    places = [LINEAR.index(state) for state in (PORT_A, PORT_B, RATE, HINGE)]
    squares = []
    for planar in (stiff, soft):
        a, _ = planar.linearised(-0.35)
        squares.append(np.abs(np.linalg.eigvals(a[0][np.ix_(places, places)]).imag).max() ** 2)
    spring = squares[0] * joint_inertia(stiff.half, -0.35)[0]
    assert squares[1] / squares[0] == pytest.approx(1.0 / (1.0 + 2e-7 * spring), rel=1e-6)


def test_a_slow_compensator_takes_the_damping_of_the_oil():
    """Load sensing answers a rising load late; a slow compensator lets that through as flow that rises with pressure."""
    lag = {"steering.valve.compensator_time_constant": np.array([0.001, 0.01, 0.03])}
    for name in ("aoro", "aoro_datasheet"):
        frequency, damping = oil_mode(Planar(Machine.load(name).set(lag), 1.0), np.radians(-20.0))
        assert np.all(np.diff(damping) < 0.0)
        assert damping[0] > 0.0 > damping[1]
        assert np.all((frequency > 25.0) & (frequency < 50.0))


def test_rest_is_an_equilibrium_on_level_ground_and_on_a_slope(machine):
    planar = Planar(machine, 1.0, np.array([0.0, 0.004, -0.004]))
    x = planar.rest()
    rise = planar.derivative(x, 0.0)
    loads = {PORT_A: 1e5, PORT_B: 1e5, RETURN: 1e5, SUPPLY: 1e6, SPOOL: 1e-9, ROLL: 1e-12, PHI: 1e-12, BRISTLE: 1e-12}
    for state, bound in loads.items():
        assert np.abs(rise[state]).max() < bound, STATES[state]
    held = float(planar.half.mass) * GRAVITY * 0.004
    # dry friction, taken as viscous at standstill, holds nothing there: the joint's torque is what it has to hold
    assert np.abs(rise[HINGE] * planar.half.mass)[1:].max() < 1.5 * held
    assert np.sign(x[BRISTLE]).tolist() == [0.0, -1.0, 1.0]


@pytest.mark.slow
def test_halving_the_step_changes_nothing_seen(monkeypatch):
    """The command's edge falls within a step, so that all of the motion is as late as that at most."""
    step, machine = module.STEP, Machine.load("aoro")
    time, coarse = Planar(machine, 1.0).turn(0.05)
    monkeypatch.setattr(module, "STEP", 0.5 * step)
    _, fine = Planar(machine, 1.0).turn(0.05)
    for state in (SUPPLY, PORT_A, RATE):
        fastest = np.abs(np.diff(fine[:, state, 0])).max() / (time[1] - time[0])
        assert np.abs(coarse - fine)[:, state].max() < step * fastest, STATES[state]


def test_limits_cap_the_pressure(machine):
    low = machine.set({"steering.pump.cutoff": 60.0}, check_ranges=False)
    planar = Planar(low, np.ones(2), without=[[], ["cut-off"]])
    _, states = planar.turn(0.08)
    top = states[:, SUPPLY].max(axis=0)
    reach = low.steering.pump.control_band
    assert top[0] < 60e5 + 3.0 * reach < top[1]
    assert set(LIMITS) >= {"cut-off", "shock valves", "anti-cavitation valves"}


@pytest.mark.parametrize("family", FAMILIES)
def test_the_steady_turn_of_every_family_is_an_equilibrium_of_its_circuit(family):
    """Of all that the flow balance knows; port B and the return line miss what leaks there, at most 3e-4 of the flow."""
    machine = Machine.load("aoro").with_laws(family)
    planar = Planar(machine, np.array([1.0, 0.6]))
    x, turn = planar.steady(-0.4)
    rise = planar.derivative(x, planar.level) / SCALES[:, None]
    known = [SUPPLY, LS, SWASH, COMPENSATOR, SPOOL, SPOOL_RATE, PUMP_VALVE]
    assert np.abs(rise[known]).max() < 1e-6
    leaks = 3e-4 * turn.flow * (modulus(machine, 1e6) / 1e-4 / SCALES[PORT_A])
    assert np.all(np.abs(rise[[PORT_A, PORT_B, RETURN]]) < leaks)
    np.testing.assert_allclose(planar.circuit.balanced(x), turn.compensator, atol=1e-6)
    assert (x[HOSE_FLOW_A].max() > 0.0) == (family == "valve_maker")


def test_tires_resist_swivelling_by_their_law(machine):
    """A patch that slides as a whole at the bore torque; discs in proportion to a small twist, at most at their grip, and
    more so by a scrub radius over the mean distance of the five from the middle."""
    tire = machine.tire
    torques = {}
    for swivel in ("five_discs", "bore_torque"):
        planar = Planar(machine.with_laws(swivel=swivel), np.ones(3))
        x = np.zeros((len(STATES), 3))
        x[TWIST] = [1e-6, 2e-6, 1e3]
        torques[swivel] = planar._swivel(x, np.zeros(3))[1]
        assert torques[swivel][1] == pytest.approx(2.0 * torques[swivel][0], rel=1e-12)
    load = 0.5 * float(Planar(machine, 1.0).half.load)
    assert torques["bore_torque"][2] == pytest.approx(2.0 * tire.friction_coulomb * load * tire.bore_radius)
    assert torques["bore_torque"][0] == pytest.approx(2.0 * tire.bore_stiffness * 1e-6)
    depth = load / tire.stiffness
    shares = np.array([depth - tire.disc_drop_inner, depth - tire.disc_drop_outer]) / (
        depth + 2.0 * (2.0 * depth - tire.disc_drop_inner - tire.disc_drop_outer)
    )
    levers = np.array([tire.disc_offset_inner, tire.disc_offset_outer])
    stiffness = 2.0 * load * 2.0 * tire.sigma0_longitudinal * (shares @ levers**2)
    assert torques["five_discs"][0] == pytest.approx(stiffness * 1e-6, rel=1e-9)
    assert torques["five_discs"][2] == pytest.approx(4.0 * load * tire.friction_static * (shares @ levers), rel=1e-9)
    scrubbing = Planar(machine.set({"tire.scrub_radius": 0.05}).with_laws(swivel="five_discs"), np.ones(3))
    factor = 1.0 + 0.05 / np.mean([0.0, *levers, *levers])
    np.testing.assert_allclose(scrubbing._swivel(x, np.zeros(3))[1], factor * torques["five_discs"], rtol=1e-12)


def test_a_relaxing_tire_has_a_slip_stiffness_and_slides_at_its_grip(machine):
    """ż = u − |v_r| z/ℓ rests at z = u ℓ/|v_r|."""
    planar = Planar(machine.with_laws(slip="relaxation"), np.ones(1))
    x, out = np.zeros((len(STATES), 1)), np.zeros((len(STATES), 1))
    x[RATE], slip = 0.3, np.array([1e-3])
    x[BRISTLE] = 1e-3 * machine.tire.relaxation_lateral / (0.3 * planar.half.half_track)
    force = planar._lateral(x, slip, out)
    assert out[BRISTLE] == pytest.approx(0.0, abs=1e-15)
    assert force == pytest.approx(machine.tire.sigma0_lateral * x[BRISTLE], rel=1e-12)
    x[BRISTLE] = 1.0
    x[HINGE] = 0.0
    most = planar._tire_grip(planar.half.axle * x[RATE])
    assert planar._bounded(x.copy())[BRISTLE] == pytest.approx(most / machine.tire.sigma0_lateral)


@pytest.mark.parametrize("law", OPTIONS["friction"])
def test_dry_friction_slides_at_its_capacity_by_every_law(machine, law):
    planar = Planar(machine.with_laws(friction=law), np.ones(2))
    x, out = np.zeros((len(STATES), 2)), np.zeros((len(STATES), 2))
    ports, rate = chambers(machine, np.zeros(2)), np.array([0.2, -0.2])
    grip = planar._grip(x, ports, rate)
    x[JOINT_BRISTLE] = np.sign(rate) * grip / machine.joint.presliding_stiffness
    np.testing.assert_allclose(planar._friction(x, ports, rate, out), np.sign(rate) * grip, rtol=1e-9)
