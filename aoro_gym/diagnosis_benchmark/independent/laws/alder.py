"""Alder: a spool with a measured flow curve behind a spring–mass compensator, a pump with a spring–mass control spool.

Valve: command → play → second-order spool with a rate limit → flow curve by linear interpolation of measured points.
Compensator upstream of the spool: m ÿ = A (p_spring − Δp_edge) − b ẏ. Oil by Nykänen, hoses of constant stiffness,
one volume a side; LuGre cylinders; relaxation tires with Dahl swivel; Dahl joint bearing.
"""

from typing import Any

import warp as wp

from . import layout as at
from .bodies import frames, rod_torque, wheel_motion
from .disturbances import (
    air_share,
    bent_rod,
    pocket,
    ripple,
    stuck_shock_valve,
    swinging_load,
    wheel_load,
)
from .driveline import drive_power, driveline, engine
from .friction import bristle_rate, stribeck
from .geometry import chambers, vec4d, vec6d
from .numbers import ONE, TWO, ZERO, check, f64, play, series, unit
from .oil import ATMOSPHERE, nykanen
from .shared import onto_axle, sensors, to_tank
from .tires import relaxation_tire

BEARING = wp.constant(at.TIRES + 12)
SEALS = wp.constant(at.TIRES + 13)  # right, left
A, B, P, LS = (wp.constant(at.TIRES + 15 + i) for i in range(4))
COMPENSATOR, COMPENSATOR_RATE, HELD, SPOOL, SPOOL_RATE = (wp.constant(at.TIRES + 19 + i) for i in range(5))
CONTROL, CONTROL_RATE, SWASH = (wp.constant(at.TIRES + 24 + i) for i in range(3))
N_STATES = at.TIRES + 27

State = wp.types.vector(length=N_STATES, dtype=wp.float64)


@wp.func
def flow_curve(m: Any, spool: wp.float64):
    """Flow [m³/s] at the compensator's pressure drop: points measured over the spool's travel, and straight lines."""
    s = wp.abs(spool)
    left = spool >= ZERO
    start = wp.where(left, m.dead_left, m.dead_right)
    half = wp.where(left, m.curve_left_50, m.curve_right_50)
    most = wp.where(left, m.curve_left_75, m.curve_right_75)
    full = wp.where(left, m.curve_left_100, m.curve_right_100)
    flow = half * unit((s - start) / (f64(0.5) - start))
    flow += (most - half) * unit((s - f64(0.5)) * f64(4.0))
    return flow + (full - most) * unit((s - f64(0.75)) * f64(4.0))


@wp.func
def edges(x: Any, m: Any):
    """Conductances [m³/s/√Pa] from pump to the compensator, over the spool, and from the other side to tank."""
    flow = flow_curve(m, x[SPOOL])
    inlet = flow / wp.sqrt(m.compensator_drop)
    share = unit(flow / m.curve_left_100)
    back = m.return_conductance * share * (TWO - share)
    valve = m.compensator_conductance * wp.max(x[COMPENSATOR] / m.compensator_stroke, f64(0.002))
    return vec4d(valve, inlet, series(back, m.return_line), ZERO)


@wp.func
def tires(x: Any, m: Any, wheel: int):
    """Tire of a wheel: forces and rates."""
    k = at.TIRES + 3 * wheel
    return relaxation_tire(m, wheel_motion(x, m, wheel), wheel_load(m, wheel), x[k], x[k + 1], x[k + 2])


