"""How the oil and the engine of a plant move: rates of their state, and a stabilised explicit method that steps it.

Within a call of :func:`advance_circuit` the frames and wheels move at constant rates; the state is integrated by a
Runge-Kutta-Chebyshev method of second order, so that stiff valves need no Jacobian.
"""

# device code: its types are Warp's
# pyright: reportGeneralTypeIssues=false, reportInvalidTypeForm=false, reportOperatorIssue=false
# pyright: reportCallIssue=false, reportIndexIssue=false, reportArgumentType=false, reportAssignmentType=false
import numpy as np
import warp as wp

from aoro_gym.diagnosis_benchmark.plants import circuits as rows
from aoro_gym.diagnosis_benchmark.plants.circuits import Circuit, Drive, Engine, Lines, Valve
from aoro_gym.diagnosis_benchmark.plants.fluid import (
    ATMOSPHERE,
    Oil,
    check_valve,
    compressibility,
    orifice,
    relief_valve,
)
from aoro_gym.diagnosis_benchmark.plants.joint import PISTON_INERTIA, capacity, cylinder_torque, series_torque
from aoro_gym.diagnosis_benchmark.plants.linkage import Displacement, displacement
from aoro_gym.diagnosis_benchmark.plants.records import (
    Array,
    clipped,
    f64,
    positive,
    record,
    square,
    unit,
    vec4,
    vec11,
    vec15,
    vec29,
)

SLOW_SHARE, SLOW_TIME = wp.constant(f64(0.4)), wp.constant(f64(0.02))
"""Share of a hose's wall that stretches late, and its time constant [s] (level 3, estimates; rubber: 10 to 100 ms)."""

NEAR = wp.constant(f64(0.005))
"""Change of the absolute pressure, as a share, within which the compressibility is taken as a straight line: the curve of
air, ∝ P⁻² at the steepest, lies at most 3 NEAR² = 7.5e-5 of itself above it."""

SPEED = wp.constant(vec11(*rows.SPEEDS))

Held = record(
    "Held", "inlet outlet full_load droop pin rate steer drive", left=wp.int32, curve=vec4, at=Displacement, wheel_rate=vec4,
)  # fmt: skip
"""What stays for the length of a call: edges and opening's curve of the side on which the spool stands; the torque [N m]
that the engine can give, which half a millisecond changes by 0.1 N m, and the droop [rad/s per N m]; the cylinders' geometry
at the angle ``pin``, rates of joint and wheels, commands."""

ValveFlows = record("ValveFlows", "inflow returned into_a into_b sensed stroke edge_drop")
"""Flows [m³/s] from the supply, to the return line and into either port's line; pressure [Pa] that the load-sensing line
takes up; the compensator's stroke [0, 1]; the pressure [Pa] over the open inlet edge."""


def chebyshev(stages: int) -> Array:
    """Coefficients (instant c, 1 − μ − ν, μ, ν, μ̃, γ̃) of each stage (stages, 6) of the Runge-Kutta-Chebyshev method of
    second order with ``stages`` ≥ 2 stages and damping 2/13; the first stage is an Euler step.

    Stable for real eigenvalues up to about 0.65 stages² / h. Source: Sommeijer, Shampine and Verwer, J. Comput. Appl. Math.
    88 (1998) 315.
    """
    if stages < 2:
        raise ValueError(f"stages is {stages}, but must be an integer of at least 2")
    w0 = 1.0 + 2.0 / 13.0 / stages**2
    value, first, second = [1.0, w0], [0.0, 1.0], [0.0, 0.0]
    for _ in range(2, stages + 1):
        value.append(2.0 * w0 * value[-1] - value[-2])
        first.append(2.0 * w0 * first[-1] - first[-2] + 2.0 * value[-2])
        second.append(2.0 * w0 * second[-1] - second[-2] + 4.0 * first[-2])
    w1 = first[-1] / second[-1]
    b = [0.0, 0.0] + [second[j] / first[j] ** 2 for j in range(2, stages + 1)]
    b[0] = b[1] = b[2]
    a = [1.0 - b[j] * value[j] for j in range(stages + 1)]
    rule, times = [(0.0, 1.0, 0.0, 0.0, b[1] * w1, 0.0)], [0.0, b[1] * w1]
    for j in range(2, stages + 1):
        mu, nu, slope = 2.0 * b[j] * w0 / b[j - 1], -b[j] / b[j - 2], 2.0 * b[j] * w1 / b[j - 1]
        back = -a[j - 1] * slope
        rule.append((times[-1], 1.0 - mu - nu, mu, nu, slope, back))
        times.append(mu * times[-1] + nu * times[-2] + slope + back)
    return np.array(rule)


