"""Laws of pine: long steel pipes in two halves with inertia each, compensators behind the metering edges, a swash plate
between a half bridge and a bias piston, a load-sensing line with a relief, oil by Kumari and Dass with bubbles by Wood.

Tires are UniTire's with a hyperbola in twist; seals by LuGre with a film that grows, brackets slip in their bolts.
"""

from typing import Any

import warp as wp

from aoro_gym.diagnosis_benchmark.independent.laws import layout as at
from aoro_gym.diagnosis_benchmark.independent.laws.numbers import HALF, ONE, TWO, ZERO, f64, orifice, unit

from . import assembly
from .common import bounded, into_ports, passage, relief
from .disturbances import accumulator, other_flow, pinch, pulsation
from .places import (
    ATMOSPHERE,
    BAR,
    COMPENSATOR,
    CONTROL,
    CREEP,
    DRIVER,
    GAS,
    GROUND_FLOOR,
    HYSTERESIS,
    LINE,
    SEAL,
    SENSE,
    SIDE_A,
    SPOOL,
    SPOOL_RATE,
    STROKE,
    SUPPLY,
    TIRE,
    WAVE,
    Hydraulic,
    State,
    Tire,
    vec2d,
    vec3d,
    vec4d,
)  # fmt: skip

NEAR, MIDDLE, FIRST, SECOND = LINE, GAS, LINE + 2, WAVE
"""Pressures [Pa] at the valve and halfway, flows [m³/s] in the near and the far half: of pipes A and B."""
SLIPS = SPOOL_RATE
"""Force of the second slip element at the spool; the first is in HYSTERESIS."""
STIFFENING, SATURATION = wp.constant(f64(10.5)), wp.constant(f64(4e-9))
"""Growth of the liquid's bulk modulus over pressure, and how that dies away [1/Pa] (S27; Kumari, Dass 1990)."""
UNSTEADY = wp.constant(f64(0.0345))
"""Share of a pipe's inertance that laminar friction adds while flow changes: √0.00476/2 (Vardy, Brown 1995)."""
SENSED_VOLUME = wp.constant(f64(9e-14))
"""Compliance [m³/Pa] of the load-sensing line: 90 mL."""
SLIPPING = wp.constant(f64(9e3))
"""Torque [N m] at which bolts of the brackets slip as a whole (E)."""
REACH, TURN = wp.constant(f64(2.5)), wp.constant(f64(6.0))
"""Demands over a tire's largest force and moment beyond which the tread only slides."""


@wp.func
def liquid(pressure: wp.float64, m: Any):
    """Volume of the liquid over that without pressure, and its bulk modulus [Pa].

    Kumari, Dass 1990: K = K₀ + (K′/λ)(1 − e^(−λ p)), so v = ((s e^(λ p) − a)/K₀)^(−1/(λ s)) with a = K′/λ, s = K₀ + a.
    """
    p = wp.max(pressure, ZERO)
    a = STIFFENING / SATURATION
    s = m.bulk_modulus + a
    volume = wp.pow((s * wp.exp(SATURATION * p) - a) / m.bulk_modulus, -ONE / (SATURATION * s))
    return vec2d(volume, s - a * wp.exp(-SATURATION * p))


@wp.func
def softness(pressure: wp.float64, m: Any):
    """Compliance [1/Pa] of oil with fine bubbles, isothermal, none of which dissolves (Wood 1930; Wylie, Streeter 1993)."""
    absolute = wp.max(pressure + ATMOSPHERE, f64(0.02) * BAR)
    oil = liquid(pressure, m)
    rest = (ONE - m.bubble_share) * oil[0]
    gas = m.bubble_share * ATMOSPHERE / absolute
    return (rest / oil[1] + gas / absolute) / (rest + gas)


