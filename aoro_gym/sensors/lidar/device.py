"""Device code: one pulse a thread, with the pose at its instant, sub-rays across its beam, echoes and their detection.

Powers are relative to a white Lambertian surface at right angles 1 m away in clear air: the range equation of an extended
target (Jelalian 1992, Laser Radar Systems; Wagner et al. 2006, ISPRS J. 60) is then P = ρ cos θ / R² exp(-2 α R). A volume
of backscatter β over a pulse's length L gives P = π β L / R² exp(-2 α R).

Transmitter and receiver look side by side, so that near by the receiver sees but the share ξ(R) of the beam: 0 up to R1, 1
from R2 on, linear in between (Rasshofer, Spies and Spies 2011, Adv. Radio Sci. 9: the crossover function; Hahner et al.
2021, ICCV, take it for fog). What reaches the detector is ξ P: by this echoes are detected and compared. P is what is
reported, as makers calibrate their intensities by range.
"""

# Device code: its types are Warp's, not Python's.
# pyright: reportGeneralTypeIssues=false, reportInvalidTypeForm=false, reportIndexIssue=false, reportOperatorIssue=false
# pyright: reportArgumentType=false, reportAttributeAccessIssue=false, reportCallIssue=false, reportAssignmentType=false
# ruff: noqa: UP018, RUF046
import warp as wp

from aoro_gym.sensors.raytrace.device import Rays, cast
from aoro_gym.sensors.raytrace.undergrowth import FACING, stopped_at

MOST = wp.constant(16)  # sub-rays of a beam
LEVELS = wp.types.vector(length=16, dtype=wp.float32)
LABELS = wp.types.vector(length=16, dtype=wp.int32)
FIRST, STRONGEST, LAST = wp.constant(0), wp.constant(1), wp.constant(2)
PRECIPITATION = wp.constant(-2)  # instance of an echo of rain, fog or snow
UNDERGROWTH = wp.constant(-3)  # likewise of leaves that are no triangles
NOTHING = wp.constant(-1)  # likewise of a ray that met nothing
NO_CLASS = wp.constant(255)


@wp.struct
class Sensor:
    """A lidar, as pulses need it."""

    mounting: wp.transform  # of the sensor's axes in the front frame's, errors included
    min_range: float  # [m]
    max_range: float
    overlap: wp.vec2  # [m] ranges from which on the receiver sees some and all of the beam
    gate: float  # [m] length of a pulse
    resolution: float  # [m]
    noise_range: wp.vec4  # [m] ranges, and the standard deviations [m] there
    noise_deviation: wp.vec4
    threshold: float  # power that is detected ...
    power_noise: float  # ... with noise of this standard deviation
    band: int  # of the scene's reflectances
    subrays: int
    across: LEVELS  # tangents of the sub-rays' angles off the beam's axis, left ...
    up: LEVELS  # ... and up


@wp.struct
class Air:
    """Weather, as pulses need it."""

    extinction: float  # [1/m]
    volume: float  # power of a full gate at 1 m: π β L
    drops: float  # mean number of particles in a gate, over its range squared [1/m²]
    reach: float  # [m] beyond which no particle can be detected; 0: none at all


@wp.struct
class Echo:
    """What came back at once."""

    range: float  # [m] as reported; infinite: nothing
    true_range: float  # [m]
    power: float
    level: float  # of the power what reaches the detector
    instance: int
    kind: int


@wp.struct
class Echoes:
    """Of a pulse."""

    count: int
    first: Echo
    strongest: Echo
    last: Echo


@wp.func
def nothing():
    """No echo."""
    out = Echo()
    out.range = wp.inf
    out.instance = -1
    out.kind = NO_CLASS
    return out


@wp.func
def deviation(sensor: Sensor, distance: float):
    """Standard deviation [m] of a range, linear between the published ones and constant outside."""
    out = sensor.noise_deviation[0]
    for i in range(3):
        low = sensor.noise_range[i]
        high = sensor.noise_range[i + 1]
        if high > low and distance > low:
            share = wp.min((distance - low) / (high - low), 1.0)
            out = sensor.noise_deviation[i] + share * (sensor.noise_deviation[i + 1] - sensor.noise_deviation[i])
    return out


@wp.func
def overlap(sensor: Sensor, distance: float):
    """Share of the beam that the receiver sees at a distance [m]."""
    if distance >= sensor.overlap[1]:
        return 1.0
    return wp.max((distance - sensor.overlap[0]) / (sensor.overlap[1] - sensor.overlap[0]), 0.0)


