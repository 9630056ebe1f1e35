"""A tire's discs on the triangles themselves: what :class:`~aoro_gym.twin.physics.ground.Discs` has in place of one averaged
plane under the wheel.

Each of the five discs is cut out of the ground by its own plane: a line of pieces, one a triangle, as exact as the triangles
are. Where the line lies inside of the disc, the tread is pressed in by radial springs (Davis, *A Radial-Spring
Terrain-Enveloping Tire Model*, Vehicle System Dynamics 4, 1975). With w = (R² − r²)/2R, which is the spring's deflection
R − r to within δ/2R of it, at the distance r from the centre, and n the ground's normal,

    E = ∬ w dA over ground inside of the disc = ∫ ½ w² R dθ,      ∂E/∂x = −∫ w n ds along the line,

so that springs on any ground are as far bent as on a plane at the depth δ with E_plane(δ) = E: Davis's equivalent
deflection. Springs of even stiffness would make the force on a plane grow as δ^1.5; a tire's is F = k δ. So the force is
that of the energy ½ k δ(E)², F = −k δ ∂δ/∂x with ∂δ/∂x = (∂E/∂x)/E′_plane(δ). It goes through the disc's centre, is
continuous over kerbs and edges of ditches, and gives back the work that was put in. On a plane it is k δ along the normal:
what :func:`~aoro_gym.twin.physics.tires.tire_contact` feels there, to 1e-5 at δ = 5 cm.

Depths and pushes of the discs are blended as on a plane (:func:`~aoro_gym.twin.physics.tires.disc_contact`) into one contact
point, which carries friction. How steep the ground is across a disc is told by its triangles. Left out: the tread's own
bending stiffness, without which a sharp edge goes deeper into the tire than into a real one (E: 0.15 m into a right angle at
22.5 kN, where a plane goes 0.05 m); friction at two places at once; hulls, which feel the averaged plane. Valid for ground
below the wheel's centre, of triangles wound counter-clockwise seen from above.
"""

# pyright: reportGeneralTypeIssues=false, reportInvalidTypeForm=false
from typing import Any

import warp as wp

from aoro_gym.twin.physics.ground import Discs, Footing, Site
from aoro_gym.twin.physics.tires import DISC_BLEND, DiscContact, Tire, TireContact, tire_contact, touch_forces

DISCS = wp.constant(5)
BELOW = wp.constant(0.02)  # [m] that a disc looks beyond its rim: ten times DISC_BLEND, what is farther has no weight
FLATTEST = wp.constant(1.0e-6)  # [-] of a triangle's normal in the disc's plane: it lies in that plane
NOWHERE = wp.constant(1.0e3)  # [m]
# Gauss–Legendre on [−1, 1], five points
GAUSS_PLACE_1 = wp.constant(0.5384693101056831)
GAUSS_PLACE_2 = wp.constant(0.906179845938664)
GAUSS_SHARE_0 = wp.constant(0.5688888888888889)
GAUSS_SHARE_1 = wp.constant(0.47862867049936647)
GAUSS_SHARE_2 = wp.constant(0.23692688505618908)


@wp.struct
class Cut:
    """Where a disc meets the ground."""

    energy: float  # [m³] E, of springs of unit stiffness
    push: wp.vec3  # [m²] −∂E/∂x, frame axes
    distance: float  # [m] of the nearest ground from the disc's centre
    flat: float  # [-] what of that triangle's normal lies in the disc's plane


@wp.struct
class DiscTouch:
    """How a disc touches the ground."""

    depth: float  # [m] along the ground's normal; negative above it
    push: wp.vec3  # [-] force over k δ: along the ground's normal, frame axes; of length 1 on a plane


@wp.func
def spring_energy(place: float, square: float, radius: float, d: float):
    """½ w² R dθ/ds at ``place`` s [m] of a piece that lies ``d`` [m] from the centre; ``square`` is R² − d²."""
    r_square = d * d + place * place
    w = 0.5 * (square - place * place) / radius
    return 0.5 * w * w * radius * d / wp.max(r_square, 1.0e-12)


