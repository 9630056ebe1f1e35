"""What the kernels of turning know: the memory of a task, shared."""

import warp as wp

from aoro_gym.envs.core.kernels.joint import JointMemory
from aoro_gym.sensors.kernels.pressure import PressureMemory


@wp.struct
class Goals:
    """Targets and judgement, (N,) unless said otherwise; as the fields of the task."""

    table: wp.array2d(dtype=float)  # (N, targets) [rad]
    until: wp.array2d(dtype=wp.int64)  # (N, targets) step that ends each
    cursor: wp.array(dtype=wp.int64)
    step: wp.array(dtype=wp.int64)
    set_at: wp.array(dtype=wp.int64)
    target: wp.array(dtype=float)
    approach: wp.array(dtype=float)
    angle: wp.array(dtype=float)
    inside: wp.array(dtype=wp.int64)
    settled: wp.array(dtype=wp.int64)
    missed: wp.array(dtype=wp.int64)
    largest_overshoot: wp.array(dtype=float)
    signals: wp.array2d(dtype=float)  # (M, N) newest first
    flows: wp.array2d(dtype=float)  # (3, N) newest first
    pursued: wp.array2d(dtype=float)  # (3, N)
    pursued_age: wp.array(dtype=wp.float64)


GOALS = tuple(Goals.vars)
"""Fields of the task that :class:`Goals` shares, by their names less the underscore."""


@wp.struct
class Measured:
    """Sensors, and what they last read."""

    joint: JointMemory
    with_pressures: int
    pressure: PressureMemory
    noise: wp.array(dtype=float)  # (N,) of the pressures
    pressures: wp.array2d(dtype=float)  # (N, 3)


@wp.struct
class Rules:
    """How a turn is judged."""

    tolerance: float  # [rad]
    dwell: wp.int64  # steps within the tolerance that settle
    hold: wp.float64  # [s] shortest


@wp.struct
class Told:
    """What is logged beside the reward."""

    floats: wp.array2d(dtype=float)  # (3, N)
    integers: wp.array2d(dtype=wp.int64)  # (2, N)
    success: wp.array(dtype=wp.bool)  # (N,)
