"""How a step went: reward terms by name, ends, and what is logged, for one vehicle."""

import warp as wp

from aoro_gym.envs.core.contacts import chassis_contact
from aoro_gym.envs.core.kernels.step import OWN, StepMemory, chassis_force, counts, end_step
from aoro_gym.envs.levelling import rewards
from aoro_gym.envs.levelling.kernels.memory import Frames, Limits
from aoro_gym.envs.path_tracking.kernels.judge import END_OF_PATH, ending_of, mean_load, weigh
from aoro_gym.envs.path_tracking.kernels.judge import tell as tell_of_drive
from aoro_gym.envs.path_tracking.kernels.memory import Control, Courses, Driving, Rules, Sensing, Told
from aoro_gym.envs.path_tracking.kernels.sense import last
from aoro_gym.twin.records import Output, State

ZERO = wp.constant(wp.float64(0.0))
ONE = wp.constant(wp.float64(1.0))
TWO = wp.constant(wp.float64(2.0))
FOUR = wp.constant(wp.float64(4.0))
QUARTER = wp.constant(wp.float64(0.25))
TILT_SCALE, UNEVENNESS_SCALE, RATE_SCALE, SUNK_SCALE, LIFTED, TIPPING_RESERVE, FULL_POWER = (
    wp.constant(wp.float64(value))
    for value in (
        rewards.TILT_SCALE, rewards.UNEVENNESS_SCALE, rewards.RATE_SCALE, rewards.SUNK_SCALE, rewards.LIFTED,
        rewards.TIPPING_RESERVE, rewards.FULL_POWER,
    )
)  # fmt: skip

REWARDED = (
    rewards.level, rewards.even, rewards.swaying, rewards.lifted, rewards.tipping, rewards.height, rewards.energy,
    rewards.signal_change, rewards.elapsed, chassis_contact, rewards.failure,
)  # fmt: skip
"""Functions of reward terms that :func:`reward_of` knows, by their kinds."""

LEVEL, EVEN, SWAYING, LIFTED_WHEELS, TIPPING, HEIGHT, ENERGY, SIGNAL_CHANGE, ELAPSED, CHASSIS_CONTACT, FAILURE = (
    wp.constant(kind) for kind in range(len(REWARDED))
)


@wp.func
def squared(value: wp.float64):
    """Its square."""
    return value * value


@wp.func
def arm_way(m: StepMemory, f: Frames, i: int):
    """Mean way [m] of a wheel against its frame over the step."""
    total = wp.float64(0.0)
    for wheel in range(4):
        total += wp.abs(wp.float64(m.state[State.ARM_RATE_FL + wheel, i]))
    return QUARTER * total * f.arm_length[i] * m.control_step


@wp.func
def lifted_share(f: Frames, i: int):
    """Share [-] of the wheels that are lifted."""
    count = wp.float64(0.0)
    for wheel in range(4):
        if f.loads[wheel, i] < LIFTED * f.weight[i] * f.rest_share[wheel, i]:
            count += ONE
    return QUARTER * count


@wp.func
def sunk(m: StepMemory, f: Frames, i: int):
    """Mean height [m] that the frames lack."""
    total = wp.float64(0.0)
    for wheel in range(4):
        total += last(m, Output.ARM_ANGLE_FL + wheel, i) - f.rest_angles[wheel, i]
    return QUARTER * total * f.arm_length[i]


@wp.func
def tilt_of(m: StepMemory, i: int):
    """Angle [rad] of the front frame's vertical axis off the world's."""
    roll = last(m, Output.ROLL, i)
    pitch = last(m, Output.PITCH, i)
    across = wp.sin(roll)
    along = wp.cos(roll) * wp.sin(pitch)
    return wp.atan2(wp.sqrt(across * across + along * along), wp.cos(roll) * wp.cos(pitch))


@wp.func
def unevenness_of(f: Frames, i: int):
    """What the loads differ by from their shares at rest [-]."""
    total = wp.max(f.loads[0, i] + f.loads[1, i] + f.loads[2, i] + f.loads[3, i], ONE)
    off = wp.float64(0.0)
    for wheel in range(4):
        off += squared(f.loads[wheel, i] - total * f.rest_share[wheel, i])
    return TWO * wp.sqrt(off) / total


@wp.func
def pump_power(m: StepMemory, i: int):
    """Mean of pressure times flow of pump 2 over the step [W]."""
    total = wp.float64(0.0)
    for frame in range(m.outputs.shape[0]):
        total += wp.float64(m.outputs[frame, Output.PUMP_PRESSURE, i] * m.outputs[frame, Output.PUMP_FLOW, i])
    return total / wp.float64(m.outputs.shape[0])


