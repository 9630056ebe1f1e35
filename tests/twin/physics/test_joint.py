"""The joint's dry friction by each of its laws, rigid and behind a mount, against SciPy, closed forms and work."""

# Device code: its types are Warp's, not Python's.
# pyright: reportInvalidTypeForm=false, reportGeneralTypeIssues=false, reportArgumentType=false

import numpy as np
import pytest
import warp as wp
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from aoro_gym.machine.laws import OPTIONS
from aoro_gym.twin.physics.joint import Joint, friction_step, joint_friction, seals
from tests.twin.physics.launch import ROUNDOFF, changed, launch, record, rounded

STIFFNESS, DAMPING, VELOCITY = (float(rounded(x)) for x in (7e5, 5e3, 0.01))
SLIDING, STATIC, STRIBECK = 1500.0, 2000.0, 0.05
"""[N m], [N m], [rad/s] of the capacity g(v) = 1500 + 500 exp(−(v/0.05)²) that the tests' kernels have."""
INERTIA = 1300.0
"""[kg m²] that turns."""
LAWS = ("lugre", "stribeck_tanh", "coulomb_viscous")
JOINT = record(
    Joint, range=0.7, friction_torque=200.0, backlash=0.0, mount_stiffness=0.0, stop_torsional_stiffness=1e7,
    stop_torsional_damping=1e4, presliding_stiffness=7e5, presliding_damping=5e3, friction_law=0, friction_velocity=0.01,
    mount_law=0, hardening_angle=0.003,
)  # fmt: skip


def obeying(law, **values):
    return changed(JOINT, friction_law=OPTIONS["friction"].index(law), **values)


@wp.func
def stribeck(rate: float):
    ratio = rate / 0.05
    return 1500.0 + 500.0 * wp.exp(-ratio * ratio)


@wp.kernel(enable_backward=False)
def driven_kernel(
    m: wp.array(dtype=Joint),
    rate: wp.array2d(dtype=float),
    h: wp.array(dtype=float),
    torque: wp.array2d(dtype=float),
    deflection: wp.array2d(dtype=float),
):
    """A rigid joint that is moved: deflection and torque in the middle of every step, as in the main step."""
    i = wp.tid()
    z = float(0.0)
    for k in range(rate.shape[1] - 1):
        middle = 0.5 * (rate[i, k] + rate[i, k + 1])
        z = friction_step(m[i], z, rate[i, k], stribeck(middle), h[i])
        torque[i, k] = joint_friction(m[i], z, middle, stribeck(middle), 1300.0, h[i])
        deflection[i, k] = z


@wp.kernel(enable_backward=False)
def point_kernel(
    m: wp.array(dtype=Joint),
    deflection: wp.array(dtype=float),
    rate: wp.array(dtype=float),
    torque: wp.array(dtype=float),
):
    i = wp.tid()
    torque[i] = joint_friction(m[i], deflection[i], rate[i], stribeck(rate[i]), 1300.0, 1.0e-3)


@wp.kernel(enable_backward=False)
def rigid_kernel(
    m: wp.array(dtype=Joint),
    load: wp.array(dtype=float),
    start: wp.array(dtype=float),
    inertia: wp.array(dtype=float),
    h: wp.array(dtype=float),
    rate: wp.array2d(dtype=float),
):
    """A rigid joint under a constant load, stepped as the main step does: rates extrapolated to its middle."""
    i = wp.tid()
    v = start[i]
    z = float(0.0)
    last = float(0.0)
    for k in range(rate.shape[1]):
        middle = v + 0.5 * h[i] * last
        z = friction_step(m[i], z, v, stribeck(middle), h[i])
        last = (load[i] + joint_friction(m[i], z, middle, stribeck(middle), inertia[i], h[i])) / inertia[i]
        v += h[i] * last
        rate[i, k] = v


@wp.kernel(enable_backward=False)
def cylinder_kernel(
    m: wp.array(dtype=Joint),
    load: wp.array(dtype=float),
    start: wp.array(dtype=float),
    inertia: wp.array(dtype=float),
    dt: wp.array(dtype=float),
    rate: wp.array2d(dtype=float),
):
    """Cylinders on their mount under a constant load that nothing but dry friction holds, implicit as in their substep."""
    i = wp.tid()
    w = start[i]
    z = float(0.0)
    for k in range(rate.shape[1]):
        capacity = stribeck(w)
        dry = seals(m[i], z, w, capacity, dt[i])
        push = load[i] + dry.torque - dt[i] * dry.grip * w
        w += dt[i] * push / (inertia[i] + dt[i] * (dt[i] * dry.grip + dry.drag))
        z = friction_step(m[i], z, w, capacity, dt[i])
        rate[i, k] = w


