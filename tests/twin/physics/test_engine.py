"""The engine: torque curve, governor and speed against closed forms and SciPy."""

# Device code: its types are Warp's, not Python's.
# pyright: reportInvalidTypeForm=false, reportGeneralTypeIssues=false, reportArgumentType=false

import numpy as np
import pytest
import warp as wp
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from aoro_gym.twin.physics.engine import Engine, EngineState, engine_step, full_load_torque, governed_speed
from tests.twin.physics.launch import ROUNDOFF, changed, columns, launch, record

RPM = np.pi / 30.0
CURVE_RPM = np.array([900.0, 1200.0, 1400.0, 1600.0, 1800.0, 2000.0, 2200.0, 2400.0])
CURVE_TORQUE = np.array([430.0, 590.0, 635.0, 630.0, 605.0, 575.0, 540.0, 513.0])

ENGINE = record(
    Engine,
    set_speed=1595.0 * RPM,
    inertia=1.4,
    friction_0=30.67,
    friction_1=0.2122,
    governor_proportional=8.0,
    governor_integral=40.0,
    droop=0.0,
    torque_time_constant=0.05,
    smoke_rate=1500.0,
    **{f"torque_rpm_{rpm:.0f}": torque for rpm, torque in zip(CURVE_RPM, CURVE_TORQUE, strict=True)},
)


@wp.kernel(enable_backward=False)
def curve_kernel(engine: wp.array(dtype=Engine), speed: wp.array(dtype=float), torque: wp.array(dtype=float)):
    i = wp.tid()
    torque[i] = full_load_torque(engine[i], speed[i])


@wp.kernel(enable_backward=False)
def governed_kernel(
    engine: wp.array(dtype=Engine),
    brake: wp.array(dtype=float),
    full: wp.array(dtype=float),
    speed: wp.array(dtype=float),
):
    i = wp.tid()
    speed[i] = governed_speed(engine[i], brake[i], full[i])


@wp.kernel(enable_backward=False)
def run_kernel(
    engine: wp.array(dtype=Engine),
    start: wp.array(dtype=EngineState),
    load: wp.array(dtype=float),
    dt: wp.array(dtype=float),
    steps: wp.array(dtype=int),
    end: wp.array(dtype=EngineState),
    fastest_rise: wp.array(dtype=float),
    lowest_speed: wp.array(dtype=float),
    largest_excess: wp.array(dtype=float),
):
    """Steps under a constant load; also the extremes of torque rate, speed and of the integral over its limit."""
    i = wp.tid()
    s = start[i]
    rise = float(0.0)
    lowest = s.speed
    excess = float(-1.0e9)
    for _ in range(steps[i]):
        new = engine_step(engine[i], s, load[i], dt[i])
        rise = wp.max(rise, (new.torque - s.torque) / dt[i])
        lowest = wp.min(lowest, new.speed)
        limit = full_load_torque(engine[i], s.speed) + engine[i].friction_0 + engine[i].friction_1 * s.speed
        excess = wp.max(excess, wp.max(new.integral - limit, -new.integral))
        s = new
    end[i] = s
    fastest_rise[i] = rise
    lowest_speed[i] = lowest
    largest_excess[i] = excess


def friction(engine, speed):
    return engine.friction_0 + engine.friction_1 * speed


def brake_curve(speed):
    """Brake torque [N m] of the curve, zero at 300 and 2600 rpm and beyond."""
    points = np.concatenate([[0.0, 300.0], CURVE_RPM, [2600.0, 4000.0]])
    return np.interp(speed / RPM, points, np.concatenate([[0.0, 0.0], CURVE_TORQUE, [0.0, 0.0]]))


def running(load=0.0, speed=None):
    """The engine's steady state under ``load`` at its set speed (or another)."""
    engine = columns(ENGINE)
    speed = engine.set_speed if speed is None else speed
    torque = friction(engine, speed) + load
    return record(EngineState, speed=speed, integral=torque, torque=torque)


def test_curve_passes_through_its_points():
    torque = launch(curve_kernel, ENGINE, CURVE_RPM * RPM)
    # a point's speed is rounded: 3 roundings of the speed times the steepest slope of 513/200 N m per rpm
    np.testing.assert_allclose(torque, CURVE_TORQUE, atol=3 * ROUNDOFF * 2400.0 * 2.6 + 3 * ROUNDOFF * 635.0)


def test_curve_is_linear_between_its_points_and_zero_outside():
    speed = np.concatenate([np.linspace(0.0, 2600.0, 2001), [2600.0, 2700.0, 5000.0, 1e5]]) * RPM
    torque = launch(curve_kernel, ENGINE, speed)
    np.testing.assert_allclose(torque, brake_curve(speed), atol=4 * ROUNDOFF * 2600.0 * 2.6 + 4 * ROUNDOFF * 635.0)
    assert np.all(launch(curve_kernel, ENGINE, np.array([-10.0, 0.0, 299.9, 2601.0, 1e5]) * RPM) == 0.0)


