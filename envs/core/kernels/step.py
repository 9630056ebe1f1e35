"""The memory of a control step, and its beginning and end for one sub-environment."""

import warp as wp

from aoro_gym.envs.core import contacts
from aoro_gym.twin.records import Output, State

UNMEANT, WRONG_REWARD, WRONG_OBSERVATION, ANY_TERMINATED, ANY_DONE = (wp.constant(number) for number in range(5))
BEGUN, LEFT, WRONG_BEGINNING = (wp.constant(number) for number in (5, 6, 7))
"""Rows of the flags; the last ones are how many episodes begin, whether any sub-environment is left to the host to begin
another, and whether an episode began with a wrong observation in the step before."""
TERMINATED, TRUNCATED, DONE, RUNNING = (wp.constant(number) for number in range(4))
"""Rows of what a step ended with."""
OWN = wp.constant(-1)
"""Kind of a term that is a function of the user's own: it is left to the host."""
OBJECT_ROWS = wp.constant(contacts.OBJECT_ROWS)
"""Channels of twins among objects."""
FRONT_CHASSIS, REAR_CHASSIS = (wp.constant(row) for row in contacts.CHASSIS_ROWS)


@wp.struct
class StepMemory:
    """Of N sub-environments with A actions, T reward terms and D columns of the observation."""

    control_step: wp.float64  # [s]
    reasons: int  # why a task's episodes may terminate, how many
    max_steps: wp.int64  # of an episode; -1: no bound
    given: wp.array2d(dtype=float)  # (N, A) actions as they were given
    least: wp.array(dtype=float)  # (A,)
    largest: wp.array(dtype=float)  # (A,)
    commands: wp.array2d(dtype=float)  # of the twins
    outputs: wp.array3d(dtype=float)  # likewise
    state: wp.array2d(dtype=float)  # likewise
    status: wp.array(dtype=int)  # likewise
    steps: wp.array(dtype=wp.int64)  # (N,) since the episode began
    resetting: wp.array(dtype=wp.bool)  # (N,) whose episode begins in this step
    flags: wp.array(dtype=int)  # (8,)
    begun: wp.array(dtype=wp.int64)  # (N,) whose episodes begin; so many of them as the flags say
    weights: wp.array(dtype=wp.float64)  # (T,)
    reward_kinds: wp.array(dtype=int)  # (T,)
    values: wp.array2d(dtype=float)  # (T, N)
    rewards: wp.array(dtype=float)  # (N,)
    ending: wp.array(dtype=wp.int64)  # (N,)
    ended: wp.array2d(dtype=wp.bool)  # (4, N)
    keeps: wp.array(dtype=wp.bool)  # (N,) whose observation stays as it was
    observation_kinds: wp.array(dtype=int)  # of each term
    columns: wp.array(dtype=int)  # its first one
    lowest: wp.array(dtype=float)  # (D,)
    highest: wp.array(dtype=float)  # (D,)
    observation: wp.array2d(dtype=float)  # (N, D)


@wp.kernel(enable_backward=False, module="aoro_gym.envs.core.kernels")
def clear_flags(m: StepMemory):
    """None is set, at the beginning of a step, but for a first observation that was wrong, which the host has not read: no
    episode begins where one of a step is. One thread."""
    wrong = m.flags[WRONG_OBSERVATION] * wp.min(m.flags[BEGUN], 1)
    for row in range(m.flags.shape[0]):
        m.flags[row] = 0
    m.flags[WRONG_BEGINNING] = wrong


@wp.func
def taken_action(m: StepMemory, i: int, column: int):
    """An action within its space; 0 for what is not finite, which is told."""
    value = m.given[i, column]
    if not wp.isfinite(value):
        m.flags[UNMEANT] = 1
        value = float(0.0)
    return wp.clamp(value, m.least[column], m.largest[column])


@wp.func
def begin_step(m: StepMemory, i: int):
    """Time [s] of the episode at the end of this step; what a twin that diverged shows is made numbers."""
    if m.status[i] != 0:
        for frame in range(m.outputs.shape[0]):
            for channel in range(m.outputs.shape[1]):
                if not wp.isfinite(m.outputs[frame, channel, i]):
                    m.outputs[frame, channel, i] = 0.0
    m.steps[i] = m.steps[i] + wp.int64(1)
    return wp.float64(m.steps[i]) * m.control_step


@wp.func
def counts(m: StepMemory, i: int):
    """Whether rewards of this step count: an episode was running, and the twin did not diverge."""
    return not m.resetting[i] and m.status[i] == 0


