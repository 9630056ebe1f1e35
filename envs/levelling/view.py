"""What the terms of levelling see."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from aoro_gym.envs.core.ray_sensing import RaySensing
from aoro_gym.envs.core.task import Outputs
from aoro_gym.envs.path_tracking.view import PathTrackingView
from aoro_gym.execution.array_api import Array


@dataclass(frozen=True)
class LevellingView:
    """All sub-environments at the end of a control step; arrays of shape (N,) unless said otherwise, SI. Corners are in the
    order front left, front right, rear left, rear right.

    What begins with ``measured`` is what sensors give, the rest is exact.
    """

    xp: Any
    """Array namespace of all arrays."""
    control_step: float
    """[s]"""
    pace: Array
    """Path gained in the step, as a share [-] of what the working speed gains."""
    tilt: Array
    """Angle [rad] of the front frame's vertical axis off the world's, at the end of the step. The rear frame's is the same
    but for what the joint's axis leans."""
    tilt_rate: Array
    """Magnitude of roll and pitch rate together [rad/s]."""
    loads: Array
    """Of the wheels, mean over the step [N] (N, 4)."""
    unevenness: Array
    """Root mean square [-] of what the wheels' loads differ by from their shares at rest on level ground, in units of a
    quarter of the whole: 0 as at rest, 1 where two wheels of a diagonal carry everything."""
    lifted: Array
    """Share [-] of the wheels that bear less than a tenth of their load at rest."""
    sunk: Array
    """Mean height [m] that the frames lack to what they have with all arms at rest."""
    arm_travel: Array
    """Mean way [m] of a wheel against its frame over the step, by the arm's rate at its end."""
    hydraulic_power: Array
    """Of pump 2, which feeds arms and steering: mean of pressure times flow over the step [W]."""
    tipping_margin: Array
    """1 less the larger share [-] of the weight that has moved across or along: 1 even, 0 when two wheels lift."""
    finished: Array
    """Whether the end of the path was reached in this step."""
    failed: Array
    """Whether the episode ended badly in this step."""
    measured_roll: Array
    """Of the front frame [rad], positive where the left side is up."""
    measured_pitch: Array
    """[rad], positive where the nose is down."""
    measured_rates: Array
    """Angular velocity in the front frame's axes [rad/s] (N, 3)."""
    measured_force: Array
    """Specific force in the front frame's axes [m/s²] (N, 3)."""
    measured_arms: Array
    """Arm angles less those at rest [rad] (N, 4), positive where the wheel is up."""
    measured_arm_rates: Array
    """Differences of the last two arm angles over the control step [rad/s] (N, 4)."""
    measured_supports: Array
    """What the arms' cylinders bear [Pa] (N, 4): pressure at the bore less the rod's share of that at the rod."""
    measured_supply: Array
    """Pressure of pump 2 [Pa]."""
    measured_angle: Array
    """Joint angle [rad]."""
    measured_speed: Array
    """Over ground, from the wheel speeds [m/s]."""
    measured_ground: Array
    """Heights [m] of the ground in the left track, then in the right one, over their mean (N, 2 K)."""
    signals: Array
    """The last signals of the arm valves, newest first (N, M, 4)."""
    step: Array
    """Control steps since the episode began, int64."""
    driving: PathTrackingView
    """What the path controller sees."""
    rays: RaySensing
    """For terms that cast rays."""
    outputs: Outputs
    """Exact output channels of the twins over the step."""

    def output(self, channel: str) -> Array:
        """Any exact output channel of the twin at the end of the step, SI; see ``aoro_gym.twin.records.Output``."""
        return self.outputs.last(channel)
