"""Birch: four metering edges of their own laps, hoses as lines with inertia, a pump as a delayed pressure source.

Valve: command → first-order spool with a rate limit → play → four edges; discharge coefficients by McCloy. Compensator
upstream, ideal but for a first-order lag. Pump: ṗ = (p_wanted(t − T_d) − R Q − p)/τ within rate limits. Oil by Yu, three
volumes and two inertias a side; Maxwell-slip seals; carpet tires; joint bearing without memory.
"""

from typing import Any

import warp as wp

from . import layout as at
from .bodies import frames, rod_torque, wheel_motion
from .disturbances import air_share, bent_rod, pocket, ripple, stuck_shock_valve, swinging_load, wheel_load
from .driveline import drive_power, driveline, engine
from .friction import coulomb, maxwell_rate, stribeck
from .geometry import chambers, vec4d, vec6d
from .numbers import HALF, ONE, TWO, ZERO, f64, mccloy, play, series, unit
from .oil import ATMOSPHERE, yu
from .shared import onto_axle, sensors, to_tank
from .tires import carpet_tire

SEALS = wp.constant(at.TIRES + 16)  # right soft, right stiff, left soft, left stiff
SIDE_A, SIDE_B = wp.constant(at.TIRES + 20), wp.constant(at.TIRES + 25)  # valve, flow, middle, flow, cylinder
P, LS, SPOOL, HELD, PASSING = (wp.constant(at.TIRES + 30 + i) for i in range(5))
N_STATES = at.TIRES + 35

State = wp.types.vector(length=N_STATES, dtype=wp.float64)


@wp.func
def notch(travel: wp.float64, lap: wp.float64, bend: wp.float64, exponent: wp.float64):
    """Open share of an inlet edge with round notches: r/(1 + r), r = k (ξ/(1 − ξ))ⁿ, ξ = (s − lap)/(1 − lap)."""
    x = wp.clamp((travel - lap) / (ONE - lap), ZERO, ONE)
    opening = bend * wp.pow(x, exponent)
    return opening / (opening + wp.pow(ONE - x, exponent) + f64(1e-12))


@wp.func
def slot(travel: wp.float64, lap: wp.float64):
    """Open share of a return edge: ξ (2 − ξ)."""
    x = wp.clamp((travel - lap) / (ONE - lap), ZERO, ONE)
    return x * (TWO - x)


@wp.func
def mechanics(d: Any, x: Any, m: Any, inputs: Any, c: Any):
    """Frames, wheels, bearing and seals."""
    rear = vec4d()
    front = vec4d()
    along = vec4d()
    for wheel in range(4):
        k = at.TIRES + 4 * wheel
        u = vec4d(x[k], x[k + 1], x[k + 2], x[k + 3])
        f = carpet_tire(m, wheel_motion(x, m, wheel), wheel_load(m, wheel), u)
        for i in range(4):
            d[k + i] = f[3 + i]
        along[wheel] = f[0]
        if wheel < 2:
            front = onto_axle(front, m, wheel, f[0], f[1], f[2])
        else:
            rear = onto_axle(rear, m, wheel, f[0], f[1], f[2])
    front[3] = swinging_load(m, inputs)
    rate = x[at.RATE_FRONT] - x[at.RATE_REAR]
    bearing = coulomb(rate, m.joint_friction / m.bearing_static, m.joint_friction, m.bearing_speed)
    a = x[SIDE_A + 4]
    b = x[SIDE_B + 4]
    torque = c[2] * a + c[3] * b
    pressing = m.seal_friction + m.seal_pressure * (wp.max(a, ZERO) + wp.max(b, ZERO))
    for i in range(2):
        v = c[4 + i] * x[at.ROD_RATE]
        kinetic = pressing
        if i == 1:
            kinetic = pressing + bent_rod(m, x[at.ANGLE])
        level = stribeck(v, kinetic, kinetic * m.seal_static, m.seal_speed)
        soft = m.seal_share * level
        stiff = (ONE - m.seal_share) * level
        k = SEALS + 2 * i
        d[k] = maxwell_rate(v, x[k], soft, m.seal_share * kinetic / m.seal_bend)
        d[k + 1] = maxwell_rate(v, x[k + 1], stiff, (ONE - m.seal_share) * kinetic / (m.seal_bend * f64(0.3)))
        torque -= c[4 + i] * (x[k] + x[k + 1] + m.seal_viscous * inputs[at.VISCOSITY] * v)
    d = driveline(d, x, m, inputs, along)
    return frames(d, x, m, rear, front, rod_torque(x, m) - bearing, torque)


