"""What may go wrong outside of the catalogue: terms of every family, nought on a healthy machine."""

from typing import Any

import warp as wp

from .layout import TIME
from .numbers import HALF, ONE, ZERO, f64, orifice
from .oil import ATMOSPHERE, VACUUM


@wp.func
def after(inputs: Any, start: wp.float64):
    """1 after ``start`` [s], 0 before."""
    on = ZERO
    if inputs[TIME] >= start:
        on = ONE
    return on


@wp.func
def air_share(m: Any, inputs: Any):
    """Volume share of undissolved air; foam from the tank passes for a while."""
    burst = after(inputs, m.burst_start) - after(inputs, m.burst_start + m.burst_duration)
    return m.air + m.burst_air * burst


@wp.func
def pocket(m: Any, pressure: wp.float64, angle: wp.float64, side: wp.float64):
    """Compliance [m³/Pa] of a trapped air pocket, isothermal: C = V₀ p₀/p².

    It wanders from side A to B as the joint turns to the left past an angle.
    """
    absolute = wp.max(pressure + ATMOSPHERE, f64(10.0) * VACUUM)
    here = HALF * (ONE - side * wp.tanh((angle - m.pocket_angle) / f64(0.05)))
    return m.pocket_volume * here * ATMOSPHERE / (absolute * absolute)


@wp.func
def stuck_shock_valve(m: Any, inputs: Any, pressure: wp.float64):
    """Flow [m³/s] from side A to tank through a shock valve that has not closed."""
    return after(inputs, m.shock_start) * orifice(m.shock_leak, pressure, m.transition)


@wp.func
def bent_rod(m: Any, angle: wp.float64):
    """Additional friction [N] of the left cylinder where its bent rod passes the gland."""
    away = (angle - m.bend_angle) / f64(0.12)
    return m.bend_force * wp.exp(-away * away)


@wp.func
def ripple(m: Any, inputs: Any):
    """Relative swing of the pump's flow: its case on soft mounts at resonance."""
    return ONE + m.ripple * wp.sin(f64(6.2831853) * m.ripple_frequency * inputs[TIME])


@wp.func
def swinging_load(m: Any, inputs: Any):
    """Yaw torque [N m] on the front frame of a load that swings under the crane."""
    return m.swing_torque * wp.sin(f64(6.2831853) * m.swing_frequency * inputs[TIME] + m.swing_phase)


@wp.func
def wheel_load(m: Any, wheel: int):
    """Load of a wheel [N] as far as it grips: wheel 1 may stand on ice."""
    load = m.load_rear
    if wheel < 2:
        load = m.load_front
    if wheel == 1:
        load = load * m.grip
    return load
