"""The steering circuit: geometry, valve, compensator, pump, and the circuit's balances of oil and power."""

# Device code: its types are Warp's, not Python's.
# pyright: reportInvalidTypeForm=false, reportGeneralTypeIssues=false, reportArgumentType=false

from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pytest
import warp as wp
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from aoro_gym.twin.physics.fluid import Oil
from aoro_gym.twin.physics.load_sensing_pump import swash_step
from aoro_gym.twin.physics.steering import (
    steering_displace,
    steering_gas,
    steering_geometry,
    steering_step,
    steering_torque,
)
from aoro_gym.twin.physics.steering_circuit import Exchange, Steering, SteeringGeometry, SteeringState
from aoro_gym.twin.physics.steering_valve import play, play_output, valve_opening
from tests.twin.physics.elements import (
    BAR,
    OIL,
    SUBSTEP,
    VOID,
    chamber_compliance,
    check_valve,
    compliance,
    cv,
    orifice,
    pin_distance,
    relief,
    through_filter,
    uncrossed,
)
from tests.twin.physics.launch import ROUNDOFF, changed, columns, launch, record, rounded
from tests.twin.physics.steering_elements import HALF_RANGE, NO_ARMS, STEERING, state

STATES = [name for name in SteeringState.vars if name != "law"]  # what only some laws have is tested with them
SPEED = 167.0  # [rad/s] engine


@wp.kernel(enable_backward=False)
def geometry_kernel(
    m: wp.array(dtype=Steering), angle: wp.array(dtype=float), geometry: wp.array(dtype=SteeringGeometry)
):
    i = wp.tid()
    geometry[i] = steering_geometry(m[i], angle[i])


@wp.kernel(enable_backward=False)
def play_kernel(
    command: wp.array2d(dtype=float),
    width: wp.array(dtype=float),
    position: wp.array2d(dtype=float),
    output: wp.array2d(dtype=float),
):
    i = wp.tid()
    r = float(0.0)
    for k in range(command.shape[1]):
        r = play(r, command[i, k], width[i])
        position[i, k] = r
        output[i, k] = play_output(r, width[i])


@wp.kernel(enable_backward=False)
def opening_kernel(
    spool: wp.array(dtype=float),
    overlap: wp.array(dtype=float),
    dead_band: float,
    opening_1V0: float,
    opening_1V5: float,
    opening: wp.array(dtype=float),
):
    i = wp.tid()
    opening[i] = valve_opening(spool[i], overlap[i], dead_band, opening_1V0, opening_1V5)


@wp.kernel(enable_backward=False)
def swash_kernel(
    m: wp.array(dtype=Steering),
    swash: wp.array(dtype=float),
    supply: wp.array(dtype=float),
    ls_pressure: wp.array(dtype=float),
    dt: wp.array(dtype=float),
    out: wp.array(dtype=float),
):
    i = wp.tid()
    out[i] = swash_step(m[i], swash[i], supply[i], ls_pressure[i], dt[i])


@wp.kernel(enable_backward=False)
def step_kernel(
    m: wp.array(dtype=Steering),
    oil: wp.array(dtype=Oil),
    angle: wp.array(dtype=float),
    demand: wp.array(dtype=float),
    engine_speed: wp.array(dtype=float),
    joint_rate: wp.array(dtype=float),
    arms: wp.array(dtype=Exchange),
    start: wp.array(dtype=SteeringState),
    dt: wp.array(dtype=float),
    end: wp.array(dtype=SteeringState),
):
    i = wp.tid()
    g = steering_geometry(m[i], angle[i])
    gas = steering_gas(oil[i], start[i])
    end[i] = steering_step(m[i], oil[i], gas, g, demand[i], engine_speed[i], joint_rate[i], arms[i], start[i], dt[i])


@wp.kernel(enable_backward=False)
def turn_kernel(
    m: wp.array(dtype=Steering),
    oil: wp.array(dtype=Oil),
    angle: wp.array(dtype=float),
    turned: wp.array(dtype=float),
    start: wp.array(dtype=SteeringState),
    end: wp.array(dtype=SteeringState),
    torque_before: wp.array(dtype=float),
    torque_after: wp.array(dtype=float),
):
    """The joint turned by a small angle with everything shut, and the oil's torque before and after."""
    i = wp.tid()
    g = steering_geometry(m[i], angle[i])
    s = steering_displace(m[i], oil[i], g, turned[i], start[i])
    torque_before[i] = steering_torque(oil[i], g, start[i])
    torque_after[i] = steering_torque(oil[i], g, s)
    end[i] = s


@wp.kernel(enable_backward=False)
def run_kernel(
    m: wp.array(dtype=Steering),
    oil: wp.array(dtype=Oil),
    demand: wp.array(dtype=float),
    arms: wp.array(dtype=Exchange),
    start: wp.array(dtype=SteeringState),
    dt: float,
    steps: int,
    hold_supply: int,
    hold_ports: int,
    end: wp.array(dtype=SteeringState),
):
    """The circuit with a joint at rest; pressures may be held as if the volumes were endless."""
    i = wp.tid()
    first = start[i]
    s = start[i]
    g = steering_geometry(m[i], 0.0)
    gas = steering_gas(oil[i], first)
    for _ in range(steps):
        s = steering_step(m[i], oil[i], gas, g, demand[i], 167.0, 0.0, arms[i], s, dt)
        if hold_supply == 1:
            s.supply = first.supply
        if hold_ports == 1:
            s.port_a = first.port_a
            s.port_b = first.port_b
            s.tank_line = first.tank_line
    end[i] = s


# ---- geometry ----


def chambers(m, angle):
    """Volumes V_A and V_B from the pins' distance: A holds the right cylinder's bore and the left one's annulus."""
    link = m.cylinder_linkage
    right = pin_distance(link, angle) - link.dead_length
    left = pin_distance(link, -angle) - link.dead_length
    fixed = m.hose_volume + 2.0 * m.cylinder_dead_volume
    bore, annulus = m.cylinder_bore_area, m.cylinder_annulus_area
    return (
        fixed + bore * right + annulus * (link.stroke - left),
        fixed + bore * left + annulus * (link.stroke - right),
    )


