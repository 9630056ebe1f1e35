"""Wheels that a driveline outside of the twin turns: what then stands for the digital one.

The cut lies at the flange between hub and wheel. The torque there is what is left of the motor's D Δp after the friction of
motor, reduction, hub and brakes, so that with measured torques the twin has none of these and loses nothing twice. It acts
on the wheel and, in reverse, on its arm. The twin keeps wheels, tires and ground; arms, joint and the oil in their
cylinders; pump 2. Pump 1, motors, brakes and engine are outside; of the engine the twin takes the speed, at which pump 2
turns.

What is measured stands in the twin's state and holds until it is set again: the rows ``HOSE_…`` are torques [N m] here, not
pressures, and ``ENGINE_SPEED`` is the measured speed. :func:`aoro_gym.twin.kernels.build.build` puts the functions of this
module in place of those that the digital driveline needs.
"""

# pyright: reportGeneralTypeIssues=false, reportInvalidTypeForm=false
from typing import Any

import warp as wp

from aoro_gym.twin.kernels.laws import with_laws
from aoro_gym.twin.kernels.state import Actuators
from aoro_gym.twin.physics.driveline import Driveline, DrivelineControl, DrivelineGas, DrivelineState
from aoro_gym.twin.physics.engine import Engine, EngineState
from aoro_gym.twin.physics.fluid import Oil
from aoro_gym.twin.records import MachineRecord


@wp.func
def measured_with_laws(laws: Any, m: MachineRecord):
    """``m`` without what brakes, motors and hubs lose: torques are measured behind it."""
    out = with_laws(laws, m)
    out.driveline.brake_disc_torque = 0.0
    out.driveline.brake_parking_torque = 0.0
    out.driveline.motor_mechanical_efficiency = 1.0
    return out


@wp.func
def measured_driveline_control(displacement: float, old: Actuators, new: Actuators, engine_speed: float):
    """The control of a driveline whose state is torques: a motor gives 1 N m a N m."""
    control = DrivelineControl()
    control.displacement_front = 1.0
    control.displacement_rear = 1.0
    control.engine_speed = engine_speed
    return control


@wp.func
def measured_motor_pressures(oil: Oil, s: DrivelineState):
    """Torque [N m] at every hub."""
    return wp.vec4(s.wheel_fl, s.wheel_fr, s.wheel_rl, s.wheel_rr)


@wp.func
def unknown_motor_pressures(oil: Oil, s: DrivelineState):
    """Nothing, for the outputs: pressures of the driveline outside are not known."""
    return wp.vec4()


@wp.func
def measured_driveline_step(
    m: Driveline, oil: Oil, gas: DrivelineGas, c: DrivelineControl, rates: wp.vec4, s: DrivelineState, dt: float
):
    """Torques hold over a substep."""
    return s


@wp.func
def measured_driveline_displace(m: Driveline, oil: Oil, c: DrivelineControl, angles: wp.vec4, s: DrivelineState):
    """Torques hold however the wheels turn."""
    return s


@wp.func
def measured_engine_step(m: Engine, s: EngineState, load: float, dt: float):
    """The engine's speed holds under any load."""
    return s
