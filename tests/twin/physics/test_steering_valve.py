"""The steering valve's laws beyond the default ones: spool, opening, edges, flow force, compensators, shock valve."""

# Device code: its types are Warp's, not Python's.
# pyright: reportInvalidTypeForm=false, reportGeneralTypeIssues=false, reportArgumentType=false

import numpy as np
import pytest
import warp as wp
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicHermiteSpline, PchipInterpolator
from scipy.optimize import brentq

from aoro_gym.machine.laws import OPTIONS
from aoro_gym.twin.physics.steering_circuit import Steering
from aoro_gym.twin.physics.steering_valve import (
    closed_by_flow,
    compensator_step,
    edge_flow,
    shock_flow,
    smooth_opening,
    spool_step,
    spring_mass_compensator,
    static_compensator,
)
from tests.twin.physics.deviations import within
from tests.twin.physics.elements import BAR, orifice
from tests.twin.physics.launch import ROUNDOFF, changed, columns, launch, rounded
from tests.twin.physics.steering_elements import STEERING

M = columns(STEERING)
SECOND_ORDER = OPTIONS["spool"].index("second_order")


@wp.kernel(enable_backward=False)
def spool_kernel(
    m: wp.array(dtype=Steering),
    demand: wp.array(dtype=float),
    dt: float,
    steps: int,
    spool: wp.array(dtype=float),
    fastest: wp.array(dtype=float),
):
    i = wp.tid()
    x = float(0.0)
    rate = float(0.0)
    for _ in range(steps):
        x, rate = spool_step(m[i], x, rate, demand[i], dt)
        fastest[i] = wp.max(fastest[i], rate)
    spool[i] = x


@wp.kernel(enable_backward=False)
def opening_kernel(
    spool: wp.array(dtype=float),
    overlap: float,
    dead_band: wp.array(dtype=float),
    opening_1V0: wp.array(dtype=float),
    opening_1V5: wp.array(dtype=float),
    opening: wp.array(dtype=float),
):
    i = wp.tid()
    opening[i] = smooth_opening(spool[i], overlap, dead_band[i], opening_1V0[i], opening_1V5[i])


@wp.kernel(enable_backward=False)
def edge_kernel(
    m: wp.array(dtype=Steering),
    coefficient: wp.array(dtype=float),
    drop: wp.array(dtype=float),
    flow: wp.array(dtype=float),
):
    i = wp.tid()
    flow[i] = edge_flow(m[i], coefficient[i], drop[i], 1.0e5)


@wp.kernel(enable_backward=False)
def force_kernel(
    m: wp.array(dtype=Steering),
    demand: wp.array(dtype=float),
    opening: wp.array(dtype=float),
    drop: wp.array(dtype=float),
    left: wp.array(dtype=float),
):
    i = wp.tid()
    left[i] = closed_by_flow(m[i], demand[i], opening[i], drop[i])


@wp.kernel(enable_backward=False)
def compensator_kernel(
    m: wp.array(dtype=Steering),
    start: wp.array(dtype=float),
    available: wp.array(dtype=float),
    ratio: wp.array(dtype=float),
    bias: wp.array(dtype=float),
    dt: float,
    steps: int,
    opening: wp.array(dtype=float),
    end_rate: wp.array(dtype=float),
):
    i = wp.tid()
    y = start[i]
    rate = float(0.0)
    for _ in range(steps):
        if m[i].compensator_law == 1:
            y = static_compensator(m[i], y, available[i], ratio[i], bias[i])
        elif m[i].compensator_law == 2:
            y, rate = spring_mass_compensator(m[i], y, rate, available[i], ratio[i], bias[i], dt)
        else:
            y = compensator_step(m[i], y, available[i], ratio[i], bias[i], dt)
    opening[i] = y
    end_rate[i] = rate


@wp.kernel(enable_backward=False)
def shock_kernel(
    m: wp.array(dtype=Steering), port: wp.array(dtype=float), tank: wp.array(dtype=float), flow: wp.array(dtype=float)
):
    i = wp.tid()
    flow[i] = shock_flow(m[i], port[i], tank[i])


