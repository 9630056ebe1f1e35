"""Closed hydrostatic loop with four motors in parallel, wheels, and the diesel engine with its governor."""

from typing import Any

import warp as wp

from .layout import DRIVE, ENGINE, GOVERNOR, LOOP_FORWARD, LOOP_RETURN, PUMP_FLOW, TIME, WHEEL
from .numbers import HALF, ONE, ZERO, f64, unit


@wp.func
def wheel_brake(m: Any, wheel: int):
    """Resisting torque [N m] of a wheel; a stone in front of wheel 0 holds it."""
    torque = m.wheel_brake
    if wheel == 0:
        torque += m.stone_torque
    return torque


@wp.func
def driveline(d: Any, x: Any, m: Any, inputs: Any, tires: Any):
    """Derivatives of wheels and loop. ``tires``: the four longitudinal forces on the machine [N].

    J Ω̇ = D Δp − M_b tanh(Ω/Ω₀) − R F_x. V/β ṗ = ±(Q_p − D ΣΩ − c Δp) + K (p_c − p)₊ − K (p − p_r)₊: charge check
    valves and relief valves. A shuttle flushes the side of lower pressure from 2 bar above the charge pressure on.
    """
    drop = x[LOOP_FORWARD] - x[LOOP_RETURN]
    speeds = ZERO
    for wheel in range(4):
        speed = x[WHEEL + wheel]
        speeds += speed
        brake = wheel_brake(m, wheel)
        smooth = wp.max(m.brake_speed, brake / (m.wheel_inertia * f64(5e3)))  # a rate of 5000/s at most
        resisting = brake * wp.tanh(speed / smooth)
        d[WHEEL + wheel] = (m.motor_displacement * drop - resisting - m.tire_radius * tires[wheel]) / m.wheel_inertia
    flow = x[PUMP_FLOW] - m.motor_displacement * speeds - m.loop_leakage * drop
    filling = m.loop_modulus / m.loop_volume
    forward = m.charge_conductance * wp.max(ZERO, m.charge_pressure - x[LOOP_FORWARD])
    back = m.charge_conductance * wp.max(ZERO, m.charge_pressure - x[LOOP_RETURN])
    forward -= m.charge_conductance * wp.max(ZERO, x[LOOP_FORWARD] - m.loop_relief)
    back -= m.charge_conductance * wp.max(ZERO, x[LOOP_RETURN] - m.loop_relief)
    shuttle = unit(HALF - drop / f64(8e5))  # share of the flushing that drains the forward side
    forward -= shuttle * m.flush_conductance * wp.max(ZERO, x[LOOP_FORWARD] - m.charge_pressure - f64(2e5))
    back -= (ONE - shuttle) * m.flush_conductance * wp.max(ZERO, x[LOOP_RETURN] - m.charge_pressure - f64(2e5))
    d[LOOP_FORWARD] = filling * (flow + forward)
    d[LOOP_RETURN] = filling * (back - flow)
    d[PUMP_FLOW] = (inputs[DRIVE] * m.drive_flow * x[ENGINE] / m.engine_speed - x[PUMP_FLOW]) / m.drive_lag
    return d


@wp.func
def drive_power(x: Any):
    """Power [W] that the drive pump takes."""
    return wp.max((x[LOOP_FORWARD] - x[LOOP_RETURN]) * x[PUMP_FLOW], ZERO)


@wp.func
def engine(d: Any, x: Any, m: Any, inputs: Any, power: wp.float64):
    """Derivatives of the engine: J ω̇ = M − P/ω; governor M = M_i + K (ω_set (1 − droop M/M_r) − ω), M_i slow.

    ``power`` [W] that the pumps take. The set speed swings by ``hunting`` where the governor hunts.
    """
    wave = ONE + m.hunting * wp.sin(f64(6.2831853) * m.hunting_frequency * inputs[TIME])
    load = power / x[ENGINE]
    wanted = m.engine_speed * wave * (ONE - m.engine_droop * load / m.engine_torque)
    error = wanted - x[ENGINE]
    torque = wp.clamp(x[GOVERNOR] + m.governor_gain * error, ZERO, m.engine_torque)
    d[ENGINE] = (torque - m.engine_idle_torque - load) / m.engine_inertia
    d[GOVERNOR] = m.governor_gain * error / m.governor_time
    return d
