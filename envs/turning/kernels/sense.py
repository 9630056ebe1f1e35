"""Commands and measurements of one joint."""

import warp as wp

from aoro_gym.envs.core.kernels.joint import rest_joint, sense_joint
from aoro_gym.envs.core.kernels.step import StepMemory, begin_step, beginning, taken_action
from aoro_gym.envs.turning.kernels.judge import tell
from aoro_gym.envs.turning.kernels.memory import Goals, Measured, Rules, Told
from aoro_gym.sensors.kernels.pressure import pressure_shown
from aoro_gym.twin.records import Command, Output

ZERO = wp.constant(wp.float64(0.0))


@wp.func
def last(m: StepMemory, channel: int, i: int):
    """An output of a twin at the end of the step."""
    return m.outputs[m.outputs.shape[0] - 1, channel, i]


@wp.func
def sense_pressure(m: StepMemory, s: Measured, i: int, sensor: int, channel: int, time: wp.float64):
    """Read the sensor of a channel."""
    true = wp.float64(last(m, channel, i))
    shown = pressure_shown(s.pressure, sensor, i, true, time)
    s.pressures[i, sensor] = float(true + wp.float64(s.noise[i]) * (shown - true))


@wp.func
def sense_pressures(m: StepMemory, s: Measured, i: int, time: wp.float64):
    """Ports A and B and the pump, where they are observed."""
    if s.with_pressures != 0:
        sense_pressure(m, s, i, 0, Output.PRESSURE_A, time)
        sense_pressure(m, s, i, 1, Output.PRESSURE_B, time)
        sense_pressure(m, s, i, 2, Output.PUMP_PRESSURE, time)


@wp.kernel(enable_backward=False, module="aoro_gym.envs.turning.kernels")
def act(m: StepMemory, g: Goals):
    """Command the twins, and remember the action."""
    i = wp.tid()
    memory = g.signals.shape[0]
    for age in range(memory - 1):
        g.signals[memory - 1 - age, i] = g.signals[memory - 2 - age, i]
    g.signals[0, i] = taken_action(m, i, 0)
    m.commands[Command.STEERING_SIGNAL, i] = g.signals[0, i]


@wp.kernel(enable_backward=False, module="aoro_gym.envs.turning.kernels")
def sense(m: StepMemory, g: Goals, s: Measured):
    """Read all sensors at the end of the step."""
    i = wp.tid()
    time = begin_step(m, i)
    g.step[i] = g.step[i] + wp.int64(1)
    sense_joint(m, s.joint, i, time)
    sense_pressures(m, s, i, time)
    # the channel is positive in the direction of the commanded turn
    rate = last(m, Output.JOINT_RATE, i)
    flow = wp.abs(last(m, Output.JOINT_FLOW, i))
    if rate < 0.0:
        flow = -flow
    if rate == 0.0:
        flow = 0.0
    g.flows[2, i] = g.flows[1, i]
    g.flows[1, i] = g.flows[0, i]
    g.flows[0, i] = flow
    g.angle[i] = last(m, Output.JOINT_ANGLE, i)


@wp.kernel(enable_backward=False, module="aoro_gym.envs.turning.kernels")
def rest(m: StepMemory, g: Goals, s: Measured, r: Rules, t: Told):
    """First measurements of the joints whose episodes begin, at rest, and what is told of them."""
    i = beginning(m, wp.tid())
    if i >= 0:
        rest_joint(s.joint, i, wp.float64(g.angle[i]))
        sense_pressures(m, s, i, ZERO)
        tell(m, g, r, t, i)
