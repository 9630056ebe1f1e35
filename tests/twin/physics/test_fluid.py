"""Orifices, checks, reliefs and oil volumes against closed forms and SciPy."""

# Device code: its types are Warp's, not Python's.
# pyright: reportInvalidTypeForm=false, reportGeneralTypeIssues=false, reportArgumentType=false

import numpy as np
import pytest
import warp as wp
from scipy.integrate import solve_ivp

from aoro_gym.machine import Machine
from aoro_gym.machine.laws import OPTIONS
from aoro_gym.twin.physics.fluid import (
    SERIES_REACH,
    Gas,
    Oil,
    check_valve,
    fill,
    fill_chamber,
    free_gas,
    gas_share,
    oil_bulk_modulus,
    orifice,
    polytrope,
    pressure,
    relief_valve,
    return_filter,
    without_gas,
)
from aoro_gym.twin.records import pack
from tests.twin.physics.deviations import within
from tests.twin.physics.elements import BAR, OIL
from tests.twin.physics.launch import ROUNDOFF, changed, columns, launch, record, rounded

ATMOSPHERE = 101325.0
DISSOLVING = OPTIONS["gas"].index("dissolving")
LAMINAR = BAR  # also written into the kernels below
# coefficient × drop, root and quotient: three roundings, and one more for roots that are not correctly rounded
ORIFICE_ERROR = 4.0 * ROUNDOFF


@wp.kernel(enable_backward=False)
def orifice_kernel(coefficient: wp.array(dtype=float), drop: wp.array(dtype=float), flow: wp.array(dtype=float)):
    i = wp.tid()
    flow[i] = orifice(coefficient[i], drop[i], 1.0e5)


@wp.kernel(enable_backward=False)
def check_kernel(
    coefficient: wp.array(dtype=float),
    drop: wp.array(dtype=float),
    crack: wp.array(dtype=float),
    flow: wp.array(dtype=float),
):
    i = wp.tid()
    flow[i] = check_valve(coefficient[i], drop[i], crack[i], 1.0e5)


@wp.kernel(enable_backward=False)
def relief_kernel(
    drop: wp.array(dtype=float),
    setting: wp.array(dtype=float),
    ramp: wp.array(dtype=float),
    nominal: wp.array(dtype=float),
    flow: wp.array(dtype=float),
):
    i = wp.tid()
    flow[i] = relief_valve(drop[i], setting[i], ramp[i], nominal[i])


@wp.kernel(enable_backward=False)
def filter_kernel(
    drop: wp.array(dtype=float),
    setting: wp.array(dtype=float),
    ramp: wp.array(dtype=float),
    nominal: wp.array(dtype=float),
    throttle: wp.array(dtype=float),
    flow: wp.array(dtype=float),
):
    i = wp.tid()
    flow[i] = return_filter(drop[i], setting[i], ramp[i], nominal[i], throttle[i])


@wp.kernel(enable_backward=False)
def pressure_kernel(oil: wp.array(dtype=Oil), content: wp.array(dtype=float), out: wp.array(dtype=float)):
    i = wp.tid()
    out[i] = pressure(oil[i], content[i])


@wp.kernel(enable_backward=False)
def polytrope_kernel(oil: wp.array(dtype=Oil), absolute: wp.array(dtype=float), share: wp.array(dtype=float)):
    i = wp.tid()
    share[i] = polytrope(oil[i], absolute[i])


@wp.kernel(enable_backward=False)
def free_gas_kernel(oil: wp.array(dtype=Oil), content: wp.array(dtype=float), gas: wp.array(dtype=Gas)):
    i = wp.tid()
    gas[i] = free_gas(oil[i], content[i])


@wp.kernel(enable_backward=False)
def share_kernel(
    oil: wp.array(dtype=Oil), gas: wp.array(dtype=Gas), absolute: wp.array(dtype=float), share: wp.array(dtype=float)
):
    i = wp.tid()
    share[i] = gas_share(oil[i], gas[i], absolute[i])


@wp.kernel(enable_backward=False)
def modulus_kernel(oil: wp.array(dtype=Oil), p: wp.array(dtype=float), modulus: wp.array(dtype=float)):
    i = wp.tid()
    modulus[i] = oil_bulk_modulus(oil[i], free_gas(oil[i], p[i]), p[i])


@wp.kernel(enable_backward=False)
def modulus_from_kernel(
    oil: wp.array(dtype=Oil), known: wp.array(dtype=float), p: wp.array(dtype=float), modulus: wp.array(dtype=float)
):
    i = wp.tid()
    modulus[i] = oil_bulk_modulus(oil[i], free_gas(oil[i], known[i]), p[i])


@wp.kernel(enable_backward=False)
def fill_kernel(
    oil: wp.array(dtype=Oil),
    content: wp.array(dtype=float),
    net_flow: wp.array(dtype=float),
    dt: wp.array(dtype=float),
    volume: wp.array(dtype=float),
    hose: wp.array(dtype=float),
    out: wp.array(dtype=float),
):
    i = wp.tid()
    gas = free_gas(oil[i], content[i])
    out[i] = fill(oil[i], gas, content[i], net_flow[i], dt[i], volume[i], hose[i])