@wp.func
def weigh_frames(m: StepMemory, f: Frames, i: int):
    """Loads, tilt and power, and sums over the episode."""
    for wheel in range(4):
        f.loads[wheel, i] = mean_load(m, wheel, i)
    f.unevenness[i] = unevenness_of(f, i)
    f.tilt[i] = tilt_of(m, i)
    f.power[i] = pump_power(m, i)
    f.work[i] = f.work[i] + f.power[i] * m.control_step
    f.travel[i] = f.travel[i] + arm_way(m, f, i)
    f.lifted[i] = f.lifted[i] + lifted_share(f, i)
    f.tilt_squares[i] = f.tilt_squares[i] + squared(f.tilt[i])
    f.load_squares[i] = f.load_squares[i] + squared(f.unevenness[i])


@wp.func
def tilt_rate(m: StepMemory, i: int):
    """Magnitude of roll and pitch rate together [rad/s]."""
    return wp.sqrt(squared(wp.float64(m.state[State.WX, i])) + squared(wp.float64(m.state[State.WY, i])))


@wp.func
def signal_change(f: Frames, i: int):
    """Mean of the squared changes of the four signals."""
    total = float(0.0)
    for wheel in range(4):
        change = f.signals[0, i, wheel] - f.signals[1, i, wheel]
        total += change * change
    return wp.float64(0.25 * total)


@wp.func
def reward_of(kind: int, m: StepMemory, d: Driving, f: Frames, pace: wp.float64, i: int):
    """A reward term before its weight; see :mod:`aoro_gym.envs.levelling.rewards`."""
    if kind == LEVEL:
        return pace / (ONE + squared(f.tilt[i] / TILT_SCALE))
    if kind == EVEN:
        return pace / (ONE + squared(f.unevenness[i] / UNEVENNESS_SCALE))
    if kind == SWAYING:
        return wp.min(squared(tilt_rate(m, i) / RATE_SCALE), FOUR)
    if kind == LIFTED_WHEELS:
        return lifted_share(f, i)
    if kind == TIPPING:
        return squared(wp.clamp((TIPPING_RESERVE - d.tipping_margin[i]) / TIPPING_RESERVE, ZERO, ONE))
    if kind == HEIGHT:
        return wp.min(squared(sunk(m, f, i) / SUNK_SCALE), FOUR)
    if kind == ENERGY:
        return f.power[i] / FULL_POWER
    if kind == SIGNAL_CHANGE:
        return signal_change(f, i)
    if kind == ELAPSED:
        return ONE
    if kind == CHASSIS_CONTACT:
        return wp.where(chassis_force(m, i) > 0.0, ONE, ZERO)
    return wp.where(d.ending[i] > END_OF_PATH, ONE, ZERO)


@wp.func
def tell(d: Driving, f: Frames, u: Limits, t: Told, frames: wp.array2d(dtype=wp.float64), i: int):
    """What is logged beside what path tracking tells; see ``Levelling.info``."""
    steps = wp.float64(wp.max(d.step[i], wp.int64(1)))
    tilt = wp.sqrt(f.tilt_squares[i] / steps)
    unevenness = wp.sqrt(f.load_squares[i] / steps)
    frames[0, i] = f.tilt[i]
    frames[1, i] = tilt
    frames[2, i] = f.unevenness[i]
    frames[3, i] = unevenness
    frames[4, i] = f.lifted[i] / steps
    frames[5, i] = f.work[i]
    frames[6, i] = f.travel[i]
    t.success[i] = t.success[i] and tilt <= u.tilt and unevenness <= u.unevenness


@wp.kernel(enable_backward=False, module="aoro_gym.envs.levelling.kernels")
def judge(
    m: StepMemory,
    c: Courses,
    k: Control,
    s: Sensing,
    d: Driving,
    r: Rules,
    t: Told,
    f: Frames,
    u: Limits,
    frames: wp.array2d(dtype=wp.float64),
):
    """Reward the step, end it, and tell of it."""
    i = wp.tid()
    weigh(m, d, i)
    weigh_frames(m, f, i)
    d.ending[i] = ending_of(m, c, d, r, i)
    count = counts(m, i)
    pace = d.progress[i] / (m.control_step * r.working_speed)
    total = float(0.0)
    for term in range(m.weights.shape[0]):
        kind = m.reward_kinds[term]
        if kind != OWN:
            value = float(0.0)
            if count:
                value = float(m.weights[term] * reward_of(kind, m, d, f, pace, i))
            m.values[term, i] = value
            total += value
    end_step(m, i, total, d.ending[i], d.step[i] >= d.steps_allowed[i])
    tell_of_drive(m, k, s, d, t, i)
    tell(d, f, u, t, frames, i)
