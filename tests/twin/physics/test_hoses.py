"""Hoses that stiffen, creep, or carry oil between two segments."""

# Device code: its types are Warp's, not Python's.
# pyright: reportInvalidTypeForm=false, reportGeneralTypeIssues=false, reportArgumentType=false

import numpy as np
import pytest
import warp as wp
from scipy.linalg import expm

from aoro_gym.machine.laws import OPTIONS
from aoro_gym.twin.physics.fluid import Gas, Oil, fill, pressure
from aoro_gym.twin.physics.hoses import creep, fill_port, hose_flow_step
from aoro_gym.twin.physics.steering_circuit import Steering
from tests.twin.physics.deviations import within
from tests.twin.physics.elements import BAR, OIL
from tests.twin.physics.launch import ROUNDOFF, changed, columns, launch, rounded
from tests.twin.physics.steering_elements import STEERING

M = columns(STEERING)
STIFFENING, VISCOELASTIC, TWO_SEGMENTS = (
    changed(STEERING, hose_law=OPTIONS["hose"].index(name)) for name in ("stiffening", "viscoelastic", "two_segments")
)
SOFT = changed(OIL, bulk_modulus_slope=0.0)  # linear: a closed form for each
VOLUME = float(rounded(2e-3))  # [m³]


@wp.kernel(enable_backward=False)
def fill_kernel(
    m: wp.array(dtype=Steering),
    oil: wp.array(dtype=Oil),
    start: wp.array(dtype=float),
    flow: wp.array(dtype=float),
    volume: float,
    dt: float,
    steps: int,
    end: wp.array(dtype=float),
):
    i = wp.tid()
    p = start[i]
    for _ in range(steps):
        p = fill_port(m[i], oil[i], Gas(), p, flow[i], dt, volume)
    end[i] = p


@wp.kernel(enable_backward=False)
def creep_kernel(
    m: wp.array(dtype=Steering),
    oil: wp.array(dtype=Oil),
    start: wp.array(dtype=float),
    volume: float,
    dt: float,
    steps: int,
    end: wp.array(dtype=float),
    strain: wp.array(dtype=float),
):
    """A closed side whose walls have not crept yet."""
    i = wp.tid()
    p = start[i]
    v = float(0.0)
    for _ in range(steps):
        into = creep(m[i], v, pressure(oil[i], p))
        v += dt * into
        p = fill_port(m[i], oil[i], Gas(), p, -into, dt, volume)
    end[i] = p
    strain[i] = v


@wp.kernel(enable_backward=False)
def segments_kernel(
    m: wp.array(dtype=Steering),
    oil: wp.array(dtype=Oil),
    start: wp.array(dtype=float),
    through: float,
    volume: float,
    dt: float,
    steps: int,
    valve_end: wp.array(dtype=float),
    cylinder_end: wp.array(dtype=float),
    flow: wp.array(dtype=float),
):
    """Two segments, the one on the valve's end at ``start`` and given ``through`` [m³/s], the other at 20 bar, from which it
    is taken."""
    i = wp.tid()
    a = start[i]
    b = float(2.0e6)
    q = float(0.0)
    half = 0.5 * m[i].hose_volume
    for _ in range(steps):
        q = hose_flow_step(m[i], q, a - b, dt)
        a = fill(oil[i], Gas(), a, through - q, dt, half, 0.5 * m[i].hose_compliance)
        b = fill_port(m[i], oil[i], Gas(), b, q - through, dt, volume)
    valve_end[i] = a
    cylinder_end[i] = b
    flow[i] = q


def test_stiffening_hose_holds_the_integral_of_its_compliance():
    """V/s ln(β(p)/β₀) of oil and C p_s ln(1 + p/p_s) of walls are what was filled, Euler's steps of the pressure apart."""
    filled, steps = 50e-6, 2000
    coarse, fine = (launch(fill_kernel, STIFFENING, OIL, 0.0, 1e-3, VOLUME, 0.05 / n, n) for n in (steps, 2 * steps))

    def held(p):
        stiffening = M.hose_stiffening_pressure
        oil = VOLUME / 10.0 * np.log1p(10.0 * p / 1.4e9)
        return oil + M.hose_compliance * stiffening * np.log1p(p / stiffening)

    assert fine > 200.0 * BAR
    off = np.array([held(coarse), held(fine)]) - filled
    # half a step times the relative fall of the compliance over the way, at most ln 2; twice the steps half of it
    assert abs(off[1]) < 0.5 * filled / (2 * steps) + 4 * steps * ROUNDOFF * filled
    within(
        2.0 * off[1] - off[0],
        filled / steps**2 + 6 * np.sqrt(4 * steps) * 2 * ROUNDOFF * filled,
        law="hose: stiffening",
        oracle="integral of its compliance [m³]",
        source="second order of the step, extrapolated; rounding at random",
    )
    # from its walls it gives less oil than a linear hose would: by 0.03 of 0.08 mL/bar at 150 bar
    linear = launch(fill_kernel, STEERING, OIL, 0.0, 1e-3, VOLUME, 0.05 / steps, steps)
    assert fine > linear + 5.0 * BAR


