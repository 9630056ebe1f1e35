"""Seals, stiction, end stops and lags against closed forms and energy balances."""

# Device code: its types are Warp's, not Python's.
# pyright: reportInvalidTypeForm=false, reportGeneralTypeIssues=false, reportArgumentType=false

import numpy as np
import pytest
import warp as wp

from aoro_gym.twin.physics.friction import dry_friction, end_stop, lag, presliding, seal_friction
from tests.twin.physics.launch import ROUNDOFF, launch, rounded


@wp.kernel(enable_backward=False)
def seal_kernel(
    preload: wp.array(dtype=float),
    slope: wp.array(dtype=float),
    pressures: wp.array(dtype=float),
    static_ratio: wp.array(dtype=float),
    stribeck: wp.array(dtype=float),
    speed: wp.array(dtype=float),
    capacity: wp.array(dtype=float),
):
    i = wp.tid()
    capacity[i] = seal_friction(preload[i], slope[i], pressures[i], static_ratio[i], stribeck[i], speed[i])


@wp.kernel(enable_backward=False)
def torque_kernel(
    deflection: wp.array(dtype=float),
    rate: wp.array(dtype=float),
    capacity: wp.array(dtype=float),
    stiffness: wp.array(dtype=float),
    damping: wp.array(dtype=float),
    torque: wp.array(dtype=float),
):
    i = wp.tid()
    torque[i] = dry_friction(deflection[i], rate[i], capacity[i], stiffness[i], damping[i])


@wp.kernel(enable_backward=False)
def driven_kernel(
    rate: wp.array2d(dtype=float),
    capacity: wp.array2d(dtype=float),
    stiffness: wp.array(dtype=float),
    damping: wp.array(dtype=float),
    dt: wp.array(dtype=float),
    torque: wp.array2d(dtype=float),
    deflection: wp.array2d(dtype=float),
):
    """An element that is moved: the torque acts at the mean deflection of every step."""
    i = wp.tid()
    z = float(0.0)
    for k in range(rate.shape[1]):
        new = presliding(z, rate[i, k], dt[i], capacity[i, k], stiffness[i])
        torque[i, k] = dry_friction(0.5 * (z + new), rate[i, k], capacity[i, k], stiffness[i], damping[i])
        deflection[i, k] = new
        z = new


@wp.kernel(enable_backward=False)
def loaded_kernel(
    mean: wp.array(dtype=float),
    amplitude: wp.array(dtype=float),
    frequency: wp.array(dtype=float),
    growth: wp.array(dtype=float),
    start_rate: wp.array(dtype=float),
    inertia: float,
    stiffness: float,
    damping: float,
    capacity: float,
    dt: float,
    steps: int,
    position: wp.array(dtype=float),
    rate: wp.array(dtype=float),
    slide: wp.array(dtype=float),
    load_at_slide: wp.array(dtype=float),
):
    """A mass held by the element under a load; ``slide`` is the largest position less deflection."""
    i = wp.tid()
    z = mean[i] / stiffness
    x = z
    v = start_rate[i]
    slipped = float(0.0)
    at_slide = float(0.0)
    phase = float(0.0)
    load = mean[i]
    for k in range(steps):
        phase += frequency[i] * dt
        phase -= wp.floor(phase)
        load = mean[i] + growth[i] * dt * float(k) + amplitude[i] * wp.sin(6.2831853 * phase)
        v += dt * (load + dry_friction(z, v, capacity, stiffness, damping)) / inertia
        x += dt * v
        z = presliding(z, v, dt, capacity, stiffness)
        if wp.abs(x - z) > slipped:
            slipped = wp.abs(x - z)
            if at_slide == 0.0:
                at_slide = load
    position[i] = x
    rate[i] = v
    slide[i] = slipped
    load_at_slide[i] = at_slide


@wp.kernel(enable_backward=False)
def stop_kernel(
    position: wp.array(dtype=float),
    rate: wp.array(dtype=float),
    limit: wp.array(dtype=float),
    stiffness: wp.array(dtype=float),
    damping: wp.array(dtype=float),
    torque: wp.array(dtype=float),
):
    i = wp.tid()
    torque[i] = end_stop(position[i], rate[i], limit[i], stiffness[i], damping[i])


