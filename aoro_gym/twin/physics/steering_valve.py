"""The steering valve: spool, opening curve, metering edges, pressure compensator, shock and anti-cavitation valves.

Sources: Merritt (1967) ch. 3–5 and 7; Lehto et al. (Machines 2026, 14, 128) for the measured opening curve and the laminar
limit.
"""

# pyright: reportGeneralTypeIssues=false, reportInvalidTypeForm=false
import warp as wp

from aoro_gym.twin.physics.fluid import check_valve, inverse_root, orifice, relief_valve
from aoro_gym.twin.physics.laws import option
from aoro_gym.twin.physics.steering_circuit import Steering, SteeringState

SPOOL_SECOND_ORDER = option("spool", "second_order")
OPENING_SMOOTH = option("opening", "smooth")
ORIFICE_SMOOTH = option("orifice", "smooth")
COMPENSATOR_STATIC = option("compensator", "static")
COMPENSATOR_SPRING_MASS = option("compensator", "spring_mass")
SENSES_LOAD_SENSING_LINE = option("compensator_sensing", "load_sensing_line")
FLOW_FORCE_STEADY = option("flow_force", "steady")
SHOCK_VALVE_LAG = option("shock_valve", "lag")


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
def hermite(x: float, x_0: float, x_1: float, y_0: float, y_1: float, slope_0: float, slope_1: float):
    """Cubic between two points with given slopes, constant beyond them (Fritsch & Carlson, SIAM J. Numer. Anal. 17, 1980).
    """
    h = x_1 - x_0
    s = wp.clamp((x - x_0) / h, 0.0, 1.0)
    rest = 1.0 - s
    return (
        (1.0 + 2.0 * s) * rest * rest * y_0
        + s * s * (3.0 - 2.0 * s) * y_1
        + h * s * rest * (rest * slope_0 - s * slope_1)
    )


@wp.func
def knot_slope(h_0: float, h_1: float, secant_0: float, secant_1: float):
    """Slope at the point between two intervals of the widths h that keeps the cubic monotone: the weighted harmonic mean of
    both secants (Fritsch & Butland, SIAM J. Sci. Stat. Comput. 5, 1984); 0 where one is."""
    w_0 = 2.0 * h_1 + h_0
    w_1 = h_1 + 2.0 * h_0
    slope = float(0.0)
    if secant_0 > 0.0 and secant_1 > 0.0:
        slope = (w_0 + w_1) / (w_0 / secant_0 + w_1 / secant_1)
    return slope


@wp.func
def smooth_opening(spool: float, overlap: float, dead_band: float, opening_1V0: float, opening_1V5: float):
    """:func:`valve_opening` without kinks: a monotone cubic through the same points, that lifts off with slope 0 at the end
    of the dead band and ends with the last secant."""
    volts = 2.0 * wp.abs(spool) - overlap
    first = opening_1V0 / (1.0 - dead_band)
    second = 2.0 * (opening_1V5 - opening_1V0)
    third = 2.0 * (1.0 - opening_1V5)
    slope_1V0 = knot_slope(1.0 - dead_band, 0.5, first, second)
    slope_1V5 = knot_slope(0.5, 0.5, second, third)
    opening = hermite(volts, dead_band, 1.0, 0.0, opening_1V0, 0.0, slope_1V0)
    if volts > 1.0:
        opening = hermite(volts, 1.0, 1.5, opening_1V0, opening_1V5, slope_1V0, slope_1V5)
    if volts > 1.5:
        opening = hermite(volts, 1.5, 2.0, opening_1V5, 1.0, slope_1V5, third)
    return opening


@wp.func
def edge_flow(m: Steering, coefficient: float, drop: float, lam: float):
    """Flow [m³/s] through an edge of the valve, by the law of orifices: :func:`orifice`, or without its kink at ``lam`` [Pa]
    Q = C Δp/(Δp² + p_lam²)^¼ (Borutzky, Barnard & Thoma, Simul. Model. Pract. Theory 10, 2002): the same laminar slope
    C/√p_lam, and C √Δp far above."""
    flow = float(0.0)
    if m.orifice_law == ORIFICE_SMOOTH:
        flow = coefficient * drop * wp.sqrt(inverse_root(drop * drop + lam * lam))
    else:
        flow = orifice(coefficient, drop, lam)
    return flow


