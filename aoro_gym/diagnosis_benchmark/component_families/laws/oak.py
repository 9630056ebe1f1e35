"""Laws of oak: oil by its density with air that dissolves in balance, viscoelastic hoses that curve, a swash plate that
sticks, a pilot-operated relief, a jet pipe behind a Prandtl–Ishlinskii operator, rounded edges, a compensator with mass.

Tires are Rill's first-order TMeasy with bore slip; seals follow their film late; the bearing is elastoplastic.
"""

from typing import Any

import warp as wp

from aoro_gym.diagnosis_benchmark.independent.laws import layout as at
from aoro_gym.diagnosis_benchmark.independent.laws.numbers import HALF, ONE, TWO, ZERO, f64, mccloy, orifice, unit

from . import assembly
from .common import bounded, coulomb, excess, into_ports, passage, relief
from .disturbances import accumulator, other_flow, pinch, pulsation
from .places import (
    ATMOSPHERE,
    BAR,
    COMPENSATOR,
    CONTROL,
    DRIVER,
    GAS,
    GROUND_FLOOR,
    HINGE,
    HYSTERESIS,
    LINE,
    SEAL,
    SENSE,
    SIDE_A,
    SIDE_B,
    SPOOL,
    SPOOL_RATE,
    STROKE,
    SUPPLY,
    TIRE,
    Hydraulic,
    State,
    Tire,
    vec2d,
    vec3d,
    vec4d,
)  # fmt: skip

RETURN, RELIEF, COMPENSATOR_RATE, PLAY = DRIVER, HYSTERESIS, SPOOL_RATE, GAS
"""Pressure [Pa] of the return line, opening of the relief, speed of the compensator [1/s], two plays of the hysteresis."""
FAST, SLOW = wp.constant(f64(0.02)), wp.constant(f64(0.25))
"""Times [s] in which the two branches of a hose's wall relax (E)."""
SHARPEST = wp.constant(f64(0.02))
"""Rounding of the metering edges, share of the spool's stroke (E: 0.1 mm)."""
STILL_SPEED = wp.constant(f64(0.02))
"""Speed [m/s] that keeps slips finite on a standing wheel (Rill 2012)."""


@wp.func
def liquid(pressure: wp.float64, m: Any):
    """Density of the liquid over that without pressure, and its bulk modulus [Pa].

    Dowson, Higginson 1966: ρ/ρ₀ = 1 + A p/(1 + B p), B = 1.7e-9 1/Pa; K = ρ dp/dρ = (1 + B p)(1 + (A + B) p)/A, A = 1/K₀.
    """
    p = wp.max(pressure, ZERO)
    a = ONE / m.bulk_modulus
    b = f64(1.7e-9)
    return vec2d(ONE + a * p / (ONE + b * p), (ONE + b * p) * (ONE + (a + b) * p) / a)


@wp.func
def undissolved(absolute: wp.float64, m: Any):
    """Share of the air that is free in balance, and minus its slope over pressure [1/Pa].

    (1 − x)⁵ (1 + 5 x + 15 x² + 35 x³ + 70 x⁴), x = p/p_sat: Henry's law with smooth ends, of the LMS model in Gholizadeh,
    Burton, Schoenau 2012 (R); its slope is −630 x⁴ (1 − x)⁴.
    """
    x = unit(absolute / m.saturation_pressure)
    u = ONE - x
    share = u * u * u * u * u * (ONE + x * (f64(5.0) + x * (f64(15.0) + x * (f64(35.0) + f64(70.0) * x))))
    xu = x * u
    return vec2d(share, f64(630.0) * xu * xu * xu * xu / m.saturation_pressure)


@wp.func
def softness(pressure: wp.float64, m: Any):
    """Compliance [1/Pa] of oil with air, a unit of volume: liquid and air (polytropic, n = 1.3) side by side."""
    absolute = wp.max(pressure + ATMOSPHERE, f64(0.02) * BAR)
    oil = liquid(pressure, m)
    free = undissolved(absolute, m)
    gas = m.air_share * wp.pow(ATMOSPHERE / absolute, ONE / f64(1.3))
    rest = (ONE - m.air_share) / oil[0]
    soft = rest / oil[1] + gas * (free[0] / (f64(1.3) * absolute) + free[1])
    return soft / (rest + gas * free[0])


