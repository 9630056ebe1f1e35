"""Static laws and closed forms of the steering circuit against definitions, limits, and the twin in a steady turn."""

import numpy as np
import pytest
from scipy.interpolate import CubicHermiteSpline, PchipInterpolator

from aoro_gym import Machine, Twin
from aoro_gym.machine.laws import OPTIONS
from aoro_gym.units import ATMOSPHERIC_PRESSURE, LITRE_PER_MINUTE
from aoro_gym.validation.theory.circuit import (
    chambers,
    dry_friction,
    edge_drop,
    edge_flow,
    load_sensing_loop,
    metered_flow,
    modulus,
    opening,
    return_flow,
    return_pressure,
    steady_turn,
    turbulent,
    walls,
)
from aoro_gym.validation.theory.planar import LINEAR, Planar
from aoro_gym.validation.theory.states import SUPPLY, SWASH


def test_chambers_displace_what_their_volumes_change_by(machine):
    angle, step = np.radians([-35.0, -10.0, 20.0]), 1e-5
    at, before, after = (chambers(machine, angle + shift) for shift in (0.0, -step, step))
    np.testing.assert_allclose((after.volume_a - before.volume_a) / (2.0 * step), at.displacement_a, rtol=1e-8)
    np.testing.assert_allclose((before.volume_b - after.volume_b) / (2.0 * step), at.displacement_b, rtol=1e-8)
    reach = float(machine.joint.range)
    whole = chambers(machine, reach).volume_a - chambers(machine, -reach).volume_a
    assert whole == pytest.approx(machine.steering.full_turn_volume, rel=1e-12)


def test_an_orifice_is_linear_below_its_limit_and_a_root_above():
    assert turbulent(2.0, 4e5, 1e5) == pytest.approx(2.0 * np.sqrt(4e5))
    assert turbulent(2.0, 1e5, 1e5) == pytest.approx(2.0 * np.sqrt(1e5))
    assert turbulent(2.0, -0.5e5, 1e5) == pytest.approx(-np.sqrt(1e5))


def test_modulus_is_the_slope_of_liquid_and_gas_in_one_volume(machine):
    """−V dp/dV of the volumes themselves: liquid with a modulus that rises with pressure, air by p Vⁿ."""
    aerated = machine.set({"oil.gas_fraction": 0.01})
    oil = aerated.oil

    def volume(p):
        liquid = 0.99 * (1.0 + oil.bulk_modulus_slope * p / oil.bulk_modulus) ** (-1.0 / oil.bulk_modulus_slope)
        return liquid, 0.01 * (ATMOSPHERIC_PRESSURE / (p + ATMOSPHERIC_PRESSURE)) ** (1.0 / oil.polytropic_exponent)

    for p in (2e5, 20e5, 150e5):
        step = 1e-4 * p
        (l0, g0), (l1, g1) = volume(p - step), volume(p + step)
        # the liquid's share is kept as it is at atmospheric pressure, which a modulus of 1e9 Pa moves by p/β
        expected = -sum(volume(p)) * 2.0 * step / (l1 + g1 - l0 - g0)
        assert modulus(aerated, p) == pytest.approx(expected, rel=2.0 * p / oil.bulk_modulus + 1e-6)


def test_opening_goes_through_the_measured_points(machine):
    valve = machine.steering.valve
    volts = np.array([0.0, valve.dead_band_left, 1.0, 1.5, 2.0])
    np.testing.assert_allclose(
        opening(machine, volts / 2.0), [0.0, 0.0, valve.opening_left_1V0, valve.opening_left_1V5, 1.0], atol=1e-15
    )
    wider = machine.set({"steering.valve.overlap": 0.1})
    np.testing.assert_allclose(opening(wider, (volts + 0.1) / 2.0), opening(machine, volts / 2.0), atol=1e-12)


def test_the_compensator_holds_its_setting_over_the_edge(machine):
    even = machine.set({"steering.valve.compensator_droop": 0.0})
    valve = even.steering.valve
    edge, available = np.array([0.3, 1.0]), np.array([15e5, 30e5])
    flow, y, drop = metered_flow(even, edge, available)
    np.testing.assert_allclose(flow, edge * valve.cv_in_left * np.sqrt(valve.compensator_pressure), rtol=1e-12)
    np.testing.assert_allclose(drop, valve.compensator_pressure, rtol=1e-12)
    assert np.all((y > 0.0) & (y < 1.0))
    starved, wide, _ = metered_flow(even, edge, 0.5 * valve.compensator_pressure)
    assert np.all(wide == pytest.approx(1.0)) and np.all(starved < flow)


