"""Lumped-parameter fluid power: orifices, checks, reliefs, and the compliance of an oil volume.

Pressures are gauge [Pa] (0 = tank), flows [m³/s], compliances [m³/Pa].
Sources: Merritt, *Hydraulic Control Systems* (1967), ch. 3 (orifices) and ch. 1 (bulk modulus of oil with free gas).
"""

# pyright: reportGeneralTypeIssues=false, reportInvalidTypeForm=false
import warp as wp

from aoro_gym import units
from aoro_gym.twin.physics.laws import option

ATMOSPHERIC_PRESSURE = wp.constant(units.ATMOSPHERIC_PRESSURE)
GAS_DISSOLVING = option("gas", "dissolving")
SERIES_REACH = wp.constant(1.0 / 16.0)
"""Relative change of pressure up to which :func:`gas_share` is a series: its sixth power is 2⁻²⁴."""


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    return rsqrtf(x);
#else
    return 1.0f / wp::sqrt(x);
#endif
""")
def inverse_root(x: float) -> float:
    """1/√x: one instruction on CUDA."""


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    return true;
#else
    return false;
#endif
""")
def on_cuda() -> bool:
    """Whether the code is compiled for CUDA."""


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    asm volatile("" : "+f"(x));
#endif
    return x;
""")
def seldom(x: float) -> float:
    """``x``; what follows of it CUDA's compiler leaves in its branch, and does not compute in any case."""


@wp.struct
class Oil:
    """The fluid of all circuits (machine section ``oil``)."""

    bulk_modulus: float  # [Pa] at 0 Pa gauge, without gas
    bulk_modulus_slope: float  # [-] increase with pressure
    gas_fraction: float  # [-] volume share of free gas at atmospheric pressure
    polytropic_exponent: float  # [-]
    laminar_pressure: float  # [Pa] below it an orifice is laminar
    void_pressure: float  # [Pa] gauge pressure at which a void forms
    gas_law: int  # by the numbers of aoro_gym.machine.laws
    solution_pressure: float  # [Pa]
    liquid_law: int


@wp.struct
class Gas:
    """Free gas of a volume at one pressure, from which :func:`gas_share` finds it at those nearby; zeros without gas."""

    share: float  # [-] α e₀, in volumes of the oil with its gas at atmospheric pressure
    inverse_pressure: float  # [1/Pa] 1/P₀, absolute


@wp.func
def orifice(coefficient: float, drop: float, laminar_pressure: float):
    """Flow [m³/s] through a restrictor: Q = C √Δp where turbulent, Q = C Δp/√Δp_lam below ``laminar_pressure``.

    ``coefficient`` C = C_d A √(2/ρ) = Q_nom/√Δp_nom [m³/s/√Pa]. Continuous and odd in ``drop`` [Pa].
    Valid for short orifices at Reynolds numbers where C_d is constant; the laminar branch keeps the slope finite.
    """
    return coefficient * drop * inverse_root(wp.max(wp.abs(drop), laminar_pressure))


@wp.func
def check_valve(coefficient: float, drop: float, crack: float, laminar_pressure: float):
    """Flow [m³/s] through a spring-loaded check that opens at ``crack`` [Pa]; none backwards."""
    return orifice(coefficient, wp.max(drop - crack, 0.0), laminar_pressure)


@wp.func
def relief_valve(drop: float, setting: float, ramp: float, nominal_flow: float):
    """Flow [m³/s] of a direct-acting relief: zero up to ``setting``, ``nominal_flow`` at ``setting + ramp`` [Pa]."""
    return (nominal_flow / ramp) * wp.max(drop - setting, 0.0)


@wp.func
def return_filter(drop: float, setting: float, ramp: float, nominal_flow: float, throttle: float):
    """Flow [m³/s] through a filter behind a spring-loaded check: Δp = setting + r Q + a Q², with
    r = ``ramp``/``nominal_flow`` and a = ``throttle`` [Pa s²/m⁶].

    Solved for Q in the form that does not cancel. A clean filter is its check alone.
    """
    linear = ramp / nominal_flow
    over = wp.max(drop - setting, 0.0)
    throttled = 2.0 * over / (linear + wp.sqrt(linear * linear + 4.0 * throttle * over))
    return wp.where(throttle > 0.0, throttled, relief_valve(drop, setting, ramp, nominal_flow))


@wp.func
def pressure(oil: Oil, content: float):
    """Pressure [Pa] of a volume from its state ``content`` [Pa].

    Above the void pressure the state is the pressure; below, the shortfall times the void compliance is the
    void's volume, which has to be refilled before the pressure rises again.
    """
    return wp.max(content, oil.void_pressure)


@wp.func
def absolute_pressure(p: float):
    """P [Pa] of free gas at gauge pressure ``p`` [Pa]; bounded below by 5 kPa."""
    return wp.max(p + ATMOSPHERIC_PRESSURE, 5000.0)


@wp.func
def polytrope(oil: Oil, absolute: float):
    """Volume α e [-] of the free gas at ``absolute`` pressure P [Pa], e = (p_atm/P)^(1/n)."""
    return oil.gas_fraction * wp.pow(absolute * (1.0 / ATMOSPHERIC_PRESSURE), -1.0 / oil.polytropic_exponent)


@wp.func
def free_gas(oil: Oil, content: float):
    """Free gas of a volume in the state ``content`` [Pa]: what the power costs once, :func:`gas_share` need not pay again.
    """
    gas = Gas()
    if oil.gas_fraction > 0.0:
        absolute = absolute_pressure(pressure(oil, content))
        gas.share = polytrope(oil, absolute)
        gas.inverse_pressure = 1.0 / absolute
    return gas


