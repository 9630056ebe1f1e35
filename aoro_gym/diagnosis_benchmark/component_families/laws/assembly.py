"""The vehicle around a family's laws: frames, wheels, closed loop of the drive, engine, and rods between them."""

from typing import Any

import warp as wp

from aoro_gym.diagnosis_benchmark.independent.laws import layout as at
from aoro_gym.diagnosis_benchmark.independent.laws.bodies import frames, stop_torque, wheel_motion
from aoro_gym.diagnosis_benchmark.independent.laws.geometry import chambers
from aoro_gym.diagnosis_benchmark.independent.laws.numbers import HALF, ONE, ZERO, f64

from . import places
from .disturbances import grip, hinge_torque, slew_torque
from .places import HINGE, SEAL, SIDE_A, SIDE_B, TIRE, State, vec2d, vec4d

Inputs = wp.types.vector(length=at.N_INPUTS, dtype=wp.float64)


@wp.func
def wheel_load(m: Any, wheel: int):
    """Load [N] of a wheel: share of its axle, skewed over a diagonal if the arms stand unevenly, tilted to the left."""
    load = m.load_rear
    if wheel < 2:
        load = m.load_front
    skew = m.load_skew
    if wheel == 1 or wheel == 2:
        skew = -skew
    tilt = m.load_tilt
    if wheel == 1 or wheel == 3:
        tilt = -tilt
    return wp.max(load * (ONE + skew) + tilt, f64(0.02) * load)


@wp.func
def loop_rates(x: Any, m: Any, motors: wp.float64):
    """Rates [Pa/s] of the closed loop; ``motors``: flow through all motors forwards.

    Charge checks and reliefs are linear in their drop; leakage to the case from either side.
    """
    forward = x[at.LOOP_FORWARD]
    back = x[at.LOOP_RETURN]
    check = f64(2e-9)
    flow = x[at.PUMP_FLOW] - motors - m.loop_leakage * (forward - back)
    into = check * wp.max(m.charge_pressure - forward, ZERO) - check * wp.max(forward - m.loop_relief, ZERO)
    out = check * wp.max(m.charge_pressure - back, ZERO) - check * wp.max(back - m.loop_relief, ZERO)
    charge_relief = f64(5e-10) * wp.max(back - m.charge_pressure, ZERO) * wp.where(forward > back, ONE, ZERO)
    other_relief = f64(5e-10) * wp.max(forward - m.charge_pressure, ZERO) * wp.where(back > forward, ONE, ZERO)
    return vec2d((flow + into - other_relief) / m.loop_compliance, (-flow + out - charge_relief) / m.loop_compliance)


def assemble(laws: Any, machine: Any) -> Any:
    """Derivative of all states by a family's laws.

    ``laws``: module with ``tire``, ``resistance``, ``hinge``, ``seals``, ``rods``, ``engine`` and ``hydraulics``.
    ``machine``: Warp struct of its constants.
    """
    tire, resistance, hinge, seals = laws.tire, laws.resistance, laws.hinge, laws.seals
    rods, engine, hydraulics = laws.rods, laws.engine, laws.hydraulics

    @wp.func
    def derivative(x: State, m: machine, inputs: Inputs):
        d = State()
        c = chambers(x[at.ROD], m)
        rear = vec4d()
        front = vec4d()
        motors = ZERO
        drop = x[at.LOOP_FORWARD] - x[at.LOOP_RETURN]
        for wheel in range(4):
            load = wheel_load(m, wheel)
            t = tire(x, m, wheel, wheel_motion(x, m, wheel), load * grip(m, inputs))
            for i in range(3):
                d[TIRE + 3 * wheel + i] = t[i]
            side = HALF * m.track
            if wheel == 1 or wheel == 3:
                side = -side
            motor = m.motor_displacement
            force = vec4d(t[3], t[4], t[5] - side * t[3], ZERO)
            if wheel < 2:
                motor *= ONE - m.free_axle
                front += force
            else:
                rear += force
            motors += motor * x[at.WHEEL + wheel]
            against = m.tire_radius * t[3] + resistance(x, m, wheel, load)
            d[at.WHEEL + wheel] = (motor * drop - against) / m.wheel_inertia
        loop = loop_rates(x, m, motors)
        d[at.LOOP_FORWARD] = loop[0]
        d[at.LOOP_RETURN] = loop[1]
        wanted = inputs[at.DRIVE] * m.drive_displacement * x[at.ENGINE]
        d[at.PUMP_FLOW] = (wanted - x[at.PUMP_FLOW]) / m.drive_lag
        front[3] = slew_torque(m, inputs)
        rod = rods(x, m)
        bearing = hinge(x, m)
        seal = seals(x, m, c, inputs)
        d[places.CREEP] = rod[1]
        d[HINGE] = bearing[1]
        d[SEAL] = seal[1]
        d[SEAL + 1] = seal[2]
        cylinders = x[SIDE_A] * c[2] + x[SIDE_B] * c[3] - seal[0]
        d = frames(d, x, m, rear, front, rod[0] - bearing[0] + hinge_torque(x, m, inputs), cylinders)
        d[at.ROD_RATE] = (cylinders - rod[0] + stop_torque(x, m)) / m.rod_inertia
        d[at.LAG_TWO] = d[at.ANGLE]
        d = hydraulics(d, x, m, inputs, c)
        driven = wp.abs(x[at.PUMP_FLOW] * drop) / x[at.ENGINE]
        supply = wp.max(x[places.SUPPLY], ZERO) * x[places.STROKE] * m.pump_displacement
        shaft = engine(x, m, m.engine_idle_torque + (driven + supply) / m.pump_efficiency)
        d[at.ENGINE] = shaft[0]
        d[at.GOVERNOR] = shaft[1]
        return d

    return derivative


@wp.func
def at_rest(x: State, m: Any, angle: wp.float64):
    """States at rest that all families share: pressures, pump at its standby stroke, tires that hold the slope."""
    for i in range(4):
        x[TIRE + 3 * i] = -m.slope_along * m.mass_total / (f64(4.0) * m.stiffness_along)
        x[TIRE + 3 * i + 1] = m.slope_across * m.mass_total / (f64(4.0) * m.stiffness_across)
    x[SIDE_A] = m.rest_pressure
    x[SIDE_B] = m.rest_pressure
    x[places.SUPPLY] = m.margin
    x[places.STROKE] = m.standby_stroke
    x[places.COMPENSATOR] = ONE
    return x


@wp.func
def nothing_remembered(x: State, m: Any):
    """Value of which the integrator keeps a history: none is needed here."""
    return x[places.SPOOL]