@wp.func
def received(sensor: Sensor, echoes: Echoes, echo: Echo, state: wp.uint32):
    """The echoes with one more, if it is detected; its range as reported."""
    out = echoes
    own = wp.rand_init(int(state), 1)  # a sequence apart from the caller's, whose state this is
    level = echo.level + sensor.power_noise * wp.randn(own)
    noise = wp.randn(own)
    if level >= sensor.threshold:
        told = Echo()
        told.power = echo.power
        told.level = echo.level
        told.instance = echo.instance
        told.kind = echo.kind
        told.true_range = echo.range
        told.range = echo.range + deviation(sensor, echo.range) * noise
        told.range = wp.round(told.range / sensor.resolution) * sensor.resolution
        out.count = echoes.count + 1
        if out.count == 1 or echo.range < out.first.true_range:
            out.first = told
        if out.count == 1 or echo.range > out.last.true_range:
            out.last = told
        if out.count == 1 or echo.level > out.strongest.level:
            out.strongest = told
    return out


@wp.func
def share_beyond(ranges: LEVELS, count: int, subrays: int, distance: float):
    """Share of a beam's sub-rays that no surface stops before a distance."""
    stopped = int(0)
    for k in range(count):
        if ranges[k] < distance:
            stopped += 1
    return 1.0 - float(stopped) / float(subrays)


@wp.func
def echoes_of_air(sensor: Sensor, air: Air, ranges: LEVELS, count: int, echoes: Echoes, state: wp.uint32):
    """Echoes of drops and flakes, a pulse's length after the other: their number in each is Poisson's."""
    out = echoes
    distance = sensor.min_range + 0.5 * sensor.gate
    share = float(1.0)
    while distance < air.reach and share > 0.0:
        share = share_beyond(ranges, count, sensor.subrays, distance)
        mean = air.drops * distance * distance
        found = float(wp.poisson(state, wp.min(mean, 1.0e6))) / wp.min(mean, 1.0e6)
        power = share * air.volume * found / (distance * distance) * wp.exp(-2.0 * air.extinction * distance)
        level = power * overlap(sensor, distance)
        if level >= 0.5 * sensor.threshold:
            echo = Echo()
            echo.level = level
            echo.range = distance + sensor.gate * (wp.randf(state) - 0.5)
            echo.power = power
            echo.instance = PRECIPITATION
            echo.kind = NO_CLASS
            out = received(sensor, out, echo, wp.randu(state))
        distance += sensor.gate
    return out


@wp.func
def echoes_of_surfaces(
    sensor: Sensor, ranges: LEVELS, powers: LEVELS, instances: LABELS, kinds: LABELS, count: int, echoes: Echoes,
    state: wp.uint32,
):  # fmt: skip
    """Echoes of sorted sub-rays: those within a pulse's length are one, at the mean of their ranges by power."""
    out = echoes
    begin = int(0)
    while begin < count:
        echo = Echo()
        moment = float(0.0)
        most = float(-1.0)
        end = begin
        while end < count and ranges[end] - ranges[begin] < sensor.gate:
            echo.power += powers[end]
            moment += powers[end] * (ranges[end] - ranges[begin])
            if powers[end] > most:
                most = powers[end]
                echo.instance = instances[end]
                echo.kind = kinds[end]
            end += 1
        echo.range = ranges[begin]
        if echo.power > 0.0:
            echo.range += moment / echo.power
        echo.level = echo.power * overlap(sensor, echo.range)
        out = received(sensor, out, echo, wp.randu(state))
        begin = end
    return out


@wp.func
def pose_at(times: wp.array(dtype=float), poses: wp.array2d(dtype=wp.transform), world: int, time: float):
    """Pose between two samples: positions by straight lines, rotations by normalised means."""
    low = int(0)
    high = times.shape[0] - 1
    while high - low > 1:
        middle = (low + high) / 2
        if times[middle] <= time:
            low = middle
        else:
            high = middle
    share = float(0.0)
    if high > low:
        share = wp.clamp((time - times[low]) / (times[high] - times[low]), 0.0, 1.0)
    a = poses[low, world]
    b = poses[high, world]
    p = wp.lerp(wp.transform_get_translation(a), wp.transform_get_translation(b), share)
    q = wp.transform_get_rotation(a)
    r = wp.transform_get_rotation(b)
    if wp.dot(q, r) < 0.0:
        r = -r
    return wp.transform(p, wp.normalize(q * (1.0 - share) + r * share))


@wp.struct
class Pulse:
    """A beam in the world's axes."""

    origin: wp.vec3  # [m]
    axis: wp.vec3  # unit, as left and up
    left: wp.vec3
    up: wp.vec3


