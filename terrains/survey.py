"""Device code that looks down on a terrain's triangles: the effective road plane at nodes, and ceilings of cells."""

# Device code: its types are Warp's, not Python's.
# pyright: reportGeneralTypeIssues=false, reportInvalidTypeForm=false, reportIndexIssue=false, reportOperatorIssue=false
# pyright: reportArgumentType=false, reportAttributeAccessIssue=false, reportCallIssue=false
# ruff: noqa: UP018
import warp as wp

PATCH = 0.2
"""Half the chord [m] that bridges the ground under a contact, both ways: 0.4 of a loaded tire's contact length."""
REACH = 0.5
"""What is less than this [m] above a wheel's hub or a frame's corner can be its ground; what is higher hangs over it."""
HEADROOM = 1.5
"""A gap [m] above a surface that wheels can drive in: what is above it hangs over, what is less far up is an obstacle."""
MOST_SURFACES = wp.constant(32)  # above one another that a node looks through
STEP = wp.constant(2.0e-3)  # [m] from one surface on to the next: float32 resolves 0.5 mm at 5 km


@wp.struct
class Surface:
    """A place on a triangle."""

    found: bool
    height: float  # [m]
    face: int
    u: float  # [-] weights of the triangle's first and second vertex
    v: float


@wp.func
def drivable(mesh: wp.uint64, x: float, y: float, bottom: float, top: float):
    """The lowest surface with headroom over the plan position (x, y)."""
    out = Surface()
    z = bottom - 1.0
    for _ in range(MOST_SURFACES):
        hit = wp.mesh_query_ray(mesh, wp.vec3(x, y, z), wp.vec3(0.0, 0.0, 1.0), top + 1.0 - z)
        if not hit.result:
            break
        height = z + hit.t
        if out.found and height - out.height >= HEADROOM:
            break
        out.found = True
        out.height = height
        out.face = hit.face
        out.u = hit.u
        out.v = hit.v
        z = height + STEP
    return out


@wp.func
def value_at(values: wp.array(dtype=float), faces: wp.array(dtype=int), s: Surface):
    """Value at a surface: one for all, or interpolated between the triangle's vertices."""
    if values.shape[0] == 1:
        return values[0]
    first = values[faces[3 * s.face]]
    second = values[faces[3 * s.face + 1]]
    third = values[faces[3 * s.face + 2]]
    return s.u * first + s.v * second + (1.0 - s.u - s.v) * third


@wp.kernel(enable_backward=False)
def survey(
    mesh: wp.uint64,
    faces: wp.array(dtype=int),
    friction: wp.array(dtype=float),
    rolling_resistance: wp.array(dtype=float),
    corner: wp.vec2,
    cell: float,
    columns: int,
    bottom: float,
    top: float,
    nodes: wp.array(dtype=wp.vec4),
    cover: wp.array(dtype=wp.vec2),
):
    """Effective road plane at every node: height, slopes, share known; and the multipliers there."""
    i = wp.tid()
    x = corner[0] + cell * float(i % columns)
    y = corner[1] + cell * float(i / columns)
    known = float(0.0)
    height = float(0.0)
    slopes = wp.vec2()
    multipliers = wp.vec2()
    for axis in range(2):
        step = wp.vec2(PATCH, 0.0)
        if axis == 1:
            step = wp.vec2(0.0, PATCH)
        ahead = drivable(mesh, x + step[0], y + step[1], bottom, top)
        behind = drivable(mesh, x - step[0], y - step[1], bottom, top)
        if ahead.found:
            known += 1.0
            height += ahead.height
            multipliers += wp.vec2(value_at(friction, faces, ahead), value_at(rolling_resistance, faces, ahead))
        if behind.found:
            known += 1.0
            height += behind.height
            multipliers += wp.vec2(value_at(friction, faces, behind), value_at(rolling_resistance, faces, behind))
        if ahead.found and behind.found:
            slopes[axis] = (ahead.height - behind.height) / (2.0 * PATCH)
    share = 1.0 / wp.max(known, 1.0)
    nodes[i] = wp.vec4(share * height, slopes[0], slopes[1], 0.25 * known)
    cover[i] = share * multipliers


@wp.kernel(enable_backward=False)
def bound(
    points: wp.array(dtype=wp.vec3),
    faces: wp.array(dtype=int),
    corner: wp.vec2,
    cell: float,
    columns: int,
    rows: int,
    ceilings: wp.array(dtype=float),
):
    """Raise the ceilings of all cells from which a patch can reach a triangle over the triangle's plane there."""
    f = wp.tid()
    a = points[faces[3 * f]]
    b = points[faces[3 * f + 1]]
    c = points[faces[3 * f + 2]]
    low = wp.min(a, wp.min(b, c)) - wp.vec3(PATCH, PATCH, 0.0)
    high = wp.max(a, wp.max(b, c)) + wp.vec3(PATCH, PATCH, 0.0)
    normal = wp.cross(b - a, c - a)
    flat = wp.abs(normal[2]) > 1.0e-3 * wp.length(normal)
    half = 0.5 * cell + PATCH
    for row in range(
        wp.max(int(wp.floor((low[1] - corner[1]) / cell)), 0), wp.min(int((high[1] - corner[1]) / cell), rows - 1) + 1
    ):
        for column in range(
            wp.max(int(wp.floor((low[0] - corner[0]) / cell)), 0),
            wp.min(int((high[0] - corner[0]) / cell), columns - 1) + 1,
        ):
            top = high[2]
            if flat:
                x = corner[0] + cell * (float(column) + 0.5) - a[0]
                y = corner[1] + cell * (float(row) + 0.5) - a[1]
                middle = a[2] - (normal[0] * x + normal[1] * y) / normal[2]
                top = wp.min(top, middle + half * (wp.abs(normal[0]) + wp.abs(normal[1])) / wp.abs(normal[2]))
            wp.atomic_max(ceilings, row * columns + column, top)