@wp.kernel(enable_backward=False)
def bounce_kernel(
    position: wp.array(dtype=float),
    rate: wp.array(dtype=float),
    stiffness: wp.array(dtype=float),
    damping: wp.array(dtype=float),
    dt: float,
    steps: int,
    rate_after: wp.array(dtype=float),
    outermost: wp.array(dtype=float),
):
    """A unit mass that runs into the stop at ±1 (leapfrog)."""
    i = wp.tid()
    # the penetration is integrated, not the position: it is the small number
    side = wp.sign(position[i])
    pen = float(0.0)
    v = rate[i]
    far = float(0.0)
    for _ in range(steps):
        pen += 0.5 * dt * side * v
        v += dt * end_stop(side * (1.0e-9 + wp.max(pen, 0.0)), v, 1.0e-9, stiffness[i], damping[i])
        pen += 0.5 * dt * side * v
        far = wp.max(far, pen)
    rate_after[i] = v
    outermost[i] = far


@wp.kernel(enable_backward=False)
def lag_kernel(
    x: wp.array(dtype=float),
    target: wp.array(dtype=float),
    time_constant: wp.array(dtype=float),
    rate_limit: wp.array(dtype=float),
    dt: wp.array(dtype=float),
    out: wp.array(dtype=float),
):
    i = wp.tid()
    out[i] = lag(x[i], target[i], time_constant[i], rate_limit[i], dt[i])


# ---- seals ----


def test_seal_friction_between_rest_and_sliding():
    preload, slope, pressures, ratio, stribeck = (float(rounded(x)) for x in (250.0, 1e-4, 2.5e7, 1.3, 0.01))
    sliding = preload + slope * pressures
    speed = rounded(np.array([0.0, 0.005, 0.01, -0.01, 0.02, 10.0, -10.0]))
    expected = sliding * (1.0 + (ratio - 1.0) * np.exp(-((speed / stribeck) ** 2)))
    capacity = launch(seal_kernel, preload, slope, pressures, ratio, stribeck, speed)
    # half a dozen operations; the exponent's rounding is multiplied by its size, at most 4 where exp still counts
    np.testing.assert_allclose(capacity, expected, rtol=12.0 * ROUNDOFF)
    assert capacity[0] == pytest.approx(1.3 * (250.0 + 2500.0), rel=12.0 * ROUNDOFF)
    assert capacity[-1] == pytest.approx(2750.0, rel=12.0 * ROUNDOFF)


def test_seal_friction_is_even_in_speed_and_falls_from_breakaway():
    speed = np.linspace(0.0, 0.05, 200)
    forward = launch(seal_kernel, 250.0, 1e-4, 1e7, 1.3, 0.01, speed)
    np.testing.assert_array_equal(launch(seal_kernel, 250.0, 1e-4, 1e7, 1.3, 0.01, -speed), forward)
    assert np.all(np.diff(forward) <= 0.0)


# ---- the sticking element ----


def test_friction_opposes_deflection_and_rate_up_to_its_capacity():
    deflection = rounded(np.array([0.001, -0.001, 0.0, 0.0, 0.001, 0.01, -0.01, 0.0, 0.0]))
    rate = rounded(np.array([0.0, 0.0, 0.02, -0.02, -0.01, 0.0, 0.0, 3.0, -3.0]))
    torque = launch(torque_kernel, deflection, rate, 2000.0, 7e5, 5e3)
    expected = [-700.0, 700.0, -100.0, 100.0, -650.0, -2000.0, 2000.0, -2000.0, 2000.0]
    np.testing.assert_allclose(torque, expected, rtol=4.0 * ROUNDOFF)


def test_element_is_a_spring_below_breakaway():
    """Moved to and fro inside the limit, the deflection is the motion, whatever the path."""
    rng = np.random.default_rng(1)
    stiffness, capacity, steps = 7e5, 3000.0, 500
    limit = capacity / stiffness
    path = rng.uniform(-0.999 * limit, 0.999 * limit, (50, steps))
    rate = rounded(np.diff(path, axis=1, prepend=0.0) / 1e-3)
    _, deflection = launch(driven_kernel, rate, np.full((50, steps), capacity), stiffness, 0.0, 1e-3, length=steps)
    # two roundings a step, each relative to a step of up to 2 limits
    np.testing.assert_allclose(deflection, np.cumsum(rate * rounded(1e-3), axis=1), atol=steps * 4 * ROUNDOFF * limit)


