"""Cedar: a piloted proportional spool, its compensator downstream, a counterbalanced return and a pump that keeps a margin.

Valve: command → solenoid current → pilot pressure with a limited rate → spool with dry friction → rows of holes. The
flow follows from the pump's margin over the spool; the compensator behind it keeps load-sensing pressure before itself.
Pump: proportional–integral margin controller, swash plate, line volume. Oil by Ruan and Burton, hoses that stiffen with
pressure; Armstrong's seven parameters in the seals; LuGre tires; Bouc–Wen joint bearing.
"""

from typing import Any

import warp as wp

from . import layout as at
from .bodies import frames, rod_torque, wheel_motion
from .disturbances import air_share, bent_rod, pocket, ripple, stuck_shock_valve, swinging_load, wheel_load
from .driveline import drive_power, driveline, engine
from .friction import armstrong_level, bouc_wen_rate, bristle_rate
from .geometry import chambers, vec4d, vec6d
from .numbers import ONE, TWO, ZERO, check, f64, orifice, series, unit
from .oil import ATMOSPHERE, ruan_burton
from .shared import onto_axle, sensors, to_tank
from .tires import lugre_tire

BEARING = wp.constant(at.TIRES + 12)
SEALS = wp.constant(at.TIRES + 13)  # right, left
RECENT, DWELL = (wp.constant(at.TIRES + 15 + i) for i in range(2))
A, B, P, LS = (wp.constant(at.TIRES + 17 + i) for i in range(4))
CURRENT, PILOT, SPOOL, SPOOL_RATE, RUB = (wp.constant(at.TIRES + 21 + i) for i in range(5))
COMPENSATOR, COUNTER, SWASH, INTEGRAL = (wp.constant(at.TIRES + 26 + i) for i in range(4))
N_STATES = at.TIRES + 30

State = wp.types.vector(length=N_STATES, dtype=wp.float64)


@wp.func
def holes(travel: wp.float64, lap: wp.float64, small: wp.float64, begin: wp.float64):
    """Open share over the spool's travel: fine notches, then a row of round holes up to nine tenths of it.

    A hole of diameter 1 is open by (arccos(1 − 2 y) − 2 (1 − 2 y) √(y − y²))/π at depth y.
    """
    x = wp.clamp((travel - lap) / (ONE - lap), ZERO, ONE)
    y = wp.clamp((x - begin) / (f64(0.9) - begin), ZERO, ONE)
    middle = ONE - TWO * y
    hole = (wp.acos(middle) - TWO * middle * wp.sqrt(wp.max(y - y * y, ZERO))) / f64(3.141592653589793)
    return small * x + (ONE - small) * hole


@wp.func
def mechanics(d: Any, x: Any, m: Any, inputs: Any, c: Any):
    """Frames, wheels, bearing and seals."""
    rear = vec4d()
    front = vec4d()
    along = vec4d()
    for wheel in range(4):
        k = at.TIRES + 3 * wheel
        f = lugre_tire(m, wheel_motion(x, m, wheel), wheel_load(m, wheel), x[k], x[k + 1], x[k + 2])
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
    d[BEARING] = bouc_wen_rate(rate, x[BEARING], m.joint_friction, m.joint_friction / m.bearing_bend)
    torque = c[2] * x[A] + c[3] * x[B]
    pressing = m.seal_friction + m.seal_pressure * (wp.max(x[A], ZERO) + wp.max(x[B], ZERO))
    speed = f64(0.19) * wp.abs(x[at.ROD_RATE])  # of the pistons
    d[RECENT] = (speed - x[RECENT]) / m.seal_memory
    d[DWELL] = (ONE - x[DWELL]) / m.seal_dwell - x[DWELL] * speed / f64(1e-3)
    static = ONE + (m.seal_static - ONE) * (f64(0.6) + f64(0.4) * x[DWELL])
    for i in range(2):
        v = c[4 + i] * x[at.ROD_RATE]
        kinetic = pressing
        if i == 1:
            kinetic = pressing + bent_rod(m, x[at.ANGLE])
        level = armstrong_level(x[RECENT], kinetic, kinetic * static, m.seal_speed)
        d[SEALS + i] = bristle_rate(v, x[SEALS + i], level, kinetic / m.seal_bend)
        torque -= c[4 + i] * (x[SEALS + i] + m.seal_viscous * inputs[at.VISCOSITY] * v)
    d = driveline(d, x, m, inputs, along)
    return frames(d, x, m, rear, front, rod_torque(x, m) - x[BEARING], torque)


