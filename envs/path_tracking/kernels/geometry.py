"""Places on paths and heights of grounds: the table of paths and the height map for one vehicle."""

import warp as wp

from aoro_gym.envs.path_tracking.kernels.memory import Courses

ZERO = wp.constant(wp.float64(0.0))
ONE = wp.constant(wp.float64(1.0))


@wp.struct
class Projection:
    """Where a point is on its path."""

    s: wp.float64  # [m]
    offset: wp.float64  # [m] positive left


@wp.struct
class Place:
    """What stands at an arc length of a path."""

    x: wp.float64  # [m]
    y: wp.float64  # [m]
    cosine: wp.float64
    sine: wp.float64
    curvature: wp.float64  # [1/m]


@wp.func
def project(c: Courses, path: wp.int64, x: wp.float64, y: wp.float64, near: wp.float64, half: wp.int64):
    """Arc length and offset of a point, looked for ``half`` points around the arc length ``near``."""
    middle = wp.int64(wp.rint(near / c.spacing)) + c.beyond
    last = wp.max(c.count - wp.int64(1) - wp.int64(2) * half, wp.int64(0))
    first = wp.clamp(middle - half, wp.int64(0), last)
    points = wp.min(wp.int64(2) * half + wp.int64(1), c.count)
    start = int(path * c.count + first)
    best = int(0)
    least = wp.float64(0.0)
    along = wp.float64(0.0)
    right = bool(False)
    px = c.points[0, start]
    py = c.points[1, start]
    for k in range(int(points) - 1):
        qx = c.points[0, start + k + 1]
        qy = c.points[1, start + k + 1]
        side_x = qx - px
        side_y = qy - py
        apart_x = x - px
        apart_y = y - py
        length = wp.max(side_x * side_x + side_y * side_y, wp.float64(1e-12))
        share = wp.clamp((apart_x * side_x + apart_y * side_y) / length, ZERO, ONE)
        gap_x = apart_x - share * side_x
        gap_y = apart_y - share * side_y
        gap = gap_x * gap_x + gap_y * gap_y
        if k == 0 or gap < least:
            best = k
            least = gap
            along = share
            right = side_x * gap_y - side_y * gap_x < ZERO
        px = qx
        py = qy
    out = Projection()
    out.s = (wp.float64(first + wp.int64(best) - c.beyond) + along) * c.spacing
    distance = wp.sqrt(least)
    out.offset = wp.where(right, -distance, distance)
    return out


@wp.func
def place_at(c: Courses, path: wp.int64, s: wp.float64):
    """What stands at the arc length ``s`` [m]."""
    where = wp.clamp(s / c.spacing + wp.float64(c.beyond), ZERO, wp.float64(c.count) - wp.float64(1.001))
    before = wp.int64(where)
    share = where - wp.float64(before)
    k = int(path * c.count + before)
    out = Place()
    out.x = c.points[0, k] + share * (c.points[0, k + 1] - c.points[0, k])
    out.y = c.points[1, k] + share * (c.points[1, k + 1] - c.points[1, k])
    out.cosine = c.points[2, k] + share * (c.points[2, k + 1] - c.points[2, k])
    out.sine = c.points[3, k] + share * (c.points[3, k + 1] - c.points[3, k])
    out.curvature = c.points[4, k] + share * (c.points[4, k + 1] - c.points[4, k])
    return out


@wp.func
def between(c: Courses, nodes: wp.array(dtype=wp.float64), ground: int, x: wp.float64, y: wp.float64):
    """A value of the nodes of a ground, bilinear between them."""
    px = wp.max(wp.min((x - c.extents[ground, 0]) / c.cell, c.extents[ground, 6]), ZERO)
    py = wp.max(wp.min((y - c.extents[ground, 1]) / c.cell, c.extents[ground, 7]), ZERO)
    column = wp.int64(px)
    row = wp.int64(py)
    u = px - wp.float64(column)
    v = py - wp.float64(row)
    columns = c.shapes[ground, 0]
    k = int(c.shapes[ground, 1] + row * columns + column)
    south = (ONE - u) * nodes[k] + u * nodes[k + 1]
    k += int(columns)
    return (ONE - v) * south + v * ((ONE - u) * nodes[k] + u * nodes[k + 1])


@wp.func
def height_at(c: Courses, ground: wp.int64, x: wp.float64, y: wp.float64):
    """Height [m] of the ground."""
    if c.level != 0:
        return c.slope[0] * x + c.slope[1] * y
    return between(c, c.heights, int(ground), x, y)


@wp.func
def known_at(c: Courses, ground: wp.int64, x: wp.float64, y: wp.float64):
    """Whether there is ground."""
    if c.level != 0:
        return wp.isfinite(x)
    g = int(ground)
    inside = x >= c.extents[g, 2] and y >= c.extents[g, 3] and x <= c.extents[g, 4] and y <= c.extents[g, 5]
    if not inside:
        return False
    return between(c, c.known, g, x, y) >= wp.float64(0.5)
