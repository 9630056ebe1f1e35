"""Laws of fir: pockets of air that dissolve, hoses with inertia, transient magic-formula tires, a check valve in the
return line, a sticking spool behind a pilot, and slow load sensing.

Chambers and hoses are volumes of their own with the line's inertia between them; logged port pressures are the chambers'.
"""

from typing import Any

import warp as wp

from aoro_gym.diagnosis_benchmark.independent.laws import layout as at
from aoro_gym.diagnosis_benchmark.independent.laws.numbers import HALF, ONE, TWO, ZERO, f64, unit

from . import assembly
from .common import bounded, coulomb, excess, passage, relief
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


@wp.func
def oil(pressure: wp.float64, m: Any):
    """Bulk modulus [Pa] of the liquid: β₀ + 10 p (Jelali, Kroll: Hydraulic Servo-systems, 2003)."""
    return m.bulk_modulus + f64(10.0) * wp.max(pressure, ZERO)


@wp.func
def free_gas(pressure: wp.float64, m: Any):
    """Share of a pocket that stays free in equilibrium: falls in a straight line to the saturation pressure (Henry)."""
    return unit(ONE - pressure / m.saturation_pressure)


@wp.func
def pocket(pressure: wp.float64, free: wp.float64, m: Any):
    """Volume [m³] of a free pocket and minus its rate over pressure [m³/Pa]: V₀ φ (p₀/p)^(1/1.15)."""
    absolute = wp.max(pressure + ATMOSPHERE, f64(0.02) * BAR)
    exponent = ONE / f64(1.15)
    volume = m.pocket_volume * free * wp.pow(ATMOSPHERE / absolute, exponent)
    return vec2d(volume, volume * exponent / absolute)


@wp.func
def hose(pressure: wp.float64, m: Any):
    """Compliance [m³/Pa] of a hose and its oil; its wall stiffens with pressure (Manring 2005)."""
    wall = m.hose_modulus * (ONE + wp.max(pressure, ZERO) / (f64(400.0) * BAR))
    return m.hose_volume * (ONE / oil(pressure, m) + ONE / wall)


@wp.func
def formula(deflection: wp.float64, stiffness: wp.float64, peak: wp.float64):
    """Magic formula D sin(C atan(B z)) with C = 1.3, B C D the stiffness (Pacejka: Tire and Vehicle Dynamics, 2012)."""
    return peak * wp.sin(f64(1.3) * wp.atan(stiffness * deflection / (f64(1.3) * peak)))


@wp.func
def tire(x: Any, m: Any, wheel: int, motion: vec4d, load: wp.float64):
    """Transient tire: ż = v_s − (|V|/σ + |v_s|/z_max) z, force by the magic formula of the deflection.

    Pacejka 2012, chapter 8, deflections bounded at low speed. Moment: the turn slip at standstill, bounded at
    2/3 μ F_n R. Rates of the deflections, then forces along, across, and moment.
    """
    peak = m.grip_sliding * load
    rolling = wp.abs(motion[2]) / m.relaxation_length
    moment = m.scrub_moment * m.grip_sliding * load
    soft_x = m.stiffness_along
    soft_y = m.stiffness_across
    t = Tire()
    for i in range(3):
        speed = motion[0]
        bound = f64(3.5) * peak / soft_x
        if i == 1:
            speed = motion[1]
            bound = f64(3.5) * peak / soft_y
        if i == 2:
            speed = motion[3]
            bound = f64(3.5) * moment / m.twist_stiffness
        z = x[TIRE + 3 * wheel + i]
        t[i] = speed - (rolling + wp.abs(speed) / bound) * z
    t[3] = formula(x[TIRE + 3 * wheel], soft_x, peak) + m.tire_damping * t[0]
    rut = m.rut_drag * load * coulomb(motion[1], f64(0.02))
    t[4] = -formula(x[TIRE + 3 * wheel + 1], soft_y, peak) - m.tire_damping * t[1] - rut
    t[5] = -formula(x[TIRE + 3 * wheel + 2], m.twist_stiffness, moment) - f64(0.02) * m.twist_stiffness * t[2]
    return t


