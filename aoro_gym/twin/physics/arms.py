"""The pendulum arms' cylinders: proportional section with a compensator, and load-holding valves.

By default the compensator is ideal: the edge's drop is its setting, or what supply and load leave. By the law ``arm_valve``
= ``section`` it is that of the steering section, in series with the edge, with its lag and its stops
(:func:`~aoro_gym.twin.physics.steering_valve.compensator_step`): a supply that jumps passes through until it has closed. At
rest both pass the same flow, C √Δp_set, wherever it is not fully open; where it is, the open compensator takes its part of
the drop. With a lag of 2 to 10 ms supply and load hunt for each other under pump 2's first-order control, as load-sensing
systems may (Krus, *On Load Sensing Fluid Power Systems*, 1988). The spool follows its signal by a lag within its rate limit
either way.

Positive command extends the cylinder: the wheel goes down, the frame up. Machine section ``arm``.
"""

# pyright: reportGeneralTypeIssues=false, reportInvalidTypeForm=false
import warp as wp

from aoro_gym.twin.physics.cylinders import Linkage, cylinder_extension
from aoro_gym.twin.physics.fluid import Gas, Oil, fill_chamber, free_gas, inverse_root, orifice, pressure, relief_valve
from aoro_gym.twin.physics.friction import dry_friction, end_stop, seal_friction
from aoro_gym.twin.physics.laws import option
from aoro_gym.twin.physics.steering_circuit import Steering
from aoro_gym.twin.physics.steering_valve import compensator_step

DYNAMIC_SECTION = option("arm_valve", "section")


@wp.struct
class Arm:
    """Parameters of a pendulum arm (all four alike): geometry, friction and hydraulics."""

    length: float  # [m] pivot to wheel centre
    swing: float  # [rad] half range about level
    pivot_lateral: float  # [m]
    stop_torsional_stiffness: float  # [N m/rad]
    stop_torsional_damping: float  # [N m s/rad]
    presliding_stiffness: float  # [N m/rad]
    presliding_damping: float  # [N m s/rad]
    rod_rest_pressure: float  # [Pa]
    hose_volume: float  # [m³] a side
    hose_compliance: float  # [m³/Pa]
    cylinder_linkage: Linkage
    cylinder_bore_area: float  # [m²]
    cylinder_annulus_area: float  # [m²]
    cylinder_dead_volume: float  # [m³] an end
    cylinder_seal_preload: float  # [N]
    cylinder_seal_pressure_coefficient: float  # [N/Pa]
    cylinder_seal_static_ratio: float  # [-]
    cylinder_seal_stribeck_velocity: float  # [m/s]
    cylinder_seal_viscous: float  # [N s/m]
    valve_cv: float  # [m³/s/√Pa] an edge, fully open
    valve_pressure_drop: float  # [Pa] that the compensator leaves over the edge
    valve_dead_band: float  # [-]
    valve_time_constant: float  # [s]
    valve_rate_limit: float  # [1/s]
    valve_holding_pressure: float  # [Pa] load-holding valve opens unpiloted
    valve_holding_ramp: float  # [Pa]
    valve_pilot_ratio: float  # [-]
    valve_port_relief: float  # [Pa]
    valve_port_ramp: float  # [Pa]
    valve_port_flow: float  # [m³/s]


@wp.struct
class ArmValve:
    """What only the law ``arm_valve`` needs of an arm's valve section."""

    arm_valve_law: int  # by the numbers of aoro_gym.machine.laws
    pressure_drop: float  # [Pa] setting of the compensator
    compensator_time_constant: float  # [s] full stroke under an excess of one setting
    cv_compensator: float  # [m³/s/√Pa] fully open


@wp.struct
class ArmState:
    bore: float  # [Pa] content
    rod: float  # [Pa] content
    compensator: float  # [-] 0 (closed) … 1 (open), of dynamic sections


