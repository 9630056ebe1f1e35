"""Laws of aspen: a gear pump behind a priority valve, a poppet relief, oil by a logarithmic modulus, coarse air behind
necks, hoses that swell by a power of pressure, a spool with LuGre friction, semicircular notches, a filter with a soft cake.

Tires are Dugoff's with Gough's swivel moment; seals by Makkar, the bearing by Threlfall, pins by Liu's conformal contact.
"""

from typing import Any

import warp as wp

from aoro_gym.diagnosis_benchmark.independent.laws import layout as at
from aoro_gym.diagnosis_benchmark.independent.laws.geometry import chambers
from aoro_gym.diagnosis_benchmark.independent.laws.numbers import HALF, ONE, TWO, ZERO, check, f64, unit

from . import assembly
from .common import into_ports, passage, relief
from .disturbances import accumulator, other_flow, pinch, pulsation
from .places import (
    ATMOSPHERE,
    BAR,
    COMPENSATOR,
    CONTROL,
    DRIVER,
    GAS,
    GROUND_FLOOR,
    HYSTERESIS,
    LINE,
    SENSE,
    SIDE_A,
    SIDE_B,
    SPOOL,
    SPOOL_RATE,
    STROKE,
    SUPPLY,
    TIRE,
    Hydraulic,
    State,
    Tire,
    vec2d,
    vec3d,
    vec4d,
)  # fmt: skip

RETURN, RELIEF = LINE, LINE + 1
"""Pressure [Pa] before the return filter; lift of the relief's poppet, share of the whole one."""
HIGHEST = wp.constant(f64(280.0e5))
"""Pressure [Pa] at which the oil's modulus is as given (Boes)."""
REACH = wp.constant(f64(3.0))
"""Demand over the largest force up to which a tire's deflection grows: 92 % of that force."""
TURN = wp.constant(f64(4.0))
"""Twist of a patch over that of a straight line to its largest moment, beyond which it turns as a whole."""


@wp.func
def liquid(pressure: wp.float64, m: Any):
    """Bulk modulus [Pa] of oil with its finest bubbles: ½ K_m lg(90 p/p_m + 3), p_m = 280 bar.

    Empirical, 20 to 60 °C, 0 to 350 bar (Boes; Jelali, Kroll: Hydraulic Servo-systems, 2003, with that of Lee 1977).
    """
    above = wp.max(pressure, ZERO)
    return HALF * m.bulk_modulus * wp.log10(f64(90.0) * above / HIGHEST + f64(3.0))


@wp.func
def swelling(pressure: wp.float64, m: Any):
    """Compliance [1/Pa] of hoses whose volume grows by e ((p + p₁)/p₀)^0.7, p₀ = 100 bar, p₁ = 4 bar.

    A power law through makers' volumetric expansion by the test of ISO 6801 (E); 0 to 300 bar.
    """
    reference = f64(100.0) * BAR
    share = (wp.max(pressure, ZERO) + f64(4.0) * BAR) / reference
    return f64(0.7) * m.hose_expansion * wp.pow(share, f64(-0.3)) / reference


@wp.func
def pocket(pressure: wp.float64, m: Any):
    """Compliance [m³/Pa] of a pocket of coarse air by its own pressure: V₀ (p₀/p)^(1/n)/(n p), n = 1.2.

    Zhou, Liu, Karney 2013: trapped air, polytropic between isothermal and adiabatic.
    """
    absolute = wp.max(pressure + ATMOSPHERE, f64(0.05) * BAR)
    return m.pocket_at_rest * wp.pow(ATMOSPHERE / absolute, ONE / f64(1.2)) / (f64(1.2) * absolute)


@wp.func
def dugoff(demand: wp.float64):
    """Force over the one in proportion to a deflection, by that ``demand`` r over the largest force.

    Dugoff, Fancher, Segel 1970: 1 up to r = ½, (2 − λ) λ with λ = 1/(2 r) from there on, whatever the direction.
    """
    share = unit(HALF / wp.max(demand, f64(1e-9)))
    return (TWO - share) * share