@wp.func
def wall(pressure: wp.float64, fast: wp.float64, slow: wp.float64, m: Any):
    """Rates [1/s] of the strains of both branches of a hose's wall, and their part of the whole strain's rate.

    Maxwell–Wiechert: p = E∞ ε + E₁ (ε − ε₁) + E₂ (ε − ε₂), ε̇ᵢ = (ε − εᵢ)/τᵢ (Ferry: Viscoelastic
    Properties of Polymers, 1980).
    """
    glassy = m.hose_relaxed + m.wall_fast + m.wall_slow
    strain = (pressure + m.wall_fast * fast + m.wall_slow * slow) / glassy
    one = (strain - fast) / FAST
    two = (strain - slow) / SLOW
    return vec3d(one, two, (m.wall_fast * one + m.wall_slow * two) / glassy)


@wp.func
def characteristic(demand: wp.float64, most: wp.float64):
    """Force [N] of a tire over what it would be in proportion to the slip: Rill's TMeasy of that ``demand`` [N].

    Largest, ``most``, where three times as much is asked, 92 % of it from seven times on; F = F₀′ s/(1 + σ (σ + 1)) with
    σ = s/s_M before, a cubic between (Hirschberg, Rill, Weinfurter 2007; Rill 2012).
    """
    g = demand / most
    part = g / f64(3.0)
    force = g / (ONE + part * (part + ONE))
    if part > ONE:
        fall = unit((g - f64(3.0)) / f64(4.0))
        force = ONE - f64(0.08) * fall * fall * (f64(3.0) - TWO * fall)
    return force / wp.max(g, f64(1e-9))


@wp.func
def tire(x: Any, m: Any, wheel: int, motion: vec4d, load: wp.float64):
    """First-order TMeasy tire: c z + d ż = f (v − ż)/v_T, so that ż = (f v − v_T c z)/(v_T d + f), v_T = |V| + v_N.

    Rill: Road Vehicle Dynamics, 2012. Slips along, across and of the bore (turning on the spot, radius R_B) make one
    generalised slip; f is the force over it. Rates of the deflections, then forces along, across, and moment.
    """
    most = m.grip_sticking * load
    share = load / m.load_mean
    carried = wp.abs(motion[2]) + STILL_SPEED
    stiff = vec3d(m.stiffness_along, m.stiffness_across, m.twist_stiffness)
    damping = vec3d(m.tire_damping, m.tire_damping, f64(0.02) * m.twist_stiffness)
    speed = vec3d(motion[0], motion[1], motion[3])
    reach = vec3d(ONE, ONE, m.bore_radius)
    asked = ZERO
    for i in range(3):
        one = stiff[i] * m.relaxation_length * share * speed[i] / (carried * reach[i])
        asked += one * one
    yielding = characteristic(wp.sqrt(asked), most)
    t = Tire()
    for i in range(3):
        z = x[TIRE + 3 * wheel + i]
        f = yielding * stiff[i] * m.relaxation_length * share
        t[i] = (f * speed[i] - carried * stiff[i] * z) / (carried * damping[i] + f)
        force = stiff[i] * z + damping[i] * t[i]
        if i > 0:
            force = -force
        t[3 + i] = force
    return t


@wp.func
def resistance(x: Any, m: Any, wheel: int, load: wp.float64):
    """Torque [N m] against a wheel: radial stress in ground (Wong, Reece 1967), a dry brake, and oil churned by ω².

    Stress in a triangle from the entry angle θ_e ∝ F^⅓ to its peak at (0.4 + 0.2 s) θ_e: R/F = θ_e (1.4 + 0.2 s)/3.
    """
    speed = x[at.WHEEL + wheel]
    rolled = m.tire_radius * speed
    slip = unit(wp.abs(rolled - x[at.VX]) / (wp.abs(rolled) + f64(0.3)))
    soil = m.soil_rolling * wp.pow(load / m.load_mean, ONE / f64(3.0)) * (ONE + slip / f64(7.0))
    dry = (m.tire_rolling + soil) * load * m.tire_radius + m.brake_torque
    return dry * coulomb(speed, f64(0.03)) + m.churning * wp.abs(speed) * speed