@wp.struct
class ArmGas:
    """Free gas of both chambers at the start of a main step."""

    bore: Gas
    rod: Gas


@wp.struct
class ArmGeometry:
    """Chambers at one arm angle, and the valve's opening over one main step."""

    volume_bore: float  # [m³]
    volume_rod: float
    displacement_bore: float  # [m³/rad] dV/dφ (negative: the cylinder shortens as the wheel rises)
    displacement_rod: float
    lever: float  # [m] dL/dγ
    opening: float  # [-] −1 (retract) … 1 (extend), beyond the dead band


@wp.func
def arm_geometry(m: Arm, angle: float, spool: float):
    """Chambers of an arm's cylinder at arm ``angle`` [rad]; ``spool`` [-1, 1] of its valve."""
    extension, lever = cylinder_extension(m.cylinder_linkage, -angle)
    fixed = m.hose_volume + m.cylinder_dead_volume
    g = ArmGeometry()
    g.volume_bore = fixed + m.cylinder_bore_area * extension
    g.volume_rod = fixed + m.cylinder_annulus_area * (m.cylinder_linkage.stroke - extension)
    g.displacement_bore = -m.cylinder_bore_area * lever
    g.displacement_rod = m.cylinder_annulus_area * lever
    g.lever = lever
    g.opening = wp.sign(spool) * wp.max(wp.abs(spool) - m.valve_dead_band, 0.0) / (1.0 - m.valve_dead_band)
    return g


@wp.func
def arm_gas(oil: Oil, s: ArmState):
    """Free gas of both chambers in the state ``s``."""
    gas = ArmGas()
    gas.bore = free_gas(oil, s.bore)
    gas.rod = free_gas(oil, s.rod)
    return gas


@wp.func
def arm_oil_torque(oil: Oil, g: ArmGeometry, s: ArmState):
    """Torque [N m] of the oil on the arm, positive raising the wheel: Σ p dV/dφ."""
    return pressure(oil, s.bore) * g.displacement_bore + pressure(oil, s.rod) * g.displacement_rod


@wp.func
def arm_seal_capacity(m: Arm, oil: Oil, g: ArmGeometry, s: ArmState, rate: float):
    """Friction torque [N m] at which an arm's cylinder breaks away or slides."""
    return g.lever * seal_friction(
        m.cylinder_seal_preload,
        m.cylinder_seal_pressure_coefficient,
        wp.max(pressure(oil, s.bore), 0.0) + wp.max(pressure(oil, s.rod), 0.0),
        m.cylinder_seal_static_ratio,
        m.cylinder_seal_stribeck_velocity,
        g.lever * rate,
    )


@wp.func
def arm_torque(m: Arm, g: ArmGeometry, angle: float, rate: float, deflection: float, capacity: float, oil_torque: float):
    """Torque [N m] that raises an arm: oil, seal friction, end stops."""
    return (
        oil_torque
        + dry_friction(deflection, rate, capacity, m.presliding_stiffness, m.presliding_damping)
        - m.cylinder_seal_viscous * g.lever * g.lever * rate
        + end_stop(angle, rate, m.swing, m.stop_torsional_stiffness, m.stop_torsional_damping)
    )


@wp.func
def load_holding(m: Arm, load: float, pilot: float):
    """Opening [0…1] of a counterbalance valve: p_load + R p_pilot against its setting."""
    return wp.clamp((load + m.valve_pilot_ratio * pilot - m.valve_holding_pressure) / m.valve_holding_ramp, 0.0, 1.0)


