"""The kernels of a task, and their memory, put together."""

from typing import Any

from aoro_gym.envs.core.kernel_step import TaskKernels, shared, told_memory
from aoro_gym.envs.core.kernels.step import StepMemory
from aoro_gym.envs.levelling.kernels.act import act
from aoro_gym.envs.levelling.kernels.judge import REWARDED, judge
from aoro_gym.envs.levelling.kernels.memory import (
    FRAMES,
    Frames,
    Limits,
    arms_memory,
    driver_memory,
    ground_memory,
)
from aoro_gym.envs.levelling.kernels.observe import OBSERVED, observe
from aoro_gym.envs.levelling.kernels.sense import rest, sense
from aoro_gym.envs.path_tracking.kernels.memory import Told
from aoro_gym.envs.path_tracking.kernels.step import LOGGED as LOGGED_OF_DRIVE
from aoro_gym.envs.path_tracking.kernels.step import vehicles
from aoro_gym.execution.array_api import Array, Arrays

LOGGED = ("tilt", "tilt_rms", "unevenness", "unevenness_rms", "lifted_share", "pump_work", "arm_way")
"""Rows of what :func:`aoro_gym.envs.levelling.kernels.judge.tell` tells."""
LOGGED_BESIDE = (
    ("cross_track",), ("cross_track_rms", "mean_speed", "remaining", "tipping_margin", "engine_work"), ("terrain", "path"),
    ("is_success",),
)  # fmt: skip
"""What of path tracking is told, too; names that follow each other there, in the order of ``Levelling.info``."""


def levelling_kernels(task: Any, memory: StepMemory, arrays: Arrays, *, reach: float) -> TaskKernels:
    """A control step of ``task``.

    Args:
        task: Of :class:`aoro_gym.envs.levelling.task.Levelling`, allocated.
        memory: Of the step.
        arrays: Where the task's arrays live.
        reach: See :func:`aoro_gym.envs.path_tracking.kernels.step.path_tracking_kernels`.
    """
    count, config = len(task._tilt), task.config
    courses, control, measures, sensing, driving, rules = vehicles(task.driving, arrays, reach)
    driver, frames = driver_memory(config.driver), shared(Frames(), task, FRAMES, arrays, "_")
    arms, ground = arms_memory(task._sensors, arrays), ground_memory(task._ground, config.ground_noise, arrays)
    limits = Limits()
    limits.tilt, limits.unevenness = config.tilt_limit, config.unevenness_limit
    told, logged, frames_told = _told(count, arrays)
    told_at_rest, begun, frames_at_rest = _told(count, arrays)
    return TaskKernels(
        before=[(act, [memory, courses, control, sensing, measures, driving, rules, driver, frames])],
        after=[
            (sense, [memory, courses, measures, sensing, driving, rules, arms, ground]),
            (judge, [memory, courses, control, sensing, driving, rules, told, frames, limits, frames_told]),
        ],
        rest=(
            rest,
            [
                memory, courses, control, measures, sensing, driving, rules, arms, ground, told_at_rest, frames, limits,
                frames_at_rest,
            ],
        ),
        observe=(observe, [memory, measures, sensing, arms, ground, frames]),
        rewarded=REWARDED,
        observed=OBSERVED,
        logged=logged,
        begun=begun,
    )  # fmt: skip


def _told(count: int, arrays: Arrays) -> tuple[Told, list[tuple[Any, Array]], Any]:
    """What is told of ``count`` vehicles: of the drive, what is logged of all, and the rest of it, shared."""
    told, of_drive = told_memory(Told(), LOGGED_OF_DRIVE, count, arrays)
    logged = arrays.zeros((len(LOGGED), count))
    return told, [(LOGGED, logged), *(_rows(of_drive, names) for names in LOGGED_BESIDE)], arrays.shared(logged)


def _rows(logged: list[tuple[Any, Array]], names: tuple[str, ...]) -> tuple[tuple[str, ...], Array]:
    """``names`` of what is ``logged``, which follow each other there, and their rows."""
    known, array = next(each for each in logged if names[0] in each[0])
    first = known.index(names[0])
    return names, array[first : first + len(names)]
