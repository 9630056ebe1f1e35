"""Tires of the plants: what the ground under a standing or slowly rolling wheel resists with.

Vectors are in the wheel's own axes (longitudinal, lateral), arrays (4, R) by wheel: front left, front right, rear left, rear
right. A force is the ground's on the wheel.
"""

from __future__ import annotations

import numpy as np

from aoro_gym.diagnosis_benchmark.plants.fluid import Array, Constants
from aoro_gym.diagnosis_benchmark.plants.friction import dahl

NOMINAL_LOAD = 24_500.0
"""[N] on a wheel, at which tire magnitudes are stated."""

SCRUB_ANGLE = 0.1
"""Swivel angle [rad] over which scrub torque builds up (published breakaway of standing tires: 0.05 to 0.2 rad)."""

ROLLING_SPEED = 0.05
"""Spin [rad/s] over which rolling resistance changes its sign."""

RUT_SPEED = 0.01
"""Lateral speed [m/s] over which a rut's resistance changes its sign."""

RUT_SHARE = 1.5
"""Lateral over longitudinal resistance of soft ground above level 0: a wheel pushed sideways bulldozes (estimate)."""

PATCH_OFFSETS = np.array([-0.20, -0.10, 0.0, 0.10, 0.20])
"""[m] of a patch's strips across the tire, 0.53 m wide."""

PATCH_SHARES = np.array([0.15, 0.225, 0.25, 0.225, 0.15])
"""Of the load on each strip: less under the shoulders."""

PATCH_HALF_LENGTH = 0.10
"""[m] from the patch's middle to the bristles at its front and its rear half: √(F/πp) = 0.2 m at 24.5 kN and 2 bar."""

PARKING = 1000.0
"""Torque [N m] that a standing tire of level 3 resists swivelling with at its nominal load: 2/3 μ F a of a disc, a = 0.1 m
(estimate)."""


