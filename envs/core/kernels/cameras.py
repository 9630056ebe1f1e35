"""What machines see through a camera at one instant: depths, and colours; a pixel a thread."""

import warp as wp

from aoro_gym.envs.core.kernels.rays import Episodes, Errors, misplaced, noise_seed, pose_before
from aoro_gym.sensors.camera.kernels.lens import Lens, direction_of
from aoro_gym.sensors.camera.kernels.render import Shutter, sent_back
from aoro_gym.sensors.camera.kernels.sky import Sky, beyond, through_air
from aoro_gym.sensors.camera.kernels.surfaces import Look, see
from aoro_gym.sensors.raytrace.device import Rays, cast


@wp.func
def eye_of(e: Episodes, errors: Errors, i: int, age: float, mounting: wp.transform, optical: wp.transform):
    """Pose of a camera's axes ``age`` [s] ago; errors turn and move the mounting in its own axes."""
    return pose_before(e, i, age) * mounting * misplaced(e, errors, i) * optical


@wp.kernel(enable_backward=False, module="aoro_gym.envs.core.kernels.depths")
def look_far(
    e: Episodes, errors: Errors, scenes: wp.array(dtype=Rays), lens: Lens, mounting: wp.transform, optical: wp.transform,
    age: float, farthest: float,
    stereo: float,  # [pixels m] focal length times baseline
    deviation: float,  # [pixels] of the disparity
    depths: wp.array2d(dtype=float),
):  # fmt: skip
    """Depth [m] along the camera's axis; ``farthest`` where there is nothing nearer."""
    i, p = wp.tid()
    depths[i, p] = farthest
    eye = eye_of(e, errors, i, age, mounting, optical)
    if wp.length(wp.transform_get_rotation(eye)) > 0.5:  # not before the first episode
        ahead = direction_of(lens, float(p % lens.width), float(p / lens.width))
        direction = wp.transform_vector(eye, ahead)
        hit = cast(scenes[int(e.ground[i])], wp.transform_get_translation(eye), direction, farthest / ahead[2], 0)
        if hit.instance >= 0:
            depth = hit.distance * ahead[2]
            if deviation > 0.0:
                state = wp.rand_init(noise_seed(e, errors, i), p)
                disparity = stereo / wp.max(depth, 1.0e-3) + deviation * float(e.noise[i]) * wp.randn(state)
                depth = stereo / wp.max(disparity, stereo / farthest)
            depths[i, p] = wp.clamp(depth, 0.0, farthest)


@wp.kernel(enable_backward=False, module="aoro_gym.envs.core.kernels.colours")
def look_at_colours(
    e: Episodes, errors: Errors, scenes: wp.array(dtype=Rays), looks: wp.array(dtype=Look), lens: Lens,
    mounting: wp.transform, optical: wp.transform, age: float, reach: float, sky: Sky, shutter: Shutter,
    white: wp.vec3,  # [W/(m² sr)] that is 1
    deviation: float,
    colours: wp.array2d(dtype=float),
):  # fmt: skip
    """Red, green and blue of a pixel in [0, 1], by the square root of radiance over ``white``."""
    i, p = wp.tid()
    eye = eye_of(e, errors, i, age, mounting, optical)
    for band in range(3):
        colours[i, 3 * p + band] = 0.0
    if wp.length(wp.transform_get_rotation(eye)) > 0.5:
        rays = scenes[int(e.ground[i])]
        look = looks[int(e.ground[i])]
        direction = wp.transform_vector(eye, direction_of(lens, float(p % lens.width), float(p / lens.width)))
        seed = noise_seed(e, errors, i)
        seen = see(rays, look, wp.transform_get_translation(eye), direction, reach, 0)
        radiance = beyond(sky, direction, True)
        if seen.hit.instance != -1:
            sent = sent_back(rays, look, sky, shutter, seen, direction, 0, p, 0, seed)
            radiance = through_air(sky, sent.direct + wp.cw_mul(sent.reflected, sent.light), seen.hit.distance)
        state = wp.rand_init(seed, p)
        for band in range(3):
            level = wp.sqrt(wp.max(radiance[band] / white[band], 0.0)) + deviation * float(e.noise[i]) * wp.randn(state)
            colours[i, 3 * p + band] = wp.clamp(level, 0.0, 1.0)
