"""The kernels of a task, and their memory, put together."""

import math
from typing import Any, NamedTuple

import warp as wp

from aoro_gym.envs.core.kernel_step import TaskKernels, shared, told_memory
from aoro_gym.envs.core.kernels.step import StepMemory
from aoro_gym.envs.path_tracking.assistance import GEAR_DISPLACEMENT
from aoro_gym.envs.path_tracking.kernels.act import act
from aoro_gym.envs.path_tracking.kernels.filtered import rest_filtered, sense_filtered
from aoro_gym.envs.path_tracking.kernels.judge import REWARDED, judge
from aoro_gym.envs.path_tracking.kernels.memory import (
    DRIVING,
    Control,
    Courses,
    Driving,
    Rules,
    Sensing,
    Told,
    Vehicle,
    courses_memory,
    sensing_memory,
    vehicle_memory,
)
from aoro_gym.envs.path_tracking.kernels.observe import OBSERVED, observe
from aoro_gym.envs.path_tracking.kernels.sense import rest, sense
from aoro_gym.execution.array_api import Arrays
from aoro_gym.sensors.kernels.noise import constants
from aoro_gym.sensors.pose_filter import PoseFilter

LOGGED = (
    ("cross_track", "heading_error", "cross_track_rms", "mean_speed", "remaining", "tipping_margin", "engine_work"),
    ("gear", "gps_quality", "terrain", "path"),
    ("is_success",),
)
"""Rows of :class:`aoro_gym.envs.path_tracking.kernels.memory.Told`, by array."""


def path_tracking_kernels(task: Any, memory: StepMemory, arrays: Arrays, *, reach: float) -> TaskKernels:
    """A control step of ``task``.

    Args:
        task: Of :class:`aoro_gym.envs.path_tracking.task.PathTracking`, allocated.
        memory: Of the step.
        arrays: Where the task's arrays live.
        reach: How far [m] around the last projection the next one is looked for.
    """
    courses, control, measures, sensing, driving, rules = vehicles(task, arrays, reach)
    told, logged = told_memory(Told(), LOGGED, len(task._s), arrays)
    told_at_rest, begun = told_memory(Told(), LOGGED, len(task._s), arrays)
    filters = isinstance(task._sensors.localisation, PoseFilter)
    sensed, rested = (sense_filtered, rest_filtered) if filters else (sense, rest)
    return TaskKernels(
        before=[(act, [memory, control, sensing, measures, driving])],
        after=[
            (sensed, [memory, courses, measures, sensing, driving, rules]),
            (judge, [memory, courses, control, sensing, driving, rules, told]),
        ],
        rest=(rested, [memory, courses, control, measures, sensing, driving, rules, told_at_rest]),
        observe=(observe, [memory, courses, control, sensing, driving, rules]),
        rewarded=REWARDED,
        observed=OBSERVED,
        logged=logged,
        begun=begun,
    )


class Vehicles(NamedTuple):
    """The memory of a task, shared."""

    courses: Courses
    control: Control
    measures: Vehicle
    sensing: Sensing
    driving: Driving
    rules: Rules


def vehicles(task: Any, arrays: Arrays, reach: float) -> Vehicles:
    """Of ``task``; see :func:`path_tracking_kernels`."""
    return Vehicles(
        courses_memory(task.table, task.height_map, arrays),
        _control(task, arrays),
        vehicle_memory(task._measures, arrays),
        sensing_memory(task._sensors, arrays),
        shared(Driving(), task, DRIVING, arrays, "_"),
        _rules(task, arrays, math.ceil(reach / task.table.spacing)),
    )


def _rules(task: Any, arrays: Arrays, half: int) -> Rules:
    out, config = Rules(), task.config
    for name in ("working_speed", "end_tolerance", "path_limit", "stuck_distance", "stuck_time", "chassis_force_limit"):
        setattr(out, name, getattr(config, name))
    out.reach, out.upright = half, math.cos(config.rollover)
    out.preview = constants(arrays, config.preview)
    if len(task._scan):
        out.scan = arrays.shared(task._scan)
    return out


def _control(task: Any, arrays: Arrays) -> Control:
    """The controllers between ``task``'s action and the machine."""
    out, config, layout = Control(), task.config, task.action_layout
    for name in ("arms", "traction", "gear"):
        setattr(out, f"{name}_column", layout[name].start if name in layout else -1)
    shift, rows = config.gear_shift, task._sensors._pressure_rows
    out.automatic, out.share = int(config.gear == "automatic"), wp.vec3d(*GEAR_DISPLACEMENT)
    out.drop = wp.vec2i(*(rows.get(f"drive_pressure_{side}", 0) for side in ("forward", "return")))
    for name in ("up_speed", "up_signal", "up_pressure", "down_speed", "down_pressure", "hold"):
        setattr(out, name, getattr(shift, name))
    out.gear, out.held = arrays.shared(task._gear.gear), arrays.shared(task._gear._held)
    out.controls_arms = int(config.arms is not None)
    out.bores, out.rods = (rows.get(f"arm_pressure_{end}_fl", 0) for end in ("bore", "rod"))
    out.twist, out.openings = arrays.shared(task._arms._twist), arrays.shared(task._openings)
    if config.arms is not None:
        for name in (
            "share_gain", "share_band", "share_time", "level_gain", "level_band", "height_gain", "largest",
        ):  # fmt: skip
            setattr(out, name, getattr(config.arms, name))
    out.controls_traction = int(config.traction is not None)
    if config.traction is not None:
        for name in ("excess", "slack", "close", "open", "least"):
            setattr(out, name, getattr(config.traction, name))
    return out
