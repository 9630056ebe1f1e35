"""A cylinder pinned on both sides of a hinge: the geometry that makes its stroke span the joint's range.

The pins stand at the radii a and b from the hinge, the angle between the radii is γ. Law of cosines:
L(γ) = √(a² + b² − 2ab cos γ), lever dL/dγ = ab sin γ / L. Angles are counted from mid-range, γ = γ₀ + angle.
"""

from dataclasses import dataclass

import numpy as np

from aoro_gym.machine.quantities import Quantity, as_quantity


@dataclass(frozen=True, eq=False)
class Linkage:
    """Cylinder on its hinge; every attribute is a float or an array of shape (N,)."""

    a: Quantity  # [m] hinge to the first pin
    b: Quantity  # [m] hinge to the second pin
    g0: Quantity  # [rad] angle between the radii at mid-range
    dead_length: Quantity  # [m] pin to pin, fully retracted
    stroke: Quantity  # [m]
    half_range: Quantity  # [rad]

    @property
    def mean_lever(self) -> Quantity:
        """Stroke over the whole range [m]."""
        return self.stroke / (2.0 * self.half_range)

    def length(self, angle: Quantity) -> Quantity:
        """Pin-to-pin length [m] at ``angle`` [rad] from mid-range."""
        return np.sqrt(self.a**2 + self.b**2 - 2.0 * self.a * self.b * np.cos(self.g0 + angle))

    def extension(self, angle: Quantity) -> Quantity:
        """Extension [m] at ``angle`` [rad]: 0 closed, ``stroke`` open."""
        return self.length(angle) - self.dead_length

    def lever(self, angle: Quantity) -> Quantity:
        """dL/dγ [m] at ``angle`` [rad]."""
        return self.a * self.b * np.sin(self.g0 + angle) / self.length(angle)


def close_linkage(dead_length: Quantity, stroke: Quantity, mount_ratio: Quantity, half_range: Quantity) -> Linkage:
    """Linkage that is closed (``dead_length`` [m]) at −``half_range`` [rad], open by ``stroke`` [m] at +``half_range``.

    With k = b/a = ``mount_ratio`` and ρ = ((L₀+S)/L₀)², both end conditions give
    (1+k²)(ρ−1) = 2k [(ρ−1) cos m cos γ₀ + (ρ+1) sin m sin γ₀], which has two solutions γ₀ or none. Of those that pass
    no dead centre (m < γ₀ < π − m) the one with the longer shortest lever is taken.

    Where there is none, a, b and γ₀ are NaN.
    """
    l0, s, k, m = np.broadcast_arrays(dead_length, stroke, mount_ratio, half_range)
    rho = ((l0 + s) / l0) ** 2
    cos_part = (rho - 1.0) * np.cos(m)
    sin_part = (rho + 1.0) * np.sin(m)
    ratio = (1.0 + k**2) * (rho - 1.0) / (2.0 * k * np.hypot(cos_part, sin_part))
    middle = np.arctan2(sin_part, cos_part)
    spread = np.arccos(np.clip(ratio, -1.0, 1.0))

    best = np.full(l0.shape, -np.inf)
    g0 = np.full(l0.shape, np.nan)
    a = np.full(l0.shape, np.nan)
    for root in (middle - spread, middle + spread):
        first = l0 / np.sqrt(1.0 + k**2 - 2.0 * k * np.cos(root - m))
        # the lever has a single maximum between the dead centres, so its minimum lies at an end of the range
        shortest = k * first**2 * np.minimum(np.sin(root - m) / l0, np.sin(root + m) / (l0 + s))
        better = (np.abs(ratio) <= 1.0) & (root > m) & (root < np.pi - m) & (shortest > best)
        best = np.where(better, shortest, best)
        g0 = np.where(better, root, g0)
        a = np.where(better, first, a)

    return Linkage(as_quantity(a), as_quantity(k * a), as_quantity(g0), dead_length, stroke, half_range)
