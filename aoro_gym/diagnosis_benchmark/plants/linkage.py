"""Cylinders pinned across a hinge: lengths, levers and what the two steering cylinders displace.

The pins stand at radii a and k a from the hinge, γ between them: L² = a² (1 + k² − 2 k cos γ).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from aoro_gym.diagnosis_benchmark.plants.fluid import Array, Constants


class Linkage:
    """Mounting with which a cylinder of ``closed`` [m] and ``stroke`` [m] is closed at −``reach`` and open at +``reach``.

    The squares of both lengths over a² give one equation A cos γ₀ + B sin γ₀ = C for the angle at mid-range; of its two
    roots the one with the longer shortest lever is built.
    """

    def __init__(self, closed: Array, stroke: Array, ratio: Array, reach: Array):
        square = ((closed + stroke) / closed) ** 2
        cosine, sine = (square - 1.0) * np.cos(reach), (square + 1.0) * np.sin(reach)
        middle = np.arctan2(sine, cosine)
        apart = np.arccos((1.0 + ratio**2) * (square - 1.0) / (2.0 * ratio * np.hypot(cosine, sine)))
        low, high = (self._radius(middle + sign * apart, closed, ratio, reach) for sign in (-1.0, 1.0))
        better = high[1] > low[1]
        self.middle = np.where(better, middle + apart, middle - apart)
        self.first = np.where(better, high[0], low[0])
        self.second = ratio * self.first
        self.closed, self.stroke = closed, stroke

    @staticmethod
    def _radius(middle: Array, closed: Array, ratio: Array, reach: Array) -> tuple[Array, Array]:
        """Radius of the first pin [m], and the shorter of the levers at the ends of the range [m], negative past a
        dead centre."""
        first = closed / np.sqrt(1.0 + ratio**2 - 2.0 * ratio * np.cos(middle - reach))
        open_ = first * np.sqrt(1.0 + ratio**2 - 2.0 * ratio * np.cos(middle + reach))
        ends = np.sin(middle - reach) / closed, np.sin(middle + reach) / open_
        return first, ratio * first**2 * np.minimum(*ends)

    def length(self, angle: Array) -> Array:
        """Pin to pin [m] at ``angle`` [rad] from mid-range."""
        a, b = self.first, self.second
        return np.sqrt(a**2 + b**2 - 2.0 * a * b * np.cos(self.middle + angle))

    def levers(self, angle: Array) -> tuple[Array, Array, Array]:
        """Length [m], its first and its second derivative by the angle [m/rad, m/rad²]."""
        product, length = self.first * self.second, self.length(angle)
        lever = product * np.sin(self.middle + angle) / length
        return length, lever, (product * np.cos(self.middle + angle) - lever**2) / length


@dataclass(frozen=True)
class Displacement:
    """The joint's cylinders at one angle; everything (R,)."""

    right: Array  # lever of the right cylinder, dL/dθ [m]
    left: Array  # lever of the left one, negative
    volume_a: Array  # [m³] of the chambers on port A, without hoses and dead volumes
    volume_b: Array
    slope_a: Array  # dV/dθ [m³/rad]
    slope_b: Array
    curve_a: Array  # d²V/dθ² [m³/rad²]
    curve_b: Array


class SteeringCylinders:
    """Two cross-connected cylinders: port A feeds the right one's bore and the left one's annulus, port B the others."""

    def __init__(self, constants: Constants):
        part = "steering.cylinder."
        self.bore = 0.25 * np.pi * constants[part + "bore"] ** 2
        self.annulus = self.bore - 0.25 * np.pi * constants[part + "rod"] ** 2
        self.reach = constants["joint.range"]
        self.linkage = Linkage(
            constants[part + "dead_length"], constants[part + "stroke"], constants[part + "mount_ratio"], self.reach
        )
        self.mean_lever = constants[part + "stroke"] / (2.0 * self.reach)

    def at(self, angle: Array) -> Displacement:
        """Levers, volumes and their derivatives at the joint angle [rad]."""
        link = self.linkage
        right, right_lever, right_curve = link.levers(angle)
        left, left_lever, left_curve = link.levers(-angle)
        left_lever = -left_lever
        out_right, out_left = right - link.closed, left - link.closed
        return Displacement(
            right=right_lever,
            left=left_lever,
            volume_a=self.bore * out_right + self.annulus * (link.stroke - out_left),
            volume_b=self.bore * out_left + self.annulus * (link.stroke - out_right),
            slope_a=self.bore * right_lever - self.annulus * left_lever,
            slope_b=self.bore * left_lever - self.annulus * right_lever,
            curve_a=self.bore * right_curve - self.annulus * left_curve,
            curve_b=self.bore * left_curve - self.annulus * right_curve,
        )
