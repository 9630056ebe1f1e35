"""What the terms of a forest run see."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from aoro_gym.envs.core.ray_sensing import RaySensing
from aoro_gym.envs.core.task import Outputs
from aoro_gym.envs.path_tracking.view import PathTrackingView
from aoro_gym.execution.array_api import Array


@dataclass(frozen=True)
class ForestRunView:
    """All sub-environments at the end of a control step; arrays of shape (N,) unless said otherwise, SI.

    What begins with ``measured`` is what sensors and dead reckoning give, the rest is exact.
    """

    xp: Any
    """Array namespace of all arrays."""
    control_step: float
    """[s]"""
    working_speed: float
    """[m/s]"""
    nearer: Array
    """By how much the step has brought the reference point nearer to the goal [m]."""
    remaining: Array
    """Distance of the reference point to the goal [m]."""
    chassis_force: Array
    """Largest force [N] of objects on either chassis among the samples of the step."""
    engine_power: Array
    """Mean over the step [W]."""
    tipping_margin: Array
    """1 less the larger share [-] of the weight that has moved across or along: 1 even, 0 when two wheels lift."""
    finished: Array
    """Whether the goal was reached in this step."""
    failed: Array
    """Whether the episode ended badly in this step."""
    measured_goal: Array
    """x forward, y left of the goal [m] from the reference point as measured (N, 2)."""
    measured_heading: Array
    """Of the front frame against the x axis of the goal's coordinates [rad]."""
    measured_roll: Array
    """[rad], positive where the left side is up."""
    measured_pitch: Array
    """[rad], positive where the nose is down."""
    driving: PathTrackingView
    """What is measured besides: speeds, joint, inertial unit, actions."""
    step: Array
    """Control steps since the episode began, int64."""
    rays: RaySensing
    """For terms that cast rays."""
    outputs: Outputs
    """Exact output channels of the twins over the step."""

    def output(self, channel: str) -> Array:
        """Any exact output channel of the twin at the end of the step, SI; see ``aoro_gym.twin.records.Output``."""
        return self.outputs.last(channel)
