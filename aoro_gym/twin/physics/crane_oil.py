"""Oil of a crane: four double-acting cylinders behind a bank of sections that share the flow of the load-sensing pump.

**Sections** have their compensators behind the metering edges, all under the highest load p_m of the bank, so that every
edge feels the same drop (flow sharing; Krus, *On Load Sensing Fluid Power Systems*, 1988):

    Q_i = C_i y_i √(σ min(p_s − p_m, Δp₀)),

with the orifice constant C_i of an open edge, its opening y_i, and the drop Δp₀ that the compensators let through. While the
pump keeps its margin, Q_i is what its opening says; where it is saturated, p_s falls until all of Q_i together are its flow:
their ratios stay those of C_i y_i. Compensators are ideal, without mass.

**Priority**: a valve opens to the bank by the share σ = clip((p_s − p_st − p_p)/Δp_p, 0, 1) of the drop while the steering
works under its load p_st: the bank starves before the steering does.

**Load holding** and port reliefs: as of the arms (:mod:`aoro_gym.twin.physics.arms`). A closed section passes nothing. The
slew's racks are a cylinder whose way is the angle. Units: m, kg, s, rad, N, Pa.
"""

# pyright: reportGeneralTypeIssues=false, reportInvalidTypeForm=false
import warp as wp

from aoro_gym.twin.physics.fluid import Gas, Oil, fill_chamber, free_gas, orifice, pressure, relief_valve
from aoro_gym.twin.physics.friction import dry_friction, end_stop


@wp.struct
class CraneHydraulics:
    """Parameters of a crane's cylinders, valves, friction and stops (:class:`aoro_gym.machine.vehicle_crane.CraneMount`)."""

    # cylinders: slew (its way is an angle), lift, fold, telescope
    bore_area: wp.vec4  # [m²], of the slew [m³/rad]
    annulus_area: wp.vec4
    shortest: wp.vec4  # [m] pin to pin, closed; of the slew [rad]
    stroke: wp.vec4
    lift_pillar_pin: float  # [m]
    lift_boom_pin: float
    lift_level_angle: float  # [rad]
    fold_pin: wp.vec2  # [m] of the cylinder on the boom: along it and over it, from the fold's pin
    fold_pivot: wp.vec2  # of the lever
    fold_lever: float
    fold_coupler: float
    fold_lug: float
    fold_lug_angle: float  # [rad]
    telescope_ratio: float
    fixed_volume: float  # [m³] of a side's hose and closed chamber
    hose_compliance: float  # [m³/Pa]
    # valves
    valve_cv: wp.vec4  # [m³/s/√Pa] an edge, fully open
    pressure_drop: float  # [Pa]
    dead_band: float  # [-]
    time_constant: float  # [s]
    rate_limit: float  # [1/s]
    holding_pressure: float  # [Pa]
    holding_ramp: float  # [Pa]
    pilot_ratio: float  # [-]
    port_relief: float  # [Pa]
    port_ramp: float  # [Pa]
    port_flow: float  # [m³/s]
    priority_pressure: float  # [Pa]
    priority_ramp: float  # [Pa]
    # friction and stops
    dry: wp.vec4  # of the slew [N m], of the cylinders [N]
    viscous: wp.vec4  # of the slew [N m s/rad], of the cylinders [N s/m]
    presliding: float  # [rad], of the telescope [m]
    middle: wp.vec4  # [rad], of the telescope [m]: middle of each joint's range
    reach: wp.vec4  # half of it
    stop_stiffness: wp.vec4  # [N m/rad], of the telescope [N/m]
    stop_damping: wp.vec4


@wp.struct
class CraneChambers:
    """Cylinders at one pose."""

    volume_bore: wp.vec4  # [m³]
    volume_annulus: wp.vec4
    slope: wp.vec4  # [m/rad] of each way with its joint; of the slew 1, of the telescope [-]


@wp.struct
class CraneSections:
    """Oil of a crane over the substeps of a main step."""

    chambers: CraneChambers
    opening: wp.vec4  # [-] −1 (shortens) … 1 (lengthens), beyond the dead band
    rate: wp.vec4  # of the joints
    bore: wp.vec4  # [Pa] content
    annulus: wp.vec4
    bore_share: wp.vec4  # free gas at the start of the main step, see Gas
    bore_inverse: wp.vec4
    annulus_share: wp.vec4
    annulus_inverse: wp.vec4
    torque: wp.vec4  # sums over the substeps: of the torque on the joints [N m], [N]
    drawn: wp.vec4  # of the flows from the pump [m³/s]


@wp.func
def dot(a: wp.vec2, b: wp.vec2):
    return a[0] * b[0] + a[1] * b[1]