@wp.func
def with_piece(c: Cut, radius: float, n: wp.vec3, from_x: float, from_z: float, to_x: float, to_z: float):
    """``c`` with a piece of the ground's line between two points [m] from the disc's centre, of a triangle of unit normal
    ``n`` (frame axes)."""
    out = c
    flat = wp.sqrt(n[0] * n[0] + n[2] * n[2])
    if flat > FLATTEST:
        up_x = n[0] / flat
        up_z = n[2] / flat
        d = -(up_x * from_x + up_z * from_z)
        s_from = up_z * from_x - up_x * from_z
        s_to = up_z * to_x - up_x * to_z
        low = wp.min(s_from, s_to)
        high = wp.max(s_from, s_to)
        foot = wp.clamp(0.0, low, high)
        distance = wp.sqrt(d * d + foot * foot)
        if distance < c.distance:
            out.distance = distance
            out.flat = flat
        square = (radius - d) * (radius + d)
        if square > 0.0:
            chord = wp.sqrt(square)
            low = wp.max(low, -chord)
            high = wp.min(high, chord)
            if high > low:
                half = 0.5 * (high - low)
                middle = 0.5 * (high + low)
                one = GAUSS_PLACE_1 * half
                two = GAUSS_PLACE_2 * half
                energy = GAUSS_SHARE_0 * spring_energy(middle, square, radius, d)
                energy += GAUSS_SHARE_1 * (
                    spring_energy(middle - one, square, radius, d) + spring_energy(middle + one, square, radius, d)
                )
                energy += GAUSS_SHARE_2 * (
                    spring_energy(middle - two, square, radius, d) + spring_energy(middle + two, square, radius, d)
                )
                # mean of w over the piece
                pressed = 0.5 * (square - middle * middle - half * half / 3.0) / radius
                out.energy += half * energy
                out.push += (2.0 * half * pressed / flat) * n
    return out


@wp.func
def crossing(lone: wp.vec3, other: wp.vec3):
    """Where the edge between two points meets the disc's plane, y = 0."""
    share = lone[1] / (lone[1] - other[1])
    return lone[0] + share * (other[0] - lone[0]), lone[2] + share * (other[2] - lone[2])


@wp.func
def with_triangle(c: Cut, radius: float, a: wp.vec3, b: wp.vec3, d: wp.vec3):
    """``c`` with the piece that the disc's plane cuts out of a triangle; corners [m] from the disc's centre, frame axes.

    A corner in the plane counts as on its left, so that neighbours neither share a piece nor leave one out.
    """
    out = c
    side_a = a[1] >= 0.0
    side_b = b[1] >= 0.0
    side_d = d[1] >= 0.0
    if side_a != side_b or side_a != side_d:
        n = wp.normalize(wp.cross(b - a, d - a))
        lone = a
        first = b
        second = d
        if side_a == side_b:
            lone = d
            first = a
            second = b
        elif side_a == side_d:
            lone = b
            first = a
            second = d
        from_x, from_z = crossing(lone, first)
        to_x, to_z = crossing(lone, second)
        out = with_piece(c, radius, n, from_x, from_z, to_x, to_z)
    return out


@wp.func
def cut(mesh: wp.uint64, to_frame: wp.mat33, centre: wp.vec3, radius: float):
    """A disc whose ``centre`` [m] is in the world's axes against all triangles near it."""
    out = Cut()
    out.distance = NOWHERE
    reach = radius + BELOW
    extent = wp.vec3()
    for i in range(3):
        extent[i] = reach * wp.sqrt(wp.max(1.0 - to_frame[1, i] * to_frame[1, i], 0.0))
    query = wp.mesh_query_aabb(mesh, centre - extent, centre + extent)
    face = int(0)
    while wp.mesh_query_aabb_next(query, face):
        out = with_triangle(
            out,
            radius,
            to_frame * (wp.mesh_get_point(mesh, 3 * face) - centre),
            to_frame * (wp.mesh_get_point(mesh, 3 * face + 1) - centre),
            to_frame * (wp.mesh_get_point(mesh, 3 * face + 2) - centre),
        )
    return out


@wp.func
def plane_energy(depth: float, radius: float):
    """E [m³] of a disc at a ``depth`` δ [m] in a plane, ∫ (2/3R) (2Rx − x²)^1.5 dx, by the series of (1 − x/2R)^1.5: to 1e-5
    at δ = 0.4 R."""
    z = 0.5 * depth / radius
    series = 0.4 + z * (-0.42857143 + z * (0.083333333 + z * (0.011363636 + z * 0.0036057692)))
    return (2.0 / 3.0) / radius * 2.0 * radius * wp.sqrt(2.0 * radius * depth) * depth * depth * series


@wp.func
def plane_slope(depth: float, radius: float):
    """E′ [m²] of :func:`plane_energy`: (2/3R) (2Rδ − δ²)^1.5."""
    square = depth * (2.0 * radius - depth)
    return (2.0 / 3.0) / radius * square * wp.sqrt(square)


@wp.func
def equivalent_depth(energy: float, radius: float):
    """Depth δ [m] at which a plane bends the springs as far: three Newton steps from where δ is small."""
    depth = wp.pow(energy / (0.26666667 / radius * 2.0 * radius * wp.sqrt(2.0 * radius)), 0.4)
    for _ in range(3):
        depth = wp.clamp(
            depth - (plane_energy(depth, radius) - energy) / plane_slope(depth, radius), 0.5 * depth, radius
        )
    return depth