@wp.func
def thickness(m: Any, inputs: Any):
    """Pressure drop [Pa] below which edges are laminar, by viscosity; a floor keeps the small volumes' rates bounded."""
    return wp.max(m.transition * inputs[at.VISCOSITY] * inputs[at.VISCOSITY], f64(9e4))


@wp.func
def inlet(x: Any, m: Any, inputs: Any):
    """Flow [m³/s] over the open inlet edge, the drop that would be over it if the compensator stayed open, the one kept."""
    left = x[HELD] >= ZERO
    into = wp.where(left, x[SIDE_A], x[SIDE_B])
    lap = wp.where(left, m.dead_left, m.dead_right)
    bend = wp.where(left, m.notch_left, m.notch_right)
    full = wp.where(left, m.flow_left, m.flow_right)
    edge = full / wp.sqrt(m.compensator_drop) * notch(wp.abs(x[HELD]), lap, bend, m.notch_exponent)
    valve = m.compensator_conductance
    there = wp.max(x[P] - into, ZERO) * valve * valve / (valve * valve + edge * edge)
    flow = mccloy(edge, x[PASSING] * there, thickness(m, inputs))
    kept = m.compensator_drop - m.compensator_droop * (wp.max(x[SIDE_A], x[SIDE_B]) - m.droop_from)
    return vec4d(flow, there, kept, ZERO)


@wp.func
def outlet(x: Any, m: Any, inputs: Any, pressure: wp.float64, travel: wp.float64, lap: wp.float64):
    """Flow [m³/s] of a side over its return edge to the return gallery."""
    edge = series(m.return_conductance * slot(travel, lap), m.return_line)
    return mccloy(edge, wp.max(pressure - m.return_preload, ZERO), thickness(m, inputs))


@wp.func
def port_flows(x: Any, m: Any, inputs: Any, supply: wp.float64):
    """Flows [m³/s] into sides A and B at the valve."""
    a = x[SIDE_A]
    b = x[SIDE_B]
    left = x[HELD] >= ZERO
    into_a = wp.where(left, supply, ZERO) - outlet(x, m, inputs, a, -x[HELD], m.return_lap_a)
    into_b = wp.where(left, ZERO, supply) - outlet(x, m, inputs, b, x[HELD], m.return_lap_b)
    gap = m.spool_gap / inputs[at.VISCOSITY]
    cross = m.cross_leakage / inputs[at.VISCOSITY] * (a - b)
    into_a += gap * (x[P] + m.return_preload - TWO * a) - cross - to_tank(m, a) - stuck_shock_valve(m, inputs, a)
    into_b += gap * (x[P] + m.return_preload - TWO * b) + cross - to_tank(m, b)
    return vec4d(into_a, into_b, ZERO, ZERO)


@wp.func
def modulus(m: Any, inputs: Any, pressure: wp.float64):
    """Oil's bulk modulus [Pa] at a pressure."""
    liquid = m.liquid + m.liquid_slope * pressure
    return yu(pressure + ATMOSPHERE, liquid, air_share(m, inputs), m.polytropic, m.dissolving)


@wp.func
def line(d: Any, x: Any, m: Any, inputs: Any, k: int, ends: vec4d):
    """A side: three volumes of oil in hose, two inertias, q̇ = (p₁ − p₂ − R q − R₂ q |q|)/L; the last holds the cylinders.

    ``ends``: flow in at the valve, flow that leaves at the cylinders, volume of oil there, 1 or −1 for side A or B.
    """
    first = modulus(m, inputs, x[k])
    last = modulus(m, inputs, x[k + 4])
    middle = HALF * (first + last)
    inertia = HALF * m.hose_inertia
    viscous = HALF * m.hose_resistance * inputs[at.VISCOSITY]
    for i in range(2):
        q = x[k + 1 + 2 * i]
        lost = q * (viscous + HALF * m.hose_turbulence * wp.abs(q))
        d[k + 1 + 2 * i] = (x[k + 2 * i] - x[k + 2 + 2 * i] - lost) / inertia
    hose = m.hose_volume
    d[k] = (ends[0] - x[k + 1]) / (f64(0.45) * hose * (ONE / first + ONE / m.hose_modulus))
    d[k + 2] = (x[k + 1] - x[k + 3]) / (f64(0.2) * hose * (ONE / middle + ONE / m.hose_modulus))
    held = (ends[2] + f64(0.35) * hose) / last + f64(0.35) * hose / m.hose_modulus
    d[k + 4] = (x[k + 3] - ends[1]) / (held + pocket(m, x[k + 4], x[at.ANGLE], ends[3]))
    return d