# ---- spool ----


def spool_response(frequency, damping, demand, t):
    """Step response from rest of ẍ = ω² (u − x) − 2 ζ ω ẋ by its two poles."""
    root = np.sqrt(complex(damping**2 - 1.0))
    first, second = frequency * (-damping + root), frequency * (-damping - root)
    return demand * (1.0 + (second * np.exp(first * t) - first * np.exp(second * t)) / (first - second)).real


@pytest.mark.parametrize("damping", [0.3, 0.85, 2.0])
@pytest.mark.parametrize("duration", [0.008, 0.03])
def test_second_order_spool_follows_its_poles(damping, duration):
    """From under- to overdamped, in the rise and after it; first order in the step, so what two steps extrapolate to is of
    second: (ω dt)² ω t of the demand."""
    m = changed(STEERING, spool_law=SECOND_ORDER, valve_spool_damping=damping)
    frequency, damping = M.valve_spool_frequency, float(rounded(damping))
    demand, steps = 0.0625, 200
    exact = spool_response(frequency, damping, demand, duration)
    coarse, fine = (launch(spool_kernel, m, demand, duration / n, n)[0] - exact for n in (steps, 2 * steps))
    step = frequency * duration / steps
    rounding = 2 * steps * ROUNDOFF * demand
    within(
        2.0 * fine - coarse,
        step**2 * max(frequency * duration, 1.0) * demand + 3.0 * rounding,
        law="spool: second_order",
        oracle="step response by its two poles [-]",
        source="(ω dt)² ω t of the demand, extrapolated; rounding of each step",
    )
    assert rounding < abs(fine) < step * (1.0 + damping) * demand


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_second_order_spool_keeps_the_pilots_rate(side):
    m = changed(STEERING, spool_law=SECOND_ORDER)
    dt, limit = 1e-4, M.valve_spool_rate_limit
    spool, fastest = launch(spool_kernel, m, side, dt, 400)
    if side > 0.0:
        assert fastest == limit  # of an unlimited 48 /s
    # the limit is reached within 2 ms: ω² u t = limit after 0.7 ms
    assert (0.04 - 2e-3) * limit < side * spool <= 0.04 * limit * (1.0 + 400 * ROUNDOFF)


# ---- opening ----

CURVES = [(0.27, 0.289, 0.783), (0.35, 0.191, 0.661), (0.1, 0.6, 0.65)]


@pytest.mark.parametrize("overlap", [0.0, 0.2])
@pytest.mark.parametrize("curve", CURVES)
def test_smooth_opening_is_the_monotone_cubic(curve, overlap):
    """SciPy's Pchip has the same slopes (Fritsch and Butland) at inner points; the ends are 0 and the last secant."""
    dead_band, at_1V0, at_1V5 = rounded(curve)
    volts, openings = np.array([dead_band, 1.0, 1.5, 2.0]), np.array([0.0, at_1V0, at_1V5, 1.0])
    slopes = PchipInterpolator(volts, openings).derivative()(volts)
    slopes[0], slopes[-1] = 0.0, 2.0 * (1.0 - at_1V5)
    spline = CubicHermiteSpline(volts, openings, slopes)
    spool = rounded(np.linspace(-1.3, 1.3, 2601))
    expected = spline(np.clip(2.0 * np.abs(spool) - rounded(overlap), dead_band, 2.0))
    opening = launch(opening_kernel, spool, overlap, *curve)
    # volts of up to 2.6 and s round, times the steepest slope of 2.5 /V; a dozen operations on numbers up to 1
    within(
        opening - expected,
        (4 * 2.6 * 2.5 + 12) * ROUNDOFF,
        law="opening: smooth",
        oracle="monotone cubic in float64 [-]",
        source="rounding of the volts times the steepest slope",
    )
    half = opening[1300:]
    assert np.all(np.diff(half) >= -4 * ROUNDOFF)
    assert half[0] == 0.0
    assert half[-1] == pytest.approx(1.0, abs=4 * ROUNDOFF)
    at_points = launch(opening_kernel, 0.5 * (volts + overlap), overlap, *curve)
    np.testing.assert_allclose(at_points, openings, atol=32 * ROUNDOFF)