def test_deflection_stops_at_breakaway_and_turns_at_once():
    stiffness, capacity = 7e5, 2800.0
    limit = capacity / stiffness  # 4 mrad
    rate = np.concatenate([np.full(100, 0.1), np.full(20, -0.1)])[None]
    torque, deflection = launch(driven_kernel, rate, np.full_like(rate, capacity), stiffness, 0.0, 1e-3, length=120)
    moved = 0.1e-3 * np.arange(1, 101)
    np.testing.assert_allclose(deflection[0, :100], np.minimum(moved, limit), rtol=100 * ROUNDOFF)
    np.testing.assert_allclose(torque[0, 50:100], -capacity, rtol=4 * ROUNDOFF)
    # no windup beyond the limit: going back unloads from the first step on
    np.testing.assert_allclose(deflection[0, 100:], limit - 0.1e-3 * np.arange(1, 21), rtol=100 * ROUNDOFF)


def test_deflection_follows_a_capacity_that_shrinks():
    capacity = np.concatenate([np.full(60, 2800.0), np.linspace(2800.0, 700.0, 60)])[None]
    rate = np.concatenate([np.full(60, 0.1), np.zeros(60)])[None]
    torque, deflection = launch(driven_kernel, rate, capacity, 7e5, 0.0, 1e-3, length=120)
    np.testing.assert_allclose(deflection[0, 60:], rounded(capacity[0, 60:]) / 7e5, rtol=2 * ROUNDOFF)
    assert np.all(-torque <= capacity * (1.0 + 2 * ROUNDOFF))


