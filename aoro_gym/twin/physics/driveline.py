"""The hydrostatic driveline: pump 1 and four wheel motors in a closed loop, with charge, flushing and reliefs.

Positive drive signal pumps from the return main R to the forward main F; each motor takes oil from F through its
traction valve and gives it to R. Machine section ``driveline``. Source: Merritt (1967) ch. 4 (pump-controlled motor).
"""

# pyright: reportGeneralTypeIssues=false, reportInvalidTypeForm=false
import warp as wp

from aoro_gym.twin.physics.fluid import Gas, Oil, check_valve, fill, free_gas, orifice, pressure, relief_valve
from aoro_gym.twin.physics.laws import option

SECOND_GEAR_FRONT = option("second_gear", "front")


@wp.struct
class Driveline:
    """Parameters of the driveline (displacements in m³/rad)."""

    main_volume: float  # [m³] a side
    main_compliance: float  # [m³/Pa]
    wheel_hose_volume: float  # [m³] traction valve to motor
    wheel_hose_compliance: float  # [m³/Pa]
    pump_displacement: float
    pump_time_constant: float  # [s]
    pump_stroke_time: float  # [s] zero to full
    pump_leakage: float  # [m³/s/Pa] each side to the case
    pump_cross_leakage: float  # [m³/s/Pa]
    pump_mechanical_efficiency: float  # [-]
    charge_displacement: float
    charge_relief_pressure: float  # [Pa]
    charge_relief_ramp: float  # [Pa]
    charge_relief_flow: float  # [m³/s]
    charge_volume: float  # [m³]
    charge_compliance: float  # [m³/Pa]
    charge_cv_check: float
    charge_check_crack: float  # [Pa]
    charge_mechanical_efficiency: float  # [-]
    flush_shift_pressure: float  # [Pa]
    flush_pressure: float  # [Pa]
    flush_ramp: float  # [Pa]
    flush_flow: float  # [m³/s]
    relief_pressure: float  # [Pa] cross-port
    relief_ramp: float  # [Pa]
    relief_flow: float  # [m³/s]
    traction_cv: float
    traction_time_constant: float  # [s]
    motor_displacement: float
    motor_leakage: float  # [m³/s/Pa]
    motor_mechanical_efficiency: float  # [-]
    motor_shift_time: float  # [s]
    brake_disc_torque: float  # [N m]
    brake_parking_torque: float  # [N m]
    brake_presliding_stiffness: float  # [N m/rad]
    brake_presliding_damping: float  # [N m s/rad]
    second_gear_law: int  # by the numbers of aoro_gym.machine.laws


@wp.struct
class DrivelineState:
    forward: float  # [Pa] content of main F
    back: float  # [Pa] content of main R
    wheel_fl: float  # [Pa] content of the hose between traction valve and motor
    wheel_fr: float
    wheel_rl: float
    wheel_rr: float
    charge: float  # [Pa]


@wp.struct
class DrivelineGas:
    """Free gas of the circuit's volumes at the start of a main step."""

    forward: Gas
    back: Gas
    wheel_fl: Gas
    wheel_fr: Gas
    wheel_rl: Gas
    wheel_rr: Gas
    charge: Gas


@wp.struct
class DrivelineControl:
    """What stays constant over one main step."""

    swash: float  # [-] −1 … 1 of pump 1
    displacement_front: float  # [m³/rad] a front motor
    displacement_rear: float
    traction: wp.vec4  # [-] openings
    engine_speed: float  # [rad/s]


