"""Pump 2 under second-order control, and a load-sensing line with a volume."""

# Device code: its types are Warp's, not Python's.
# pyright: reportInvalidTypeForm=false, reportGeneralTypeIssues=false, reportArgumentType=false

import numpy as np
import pytest
import warp as wp
from scipy.integrate import solve_ivp
from scipy.linalg import expm

from aoro_gym.twin.physics.fluid import Oil, orifice
from aoro_gym.twin.physics.load_sensing_pump import load_sensing_step, swash_step_second_order
from aoro_gym.twin.physics.steering_circuit import Steering
from tests.twin.physics import elements
from tests.twin.physics.deviations import within
from tests.twin.physics.elements import BAR, OIL
from tests.twin.physics.launch import ROUNDOFF, changed, columns, launch, rounded
from tests.twin.physics.steering_elements import STEERING

M = columns(STEERING)


@wp.kernel(enable_backward=False)
def swaying_kernel(
    m: wp.array(dtype=Steering),
    amplitude: wp.array(dtype=float),
    dt: float,
    steps: int,
    swash: wp.array(dtype=float),
    lagged: wp.array(dtype=float),
):
    """The supply sways about the load's pressure and the margin by 40 rad/s."""
    i = wp.tid()
    x = float(0.5)
    v = float(0.0)
    for k in range(steps):
        supply = 1.2e7 - amplitude[i] * wp.sin(40.0 * dt * float(k))
        x, v = swash_step_second_order(m[i], x, v, supply, 1.0e7, dt)
    swash[i] = x
    lagged[i] = v


@wp.kernel(enable_backward=False)
def closed_loop_kernel(
    m: wp.array(dtype=Steering),
    gain: float,
    start: float,
    dt: float,
    steps: int,
    off: wp.array(dtype=float),
):
    """A line that gains ``gain`` [Pa/s] per swash beyond a fixed demand of half a swash: how far its pressure is off."""
    i = wp.tid()
    x = float(0.5)
    v = float(0.0)
    p = float(start)
    for _ in range(steps):
        filled = dt * gain * (x - 0.5)
        x, v = swash_step_second_order(m[i], x, v, 1.2e7 + p, 1.0e7, dt)
        p += filled
    off[i] = p


@wp.kernel(enable_backward=False)
def line_kernel(
    m: wp.array(dtype=Steering),
    oil: wp.array(dtype=Oil),
    start: wp.array(dtype=float),
    load: wp.array(dtype=float),
    dt: float,
    steps: int,
    end: wp.array(dtype=float),
    drawn: wp.array(dtype=float),
    bled: wp.array(dtype=float),
):
    """A line behind its orifice with the load held: its pressure, and the oil that it drew and let go [m³]."""
    i = wp.tid()
    p = start[i]
    for _ in range(steps):
        bled[i] += dt * orifice(m[i].pump_cv_bleed, p, oil[i].laminar_pressure)
        p, flow = load_sensing_step(m[i], oil[i], oil[i].laminar_pressure, p, load[i], dt)
        drawn[i] += dt * flow
    end[i] = p


def driven(amplitude, span):
    """Swash and the valve's lagged error under the swaying supply, by SciPy."""
    lag, lead = M.pump_valve_time_constant, M.pump_valve_lead_time

    def rates(t, x):
        error = amplitude * np.sin(40.0 * t) / M.pump_control_band
        ahead = x[1] + lead / lag * (error - x[1])
        return [
            np.clip(ahead / M.pump_stroke_up_time, -1.0 / M.pump_stroke_down_time, 1.0 / 0.13),
            (error - x[1]) / lag,
        ]

    return solve_ivp(rates, (0.0, span), [0.5, 0.0], rtol=1e-10, atol=1e-12, max_step=1e-4).y[:, -1]


@pytest.mark.parametrize("amplitude", [3.0, 30.0])
def test_second_order_control_leads_its_lagging_valve(amplitude):
    """Within the stroke times and beyond them, at the load-sensing margin; first order in the step."""
    amplitude, span, steps = float(rounded(amplitude * BAR)), 0.03, 1000
    exact = driven(amplitude, span)
    coarse, fine = (
        np.array(launch(swaying_kernel, STEERING, amplitude, span / n, n)) - exact for n in (steps, 2 * steps)
    )
    # An error is a difference of pressures of 120 bar that round, over a band of 10; the lead multiplies it by 5. What both
    # extrapolate to is of second order in dt/τ = 0.03, and of each passing of a clip in the step
    error = amplitude / M.pump_control_band
    rounding = 2.0 * ROUNDOFF * 120.0 / 10.0 * np.array([5.0 * span / 0.13, 1.0]) + 2 * steps * 2 * ROUNDOFF
    second = (span / steps / M.pump_valve_time_constant) ** 2 * 40.0 * M.pump_valve_time_constant * error
    within(
        2.0 * fine - coarse,
        second * np.array([span / 0.13, 1.0]) + 3.0 * rounding,
        law="pump: second_order",
        oracle="SciPy, 1e-10 [-]",
        source="(dt/τ)² of the error, extrapolated; rounding of 120 bar over the band",
    )
    assert np.all(np.abs(fine) < 40.0 * span / steps * error * np.array([5.0 * span / 0.13, 1.0]))


def test_swash_under_second_order_control_takes_its_stroke_times():
    for amplitude, span in ((400.0, 0.04), (-400.0, 0.04)):
        swash, _ = launch(swaying_kernel, STEERING, amplitude * BAR, 1e-4, round(span / 1e-4))
        # saturated but for the first two steps, in which the supply hardly sways yet
        if amplitude > 0.0:
            assert (span - 2e-4) / 0.13 <= swash - 0.5 <= span / 0.13
        else:
            assert swash == 0.0


