"""What the terms of path tracking see."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from aoro_gym.envs.core.ray_sensing import RaySensing
from aoro_gym.envs.core.task import Outputs
from aoro_gym.execution.array_api import Array


@dataclass(frozen=True)
class PathTrackingView:
    """All sub-environments at the end of a control step; arrays of shape (N,) unless said otherwise, SI.

    What begins with ``measured`` is what sensors and dead reckoning give; ``cross_track``, ``heading_error`` and what
    follows them are exact.
    """

    xp: Any
    """Array namespace of all arrays."""
    control_step: float
    """[s]"""
    working_speed: float
    """[m/s]"""
    cross_track: Array
    """Of the reference point [m], positive left of the path."""
    heading_error: Array
    """Heading of the front frame less that of the path [rad], in [−π, π)."""
    progress: Array
    """Length of path [m] that the step gained."""
    remaining: Array
    """Length of path [m] to its end."""
    speed: Array
    """Of the hinge, along the front frame [m/s]."""
    tipping_margin: Array
    """1 less the larger share [-] of the weight that has moved across or along: 1 even, 0 when two wheels lift."""
    engine_power: Array
    """Mean over the step [W]."""
    finished: Array
    """Whether the end of the path was reached in this step."""
    failed: Array
    """Whether the episode ended badly in this step."""
    measured_cross_track: Array
    """[m]"""
    measured_heading_error: Array
    """[rad]"""
    measured_remaining: Array
    """[m]"""
    gps_quality: Array
    """0 no satellites, 1 float, 2 fixed; int64."""
    preview: Array
    """Places on the path ahead, x forward, y left of the reference point as measured [m], shape (N, K, 2)."""
    curvature: Array
    """Of the path beside the vehicle and at the preview's places [1/m], positive left, shape (N, 1 + K)."""
    measured_speed: Array
    """Over ground, from the wheel speeds [m/s]."""
    measured_angle: Array
    """Joint angle [rad]."""
    measured_rate: Array
    """Joint rate [rad/s]: slope of the line through the last measured angles."""
    measured_roll: Array
    """[rad], positive where the left side is up."""
    measured_pitch: Array
    """[rad], positive where the nose is down."""
    measured_rates: Array
    """Angular velocity in the front frame's axes [rad/s], shape (N, 3)."""
    measured_force: Array
    """Specific force in the front frame's axes [m/s²], shape (N, 3); zero unless it is observed."""
    measured_wheel_rates: Array
    """[rad/s], shape (N, 4)."""
    gear: Array
    """1, 2 or 3."""
    actions: Array
    """The last actions, newest first, shape (N, M, A)."""
    heights: Array
    """Ground at the scan's places over that at the reference point [m], shape (N, G)."""
    step: Array
    """Control steps since the episode began, int64."""
    rays: RaySensing
    """For terms that cast rays."""
    outputs: Outputs
    """Exact output channels of the twins over the step."""

    def output(self, channel: str) -> Array:
        """Any exact output channel of the twin at the end of the step, SI; see ``aoro_gym.twin.records.Output``."""
        return self.outputs.last(channel)