@wp.kernel(enable_backward=False)
def fill_chamber_kernel(
    oil: wp.array(dtype=Oil),
    content: wp.array(dtype=float),
    net_flow: wp.array(dtype=float),
    dt: wp.array(dtype=float),
    volume: wp.array(dtype=float),
    hose: wp.array(dtype=float),
    nominal: wp.array(dtype=float),
    out: wp.array(dtype=float),
):
    i = wp.tid()
    gas = free_gas(oil[i], content[i])
    out[i] = fill_chamber(oil[i], gas, content[i], net_flow[i], dt[i], volume[i], hose[i], nominal[i])


@wp.kernel(enable_backward=False)
def liquid_modulus_kernel(oil: wp.array(dtype=Oil), p: wp.array(dtype=float), modulus: wp.array(dtype=float)):
    i = wp.tid()
    liquid = without_gas(oil[i])
    modulus[i] = oil_bulk_modulus(liquid, free_gas(liquid, p[i]), p[i])


@wp.kernel(enable_backward=False)
def piston_kernel(
    oil: wp.array(dtype=Oil),
    start: wp.array(dtype=float),
    volume_start: wp.array(dtype=float),
    volume_end: wp.array(dtype=float),
    hose: wp.array(dtype=float),
    steps: wp.array(dtype=int),
    end: wp.array(dtype=float),
):
    """A closed chamber whose piston moves steadily from one volume to another within a second; its gas is known at the
    start."""
    i = wp.tid()
    content = start[i]
    gas = free_gas(oil[i], content)
    dt = 1.0 / float(steps[i])
    travel = volume_end[i] - volume_start[i]
    for k in range(steps[i]):
        volume = volume_start[i] + travel * (float(k) + 0.5) * dt
        content = fill_chamber(oil[i], gas, content, -travel, dt, volume, hose[i], volume_start[i])
    end[i] = content


@wp.kernel(enable_backward=False)
def pump_out_and_in_kernel(
    oil: wp.array(dtype=Oil),
    start: wp.array(dtype=float),
    flow: wp.array(dtype=float),
    steps: int,
    dt: float,
    volume: float,
    hose: float,
    turning: wp.array(dtype=float),
    end: wp.array(dtype=float),
):
    """A rigid volume from which oil is drawn for a number of steps and given back in as many; its gas is known at the
    start."""
    i = wp.tid()
    content = start[i]
    gas = free_gas(oil[i], content)
    for _ in range(steps):
        content = fill(oil[i], gas, content, -flow[i], dt, volume, hose)
    turning[i] = content
    for _ in range(steps):
        content = fill(oil[i], gas, content, flow[i], dt, volume, hose)
    end[i] = content


# ---- orifice ----


def test_orifice_passes_its_nominal_flow_at_its_nominal_drop():
    nominal_flow = np.array([0.5, 70.6, 100.0, 200.0]) / 60000.0
    nominal_drop = np.array([200.0, 7.0, 2.0, 1.0]) * BAR
    flow = launch(orifice_kernel, nominal_flow / np.sqrt(nominal_drop), nominal_drop)
    # one more rounding: that of the coefficient
    np.testing.assert_allclose(flow, nominal_flow, rtol=ORIFICE_ERROR + ROUNDOFF)


def test_orifice_follows_the_root_when_turbulent_and_a_line_when_laminar():
    drop = rounded(np.concatenate([-np.logspace(1, 8, 200), [0.0], np.logspace(1, 8, 200)]))
    coefficient = float(rounded(1.5e-6))
    expected = coefficient * np.where(
        np.abs(drop) < LAMINAR, drop / np.sqrt(LAMINAR), np.sign(drop) * np.sqrt(np.abs(drop))
    )
    np.testing.assert_allclose(launch(orifice_kernel, coefficient, drop), expected, rtol=ORIFICE_ERROR)


def test_orifice_is_odd_and_rises_throughout():
    drop = np.concatenate([np.linspace(0.0, 3.0 * BAR, 4001), np.linspace(3.1, 400.0, 2000) * BAR])
    flow = launch(orifice_kernel, 2.0e-6, drop)
    np.testing.assert_array_equal(launch(orifice_kernel, 2.0e-6, -drop), -flow)
    assert np.all(np.diff(flow) > 0.0)


def test_orifice_is_continuous_where_it_turns_turbulent_and_its_slope_halves():
    # on the line dQ/dΔp = C/√Δp_lam, on the root C/(2√Δp): secants 1 % wide lie within 0.5 % × 1/2 of the tangent
    width = 0.01 * LAMINAR
    below, at, above = launch(orifice_kernel, 1.0, np.array([LAMINAR - width, LAMINAR, LAMINAR + width]))
    assert at == pytest.approx(np.sqrt(LAMINAR), rel=ORIFICE_ERROR)
    assert (at - below) / width == pytest.approx(1.0 / np.sqrt(LAMINAR), rel=1e-3)
    assert (above - at) / width == pytest.approx(0.5 / np.sqrt(LAMINAR), rel=5e-3)


