"""The mean half of the machine: its masses about the hinge, what its tires bear, and the inertia that the joint has."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from aoro_gym.machine import Machine
from aoro_gym.units import GRAVITY
from aoro_gym.validation.theory.circuit import Array

DISC_DEPTH = 2e-3
"""Depth ε [m] over which the discs across a tire share its contact."""


@dataclass(frozen=True, eq=False)
class Half:
    """The mean half: mass, first and second moment about the hinge, axle and wheels."""

    mass: Array  # [kg]
    moment: Array  # [kg m] m c
    inertia: Array  # [kg m²] about the hinge, upright axis
    axle: Array  # [m] a, from the hinge
    half_track: Array  # [m] w
    wheel_mass: Array  # [kg] a wheel's spin inertia over its radius squared
    high: Array  # [kg m] m h over the ground
    ahead_high: Array  # [kg m²] Σ m x h, x from the hinge
    roll_inertia: Array  # [kg m²] about the ground
    roll_stiffness: Array  # [N m/rad] of the tires, less what the weight tips
    roll_damping: Array  # [N m s/rad]
    load: Array  # [N] of one axle
    drag: Array  # [N] of brake and rolling at one rim

    def mass_matrix(self, phi: ArrayLike) -> tuple[Array, Array, Array, Array, Array, Array]:
        """Elements 11, 12, 22, 13, 23, 33 of M for (φ̈, v̇, ρ̈).

        The hinge moves at v sin φ along the half and at v cos φ across it; what is at the height h ahead of the hinge by x
        moves sideways at v + x φ̇ cos φ − h ρ̇.
        """
        cosine = np.cos(phi)
        return (
            np.asarray(self.inertia + 2.0 * self.wheel_mass * self.half_track**2 + 0.0 * cosine),
            self.moment * cosine,
            self.mass + 2.0 * self.wheel_mass * np.sin(phi) ** 2,
            -self.ahead_high * cosine,
            np.asarray(-self.high + 0.0 * cosine),
            np.asarray(self.roll_inertia + 0.0 * cosine),
        )


def half_of(machine: Machine) -> Half:
    """The mean half of ``machine`` at rest."""
    corner, arm, tire, rest = machine.corner, machine.arm, machine.tire, machine.rest
    halves, cargo = [], machine.payload
    for frame, angle, load, carried in (
        (machine.frame.front, rest.arm_angle_front, rest.wheel_load_front, 0.0),
        (machine.frame.rear, rest.arm_angle_rear, rest.wheel_load_rear, cargo.mass),
    ):
        cosine, sine = np.cos(angle), np.sin(angle)
        pivot = frame.axle_distance - arm.length
        ahead, centre = pivot + corner.rho * cosine, frame.axle_distance - frame.cog_offset
        frame_height, wheel_height = frame.cog_height + rest.height, tire.radius - load / tire.stiffness
        tall = frame.mass * frame_height**2 + 2.0 * corner.mass * (wheel_height**2 + corner.lateral**2)
        carried_height = cargo.cog_height + rest.height
        own = frame.inertia_zz + 2.0 * (corner.inertia_ee * sine**2 + corner.inertia_nn * cosine**2)
        far = frame.mass * centre**2 + 2.0 * corner.mass * (ahead**2 + corner.lateral**2)
        if np.any(np.greater(carried, 0.0)):
            own = own + cargo.inertia_zz
            far = far + carried * cargo.distance**2
            tall = tall + carried * carried_height**2 + cargo.inertia_xx
        halves.append(
            (
                frame.mass + carried + 2.0 * corner.mass,
                frame.mass * centre + carried * cargo.distance + 2.0 * corner.mass * ahead,
                own + far,
                pivot + arm.length * cosine,
                2.0 * load,
                frame.mass * frame_height + carried * carried_height + 2.0 * corner.mass * wheel_height,
                frame.mass * frame_height * centre
                + carried * carried_height * cargo.distance
                + 2.0 * corner.mass * wheel_height * ahead,
                frame.inertia_xx + 2.0 * corner.inertia_ee + tall,
            )
        )
    mass, moment, inertia, axle, axle_load, high, ahead_high, roll_inertia = (
        np.asarray(0.5 * (front + rear)) for front, rear in zip(*halves, strict=True)
    )
    half_track = np.asarray(0.5 * machine.frame.track)
    radius = tire.radius - 0.5 * (rest.deflection_front + rest.deflection_rear)
    return Half(
        mass=mass,
        moment=moment,
        inertia=inertia,
        axle=axle,
        half_track=half_track,
        wheel_mass=np.asarray(machine.wheel.inertia_spin / radius**2),
        high=high,
        ahead_high=ahead_high,
        roll_inertia=roll_inertia,
        roll_stiffness=2.0 * tire.stiffness * half_track**2 + axle_load * _crown(machine) - high * GRAVITY,
        roll_damping=2.0 * tire.damping * half_track**2,
        load=axle_load,
        drag=np.asarray(machine.driveline.brake.disc_torque / radius + 0.5 * tire.rolling_resistance * axle_load),
    )


def _crown(machine: Machine) -> Array:
    """How far the contact moves across a tire that leans [m/rad]: to discs that a little less depth parts from the middle
    one's, their share of the load falling by exp(−depth/ε)."""
    tire = machine.tire
    share = [np.exp(-np.asarray(drop) / DISC_DEPTH) for drop in (tire.disc_drop_inner, tire.disc_drop_outer)]
    moved = tire.disc_offset_inner**2 * share[0] + tire.disc_offset_outer**2 * share[1]
    return 2.0 * moved / DISC_DEPTH / (1.0 + 2.0 * (share[0] + share[1]))


def joint_inertia(half: Half, angle: ArrayLike) -> tuple[Array, Array]:
    """Inertia J [kg m²] of the joint at ``angle`` [rad]: on tires that give way sideways and in roll, and with axles held.

    That is far above the tires' own frequencies, where hinge and roll follow from the mass matrix, and far below them,
    where v cos φ = −a φ̇ without roll. Two halves with θ̇ = 2 φ̇ make J = ½ M.
    """
    phi = 0.5 * np.asarray(angle, dtype=np.float64)
    m11, m12, m22, m13, m23, m33 = half.mass_matrix(phi)
    determinant = m22 * m33 - m23**2
    free = m11 - (m12**2 * m33 - 2.0 * m12 * m13 * m23 + m13**2 * m22) / determinant
    aside = -half.axle / np.cos(phi)
    return 0.5 * free, 0.5 * (m11 + 2.0 * m12 * aside + m22 * aside**2)