@wp.func
def disc_touch(c: Cut, radius: float):
    """Depth and push of a disc that is ``c``; the depth is along the normal, and δ in the disc's own plane is as much longer
    as that is steep across it."""
    out = DiscTouch()
    along = wp.sqrt(c.push[0] * c.push[0] + c.push[2] * c.push[2])
    if c.energy > 0.0 and along > 0.0:
        depth = equivalent_depth(c.energy, radius)
        whole = wp.length(c.push)
        out.depth = depth * along / whole
        out.push = along / (whole * plane_slope(depth, radius)) * c.push
    else:
        out.depth = wp.min(radius - c.distance, 0.0) * c.flat
        out.depth = wp.where(c.distance < NOWHERE, out.depth, -NOWHERE)
    return out


@wp.struct
class TireTouch:
    """How all discs of a tire touch the ground."""

    contact: DiscContact
    normal: wp.vec3  # of the ground as a whole, unit, frame axes
    steepness: float  # [-] by which the depth grows with the way against the normal: 1 on a plane
    middle: float  # [m] depth of the middle disc


@wp.func
def tire_touch(m: Tire, mesh: wp.uint64, rotation: wp.mat33, hub: wp.vec3):
    """Contact of a wheel whose centre is at ``hub`` [m] in the world, blended over its discs as that on a plane is
    (:func:`~aoro_gym.twin.physics.tires.disc_contact`): shares go with exp(δ_i/ε), here summed with the deepest so far."""
    out = TireTouch()
    to_frame = wp.transpose(rotation)
    deepest = float(-2.0 * NOWHERE)
    total = float(0.0)
    aside = float(0.0)
    drop = float(0.0)
    mean = float(0.0)
    push = wp.vec3()
    discs = int(DISCS)
    for i in range(discs):
        side = float(1.0)
        if i & 1:
            side = float(-1.0)
        offset = float(0.0)
        smaller = float(0.0)
        if i > 2:
            offset = side * m.disc_offset_outer
            smaller = m.disc_drop_outer
        elif i > 0:
            offset = side * m.disc_offset_inner
            smaller = m.disc_drop_inner
        radius = m.radius - smaller
        centre = hub + rotation * wp.vec3(0.0, offset, 0.0)
        disc = disc_touch(cut(mesh, to_frame, centre, radius), radius)
        if i == 0:
            out.middle = disc.depth
        share = float(1.0)
        if disc.depth > deepest:
            faded = wp.exp((deepest - disc.depth) / DISC_BLEND)
            deepest = disc.depth
            total *= faded
            aside *= faded
            drop *= faded
            mean *= faded
            push *= faded
        else:
            share = wp.exp((disc.depth - deepest) / DISC_BLEND)
        total += share
        aside += share * offset
        drop += share * smaller
        mean += share * disc.depth
        push += share * disc.push
    level = 1.0 + 2.0 * (wp.exp(-m.disc_drop_inner / DISC_BLEND) + wp.exp(-m.disc_drop_outer / DISC_BLEND))
    out.contact.depth = deepest + DISC_BLEND * wp.log(total / level)
    out.steepness = wp.length(push) / total
    if out.steepness > 0.0:
        out.normal = wp.normalize(push)
        tilt = wp.max(wp.sqrt(out.normal[0] * out.normal[0] + out.normal[2] * out.normal[2]), FLATTEST)
        down = wp.vec3(-out.normal[0] / tilt, 0.0, -out.normal[2] / tilt)
        out.contact.place = (
            wp.vec3(0.0, aside / total, 0.0)
            + (m.radius - drop / total) * down
            - (out.contact.depth - mean / total) * out.normal
        )
    else:
        out.contact.depth = -NOWHERE
    return out


@wp.func
def wheel_contact(
    terrain: Any, ground: Any, m: Tire, under: Footing, rotation: wp.mat33, origin: wp.vec3, centre: wp.vec3,
    velocity: wp.vec3, omega: wp.vec3, spin: float, bristle_x: float, bristle_y: float, twist: float, dt: float,
):  # fmt: skip
    """Contact of one wheel with any ground but that of discs: :func:`~aoro_gym.twin.physics.tires.tire_contact`."""
    return tire_contact(
        m, under, rotation, origin, centre, velocity, omega, spin, bristle_x, bristle_y, twist, dt
    )


@wp.func
def wheel_contact(
    terrain: Discs, ground: Site, m: Tire, under: Footing, rotation: wp.mat33, origin: wp.vec3, centre: wp.vec3,
    velocity: wp.vec3, omega: wp.vec3, spin: float, bristle_x: float, bristle_y: float, twist: float, dt: float,
):  # fmt: skip
    """Contact of one wheel whose discs ask the triangles; where the map ends, with the averaged plane."""
    out = TireContact()
    if under.known < 1.0:
        out = tire_contact(
            m, under, rotation, origin, centre, velocity, omega, spin, bristle_x, bristle_y, twist, dt
        )
    else:
        touch = tire_touch(m, ground.mesh, rotation, origin + rotation * centre)
        if touch.contact.depth > 0.0:
            out = touch_forces(
                m, under, touch.normal, touch.middle, touch.contact, touch.steepness, velocity, omega, spin, bristle_x,
                bristle_y, twist, dt,
            )  # fmt: skip
    return out