def test_two_orifices_in_series_pass_the_same_flow():
    """The pressure between them is p = (C₁² p₁ + C₂² p₂)/(C₁² + C₂²); together they are C₁C₂/√(C₁² + C₂²)."""
    rng = np.random.default_rng(1)
    c1, c2 = rounded(10.0 ** rng.uniform(-7.0, -5.0, (2, 500)))
    ratio = (c1 / c2) ** 2
    drop_in = BAR * 10.0 ** rng.uniform(0.1, 2.0, 500)
    drop_out = drop_in * ratio
    turbulent = drop_out > LAMINAR
    drop_in, drop_out, c1, c2 = (x[turbulent] for x in (drop_in, drop_out, c1, c2))
    assert turbulent.sum() > 100
    first = launch(orifice_kernel, c1, drop_in)
    # the drops are rounded to float32: half of that error arrives in the flow
    np.testing.assert_allclose(launch(orifice_kernel, c2, drop_out), first, rtol=2 * ORIFICE_ERROR + 2 * ROUNDOFF)
    both = c1 * c2 / np.hypot(c1, c2)
    np.testing.assert_allclose(
        launch(orifice_kernel, both, drop_in + drop_out), first, rtol=2 * ORIFICE_ERROR + 4 * ROUNDOFF
    )


# ---- check and relief ----


def test_check_never_passes_oil_backwards_or_below_its_crack():
    drop = np.concatenate([-np.logspace(0, 8, 50), [0.0], np.linspace(0.0, 0.3 * BAR, 50)])
    np.testing.assert_array_equal(launch(check_kernel, 1.0e-5, drop, 0.3 * BAR), 0.0)


def test_check_is_an_orifice_beyond_its_crack():
    crack = float(rounded(0.3 * BAR))
    drop = rounded(crack + np.logspace(3, 7, 200))
    over = drop - crack
    expected = 1.0e-5 * np.where(over < LAMINAR, over / np.sqrt(LAMINAR), np.sqrt(over))
    flow = launch(check_kernel, 1.0e-5, drop, crack)
    # the excess over the crack is rounded relative to the drop, the flow is at most proportional to it
    np.testing.assert_allclose(flow, expected, rtol=2 * ORIFICE_ERROR + ROUNDOFF * float(np.max(drop / over)))


def test_relief_opens_at_its_setting_and_reaches_its_flow_over_the_ramp():
    setting, ramp, nominal = 210.0 * BAR, 10.0 * BAR, 100.0 / 60000.0
    closed = np.array([-300.0, 0.0, 100.0, 210.0]) * BAR
    np.testing.assert_array_equal(launch(relief_kernel, closed, setting, ramp, nominal), 0.0)
    share = np.array([0.1, 0.5, 1.0, 3.0])
    flow = launch(relief_kernel, setting + share * ramp, setting, ramp, nominal)
    # the excess is a difference of pressures that are rounded relative to the pressure, here up to 240 bar over 1 bar
    np.testing.assert_allclose(flow, nominal * share, rtol=240.0 * ROUNDOFF + 4.0 * ROUNDOFF)


def test_a_filter_drops_what_its_flow_asks_for():
    setting, ramp, nominal = 3.0 * BAR, 1.0 * BAR, 100.0 / 60000.0
    closed = np.array([-30.0, 0.0, 3.0]) * BAR
    np.testing.assert_array_equal(launch(filter_kernel, closed, setting, ramp, nominal, 1e11), 0.0)
    flow = nominal * np.geomspace(1e-3, 3.0, 25)[:, None]
    throttle = np.array([1e3, 1e9, 15.0 * BAR / 1e-3**2])  # up to 15 bar at 60 L/min
    over = ramp / nominal * flow + throttle * flow**2
    found = launch(filter_kernel, setting + over, setting, ramp, nominal, throttle)
    # the excess is a difference of rounded pressures; the root has half of its relative error or less, and six roundings
    error = ROUNDOFF * (2.0 * (setting + over) / over + 6.0)
    assert np.all(np.abs(found / flow - 1.0) < error)


def test_a_clean_filter_is_its_check_alone():
    """To the bit."""
    setting, ramp, nominal = 3.0 * BAR, 1.0 * BAR, 100.0 / 60000.0
    drop = np.linspace(0.0, 9.0, 1001) * BAR
    clean = launch(filter_kernel, drop, setting, ramp, nominal, 0.0)
    np.testing.assert_array_equal(clean, launch(relief_kernel, drop, setting, ramp, nominal))


# ---- compressibility ----


def liquid_modulus(oil, p):
    """β_l of a liquid whose stiffness grows with pressure."""
    return oil.bulk_modulus + oil.bulk_modulus_slope * np.maximum(p, 0.0)


def mixture_modulus(oil, p):
    """The effective modulus as the equation of the docstring has it, with air that dissolves by its law."""
    absolute = np.maximum(p + ATMOSPHERE, 5000.0)
    gas = expanded(oil, absolute)
    rest = 1.0 - oil.gas_fraction
    x = np.clip(p / oil.solution_pressure, 0.0, 1.0) * (oil.gas_law == DISSOLVING)
    free, fall = 1.0 - 3.0 * x**2 + 2.0 * x**3, 6.0 * x * (1.0 - x) / oil.solution_pressure
    spring = free / (oil.polytropic_exponent * absolute) + fall
    return (rest + gas * free) / (rest / liquid_modulus(oil, p) + gas * spring)