@wp.func
def tire(x: Any, m: Any, wheel: int, motion: vec4d, load: wp.float64):
    """Deflections that a rolling tire forgets over its relaxation length (Bernard, Clover 1995) before Dugoff's force.

    Beyond three times the largest force the tread only slides. Twist: M₀ tanh(k ψ/M₀) towards Gough's moment on a standing
    wheel, M₀ = μ/3 √(F³/p) (Sharp, Granger 2003). Rates of the deflections, then forces along, across, and moment.
    """
    most = m.grip * load
    rolled = wp.abs(motion[2]) / m.relaxation_length
    along = m.stiffness_along * x[TIRE + 3 * wheel] / most
    across = m.stiffness_across * x[TIRE + 3 * wheel + 1] / most
    demand = wp.sqrt(along * along + across * across)
    rising = wp.max(along * m.stiffness_along * motion[0] + across * m.stiffness_across * motion[1], ZERO) / most
    loose = rising * demand / (REACH * REACH * REACH)
    t = Tire()
    for i in range(2):
        t[i] = motion[i] - (rolled + loose) * x[TIRE + 3 * wheel + i]
    force = most * dugoff(demand)
    t[3] = force * along + m.tire_damping * t[0]
    t[4] = -force * across - m.tire_damping * t[1]
    share = load / m.load_mean
    moment = m.swivel_moment * share * wp.sqrt(share)
    twist = m.twist_stiffness * x[TIRE + 3 * wheel + 2] / moment
    elastic = ONE
    if motion[3] * twist > ZERO:
        full = twist / TURN
        elastic = ONE - full * full * full * full
    t[2] = motion[3] * elastic - rolled * x[TIRE + 3 * wheel + 2]
    t[5] = -(moment * wp.tanh(twist) + f64(0.015) * m.twist_stiffness * t[2])
    return t


@wp.func
def resistance(x: Any, m: Any, wheel: int, load: wp.float64):
    """Torque [N m] against a wheel: rolling by Gee-Clough's mobility number (in the coefficient), and hubs.

    Hubs, their bearings and seals: a dry part and a viscous one with Ω^⅔ (Palmgren 1959).
    """
    speed = x[at.WHEEL + wheel]
    hub = m.brake_torque * (f64(0.75) + f64(0.25) * wp.pow(speed * speed + f64(1e-8), ONE / f64(3.0)))
    return (m.rolling * load * m.tire_radius + hub) * speed / wp.sqrt(speed * speed + f64(6e-4))


@wp.func
def hinge(x: Any, m: Any):
    """Threlfall's friction of the bearing: T (1 − e^(−3 |ω|/ω₀)) sgn ω, ω₀ = 12 mrad/s (Threlfall 1978): torque [N m]."""
    rate = x[at.RATE_FRONT] - x[at.RATE_REAR]
    grown = ONE - wp.exp(f64(-3.0) * wp.abs(rate) / f64(0.012))
    return vec2d(m.hinge_torque * grown * wp.sign(rate) + f64(130.0) * rate, ZERO)


@wp.func
def seals(x: Any, m: Any, c: Any, inputs: Any):
    """Makkar's continuous friction of both cylinders as a torque [N m], in two of its three tanh, and viscous.

    F (tanh 4 r − (1 − 1/q) tanh ½ r), r = v/v_s, q static over sliding (Makkar, Dixon, Sawyer, Hu 2005).
    """
    torque = ZERO
    for side in range(2):
        lever = c[4 + side]
        v = lever * x[at.ROD_RATE]
        r = v / m.stribeck_speed
        dry = wp.tanh(f64(4.0) * r) - (ONE - ONE / m.seal_ratio) * wp.tanh(HALF * r)
        torque += lever * (m.seal_force * dry + m.seal_viscosity * inputs[at.VISCOSITY] * v)
    return vec3d(torque, ZERO, ZERO)


@wp.func
def rods(x: Any, m: Any):
    """Torque [N m] of pins in bushes that nearly fit: k δ √(δ/(c + δ)) by the depth δ beyond the clearance c.

    Conformal contact of Liu, Zhang, Yang 2007, only pressing, damping with the same root; grease within the clearance.
    """
    stretch = x[at.ROD] - x[at.ANGLE]
    rate = x[at.ROD_RATE] - x[at.RATE_FRONT] + x[at.RATE_REAR]
    torque = f64(0.06) * m.joint_damping * rate
    depth = wp.abs(stretch) - m.joint_play
    if depth > ZERO:
        side = wp.sign(stretch)
        fit = wp.sqrt(depth / (m.joint_play + depth))
        torque += side * wp.max((m.joint_stiffness * depth + m.joint_damping * rate * side) * fit, ZERO)
    return vec2d(torque, ZERO)


