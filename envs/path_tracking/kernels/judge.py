"""How a step went: reward terms by name, ends, and what is logged, for one vehicle."""

import warp as wp

from aoro_gym.envs.core.contacts import chassis_contact
from aoro_gym.envs.core.kernels.step import OWN, StepMemory, chassis_force, counts, end_step
from aoro_gym.envs.path_tracking import rewards
from aoro_gym.envs.path_tracking.kernels.geometry import known_at
from aoro_gym.envs.path_tracking.kernels.memory import Control, Courses, Driving, Rules, Sensing, Told
from aoro_gym.twin.records import Output

ZERO = wp.constant(wp.float64(0.0))
ONE = wp.constant(wp.float64(1.0))
FOUR = wp.constant(wp.float64(4.0))
CROSS_TRACK_SCALE = wp.constant(wp.float64(rewards.CROSS_TRACK_SCALE))
EXACT_SCALE = wp.constant(wp.float64(rewards.EXACT_SCALE))
BRISK = wp.constant(wp.float64(rewards.BRISK))
TIPPING_RESERVE = wp.constant(wp.float64(rewards.TIPPING_RESERVE))
FULL_POWER = wp.constant(wp.float64(rewards.FULL_POWER))

REWARDED = (
    rewards.progress, rewards.cross_track_cost, rewards.exact_progress, rewards.signal_change, rewards.tipping,
    rewards.energy, rewards.elapsed, rewards.finish, chassis_contact, rewards.failure,
)  # fmt: skip
"""Functions of reward terms that :func:`reward_of` knows, by their kinds."""

(
    PROGRESS, CROSS_TRACK, EXACT_PROGRESS, SIGNAL_CHANGE, TIPPING, ENERGY, ELAPSED, FINISH, CHASSIS_CONTACT, FAILURE,
) = (wp.constant(kind) for kind in range(len(REWARDED)))  # fmt: skip
END_OF_PATH, ROLLED_OVER, LEFT_TERRAIN, LOST_PATH, STUCK, HIT_OBJECT = (
    wp.constant(wp.int64(reason)) for reason in range(1, 7)
)
"""As in ``TERMINATION_REASONS``."""


@wp.func
def signal_change(d: Driving, i: int):
    """Sum of the squared changes of all signals."""
    total = float(0.0)
    for column in range(d.actions.shape[2]):
        change = d.actions[0, i, column] - d.actions[1, i, column]
        total += change * change
    return wp.float64(total)


@wp.func
def reward_of(kind: int, m: StepMemory, d: Driving, pace: wp.float64, i: int):
    """A reward term before its weight; see :mod:`aoro_gym.envs.path_tracking.rewards`."""
    if kind == PROGRESS:
        return pace
    if kind == CROSS_TRACK:
        off = d.cross_track[i] / CROSS_TRACK_SCALE
        return wp.min(off * off, FOUR)
    if kind == EXACT_PROGRESS:
        off = d.cross_track[i] / EXACT_SCALE
        return (pace - wp.float64(2.0) * wp.max(pace - BRISK, ZERO)) / (ONE + off * off)
    if kind == SIGNAL_CHANGE:
        return signal_change(d, i)
    if kind == TIPPING:
        lacks = wp.clamp((TIPPING_RESERVE - d.tipping_margin[i]) / TIPPING_RESERVE, ZERO, ONE)
        return lacks * lacks
    if kind == ENERGY:
        return d.power[i] / FULL_POWER
    if kind == ELAPSED:
        return ONE
    if kind == FINISH:
        return wp.where(d.ending[i] == END_OF_PATH, ONE, ZERO)
    if kind == CHASSIS_CONTACT:
        return wp.where(chassis_force(m, i) > 0.0, ONE, ZERO)
    return wp.where(d.ending[i] > END_OF_PATH, ONE, ZERO)


@wp.func
def mean_load(m: StepMemory, wheel: int, i: int):
    """Mean load [N] of a wheel over the step."""
    total = wp.float64(0.0)
    for frame in range(m.outputs.shape[0]):
        total += wp.float64(m.outputs[frame, Output.WHEEL_LOAD_FL + wheel, i])
    return total / wp.float64(m.outputs.shape[0])


