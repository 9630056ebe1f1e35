"""What a camera's ray meets: surfaces with the gaps between needles and leaves, and the leaves of the undergrowth.

A triangle of foliage is a twig: of a triangle's points, those of the twig and its needles or leaves stop a ray. The
undergrowth is a field of leaf area; here each of its leaves is a disc that stands still, so that the left and the right
camera and the next picture see the same one. Space is cut into cubes that stand on their corners, so that no view looks
along their rows; one holds a disc of radius r with the probability
u a³ / (π r²), u the area of leaves in a volume, a the edge. As discs point anywhere, a ray gets through with the probability
exp(-∫ u / 2 ds) in the mean, as far as discs are small: the law of Beer and Lambert that lidars go by.
"""

import warp as wp

from aoro_gym.sensors.raytrace.device import Hit, Rays, cast
from aoro_gym.sensors.raytrace.undergrowth import Leaves, node

UNDERGROWTH = wp.constant(-3)  # instance of its leaves
STEP = wp.constant(1.0e-4)  # [m] at which a ray goes on behind a gap
MOST_GAPS = wp.constant(24)  # that a ray passes; the next triangle stops it
PLAIN, NEEDLES, BROAD = wp.constant(-1), wp.constant(12), wp.constant(14)
SPRUCE = wp.constant(13)
DISC = wp.constant(0.42)  # radius of a disc over the edge of its cube
EDGE = wp.constant(0.02)  # [m] of cubes nearby; twice and four times as much farther away
NEAR, MIDDLE = wp.constant(4.0), wp.constant(10.0)  # [m] up to which cubes are small, and twice as large
CORNERED = wp.constant(wp.quat(0.325058, -0.325058, 0.0, 0.888074))  # from the cubes' axes to the world's
STRIDE = wp.constant(0.1)  # [m] between looks at how high the leaves are
MOST_CELLS = wp.constant(3000)


@wp.struct
class Look:
    """Appearance of classes and objects."""

    texture: wp.array(dtype=int)  # of each class: the number of a surface, or PLAIN
    albedo: wp.array(dtype=wp.vec3)  # of each class
    transmittance: wp.array(dtype=wp.vec3)  # likewise, of leaves
    poses: wp.array(dtype=wp.transform)  # of each instance, from its own axes to the world's; beyond its end: none
    undergrowth: bool  # whether the field of leaves is seen
    densest: float  # most area [1/m] of its leaves in a volume
    gaps: bool  # whether triangles of foliage have gaps
    bare: bool  # whether birches have no leaves
    autumn: float  # share of leaves that have turned
    snow: float  # cover of what faces up, in [0, 1]
    wetness: float  # [0, 1]


@wp.struct
class Seen:
    """What a ray met first."""

    hit: Hit
    place: wp.vec3  # [m]


@wp.func
def in_triangle(mesh: wp.uint64, face: int, place: wp.vec3):
    """Shares of the second and the third corner in a place on a triangle."""
    a = wp.mesh_get_point(mesh, 3 * face)
    u = wp.mesh_get_point(mesh, 3 * face + 1) - a
    v = wp.mesh_get_point(mesh, 3 * face + 2) - a
    w = place - a
    uu = wp.dot(u, u)
    uv = wp.dot(u, v)
    vv = wp.dot(v, v)
    det = uu * vv - uv * uv
    wu = wp.dot(w, u)
    wv = wp.dot(w, v)
    return wp.vec2((vv * wu - uv * wv) / det, (uu * wv - uv * wu) / det)


@wp.func
def part(value: float):
    """What is left of a number over the whole one below."""
    return value - wp.floor(value)


