"""A planar machine of two equal halves on the steering circuit: its equations, its linearisation, its motion.

Front and rear half are replaced by their mean, so that the plane between them is one of symmetry: the hinge moves in it at
v, the halves yaw by ±φ, θ = 2 φ, and both roll together on their tires, as an upright hinge makes them. Circuit: one
pressure a volume, orifices and valves as static characteristics. Without: pitch, the pendulum arms, the driveline's loop,
the bristles' stretch along the tires, friction at standstill.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import ArrayLike

from aoro_gym.machine import Machine
from aoro_gym.units import BAR, GRAVITY
from aoro_gym.validation.theory.circuit import (
    Array,
    SteadyTurn,
    chambers,
    dry_friction,
    hydraulic_frequency,
    modulus,
    opening,
    steady_turn,
    turbulent,
)
from aoro_gym.validation.theory.half import half_of, joint_inertia

STATES = (
    "supply", "port_a", "port_b", "return_line", "load_sensing", "swash", "compensator", "spool", "half_angle",
    "half_rate", "hinge_speed", "bristle", "twist", "roll", "roll_rate",
)  # fmt: skip
"""Rows of a state (15, N): pressures [Pa], openings [-], φ [rad], φ̇ [rad/s], v [m/s], tires' lateral stretch [m], twist
[rad], roll [rad] and its rate [rad/s]."""

SUPPLY, PORT_A, PORT_B, RETURN, LS, SWASH, COMPENSATOR, SPOOL, PHI, RATE, HINGE, BRISTLE, TWIST, ROLL, ROLL_RATE = (
    range(len(STATES))
)

CREEP = 0.01
"""Joint rate [rad/s] below which dry friction is taken as viscous."""
CREEP_WHEEL = 0.01
"""Rim speed [m/s] likewise of the wheels."""
STEP = 1e-4
"""Time step [s] of the fourth-order Runge-Kutta method, stable up to poles of 2.8/STEP: those of the anti-cavitation valve
into a port of least volume are near 1.9e4 1/s."""
PLAY_TORQUE = 100.0
"""Torque [N m] over which a free play is crossed."""

LIMITS: Mapping[str, Mapping[str, float]] = {
    "cut-off": {"cutoff": np.inf, "relief_pressure": np.inf},
    "shock valves": {"shock_pressure": np.inf},
    "anti-cavitation valves": {"cv_anticavitation": 0.0},
    "swash rate": {"swash_limited": 0.0},
    "spool rate": {"spool_rate_limit": np.inf},
    "tire grip": {"tire_slides": 0.0},
    "roll": {"rolls": 0.0},
}
"""Laws that bound what linear theory says, and the roll that the plane leaves out: what takes each of them away."""


class Planar:
    """Equations of motion of N planar machines in left turns from the right stop.

    Args:
        machine: One machine, or N variants.
        level: Steering signal, 0 to 1, scalar or (N,).
        slope: Rise of the ground along the direction in which the hinge moves, scalar or (N,).
        without: Names of :data:`LIMITS` that are out of reach, one sequence for each of the N.
    """

    def __init__(
        self, machine: Machine, level: ArrayLike, slope: ArrayLike = 0.0, without: Sequence[Sequence[str]] = ()
    ) -> None:
        self.machine = machine
        self.count = max(machine.num_variants, np.size(level), np.size(slope), len(without), 1)
        self.level, self.slope = (np.broadcast_to(np.asarray(x, dtype=np.float64), self.count) for x in (level, slope))
        self.half = half_of(machine)
        valve, pump = machine.steering.valve, machine.steering.pump
        limits = {
            "cutoff": pump.cutoff,
            "relief_pressure": pump.relief_pressure,
            "shock_pressure": valve.shock_pressure,
            "cv_anticavitation": valve.cv_anticavitation,
            "spool_rate_limit": valve.spool_rate_limit,
            "swash_limited": 1.0,
            "tire_slides": 1.0,
            "rolls": 1.0,
        }
        self.limits = {name: np.array(np.broadcast_to(value, self.count)) for name, value in limits.items()}
        for lane, names in enumerate(without):
            for name in names:
                for key, value in LIMITS[name].items():
                    self.limits[key][lane] = value
        self.cv_in, self.cv_out = np.asarray(valve.cv_in_left), np.asarray(valve.cv_out_left)
        self.cv_compensator, self.cv_bleed = np.asarray(valve.cv_compensator), np.asarray(pump.cv_bleed)
        self.cv_cross_port, self.cv_suction = valve.cv_cross_port, machine.steering.tank_line.cv_suction

    def rest(self) -> Array:
        """State (15, N) before the command, at the right stop: ports at the return line's pressure, pump at its margin."""
        pump, line = self.machine.steering.pump, self.machine.steering.tank_line
        x = np.zeros((len(STATES), self.count))
        x[SUPPLY] = pump.margin
        x[PORT_A] = x[PORT_B] = x[RETURN] = line.back_pressure
        x[SWASH] = pump.leakage * pump.margin / (pump.displacement * self.machine.engine.set_speed)
        x[COMPENSATOR] = 1.0
        x[PHI] = -0.5 * np.asarray(self.machine.joint.range)
        self._lean(x)
        return x

    def _lean(self, x: Array) -> None:
        """Tires and oil that hold the machine on its slope: sideways force m g s / cos φ at the axle; the joint's torque by
        dry friction, and by the ports' pressure what is beyond it."""
        half, phi = self.half, x[PHI]
        sideways = half.mass * GRAVITY * self.slope / np.cos(phi)
        x[BRISTLE] = -sideways / (half.load * self.machine.tire.sigma0_lateral)
        x[ROLL] = half.high * GRAVITY * self.slope / (half.roll_stiffness * np.cos(phi) ** 2)
        torque = half.moment * np.cos(phi) * GRAVITY * self.slope - half.axle * sideways
        ports = chambers(self.machine, 2.0 * phi)
        held = dry_friction(self.machine, ports, x[PORT_A] + x[PORT_B], 0.0)
        lacking = torque - x[PORT_A] * ports.displacement_a + x[PORT_B] * ports.displacement_b
        lacking = lacking - np.clip(lacking, -held, held)
        x[PORT_A] += np.maximum(lacking, 0.0) / ports.displacement_a
        x[PORT_B] += np.maximum(-lacking, 0.0) / ports.displacement_b

    def steady(self, angle: ArrayLike) -> tuple[Array, SteadyTurn]:
        """State (15, N) of the steady turn at joint ``angle`` [rad]: axles roll without slipping sideways."""
        load = 2.0 * self.half.half_track * self.half.drag
        theta = np.broadcast_to(np.asarray(angle, dtype=np.float64), self.count)
        turn = steady_turn(self.machine, self.level, theta, load)
        x = np.zeros((len(STATES), self.count))
        x[SUPPLY], x[PORT_A], x[PORT_B], x[RETURN] = turn.supply, turn.pressure_a, turn.pressure_b, turn.return_pressure
        x[LS], x[SWASH], x[COMPENSATOR], x[SPOOL] = turn.pressure_a, turn.swash, turn.compensator, self.level
        x[PHI] = 0.5 * theta
        x[RATE] = 0.5 * turn.flow / chambers(self.machine, theta).displacement_a
        x[HINGE] = -self.half.axle * x[RATE] / np.cos(x[PHI])
        return x, turn

    def derivative(self, x: Array, command: ArrayLike) -> Array:
        """ẋ (15, N) at the spool's ``command`` (of the full signal)."""
        out = np.empty_like(x)
        joint_rate = 2.0 * x[RATE]
        ports = chambers(self.machine, 2.0 * x[PHI])
        p_s, p_a, p_b, p_t = x[SUPPLY], x[PORT_A], x[PORT_B], x[RETURN]
        edge = opening(self.machine, x[SPOOL])
        self._valve_and_pump(x, edge, command, out)
        flow_in, flow_out, tank_a, tank_b, across = self._flows(x, edge)

        # ports: shut oil in series with mounts and their play
        compliance_a = ports.volume_a / modulus(self.machine, p_a) + self.machine.steering.hose_compliance
        compliance_b = ports.volume_b / modulus(self.machine, p_b) + self.machine.steering.hose_compliance
        rise_a = (flow_in - tank_a - across - ports.displacement_a * joint_rate) / compliance_a
        rise_b = (-flow_out - tank_b + across + ports.displacement_b * joint_rate) / compliance_b
        torque = p_a * ports.displacement_a - p_b * ports.displacement_b
        bend = self._bend(torque)
        spring = ports.displacement_a**2 / compliance_a + ports.displacement_b**2 / compliance_b
        torque_rate = (ports.displacement_a * rise_a - ports.displacement_b * rise_b) / (1.0 + bend * spring)
        out[PORT_A] = rise_a - ports.displacement_a / compliance_a * bend * torque_rate
        out[PORT_B] = rise_b + ports.displacement_b / compliance_b * bend * torque_rate

        # supply and return line
        steering, oil = self.machine.steering, self.machine
        pump, line = steering.pump, steering.tank_line
        laminar = self.machine.oil.laminar_pressure
        delivered = x[SWASH] * pump.displacement * self.machine.engine.set_speed
        relief = pump.relief_flow / pump.relief_ramp * np.maximum(p_s - self.limits["relief_pressure"], 0.0)
        bled = turbulent(self.cv_bleed, x[LS], laminar)
        supply_compliance = pump.line_volume / modulus(oil, p_s) + pump.line_compliance
        out[SUPPLY] = (delivered - pump.leakage * p_s - bled - relief - flow_in) / supply_compliance
        over = np.maximum(p_t - line.back_pressure, 0.0)
        linear = line.back_pressure_ramp / line.back_flow
        drained = 2.0 * over / (linear + np.sqrt(linear**2 + 4.0 * line.throttle * over))
        sucked = turbulent(self.cv_suction, np.maximum(-p_t, 0.0), laminar)
        return_compliance = line.volume / modulus(oil, p_t) + line.compliance
        out[RETURN] = (flow_out + tank_a + tank_b - drained + sucked) / return_compliance

        drag = steering.cylinder.seal_viscous * ports.lever_squares * joint_rate
        grip = dry_friction(self.machine, ports, np.maximum(p_a, 0.0) + np.maximum(p_b, 0.0), joint_rate)
        stop = self._stop(2.0 * x[PHI], joint_rate)
        self._bodies(x, torque + stop - drag - grip * np.tanh(joint_rate / CREEP), out)
        return out

    def _valve_and_pump(self, x: Array, edge: Array, command: ArrayLike, out: Array) -> None:
        """Spool, compensator, swash and load-sensing line, the metering ``edge`` [-] open."""
        valve, pump = self.machine.steering.valve, self.machine.steering.pump
        fastest = self.limits["spool_rate_limit"]
        out[SPOOL] = np.clip((command - x[SPOOL]) / valve.spool_time_constant, -fastest, fastest)

        y = x[COMPENSATOR]
        available = np.where(edge > 0.0, np.maximum(x[SUPPLY] - x[PORT_A], 0.0), 0.0)
        ratio = edge * self.cv_in / self.cv_compensator
        wide = np.maximum(y**2 + ratio**2, 1e-12)
        excess = available * y**2 / wide / valve.compensator_pressure
        speed = (1.0 + valve.compensator_droop * (0.5 - y) - excess) / valve.compensator_time_constant
        # its pole grows without bound as the edge closes; damped by the square of what a step resolves
        pole = 2.0 * available * y * ratio**2 / wide**2 / valve.compensator_pressure / valve.compensator_time_constant
        speed = speed / (1.0 + (STEP * pole / 2.8) ** 2)
        out[COMPENSATOR] = np.where((y >= 1.0) & (speed > 0.0) | (y <= 0.0) & (speed < 0.0), 0.0, speed)

        error = np.minimum(x[LS] + pump.margin, self.limits["cutoff"]) - x[SUPPLY]
        free = error / (pump.control_band * pump.stroke_up_time)
        limited = self.limits["swash_limited"] > 0.0
        speed = np.where(limited, np.clip(free, -1.0 / pump.stroke_down_time, 1.0 / pump.stroke_up_time), free)
        at_stop = (x[SWASH] >= 1.0) & (speed > 0.0) | (x[SWASH] <= 0.0) & (speed < 0.0)
        out[SWASH] = np.where(at_stop, 0.0, speed)

        load = np.where(edge > 0.0, np.maximum(x[PORT_A], 0.0), 0.0)
        out[LS] = (load - x[LS]) / pump.ls_time_constant

    def _flows(self, x: Array, edge: Array) -> tuple[Array, Array, Array, Array, Array]:
        """Flows [m³/s] into A, out of B, from either port to the return line past the edges, and from A to B."""
        valve, laminar = self.machine.steering.valve, self.machine.oil.laminar_pressure
        p_a, p_b, p_t, y = x[PORT_A], x[PORT_B], x[RETURN], x[COMPENSATOR]
        ratio = edge * self.cv_in / self.cv_compensator
        share = y / np.sqrt(np.maximum(y**2 + ratio**2, 1e-12))
        flow_in = turbulent(edge * self.cv_in * share, np.maximum(x[SUPPLY] - p_a, 0.0), laminar)
        flow_out = turbulent(edge * self.cv_out, p_b - p_t, laminar)
        past = []
        for port in (p_a, p_b):
            shock = valve.shock_flow / valve.shock_ramp * np.maximum(port - p_t - self.limits["shock_pressure"], 0.0)
            opens = np.maximum(p_t - port - valve.anticavitation_crack, 0.0)
            past.append(
                shock + valve.leakage * (port - p_t) - turbulent(self.limits["cv_anticavitation"], opens, laminar)
            )
        across = 2.0 * self.machine.steering.cylinder.leakage * (p_a - p_b)
        across = across + turbulent(self.cv_cross_port, p_a - p_b, laminar)
        return flow_in, flow_out, past[0], past[1], across

    def _bend(self, torque: Array) -> Array:
        """Compliance [rad/(N m)] between cylinders and frames at ``torque``: mounts, and play that a torque crosses."""
        joint = self.machine.joint
        crossing = 1.0 / np.cosh(np.clip(torque / PLAY_TORQUE, -50.0, 50.0)) ** 2
        return np.asarray(joint.compliance + 0.5 * joint.backlash / PLAY_TORQUE * crossing)

    def _stop(self, angle: Array, rate: Array) -> Array:
        """Torque [N m] of both bottomed cylinders at the left stop: spring and damper that never pull."""
        joint, lever = self.machine.joint, self.machine.steering.cylinder.linkage.mean_lever
        push = joint.stop_stiffness * (angle - joint.range) + joint.stop_damping * rate
        return np.where(angle > joint.range, -2.0 * np.square(lever) * np.maximum(push, 0.0), 0.0)

    def _bodies(self, x: Array, torque: Array, out: Array) -> None:
        """Half angle, hinge, roll, tires: M (φ̈, v̇) = loads. Bristles ż = u − σ₀ |u| z/g(u), u the axle's slip sideways
        (Canudas de Wit et al. 1995); a twist that rolling renews (Sharp & Granger)."""
        half, tire = self.half, self.machine.tire
        phi, rate, hinge = x[PHI], x[RATE], x[HINGE]
        cosine, sine = np.cos(phi), np.sin(phi)
        slip = hinge * cosine + half.axle * rate
        grip = tire.friction_coulomb + (tire.friction_static - tire.friction_coulomb) * np.exp(
            -((slip / tire.stribeck_velocity) ** 2)
        )
        slides = self.limits["tire_slides"] * tire.sigma0_lateral * np.abs(slip) / grip
        out[BRISTLE] = slip - slides * x[BRISTLE]
        sideways = -half.load * (
            tire.sigma0_lateral * x[BRISTLE] + tire.sigma1_lateral * out[BRISTLE] + tire.sigma2_lateral * slip
        )
        along, apart = hinge * sine, half.half_track * rate
        inner, outer = np.tanh((along - apart) / CREEP_WHEEL), np.tanh((along + apart) / CREEP_WHEEL)
        patch = 2.0 * np.sqrt(2.0 * tire.radius * 0.5 * half.load / tire.stiffness)
        rolls = 0.5 * (np.abs(along - apart) + np.abs(along + apart)) / patch
        out[TWIST] = rate - (np.abs(rate) / tire.scrub_angle + rolls) * x[TWIST]
        scrub = tire.friction_coulomb * half.load * tire.scrub_radius * x[TWIST] / tire.scrub_angle

        push = torque - scrub + half.axle * sideways + half.drag * half.half_track * (inner - outer)
        push = push - half.moment * cosine * GRAVITY * self.slope
        aside = cosine * sideways - half.drag * sine * (inner + outer) - half.mass * GRAVITY * self.slope
        aside = aside + half.moment * sine * rate**2 - 2.0 * half.wheel_mass * sine * cosine * rate * hinge
        tips = -half.roll_stiffness * cosine**2 * x[ROLL] - half.roll_damping * cosine**2 * x[ROLL_RATE]
        tips = tips + half.high * GRAVITY * self.slope - half.ahead_high * sine * rate**2

        # the roll eliminated
        m11, m12, m22, m13, m23, m33 = half.mass_matrix(phi)
        m13, m23 = self.limits["rolls"] * m13, self.limits["rolls"] * m23
        push, aside = push - m13 / m33 * tips, aside - m23 / m33 * tips
        m11, m12, m22 = m11 - m13**2 / m33, m12 - m13 * m23 / m33, m22 - m23**2 / m33
        determinant = m11 * m22 - m12**2
        out[PHI] = rate
        out[RATE] = (m22 * push - m12 * aside) / determinant
        out[HINGE] = (m11 * aside - m12 * push) / determinant
        out[ROLL] = x[ROLL_RATE]
        out[ROLL_RATE] = (tips - m13 * out[RATE] - m23 * out[HINGE]) / m33

    def turn(self, duration: float, every: float = 1e-3) -> tuple[Array, Array]:
        """Instants [s] (F,) from the command's step on and states (F, 15, N): Runge-Kutta of the fourth order."""
        steps, frames = round(every / STEP), round(duration / every)
        delay = np.asarray(self.machine.steering.valve.command_delay)
        x, states = self.rest(), []
        for frame in range(frames + 1):
            states.append(x)
            for step in range(steps if frame < frames else 0):
                x = self._step(x, frame * every + step * STEP, delay)
        return np.arange(frames + 1) * every, np.array(states)

    def _step(self, x: Array, time: float, delay: Array) -> Array:
        early, middle, late = (np.where(time + share * STEP >= delay, self.level, 0.0) for share in (0.0, 0.5, 1.0))
        k1 = self.derivative(x, early)
        k2 = self.derivative(x + 0.5 * STEP * k1, middle)
        k3 = self.derivative(x + 0.5 * STEP * k2, middle)
        k4 = self.derivative(x + STEP * k3, late)
        x = x + STEP / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
        x[SWASH], x[COMPENSATOR] = np.clip(x[SWASH], 0.0, 1.0), np.clip(x[COMPENSATOR], 0.0, 1.0)
        return x

    def linearised(self, angle: ArrayLike) -> tuple[Array, Array]:
        """Matrix A (N, 13, 13) of δẋ = A δx about the steady turn, joint ``angle`` and spool held; and that state (15, N).

        Rows and columns in the order of :data:`STATES` without spool and half angle (:data:`LINEAR`). Central differences.
        """
        steady, _ = self.steady(angle)
        a = np.empty((self.count, len(LINEAR), len(LINEAR)))
        for column, state in enumerate(LINEAR):
            step = 1e-4 * SCALES[state]
            moved = [steady.copy() for _ in range(2)]
            moved[0][state] += step
            moved[1][state] -= step
            rises = [self.derivative(x, self.level) for x in moved]
            a[:, :, column] = ((rises[0] - rises[1])[list(LINEAR)] / (2.0 * step)).T
        return a, steady


