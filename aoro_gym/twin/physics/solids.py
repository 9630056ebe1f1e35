"""Contact of wheels and chassis with solid objects that do not move: stems, stumps and stones.

Every body is a convex **core** with all points within a **margin** of it. The depth of two bodies is the sum of their
margins less the distance of their cores: smooth, with one normal, exact until the cores meet.

==========  ======================================  ==========================================
body        core                                    margin
==========  ======================================  ==========================================
wheel       a disc in its middle plane              half its tread: it is round across
chassis     a box                                   ``HULL_EDGE``, or less where it is thin
stem, log   a segment                               its radius, linear along it; ends are round
stump       a cylinder                              the rounding of its edge
stone       an ellipsoid of shorter half axes       what they lack; exact for a sphere
==========  ======================================  ==========================================

The nearest points of a segment and a convex core are the root of a monotone derivative (Illinois' method); those of two
other cores are found by alternating projections (Cheney and Goldstein, *Proximity Maps for Convex Sets*, 1959).

A tire is the spring and damper that it is on the ground, Kelvin and Voigt's k δ + c δ̇ that never pulls, with the friction
of its law of slip; its footprint on a thin log is smaller than on the ground, and it softer than this. The chassis follows
Hunt and Crossley, *Coefficient of Restitution Interpreted as Damping in Vibroimpact* (J. Appl. Mech. 42, 1975), F = K δ
(1 + a δ̇), with Coulomb friction regularised below ``HULL_REGULARISATION``. Objects neither bend nor break.

Forces are explicit in the main step h, but for what a tire's friction does to its wheel's spin. A spring k is stable for
k h² < 4 m and a damper c for c h < 2 m, with m the effective mass at the contact. The bundled machine has 400 kg or more at
a wheel and 700 kg or more at a corner of the chassis. At h = 2 ms, the longest step, the tire (344 kN/m, 3.1 kN s/m) needs
3 kg, the chassis (2 MN/m) 2 kg for its stiffness and K a δ h/2 = 300 kg for its damping at δ = 0.2 m. Its friction is
c = μ F/v₀ of the contact's load F below the regularisation's v₀: 500 kg under 100 kN at 1 ms, where what is larger chatters
about rest at no more than v₀, as it never exceeds μ F.
"""

# pyright: reportGeneralTypeIssues=false, reportInvalidTypeForm=false
import warp as wp

from aoro_gym.twin.physics.tires import (
    HULL_REGULARISATION,
    LUGRE,
    Friction,
    Hull,
    Slide,
    Tire,
    TireContact,
    lugre_slip,
    relaxed_slip,
)

STEM = wp.constant(0)
STUMP = wp.constant(1)
STONE = wp.constant(2)

HULL_EDGE = wp.constant(0.2)  # [m] radius of the chassis' edges, at most half its least half size (E)
DISSIPATION = wp.constant(0.75)  # [s/m] a of Hunt and Crossley: 3/2 of the loss of restitution a m/s, 0.5: wood (E)
CROWN = wp.constant(0.05)  # [1/m] curvature given to flat faces along a stem, so that one point is the deepest
ROOT_STEPS = wp.constant(16)  # of Illinois' method, every fourth of bisection
PROJECTIONS = wp.constant(16)  # alternating; each leaves at most 0.6 of the way to the nearest points
NEWTON_STEPS = wp.constant(5)  # to the nearest point of an ellipsoid
LEAST = wp.constant(1.0e-5)  # [m] distance of cores below which they have no direction


@wp.struct
class Solid:
    """An object, in the world's axes or a frame's."""

    kind: int  # STEM, STUMP or STONE
    start: wp.vec3  # [m] lower end of the core's axis; a stone's middle
    end: wp.vec3  # [m] upper end
    start_margin: float  # [m]
    end_margin: float  # [m]
    half: wp.vec3  # [m] a stone's core: half axes; a stump's: its radius in x
    rotation: wp.quat  # a stone's own axes → world
    friction: float  # [-] multiplier of the tire's friction


@wp.struct
class Part:
    """A wheel or a frame's chassis, in its frame's axes."""

    centre: wp.vec3  # [m]
    half: wp.vec3  # [m] of the core: half sizes of a box; of a disc its radius, 0, its radius
    margin: float  # [m]
    round: int  # 1: a disc about the y axis, 0: a box


@wp.struct
class Gap:
    """How a part and an object are to one another, in the frame's axes."""

    depth: float  # [m] negative apart
    normal: wp.vec3  # unit, from the object to the part
    place: wp.vec3  # [m] on the part's surface


@wp.func
def nearest_on_part(part: Part, point: wp.vec3):
    """The part's core's nearest point to ``point``."""
    d = point - part.centre
    if part.round == 1:
        share = wp.min(part.half[0] / wp.max(wp.sqrt(d[0] * d[0] + d[2] * d[2]), LEAST), 1.0)
        return part.centre + wp.vec3(share * d[0], 0.0, share * d[2])
    return part.centre + wp.vec3(
        wp.clamp(d[0], -part.half[0], part.half[0]),
        wp.clamp(d[1], -part.half[1], part.half[1]),
        wp.clamp(d[2], -part.half[2], part.half[2]),
    )


