"""The steering circuit: load-sensing pump, valve section with compensator, hoses, two cross-connected cylinders.

Sources: Merritt (1967) ch. 3–5; Krus, *On Load Sensing Fluid Power Systems* (1988).
"""

# pyright: reportGeneralTypeIssues=false, reportInvalidTypeForm=false
import warp as wp

from aoro_gym.twin.physics.cylinders import cylinder_extension
from aoro_gym.twin.physics.fluid import (
    Oil,
    check_valve,
    fill,
    free_gas,
    inverse_root,
    orifice,
    pressure,
    relief_valve,
    return_filter,
)
from aoro_gym.twin.physics.hoses import HOSE_TWO_SEGMENTS, HOSE_VISCOELASTIC, creep, fill_port, hose_flow_step
from aoro_gym.twin.physics.laws import option
from aoro_gym.twin.physics.load_sensing_pump import load_sensing_step, swash_step, swash_step_second_order
from aoro_gym.twin.physics.steering_circuit import Exchange, Steering, SteeringGas, SteeringGeometry, SteeringState
from aoro_gym.twin.physics.steering_valve import (
    COMPENSATOR_SPRING_MASS,
    COMPENSATOR_STATIC,
    FLOW_FORCE_STEADY,
    SENSES_LOAD_SENSING_LINE,
    SHOCK_VALVE_LAG,
    Metering,
    closed_by_flow,
    compensator_step,
    edge_drop,
    metering,
    port_to_tank,
    shock_flow,
    spool_step,
    spring_mass_compensator,
    static_compensator,
)

PUMP_SECOND_ORDER = option("pump", "second_order")
LOAD_SENSING_VOLUME = option("load_sensing_line", "volume")
RETURN_ORIFICE = option("return_line", "orifice")


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
def steering_displace(m: Steering, oil: Oil, g: SteeringGeometry, angle: float, s: SteeringState):
    """State after the joint has turned by ``angle`` [rad] with all valves shut."""
    gas_a = free_gas(oil, s.port_a)
    gas_b = free_gas(oil, s.port_b)
    given_a = -g.displacement_a * angle
    given_b = -g.displacement_b * angle
    out = s
    out.port_a = fill_port(m, oil, gas_a, s.port_a, given_a, 1.0, g.volume_a)
    out.port_b = fill_port(m, oil, gas_b, s.port_b, given_b, 1.0, g.volume_b)
    return out


@wp.func
def return_flow(m: Steering, lam: float, p: float):
    """Flow [m³/s] from the return line at ``p`` [Pa] to the tank, by the law of return lines: behind its filter's check, or
    through an orifice that drops as much at ``back_flow`` and nothing at rest."""
    flow = float(0.0)
    if m.return_line_law == RETURN_ORIFICE:
        nominal = m.tank_line_back_pressure + m.tank_line_back_pressure_ramp
        nominal += m.tank_line_throttle * m.tank_line_back_flow * m.tank_line_back_flow
        flow = orifice(m.tank_line_back_flow * inverse_root(nominal), wp.max(p, 0.0), lam)
    else:
        flow = return_filter(
            p, m.tank_line_back_pressure, m.tank_line_back_pressure_ramp, m.tank_line_back_flow, m.tank_line_throttle
        )
    return flow


@wp.func
def compensator(m: Steering, edges: Metering, s: SteeringState, dt: float):
    """Compensator opening and its rate [1/s] after ``dt``, by the law of compensators."""
    bias = float(0.0)
    if m.compensator_sensing_law == SENSES_LOAD_SENSING_LINE:
        bias = wp.where(edges.opening > 0.0, edges.load_pressure - s.ls_pressure, 0.0)
    y = float(0.0)
    rate = float(0.0)
    if m.compensator_law == COMPENSATOR_STATIC:
        y = static_compensator(m, s.compensator, edges.available, edges.ratio, bias)
    elif m.compensator_law == COMPENSATOR_SPRING_MASS:
        y, rate = spring_mass_compensator(
            m, s.compensator, s.law.compensator_rate, edges.available, edges.ratio, bias, dt
        )
    else:
        y = compensator_step(m, s.compensator, edges.available, edges.ratio, bias, dt)
    return y, rate