@wp.func
def engine(x: Any, m: Any, load: wp.float64):
    """Governor on a Willans line: indicated torque less friction a ω + b ω² (Chen, Flynn 1965; Guzzella, Onder 2010).

    The rack moves no faster than 3000 N m/s, softly (tanh). Rates of speed and torque; friction counts from the set speed.
    """
    ratio = x[at.ENGINE] / m.engine_speed
    goal = m.engine_idle_torque + (ONE - ratio) / m.droop * f64(200.0)
    away = (wp.clamp(goal, ZERO, f64(625.0)) - x[at.GOVERNOR]) / f64(0.05)
    friction = f64(20.0) * (ratio * ratio - ONE) + f64(25.0) * (ratio - ONE)
    fastest = f64(3000.0)
    return vec2d((x[at.GOVERNOR] - load - friction) / m.engine_inertia, fastest * wp.tanh(away / fastest))


@wp.func
def notch(place: wp.float64):
    """Area of a milled notch uncovered to a share of its length, over the whole: a half disc of radius 0.3, then parallel.

    Borghi, Milani, Paoluzzi 2005 (notches of spool valves).
    """
    y = unit(place)
    r = f64(0.3)
    end = wp.min(y, r)
    depth = ONE - end / r
    disc = r * r * (wp.acos(depth) - depth * wp.sqrt(wp.max(ONE - depth * depth, ZERO)))
    whole = HALF * f64(wp.pi) * r * r + TWO * r * (ONE - r)
    return (disc + TWO * r * (y - end)) / whole


@wp.func
def opening(spool: wp.float64, m: Any):
    """Share of the edge that is open: three pairs of notches one after the other, and bores beside them that amplify."""
    s = wp.abs(spool)
    band = m.band_left
    pairs = vec3d(m.pair_one_left, m.pair_two_left, m.pair_three_left)
    if spool < ZERO:
        band = m.band_right
        pairs = vec3d(m.pair_one_right, m.pair_two_right, m.pair_three_right)
    area = pairs[0] * notch((s - band) / (f64(0.8) - band)) + pairs[1] * notch((s - HALF) / f64(0.35))
    area += pairs[2] * notch(f64(4.0) * (s - f64(0.75)))
    return area * (ONE + (m.amplification - ONE) * unit((s - f64(0.2)) / f64(0.3)))


@wp.func
def hose_factor(flow: wp.float64, viscosity: wp.float64, m: Any):
    """Friction of a hose over the laminar one, at all Reynolds numbers, by Churchill 1977; roughness 1e-3 of the bore."""
    re = wp.max(m.line_reynolds * wp.abs(flow) / viscosity, ONE)
    inner = wp.pow(f64(7.0) / re, f64(0.9)) + f64(0.27e-3)
    a = wp.pow(f64(-2.457) * wp.log(inner), f64(16.0))
    b = wp.pow(f64(37530.0) / re, f64(16.0))
    slow = wp.pow(f64(8.0) / re, f64(12.0))
    factor = f64(8.0) * wp.pow(slow + ONE / wp.pow(a + b, f64(1.5)), ONE / f64(12.0))
    return factor * re / f64(64.0)


@wp.func
def through(drop: wp.float64, losses: wp.float64, more: wp.float64, viscosity: wp.float64, m: Any):
    """Flow [m³/s] through edges, a hose and ``more`` resistance [Pa s/m³]; two rounds of the hose's factor."""
    line = m.line_resistance * viscosity
    flow = passage(drop, losses, line + more)
    for _ in range(2):
        flow = passage(drop, losses, line * hose_factor(flow, viscosity, m) + more)
    return flow


@wp.func
def priority(closing: wp.float64, m: Any):
    """Conductance [m³/(s √Pa)] of the priority valve's edge to the steering, by the opening of the one to other users."""
    return m.priority_passage * unit(f64(0.1) + f64(1.8) * (ONE - closing))


@wp.func
def flows(x: Any, m: Any, inputs: Any):
    """Flows [m³/s] out of the supply and into the return line, drop [Pa] over the metering edge, sensed pressure."""
    left = x[SPOOL] > ZERO
    port = x[SIDE_B]
    other = x[SIDE_A]
    nominal = m.edge_right
    added = ZERO
    block = ZERO
    if left:
        port = x[SIDE_A]
        other = x[SIDE_B]
        nominal = m.edge_left
        added = pinch(x, m)
        block = m.half_block
    viscosity = inputs[at.VISCOSITY]
    area = opening(x[SPOOL], m) + f64(1e-7)
    edge = nominal * area
    place = x[COMPENSATOR]
    throttle = m.compensator_passage * (place * place + f64(1e-6))
    first = priority(x[CONTROL], m)
    losses = ONE / (edge * edge) + ONE / (throttle * throttle) + ONE / (first * first)
    flow = through(x[SUPPLY] - port, losses, added, viscosity, m)
    back = m.return_edge * area * (ONE - block)
    out = through(other - x[RETURN], ONE / (back * back), ZERO, viscosity, m)
    sensed = x[SUPPLY] - flow * flow * losses
    return vec4d(flow, out, flow * flow / (edge * edge), wp.where(area > f64(1e-3), sensed, m.tank_pressure))