@wp.func
def unitire(demand: wp.float64):
    """Force over its largest, by the ``demand`` φ: 1 − exp(−φ − E φ² − (E² + 1/12) φ³), E = 0.2 (Guo, Lu 2007)."""
    e = f64(0.2)
    return ONE - wp.exp(-demand * (ONE + demand * (e + demand * (e * e + ONE / f64(12.0)))))


@wp.func
def tire(x: Any, m: Any, wheel: int, motion: vec4d, load: wp.float64):
    """UniTire on deflections that rolling releases over the relaxation length (Guo, Lu 2007), along and across combined.

    Twist on turf: hyperbola k ψ/(1 + k ψ/M₀) (Kondner 1963), M₀ = ⅔ μ F R. Rates, forces along, across, and moment.
    """
    most = m.grip * load
    rolled = wp.abs(motion[2]) / m.relaxation_length
    along = m.stiffness_along * x[TIRE + 3 * wheel] / most
    across = m.stiffness_across * x[TIRE + 3 * wheel + 1] / most
    demand = wp.sqrt(along * along + across * across)
    rising = wp.max(along * m.stiffness_along * motion[0] + across * m.stiffness_across * motion[1], ZERO) / most
    over = demand / REACH
    loose = rising * over * over / (REACH * REACH)
    force = ONE
    if demand > f64(1e-6):
        force = unitire(demand) / demand
    t = Tire()
    for i in range(2):
        t[i] = motion[i] - (rolled + loose) * x[TIRE + 3 * wheel + i]
    t[3] = most * force * along + m.tire_damping * t[0]
    t[4] = -most * force * across - m.tire_damping * t[1]
    moment = m.swivel_moment * load / m.load_mean
    twist = m.twist_stiffness * x[TIRE + 3 * wheel + 2] / moment
    elastic = ONE
    if motion[3] * twist > ZERO:
        full = twist / TURN
        elastic = ONE - full * full
    t[2] = motion[3] * elastic - rolled * x[TIRE + 3 * wheel + 2]
    t[5] = -(moment * twist / (ONE + wp.abs(twist)) + f64(0.02) * m.twist_stiffness * t[2])
    return t


@wp.func
def resistance(x: Any, m: Any, wheel: int, load: wp.float64):
    """Torque [N m] against a wheel: ground by Reece (in the coefficient), a brake, and a motor whose friction grows with its
    drop, c V |Δp| + b Ω (McCandlish, Dorey 1984)."""
    speed = x[at.WHEEL + wheel]
    rubbed = m.motor_rub * m.motor_displacement * wp.abs(x[at.LOOP_FORWARD] - x[at.LOOP_RETURN])
    dry = m.rolling * load * m.tire_radius + m.brake_torque + rubbed
    return dry * wp.tanh(speed / f64(0.028)) + f64(30.0) * speed


@wp.func
def hinge(x: Any, m: Any):
    """Roller bearing by Palmgren (1959): a part under load, and a viscous one with ω^⅔: torque [N m]."""
    rate = x[at.RATE_FRONT] - x[at.RATE_REAR]
    oily = f64(90.0) * wp.pow(rate * rate + f64(1e-8), ONE / f64(3.0))
    return vec2d((m.hinge_torque + oily) * rate / wp.sqrt(rate * rate + f64(6e-5)), ZERO)


@wp.func
def seals(x: Any, m: Any, c: Any, inputs: Any):
    """LuGre friction with a film that grows late, of both cylinders at their mean lever, as a torque [N m].

    Yanada, Sekikawa 2008: g = F_c + ((1 − h) F_s − F_c)₊ e^−(v/v_s)², ḣ = (h_s − h)/τ, h_s = |v|^⅔ over that at 0.1 m/s, at
    most 0.6; τ is 25 ms as the film grows and 0.25 s as it thins. Strokes above 5 mm/s; not for dwell of hours.
    """
    lever = HALF * (c[4] - c[5])
    v = lever * x[at.ROD_RATE]
    z = x[SEAL]
    film = x[SEAL + 1]
    sliding = m.seal_force / m.seal_ratio
    ratio = v / m.stribeck_speed
    above = wp.max((ONE - film) * m.seal_force - sliding, ZERO)
    level = sliding + above * wp.exp(-ratio * ratio)
    stiffness = f64(5e6)
    rate = v - wp.abs(v) * stiffness * z / level
    steady = wp.min(f64(0.6) * wp.pow(wp.abs(v) / f64(0.1) + f64(1e-9), TWO / f64(3.0)), f64(0.6))
    time = wp.where(steady > film, f64(0.025), f64(0.25))
    force = stiffness * z + f64(1200.0) * rate + m.seal_viscosity * inputs[at.VISCOSITY] * v
    return vec3d(TWO * lever * force, rate, (steady - film) / time)