@wp.func
def weigh(m: StepMemory, d: Driving, i: int):
    """Tipping margin, engine power, and sums over the episode."""
    fl = mean_load(m, 0, i)
    fr = mean_load(m, 1, i)
    rl = mean_load(m, 2, i)
    rr = mean_load(m, 3, i)
    total = wp.max(fl + fr + rl + rr, ONE)
    across = wp.abs(fl + rl - fr - rr)
    along = wp.abs(fl + fr - rl - rr)
    d.tipping_margin[i] = ONE - wp.max(across, along) / total
    power = wp.float64(0.0)
    for frame in range(m.outputs.shape[0]):
        power += wp.float64(m.outputs[frame, Output.ENGINE_TORQUE, i] * m.outputs[frame, Output.ENGINE_SPEED, i])
    power = power / wp.float64(m.outputs.shape[0])
    d.power[i] = power
    d.work[i] = d.work[i] + power * m.control_step
    d.squares[i] = d.squares[i] + d.cross_track[i] * d.cross_track[i]


@wp.func
def ending_of(m: StepMemory, c: Courses, d: Driving, r: Rules, i: int):
    """Why the episode terminates; of several reasons the worst."""
    if d.s[i] >= d.mark_s[i] + r.stuck_distance:
        d.mark_s[i] = d.s[i]
        d.mark_step[i] = d.step[i]
    frame = m.outputs.shape[0] - 1
    course = d.course[i]
    front = known_at(c, course, d.reference[i, 0], d.reference[i, 1])
    rear = known_at(c, course, d.rear_axle[i, 0], d.rear_axle[i, 1])
    ending = wp.int64(0)
    if d.s[i] >= d.length[i] - r.end_tolerance:
        ending = END_OF_PATH
    if wp.float64(d.step[i] - d.mark_step[i]) * m.control_step >= r.stuck_time:
        ending = STUCK
    if wp.abs(d.cross_track[i]) > r.path_limit:
        ending = LOST_PATH
    if not (front and rear):
        ending = LEFT_TERRAIN
    if chassis_force(m, i) > r.chassis_force_limit:
        ending = HIT_OBJECT
    if wp.cos(m.outputs[frame, Output.ROLL, i]) * wp.cos(m.outputs[frame, Output.PITCH, i]) < r.upright:
        ending = ROLLED_OVER
    return ending


@wp.func
def tell(m: StepMemory, k: Control, s: Sensing, d: Driving, t: Told, i: int):
    """What is logged; see ``PathTracking.info``."""
    steps = wp.float64(wp.max(d.step[i], wp.int64(1)))
    t.floats[0, i] = d.cross_track[i]
    t.floats[1, i] = d.heading_error[i]
    t.floats[2, i] = wp.sqrt(d.squares[i] / steps)
    t.floats[3, i] = (d.s[i] - d.start_s[i]) / (steps * m.control_step)
    t.floats[4, i] = d.length[i] - d.s[i]
    t.floats[5, i] = d.tipping_margin[i]
    t.floats[6, i] = d.work[i]
    t.integers[0, i] = wp.int64(k.gear[i])
    t.integers[1, i] = s.gps.state[i]
    t.integers[2, i] = d.course[i]
    t.integers[3, i] = d.path_number[i]
    t.success[i] = d.ending[i] == END_OF_PATH and m.status[i] == 0


@wp.kernel(enable_backward=False, module="aoro_gym.envs.path_tracking.kernels")
def judge(m: StepMemory, c: Courses, k: Control, s: Sensing, d: Driving, r: Rules, t: Told):
    """Reward the step, end it, and tell of it."""
    i = wp.tid()
    weigh(m, d, i)
    d.ending[i] = ending_of(m, c, d, r, i)
    count = counts(m, i)
    pace = d.progress[i] / (m.control_step * r.working_speed)
    total = float(0.0)
    for term in range(m.weights.shape[0]):
        kind = m.reward_kinds[term]
        if kind != OWN:
            value = float(0.0)
            if count:
                value = float(m.weights[term] * reward_of(kind, m, d, pace, i))
            m.values[term, i] = value
            total += value
    end_step(m, i, total, d.ending[i], d.step[i] >= d.steps_allowed[i])
    tell(m, k, s, d, t, i)