@wp.func
def thickness(m: Any, inputs: Any):
    """Pressure drop [Pa] below which edges are laminar, by viscosity."""
    return wp.max(m.transition * inputs[at.VISCOSITY] * inputs[at.VISCOSITY], f64(5e4))


@wp.func
def port_flows(x: Any, m: Any, inputs: Any):
    """Flows [m³/s] out of the pump line, into sides A and B, and the pressure [Pa] between edge and compensator."""
    thick = thickness(m, inputs)
    left = x[SPOOL] >= ZERO
    into = wp.where(left, x[A], x[B])
    back = wp.where(left, x[B], x[A])
    begin = wp.where(left, m.hole_left, m.hole_right)
    share = holes(wp.abs(x[SPOOL]), wp.where(left, m.dead_left, m.dead_right), m.notch_share, begin)
    edge = wp.where(left, m.flow_left, m.flow_right) / wp.sqrt(m.metering_drop) * share
    behind = m.compensator_conductance * (f64(0.003) + x[COMPENSATOR])
    supply = check(series(edge, behind), x[P] - into, thick)
    between = x[P] - (x[P] - into) * behind * behind / (behind * behind + edge * edge + f64(1e-30))
    counter = series(m.return_conductance * wp.sqrt(share * (TWO - share)) * x[COUNTER], m.return_line)
    drained = check(counter, back - m.return_preload, thick)
    gap = m.spool_gap / inputs[at.VISCOSITY]
    cross = (m.cylinder_leakage + m.cross_leakage) / inputs[at.VISCOSITY] * (x[A] - x[B])
    lost_a = cross + to_tank(m, x[A]) + stuck_shock_valve(m, inputs, x[A])
    lost_b = to_tank(m, x[B]) - cross
    a = wp.where(left, supply, -drained) - lost_a + gap * (x[P] + m.return_preload - TWO * x[A])
    b = wp.where(left, -drained, supply) - lost_b + gap * (x[P] + m.return_preload - TWO * x[B])
    return vec4d(supply, a, b, between)


@wp.func
def spool(d: Any, x: Any, m: Any, inputs: Any):
    """Solenoid, pilot stage and spool: s̈ = ω² (π − s − r) − 2 ζ ω ṡ, dry friction r by Dahl in units of the command."""
    d[CURRENT] = (inputs[at.COMMAND] - x[CURRENT]) / m.current_lag
    lag = wp.where(x[PILOT] >= ZERO, m.pilot_lag_left, m.pilot_lag_right)
    d[PILOT] = wp.clamp((x[CURRENT] - x[PILOT]) / lag, -m.spool_rate, m.spool_rate)
    omega = m.spool_frequency
    d[SPOOL] = x[SPOOL_RATE]
    pull = omega * omega * (x[PILOT] - x[SPOOL] - x[RUB])
    d[SPOOL_RATE] = pull - TWO * m.spool_damping * omega * x[SPOOL_RATE]
    d[RUB] = bristle_rate(x[SPOOL_RATE], x[RUB], m.valve_play, f64(2.0))
    return d


@wp.func
def pressures(d: Any, x: Any, m: Any, inputs: Any, between: wp.float64):
    """Compensator, counterbalance and load-sensing line."""
    goal = unit((between - x[LS] - m.compensator_drop) / m.compensator_band)
    d[COMPENSATOR] = (goal - x[COMPENSATOR]) / m.compensator_lag
    inlet = wp.where(x[SPOOL] >= ZERO, x[A], x[B])
    opening = wp.clamp(m.counter_least + (inlet - m.counter_start) / m.counter_range, m.counter_least, ONE)
    d[COUNTER] = (opening - x[COUNTER]) / m.counter_lag
    tap_a = unit((x[SPOOL] - m.sense_start) / f64(0.02))
    tap_b = unit((-x[SPOOL] - m.sense_start) / f64(0.02))
    load = wp.max(tap_a * x[A] + tap_b * x[B], ZERO)
    thick = thickness(m, inputs)
    fill = orifice(m.sense_orifice, load - x[LS], thick) - check(m.sense_bleed, x[LS], thick)
    d[LS] = fill / (m.sense_capacity * wp.where(fill < ZERO, m.sense_fall, ONE))
    return d