@wp.func
def rods(x: Any, m: Any):
    """Torque [N m] of bolted brackets beyond a free play, and the rate of the part that slips.

    70 % of the stiffness is a spring, 30 % one behind a slider that yields with the square of its share (Iwan 1966, smooth);
    only pressing. What slipped is forgotten in 2 ms where nothing touches.
    """
    stretch = x[at.ROD] - x[at.ANGLE]
    rate = x[at.ROD_RATE] - x[at.RATE_FRONT] + x[at.RATE_REAR]
    depth = wp.abs(stretch) - m.joint_play
    torque = f64(0.05) * m.joint_damping * rate
    slipped = -x[CREEP] / f64(0.002)
    if depth > ZERO:
        side = wp.sign(stretch)
        slipped = f64(0.3) * m.joint_stiffness * rate
        share = x[CREEP] / SLIPPING
        if rate * share > ZERO:
            slipped *= ONE - share * share
        damped = m.joint_damping * unit(depth / f64(3e-5)) * rate
        held = f64(0.7) * m.joint_stiffness * depth + side * (x[CREEP] + damped)
        torque += side * wp.max(held, ZERO)
    return vec2d(torque, slipped)


@wp.func
def engine(x: Any, m: Any, load: wp.float64):
    """Governor that holds its droop on power: torque (T₀ + 200 s) ω₀/ω, s the share of the droop, behind a lag that shortens
    with load (Heywood 2018, mean values). Rates of speed and torque."""
    speed = wp.max(x[at.ENGINE], f64(50.0))
    below = (m.engine_speed - speed) / (m.droop * m.engine_speed)
    goal = wp.clamp((m.engine_idle_torque + f64(200.0) * below) * m.engine_speed / speed, ZERO, f64(632.0))
    lag = f64(0.03) + f64(0.05) * (ONE - unit(x[at.GOVERNOR] / f64(632.0)))
    return vec2d((x[at.GOVERNOR] - load) / m.engine_inertia, (goal - x[at.GOVERNOR]) / lag)


@wp.func
def rational(t: wp.float64, y0: wp.float64, y1: wp.float64, slope: wp.float64, s0: wp.float64, s1: wp.float64):
    """Rational quadratic on [0, 1] between two points, by the mean ``slope`` and those at its ends; monotone.

    Delbourgo, Gregory 1985.
    """
    u = t * (ONE - t)
    return y0 + (y1 - y0) * (slope * t * t + s0 * u) / (slope + (s0 + s1 - TWO * slope) * u)


@wp.func
def opening(spool: wp.float64, m: Any):
    """Share of the edge that is open: a monotone rational spline through the measured points, flat where it begins.

    Slopes between two spans are their geometric mean, at the end half the last one.
    """
    s = wp.abs(spool)
    band = m.band_left
    low = m.half_left
    high = m.most_left
    if spool < ZERO:
        band = m.band_right
        low = m.half_right
        high = m.most_right
    first = low / (HALF - band)
    second = f64(4.0) * (high - low)
    last = f64(4.0) * (ONE - high)
    joint = wp.sqrt(first * second)
    top = wp.sqrt(second * last)
    area = rational(unit((s - band) / (HALF - band)), ZERO, low, first, ZERO, joint)
    if s > HALF:
        area = rational(unit(f64(4.0) * s - TWO), low, high, second, joint, top)
    if s > f64(0.75):
        area = rational(unit(f64(4.0) * s - f64(3.0)), high, ONE, last, top, HALF * last)
    return area