class Tires:
    """LuGre bristles a unit of load, at one point a wheel (level 0 and 1) or at ten points of its contact patch (level 2)::

        ż = v − σ₀ |v| z / g(|v|) [− |Ω r| z / ℓ],    F = −N (σ₀ z + σ₁ ż + σ₂ v)

    The term in brackets is the patch's: tread that rolls out of the contact takes its bristles along. With a patch a wheel
    that is swivelled builds up a torque; with one point a torque of Dahl's form is added where the effect asks for one.
    Source: Canudas de Wit, Tsiotras, Velenis, Basset and Gissinger, Vehicle System Dynamics 39 (2003) 189.

    Level 3 has one point a wheel whose bristles roll out of the contact, too, slides at one level of friction, and a torque
    of Dahl's form on every wheel that is swivelled.
    """

    def __init__(self, constants: Constants, level: int):
        p = constants
        self.patch = level == 2
        self.rolls_out = level >= 2
        self.stiffness = np.stack([p["tire.sigma0_longitudinal"], p["tire.sigma0_lateral"]])[:, None, None]
        self.damping = np.stack([p["tire.sigma1_longitudinal"], p["tire.sigma1_lateral"]])[:, None, None]
        self.viscous = np.stack([p["tire.sigma2_longitudinal"], p["tire.sigma2_lateral"]])[:, None, None]
        self.sliding = p["tire.friction_coulomb"]
        self.sticking = self.sliding if level == 3 else p["tire.friction_static"]
        self.stribeck = p["tire.stribeck_velocity"]
        self.rolling = p["tire.rolling_resistance"]
        self.rut = RUT_SHARE * p["ground.rut"]
        self.scrub = p["tire.scrub_torque"] + (PARKING if level == 3 else 0.0)
        self.length = 4.0 * PATCH_HALF_LENGTH
        scale = 1.0 + p["tire.patch_gain"]
        if self.patch:
            across, along = np.meshgrid(PATCH_OFFSETS, [-PATCH_HALF_LENGTH, PATCH_HALF_LENGTH])
            share = np.stack([PATCH_SHARES, PATCH_SHARES]).ravel() / 2.0
            self.along = along.ravel()[:, None, None] * scale
            self.across = across.ravel()[:, None, None] * scale
            self.share = share[:, None, None]
            self.length = self.length * scale
        else:
            self.along = self.across = np.zeros((1, 1, 1))
            self.share = np.ones((1, 1, 1))
        runs = len(self.sliding)
        self.bristles = np.zeros((2, len(self.share), 4, runs))  # [m]
        self.twist = np.zeros((4, runs))  # share of the scrub torque

    def _slip(self, longitudinal: Array, lateral: Array, yaw_rate: Array) -> Array:
        """Slip velocity (2, points, 4, R) [m/s] of the contact's points."""
        shape = (len(self.share), *longitudinal.shape)
        return np.stack(
            [
                np.broadcast_to(longitudinal - self.across * yaw_rate, shape),
                np.broadcast_to(lateral + self.along * yaw_rate, shape),
            ]
        )

    def _yielding(self, slip: Array, roll: Array) -> Array:
        """Rate [1/s] at which bristles lose their stretch, (2, points, 4, R)."""
        speed = np.sqrt(slip[0] ** 2 + slip[1] ** 2)
        grip = self.sliding + (self.sticking - self.sliding) * np.exp(-((speed / self.stribeck) ** 2))
        loss = self.stiffness * (speed / grip)
        return loss + np.abs(roll) / self.length if self.rolls_out else loss

    def advance(self, longitudinal: Array, lateral: Array, yaw_rate: Array, roll: Array, duration: float) -> None:
        """Move the bristles on by ``duration`` [s] at constant slip: exact, as their law is linear in them.

        Args:
            longitudinal: Slip (4, R) [m/s] of the patch's middle along the wheel.
            lateral: The same across it.
            yaw_rate: Of the wheel's frame (4, R) [rad/s].
            roll: Rolling speed (4, R) [m/s].
            duration: Time [s].
        """
        slip = self._slip(longitudinal, lateral, yaw_rate)
        loss = self._yielding(slip, roll)
        passed = loss * duration
        # (1 − exp(−x))/x, which is 1 − x/2 for a wheel that hardly slips
        gained = np.where(passed > 1e-6, -np.expm1(-passed) / np.maximum(passed, 1e-12), 1.0 - 0.5 * passed)
        self.bristles = self.bristles * np.exp(-passed) + slip * gained * duration
        self.twist = dahl(self.twist, yaw_rate * duration, np.asarray(1.0 / SCRUB_ANGLE))

    def forces(
        self, load: Array, longitudinal: Array, lateral: Array, yaw_rate: Array, roll: Array
    ) -> tuple[Array, Array, Array]:
        """Longitudinal and lateral force [N] and torque about the vertical [N m] on the wheels, each (4, R).

        Args:
            load: Wheel loads (4, R) [N].
            longitudinal: Slip (4, R) [m/s] of the patch's middle along the wheel.
            lateral: The same across it.
            yaw_rate: Of the wheel's frame (4, R) [rad/s].
            roll: Rolling speed (4, R) [m/s].
        """
        slip = self._slip(longitudinal, lateral, yaw_rate)
        stretching = slip - self._yielding(slip, roll) * self.bristles
        push = self.stiffness * self.bristles + self.damping * stretching + self.viscous * slip
        push *= -load * self.share
        torque = -self.scrub * self.twist * load / NOMINAL_LOAD
        if self.patch:
            torque = torque + (push[1] * self.along - push[0] * self.across).sum(axis=0)
        lateral_force = push[1].sum(axis=0) - self.rut * load * np.tanh(lateral / RUT_SPEED)
        return push[0].sum(axis=0), lateral_force, torque

    def rolling_moment(self, load: Array, radius: Array, spin: Array) -> Array:
        """Moment [N m] of rolling resistance on the wheels' spin (4, R)."""
        return -self.rolling * load * radius * np.tanh(spin / ROLLING_SPEED)