@wp.func
def long_orifice(drop: wp.float64, viscosity: wp.float64, m: Any):
    """Flow [m³/s] through a bore twice as long as wide: √(2 Δp/ρ) A = Q/C_d + 20 (1 + 2.25 L/d) ν A/d.

    Lichtarowicz, Duggins, Markland 1965, Re 10 to 2e4; what flows below that is left out. C_d = 0.8.
    """
    speed = wp.sqrt(wp.abs(drop) * m.speed_square) - f64(110.0) * viscosity * m.bore_thickness
    return wp.sign(drop) * f64(0.8) * m.bore_area_leak * wp.max(speed, ZERO)


@wp.func
def leaks(x: Any, m: Any, inputs: Any, c: Any):
    """Leakage [m³/s] from A to B: past pistons by Couette and Poiseuille, π D h (h² Δp/(12 μ L) − ½ v), 1.9 times as much in
    an eccentric gap (Ivantysyn, Ivantysynova 2001); between the ports :func:`long_orifice`."""
    drop = x[SIDE_A] - x[SIDE_B]
    drawn = m.gap_half_area * (c[4] - c[5]) * x[at.ROD_RATE]
    past = m.gap_conductance / inputs[at.VISCOSITY] * drop - drawn
    return past + long_orifice(drop, inputs[at.VISCOSITY], m)


@wp.func
def port(pressure: wp.float64, m: Any):
    """Flow [m³/s] into a port from its anti-cavitation check, less that of its shock valve."""
    return relief(m.tank_pressure, pressure, f64(2.8e-9)) - relief(pressure, m.shock_pressure, f64(5.5e-10))


@wp.func
def into_sides(x: Any, m: Any, inputs: Any, f: vec4d, c: Any):
    """Flows [m³/s] into A and into B."""
    return into_ports(x[SPOOL], f, port(x[SIDE_A], m), port(x[SIDE_B], m), leaks(x, m, inputs, c))


@wp.func
def supply_rates(d: State, x: Any, m: Any, inputs: Any, f: vec4d):
    """Rates of the supply, its priority valve, its relief, and the return line.

    Gear pump: constant, its slip Δp/μ (Wilson 1946). Priority valve: one spool with an edge to the steering and one to an
    open centre and the tank, its spring against the drop to the load, behind a damping orifice (Axin 2013, R). Relief: a
    poppet, lift = (p − p₀)/(spring + 0.06 p of flow force), Q ∝ lift √p (Johnston, Edge, Vaughan 1991). Return: a filter
    whose cake is pressed denser, Δp^0.6 = α μ Q (Tiller 1953; exponent of compressibility 0.4).
    """
    viscosity = inputs[at.VISCOSITY]
    given = m.pump_displacement * x[at.ENGINE] * pulsation(m, inputs)
    bypass = m.bypass_passage * x[CONTROL]
    centre = bypass * m.centre_passage / wp.sqrt(bypass * bypass + m.centre_passage * m.centre_passage)
    let_go = check(centre, x[SUPPLY] - m.tank_pressure, HALF * BAR)
    lost = m.pump_leakage * f64(0.04) / viscosity * x[SUPPLY] + let_go + f[0] + other_flow(x[SUPPLY], m, inputs)
    lost += check(m.poppet_passage * x[RELIEF], x[SUPPLY], BAR)
    rise = (given - lost) / (m.supply_volume * (ONE / liquid(x[SUPPLY], m) + swelling(x[SUPPLY], m)))
    d[SUPPLY] = rise
    d[SENSE] = (wp.max(f[3], ZERO) - x[SENSE]) / m.sense_lag
    spent = f[0] / priority(x[CONTROL], m)
    error = x[SUPPLY] - spent * spent - x[SENSE] - m.margin + m.regulator_lead * rise
    d[CONTROL] = (unit(HALF + error / m.priority_band) - x[CONTROL]) / m.priority_lag
    lift = unit((x[SUPPLY] - m.poppet_pressure) / (m.poppet_band + f64(0.06) * wp.max(x[SUPPLY], ZERO)))
    d[RELIEF] = (lift - x[RELIEF]) / f64(0.003)
    over = x[RETURN] - m.tank_pressure
    filtered = over / (m.cake * viscosity * wp.pow(over * over + f64(0.01) * BAR * BAR, f64(0.2)))
    d[RETURN] = (f[1] - filtered) / f64(3e-11)
    return d


