"""Observation terms of path tracking: each a function of the view that gives (N,) or (N, columns), with its bounds."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping

from aoro_gym.envs.core.terms import Frozen, ObservationTerm
from aoro_gym.envs.path_tracking.view import PathTrackingView
from aoro_gym.execution.array_api import Array, floats
from aoro_gym.units import GRAVITY


def cross_track(view: PathTrackingView) -> Array:
    """Measured cross-track error [m], positive left of the path."""
    return view.measured_cross_track


def heading_error(view: PathTrackingView) -> Array:
    """Measured heading error [rad], positive left of the path's heading."""
    return view.measured_heading_error


def preview(view: PathTrackingView) -> Array:
    """Path ahead in the vehicle's axes [m]: x1, y1, x2, y2, … at the configuration's ``preview`` distances (N, 2 K)."""
    return view.preview.reshape(len(view.preview), -1)


def curvature(view: PathTrackingView) -> Array:
    """Curvature [1/m] beside the vehicle, then at the preview's places (N, 1 + K)."""
    return view.curvature


def remaining(view: PathTrackingView) -> Array:
    """Path left [m], clipped at 20 m."""
    return view.measured_remaining


def speed(view: PathTrackingView) -> Array:
    """Speed over ground from the wheels [m/s]."""
    return view.measured_speed


def joint_angle(view: PathTrackingView) -> Array:
    """Measured joint angle [rad]."""
    return view.measured_angle


def joint_rate(view: PathTrackingView) -> Array:
    """Estimated joint rate [rad/s]."""
    return view.measured_rate


def roll(view: PathTrackingView) -> Array:
    """Measured roll [rad], positive where the left side is up."""
    return view.measured_roll


def pitch(view: PathTrackingView) -> Array:
    """Measured pitch [rad], positive where the nose is down."""
    return view.measured_pitch


def yaw_rate(view: PathTrackingView) -> Array:
    """Measured yaw rate [rad/s]."""
    return view.measured_rates[:, 2]


def wheel_speeds(view: PathTrackingView) -> Array:
    """Measured wheel speeds [rad/s], front left, front right, rear left, rear right (N, 4)."""
    return view.measured_wheel_rates


def actions(view: PathTrackingView) -> Array:
    """The last actions, newest first, each as the action space has it (N, M A)."""
    return view.actions.reshape(len(view.actions), -1)


def gps_quality(view: PathTrackingView) -> Array:
    """Of the receiver's newest solution: 0 no satellites, 1 ambiguities of the carrier not resolved, 2 resolved."""
    return floats(view.gps_quality)


def gear(view: PathTrackingView) -> Array:
    """The gear, 1, 2 or 3."""
    return view.gear


def inertial(view: PathTrackingView) -> Array:
    """Roll rate and pitch rate [rad/s], then the specific force in units of gravity (N, 5)."""
    return view.xp.concat([view.measured_rates[:, :2], view.measured_force / GRAVITY], axis=1)


def heights(view: PathTrackingView) -> Array:
    """Ground at the scan's places over that at the reference point [m] (N, G), rows of ``scan_x`` by ``scan_y``."""
    return view.heights


OBSERVATION_TERMS = Frozen(
    {
        "cross_track": ObservationTerm(cross_track, -10.0, 10.0),
        "heading_error": ObservationTerm(heading_error, -math.pi, math.pi),
        "preview": ObservationTerm(preview, -30.0, 30.0),
        "curvature": ObservationTerm(curvature, -1.0, 1.0),
        "remaining": ObservationTerm(remaining, -1.0, 20.0),
        "speed": ObservationTerm(speed, -10.0, 10.0),
        "joint_angle": ObservationTerm(joint_angle, -math.pi, math.pi),
        "joint_rate": ObservationTerm(joint_rate, -5.0, 5.0),
        "roll": ObservationTerm(roll, -math.pi, math.pi),
        "pitch": ObservationTerm(pitch, -math.pi, math.pi),
        "yaw_rate": ObservationTerm(yaw_rate, -5.0, 5.0),
        "wheel_speeds": ObservationTerm(wheel_speeds, -30.0, 30.0),
        "actions": ObservationTerm(actions, -1.0, 1.0),
    }
)
"""What the machine measures, in this order; ``observation_layout`` gives the columns of each by name."""
EXACT_TERMS: Mapping[str, Callable[[PathTrackingView], Array]] = {
    "cross_track": lambda view: view.cross_track,
    "heading_error": lambda view: view.heading_error,
}
"""True values of terms that localisation gives with errors that last, for teachers."""
GPS_TERMS = Frozen({"gps_quality": ObservationTerm(gps_quality, 0.0, 2.0)})
"""What a receiver says beside its solutions."""
GEAR_TERMS = Frozen({"gear": ObservationTerm(gear, 1.0, 3.0)})
"""What a gear that changes adds."""
INERTIAL_TERMS = Frozen({"inertial": ObservationTerm(inertial, -20.0, 20.0)})
"""What ``observe_inertial=True`` adds."""
HEIGHT_TERMS = Frozen({"heights": ObservationTerm(heights, -5.0, 5.0)})
"""What a height scan adds."""
