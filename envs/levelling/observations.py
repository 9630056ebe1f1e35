"""Observation terms of levelling: each a function of the view that gives (N,) or (N, columns), with its bounds."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping

from aoro_gym.envs.core.terms import Frozen, ObservationTerm
from aoro_gym.envs.levelling.view import LevellingView
from aoro_gym.execution.array_api import Array
from aoro_gym.units import GRAVITY

SUPPORT_UNIT = 1e7
"""Pressure [Pa] that the observation shows as 1."""


def roll(view: LevellingView) -> Array:
    """Measured roll [rad], positive where the left side is up."""
    return view.measured_roll


def pitch(view: LevellingView) -> Array:
    """Measured pitch [rad], positive where the nose is down."""
    return view.measured_pitch


def tilt_rates(view: LevellingView) -> Array:
    """Measured roll rate and pitch rate [rad/s] (N, 2)."""
    return view.measured_rates[:, :2]


def force(view: LevellingView) -> Array:
    """Specific force in the front frame's axes in units of gravity (N, 3)."""
    return view.measured_force / GRAVITY


def arm_angles(view: LevellingView) -> Array:
    """Measured arm angles less those at rest [rad], positive where the wheel is up (N, 4)."""
    return view.measured_arms


def arm_rates(view: LevellingView) -> Array:
    """Differences of the last two measured arm angles over a step [rad/s] (N, 4)."""
    return view.measured_arm_rates


def supports(view: LevellingView) -> Array:
    """Measured pressures that the arms' cylinders bear [100 bar], bore less the rod's share (N, 4)."""
    return view.measured_supports / SUPPORT_UNIT


def supply(view: LevellingView) -> Array:
    """Measured pressure of pump 2 [100 bar]."""
    return view.measured_supply / SUPPORT_UNIT


def ground(view: LevellingView) -> Array:
    """Heights of the ground under and ahead of the wheels, left track, then right track, over their mean [m] (N, 2 K)."""
    return view.measured_ground


def joint_angle(view: LevellingView) -> Array:
    """Measured joint angle [rad]."""
    return view.measured_angle


def speed(view: LevellingView) -> Array:
    """Speed over ground from the wheels [m/s]."""
    return view.measured_speed


def signals(view: LevellingView) -> Array:
    """The last signals of the arm valves, newest first, four each (N, M 4)."""
    return view.signals.reshape(len(view.signals), -1)


def _true(channel: str) -> Callable[[LevellingView], Array]:
    return lambda view: view.output(channel)


OBSERVATION_TERMS = Frozen(
    {
        "roll": ObservationTerm(roll, -math.pi, math.pi),
        "pitch": ObservationTerm(pitch, -math.pi, math.pi),
        "tilt_rates": ObservationTerm(tilt_rates, -5.0, 5.0),
        "force": ObservationTerm(force, -5.0, 5.0),
        "arm_angles": ObservationTerm(arm_angles, -2.0, 2.0),
        "arm_rates": ObservationTerm(arm_rates, -10.0, 10.0),
        "supports": ObservationTerm(supports, -4.0, 4.0),
        "supply": ObservationTerm(supply, 0.0, 4.0),
        "ground": ObservationTerm(ground, -2.0, 2.0),
        "joint_angle": ObservationTerm(joint_angle, -math.pi, math.pi),
        "speed": ObservationTerm(speed, -10.0, 10.0),
        "signals": ObservationTerm(signals, -1.0, 1.0),
    }
)
"""What the machine measures, in this order; ``observation_layout`` gives the columns of each by name."""
EXACT_TERMS: Mapping[str, Callable[[LevellingView], Array]] = {"roll": _true("roll"), "pitch": _true("pitch")}
"""True values of terms that the inertial unit gives with errors that last, for teachers."""
