"""The mount between cylinders and frames: dead zone, statics, free play and period against closed forms and SciPy."""

# Device code: its types are Warp's, not Python's.
# pyright: reportInvalidTypeForm=false, reportGeneralTypeIssues=false, reportArgumentType=false

import numpy as np
import pytest
import warp as wp
from scipy.integrate import solve_ivp

from aoro_gym.twin.physics.mount import MountState, mount_bend, mount_step, mount_torque
from aoro_gym.twin.physics.steering_circuit import SteeringGeometry
from tests.twin.physics.launch import ROUNDOFF, launch, record, rounded

LEVERS = record(
    SteeringGeometry, volume_a=2e-3, volume_b=2e-3, displacement_a=1.6e-3, displacement_b=-1.6e-3, lever_left=0.2,
    lever_right=0.18,
)  # fmt: skip
INERTIA = 10.0 * (0.2**2 + 0.18**2)  # [kg m²]
LOSS_TIME = 1e-3  # [s]


@wp.kernel(enable_backward=False)
def torque_kernel(
    stiffness: wp.array(dtype=float),
    backlash: wp.array(dtype=float),
    hardening: wp.array(dtype=float),
    deflection: wp.array(dtype=float),
    slip: wp.array(dtype=float),
    torque: wp.array(dtype=float),
):
    i = wp.tid()
    torque[i] = mount_torque(stiffness[i], backlash[i], hardening[i], deflection[i], slip[i])


@wp.kernel(enable_backward=False)
def bend_kernel(
    stiffness: wp.array(dtype=float),
    hardening: wp.array(dtype=float),
    torque: wp.array(dtype=float),
    bend: wp.array(dtype=float),
):
    i = wp.tid()
    bend[i] = mount_bend(stiffness[i], hardening[i], torque[i])


@wp.kernel(enable_backward=False)
def run_kernel(
    g: wp.array(dtype=SteeringGeometry),
    stiffness: wp.array(dtype=float),
    backlash: wp.array(dtype=float),
    hardening: wp.array(dtype=float),
    oil_torque: wp.array(dtype=float),
    grip: wp.array(dtype=float),
    drag: wp.array(dtype=float),
    joint_rate: wp.array(dtype=float),
    start: wp.array(dtype=MountState),
    dt: wp.array(dtype=float),
    steps: wp.array(dtype=int),
    end: wp.array(dtype=MountState),
):
    """Steps under constant oil torque and joint rate, of cylinders that a spring ``grip`` and a damper ``drag`` hold where
    the joint stands still."""
    i = wp.tid()
    x = start[i]
    for _ in range(steps[i]):
        torque = oil_torque[i] - grip[i] * x.deflection - drag[i] * x.rate
        x = mount_step(g[i], stiffness[i], backlash[i], hardening[i], torque, grip[i], drag[i], joint_rate[i], x, dt[i])
    end[i] = x


def at(deflection=0.0, rate=0.0):
    return record(MountState, deflection=deflection, rate=rate, friction=0.0)


HARDENINGS = (0.0, 1.0 / 0.003)
"""[1/rad] of a linear spring, and of one whose stiffness doubles at 3 mrad."""


def spring(bent, hardening):
    """Spring's torque over its stiffness at rest, and its slope: ∫ (1 + a|b|) db and 1 + a|b|."""
    return bent + 0.5 * hardening * np.abs(bent) * bent, 1.0 + hardening * np.abs(bent)