@wp.func
def flows(x: Any, m: Any, inputs: Any):
    """Flows [m³/s] out of the supply and into the tank, pressure [Pa] between edge and compensator, sensed pressure.

    The return passes a cock that stands half closed, ζ ρ v²/2 (Weisbach 1855), and a pipe, laminar.
    """
    left = x[SPOOL] > ZERO
    port = x[NEAR + 1]
    other = x[NEAR]
    nominal = m.edge_right
    block = ZERO
    if left:
        port = x[NEAR]
        other = x[NEAR + 1]
        nominal = m.edge_left
        block = m.half_block
    area = opening(x[SPOOL], m) + f64(1e-7)
    edge = nominal * area
    throttle = m.compensator_passage * (x[COMPENSATOR] + f64(1e-6))
    laminar = f64(2e8) * inputs[at.VISCOSITY]
    flow = passage(x[SUPPLY] - port, ONE / (edge * edge) + ONE / (throttle * throttle), laminar)
    back = m.return_edge * area * (ONE - block)
    out = passage(other - m.tank_pressure, ONE / (back * back) + m.cock_loss, m.return_pipe * inputs[at.VISCOSITY])
    between = x[SUPPLY] - flow * flow / (edge * edge)
    return vec4d(flow, out, between, wp.where(area > f64(1e-3), port, m.tank_pressure))


@wp.func
def ring_leak(x: Any, m: Any, inputs: Any):
    """Leakage [m³/s] from chamber A to B through the gap of a piston ring: laminar with h³, turbulent by Blasius with
    Δp^(4/7) where that is less, 1/Q² = 1/Q_l² + 1/Q_t² (Merritt 1967; Idelchik 2008)."""
    drop = x[SIDE_A] - x[SIDE_A + 1]
    laminar = m.ring_laminar / inputs[at.VISCOSITY] * drop
    size = wp.abs(drop) + f64(1.0)
    turbulent = m.ring_turbulent * wp.pow(inputs[at.VISCOSITY], f64(-1.0 / 7.0)) * wp.pow(size, f64(4.0 / 7.0))
    share = laminar / turbulent
    return laminar / wp.sqrt(ONE + share * share)


@wp.func
def crack_leak(x: Any, m: Any, inputs: Any):
    """Leakage [m³/s] between the ports at the valve, through a crack as a sharp orifice at all Reynolds numbers.

    C_d = 0.61 (1 + 1.07 e^(−0.126 √Re) − 2.07 e^(−0.246 √Re)) (Wu, Burton, Schoenau 2002), Re of the jet.
    """
    drop = x[NEAR] - x[NEAR + 1]
    speed = wp.sqrt(wp.abs(drop) * m.speed_square)
    root = wp.sqrt(speed * m.crack_density / inputs[at.VISCOSITY])
    coefficient = ONE + f64(1.07) * wp.exp(f64(-0.126) * root) - f64(2.07) * wp.exp(f64(-0.246) * root)
    return wp.sign(drop) * f64(0.61) * coefficient * m.crack_area * speed


@wp.func
def port(pressure: wp.float64, m: Any):
    """Flow [m³/s] into a port from its anti-cavitation check, less that of its shock valve."""
    return relief(m.tank_pressure, pressure, f64(2.6e-9)) - relief(pressure, m.shock_pressure, f64(5e-10))