@wp.func
def spool_step(m: Steering, spool: float, rate: float, demand: float, dt: float):
    """Spool [-] and its rate [1/s] after ``dt``, by the law of spools.

    First order: τ ẋ = u − x. Second order: ẍ = ω² (u − x) − 2 ζ ω ẋ (Merritt 1967, ch. 7), semi-implicit. Both within the
    pilot's rate limit.
    """
    out = float(spool)
    out_rate = float(0.0)
    if m.spool_law == SPOOL_SECOND_ORDER:
        omega = m.valve_spool_frequency
        out_rate = (rate + dt * omega * omega * (demand - spool)) / (1.0 + 2.0 * m.valve_spool_damping * omega * dt)
        out_rate = wp.clamp(out_rate, -m.valve_spool_rate_limit, m.valve_spool_rate_limit)
        out = spool + dt * out_rate
    else:
        fastest = dt * m.valve_spool_rate_limit
        out = spool + wp.clamp((dt / m.valve_spool_time_constant) * (demand - spool), -fastest, fastest)
        # a way that a step does not resolve is left to none
        out = wp.where(out == spool, demand, out)
    return out, out_rate


@wp.func
def closed_by_flow(m: Steering, demand: float, opening: float, drop: float):
    """Demand [-] on the spool less what the steady flow force moves it: F = 2 C_d A Δp cos 69° closes the edge (Merritt
    1967, ch. 5), over the centring spring a share of the stroke that goes with A Δp, ``flow_force_share`` of it with the
    edge fully open and its ``drop`` the compensator's setting."""
    moved = m.valve_flow_force_share * opening * drop / m.valve_compensator_pressure
    return wp.sign(demand) * wp.max(wp.abs(demand) - moved, 0.0)


@wp.func
def edge_drop(y: float, available: float, square: float):
    """Drop [Pa] over the metering edge, Δp y²/(y² + ρ²), of the ``available`` drop Δp [Pa] with the compensator at ``y``;
    ``square`` is ρ², of the edge over the open compensator."""
    return available * y * y / (y * y + square)


@wp.func
def compensator_excess(m: Steering, y: float, available: float, square: float, bias: float):
    """Pressures [Pa] on the compensator less its spring at the opening ``y``, Δp_edge + b − p_ref (1 + κ (½ − y)), and how
    it rises with y."""
    wide = y * y + square
    spring = m.valve_compensator_pressure * m.valve_compensator_droop
    excess = edge_drop(y, available, square) + bias - m.valve_compensator_pressure - spring * (0.5 - y)
    return excess, 2.0 * available * y * square / (wide * wide) + spring


@wp.func
def static_compensator(m: Steering, y: float, available: float, ratio: float, bias: float):
    """Opening at which spring and pressures balance, or a stop: three Newton steps from the last opening ``y``.

    The excess rises with y, convex up to y = ρ/√3 and concave beyond. On the side of that point where its root lies, and no
    step may leave, the steps after the first come nearer from the one side on which the tangent does not overshoot.
    """
    square = wp.max(ratio * ratio, 1.0e-12)
    turn = wp.min(wp.sqrt(square * (1.0 / 3.0)), 1.0)
    at_turn, steepest = compensator_excess(m, turn, available, square, bias)
    low = wp.where(at_turn < 0.0, turn, 0.0)
    high = wp.where(at_turn < 0.0, 1.0, turn)
    out = wp.clamp(y, low, high)
    for _ in range(3):
        excess, slope = compensator_excess(m, out, available, square, bias)
        out = wp.clamp(out - excess / wp.max(slope, 1.0e-6 * (steepest + 1.0)), low, high)
    return out


@wp.func
def spring_mass_compensator(
    m: Steering, y: float, rate: float, available: float, ratio: float, bias: float, dt: float
):
    """Opening and rate [1/s] after ``dt`` of a compensator with mass, ÿ = ω² (1 + κ (½ − y) − (Δp_edge + b)/p_ref) −
    2 ζ ω ẏ, with ω² = setting × area over mass × stroke and inelastic stops at 0 and 1."""
    omega = m.valve_compensator_frequency
    square = wp.max(ratio * ratio, 1.0e-12)
    sensed = edge_drop(y, available, square) + bias
    push = 1.0 + m.valve_compensator_droop * (0.5 - y) - sensed / m.valve_compensator_pressure
    moved = (rate + dt * omega * omega * push) / (1.0 + 2.0 * m.valve_compensator_damping * omega * dt)
    out = y + dt * moved
    if out > 1.0 or out < 0.0:
        moved = float(0.0)
    return wp.clamp(out, 0.0, 1.0), moved


