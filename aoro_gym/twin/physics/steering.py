"""The steering circuit: load-sensing pump, valve section with compensator, hoses, two cross-connected cylinders.

Port A is pressurised in a left turn (positive command, positive joint rate). Machine section ``steering``.
Sources: Merritt (1967) ch. 3–5; Krus, *On Load Sensing Fluid Power Systems* (1988); Lehto et al. (Machines 2026, 14, 128)
for the measured opening curve and the laminar limit.
"""

# pyright: reportGeneralTypeIssues=false, reportInvalidTypeForm=false
import warp as wp

from aoro_gym.twin.physics.cylinders import Linkage, cylinder_extension
from aoro_gym.twin.physics.fluid import (
    Gas,
    Oil,
    check_valve,
    fill,
    fill_chamber,
    free_gas,
    inverse_root,
    orifice,
    pressure,
    relief_valve,
    return_filter,
)


@wp.struct
class Steering:
    """Parameters of the steering circuit, its pump and its return line (C = Q_nom/√Δp_nom in m³/s/√Pa)."""

    # valve section
    valve_cv_in_left: float  # [m³/s/√Pa] meter-in edge P→A, fully open
    valve_cv_in_right: float  # P→B
    valve_cv_out_left: float  # meter-out edge B→T in a left turn
    valve_cv_out_right: float  # A→T in a right turn
    valve_dead_band_left: float  # [V] of the signal
    valve_dead_band_right: float
    valve_opening_left_1V0: float  # [-] measured opening at 1.0 V
    valve_opening_left_1V5: float
    valve_opening_right_1V0: float
    valve_opening_right_1V5: float
    valve_spool_time_constant: float  # [s]
    valve_spool_rate_limit: float  # [1/s] full strokes a second
    valve_command_delay: float  # [s]
    valve_hysteresis: float  # [-] width, share of the full signal
    valve_overlap: float  # [V] by which the opening curve lies farther out
    valve_leakage: float  # [m³/s/Pa] port to tank
    valve_cv_cross_port: float  # leak from port to port
    valve_cv_compensator: float  # fully open
    valve_compensator_pressure: float  # [Pa]
    valve_compensator_droop: float  # [-] of the setting over the stroke
    valve_compensator_time_constant: float  # [s] full stroke under an excess of one setting
    valve_shock_pressure: float  # [Pa]
    valve_shock_ramp: float  # [Pa]
    valve_shock_flow: float  # [m³/s]
    valve_anticavitation_crack: float  # [Pa]
    valve_cv_anticavitation: float
    # hoses and cylinders
    hose_volume: float  # [m³] a side
    hose_compliance: float  # [m³/Pa] walls, a side
    cylinder_linkage: Linkage
    cylinder_bore_area: float  # [m²]
    cylinder_annulus_area: float  # [m²]
    cylinder_dead_volume: float  # [m³] an end
    cylinder_leakage: float  # [m³/s/Pa] a cylinder
    cylinder_seal_preload: float  # [N]
    cylinder_seal_pressure_coefficient: float  # [N/Pa]
    cylinder_seal_static_ratio: float  # [-]
    cylinder_seal_stribeck_velocity: float  # [m/s]
    cylinder_seal_viscous: float  # [N s/m]
    # load-sensing pump (pump 2) and its line
    pump_displacement: float  # [m³/rad]
    pump_margin: float  # [Pa]
    pump_control_band: float  # [Pa] error that moves the swash at full rate
    pump_stroke_up_time: float  # [s]
    pump_stroke_down_time: float  # [s]
    pump_cutoff: float  # [Pa]
    pump_ls_time_constant: float  # [s]
    pump_cv_bleed: float
    pump_leakage: float  # [m³/s/Pa]
    pump_mechanical_efficiency: float  # [-]
    pump_line_volume: float  # [m³]
    pump_line_compliance: float  # [m³/Pa]
    pump_relief_pressure: float  # [Pa]
    pump_relief_ramp: float  # [Pa]
    pump_relief_flow: float  # [m³/s]
    # return line
    tank_line_volume: float  # [m³]
    tank_line_compliance: float  # [m³/Pa]
    tank_line_back_pressure: float  # [Pa]
    tank_line_back_pressure_ramp: float  # [Pa]
    tank_line_back_flow: float  # [m³/s]
    tank_line_throttle: float  # [Pa s²/m⁶]
    tank_line_cv_suction: float
    # laws, by the numbers of aoro_gym.machine.laws, and what only they need
    spool_law: int
    valve_spool_frequency: float  # [rad/s]
    valve_spool_damping: float  # [-]
    opening_law: int
    orifice_law: int
    flow_force_law: int
    valve_flow_force_share: float  # [-]
    compensator_law: int
    valve_compensator_frequency: float  # [rad/s]
    valve_compensator_damping: float  # [-]
    compensator_sensing_law: int
    shock_valve_law: int
    valve_shock_time_constant: float  # [s]
    pump_law: int
    pump_valve_time_constant: float  # [s]
    load_sensing_line_law: int
    pump_ls_volume: float  # [m³]
    pump_cv_ls: float
    return_line_law: int
    hose_law: int
    hose_stiffening_pressure: float  # [Pa]
    hose_delayed_share: float  # [-]
    hose_delay_time: float  # [s]
    hose_inertance: float  # [kg/m⁴]
    hose_resistance: float  # [Pa s²/m⁶]


