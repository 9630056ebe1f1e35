"""Radiance of each pixel: rays through the lens, the light that their surfaces send back, and the air on the way.

A surface of albedo ρ sends ρ / π (E_sun cos θ V + E_sky) to all sides, V whether the sun is seen. E_sky is a mean over rays
spread by the cosine: what meets the sky brings its radiance, what meets another surface that one's, lit by the sun and by
a share of the sky's light: one bounce. Leaves let light through, too.
"""

import warp as wp

from aoro_gym.sensors.camera.kernels.lens import Lens, direction_of
from aoro_gym.sensors.camera.kernels.sky import Sky, beyond, through_air
from aoro_gym.sensors.camera.kernels.surfaces import Look, Seen, blocked, see, see_solid, through_leaves
from aoro_gym.sensors.camera.kernels.textures import Patch, patch_of
from aoro_gym.sensors.lidar.device import pose_at
from aoro_gym.sensors.raytrace.device import Rays

PI = wp.constant(3.14159265)
AMBIENT = wp.constant(0.35)  # share of the sky's light on a surface that light bounces off; (E)
OFFSET = wp.constant(1.0e-3)  # [m] at which rays leave a surface
FAR_LIGHT = wp.constant(300.0)  # [m] within which surfaces cast shadows
FAR_AIR = wp.constant(1.0e4)  # [m] of air before the sky
FIRST, SECOND = wp.constant(0.7548776662), wp.constant(0.5698402910)  # of Roberts' (2018) sequence R2


@wp.struct
class Shutter:
    """When rows are exposed."""

    exposure: float  # [s]
    line: float  # [s] from a row to the next; 0: all at once
    samples: int  # sub-frames, each with rays of its own
    sky_rays: int  # of each sample


@wp.struct
class Shot:
    """One camera's picture of one world."""

    rays: Rays
    look: Look
    sky: Sky
    mounting: wp.transform  # from the camera's axes to the front frame's
    times: wp.array(dtype=float)  # [s] motion of the front frames ...
    poses: wp.array2d(dtype=wp.transform)  # ... of several worlds
    world: int  # of these
    bodies: int  # world of the moving things that the camera's rays meet
    lit: int  # and of those that light meets
    exposure: float  # [s]
    salt: int


@wp.func
def spread(index: int, number: int, salt: int):
    """A point of the unit square, the number-th of an even sequence that is shifted at random for each ``index``."""
    state = wp.rand_init(salt, index)
    x = wp.randf(state) + FIRST * float(number)
    y = wp.randf(state) + SECOND * float(number)
    return wp.vec2(x - wp.floor(x), y - wp.floor(y))


@wp.func
def about(normal: wp.vec3, point: wp.vec2):
    """Direction about a normal, by a density of the cosine over π."""
    radius = wp.sqrt(point[0])
    turn = 2.0 * PI * point[1]
    helper = wp.vec3(1.0, 0.0, 0.0)
    if wp.abs(normal[0]) > 0.7:
        helper = wp.vec3(0.0, 1.0, 0.0)
    u = wp.normalize(wp.cross(helper, normal))
    v = wp.cross(normal, u)
    return wp.normalize(
        radius * wp.cos(turn) * u + radius * wp.sin(turn) * v + wp.sqrt(wp.max(1.0 - point[0], 0.0)) * normal
    )


@wp.func
def sunlit(rays: Rays, look: Look, sky: Sky, place: wp.vec3, normal: wp.vec3, world: int):
    """Whether nothing hides the sun from a place; ``normal`` is the triangle's, towards the sun."""
    if wp.max(sky.sunlight) <= 0.0:
        return False
    return not blocked(rays, look, place + OFFSET * normal, sky.sun, FAR_LIGHT, world)


@wp.func
def from_sun(rays: Rays, look: Look, sky: Sky, seen: Seen, patch: Patch, world: int):
    """Radiance [W/(m² sr)] that a patch sends back of the sun's light, or lets through."""
    facing = wp.dot(patch.normal, sky.sun)
    out = wp.vec3()
    colour = patch.albedo
    side = seen.hit.normal
    if facing < 0.0:
        colour = patch.transmittance
    if wp.dot(side, sky.sun) < 0.0:
        if wp.max(patch.transmittance) <= 0.0:
            return out  # the bump faces the sun, the surface does not
        side = -side
    if wp.max(colour) > 0.0 and sunlit(rays, look, sky, seen.place, side, world):
        share = wp.abs(facing) / PI * through_leaves(rays, look, seen.place, sky.sun)
        out = wp.cw_mul(colour, sky.sunlight) * share
    return out


@wp.func
def bounced(rays: Rays, look: Look, sky: Sky, seen: Seen, world: int):
    """Radiance [W/(m² sr)] of a surface that light bounces off: even in colour, with a share of the sky's light."""
    patch = Patch()
    patch.albedo = look.albedo[seen.hit.kind]
    patch.transmittance = look.transmittance[seen.hit.kind]
    patch.normal = seen.hit.normal
    if look.snow > 0.0:
        patch.albedo = wp.lerp(patch.albedo, wp.vec3(0.9, 0.9, 0.9), look.snow * wp.max(patch.normal[2], 0.0))
    up = 0.5 + 0.5 * patch.normal[2]
    sky_part = wp.cw_mul(patch.albedo, sky.diffuse) * (AMBIENT * up / PI)
    return from_sun(rays, look, sky, seen, patch, world) + sky_part