@wp.func
def motor_shares(m: Driveline, gear: float):
    """Shares of their displacement that the front and the rear motors have in a ``gear`` (1, 2 or 3).

    A motor of two cams, half of whose pistons the shift valve short-circuits, has half of it (Poclain MSE18). All of it in
    first gear, half on all wheels in third; second gear halves one axle, of which the paper does not say which: by the law
    ``second_gear`` the rear one or the front one. Where no wheel slips each wheel turns at the same rate ω and each motor
    sees the same Δp, so a flow Q makes ω = Q / (2 D (s_f + s_r)) and the axles pull as s_f to s_r.
    """
    second_front = float(1.0)
    second_rear = float(0.5)
    if m.second_gear_law == SECOND_GEAR_FRONT:
        second_front = 0.5
        second_rear = 1.0
    front = wp.where(gear > 2.5, 0.5, wp.where(gear > 1.5, second_front, 1.0))
    rear = wp.where(gear > 2.5, 0.5, wp.where(gear > 1.5, second_rear, 1.0))
    return front, rear


@wp.func
def driveline_gas(oil: Oil, s: DrivelineState):
    """Free gas of the circuit's volumes in the state ``s``."""
    gas = DrivelineGas()
    gas.forward = free_gas(oil, s.forward)
    gas.back = free_gas(oil, s.back)
    gas.wheel_fl = free_gas(oil, s.wheel_fl)
    gas.wheel_fr = free_gas(oil, s.wheel_fr)
    gas.wheel_rl = free_gas(oil, s.wheel_rl)
    gas.wheel_rr = free_gas(oil, s.wheel_rr)
    gas.charge = free_gas(oil, s.charge)
    return gas


@wp.func
def motor_pressures(oil: Oil, s: DrivelineState):
    """Pressure difference [Pa] across every motor."""
    back = pressure(oil, s.back)
    return wp.vec4(
        pressure(oil, s.wheel_fl) - back,
        pressure(oil, s.wheel_fr) - back,
        pressure(oil, s.wheel_rl) - back,
        pressure(oil, s.wheel_rr) - back,
    )


@wp.func
def motor_hose_step(
    m: Driveline, oil: Oil, gas: Gas, opening: float, displacement: float, rate: float, main: float, back: float,
    content: float, dt: float,
):
    """Hose and motor of one wheel over one substep: state [Pa], flow from main F, flow into main R [m³/s].

    Motor: Q = D ω + c Δp, so that shifting D neither makes nor loses oil; its torque D Δp uses the same D. Out of a
    void in its hose it passes on no more than what comes in, and out of a void in main R nothing.
    """
    p = pressure(oil, content)
    taken = orifice(opening * m.traction_cv, main - p, oil.laminar_pressure)
    given = displacement * rate + m.motor_leakage * (p - back)
    given = wp.where(content < oil.void_pressure, wp.min(given, taken), given)
    given = wp.where(back <= oil.void_pressure, wp.max(given, 0.0), given)
    filled = fill(oil, gas, content, taken - given, dt, m.wheel_hose_volume, m.wheel_hose_compliance)
    return filled, taken, given


