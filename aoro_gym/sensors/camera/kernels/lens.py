"""From pixels to directions and back: a pinhole with the lens distortion of Brown (1966) and Conrady (1919).

Axes of a camera are OpenCV's: x right, y down, z ahead; the middle of the first pixel is at (0, 0). With x = X/Z, y = Y/Z
and r² = x² + y² the lens draws the point at

    x' = x (1 + k1 r² + k2 r⁴ + k3 r⁶) + 2 p1 x y + p2 (r² + 2 x²)
    y' = y (1 + k1 r² + k2 r⁴ + k3 r⁶) + p1 (r² + 2 y²) + 2 p2 x y

and the pixel is u = fx x' + cx, v = fy y' + cy.
"""

import warp as wp

ITERATIONS = wp.constant(8)  # of Newton's method: it squares the error each time, from at most 0.5


@wp.struct
class Lens:
    """Intrinsics of a camera."""

    width: int
    height: int
    focal: wp.vec2  # fx, fy [pixels]
    centre: wp.vec2  # cx, cy [pixels]
    radial: wp.vec3  # k1, k2, k3 [-]
    tangential: wp.vec2  # p1, p2 [-]


@wp.func
def distorted(lens: Lens, point: wp.vec2):
    """Where the lens draws a point of the plane at distance 1."""
    x = point[0]
    y = point[1]
    s = x * x + y * y
    scale = 1.0 + s * (lens.radial[0] + s * (lens.radial[1] + s * lens.radial[2]))
    p1 = lens.tangential[0]
    p2 = lens.tangential[1]
    return wp.vec2(
        x * scale + 2.0 * p1 * x * y + p2 * (s + 2.0 * x * x), y * scale + p1 * (s + 2.0 * y * y) + 2.0 * p2 * x * y
    )


@wp.func
def undistorted(lens: Lens, drawn: wp.vec2):
    """The point of the plane at distance 1 that the lens draws there, by Newton's method."""
    point = drawn
    p1 = lens.tangential[0]
    p2 = lens.tangential[1]
    for _ in range(ITERATIONS):
        x = point[0]
        y = point[1]
        s = x * x + y * y
        scale = 1.0 + s * (lens.radial[0] + s * (lens.radial[1] + s * lens.radial[2]))
        slope = lens.radial[0] + s * (2.0 * lens.radial[1] + 3.0 * s * lens.radial[2])
        xx = scale + 2.0 * x * x * slope + 2.0 * p1 * y + 6.0 * p2 * x
        xy = 2.0 * x * y * slope + 2.0 * p1 * x + 2.0 * p2 * y
        yy = scale + 2.0 * y * y * slope + 6.0 * p1 * y + 2.0 * p2 * x
        off = distorted(lens, point) - drawn
        det = xx * yy - xy * xy
        point = point - wp.vec2(yy * off[0] - xy * off[1], xx * off[1] - xy * off[0]) / det
    return point


@wp.func
def direction_of(lens: Lens, u: float, v: float):
    """Unit direction, in the camera's axes, of what is drawn at a pixel."""
    drawn = wp.vec2((u - lens.centre[0]) / lens.focal[0], (v - lens.centre[1]) / lens.focal[1])
    point = undistorted(lens, drawn)
    return wp.normalize(wp.vec3(point[0], point[1], 1.0))


@wp.func
def pixel_of(lens: Lens, point: wp.vec3):
    """Pixel at which a point ahead of the camera, in its axes, is drawn."""
    drawn = distorted(lens, wp.vec2(point[0] / point[2], point[1] / point[2]))
    return wp.vec2(lens.focal[0] * drawn[0] + lens.centre[0], lens.focal[1] * drawn[1] + lens.centre[1])