@wp.func
def resistance(x: Any, m: Any, wheel: int, load: wp.float64):
    """Torque [N m] against a wheel: rolling by the cone index (Wismer, Luth 1974), motor's Coulomb and viscous losses
    (Wilson 1950; Schlösser 1961)."""
    speed = x[at.WHEEL + wheel]
    dry = m.rolling * load * m.tire_radius + m.brake_torque
    return dry * coulomb(speed, f64(0.02)) + m.motor_viscosity * speed


@wp.func
def hinge(x: Any, m: Any):
    """Dahl's friction of the bearing (1968): torque σ z, ż = ω (1 − sgn(ω) σ z/T)."""
    rate = x[at.RATE_FRONT] - x[at.RATE_REAR]
    stiffness = f64(4e5)
    torque = stiffness * x[HINGE]
    return vec2d(torque + f64(100.0) * rate, rate - wp.abs(rate) * torque / m.hinge_torque)


@wp.func
def seals(x: Any, m: Any, c: Any, inputs: Any):
    """Two Maxwell slip elements and viscous friction, as a torque [N m] of both cylinders.

    Swevers, Al-Bender, Ganseman, Prajogo 2000; Al-Bender, Lampaert, Swevers 2005. Elements carry 60 and 40 % and yield
    smoothly; the limit falls with speed by Stribeck.
    """
    lever = HALF * (c[4] - c[5])
    v = lever * x[at.ROD_RATE]
    ratio = wp.abs(v) / m.stribeck_speed
    level = m.seal_force * (ONE / m.seal_ratio + (ONE - ONE / m.seal_ratio) * wp.exp(-ratio))
    force = m.seal_viscosity * inputs[at.VISCOSITY] * v
    rates = vec2d()
    for i in range(2):
        share = f64(0.6)
        stiffness = f64(6e6)
        if i == 1:
            share = f64(0.4)
            stiffness = f64(1.2e6)
        z = x[SEAL + i]
        load = stiffness * z / (share * level)
        toward = v * load
        rates[i] = v
        if toward > ZERO:
            rates[i] = v * (ONE - load * load * load * load)
        force += stiffness * z + f64(800.0) * rates[i]
    return vec3d(TWO * lever * force, rates[0], rates[1])


@wp.func
def rods(x: Any, m: Any):
    """Torque [N m] of rods in worn bushes: soft within the clearance, k (s − w tanh(s/w)), straight beyond, damped."""
    stretch = x[at.ROD] - x[at.ANGLE]
    rate = x[at.ROD_RATE] - x[at.RATE_FRONT] + x[at.RATE_REAR]
    bend = stretch / (m.joint_play + f64(1e-6))
    slope = wp.tanh(bend)
    torque = m.joint_stiffness * (stretch - (m.joint_play + f64(1e-6)) * slope)
    return vec2d(torque + m.joint_damping * rate * (f64(0.15) + f64(0.85) * slope * slope), ZERO)


@wp.func
def engine(x: Any, m: Any, load: wp.float64):
    """Proportional and integral governor with droop fed back (Heywood 2018; Kiencke, Nielsen 2005): rates of both."""
    error = (m.engine_speed - x[at.ENGINE]) / m.engine_speed
    above = x[at.GOVERNOR] - m.engine_idle_torque
    torque = wp.clamp(x[at.GOVERNOR] + f64(2500.0) * error, ZERO, f64(630.0))
    return vec2d((torque - load) / m.engine_inertia, f64(1.5e4) * (error - m.droop * above / f64(200.0)))


@wp.func
def opening(spool: wp.float64, m: Any):
    """Share of the regulated flow: triangular notches of area s^2.5 in series with a bore: f² = (1 + c) a²/(1 + c a²)."""
    band = m.band_left
    bore = m.bore_left
    if spool < ZERO:
        band = m.band_right
        bore = m.bore_right
    s = wp.clamp((wp.abs(spool) - band) / (ONE - band), ZERO, f64(1.2))
    a = s * s * s * s * s
    return wp.sqrt((ONE + bore) * a / (ONE + bore * a))