def test_dry_friction_rises_with_pressure_and_falls_with_speed(machine):
    ports = chambers(machine, 0.0)
    cylinder = machine.steering.cylinder
    slow, fast = (float(dry_friction(machine, ports, 0.0, rate)) for rate in (0.0, 10.0))
    seals = ports.lever_sum * cylinder.seal_preload
    assert slow == pytest.approx(machine.joint.friction_torque + cylinder.seal_static_ratio * seals)
    assert fast == pytest.approx(machine.joint.friction_torque + seals)
    pressed = float(dry_friction(machine, ports, 1e7, 10.0))
    assert pressed - fast == pytest.approx(ports.lever_sum * cylinder.seal_pressure_coefficient * 1e7)


@pytest.mark.parametrize("orifice", OPTIONS["orifice"])
def test_the_drop_over_an_edge_is_the_inverse_of_its_flow(machine, orifice):
    chosen, drop = machine.with_laws(orifice=orifice), np.array([0.0, 1e4, 9e4, 2e5, 5e6])
    flow = edge_flow(chosen, 2e-6, drop)
    np.testing.assert_allclose(edge_drop(chosen, 2e-6, flow), drop, rtol=1e-9, atol=1e-9)
    slope, far = 2e-6 / np.sqrt(machine.oil.laminar_pressure), 2e-6 * np.sqrt(5e6)
    assert flow[1] == pytest.approx(1e4 * slope, rel=3e-3) and flow[-1] == pytest.approx(far, rel=1.1e-4)


@pytest.mark.parametrize("option", OPTIONS["return_line"])
def test_the_flow_of_a_return_line_is_the_inverse_of_its_pressure(machine, option):
    chosen, flow = machine.with_laws(return_line=option), np.array([1e-5, 2e-4, 1e-3])
    np.testing.assert_allclose(return_flow(chosen, return_pressure(chosen, flow)), flow, rtol=1e-9)
    assert float(return_flow(chosen, 0.0)) == 0.0


def test_a_smooth_opening_is_scipys_monotone_cubic_inside(machine):
    """SciPy's slopes at the inner points; none at the end of the dead band, the last secant at 2 V."""
    smooth, valve = machine.with_laws(opening="smooth"), machine.steering.valve
    knots = np.array([valve.dead_band_left, 1.0, 1.5, 2.0], dtype=np.float64)
    heights = np.array([0.0, valve.opening_left_1V0, valve.opening_left_1V5, 1.0])
    slopes = PchipInterpolator(knots, heights).derivative()(knots)
    slopes[0], slopes[3] = 0.0, (heights[3] - heights[2]) / 0.5
    volts = np.linspace(knots[0], 2.0, 101)
    expected = CubicHermiteSpline(knots, heights, slopes)(volts)
    np.testing.assert_allclose(opening(smooth, volts / 2.0), expected, atol=1e-12)
    assert float(opening(smooth, 0.5 * knots[0] - 0.01)) == 0.0


def test_oil_of_each_law_is_as_stiff_as_its_law_says(machine):
    aerated = machine.set({"oil.gas_fraction": 0.01})
    exponents = {"polytropic": aerated.oil.polytropic_exponent, "isothermal": 1.0, "adiabatic": 1.4}
    for gas, exponent in exponents.items():
        same = aerated.set({"oil.polytropic_exponent": exponent})
        assert modulus(aerated.with_laws(gas=gas), 3e5) == pytest.approx(modulus(same, 3e5), rel=1e-12)
    constant = machine.with_laws(liquid="constant")
    assert modulus(constant, 1e5) == modulus(constant, 3e7) == pytest.approx(modulus(machine, 50e5), rel=1e-12)


def test_dissolving_air_is_the_slope_of_its_volume(machine):
    oil = machine.set({"oil.gas_fraction": 0.01, "oil.bulk_modulus_slope": 0.0}).with_laws(gas="dissolving")

    def gas(p):
        x = p / oil.oil.solution_pressure
        free = 1.0 - 3.0 * x**2 + 2.0 * x**3
        return 0.01 * free * (ATMOSPHERIC_PRESSURE / (p + ATMOSPHERIC_PRESSURE)) ** (1.0 / oil.oil.polytropic_exponent)

    for p in (2e5, 15e5):
        compliance = 0.99 / oil.oil.bulk_modulus - (gas(p + 10.0) - gas(p - 10.0)) / 20.0
        assert modulus(oil, p) == pytest.approx((0.99 + gas(p)) / compliance, rel=1e-6)
    assert modulus(oil, 40e5) == pytest.approx(oil.oil.bulk_modulus, rel=1e-12)