@wp.func
def hinge(x: Any, m: Any):
    """Elastoplastic friction of the bearing: ż = ω (1 − α σ z/T), α nought up to 60 % of the breakaway, one at it.

    Dupont, Hayward, Armstrong, Altpeter 2002; α rises as half a sine where ω goes on, and is nought where it turns back.
    """
    rate = x[at.RATE_FRONT] - x[at.RATE_REAR]
    stiffness = f64(3.5e5)
    share = stiffness * x[HINGE] / m.hinge_torque
    plastic = ZERO
    if share * rate > ZERO:
        plastic = HALF - HALF * wp.cos(f64(wp.pi) * unit((wp.abs(share) - f64(0.6)) / f64(0.4)))
    bristle = rate - wp.abs(rate) * plastic * share
    return vec2d(stiffness * x[HINGE] + f64(250.0) * bristle + f64(120.0) * rate, bristle)


@wp.func
def seals(x: Any, m: Any, c: Any, inputs: Any):
    """Friction of both cylinders by a film that follows the speed late, as a torque [N m].

    Hess, Soom 1990: F_c + (F_s − F_c)/(1 + (v/v_s)²) of the speed some milliseconds ago, here behind a lag of 8 ms; viscous
    without lag. The direction is the present one, so that power is never made.
    """
    torque = ZERO
    rates = vec2d()
    sliding = m.seal_force / m.seal_ratio
    for side in range(2):
        lever = c[4 + side]
        v = lever * x[at.ROD_RATE]
        ratio = x[SEAL + side] / m.stribeck_speed
        rates[side] = (v - x[SEAL + side]) / f64(0.008)
        dry = sliding + (m.seal_force - sliding) / (ONE + ratio * ratio)
        torque += lever * (dry * coulomb(v, f64(0.004)) + m.seal_viscosity * inputs[at.VISCOSITY] * v)
    return vec3d(torque, rates[0], rates[1])


@wp.func
def beyond(stretch: wp.float64, gap: wp.float64):
    """Stretch beyond a free play ±w and its slope: s³/(6.75 w²) up to 1.5 w, s − w from there on."""
    size = wp.abs(stretch)
    past = vec2d(wp.sign(stretch) * (size - gap), ONE)
    if size < f64(1.5) * gap:
        share = size / gap
        past = vec2d(stretch * share * share / f64(6.75), share * share / f64(2.25))
    return past


@wp.func
def rods(x: Any, m: Any):
    """Torque [N m] of bolted brackets that stiffen with load, k e (1 + (k e/T₀)²), T₀ = 55 kN m, behind a smooth play."""
    rate = x[at.ROD_RATE] - x[at.RATE_FRONT] + x[at.RATE_REAR]
    past = beyond(x[at.ROD] - x[at.ANGLE], m.joint_play)
    straight = m.joint_stiffness * past[0]
    stiffer = straight / f64(5.5e4)
    return vec2d(straight * (ONE + stiffer * stiffer) + m.joint_damping * past[1] * rate, ZERO)


@wp.func
def engine(x: Any, m: Any, load: wp.float64):
    """Governor on a torque that waits for the turbocharger, the longer the more of it is asked: rates of both.

    Lag 20 ms downwards, 20 to 140 ms upwards (Winterbone, Benson, Closs 1973; Rakopoulos, Giakoumis 2009, R); torque at full
    load falls off the rated speed by a parabola.
    """
    away = x[at.ENGINE] - m.engine_speed
    goal = m.engine_idle_torque - away / (m.droop * m.engine_speed) * f64(200.0)
    goal = wp.clamp(goal, ZERO, f64(650.0) - f64(0.03) * away * away)
    lag = f64(0.02)
    if goal > x[at.GOVERNOR]:
        lag += f64(0.12) * goal / f64(650.0)
    return vec2d((x[at.GOVERNOR] - load) / m.engine_inertia, (goal - x[at.GOVERNOR]) / lag)


