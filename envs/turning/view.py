"""What the terms of turning see."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from aoro_gym.envs.core.ray_sensing import RaySensing
from aoro_gym.envs.core.task import Outputs
from aoro_gym.execution.array_api import Array


@dataclass(frozen=True)
class TurningView:
    """All sub-environments at the end of a control step; arrays of shape (N,) unless said otherwise, SI.

    Angles are positive to the left. In reward terms ``target`` is the one that the step pursued; in observation terms
    it is the one that the next step shall pursue.
    """

    xp: Any
    """Array namespace of all arrays."""
    control_step: float
    """[s]"""
    tolerance: float
    """Error [rad] within which a target counts as reached."""
    target: Array
    """[rad]"""
    target_age: Array
    """Time since the target was set [s]."""
    error: Array
    """Target less true joint angle [rad]."""
    overshoot: Array
    """How far [rad] the joint is beyond the target, seen from where it stood when the target was set; at least 0."""
    measured_angle: Array
    """Joint angle [rad] as the sensor gives it."""
    measured_rate: Array
    """Joint rate [rad/s] as the controller can know it: slope of the line through the last measured angles."""
    signals: Array
    """Steering signals of the last steps, newest first, shape (N, M)."""
    flows: Array
    """True joint flow [m³/s], positive left, at the end of the last three steps, newest first, shape (3, N)."""
    measured_pressures: Array
    """Ports A and B and the pump [Pa] as their sensors give them, shape (N, 3); (N, 0) if they are not observed."""
    step: Array
    """Control steps since the episode began, int64."""
    rays: RaySensing
    """For terms that cast rays."""
    outputs: Outputs
    """Exact output channels of the twins over the step."""

    def output(self, channel: str) -> Array:
        """Any exact output channel of the twin at the end of the step, SI; see ``aoro_gym.twin.records.Output``."""
        return self.outputs.last(channel)

    def samples(self, channel: str) -> Array:
        """The channel's samples over the step, 100 a second, oldest first, shape (frames, N)."""
        return self.outputs.samples(channel)
