"""Double-acting cylinders on a hinged linkage: length, lever arm, chamber volumes.

A cylinder pinned at distances a and b from a hinge, with the angle γ between both radii, has the length
L = √(a² + b² − 2ab cos γ) and the lever dL/dγ = ab sin γ / L (law of cosines).
"""

# pyright: reportGeneralTypeIssues=false, reportInvalidTypeForm=false
import warp as wp


@wp.struct
class Linkage:
    """Geometry of one cylinder on its hinge (derived from stroke, closed length, mount ratio and range)."""

    a: float  # [m] hinge to first pin
    b: float  # [m] hinge to second pin
    g0: float  # [rad] angle between the radii at mid-range
    dead_length: float  # [m] pin to pin, fully retracted
    stroke: float  # [m]


@wp.func
def cylinder_extension(linkage: Linkage, angle: float):
    """Extension [m] (0 = closed, stroke = open) and lever dL/dγ [m] at ``angle`` = γ − γ₀ [rad]."""
    gamma = linkage.g0 + angle
    ab = linkage.a * linkage.b
    length = wp.sqrt(linkage.a * linkage.a + linkage.b * linkage.b - 2.0 * ab * wp.cos(gamma))
    return length - linkage.dead_length, ab * wp.sin(gamma) / length
