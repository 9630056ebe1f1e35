"""Observation terms of turning: each a function of the view that gives (N,) or (N, columns), with its bounds."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping

from aoro_gym.envs.core.terms import Frozen, ObservationTerm
from aoro_gym.envs.turning.view import TurningView
from aoro_gym.execution.array_api import Array


def joint_angle(view: TurningView) -> Array:
    """Measured joint angle [rad]."""
    return view.measured_angle


def joint_rate(view: TurningView) -> Array:
    """Estimated joint rate [rad/s]."""
    return view.measured_rate


def target(view: TurningView) -> Array:
    """Target [rad]."""
    return view.target


def target_error(view: TurningView) -> Array:
    """Target less measured angle [rad]."""
    return view.target - view.measured_angle


def signals(view: TurningView) -> Array:
    """The last steering signals, newest first (N, M)."""
    return view.signals


def pressures(view: TurningView) -> Array:
    """Measured pressures of port A, port B and the pump, in units of 100 bar (N, 3)."""
    return view.measured_pressures / 1e7


OBSERVATION_TERMS = Frozen(
    {
        "joint_angle": ObservationTerm(joint_angle, -math.pi, math.pi),
        "joint_rate": ObservationTerm(joint_rate, -5.0, 5.0),
        "target": ObservationTerm(target, -math.pi, math.pi),
        "error": ObservationTerm(target_error, -math.pi, math.pi),
        "signals": ObservationTerm(signals, -1.0, 1.0),
    }
)
"""What the real machine knows with its joint-angle sensor alone."""
EXACT_TERMS: Mapping[str, Callable[[TurningView], Array]] = {
    "joint_angle": lambda view: view.target - view.error,
    "error": lambda view: view.error,
}
"""True values of measured terms, for teachers."""
PRESSURE_TERMS = Frozen({"pressures": ObservationTerm(pressures, -1.0, 10.0)})
"""What ``observe_pressures=True`` adds."""