@wp.func
def compensator_step(m: Steering, y: float, available: float, ratio: float, bias: float, dt: float):
    """Compensator opening after ``dt``: τ p_ref ẏ = p_ref (1 + κ(½ − y)) − Δp_edge, with stops at 0 and 1.

    Spring against the drop over the metering edge, damped by its pilot orifice; Δp_edge = Δp y²/(y² + ρ²) of the
    ``available`` drop Δp [Pa], ``ratio`` ρ = edge over open compensator. Δp_edge vanishes with y, so it is taken as
    (Δp_edge/y) y′ with the new y′: the step keeps y positive and converges to the static balance at any dt. The law is
    faster than the volumes, hence two steps of dt/2, each taken as the small change that it is: rounding of y′ as a ratio
    of two large sums would be a drift at short steps. ``bias`` b [Pa] is what it senses on top of the edge's drop, where
    it does not feel the port itself.
    """
    setting = m.valve_compensator_pressure
    droop = m.valve_compensator_droop
    rate = 0.5 * dt / (setting * m.valve_compensator_time_constant)
    opened = rate * setting * (1.0 + 0.5 * droop)
    if m.compensator_sensing_law == SENSES_LOAD_SENSING_LINE:
        opened -= rate * bias
    slope = rate * setting * droop
    square = wp.max(ratio * ratio, 1.0e-12)
    wide = y * y + square
    closing = slope * wide + rate * available * y
    half = wp.min(y + (opened * wide - closing * y) / (wide + closing), 1.0)
    if m.compensator_sensing_law == SENSES_LOAD_SENSING_LINE:
        half = wp.max(half, 0.0)
    wide = half * half + square
    closing = slope * wide + rate * available * half
    out = wp.min(half + (opened * wide - closing * half) / (wide + closing), 1.0)
    if m.compensator_sensing_law == SENSES_LOAD_SENSING_LINE:
        out = wp.max(out, 0.0)
    return out


@wp.struct
class Metering:
    """Flows through the metering edges, which one side of the valve works at a time."""

    left: bool  # the side that works
    available: float  # [Pa] drop over compensator and meter-in edge
    ratio: float  # [-] meter-in edge over open compensator
    flow_in: float  # [m³/s]
    flow_out: float  # [m³/s]
    load_pressure: float  # [Pa] of the loaded port, where the valve is open
    opening: float  # [-] of the edges


@wp.func
def metering(m: Steering, lam: float, s: SteeringState, p_s: float, p_a: float, p_b: float, p_t: float):
    """Valve section at pressures [Pa] of supply, ports and return line: compensator and meter-in edge in series behind a
    load check, and the meter-out edge."""
    left = s.spool > 0.0
    dead_band = wp.where(left, m.valve_dead_band_left, m.valve_dead_band_right)
    opening_1V0 = wp.where(left, m.valve_opening_left_1V0, m.valve_opening_right_1V0)
    opening_1V5 = wp.where(left, m.valve_opening_left_1V5, m.valve_opening_right_1V5)
    opening = float(0.0)
    if m.opening_law == OPENING_SMOOTH:
        opening = smooth_opening(s.spool, m.valve_overlap, dead_band, opening_1V0, opening_1V5)
    else:
        opening = valve_opening(s.spool, m.valve_overlap, dead_band, opening_1V0, opening_1V5)
    cv_in = wp.where(left, m.valve_cv_in_left, m.valve_cv_in_right)
    cv_out = wp.where(left, m.valve_cv_out_left, m.valve_cv_out_right)
    p_load = wp.where(left, p_a, p_b)
    p_unload = wp.where(left, p_b, p_a)
    out = Metering()
    out.left = left
    out.available = wp.where(opening > 0.0, wp.max(p_s - p_load, 0.0), 0.0)
    out.ratio = opening * (cv_in / m.valve_cv_compensator)
    share = s.compensator * inverse_root(wp.max(s.compensator * s.compensator + out.ratio * out.ratio, 1.0e-12))
    out.flow_in = edge_flow(m, opening * cv_in * share, out.available, lam)
    out.flow_out = edge_flow(m, opening * cv_out, p_unload - p_t, lam)
    out.load_pressure = wp.where(opening > 0.0, p_load, 0.0)
    out.opening = opening
    return out


@wp.func
def shock_flow(m: Steering, port: float, tank: float):
    """Flow [m³/s] of a port's open relief valve."""
    return relief_valve(port - tank, m.valve_shock_pressure, m.valve_shock_ramp, m.valve_shock_flow)


@wp.func
def port_to_tank(m: Steering, lam: float, port: float, tank: float, lagged_shock: float):
    """Flow [m³/s] from a port to the return line past the metering edges: port relief, leakage, anti-cavitation.
    ``lagged_shock`` [m³/s] is that of the relief where it opens late."""
    shock = shock_flow(m, port, tank)
    if m.shock_valve_law == SHOCK_VALVE_LAG:
        shock = lagged_shock
    suction = check_valve(m.valve_cv_anticavitation, tank - port, m.valve_anticavitation_crack, lam)
    return shock + m.valve_leakage * (port - tank) - suction