def capacity(rate):
    """g(v) [N m] in float64."""
    return SLIDING + (STATIC - SLIDING) * np.exp(-((rate / STRIBECK) ** 2))


def lugre(z, rate):
    """Rate of the bristle and torque against the motion, from the definition."""
    change = rate - STIFFNESS * abs(rate) * z / capacity(rate)
    return change, STIFFNESS * z + min(DAMPING, 4.0 * capacity(rate) / max(abs(rate), 1e-9)) * change


def motion(time):
    """Rate [rad/s] of a joint that slides, reverses and creeps."""
    return 0.04 * np.sin(9.0 * time) + 0.02 * np.sin(31.0 * time + 1.0) + 0.005


def test_lugre_loops_are_those_of_its_differential_equation():
    """A joint moved to and fro through its loops, against SciPy; first order in the step, at 1 ms within 2 % of g."""
    span = 1.2
    exact = solve_ivp(
        lambda t, z: [lugre(z[0], motion(t))[0]], (0.0, span), [0.0], method="LSODA", rtol=1e-10, atol=1e-13,
        dense_output=True, max_step=1e-3,
    ).sol  # fmt: skip
    errors = []
    for steps in (1200, 2400):
        h = span / steps
        torque, _ = launch(driven_kernel, obeying("lugre"), motion(h * np.arange(steps + 1))[None], h, length=steps)
        middle = h * (np.arange(steps) + 0.5)
        expected = -np.array([lugre(exact(t)[0], motion(t))[1] for t in middle])
        errors.append(np.abs(torque[0] - expected).max())
    assert errors[0] < 0.02 * STATIC
    assert errors[0] / errors[1] == pytest.approx(2.0, rel=0.2)


@pytest.mark.parametrize("law", LAWS)
def test_sliding_meets_the_capacity(law):
    """At constant rates, once LuGre's bristle is bent: F = −g(v), smooth laws by tanh(v/v_t) of it."""
    rate = rounded(np.array([0.02, -0.03, 0.2, -0.7]))  # 30 time constants g/σ₀|v| of the slowest
    h = 1e-3
    torque, deflection = launch(driven_kernel, obeying(law), np.tile(rate[:, None], 4001), h, length=4001)
    share = np.ones(4) if law == "lugre" else np.abs(np.tanh(rate / VELOCITY))
    np.testing.assert_allclose(torque[:, 3999], -np.sign(rate) * share * capacity(rate), rtol=256 * ROUNDOFF)
    bend = capacity(rate) / STIFFNESS if law == "lugre" else 0.0
    np.testing.assert_allclose(deflection[:, 3999], np.sign(rate) * bend, rtol=256 * ROUNDOFF)


@pytest.mark.parametrize("law", LAWS)
def test_friction_never_gives_back_more_than_was_stored(law):
    """Work put in by random motions from rest is never less than nothing: bristles start unbent, smooth laws store none.

    Work of the middle torques at the middle rates, which a LuGre bristle moved at the old rates meets to first order: of
    h |v̇| of rate in a step, 1 ms · 20 rad/s² of 1 rad/s, two hundredths of what is lost on the way.
    """
    rng = np.random.default_rng(8)
    count, steps, h = 300, 3000, 1e-3
    t = h * np.arange(steps + 1)
    rate = np.zeros((count, steps + 1))
    for _ in range(3):
        size, frequency = 10.0 ** rng.uniform(-3.5, -0.5, (count, 1)), rng.uniform(0.1, 5.0, (count, 1))
        rate += size * np.sin(2 * np.pi * frequency * t + rng.uniform(0.0, 6.3, (count, 1)))
    rate = rounded(rate)
    torque, _ = launch(driven_kernel, obeying(law), rate, h, length=steps + 1)
    middle = 0.5 * (rate[:, 1:] + rate[:, :-1])
    power = -torque[:, :-1] * middle
    work, lost = np.cumsum(power, axis=1) * h, np.cumsum(np.abs(power), axis=1) * h
    if law != "lugre":
        assert np.all(power >= 0.0)
    assert np.all(work >= -0.02 * lost)
    assert np.all(work[:, -1] > 0.0)