@wp.func
def is_gap(rays: Rays, look: Look, hit: Hit, place: wp.vec3):
    """Whether a ray passes between the needles or leaves of the triangle that it met."""
    if hit.face < 0 or hit.instance < 1:
        return False
    kind = look.texture[hit.kind]
    if kind < NEEDLES or kind > BROAD:
        return False
    if kind == BROAD and look.bare:
        return True
    if not look.gaps:
        return False
    shares = in_triangle(rays.mesh, hit.face, place)
    along = shares[0] + shares[1]  # from the first corner, where the twig begins, to the far edge
    across = (shares[1] - shares[0]) / wp.max(along, 1.0e-4)  # from edge to edge, -1 to 1
    if wp.abs(across) < 0.05:
        return False
    if kind == BROAD:
        column = 1.6 * (across + 1.0)
        row = 3.0 * along + 0.5 * wp.floor(column)
        x = part(column) - 0.5
        y = part(row) - 0.5
        return 4.0 * x * x + 2.4 * y * y > 0.55
    count = float(22.0)
    if kind == SPRUCE:
        count = float(30.0)
    return part(count * (along - 0.22 * wp.abs(across))) > 0.62


@wp.func
def cell_bits(i: int, j: int, k: int, level: int):
    """State of the random numbers of a cube."""
    mixed = wp.uint32(i) * wp.uint32(73856093) ^ wp.uint32(j) * wp.uint32(19349663) ^ wp.uint32(k) * wp.uint32(83492791)
    return wp.rand_init(int(mixed), level)


@wp.func
def leaf_of(leaves: Leaves, i: int, j: int, k: int, level: int, edge: float):
    """Middle and normal of a cube's leaf, and whether there is one."""
    state = cell_bits(i, j, k, level)
    chance = wp.randf(state)
    radius = DISC * edge
    room = edge - 2.0 * radius
    x = float(i) * edge + radius + room * wp.randf(state)
    y = float(j) * edge + radius + room * wp.randf(state)
    z = float(k) * edge + radius + room * wp.randf(state)
    normal = wp.sample_unit_sphere_surface(state)
    place = wp.quat_rotate(CORNERED, wp.vec3(x, y, z))
    here = node(leaves, place[0], place[1])
    above = place[2] - here[0]
    share = here[2] * edge / (3.14159265 * DISC * DISC)
    there = chance < share and above < here[1] and above > -edge
    return place, normal, there


@wp.func
def meets_leaf(leaves: Leaves, densest: float, origin: wp.vec3, direction: wp.vec3, reach: float):
    """Distance [m] at which a ray meets a leaf of the undergrowth, infinite for none, and the leaf's normal."""
    turned = wp.quat_rotate_inv(CORNERED, origin)
    along = wp.quat_rotate_inv(CORNERED, direction)
    t = float(0.0)
    looked = float(-1.0)  # where the height of the leaves was looked up
    found = float(wp.inf)
    normal = wp.vec3(0.0, 0.0, 1.0)
    cells = int(0)
    while t < reach and cells < MOST_CELLS:
        cells += 1
        if t >= looked:
            place = origin + t * direction
            here = node(leaves, place[0], place[1])
            above = place[2] - here[0] - leaves.tallest - 0.05
            if above > 0.0:
                t += above / wp.max(leaves.steepest + wp.abs(direction[2]), 1.0e-3) + 1.0e-3
                looked = t
                continue
            if here[2] == 0.0 and above < -leaves.tallest - 0.3:
                return found, normal  # far below the ground
            looked = t + STRIDE
        level = int(0)
        edge = float(EDGE)
        if t > NEAR:
            level = int(1)
            edge = 2.0 * EDGE
        if t > MIDDLE:
            level = int(2)
            edge = 4.0 * EDGE
        place = turned + (t + 1.0e-4 * edge + 1.0e-6 * t) * along
        step = float(wp.inf)
        for axis in range(3):
            share = place[axis] / edge
            share = share - wp.floor(share)
            if along[axis] > 1.0e-6:
                step = wp.min(step, (1.0 - share) * edge / along[axis])
            if along[axis] < -1.0e-6:
                step = wp.min(step, -share * edge / along[axis])
        i = int(wp.floor(place[0] / edge))
        j = int(wp.floor(place[1] / edge))
        k = int(wp.floor(place[2] / edge))
        state = cell_bits(i, j, k, level)
        if wp.randf(state) < densest * edge / (3.14159265 * DISC * DISC):
            middle, facing, there = leaf_of(leaves, i, j, k, level, edge)
            if there:
                slope = wp.dot(direction, facing)
                if wp.abs(slope) > 1.0e-4:
                    distance = wp.dot(middle - origin, facing) / slope
                    off = origin + distance * direction - middle
                    if distance > 0.0 and distance < reach and wp.dot(off, off) < DISC * DISC * edge * edge:
                        return distance, facing
        t += wp.max(step, 0.02 * edge) + 2.0e-4 * edge + 1.0e-6 * t
    return found, normal


