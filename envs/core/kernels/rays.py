"""What machines see around them by rays: a lidar's ranges and a grid of heights, one ray or pulse a thread.

Poses of the last control steps are remembered in rings of slots, step k of an episode in slot k mod L, so that asking twice
changes nothing and a new episode, whose steps count from 0, needs no clearing.
"""

import warp as wp

from aoro_gym.sensors.kernels.noise import bits_of, mixed, white
from aoro_gym.sensors.lidar.device import Air, Sensor, echoes_of, pulse_of
from aoro_gym.sensors.raytrace.device import Rays
from aoro_gym.sensors.raytrace.downward import DEEP
from aoro_gym.twin.records import State

ERRORS = wp.constant(-1)  # number of a seed's samples that mounting errors begin at, downward: none is a step's


@wp.struct
class Errors:
    """Standard deviations of what is drawn anew each episode."""

    position: float  # [m] of each axis
    angle: float  # [rad] of each component of the rotation vector
    channel: wp.uint64  # of the sensor: those of others are independent


@wp.struct
class Episodes:
    """Of N sub-environments."""

    ground: wp.array(dtype=wp.int64)  # (N,) which scene they are in
    step: wp.array(dtype=wp.int64)  # (N,) control steps since the episode began
    seeds: wp.array(dtype=wp.int64)  # (N,)
    noise: wp.array(dtype=wp.float64)  # (N,) multiples of all noise and errors
    poses: wp.array3d(dtype=float)  # (L, N, 7) position [m] and quaternion x, y, z, w
    control_step: float  # [s]


@wp.kernel(enable_backward=False, module="aoro_gym.envs.core.kernels.rays")
def remember(e: Episodes, state: wp.array2d(dtype=float)):
    """Keep the poses of this step."""
    i = wp.tid()
    slot = int(e.step[i] % wp.int64(e.poses.shape[0]))
    for axis in range(3):
        e.poses[slot, i, axis] = state[State.X + axis, i]
    for part in range(4):
        e.poses[slot, i, 3 + part] = state[State.QX + part, i]


@wp.func
def kept_pose(e: Episodes, i: int, number: wp.int64):
    """Pose at a step of the episode; before the first one the machine stood."""
    slot = int(wp.max(number, wp.int64(0)) % wp.int64(e.poses.shape[0]))
    p = wp.vec3(e.poses[slot, i, 0], e.poses[slot, i, 1], e.poses[slot, i, 2])
    q = wp.quat(e.poses[slot, i, 3], e.poses[slot, i, 4], e.poses[slot, i, 5], e.poses[slot, i, 6])
    return wp.transform(p, q)


@wp.func
def pose_before(e: Episodes, i: int, age: float):
    """Pose ``age`` [s] ago: positions by straight lines between steps, rotations by normalised means."""
    steps = age / e.control_step
    whole = wp.floor(steps)
    share = steps - whole
    later = kept_pose(e, i, e.step[i] - wp.int64(whole))
    if share < 1.0e-4:
        return later
    earlier = kept_pose(e, i, e.step[i] - wp.int64(whole) - wp.int64(1))
    p = wp.lerp(wp.transform_get_translation(later), wp.transform_get_translation(earlier), share)
    q = wp.transform_get_rotation(later)
    r = wp.transform_get_rotation(earlier)
    if wp.dot(q, r) < 0.0:
        r = -r
    return wp.transform(p, wp.normalize(q * (1.0 - share) + r * share))


@wp.func
def seed_of(e: Episodes, errors: Errors, i: int):
    """The sensor's own seed in an episode."""
    return wp.int64(mixed(wp.uint64(e.seeds[i]) + mixed(errors.channel)))


@wp.func
def drawn(e: Episodes, errors: Errors, i: int, kind: int, deviation: float):
    """Three errors that an episode keeps."""
    out = wp.vec3()
    if deviation > 0.0:
        seed = seed_of(e, errors, i)
        for axis in range(3):
            number = wp.int64(ERRORS - 3 * kind - axis)
            out[axis] = deviation * float(e.noise[i] * white(seed, number))
    return out