def expanded(oil, absolute):
    """α (p_atm/P)^(1/n)."""
    return oil.gas_fraction * (ATMOSPHERE / absolute) ** (1.0 / oil.polytropic_exponent)


# pow of up to e⁹ with an exponent rounded once: 9 + 2 roundings, one more for the share
SHARE_ERROR = 12.0 * ROUNDOFF
# d: 1/P₀ and P/P₀; what the series leaves out; its last product and sum
SERIES_ERROR = 5.0 * ROUNDOFF
# and a dozen operations
MODULUS_ERROR = SHARE_ERROR + SERIES_ERROR + 12.0 * ROUNDOFF


def random_oils(count):
    rng = np.random.default_rng(2)
    return changed(
        OIL,
        bulk_modulus=rng.uniform(1.0e9, 1.72e9, count),
        bulk_modulus_slope=rng.uniform(0.0, 12.0, count),
        gas_fraction=10.0 ** rng.uniform(-5.0, -1.0, count),
        polytropic_exponent=rng.uniform(1.0, 1.4, count),
    )


def test_modulus_is_the_compressibility_of_oil_and_polytropic_gas():
    """1/β = −(dV/dp)/V of a volume V(p) of liquid (compressed with its own modulus) and gas (P Vⁿ constant).

    The equation leaves the liquid's own loss of volume out of the shares. Both sides are means of 1/β_l and 1/(nP), so
    the loss δ = ∫dp/β_l of the liquid's weight changes them by less than −ln(1 − δ) relative.
    """
    count = 2000
    oils = random_oils(count)
    oil = columns(oils)
    p = rounded(np.random.default_rng(3).uniform(-0.9, 350.0, count) * BAR)

    slope = np.maximum(oil.bulk_modulus_slope, 1e-9)

    def volume(p):
        """m³ of what fills 1 m³ at atmospheric pressure; the liquid's own curve is dV/V = −dp/(β₀ + s p), p ≥ 0."""
        shrunk = np.where(
            p > 0.0,
            np.power(1.0 + oil.bulk_modulus_slope * np.maximum(p, 0.0) / oil.bulk_modulus, -1.0 / slope),
            np.exp(-np.minimum(p, 0.0) / oil.bulk_modulus),
        )
        gas = (ATMOSPHERE / (p + ATMOSPHERE)) ** (1.0 / oil.polytropic_exponent)
        return (1.0 - oil.gas_fraction) * shrunk + oil.gas_fraction * gas

    step = 1e-4 * (p + ATMOSPHERE)
    compressibility = -(volume(p + step) - volume(p - step)) / (2.0 * step) / volume(p)
    loss = np.abs(p) / oil.bulk_modulus
    # central difference of a power: relative error (step/P)²·(1/n + 1)(1/n + 2)/6 ≤ 1e-8; float64 differences of
    # volumes 1e-16 / (1e-4 · 1e4 Pa · 7e-10 / Pa) ≈ 2e-7
    tolerance = -np.log(1.0 - loss) + MODULUS_ERROR + 1e-6
    modulus = launch(modulus_kernel, oils, p)
    assert np.all(np.abs(np.log(modulus * compressibility)) <= tolerance)


def test_modulus_follows_its_equation():
    oils = random_oils(2000)
    p = rounded(np.random.default_rng(4).uniform(-1.5, 350.0, 2000) * BAR)
    np.testing.assert_allclose(launch(modulus_kernel, oils, p), mixture_modulus(columns(oils), p), rtol=MODULUS_ERROR)


def test_free_gas_is_the_polytrope_at_the_pressure_of_the_content():
    oils = random_oils(2000)
    content = rounded(np.random.default_rng(6).uniform(-1.5, 400.0, 2000) * BAR)
    oil = columns(oils)
    absolute = np.maximum(np.maximum(content, oil.void_pressure) + ATMOSPHERE, 5000.0)
    gas = launch(free_gas_kernel, oils, content)
    np.testing.assert_allclose(gas.share, expanded(oil, absolute), rtol=SHARE_ERROR)
    # sum and quotient
    np.testing.assert_allclose(gas.inverse_pressure, 1.0 / absolute, rtol=(1.0 + 0.95 * BAR / 6325.0) * ROUNDOFF)
    none = launch(free_gas_kernel, changed(oils, gas_fraction=0.0), content)
    np.testing.assert_array_equal(none.share, 0.0)
    np.testing.assert_array_equal(none.inverse_pressure, 0.0)


def known_gas(count, d):
    """Oils with exponents over all that is valid, their gas at pressures from 5 kPa to 400 bar, and pressures that differ
    from these by ``d`` or nearly so; with the exact ``d``."""
    rng = np.random.default_rng(7)
    exponent = np.where(rng.random(count) < 0.3, 1.0, rng.uniform(1.0, 2.0, count))
    oils = changed(random_oils(count), polytropic_exponent=exponent)
    known = np.exp(rng.uniform(np.log(5e3), np.log(4e7), count))
    gas = record(Gas, share=rng.uniform(1e-6, 1.0, count), inverse_pressure=1.0 / known)
    absolute = rounded(known * (1.0 + d))
    return oils, gas, absolute, absolute * columns(gas).inverse_pressure - 1.0