@wp.struct
class SteeringLawState:
    """States that only some laws have."""

    spool_rate: float  # [1/s]
    compensator_rate: float  # [1/s]
    pump_valve: float  # [-] −1 … 1 of pump 2's control valve
    shock_a: float  # [m³/s] through the relief valve of port A
    shock_b: float
    hose_strain_a: float  # [m³] by which the walls of side A have crept
    hose_strain_b: float
    hose_a: float  # [Pa] content of side A's hose on the valve's end
    hose_b: float
    hose_flow_a: float  # [m³/s] from there to the cylinders
    hose_flow_b: float


@wp.struct
class SteeringState:
    supply: float  # [Pa] content of pump 2's line
    port_a: float  # [Pa] content of hose A with its chambers
    port_b: float  # [Pa]
    tank_line: float  # [Pa] content of the return line
    ls_pressure: float  # [Pa]
    spool: float  # [-] −1 (right) … 1 (left)
    compensator: float  # [-] 0 (closed) … 1 (open)
    swash: float  # [-] 0 … 1 of pump 2
    flow_in: float  # [m³/s] metered into the loaded port
    flow_out: float  # [m³/s] metered out of the other port
    law: SteeringLawState


@wp.struct
class SteeringGas:
    """Free gas of the circuit's volumes at the start of a main step."""

    supply: Gas
    port_a: Gas
    port_b: Gas
    tank_line: Gas


@wp.struct
class SteeringGeometry:
    """Chambers at one joint angle."""

    volume_a: float  # [m³] all oil on side A: hose, dead volumes, right bore, left annulus
    volume_b: float
    displacement_a: float  # [m³/rad] dV_A/dθ
    displacement_b: float
    lever_left: float  # [m] dL/dγ of the left cylinder
    lever_right: float


@wp.struct
class Exchange:
    """What the pendulum arms take from the pump's line and give to the return line."""

    supply_flow: float  # [m³/s] drawn
    tank_flow: float  # [m³/s] returned
    load_pressure: float  # [Pa] highest load of a working section