@wp.func
def flows(x: Any, m: Any, inputs: Any):
    """Flows [m³/s] out of the supply and into the tank, drop [Pa] over the metering edge, sensed pressure."""
    left = x[SPOOL] > ZERO
    port = x[LINE + 1]
    other = x[LINE]
    nominal = m.edge_right
    if left:
        port = x[LINE]
        other = x[LINE + 1]
        nominal = m.edge_left
    area = opening(x[SPOOL], m) + f64(1e-7)
    edge = nominal * area
    place = x[COMPENSATOR]
    throttle = m.compensator_passage * (place * (HALF + HALF * place) + m.bypass + f64(1e-6))
    laminar = f64(3e8) * inputs[at.VISCOSITY]
    flow = passage(x[SUPPLY] - port, ONE / (edge * edge) + ONE / (throttle * throttle), laminar)
    back = m.return_edge * area
    if left:
        back *= ONE - m.half_block
    spring = m.tank_pressure + m.check_pressure
    out = passage(other - spring, ONE / (back * back) + m.tank_loss, m.check_slope)
    return vec4d(flow, out, flow * flow / (edge * edge), wp.where(area > f64(1e-3), port, m.tank_pressure))


@wp.func
def leakage(x: Any, m: Any):
    """Leakage [m³/s] from A to B past damaged seals: turbulent, C_d A √(2 Δp/ρ) (Merritt 1967), and a laminar rest."""
    drop = x[SIDE_A] - x[SIDE_B]
    return m.piston_leakage * drop / wp.sqrt(wp.sqrt(drop * drop + f64(0.25) * BAR * BAR)) + f64(4e-13) * drop


@wp.func
def seat(x: Any, m: Any):
    """Leakage [m³/s] from hose A to hose B through worn cross-line seats: between laminar and turbulent, Δp^0.75."""
    drop = x[LINE] - x[LINE + 1]
    return m.port_leakage * drop / wp.pow(drop * drop + BAR * BAR, f64(0.125))


@wp.func
def port(pressure: wp.float64, m: Any):
    """Flow [m³/s] into a port from its anti-cavitation check, less that of its shock valve."""
    return relief(m.tank_pressure, pressure, f64(2.5e-9)) - relief(pressure, m.shock_pressure, f64(4e-10))


@wp.func
def chamber_rates(d: State, x: Any, m: Any, c: Any):
    """Rates of pressures in both chambers and of their pockets' free share; dissolution of first order (Zhou et al. 2013).

    Conservation: Q − V̇ + V̇_gas = V ṗ/β, gas by :func:`pocket`.
    """
    leak = leakage(x, m)
    for i in range(2):
        into = x[LINE + 2] - leak
        volume = c[0]
        rate = c[2]
        if i == 1:
            into = x[LINE + 3] + leak
            volume = c[1]
            rate = c[3]
        p = x[SIDE_A + i]
        change = (free_gas(p, m) - x[GAS + i]) / m.dissolving_time
        gas = pocket(p, x[GAS + i], m)
        grown = change * gas[0] / wp.max(x[GAS + i], f64(1e-3))
        soft = volume / oil(p, m) + gas[1]
        if i == 0:
            soft += accumulator(p, m)
        d[GAS + i] = change
        d[SIDE_A + i] = (into - rate * x[at.ROD_RATE] + grown) / soft
    return d


