"""Parts that are alike in all families: wheels' forces summed over an axle, valves to tank, filters of the sensors."""

from typing import Any

import warp as wp

from .layout import ANGLE, LAG, LAG_TWO
from .numbers import HALF, ZERO, check, f64


@wp.func
def onto_axle(axle: Any, m: Any, wheel: int, along: wp.float64, across: wp.float64, torque: wp.float64):
    """Add a wheel's force to its axle's (along, across, moment of the pair, torque)."""
    side = HALF * m.track
    if wheel == 1 or wheel == 3:
        side = -side
    axle[0] += along
    axle[1] += across
    axle[2] += torque - side * along
    return axle


@wp.func
def to_tank(m: Any, pressure: wp.float64):
    """Flow [m³/s] out of a side: over the shock valve, K (p − p_s)₊, less what the anti-cavitation check draws in."""
    relief = m.shock_conductance * wp.max(ZERO, pressure - m.shock_pressure)
    suction = check(m.suction_conductance, m.return_preload - m.suction_cracking - pressure, f64(5e4))
    return relief - suction


@wp.func
def sensors(d: Any, x: Any, m: Any, a: wp.float64, b: wp.float64, pump: wp.float64):
    """Derivatives of the measuring chain's first-order filters."""
    d[LAG] = (x[ANGLE] - x[LAG]) / m.angle_filter
    d[LAG_TWO] = (x[LAG] - x[LAG_TWO]) / m.chain_filter
    lag = m.pressure_filter + m.chain_filter
    d[LAG + 1] = (a - x[LAG + 1]) / lag
    d[LAG + 2] = (b - x[LAG + 2]) / lag
    d[LAG + 3] = (pump - x[LAG + 3]) / lag
    return d