@wp.func
def mechanics(d: Any, x: Any, m: Any, inputs: Any, c: Any):
    """Frames, wheels, bearing and seals."""
    rear = vec4d()
    front = vec4d()
    along = vec4d()
    for wheel in range(4):
        f = tires(x, m, wheel)
        k = at.TIRES + 3 * wheel
        d[k] = f[3]
        d[k + 1] = f[4]
        d[k + 2] = f[5]
        along[wheel] = f[0]
        if wheel < 2:
            front = onto_axle(front, m, wheel, f[0], f[1], f[2])
        else:
            rear = onto_axle(rear, m, wheel, f[0], f[1], f[2])
    front[3] = swinging_load(m, inputs)
    rate = x[at.RATE_FRONT] - x[at.RATE_REAR]
    d[BEARING] = bristle_rate(rate, x[BEARING], m.joint_friction, m.joint_friction / m.bearing_bend)
    torque = c[2] * x[A] + c[3] * x[B]
    pressing = m.seal_friction + m.seal_pressure * (wp.max(x[A], ZERO) + wp.max(x[B], ZERO))
    for i in range(2):
        v = c[4 + i] * x[at.ROD_RATE]
        kinetic = pressing
        if i == 1:
            kinetic = pressing + bent_rod(m, x[at.ANGLE])
        level = stribeck(v, kinetic, kinetic * m.seal_static, m.seal_speed)
        d[SEALS + i] = bristle_rate(v, x[SEALS + i], level, kinetic / m.seal_bend)
        torque -= c[4 + i] * (x[SEALS + i] + m.seal_viscous * inputs[at.VISCOSITY] * v)
    d = driveline(d, x, m, inputs, along)
    return frames(d, x, m, rear, front, rod_torque(x, m) - x[BEARING], torque)


@wp.func
def port_flows(x: Any, m: Any, inputs: Any):
    """Flows [m³/s] out of the pump line, into side A and into side B; pressure drop [Pa] over the inlet edge."""
    k = edges(x, m)
    transition = m.transition * inputs[at.VISCOSITY] * inputs[at.VISCOSITY]
    supply = series(k[0], k[1])
    left = x[SPOOL] >= ZERO
    into = wp.where(left, x[A], x[B])
    back = wp.where(left, x[B], x[A])
    inflow = check(supply, x[P] - into, transition)
    outflow = check(k[2], back - m.return_preload, transition)
    cross = (m.cylinder_leakage + m.cross_leakage) / inputs[at.VISCOSITY] * (x[A] - x[B])
    lost = cross + to_tank(m, x[A]) + stuck_shock_valve(m, inputs, x[A])
    a = wp.where(left, inflow, -outflow) - lost
    b = wp.where(left, -outflow, inflow) + cross - to_tank(m, x[B])
    gap = m.spool_gap / inputs[at.VISCOSITY]  # of the closed spool: from the pump to a port and from there to tank
    a += gap * (x[P] + m.return_preload - TWO * x[A])
    b += gap * (x[P] + m.return_preload - TWO * x[B])
    return vec4d(inflow, a, b, (x[P] - into) * k[0] * k[0] / (k[0] * k[0] + k[1] * k[1]))


@wp.func
def valve(d: Any, x: Any, m: Any, inputs: Any, edge_drop: wp.float64):
    """Play, spool, compensator and load-sensing line."""
    d[HELD] = f64(4000.0) * play(inputs[at.COMMAND] - x[HELD], m.valve_play)
    lag = TWO * m.spool_damping / m.spool_frequency
    wanted = wp.clamp((x[HELD] - x[SPOOL]) / lag, -m.spool_rate, m.spool_rate)
    d[SPOOL] = x[SPOOL_RATE]
    d[SPOOL_RATE] = TWO * m.spool_damping * m.spool_frequency * (wanted - x[SPOOL_RATE])
    y = x[COMPENSATOR]
    spring = m.compensator_drop + m.compensator_spring * (y / m.compensator_stroke - f64(0.5))
    spring -= m.compensator_droop * (wp.max(x[A], x[B]) - m.droop_from)
    damping = m.compensator_damping * inputs[at.VISCOSITY]
    force = m.compensator_area * (spring - edge_drop) - damping * x[COMPENSATOR_RATE]
    d[COMPENSATOR] = x[COMPENSATOR_RATE]
    d[COMPENSATOR_RATE] = force / wp.max(m.compensator_mass, damping / f64(1.2e4))  # overdamped: mass hardly counts
    tap_a = unit((x[SPOOL] - m.sense_start) / f64(0.02))
    tap_b = unit((-x[SPOOL] - m.sense_start) / f64(0.02))
    load = wp.max(tap_a * x[A] + tap_b * x[B], ZERO)
    lag = m.sense_lag * (f64(0.5) + f64(0.5) * inputs[at.VISCOSITY])
    d[LS] = (load - x[LS]) / (lag * wp.where(load < x[LS], m.sense_fall, ONE))
    return d