@wp.func
def line_rates(d: State, x: Any, m: Any, inputs: Any, f: vec4d):
    """Rates of hose pressures and of line flows: I Q̇ = Δp − R μ Q − c |Q| Q (Watton 2009; inertance ρ l/A)."""
    into_a = f[0]
    into_b = -f[1]
    if x[SPOOL] <= ZERO:
        into_a = -f[1]
        into_b = f[0]
    cross = seat(x, m)
    into_a += port(x[LINE], m) - cross
    into_b += port(x[LINE + 1], m) + cross
    d[LINE] = (into_a - x[LINE + 2]) / hose(x[LINE], m)
    d[LINE + 1] = (into_b - x[LINE + 3]) / hose(x[LINE + 1], m)
    for i in range(2):
        q = x[LINE + 2 + i]
        laminar = m.line_resistance * inputs[at.VISCOSITY]
        if i == 0:
            laminar += pinch(x, m)
        loss = laminar * q + m.line_loss * wp.abs(q) * q
        d[LINE + 2 + i] = (x[LINE + i] - x[SIDE_A + i] - loss) / m.line_inertance
    return d


@wp.func
def hydraulics(d: State, x: Any, m: Any, inputs: Any, c: Any):
    """Derivatives of pressures, pump, valve.

    Pump: the regulator sees load sensing late (CONTROL), main-line relief. Valve: pilot of first order, spool with viscous
    and Coulomb friction on a spring, its speed bounded by the pilot's flow (tanh).
    """
    f = flows(x, m, inputs)
    d = chamber_rates(d, x, m, c)
    d = line_rates(d, x, m, inputs, f)
    given = x[STROKE] * m.pump_displacement * x[at.ENGINE] * pulsation(m, inputs)
    lost = m.pump_leakage * x[SUPPLY] + relief(x[SUPPLY], m.relief_pressure, f64(1.5e-9)) + f[0]
    lost += other_flow(x[SUPPLY], m, inputs)
    rise = (given - lost) * oil(x[SUPPLY], m) / (m.supply_volume * f64(1.9))
    d[SUPPLY] = rise
    sensed = wp.max(f[3], ZERO)
    fall = wp.where(sensed > x[SENSE], ONE, HALF)
    d[SENSE] = (sensed - x[SENSE]) * fall / m.sense_lag
    d[CONTROL] = (x[SENSE] - x[CONTROL]) / m.control_lag
    error = m.margin + wp.min(x[CONTROL], m.cut_off) - x[SUPPLY] - m.regulator_lead * rise
    wanted = error * f64(1.5) / (m.margin * m.stroke_time)
    d[STROKE] = bounded(wp.clamp(wanted, -f64(1.8) / m.stroke_time, ONE / m.stroke_time), x[STROKE])
    d[DRIVER] = (inputs[at.COMMAND] + m.null_shift - x[DRIVER]) / m.pilot_lag
    push = excess(x[DRIVER] - x[SPOOL], m.spool_friction) / m.spool_lag
    d[SPOOL] = m.spool_rate * wp.tanh(push / m.spool_rate)
    balance = unit(HALF + (m.edge_drop - f64(1.05) * f[2]) / m.edge_drop)
    d[COMPENSATOR] = (balance - x[COMPENSATOR]) / m.compensator_lag
    return d


@wp.func
def limit(x: State, m: Any):
    """Stops of the swash plate, pressures at boiling oil, shares of gas."""
    x[STROKE] = unit(x[STROKE])
    for i in range(2):
        x[SIDE_A + i] = wp.max(x[SIDE_A + i], GROUND_FLOOR)
        x[LINE + i] = wp.max(x[LINE + i], GROUND_FLOOR)
    x[SUPPLY] = wp.max(x[SUPPLY], GROUND_FLOOR)
    return x


@wp.func
def start(m: Any, angle: wp.float64):
    """State at rest: all volumes alike, pockets in equilibrium."""
    x = assembly.at_rest(State(), m, angle)
    for i in range(2):
        x[LINE + i] = m.rest_pressure
        x[GAS + i] = free_gas(m.rest_pressure, m)
    return x


@wp.func
def hydraulic_signals(x: Any, m: Any, inputs: Any):
    """Pressures a, b, pump; flows into the chambers a and b; spool."""
    leak = leakage(x, m)
    return Hydraulic(
        x[SIDE_A], x[SIDE_B], x[SUPPLY], x[LINE + 2] - leak, x[LINE + 3] + leak, x[SPOOL]
    )