@wp.func
def steering_geometry(m: Steering, joint_angle: float):
    """Chamber volumes and levers: the right cylinder extends as the joint turns left, the left one retracts."""
    right, lever_right = cylinder_extension(m.cylinder_linkage, joint_angle)
    left, lever_left = cylinder_extension(m.cylinder_linkage, -joint_angle)
    stroke = m.cylinder_linkage.stroke
    fixed = m.hose_volume + 2.0 * m.cylinder_dead_volume
    g = SteeringGeometry()
    g.volume_a = fixed + m.cylinder_bore_area * right + m.cylinder_annulus_area * (stroke - left)
    g.volume_b = fixed + m.cylinder_bore_area * left + m.cylinder_annulus_area * (stroke - right)
    g.displacement_a = m.cylinder_bore_area * lever_right + m.cylinder_annulus_area * lever_left
    g.displacement_b = -(m.cylinder_bore_area * lever_left + m.cylinder_annulus_area * lever_right)
    g.lever_left = lever_left
    g.lever_right = lever_right
    return g


@wp.func
def steering_gas(oil: Oil, s: SteeringState):
    """Free gas of the circuit's volumes in the state ``s``."""
    gas = SteeringGas()
    gas.supply = free_gas(oil, s.supply)
    gas.port_a = free_gas(oil, s.port_a)
    gas.port_b = free_gas(oil, s.port_b)
    gas.tank_line = free_gas(oil, s.tank_line)
    return gas


@wp.func
def steering_torque(oil: Oil, g: SteeringGeometry, s: SteeringState):
    """Torque [N m] of the oil on the joint: Σ p dV/dθ."""
    return pressure(oil, s.port_a) * g.displacement_a + pressure(oil, s.port_b) * g.displacement_b


@wp.func
def port_nominal_volume(m: Steering):
    """Oil [m³] on one side at half stroke."""
    return (
        m.hose_volume
        + 2.0 * m.cylinder_dead_volume
        + 0.5 * (m.cylinder_bore_area + m.cylinder_annulus_area) * m.cylinder_linkage.stroke
    )


@wp.func
def steering_displace(m: Steering, oil: Oil, g: SteeringGeometry, angle: float, s: SteeringState):
    """State after the joint has turned by ``angle`` [rad] with all valves shut."""
    nominal = port_nominal_volume(m)
    gas_a = free_gas(oil, s.port_a)
    gas_b = free_gas(oil, s.port_b)
    given_a = -g.displacement_a * angle
    given_b = -g.displacement_b * angle
    out = s
    out.port_a = fill_chamber(oil, gas_a, s.port_a, given_a, 1.0, g.volume_a, m.hose_compliance, nominal)
    out.port_b = fill_chamber(oil, gas_b, s.port_b, given_b, 1.0, g.volume_b, m.hose_compliance, nominal)
    return out


@wp.func
def play(position: float, command: float, width: float):
    """Backlash (play) operator of total ``width``: its output follows ``command`` at half a width's distance."""
    return wp.clamp(position, command - 0.5 * width, command + 0.5 * width)


@wp.func
def play_output(position: float, width: float):
    """Spool demand from the play's position, centred so that a rising command beyond one ``width`` is met exactly.

    The opening curve was measured with rising commands; hysteresis shows on falling ones.
    """
    return position + wp.clamp(position, -0.5 * width, 0.5 * width)


@wp.func
def valve_opening(spool: float, overlap: float, dead_band: float, opening_1V0: float, opening_1V5: float):
    """Opening [0…1] of the section's edges at ``spool`` [share of the 2 V signal]: the measured curve, linear between
    the end of the dead band, 1.0 V, 1.5 V and 2.0 V, moved out by ``overlap`` [V]."""
    volts = 2.0 * wp.abs(spool) - overlap
    first = opening_1V0 * wp.clamp((volts - dead_band) / (1.0 - dead_band), 0.0, 1.0)
    second = (opening_1V5 - opening_1V0) * wp.clamp(2.0 * volts - 2.0, 0.0, 1.0)
    third = (1.0 - opening_1V5) * wp.clamp(2.0 * volts - 3.0, 0.0, 1.0)
    return first + second + third


