"""Cylinders pinned across a hinge: lengths, levers and what the two steering cylinders displace.

The pins stand at radii a and k a from the hinge, γ between them: L² = a² (1 + k² − 2 k cos γ).
"""

# pyright: reportGeneralTypeIssues=false, reportInvalidTypeForm=false
import numpy as np
import warp as wp

from aoro_gym.diagnosis_benchmark.plants.records import Array, Constants, f64, record

Linkage = record("Linkage", "closed stroke middle first second")
"""Closed length [m] and stroke, γ [rad] at mid-range, radii [m] of the pins."""

Cylinders = record("Cylinders", "bore annulus reach mean_lever", link=Linkage)
"""Areas [m²], end of the joint's range [rad], mean lever [m] of the two cross-connected steering cylinders: port A feeds the
right one's bore and the left one's annulus, port B the others."""

Displacement = record("Displacement", "right left volume_a volume_b slope_a slope_b curve_a curve_b")
"""The joint's cylinders at one angle: levers dL/dθ [m] (the left one's is negative), volumes [m³] of the chambers on either
port without hoses and dead volumes, their first and their second derivative by the angle."""


def linkage_of(closed: Array, stroke: Array, ratio: Array, reach: Array) -> dict[str, Array]:
    """Mounting with which a cylinder of ``closed`` [m] and ``stroke`` [m] is closed at −``reach`` and open at +``reach``.

    The squares of both lengths over a² give one equation A cos γ₀ + B sin γ₀ = C for the angle at mid-range; of its two
    roots the one with the longer shortest lever is built.
    """
    square = ((closed + stroke) / closed) ** 2
    cosine, sine = (square - 1.0) * np.cos(reach), (square + 1.0) * np.sin(reach)
    middle = np.arctan2(sine, cosine)
    apart = np.arccos((1.0 + ratio**2) * (square - 1.0) / (2.0 * ratio * np.hypot(cosine, sine)))
    low, high = (_radius(middle + sign * apart, closed, ratio, reach) for sign in (-1.0, 1.0))
    better = high[1] > low[1]
    first = np.where(better, high[0], low[0])
    middle = np.where(better, middle + apart, middle - apart)
    return {"closed": closed, "stroke": stroke, "middle": middle, "first": first, "second": ratio * first}


def _radius(middle: Array, closed: Array, ratio: Array, reach: Array) -> tuple[Array, Array]:
    """Radius of the first pin [m], and the shorter of the levers at the ends of the range [m], negative past a dead
    centre."""
    first = closed / np.sqrt(1.0 + ratio**2 - 2.0 * ratio * np.cos(middle - reach))
    open_ = first * np.sqrt(1.0 + ratio**2 - 2.0 * ratio * np.cos(middle + reach))
    ends = np.sin(middle - reach) / closed, np.sin(middle + reach) / open_
    return first, ratio * first**2 * np.minimum(*ends)


def cylinders_of(p: Constants) -> dict[str, object]:
    """Fields of :data:`Cylinders` (R,)."""
    part = "steering.cylinder."
    bore, reach, stroke = 0.25 * np.pi * p[part + "bore"] ** 2, p["joint.range"], p[part + "stroke"]
    return {
        "bore": bore, "annulus": bore - 0.25 * np.pi * p[part + "rod"] ** 2, "reach": reach,
        "mean_lever": stroke / (2.0 * reach),
        "link": linkage_of(p[part + "dead_length"], stroke, p[part + "mount_ratio"], reach),
    }  # fmt: skip


@wp.func
def levers(link: Linkage, angle: f64):
    """Length [m] pin to pin at ``angle`` [rad] from mid-range, its first and its second derivative by the angle."""
    product = link.first * link.second
    cosine = wp.cos(link.middle + angle)
    length = wp.sqrt(link.first * link.first + link.second * link.second - f64(2.0) * product * cosine)
    lever = product * wp.sin(link.middle + angle) / length
    return length, lever, (product * cosine - lever * lever) / length


@wp.func
def displacement(c: Cylinders, angle: f64):
    """Levers, volumes and their derivatives at the joint angle [rad]."""
    right, right_lever, right_curve = levers(c.link, angle)
    left, left_lever, left_curve = levers(c.link, -angle)
    out_right, out_left = right - c.link.closed, left - c.link.closed
    at = Displacement()
    at.right = right_lever
    at.left = -left_lever
    at.volume_a = c.bore * out_right + c.annulus * (c.link.stroke - out_left)
    at.volume_b = c.bore * out_left + c.annulus * (c.link.stroke - out_right)
    at.slope_a = c.bore * right_lever + c.annulus * left_lever
    at.slope_b = -c.bore * left_lever - c.annulus * right_lever
    at.curve_a = c.bore * right_curve - c.annulus * left_curve
    at.curve_b = c.bore * left_curve - c.annulus * right_curve
    return at