@wp.func
def see_solid(rays: Rays, look: Look, origin: wp.vec3, direction: wp.vec3, reach: float, world: int):
    """The first surface on a ray, undergrowth left out; arguments as of :func:`see`."""
    out = Seen()
    begun = float(0.0)
    gaps = int(0)
    looking = bool(True)
    while looking:
        hit = cast(rays, origin + begun * direction, direction, reach - begun, world)
        hit.distance = hit.distance + begun
        out.hit = hit
        looking = bool(False)
        if hit.instance > 0 and gaps < MOST_GAPS:
            if is_gap(rays, look, hit, origin + hit.distance * direction):
                begun = hit.distance + STEP
                gaps += 1
                looking = bool(True)
    out.place = origin + out.hit.distance * direction
    return out


@wp.func
def ragged(rays: Rays, look: Look, hit: Hit, place: wp.vec3):
    """Class of the ground at a place: the triangles', their borders shifted by up to about half a metre."""
    if look.texture[hit.kind] == PLAIN:
        return hit.kind
    shift = wp.vec3()
    for axis in range(2):
        state = wp.uint32(51 + axis)
        shift[axis] = (
            0.6 * wp.noise(state, 0.9 * place)
            + 0.25 * wp.noise(state, 3.1 * place)
            + 0.12 * wp.noise(state, 11.0 * place)
        )
    met = wp.mesh_query_ray(rays.mesh, place + shift + wp.vec3(0.0, 0.0, 0.4), wp.vec3(0.0, 0.0, -1.0), 1.5)
    if met.result:
        if rays.face_instance[met.face] == 0:
            return int(rays.face_class[met.face])
    return hit.kind


@wp.func
def see(rays: Rays, look: Look, origin: wp.vec3, direction: wp.vec3, reach: float, world: int):
    """The first surface or leaf on a ray.

    Args: origin [m] and unit direction in the world's axes; reach [m]; world: whose moving things are met.
    """
    out = see_solid(rays, look, origin, direction, reach, world)
    if out.hit.instance == 0:
        out.hit.kind = ragged(rays, look, out.hit, out.place)
    if look.undergrowth and rays.leaves.tallest > 0.0:
        distance, normal = meets_leaf(rays.leaves, look.densest, origin, direction, wp.min(out.hit.distance, reach))
        if distance < out.hit.distance:
            out.hit.distance = distance
            out.hit.instance = UNDERGROWTH
            out.hit.kind = rays.leaves.kind
            out.hit.face = -1
            out.hit.front = True
            out.hit.normal = normal
            if wp.dot(normal, direction) > 0.0:
                out.hit.normal = -normal
            out.place = origin + distance * direction
    return out


@wp.func
def blocked(rays: Rays, look: Look, origin: wp.vec3, direction: wp.vec3, reach: float, world: int):
    """Whether any surface lies on a ray; leaves of the undergrowth are not looked at, see :func:`through_leaves`."""
    begun = float(0.0)
    gaps = int(0)
    while gaps < MOST_GAPS:
        hit = cast(rays, origin + begun * direction, direction, reach - begun, world)
        if hit.instance < 0:
            return False
        hit.distance = hit.distance + begun
        if not is_gap(rays, look, hit, origin + hit.distance * direction):
            return True
        begun = hit.distance + STEP
        gaps += 1
    return True


@wp.func
def through_leaves(rays: Rays, look: Look, place: wp.vec3, direction: wp.vec3):
    """Share of light that comes through the undergrowth to a place, from a direction above the horizon."""
    if not look.undergrowth or rays.leaves.tallest <= 0.0:
        return 1.0
    here = node(rays.leaves, place[0], place[1])
    deep = here[1] - (place[2] - here[0])
    if deep <= 0.0:
        return 1.0
    return wp.exp(-0.5 * here[2] * wp.min(deep, here[1]) / wp.max(direction[2], 0.1))