# Lengths of 0.5 to 0.8 m: squares of up to 0.8 m² with four roundings, over twice the length; γ's own rounding times
# the lever. In sum an extension is good to 4 · 2⁻²⁴ · 0.8 m, times areas of 9e-3 m² in all; the volume of 3 L rounds too.
VOLUME_ERROR = 8.0 * ROUNDOFF * 0.8 * 9e-3
ANGLES = rounded(np.linspace(-HALF_RANGE, HALF_RANGE, 401))


def test_chambers_follow_the_pins():
    volume_a, volume_b = chambers(columns(STEERING), ANGLES)
    g = launch(geometry_kernel, STEERING, ANGLES)
    np.testing.assert_allclose(g.volume_a, volume_a, atol=VOLUME_ERROR)
    np.testing.assert_allclose(g.volume_b, volume_b, atol=VOLUME_ERROR)


def test_displacements_are_the_chambers_derivatives():
    m, step = columns(STEERING), 1e-5
    g = launch(geometry_kernel, STEERING, ANGLES)
    after, before = chambers(m, ANGLES + step), chambers(m, ANGLES - step)
    # levers of 0.2 to 0.4 m with a dozen roundings; the difference quotient is good to 1e-16/1e-5 and 1e-10
    for value, up, down in ((g.displacement_a, after[0], before[0]), (g.displacement_b, after[1], before[1])):
        np.testing.assert_allclose(value, (up - down) / (2.0 * step), rtol=16.0 * ROUNDOFF, atol=1e-10)
    assert np.all(g.displacement_a > 0.0)
    assert np.all(g.displacement_b < 0.0)


def test_levers_are_the_cylinders():
    link, step = columns(STEERING).cylinder_linkage, 1e-5
    g = launch(geometry_kernel, STEERING, ANGLES)
    for lever, angle in ((g.lever_right, ANGLES), (g.lever_left, -ANGLES)):
        slope = (pin_distance(link, angle + step) - pin_distance(link, angle - step)) / (2.0 * step)
        np.testing.assert_allclose(lever, slope, rtol=16.0 * ROUNDOFF)


def test_full_turn_sweeps_both_cylinders():
    """From stop to stop A takes one bore and one annulus over the whole stroke, and B gives as much back."""
    m = columns(STEERING)
    g = launch(geometry_kernel, STEERING, np.array([-HALF_RANGE, HALF_RANGE]))
    swept = (m.cylinder_bore_area + m.cylinder_annulus_area) * m.cylinder_linkage.stroke
    assert g.volume_a[1] - g.volume_a[0] == pytest.approx(swept, abs=2 * VOLUME_ERROR)
    assert g.volume_b[0] - g.volume_b[1] == pytest.approx(swept, abs=2 * VOLUME_ERROR)


def test_geometry_is_mirrored():
    left, right = launch(geometry_kernel, STEERING, ANGLES), launch(geometry_kernel, STEERING, -ANGLES)
    np.testing.assert_allclose(left.volume_a, right.volume_b, rtol=2 * ROUNDOFF)
    np.testing.assert_allclose(left.displacement_a, -right.displacement_b, rtol=2 * ROUNDOFF)
    np.testing.assert_allclose(left.lever_left, right.lever_right, rtol=2 * ROUNDOFF)


# ---- play ----

WIDTH = 0.03


def follow(command):
    position, output = launch(play_kernel, np.atleast_2d(command), WIDTH, length=np.shape(command)[-1])
    return position[0], output[0]


def test_play_holds_its_distance_and_moves_only_when_pushed():
    rng = np.random.default_rng(1)
    command = rounded(np.cumsum(rng.normal(0.0, 0.02, 5000)))
    position, _ = follow(command)
    gap = command - position
    # the edge itself is rounded relative to the command
    slack = 2 * ROUNDOFF * (1.0 + np.abs(command))
    assert np.all(np.abs(gap) <= WIDTH / 2 + slack)
    moved = np.diff(position)
    # while it moves it touches the edge behind it
    assert np.all((moved <= 0.0) | (np.abs(gap[1:] - WIDTH / 2) <= slack[1:]))
    assert np.all((moved >= 0.0) | (np.abs(gap[1:] + WIDTH / 2) <= slack[1:]))
    assert np.any(moved == 0.0)


def test_play_does_not_depend_on_the_rate():
    """The same turning points reached in 1 or in 200 steps leave the same position."""
    turns = rounded(np.array([0.0, 0.4, 0.385, 0.1, 0.7, 0.69, -0.5, 0.2]))
    quick, _ = follow(turns)
    slow, _ = follow(np.concatenate([np.linspace(a, b, 200) for a, b in pairwise(turns)]))
    np.testing.assert_allclose(slow[199::200], quick[1:], atol=2 * ROUNDOFF)


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_spool_demand_meets_a_rising_command_exactly(side):
    """Beyond the hysteresis the demand is the command; below it rises from nothing to it."""
    command = side * np.linspace(0.0, 1.0, 2001)
    _, output = follow(command)
    beyond = np.abs(command) >= WIDTH
    np.testing.assert_allclose(output[beyond], rounded(command)[beyond], atol=2 * ROUNDOFF)
    assert np.all(np.abs(output) <= np.abs(command) + 2 * ROUNDOFF)
    np.testing.assert_array_equal(output[np.abs(command) < 0.99 * WIDTH / 2], 0.0)
    assert np.all(np.diff(side * output) >= 0.0)


def test_spool_demand_lags_a_falling_command_by_the_hysteresis():
    command = np.concatenate([np.linspace(0.0, 0.8, 400), np.linspace(0.8, 0.3, 400)])
    _, output = follow(command)
    falling = output[400:] - rounded(command[400:])
    # right after the turn the spool stands; once the play is crossed it lags by its width
    crossed = command[400:] < 0.8 - 1.01 * WIDTH
    np.testing.assert_allclose(falling[crossed], WIDTH, atol=4 * ROUNDOFF)
    np.testing.assert_allclose(output[400:][command[400:] > 0.8 - 0.99 * WIDTH], 0.8, atol=4 * ROUNDOFF)


# ---- valve, compensator, pump ----