@wp.func
def pipe_loss(flow: wp.float64, viscosity: wp.float64, m: Any):
    """Drop [Pa] of half a pipe: laminar, and where that is more by Swamee, Jain 1976, roughness 0.03 of a millimetre.

    λ = 0.25/lg²(ε/(3.7 D) + 5.74/Re^0.9), Re > 2300.
    """
    re = m.pipe_reynolds * wp.abs(flow) / viscosity
    factor = ONE
    if re > f64(1200.0):
        rough = wp.log10(m.pipe_roughness + f64(5.74) / wp.pow(re, f64(0.9)))
        factor = wp.max(f64(0.25 / 64.0) * re / (rough * rough), ONE)
    return HALF * m.pipe_resistance * viscosity * factor * flow


@wp.func
def line_rates(d: State, x: Any, m: Any, inputs: Any, f: vec4d, c: Any):
    """Rates of the pipes' pressures and flows and of the chambers: I Q̇ = Δp − loss each half, C ṗ = ΣQ each node.

    A quarter of a pipe's volume lies at the valve, a half in its middle, a quarter at the chamber (Watton 2009, lumped).
    Walls: Korteweg 1878, and flexible ends.
    """
    into = into_ports(x[SPOOL], f, port(x[NEAR], m), port(x[NEAR + 1], m), crack_leak(x, m, inputs))
    leak = ring_leak(x, m, inputs)
    half = HALF * m.pipe_inertance * (ONE + UNSTEADY)
    quarter = f64(0.25) * m.hose_volume
    for i in range(2):
        p = x[SIDE_A + i]
        soft = (c[i] + quarter) * softness(p, m) + quarter * m.wall_softness
        lost = leak
        added = ZERO
        if i == 0:
            soft += accumulator(p, m)
            added = pinch(x, m)
        else:
            lost = -leak
        near = softness(x[NEAR + i], m) + m.wall_softness
        middle = softness(x[MIDDLE + i], m) + m.wall_softness
        first = x[FIRST + i]
        second = x[SECOND + i]
        d[NEAR + i] = (into[i] - first) / (quarter * near)
        d[MIDDLE + i] = (first - second) / (TWO * quarter * middle)
        d[SIDE_A + i] = (second - lost - c[2 + i] * x[at.ROD_RATE]) / soft
        d[FIRST + i] = (x[NEAR + i] - x[MIDDLE + i] - pipe_loss(first, inputs[at.VISCOSITY], m) - added * first) / half
        d[SECOND + i] = (x[MIDDLE + i] - p - pipe_loss(second, inputs[at.VISCOSITY], m)) / half
    return d


@wp.func
def pump_rates(d: State, x: Any, m: Any, inputs: Any, f: vec4d):
    """Rates of the supply, of the load-sensing line and of the swash plate.

    Line: a volume behind an orifice, with a bleed and a relief that ends the supply. Regulator: an underlapped spool, half a
    bridge a²/(a² + b²) of the supply on the control piston, against a bias piston of half its area and a spring of 6 bar
    (Manring, Johnson 1996; Ivantysyn, Ivantysynova 2001): the stroke is slower where the supply is low.
    """
    given = x[STROKE] * m.pump_displacement * x[at.ENGINE] * pulsation(m, inputs)
    lost = m.pump_leakage * x[SUPPLY] + relief(x[SUPPLY], f64(260.0) * BAR, f64(1.5e-9)) + f[0]
    lost += other_flow(x[SUPPLY], m, inputs)
    rise = (given - lost) / (m.supply_volume * (softness(x[SUPPLY], m) + m.wall_softness))
    d[SUPPLY] = rise
    passed = orifice(m.sense_orifice, wp.max(f[3], ZERO) - x[SENSE], HALF * BAR)
    limited = f64(1e-10) * wp.max(x[SENSE] - m.sense_limit, ZERO)
    d[SENSE] = (passed - limited - f64(2e-14) * x[SENSE]) / SENSED_VOLUME
    error = x[SUPPLY] - x[SENSE] - m.margin + f64(1.6) * BAR + m.regulator_lead * rise  # set where the bridge balances
    d[CONTROL] = (wp.clamp(error / (f64(6.0) * BAR), -ONE, ONE) - x[CONTROL]) / f64(0.003)
    a = HALF + HALF * x[CONTROL]
    b = f64(0.02) + HALF - HALF * x[CONTROL]
    pressed = wp.max(x[SUPPLY], ZERO)
    push = HALF * pressed + f64(6.0) * BAR - pressed * a * a / (a * a + b * b)
    d[STROKE] = bounded(push / (f64(56.0) * BAR * m.stroke_time), x[STROKE])
    return d


