"""Smooth light of the sky: few rays sample it, so a pixel shares it with neighbours at its depth that face its way.

What is smoothed is the light that falls in, not what a surface sends back, so textures and edges stay sharp: an à-trous
filter with the cubic B-spline's weights (Dammertz, Sewtz, Hanika, Lensch 2010, Edge-avoiding À-Trous wavelet transform for
fast global illumination filtering, High Performance Graphics).
"""

import warp as wp

DEPTH = wp.constant(0.02)  # difference over the depth and the step [pixels] at which a neighbour counts 1/e; (E)
FACING = wp.constant(8.0)  # power of the cosine between normals; (E)


@wp.func
def spline(offset: int):
    """Weight of the cubic B-spline at -2 to 2."""
    if offset == 0:
        return 0.375
    if wp.abs(offset) == 1:
        return 0.25
    return 0.0625


@wp.kernel(enable_backward=False)
def smooth(
    light: wp.array3d(dtype=wp.vec3),
    guide: wp.array3d(dtype=wp.vec4),  # normal, and depth [m]
    step: int,
    out: wp.array3d(dtype=wp.vec3),
):
    """One pass over neighbours ``step`` pixels apart."""
    world, row, column = wp.tid()
    own = guide[world, row, column]
    total = wp.vec3()
    weights = float(0.0)
    for dy in range(-2, 3):
        y = row + dy * step
        if y >= 0 and y < light.shape[1]:
            for dx in range(-2, 3):
                x = column + dx * step
                if x >= 0 and x < light.shape[2]:
                    other = guide[world, y, x]
                    cosine = own[0] * other[0] + own[1] * other[1] + own[2] * other[2]
                    apart = wp.abs(own[3] - other[3]) / (DEPTH * float(step) * wp.max(own[3], 0.1))
                    weight = spline(dx) * spline(dy) * wp.exp(-apart) * wp.pow(wp.max(cosine, 0.0), FACING)
                    if dx == 0 and dy == 0:
                        weight = spline(0) * spline(0)
                    total += weight * light[world, y, x]
                    weights += weight
    out[world, row, column] = total / weights


@wp.kernel(enable_backward=False)
def add(
    direct: wp.array3d(dtype=wp.vec3),
    reflected: wp.array3d(dtype=wp.vec3),
    light: wp.array3d(dtype=wp.vec3),
    radiance: wp.array3d(dtype=wp.vec3),
):
    """Radiance [W/(m² sr)]: what needs no smoothing, and light times what sends it back."""
    world, row, column = wp.tid()
    light_here = light[world, row, column]
    radiance[world, row, column] = direct[world, row, column] + wp.cw_mul(reflected[world, row, column], light_here)