@wp.func
def pump(d: Any, x: Any, m: Any, inputs: Any, outflow: wp.float64, modulus: wp.float64):
    """Control spool on its spring, swash plate with stroking times, and the pump line.

    e = min(margin + p_LS, cut-off) − p − T ṗ; χ̈ = ω² (e/band − χ) − 2 ζ ω χ̇; α̇ = χ/t_up or χ/t_down, χ held in ±1.
    """
    flow = x[SWASH] * m.pump_flow * x[at.ENGINE] / m.engine_speed * ripple(m, inputs)
    leak = m.pump_leakage / inputs[at.VISCOSITY] * x[P]
    rate = (flow - leak - outflow) / (m.line_volume / modulus)
    d[P] = rate
    error = wp.min(m.margin + x[LS], m.pump_limit) - x[P] - m.control_lead * rate
    pull = m.control_frequency * m.control_frequency * (error / m.control_band - x[CONTROL])
    d[CONTROL] = x[CONTROL_RATE]
    d[CONTROL_RATE] = pull - TWO * m.control_damping * m.control_frequency * x[CONTROL_RATE]
    stroke = wp.clamp(x[CONTROL], -ONE, ONE)
    d[SWASH] = stroke / wp.where(stroke < ZERO, m.stroke_down, m.stroke_up)
    if (x[SWASH] <= ZERO and stroke < ZERO) or (x[SWASH] >= ONE and stroke > ZERO):
        d[SWASH] = ZERO
    return d


@wp.func
def moduli(x: Any, m: Any, inputs: Any):
    """Oil's bulk modulus [Pa] in sides A and B and in the pump line."""
    air = air_share(m, inputs)
    a = nykanen(x[A] + ATMOSPHERE, m.liquid + m.liquid_slope * x[A], air, m.polytropic)
    b = nykanen(x[B] + ATMOSPHERE, m.liquid + m.liquid_slope * x[B], air, m.polytropic)
    p = nykanen(x[P] + ATMOSPHERE, m.liquid + m.liquid_slope * x[P], air, m.polytropic)
    return vec4d(a, b, p, ZERO)


@wp.func
def derivative(x: State, m: Any, inputs: Any):
    """Rates of all states."""
    d = State()
    c = chambers(x[at.ROD], m)
    d = mechanics(d, x, m, inputs, c)
    flows = port_flows(x, m, inputs)
    beta = moduli(x, m, inputs)
    hose = m.hose_volume / m.hose_modulus
    capacity_a = (c[0] + m.hose_volume) / beta[0] + hose + pocket(m, x[A], x[at.ANGLE], ONE)
    capacity_b = (c[1] + m.hose_volume) / beta[1] + hose + pocket(m, x[B], x[at.ANGLE], -ONE)
    d[A] = (flows[1] - c[2] * x[at.ROD_RATE]) / capacity_a
    d[B] = (flows[2] - c[3] * x[at.ROD_RATE]) / capacity_b
    d = valve(d, x, m, inputs, flows[3])
    line = ONE / (ONE / beta[2] + ONE / m.hose_modulus)
    d = pump(d, x, m, inputs, flows[0] + m.sense_bleed, line)
    d = engine(d, x, m, inputs, wp.max(x[P], ZERO) * flows[0] + drive_power(x))
    return sensors(d, x, m, x[A], x[B], x[P])


@wp.func
def limit(x: State, m: Any):
    """What hits a stop: compensator and swash plate."""
    if x[COMPENSATOR] < ZERO or x[COMPENSATOR] > m.compensator_stroke:
        x[COMPENSATOR] = wp.clamp(x[COMPENSATOR], ZERO, m.compensator_stroke)
        x[COMPENSATOR_RATE] = ZERO
    x[SWASH] = unit(x[SWASH])
    return x


@wp.func
def start(m: Any, angle: wp.float64):
    """State at rest."""
    x = State()
    x[A] = m.rest_pressure + m.rest_difference
    x[B] = m.rest_pressure - m.rest_difference
    x[P] = m.margin
    return x


@wp.func
def remembered(x: State, m: Any):
    """Nothing in this family waits."""
    return ZERO


@wp.func
def hydraulic_signals(x: State, m: Any, inputs: Any):
    """Pressures at the cylinders and the pump, and flows into both sides: exact."""
    flows = port_flows(x, m, inputs)
    return vec6d(x[A], x[B], x[P], flows[1], flows[2], x[SPOOL])