@pytest.mark.parametrize("hardening", HARDENINGS)
def test_torque_is_a_spring_behind_a_dead_zone_that_never_pulls(hardening):
    rng = np.random.default_rng(0)
    stiffness, backlash = rounded(10.0 ** rng.uniform(6, 8, 500)), rounded(rng.uniform(0.0, 0.01, 500))
    x, slip = rounded(rng.uniform(-0.02, 0.02, 500)), rounded(rng.normal(0.0, 5.0, 500))
    bent = np.sign(x) * np.maximum(np.abs(x) - 0.5 * backlash, 0.0)
    elastic, slope = spring(bent, hardening)
    expected = stiffness * (elastic + np.clip(LOSS_TIME * slope * slip, -np.abs(elastic), np.abs(elastic)))
    torque = launch(torque_kernel, stiffness, backlash, hardening, x, slip)
    # deflection and play round by 2⁻²⁴ of 0.02 rad each; what hardens raises that by its slope, and by its own roundings
    slack = 4 * ROUNDOFF * 0.02 * stiffness * slope + (4 * ROUNDOFF * np.abs(expected) if hardening else 0.0)
    assert np.all(np.abs(torque - expected) <= slack.max())
    assert np.all(torque * x >= 0.0)


def test_hardening_doubles_the_stiffness_at_its_angle():
    """dT/db by central differences, exact for a parabola: k (1 + |b|/b₀)."""
    angle, step = 0.003, 0.001
    b = np.array([-0.006, -0.003, 0.0015, 0.003, 0.009])
    high, low = (launch(torque_kernel, 1e6, 0.0, 1.0 / angle, b + side * step, 0.0) for side in (1.0, -1.0))
    np.testing.assert_allclose((high - low) / (2.0 * step), 1e6 * (1.0 + np.abs(b) / angle), rtol=32 * ROUNDOFF * 10)


@pytest.mark.parametrize("hardening", HARDENINGS)
def test_bend_at_rest_is_the_inverse_of_the_torque(hardening):
    torque = rounded(np.concatenate([-np.logspace(-3, 6, 50), [0.0], np.logspace(-3, 6, 50)]))
    bend = launch(bend_kernel, 2e6, hardening, torque)
    np.testing.assert_allclose(2e6 * spring(bend, hardening)[0], torque, rtol=16 * ROUNDOFF)


@pytest.mark.parametrize("hardening", HARDENINGS)
@pytest.mark.parametrize("stiffness", [2e6, 2e8])
def test_constant_torque_bends_it_by_its_compliance_behind_the_play(stiffness, hardening):
    """At rest x = b/2 + τ/k, or the root of the hardening spring, whichever way the torque points."""
    bend = 2e4 / stiffness
    if hardening:
        bend = (np.sqrt(1.0 + 2.0 * hardening * bend) - 1.0) / hardening
    for torque in (2e4, -2e4):
        end = launch(run_kernel, LEVERS, stiffness, 0.006, hardening, torque, 0.0, 0.0, 0.0, at(), 1e-3 / 30.0, 6000)
        expected = np.sign(torque) * (0.003 + bend)
        # the deflection's last bits are those of 3e-3 rad, the rate's those at which its product rounds to nothing: half
        # a bit of 0.01 rad a step, which losses hold against bend
        stalled = 0.5 * 2.0**-30 / (1e-3 / 30.0)
        assert end.deflection == pytest.approx(expected, abs=4 * ROUNDOFF * 0.02 + LOSS_TIME * stalled)
        assert end.rate == pytest.approx(0.0, abs=1e-4)


def test_free_play_is_crossed_as_a_free_mass():
    """Within the play only the moving mass resists: x = τ t²/(2 I), ẋ = τ t/I."""
    dt, steps, torque = 1e-5, 100, 50.0
    end = launch(run_kernel, LEVERS, 2e7, 0.1, 0.0, torque, 0.0, 0.0, 0.0, at(), dt, steps)
    time = dt * steps
    assert end.rate == pytest.approx(torque * time / INERTIA, rel=steps * ROUNDOFF)
    # the new rate moves it: x is ahead by half a step
    assert end.deflection == pytest.approx(0.5 * torque * time * (time + dt) / INERTIA, rel=2 * steps * ROUNDOFF)


