"""Observation terms of a forest run: each a function of the view that gives (N,) or (N, columns), with its bounds."""

from __future__ import annotations

import math

from aoro_gym.envs.core.terms import Frozen, ObservationTerm
from aoro_gym.envs.forest_run.view import ForestRunView
from aoro_gym.envs.path_tracking import observations as path_tracking
from aoro_gym.execution.array_api import Array

FARTHEST = 100.0
"""[m] that the goal's coordinates are clipped to."""


def goal(view: ForestRunView) -> Array:
    """Goal in the machine's axes as measured [m]: x forward, y left of the front axle's middle (N, 2)."""
    return view.measured_goal


def heading(view: ForestRunView) -> Array:
    """Cosine and sine of the measured heading against a fixed direction (N, 2)."""
    return view.xp.stack([view.xp.cos(view.measured_heading), view.xp.sin(view.measured_heading)], axis=1)


def speed(view: ForestRunView) -> Array:
    """Speed over ground from the wheels [m/s]."""
    return path_tracking.speed(view.driving)


def joint_angle(view: ForestRunView) -> Array:
    """Measured joint angle [rad]."""
    return path_tracking.joint_angle(view.driving)


def joint_rate(view: ForestRunView) -> Array:
    """Estimated joint rate [rad/s]."""
    return path_tracking.joint_rate(view.driving)


def roll(view: ForestRunView) -> Array:
    """Measured roll [rad], positive where the left side is up."""
    return view.measured_roll


def pitch(view: ForestRunView) -> Array:
    """Measured pitch [rad], positive where the nose is down."""
    return view.measured_pitch


def yaw_rate(view: ForestRunView) -> Array:
    """Measured yaw rate [rad/s]."""
    return path_tracking.yaw_rate(view.driving)


def inertial(view: ForestRunView) -> Array:
    """Roll rate and pitch rate [rad/s], then the specific force in units of gravity (N, 5)."""
    return path_tracking.inertial(view.driving)


def wheel_speeds(view: ForestRunView) -> Array:
    """Measured wheel speeds [rad/s], front left, front right, rear left, rear right (N, 4)."""
    return path_tracking.wheel_speeds(view.driving)


def actions(view: ForestRunView) -> Array:
    """The last actions, newest first, each as the action space has it (N, M A)."""
    return path_tracking.actions(view.driving)


OBSERVATION_TERMS = Frozen(
    {
        "goal": ObservationTerm(goal, -FARTHEST, FARTHEST),
        "heading": ObservationTerm(heading, -1.0, 1.0),
        "speed": ObservationTerm(speed, -10.0, 10.0),
        "joint_angle": ObservationTerm(joint_angle, -math.pi, math.pi),
        "joint_rate": ObservationTerm(joint_rate, -5.0, 5.0),
        "roll": ObservationTerm(roll, -math.pi, math.pi),
        "pitch": ObservationTerm(pitch, -math.pi, math.pi),
        "yaw_rate": ObservationTerm(yaw_rate, -5.0, 5.0),
        "inertial": ObservationTerm(inertial, -20.0, 20.0),
        "wheel_speeds": ObservationTerm(wheel_speeds, -30.0, 30.0),
        "actions": ObservationTerm(actions, -1.0, 1.0),
    }
)
"""What the machine measures, in this order; ``obstacles`` follow, which a lidar shows."""
