"""What happens to a machine from outside of the catalogue of effects; nought unless a run asks for it."""

from typing import Any

import warp as wp

from aoro_gym.diagnosis_benchmark.independent.laws.layout import ANGLE, TIME
from aoro_gym.diagnosis_benchmark.independent.laws.numbers import HALF, ONE, ZERO, f64, orifice, unit

from .places import ATMOSPHERE, BAR


@wp.func
def window(time: wp.float64, start: wp.float64, length: wp.float64):
    """1 during a window that opens and closes over 20 ms, else 0."""
    ramp = f64(0.02)
    return unit((time - start) / ramp) * unit((start + length - time) / ramp)


@wp.func
def hinge_torque(x: Any, m: Any, inputs: Any):
    """Torque [N m] on the joint: of something bent round it, of something jammed in it, and of a push from aside."""
    torque = -m.bent_stiffness * (x[ANGLE] - m.bent_angle)
    depth = wp.max(x[ANGLE] * m.jam_side - m.jam_angle, ZERO)
    torque -= m.jam_side * m.jam_stiffness * depth
    time = inputs[TIME]
    return torque + m.push_torque * window(time, m.push_start, m.push_length)


@wp.func
def slew_torque(m: Any, inputs: Any):
    """Torque [N m] on the front frame of a boom that is sped up and braked: a doublet."""
    time = inputs[TIME]
    first = window(time, m.slew_start, m.slew_length)
    return m.slew_torque * (first - window(time, m.slew_start + m.slew_length, m.slew_length))


@wp.func
def grip(m: Any, inputs: Any):
    """Share of the ground's friction that is left once its crust breaks."""
    return ONE - m.crust_loss * unit((inputs[TIME] - m.crust_start) / f64(0.02))


@wp.func
def other_flow(supply: wp.float64, m: Any, inputs: Any):
    """Flow [m³/s] that another consumer takes from the supply."""
    share = window(inputs[TIME], m.other_start, m.other_length)
    return share * orifice(m.other_conductance, wp.max(supply, ZERO), BAR)


@wp.func
def accumulator(pressure: wp.float64, m: Any):
    """Compliance [m³/Pa] of a gas accumulator on side A: V₀ (p₀/p)^(1/n)/(n p) above its precharge, n = 1.3."""
    precharge = m.accumulator_precharge + ATMOSPHERE
    absolute = pressure + ATMOSPHERE
    open = unit((absolute - precharge) / (f64(0.5) * BAR) + HALF)
    size = m.accumulator_volume * wp.pow(precharge / wp.max(absolute, precharge), ONE / f64(1.3))
    return open * size / (f64(1.3) * wp.max(absolute, precharge))


@wp.func
def pinch(x: Any, m: Any):
    """Added resistance [Pa s/m³] of a hose to side A that the joint pinches, the more the closer it is to an angle."""
    away = (x[ANGLE] - m.pinch_angle) / f64(0.2)
    return m.pinch_resistance * wp.exp(-away * away)


@wp.func
def pulsation(m: Any, inputs: Any):
    """Factor of the pump's flow with a dead piston: one dent a revolution."""
    return ONE + m.dead_piston * wp.sin(m.engine_speed * inputs[TIME])
