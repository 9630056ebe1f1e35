"""Device code: rays against boxes, cylinders and capsules in their own axes.

Rays are p(t) = origin + t direction with a unit direction, so that t is a distance [m]. Each function gives the distance
to the surface ahead, from outside or from inside, and the outward normal there; below zero where the ray misses.
"""

# Device code: its types are Warp's, not Python's.
# pyright: reportGeneralTypeIssues=false, reportInvalidTypeForm=false, reportIndexIssue=false, reportOperatorIssue=false
# pyright: reportArgumentType=false, reportAttributeAccessIssue=false, reportCallIssue=false
import warp as wp

MISS = wp.constant(-1.0)
FAR = wp.constant(1.0e9)  # [m]
TINY = wp.constant(1.0e-20)  # in place of a zero component of a direction, whose inverse stays finite


@wp.struct
class Surface:
    """Where a ray meets a shape."""

    distance: float  # [m], negative: nowhere
    normal: wp.vec3  # unit, outward


@wp.struct
class Interval:
    """What a ray passes of a convex body."""

    enter: float  # [m]
    leave: float  # [m]; below enter: nothing
    enter_normal: wp.vec3
    leave_normal: wp.vec3


@wp.func
def finite_inverse(value: float):
    """1 / value, large and finite for zero."""
    if wp.abs(value) < TINY:
        return 1.0 / TINY
    return 1.0 / value


@wp.func
def slab(origin: wp.vec3, direction: wp.vec3, axis: int, half: float):
    """Interval between the planes at ± half on an axis."""
    out = Interval()
    normal = wp.vec3()
    normal[axis] = 1.0
    if wp.abs(direction[axis]) < TINY:
        out.enter = -FAR
        out.leave = FAR
        if wp.abs(origin[axis]) > half:
            out.leave = -2.0 * FAR
        out.enter_normal = normal
        out.leave_normal = normal
        return out
    inverse = 1.0 / direction[axis]
    low = (-half - origin[axis]) * inverse
    high = (half - origin[axis]) * inverse
    if inverse > 0.0:
        out.enter = low
        out.leave = high
        out.enter_normal = -normal
        out.leave_normal = normal
    else:
        out.enter = high
        out.leave = low
        out.enter_normal = normal
        out.leave_normal = -normal
    return out


@wp.func
def both(a: Interval, b: Interval):
    """What lies in two bodies."""
    out = a
    if b.enter > a.enter:
        out.enter = b.enter
        out.enter_normal = b.enter_normal
    if b.leave < a.leave:
        out.leave = b.leave
        out.leave_normal = b.leave_normal
    return out


@wp.func
def either(a: Interval, b: Interval):
    """What lies in one of two bodies whose union is convex."""
    if a.leave < a.enter:
        return b
    if b.leave < b.enter:
        return a
    out = a
    if b.enter < a.enter:
        out.enter = b.enter
        out.enter_normal = b.enter_normal
    if b.leave > a.leave:
        out.leave = b.leave
        out.leave_normal = b.leave_normal
    return out


@wp.func
def tube(origin: wp.vec3, direction: wp.vec3, radius: float):
    """Interval within an endless cylinder about z, from its point closest to the axis: exact far away, too."""
    out = Interval()
    across = direction[0] * direction[0] + direction[1] * direction[1]
    if across < 1.0e-14:
        out.enter = -FAR
        out.leave = FAR
        if origin[0] * origin[0] + origin[1] * origin[1] > radius * radius:
            out.leave = -2.0 * FAR
        out.enter_normal = wp.vec3(1.0, 0.0, 0.0)
        out.leave_normal = wp.vec3(1.0, 0.0, 0.0)
        return out
    closest = -(origin[0] * direction[0] + origin[1] * direction[1]) / across
    x = origin[0] + closest * direction[0]
    y = origin[1] + closest * direction[1]
    square = (radius * radius - x * x - y * y) / across
    if square < 0.0:
        out.enter = FAR
        out.leave = -FAR
        return out
    half = wp.sqrt(square)
    out.enter = closest - half
    out.leave = closest + half
    out.enter_normal = wp.normalize(wp.vec3(x - half * direction[0], y - half * direction[1], 0.0))
    out.leave_normal = wp.normalize(wp.vec3(x + half * direction[0], y + half * direction[1], 0.0))
    return out


@wp.func
def ball(origin: wp.vec3, direction: wp.vec3, radius: float):
    """Interval within a sphere about the origin."""
    out = Interval()
    closest = -wp.dot(origin, direction)
    nearest = origin + closest * direction
    square = radius * radius - wp.dot(nearest, nearest)
    if square < 0.0:
        out.enter = FAR
        out.leave = -FAR
        return out
    half = wp.sqrt(square)
    out.enter = closest - half
    out.leave = closest + half
    out.enter_normal = wp.normalize(nearest - half * direction)
    out.leave_normal = wp.normalize(nearest + half * direction)
    return out


@wp.func
def ahead(interval: Interval):
    """The surface of a convex body ahead of a ray's origin."""
    out = Surface()
    out.distance = MISS
    if interval.leave < interval.enter or interval.leave < 0.0:
        return out
    if interval.enter >= 0.0:
        out.distance = interval.enter
        out.normal = interval.enter_normal
    else:
        out.distance = interval.leave
        out.normal = interval.leave_normal
    return out


@wp.func
def ray_box(origin: wp.vec3, direction: wp.vec3, half: wp.vec3):
    """A box of the half edges ``half`` [m]."""
    inside = both(slab(origin, direction, 0, half[0]), slab(origin, direction, 1, half[1]))
    return ahead(both(inside, slab(origin, direction, 2, half[2])))


@wp.func
def ray_cylinder(origin: wp.vec3, direction: wp.vec3, radius: float, half: float):
    """A cylinder about z between ± half [m], with its ends."""
    return ahead(both(tube(origin, direction, radius), slab(origin, direction, 2, half)))


@wp.func
def ray_capsule(origin: wp.vec3, direction: wp.vec3, radius: float, half: float):
    """A capsule about z whose hemispheres are centred at ± half [m]."""
    body = both(tube(origin, direction, radius), slab(origin, direction, 2, half))
    up = wp.vec3(0.0, 0.0, half)
    body = either(body, ball(origin - up, direction, radius))
    return ahead(either(body, ball(origin + up, direction, radius)))