@wp.func
def fold_way(c: CraneHydraulics, fold: float):
    """Length [m] of the fold's cylinder pin to pin, and its slope [m/rad], over four bars
    (:meth:`aoro_gym.machine.crane.FoldCylinder.extension`)."""
    angle = c.fold_lug_angle + fold
    lug = c.fold_lug * wp.vec2(wp.cos(angle), wp.sin(angle))
    way = lug - c.fold_pivot
    distance = wp.length(way)
    cosine = (distance * distance + c.fold_lever * c.fold_lever - c.fold_coupler * c.fold_coupler) / (
        2.0 * distance * c.fold_lever
    )
    cosine = wp.clamp(cosine, -1.0, 1.0)
    sine = wp.sqrt(1.0 - cosine * cosine)
    e = way / distance
    lever = c.fold_lever * wp.vec2(e[0] * cosine + e[1] * sine, e[1] * cosine - e[0] * sine)
    shared = c.fold_pivot + lever
    along = shared - lug
    lug_turned = wp.vec2(-lug[1], lug[0])
    lever_turned = wp.vec2(-lever[1], lever[0])
    rod = shared - c.fold_pin
    length = wp.length(rod)
    turn = dot(lug_turned, along) / dot(lever_turned, along)
    return length, turn * dot(lever_turned, rod) / length


@wp.func
def lift_way(c: CraneHydraulics, lift: float):
    """The same of the lift's cylinder (law of cosines)."""
    between = c.lift_level_angle + lift
    product = c.lift_pillar_pin * c.lift_boom_pin
    square = c.lift_pillar_pin * c.lift_pillar_pin + c.lift_boom_pin * c.lift_boom_pin
    length = wp.sqrt(square - 2.0 * product * wp.cos(between))
    return length, product * wp.sin(between) / length


@wp.func
def crane_chambers(c: CraneHydraulics, q: wp.vec4):
    """Chambers at the joints ``q``."""
    lift, lift_slope = lift_way(c, q[1])
    fold, fold_slope = fold_way(c, q[2])
    out = CraneChambers()
    out.slope = wp.vec4(1.0, lift_slope, fold_slope, 1.0 / c.telescope_ratio)
    ways = wp.vec4(q[0], lift, fold, q[3] / c.telescope_ratio) - c.shortest
    for i in range(4):
        way = wp.clamp(ways[i], 0.0, c.stroke[i])
        out.volume_bore[i] = c.fixed_volume + c.bore_area[i] * way
        out.volume_annulus[i] = c.fixed_volume + c.annulus_area[i] * (c.stroke[i] - way)
    return out


@wp.func
def crane_opening(c: CraneHydraulics, spool: float):
    """Opening [-] of a section whose ``spool`` is in −1 … 1."""
    return wp.sign(spool) * wp.max(wp.abs(spool) - c.dead_band, 0.0) / (1.0 - c.dead_band)


@wp.func
def cylinder_torques(c: CraneHydraulics, oil: Oil, s: CraneSections):
    """Torques [N m] of the oil on the joints, the last a force [N]: Σ p dV/dq."""
    out = wp.vec4()
    for i in range(4):
        push = pressure(oil, s.bore[i]) * c.bore_area[i] - pressure(oil, s.annulus[i]) * c.annulus_area[i]
        out[i] = push * s.chambers.slope[i]
    return out


@wp.func
def with_gas(oil: Oil, sections: CraneSections):
    """``sections`` with the free gas of their chambers."""
    out = sections
    for i in range(4):
        bore = free_gas(oil, sections.bore[i])
        annulus = free_gas(oil, sections.annulus[i])
        out.bore_share[i] = bore.share
        out.bore_inverse[i] = bore.inverse_pressure
        out.annulus_share[i] = annulus.share
        out.annulus_inverse[i] = annulus.inverse_pressure
    return out


@wp.func
def filled(c: CraneHydraulics, oil: Oil, s: CraneSections, bore_flow: wp.vec4, annulus_flow: wp.vec4, dt: float):
    """``s`` after ``dt`` [s] of net flows [m³/s] into its chambers."""
    out = s
    for i in range(4):
        nominal = c.fixed_volume + 0.5 * c.bore_area[i] * c.stroke[i]
        gas = Gas(s.bore_share[i], s.bore_inverse[i])
        out.bore[i] = fill_chamber(
            oil, gas, s.bore[i], bore_flow[i], dt, s.chambers.volume_bore[i], c.hose_compliance, nominal
        )
        nominal = c.fixed_volume + 0.5 * c.annulus_area[i] * c.stroke[i]
        gas = Gas(s.annulus_share[i], s.annulus_inverse[i])
        out.annulus[i] = fill_chamber(
            oil, gas, s.annulus[i], annulus_flow[i], dt, s.chambers.volume_annulus[i], c.hose_compliance, nominal
        )
    return out