@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_gas_near_a_known_pressure_is_the_series(sign):
    """To what d⁶ leaves out and float32's roundings, one by one; without these, which go either way, in the mean."""
    count = 40_000
    reach = np.random.default_rng(8).uniform(0.0, 1.0, count) ** 0.25 * SERIES_REACH * (1.0 - 4e-6)
    oils, gas, absolute, d = known_gas(count, sign * reach)
    assert np.max(np.abs(d)) < SERIES_REACH
    a = 1.0 / columns(oils).polytropic_exponent
    error = launch(share_kernel, oils, gas, absolute) / (columns(gas).share * (1.0 + d) ** -a) - 1.0
    # P/P₀, of which e has a; the last sum; beside it a, its sum and two products, and half of six more in the terms in d²;
    # with what the sum is above and below e
    rounding = (a + 1.0 + a * np.abs(d) * (4.0 + 3.0 * np.abs(d))) * (1.0 + SERIES_REACH) * ROUNDOFF
    assert np.all(np.abs(error) <= d**6 + rounding)
    assert np.all(d**6 <= ROUNDOFF)
    # 6 s_6 ∫ t⁵ (1 + t)^(a−1) dt with the second factor at the mean of t under the first, 6/7 d: its curvature adds less
    # than 1/16
    s_6 = a * (a + 1.0) * (a + 2.0) * (a + 3.0) * (a + 4.0) * (a + 5.0) / 720.0
    left_out = s_6 * d**6 * (1.0 + 6.0 / 7.0 * d) ** (a - 1.0)
    for low in (0.0, 0.9):
        shell = np.abs(d) >= low * SERIES_REACH
        within = np.mean(left_out[shell]) / 16.0 + 4.0 * np.sqrt(np.mean(rounding[shell] ** 2) / np.sum(shell))
        assert abs(np.mean(error[shell] + left_out[shell])) < within


def test_gas_far_from_a_known_pressure_is_the_power():
    """To the bit, whatever was known."""
    rng = np.random.default_rng(9)
    beyond = SERIES_REACH * (1.0 + 10.0 ** np.concatenate([[-5.4], rng.uniform(-5.4, 3.0, 2000)]))
    d = np.concatenate([beyond, -beyond[beyond < 1.0]])
    oils, gas, absolute, d = known_gas(len(d), d)
    assert np.min(np.abs(d)) > SERIES_REACH
    wrong = changed(gas, share=123.0)
    np.testing.assert_array_equal(launch(share_kernel, oils, wrong, absolute), launch(polytrope_kernel, oils, absolute))


def test_modulus_is_the_same_from_wherever_its_gas_is_known():
    count = 20_000
    rng = np.random.default_rng(10)
    oils = random_oils(count)
    oil = columns(oils)
    known = np.exp(rng.uniform(np.log(5e3), np.log(4e7), count))
    p = rounded(known * (1.0 + rng.uniform(-2.0, 2.0, count) * SERIES_REACH) - ATMOSPHERE)
    modulus = launch(modulus_from_kernel, oils, known - ATMOSPHERE, p)
    np.testing.assert_allclose(modulus, mixture_modulus(oil, p), rtol=MODULUS_ERROR)


def test_modulus_without_gas_is_the_liquids():
    p = rounded(np.array([-0.95, 0.0, 1.0, 100.0, 350.0]) * BAR)
    expected = 1.4e9 + 10.0 * np.maximum(p, 0.0)
    np.testing.assert_allclose(launch(modulus_kernel, OIL, p), expected, rtol=2.0 * ROUNDOFF)


def test_modulus_with_gas_at_atmospheric_pressure():
    """At p = 0 the gas has its nominal share: 1/β = (1−α)/β₀ + α/(n p_atm)."""
    alpha = rounded(np.array([1e-4, 0.01, 0.05, 0.5]))
    modulus = launch(modulus_kernel, changed(OIL, gas_fraction=alpha), 0.0)
    expected = 1.0 / ((1.0 - alpha) / 1.4e9 + alpha / (float(rounded(1.4)) * ATMOSPHERE))
    np.testing.assert_allclose(modulus, expected, rtol=MODULUS_ERROR)


def test_oil_without_gas_is_the_same_oil_but_for_its_gas():
    oils = random_oils(50)
    p = np.linspace(-0.95, 350.0, 50) * BAR
    np.testing.assert_array_equal(
        launch(liquid_modulus_kernel, oils, p), launch(modulus_kernel, changed(oils, gas_fraction=0.0), p)
    )


def test_modulus_tends_to_the_liquids_at_high_pressure_and_with_little_gas():
    # at 1 GPa: gas share α e = 0.05 · 1e-4^(1/1.4) = 7e-5 with modulus 1.4 GPa against the liquid's 11.4
    stiff = launch(modulus_kernel, changed(OIL, gas_fraction=0.05), 1.0e9)
    assert stiff == pytest.approx(1.14e10, rel=7.5e-5 * 11.4 / 1.4)
    little = launch(modulus_kernel, changed(OIL, gas_fraction=1.0e-9), 0.0)
    assert little == pytest.approx(1.4e9, rel=1.1e-9 * 1.4e9 / (1.4 * ATMOSPHERE))


