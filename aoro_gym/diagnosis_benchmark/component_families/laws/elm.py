"""Laws of elm: entrained gas, LuGre seals and tires, a lever with play to the spool, and a critically built regulator.

Port pressures are those of the chambers; hoses are laminar resistances before them.
"""

from typing import Any

import warp as wp

from aoro_gym.diagnosis_benchmark.independent.laws import layout as at
from aoro_gym.diagnosis_benchmark.independent.laws.numbers import HALF, ONE, TWO, ZERO, f64, play, unit

from . import assembly
from .common import bounded, coulomb, excess, passage, relief, segment
from .disturbances import accumulator, other_flow, pinch, pulsation
from .places import (
    ATMOSPHERE,
    BAR,
    COMPENSATOR,
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


@wp.func
def compliance(pressure: wp.float64, volume: wp.float64, hose: wp.float64, m: Any):
    """Compliance [m³/Pa] of oil with entrained gas, and of its hose.

    Nykänen, Esqué, Ellman 2000: gas polytropic by (p₀/p)^(1/n), liquid by exp((p₀ − p)/β) (Cho 2002); n = 1.25.
    """
    absolute = wp.max(pressure + ATMOSPHERE, f64(0.02) * BAR)
    gas = m.air_share * wp.pow(ATMOSPHERE / absolute, f64(0.8))
    liquid = (ONE - m.air_share) * wp.exp((ATMOSPHERE - absolute) / m.bulk_modulus)
    mixture = (gas * f64(0.8) / absolute + liquid / m.bulk_modulus) / (gas + liquid)
    return volume * mixture + hose * (mixture + ONE / m.hose_modulus)


@wp.func
def tire(x: Any, m: Any, wheel: int, motion: vec4d, load: wp.float64):
    """Average lumped LuGre tire: ż = v − |v| σ₀ z/g − κ|V| z, F = F_n (σ₀ z + σ₁ ż + σ₂ v).

    Deur, Asgari, Hrovat 2004; Velenis, Tsiotras 2005. Twist: Dahl (1968) to the moment of a round patch,
    2/3 μ F_n R (Sharp, Granger 2003). Of z the rates, then forces along, across, and moment.
    """
    zx = x[TIRE + 3 * wheel]
    zy = x[TIRE + 3 * wheel + 1]
    zt = x[TIRE + 3 * wheel + 2]
    rolling = wp.abs(motion[2]) / m.relaxation_length
    t = Tire()
    stribeck_x = m.grip_sliding + (m.grip_sticking - m.grip_sliding) * wp.exp(-wp.sqrt(wp.abs(motion[0]) / f64(0.3)))
    stribeck_y = m.grip_sliding + (m.grip_sticking - m.grip_sliding) * wp.exp(-wp.sqrt(wp.abs(motion[1]) / f64(0.3)))
    t[0] = motion[0] - wp.abs(motion[0]) * m.stiffness_along * zx / (stribeck_x * load) - rolling * zx
    t[1] = motion[1] - wp.abs(motion[1]) * m.stiffness_across * zy / (stribeck_y * load) - rolling * zy
    moment = m.scrub_moment * load / m.load_mean
    t[2] = motion[3] - wp.abs(motion[3]) * m.twist_stiffness * zt / moment - rolling * zt
    t[3] = m.stiffness_along * zx + m.tire_damping * t[0] + f64(0.01) * load * motion[0]
    t[4] = -(m.stiffness_across * zy + m.tire_damping * t[1] + f64(0.01) * load * motion[1])
    t[5] = -(m.twist_stiffness * zt + f64(0.02) * m.twist_stiffness * t[2])
    return t


@wp.func
def resistance(x: Any, m: Any, wheel: int, load: wp.float64):
    """Torque [N m] against a wheel: rolling by the sunk tire (Bekker 1969, in the coefficient) and a dry brake."""
    speed = x[at.WHEEL + wheel]
    return (m.rolling * load * m.tire_radius + m.brake_torque) * coulomb(speed, f64(0.03))


@wp.func
def hinge(x: Any, m: Any):
    """Coulomb friction of the bearing, smooth, with a viscous part: torque [N m]."""
    rate = x[at.RATE_FRONT] - x[at.RATE_REAR]
    return vec2d(m.hinge_torque * coulomb(rate, f64(0.01)) + f64(150.0) * rate, ZERO)


@wp.func
def seals(x: Any, m: Any, c: Any, inputs: Any):
    """LuGre friction of both cylinders as a torque [N m]: σ₀ z + σ₁ ż + σ₂ v (Canudas de Wit, Olsson et al. 1995)."""
    torque = ZERO
    rates = vec2d()
    sliding = m.seal_force / m.seal_ratio
    for side in range(2):
        lever = c[4 + side]
        v = lever * x[at.ROD_RATE]
        z = x[SEAL + side]
        ratio = v / m.stribeck_speed
        g = sliding + (m.seal_force - sliding) * wp.exp(-ratio * ratio)
        rates[side] = v - wp.abs(v) * f64(4e6) * z / g
        viscous = m.seal_viscosity * inputs[at.VISCOSITY]
        torque += lever * (f64(4e6) * z + f64(1500.0) * rates[side] + viscous * v)
    return vec3d(torque, rates[0], rates[1])


@wp.func
def rods(x: Any, m: Any):
    """Torque [N m] of rods and brackets: a straight spring with damping behind a free play."""
    stretch = x[at.ROD] - x[at.ANGLE]
    touching = unit(ONE + (wp.abs(stretch) - m.joint_play) / f64(2e-5))
    rate = x[at.ROD_RATE] - x[at.RATE_FRONT] + x[at.RATE_REAR]
    return vec2d(m.joint_stiffness * play(stretch, m.joint_play) + m.joint_damping * rate * touching, ZERO)


@wp.func
def engine(x: Any, m: Any, load: wp.float64):
    """Governor with speed droop and a first-order lag of the torque (Guzzella, Onder 2010): rates of both."""
    speed = x[at.ENGINE]
    goal = m.engine_idle_torque + (m.engine_speed - speed) / (m.droop * m.engine_speed) * f64(200.0)
    rate = (wp.clamp(goal, ZERO, f64(640.0)) - x[at.GOVERNOR]) / f64(0.06)
    return vec2d((x[at.GOVERNOR] - load) / m.engine_inertia, rate)


@wp.func
def opening(spool: wp.float64, m: Any):
    """Share of the edge that is open: straight lines through the measured curve, each side its own."""
    s = wp.abs(spool)
    first = m.band_left
    low = m.half_left
    high = m.most_left
    if spool < ZERO:
        first = m.band_right
        low = m.half_right
        high = m.most_right
    value = segment(s, first, ZERO, HALF, low)
    value += segment(s, HALF, ZERO, f64(0.75), high - low)
    return value + segment(s, f64(0.75), ZERO, ONE, ONE - high)


@wp.func
def flows(x: Any, m: Any, inputs: Any):
    """Flows [m³/s] out of the supply, into A, into B, the drop [Pa] over the metering edge, and the sensed pressure."""
    left = x[SPOOL] > ZERO
    port = x[SIDE_B]
    other = x[SIDE_A]
    nominal = m.edge_right
    added = ZERO
    if left:
        port = x[SIDE_A]
        other = x[SIDE_B]
        nominal = m.edge_left
        added = pinch(x, m)
    area = opening(x[SPOOL], m) + f64(1e-7)
    edge = nominal * area
    throttle = m.compensator_passage * (x[COMPENSATOR] + f64(1e-6))
    line = m.line_resistance * inputs[at.VISCOSITY] + added
    flow = passage(x[SUPPLY] - port, ONE / (edge * edge) + ONE / (throttle * throttle), line)
    back = m.return_edge * area
    tank = m.tank_conductance
    block = ZERO
    if left:
        block = m.half_block
    tank *= ONE - block
    out = passage(other - m.tank_pressure, ONE / (back * back) + ONE / (tank * tank), line)
    sensed = port + line * flow
    return vec4d(flow, out, flow * flow / (edge * edge), wp.where(area > f64(1e-3), sensed, m.tank_pressure))


@wp.func
def port(pressure: wp.float64, m: Any):
    """Flow [m³/s] into a port out of its anti-cavitation check, less that of its shock valve."""
    return relief(m.tank_pressure, pressure, f64(3e-9)) - relief(pressure, m.shock_pressure, f64(5e-10))


@wp.func
def leaks(x: Any, m: Any, inputs: Any):
    """Leakage [m³/s] from A to B: past pistons laminar in the gap (Manring 2005), between ports an orifice that starts
    laminar (Borutzky et al. 2002)."""
    drop = x[SIDE_A] - x[SIDE_B]
    turbulent = m.port_leakage * drop / wp.sqrt(wp.sqrt(drop * drop + f64(4.0) * BAR * BAR))
    return m.piston_leakage / inputs[at.VISCOSITY] * drop + turbulent


@wp.func
def hydraulics(d: State, x: Any, m: Any, inputs: Any, c: Any):
    """Derivatives of pressures, pump, valve.

    Pump: regulator with integral action and lead (Hopsan's pressure-controlled pump), stroke rates limited. Valve:
    lever with play, second-order spool with a rate limit. Compensator: force balance that is quasi-static behind a lag.
    """
    f = flows(x, m, inputs)
    into_a = f[0]
    into_b = -f[1]
    if x[SPOOL] <= ZERO:
        into_a = -f[1]
        into_b = f[0]
    leak = leaks(x, m, inputs)
    into_a += port(x[SIDE_A], m) - leak
    into_b += port(x[SIDE_B], m) + leak
    soft_a = compliance(x[SIDE_A], c[0], m.hose_volume, m) + accumulator(x[SIDE_A], m)
    soft_b = compliance(x[SIDE_B], c[1], m.hose_volume, m)
    d[SIDE_A] = (into_a - c[2] * x[at.ROD_RATE]) / soft_a
    d[SIDE_B] = (into_b - c[3] * x[at.ROD_RATE]) / soft_b
    given = x[STROKE] * m.pump_displacement * x[at.ENGINE] * pulsation(m, inputs)
    lost = m.pump_leakage * x[SUPPLY] + relief(x[SUPPLY], m.relief_pressure, f64(1e-9)) + f[0]
    lost += other_flow(x[SUPPLY], m, inputs)
    rise = (given - lost) / compliance(x[SUPPLY], m.supply_volume, ZERO, m)
    d[SUPPLY] = rise
    d[SENSE] = (wp.max(f[3], ZERO) - x[SENSE]) / m.sense_lag
    error = wp.min(m.margin + x[SENSE], m.cut_off) - x[SUPPLY] - m.regulator_lead * rise
    wanted = error * TWO / (m.margin * m.stroke_time)
    d[STROKE] = bounded(wp.clamp(wanted, -TWO / m.stroke_time, ONE / m.stroke_time), x[STROKE])
    d[HYSTERESIS] = excess(inputs[at.COMMAND] + m.null_shift - x[HYSTERESIS], m.lever_play) / f64(0.002)
    w = m.spool_frequency
    d[SPOOL_RATE] = w * w * (x[HYSTERESIS] - x[SPOOL]) - TWO * m.spool_damping * w * x[SPOOL_RATE]
    d[SPOOL] = wp.clamp(x[SPOOL_RATE], -m.spool_rate, m.spool_rate)
    balance = unit(HALF + (m.edge_drop - f[2]) / (f64(0.8) * m.edge_drop))
    d[COMPENSATOR] = (balance - x[COMPENSATOR]) / m.compensator_lag
    return d


@wp.func
def limit(x: State, m: Any):
    """Stops of the pump's swash plate, of pressures at boiling oil."""
    x[STROKE] = unit(x[STROKE])
    for i in range(3):
        x[SIDE_A + i] = wp.max(x[SIDE_A + i], GROUND_FLOOR)
    return x


@wp.func
def start(m: Any, angle: wp.float64):
    """State at rest."""
    return assembly.at_rest(State(), m, angle)


@wp.func
def hydraulic_signals(x: Any, m: Any, inputs: Any):
    """Pressures a, b, pump; flows into a and b; spool."""
    f = flows(x, m, inputs)
    into_a = f[0]
    into_b = -f[1]
    if x[SPOOL] <= ZERO:
        into_a = -f[1]
        into_b = f[0]
    leak = leaks(x, m, inputs)
    into_a += port(x[SIDE_A], m) - leak
    into_b += port(x[SIDE_B], m) + leak
    return Hydraulic(x[SIDE_A], x[SIDE_B], x[SUPPLY], into_a, into_b, x[SPOOL])