@wp.func
def arriving(rays: Rays, look: Look, sky: Sky, origin: wp.vec3, direction: wp.vec3, world: int):
    """Radiance [W/(m² sr)] that arrives at a surface from a direction."""
    seen = see_solid(rays, look, origin, direction, FAR_LIGHT, world)
    if seen.hit.instance == -1:
        return beyond(sky, direction, False)
    return bounced(rays, look, sky, seen, world)


@wp.struct
class Sent:
    """What a surface sends to the camera: ``direct + reflected * light`` [W/(m² sr)]."""

    direct: wp.vec3
    reflected: wp.vec3  # albedo, less what a film of water keeps
    light: wp.vec3  # of the sky, and bounced


@wp.func
def sent_back(
    rays: Rays, look: Look, sky: Sky, shutter: Shutter, seen: Seen, direction: wp.vec3, world: int, index: int,
    number: int, salt: int,
):  # fmt: skip
    """What a surface sends towards the camera."""
    patch = patch_of(rays, look, seen, direction)
    out = Sent()
    out.direct = from_sun(rays, look, sky, seen, patch, world)
    out.reflected = patch.albedo + 0.5 * patch.transmittance
    origin = seen.place + OFFSET * seen.hit.normal
    for k in range(shutter.sky_rays):
        way = about(patch.normal, spread(index, number * shutter.sky_rays + k, salt + 1))
        if wp.dot(way, seen.hit.normal) > 0.0:
            out.light += arriving(rays, look, sky, origin, way, world)
    open_above = through_leaves(rays, look, seen.place, wp.vec3(0.0, 0.0, 1.0))
    out.light = out.light / float(shutter.sky_rays) * open_above
    if patch.gloss > 0.02:
        point = spread(index, number, salt + 2)
        facet = wp.normalize(patch.normal + patch.roughness * (about(patch.normal, point) - patch.normal))
        cosine = wp.max(-wp.dot(facet, direction), 0.0)
        mirror = direction + 2.0 * cosine * facet
        share = patch.gloss * (0.02 + 0.98 * wp.pow(1.0 - cosine, 5.0))  # Schlick (1994); 0.02 of water from above
        if wp.dot(mirror, seen.hit.normal) > 0.0:
            film = arriving(rays, look, sky, origin, wp.normalize(mirror), world) * (share * open_above)
            out.direct = out.direct * (1.0 - share) + film
            out.reflected = out.reflected * (1.0 - share)
    return out


@wp.kernel(enable_backward=False)
def render(
    shots: wp.array(dtype=Shot),
    lens: Lens,
    shutter: Shutter,  # whose exposure is the shots' own
    reach: float,  # [m]
    first_row: int,
    every: int,  # pixels from a rendered one to the next, for metering
    # out, means over the exposure, see Sent; and normal and depth of the first sub-frame
    direct: wp.array3d(dtype=wp.vec3),
    reflected: wp.array3d(dtype=wp.vec3),
    light: wp.array3d(dtype=wp.vec3),
    guide: wp.array3d(dtype=wp.vec4),
):
    """A pixel of a shot."""
    n, y, column = wp.tid()
    shot = shots[n]
    row = (first_row + y) * every
    index = (shot.world * lens.height + row) * lens.width + column * every
    sums = Sent()
    met = float(0.0)
    for k in range(shutter.samples):
        offset = spread(index, k, shot.salt)
        u = float(column * every) + offset[0] - 0.5
        v = float(row) + offset[1] - 0.5
        time = shutter.line * float(row) + shot.exposure * (float(k) + 0.5) / float(shutter.samples)
        pose = pose_at(shot.times, shot.poses, shot.world, time) * shot.mounting
        origin = wp.transform_get_translation(pose)
        direction = wp.transform_vector(pose, direction_of(lens, u, v))
        seen = see(shot.rays, shot.look, origin, direction, reach, shot.bodies)
        near = wp.vec4(0.0, 0.0, 0.0, FAR_AIR)
        if seen.hit.instance == -1:
            far = beyond(shot.sky, direction, True)
            if shot.sky.extinction > 0.0:
                far = through_air(shot.sky, far, FAR_AIR)
            sums.direct += far
        else:
            sent = sent_back(shot.rays, shot.look, shot.sky, shutter, seen, direction, shot.lit, index, k, shot.salt)
            sums.direct += through_air(shot.sky, sent.direct, seen.hit.distance)
            sums.reflected += sent.reflected * wp.exp(-shot.sky.extinction * seen.hit.distance)
            sums.light += sent.light
            met += 1.0
            side = seen.hit.normal
            near = wp.vec4(side[0], side[1], side[2], seen.hit.distance)
        if k == 0:
            guide[n, first_row + y, column] = near
    direct[n, first_row + y, column] = sums.direct / float(shutter.samples)
    reflected[n, first_row + y, column] = sums.reflected / float(shutter.samples)
    light[n, first_row + y, column] = sums.light / wp.max(met, 1.0)
