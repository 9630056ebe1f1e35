"""Observation terms of loading: each a function of the view that gives (N,) or (N, columns), with its bounds."""

from __future__ import annotations

import math

from aoro_gym.envs.core.terms import Frozen, ObservationTerm
from aoro_gym.envs.loading.view import LoadingView
from aoro_gym.execution.array_api import Array

LOAD_UNIT = 1e4
"""Force [N] that the observation shows as 1."""
PRESSURE_UNIT = 1e7
"""Pressure [Pa] that the observation shows as 1."""


def joints(view: LoadingView) -> Array:
    """Measured slew, lift, fold [rad] and telescope [m] (N, 4)."""
    return view.measured_joints


def joint_rates(view: LoadingView) -> Array:
    """Their differences over a step [rad/s], of the telescope [m/s] (N, 4)."""
    return view.measured_rates


def tip_load(view: LoadingView) -> Array:
    """Measured force of grapple and log on the tip [10 kN]."""
    return view.measured_load / LOAD_UNIT


def pressures(view: LoadingView) -> Array:
    """Measured pressures of the bores of lift and fold, the annulus of the fold, and the pump [100 bar] (N, 4)."""
    return view.measured_pressures / PRESSURE_UNIT


def rotator(view: LoadingView) -> Array:
    """Angle of the grapple to the pillar [rad]."""
    return view.rotator


def grapple(view: LoadingView) -> Array:
    """1 where the grapple is closed, and 1 where it holds the log (N, 2)."""
    return view.xp.stack([view.closed, view.held], axis=1)


def log(view: LoadingView) -> Array:
    """Measured way from the grapple to the log in the front frame [m]; zero with the log (N, 3)."""
    return view.measured_log


def log_angle(view: LoadingView) -> Array:
    """Measured angle of the log to the grapple [rad]; zero with the log."""
    return view.measured_log_angle


def bunk(view: LoadingView) -> Array:
    """Way from the grapple to the place on the bunk in the front frame [m] (N, 3)."""
    return view.bunk


def bunk_angle(view: LoadingView) -> Array:
    """Angle of the bunk to the grapple [rad]."""
    return view.bunk_angle


def signals(view: LoadingView) -> Array:
    """The signals of the last two steps, newest first, six each (N, 12)."""
    return view.signals.reshape(len(view.signals), -1)


OBSERVATION_TERMS = Frozen(
    {
        "joints": ObservationTerm(joints, -4.0, 4.0),
        "joint_rates": ObservationTerm(joint_rates, -3.0, 3.0),
        "tip_load": ObservationTerm(tip_load, 0.0, 4.0),
        "pressures": ObservationTerm(pressures, -0.1, 4.0),
        "rotator": ObservationTerm(rotator, -4.0, 4.0),
        "grapple": ObservationTerm(grapple, 0.0, 1.0),
        "log": ObservationTerm(log, -12.0, 12.0),
        "log_angle": ObservationTerm(log_angle, -math.pi / 2.0, math.pi / 2.0),
        "bunk": ObservationTerm(bunk, -12.0, 12.0),
        "bunk_angle": ObservationTerm(bunk_angle, -math.pi / 2.0, math.pi / 2.0),
        "signals": ObservationTerm(signals, -1.0, 1.0),
    }
)
"""What the crane measures, and where a camera sees the log; ``observation_layout`` gives the columns of each by name."""