@pytest.mark.parametrize("curve", CURVES)
def test_smooth_opening_has_no_kink(curve):
    """Slopes on both sides of a measured point differ by its curvature over what they are taken over: C¹."""
    h = 2.0**-8  # [V]
    for point in (curve[0], 1.0, 1.5):
        below, at, above = launch(opening_kernel, 0.5 * (point + h * np.array([-1.0, 0.0, 1.0])), 0.0, *curve)
        # second derivatives of these cubics are below 6 · 2.5 / 0.5; either difference is off by h/2 of them
        assert abs((above - at) - (at - below)) < h * h * 30.0 + 64 * ROUNDOFF


# ---- edges ----

SMOOTH = changed(STEERING, orifice_law=OPTIONS["orifice"].index("smooth"))


def test_smooth_edge_is_laminar_below_and_turbulent_above():
    drop = rounded(np.concatenate([[0.0], 10.0 ** np.linspace(-2.0, 7.5, 400)]))
    coefficient = float(rounded(1e-6))
    flow = launch(edge_kernel, SMOOTH, coefficient, drop)
    law = coefficient * drop / (drop**2 + BAR**2) ** 0.25
    within(
        flow - law,
        8 * ROUNDOFF * np.abs(law),
        law="orifice: smooth",
        oracle="closed form [m³/s]",
        source="rounding: 8 units in the last place",
    )
    np.testing.assert_array_equal(launch(edge_kernel, SMOOTH, coefficient, -drop), -flow)
    assert np.all(np.diff(flow) > 0.0)
    # x = Δp/p_lam: between C Δp/√p_lam less x²/4, and C √Δp less 1/(4 x²)
    little, much = drop < 0.1 * BAR, drop > 10.0 * BAR
    x = drop / BAR
    laminar, turbulent = coefficient * drop / np.sqrt(BAR), coefficient * np.sqrt(drop)
    assert np.all(np.abs(flow - laminar)[little] <= ((0.25 * x**2 + 8 * ROUNDOFF) * laminar)[little])
    assert np.all(np.abs(flow - turbulent)[much] <= ((0.25 / x[much] ** 2 + 8 * ROUNDOFF) * turbulent[much]))
    # where they meet it is farthest from the switched law: 2^(−1/4)
    assert np.min(flow[1:] / orifice(coefficient, drop[1:])) == pytest.approx(2.0**-0.25, rel=1e-3)


# ---- flow force ----


def test_flow_force_closes_by_a_share_of_the_stroke():
    """5 % at the compensator's setting with the edge fully open, in proportion to area and drop, and never beyond closed."""
    rng = np.random.default_rng(1)
    demand, opening = rounded(rng.uniform(-1.0, 1.0, 1000)), rounded(rng.uniform(0.0, 1.0, 1000))
    drop = rounded(rng.uniform(0.0, 60.0, 1000) * BAR)
    moved = M.valve_flow_force_share * opening * drop / M.valve_compensator_pressure
    expected = np.sign(demand) * np.maximum(np.abs(demand) - moved, 0.0)
    within(
        launch(force_kernel, STEERING, demand, opening, drop) - expected,
        6 * ROUNDOFF,
        law="flow_force: steady",
        oracle="share of the stroke [-]",
        source="rounding of a stroke of 1",
    )
    assert 0.05 < np.mean(expected == 0.0) < 0.5
    full = launch(force_kernel, STEERING, 1.0, 1.0, M.valve_compensator_pressure)
    assert full == pytest.approx(1.0 - 0.05, abs=4 * ROUNDOFF)


# ---- compensators ----

LAG, STATIC, SPRING_MASS = (OPTIONS["compensator"].index(name) for name in ("lag", "static", "spring_mass"))


def excess(y, available, ratio, bias):
    """Spring less pressures [Pa]: p_ref (1 + κ (½ − y)) − Δp y²/(y² + ρ²) − b."""
    return (
        M.valve_compensator_pressure * (1.0 + M.valve_compensator_droop * (0.5 - y))
        - available * y * y / (y * y + ratio * ratio)
        - bias
    )