def test_modulus_grows_with_pressure_and_falls_with_gas():
    p = np.linspace(-0.9, 350.0, 2000) * BAR
    modulus = launch(modulus_kernel, changed(OIL, gas_fraction=0.02), p)
    assert np.all(np.diff(modulus) > 0.0)
    alpha = np.linspace(0.0, 0.2, 500)
    assert np.all(np.diff(launch(modulus_kernel, changed(OIL, gas_fraction=alpha), 5.0 * BAR)) < 0.0)


def test_gas_is_bounded_at_five_kilopascal():
    oil = changed(OIL, gas_fraction=0.01)
    below, floor = launch(modulus_kernel, oil, np.array([-2.0 * BAR, 5000.0 - ATMOSPHERE]))
    assert below == pytest.approx(floor, rel=MODULUS_ERROR)


# ---- air that dissolves, and other laws of oil ----


def dissolving_oil(**values):
    return changed(OIL, gas_law=DISSOLVING, gas_fraction=0.02, **values)


def test_dissolving_air_is_the_compressibility_of_its_volume():
    """−(dV/dp)/V of liquid and α e ψ by differences in float64, ψ = 1 − 3 x² + 2 x³ of the solution pressure."""
    oil_record = dissolving_oil(bulk_modulus_slope=0.0, polytropic_exponent=rounded(np.array([1.0, 1.2, 1.4]))[:, None])
    oil, h = columns(oil_record), 1e3
    p = rounded(np.concatenate([np.linspace(-0.6, 0.0, 5)[:-1], np.linspace(0.1, 40.0, 200)]) * BAR)

    def gas(p):
        x = np.clip(p / oil.solution_pressure, 0.0, 1.0)
        return expanded(oil, p + ATMOSPHERE) * (1.0 - x * x * (3.0 - 2.0 * x))

    rest = 1.0 - oil.gas_fraction
    expected = (rest + gas(p)) / (rest / 1.4e9 - (gas(p + h) - gas(p - h)) / (2.0 * h))
    modulus = launch(modulus_kernel, oil_record, p)
    # differences of 1e-16 over 2 h of a compressibility of 7e-10, and h²/6 of third derivatives: below (h/P)² of the gas'
    error = MODULUS_ERROR + 16 * ROUNDOFF + 1e-16 / h / 7e-10 + 2.0 * (h / (p + ATMOSPHERE)) ** 2
    smooth = np.abs(p[None] - oil.solution_pressure) > h
    smooth = smooth & (np.abs(p) > h)
    assert np.all((np.abs(modulus / expected - 1.0) <= error)[np.broadcast_to(smooth, modulus.shape)])
    mixture = mixture_modulus(oil, p[None])
    within(
        modulus / mixture - 1.0,
        MODULUS_ERROR + 16 * ROUNDOFF,
        law="gas: dissolving",
        oracle="modulus of liquid and free air in series [-]",
        source="rounding of the power, and 16 operations",
    )


def test_dissolving_air_is_free_below_the_atmosphere_and_gone_at_the_solution_pressure():
    dissolving, free = dissolving_oil(), changed(dissolving_oil(), gas_law=0)
    below = np.linspace(-0.9, 0.0, 50) * BAR
    np.testing.assert_allclose(
        launch(modulus_kernel, dissolving, below), launch(modulus_kernel, free, below), rtol=4 * ROUNDOFF
    )
    above = np.array([30.0, 31.0, 100.0, 350.0]) * BAR
    liquid = 1.4e9 + 10.0 * above
    np.testing.assert_allclose(launch(modulus_kernel, dissolving, above), liquid, rtol=4 * ROUNDOFF)
    assert np.all(launch(modulus_kernel, free, above) < 0.999 * liquid)
    # what dissolves gives way beside what is compressed: softer than a polytrope up to four fifths of the way
    way = np.linspace(0.05, 0.8, 100) * 30.0 * BAR
    assert np.all(launch(modulus_kernel, dissolving, way) < launch(modulus_kernel, free, way))


def test_laws_of_gas_and_liquid_reach_the_device():
    """Isothermal and adiabatic air by their exponents; constant liquid as stiff as the other at 50 bar, at any pressure."""
    machine = Machine.load("aoro").with_laws(gas=["polytropic", "isothermal", "adiabatic"])
    own = float(machine.oil.polytropic_exponent)
    np.testing.assert_allclose(pack(machine)["oil"]["polytropic_exponent"], [own, 1.0, 1.4], rtol=ROUNDOFF)
    stiffening, constant = pack(Machine.load("aoro").with_laws(liquid=["stiffening", "constant"]))["oil"]
    stiffening["gas_fraction"] = constant["gas_fraction"] = 0.0
    p = np.array([0.0, 50.0, 200.0]) * BAR
    rising, level = launch(modulus_kernel, stiffening, p), launch(modulus_kernel, constant, p)
    np.testing.assert_array_equal(level, level[0])
    assert level[1] == pytest.approx(rising[1], rel=4 * ROUNDOFF)
    assert rising[0] < level[0] < rising[2]


# ---- volumes ----