@wp.func
def ports_step(
    # parameters
    m: Steering,
    oil: Oil,
    # at this main step
    gas: SteeringGas,
    g: SteeringGeometry,
    # at this substep: flows [m³/s] into the hoses, from A to B in valve and cylinders and in the cylinders alone; pressures
    # on the valve's end; what the cylinders see as the joint rate
    metered_a: float,
    metered_b: float,
    across: float,
    leakage: float,
    p_a: float,
    p_b: float,
    cylinder_rate: float,
    s: SteeringState,
    begun: SteeringState,
    dt: float,
):
    """``begun`` with both sides' oil after ``dt``, by the law of hoses."""
    out = begun
    q_a = metered_a - across - g.displacement_a * cylinder_rate
    q_b = metered_b + across - g.displacement_b * cylinder_rate
    if m.hose_law == HOSE_TWO_SEGMENTS:
        cross = across - leakage
        half = 0.5 * m.hose_volume
        walls = 0.5 * m.hose_compliance
        flow_a = out.law.hose_flow_a
        flow_b = out.law.hose_flow_b
        out.law.hose_a = fill(oil, gas.port_a, s.law.hose_a, metered_a - cross - flow_a, dt, half, walls)
        out.law.hose_b = fill(oil, gas.port_b, s.law.hose_b, metered_b + cross - flow_b, dt, half, walls)
        q_a = flow_a - leakage - g.displacement_a * cylinder_rate
        q_b = flow_b + leakage - g.displacement_b * cylinder_rate
    if m.hose_law == HOSE_VISCOELASTIC:
        creep_a = creep(m, s.law.hose_strain_a, p_a)
        creep_b = creep(m, s.law.hose_strain_b, p_b)
        out.law.hose_strain_a += dt * creep_a
        out.law.hose_strain_b += dt * creep_b
        q_a -= creep_a
        q_b -= creep_b
    out.port_a = fill_port(m, oil, gas.port_a, s.port_a, q_a, dt, g.volume_a)
    out.port_b = fill_port(m, oil, gas.port_b, s.port_b, q_b, dt, g.volume_b)
    return out


@wp.struct
class LoadSensing:
    """The load-sensing line after a substep, and what it took over it."""

    pressure: float  # [Pa]
    bleed: float  # [m³/s] from pump 2's line
    drawn: float  # [m³/s] from the loaded port
    drained: float  # [m³/s] into the return line


@wp.func
def load_sensing(m: Steering, oil: Oil, lam: float, port: float, arms: float, ls_pressure: float, dt: float):
    """What the pump feels after ``dt`` of the highest load [Pa], of the open ``port`` or the ``arms``, by the law of
    load-sensing lines. While nothing works, the valves connect a line that has a volume with the tank."""
    load = wp.max(wp.max(arms, port), 0.0)
    out = LoadSensing()
    if m.load_sensing_line_law == LOAD_SENSING_VOLUME:
        felt, drawn = load_sensing_step(m, oil, lam, ls_pressure, load, dt)
        out.pressure = felt
        if load <= 0.0:
            out.drained = -drawn
        elif port >= load:
            out.drawn = drawn
    else:
        out.pressure = ls_pressure + (dt / m.pump_ls_time_constant) * (load - ls_pressure)
        out.bleed = orifice(m.pump_cv_bleed, ls_pressure, lam)
    return out


@wp.func
def valve_and_pump_step(
    m: Steering,
    edges: Metering,
    spool_demand: float,
    p_s: float,
    p_a: float,
    p_b: float,
    p_t: float,
    s: SteeringState,
    begun: SteeringState,
    dt: float,
):
    """``begun`` with spool, compensator, swash and relief valves after ``dt`` under the pressures [Pa] of supply, ports and
    return line."""
    out = begun
    demand = float(spool_demand)
    if m.flow_force_law == FLOW_FORCE_STEADY:
        drop = edge_drop(s.compensator, edges.available, wp.max(edges.ratio * edges.ratio, 1.0e-12))
        demand = closed_by_flow(m, demand, edges.opening, drop)
    spool, spool_rate = spool_step(m, s.spool, s.law.spool_rate, demand, dt)
    out.spool = spool
    out.law.spool_rate = spool_rate
    opened, compensator_rate = compensator(m, edges, s, dt)
    out.compensator = opened
    out.law.compensator_rate = compensator_rate
    if m.pump_law == PUMP_SECOND_ORDER:
        swash, pump_valve = swash_step_second_order(m, s.swash, s.law.pump_valve, p_s, s.ls_pressure, dt)
        out.swash = swash
        out.law.pump_valve = pump_valve
    else:
        out.swash = swash_step(m, s.swash, p_s, s.ls_pressure, dt)
    if m.shock_valve_law == SHOCK_VALVE_LAG:
        follow = dt / (m.valve_shock_time_constant + dt)
        out.law.shock_a += follow * (shock_flow(m, p_a, p_t) - s.law.shock_a)
        out.law.shock_b += follow * (shock_flow(m, p_b, p_t) - s.law.shock_b)
    out.flow_in = edges.flow_in
    out.flow_out = edges.flow_out
    return out


@wp.struct
class SteeringFlows:
    """Flows of the steering circuit over a substep, as far as the arms have no say in them."""

    p_s: float  # [Pa] of the supply
    p_a: float  # [Pa] of the ports, on the valve's end
    p_b: float
    p_t: float  # [Pa] of the return line
    edges: Metering
    leakage: float  # [m³/s] from A to B in the cylinders
    across: float  # [m³/s] from A to B in valve and cylinders
    to_tank_a: float  # [m³/s] past the metering edges
    to_tank_b: float
    metered_a: float  # [m³/s] into the hoses
    metered_b: float


