"""What a pixel truly shows, by one ray through its middle at the middle of its row's exposure."""

import warp as wp

from aoro_gym.sensors.camera.kernels.lens import Lens, direction_of, pixel_of
from aoro_gym.sensors.camera.kernels.render import Shutter, sunlit
from aoro_gym.sensors.camera.kernels.sky import Sky
from aoro_gym.sensors.camera.kernels.surfaces import Look, see
from aoro_gym.sensors.lidar.device import pose_at
from aoro_gym.sensors.raytrace.device import Rays

ROUNDS = wp.constant(4)  # in which the row of a moved point, and with it its time, is found
CLOSEST = wp.constant(0.01)  # [m] ahead of the camera at which points are still drawn


@wp.func
def seen_later(
    lens: Lens, shutter: Shutter, mounting: wp.transform, times: wp.array(dtype=float),
    poses: wp.array2d(dtype=wp.transform), world: int, place: wp.vec3, later: float, row: float,
):  # fmt: skip
    """Pixel at which a still place is drawn in the picture that begins ``later`` [s]; NaN behind the camera."""
    pixel = wp.vec2(0.0, row)
    for _ in range(ROUNDS):
        line = wp.clamp(pixel[1], -1.0, float(lens.height))
        pose = pose_at(times, poses, world, later + shutter.line * line + 0.5 * shutter.exposure)
        point = wp.transform_point(wp.transform_inverse(pose * mounting), place)
        if point[2] < CLOSEST:
            return wp.vec2(wp.nan, wp.nan)
        pixel = pixel_of(lens, point)
    return pixel


@wp.kernel(enable_backward=False)
def annotate(
    rays: Rays,
    look: Look,
    sky: Sky,
    lens: Lens,
    shutter: Shutter,
    mounting: wp.transform,
    reach: float,
    baseline: float,  # [m]
    interval: float,  # [s] to the next picture
    # motion of the front frames
    times: wp.array(dtype=float),
    poses: wp.array2d(dtype=wp.transform),
    # out
    depth: wp.array3d(dtype=float),
    disparity: wp.array3d(dtype=float),
    instance: wp.array3d(dtype=int),
    kind: wp.array3d(dtype=wp.uint8),
    normal: wp.array3d(dtype=wp.vec3),
    flow: wp.array3d(dtype=wp.vec2),
    sun: wp.array3d(dtype=wp.uint8),
):
    """A pixel of a world's camera."""
    world, row, column = wp.tid()
    pose = pose_at(times, poses, world, shutter.line * float(row) + 0.5 * shutter.exposure) * mounting
    ahead = direction_of(lens, float(column), float(row))
    direction = wp.transform_vector(pose, ahead)
    seen = see(rays, look, wp.transform_get_translation(pose), direction, reach, world)
    instance[world, row, column] = seen.hit.instance
    kind[world, row, column] = wp.uint8(seen.hit.kind)
    if seen.hit.instance == -1:
        depth[world, row, column] = wp.inf
        disparity[world, row, column] = 0.0
        normal[world, row, column] = wp.vec3()
        flow[world, row, column] = wp.vec2(wp.nan, wp.nan)
        sun[world, row, column] = wp.uint8(0)
        return
    z = seen.hit.distance * ahead[2]
    depth[world, row, column] = z
    disparity[world, row, column] = lens.focal[0] * baseline / z
    normal[world, row, column] = wp.transform_vector(wp.transform_inverse(pose), seen.hit.normal)
    moved = seen_later(lens, shutter, mounting, times, poses, world, seen.place, interval, float(row))
    flow[world, row, column] = moved - wp.vec2(float(column), float(row))
    lit = wp.dot(seen.hit.normal, sky.sun) > 0.0 and sunlit(rays, look, sky, seen.place, seen.hit.normal, world)
    if lit:
        sun[world, row, column] = wp.uint8(1)
    else:
        sun[world, row, column] = wp.uint8(0)