# ------------------------------------------------------------------------------------------------------------ steering
@wp.func
def opening(curve: vec4, shift: f64, volts: f64):
    """Opening [0, 1] of the edges at the spool's ``volts`` [V] from the middle: three straight lines."""
    signal = positive(volts - shift)
    low = wp.min(positive(signal - curve[0]), f64(1.0) - curve[0])
    middle, high = wp.min(positive(signal - f64(1.0)), f64(0.5)), wp.min(positive(signal - f64(1.5)), f64(0.5))
    return curve[1] * low + curve[2] * middle + curve[3] * high


@wp.func
def valve_flows(v: Valve, held: Held, y: vec29, supply: f64, tank: f64, valve_a: f64, valve_b: f64):
    """Flows of compensator, edges, shock and suction valves, and leaks, at the valve's ports A and B [Pa]."""
    flows = ValveFlows()
    is_open = opening(held.curve, v.shift, f64(2.0) * wp.abs(y[rows.SPOOL]))
    loaded = wp.where(held.left == 1, valve_a, valve_b)
    emptied = wp.where(held.left == 1, valve_b, valve_a)
    flows.stroke = unit(y[rows.COMPENSATOR])
    into_loaded, out_of_emptied = f64(0.0), f64(0.0)
    if is_open > f64(0.0):
        throttle = square(flows.stroke * v.compensator)
        edge = is_open * held.inlet
        both = throttle + edge * edge + f64(1e-30)
        available = positive(supply - loaded)
        into_loaded = orifice(edge * wp.sqrt(throttle / both), available, v.laminar)
        out_of_emptied = orifice(is_open * held.outlet, emptied - tank, v.laminar)
        flows.sensed = positive(loaded)
        flows.edge_drop = available * throttle / both
    over_a, over_b = valve_a - tank, valve_b - tank
    out_a = relief_valve(over_a, v.shock_setting[0], v.shock_gain) + v.port_leak[0] * over_a
    out_b = relief_valve(over_b, v.shock_setting[1], v.shock_gain) + v.port_leak[1] * over_b
    out_a -= check_valve(v.suction, -over_a, v.crack, v.laminar)
    out_b -= check_valve(v.suction, -over_b, v.crack, v.laminar)
    cross = f64(0.0)
    if v.cross_orifice > f64(0.0):
        cross = orifice(v.cross_orifice, valve_a - valve_b, v.laminar)
    flows.inflow = into_loaded
    flows.returned = out_of_emptied + out_a + out_b
    flows.into_a = wp.where(held.left == 1, into_loaded, -out_of_emptied) - out_a - cross
    flows.into_b = wp.where(held.left == 1, -out_of_emptied, into_loaded) - out_b + cross
    return flows


