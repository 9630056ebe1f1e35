"""What a pixel truly shows, by one ray through its middle at the middle of its row's exposure."""

import warp as wp

from aoro_gym.sensors.camera.kernels.lens import Lens, direction_of, pixel_of
from aoro_gym.sensors.camera.kernels.render import Shot, Shutter, sunlit
from aoro_gym.sensors.camera.kernels.surfaces import see
from aoro_gym.sensors.lidar.device import pose_at

ROUNDS = wp.constant(4)  # in which the row of a moved point, and with it its time, is found
CLOSEST = wp.constant(0.01)  # [m] ahead of the camera at which points are still drawn


@wp.func
def seen_later(
    lens: Lens, shutter: Shutter, shot: Shot, place: wp.vec3, later: float, row: float,
):  # fmt: skip
    """Pixel at which a still place is drawn in the picture that begins ``later`` [s]; NaN behind the camera."""
    pixel = wp.vec2(0.0, row)
    for _ in range(ROUNDS):
        line = wp.clamp(pixel[1], -1.0, float(lens.height))
        pose = pose_at(shot.times, shot.poses, shot.world, later + shutter.line * line + 0.5 * shot.exposure)
        point = wp.transform_point(wp.transform_inverse(pose * shot.mounting), place)
        if point[2] < CLOSEST:
            return wp.vec2(wp.nan, wp.nan)
        pixel = pixel_of(lens, point)
    return pixel


@wp.kernel(enable_backward=False)
def annotate(
    shots: wp.array(dtype=Shot),
    lens: Lens,
    shutter: Shutter,  # whose exposure is the shots' own
    reach: float,  # [m]
    baseline: float,  # [m]
    interval: float,  # [s] to the next picture
    first_row: int,
    # out
    depth: wp.array3d(dtype=float),
    disparity: wp.array3d(dtype=float),
    instance: wp.array3d(dtype=int),
    kind: wp.array3d(dtype=wp.uint8),
    normal: wp.array3d(dtype=wp.vec3),
    flow: wp.array3d(dtype=wp.vec2),
    sun: wp.array3d(dtype=wp.uint8),
):
    """A pixel of a shot."""
    n, y, column = wp.tid()
    row = first_row + y
    shot = shots[n]
    time = shutter.line * float(row) + 0.5 * shot.exposure
    pose = pose_at(shot.times, shot.poses, shot.world, time) * shot.mounting
    ahead = direction_of(lens, float(column), float(row))
    direction = wp.transform_vector(pose, ahead)
    seen = see(shot.rays, shot.look, wp.transform_get_translation(pose), direction, reach, shot.bodies)
    instance[n, row, column] = seen.hit.instance
    kind[n, row, column] = wp.uint8(seen.hit.kind)
    if seen.hit.instance == -1:
        depth[n, row, column] = wp.inf
        disparity[n, row, column] = 0.0
        normal[n, row, column] = wp.vec3()
        flow[n, row, column] = wp.vec2(wp.nan, wp.nan)
        sun[n, row, column] = wp.uint8(0)
        return
    z = seen.hit.distance * ahead[2]
    depth[n, row, column] = z
    disparity[n, row, column] = lens.focal[0] * baseline / z
    normal[n, row, column] = wp.transform_vector(wp.transform_inverse(pose), seen.hit.normal)
    moved = seen_later(lens, shutter, shot, seen.place, interval, float(row))
    flow[n, row, column] = moved - wp.vec2(float(column), float(row))
    side = seen.hit.normal
    lit = wp.dot(side, shot.sky.sun) > 0.0 and sunlit(shot.rays, shot.look, shot.sky, seen.place, side, shot.lit)
    if lit:
        sun[n, row, column] = wp.uint8(1)
    else:
        sun[n, row, column] = wp.uint8(0)