@wp.func
def wanted(x: Any, m: Any):
    """Pressure [Pa] that the pump's controller wants."""
    return wp.min(x[LS] + m.margin, m.pump_limit)


@wp.func
def derivative(x: State, m: Any, inputs: Any):
    """Rates of all states."""
    d = State()
    c = chambers(x[at.ROD], m)
    d = mechanics(d, x, m, inputs, c)
    supply = inlet(x, m, inputs)
    ports = port_flows(x, m, inputs, supply[0])
    leak = m.cylinder_leakage / inputs[at.VISCOSITY] * (x[SIDE_A + 4] - x[SIDE_B + 4])
    d = line(d, x, m, inputs, SIDE_A, vec4d(ports[0], c[2] * x[at.ROD_RATE] + leak, c[0], ONE))
    d = line(d, x, m, inputs, SIDE_B, vec4d(ports[1], c[3] * x[at.ROD_RATE] - leak, c[1], -ONE))
    d[SPOOL] = wp.clamp((inputs[at.COMMAND] - x[SPOOL]) / m.spool_lag, -m.spool_rate, m.spool_rate)
    d[HELD] = f64(4000.0) * play(x[SPOOL] - x[HELD], m.valve_play)
    goal = wp.clamp(supply[2] / (supply[1] + f64(1e3)), ZERO, ONE)
    d[PASSING] = (goal - x[PASSING]) / m.compensator_lag
    tap_a = unit((x[HELD] - m.sense_start) / f64(0.02))
    tap_b = unit((-x[HELD] - m.sense_start) / f64(0.02))
    load = wp.max(wp.max(tap_a * x[SIDE_A], tap_b * x[SIDE_B]), ZERO)
    lag = m.sense_lag * (HALF + HALF * inputs[at.VISCOSITY]) * wp.where(load < x[LS], m.sense_fall, ONE)
    d[LS] = (load - x[LS]) / lag
    target = inputs[at.DELAYED] * ripple(m, inputs) - m.pump_droop * supply[0]
    d[P] = wp.clamp((target - x[P]) / m.pump_lag, -m.pump_fall, m.pump_rise)
    d = engine(d, x, m, inputs, wp.max(x[P], ZERO) * supply[0] + drive_power(x))
    return sensors(d, x, m, x[SIDE_A + 4], x[SIDE_B + 4], x[P])


@wp.func
def limit(x: State, m: Any):
    """What hits a stop: the compensator."""
    x[PASSING] = unit(x[PASSING])
    return x


@wp.func
def start(m: Any, angle: wp.float64):
    """State at rest."""
    x = State()
    for i in range(3):
        x[SIDE_A + 2 * i] = m.rest_pressure + m.rest_difference
        x[SIDE_B + 2 * i] = m.rest_pressure - m.rest_difference
    x[P] = m.margin
    x[PASSING] = m.compensator_drop / m.margin
    return x


@wp.func
def remembered(x: State, m: Any):
    """What the pump answers to later."""
    return wanted(x, m)


@wp.func
def hydraulic_signals(x: State, m: Any, inputs: Any):
    """Pressures at the cylinders and the pump, and flows into their volumes: exact."""
    leak = m.cylinder_leakage / inputs[at.VISCOSITY] * (x[SIDE_A + 4] - x[SIDE_B + 4])
    return vec6d(x[SIDE_A + 4], x[SIDE_B + 4], x[P], x[SIDE_A + 3] - leak, x[SIDE_B + 3] + leak, x[HELD])
