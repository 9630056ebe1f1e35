"""A planar machine of two equal halves on the steering circuit: its equations, its linearisation, its motion.

Front and rear half are replaced by their mean, so that the plane between them is one of symmetry: the hinge moves in it at
v, the halves yaw by ±φ, θ = 2 φ, and both roll together on their tires, as an upright hinge makes them. Circuit: one
pressure a volume, orifices and valves as static characteristics or as slow as their law says. Without: pitch, the pendulum
arms, the driveline's loop, the bristles' stretch along the tires.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from aoro_gym.machine import Machine
from aoro_gym.units import GRAVITY
from aoro_gym.validation.theory.circuit import (
    Array,
    Chambers,
    SteadyTurn,
    chambers,
    dry_friction,
    either,
    hydraulic_frequency,
    modulus,
    obeys,
    steady_turn,
    walls,
)
from aoro_gym.validation.theory.half import half_of, joint_inertia
from aoro_gym.validation.theory.hydraulics import Circuit
from aoro_gym.validation.theory.states import (
    BRISTLE,
    COMPENSATOR,
    COMPENSATOR_RATE,
    HINGE,
    HOSE_A,
    HOSE_B,
    HOSE_FLOW_A,
    HOSE_FLOW_B,
    JOINT_BRISTLE,
    LIMITS,
    LS,
    PHI,
    PORT_A,
    PORT_B,
    RATE,
    RETURN,
    ROLL,
    ROLL_RATE,
    SCALES,
    SPOOL,
    SPOOL_RATE,
    STATES,
    STRAIN_A,
    STRAIN_B,
    SUPPLY,
    SWASH,
    TWIST,
)

CREEP_WHEEL = 0.01
"""Rim speed [m/s] below which a wheel's drag is taken as viscous."""


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
        self.circuit = Circuit(machine, self.limits)
        self.bristles_yield = obeys(machine, "friction", "lugre")
        self.fades = obeys(machine, "friction", "stribeck_tanh") | obeys(machine, "friction", "coulomb_viscous")
        self.relaxes = obeys(machine, "slip", "relaxation")
        self.discs = obeys(machine, "swivel", "five_discs")
        self.bores = obeys(machine, "swivel", "bore_torque")

    def rest(self) -> Array:
        """State (27, N) before the command, at the right stop: ports at the return line's pressure, pump at its margin."""
        pump, line = self.machine.steering.pump, self.machine.steering.tank_line
        x = np.zeros((len(STATES), self.count))
        x[SUPPLY] = pump.margin
        back = np.where(obeys(self.machine, "return_line", "orifice"), 0.0, line.back_pressure)
        x[PORT_A] = x[PORT_B] = x[RETURN] = back
        x[SWASH] = pump.leakage * pump.margin / (pump.displacement * self.machine.engine.set_speed)
        x[COMPENSATOR] = 1.0
        x[PHI] = -0.5 * np.asarray(self.machine.joint.range)
        self._lean(x)
        self._settle_hoses(x)
        return x

    def _settle_hoses(self, x: Array) -> None:
        """Segments at the valve at their port's pressure, and walls that have crept."""
        steering = self.machine.steering
        for port, hose, strain in ((PORT_A, HOSE_A, STRAIN_A), (PORT_B, HOSE_B, STRAIN_B)):
            x[hose] = x[port]
            x[strain] = steering.hose_delayed_share * steering.hose_compliance * np.maximum(x[port], 0.0)

    def _lean(self, x: Array) -> None:
        """Tires and oil that hold the machine on its slope: sideways force m g s / cos φ at the axle; the joint's torque by
        dry friction where it sticks, and by the ports' pressure what is beyond it."""
        half, phi = self.half, x[PHI]
        sideways = half.mass * GRAVITY * self.slope / np.cos(phi)
        x[BRISTLE] = -sideways / (half.load * self.machine.tire.sigma0_lateral)
        x[ROLL] = half.high * GRAVITY * self.slope / (half.roll_stiffness * np.cos(phi) ** 2)
        torque = half.moment * np.cos(phi) * GRAVITY * self.slope - half.axle * sideways
        ports = chambers(self.machine, 2.0 * phi)
        held = np.where(self.fades, 0.0, dry_friction(self.machine, ports, x[PORT_A] + x[PORT_B], 0.0))
        lacking = torque - x[PORT_A] * ports.displacement_a + x[PORT_B] * ports.displacement_b
        x[JOINT_BRISTLE] = -np.clip(lacking, -held, held) / self.machine.joint.presliding_stiffness
        lacking = lacking - np.clip(lacking, -held, held)
        x[PORT_A] += np.maximum(lacking, 0.0) / ports.displacement_a
        x[PORT_B] += np.maximum(-lacking, 0.0) / ports.displacement_b

    def steady(self, angle: ArrayLike) -> tuple[Array, SteadyTurn]:
        """State (27, N) of the steady turn at joint ``angle`` [rad]: axles roll without slipping sideways."""
        theta = np.broadcast_to(np.asarray(angle, dtype=np.float64), self.count)
        x = np.zeros((len(STATES), self.count))
        load = 2.0 * self.half.half_track * self.half.drag
        for _ in range(2):  # the torque that twists the tires hardly changes the flow
            turn = steady_turn(self.machine, self.level, theta, load)
            ports = chambers(self.machine, theta)
            x[PHI], x[RATE] = 0.5 * theta, 0.5 * turn.flow / ports.displacement_a
            x[HINGE] = -self.half.axle * x[RATE] / np.cos(x[PHI])
            x[TWIST] = self._steady_twist(x)
            load = 2.0 * self.half.half_track * self.half.drag + self._swivel(x, np.zeros(self.count))[1]
        x[SUPPLY], x[PORT_A], x[PORT_B], x[RETURN] = turn.supply, turn.cylinder_a, turn.cylinder_b, turn.return_pressure
        x[LS], x[SWASH], x[COMPENSATOR], x[SPOOL] = turn.load_sensing, turn.swash, turn.compensator, turn.spool
        grip = dry_friction(self.machine, ports, turn.pressure_a + turn.pressure_b, 2.0 * x[RATE])
        x[JOINT_BRISTLE] = grip / self.machine.joint.presliding_stiffness
        self._settle_hoses(x)
        x[HOSE_A], x[HOSE_B] = turn.pressure_a, turn.pressure_b
        two = self.circuit.two_segments
        x[HOSE_FLOW_A] = np.where(two, turn.flow, 0.0)
        x[HOSE_FLOW_B] = np.where(two, -turn.flow * ports.displacement_b / ports.displacement_a, 0.0)
        return x, turn

    def derivative(self, x: Array, command: ArrayLike) -> Array:
        """ẋ (27, N) at the spool's ``command`` (of the full signal)."""
        out = np.empty_like(x)
        joint_rate = 2.0 * x[RATE]
        ports = chambers(self.machine, 2.0 * x[PHI])
        self.circuit.derivative(x, command, ports, joint_rate, out)
        drag = self.machine.steering.cylinder.seal_viscous * ports.lever_squares * joint_rate
        torque = self.circuit.torque(x, ports) + self._stop(2.0 * x[PHI], joint_rate) - drag
        self._bodies(x, torque - self._friction(x, ports, joint_rate, out), out)
        return out

    def _grip(self, x: Array, ports: Chambers, rate: Array) -> Array:
        """Torque [N m] at which the joint slides."""
        felt = np.maximum(x[PORT_A], 0.0) + np.maximum(x[PORT_B], 0.0)
        return dry_friction(self.machine, ports, felt, rate)

    def _friction(self, x: Array, ports: Chambers, rate: Array, out: Array) -> Array:
        """Dry friction [N m] of the joint: a spring that slides at its capacity g (Prandtl), one that yields on the way,
        k z + c ż with ż = v − k |v| z/g (Canudas de Wit et al. 1995), or g tanh(v/v_t)."""
        joint, z, grip = self.machine.joint, x[JOINT_BRISTLE], self._grip(x, ports, rate)
        slipping = np.where(
            self.bristles_yield, joint.presliding_stiffness * np.abs(rate) / np.maximum(grip, 1e-3) * z, 0.0
        )
        out[JOINT_BRISTLE] = np.where(self.fades, 0.0, rate - slipping)
        damping = np.minimum(joint.presliding_damping, 4.0 * grip / np.maximum(np.abs(rate), 1e-6))
        damping = np.where(self.bristles_yield, damping, joint.presliding_damping)
        torque = joint.presliding_stiffness * z + damping * out[JOINT_BRISTLE]
        torque = np.where(self.bristles_yield, torque, np.clip(torque, -grip, grip))
        return np.where(self.fades, grip * np.tanh(rate / joint.friction_velocity), torque)

    def _stop(self, angle: Array, rate: Array) -> Array:
        """Torque [N m] of both bottomed cylinders at the left stop: spring and damper that never pull."""
        joint, lever = self.machine.joint, self.machine.steering.cylinder.linkage.mean_lever
        push = joint.stop_stiffness * (angle - joint.range) + joint.stop_damping * rate
        return np.where(angle > joint.range, -2.0 * np.square(lever) * np.maximum(push, 0.0), 0.0)

    def _bodies(self, x: Array, torque: Array, out: Array) -> None:
        """Half angle, hinge, roll, tires: M (φ̈, v̇) = loads."""
        half = self.half
        phi, rate, hinge = x[PHI], x[RATE], x[HINGE]
        cosine, sine = np.cos(phi), np.sin(phi)
        slip = hinge * cosine + half.axle * rate
        sideways = -half.load * self._lateral(x, slip, out)
        out[TWIST], scrub = self._swivel(x, slip)
        along, apart = hinge * sine, half.half_track * rate
        inner, outer = np.tanh((along - apart) / CREEP_WHEEL), np.tanh((along + apart) / CREEP_WHEEL)

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

    def _tire_grip(self, slip: Array) -> Array:
        """Friction coefficient of a tire that slips at ``slip`` [m/s]."""
        tire = self.machine.tire
        more = (tire.friction_static - tire.friction_coulomb) * np.exp(-((slip / tire.stribeck_velocity) ** 2))
        return np.asarray(tire.friction_coulomb + more)

    def _rolling(self, x: Array) -> Array:
        """Mean speed [m/s] at which both wheels of an axle roll."""
        along, apart = x[HINGE] * np.sin(x[PHI]), self.half.half_track * x[RATE]
        return 0.5 * (np.abs(along - apart) + np.abs(along + apart))

    def _lateral(self, x: Array, slip: Array, out: Array) -> Array:
        """Lateral force over the load: bristles ż = u − σ₀ |u| z/g(u), u the axle's ``slip`` [m/s] sideways (Canudas de Wit
        et al. 1995), or a carcass that tread renews as it rolls in, ż = u − |v_r| z/ℓ (Pacejka 2012, 7.2), within g."""
        tire, z, grip = self.machine.tire, x[BRISTLE], self._tire_grip(slip)
        slides = self.limits["tire_slides"] * tire.sigma0_lateral * np.abs(slip) / grip
        out[BRISTLE] = (
            slip - either(self.relaxes, lambda: self._rolling(x) / tire.relaxation_lateral, lambda: slides) * z
        )
        force = tire.sigma0_lateral * z + tire.sigma1_lateral * out[BRISTLE]
        bound = np.where(self.limits["tire_slides"] > 0.0, grip, np.inf)
        return either(self.relaxes, lambda: np.clip(force, -bound, bound), lambda: force + tire.sigma2_lateral * slip)

    def _swivel(self, x: Array, slip: Array) -> tuple[Array, Array]:
        """Rate [rad/s] of the tires' twist, and the torque [N m] on a half by which both its tires resist it.

        Rolling renews a patch over its length. It slides at the scrub angle (Sharp & Granger), as its bristles do, disc by
        disc, or as a whole at the bore torque.
        """
        half, tire, rate, twist = self.half, self.machine.tire, x[RATE], x[TWIST]
        depth = np.asarray(0.5 * half.load / tire.stiffness)
        rolls = self._rolling(x) / (2.0 * np.sqrt(2.0 * tire.radius * depth))
        rim = rate * tire.disc_offset_inner
        speed = np.hypot(slip, rim)
        unload = np.where(
            self.discs, tire.sigma0_longitudinal * speed / self._tire_grip(speed), np.abs(rate) / tire.scrub_angle
        )
        change = rate - (np.where(self.bores, 0.0, unload) + rolls) * twist
        scrub = tire.friction_coulomb * half.load * tire.scrub_radius * twist / tire.scrub_angle
        torque = either(self.discs, lambda: self._disc_torque(x, slip, depth), lambda: scrub)
        limit = 0.5 * tire.friction_coulomb * half.load * tire.bore_radius
        return change, np.where(self.bores, 2.0 * np.clip(tire.bore_stiffness * twist, -limit, limit), torque)

    def _disc_torque(self, x: Array, slip: Array, depth: Array) -> Array:
        """Torque [N m] of both tires' discs at ±y that bear a share w of the load by their depth, F_n Σ w y clip(σ₀ w y),
        longer by the scrub radius over the discs' mean offset."""
        tire = self.machine.tire
        dips = [np.maximum(depth - np.asarray(drop), 0.0) for drop in (tire.disc_drop_inner, tire.disc_drop_outer)]
        total = depth + 2.0 * (dips[0] + dips[1])
        torque = np.zeros(self.count)
        for dip, lever in zip(dips, (tire.disc_offset_inner, tire.disc_offset_outer), strict=True):
            grip = self._tire_grip(np.hypot(slip, x[RATE] * lever))
            left = np.sqrt(np.maximum(grip**2 - np.square(tire.sigma0_lateral * x[BRISTLE]), 0.0))
            pull = np.clip(tire.sigma0_longitudinal * lever * x[TWIST], -left, left)
            torque = torque + 2.0 * self.half.load * dip / total * lever * pull
        mean_offset = 0.4 * (np.asarray(tire.disc_offset_inner) + tire.disc_offset_outer)
        return torque * (1.0 + tire.scrub_radius / mean_offset)

    def _steady_twist(self, x: Array) -> Array:
        """Twist [rad] at which it changes no more."""
        x = x.copy()
        x[TWIST] = 1.0
        return x[RATE] / np.maximum(x[RATE] - self._swivel(x, np.zeros(self.count))[0], 1e-9)

    def turn(self, duration: float, every: float = 1e-3) -> tuple[Array, Array]:
        """Instants [s] (F,) from the command's step on and states (F, 27, N): Runge-Kutta of the fourth order."""
        step = self.circuit.step
        steps, frames = round(every / step), round(duration / every)
        delay = np.asarray(self.machine.steering.valve.command_delay)
        x, states = self.rest(), []
        for frame in range(frames + 1):
            states.append(x)
            for at in range(steps if frame < frames else 0):
                x = self._step(x, frame * every + at * step, step, delay)
        return np.arange(frames + 1) * every, np.array(states)

    def _step(self, x: Array, time: float, step: float, delay: Array) -> Array:
        early, middle, late = (np.where(time + share * step >= delay, self.level, 0.0) for share in (0.0, 0.5, 1.0))
        k1 = self.derivative(x, early)
        k2 = self.derivative(x + 0.5 * step * k1, middle)
        k3 = self.derivative(x + 0.5 * step * k2, middle)
        k4 = self.derivative(x + step * k3, late)
        return self._bounded(x + step / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4))

    def _bounded(self, x: Array) -> Array:
        """Openings, rates, and stretches within their ends; a static compensator in balance."""
        circuit, joint, tire = self.circuit, self.machine.joint, self.machine.tire
        stopped = (x[COMPENSATOR] > 1.0) | (x[COMPENSATOR] < 0.0)
        x[COMPENSATOR_RATE] = np.where(stopped, 0.0, x[COMPENSATOR_RATE])
        x[SWASH], x[COMPENSATOR] = np.clip(x[SWASH], 0.0, 1.0), np.clip(x[COMPENSATOR], 0.0, 1.0)
        fastest = self.limits["spool_rate_limit"]
        x[SPOOL_RATE] = np.clip(x[SPOOL_RATE], -fastest, fastest)
        x[LS] = np.maximum(x[LS], 0.0)
        if np.any(circuit.is_static):
            x[COMPENSATOR] = np.where(circuit.is_static, circuit.balanced(x), x[COMPENSATOR])
        ports = chambers(self.machine, 2.0 * x[PHI])
        most = self._grip(x, ports, 2.0 * x[RATE]) / joint.presliding_stiffness
        x[JOINT_BRISTLE] = np.where(self.bristles_yield, x[JOINT_BRISTLE], np.clip(x[JOINT_BRISTLE], -most, most))
        if np.any(self.relaxes):
            slip = x[HINGE] * np.cos(x[PHI]) + self.half.axle * x[RATE]
            most = np.where(self.limits["tire_slides"] > 0.0, self._tire_grip(slip) / tire.sigma0_lateral, np.inf)
            x[BRISTLE] = np.where(self.relaxes, np.clip(x[BRISTLE], -most, most), x[BRISTLE])
        if np.any(self.bores):
            most = 0.5 * tire.friction_coulomb * self.half.load * tire.bore_radius / tire.bore_stiffness
            x[TWIST] = np.where(self.bores, np.clip(x[TWIST], -most, most), x[TWIST])
        return x

    def linearised(self, angle: ArrayLike) -> tuple[Array, Array]:
        """Matrix A (N, 24, 24) of δẋ = A δx about the steady turn, joint ``angle`` held; and that state (27, N).

        Rows and columns in the order of :data:`STATES` without half angle, dry friction's stretch, which slides, and the
        opening of a compensator in balance (:data:`LINEAR`). Central differences.
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


LINEAR = tuple(i for i in range(len(STATES)) if i not in (SPOOL, PHI, JOINT_BRISTLE))
"""States of the linearised circuit."""


def oil_mode(planar: Planar, angle: ArrayLike) -> tuple[Array, Array]:
    """Natural frequency ω_n [rad/s] and damping ratio ζ (N,) of the joint on its oil columns, at joint ``angle`` [rad].

    The linearised circuit's pole nearest to that of shut columns
    (:func:`~aoro_gym.validation.theory.circuit.hydraulic_frequency`).
    A negative ζ is an oscillation that grows until a limit holds it.
    """
    a, steady = planar.linearised(angle)
    machine, ports = planar.machine, chambers(planar.machine, 2.0 * steady[PHI])
    shut = hydraulic_frequency(
        ports,
        ports.volume_a / modulus(machine, steady[PORT_A]) + walls(machine, steady[PORT_A]),
        ports.volume_b / modulus(machine, steady[PORT_B]) + walls(machine, steady[PORT_B]),
        joint_inertia(planar.half, 2.0 * steady[PHI])[0],
    )
    poles = np.linalg.eigvals(a)
    far = np.where(poles.imag > 1e-9, np.abs(np.log(np.maximum(np.abs(poles), 1e-9) / shut[:, None])), np.inf)
    pole = np.take_along_axis(poles, far.argmin(axis=1)[:, None], axis=1)[:, 0]
    return np.abs(pole), -pole.real / np.abs(pole)
