"""What the terms of loading see."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from aoro_gym.envs.core.task import Outputs
from aoro_gym.execution.array_api import Array


@dataclass(frozen=True)
class LoadingView:
    """All sub-environments at the end of a control step; arrays of shape (N,) unless said otherwise, SI. Ways are in the
    axes of the front frame, angles of logs between −90° and 90°, as a log's two ends are alike.

    What begins with ``measured`` is what sensors give, the rest is exact.
    """

    xp: Any
    """Array namespace of all arrays."""
    control_step: float
    """[s]"""
    remaining: Array
    """Way [m] that is left: from the grapple to the log and from there to the bunk, or, with the log, to the bunk."""
    nearer: Array
    """What of it the step gained [m]."""
    misaligned: Array
    """Angle [rad] of the grapple off the log, or, with the log, of the log off the bunk; at least 0."""
    turned: Array
    """What of it the step gained [rad]."""
    held: Array
    """1 where the grapple holds the log, else 0."""
    grasped: Array
    """Whether it was grasped in this step."""
    sway: Array
    """Swing [rad] of the grapple off the plumb line, were it free to swing, by the tip's motion."""
    power: Array
    """Hydraulic power of the pump, mean over the step [W]."""
    tilt: Array
    """Angle [rad] of the front frame off the plumb line."""
    placed: Array
    """Whether the log was put on the bunk in this step."""
    failed: Array
    """Whether the episode ended badly in this step."""
    measured_joints: Array
    """Slew, lift, fold [rad] and telescope [m] (N, 4)."""
    measured_rates: Array
    """Differences of the last two of them over the control step (N, 4)."""
    measured_load: Array
    """Force of grapple and log on the tip [N]."""
    measured_pressures: Array
    """Bores of lift and fold, annulus of the fold, and pump [Pa] (N, 4)."""
    rotator: Array
    """Angle of the grapple to the pillar [rad]."""
    closed: Array
    """1 where the grapple is closed, else 0."""
    measured_log: Array
    """Way from the grapple to the log [m] (N, 3), as a camera gives it; zero with the log."""
    measured_log_angle: Array
    """Angle of the log to the grapple [rad], likewise."""
    bunk: Array
    """Way from the grapple to where a log is to lie on the bunk [m] (N, 3), by the measured joints."""
    bunk_angle: Array
    """Angle of the bunk to the grapple [rad], likewise."""
    signals: Array
    """Signals of the last two steps, newest first (N, 2, 6)."""
    step: Array
    """Control steps since the episode began, int64."""
    outputs: Outputs
    """Exact output channels of the twins over the step."""

    def output(self, channel: str) -> Array:
        """Any exact output channel of the twin at the end of the step, SI; see ``aoro_gym.twin.records``."""
        return self.outputs.last(channel)