def test_viscoelastic_hose_relaxes_as_zeners_solid():
    """A side pressed to p₀ at once: p falls to p₀ C_i/(C_i + s C) at the rate (1 + s C/C_i)/τ, and the walls take s C p."""
    late = M.hose_delayed_share * M.hose_compliance
    at_once = VOLUME / 1.4e9 + M.hose_compliance - late
    start, tau = 100.0 * BAR, M.hose_delay_time
    rate = (1.0 + late / at_once) / tau
    for span in (0.01, 0.05):
        rest = start * at_once / (at_once + late)
        exact = rest + (start - rest) * np.exp(-rate * span)
        steps = 500
        ends = [launch(creep_kernel, VISCOELASTIC, SOFT, start, VOLUME, span / n, n) for n in (steps, 2 * steps)]
        coarse, fine = (p - exact for p, _ in ends)
        step = rate * span / steps
        rounding = 2 * steps * ROUNDOFF * start
        # (1 − λ dt)ⁿ = e^(−λt) (1 − λ² dt t/2 …)
        within(
            2.0 * fine - coarse,
            step**2 * rate * span * start + 3.0 * rounding,
            law="hose: viscoelastic",
            oracle="Zener's solid [Pa]",
            source="(λ dt)² λ t, extrapolated; rounding of each step",
        )
        assert abs(fine) <= 0.5 * step * rate * span * (start - rest) + rounding
        # no oil made or lost: what left the walls' quick part and the oil is in the late one
        p, strain = ends[1]
        assert at_once * (start - p) == pytest.approx(strain, abs=2 * steps * ROUNDOFF * at_once * start)


def test_viscoelastic_hose_is_as_compliant_as_the_linear_one_in_the_end_and_stiffer_at_once():
    oil = 20e-6
    slow = launch(creep_kernel, VISCOELASTIC, SOFT, 0.0, VOLUME, 1e-3, 1)[0]
    assert slow == 0.0
    total = VOLUME / 1.4e9 + M.hose_compliance
    at_once = launch(fill_kernel, VISCOELASTIC, SOFT, 0.0, oil / 1e-3, VOLUME, 1e-3, 1)
    assert at_once == pytest.approx(oil / (total - M.hose_delayed_share * M.hose_compliance), rel=8 * ROUNDOFF)
    rest, _ = launch(creep_kernel, VISCOELASTIC, SOFT, at_once, VOLUME, 1e-4, 5000)
    # ten and more time constants; stalled where dt/τ (s C p − v)/C is below half an ulp of p
    stall = ROUNDOFF * rest * M.hose_delay_time / 1e-4 * 2.0
    assert rest == pytest.approx(oil / total, abs=stall + np.exp(-0.5 / M.hose_delay_time) * at_once)


def segments(resistance):
    """Matrix of (p_valve, p_cylinder, q), and both compliances."""
    valve_end = 0.5 * M.hose_volume / 1.4e9 + 0.5 * M.hose_compliance
    cylinder_end = (VOLUME - 0.5 * M.hose_volume) / 1.4e9 + 0.5 * M.hose_compliance
    matrix = [
        [0.0, 0.0, -1.0 / valve_end],
        [0.0, 0.0, 1.0 / cylinder_end],
        [1.0 / M.hose_inertance, -1.0 / M.hose_inertance, -resistance / M.hose_inertance],
    ]
    return np.array(matrix), valve_end, cylinder_end


@pytest.mark.parametrize("resistance", [0.0, 1e8, 3e9])
def test_two_segments_swing_as_their_inertance_and_compliances_have_it(resistance):
    """Natural frequency √((1/C₁ + 1/C₂)/L) and the damping of R, by the matrix exponential; no oil is made or lost."""
    m = changed(TWO_SEGMENTS, hose_resistance=resistance)
    matrix, first, second = segments(float(rounded(resistance)))
    if resistance == 0.0:
        frequency = np.sqrt((1.0 / first + 1.0 / second) / M.hose_inertance)
        assert np.max(np.linalg.eigvals(matrix).imag) == pytest.approx(frequency, rel=1e-9)
    span, start, steps = 0.02, 30.0 * BAR, 1000
    exact = expm(matrix * span) @ [start, 20.0 * BAR, 0.0]
    ends = [np.array(launch(segments_kernel, m, SOFT, start, 0.0, VOLUME, span / n, n)) for n in (steps, 2 * steps)]
    coarse, fine = (end - exact for end in ends)
    fastest = np.max(np.abs(np.linalg.eigvals(matrix)))
    scale = np.array([1.0, 1.0, 1.0 / np.sqrt(M.hose_inertance / first)]) * 10.0 * BAR
    rounding = 2 * np.sqrt(2 * steps) * ROUNDOFF * np.array([3.0, 3.0, 1.0]) * scale
    step = fastest * span / steps
    # symplectic: off by half a step in phase; what both extrapolate to is of second order, growing with the way
    within(
        (2.0 * fine - coarse) / scale,
        step**2 * fastest * span + 6.0 * rounding / scale,
        law="hose: two_segments",
        oracle="matrix exponential [of 10 bar]",
        source="(ω dt)² ω t, extrapolated; rounding at random",
    )
    assert np.all(np.abs(fine) < step * scale + rounding)
    for a, b, _ in ends:
        gained = first * (a - start) + second * (b - 20.0 * BAR)
        # each sum rounds: contents of 30 bar, at random
        assert abs(gained) < 8 * np.sqrt(2 * steps) * ROUNDOFF * (first + second) * start


def test_steady_flow_through_two_segments_drops_as_its_resistance_has_it():
    m = changed(TWO_SEGMENTS, hose_resistance=3e9)
    through = 5e-4
    a, b, q = launch(segments_kernel, m, SOFT, 20.0 * BAR, through, VOLUME, 1e-5, 100000)
    # one second: 150 time constants of R/(2 L); stalled where an increment is below half an ulp
    assert q == pytest.approx(through, rel=1e-4)
    assert a - b == pytest.approx(3e9 * through, rel=1e-4)