@wp.func
def slip(speed: wp.float64, force: wp.float64, limit: wp.float64, stiffness: wp.float64):
    """Rate of the force of an element that is elastic and slips at a limit, yielding with the fourth power of its share."""
    rate = stiffness * speed
    share = force / limit
    if speed * share > ZERO:
        rate *= ONE - share * share * share * share
    return rate


@wp.func
def valve_rates(d: State, x: Any, m: Any, inputs: Any, f: vec4d):
    """Rates of the valve: position control over a transducer, a spool whose dry friction is two Maxwell elements that slip
    one after the other (Al-Bender, Lampaert, Swevers 2005), and the compensator behind the edge.

    The compensator opens once the pressure between them exceeds the sensed one by its spring (flow sharing; Djurovic 2007).
    """
    d[DRIVER] = (inputs[at.COMMAND] + m.null_shift - x[DRIVER]) / m.pilot_lag
    away = x[DRIVER] / m.transducer_scale - x[SPOOL] - x[HYSTERESIS] - x[SLIPS]
    speed = away / (m.spool_lag + wp.abs(away) / m.spool_rate)
    d[SPOOL] = speed
    d[HYSTERESIS] = slip(speed, x[HYSTERESIS], f64(0.6) * m.slip_width, f64(6.0))
    d[SLIPS] = slip(speed, x[SLIPS], f64(0.4) * m.slip_width, f64(1.5))
    goal = unit(HALF + (f[2] - x[SENSE] - m.drop_spring) / m.drop_spring)
    d[COMPENSATOR] = (goal - x[COMPENSATOR]) / m.compensator_lag
    return d


@wp.func
def hydraulics(d: State, x: Any, m: Any, inputs: Any, c: Any):
    """Derivatives of pipes, chambers, pump, valve."""
    f = flows(x, m, inputs)
    d = line_rates(d, x, m, inputs, f, c)
    d = pump_rates(d, x, m, inputs, f)
    return valve_rates(d, x, m, inputs, f)


@wp.func
def limit(x: State, m: Any):
    """Stops of the swash plate and of the compensator, pressures at boiling oil."""
    x[STROKE] = unit(x[STROKE])
    x[COMPENSATOR] = unit(x[COMPENSATOR])
    for i in range(2):
        x[SIDE_A + i] = wp.max(x[SIDE_A + i], GROUND_FLOOR)
        x[NEAR + i] = wp.max(x[NEAR + i], GROUND_FLOOR)
        x[MIDDLE + i] = wp.max(x[MIDDLE + i], GROUND_FLOOR)
    x[SUPPLY] = wp.max(x[SUPPLY], GROUND_FLOOR)
    return x


@wp.func
def start(m: Any, angle: wp.float64):
    """State at rest: all nodes of the pipes alike, the compensator closed, the regulator in balance."""
    x = assembly.at_rest(State(), m, angle)
    for i in range(2):
        x[NEAR + i] = m.rest_pressure
        x[MIDDLE + i] = m.rest_pressure
    x[COMPENSATOR] = ZERO
    x[CONTROL] = f64(0.3)
    return x


@wp.func
def hydraulic_signals(x: Any, m: Any, inputs: Any):
    """Pressures a, b, pump; flows into the chambers a and b; spool."""
    leak = ring_leak(x, m, inputs)
    return Hydraulic(x[SIDE_A], x[SIDE_A + 1], x[SUPPLY], x[SECOND] - leak, x[SECOND + 1] + leak, x[SPOOL])
