"""The kernels of a task, and their memory, put together."""

from typing import Any

from aoro_gym.envs.core.kernel_step import TaskKernels, shared, told_memory
from aoro_gym.envs.core.kernels.joint import joint_memory
from aoro_gym.envs.core.kernels.step import StepMemory
from aoro_gym.envs.turning.kernels.judge import REWARDED, judge
from aoro_gym.envs.turning.kernels.memory import GOALS, Goals, Measured, Rules, Told
from aoro_gym.envs.turning.kernels.observe import OBSERVED, observe
from aoro_gym.envs.turning.kernels.sense import act, rest, sense
from aoro_gym.execution.array_api import Arrays
from aoro_gym.sensors.kernels.pressure import pressure_memory

LOGGED = (
    ("target", "joint_angle", "largest_overshoot"),
    ("targets_settled", "targets_missed"),
    ("is_success",),
)
"""Rows of :class:`aoro_gym.envs.turning.kernels.memory.Told`, by array."""


def turning_kernels(task: Any, memory: StepMemory, arrays: Arrays) -> TaskKernels:
    """A control step of ``task``, an allocated :class:`aoro_gym.envs.turning.task.Turning` whose arrays are ``arrays``, with
    the ``memory`` of the step."""
    goals = shared(Goals(), task, GOALS, arrays, "_")
    measured = _measured(task, arrays)
    rules = Rules()
    rules.tolerance, rules.dwell, rules.hold = task.config.tolerance, task.dwell_steps, task.config.hold[0]
    told, logged = told_memory(Told(), LOGGED, len(task._target), arrays, arrays.xp.float32)
    told_at_rest, begun = told_memory(Told(), LOGGED, len(task._target), arrays, arrays.xp.float32)
    return TaskKernels(
        before=[(act, [memory, goals])],
        after=[(sense, [memory, goals, measured]), (judge, [memory, goals, rules, told])],
        rest=(rest, [memory, goals, measured, rules, told_at_rest]),
        observe=(observe, [memory, goals, measured]),
        rewarded=REWARDED,
        observed=OBSERVED,
        logged=logged,
        begun=begun,
    )


def _measured(task: Any, arrays: Arrays) -> Measured:
    """The sensors of ``task``."""
    out = Measured()
    out.joint, out.noise = joint_memory(task._joint, arrays), arrays.shared(task._noise)
    out.with_pressures = int(task._pressure_sensor is not None)
    if task._pressure_sensor is not None:
        out.pressure, out.pressures = pressure_memory(task._pressure_sensor, arrays), arrays.shared(task._pressures)
    return out