@wp.func
def land(depth: wp.float64):
    """Opening of an edge of rounding r by a ``depth``: √(x² + r²) − r, closed below nought (Merritt 1967)."""
    x = wp.max(depth, ZERO)
    return wp.sqrt(x * x + SHARPEST * SHARPEST) - SHARPEST


@wp.func
def opening(spool: wp.float64, m: Any):
    """Share of the edge that is open: rectangular lands of three widths behind each other, all with rounded edges."""
    s = wp.min(wp.abs(spool), f64(1.1))
    area = m.first_left * land(s - m.band_left) + m.second_left * land(s - HALF) + m.third_left * land(s - f64(0.75))
    if spool < ZERO:
        area = m.first_right * land(s - m.band_right)
        area += m.second_right * land(s - HALF) + m.third_right * land(s - f64(0.75))
    return area


@wp.func
def curved(drop: wp.float64, losses: wp.float64, line: wp.float64, more: wp.float64, m: Any, viscosity: wp.float64):
    """Flow [m³/s] of a drop over edges and a curved hose, and the hose's resistance [Pa s/m³].

    Straight: Hagen–Poiseuille. Curved: times 1 + 0.033 (lg De)⁴, De = Re √(D/D_c) (Mishra, Gupta 1979); the Dean number is
    that of the flow without it.
    """
    plain = passage(drop, losses, line + more)
    log = wp.log10(wp.max(m.dean * plain / viscosity, ONE))
    bent = line * (ONE + f64(0.033) * log * log * log * log) + more
    return vec2d(passage(drop, losses, bent), bent)


@wp.func
def flows(x: Any, m: Any, inputs: Any):
    """Flows [m³/s] out of the supply and into the return line, drop [Pa] over the metering edge, sensed pressure.

    Discharge coefficient of edges: C_d tanh of the flow number at the regulated drop (McCloy, Martin 1980). Before the port
    a load check; hoses develop their flow over the entrance, 1.25 ρ v²/2 (Shah, London 1978).
    """
    left = x[SPOOL] > ZERO
    port = x[SIDE_B]
    other = x[SIDE_A]
    nominal = m.edge_right
    added = ZERO
    block = ZERO
    if left:
        port = x[SIDE_A]
        other = x[SIDE_B]
        nominal = m.edge_left
        added = pinch(x, m)
        block = m.half_block
    viscosity = inputs[at.VISCOSITY]
    area = opening(x[SPOOL], m)
    through = m.discharge * wp.tanh(area / (f64(1.1) * viscosity)) * area + f64(1e-7)
    edge = nominal * through
    throttle = m.compensator_passage * (x[COMPENSATOR] + f64(1e-6))
    losses = ONE / (throttle * throttle) + ONE / (m.check_passage * m.check_passage) + m.entrance_loss
    line = m.line_resistance * viscosity
    inward = curved(x[SUPPLY] - port, ONE / (edge * edge) + losses, line, added, m, viscosity)
    back = m.return_edge * through * (ONE - block)
    outward = curved(other - x[RETURN], ONE / (back * back) + m.entrance_loss, line, ZERO, m, viscosity)
    sensed = port + inward[1] * inward[0]
    drop = inward[0] * inward[0] / (edge * edge)
    return vec4d(inward[0], outward[0], drop, wp.where(area > f64(1e-3), sensed, m.tank_pressure))


@wp.func
def leaks(x: Any, m: Any, inputs: Any):
    """Leakage [m³/s] from A to B: past pistons in a gap, between ports through a short bore.

    Gap: Poiseuille with h³ and Barus' viscosity, (e^(−α p_B) − e^(−α p_A))/α in place of the drop, α = 2e-8 1/Pa (Hamrock,
    Schmid, Jacobson 2004). Bore: root of the drop, laminar below a drop that grows as μ² (McCloy, Martin 1980).
    """
    alpha = f64(2e-8)
    a = wp.exp(-alpha * x[SIDE_A])
    b = wp.exp(-alpha * x[SIDE_B])
    gap = m.gap_conductance / inputs[at.VISCOSITY] * (b - a) / alpha
    thick = inputs[at.VISCOSITY] / f64(0.04)
    return gap + mccloy(m.port_leakage, x[SIDE_A] - x[SIDE_B], f64(4.0) * BAR * thick * thick)