@wp.func
def steering_flows(m: Steering, oil: Oil, spool_demand: float, s: SteeringState, dt: float):
    """Flows over one substep from the pressures at its start; and the state ``s`` with all that they alone move after
    ``dt`` [s]: valve, pump, and oil between two segments of a hose, whose flow is of the step's end."""
    lam = oil.laminar_pressure
    q = SteeringFlows()
    q.p_s = pressure(oil, s.supply)
    q.p_a = pressure(oil, s.port_a)
    q.p_b = pressure(oil, s.port_b)
    q.p_t = pressure(oil, s.tank_line)
    out = s
    # flows into the hoses [m³/s] on the valve's end, and from there to the cylinders
    q.leakage = 2.0 * m.cylinder_leakage * (q.p_a - q.p_b)
    if m.hose_law == HOSE_TWO_SEGMENTS:
        out.law.hose_flow_a = hose_flow_step(m, s.law.hose_flow_a, pressure(oil, s.law.hose_a) - q.p_a, dt)
        out.law.hose_flow_b = hose_flow_step(m, s.law.hose_flow_b, pressure(oil, s.law.hose_b) - q.p_b, dt)
        q.p_a = pressure(oil, s.law.hose_a)
        q.p_b = pressure(oil, s.law.hose_b)

    q.edges = metering(m, lam, s, q.p_s, q.p_a, q.p_b, q.p_t)
    q.to_tank_a = port_to_tank(m, lam, q.p_a, q.p_t, s.law.shock_a)
    q.to_tank_b = port_to_tank(m, lam, q.p_b, q.p_t, s.law.shock_b)
    q.across = q.leakage + orifice(m.valve_cv_cross_port, q.p_a - q.p_b, lam)
    q.metered_a = wp.where(q.edges.left, q.edges.flow_in, -q.edges.flow_out) - q.to_tank_a
    q.metered_b = wp.where(q.edges.left, -q.edges.flow_out, q.edges.flow_in) - q.to_tank_b
    out = valve_and_pump_step(m, q.edges, spool_demand, q.p_s, q.p_a, q.p_b, q.p_t, s, out, dt)
    return q, out


@wp.func
def steering_fill(
    # parameters
    m: Steering,
    oil: Oil,
    # at this main step
    gas: SteeringGas,
    g: SteeringGeometry,
    engine_speed: float,
    # at this substep: what the cylinders see as the joint rate, what the arms draw
    cylinder_rate: float,
    arms: Exchange,
    q: SteeringFlows,
    s: SteeringState,
    begun: SteeringState,
    dt: float,
):
    """``begun`` with all oil and the load-sensing line after ``dt`` [s] of the flows ``q`` and those of the arms."""
    lam = oil.laminar_pressure
    out = begun
    metered_a = q.metered_a
    metered_b = q.metered_b
    sensed = load_sensing(m, oil, lam, q.edges.load_pressure, arms.load_pressure, s.ls_pressure, dt)
    out.ls_pressure = sensed.pressure
    if m.load_sensing_line_law == LOAD_SENSING_VOLUME:
        metered_a -= wp.where(q.edges.left, sensed.drawn, 0.0)
        metered_b -= wp.where(q.edges.left, 0.0, sensed.drawn)

    out = ports_step(
        m, oil, gas, g, metered_a, metered_b, q.across, q.leakage, q.p_a, q.p_b, cylinder_rate, s, out, dt
    )
    q_supply = (
        s.swash * m.pump_displacement * engine_speed
        - m.pump_leakage * q.p_s
        - sensed.bleed
        - relief_valve(q.p_s, m.pump_relief_pressure, m.pump_relief_ramp, m.pump_relief_flow)
        - q.edges.flow_in
        - arms.supply_flow
    )
    q_tank = (
        q.edges.flow_out
        + q.to_tank_a
        + q.to_tank_b
        + arms.tank_flow
        + sensed.drained
        - return_flow(m, lam, q.p_t)
        + check_valve(m.tank_line_cv_suction, -q.p_t, 0.0, lam)
    )

    out.supply = fill(oil, gas.supply, s.supply, q_supply, dt, m.pump_line_volume, m.pump_line_compliance)
    out.tank_line = fill(oil, gas.tank_line, s.tank_line, q_tank, dt, m.tank_line_volume, m.tank_line_compliance)
    return out


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
    """The whole steering circuit over one hydraulic substep (all flows from the pressures at its start, but that between
    two segments of a hose, which is of its end)."""
    q, begun = steering_flows(m, oil, spool_demand, s, dt)
    return steering_fill(m, oil, gas, g, engine_speed, cylinder_rate, arms, q, s, begun, dt)