@wp.func
def arm_fill(
    m: Arm, oil: Oil, gas: ArmGas, g: ArmGeometry, s: ArmState, bore_flow: float, rod_flow: float, dt: float
):
    """Both chambers after ``dt`` [s] of net flows [m³/s]."""
    fixed = m.hose_volume + m.cylinder_dead_volume
    mid_bore = fixed + 0.5 * m.cylinder_bore_area * m.cylinder_linkage.stroke
    mid_rod = fixed + 0.5 * m.cylinder_annulus_area * m.cylinder_linkage.stroke
    out = ArmState()
    out.bore = fill_chamber(oil, gas.bore, s.bore, bore_flow, dt, g.volume_bore, m.hose_compliance, mid_bore)
    out.rod = fill_chamber(oil, gas.rod, s.rod, rod_flow, dt, g.volume_rod, m.hose_compliance, mid_rod)
    out.compensator = s.compensator
    return out


@wp.struct
class ArmFlows:
    """Flows [m³/s] of one arm over a substep, and the load that its valve signals."""

    bore: float  # into the bore and what the piston sweeps
    rod: float
    drawn: float  # from the pump
    returned: float  # to the return line
    load: float  # [Pa]
    compensator: float  # [-] of a dynamic section after the substep


@wp.func
def arm_compensator_step(v: ArmValve, y: float, available: float, ratio: float, dt: float):
    """Compensator opening after ``dt`` [s] by the steering section's law, with a spring that does not stiffen and sensing at
    the port; ``available`` [Pa] is the drop over compensator and edge, ``ratio`` edge over open compensator."""
    section = Steering()
    section.valve_compensator_pressure = v.pressure_drop
    section.valve_compensator_time_constant = v.compensator_time_constant
    return compensator_step(section, y, available, ratio, 0.0, dt)


@wp.func
def arm_flows(
    m: Arm, v: ArmValve, oil: Oil, g: ArmGeometry, rate: float, supply: float, tank: float, s: ArmState, dt: float
):
    """Flows of one arm's valve in the state ``s``, and its compensator after a substep of ``dt`` [s]; a closed one passes
    nothing at all."""
    lam = oil.laminar_pressure
    p_b = pressure(oil, s.bore)
    p_r = pressure(oil, s.rod)
    relief_b = relief_valve(p_b - tank, m.valve_port_relief, m.valve_port_ramp, m.valve_port_flow)
    relief_r = relief_valve(p_r - tank, m.valve_port_relief, m.valve_port_ramp, m.valve_port_flow)
    q = ArmFlows()
    q.bore = -relief_b - g.displacement_bore * rate
    q.rod = -relief_r - g.displacement_rod * rate
    q.returned = relief_b + relief_r
    available = float(0.0)
    ratio = float(0.0)
    if g.opening != 0.0:
        cv = wp.abs(g.opening) * m.valve_cv
        extend = g.opening > 0.0
        p_in = wp.where(extend, p_b, p_r)
        p_out = wp.where(extend, p_r, p_b)
        drawn = float(0.0)
        if v.arm_valve_law == DYNAMIC_SECTION:
            available = wp.max(supply - p_in, 0.0)
            ratio = cv / v.cv_compensator
            share = s.compensator * inverse_root(wp.max(s.compensator * s.compensator + ratio * ratio, 1.0e-12))
            drawn = orifice(cv * share, available, lam)
        else:
            drawn = orifice(cv, wp.clamp(supply - p_in, 0.0, m.valve_pressure_drop), lam)
        out = load_holding(m, p_out, p_in) * orifice(cv, wp.max(p_out - tank, 0.0), lam)
        q.drawn = drawn
        q.returned += out
        q.load = p_in
        q.bore += wp.where(extend, drawn, -out)
        q.rod += wp.where(extend, -out, drawn)
    if v.arm_valve_law == DYNAMIC_SECTION:
        q.compensator = arm_compensator_step(v, s.compensator, available, ratio, dt)
    return q


@wp.func
def arm_displace(m: Arm, oil: Oil, g: ArmGeometry, angle: float, s: ArmState):
    """State after the arm has risen by ``angle`` [rad] with its valve shut."""
    return arm_fill(m, oil, arm_gas(oil, s), g, s, -g.displacement_bore * angle, -g.displacement_rod * angle, 1.0)