@wp.func
def compensator_step(m: Steering, y: float, available: float, ratio: float, dt: float):
    """Compensator opening after ``dt``: τ p_ref ẏ = p_ref (1 + κ(½ − y)) − Δp_edge, with stops at 0 and 1.

    Spring against the drop over the metering edge, damped by its pilot orifice; Δp_edge = Δp y²/(y² + ρ²) of the
    ``available`` drop Δp [Pa], ``ratio`` ρ = edge over open compensator. Δp_edge vanishes with y, so it is taken as
    (Δp_edge/y) y′ with the new y′: the step keeps y positive and converges to the static balance at any dt. The law is
    faster than the volumes, hence two steps of dt/2.
    """
    setting = m.valve_compensator_pressure
    droop = m.valve_compensator_droop
    rate = 0.5 * dt / (setting * m.valve_compensator_time_constant)
    opened = rate * setting * (1.0 + 0.5 * droop)
    held = 1.0 + rate * setting * droop
    square = wp.max(ratio * ratio, 1.0e-12)
    wide = y * y + square
    half = wp.min((y + opened) * wide / (held * wide + rate * available * y), 1.0)
    wide = half * half + square
    return wp.min((half + opened) * wide / (held * wide + rate * available * half), 1.0)


@wp.func
def swash_step(m: Steering, swash: float, supply: float, ls_pressure: float, dt: float):
    """Pump 2's swash after ``dt``: rate ∝ the smaller of the load-sensing and the cut-off error, within stroke times."""
    error = wp.min(ls_pressure + m.pump_margin - supply, m.pump_cutoff - supply)
    rate = wp.clamp(
        error * (1.0 / (m.pump_control_band * m.pump_stroke_up_time)),
        -1.0 / m.pump_stroke_down_time,
        1.0 / m.pump_stroke_up_time,
    )
    return wp.clamp(swash + dt * rate, 0.0, 1.0)


@wp.struct
class Metering:
    """Flows through the metering edges, which one side of the valve works at a time."""

    left: bool  # the side that works
    available: float  # [Pa] drop over compensator and meter-in edge
    ratio: float  # [-] meter-in edge over open compensator
    flow_in: float  # [m³/s]
    flow_out: float  # [m³/s]
    load_pressure: float  # [Pa] of the loaded port, where the valve is open


@wp.func
def metering(m: Steering, lam: float, s: SteeringState, p_s: float, p_a: float, p_b: float, p_t: float):
    """Valve section at pressures [Pa] of supply, ports and return line: compensator and meter-in edge in series behind a
    load check, and the meter-out edge."""
    left = s.spool > 0.0
    opening = valve_opening(
        s.spool,
        m.valve_overlap,
        wp.where(left, m.valve_dead_band_left, m.valve_dead_band_right),
        wp.where(left, m.valve_opening_left_1V0, m.valve_opening_right_1V0),
        wp.where(left, m.valve_opening_left_1V5, m.valve_opening_right_1V5),
    )
    cv_in = wp.where(left, m.valve_cv_in_left, m.valve_cv_in_right)
    cv_out = wp.where(left, m.valve_cv_out_left, m.valve_cv_out_right)
    p_load = wp.where(left, p_a, p_b)
    p_unload = wp.where(left, p_b, p_a)
    out = Metering()
    out.left = left
    out.available = wp.where(opening > 0.0, wp.max(p_s - p_load, 0.0), 0.0)
    out.ratio = opening * (cv_in / m.valve_cv_compensator)
    share = s.compensator * inverse_root(wp.max(s.compensator * s.compensator + out.ratio * out.ratio, 1.0e-12))
    out.flow_in = orifice(opening * cv_in * share, out.available, lam)
    out.flow_out = orifice(opening * cv_out, p_unload - p_t, lam)
    out.load_pressure = wp.where(opening > 0.0, p_load, 0.0)
    return out