@pytest.mark.parametrize("load", [0.0, 150.0, 300.0, 550.0])
def test_governor_holds_the_set_speed_under_any_load(load):
    """Isochronous: no droop. The torque is then friction and load."""
    engine = columns(ENGINE)
    # from 70 % of the load: all of it at once would stall the engine under its smoke limit
    end, *_ = launch(run_kernel, ENGINE, running(0.7 * load), load, 1e-3, 20000)
    # ω² = Ki/J, damped by Kp/2J = 2.9 /s and less by the lag: gone after 20 s. What is left is float32: the integral
    # moves no more once dt·Ki·error is less than half an ulp of it (2⁻²⁴ of at most 620 N m)
    dead_zone = ROUNDOFF * 620.0 / (1e-3 * 40.0)
    assert end.speed == pytest.approx(engine.set_speed, abs=2 * dead_zone)
    # the speed rests once dt/J·(torque error) is less than half its ulp
    torque_error = 2 * ROUNDOFF * 170.0 * 1.4 / 1e-3
    assert end.torque == pytest.approx(friction(engine, engine.set_speed) + load, abs=2 * torque_error)
    assert end.integral == pytest.approx(end.torque, abs=2 * torque_error + 8.0 * 2 * dead_zone)


@pytest.mark.parametrize("load", [0.0, 150.0, 550.0, -30.0])
def test_droop_lowers_the_speed_by_the_share_of_full_load(load):
    """n = n₀ (1 − δ T/T_full(n)) with T the brake torque; a machine that drives its engine does not raise it."""
    engine = columns(changed(ENGINE, droop=0.05))

    def excess(speed):
        return speed - engine.set_speed * (1.0 - engine.droop * np.clip(load / brake_curve(speed), 0.0, 1.0))

    expected = brentq(excess, 0.9 * engine.set_speed, engine.set_speed + 1e-9, xtol=1e-12)
    end, *_ = launch(run_kernel, changed(ENGINE, droop=0.05), running(max(0.7 * load, load)), load, 1e-3, 20000)
    # as without droop: the integral rests where a step no longer moves it
    assert end.speed == pytest.approx(expected, abs=4 * ROUNDOFF * 620.0 / (1e-3 * 40.0))


def test_steps_converge_to_the_continuous_engine():
    """A load step of 300 N m against SciPy, first order in the step."""
    engine = columns(ENGINE)
    load = 300.0

    def rate(_, state):
        speed, integral, torque = state
        limit = brake_curve(speed) + friction(engine, speed)
        error = engine.set_speed - speed
        demand = np.clip(engine.governor_proportional * error + integral, 0.0, limit)
        return [
            (torque - friction(engine, speed) - load) / engine.inertia,
            engine.governor_integral * error,
            min((demand - torque) / engine.torque_time_constant, engine.smoke_rate),
        ]

    start = columns(running())
    exact = solve_ivp(rate, (0.0, 0.4), [start.speed, start.integral, start.torque], rtol=1e-10, atol=1e-9).y[:, -1]
    assert exact[0] < start.speed - 1.0  # it still sags: the smoke limit and the lag both have acted
    errors = []
    for steps in (2000, 4000):
        end, *_ = launch(run_kernel, ENGINE, running(), load, 0.4 / steps, steps)
        errors.append(np.array([end.speed, end.integral, end.torque]) - exact)
    np.testing.assert_allclose(errors[0] / errors[1], 2.0, rtol=0.1)
    assert np.all(np.abs(errors[1]) < 1e-3 * np.abs(exact))


def test_torque_rises_no_faster_than_the_smoke_limit_and_falls_freely():
    _, rise, _, _ = launch(run_kernel, ENGINE, running(), 500.0, 1e-3, 2000)
    # a torque's ulp over dt
    assert rise == pytest.approx(1500.0, abs=2 * ROUNDOFF * 700.0 / 1e-3)
    # overspeed without an integral: the demand is zero and the torque decays with its lag, faster than 1500 N m/s
    fast = record(EngineState, speed=260.0, integral=0.0, torque=600.0)
    end, *_ = launch(run_kernel, ENGINE, fast, 0.0, 1e-4, 400)
    # Euler: (1 − dt/τ)^n against exp(−n dt/τ), relative n (dt/τ)²/2
    assert end.torque == pytest.approx(600.0 * np.exp(-0.04 / 0.05), rel=400 * 0.002**2 / 2 + 400 * 2 * ROUNDOFF)