def balance(available, ratio, bias=0.0):
    """Root of :func:`excess`, which falls with y, or the stop that it presses against."""
    if excess(1.0, available, ratio, bias) >= 0.0:
        return 1.0
    if excess(0.0, available, ratio, bias) <= 0.0:
        return 0.0
    return brentq(excess, 0.0, 1.0, args=(available, ratio, bias), xtol=1e-13)


def loads(count, seed):
    rng = np.random.default_rng(seed)
    available = rounded(10.0 ** rng.uniform(0.0, np.log10(200.0), count) * BAR)
    return available, rounded(10.0 ** rng.uniform(-1.5, 0.0, count)), rng


@pytest.mark.parametrize("bias", [-2.0, 0.0, 5.0, 12.0])
def test_static_compensator_balances_its_spring(bias):
    """Drops from idle to cut-off, started anywhere: in a few calls at the balance or at a stop."""
    available, ratio, rng = loads(400, 2)
    bias = float(rounded(bias * BAR))
    expected = np.array([balance(a, r, bias) for a, r in zip(available, ratio, strict=True)])
    m = changed(STEERING, compensator_law=STATIC)
    y, _ = launch(compensator_kernel, m, rng.uniform(0.0, 1.0, 400), available, ratio, bias, 0.0, 8)
    # pressures of the size of the setting and the bias round, over a slope of at least κ p_ref
    tolerance = 16 * ROUNDOFF * (1.15 + abs(bias) / M.valve_compensator_pressure) / M.valve_compensator_droop
    within(
        y - expected,
        tolerance + 4 * ROUNDOFF,
        law="compensator: static",
        oracle="root of the balance by Brent [-]",
        source="rounding of the pressures over the spring's slope κ",
    )
    assert (bias > 8.0 * BAR) == bool(np.all(expected == 0.0))
    assert np.any(expected == 1.0) == (bias < 8.0 * BAR)


def test_static_compensator_follows_a_moving_load_within_a_substep():
    """Newton's error squares three times: of a load that moves the balance by 1 % of the stroke less than 1e-6 is left."""
    available, ratio, _ = loads(400, 3)
    m = changed(STEERING, compensator_law=STATIC)
    expected = np.array([balance(a, r) for a, r in zip(available, ratio, strict=True)])
    moving = (expected > 0.05) & (expected < 0.95)
    start = expected + 0.01 * np.where(np.arange(400) % 2, 1.0, -1.0)
    y, _ = launch(compensator_kernel, m, start, available, ratio, 0.0, 0.0, 1)
    tolerance = 16 * ROUNDOFF * 1.15 / M.valve_compensator_droop + 1e-6
    assert np.sum(moving) > 100
    assert np.all(np.abs(y - expected)[moving] <= tolerance)


@pytest.mark.parametrize("bias", [0.0, 3.0])
def test_spring_mass_compensator_is_a_damped_oscillator(bias):
    """SciPy on ÿ = ω² (1 + κ (½ − y) − (Δp_edge + b)/p_ref) − 2 ζ ω ẏ between its stops; first order in the step."""
    available, ratio, span = rounded(np.array([20.0 * BAR, 0.6, 4e-3]))
    bias = float(rounded(bias * BAR))
    omega, zeta = M.valve_compensator_frequency, M.valve_compensator_damping

    def rates(_, x):
        push = excess(x[0], available, ratio, bias) / M.valve_compensator_pressure
        return [x[1], omega**2 * push - 2.0 * zeta * omega * x[1]]

    exact = solve_ivp(rates, (0.0, span), [0.9, 0.0], rtol=1e-10, atol=1e-12).y[:, -1]
    assert 0.1 < exact[0] < 0.85
    m = changed(STEERING, compensator_law=SPRING_MASS)
    runs = [launch(compensator_kernel, m, 0.9, available, ratio, bias, span / n, n) for n in (200, 400)]
    coarse, fine = (np.array(run) - exact for run in runs)
    # of first order; what both extrapolate to is of second, (w dt)² w t of a stroke at w of up to 3 ω, and rounds 400 times
    scale = np.array([1.0, 3.0 * omega])
    step = 3.0 * omega * span / 200
    within(
        (2.0 * fine - coarse) / scale,
        step**2 * 3.0 * omega * span + 3 * 400 * ROUNDOFF,
        law="compensator: spring_mass",
        oracle="SciPy, 1e-10 [of a stroke]",
        source="(3 ω dt)² 3 ω t, extrapolated; rounding of 400 steps",
    )
    assert np.all(np.abs(fine) < 0.5 * step * scale)
    assert abs(fine[0]) > 1e-4