@wp.func
def driveline_step(
    m: Driveline, oil: Oil, gas: DrivelineGas, c: DrivelineControl, rates: wp.vec4, s: DrivelineState, dt: float
):
    """The closed loop over one substep; ``rates`` [rad/s] of the wheels relative to their arms (fl, fr, rl, rr)."""
    lam = oil.laminar_pressure
    p_f = pressure(oil, s.forward)
    p_r = pressure(oil, s.back)
    p_c = pressure(oil, s.charge)
    hose_fl, taken_fl, given_fl = motor_hose_step(
        m, oil, gas.wheel_fl, c.traction[0], c.displacement_front, rates[0], p_f, p_r, s.wheel_fl, dt
    )
    hose_fr, taken_fr, given_fr = motor_hose_step(
        m, oil, gas.wheel_fr, c.traction[1], c.displacement_front, rates[1], p_f, p_r, s.wheel_fr, dt
    )
    hose_rl, taken_rl, given_rl = motor_hose_step(
        m, oil, gas.wheel_rl, c.traction[2], c.displacement_rear, rates[2], p_f, p_r, s.wheel_rl, dt
    )
    hose_rr, taken_rr, given_rr = motor_hose_step(
        m, oil, gas.wheel_rr, c.traction[3], c.displacement_rear, rates[3], p_f, p_r, s.wheel_rr, dt
    )

    crossed = relief_valve(p_f - p_r, m.relief_pressure, m.relief_ramp, m.relief_flow) - relief_valve(
        p_r - p_f, m.relief_pressure, m.relief_ramp, m.relief_flow
    )
    charge_f = check_valve(m.charge_cv_check, p_c - p_f, m.charge_check_crack, lam)
    charge_r = check_valve(m.charge_cv_check, p_c - p_r, m.charge_check_crack, lam)
    # the shuttle opens the low side to the flushing relief once both sides differ
    shift = wp.clamp((1.0 / m.flush_shift_pressure) * wp.abs(p_f - p_r) - 1.0, 0.0, 1.0)
    flush = shift * relief_valve(wp.min(p_f, p_r), m.flush_pressure, m.flush_ramp, m.flush_flow)
    flush_f = wp.where(p_f < p_r, flush, 0.0)

    # all but the pump; out of a void the pump, like a motor, moves no more than what comes in
    q_f = charge_f - crossed - flush_f - m.pump_leakage * p_f - (taken_fl + taken_fr + taken_rl + taken_rr)
    q_r = charge_r + crossed - (flush - flush_f) - m.pump_leakage * p_r + (given_fl + given_fr + given_rl + given_rr)
    pumped = c.swash * m.pump_displacement * c.engine_speed - m.pump_cross_leakage * (p_f - p_r)
    pumped = wp.where(s.back < oil.void_pressure, wp.min(pumped, wp.max(q_r, 0.0)), pumped)
    pumped = wp.where(s.forward < oil.void_pressure, wp.max(pumped, -wp.max(q_f, 0.0)), pumped)
    q_f += pumped
    q_r -= pumped
    q_c = (
        m.charge_displacement * c.engine_speed
        - charge_f
        - charge_r
        - relief_valve(p_c, m.charge_relief_pressure, m.charge_relief_ramp, m.charge_relief_flow)
    )
    out = DrivelineState()
    out.wheel_fl = hose_fl
    out.wheel_fr = hose_fr
    out.wheel_rl = hose_rl
    out.wheel_rr = hose_rr
    out.forward = fill(oil, gas.forward, s.forward, q_f, dt, m.main_volume, m.main_compliance)
    out.back = fill(oil, gas.back, s.back, q_r, dt, m.main_volume, m.main_compliance)
    out.charge = fill(oil, gas.charge, s.charge, q_c, dt, m.charge_volume, m.charge_compliance)
    return out


@wp.func
def driveline_displace(m: Driveline, oil: Oil, c: DrivelineControl, angles: wp.vec4, s: DrivelineState):
    """State after the wheels have turned by ``angles`` [rad] with pump and valves shut."""
    hose = m.wheel_hose_volume
    walls = m.wheel_hose_compliance
    front = c.displacement_front
    rear = c.displacement_rear
    given = front * (angles[0] + angles[1]) + rear * (angles[2] + angles[3])
    out = s
    out.wheel_fl = fill(oil, free_gas(oil, s.wheel_fl), s.wheel_fl, -front * angles[0], 1.0, hose, walls)
    out.wheel_fr = fill(oil, free_gas(oil, s.wheel_fr), s.wheel_fr, -front * angles[1], 1.0, hose, walls)
    out.wheel_rl = fill(oil, free_gas(oil, s.wheel_rl), s.wheel_rl, -rear * angles[2], 1.0, hose, walls)
    out.wheel_rr = fill(oil, free_gas(oil, s.wheel_rr), s.wheel_rr, -rear * angles[3], 1.0, hose, walls)
    out.back = fill(oil, free_gas(oil, s.back), s.back, given, 1.0, m.main_volume, m.main_compliance)
    return out


@wp.func
def pump_torque(displacement: float, drop: float, efficiency: float):
    """Shaft torque [N m] that a pump takes: D Δp + (1 − η)|D Δp|; less is given back when it is driven."""
    return displacement * drop + (1.0 - efficiency) * wp.abs(displacement * drop)