@wp.func
def displaced(c: CraneHydraulics, oil: Oil, s: CraneSections, moved: wp.vec4):
    """``s`` after the joints have ``moved`` with all valves shut."""
    swept = wp.cw_mul(s.chambers.slope, moved)
    return filled(c, oil, with_gas(oil, s), -wp.cw_mul(c.bore_area, swept), wp.cw_mul(c.annulus_area, swept), 1.0)


@wp.func
def priority_share(c: CraneHydraulics, supply: float, steering_load: float):
    """Share σ [-] of the drop that the priority valve leaves the bank; ``steering_load`` [Pa], 0: the steering rests."""
    if steering_load <= 0.0:
        return 1.0
    return wp.clamp((supply - steering_load - c.priority_pressure) / c.priority_ramp, 0.0, 1.0)


@wp.func
def bank_load(oil: Oil, s: CraneSections):
    """Highest load [Pa] of the open sections; 0: none is open."""
    load = float(0.0)
    for i in range(4):
        if s.opening[i] > 0.0:
            load = wp.max(load, pressure(oil, s.bore[i]))
        if s.opening[i] < 0.0:
            load = wp.max(load, pressure(oil, s.annulus[i]))
    return load


@wp.func
def sections_step(
    c: CraneHydraulics, oil: Oil, s: CraneSections, supply: float, tank: float, load: float, share: float, dt: float
):
    """All sections over a substep of ``dt`` [s] under the bank's highest ``load`` [Pa]: returns (CraneSections, flow drawn
    from the pump [m³/s], flow given to the return line)."""
    lam = oil.laminar_pressure
    drop = share * wp.clamp(supply - load, 0.0, c.pressure_drop)
    bore_flow = wp.vec4()
    annulus_flow = wp.vec4()
    drawn = wp.vec4()
    returned = float(0.0)
    for i in range(4):
        p_b = pressure(oil, s.bore[i])
        p_a = pressure(oil, s.annulus[i])
        relief_b = relief_valve(p_b - tank, c.port_relief, c.port_ramp, c.port_flow)
        relief_a = relief_valve(p_a - tank, c.port_relief, c.port_ramp, c.port_flow)
        swept = s.chambers.slope[i] * s.rate[i]
        into = float(0.0)
        out = float(0.0)
        if s.opening[i] != 0.0:
            cv = wp.abs(s.opening[i]) * c.valve_cv[i]
            p_in = wp.where(s.opening[i] > 0.0, p_b, p_a)
            p_out = wp.where(s.opening[i] > 0.0, p_a, p_b)
            into = orifice(cv, drop, lam)
            held = wp.clamp((p_out + c.pilot_ratio * p_in - c.holding_pressure) / c.holding_ramp, 0.0, 1.0)
            out = held * orifice(cv, wp.max(p_out - tank, 0.0), lam)
        lengthens = s.opening[i] > 0.0
        bore_flow[i] = wp.where(lengthens, into, -out) - relief_b - c.bore_area[i] * swept
        annulus_flow[i] = wp.where(lengthens, -out, into) - relief_a + c.annulus_area[i] * swept
        drawn[i] = into
        returned += out + relief_b + relief_a
    after = filled(c, oil, s, bore_flow, annulus_flow, dt)
    after.torque += cylinder_torques(c, oil, after)
    after.drawn += drawn
    return after, drawn[0] + drawn[1] + drawn[2] + drawn[3], returned


@wp.func
def friction_capacity(c: CraneHydraulics, chambers: CraneChambers, i: int):
    """Dry friction [N m] (N) of joint ``i`` when it breaks away."""
    return c.dry[i] * wp.abs(chambers.slope[i])


@wp.func
def friction_and_stops(c: CraneHydraulics, chambers: CraneChambers, q: wp.vec4, rate: wp.vec4, deflection: wp.vec4):
    """Torques [N m] (N) of friction and end stops on the joints."""
    out = wp.vec4()
    for i in range(4):
        capacity = friction_capacity(c, chambers, i)
        out[i] = (
            dry_friction(deflection[i], rate[i], capacity, capacity / c.presliding, 0.0)
            - c.viscous[i] * chambers.slope[i] * chambers.slope[i] * rate[i]
            + end_stop(q[i] - c.middle[i], rate[i], c.reach[i], c.stop_stiffness[i], c.stop_damping[i])
        )
    return out