@wp.func
def nearest_on_cylinder(start: wp.vec3, end: wp.vec3, radius: float, point: wp.vec3):
    """A solid cylinder's nearest point to ``point``."""
    axis = end - start
    along = wp.dot(point - start, axis) / wp.dot(axis, axis)
    across = point - start - along * axis
    share = wp.min(radius / wp.max(wp.length(across), LEAST), 1.0)
    return start + wp.clamp(along, 0.0, 1.0) * axis + share * across


@wp.func
def nearest_on_ellipsoid(half: wp.vec3, p: wp.vec3):
    """A solid ellipsoid's nearest point to ``p``, both in its own axes: x_i = a_i² p_i/(a_i² + t), with t the largest root
    of Σ (a_i p_i/(a_i² + t))² = 1 (Eberly, *Distance from a Point to an Ellipse, an Ellipsoid, or a Hyperellipsoid*,
    2013), by Newton's method from its lower bound, from where it converges monotonically."""
    squares = wp.cw_mul(half, half)
    scaled = wp.cw_mul(half, p)
    inside = wp.cw_div(p, half)
    if wp.dot(inside, inside) <= 1.0:
        return p
    t = wp.max(wp.max(wp.abs(scaled[0]) - squares[0], wp.abs(scaled[1]) - squares[1]), wp.abs(scaled[2]) - squares[2])
    t = wp.max(t, 0.0)
    step = int(0)
    while step < NEWTON_STEPS:
        shifted = squares + wp.vec3(t, t, t)
        share = wp.cw_div(scaled, shifted)
        sizes = wp.cw_mul(share, share)
        slope = 2.0 * (sizes[0] / shifted[0] + sizes[1] / shifted[1] + sizes[2] / shifted[2])
        t += (sizes[0] + sizes[1] + sizes[2] - 1.0) / wp.max(slope, 1.0e-20)
        step += 1
    return wp.cw_div(wp.cw_mul(squares, p), squares + wp.vec3(t, t, t))


@wp.func
def nearest_on_object(one: Solid, point: wp.vec3):
    """The nearest point of a stump's or a stone's core to ``point``."""
    if one.kind == STUMP:
        return nearest_on_cylinder(one.start, one.end, one.half[0], point)
    local = wp.quat_rotate_inv(one.rotation, point - one.start)
    return one.start + wp.quat_rotate(one.rotation, nearest_on_ellipsoid(one.half, local))


@wp.func
def facing(part: Part, on_part: wp.vec3, on_object: wp.vec3, margins: float):
    """The gap at the nearest points of both cores; where these meet, the normal points to the part's middle."""
    out = Gap()
    apart = on_part - on_object
    distance = wp.length(apart)
    if distance > LEAST:
        out.normal = apart / distance
    else:
        aside = part.centre - on_object
        far = wp.length(aside)
        out.normal = wp.where(far > LEAST, aside / wp.max(far, LEAST), wp.vec3(0.0, 0.0, 1.0))
    out.depth = margins - distance
    out.place = on_part - part.margin * out.normal
    return out


@wp.func
def approach(part: Part, point: wp.vec3, axis: wp.vec3):
    """How fast the distance to the part's core grows [-] from ``point`` along a unit ``axis``."""
    v = point - nearest_on_part(part, point)
    return wp.dot(v, axis) / wp.max(wp.length(v), LEAST)


@wp.func
def stem_gap(part: Part, one: Solid):
    """Gap to a stem: the least of |x(s) − core| − r(s) + κ (s − s₀)²/2 over its axis, which is convex in s. κ is
    :data:`CROWN` and s₀ nearest to the part's middle: flat faces along a stem are slightly domed."""
    axis = one.end - one.start
    length = wp.length(axis)
    axis = axis / length
    taper = (one.end_margin - one.start_margin) / length
    reach = wp.length(part.half)
    middle = wp.dot(part.centre - one.start, axis)
    low = wp.clamp(middle - reach, 0.0, length)
    high = wp.clamp(middle + reach, 0.0, length)
    middle = wp.clamp(middle, 0.0, length)
    slope_low = approach(part, one.start + low * axis, axis) - taper + CROWN * (low - middle)
    slope_high = approach(part, one.start + high * axis, axis) - taper + CROWN * (high - middle)
    s = low
    if slope_low < 0.0:
        s = high
        if slope_high > 0.0:
            side = int(0)
            step = int(0)
            while step < ROOT_STEPS:
                s = (low * slope_high - high * slope_low) / (slope_high - slope_low)
                if step % 4 == 1:
                    s = 0.5 * (low + high)  # where the derivative jumps
                slope = approach(part, one.start + s * axis, axis) - taper + CROWN * (s - middle)
                if slope > 0.0:
                    high = s
                    slope_high = slope
                    if side == 1:
                        slope_low *= 0.5
                    side = 1
                else:
                    low = s
                    slope_low = slope
                    if side == -1:
                        slope_high *= 0.5
                    side = -1
                step += 1
    point = one.start + s * axis
    margin = one.start_margin + taper * s - 0.5 * CROWN * (s - middle) * (s - middle)
    return facing(part, nearest_on_part(part, point), point, part.margin + margin)