@wp.func
def misplaced(e: Episodes, errors: Errors, i: int):
    """What a mounting is truly moved and turned by, in its own axes."""
    turn = drawn(e, errors, i, 1, errors.angle)
    angle = wp.length(turn)
    q = wp.quat_identity()
    if angle > 0.0:
        q = wp.quat_from_axis_angle(turn / angle, angle)
    return wp.transform(drawn(e, errors, i, 0, errors.position), q)


@wp.func
def noise_seed(e: Episodes, errors: Errors, i: int):
    """Of this step's noise, for Warp's generators."""
    return int(bits_of(seed_of(e, errors, i), e.step[i]) >> wp.uint64(34))


@wp.kernel(enable_backward=False, module="aoro_gym.envs.core.kernels.rays")
def look_around(
    e: Episodes, errors: Errors, scenes: wp.array(dtype=Rays), sensor: Sensor, air: Air,
    ages: wp.array(dtype=float),  # (P,) [s] of the pulses
    angles: wp.array(dtype=wp.vec2),  # (P,) azimuth and elevation [rad]
    places: wp.array(dtype=int),  # (P,) columns that they are written to
    ranges: wp.array2d(dtype=float),
):  # fmt: skip
    """Range [m] of each pulse's strongest echo; the greatest range where there is none."""
    i, p = wp.tid()
    pose = pose_before(e, i, ages[p])
    ranges[i, places[p]] = sensor.max_range
    if wp.length(wp.transform_get_rotation(pose)) > 0.5:  # not before the first episode
        own = sensor
        own.noise_deviation = float(e.noise[i]) * sensor.noise_deviation
        pulse = pulse_of(pose * sensor.mounting * misplaced(e, errors, i), angles[p][0], angles[p][1])
        echoes = echoes_of(scenes[int(e.ground[i])], own, air, pulse, 0, noise_seed(e, errors, i), p)
        if echoes.count > 0:
            ranges[i, places[p]] = wp.clamp(echoes.strongest.range, 0.0, sensor.max_range)


@wp.kernel(enable_backward=False, module="aoro_gym.envs.core.kernels.rays")
def look_at_ground(
    e: Episodes, errors: Errors, meshes: wp.array(dtype=wp.uint64), age: float, deviation: float, above: float,
    points: wp.array(dtype=wp.vec2),  # (K,) forward and left [m]
    missing: float,
    heights: wp.array2d(dtype=float),
):  # fmt: skip
    """Height [m] of each point of a grid in the heading's axes over the machine; ``missing`` where there is no ground."""
    i, k = wp.tid()
    pose = pose_before(e, i, age)
    heights[i, k] = missing
    q = wp.transform_get_rotation(pose)
    if wp.length(q) > 0.5:
        error = misplaced(e, errors, i)
        turned = wp.transform_get_rotation(error)
        forward = wp.quat_rotate(q, wp.vec3(1.0, 0.0, 0.0))
        level = wp.quat_from_axis_angle(wp.vec3(0.0, 0.0, 1.0), wp.atan2(forward[1], forward[0]))
        seen = wp.vec3(points[k][0], points[k][1], 0.0)
        true = wp.quat_rotate(level, wp.transform_get_translation(error) + wp.quat_rotate(turned, seen))
        start = wp.transform_get_translation(pose) + true + wp.vec3(0.0, 0.0, above)
        hit = wp.mesh_query_ray(meshes[int(e.ground[i])], start, wp.vec3(0.0, 0.0, -1.0), DEEP)
        if hit.result:
            state = wp.rand_init(noise_seed(e, errors, i), k)
            heights[i, k] = above - hit.t + deviation * float(e.noise[i]) * wp.randn(state)