def test_pressure_is_the_content_above_the_void_pressure():
    content = np.array([-40.0, -0.95, -0.9, 0.0, 210.0]) * BAR
    np.testing.assert_array_equal(launch(pressure_kernel, OIL, content), rounded(np.maximum(content, -0.95 * BAR)))


def test_fill_adds_the_flow_over_oil_and_hose():
    rng = np.random.default_rng(5)
    count = 500
    oils = random_oils(count)
    oil = columns(oils)
    content = rounded(rng.uniform(-3.0, 350.0, count) * BAR)
    flow, dt = rounded(rng.uniform(-2e-3, 2e-3, count)), rounded(rng.uniform(1e-5, 1e-2, count))
    volume, hose = rounded(rng.uniform(0.3e-3, 4e-3, count)), rounded(rng.uniform(0.1e-12, 3e-12, count))
    change = dt * flow / (volume / mixture_modulus(oil, np.maximum(content, -0.95 * BAR)) + hose)
    tolerance = (MODULUS_ERROR + 4 * ROUNDOFF) * np.abs(change)
    out = launch(fill_kernel, oils, content, flow, dt, volume, hose)
    assert np.all(np.abs(out - content - change) <= tolerance + 2 * ROUNDOFF * np.abs(out))
    # a chamber does the same while it is full
    full = (content >= -0.95 * BAR) & (content + change >= -0.95 * BAR)
    assert 0.5 < np.mean(full) < 1.0
    out = launch(fill_chamber_kernel, oils, content, flow, dt, volume, hose, 1.0)
    assert np.all((np.abs(out - content - change) <= tolerance + 2 * ROUNDOFF * np.abs(out))[full])


def test_closed_chamber_without_gas_follows_the_liquids_curve():
    """Rigid chamber: dp = −(β₀ + s p) dV/V, so p = β₀/s ((V₀/V)^s − 1)."""
    volume = np.array([0.999, 0.995, 0.99]) * 1e-3
    compression = rounded(1e-3) / rounded(volume)
    expected = 1.4e9 / 10.0 * (compression**10.0 - 1.0)
    steps = 2000
    end = launch(piston_kernel, OIL, 0.0, 1e-3, volume, 0.0, steps)
    # Euler in p: relative error of the modulus within a step is s·Δp/β = s ΔV/V, half of it on average; a stroke of
    # 1e-3 in volume is rounded to 1e-4 relative in float32 (1e-3 · 2⁻²⁴ / 1e-6) once, and the steps' sum by √steps ulps
    travel = 1.0 - 1.0 / compression
    tolerance = 0.5 * 10.0 * travel * expected / steps + expected * 2 * ROUNDOFF / travel
    tolerance += ROUNDOFF * expected * steps
    assert np.all(np.abs(end - expected) <= tolerance)


def test_closed_chamber_with_gas_follows_the_polytrope():
    """With an incompressible liquid V/V₀ = (1−α) + α(p_atm/P)^(1/n) exactly: a closed form for any compression."""
    alpha, n, fixed = float(rounded(0.1)), float(rounded(1.4)), 1.0e-3
    oil = changed(OIL, bulk_modulus=1.0e15, bulk_modulus_slope=0.0, gas_fraction=alpha)
    # from 0 to 5 bar, and from 0 to 0.3 bar below the atmosphere
    target = np.array([5.0, -0.3]) * BAR
    volume = rounded(fixed * ((1 - alpha) + alpha * (ATMOSPHERE / (target + ATMOSPHERE)) ** (1 / n)))
    exact = ATMOSPHERE * (alpha / (volume / rounded(fixed) - (1 - alpha))) ** n - ATMOSPHERE
    coarse, fine = (launch(piston_kernel, oil, 0.0, fixed, volume, 0.0, steps) - exact for steps in (400, 800))
    # first order: half the step, half the error; the second order's share is of the size of the relative error, < 2 %
    np.testing.assert_allclose(coarse / fine, 2.0, rtol=0.05)
    assert np.all(np.abs(fine) < 0.02 * np.abs(exact))


def test_chamber_with_gas_and_hose_converges_to_the_continuous_curve():
    """SciPy on ṗ = −V̇/(V/β(p) + C_hose) with the equation above, first order in the step."""
    oil_record = changed(OIL, gas_fraction=0.02)
    oil = columns(oil_record)
    v0, v1, hose = (float(rounded(x)) for x in (1.0e-3, 0.97e-3, 0.4e-12))

    def rate(t, p):
        return (v0 - v1) / ((v0 + (v1 - v0) * t) / mixture_modulus(oil, p) + hose)

    exact = solve_ivp(rate, (0.0, 1.0), [0.0], method="LSODA", rtol=1e-10, atol=1e-3).y[0, -1]
    coarse, fine = (launch(piston_kernel, oil_record, 0.0, v0, v1, hose, steps) - exact for steps in (2000, 4000))
    assert exact > 50.0 * BAR
    assert coarse / fine == pytest.approx(2.0, rel=0.05)
    assert abs(fine) < 0.01 * exact