@wp.func
def end_step(m: StepMemory, i: int, reward: float, terminal: wp.int64, time_limit: bool):
    """Write the reward, and how the step ends."""
    running = not m.resetting[i]
    diverged = m.status[i] != 0
    if not wp.isfinite(reward):
        m.flags[WRONG_REWARD] = 1
    m.rewards[i] = reward
    ending = terminal
    if diverged:
        ending = wp.int64(m.status[i] + m.reasons - 1)
    if not running:
        ending = wp.int64(0)
    late = time_limit
    if m.max_steps >= wp.int64(0) and m.steps[i] >= m.max_steps:
        late = True
    terminated = ending != wp.int64(0)
    truncated = late and running and not terminated
    m.ending[i] = ending
    m.ended[TERMINATED, i] = terminated
    m.ended[TRUNCATED, i] = truncated
    m.ended[DONE, i] = terminated or truncated
    m.ended[RUNNING, i] = running
    m.keeps[i] = diverged and running
    if terminated:
        m.flags[ANY_TERMINATED] = 1
    if terminated or truncated:
        m.flags[ANY_DONE] = 1


@wp.func
def force_at(m: StepMemory, frame: int, row: int, i: int):
    """Length of the vector whose components stand in the outputs from ``row`` on."""
    x = m.outputs[frame, row, i]
    y = m.outputs[frame, row + 1, i]
    z = m.outputs[frame, row + 2, i]
    return wp.sqrt(x * x + y * y + z * z)


@wp.func
def chassis_force(m: StepMemory, i: int):
    """Largest force [N] of objects on either chassis in the step; see :func:`aoro_gym.envs.core.contacts.chassis_force`."""
    largest = float(0.0)
    if m.outputs.shape[1] == OBJECT_ROWS:
        for frame in range(m.outputs.shape[0]):
            largest = wp.max(largest, wp.max(force_at(m, frame, FRONT_CHASSIS, i), force_at(m, frame, REAR_CHASSIS, i)))
    return largest


@wp.func
def observe_value(m: StepMemory, i: int, column: int, value: wp.float64):
    """Write a column of the observation, within its bounds."""
    if not wp.isfinite(value):
        m.flags[WRONG_OBSERVATION] = 1
        m.observation[i, column] = float(value)
    else:
        m.observation[i, column] = wp.clamp(float(value), m.lowest[column], m.highest[column])


@wp.func
def beginning(m: StepMemory, k: int):
    """The ``k``-th sub-environment whose episode begins; −1 if there are fewer."""
    if k >= m.flags[BEGUN]:
        return int(-1)
    return int(m.begun[k])


@wp.kernel(enable_backward=False, module="aoro_gym.envs.core.kernels")
def rest_outputs(m: StepMemory, known: wp.array2d(dtype=float)):
    """What is known of machines at rest, until a step gives the outputs of those whose episodes begin.

    ``known`` is (5, N): joint angle [rad], pressure in both ports and at the pump [Pa], engine speed [rad/s].
    """
    i = beginning(m, wp.tid())
    if i < 0:
        return
    x = wp.float64(m.state[State.QX, i])
    y = wp.float64(m.state[State.QY, i])
    z = wp.float64(m.state[State.QZ, i])
    w = wp.float64(m.state[State.QW, i])
    one = wp.float64(1.0)
    two = wp.float64(2.0)
    for frame in range(m.outputs.shape[0]):
        for channel in range(m.outputs.shape[1]):
            m.outputs[frame, channel, i] = 0.0
        for axis in range(3):
            m.outputs[frame, Output.POSITION_X + axis, i] = m.state[State.X + axis, i]
        m.outputs[frame, Output.ROLL, i] = float(wp.atan2(two * (y * z + w * x), one - two * (x * x + y * y)))
        m.outputs[frame, Output.PITCH, i] = float(-wp.asin(wp.clamp(two * (x * z - w * y), -one, one)))
        m.outputs[frame, Output.YAW, i] = float(wp.atan2(two * (x * y + w * z), one - two * (y * y + z * z)))
        for wheel in range(4):
            m.outputs[frame, Output.ARM_ANGLE_FL + wheel, i] = m.state[State.ARM_FL + wheel, i]
        m.outputs[frame, Output.JOINT_ANGLE, i] = known[0, i]
        m.outputs[frame, Output.PRESSURE_A, i] = known[1, i]
        m.outputs[frame, Output.PRESSURE_B, i] = known[2, i]
        m.outputs[frame, Output.PUMP_PRESSURE, i] = known[3, i]
        m.outputs[frame, Output.ENGINE_SPEED, i] = known[4, i]