@pytest.mark.parametrize("hardening", HARDENINGS)
def test_swing_on_the_spring_converges_to_the_continuous_mass(hardening):
    """Let go from rest under a torque step, against SciPy; first order in the step."""
    stiffness, torque, span = 1e6, 5e3, 4e-3

    def rate(_, y):
        elastic, slope = spring(y[0], hardening)
        losses = np.clip(LOSS_TIME * slope * y[1], -abs(elastic), abs(elastic))
        return [y[1], (torque - stiffness * (elastic + losses)) / INERTIA]

    exact = solve_ivp(rate, (0.0, span), [1e-4, 0.0], method="LSODA", rtol=1e-11, atol=1e-14).y[:, -1]
    errors = []
    for steps in (800, 1600):
        end = launch(
            run_kernel, LEVERS, stiffness, 0.0, hardening, torque, 0.0, 0.0, 0.0, at(1e-4), span / steps, steps
        )
        errors.append(np.array([end.deflection, end.rate]) - exact)
    np.testing.assert_allclose(errors[0] / errors[1], 2.0, rtol=0.15)
    assert np.all(np.abs(errors[1]) < 5e-3 * np.abs([torque / stiffness, torque / np.sqrt(stiffness * INERTIA)]))


def test_stiff_mount_gives_the_rigid_joint():
    """Cylinders go with the joint's rate, and what they transmit is the oil's torque, at any step."""
    for dt in (1e-5, 1e-3 / 30.0, 1e-4):
        end = launch(run_kernel, LEVERS, 2e8, 0.0, 0.0, 2e4, 0.0, 0.0, 0.7, at(), dt, int(0.1 / dt))
        assert end.rate == pytest.approx(0.7, rel=1e-4)
        assert 2e8 * end.deflection == pytest.approx(2e4, rel=1e-3)


def test_what_holds_the_cylinders_slows_them_as_the_continuous_law():
    """Seals before they slide, or the end of the stroke: a spring and a damper on the moving mass beside the mount's,
    against SciPy; first order in the step."""
    stiffness, torque, grip, drag, span = 1e6, 5e3, 2e6, 300.0, 4e-3

    def rate(_, y):
        bent = abs(y[0])
        mount = stiffness * (y[0] + np.clip(LOSS_TIME * y[1], -bent, bent))
        return [y[1], (torque - grip * y[0] - drag * y[1] - mount) / INERTIA]

    exact = solve_ivp(rate, (0.0, span), [1e-4, 0.0], method="LSODA", rtol=1e-11, atol=1e-14).y[:, -1]
    errors = []
    for steps in (800, 1600):
        end = launch(run_kernel, LEVERS, stiffness, 0.0, 0.0, torque, grip, drag, 0.0, at(1e-4), span / steps, steps)
        errors.append(np.array([end.deflection, end.rate]) - exact)
    np.testing.assert_allclose(errors[0] / errors[1], 2.0, rtol=0.15)


def test_the_hardest_stop_is_stable_at_any_step():
    """It bends with the mount, x = τ / (k + s)."""
    for dt in (1e-5, 1e-4, 1e-3):
        end = launch(run_kernel, LEVERS, 2e6, 0.0, 0.0, 2e4, 1e8, 1e4, 0.0, at(1e-4), dt, int(0.5 / dt))
        assert end.deflection == pytest.approx(2e4 / (2e6 + 1e8), rel=1e-3)
        assert end.rate == pytest.approx(0.0, abs=1e-4)


def test_a_mount_far_into_its_hardening_is_stable_at_any_step():
    """At 20 times the bend that doubles its stiffness: 21 times as stiff as unbent, k b (1 + b/2b₀) = τ."""
    bend, angle, stiffness = 0.02, 0.001, 2e6
    torque = stiffness * bend * (1.0 + 0.5 * bend / angle)
    for dt in (1e-5, 1e-4, 1e-3):
        end = launch(
            run_kernel, LEVERS, stiffness, 0.0, 1.0 / angle, torque, 0.0, 0.0, 0.0, at(bend), dt, int(0.5 / dt)
        )
        assert end.deflection == pytest.approx(bend, rel=1e-4)
        end = launch(run_kernel, LEVERS, stiffness, 0.0, 1.0 / angle, torque, 0.0, 0.0, 0.0, at(0.0), dt, int(0.5 / dt))
        assert end.deflection == pytest.approx(bend, rel=1e-3)
