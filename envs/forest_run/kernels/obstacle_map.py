"""What past sweeps have shown around machines, kept in grids of cells on the ground, and looked at from where machines are.

A cell is that of all places whose columns and rows differ by the grid's size: of the two places that a machine can come near
to within an episode, one at most is in reach.
"""

import warp as wp

FAR = wp.constant(1.0e9)  # [m]: never


@wp.struct
class Grids:
    """Of N sub-environments, S x S cells each."""

    step: wp.array(dtype=wp.int64)  # (N,) control steps since the episode began
    stood: wp.array3d(dtype=wp.uint8)  # (N, S, S) whether something stood there in any sweep
    cell: float  # [m]


@wp.struct
class Poses:
    """As measured, of N sub-environments."""

    x: wp.array(dtype=float)  # (N,) [m] of the front axle's middle
    y: wp.array(dtype=float)
    heading: wp.array(dtype=float)  # [rad]


@wp.struct
class Sight:
    """How the grids are looked at."""

    reach: float  # [m]
    directions: int  # sectors, from behind by the left to the front and on by the right
    curvatures: wp.array(dtype=float)  # (A,) [1/m] of arcs
    widths: wp.array(dtype=float)  # (B,) [m] half widths of what is driven along them


@wp.func
def node(place: float, cell: float):
    """Number of the cell of a coordinate [m]."""
    return int(wp.floor(place / cell + 0.5))


@wp.func
def wrapped(number: int, size: int):
    """Column or row of a grid."""
    return ((number % size) + size) % size


@wp.func
def free_way(curvature: float, width: float, x: float, y: float):
    """Way [m] along an arc that begins at the origin along x until a place (x, y) [m] is ``width`` away; FAR for never.

    The arc's middle is (0, 1/curvature). In the triangle of the middle, the place and the sought point two sides and the
    third, ``width``, are known: the law of cosines. Beside or behind from the beginning does not count.
    """
    if x * x + y * y <= width * width:
        return wp.where(x > 0.0, 0.0, FAR)
    if wp.abs(curvature) < 1.0e-6:
        if x > 0.0 and wp.abs(y) < width:
            return x - wp.sqrt(width * width - y * y)
        return FAR
    radius = 1.0 / wp.abs(curvature)
    left = y * wp.sign(curvature)
    away = wp.sqrt(x * x + (left - radius) * (left - radius))
    if wp.abs(away - radius) >= width or x <= 0.0:
        return FAR
    share = (radius * radius + away * away - width * width) / (2.0 * radius * away)
    return radius * wp.max(wp.atan2(x, radius - left) - wp.acos(wp.clamp(share, -1.0, 1.0)), 0.0)


@wp.kernel(enable_backward=False, module="aoro_gym.envs.forest_run.kernels.obstacle_map")
def forget(g: Grids):
    """Empty the grids of episodes that begin, a row a thread."""
    i, row = wp.tid()
    if g.step[i] == wp.int64(0):
        for column in range(g.stood.shape[2]):
            g.stood[i, row, column] = wp.uint8(0)


@wp.kernel(enable_backward=False, module="aoro_gym.envs.forest_run.kernels.obstacle_map")
def remember_sweep(
    g: Grids, p: Poses, ahead: float, mapped: float,
    standing: wp.array2d(dtype=float),  # (N, K) [m] in plan from the lidar to what stands in a sector
    azimuths: wp.array(dtype=float),  # (K,) [rad] of the sectors
):  # fmt: skip
    """Put what stands in a sector into the grid; asked twice, it changes nothing."""
    i, k = wp.tid()
    away = standing[i, k]
    if away < mapped:
        c = wp.cos(p.heading[i])
        s = wp.sin(p.heading[i])
        forward = ahead + away * wp.cos(azimuths[k])
        left = away * wp.sin(azimuths[k])
        size = g.stood.shape[1]
        row = wrapped(node(p.y[i] + s * forward + c * left, g.cell), size)
        column = wrapped(node(p.x[i] + c * forward - s * left, g.cell), size)
        g.stood[i, row, column] = wp.uint8(1)


@wp.func
def show(view: Sight, i: int, x: float, y: float, cell: float, shown: wp.array2d(dtype=float)):
    """Lower what is shown to what a cell at x, y [m] in the machine's axes leaves."""
    away = wp.sqrt(x * x + y * y)
    half = wp.asin(wp.min(0.5 * cell / wp.max(away, cell), 1.0))
    sector = 2.0 * wp.pi / float(view.directions)
    behind = wp.atan2(y, x) + wp.pi
    first = int(wp.floor((behind - half) / sector))
    last = int(wp.floor((behind + half) / sector))
    for k in range(first, last + 1):
        # from behind by the left: azimuths fall
        wp.atomic_min(shown, i, wrapped(view.directions - 1 - k, view.directions), away)
    arcs = view.curvatures.shape[0]
    for b in range(view.widths.shape[0]):
        for a in range(arcs):
            way = free_way(view.curvatures[a], view.widths[b], x, y)
            if way < view.reach:
                wp.atomic_min(shown, i, view.directions + b * arcs + a, way)


@wp.kernel(enable_backward=False, module="aoro_gym.envs.forest_run.kernels.obstacle_map")
def look_at_grids(g: Grids, p: Poses, view: Sight, shown: wp.array2d(dtype=float)):
    """Lower what is shown (N, D + B A), which begins at the reach, a row of cells around a machine a thread."""
    i, offset = wp.tid()
    size = g.stood.shape[1]
    around = int(wp.ceil(view.reach / g.cell))
    row = node(p.y[i], g.cell) + offset - around
    middle = node(p.x[i], g.cell)
    dy = float(row) * g.cell - p.y[i]
    c = wp.cos(p.heading[i])
    s = wp.sin(p.heading[i])
    for step in range(2 * around + 1):
        column = middle + step - around
        dx = float(column) * g.cell - p.x[i]
        stood = g.stood[i, wrapped(row, size), wrapped(column, size)] > wp.uint8(0)
        if stood and dx * dx + dy * dy < view.reach * view.reach:
            show(view, i, c * dx + s * dy, c * dy - s * dx, g.cell, shown)