@wp.func
def pulse_of(pose: wp.transform, azimuth: float, elevation: float):
    """The beam of a sensor at a pose, by its angles [rad] in the sensor's axes."""
    out = Pulse()
    ca = wp.cos(azimuth)
    sa = wp.sin(azimuth)
    ce = wp.cos(elevation)
    se = wp.sin(elevation)
    out.origin = wp.transform_get_translation(pose)
    out.axis = wp.transform_vector(pose, wp.vec3(ce * ca, ce * sa, se))
    out.left = wp.transform_vector(pose, wp.vec3(-sa, ca, 0.0))
    out.up = wp.transform_vector(pose, wp.vec3(-se * ca, -se * sa, ce))
    return out


@wp.func
def echoes_of(rays: Rays, sensor: Sensor, air: Air, pulse: Pulse, world: int, seed: int, number: int):
    """Echoes of one pulse, by the noise of a seed and the pulse's number."""
    ranges = LEVELS()
    powers = LEVELS()
    instances = LABELS()
    kinds = LABELS()
    count = int(0)
    chances = wp.rand_init(seed + 2, number)
    for k in range(sensor.subrays):
        direction = wp.normalize(pulse.axis + sensor.across[k] * pulse.left + sensor.up[k] * pulse.up)
        hit = cast(rays, pulse.origin, direction, sensor.max_range, world)
        cosine = -wp.dot(hit.normal, direction)
        if rays.leaves.tallest > 0.0:
            reach = wp.min(hit.distance, sensor.max_range)
            depth = stopped_at(rays.leaves, pulse.origin, direction, reach, 1.0 - wp.randf(chances), wp.randf(chances))
            if depth < reach:
                hit.distance = depth
                hit.instance = UNDERGROWTH
                hit.kind = rays.leaves.kind
                cosine = FACING
        if hit.instance != NOTHING and hit.distance >= sensor.min_range:
            power = rays.reflectance[hit.kind][sensor.band] * cosine / (hit.distance * hit.distance)
            power = power * wp.exp(-2.0 * air.extinction * hit.distance) / float(sensor.subrays)
            place = count
            while place > 0 and ranges[wp.max(place - 1, 0)] > hit.distance:
                ranges[place] = ranges[place - 1]
                powers[place] = powers[place - 1]
                instances[place] = instances[place - 1]
                kinds[place] = kinds[place - 1]
                place -= 1
            ranges[place] = hit.distance
            powers[place] = power
            instances[place] = hit.instance
            kinds[place] = hit.kind
            count += 1
    echoes = Echoes()
    echoes.first = nothing()
    echoes.strongest = nothing()
    echoes.last = nothing()
    state = wp.rand_init(seed, number)
    if air.reach > 0.0:
        echoes = echoes_of_air(sensor, air, ranges, count, echoes, wp.rand_init(seed + 1, number))
    return echoes_of_surfaces(sensor, ranges, powers, instances, kinds, count, echoes, state)


@wp.kernel(enable_backward=False)
def fire(
    rays: Rays,
    sensor: Sensor,
    air: Air,
    seed: int,
    # pulses
    times: wp.array(dtype=float),
    angles: wp.array(dtype=wp.vec2),
    # motion of the front frames
    pose_times: wp.array(dtype=float),
    poses: wp.array2d(dtype=wp.transform),
    # out, a column an echo: first, strongest, last
    counts: wp.array2d(dtype=int),
    out_range: wp.array3d(dtype=float),
    out_power: wp.array3d(dtype=float),
    out_instance: wp.array3d(dtype=int),
    out_kind: wp.array3d(dtype=wp.uint8),
    out_origin: wp.array2d(dtype=wp.vec3),
    out_axis: wp.array2d(dtype=wp.vec3),
):
    """A pulse of a world's lidar."""
    world, i = wp.tid()
    pulse = pulse_of(pose_at(pose_times, poses, world, times[i]) * sensor.mounting, angles[i][0], angles[i][1])
    echoes = echoes_of(rays, sensor, air, pulse, world, seed, world * times.shape[0] + i)
    counts[world, i] = echoes.count
    out_origin[world, i] = pulse.origin
    out_axis[world, i] = pulse.axis
    for k in range(3):
        echo = echoes.first
        if k == STRONGEST:
            echo = echoes.strongest
        if k == LAST:
            echo = echoes.last
        out_range[world, i, k] = echo.range
        out_power[world, i, k] = echo.power
        out_instance[world, i, k] = echo.instance
        out_kind[world, i, k] = wp.uint8(echo.kind)