def test_compression_returns_and_what_is_left_over_is_the_steps():
    """Out and back through Euler steps of volume w gain w ln(C₁/C₀) in volume: ½C'/C²·w² a step, summed both ways."""
    steps, dt, flow, volume, hose = 4000, 1e-4, -1e-4, 1e-3, 1e-13
    oil_record = changed(OIL, gas_fraction=0.01)
    oil = columns(oil_record)
    start = 1.0 * BAR
    turning, end = launch(pump_out_and_in_kernel, oil_record, start, flow, steps, dt, volume, hose)

    def compliance(p):
        return volume / mixture_modulus(oil, p) + hose

    c0, c1 = compliance(start), compliance(turning)
    assert turning > 100.0 * BAR
    predicted = abs(flow) * dt * np.log(c1 / c0) / c0
    assert abs(predicted) > 100.0 * ROUNDOFF * start
    # second order: terms of the relative size of a step, dp/P = w/(C P), here ≤ 2 %; rounding is dp's ulp at the top,
    # mapped down by C₁/C₀, a random walk over both ways
    walk = np.sqrt(2 * steps) * ROUNDOFF * turning * c1 / c0
    assert abs(end - start - predicted) <= 0.05 * abs(predicted) + walk


def test_void_is_the_volume_drawn():
    """(p_void − x)(V/β(p_void) + C_hose) is the void's volume, and the pressure stays at the void pressure meanwhile."""
    steps, dt, flow, volume, hose = 3000, 1e-4, 1e-3, 1e-3, 2e-12
    start = -0.951 * BAR
    for gas in (0.0, 0.05):
        oil = changed(OIL, gas_fraction=gas)
        turning, end = launch(pump_out_and_in_kernel, oil, start, flow, steps, dt, volume, hose)
        drawn = flow * dt * steps
        # one rounding of each step's increment and of each sum, all in the same direction at worst
        tolerance = 2.0 * steps * ROUNDOFF
        compliance = volume / mixture_modulus(columns(oil), -0.95 * BAR) + hose
        drop = drawn / compliance
        assert start - turning == pytest.approx(drop, rel=MODULUS_ERROR, abs=tolerance * abs(turning))
        assert launch(pressure_kernel, oil, turning) == pytest.approx(-0.95 * BAR, rel=2 * ROUNDOFF)
        assert end == pytest.approx(start, abs=tolerance * abs(turning))


def test_step_over_the_void_pressure_splits_its_oil():
    """A chamber's step of volume w from x₀ to x₁ across p_v: C (x₀ − p_v) + C_void (p_v − x₁) = w, with a constant C above.

    Otherwise every crossing makes or loses oil, and a port that cavitates again and again drifts.
    """
    volume, hose, dt = 1e-3, 3.6e-13, 1e-4
    void, above, below = -0.95 * BAR, volume / 1.4e9 + hose, volume / 1.4e9
    gap = np.array([0.02, 0.3, 0.7]) * BAR
    oil_above, oil_below = gap * above, gap * below
    # out: from above the void pressure, as much oil again is drawn; in: a void is filled and as much oil again added
    out = launch(fill_chamber_kernel, OIL, void + gap, -2.0 * oil_above / dt, dt, volume, hose, volume)
    back = launch(fill_chamber_kernel, OIL, void - gap, 2.0 * oil_below / dt, dt, volume, hose, volume)
    # contents of about 1 bar with a few roundings each
    np.testing.assert_allclose((void - out) * below, oil_above, atol=16 * ROUNDOFF * 2 * BAR * above)
    np.testing.assert_allclose((back - void) * above, oil_below, atol=16 * ROUNDOFF * 2 * BAR * above)


@pytest.mark.parametrize("gas", [0.0, 0.01])
def test_void_closes_where_it_opened(gas):
    """Oil drawn until a void forms and given back: the pressure returns.

    A step of volume w may straddle the void pressure once on either way and errs by at most its own oil, so 2w; the
    Euler steps above the void pressure leave w |ln(C_void/C_start)| (see above), taken twice for its second order.
    """
    steps, dt, volume, hose = 30000, 1e-5, 1e-3, 3.6e-13
    oil_record = changed(OIL, gas_fraction=gas)
    oil = columns(oil_record)
    start = 3.0 * BAR
    flow = np.linspace(0.9e-3, 1.1e-3, 11)
    turning, end = launch(pump_out_and_in_kernel, oil_record, start, flow, steps, dt, volume, hose)
    assert np.all(turning < -0.95 * BAR)

    def compliance(p):
        return volume / mixture_modulus(oil, p) + hose

    one_step = flow * dt
    bound = 2.0 * one_step + 2.0 * one_step * abs(np.log(compliance(-0.95 * BAR) / compliance(start)))
    # the deep content is a large float32 number: an ulp a step, as a random walk over both ways
    walk = np.sqrt(2.0 * steps) * ROUNDOFF * np.abs(turning) * volume / 1.4e9
    # the oil missing or too much at the end, as the volume that would bring the pressure back
    p = np.linspace(0.0, 1.0, 2001)[:, None] * (end - start) + start
    missing = np.trapezoid(compliance(p), p, axis=0)
    assert np.all(np.abs(missing) <= bound + walk), (missing / one_step).round(2)
    # and the bound is a small part of what was drawn
    assert np.all(bound + walk < 0.01 * one_step * steps)