@pytest.mark.parametrize(("dead_band", "at_1V0", "at_1V5"), [(0.27, 0.289, 0.783), (0.35, 0.191, 0.661)])
def test_opening_passes_through_the_measured_points(dead_band, at_1V0, at_1V5):
    volts = rounded(np.linspace(0.0, 2.5, 1001))
    opening = launch(opening_kernel, 0.5 * volts, 0.0, dead_band, at_1V0, at_1V5)
    expected = np.interp(volts, [dead_band, 1.0, 1.5, 2.0], [0.0, at_1V0, at_1V5, 1.0])
    # volts of up to 2 rounded, times the steepest slope of 1 /V; and a few roundings of the result
    np.testing.assert_allclose(opening, expected, atol=8 * ROUNDOFF)
    np.testing.assert_array_equal(launch(opening_kernel, -0.5 * volts, 0.0, dead_band, at_1V0, at_1V5), opening)
    knots = launch(opening_kernel, np.array([0.0, dead_band / 2, 0.5, 0.75, 1.0, 1.2]), 0.0, dead_band, at_1V0, at_1V5)
    np.testing.assert_allclose(knots, [0.0, 0.0, at_1V0, at_1V5, 1.0, 1.0], atol=8 * ROUNDOFF)


@pytest.mark.parametrize("overlap", [0.2, -0.2])
def test_overlap_moves_the_whole_opening_curve(overlap):
    volts = rounded(np.linspace(0.2, 2.0, 501))
    curve = (0.27, 0.289, 0.783)
    moved = launch(opening_kernel, 0.5 * (volts + overlap), overlap, *curve)
    # the sum rounds, times the steepest slope of 1 /V
    np.testing.assert_allclose(moved, launch(opening_kernel, 0.5 * volts, 0.0, *curve), atol=8 * ROUNDOFF)


def static_compensator(m, available, ratio):
    """Root of p_ref (1 + κ(½ − y)) = Δp share(y); ``ratio`` = edge over open compensator. Both sides are monotone."""

    def excess(y):
        share = y * y / (y * y + ratio * ratio)
        return m.valve_compensator_pressure * (1.0 + m.valve_compensator_droop * (0.5 - y)) - available * share

    return 1.0 if excess(1.0) >= 0.0 else brentq(excess, 0.0, 1.0, xtol=1e-12)


def held_valve(available, opening, compensator):
    """A left turn whose pressures are held, spool and load-sensing line at rest: the state, and edge/compensator."""
    m = columns(STEERING)
    volts = np.interp(
        opening, [0.0, m.valve_opening_left_1V0, m.valve_opening_left_1V5, 1.0], [m.valve_dead_band_left, 1.0, 1.5, 2.0]
    )
    start = state(
        supply=10.0 * BAR + available,
        port_a=10.0 * BAR,
        port_b=5.0 * BAR,
        ls_pressure=10.0 * BAR,
        spool=volts / 2.0,
        compensator=compensator,
    )
    s = columns(start)
    opening = np.interp(
        2.0 * s.spool,
        [m.valve_dead_band_left, 1.0, 1.5, 2.0],
        [0.0, m.valve_opening_left_1V0, m.valve_opening_left_1V5, 1.0],
    )
    return start, opening * m.valve_cv_in_left / m.valve_cv_compensator, s.supply - s.port_a