LINEAR = tuple(i for i in range(len(STATES)) if i not in (SPOOL, PHI))
"""States of the linearised circuit."""
SCALES = np.array([BAR] * 5 + [0.1, 0.1, 1.0, 1.0, 0.1, 0.1, 0.01, 0.01, 0.01, 0.1])
"""What each state changes by."""


def oil_mode(planar: Planar, angle: ArrayLike) -> tuple[Array, Array]:
    """Natural frequency ω_n [rad/s] and damping ratio ζ (N,) of the joint on its oil columns, at joint ``angle`` [rad].

    The linearised circuit's pole nearest to that of shut columns
    (:func:`~aoro_gym.validation.theory.circuit.hydraulic_frequency`).
    A negative ζ is an oscillation that grows until a limit holds it.
    """
    a, steady = planar.linearised(angle)
    machine, ports = planar.machine, chambers(planar.machine, 2.0 * steady[PHI])
    walls = machine.steering.hose_compliance
    shut = hydraulic_frequency(
        ports,
        ports.volume_a / modulus(machine, steady[PORT_A]) + walls,
        ports.volume_b / modulus(machine, steady[PORT_B]) + walls,
        joint_inertia(planar.half, 2.0 * steady[PHI])[0],
    )
    poles = np.linalg.eigvals(a)
    far = np.where(poles.imag > 1e-9, np.abs(np.log(np.maximum(np.abs(poles), 1e-9) / shut[:, None])), np.inf)
    pole = np.take_along_axis(poles, far.argmin(axis=1)[:, None], axis=1)[:, 0]
    return np.abs(pole), -pole.real / np.abs(pole)