@wp.func
def port(pressure: wp.float64, m: Any):
    """Flow [m³/s] into a port from its anti-cavitation check, less that of its shock valve."""
    return relief(m.tank_pressure, pressure, f64(3e-9)) - relief(pressure, m.shock_pressure, f64(6e-10))


@wp.func
def into_sides(x: Any, m: Any, inputs: Any, f: vec4d):
    """Flows [m³/s] into A and into B."""
    return into_ports(x[SPOOL], f, port(x[SIDE_A], m), port(x[SIDE_B], m), leaks(x, m, inputs))


@wp.func
def side_rates(d: State, x: Any, m: Any, c: Any, into: vec2d):
    """Rates of both sides' pressures and of their hoses' walls: Q − V̇ = (V/K) ṗ + V_h ε̇."""
    glassy = m.hose_relaxed + m.wall_fast + m.wall_slow
    for i in range(2):
        p = x[SIDE_A + i]
        w = wall(p, x[LINE + 2 * i], x[LINE + 2 * i + 1], m)
        soft = (c[i] + m.hose_volume) * softness(p, m) + m.hose_volume / glassy
        if i == 0:
            soft += accumulator(p, m)
        d[LINE + 2 * i] = w[0]
        d[LINE + 2 * i + 1] = w[1]
        d[SIDE_A + i] = (into[i] - c[2 + i] * x[at.ROD_RATE] - m.hose_volume * w[2]) / soft
    return d


@wp.func
def pump_rates(d: State, x: Any, m: Any, inputs: Any, f: vec4d):
    """Rates of the supply: swash plate with mass behind a friction that holds small errors (Zeiger, Akers 1985), power
    regulator p V ≤ T, case drain by pressure and speed, pilot-operated relief whose main stage follows its pilot (Merritt
    1967)."""
    given = x[STROKE] * m.pump_displacement * x[at.ENGINE] * pulsation(m, inputs)
    drained = m.pump_leakage * x[SUPPLY] * (HALF + HALF * x[at.ENGINE] / m.engine_speed)
    pilot = unit((x[SUPPLY] - m.relief_pressure) / m.relief_band)
    lifted = f64(0.4) * pilot + f64(0.6) * x[RELIEF]
    lost = drained + orifice(m.relief_passage * lifted, x[SUPPLY], BAR) + f[0] + other_flow(x[SUPPLY], m, inputs)
    rise = (given - lost) / (m.supply_volume * (softness(x[SUPPLY], m) + ONE / m.hose_relaxed))
    d[SUPPLY] = rise
    d[RELIEF] = (pilot - x[RELIEF]) / m.relief_lag
    d[SENSE] = (wp.max(f[3], ZERO) - x[SENSE]) / m.sense_lag
    error = m.margin + x[SENSE] - x[SUPPLY] - m.regulator_lead * rise
    power = (m.torque_limit / m.pump_displacement - x[SUPPLY] * x[STROKE]) / wp.max(x[STROKE], f64(0.3))
    wanted = excess(wp.min(error, power), m.swash_friction) * TWO / (m.margin * m.stroke_time)
    goal = wp.clamp(wanted, -TWO / m.stroke_time, ONE / m.stroke_time)
    d[CONTROL] = (goal - x[CONTROL]) / m.swash_lag
    d[STROKE] = bounded(x[CONTROL], x[STROKE])
    return d


