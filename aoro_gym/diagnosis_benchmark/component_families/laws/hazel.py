"""Laws of hazel: Tait's oil with gas in the lines, hoses that creep, tires on a limit surface, magnetic hysteresis of the
solenoid, a stroke by control flow, a filter by Darcy, pins worn in the middle of their travel."""

from typing import Any

import warp as wp

from aoro_gym.diagnosis_benchmark.independent.laws import layout as at
from aoro_gym.diagnosis_benchmark.independent.laws.numbers import HALF, ONE, TWO, ZERO, f64, unit

from . import assembly
from .common import bounded, coulomb, into_ports, passage, relief
from .disturbances import accumulator, other_flow, pinch, pulsation
from .places import (
    ATMOSPHERE,
    BAR,
    COMPENSATOR,
    CREEP,
    DRIVER,
    GROUND_FLOOR,
    HINGE,
    HYSTERESIS,
    LINE,
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
    """Bulk modulus [Pa] of the liquid by Tait: v = v₀ (1 − C ln(1 + p/B)), C = 0.0894 (Dymond, Malhotra 1988)."""
    scale = m.bulk_modulus * f64(0.0894)
    above = wp.max(pressure, ZERO)
    return (scale + above) * (ONE - f64(0.0894) * wp.log(ONE + above / scale)) / f64(0.0894)


@wp.func
def compliance(pressure: wp.float64, volume: wp.float64, hose: wp.float64, m: Any):
    """Compliance [m³/Pa] of chamber, hose, and gas that gathers in the hose, adiabatic (Wylie, Streeter 1993)."""
    absolute = wp.max(pressure + ATMOSPHERE, f64(0.02) * BAR)
    gas = m.line_gas * wp.pow(ATMOSPHERE / absolute, ONE / f64(1.4)) / (f64(1.4) * absolute)
    return (volume + hose) / oil(pressure, m) + hose / m.hose_modulus + wp.where(hose > ZERO, ONE, ZERO) * gas


@wp.func
def tire(x: Any, m: Any, wheel: int, motion: vec4d, load: wp.float64):
    """Elastic tire whose forces and moment share one limit surface: (F_x/F)² + (F_y/F)² + (M/M₀)² ≤ 1.

    Howe, Cutkosky 1996; Goyal, Ruina, Papadopoulos 1991. Yield grows smoothly with the square of the load ratio (Dafalias'
    bounding surface); rolling releases over the relaxation length. Rates, forces along, across, and moment.
    """
    limit = vec3d(m.grip_sliding * load, m.grip_sliding * load, m.scrub_moment * load / m.load_mean)
    stiff = vec3d(m.stiffness_along, m.stiffness_across, m.twist_stiffness)
    speed = vec3d(motion[0], motion[1], motion[3])
    share = vec3d()
    pull = vec3d()
    for i in range(3):
        share[i] = stiff[i] * x[TIRE + 3 * wheel + i] / limit[i]
        pull[i] = stiff[i] * speed[i] / limit[i]
    level = wp.dot(share, share)
    yielding = wp.max(wp.dot(share, pull), ZERO) * level
    t = Tire()
    for i in range(3):
        t[i] = speed[i] - (yielding + wp.abs(motion[2]) / m.relaxation_length) * x[TIRE + 3 * wheel + i]
    t[3] = stiff[0] * x[TIRE + 3 * wheel] + m.tire_damping * t[0]
    t[4] = -stiff[1] * x[TIRE + 3 * wheel + 1] - m.tire_damping * t[1]
    t[5] = -stiff[2] * (x[TIRE + 3 * wheel + 2] + f64(0.02) * t[2])
    return t


@wp.func
def resistance(x: Any, m: Any, wheel: int, load: wp.float64):
    """Torque [N m] against a wheel: rolling in plastic ground and a brake with Stribeck's fall (Armstrong 1991)."""
    speed = x[at.WHEEL + wheel]
    ratio = speed / f64(0.2)
    brake = m.brake_torque * (ONE + f64(0.25) * wp.exp(-ratio * ratio))
    return (m.rolling * load * m.tire_radius + brake) * coulomb(speed, f64(0.025))


@wp.func
def hinge(x: Any, m: Any):
    """LuGre friction of the bearing with Stribeck's fall of 30 %: torque [N m] and rate of its bristles."""
    rate = x[at.RATE_FRONT] - x[at.RATE_REAR]
    ratio = rate / f64(0.15)
    level = m.hinge_torque * (f64(0.7) + f64(0.3) * wp.exp(-ratio * ratio))
    stiffness = f64(3e5)
    bristle = rate - wp.abs(rate) * stiffness * x[HINGE] / level
    return vec2d(stiffness * x[HINGE] + f64(300.0) * bristle + f64(80.0) * rate, bristle)


@wp.func
def seals(x: Any, m: Any, c: Any, inputs: Any):
    """Brown, McPhee's continuous friction (2016) of both cylinders as a torque [N m]; seals pressed by their pressures.

    F = F_c tanh(4 v/v_s) + (F_s − F_c)(v/v_s)/((v/(2 v_s))² + 3/4)² + b v.
    """
    torque = ZERO
    pressed = ONE + (wp.max(x[SIDE_A], ZERO) + wp.max(x[SIDE_B], ZERO)) / (f64(300.0) * BAR)
    sliding = m.seal_force / m.seal_ratio * pressed
    for side in range(2):
        lever = c[4 + side]
        v = lever * x[at.ROD_RATE]
        r = v / m.stribeck_speed
        bell = r * r / f64(4.0) + f64(0.75)
        force = sliding * wp.tanh(f64(4.0) * r) + sliding * (m.seal_ratio - ONE) * r / (bell * bell)
        torque += lever * (force + m.seal_viscosity * wp.sqrt(inputs[at.VISCOSITY] / f64(0.04)) * v)
    return vec3d(torque, ZERO, ZERO)


@wp.func
def rods(x: Any, m: Any):
    """Torque [N m] of brackets as a standard linear solid behind pins worn most in the middle of their travel.

    Free play w₀ (0.4 + 0.6 exp(−(θ/0.3)²)); Zener: spring, and beside it a spring with a dashpot (40 %, 20 ms).
    """
    stretch = x[at.ROD] - x[at.ANGLE]
    place = x[at.ANGLE] / f64(0.3)
    gap = m.joint_play * (f64(0.4) + f64(0.6) * wp.exp(-place * place))
    touching = unit(ONE + (wp.abs(stretch) - gap) / f64(3e-5))
    beyond = stretch - wp.clamp(stretch, -gap, gap)
    rate = x[at.ROD_RATE] - x[at.RATE_FRONT] + x[at.RATE_REAR]
    torque = m.joint_stiffness * (beyond + f64(0.4) * (beyond - x[CREEP]))
    return vec2d(torque + m.joint_damping * rate * touching, (beyond - x[CREEP]) / f64(0.02))


@wp.func
def engine(x: Any, m: Any, load: wp.float64):
    """Governor on a torque that rises at most 1500 N m/s (smoke limit) towards its droop line: rates of both."""
    below = (m.engine_speed - x[at.ENGINE]) / (m.droop * m.engine_speed) * f64(200.0)
    goal = wp.clamp(m.engine_idle_torque + below, ZERO, f64(620.0))
    rate = wp.clamp((goal - x[at.GOVERNOR]) / f64(0.04), -f64(4000.0), f64(1500.0))
    return vec2d((x[at.GOVERNOR] - load) / m.engine_inertia, rate)


@wp.func
def cubic(t: wp.float64, y0: wp.float64, y1: wp.float64, s0: wp.float64, s1: wp.float64):
    """Hermite cubic on [0, 1]; slopes per unit of ``t``."""
    u = ONE - t
    return u * u * ((ONE + TWO * t) * y0 + t * s0) + t * t * ((ONE + TWO * u) * y1 - u * s1)


@wp.func
def opening(spool: wp.float64, m: Any):
    """Share of the edge that is open: a monotone cubic through the measured points (Fritsch, Carlson 1980)."""
    s = wp.abs(spool)
    band = m.band_left
    low = m.half_left
    high = m.most_left
    if spool < ZERO:
        band = m.band_right
        low = m.half_right
        high = m.most_right
    first = HALF - band
    slope = TWO / (first / low + f64(0.25) / (high - low))
    last = TWO / (f64(0.25) / (high - low) + f64(0.25) / (ONE - high))
    value = ZERO
    if s > band:
        value = cubic(unit((s - band) / first), ZERO, low, ZERO, slope * first)
    if s > HALF:
        value = cubic((s - HALF) * f64(4.0), low, high, slope * f64(0.25), last * f64(0.25))
    if s > f64(0.75):
        value = cubic(unit((s - f64(0.75)) * f64(4.0)), high, ONE, last * f64(0.25), ZERO)
    return value


@wp.func
def flows(x: Any, m: Any, inputs: Any):
    """Flows [m³/s] out of the supply and to the tank, drop [Pa] over the metering edge, sensed pressure.

    The filter in the return obeys Darcy: its drop is in proportion to viscosity and flow.
    """
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
    area = opening(x[SPOOL], m) + f64(1e-7)
    edge = nominal * area
    throttle = m.compensator_passage * (x[COMPENSATOR] + f64(1e-6))
    line = m.line_resistance * inputs[at.VISCOSITY] + added
    losses = m.line_loss + ONE / (throttle * throttle)
    flow = passage(x[SUPPLY] - port, ONE / (edge * edge) + losses, line)
    back = m.return_edge * area * (ONE - block)
    filter = m.filter_resistance * inputs[at.VISCOSITY] + line
    out = passage(other - m.tank_pressure, ONE / (back * back) + m.line_loss, filter)
    sensed = port + line * flow
    return vec4d(flow, out, flow * flow / (edge * edge), wp.where(area > f64(1e-3), sensed, m.tank_pressure))


@wp.func
def leaks(x: Any, m: Any, inputs: Any):
    """Leakage [m³/s] from A to B: a seal that pressure lifts, laminar with a gap that widens (Nikas 2010), and spool lands,
    laminar in an eccentric gap (Merritt 1967)."""
    drop = x[SIDE_A] - x[SIDE_B]
    lift = ONE + wp.abs(drop) / (f64(80.0) * BAR)
    seal = m.piston_leakage * drop * lift
    return (seal + m.port_leakage * drop) * f64(0.04) / inputs[at.VISCOSITY]


@wp.func
def port(pressure: wp.float64, m: Any):
    """Flow [m³/s] into a port from its anti-cavitation check, less that of its shock valve."""
    return relief(m.tank_pressure, pressure, f64(3.5e-9)) - relief(pressure, m.shock_pressure, f64(7e-10))


@wp.func
def into_sides(x: Any, m: Any, inputs: Any, f: vec4d):
    """Flows [m³/s] into A and into B."""
    return into_ports(x[SPOOL], f, port(x[SIDE_A], m), port(x[SIDE_B], m), leaks(x, m, inputs))


@wp.func
def hydraulics(d: State, x: Any, m: Any, inputs: Any, c: Any):
    """Derivatives of pressures, pump, valve.

    Pump: control flow through an orifice moves the swash plate, its speed by the root of the error (Manring 2005). Valve:
    solenoid of inductance and resistance, Coleman–Hodgdon hysteresis (1986), spool driven by a pilot orifice.
    """
    f = flows(x, m, inputs)
    into = into_sides(x, m, inputs, f)
    for i in range(2):
        creep = (m.hose_creep * x[SIDE_A + i] - x[LINE + i]) / f64(0.08)
        soft = compliance(x[SIDE_A + i], c[i], m.hose_volume, m)
        if i == 0:
            soft += accumulator(x[SIDE_A], m)
        d[LINE + i] = creep
        d[SIDE_A + i] = (into[i] - c[2 + i] * x[at.ROD_RATE] - creep) / soft
    given = x[STROKE] * m.pump_displacement * x[at.ENGINE] * pulsation(m, inputs)
    lost = m.pump_leakage * x[SUPPLY] + relief(x[SUPPLY], m.relief_pressure, f64(1.2e-9)) + f[0]
    lost += other_flow(x[SUPPLY], m, inputs)
    rise = (given - lost) / (compliance(x[SUPPLY], m.supply_volume, ZERO, m) * f64(2.0))
    d[SUPPLY] = rise
    d[SENSE] = (wp.min(wp.max(f[3], ZERO), m.sense_relief) - x[SENSE]) / m.sense_lag
    error = m.margin + x[SENSE] - x[SUPPLY] - m.regulator_lead * rise
    ratio = error / (f64(8.0) * BAR)
    wanted = ratio / wp.sqrt(wp.sqrt(ratio * ratio + ONE)) / m.stroke_time
    d[STROKE] = bounded(wp.clamp(wanted, -f64(2.2) / m.stroke_time, ONE / m.stroke_time), x[STROKE])
    change = (m.driver_gain * inputs[at.COMMAND] + m.null_shift - x[DRIVER]) / m.coil_lag
    width = m.magnetic_width
    d[DRIVER] = change
    d[HYSTERESIS] = change - wp.abs(change) * x[HYSTERESIS] / width
    away = x[DRIVER] - x[HYSTERESIS] - x[SPOOL]
    near = m.spool_rate * m.spool_lag
    d[SPOOL] = m.spool_rate * away / wp.sqrt(wp.sqrt(away * away + near * near * near * near))
    balance = wp.min(unit(HALF + (m.edge_drop - f[2]) / (f64(0.9) * m.edge_drop)), m.compensator_stop)
    speed = (balance - x[COMPENSATOR]) / m.compensator_lag
    d[COMPENSATOR] = wp.where(speed < ZERO, speed, HALF * speed)
    return d


@wp.func
def limit(x: State, m: Any):
    """Stops of the swash plate, pressures at boiling oil."""
    x[STROKE] = unit(x[STROKE])
    for i in range(3):
        x[SIDE_A + i] = wp.max(x[SIDE_A + i], GROUND_FLOOR)
    return x


@wp.func
def start(m: Any, angle: wp.float64):
    """State at rest: hoses crept, compensator at its stop."""
    x = assembly.at_rest(State(), m, angle)
    for i in range(2):
        x[LINE + i] = m.hose_creep * m.rest_pressure
    x[COMPENSATOR] = m.compensator_stop
    return x


@wp.func
def hydraulic_signals(x: Any, m: Any, inputs: Any):
    """Pressures a, b, pump; flows into a and b; spool."""
    into = into_sides(x, m, inputs, flows(x, m, inputs))
    return Hydraulic(x[SIDE_A], x[SIDE_B], x[SUPPLY], into[0], into[1], x[SPOOL])