@wp.func
def hose_rates(c: Lines, y: vec29, out: vec29, soft: vec4, into_a: f64, into_b: f64, p_a: f64, p_b: f64):
    """Rates of a hose's parts, written into ``out``, and flows [m³/s] out of the hoses into the cylinders, where ``into_a``
    and ``into_b`` enter them at the valve; ``soft``: compressibility [1/Pa] of the oil in the nodes."""
    node = vec4(y[rows.NODES], y[rows.NODES + 1], y[rows.NODES + 2], y[rows.NODES + 3])
    port = vec4(p_a, p_b, p_a, p_b)
    if c.cells == 1:
        flow_in = vec4(into_a, into_b, f64(0.0), f64(0.0))
        for i in range(2):
            p = wp.max(node[i], c.least)
            out[rows.WALLS + i] = (SLOW_SHARE * c.hose_wall * p - y[rows.WALLS + i]) / SLOW_TIME
            yielding = c.hose_volume * soft[i] + (f64(1.0) - SLOW_SHARE) * c.hose_wall
            gained = flow_in[i] - y[rows.LEGS + i] - out[rows.WALLS + i]
            out[rows.NODES + i] = gained / wp.where(node[i] > c.least, yielding, c.hose_void)
            out[rows.LEGS + i] = (p - port[i]) / c.column - c.column_decay * y[rows.LEGS + i]
        return out, y[rows.LEGS], y[rows.LEGS + 1]
    flow = vec4(into_a, into_b, y[rows.COLUMNS], y[rows.COLUMNS + 1])
    end = vec4(wp.max(node[2], c.least), wp.max(node[3], c.least), p_a, p_b)
    for i in range(4):
        p = wp.max(node[i], c.least)
        yielding = c.hose_volume * soft[i] + c.hose_wall
        out[rows.NODES + i] = (flow[i] - y[rows.COLUMNS + i]) / wp.where(node[i] > c.least, yielding, c.hose_void)
        out[rows.COLUMNS + i] = (p - end[i]) / c.column - c.column_decay * y[rows.COLUMNS + i]
    return out, y[rows.COLUMNS + 2], y[rows.COLUMNS + 3]


@wp.func
def pump_flow(c: Lines, laminar: f64, swash: f64, speed: f64, supply: f64, sensed: f64):
    """Flow [m³/s] of the steering pump, less its leak, the bleed of the load-sensing line and the relief valve's."""
    lost = c.pump_leak * supply + relief_valve(supply, c.supply_setting, c.supply_gain)
    return swash * c.pump_size * speed - lost - orifice(c.bleed, sensed, laminar)


@wp.func
def return_flow(c: Lines, tank: f64):
    """Flow [m³/s] from the return line at ``tank`` [Pa] through its filter, p − p₀ = r Q + a Q²."""
    over = positive(tank - c.back_pressure)
    if c.throttle == f64(0.0):
        return over / c.back_slope
    return f64(2.0) * over / (c.back_slope + wp.sqrt(square(c.back_slope) + f64(4.0) * c.throttle * over))


# ----------------------------------------------------------------------------------------------------------- driveline
@wp.func
def driveline_flows(d: Drive, laminar: f64, net: vec11, p: vec11, swash: f64, speed: f64, wheel_rate: vec4):
    """``net`` with the net flows [m³/s] into the closed loop's volumes."""
    forward, back, charge = p[rows.FORWARD], p[rows.BACK], p[rows.CHARGE]
    across = forward - back
    size = wp.abs(across)
    passed = d.cross * across + wp.sign(across) * relief_valve(size, d.cross_setting, d.cross_gain)
    pumped = swash * d.size * speed - passed
    check_forward = check_valve(d.charge_check, charge - forward, d.charge_crack, laminar)
    check_back = check_valve(d.charge_check, charge - back, d.charge_crack, laminar)
    flush = f64(0.0)
    if size > d.shift_pressure:
        shifted = unit(size / d.shift_pressure - f64(1.0))
        flush = shifted * relief_valve(wp.min(forward, back), d.flush_setting, d.flush_gain)
    net[rows.FORWARD] = pumped - d.leak * forward + check_forward - wp.where(forward < back, flush, f64(0.0))
    net[rows.BACK] = -pumped - d.leak * back + check_back - wp.where(forward < back, f64(0.0), flush)
    net[rows.CHARGE] = d.charge_size * speed - check_forward - check_back
    net[rows.CHARGE] -= relief_valve(charge, d.charge_setting, d.charge_gain)
    for w in range(4):
        wheel = p[rows.WHEEL_LINE + w]
        traction = orifice(d.traction, forward - wheel, laminar)
        motor = d.motor_size * wheel_rate[w] + d.motor_leak * (wheel - back)
        net[rows.FORWARD] -= traction
        net[rows.BACK] += motor
        net[rows.WHEEL_LINE + w] = traction - motor
    return net