@wp.func
def gap(part: Part, one: Solid):
    """Gap between a part and an object in its frame's axes."""
    if one.kind == STEM:
        return stem_gap(part, one)
    on_part = part.centre
    on_object = on_part
    step = int(0)
    while step < PROJECTIONS:
        on_object = nearest_on_object(one, on_part)
        on_part = nearest_on_part(part, on_object)
        step += 1
    return facing(part, on_part, on_object, part.margin + one.start_margin)


@wp.func
def in_frame(one: Solid, rotation: wp.mat33, origin: wp.vec3):
    """An object of the world in the axes of a frame at ``origin`` [m], whose ``rotation`` leads into the world."""
    out = one
    to_frame = wp.transpose(rotation)
    out.start = to_frame * (one.start - origin)
    out.end = to_frame * (one.end - origin)
    if one.kind == STONE:
        out.rotation = wp.quat_inverse(wp.quat_from_matrix(rotation)) * one.rotation
    return out


@wp.func
def wheel_part(m: Tire, centre: wp.vec3):
    """A wheel: as far out as its middle disc, as wide as its outer ones."""
    margin = wp.min(m.disc_offset_outer, 0.5 * m.radius)
    return Part(centre, wp.vec3(m.radius - margin, 0.0, m.radius - margin), margin, 1)


@wp.func
def hull_part(low: wp.vec3, high: wp.vec3):
    """A frame's hull between two opposite corners [m]."""
    half = 0.5 * (high - low)
    margin = wp.min(HULL_EDGE, 0.5 * wp.min(half))
    return Part(0.5 * (low + high), half - wp.vec3(margin, margin, margin), margin, 0)


@wp.func
def rolling_direction(n: wp.vec3):
    """The direction in which a wheel about y rolls over a surface of normal ``n``; on its flank, where it rolls nowhere,
    ahead."""
    tilt = wp.sqrt(n[0] * n[0] + n[2] * n[2])
    if tilt > 0.05:
        return wp.vec3(n[2] / tilt, 0.0, -n[0] / tilt)
    return wp.normalize(wp.vec3(1.0, 0.0, 0.0) - n[0] * n)


@wp.func
def tire_on_solid(
    m: Tire,
    at: Gap,
    # the wheel in its frame: centre, its velocity, the frame's angular velocity, absolute spin
    centre: wp.vec3,
    velocity: wp.vec3,
    omega: wp.vec3,
    spin: float,
    # multiplier of the friction, bristles
    friction: float,
    bristle_x: float,
    bristle_y: float,
    dt: float,
):
    """Contact of one wheel with an object: F_n = max(0, k δ + c δ̇), friction by the law of slip, no rolling resistance."""
    out = TireContact()
    n = at.normal
    arm = at.place - centre
    slip = velocity + wp.cross(wp.vec3(omega[0], spin, omega[2]), arm)
    out.load = wp.max(m.stiffness * at.depth - m.damping * wp.dot(n, slip), 0.0)
    out.forward = rolling_direction(n)
    sideways = wp.cross(n, out.forward)
    out.lever = -wp.dot(out.forward, wp.cross(wp.vec3(0.0, 1.0, 0.0), arm))
    v = Slide(wp.dot(out.forward, slip), wp.dot(sideways, slip), 0.0, spin * out.lever, out.load, friction)
    grip = Friction()
    if m.slip_law == LUGRE:
        grip = lugre_slip(m, v, bristle_x, bristle_y, dt)
    else:
        grip = relaxed_slip(m, v, bristle_x, bristle_y, dt)
    out.bristle_x = grip.bristle_x
    out.bristle_y = grip.bristle_y
    out.damping = grip.damping
    out.force = out.load * n - grip.x * out.forward - grip.y * sideways
    out.moment = wp.cross(arm, out.force)
    return out


@wp.func
def hull_on_solid(m: Hull, at: Gap, velocity: wp.vec3, omega: wp.vec3):
    """Force [N], frame axes, of an object on a chassis whose frame's origin moves at ``velocity`` and turns at ``omega``."""
    v = velocity + wp.cross(omega, at.place)
    closing = -wp.dot(at.normal, v)
    load = wp.max(m.stiffness * at.depth * (1.0 + DISSIPATION * closing), 0.0)
    slip = v + closing * at.normal
    speed = wp.sqrt(wp.dot(slip, slip) + HULL_REGULARISATION * HULL_REGULARISATION)
    return load * at.normal - (m.friction * load / speed) * slip