@wp.func
def port_to_tank(m: Steering, lam: float, port: float, tank: float):
    """Flow [m³/s] from a port to the return line past the metering edges: port relief, leakage, anti-cavitation."""
    shock = relief_valve(port - tank, m.valve_shock_pressure, m.valve_shock_ramp, m.valve_shock_flow)
    suction = check_valve(m.valve_cv_anticavitation, tank - port, m.valve_anticavitation_crack, lam)
    return shock + m.valve_leakage * (port - tank) - suction


@wp.func
def steering_step(
    # parameters
    m: Steering,
    oil: Oil,
    # at this main step
    gas: SteeringGas,
    g: SteeringGeometry,
    spool_demand: float,
    engine_speed: float,
    # at this substep: what the cylinders see as the joint rate, what the arms draw
    cylinder_rate: float,
    arms: Exchange,
    s: SteeringState,
    dt: float,
):
    """The whole steering circuit over one hydraulic substep (all flows from the pressures at its start)."""
    lam = oil.laminar_pressure
    p_s = pressure(oil, s.supply)
    p_a = pressure(oil, s.port_a)
    p_b = pressure(oil, s.port_b)
    p_t = pressure(oil, s.tank_line)

    edges = metering(m, lam, s, p_s, p_a, p_b, p_t)
    left = edges.left
    flow_in = edges.flow_in
    flow_out = edges.flow_out
    to_tank_a = port_to_tank(m, lam, p_a, p_t)
    to_tank_b = port_to_tank(m, lam, p_b, p_t)
    across = 2.0 * m.cylinder_leakage * (p_a - p_b)
    if m.valve_cv_cross_port > 0.0:
        across += orifice(m.valve_cv_cross_port, p_a - p_b, lam)
    q_a = wp.where(left, flow_in, -flow_out) - to_tank_a - across - g.displacement_a * cylinder_rate
    q_b = wp.where(left, -flow_out, flow_in) - to_tank_b + across - g.displacement_b * cylinder_rate

    q_supply = (
        s.swash * m.pump_displacement * engine_speed
        - m.pump_leakage * p_s
        - orifice(m.pump_cv_bleed, s.ls_pressure, lam)
        - relief_valve(p_s, m.pump_relief_pressure, m.pump_relief_ramp, m.pump_relief_flow)
        - flow_in
        - arms.supply_flow
    )
    q_tank = (
        flow_out
        + to_tank_a
        + to_tank_b
        + arms.tank_flow
        - return_filter(
            p_t, m.tank_line_back_pressure, m.tank_line_back_pressure_ramp, m.tank_line_back_flow, m.tank_line_throttle
        )
        + check_valve(m.tank_line_cv_suction, -p_t, 0.0, lam)
    )

    nominal = port_nominal_volume(m)
    out = s
    out.supply = fill(oil, gas.supply, s.supply, q_supply, dt, m.pump_line_volume, m.pump_line_compliance)
    out.port_a = fill_chamber(oil, gas.port_a, s.port_a, q_a, dt, g.volume_a, m.hose_compliance, nominal)
    out.port_b = fill_chamber(oil, gas.port_b, s.port_b, q_b, dt, g.volume_b, m.hose_compliance, nominal)
    out.tank_line = fill(oil, gas.tank_line, s.tank_line, q_tank, dt, m.tank_line_volume, m.tank_line_compliance)
    out.ls_pressure = s.ls_pressure + (dt / m.pump_ls_time_constant) * (
        wp.max(wp.max(arms.load_pressure, edges.load_pressure), 0.0) - s.ls_pressure
    )
    fastest = dt * m.valve_spool_rate_limit
    out.spool = s.spool + wp.clamp((dt / m.valve_spool_time_constant) * (spool_demand - s.spool), -fastest, fastest)
    out.compensator = compensator_step(m, s.compensator, edges.available, edges.ratio, dt)
    out.swash = swash_step(m, s.swash, p_s, s.ls_pressure, dt)
    out.flow_in = flow_in
    out.flow_out = flow_out
    return out
