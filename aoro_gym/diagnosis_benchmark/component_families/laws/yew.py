"""Laws of yew, old and worn: bubbles that diffuse into the oil, hoses with rubbing braids, a vane pump that leaks, a relief
that pops, a lever on a Bowden cable, rhombic ports, a compensator whose felt drop a worn piston divides.

Radial tires are standing brushes under parabolic pressure behind a belt; seals by Andersson, the bearing by rate and state,
pins by squeezed films.
"""

from typing import Any

import warp as wp

from aoro_gym.diagnosis_benchmark.independent.laws import layout as at
from aoro_gym.diagnosis_benchmark.independent.laws.numbers import HALF, ONE, TWO, ZERO, check, f64, unit

from . import assembly
from .common import bounded, excess, into_ports, passage, relief
from .disturbances import accumulator, other_flow, pinch, pulsation
from .places import (
    ATMOSPHERE,
    BAR,
    COMPENSATOR,
    GAS,
    GROUND_FLOOR,
    HINGE,
    HYSTERESIS,
    LINE,
    SENSE,
    SIDE_A,
    SIDE_B,
    SPOOL,
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

BRAID, RELIEF = LINE, LINE + 2
"""Pressures [Pa] that rubbing braids of A and B hold; lift of the relief, share of the whole one."""
CURVATURE = wp.constant(f64(5.5))
"""Bridgman's second coefficient over the square of the first (S27: modulus grows by 10 times the pressure)."""
REACH = wp.constant(f64(1.25))
"""Deflection of a brush, of the one at which all of it slides, beyond which it only slides."""
CALM, WEAK, SLIDE, CREEPING = (
    wp.constant(f64(0.25)), wp.constant(f64(0.30)), wp.constant(f64(3e-3)), wp.constant(f64(0.01)),
)  # fmt: skip
"""Direct and evolving effect of the bearing, its slip distance [rad] and reference speed [rad/s] (E)."""


@wp.func
def liquid(pressure: wp.float64, m: Any):
    """Volume of the liquid over that without pressure, and its bulk modulus [Pa].

    Bridgman 1931: v = 1 − p/K₀ + c (p/K₀)², to 500 bar.
    """
    q = wp.max(pressure, ZERO) / m.bulk_modulus
    volume = ONE - q + CURVATURE * q * q
    return vec2d(volume, m.bulk_modulus * volume / (ONE - TWO * CURVATURE * q))


@wp.func
def softness(pressure: wp.float64, free: wp.float64, m: Any):
    """Compliance [1/Pa] of oil with bubbles of which a share is ``free``, isothermal (Boyle), and their volume over the
    oil's."""
    absolute = wp.max(pressure + ATMOSPHERE, f64(0.02) * BAR)
    oil = liquid(pressure, m)
    gas = m.foam_share * free * ATMOSPHERE / absolute
    return vec2d((ONE - m.foam_share) * oil[0] / oil[1] + gas / absolute, gas)


@wp.func
def diffusion(pressure: wp.float64, free: wp.float64, m: Any):
    """Rate [1/s] of the free share of bubbles: R Ṙ ∝ −(p − p₀), so ∝ −∛φ (p − p₀), as given at 30 bar over the atmosphere.

    Epstein, Plesset 1950, bubbles apart from each other in oil that the atmosphere saturates.
    """
    root = wp.cbrt(wp.max(free, ZERO) + f64(1e-4))
    rate = -root * pressure / (f64(30.0) * BAR * m.foam_time)
    return bounded(rate, free)


@wp.func
def brush(demand: wp.float64):
    """Force of a standing brush over its largest, by its deflection q ≥ 0 over the one at which all of it slides.

    Under parabolic pressure bristles slide where q > 1 − ξ², ξ the place over half the patch: 3/2 (q w + 2/3 − w + w³/3),
    w = √(1 − q) (after Fromm; Pacejka 2012, chapter 3, without rolling).
    """
    q = unit(demand)
    w = wp.sqrt(ONE - q)
    return f64(1.5) * (q * w + TWO / f64(3.0) - w + w * w * w / f64(3.0))


@wp.func
def tire(x: Any, m: Any, wheel: int, motion: vec4d, load: wp.float64):
    """Brush on a belt, its stiffness that of both: deflections released as it rolls, and by sliding beyond the limit.

    Twist: a ring of brushes at the mean radius of a long patch, M = r μ F f(q). Rates, forces along, across, and moment.
    """
    most = m.grip * load
    rolled = wp.abs(motion[2]) / m.relaxation_length
    along = m.stiffness_along * x[TIRE + 3 * wheel] / (f64(1.5) * most)
    across = m.stiffness_across * x[TIRE + 3 * wheel + 1] / (f64(1.5) * most)
    demand = wp.sqrt(along * along + across * across)
    rising = along * m.stiffness_along * motion[0] + across * m.stiffness_across * motion[1]
    over = demand / REACH
    loose = wp.max(rising, ZERO) / (f64(1.5) * most) * over * over * over * over / (REACH * REACH)
    force = f64(1.5)
    if demand > f64(1e-6):
        force = brush(demand) / demand
    t = Tire()
    for i in range(2):
        t[i] = motion[i] - (rolled + loose) * x[TIRE + 3 * wheel + i]
    t[3] = most * force * along + m.tire_damping * t[0]
    t[4] = -most * force * across - m.tire_damping * t[1]
    moment = m.swivel_arm * most
    twist = m.twist_stiffness * x[TIRE + 3 * wheel + 2] / (f64(1.5) * moment)
    elastic = ONE
    if motion[3] * twist > ZERO:
        full = twist / REACH
        elastic = ONE - full * full * full * full * full * full
    t[2] = motion[3] * elastic - rolled * x[TIRE + 3 * wheel + 2]
    t[5] = -(wp.sign(twist) * moment * brush(wp.abs(twist)) + f64(0.02) * m.twist_stiffness * t[2])
    return t


@wp.func
def resistance(x: Any, m: Any, wheel: int, load: wp.float64):
    """Torque [N m] against a wheel: ruts by Gerstner (in the coefficient), the front wheels' deeper, and rusty brakes.

    Drag of these by (a + b v) e^(−c v) + d (Kragelsky, Dobychin, Kombalov 1982).
    """
    speed = x[at.WHEEL + wheel]
    ruts = f64(0.85)
    if wheel < 2:
        ruts = f64(1.15)
    size = wp.abs(speed)
    rust = m.brake_torque * (f64(0.8) + (f64(0.3) + f64(0.25) * size) * wp.exp(-size))
    return (m.rolling * ruts * load * m.tire_radius + rust) * wp.tanh(speed / f64(0.03))


@wp.func
def hinge(x: Any, m: Any):
    """Dry bush by rate and state: T a asinh(ω/(2 ω₀) e^((1 + b ψ)/a))/(1 + b), with the age ψ of its contacts.

    Dieterich 1979; Rice, Ben-Zion 1996 (regular at rest); ψ̇ = (ω₀/L)(e^−ψ − e^−1 − |ω|/ω₀), healed at ψ = 1, after seconds.
    Torque [N m] and rate of ψ.
    """
    rate = x[at.RATE_FRONT] - x[at.RATE_REAR]
    age = x[HINGE]
    s = rate / (TWO * CREEPING) * wp.exp((ONE + WEAK * age) / CALM)
    torque = m.hinge_torque * CALM / (ONE + WEAK) * wp.sign(s) * wp.log(wp.abs(s) + wp.sqrt(s * s + ONE))
    aging = CREEPING / SLIDE * (wp.exp(-age) - wp.exp(-ONE) - wp.abs(rate) / CREEPING)
    return vec2d(torque + f64(140.0) * rate, aging)


@wp.func
def seals(x: Any, m: Any, c: Any, inputs: Any):
    """Friction of both cylinders by Andersson, Söderberg, Björklund 2007 as a torque [N m]; the annuli's pressures press it.

    (F_c + (F_s − F_c) e^−√(|v|/v_s)) tanh(v/4 mm/s), times 1 + (p_a + p_b)/450 bar, and viscous.
    """
    torque = ZERO
    pressed = ONE + (wp.max(x[SIDE_A], ZERO) + wp.max(x[SIDE_B], ZERO)) / (f64(450.0) * BAR)
    sliding = m.seal_force / m.seal_ratio
    for side in range(2):
        lever = c[4 + side]
        v = lever * x[at.ROD_RATE]
        level = sliding + (m.seal_force - sliding) * wp.exp(-wp.sqrt(wp.abs(v) / m.stribeck_speed))
        torque += lever * (pressed * level * wp.tanh(v / f64(0.004)) + m.seal_viscosity * inputs[at.VISCOSITY] * v)
    return vec3d(torque, ZERO, ZERO)


@wp.func
def rods(x: Any, m: Any):
    """Torque [N m] of pins in wide bushes: a squeezed film, ∝ ė/(1 − e²)^1.5 of the eccentricity e, up to touch and beyond,
    and a spring behind the play (Pinkus, Sternlicht 1961; Flores, Lankarani 2016)."""
    stretch = x[at.ROD] - x[at.ANGLE]
    rate = x[at.ROD_RATE] - x[at.RATE_FRONT] + x[at.RATE_REAR]
    place = stretch / m.joint_play
    room = wp.max(ONE - place * place, ZERO) + f64(0.05)
    film = m.joint_damping * f64(0.01118) / (room * wp.sqrt(room))  # the whole damping where it touches
    return vec2d(m.joint_stiffness * excess(stretch, m.joint_play) + film * rate, ZERO)


@wp.func
def engine(x: Any, m: Any, load: wp.float64):
    """Governor whose spring stiffens, 200 s (1 + 0.4 |s|)/1.4 by the share s of the droop, on a worn engine: its torque
    comes in 40 ms, 110 ms as the fuel pump's plungers leak at load (Kiencke, Nielsen 2005, R). Rates of speed and torque."""
    below = (m.engine_speed - x[at.ENGINE]) / (m.droop * m.engine_speed)
    goal = m.engine_idle_torque + f64(200.0) * below * (ONE + f64(0.4) * wp.abs(below)) / f64(1.4)
    goal = wp.clamp(goal, ZERO, f64(560.0))
    lag = f64(0.04) + f64(0.07) * unit(x[at.GOVERNOR] / f64(560.0))
    return vec2d((x[at.GOVERNOR] - load) / m.engine_inertia, (goal - x[at.GOVERNOR]) / lag)


@wp.func
def rhombus(place: wp.float64):
    """Area of a rhombic port uncovered to a share of its diagonal, over the whole: 2 y², then 1 − 2 (1 − y)²."""
    y = unit(place)
    area = TWO * y * y
    if y > HALF:
        area = ONE - TWO * (ONE - y) * (ONE - y)
    return area


@wp.func
def opening(spool: wp.float64, m: Any):
    """Share of the edge that is open: three rows of rhombic ports one after the other (Merritt 1967, ports of any shape)."""
    s = wp.abs(spool)
    band = m.band_left
    rows = vec3d(m.rhombus_one_left, m.rhombus_two_left, m.rhombus_three_left)
    if spool < ZERO:
        band = m.band_right
        rows = vec3d(m.rhombus_one_right, m.rhombus_two_right, m.rhombus_three_right)
    area = rows[0] * rhombus((s - band) / (f64(0.8) - band)) + rows[1] * rhombus((s - HALF) / f64(0.35))
    return area + rows[2] * rhombus(f64(4.0) * (s - f64(0.75)))


@wp.func
def rough(drop: wp.float64, losses: wp.float64, more: wp.float64, viscosity: wp.float64, m: Any):
    """Flow [m³/s] through edges and a rough hose: laminar, or by von Kármán's 1/√λ = 2 lg(3.7 D/ε) where that loses more.

    ``more``: other resistance [Pa s/m³]. Nikuradse 1933, fully rough.
    """
    laminar = passage(drop, losses, m.line_resistance * viscosity + more)
    turbulent = passage(drop, losses + m.rough_loss, more)
    return wp.min(laminar, turbulent)


@wp.func
def flows(x: Any, m: Any, inputs: Any):
    """Flows [m³/s] out of the supply and into the tank, drop [Pa] over the metering edge, sensed pressure.

    Before the compensator lies a strainer; the oil that returns dives into the tank's gallery, ρ v²/2 (Borda), which stands
    under the pressure of a charge pump's surplus.
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
    area = opening(x[SPOOL], m) + f64(1e-7)
    edge = nominal * area
    throttle = m.compensator_passage * (x[COMPENSATOR] + f64(1e-6))
    losses = ONE / (edge * edge) + ONE / (throttle * throttle) + ONE / (m.strainer_passage * m.strainer_passage)
    flow = rough(x[SUPPLY] - port, losses, added, viscosity, m)
    back = m.return_edge * area * (ONE - block)
    out = rough(other - m.tank_pressure, ONE / (back * back) + m.borda_loss, ZERO, viscosity, m)
    sensed = x[SUPPLY] - flow * flow * losses
    return vec4d(flow, out, flow * flow / (edge * edge), wp.where(area > f64(1e-3), sensed, m.tank_pressure))


@wp.func
def leaks(x: Any, m: Any, inputs: Any):
    """Leakage [m³/s] from A to B: past pistons in wide gaps where the oil warms as it is throttled, between ports past lands
    that the pressure pushes aside.

    Gap: μ = μ₀ e^(−β Δp), β = 0.031 1/K over ρ c (half of the warming on the mean; Ivantysyn, Ivantysynova 2001). Lands:
    1 + 1.5 e², e = tanh(|Δp|/60 bar) (Merritt 1967, hydraulic lock; Viersma 1980).
    """
    drop = x[SIDE_A] - x[SIDE_B]
    warm = (wp.exp(f64(9e-9) * wp.abs(drop)) - ONE) / f64(9e-9)
    aside = wp.tanh(drop / (f64(60.0) * BAR))
    lands = m.land_conductance * (ONE + f64(1.5) * aside * aside) * drop
    return (m.barrel_conductance * wp.sign(drop) * warm + lands) / inputs[at.VISCOSITY]


@wp.func
def port(pressure: wp.float64, m: Any):
    """Flow [m³/s] into a port from its anti-cavitation check, less that of its shock valve."""
    return relief(m.tank_pressure, pressure, f64(3.4e-9)) - relief(pressure, m.shock_pressure, f64(7e-10))


@wp.func
def into_sides(x: Any, m: Any, inputs: Any, f: vec4d):
    """Flows [m³/s] into A and into B."""
    return into_ports(x[SPOOL], f, port(x[SIDE_A], m), port(x[SIDE_B], m), leaks(x, m, inputs))


@wp.func
def wall(rate: wp.float64, held: wp.float64, m: Any):
    """Stiffness [Pa] of a hose over its strain: rubber, and a braid whose wires rub on each other, as its pressure changes.

    p = E ε + z, ż = E₁ ε̇ (1 − z sgn ε̇/p_f): an element of Jenkin behind Dahl's curve (Iwan 1966).
    """
    share = wp.clamp(held / m.braid_friction * wp.sign(rate), -ONE, ONE)
    return m.braid_slack + m.braid_modulus * (ONE - share)


@wp.func
def side_rates(d: State, x: Any, m: Any, c: Any, into: vec2d):
    """Rates of both sides' pressures, of their braids, and of the free share of their bubbles.

    Q − V̇ − V̇_gas = (V/K + V_h/E) ṗ. What flows in brings bubbles from the pump, all free.
    """
    for i in range(2):
        p = x[SIDE_A + i]
        free = x[GAS + i]
        volume = c[i] + m.hose_volume
        oil = softness(p, free, m)
        change = diffusion(p, free, m)
        gone = -volume * oil[1] * change / wp.max(free, f64(1e-3))
        given = into[i] - c[2 + i] * x[at.ROD_RATE] + gone
        soft = volume * oil[0]
        if i == 0:
            soft += accumulator(p, m)
        stiff = wall(given, x[BRAID + i], m)
        rate = given / (soft + m.hose_volume / stiff)
        d[SIDE_A + i] = rate
        d[BRAID + i] = rate * (ONE - m.braid_slack / stiff)
        d[GAS + i] = change + wp.max(into[i], ZERO) / volume * (ONE - free)
    return d


@wp.func
def pump_rates(d: State, x: Any, m: Any, inputs: Any, f: vec4d):
    """Rates of the supply, of the vane pump's ring and of the relief.

    Ring: on a spring, without integral action: its stroke falls in a straight line over the pressure (Ivantysyn,
    Ivantysynova 2001). Slip Δp/μ (Wilson 1946). Relief: pops, as the flow lifts its poppet by 5 % of the pressure at
    full lift.
    """
    given = x[STROKE] * m.pump_displacement * x[at.ENGINE] * pulsation(m, inputs)
    lost = m.pump_leakage * f64(0.04) / inputs[at.VISCOSITY] * x[SUPPLY] + f[0] + other_flow(x[SUPPLY], m, inputs)
    lost += check(m.lift_passage * x[RELIEF], x[SUPPLY], BAR)
    soft = softness(x[SUPPLY], ONE, m)
    rise = (given - lost) / (m.supply_volume * (soft[0] + ONE / (m.braid_slack + m.braid_modulus)))
    d[SUPPLY] = rise
    d[SENSE] = (wp.max(f[3], ZERO) - x[SENSE]) / m.sense_lag
    error = m.margin + x[SENSE] - x[SUPPLY] - m.regulator_lead * rise
    d[STROKE] = (unit(m.standby_stroke + error / m.vane_band) - x[STROKE]) / m.stroke_time
    lifted = x[SUPPLY] * (ONE + f64(0.05) * x[RELIEF]) - m.lift_pressure
    d[RELIEF] = (unit(lifted / m.lift_band) - x[RELIEF]) / f64(0.0035)
    return d


@wp.func
def valve_rates(d: State, x: Any, m: Any, inputs: Any, f: vec4d):
    """Rates of the valve: a Bowden cable that slips at its ends by Euler and Eytelwein, the more the harder it pulls
    (Kaneko, Wada, Maekawa, Tanie 1991), a spool in a dashpot, slower home by its spring than out, and the compensator.

    A worn piston and its orifice are a bridge: the compensator feels that share of the drop.
    """
    pulled = inputs[at.COMMAND] + m.null_shift - x[HYSTERESIS]
    grip = m.capstan * (f64(0.4) + wp.abs(x[HYSTERESIS]))
    d[HYSTERESIS] = excess(pulled, grip) / f64(0.0015)
    away = x[HYSTERESIS] - x[SPOOL]
    lag = m.spool_lag
    if away * x[SPOOL] < ZERO:
        lag *= f64(1.5)
    ratio = wp.abs(away) / (lag * m.spool_rate)
    d[SPOOL] = away / lag / wp.cbrt(ONE + ratio * ratio * ratio)
    goal = unit(HALF + (m.bridge_spring - m.bridge_ratio * f[2]) / (f64(0.8) * m.bridge_spring))
    d[COMPENSATOR] = (goal - x[COMPENSATOR]) / m.compensator_lag
    return d


@wp.func
def hydraulics(d: State, x: Any, m: Any, inputs: Any, c: Any):
    """Derivatives of pressures, pump, valve."""
    f = flows(x, m, inputs)
    d = side_rates(d, x, m, c, into_sides(x, m, inputs, f))
    d = pump_rates(d, x, m, inputs, f)
    return valve_rates(d, x, m, inputs, f)


@wp.func
def limit(x: State, m: Any):
    """Stops of the ring and of the compensator, pressures at boiling oil, shares of bubbles."""
    x[STROKE] = unit(x[STROKE])
    x[COMPENSATOR] = unit(x[COMPENSATOR])
    for i in range(3):
        x[SIDE_A + i] = wp.max(x[SIDE_A + i], GROUND_FLOOR)
    for i in range(2):
        x[GAS + i] = unit(x[GAS + i])
    return x


@wp.func
def start(m: Any, angle: wp.float64):
    """State at rest: all bubbles free, contacts of the bearing healed."""
    x = assembly.at_rest(State(), m, angle)
    for i in range(2):
        x[GAS + i] = ONE
    x[HINGE] = ONE
    return x


@wp.func
def hydraulic_signals(x: Any, m: Any, inputs: Any):
    """Pressures a, b, pump; flows into a and b; spool."""
    into = into_sides(x, m, inputs, flows(x, m, inputs))
    return Hydraulic(x[SIDE_A], x[SIDE_B], x[SUPPLY], into[0], into[1], x[SPOOL])