@pytest.mark.parametrize("lead", [0.5e-3, 5e-3])
def test_lead_beyond_the_lag_is_what_damps_a_compensated_flow(lead):
    """Line and swash in a loop whose flow does not mind the pressure, C ṗ = D ω ε: s² (1 + τ s) + K (1 + T s) = 0 is stable
    just if T > τ (Routh). The device follows the matrix exponential, and grows or falls as its rightmost root says."""
    gain = 18.6e8  # [Pa/s] of full swash at 167 rad/s into 2e-12 m³/Pa
    lag, band, up = M.pump_valve_time_constant, M.pump_control_band, M.pump_stroke_up_time
    lead = float(rounded(lead))
    matrix = np.array(
        [
            [0.0, gain, 0.0],  # line pressure off its target
            [-lead / lag / band / up, 0.0, (1.0 - lead / lag) / up],  # swash
            [-1.0 / band / lag, 0.0, -1.0 / lag],  # what the valve has followed
        ]
    )
    rightmost = np.linalg.eigvals(matrix).real.max()
    assert (rightmost < 0.0) == (lead > lag)
    span, start = 0.06, 0.25 * BAR
    exact = (expm(matrix * span) @ [start, 0.0, 0.0])[0]
    m = changed(STEERING, pump_valve_lead_time=lead)
    coarse, fine = (launch(closed_loop_kernel, m, gain, start, span / n, n) - exact for n in (500, 1000))
    # first order; what both extrapolate to is of second in the loop's 120 rad/s; the pressure of 120 bar, beside which the
    # error is found, rounds by 1 Pa a step, at random
    second = (120.0 * span / 500) ** 2 * 120.0 * span * start
    within(
        2.0 * fine - coarse,
        second + 3.0 * np.sqrt(1000),
        law="pump: second_order",
        oracle="matrix exponential of the loop [Pa]",
        source="second order of the loop's 120 rad/s; 1 Pa a step at random",
    )
    assert abs(fine) < 120.0 * span / 500 * 120.0 * span * start
    assert (np.linalg.norm(expm(matrix * 0.3) @ [start, 0.0, 0.0]) < start) == (lead > lag)


@pytest.mark.parametrize(("start", "load"), [(0.0, 80.0), (80.0, 0.0), (150.0, 40.0)])
def test_load_sensing_line_fills_through_its_orifice(start, load):
    """SciPy on (V/β) ṗ = C √(p_load − p) − C_bleed √p, laminar below 1 bar; first order in the step."""
    start, load, span, steps = start * BAR, load * BAR, 4e-3, 400

    def rate(_, p):
        modulus = 1.4e9 + 10.0 * np.maximum(p, 0.0)
        flow = elements.orifice(M.pump_cv_ls, load - p) - elements.orifice(M.pump_cv_bleed, p)
        return modulus / M.pump_ls_volume * flow

    exact = solve_ivp(rate, (0.0, span), [start], method="LSODA", rtol=1e-10, atol=1e-3, max_step=1e-5).y[0, -1]
    coarse, fine = (launch(line_kernel, STEERING, OIL, start, load, span / n, n)[0] - exact for n in (steps, 2 * steps))
    # the line's rate while it is laminar: K C/√p_lam = 2500 /s, so dt of 0.025 of it; the next order is as much less
    step = 2500.0 * span / steps
    scale = abs(load - start)
    within(
        2.0 * fine - coarse,
        step**2 * scale + 6 * steps * ROUNDOFF * max(load, start),
        law="load_sensing_line: volume",
        oracle="SciPy, 1e-10 [Pa]",
        source="(dt K C/√p_lam)², extrapolated; rounding of each step",
    )
    assert abs(fine) < step * scale


def test_load_sensing_line_keeps_what_it_draws():
    """Drawn less bled is what the oil gained, ∫ V/β dp = V/s ln(β₁/β₀), by the Euler steps to half of their last change of
    β; at rest it draws what it bleeds, and stands below the load by the orifice's drop."""
    start, load, steps, dt = 10.0 * BAR, 150.0 * BAR, 3000, 1e-5
    end, drawn, bled = launch(line_kernel, STEERING, OIL, start, load, dt, steps)
    gained = M.pump_ls_volume / 10.0 * np.log((1.4e9 + 10.0 * end) / (1.4e9 + 10.0 * start))
    # steps of at most 0.5 m³/s/… : each of K dt q, q below C √140 bar, is 1 % of the way, β changes by 10 Δp/β = 10 %
    assert drawn - bled == pytest.approx(gained, rel=0.5 * 0.1 * 0.1, abs=2 * steps * ROUNDOFF * drawn)
    rest, late, gone = launch(line_kernel, STEERING, OIL, end, load, dt, 1000)
    assert late == pytest.approx(gone, rel=1e-3)
    drop = (M.pump_cv_bleed / M.pump_cv_ls) ** 2 * rest
    assert drop < BAR  # so its orifice is laminar
    drop = M.pump_cv_bleed / M.pump_cv_ls * np.sqrt(rest * BAR)
    # stalled where a step, 0.025 of what is missing, is below half an ulp
    assert load - rest == pytest.approx(drop, abs=2 * ROUNDOFF * load / 0.025)
    # nothing drawn and bled where there is no load
    assert launch(line_kernel, STEERING, OIL, 0.0, 0.0, dt, 100) == (0.0, 0.0, 0.0)
