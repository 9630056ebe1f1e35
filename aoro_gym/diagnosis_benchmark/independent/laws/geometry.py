"""The two steering cylinders: lengths and volumes over the joint angle.

Mounts at (−a, ±w) from the hinge on the rear frame and (c, ±w) on the front one. Length of the right cylinder:
L² = a² + c² + 2 w² − 2 (w² − a c) cos φ + 2 w (a + c) sin φ; of the left one: at −φ.
Port A feeds the right bore and the left annulus, port B the other two; a full turn takes in
(A_bore + A_annulus) × stroke.
"""

from typing import Any

import warp as wp

from .numbers import HALF, f64

vec2d = wp.types.vector(length=2, dtype=wp.float64)
vec3d = wp.types.vector(length=3, dtype=wp.float64)
vec4d = wp.types.vector(length=4, dtype=wp.float64)
vec6d = wp.types.vector(length=6, dtype=wp.float64)


@wp.func
def cylinder(phi: wp.float64, squares: wp.float64, across: wp.float64, along: wp.float64):
    """Length [m] of the right cylinder and its rate [m/rad]; across = w² − a c, along = w (a + c)."""
    s = wp.sin(phi)
    c = wp.cos(phi)
    length = wp.sqrt(squares - f64(2.0) * (across * c - along * s))
    return vec2d(length, (across * s + along * c) / length)


@wp.func
def chambers(phi: wp.float64, m: Any):
    """Volumes of sides A and B in the cylinders [m³], their rates, and both lengths' rates (right, left).

    Rates are over φ [m³/rad, m/rad]. A cylinder that is not attached (``attached`` 0) stands still at half its stroke.
    """
    right = cylinder(phi, m.mount_squares, m.mount_across, m.mount_along)
    left = cylinder(-phi, m.mount_squares, m.mount_across, m.mount_along)
    rate_right = m.attached_right * right[1]
    rate_left = -m.attached_left * left[1]
    middle = m.length_low + HALF * m.stroke
    out_right = middle - m.length_low + m.attached_right * (right[0] - middle)
    out_left = middle - m.length_low + m.attached_left * (left[0] - middle)
    volume_a = m.bore_area * out_right + m.annulus_area * (m.stroke - out_left) + m.dead_volume
    volume_b = m.bore_area * out_left + m.annulus_area * (m.stroke - out_right) + m.dead_volume
    lever_a = m.bore_area * rate_right - m.annulus_area * rate_left
    lever_b = m.bore_area * rate_left - m.annulus_area * rate_right
    return vec6d(volume_a, volume_b, lever_a, lever_b, rate_right, rate_left)