@wp.func
def gas_share(oil: Oil, gas: Gas, absolute: float):
    """:func:`polytrope` at ``absolute`` pressure P [Pa], from the ``gas`` at P₀ if that is near: by the binomial series

    α e = α e₀ (1 + d)^(−a) = α e₀ Σ s_k d^k with d = P/P₀ − 1, a = 1/n, s_0 = 1, s_k = −s_(k−1) (a + k − 1)/k.

    What is left out after d⁵ is 6 s_6 ∫₀^d t⁵ (1 + t)^(a−1) dt of the whole. As a ≤ 1 this is at most d⁶, that is one
    rounding of float32 at |d| = 1/16; beyond, it is the power. On CUDA it always is: there a power is little more than
    two instructions, and P₀ and e₀ would take registers.
    """
    d = absolute * gas.inverse_pressure - 1.0
    share = float(0.0)
    if not on_cuda() and wp.abs(d) <= SERIES_REACH:
        a = 1.0 / oil.polytropic_exponent
        s_2 = a * (a + 1.0) * (1.0 / 2.0)
        s_3 = -s_2 * (a + 2.0) * (1.0 / 3.0)
        s_4 = -s_3 * (a + 3.0) * (1.0 / 4.0)
        s_5 = -s_4 * (a + 4.0) * (1.0 / 5.0)
        share = gas.share + gas.share * d * (-a + d * (s_2 + d * (s_3 + d * (s_4 + d * s_5))))
    else:
        share = polytrope(oil, absolute)
    return share


@wp.func
def undissolved(oil: Oil, p: float):
    """Share ψ of the air that is free at gauge pressure ``p`` [Pa], and −dψ/dp [1/Pa]: 1 up to atmospheric pressure, 0 from
    the ``solution_pressure`` on, and between them 1 − 3 x² + 2 x³ (Henry's law at once, smooth as in Ruan & Burton, IMECE
    2006, 15029). Valid for changes slow beside the air's diffusion."""
    x = wp.clamp(p / oil.solution_pressure, 0.0, 1.0)
    return 1.0 - x * x * (3.0 - 2.0 * x), 6.0 * x * (1.0 - x) / oil.solution_pressure


@wp.func
def oil_bulk_modulus(oil: Oil, gas: Gas, p: float):
    """Effective bulk modulus [Pa] of oil at gauge pressure ``p`` [Pa], with the free ``gas`` known at any pressure.

    1/β = [(1−α)/β_l + α e/(n P)] / [(1−α) + α e], e = (p_atm/P)^(1/n), β_l = β_0 + s·max(p, 0), P absolute.
    The gas follows a polytrope and neither dissolves nor is released; by the law of dissolving gas its part
    :func:`undissolved` ψ is free, so that α e becomes α e ψ and 1/(n P) becomes 1/(n P) − ψ′/ψ. P is bounded below by 5 kPa.
    """
    liquid = oil.bulk_modulus + oil.bulk_modulus_slope * wp.max(p, 0.0)
    if oil.gas_fraction <= 0.0:
        return liquid
    absolute = absolute_pressure(p)
    share = gas_share(oil, gas, absolute)
    rest = 1.0 - oil.gas_fraction
    spring = oil.polytropic_exponent * absolute
    if oil.gas_law == GAS_DISSOLVING:
        free, fall = undissolved(oil, p)
        share = share * free
        spring = 1.0 / (1.0 / spring + fall / wp.max(free, 1.0e-6))
    return (rest + share) * liquid * spring / (rest * spring + share * liquid)


@wp.func
def without_gas(oil: Oil):
    """``oil`` that the compiler knows to be free of gas: its laws shrink to the liquid's."""
    liquid = oil
    liquid.gas_fraction = 0.0
    return liquid


@wp.func
def volume_stiffness(oil: Oil, gas: Gas, content: float, volume: float, hose_compliance: float):
    """dp/dV [Pa/m³] of a volume in the state ``content`` [Pa]: 1 / (V/β_oil(p) + V_hose/β_hose)."""
    modulus = oil_bulk_modulus(oil, gas, pressure(oil, content))
    return modulus / (volume + hose_compliance * modulus)


@wp.func
def fill(oil: Oil, gas: Gas, content: float, net_flow: float, dt: float, volume: float, hose_compliance: float):
    """State of a rigid volume [Pa] after ``dt`` [s] of ``net_flow`` [m³/s]: ṗ = ΣQ / (V/β_oil(p) + V_hose/β_hose).

    ``volume`` V [m³] is all the oil; ``hose_compliance`` V_hose/β_hose [m³/Pa] the walls' part. Below the void pressure
    β is constant: the void's volume is kept exactly.
    """
    return content + dt * net_flow * volume_stiffness(oil, gas, content, volume, hose_compliance)


@wp.func
def fill_chamber(
    oil: Oil, gas: Gas, content: float, net_flow: float, dt: float, volume: float, hose_compliance: float, nominal: float
):
    """:func:`fill` for a volume that a piston changes.

    A void is counted with the constant compliance ``nominal``/β_0, so that its volume is kept exactly while the piston
    moves; a step that crosses the void pressure is split there, so that no oil is made or lost.
    """
    added = dt * net_flow
    stiffness = volume_stiffness(oil, gas, content, volume, hose_compliance)
    void_stiffness = oil.bulk_modulus / nominal
    gap = content - oil.void_pressure
    full = gap >= 0.0
    end = content + added * wp.where(full, stiffness, void_stiffness)
    over = end - oil.void_pressure
    if full == (over >= 0.0):
        return end
    there = wp.where(full, void_stiffness, stiffness)
    here = wp.where(full, stiffness, void_stiffness)
    return oil.void_pressure + over * (seldom(there) / here)