def test_walls_give_by_their_law(machine):
    steering = machine.steering
    p = steering.hose_stiffening_pressure
    given = {option: float(walls(machine.with_laws(hose=option), p)) for option in OPTIONS["hose"]}
    whole = float(steering.hose_compliance)
    assert given == {
        "linear": whole,
        "stiffening": pytest.approx(0.5 * whole),
        "viscoelastic": pytest.approx((1.0 - steering.hose_delayed_share) * whole),
        "two_segments": pytest.approx(0.5 * whole),
    }


def test_the_return_line_follows_its_filter(machine):
    clogged = machine.set({"steering.tank_line.throttle_drop": 4.0})
    line = clogged.steering.tank_line
    at = float(return_pressure(clogged, line.back_flow))
    assert at == pytest.approx(line.back_pressure + line.back_pressure_ramp + line.throttle_drop)


def test_steady_turn_balances_every_port(machine):
    leaky = machine.set({"steering.valve.cross_port_leakage": 3.0, "steering.cylinder.leakage": 2e-12})
    valve, cylinder = leaky.steering.valve, leaky.steering.cylinder
    turn, ports = steady_turn(leaky, 0.75, -0.3, 1500.0), chambers(leaky, -0.3)
    across = 2.0 * cylinder.leakage * (turn.pressure_a - turn.pressure_b)
    across += turbulent(valve.cv_cross_port, turn.pressure_a - turn.pressure_b, leaky.oil.laminar_pressure)
    lost = across + valve.leakage * (turn.pressure_a - turn.return_pressure)
    assert turn.metered == pytest.approx(turn.flow + lost, rel=1e-9)
    out = turn.flow * ports.displacement_b / ports.displacement_a
    edge = turn.opening * valve.cv_out_left
    assert turn.pressure_b - turn.return_pressure == pytest.approx((out / edge) ** 2, rel=1e-9)
    torque = turn.pressure_a * ports.displacement_a - turn.pressure_b * ports.displacement_b
    rate = turn.flow / ports.displacement_a
    friction = dry_friction(leaky, ports, turn.pressure_a + turn.pressure_b, rate)
    assert torque == pytest.approx(1500.0 + friction + cylinder.seal_viscous * ports.lever_squares * rate, rel=1e-6)
    assert turn.supply - turn.pressure_a == pytest.approx(leaky.steering.pump.margin)


def test_flow_balance_is_the_twins_steady_flow():
    """At half signal, where the turn is long: the margin swings by δ about its mean, and the mean of a root lies below
    the root of the mean by var(Δp)/(8 Δp²), behind a compensator by no more."""
    machine = Machine.load("aoro")
    twin = Twin(machine=machine)
    twin.reset(joint_angle=-float(machine.joint.range))
    twin.step({"steering_signal": 0.5}, 2.0)
    trace = twin.step({"steering_signal": 0.5}, 3.0, sample_every=1e-3)
    assert trace is not None
    drop = (trace["pump_pressure"] - trace["pressure_a"]).astype(float)
    turn = steady_turn(machine, 0.5, float(trace["joint_angle"].mean()), 1500.0)
    below = drop.var() / (8.0 * drop.mean() ** 2)
    assert drop.mean() == pytest.approx(machine.steering.pump.margin, rel=0.05)
    assert float(trace["joint_flow"].mean()) == pytest.approx(float(turn.flow), rel=below + 1e-3)
    assert turn.flow / LITRE_PER_MINUTE == pytest.approx(21.2, abs=0.1)


def test_load_sensing_loop_is_that_of_the_linearised_circuit(machine):
    """Supply and swash alone, all else held: their two poles have the crossover and the damping of the closed form."""
    lossless = machine.set({"steering.pump.bleed_flow": 1e-9}, check_ranges=False)
    planar = Planar(lossless, np.array([1.0, 0.6]))
    a, _ = planar.linearised(-0.4)
    places = [LINEAR.index(SUPPLY), LINEAR.index(SWASH)]
    poles = np.linalg.eigvals(a[np.ix_([0, 1], places, places)])
    crossover, damping = load_sensing_loop(lossless, planar.steady(-0.4)[1])
    # central differences: curvature of the root over a hundredth of a bar in 20 bar, and the line's modulus likewise
    np.testing.assert_allclose(np.abs(poles), np.broadcast_to(crossover, (2, 2)).T, rtol=1e-5)
    np.testing.assert_allclose(-poles.real / np.abs(poles), np.broadcast_to(damping, (2, 2)).T, rtol=1e-3)