@wp.func
def pump_torque(c: Circuit, swash: f64, supply: f64, drive_swash: f64, across: f64, charge: f64):
    """Torque [N m] that the three pumps take from the engine.

    Args:
        swash: Of pump 2, 0 to 1.
        supply: Its pressure [Pa].
        drive_swash: Of pump 1, −1 to 1.
        across: Pressure [Pa] of the loop's forward side less that of its other side.
        charge: Charge pressure [Pa].
    """
    drive = drive_swash * c.drive.size * across
    steering = swash * c.lines.pump_size * supply / c.engine.steering_efficiency
    charging = c.drive.charge_size * charge / c.drive.charge_efficiency
    return steering + drive + (f64(1.0) - c.drive.efficiency) * wp.abs(drive) + charging


@wp.func
def full_load(e: Engine, speed: f64):
    """Brake torque at full load [N m] at ``speed`` [rad/s]: straight lines between the curve's points."""
    torque = e.torques[10]
    for i in range(10):
        low, high = SPEED[i], SPEED[i + 1]
        if speed > low and speed <= high:
            share = (speed - low) / (high - low)
            torque = (f64(1.0) - share) * e.torques[i] + share * e.torques[i + 1]
    return torque


@wp.func
def droop_slope(e: Engine, unused: f64):
    """Fall [rad/s per N m of brake torque] of the speed that the governor holds."""
    return e.droop * e.set_speed / full_load(e, e.set_speed)


# ---------------------------------------------------------------------------------------------------------------- rates
@wp.func
def stopped(rate: f64, x: f64):
    """``rate`` of a state in [0, 1], stopped at the end that it would leave."""
    leaving = (x >= f64(1.0) and rate > f64(0.0)) or (x <= f64(0.0) and rate < f64(0.0))
    return wp.where(leaving, f64(0.0), rate)


@wp.func
def control_rates(c: Circuit, held: Held, y: vec29, out: vec29, flows: ValveFlows, supply: f64, load: f64):
    """``out`` with the rates of load sensing, spool, compensator, swash plates, and of the engine: an isochronous governor,
    whose set speed falls with the torque where it droops."""
    v, lines, e = c.valve, c.lines, c.engine
    out[rows.LS] = (flows.sensed - y[rows.LS]) * lines.ls_pace
    out[rows.SPOOL] = clipped((held.steer - y[rows.SPOOL]) * v.spool_pace, v.spool_rate)
    reference = v.setting * (f64(1.0) + v.droop * (f64(0.5) - flows.stroke))
    out[rows.COMPENSATOR] = stopped((reference - flows.edge_drop) * v.compensator_rate, y[rows.COMPENSATOR])
    error = wp.min(y[rows.LS] + lines.margin, lines.cutoff) - supply
    stroking = wp.min(wp.max(error * lines.swash_gain, lines.swash_down), lines.swash_up)
    out[rows.SWASH] = stopped(stroking, y[rows.SWASH])
    out[rows.DRIVE_SWASH] = clipped((held.drive - y[rows.DRIVE_SWASH]) * c.drive.pace, c.drive.stroke)
    speed, torque = y[rows.ENGINE], y[rows.TORQUE]
    friction = e.friction_0 + e.friction_1 * speed
    most = held.full_load + friction
    slow = e.set_speed - held.droop * positive(torque - friction) - speed
    demand = wp.min(positive(e.proportional * slow + y[rows.GOVERNOR]), most)
    out[rows.ENGINE] = (torque - friction - load) / e.inertia
    saturated = (y[rows.GOVERNOR] >= most and slow > f64(0.0)) or (y[rows.GOVERNOR] <= f64(0.0) and slow < f64(0.0))
    out[rows.GOVERNOR] = wp.where(saturated, f64(0.0), e.integral * slow)
    out[rows.TORQUE] = wp.min((demand - torque) * e.torque_pace, e.smoke)
    return out