@wp.func
def pump(d: Any, x: Any, m: Any, inputs: Any, outflow: wp.float64, modulus: wp.float64):
    """Margin controller α* = K e + I, İ = K e/T, e = min(margin + p_LS, cut-off) − p; swash plate; line volume."""
    flow = x[SWASH] * m.pump_flow * x[at.ENGINE] / m.engine_speed * ripple(m, inputs)
    leak = m.pump_leakage / inputs[at.VISCOSITY] * x[P]
    d[P] = (flow - leak - outflow) / (m.line_volume / modulus)
    error = wp.min(m.margin + x[LS], m.pump_limit) - x[P]
    goal = unit(m.control_gain * error + x[INTEGRAL])
    d[SWASH] = wp.clamp((goal - x[SWASH]) / m.swash_lag, -ONE / m.stroke_down, ONE / m.stroke_up)
    held = unit(x[INTEGRAL] + m.control_gain * error) - x[INTEGRAL]  # no winding up at the swash plate's ends
    d[INTEGRAL] = held / m.control_time
    return d


@wp.func
def side(x: Any, m: Any, inputs: Any, pressure: wp.float64, volume: wp.float64, sign: wp.float64):
    """Compliance [m³/Pa] of a side: oil, hose V₀ a/(1 + p/p₁)², air pocket."""
    liquid = m.liquid + m.liquid_slope * pressure
    beta = ruan_burton(pressure + ATMOSPHERE, liquid, air_share(m, inputs), m.polytropic, m.critical_pressure)
    taut = ONE + wp.max(pressure, ZERO) / m.hose_taut
    return (volume + m.hose_volume) / beta + m.hose_volume / (m.hose_modulus * taut * taut) + pocket(
        m, pressure, x[at.ANGLE], sign
    )


@wp.func
def derivative(x: State, m: Any, inputs: Any):
    """Rates of all states."""
    d = State()
    c = chambers(x[at.ROD], m)
    d = mechanics(d, x, m, inputs, c)
    flows = port_flows(x, m, inputs)
    d[A] = (flows[1] - c[2] * x[at.ROD_RATE]) / side(x, m, inputs, x[A], c[0], ONE)
    d[B] = (flows[2] - c[3] * x[at.ROD_RATE]) / side(x, m, inputs, x[B], c[1], -ONE)
    d = spool(d, x, m, inputs)
    d = pressures(d, x, m, inputs, flows[3])
    liquid = m.liquid + m.liquid_slope * x[P]
    beta = ruan_burton(x[P] + ATMOSPHERE, liquid, air_share(m, inputs), m.polytropic, m.critical_pressure)
    d = pump(d, x, m, inputs, flows[0] + m.unloading * x[P], ONE / (ONE / beta + ONE / m.hose_modulus))
    d = engine(d, x, m, inputs, wp.max(x[P], ZERO) * flows[0] + drive_power(x))
    return sensors(d, x, m, x[A], x[B], x[P])


@wp.func
def limit(x: State, m: Any):
    """What hits a stop: compensator and swash plate."""
    x[COMPENSATOR] = unit(x[COMPENSATOR])
    x[SWASH] = unit(x[SWASH])
    return x


@wp.func
def start(m: Any, angle: wp.float64):
    """State at rest."""
    x = State()
    x[A] = m.rest_pressure + m.rest_difference
    x[B] = m.rest_pressure - m.rest_difference
    x[P] = m.margin
    x[COUNTER] = ONE
    x[COMPENSATOR] = ONE
    x[DWELL] = ONE
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
