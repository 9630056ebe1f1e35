"""Laws of larch: oil with air that dissolves up to a critical pressure, hoses that heat softens, a pump under a PI
controller with a line that limits power, a spool under position control behind a Bouc–Wen operator, rows of bores, a cooler.

Tires are strings whose force saturates exponentially, with a brush under parabolic pressure in twist; seals by Dahl.
"""

from typing import Any

import warp as wp

from aoro_gym.diagnosis_benchmark.independent.laws import layout as at
from aoro_gym.diagnosis_benchmark.independent.laws.numbers import HALF, ONE, TWO, ZERO, f64, unit

from . import assembly
from .common import into_ports, passage, relief
from .disturbances import accumulator, other_flow, pinch, pulsation
from .places import (
    ATMOSPHERE,
    BAR,
    COMPENSATOR,
    CONTROL,
    DRIVER,
    GROUND_FLOOR,
    HYSTERESIS,
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

GROWTH = wp.constant(f64(11.0))
"""Growth of the liquid's bulk modulus over pressure (S27)."""
POLYTROPIC = wp.constant(f64(1.35))
"""Exponent of the free gas (R)."""
BARUS = wp.constant(f64(1.8e-8))
"""Pressure coefficient [1/Pa] of the viscosity (R)."""
WORKING = wp.constant(f64(0.2))
"""Place of the compensator at which its screw sets the regulated drop, share of its slot (E)."""
REACH = wp.constant(f64(3.0))
"""Demand over the largest force up to which a tire's string stretches: 95 % of that force."""
TURN = wp.constant(f64(6.0))
"""Twist of a patch, of the one at which its rim would slip under even pressure, beyond which it turns as a whole."""


@wp.func
def liquid(pressure: wp.float64, m: Any):
    """Volume of the liquid over that without pressure, and its bulk modulus [Pa].

    Murnaghan 1944: K = K₀ + K′ p, so that v = (1 + K′ p/K₀)^(−1/K′).
    """
    above = GROWTH * wp.max(pressure, ZERO)
    return vec2d(wp.pow(ONE + above / m.bulk_modulus, -ONE / GROWTH), m.bulk_modulus + above)


@wp.func
def free_gas(absolute: wp.float64, m: Any):
    """Free gas, share of its volume at atmospheric pressure, and minus its slope over pressure [1/Pa].

    Ruan, Burton 2006: (p₀/p)^(1/n) (p_c − p)/(p_c − p₀), all of it free below p₀, none above the critical pressure p_c.
    """
    squeezed = wp.pow(ATMOSPHERE / absolute, ONE / POLYTROPIC)
    span = m.critical_pressure - ATMOSPHERE
    share = unit((m.critical_pressure - absolute) / span)
    slope = squeezed * share / (POLYTROPIC * absolute)
    if share > ZERO and share < ONE:
        slope += squeezed / span
    return vec2d(squeezed * share, slope)


@wp.func
def softness(pressure: wp.float64, m: Any):
    """Compliance [1/Pa] of oil with air, a unit of volume: liquid and gas side by side."""
    absolute = wp.max(pressure + ATMOSPHERE, f64(0.02) * BAR)
    oil = liquid(pressure, m)
    gas = free_gas(absolute, m)
    rest = (ONE - m.air_share) * oil[0]
    return (rest / oil[1] + m.air_share * gas[1]) / (rest + m.air_share * gas[0])


@wp.func
def disc(twist: wp.float64):
    """Moment over its largest of bristles in a round patch under parabolic pressure, by their ``twist`` q ≥ 0.

    A bristle at ρ = u a deflects by ρ ψ and slips where q u > 1 − u², q = k a ψ/(μ p₀): from the rim inwards up to
    u = (√(q² + 4) − q)/2. M/M₀ = (q u⁴/4 + (1 − u³)/3 − (1 − u⁵)/5)/(2/15) (after Pacejka 2012, turn slip).
    """
    u = TWO / (wp.sqrt(twist * twist + f64(4.0)) + twist)
    u3 = u * u * u
    slipping = (ONE - u3) / f64(3.0) - (ONE - u3 * u * u) / f64(5.0)
    return f64(7.5) * (f64(0.25) * twist * u3 * u + slipping)


@wp.func
def tire(x: Any, m: Any, wheel: int, motion: vec4d, load: wp.float64):
    """String of a relaxation length (von Schlippe, Dietrich 1941) before ground whose force saturates exponentially.

    ż = v − |V| z/σ; F = F_m (1 − e^−r) along c z, r = |c z|/F_m, with slips along and across combined (Brixius 1987; Crolla,
    El-Razaz 1987). Beyond r = 3 the string only turns. Twist: :func:`disc`. Rates, forces along, across, and moment.
    """
    most = m.grip * load
    rolled = wp.abs(motion[2]) / m.relaxation_length
    along = m.stiffness_along * x[TIRE + 3 * wheel] / most
    across = m.stiffness_across * x[TIRE + 3 * wheel + 1] / most
    demand = wp.sqrt(along * along + across * across)
    rising = wp.max(along * m.stiffness_along * motion[0] + across * m.stiffness_across * motion[1], ZERO) / most
    loose = rising * demand * demand / (REACH * REACH * REACH * REACH)
    # (1 − e^−r)/r by its series where r is small
    force = ONE - HALF * demand
    if demand > f64(1e-4):
        force = (ONE - wp.exp(-demand)) / demand
    t = Tire()
    for i in range(2):
        t[i] = motion[i] - (rolled + loose) * x[TIRE + 3 * wheel + i]
    t[3] = most * force * along + m.tire_damping * t[0]
    t[4] = -most * force * across - m.tire_damping * t[1]
    moment = m.bore_arm * most
    twist = m.twist_stiffness * x[TIRE + 3 * wheel + 2] / (f64(1.875) * moment)
    elastic = ONE
    if motion[3] * twist > ZERO:
        share = twist / TURN
        elastic = ONE - share * share * share * share
    t[2] = motion[3] * elastic - rolled * x[TIRE + 3 * wheel + 2]
    t[5] = -(wp.sign(twist) * moment * disc(wp.abs(twist)) + f64(0.01) * m.twist_stiffness * t[2])
    return t


@wp.func
def resistance(x: Any, m: Any, wheel: int, load: wp.float64):
    """Torque [N m] against a wheel: motion resistance by the mobility number B, and a wet brake.

    Brixius 1987: 1/B + r₀ + 0.5 s/√B, slip s. The brake's film tears: its drag rises by a quarter up to some rad/s.
    """
    speed = x[at.WHEEL + wheel]
    around = m.tire_radius * speed
    slip = unit(wp.abs(around - x[at.VX]) / (wp.abs(around) + f64(0.3)))
    soil = m.rolling + HALF * slip / wp.sqrt(m.mobility)
    brake = m.brake_torque * (f64(0.8) + f64(0.2) * speed * speed / (ONE + speed * speed))
    return (soil * load * m.tire_radius + brake) * speed / wp.sqrt(speed * speed + f64(9e-4))


@wp.func
def hinge(x: Any, m: Any):
    """Plain bearing under the vehicle's weight: friction falls by a hyperbola to 60 % as it turns (Hess, Soom 1990).

    Torque [N m] and no presliding; its direction is smooth within 4 mrad/s.
    """
    rate = x[at.RATE_FRONT] - x[at.RATE_REAR]
    film = f64(0.6) + f64(0.4) / (ONE + wp.abs(rate) / f64(0.1))
    level = m.hinge_torque * m.mass_total / f64(1e4) * film
    return vec2d(level * rate / wp.sqrt(rate * rate + f64(1.6e-5)) + f64(100.0) * rate, ZERO)


@wp.func
def seals(x: Any, m: Any, c: Any, inputs: Any):
    """Friction of both cylinders by Dahl (1968), exponent 2, towards a limit by Stribeck, as a torque [N m].

    ż = v |1 − s| (1 − s), s = σ z sgn v/F; F = F_c + (F_s − F_c) e^(−|v|/v_s), and lips pressed by the higher of both
    pressures (Kanters 1990, R).
    """
    torque = ZERO
    rates = vec2d()
    stiffness = f64(3e6)
    pressed = ONE + wp.max(wp.max(x[SIDE_A], x[SIDE_B]), ZERO) / (f64(280.0) * BAR)
    sliding = m.seal_force / m.seal_ratio
    for side in range(2):
        lever = c[4 + side]
        v = lever * x[at.ROD_RATE]
        level = pressed * (sliding + (m.seal_force - sliding) * wp.exp(-wp.abs(v) / m.stribeck_speed))
        left = ONE - wp.clamp(wp.sign(v) * stiffness * x[SEAL + side] / level, -ONE, TWO)
        rates[side] = v * wp.abs(left) * left
        torque += lever * (stiffness * x[SEAL + side] + m.seal_viscosity * inputs[at.VISCOSITY] * v)
    return vec3d(torque, rates[0], rates[1])


@wp.func
def rods(x: Any, m: Any):
    """Torque [N m] of pins in their eyes beyond a clearance: Hertz, k δ √(δ/δ₀), δ₀ = 1 mrad, only pressing.

    Damping with δ^¼ (Tsuji, Tanaka, Ishida 1992), as given at δ₀; grease within the clearance.
    """
    stretch = x[at.ROD] - x[at.ANGLE]
    rate = x[at.ROD_RATE] - x[at.RATE_FRONT] + x[at.RATE_REAR]
    torque = f64(0.05) * m.joint_damping * rate
    depth = (wp.abs(stretch) - m.joint_play) / f64(1e-3)
    if depth > ZERO:
        side = wp.sign(stretch)
        root = wp.sqrt(depth)
        pressing = m.joint_stiffness * f64(1e-3) * depth * root + m.joint_damping * wp.sqrt(root) * rate * side
        torque += side * wp.max(pressing, ZERO)
    return vec2d(torque, ZERO)


@wp.func
def engine(x: Any, m: Any, load: wp.float64):
    """Electronic governor whose torque comes a working cycle late, 4π/ω, of four strokes (Guzzella, Onder 2010).

    Its droop line bends into the full load of 630 N m by a hyperbola of 20 N m. Rates of speed and torque.
    """
    below = (m.engine_speed - x[at.ENGINE]) / (m.droop * m.engine_speed) * f64(200.0)
    spare = f64(630.0) - m.engine_idle_torque - below
    goal = f64(630.0) - HALF * (spare + wp.sqrt(spare * spare + f64(400.0)))
    lag = f64(4.0) * f64(wp.pi) / wp.max(x[at.ENGINE], f64(50.0))
    return vec2d((x[at.GOVERNOR] - load) / m.engine_inertia, (wp.max(goal, ZERO) - x[at.GOVERNOR]) / lag)


@wp.func
def bore(place: wp.float64):
    """Area of a bore uncovered to a share of its diameter, over the whole: a segment of the circle."""
    y = unit(place)
    angle = wp.acos(ONE - TWO * y)
    return (angle - HALF * wp.sin(TWO * angle)) / f64(wp.pi)


@wp.func
def opening(spool: wp.float64, m: Any):
    """Share of the edge that is open: three rows of bores that a sleeve uncovers one after the other (Merritt 1967).

    The first reaches from the overlap to the end of the stroke, the others over its third and last quarters.
    """
    s = wp.abs(spool)
    band = m.band_left
    rows = vec3d(m.row_one_left, m.row_two_left, m.row_three_left)
    if spool < ZERO:
        band = m.band_right
        rows = vec3d(m.row_one_right, m.row_two_right, m.row_three_right)
    third = f64(4.0) * (s - HALF)
    return rows[0] * bore((s - band) / (ONE - band)) + rows[1] * bore(third) + rows[2] * bore(third - ONE)


@wp.func
def hose_loss(flow: wp.float64, viscosity: wp.float64, m: Any):
    """Factor on the laminar loss of a hose: (1 + (λ_B/λ)⁸)^⅛, Blasius' 0.316 Re^−¼ over 64/Re, joined by Churchill, Usagi
    1972."""
    ratio = f64(0.316 / 64.0) * wp.pow(m.line_reynolds * flow / viscosity + f64(1e-9), f64(0.75))
    r2 = ratio * ratio
    r4 = r2 * r2
    return wp.pow(ONE + r4 * r4, f64(0.125))


@wp.func
def through(drop: wp.float64, losses: wp.float64, more: wp.float64, viscosity: wp.float64, m: Any):
    """Flow [m³/s] through edges, a hose and ``more`` resistance [Pa s/m³]; three rounds of the hose's factor."""
    line = m.line_resistance * viscosity
    flow = passage(drop, losses, line + more)
    for _ in range(3):
        flow = passage(drop, losses, line * hose_loss(flow, viscosity, m) + more)
    return flow


@wp.func
def flows(x: Any, m: Any, inputs: Any):
    """Flows [m³/s] out of the supply and into the tank, drop [Pa] over the metering edge, sensed pressure.

    The oil in hoses is thicker by e^(α p) (Barus 1893). The return passes a cooler: laminar tubes, Δp ∝ μ Q/d⁴, and their
    ends, Q²/d⁴.
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
    losses = ONE / (edge * edge) + ONE / (throttle * throttle)
    flow = through(x[SUPPLY] - port, losses, added, viscosity * wp.exp(BARUS * wp.max(port, ZERO)), m)
    back = m.return_edge * area * (ONE - block)
    cooler = m.cooler_laminar * viscosity
    out = through(other - m.tank_pressure, ONE / (back * back) + m.cooler_ends, cooler, viscosity, m)
    sensed = x[SUPPLY] - flow * flow * losses
    return vec4d(flow, out, flow * flow / (edge * edge), wp.where(area > f64(1e-3), sensed, m.tank_pressure))


@wp.func
def leaks(x: Any, m: Any, inputs: Any):
    """Leakage [m³/s] from A to B: past pistons, a laminar annular gap with the loss of its entrance, 1.5 ρ v²/2; between
    ports, worn lands, laminar with the cube of their clearance (Merritt 1967)."""
    drop = x[SIDE_A] - x[SIDE_B]
    past = wp.sign(drop) * passage(wp.abs(drop), m.gap_entrance, m.gap_resistance * inputs[at.VISCOSITY])
    return past + m.land_conductance / inputs[at.VISCOSITY] * drop


@wp.func
def port(pressure: wp.float64, m: Any):
    """Flow [m³/s] into a port from its anti-cavitation check, less that of its shock valve."""
    return relief(m.tank_pressure, pressure, f64(3.2e-9)) - relief(pressure, m.shock_pressure, f64(6.5e-10))


@wp.func
def into_sides(x: Any, m: Any, inputs: Any, f: vec4d):
    """Flows [m³/s] into A and into B."""
    return into_ports(x[SPOOL], f, port(x[SIDE_A], m), port(x[SIDE_B], m), leaks(x, m, inputs))


@wp.func
def pump_rates(d: State, x: Any, m: Any, inputs: Any, f: vec4d):
    """Rates of the supply, of a PI controller of its margin, and of a stroke that follows with one lag up and another down.

    A spring's straight line limits power: no more than (p_e − p)/(0.45 p_e) of the stroke (Ivantysyn, Ivantysynova 2001).
    The controller's integral is led back by what the limit takes off (Åström, Hägglund 1995).
    """
    given = x[STROKE] * m.pump_displacement * x[at.ENGINE] * pulsation(m, inputs)
    lost = m.pump_leakage * x[SUPPLY] + relief(x[SUPPLY], m.relief_pressure, f64(1.2e-9)) + f[0]
    lost += other_flow(x[SUPPLY], m, inputs)
    rise = (given - lost) / (m.supply_volume * (softness(x[SUPPLY], m) + ONE / m.wall_modulus))
    d[SUPPLY] = rise
    d[SENSE] = (wp.max(f[3], ZERO) - x[SENSE]) / m.sense_lag
    coming = x[SUPPLY] + m.regulator_lead * rise
    error = m.margin + x[SENSE] - coming
    asked = x[CONTROL] + error / m.control_band
    allowed = unit((m.power_end - coming) / (f64(0.45) * m.power_end))
    goal = wp.min(unit(asked), allowed)
    d[CONTROL] = (error / m.control_band + goal - asked) / m.control_time
    d[STROKE] = (goal - x[STROKE]) / wp.where(goal > x[STROKE], m.stroke_time, m.stroke_down)
    return d


@wp.func
def valve_rates(d: State, x: Any, m: Any, inputs: Any, f: vec4d):
    """Rates of the valve.

    Electronic curve: stretched from its foot. Solenoid: lag, and Bouc–Wen hysteresis (Bouc 1967; Wen 1976), exponent 2,
    β = γ, so that it unloads elastically. Spool: speed by its distance, no faster than it can brake, speed and acceleration
    bounded. Compensator: spring against drop and flow force, ∝ Q √Δp (Merritt 1967).
    """
    command = inputs[at.COMMAND]
    past = wp.max(wp.abs(command) - m.curve_foot, ZERO)
    curve = wp.min(wp.abs(command), m.curve_foot) + m.curve_scale * past
    u = wp.sign(command) * wp.min(curve, f64(1.05)) + m.null_shift
    change = (u - x[DRIVER]) / m.coil_lag
    d[DRIVER] = change
    share = x[HYSTERESIS] / m.bouc_width
    d[HYSTERESIS] = change
    if change * share > ZERO:
        d[HYSTERESIS] = change * (ONE - share * share)
    away = x[DRIVER] - x[HYSTERESIS] - x[SPOOL]
    far = wp.abs(away)
    fastest = wp.min(far / m.spool_lag, wp.sqrt(TWO * m.spool_acceleration * far))
    speed = wp.sign(away) * wp.min(fastest, m.spool_rate)
    d[SPOOL] = x[SPOOL_RATE]
    pull = (speed - x[SPOOL_RATE]) / f64(0.0015)
    d[SPOOL_RATE] = wp.clamp(pull, -m.spool_acceleration, m.spool_acceleration)
    place = x[COMPENSATOR]
    throttle = f[0] / (m.compensator_passage * (place + f64(1e-3)))
    force = f[2] + m.flow_force * f[0] * throttle
    goal = unit(m.spring_travel - (m.spring_travel - WORKING) * force / m.edge_drop)
    d[COMPENSATOR] = (goal - place) / m.compensator_lag
    return d


@wp.func
def hydraulics(d: State, x: Any, m: Any, inputs: Any, c: Any):
    """Derivatives of pressures, pump, valve: Q − V̇ = (V/K + V_h/E) ṗ a side."""
    f = flows(x, m, inputs)
    into = into_sides(x, m, inputs, f)
    for i in range(2):
        p = x[SIDE_A + i]
        soft = (c[i] + m.hose_volume) * softness(p, m) + m.hose_volume / m.wall_modulus
        if i == 0:
            soft += accumulator(p, m)
        d[SIDE_A + i] = (into[i] - c[2 + i] * x[at.ROD_RATE]) / soft
    d = pump_rates(d, x, m, inputs, f)
    return valve_rates(d, x, m, inputs, f)


@wp.func
def limit(x: State, m: Any):
    """Stops of the pump's stroke and of its controller, pressures at boiling oil."""
    x[STROKE] = unit(x[STROKE])
    x[CONTROL] = unit(x[CONTROL])
    x[COMPENSATOR] = unit(x[COMPENSATOR])
    for i in range(3):
        x[SIDE_A + i] = wp.max(x[SIDE_A + i], GROUND_FLOOR)
    return x


@wp.func
def start(m: Any, angle: wp.float64):
    """State at rest: the controller holds the standby stroke, the compensator stands where its spring lets it."""
    x = assembly.at_rest(State(), m, angle)
    x[CONTROL] = m.standby_stroke
    x[COMPENSATOR] = unit(m.spring_travel)
    return x


@wp.func
def hydraulic_signals(x: Any, m: Any, inputs: Any):
    """Pressures a, b, pump; flows into a and b; spool."""
    into = into_sides(x, m, inputs, flows(x, m, inputs))
    return Hydraulic(x[SIDE_A], x[SIDE_B], x[SUPPLY], into[0], into[1], x[SPOOL])