@wp.func
def valve_rates(d: State, x: Any, m: Any, inputs: Any, f: vec4d):
    """Rates of the valve: a solenoid's current, a spool with mass, spring, damping and friction by LuGre (Canudas de Wit,
    Olsson, Åström, Lischinsky 1995); a compensator whose port is a triangle.

    The solenoid's force falls in a straight line with the speed at which it pulls, by the voltage that motion induces
    (Merritt 1967). Friction in units of the spring's force at full stroke: ż = κ (v − |v| z/g), g = w (1 + 0.3 e^−(v/3)²).
    """
    d[DRIVER] = (inputs[at.COMMAND] + m.null_shift - x[DRIVER]) / m.coil_lag
    v = x[SPOOL_RATE]
    ratio = v / f64(3.0)
    level = m.bristle_friction * (ONE + f64(0.3) * wp.exp(-ratio * ratio))
    bristle = f64(4.0) * (v - wp.abs(v) * x[HYSTERESIS] / level)
    d[HYSTERESIS] = bristle
    w = m.spool_frequency
    force = x[DRIVER] - x[SPOOL]
    force *= wp.max(ONE - v * wp.sign(force) / m.spool_rate, ZERO)
    d[SPOOL] = v
    d[SPOOL_RATE] = w * w * (force - x[HYSTERESIS] - f64(1e-3) * bristle - TWO * m.spool_damping * v / w)
    goal = wp.sqrt(unit(HALF + (m.edge_drop - f[2]) / (f64(0.8) * m.edge_drop)))
    d[COMPENSATOR] = (goal - x[COMPENSATOR]) / m.compensator_lag
    return d


@wp.func
def hydraulics(d: State, x: Any, m: Any, inputs: Any, c: Any):
    """Derivatives of pressures, pump, valve: Q − V̇ − q = (V/K + V_h e′) ṗ a side, q into its pocket through a
    neck, laminar."""
    f = flows(x, m, inputs)
    into = into_sides(x, m, inputs, f, c)
    for i in range(2):
        p = x[SIDE_A + i]
        gas = (p - x[GAS + i]) / (m.neck_resistance * inputs[at.VISCOSITY] / f64(0.04))
        soft = (c[i] + m.hose_volume) / liquid(p, m) + m.hose_volume * swelling(p, m)
        if i == 0:
            soft += accumulator(p, m)
        d[SIDE_A + i] = (into[i] - c[2 + i] * x[at.ROD_RATE] - gas) / soft
        d[GAS + i] = gas / pocket(x[GAS + i], m)
    d = supply_rates(d, x, m, inputs, f)
    return valve_rates(d, x, m, inputs, f)


@wp.func
def limit(x: State, m: Any):
    """Stops of the valves, pressures at boiling oil."""
    x[CONTROL] = unit(x[CONTROL])
    x[COMPENSATOR] = unit(x[COMPENSATOR])
    for i in range(3):
        x[SIDE_A + i] = wp.max(x[SIDE_A + i], GROUND_FLOOR)
    for i in range(2):
        x[GAS + i] = wp.max(x[GAS + i], GROUND_FLOOR)
    x[RETURN] = wp.max(x[RETURN], GROUND_FLOOR)
    return x


@wp.func
def start(m: Any, angle: wp.float64):
    """State at rest: the pump's flow passes the priority valve, pockets are as pressed as their sides."""
    x = assembly.at_rest(State(), m, angle)
    x[STROKE] = ONE
    x[CONTROL] = HALF
    x[RETURN] = m.tank_pressure
    for i in range(2):
        x[GAS + i] = m.rest_pressure
    return x


@wp.func
def hydraulic_signals(x: Any, m: Any, inputs: Any):
    """Pressures a, b, pump; flows into a and b; spool."""
    into = into_sides(x, m, inputs, flows(x, m, inputs), chambers(x[at.ROD], m))
    return Hydraulic(x[SIDE_A], x[SIDE_B], x[SUPPLY], into[0], into[1], x[SPOOL])