@wp.func
def circuit_rates(c: Circuit, held: Held, y: vec29, soft: vec15, stretch: f64, angle: f64):
    """Time derivatives of the state at the joint ``angle`` [rad]; ``soft``: the oil's compressibility [1/Pa] in the volumes
    and in the hoses' nodes, ``stretch``: the joint's bristle [rad]."""
    out = vec29()
    p = vec11()
    for i in range(11):
        p[i] = wp.max(y[i], c.lines.least)
    pin = angle
    pin_rate = held.rate
    if c.joint.elastic == 1:  # the cylinders turn within play and flexible frame
        pin = y[rows.PIN_ANGLE]
        pin_rate = y[rows.PIN_RATE]
        push = cylinder_torque(c.joint, held.at, pin, pin_rate, stretch, p[rows.PORT_A], p[rows.PORT_B])
        out[rows.PIN_RATE] = (push - series_torque(c.joint, pin, pin_rate, angle, held.rate)) / PISTON_INERTIA
        out[rows.PIN_ANGLE] = pin_rate
    moved = pin - held.pin
    # the valve meets the ports at the cylinders, or at the hoses' other end
    valve_a = p[rows.PORT_A]
    valve_b = p[rows.PORT_B]
    if c.lines.cells > 0:
        valve_a = wp.max(y[rows.NODES], c.lines.least)
        valve_b = wp.max(y[rows.NODES + 1], c.lines.least)
    flows = valve_flows(c.valve, held, y, p[rows.SUPPLY], p[rows.RETURN], valve_a, valve_b)
    into_a = flows.into_a
    into_b = flows.into_b
    if c.lines.cells > 0:
        nodes = vec4(soft[11], soft[12], soft[13], soft[14])
        out, into_a, into_b = hose_rates(c.lines, y, out, nodes, into_a, into_b, p[rows.PORT_A], p[rows.PORT_B])
    cross = c.lines.cylinder_leak * (p[rows.PORT_A] - p[rows.PORT_B])
    swash = unit(y[rows.SWASH])
    net, yielding = vec11(), vec11()
    laminar = c.valve.laminar
    net[rows.SUPPLY] = pump_flow(c.lines, laminar, swash, y[rows.ENGINE], p[rows.SUPPLY], y[rows.LS]) - flows.inflow
    net[rows.RETURN] = flows.returned - return_flow(c.lines, p[rows.RETURN])
    net[rows.RETURN] += check_valve(c.lines.suction, -p[rows.RETURN], f64(0.0), laminar)
    net[rows.PORT_A] = into_a - cross - (held.at.slope_a + held.at.curve_a * moved) * pin_rate
    net[rows.PORT_B] = into_b + cross - (held.at.slope_b + held.at.curve_b * moved) * pin_rate
    net = driveline_flows(c.drive, laminar, net, p, y[rows.DRIVE_SWASH], y[rows.ENGINE], held.wheel_rate)
    # oil and walls yield; a volume that has run empty collects its void first
    for i in range(11):
        volume = c.lines.volume[i]
        if i == rows.PORT_A:
            volume += held.at.volume_a + moved * (held.at.slope_a + f64(0.5) * held.at.curve_a * moved)
        if i == rows.PORT_B:
            volume += held.at.volume_b + moved * (held.at.slope_b + f64(0.5) * held.at.curve_b * moved)
        yielding[i] = volume * soft[i] + c.lines.wall[i]
    if c.lines.pocket > f64(0.0):
        yielding[rows.PORT_A] += c.lines.pocket * ATMOSPHERE / square(wp.max(p[rows.PORT_A] + ATMOSPHERE, f64(5e3)))
    for i in range(11):
        out[i] = net[i] / wp.where(y[i] > c.lines.least, yielding[i], c.lines.empty[i])
    load = pump_torque(c, swash, p[rows.SUPPLY], y[rows.DRIVE_SWASH], p[rows.FORWARD] - p[rows.BACK], p[rows.CHARGE])
    return control_rates(c, held, y, out, flows, p[rows.SUPPLY], load)


# ----------------------------------------------------------------------------------------------------------- integrator
Softness = record("Softness", "", pressure=vec15, value=vec15, slope=vec15)
"""Compressibility [1/Pa] of the oil in volumes and nodes, and its derivative, at pressures [Pa] where it was last found."""