@pytest.mark.parametrize("amplitude", [2.0, 3.5, 10.0])
def test_hysteresis_loop_encloses_four_times_breakaway_by_slide(amplitude):
    """A cycle of ±A encloses a parallelogram of height 2 T_c and width 2 (A − T_c/k), damping apart."""
    stiffness, capacity, steps = 7e5, 2800.0, 4000
    limit = capacity / stiffness
    speed = amplitude * limit / (0.25e-3 * steps)
    rate = rounded(speed * np.repeat([1.0, -1.0, -1.0, 1.0, 1.0], steps // 4))[None]
    torque, _ = launch(driven_kernel, rate, np.full_like(rate, capacity), stiffness, 0.0, 1e-3, length=rate.shape[1])
    cycle = slice(steps // 4, None)
    loss = np.sum(-torque[0, cycle] * rate[0, cycle]) * 1e-3
    # a step that meets the limit is cut once a reversal: T_c times a step's travel at most; float32: a rounding a step
    slack = 2 * capacity * speed * 1e-3 + 4 * steps * ROUNDOFF * capacity * limit
    assert loss == pytest.approx(4.0 * capacity * (amplitude - 1.0) * limit, abs=slack)


def test_element_never_gives_back_more_than_it_took():
    """Passive at every instant: work put in since rest ≥ ½ k z², for any motion and a Stribeck capacity."""
    rng = np.random.default_rng(2)
    count, steps, dt = 200, 4000, 1e-3
    t = dt * np.arange(steps)
    rate = np.zeros((count, steps))
    for _ in range(4):
        rate += rng.normal(0.0, 0.05, (count, 1)) * np.sin(
            2 * np.pi * rng.uniform(0.2, 15.0, (count, 1)) * t + rng.uniform(0.0, 6.3, (count, 1))
        )
    rate = rounded(rate)
    capacity = rounded(2000.0 * (1.0 + 0.5 * np.exp(-((rate / 0.03) ** 2))))
    stiffness, damping = rounded(rng.uniform(2e5, 2e6, count)), rounded(rng.uniform(0.0, 2e4, count))
    torque, deflection = launch(driven_kernel, rate, capacity, stiffness, damping, dt, length=steps)
    assert np.mean(np.abs(torque) >= capacity * (1 - 1e-6)) > 0.2  # both regimes are met
    assert np.mean(np.abs(torque) < 0.9 * capacity) > 0.2
    work = np.cumsum(-torque * rate, axis=1) * float(rounded(dt))
    stored = 0.5 * stiffness[:, None] * deflection**2
    # deflection and torque carry a few roundings a step: of T_c |v| dt each
    slack = np.cumsum(np.abs(rate) * capacity, axis=1) * dt * 16 * ROUNDOFF + 16 * ROUNDOFF * stored
    assert np.all(work - stored >= -slack)


def test_no_creep_under_an_oscillating_load_in_a_million_steps():
    """Load of half the breakaway torque with an oscillation on it: the mass rests where it was, to the bit."""
    stiffness, capacity = 7e5, 3000.0
    frequency = np.array([0.5, 3.0, 7.0])
    # amplitude such that, with the element's resonance at 1.3 Hz and damping of 3 %, 0.9 of the breakaway stays unmet
    own = np.sqrt(stiffness / 1e4) / (2 * np.pi)
    gain = 1.0 / np.abs(1.0 - (frequency / own) ** 2)
    amplitude = 0.15 * capacity / np.maximum(gain, 1.0)
    position, _, slide, _ = launch(
        loaded_kernel, 0.5 * capacity, amplitude, frequency, 0.0, 0.0, 1e4, stiffness, 5e3, capacity, 1e-3, 1_000_000
    )
    assert np.all(slide == 0.0)
    # it still oscillates about T/k, by no more than amplitude × (1 + gain) / k (forced and free part)
    centre = 0.5 * capacity / stiffness
    assert np.all(np.abs(position - centre) < amplitude * (1.0 + 2.0 * gain) / stiffness)


def test_breakaway_at_the_capacity():
    """A load that grows slowly: not a hair of slide below T_c, and sliding right above."""
    stiffness, capacity, growth = 7e5, 3000.0, 500.0
    _, rate, slide, load = launch(loaded_kernel, 0.0, 0.0, 0.0, growth, 0.0, 1e4, stiffness, 5e4, capacity, 1e-3, 7000)
    # the ramp excites the resonance (0.75 s, damping ratio 0.3): an overshoot of at most growth/k/ω₀ = growth · 0.12 s
    # in torque, and the damper holds c·growth/k = 36 N m of the load back
    resonance = growth * np.sqrt(1e4 / stiffness)
    assert capacity - resonance < load < capacity + resonance + 5e4 * growth / stiffness
    assert slide > 0.0
    assert rate > 0.0
    below = launch(loaded_kernel, 0.0, 0.0, 0.0, growth, 0.0, 1e4, stiffness, 5e4, capacity, 1e-3, 5500)[2]
    assert below == 0.0


@pytest.mark.parametrize("start_rate", [0.3, -0.3])
def test_sliding_mass_stops_after_its_energy_is_spent(start_rate):
    """The element winds up like a spring, ω = √(k/J), until it holds T_c; from there the mass loses T_c/J a second."""
    inertia, stiffness, capacity = 1e4, 7e5, 3000.0
    position, rate, slide, _ = launch(
        loaded_kernel, 0.0, 0.0, 0.0, 0.0, start_rate, inertia, stiffness, 0.0, capacity, 1e-4, 3000
    )
    # before it stops (0.3 · 1e4 / 3000 = 1 s): the distance after t with the wind-up as the only other phase
    own = np.sqrt(stiffness / inertia)
    limit = capacity / stiffness
    wound = np.arcsin(limit * own / abs(start_rate)) / own
    v = np.sqrt(start_rate**2 - (limit * own) ** 2)
    t = 0.3 - wound
    expected = limit + v * t - 0.5 * capacity / inertia * t * t
    # semi-implicit Euler of first order: v·dt/2 in position and capacity/inertia·dt/2 · t
    assert abs(position) == pytest.approx(expected, abs=abs(start_rate) * 1e-4)
    assert np.sign(position) == np.sign(start_rate)
    assert abs(rate) == pytest.approx(v - capacity / inertia * t, abs=2 * capacity / inertia * 1e-4)
    assert slide == pytest.approx(abs(position) - limit, abs=1e-5)


# ---- end stop ----


def test_stop_is_silent_inside_and_pushes_back_outside():
    limit, stiffness, damping = 0.7, 1e6, 1e3
    inside = launch(stop_kernel, np.array([-0.7, -0.3, 0.0, 0.3, 0.7]), 5.0, limit, stiffness, damping)
    np.testing.assert_array_equal(inside, 0.0)
    position = rounded(np.array([0.71, -0.71, 0.71, -0.71]))
    rate = rounded(np.array([0.0, 0.0, 0.5, -0.5]))
    side = np.sign(position)
    expected = -side * (stiffness * (np.abs(position) - float(rounded(limit))) + damping * side * rate)
    # the penetration is a difference of two angles of 0.7
    np.testing.assert_allclose(
        launch(stop_kernel, position, rate, limit, stiffness, damping), expected, rtol=8 * ROUNDOFF
    )
    assert np.all(side * expected < 0.0)


def test_stop_never_pulls():
    rng = np.random.default_rng(3)
    position, rate = rng.uniform(-0.8, 0.8, 5000), rng.normal(0.0, 50.0, 5000)
    torque = launch(stop_kernel, position, rate, 0.7, 1e6, 1e4)
    assert np.all(torque * np.sign(position) <= 0.0)
    assert np.any(torque == 0.0)
    assert np.any(torque != 0.0)
    # leaving faster than k pen / c, it lets go
    assert launch(stop_kernel, 0.71, -2.0, 0.7, 1e6, 1e4) == 0.0


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_stop_returns_the_energy_that_its_damper_leaves(side):
    """Unit mass against spring and damper that lets go at zero force: e = exp(−tan φ (π − 2φ)), sin φ = ζ.

    With x'' + 2ζω x' + ω²x = 0 the force k x + c x' first vanishes at ω_d t = π − 2φ.
    """
    omega = 100.0
    ratio = np.array([0.0, 0.05, 0.3, 0.7, 0.95])
    dt, steps = 1e-5, 5000
    after, outermost = launch(bounce_kernel, side, side * 0.5, omega**2, 2.0 * ratio * omega, dt, steps)
    phi = np.arcsin(ratio)
    restitution = np.exp(-np.tan(phi) * (np.pi - 2.0 * phi))
    # leapfrog with lagging damper: first order in ω dt = 1e-3; float32 adds √(πω/dt) roundings, far less
    np.testing.assert_allclose(after, -side * 0.5 * restitution, atol=0.5 * 2.0 * omega * dt)
    assert np.all(np.abs(after) <= 0.5 * (1.0 + 1e-3))
    assert outermost[0] == pytest.approx(0.5 / omega, rel=1e-3)


# ---- lag ----


def test_lag_is_exact_without_a_limit():
    rng = np.random.default_rng(4)
    count = 500
    x, target = rounded(rng.uniform(-1.0, 1.0, (2, count)))
    time_constant, dt = rounded(rng.uniform(0.01, 0.5, count)), rounded(10.0 ** rng.uniform(-4.0, 1.0, count))
    out = launch(lag_kernel, x, target, time_constant, 1e6, dt)
    expected = target + (x - target) * np.exp(-dt / time_constant)
    # 1 − exp(−dt/τ) carries the rounding of a number near one
    np.testing.assert_allclose(out, expected, atol=8 * ROUNDOFF)


def test_lag_does_not_depend_on_how_time_is_cut():
    whole = launch(lag_kernel, 0.2, -0.7, 0.06, 100.0, 0.032)
    parts = np.asarray(0.2)
    for _ in range(32):
        parts = launch(lag_kernel, parts, -0.7, 0.06, 100.0, 0.001)
    assert parts == pytest.approx(whole, abs=32 * 4 * ROUNDOFF)


def test_lag_moves_no_faster_than_its_limit():
    rng = np.random.default_rng(5)
    x, target = rounded(rng.uniform(-1.0, 1.0, (2, 500)))
    out = launch(lag_kernel, x, target, 0.02, 1.25, 0.001)
    expected = x + np.clip((target - x) * -np.expm1(-0.001 / 0.02), -1.25e-3, 1.25e-3)
    np.testing.assert_allclose(out, expected, atol=8 * ROUNDOFF)
    assert np.all(np.abs(out - x) <= 1.25e-3 + 2 * ROUNDOFF)
    assert np.any(np.abs(out - x) > 1.24e-3)


def test_lag_never_overshoots():
    rng = np.random.default_rng(6)
    x, target = rounded(rng.uniform(-1.0, 1.0, (2, 500)))
    out = launch(lag_kernel, x, target, 0.05, 1e3, 10.0 ** rng.uniform(-4, 2, 500))
    assert np.all((out - x) * np.sign(target - x) >= 0.0)
    assert np.all((target - out) * np.sign(target - x) >= -2 * ROUNDOFF)