def test_lugre_dissipates_at_every_bend_and_speed():
    """Power less what the bristle stores, −F v − σ₀ z ż, is nowhere negative; without the bristle damping's limit 4 g/|v| it
    would be, of a bristle bent against a fast motion."""
    z, v = (x.ravel() for x in np.meshgrid(np.linspace(-1.0, 1.0, 41) * STATIC / STIFFNESS, np.linspace(-5.0, 5.0, 41)))
    z, v = rounded(z), rounded(v)
    damping = 2e4
    change = v - STIFFNESS * np.abs(v) * z / capacity(v)
    lost = -launch(point_kernel, obeying("lugre", presliding_damping=damping), z, v) * v - STIFFNESS * z * change
    assert np.all(lost >= -64 * ROUNDOFF * STATIC * 5.0)
    assert np.any((STIFFNESS * z + damping * change) * v - STIFFNESS * z * change < -100.0)


@pytest.mark.parametrize("kernel", [rigid_kernel, cylinder_kernel])
@pytest.mark.parametrize("law", LAWS)
def test_a_load_beyond_the_capacity_slides_away_as_by_newton(law, kernel):
    """Against SciPy: first order in the step, rigid and behind a mount alike."""
    load, span, inertia = 3000.0, 0.25, INERTIA

    def smooth(_, y):
        return [(load - capacity(y[0]) * np.tanh(y[0] / VELOCITY)) / inertia]

    def bristle(_, y):
        change, torque = lugre(y[1], y[0])
        return [(load - torque) / inertia, change]

    law_ode, start = (bristle, [0.05, 0.0]) if law == "lugre" else (smooth, [0.05])
    exact = solve_ivp(law_ode, (0.0, span), start, method="LSODA", rtol=1e-10, atol=1e-13).y[0, -1]
    errors = []
    for steps in (500, 1000):
        rate = launch(kernel, obeying(law), load, 0.05, inertia, span / steps, length=steps)
        errors.append(rate[-1] - exact)
    assert abs(errors[1]) < 1e-2 * exact
    assert abs(errors[1]) <= 0.55 * abs(errors[0]) + steps * ROUNDOFF * exact


def test_lugre_holds_a_load_that_smooth_laws_let_creep():
    """Under half the static capacity: LuGre comes to rest, the smooth laws go on at v_t artanh(F/g), found in float64."""
    load = 900.0
    for kernel, inertia, h in ((rigid_kernel, INERTIA, 1e-3), (cylinder_kernel, 0.7, 1e-3 / 30.0)):
        steps = 8000
        held = launch(kernel, obeying("lugre"), load, 0.0, inertia, h, length=steps)
        assert np.abs(held[steps // 2 :]).max() < 0.01 * VELOCITY
        creep = brentq(lambda v: capacity(v) * np.tanh(v / VELOCITY) - load, 0.0, 1.0)
        moving = launch(kernel, obeying("stribeck_tanh"), load, 0.0, inertia, h, length=steps)
        assert moving[-1] == pytest.approx(creep, rel=1e-3)


@pytest.mark.parametrize("kernel", [rigid_kernel, cylinder_kernel])
@pytest.mark.parametrize("law", LAWS)
def test_friction_stops_and_never_reverses_the_lightest_that_moves(law, kernel):
    """Let go at any rate with no load, down to inertias and up to steps that would ring if it were explicit: the rate falls
    to nothing, and what comes back is a bristle's spring alone, less than stopped it."""
    rng = np.random.default_rng(9)
    count, steps = 500, 3000
    start = rounded(np.sign(rng.normal(size=count)) * 10.0 ** rng.uniform(-4, 0, count))
    light = kernel is cylinder_kernel
    inertia = rounded(10.0 ** rng.uniform(-0.5, 1, count) if light else 10.0 ** rng.uniform(2.5, 4, count))
    h = rounded(10.0 ** rng.uniform(-5, -3.5, count) if light else rng.uniform(5e-4, 2e-3, count))
    joint = obeying(law, friction_velocity=rounded(10.0 ** rng.uniform(-2.7, -1.5, count)))
    rate = launch(kernel, joint, 0.0, start, inertia, h, length=steps)
    forward = rate * np.sign(start)[:, None]
    assert np.all(forward <= np.abs(start)[:, None])
    if law == "lugre":
        assert np.all(forward >= -np.abs(start)[:, None])
        # a spring and a damper at least: its slower time constant, 2 I/σ₁ or σ₁/σ₀; a twentieth for the step
        decay = np.exp(-h * steps * np.minimum(0.5 * DAMPING / inertia, STIFFNESS / DAMPING))
        assert np.all(np.abs(forward[:, -10:]).max(axis=1) <= (decay + 0.05) * np.abs(start))
    else:
        # extrapolated rates: a rigid joint may swing through by no more than half of half a step's loss
        assert np.all(forward >= -(0.0 if light else 0.25) * np.abs(start)[:, None])
        assert np.all(np.diff(np.abs(forward), axis=1)[:, 100:] <= 0.0)