@wp.func
def valve_rates(d: State, x: Any, m: Any, inputs: Any, f: vec4d):
    """Rates of the valve: hysteresis by Prandtl and Ishlinskii, w₀ u + w₁ P₁(u) + w₂ P₂(u) with plays of r and 2.5 r
    (Krejčí, Kuhnen 2001), a jet pipe that saturates by the pilot pressure, a compensator of mass, spring and orifice."""
    u = inputs[at.COMMAND] + m.null_shift
    d[PLAY] = excess(u - x[PLAY], m.play_width) / f64(0.0015)
    d[PLAY + 1] = excess(u - x[PLAY + 1], f64(2.5) * m.play_width) / f64(0.0015)
    away = f64(0.3) * u + f64(0.4) * x[PLAY] + f64(0.3) * x[PLAY + 1] - x[SPOOL]
    fed = wp.clamp(x[SUPPLY] / (f64(25.0) * BAR), f64(0.08), ONE)
    speed = away / m.spool_lag
    ratio = speed / (m.spool_rate * wp.sqrt(fed))
    d[SPOOL] = speed / wp.sqrt(ONE + ratio * ratio)
    balance = unit(HALF + (m.edge_drop - f[2]) / (f64(0.7) * m.edge_drop))
    w = m.compensator_frequency
    d[COMPENSATOR] = x[COMPENSATOR_RATE]
    push = balance - x[COMPENSATOR] - m.compensator_lag * x[COMPENSATOR_RATE]
    d[COMPENSATOR_RATE] = w * w * push
    return d


@wp.func
def return_flow(drop: wp.float64, m: Any, viscosity: wp.float64):
    """Flow [m³/s] through the long return hose, turbulent by Blasius: Δp ∝ μ^¼ Q^(7/4), laminar below 0.1 bar."""
    thick = wp.pow(viscosity / f64(0.04), ONE / f64(7.0))
    return m.return_passage / thick * drop / wp.pow(drop * drop + f64(0.01) * BAR * BAR, f64(3.0) / f64(14.0))


@wp.func
def hydraulics(d: State, x: Any, m: Any, inputs: Any, c: Any):
    """Derivatives of pressures, pump, valve, and of the return line with its bladder (isothermal: C = V₀ p₀/p²)."""
    f = flows(x, m, inputs)
    d = side_rates(d, x, m, c, into_sides(x, m, inputs, f))
    d = pump_rates(d, x, m, inputs, f)
    d = valve_rates(d, x, m, inputs, f)
    absolute = wp.max(x[RETURN] + ATMOSPHERE, f64(0.5) * BAR)
    soft = f64(3e-11) + m.return_gas * f64(1.5) * BAR / (absolute * absolute)
    d[RETURN] = (f[1] - return_flow(x[RETURN] - m.tank_pressure, m, inputs[at.VISCOSITY])) / soft
    return d


@wp.func
def limit(x: State, m: Any):
    """Stops of the swash plate and of the compensator, pressures at boiling oil."""
    if (x[STROKE] <= ZERO and x[CONTROL] < ZERO) or (x[STROKE] >= ONE and x[CONTROL] > ZERO):
        x[CONTROL] = ZERO
    x[STROKE] = unit(x[STROKE])
    place = x[COMPENSATOR]
    if (place <= ZERO and x[COMPENSATOR_RATE] < ZERO) or (place >= ONE and x[COMPENSATOR_RATE] > ZERO):
        x[COMPENSATOR_RATE] = ZERO
    x[COMPENSATOR] = unit(place)
    for i in range(3):
        x[SIDE_A + i] = wp.max(x[SIDE_A + i], GROUND_FLOOR)
    return x


@wp.func
def start(m: Any, angle: wp.float64):
    """State at rest: walls of hoses relaxed, no pressure over the return hose."""
    x = assembly.at_rest(State(), m, angle)
    for i in range(4):
        x[LINE + i] = m.rest_pressure / m.hose_relaxed
    x[RETURN] = m.tank_pressure
    return x


@wp.func
def hydraulic_signals(x: Any, m: Any, inputs: Any):
    """Pressures a, b, pump; flows into a and b; spool."""
    into = into_sides(x, m, inputs, flows(x, m, inputs))
    return Hydraulic(x[SIDE_A], x[SIDE_B], x[SUPPLY], into[0], into[1], x[SPOOL])