@wp.func
def unknown_softness():
    """A :data:`Softness` that is found at first use."""
    soft = Softness()
    soft.pressure = vec15(f64(-1e30))
    return soft


@wp.func
def refreshed(oil: Oil, p: vec15, s: Softness):
    """``s``, found again where the pressures ``p`` of volumes and nodes have moved."""
    found = s
    for i in range(15):
        if wp.abs(p[i] - s.pressure[i]) > NEAR * (p[i] + ATMOSPHERE):
            value, slope = compressibility(oil, p[i])
            found.pressure[i] = p[i]
            found.value[i] = value
            found.slope[i] = slope
    return found


@wp.func
def held_of(c: Circuit, y: vec29, angle: f64, rate: f64, wheel_rate: vec4, steer: f64, drive: f64):
    """What stays over a call; arguments as in :func:`advance_circuit`."""
    held = Held()
    held.left = wp.where(y[rows.SPOOL] > f64(0.0), 1, 0)
    side = 1 - held.left
    held.curve = wp.where(held.left == 1, c.valve.left, c.valve.right)
    held.inlet = c.valve.inlet[side]
    held.outlet = c.valve.outlet[side]
    held.full_load = full_load(c.engine, y[rows.ENGINE])
    held.droop = droop_slope(c.engine, f64(0.0))
    held.pin = angle
    if c.joint.elastic == 1:
        held.pin = y[rows.PIN_ANGLE]
    held.at = displacement(c.joint.cylinders, held.pin)
    held.rate = rate
    held.wheel_rate = wheel_rate
    held.steer = steer
    held.drive = drive
    return held


@wp.func
def advance_circuit(
    c: Circuit, rule: wp.array2d(dtype=f64), start: vec29, bristle: f64, known: Softness, held: Held, angle: f64,
    duration: f64, steps: int,
):  # fmt: skip
    """State, joint bristle and the oil's softness after ``duration`` [s] in ``steps`` steps.

    Args:
        c: Constants.
        rule: Coefficients of :func:`chebyshev`.
        start: State.
        bristle: Of the joint [rad].
        known: The softness so far, of :func:`unknown_softness` in the beginning.
        held: What stays, of :func:`held_of`.
        angle: Joint angle [rad] at the start.
        duration: Time [s].
        steps: Number of steps.
    """
    y = start
    stretch = bristle
    before = angle
    step = duration / f64(steps)
    soft = known
    for _ in range(steps):
        older = y
        newer = y
        first = vec29()
        for stage in range(rule.shape[0]):
            p = vec15()
            far = f64(-1.0)
            for i in range(15):
                p[i] = wp.max(newer[i + (i // 11) * 10], c.lines.least)
                far = wp.max(far, wp.abs(p[i] - soft.pressure[i]) - NEAR * (p[i] + ATMOSPHERE))
            if far > f64(0.0):
                soft = refreshed(c.oil, p, soft)
            yields = soft.value + wp.cw_mul(soft.slope, p - soft.pressure)
            now = circuit_rates(c, held, newer, yields, stretch, before + rule[stage, 0] * step * held.rate)
            if stage == 0:
                first = now
            after = rule[stage, 1] * y + rule[stage, 2] * newer + rule[stage, 3] * older
            after = after + (step * rule[stage, 4]) * now + (step * rule[stage, 5]) * first
            older = newer
            newer = after
        y = newer
        y[rows.COMPENSATOR] = unit(y[rows.COMPENSATOR])
        y[rows.SWASH] = unit(y[rows.SWASH])
        before += step * held.rate
        if c.joint.elastic == 1:
            p_a, p_b = wp.max(y[rows.PORT_A], c.lines.least), wp.max(y[rows.PORT_B], c.lines.least)
            limit = capacity(c.joint, held.at, y[rows.PIN_ANGLE], y[rows.PIN_RATE], p_a, p_b) / c.joint.presliding
            stretch = clipped(stretch + step * y[rows.PIN_RATE], limit)
        else:
            y[rows.PIN_ANGLE] = before
            y[rows.PIN_RATE] = held.rate
    return y, stretch, soft
