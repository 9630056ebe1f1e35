"""Device code: :func:`cast`, the one function that every sensor sends its rays by.

Still things are one mesh for all worlds; moving ones are shapes in one hierarchy of boxes, in which each world has a
subtree of its own.
"""

# Device code: its types are Warp's, not Python's.
# pyright: reportGeneralTypeIssues=false, reportInvalidTypeForm=false, reportIndexIssue=false, reportOperatorIssue=false
# pyright: reportArgumentType=false, reportAttributeAccessIssue=false, reportCallIssue=false
# ruff: noqa: UP018, RUF046
import warp as wp

from aoro_gym.sensors.raytrace.shapes import MISS, Surface, finite_inverse, ray_box, ray_capsule, ray_cylinder
from aoro_gym.sensors.raytrace.undergrowth import Leaves

BOX = wp.constant(0)
CYLINDER = wp.constant(1)
CAPSULE = wp.constant(2)
TRIANGLES = wp.constant(3)
NO_CLASS = wp.constant(255)  # of a ray that met nothing


@wp.struct
class Shape:
    """A moving thing in its own axes."""

    kind: int
    size: wp.vec3  # [m] half edges of a box; radius, radius and half length of a cylinder or capsule
    mesh: wp.uint64  # of triangles
    lower: wp.vec3  # [m] bounds in its own axes
    upper: wp.vec3
    instance: int
    kind_of_thing: int  # class


@wp.struct
class Rays:
    """All that rays can meet."""

    mesh: wp.uint64  # ground and still things
    face_instance: wp.array(dtype=int)
    face_class: wp.array(dtype=wp.uint8)
    bodies: wp.uint64  # hierarchy of the moving things' boxes
    roots: wp.array(dtype=int)  # of each world in it; -1: it has none
    shapes: wp.array(dtype=Shape)
    poses: wp.array(dtype=wp.transform)  # of the moving things in the world's axes
    reflectance: wp.array(dtype=wp.vec2)  # [-] of each class at 905 nm and 1550 nm
    leaves: Leaves  # undergrowth, for those that ask for it: cast() looks through it


@wp.struct
class Hit:
    """What a ray met first."""

    distance: float  # [m]; infinite: nothing
    normal: wp.vec3  # unit, of the side that the ray met
    instance: int  # 0: ground; -1: nothing
    kind: int  # class; NO_CLASS: nothing
    face: int  # of the still mesh, or of a moving mesh; -1: a box, cylinder or capsule, or nothing
    front: bool  # whether the outer side was met: false from inside a closed thing, or from below ground


@wp.func
def cast_at_shape(shape: Shape, pose: wp.transform, origin: wp.vec3, direction: wp.vec3, reach: float):
    """Surface of one moving thing, in the world's axes; and the face of a mesh."""
    to_shape = wp.transform_inverse(pose)
    o = wp.transform_point(to_shape, origin)
    d = wp.transform_vector(to_shape, direction)
    out = Surface()
    out.distance = MISS
    face = int(-1)
    if shape.kind == BOX:
        out = ray_box(o, d, shape.size)
    elif shape.kind == CYLINDER:
        out = ray_cylinder(o, d, shape.size[0], shape.size[2])
    elif shape.kind == CAPSULE:
        out = ray_capsule(o, d, shape.size[0], shape.size[2])
    else:
        met = wp.mesh_query_ray(shape.mesh, o, d, reach)
        if met.result:
            out.distance = met.t
            out.normal = wp.normalize(met.normal)
            face = met.face
    out.normal = wp.transform_vector(pose, out.normal)
    return out, face


@wp.func
def cast(rays: Rays, origin: wp.vec3, direction: wp.vec3, max_range: float, world: int):
    """What a ray meets first.

    Args: origin [m] and unit direction in the world's axes; max_range [m]; world: whose moving things are met.
    """
    out = Hit()
    out.distance = wp.inf
    out.instance = -1
    out.kind = NO_CLASS
    out.face = -1
    out.front = True
    reach = max_range
    met = wp.mesh_query_ray(rays.mesh, origin, direction, max_range)
    if met.result:
        reach = met.t
        out.distance = met.t
        out.normal = wp.normalize(met.normal)
        out.face = met.face
        out.instance = rays.face_instance[met.face]
        out.kind = int(rays.face_class[met.face])
    root = rays.roots[world]
    if root >= 0:
        safe = direction
        for axis in range(3):
            if direction[axis] == 0.0:
                safe[axis] = 1.0 / finite_inverse(0.0)
        query = wp.bvh_query_ray(rays.bodies, origin, safe, root)
        index = int(0)
        while wp.bvh_query_next(query, index, reach):
            shape = rays.shapes[index]
            surface, face = cast_at_shape(shape, rays.poses[index], origin, direction, reach)
            if surface.distance >= 0.0 and surface.distance < reach:
                reach = surface.distance
                out.distance = surface.distance
                out.normal = surface.normal
                out.face = face
                out.instance = shape.instance
                out.kind = shape.kind_of_thing
    if wp.dot(out.normal, direction) > 0.0:
        out.normal = -out.normal
        out.front = False
    return out


@wp.kernel(enable_backward=False)
def cast_many(
    rays: Rays,
    origins: wp.array(dtype=wp.vec3),
    directions: wp.array(dtype=wp.vec3),
    max_range: float,
    worlds: wp.array(dtype=int),
    distance: wp.array(dtype=float),
    normal: wp.array(dtype=wp.vec3),
    instance: wp.array(dtype=int),
    kind: wp.array(dtype=wp.uint8),
    face: wp.array(dtype=int),
    front: wp.array(dtype=bool),
):
    """One ray a thread."""
    i = wp.tid()
    hit = cast(rays, origins[i], directions[i], max_range, worlds[i])
    distance[i] = hit.distance
    normal[i] = hit.normal
    instance[i] = hit.instance
    kind[i] = wp.uint8(hit.kind)
    face[i] = hit.face
    front[i] = hit.front


@wp.kernel(enable_backward=False)
def bound(
    shapes: wp.array(dtype=Shape),
    poses: wp.array(dtype=wp.transform),
    lowers: wp.array(dtype=wp.vec3),
    uppers: wp.array(dtype=wp.vec3),
):
    """Boxes [m] in the world's axes around moving things at their poses."""
    i = wp.tid()
    shape = shapes[i]
    turned = wp.quat_to_matrix(wp.transform_get_rotation(poses[i]))
    half = 0.5 * (shape.upper - shape.lower)
    middle = wp.transform_point(poses[i], 0.5 * (shape.upper + shape.lower))
    reach = wp.vec3()
    for row in range(3):
        for column in range(3):
            reach[row] += wp.abs(turned[row, column]) * half[column]
        reach[row] += 1.0e-5 + 1.0e-6 * wp.abs(middle[row])  # what float32 rounds off
    lowers[i] = middle - reach
    uppers[i] = middle + reach


@wp.kernel(enable_backward=False)
def find_roots(bodies: wp.uint64, filled: wp.array(dtype=bool), roots: wp.array(dtype=int)):
    """Subtrees of the worlds that have moving things."""
    world = wp.tid()
    roots[world] = -1
    if filled[world]:
        roots[world] = wp.bvh_get_group_root(bodies, world)