def test_spring_mass_compensator_ends_where_the_static_one_does_and_stops_at_its_ends():
    available, ratio, rng = loads(200, 4)
    expected = np.array([balance(a, r) for a, r in zip(available, ratio, strict=True)])
    m = changed(STEERING, compensator_law=SPRING_MASS, valve_compensator_damping=4.0)
    y, _ = launch(compensator_kernel, m, rng.uniform(0.0, 1.0, 200), available, ratio, 0.0, 1e-4, 20000)
    # as of the static one; the rate stalls once ω² dt times the push is below half the rate's ulp, which is none at 0; and
    # y once dt ẏ is below half its ulp: ẏ = ω/(2 ζ) of the push, so a push of 2⁻²⁵ 2 ζ/(ω dt) over a slope of κ
    tolerance = (16 * 1.15 + 2.0 * 4.0 / (M.valve_compensator_frequency * 1e-4)) * ROUNDOFF / M.valve_compensator_droop
    within(
        y - expected,
        tolerance + 2 * ROUNDOFF,
        law="compensator: spring_mass",
        oracle="rest where the static one has it [-]",
        source="rounding over κ, and where the rate's increment is below half its last place",
    )
    assert np.any(expected == 1.0)
    shut, still = launch(compensator_kernel, m, 1.0, 0.0, 0.5, 12.0 * BAR, 1e-4, 2000)
    assert (shut, still) == (0.0, 0.0)
    opened, still = launch(compensator_kernel, m, 0.0, 0.0, 0.5, 0.0, 1e-4, 2000)
    assert (opened, still) == (1.0, 0.0)


@pytest.mark.parametrize("bias", [-2.0, 3.0, 12.0])
def test_lagged_compensator_settles_where_its_bias_shifts_it(bias):
    """What it senses on top of its edge moves the balance; it may shut altogether."""
    available, ratio, rng = loads(400, 5)
    bias = float(rounded(bias * BAR))
    expected = np.array([balance(a, r, bias) for a, r in zip(available, ratio, strict=True)])
    m = changed(STEERING, compensator_sensing_law=1)
    y, _ = launch(compensator_kernel, m, rng.uniform(0.0, 1.0, 400), available, ratio, bias, 1e-4, 4000)
    tolerance = (
        (16 * (1.15 + abs(bias) / M.valve_compensator_pressure) + 4 / 0.1) * ROUNDOFF / M.valve_compensator_droop
    )
    within(
        y - expected,
        tolerance + 2 * ROUNDOFF,
        law="compensator_sensing: load_sensing_line",
        oracle="root of the balance by Brent [-]",
        source="rounding of the pressures over κ, and of slow steps",
    )
    assert np.all(expected == 0.0) == (bias > 10.0 * BAR)


def test_shock_valve_opens_over_its_ramp():
    port, tank = rounded(np.array([150.0, 210.0, 213.4, 223.4]) * BAR), 3.4 * BAR
    over = np.maximum(port - rounded(tank) - M.valve_shock_pressure, 0.0)
    expected = over * M.valve_shock_flow / M.valve_shock_ramp
    # a difference of pressures of 220 bar, over a ramp of 10
    np.testing.assert_allclose(
        launch(shock_kernel, STEERING, port, tank), expected, atol=4 * ROUNDOFF * 22.0 * M.valve_shock_flow
    )