@pytest.mark.parametrize("share_of_time_constant", [SUBSTEP / 1e-3, 0.1, 1.0, 10.0, 1e4])
def test_compensator_settles_on_its_static_curve_at_any_step(share_of_time_constant):
    """Drops from idle to cut-off, edges from nearly closed to open, started open and closed."""
    rng = np.random.default_rng(2)
    count = 400
    m = columns(STEERING)
    start, ratio, available = held_valve(
        10.0 ** rng.uniform(0.0, np.log10(200.0), count) * BAR,
        10.0 ** rng.uniform(-2.0, 0.0, count),
        np.repeat([0.0, 1.0], count // 2),
    )
    dt = share_of_time_constant * 1e-3
    end = launch(run_kernel, STEERING, OIL, start["spool"], NO_ARMS, start, dt, 4000, 1, 1)
    expected = np.array([static_compensator(m, a, r) for a, r in zip(available, ratio, strict=True)])
    # float32: the balance of pressures rounds relative to p_ref (1 ± κ/2) and to Δp share of the same size, over its
    # slope of at least κ p_ref; y itself stalls where the change of half a step is below half its ulp
    tolerance = 16 * ROUNDOFF * 1.15 / 0.3 + 2 * ROUNDOFF + 4 * ROUNDOFF / (share_of_time_constant * 0.3)
    off = np.abs(end.compensator - expected) > tolerance
    assert not np.any(off), (
        f"{np.sum(off)} of {count} compensators do not settle: drops from {available[off].min() / BAR:.0f} bar, "
        f"edge/compensator {ratio[off].min():.3f} to {ratio[off].max():.3f}"
    )


def test_compensator_opens_without_flow_and_stays_within_its_stops():
    shut = state(compensator=0.0)
    assert launch(run_kernel, STEERING, OIL, 0.0, NO_ARMS, shut, SUBSTEP, 200, 1, 1).compensator == 1.0
    start, _, _ = held_valve(200.0 * BAR, 0.01, np.array([0.0, 0.5, 1.0]))
    for steps in (1, 2, 3, 30):
        y = launch(run_kernel, STEERING, OIL, start["spool"], NO_ARMS, start, SUBSTEP, steps, 1, 1).compensator
        assert np.all((y >= 0.0) & (y <= 1.0))


def test_compensator_converges_to_its_differential_equation():
    """τ p_ref y' = p_ref (1 + κ(½ − y)) − Δp share(y), first order in the step."""
    m = columns(STEERING)
    span = 1.5e-3
    start, ratio, available = held_valve(20.0 * BAR, 0.6, 1.0)

    def rate(_, y):
        share = y * y / (y * y + ratio * ratio)
        force = m.valve_compensator_pressure * (1.0 + m.valve_compensator_droop * (0.5 - y)) - available * share
        return force / (m.valve_compensator_pressure * m.valve_compensator_time_constant)

    exact = solve_ivp(rate, (0.0, span), [1.0], method="LSODA", rtol=1e-10, atol=1e-12).y[0, -1]
    assert 0.1 < exact < 0.9
    coarse, fine = (
        launch(run_kernel, STEERING, OIL, start["spool"], NO_ARMS, start, span / n, n, 1, 1).compensator - exact
        for n in (100, 200)
    )
    assert coarse / fine == pytest.approx(2.0, rel=0.1)
    assert abs(fine) < 0.02


def test_swash_moves_with_the_smaller_error_within_its_stroke_times():
    rng = np.random.default_rng(3)
    count = 2000
    m = columns(STEERING)
    swash, dt = rounded(rng.uniform(0.0, 1.0, count)), 1e-3
    supply = rounded(rng.uniform(0.0, 260.0, count) * BAR)
    ls = rounded(np.where(rng.random(count) < 0.5, rng.uniform(0.0, 230.0, count) * BAR, supply - 20.0 * BAR))
    ls = rounded(ls + rng.normal(0.0, 5.0, count) * BAR)
    error = np.minimum(ls + m.pump_margin - supply, m.pump_cutoff - supply)
    rate = np.clip(error / (m.pump_control_band * m.pump_stroke_up_time), -1 / 0.06, 1 / 0.13)
    out = launch(swash_kernel, STEERING, swash, supply, ls, dt)
    # the error is a difference of pressures of up to 260 bar, over 1.3 bar s; a millisecond of it
    tolerance = 1e-3 * 4 * ROUNDOFF * 260.0 / 1.3 + 8 * ROUNDOFF
    np.testing.assert_allclose(out, np.clip(swash + dt * rate, 0.0, 1.0), atol=tolerance)
    assert np.any(rate == -1 / 0.06)
    assert np.any(rate == 1 / 0.13)
    assert np.any(np.abs(rate) < 5.0)


def test_swash_takes_its_stroke_times_from_stop_to_stop():
    up, down = np.asarray(0.0), np.asarray(1.0)
    for _ in range(60):
        up = launch(swash_kernel, STEERING, up, 0.0, 100.0 * BAR, 1e-3)
        down = launch(swash_kernel, STEERING, down, 250.0 * BAR, 0.0, 1e-3)
    assert up == pytest.approx(60.0 / 130.0, rel=60 * 2 * ROUNDOFF)
    assert down == pytest.approx(0.0, abs=60 * 2 * ROUNDOFF)
    # at the cut-off the load no longer matters
    assert launch(swash_kernel, STEERING, 0.5, 211.0 * BAR, 300.0 * BAR, 1e-3) < 0.5


# ---- the circuit ----


def circuit(m, oil, angle, speed, rate, arms, s):
    """All flows of the circuit [m³/s] and the net flow into its four volumes, from the definition of its elements."""
    p_s, p_a, p_b, p_t = (np.maximum(x, oil.void_pressure) for x in (s.supply, s.port_a, s.port_b, s.tank_line))
    left = s.spool > 0.0
    volts = 2.0 * np.abs(s.spool) - m.valve_overlap
    opening = np.array(
        [
            np.interp(v, [d, 1.0, 1.5, 2.0], [0.0, a, b, 1.0])
            for v, d, a, b in np.broadcast(
                volts,
                np.where(left, m.valve_dead_band_left, m.valve_dead_band_right),
                np.where(left, m.valve_opening_left_1V0, m.valve_opening_right_1V0),
                np.where(left, m.valve_opening_left_1V5, m.valve_opening_right_1V5),
            )
        ]
    )
    p_load, p_free = np.where(left, p_a, p_b), np.where(left, p_b, p_a)
    first = s.compensator * m.valve_cv_compensator
    edge = opening * np.where(left, m.valve_cv_in_left, m.valve_cv_in_right)
    both = np.divide(first * edge, np.hypot(first, edge), out=np.zeros_like(first), where=edge > 0.0)
    f = SimpleNamespace(opening=opening)
    f.into = orifice(both, np.maximum(p_s - p_load, 0.0))
    f.out = orifice(opening * np.where(left, m.valve_cv_out_left, m.valve_cv_out_right), p_free - p_t)
    f.shock_a = relief(p_a - p_t, m.valve_shock_pressure, m.valve_shock_ramp, m.valve_shock_flow)
    f.shock_b = relief(p_b - p_t, m.valve_shock_pressure, m.valve_shock_ramp, m.valve_shock_flow)
    f.suction_a = check_valve(m.valve_cv_anticavitation, p_t - p_a, m.valve_anticavitation_crack)
    f.suction_b = check_valve(m.valve_cv_anticavitation, p_t - p_b, m.valve_anticavitation_crack)
    f.leak_a, f.leak_b = m.valve_leakage * (p_a - p_t), m.valve_leakage * (p_b - p_t)
    f.across = 2.0 * m.cylinder_leakage * (p_a - p_b)
    f.crossed = orifice(m.valve_cv_cross_port, p_a - p_b)
    f.pump = s.swash * m.pump_displacement * speed
    f.pump_leak = m.pump_leakage * p_s
    f.bleed = orifice(m.pump_cv_bleed, s.ls_pressure)
    f.relief = relief(p_s, m.pump_relief_pressure, m.pump_relief_ramp, m.pump_relief_flow)
    f.back = through_filter(
        p_t, m.tank_line_back_pressure, m.tank_line_back_pressure_ramp, m.tank_line_back_flow, m.tank_line_throttle
    )
    f.tank_suction = check_valve(m.tank_line_cv_suction, -p_t, 0.0)
    step = 1e-6
    swept = [
        (up - down) / (2.0 * step) * rate
        for up, down in zip(chambers(m, angle + step), chambers(m, angle - step), strict=True)
    ]
    f.swept_a, f.swept_b = swept
    net = SimpleNamespace(
        supply=f.pump - f.pump_leak - f.bleed - f.relief - f.into - arms.supply_flow,
        port_a=np.where(left, f.into, -f.out) - f.shock_a + f.suction_a - f.leak_a - f.across - f.crossed - f.swept_a,
        port_b=np.where(left, -f.out, f.into) - f.shock_b + f.suction_b - f.leak_b + f.across + f.crossed - f.swept_b,
        tank_line=f.out
        + f.shock_a
        + f.shock_b
        + f.leak_a
        + f.leak_b
        - f.suction_a
        - f.suction_b
        + arms.tank_flow
        - f.back
        + f.tank_suction,
    )
    return f, net


def compliances(m, oil, angle, s):
    volume_a, volume_b = chambers(m, angle)
    # the nominal volume of a port: both cylinders at mid-stroke
    middle = (
        m.hose_volume
        + 2 * m.cylinder_dead_volume
        + 0.5 * (m.cylinder_bore_area + m.cylinder_annulus_area) * m.cylinder_linkage.stroke
    )
    line, tank = m.pump_line_volume, m.tank_line_volume
    return SimpleNamespace(
        supply=compliance(oil, s.supply, line, m.pump_line_compliance),
        port_a=chamber_compliance(oil, s.port_a, volume_a, m.hose_compliance, middle),
        port_b=chamber_compliance(oil, s.port_b, volume_b, m.hose_compliance, middle),
        tank_line=compliance(oil, s.tank_line, tank, m.tank_line_compliance),
    )


VOLUMES = ("supply", "port_a", "port_b", "tank_line")
DT = 2e-4  # one single step: large, so that the rounding of a pressure is a small flow


def random_case(count, seed, **fixed):
    """Random parameters (±30 %), states (voids included), and motion; SimpleNamespace of records and arrays."""
    rng = np.random.default_rng(seed)
    keep = {"valve_dead_band_left", "valve_dead_band_right", "cylinder_linkage"}
    factors = {
        name: float(STEERING[name]) * rng.uniform(0.7, 1.3, count)
        for name in STEERING.dtype.names
        if name not in keep and "1V" not in name
    }
    effects = np.random.default_rng(seed + 1)
    factors["valve_overlap"] = effects.uniform(-0.2, 0.3, count)
    factors["valve_cv_cross_port"] = cv(1.0, 100.0) * np.maximum(effects.uniform(-1.0, 2.0, count), 0.0)
    # up to 15 bar at 60 L/min
    factors["tank_line_throttle"] = 15.0 * BAR / 1e-3**2 * np.maximum(effects.uniform(-1.0, 1.0, count), 0.0)
    m = changed(STEERING, **{**factors, **fixed.pop("parameters", {})})

    def contents(low, high):
        return np.where(rng.random(count) < 0.1, rng.uniform(-30.0, -0.95, count), rng.uniform(low, high, count)) * BAR

    values = {
        "supply": contents(-0.9, 280.0),
        "port_a": contents(-0.9, 260.0),
        "port_b": contents(-0.9, 260.0),
        "tank_line": contents(-0.9, 8.0),
        "ls_pressure": rng.uniform(0.0, 220.0, count) * BAR,
        "spool": rng.uniform(-1.0, 1.0, count),
        "compensator": rng.uniform(0.0, 1.0, count),
        "swash": rng.uniform(0.0, 1.0, count),
    }
    values = {**values, **fixed.pop("state", {})}
    return SimpleNamespace(
        m=m,
        angle=fixed.get("angle", rounded(rng.uniform(-HALF_RANGE, HALF_RANGE, count))),
        demand=rounded(rng.uniform(-1.0, 1.0, count)),
        speed=fixed.get("speed", rounded(rng.uniform(80.0, 200.0, count))),
        rate=fixed.get("rate", rounded(rng.normal(0.0, 0.3, count))),
        arms=fixed.get(
            "arms",
            record(
                Exchange,
                supply_flow=rng.uniform(0.0, 1e-3, count),
                tank_flow=rng.uniform(0.0, 1e-3, count),
                load_pressure=rng.uniform(-0.5, 220.0, count) * BAR,
            ),
        ),
        start=state(**values),
    )


def advance(case, dt=DT, oil=OIL):
    return launch(step_kernel, case.m, oil, case.angle, case.demand, case.speed, case.rate, case.arms, case.start, dt)


def flow_tolerance(m, f, capacity, before, after):
    """Rounding of a net flow: every element by its own flow, opened drops by the pressures that they are the
    difference of (conductance × pressure × 2⁻²⁴), and the new content by half an ulp."""
    magnitude = sum(np.abs(x) for name, x in vars(f).items() if name != "opening")
    conductance = (
        m.valve_shock_flow / m.valve_shock_ramp
        + m.pump_relief_flow / m.pump_relief_ramp
        + 2.0 * (m.valve_cv_anticavitation + m.pump_cv_bleed) / np.sqrt(BAR)
        + m.pump_leakage
    )
    tank = (m.tank_line_back_flow / m.tank_line_back_pressure_ramp) * 8.0 * BAR
    rounding = 16.0 * magnitude + 4.0 * (conductance * 300.0 * BAR + tank)
    return ROUNDOFF * (rounding + 4.0 * capacity * (np.abs(after) + np.abs(before)) / DT)


def test_every_volume_gains_what_flows_into_it():
    case = random_case(3000, 4)
    m, oil, s, arms = columns(case.m), columns(OIL), columns(case.start), columns(case.arms)
    end = advance(case)
    flows, net = circuit(m, oil, case.angle, case.speed, case.rate, arms, s)
    capacity = compliances(m, oil, case.angle, s)
    dt = float(rounded(DT))
    for name in VOLUMES:
        before, after, c = getattr(s, name), getattr(end, name), getattr(capacity, name)
        slack = flow_tolerance(m, flows, c, before, after)
        same = uncrossed(before, after)
        assert np.mean(same) > 0.8
        assert np.all((np.abs(c * (after - before) / dt - getattr(net, name)) <= slack)[same]), name
    # sharp enough for the smallest element: a leakage of 2e-12 m³/s/Pa at 10 bar and more
    assert np.median(flow_tolerance(m, flows, capacity.supply, s.supply, end.supply)) < 1e-6
    # the signal beyond the overlap rounds like 2 V, at most 1/V of an opening that passes 10 L/s at most
    np.testing.assert_allclose(end.flow_in, flows.into, rtol=32 * ROUNDOFF, atol=2 * ROUNDOFF * 10e-3)
    np.testing.assert_allclose(end.flow_out, flows.out, rtol=32 * ROUNDOFF, atol=2 * ROUNDOFF * 10e-3)


def test_circuit_neither_makes_nor_loses_oil():
    """The sum of C Δp over all volumes and of the swept volume is what crosses the circuit's border."""
    case = random_case(3000, 5)
    m, oil, s, arms = columns(case.m), columns(OIL), columns(case.start), columns(case.arms)
    end = advance(case)
    flows, _ = circuit(m, oil, case.angle, case.speed, case.rate, arms, s)
    capacity = compliances(m, oil, case.angle, s)
    gained, slack, same = flows.swept_a + flows.swept_b, 0.0, True
    for name in VOLUMES:
        before, after, c = getattr(s, name), getattr(end, name), getattr(capacity, name)
        gained = gained + c * (after - before) / float(rounded(DT))
        slack = slack + flow_tolerance(m, flows, c, before, after)
        same = same & uncrossed(before, after)
    assert np.mean(same) > 0.5
    crossing = flows.pump - flows.pump_leak - flows.bleed - flows.relief - flows.back + flows.tank_suction
    crossing += arms.tank_flow - arms.supply_flow
    assert np.all((np.abs(gained - crossing) <= slack)[same])


def test_circuit_without_pump_and_motion_only_loses_power():
    """Σ p Q over the volumes ≤ 0: edges, reliefs, checks and leaks all take power, none gives.

    The pump's own volume is kept above tank pressure: its load-sensing bleed is a fixed consumer.
    """
    count = 3000
    rng = np.random.default_rng(6)
    case = random_case(
        count,
        6,
        state={"swash": 0.0, "supply": rng.uniform(0.0, 280.0, count) * BAR},
        rate=0.0,
        arms=NO_ARMS,
    )
    m, oil, s = columns(case.m), columns(OIL), columns(case.start)
    end = advance(case)
    flows, _ = circuit(m, oil, case.angle, case.speed, 0.0, columns(NO_ARMS), s)
    capacity = compliances(m, oil, case.angle, s)
    power, slack, same = 0.0, 0.0, True
    for name in VOLUMES:
        before, after, c = getattr(s, name), getattr(end, name), getattr(capacity, name)
        p = np.maximum(before, VOID)
        power = power + p * c * (after - before) / float(rounded(DT))
        slack = slack + np.abs(p) * flow_tolerance(m, flows, c, before, after)
        same = same & uncrossed(before, after)
    assert np.mean(same) > 0.5
    assert np.all((power <= slack)[same])
    assert np.median(power) < -1e3


def test_metering_edges_take_power():
    case = random_case(3000, 7)
    s = columns(case.start)
    end = advance(case)
    p_s, p_a, p_b, p_t = (np.maximum(getattr(s, name), VOID) for name in VOLUMES)
    left = s.spool > 0.0
    load, free = np.where(left, p_a, p_b), np.where(left, p_b, p_a)
    assert np.all(end.flow_in >= 0.0)  # the load check
    assert np.all(end.flow_in * (p_s - load) >= 0.0)
    assert np.all(end.flow_out * (free - p_t) >= 0.0)
    assert np.all(end.flow_in[p_s <= load] == 0.0)
    assert np.any(end.flow_in > 0.0)


SYMMETRIC = {name.replace("left", "right"): float(STEERING[name]) for name in STEERING.dtype.names if "left" in name}


def test_left_and_right_are_mirrored_when_their_parameters_are():
    """Swap A and B, turn spool, joint angle, rate and demand about: the same, mirrored."""
    case = random_case(3000, 8, parameters=SYMMETRIC)
    for name in STEERING.dtype.names:
        if "left" in name:
            case.m[name] = case.m[name.replace("left", "right")]
    end = advance(case)
    s = case.start
    start = changed(s, port_a=s["port_b"], port_b=s["port_a"], spool=-s["spool"])
    other = launch(step_kernel, case.m, OIL, -case.angle, -case.demand, case.speed, -case.rate, case.arms, start, DT)
    mirrored = {"port_a": "port_b", "port_b": "port_a"}
    for name in STATES:
        value = -other.spool if name == "spool" else getattr(other, mirrored.get(name, name))
        scale = np.abs(getattr(end, name)) + np.abs(columns(s).port_a) * (name in mirrored) + 1e-9
        # sums of the same terms in another order
        assert np.all(np.abs(getattr(end, name) - value) <= 32 * ROUNDOFF * (scale + 1e7 * (name in VOLUMES))), name


def swept_volumes(m, angle):
    """dV_A/dθ and dV_B/dθ from the pins, float64."""
    step = 1e-6
    return [
        (up - down) / (2.0 * step)
        for up, down in zip(chambers(m, angle + step), chambers(m, angle - step), strict=True)
    ]


def test_oil_turns_the_joint_by_the_volumes_that_it_gains():
    """Virtual work: τ dθ = p_A dV_A + p_B dV_B; pressure in A turns left. A void pulls with the void pressure."""
    case = random_case(2000, 12)
    m, s = columns(case.m), columns(case.start)
    before = launch(turn_kernel, case.m, OIL, case.angle, 0.0, case.start)[1]
    gain_a, gain_b = swept_volumes(m, case.angle)
    p_a, p_b = np.maximum(s.port_a, VOID), np.maximum(s.port_b, VOID)
    # levers with a dozen roundings, difference quotients of 4 L good to 4e-3 · 1e-16 / 1e-6
    slack = 16 * ROUNDOFF * (np.abs(p_a * gain_a) + np.abs(p_b * gain_b)) + 1e-12 * (p_a + p_b + 2 * BAR)
    assert np.all(np.abs(before - (p_a * gain_a + p_b * gain_b)) <= slack)
    one_sided = state(port_a=100.0 * BAR, port_b=0.0)
    assert launch(turn_kernel, STEERING, OIL, 0.0, 0.0, one_sided)[1] > 0.0


def test_turned_joint_squeezes_its_ports_and_nothing_else():
    """All shut: C Δp = −dV/dθ Δθ in either port; the torque falls by Σ (dV/dθ)²/C Δθ, a spring."""
    case = random_case(2000, 13)
    turned = rounded(np.random.default_rng(13).normal(0.0, 1e-3, 2000))
    m, oil, s = columns(case.m), columns(OIL), columns(case.start)
    end, before, after = launch(turn_kernel, case.m, OIL, case.angle, turned, case.start)
    capacity = compliances(m, oil, case.angle, s)
    whole = uncrossed(s.port_a, end.port_a) & uncrossed(s.port_b, end.port_b)
    assert np.mean(whole) > 0.7
    spring = 0.0
    for name, gain in zip(("port_a", "port_b"), swept_volumes(m, case.angle), strict=True):
        x, y, c = getattr(s, name), getattr(end, name), getattr(capacity, name)
        expected = -gain * turned / c
        slack = 32 * ROUNDOFF * np.abs(expected) + 2 * ROUNDOFF * (np.abs(x) + np.abs(y))
        assert np.all((np.abs(y - x - expected) <= slack)[whole]), name
        spring = spring + np.where(x > VOID, gain**2 / c, 0.0)
    slack = 64 * ROUNDOFF * (spring * np.abs(turned) + 3e7 * 9e-3)
    assert np.all((np.abs(after - before + spring * turned) <= slack)[whole])
    for name in STATES:
        if name not in ("port_a", "port_b"):
            np.testing.assert_array_equal(getattr(end, name), getattr(s, name))


def test_spool_lags_its_demand_and_keeps_its_rate():
    case = random_case(1000, 9)
    s, m = columns(case.start), columns(case.m)
    end = advance(case, 1e-3)
    rate = np.clip(
        (case.demand - s.spool) / m.valve_spool_time_constant, -m.valve_spool_rate_limit, m.valve_spool_rate_limit
    )
    np.testing.assert_allclose(end.spool, s.spool + 1e-3 * rate, atol=8 * ROUNDOFF)
    assert np.any(np.abs(rate) == m.valve_spool_rate_limit)
    assert np.any(np.abs(rate) < m.valve_spool_rate_limit)


def test_load_sensing_line_follows_the_highest_load():
    case = random_case(2000, 10)
    s, m, arms = columns(case.start), columns(case.m), columns(case.arms)
    end = advance(case, 1e-4)
    flows, _ = circuit(m, columns(OIL), case.angle, case.speed, case.rate, arms, s)
    load = np.maximum(np.where(s.spool > 0.0, s.port_a, s.port_b), VOID)
    target = np.maximum(np.maximum(np.where(flows.opening > 0.0, load, 0.0), arms.load_pressure), 0.0)
    expected = s.ls_pressure + 1e-4 * (target - s.ls_pressure) / m.pump_ls_time_constant
    np.testing.assert_allclose(end.ls_pressure, expected, atol=8 * ROUNDOFF * 300.0 * BAR)


def test_compensator_of_the_circuit_sees_its_edge():
    """One small step of the whole circuit against τ p_ref y' = p_ref (1 + κ(½ − y)) − Δp_edge."""
    case = random_case(2000, 11)
    s, m, oil = columns(case.start), columns(case.m), columns(OIL)
    dt = 1e-7
    end = advance(case, dt)
    flows, _ = circuit(m, oil, case.angle, case.speed, case.rate, columns(case.arms), s)
    left = s.spool > 0.0
    load = np.maximum(np.where(left, s.port_a, s.port_b), VOID)
    first = s.compensator * m.valve_cv_compensator
    edge = flows.opening * np.where(left, m.valve_cv_in_left, m.valve_cv_in_right)
    share = np.where(flows.opening > 0.0, first**2 / np.maximum(first**2 + edge**2, 1e-30), 0.0)
    drop = np.maximum(np.maximum(s.supply, VOID) - load, 0.0) * share
    setting = m.valve_compensator_pressure
    rate = (setting * (1.0 + m.valve_compensator_droop * (0.5 - s.compensator)) - drop) / (
        setting * m.valve_compensator_time_constant
    )
    expected = np.clip(s.compensator + dt * rate, 0.0, 1.0)
    # linearly implicit: the change is smaller by dt/τ (κ + slope/p_ref), slope ≤ 2 Δp/y; and y's rounding
    stiff = m.valve_compensator_droop + 2.0 * np.maximum(s.supply, 0.0) / (setting * np.maximum(s.compensator, 1e-3))
    tolerance = dt**2 * np.abs(rate) * stiff / m.valve_compensator_time_constant + 4 * ROUNDOFF
    assert np.all(np.abs(end.compensator - expected) <= tolerance)


@pytest.mark.parametrize("demand", [0.3, 0.6, 1.0, -0.3, -0.6, -1.0])
@pytest.mark.parametrize("load", [30.0, 100.0, 170.0])
def test_steady_turn_under_load(demand, load):
    """Supply = load + margin; compensator on its static curve; the pump gives what valve, leakage and bleed take."""
    m = columns(STEERING)
    ports = {"port_a": load * BAR, "port_b": 6.0 * BAR} if demand > 0 else {"port_b": load * BAR, "port_a": 6.0 * BAR}
    start = state(**ports, spool=demand, supply=(load + 20.0) * BAR, ls_pressure=load * BAR, swash=0.3)
    # the pump's loop is hardly damped where the compensator holds the flow: leakage/(2C) = 1 /s, so ten seconds
    end = launch(run_kernel, STEERING, OIL, demand, NO_ARMS, start, SUBSTEP, 300000, 0, 1)
    side = "left" if demand > 0 else "right"
    opening = np.interp(
        2 * abs(demand),
        [getattr(m, f"valve_dead_band_{side}"), 1.0, 1.5, 2.0],
        [0.0, getattr(m, f"valve_opening_{side}_1V0"), getattr(m, f"valve_opening_{side}_1V5"), 1.0],
    )
    edge = opening * getattr(m, f"valve_cv_in_{side}")
    y = static_compensator(m, float(m.pump_margin), edge / m.valve_cv_compensator)
    drop = m.pump_margin * y**2 / (y**2 + (edge / m.valve_cv_compensator) ** 2)
    flow = edge * np.sqrt(drop)
    # the swash moves no more once dt·error/(band·time) is below half its ulp; the load-sensing line once dt/τ·error is
    stuck_ls = ROUNDOFF * load * BAR / (SUBSTEP / 8e-3)
    stuck = ROUNDOFF / SUBSTEP * 10.0 * BAR * 0.13 + stuck_ls + 2 * ROUNDOFF * 200.0 * BAR
    # what is left of the starting swing of at most 10 bar
    swing = 10.0 * BAR * np.exp(-10.0)
    assert end.ls_pressure == pytest.approx(load * BAR, abs=2 * stuck_ls)
    assert end.supply == pytest.approx((load + 20.0) * BAR, abs=2 * stuck + swing)
    # a relative error of the drop over both arrives in y over the droop of 0.3 (of a range of 1), in the flow by half
    relative = (2 * stuck + swing) / (20.0 * BAR)
    stuck_y = 2 * ROUNDOFF / (SUBSTEP / 1e-3 * 0.3)
    assert end.compensator == pytest.approx(y, abs=relative * y + stuck_y)
    assert end.flow_in == pytest.approx(flow, rel=relative + stuck_y / y)
    taken = flow + m.pump_leakage * (load + 20.0) * BAR + m.pump_cv_bleed * np.sqrt(load * BAR)
    # a supply that still swings by δp at ω = 120 /s needs C ω δp of flow: the swash's share of it
    capacity = m.pump_line_volume / 1.4e9 + m.pump_line_compliance
    slack = 2 * relative * flow + capacity * 120.0 * (2 * stuck + swing)
    assert end.swash * m.pump_displacement * SPEED == pytest.approx(taken, abs=slack)
    assert end.flow_out == pytest.approx(
        opening * getattr(m, f"valve_cv_out_{side}") * np.sqrt(2.6 * BAR), rel=64 * ROUNDOFF
    )


@pytest.mark.parametrize("supply", [60.0, 120.0, 200.0])
def test_flow_hardly_depends_on_the_supply(supply):
    """The compensator keeps the edge's drop within its setting ± κ/2, whatever is left over the load."""
    m = columns(STEERING)
    start = state(supply=supply * BAR, port_a=40.0 * BAR, port_b=5.0 * BAR, spool=0.5, ls_pressure=40.0 * BAR)
    end = launch(run_kernel, STEERING, OIL, 0.5, NO_ARMS, start, SUBSTEP, 3000, 1, 1)
    edge = m.valve_opening_left_1V0 * m.valve_cv_in_left
    drop = (end.flow_in / edge) ** 2
    assert 0.85 * 7.0 * BAR <= drop <= 1.15 * 7.0 * BAR
    assert drop == pytest.approx(7.0 * BAR * (1.0 + 0.3 * (0.5 - end.compensator)), rel=1e-3)


def test_idle_circuit_rests_at_its_margin():
    m = columns(STEERING)
    end = launch(run_kernel, STEERING, OIL, 0.0, NO_ARMS, state(), SUBSTEP, 300000, 0, 0)
    # ten seconds as above; the swash needs C ω δp for what still swings
    swing = 10.0 * BAR * np.exp(-10.0)
    assert end.supply == pytest.approx(20.0 * BAR, abs=swing)
    taken = m.pump_leakage * 20.0 * BAR
    capacity = m.pump_line_volume / 1.4e9 + m.pump_line_compliance
    assert end.swash * m.pump_displacement * SPEED == pytest.approx(taken, abs=capacity * 120.0 * swing)
    assert end.compensator == 1.0
    assert end.ls_pressure == 0.0
    assert end.flow_in == end.flow_out == 0.0
    # ports and return line level out over the spool's leakage, and nothing leaves while the line's valve to the tank is
    # shut. The rate is leakage/C = 1 /s, so that float32 stalls once dt·Δp·1 /s is less than half an ulp of 3 bar
    stall = ROUNDOFF * 3.4 * BAR / SUBSTEP
    assert end.port_a == pytest.approx(end.tank_line, abs=stall)
    assert end.port_b == pytest.approx(end.tank_line, abs=stall)
    assert 3.0 * BAR < end.tank_line < 3.4 * BAR


def test_blocked_joint_rests_at_the_cutoff():
    """Full command against a stop: the pump at its cut-off, the loaded port on supply, the other one on tank."""
    m = columns(STEERING)
    end = launch(run_kernel, STEERING, OIL, 1.0, NO_ARMS, state(), SUBSTEP, 300000, 0, 0)
    assert end.supply == pytest.approx(210.0 * BAR, rel=1e-5)
    across = 2.0 * m.cylinder_leakage * (end.port_a - end.port_b)
    leak = m.valve_leakage * np.array([end.port_a - end.tank_line, end.port_b - end.tank_line])
    # little flow, so laminar: Δp = Q/C · √1 bar; the compensator is open
    into = m.valve_cv_compensator * m.valve_cv_in_left / np.hypot(m.valve_cv_compensator, m.valve_cv_in_left)
    # 1 % of a few hundredths of a bar is 100 Pa, well above the 2 Pa of a pressure's ulp
    assert end.supply - end.port_a == pytest.approx((across + leak[0]) / into * np.sqrt(BAR), rel=0.01)
    assert end.port_b - end.tank_line == pytest.approx(
        (across - leak[1]) / m.valve_cv_out_left * np.sqrt(BAR), rel=0.01
    )
    through = (end.tank_line - 3.4 * BAR) * m.tank_line_back_flow / m.tank_line_back_pressure_ramp
    assert through == pytest.approx(across + leak[0], rel=0.01)


def test_void_in_a_port_draws_from_the_return_line():
    """A joint turned by force with the valve closed: the growing side fills through its anti-cavitation check."""
    for rate, grows in ((0.5, "port_a"), (-0.5, "port_b")):
        start = state(port_a=-0.5 * BAR, port_b=-0.5 * BAR, tank_line=3.4 * BAR)
        end = launch(step_kernel, STEERING, OIL, 0.0, 0.0, SPEED, rate, NO_ARMS, start, SUBSTEP)
        still = launch(step_kernel, STEERING, OIL, 0.0, 0.0, SPEED, 0.0, NO_ARMS, start, SUBSTEP)
        assert getattr(end, grows) < getattr(still, grows)
        assert still.port_a > -0.5 * BAR
        assert still.port_b > -0.5 * BAR
        assert still.tank_line < 3.4 * BAR