def test_overload_stalls_the_engine_and_it_never_runs_backwards():
    end, _, lowest, _ = launch(run_kernel, ENGINE, running(), 700.0, 1e-3, 5000)
    assert end.speed == 0.0
    assert lowest == 0.0
    # what the curve carries at a lower speed is no stall: 600 N m at 1595 rpm hold
    end, *_ = launch(run_kernel, ENGINE, running(load=500.0), 600.0, 1e-3, 20000)
    assert end.speed == pytest.approx(columns(ENGINE).set_speed, rel=1e-4)


def test_stalled_engine_stays_at_rest_without_load():
    start = record(EngineState, speed=0.0, integral=0.0, torque=0.0)
    end, *_ = launch(run_kernel, ENGINE, start, 0.0, 1e-3, 3000)
    # below 300 rpm the curve gives nothing but its own friction
    assert end.speed == pytest.approx(0.0, abs=1e-3)


def test_integral_never_winds_up():
    for load in (-300.0, 0.0, 590.0, 640.0, 900.0):
        *_, excess = launch(run_kernel, ENGINE, running(), load, 1e-3, 3000)
        # recomputing the limit rounds it once more
        assert excess <= 2 * ROUNDOFF * 700.0
    # an overload that is taken away in time: the speed comes back without a long overshoot
    dragged, *_ = launch(run_kernel, ENGINE, running(), 900.0, 1e-3, 150)
    assert dragged.speed < 150.0
    state = record(EngineState, speed=dragged.speed, integral=dragged.integral, torque=dragged.torque)
    end, *_ = launch(run_kernel, ENGINE, state, 0.0, 1e-3, 6000)
    assert end.speed == pytest.approx(columns(ENGINE).set_speed, rel=1e-3)


def test_driven_engine_cuts_its_fuel():
    """A pump that drives the engine up finds its friction only: T → 0, J ω' = −T_f − load."""
    engine = columns(ENGINE)
    load = -200.0
    end, *_ = launch(run_kernel, ENGINE, running(), load, 1e-4, 20000)
    assert end.integral == 0.0
    assert end.torque == pytest.approx(0.0, abs=1e-3)
    # the speed tends to where friction takes the load: ω = (200 − f₀)/f₁, with J/f₁ = 6.6 s; a further second:
    state = record(EngineState, speed=end.speed, integral=end.integral, torque=0.0)
    later, *_ = launch(run_kernel, ENGINE, state, load, 1e-4, 10000)
    limit = (-load - engine.friction_0) / engine.friction_1
    expected = limit + (float(end.speed) - limit) * np.exp(-engine.friction_1 / engine.inertia)
    # Euler: relative error of dt f₁/(2J) of the change; float32: an ulp of ω a step
    tolerance = abs(expected - float(end.speed)) * 1e-4 + 10000 * ROUNDOFF * expected
    assert later.speed == pytest.approx(expected, abs=tolerance)
    assert later.speed > end.speed > engine.set_speed


def test_speed_changes_by_the_surplus_torque_over_the_inertia():
    """One step of random states: J Δω = (T − T_f − load) Δt, with the torque after its own step."""
    rng = np.random.default_rng(1)
    count = 1000
    engine = columns(ENGINE)
    start = record(
        EngineState,
        speed=rng.uniform(80.0, 250.0, count),
        integral=rng.uniform(0.0, 600.0, count),
        torque=rng.uniform(0.0, 650.0, count),
    )
    load = np.float32(rng.uniform(-300.0, 700.0, count)).astype(float)
    dt = 0.01
    end, *_ = launch(run_kernel, ENGINE, start, load, dt, 1)
    s = columns(start)
    gain = float(np.float32(dt)) / engine.inertia
    expected = s.speed + gain * (end.torque - friction(engine, s.speed) - load)
    np.testing.assert_allclose(end.speed, expected, atol=2 * ROUNDOFF * 260.0 + 8 * ROUNDOFF * gain * 1500.0)


def test_heavier_engine_sags_less():
    light, *_ = launch(run_kernel, ENGINE, running(), 300.0, 1e-3, 100)
    heavy, *_ = launch(run_kernel, changed(ENGINE, inertia=2.8), running(), 300.0, 1e-3, 100)
    assert light.speed < heavy.speed < columns(ENGINE).set_speed


def test_droop_ends_at_full_load():
    engine = columns(changed(ENGINE, droop=0.05))
    torque, full = np.array([-100.0, 0.0, 300.0, 600.0, 900.0, 1e4]), 600.0
    speed = launch(governed_kernel, changed(ENGINE, droop=0.05), torque, full)
    expected = engine.set_speed * (1.0 - engine.droop * np.array([0.0, 0.0, 0.5, 1.0, 1.0, 1.0]))
    np.testing.assert_allclose(speed, expected, rtol=4 * ROUNDOFF)
