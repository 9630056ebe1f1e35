"""Laws of maple: a constant pump whose surplus an unloading valve lets go, oil by its secant modulus with pockets of gas
that exchange heat, a pilot line to a spool that sticks, triangular notches, and one return line behind a preloaded valve.

Tires are carcass springs before a patch by Fiala; seals, hinge and spool stick by elastoplastic and load-dependent friction.
"""

from typing import Any

import warp as wp

from aoro_gym.diagnosis_benchmark.independent.laws import layout as at
from aoro_gym.diagnosis_benchmark.independent.laws.numbers import HALF, ONE, TWO, ZERO, check, f64, orifice, unit

from . import assembly
from .common import excess, passage
from .disturbances import accumulator, other_flow, pinch, pulsation
from .places import (
    ATMOSPHERE,
    BAR,
    COMPENSATOR,
    CONTROL,
    DRIVER,
    GAS,
    GROUND_FLOOR,
    HINGE,
    HYSTERESIS,
    LINE,
    SEAL,
    SENSE,
    SIDE_A,
    SIDE_B,
    SPOOL,
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

RETURN_FLOW, RETURN, RELIEF = LINE, LINE + 1, LINE + 2  # flow [m³/s] and pressure [Pa] of the return line; relief's flow
SPRING_PRELOAD = wp.constant(wp.float64(0.08))  # of the spool's centring spring, share of the full pilot pressure
BREAKAWAY = wp.constant(wp.float64(0.7))  # share of a dry friction up to which it is elastic alone
ROD_SECTION = wp.constant(wp.float64(1.2566e-3))  # m² of a rod of 40 mm


@wp.func
def side_of(value: wp.float64, scale: wp.float64):
    """Direction of a dry friction, smooth within ``scale``: v/√(v² + v₀²)."""
    return value / wp.sqrt(value * value + scale * scale)


@wp.func
def liquid(pressure: wp.float64, m: Any):
    """Tangent modulus [Pa] of a liquid whose secant modulus is a straight line: K̄ = K₀ + 5 p, K = K̄ (K̄ − p)/K₀.

    From V = V₀ (1 − p/K̄) (Klaus, O'Brien 1964; Hayward 1970).
    """
    above = wp.max(pressure, ZERO)
    secant = m.bulk_modulus + f64(5.0) * above
    return secant * (secant - above) / m.bulk_modulus


@wp.func
def pocket(pressure: wp.float64, warmth: wp.float64, amount: wp.float64):
    """Volume [m³] of gas, by its ``amount`` at atmospheric pressure and its temperature over the oil's less one."""
    absolute = wp.max(pressure + ATMOSPHERE, f64(0.02) * BAR)
    return amount * ATMOSPHERE / absolute * (ONE + warmth)


@wp.func
def wall(pressure: wp.float64, m: Any):
    """Compliance [m³/Pa] of a side's walls: hose whose modulus grows exponentially with pressure, then a steel pipe."""
    hose = f64(0.7) / m.hose_modulus * wp.exp(-wp.max(pressure, ZERO) / (f64(350.0) * BAR))
    return m.hose_volume * (hose + f64(0.3) / f64(2.6e10))


@wp.func
def friction_factor(reynolds: wp.float64, roughness: wp.float64):
    """Darcy's factor of a turbulent pipe: 1/√λ = −1.8 lg((ε/3.7 D)^1.11 + 6.9/Re) (Haaland 1983)."""
    inverse = f64(-1.8) * wp.log10(wp.pow(roughness / f64(3.7), f64(1.11)) + f64(6.9) / reynolds)
    return ONE / (inverse * inverse)


@wp.func
def turbulence(flow: wp.float64, viscosity: wp.float64, m: Any):
    """Coefficient [Pa s²/m⁶] of a line's loss beyond the laminar one, over Re = 2000 to 4000 on, by Haaland."""
    reynolds = m.line_reynolds * flow / viscosity
    least = wp.max(reynolds, f64(2000.0))
    above = wp.max(friction_factor(least, f64(2e-3)) - f64(64.0) / least, ZERO)
    return m.line_turbulence * above * unit((reynolds - f64(2000.0)) / f64(2000.0))


@wp.func
def piped(drop: wp.float64, quadratic: wp.float64, linear: wp.float64, viscosity: wp.float64, m: Any):
    """Flow [m³/s] through edges and a line, by its factor at the flow before: three rounds."""
    flow = passage(drop, quadratic, linear)
    for _ in range(3):
        flow = passage(drop, quadratic + turbulence(flow, viscosity, m), linear)
    return flow


@wp.func
def bristle(speed: wp.float64, share: wp.float64):
    """Part of a motion that stays elastic, by the ``share`` of friction's limit that acts (Dupont, Hayward et al. 2002).

    All of it while the motion unloads and below the breakaway; from there to the limit it falls by a sine.
    """
    size = wp.abs(share)
    slipping = ZERO
    if speed * share > ZERO:
        place = unit((size - BREAKAWAY) / (ONE - BREAKAWAY))
        slipping = HALF - HALF * wp.cos(f64(wp.pi) * place)
    return ONE - slipping * size


@wp.func
def patch_slip(share: wp.float64):
    """Slip of a patch over its limit's over stiffness, by Fiala: f = 1 − (1 − u/3)³, u = 3 (1 − ∛(1 − f))."""
    return wp.sign(share) * f64(3.0) * (ONE - wp.cbrt(ONE - wp.min(wp.abs(share), ONE)))


@wp.func
def torsion(share: wp.float64):
    """Slope of moment over twist, share of the elastic one, of a disc whose rim yields first.

    T = T_p (1 − ¼ (ψ_y/ψ)³) beyond ψ_y (Nadai 1931), so that dT/dψ = k (4 (1 − T/T_p))^(4/3), at most k.
    """
    return wp.min(ONE, wp.pow(f64(4.0) * wp.max(ONE - wp.abs(share), ZERO), f64(4.0) / f64(3.0)))


@wp.func
def tire(x: Any, m: Any, wheel: int, motion: vec4d, load: wp.float64):
    """Carcass as a spring before a patch that slips by Fiala (1954) as it rolls, and yields at its limit.

    Limits by Mohr and Coulomb: adhesion times the patch, and friction. Twist: an elastic and plastic disc. Of deflections
    the rates, then forces along, across, and moment.
    """
    limit = m.patch_adhesion + m.grip_sliding * load
    rolled = wp.abs(motion[2])
    t = Tire()
    for i in range(2):
        stiffness = m.stiffness_along
        if i == 1:
            stiffness = m.stiffness_across
        share = stiffness * x[TIRE + 3 * wheel + i] / limit
        held = wp.clamp(share, -ONE, ONE)
        yielding = ZERO
        if motion[i] * share > ZERO:
            size = wp.min(share * share, f64(2.5))
            yielding = motion[i] * size * size * size
        rolling = rolled * patch_slip(held) * limit / (stiffness * m.relaxation_length)
        t[i] = motion[i] - rolling - yielding
        t[3 + i] = limit * held + m.tire_damping * t[i]
    t[4] = -t[4] - m.rut_drag * load * side_of(motion[1], f64(0.02))
    most = m.scrub_adhesion + m.scrub_arm * m.grip_sliding * load
    z = x[TIRE + 3 * wheel + 2]
    share = m.twist_stiffness * z / most
    elastic = ONE
    if motion[3] * share > ZERO:
        elastic = torsion(share)
    t[2] = motion[3] * elastic - rolled / m.relaxation_length * z
    t[5] = -(most * wp.clamp(share, -ONE, ONE) + f64(0.02) * m.twist_stiffness * t[2])
    return t


@wp.func
def resistance(x: Any, m: Any, wheel: int, load: wp.float64):
    """Torque [N m] against a wheel: ground that the front wheels compact for the rear ones, and a wet multi-disc brake.

    The brake drags by 0.7 + 0.3 √Ω: discs that touch, and oil between them.
    """
    speed = x[at.WHEEL + wheel]
    rolling = m.rolling_rear
    if wheel < 2:
        rolling = m.rolling_front
    brake = m.brake_torque * (f64(0.7) + f64(0.3) * wp.sqrt(wp.abs(speed)))
    return (rolling * load * m.tire_radius + brake) * side_of(speed, f64(0.03))


@wp.func
def hinge(x: Any, m: Any):
    """Plain bearing with mixed friction under its load: torque [N m] and rate of its presliding.

    The cylinders press the pin with (p_a + p_b) times a rod's section beside a weight of 15 kN; friction falls to 60 % as a
    film builds up (Stribeck). Presliding by Dahl (1968) with his exponent 3.
    """
    rate = x[at.RATE_FRONT] - x[at.RATE_REAR]
    pressed = (wp.max(x[SIDE_A], ZERO) + wp.max(x[SIDE_B], ZERO)) * ROD_SECTION / f64(1.5e4)
    film = f64(0.6) + f64(0.4) * wp.exp(-wp.abs(rate) / f64(0.12))
    torque = f64(3.5e5) * x[HINGE]
    share = torque / (m.hinge_torque * (ONE + pressed) * film)
    change = rate
    if rate * share > ZERO:
        size = wp.min(wp.abs(share), f64(2.0))
        change = rate * (ONE - size * size * size)
    return vec2d(torque + f64(120.0) * rate, change)


@wp.func
def seals(x: Any, m: Any, c: Any, inputs: Any):
    """Elastoplastic friction of both cylinders as a torque [N m]; the drop over the pistons presses their seals.

    Limit by Hess and Soom (1990): F (1/r + (1 − 1/r)/(1 + (v/v_s)²)); film by Blok: b √(μ |v|) (Müller, Nau 1998).
    """
    torque = ZERO
    rates = vec2d()
    pressed = ONE + wp.abs(x[SIDE_A] - x[SIDE_B]) / (f64(250.0) * BAR)
    for side in range(2):
        lever = c[4 + side]
        v = lever * x[at.ROD_RATE]
        ratio = v / m.stribeck_speed
        level = m.seal_force * pressed * (ONE + (m.seal_ratio - ONE) / (ONE + ratio * ratio)) / m.seal_ratio
        force = f64(5e6) * x[SEAL + side]
        rates[side] = v * bristle(v, wp.clamp(force / level, f64(-2.0), TWO))
        film = m.seal_viscosity * v * wp.sqrt(inputs[at.VISCOSITY] / (wp.abs(v) + f64(1e-3)))
        torque += lever * (force + f64(1000.0) * rates[side] + film)
    return vec3d(torque, rates[0], rates[1])


@wp.func
def rods(x: Any, m: Any):
    """Torque [N m] of rods on worn pins: k δ (1 + λ δ̇), only pressing, beyond the gap; grease within.

    Hunt, Crossley 1975: damping grows with the depth δ, so that no force jumps; as given at 1 mrad.
    """
    stretch = x[at.ROD] - x[at.ANGLE]
    rate = x[at.ROD_RATE] - x[at.RATE_FRONT] + x[at.RATE_REAR]
    depth = wp.abs(stretch) - m.joint_play
    torque = f64(0.05) * m.joint_damping * rate
    if depth > ZERO:
        side = wp.sign(stretch)
        damped = m.joint_damping * depth / f64(1e-3) * rate * side
        torque += side * wp.max(m.joint_stiffness * depth + damped, ZERO)
    return vec2d(torque, ZERO)


@wp.func
def engine(x: Any, m: Any, load: wp.float64):
    """Flyweights against a spring: torque by the square of the speed, behind a rack that sticks within 3 N m.

    Watt's governor with friction (Kiencke, Nielsen 2005): rates of speed and torque.
    """
    speed = x[at.ENGINE] / m.engine_speed
    below = (ONE - speed * speed) / (m.droop * (TWO - m.droop))
    goal = wp.clamp(m.engine_idle_torque + f64(200.0) * below, ZERO, f64(600.0))
    rate = excess(goal - x[at.GOVERNOR], f64(3.0)) / f64(0.08)
    return vec2d((x[at.GOVERNOR] - load) / m.engine_inertia, rate)


@wp.func
def opening(spool: wp.float64, m: Any):
    """Share of the edge that is open: triangular notches, a square of the travel beyond the overlap, then a slot.

    The slot grows in a straight line to the full edge (Merritt 1967).
    """
    band = m.band_left
    notch = m.notch_left
    most = m.most_left
    slot = m.slot_left
    if spool < ZERO:
        band = m.band_right
        notch = m.notch_right
        most = m.most_right
        slot = m.slot_right
    travel = wp.max(wp.abs(spool) - band, ZERO)
    end = wp.sqrt(most / notch)
    area = notch * travel * travel
    if travel > end:
        area = wp.min(most + slot * (travel - end), ONE)
    return area


@wp.func
def sprung(pilot: wp.float64, m: Any):
    """Where the centring spring lets the pilot's pressure push the spool: beyond its preload by its stiffness."""
    return wp.clamp(pilot, -SPRING_PRELOAD, SPRING_PRELOAD) + excess(pilot, SPRING_PRELOAD) / m.spring_stiffness


@wp.func
def bore(place: wp.float64):
    """Area of a round port that a land has uncovered to a share of its bore, over the whole: a segment of the circle."""
    y = wp.clamp(place, f64(1e-6), ONE)
    angle = wp.acos(ONE - TWO * y)
    return (angle - HALF * wp.sin(TWO * angle)) / f64(wp.pi)


@wp.func
def flows(x: Any, m: Any, inputs: Any):
    """Flows [m³/s] out of the supply and into the return line, drop [Pa] over the metering edge, sensed pressure."""
    left = x[SPOOL] > ZERO
    port = x[SIDE_B]
    other = x[SIDE_A]
    nominal = m.edge_right
    line = m.line_resistance * inputs[at.VISCOSITY]
    back_line = line + pinch(x, m)
    block = ZERO
    if left:
        port = x[SIDE_A]
        other = x[SIDE_B]
        nominal = m.edge_left
        back_line = line
        line += pinch(x, m)
        block = m.half_block
    area = opening(x[SPOOL], m) + f64(1e-7)
    edge = nominal * area
    throttle = m.compensator_passage * bore(x[COMPENSATOR])
    losses = ONE / (edge * edge) + ONE / (throttle * throttle)
    flow = piped(x[SUPPLY] - port, losses, line, inputs[at.VISCOSITY], m)
    back = m.return_edge * area * (ONE - block)
    out = piped(other - x[RETURN], ONE / (back * back), back_line, inputs[at.VISCOSITY], m)
    metered = flow * flow / (edge * edge)
    sensed = x[SUPPLY] - flow * flow * losses
    return vec4d(flow, out, metered, wp.where(area > f64(1e-3), sensed, m.tank_pressure))


@wp.func
def leaks(x: Any, m: Any, inputs: Any):
    """Leakage [m³/s] from A to B: past pistons laminar in a barrel that is worn most in its middle, and past the seats of
    shock valves: a root beyond the drop at which their cones lift, and a seep."""
    drop = x[SIDE_A] - x[SIDE_B]
    place = x[at.ROD] / f64(0.4)
    gap = HALF + HALF * wp.exp(-place * place)
    lifted = excess(drop, f64(12.0) * BAR)
    seat = orifice(m.port_leakage, lifted, f64(0.5) * BAR) + f64(1.5e-13) * drop
    return m.piston_leakage * gap * f64(0.04) / inputs[at.VISCOSITY] * drop + seat


@wp.func
def fed(pressure: wp.float64, x: Any, m: Any):
    """Flow [m³/s] out of the return line into a port through its anti-cavitation check: a root law."""
    return check(f64(2.4e-6), x[RETURN] - pressure, f64(0.3) * BAR)


@wp.func
def shock(pressure: wp.float64, m: Any):
    """Flow [m³/s] of a port's shock valve into the return line: a root law beyond its setting."""
    return check(f64(8e-7), pressure - m.shock_pressure, TWO * BAR)


@wp.func
def into_sides(x: Any, m: Any, inputs: Any, f: vec4d):
    """Flows [m³/s] into A and into B, and out of both into the return line."""
    into_a = f[0]
    into_b = -f[1]
    if x[SPOOL] <= ZERO:
        into_a = -f[1]
        into_b = f[0]
    leak = leaks(x, m, inputs)
    a = fed(x[SIDE_A], x, m) - shock(x[SIDE_A], m)
    b = fed(x[SIDE_B], x, m) - shock(x[SIDE_B], m)
    return vec3d(into_a + a - leak, into_b + b + leak, f[1] - a - b)


@wp.func
def warming(warmth: wp.float64, pressure: wp.float64, rate: wp.float64, time: wp.float64):
    """Rate [1/s] of a pocket's ``warmth`` while its ``pressure`` changes at a ``rate`` [Pa/s].

    Ṫ = (1 − T)/τ + (γ − 1)/γ T ṗ/p, γ = 1.4, T over the oil's temperature (Pourmovahed, Otis 1990).
    """
    absolute = wp.max(pressure + ATMOSPHERE, f64(0.02) * BAR)
    return -warmth / time + f64(2.0 / 7.0) * (ONE + warmth) * rate / absolute


@wp.func
def side_rates(d: State, x: Any, m: Any, c: Any, into: vec3d):
    """Rates of both sides' pressures and of the warmth of their gas: Q − V̇ = (V/K + wall + V_g/(γ p)) ṗ − V̇_g of heat."""
    for i in range(2):
        p = x[SIDE_A + i]
        absolute = wp.max(p + ATMOSPHERE, f64(0.02) * BAR)
        gas = pocket(p, x[GAS + i], m.line_gas)
        shrinking = gas / (ONE + x[GAS + i]) * x[GAS + i] / m.gas_time
        soft = (c[i] + m.hose_volume) / liquid(p, m) + wall(p, m) + gas / (f64(1.4) * absolute)
        if i == 0:
            soft += accumulator(p, m)
        rate = (into[i] - c[2 + i] * x[at.ROD_RATE] + shrinking) / soft
        d[SIDE_A + i] = rate
        d[GAS + i] = warming(x[GAS + i], p, rate, m.gas_time)
    return d


@wp.func
def supply_rates(d: State, x: Any, m: Any, inputs: Any, f: vec4d, added: wp.float64):
    """Rates of the supply, its unloading valve and relief, and of the return line.

    Pump: constant. Unloading valve: three-way, its spool against a spring behind a damping orifice, of first order. Relief:
    direct-acting, its flow above the setting a straight line to the full flow at the override (Merritt 1967), 4 ms late.
    Return: volume with free gas, the inertance of its line, and a valve with a preload. ``added``: flow [m³/s] of the ports.
    """
    full = m.pump_displacement * m.engine_speed
    unloading = m.unloading * x[CONTROL]
    let_go = check(unloading, x[SUPPLY] - x[RETURN], BAR)
    given = m.pump_displacement * x[at.ENGINE] * pulsation(m, inputs)
    lost = m.pump_leakage * x[SUPPLY] + x[RELIEF] + f[0] + other_flow(x[SUPPLY], m, inputs) + let_go
    rise = (given - lost) * liquid(x[SUPPLY], m) / (m.supply_volume * f64(1.8))
    d[SUPPLY] = rise
    d[SENSE] = (wp.max(f[3], ZERO) - x[SENSE]) / m.sense_lag
    error = x[SUPPLY] - x[SENSE] - m.margin + m.regulator_lead * rise
    d[CONTROL] = (unit(HALF + error / m.unloading_band) - x[CONTROL]) / m.unloading_lag
    goal = full * wp.max(x[SUPPLY] - m.relief_pressure, ZERO) / m.override
    d[RELIEF] = (goal - x[RELIEF]) / f64(0.004)
    q = x[RETURN_FLOW]
    p = wp.max(x[RETURN] + ATMOSPHERE, f64(0.02) * BAR)
    soft = f64(6e-4) / m.bulk_modulus + f64(1e-12) + f64(3.0) * m.line_gas * ATMOSPHERE / (p * p)
    d[RETURN] = (let_go + x[RELIEF] + added - q) / soft
    against = m.tank_pressure + m.preload * unit(q / f64(5e-5)) + m.return_slope * q + m.return_loss * q * wp.abs(q)
    d[RETURN_FLOW] = (x[RETURN] - against) / m.return_inertance
    if q <= ZERO:
        d[RETURN_FLOW] = wp.max(d[RETURN_FLOW], ZERO)
    return d


@wp.func
def valve_rates(d: State, x: Any, m: Any, inputs: Any, f: vec4d):
    """Rates of pilot line, spool, and the section's compensator.

    Pilot: capacity behind an orifice, Δ = τ ṗ + (ṗ/r)²: laminar, then turbulent. Spool: centring spring, viscous drag, and
    elastoplastic friction. Compensator: its spring sets where it rests; a flow force closes it (Merritt 1967).
    """
    away = inputs[at.COMMAND] + m.null_shift - x[DRIVER]
    turbulent = f64(4.0) * wp.abs(away) / (m.spool_rate * m.spool_rate)
    d[DRIVER] = TWO * away / (m.pilot_lag + wp.sqrt(m.pilot_lag * m.pilot_lag + turbulent))
    speed = (sprung(x[DRIVER], m) - x[SPOOL] - x[HYSTERESIS]) / m.spool_lag
    d[SPOOL] = speed
    d[HYSTERESIS] = f64(8.0) * speed * bristle(speed, wp.clamp(x[HYSTERESIS] / m.spool_friction, f64(-2.0), TWO))
    place = x[COMPENSATOR]
    throttle = f[0] / (m.compensator_passage * bore(place))
    force = f[2] + f64(0.05) * place * throttle * throttle
    share = unit(HALF + (m.edge_drop - force) / (HALF * m.edge_drop))
    d[COMPENSATOR] = (m.compensator_spring * share - place) / m.compensator_lag
    return d


@wp.func
def hydraulics(d: State, x: Any, m: Any, inputs: Any, c: Any):
    """Derivatives of pressures, pump, valve."""
    f = flows(x, m, inputs)
    into = into_sides(x, m, inputs, f)
    d = side_rates(d, x, m, c, into)
    d = supply_rates(d, x, m, inputs, f, into[2])
    return valve_rates(d, x, m, inputs, f)


@wp.func
def limit(x: State, m: Any):
    """Pressures at boiling oil, a return line that lets nothing back, a spool at its stops."""
    for i in range(3):
        x[SIDE_A + i] = wp.max(x[SIDE_A + i], GROUND_FLOOR)
    x[RETURN] = wp.max(x[RETURN], GROUND_FLOOR)
    x[RETURN_FLOW] = wp.max(x[RETURN_FLOW], ZERO)
    x[CONTROL] = unit(x[CONTROL])
    for i in range(2):
        x[GAS + i] = wp.clamp(x[GAS + i], f64(-0.7), TWO)
    return x


@wp.func
def start(m: Any, angle: wp.float64):
    """State at rest: the pump's flow passes the unloading valve and the return line."""
    x = assembly.at_rest(State(), m, angle)
    full = m.pump_displacement * m.engine_speed
    x[STROKE] = ONE
    x[RETURN_FLOW] = full
    x[RETURN] = m.tank_pressure + m.preload + m.return_slope * full + m.return_loss * full * full
    x[CONTROL] = HALF
    x[COMPENSATOR] = m.compensator_spring
    return x


@wp.func
def hydraulic_signals(x: Any, m: Any, inputs: Any):
    """Pressures a, b, pump; flows into a and b; spool."""
    into = into_sides(x, m, inputs, flows(x, m, inputs))
    return Hydraulic(x[SIDE_A], x[SIDE_B], x[SUPPLY], into[0], into[1], x[SPOOL])
