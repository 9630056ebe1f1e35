"""Key figures of a manoeuvre, in field units.

Those of a full turn are the published ones of :mod:`aoro_gym.simulation.key_figures`: through the measuring chain, and
with the prefix ``raw_`` from the unfiltered simulated flow. All are exact: no sensor noise.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from aoro_gym.sensors.chain import sample
from aoro_gym.simulation import key_figures as turns
from aoro_gym.simulation.key_figures import FIGURES, TOLERANCE
from aoro_gym.simulation.log import BAR, DEGREE, RPM

if TYPE_CHECKING:
    from aoro_gym.machine.sections import SteeringCylinder
    from aoro_gym.simulation.manoeuvres import Recording

UNFILTERED = ("turn_time_s", "mean_flow_L_per_min")
"""Figures that the filter does not enter."""

Figures = dict[str, float | None]


def turn_start(recording: Recording) -> float | None:
    """Time [s] at which the joint has left its start by 0.1°."""
    moved = np.abs(recording["joint_angle"] - recording["joint_angle"][0]) > TOLERANCE
    return float(recording.time[np.argmax(moved)]) if moved.any() else None


def key_figures(recording: Recording, cylinder: SteeringCylinder) -> Figures:
    """Figures of a recording by its kind: a full turn, a drive, or any other commands.

    Args:
        recording: What the twin did.
        cylinder: One of the machine's two steering cylinders.
    """
    turn = recording.manoeuvre.turn
    figures: Figures = {}
    if turn:
        ticks, angle = sample(recording.time, recording["joint_angle"])
        figures |= turns.key_figures(ticks, angle, cylinder)
        raw = turns.key_figures(recording.time, recording["joint_angle"], cylinder, flow=recording["joint_flow"])
        figures |= {f"raw_{name}": raw[name] for name in FIGURES if name not in UNFILTERED}
    else:
        figures |= _drive_figures(recording)
    steers = bool(np.any(recording["steering_signal"]))
    if steers:
        figures["highest_pressure_a_bar"] = float(recording["pressure_a"].max()) / BAR
        figures["highest_pressure_b_bar"] = float(recording["pressure_b"].max()) / BAR
        figures["highest_pump_pressure_bar"] = float(recording["pump_pressure"].max()) / BAR
    if steers and not turn:
        figures["leftmost_joint_angle_deg"] = float(recording["joint_angle"].max()) / DEGREE
        figures["rightmost_joint_angle_deg"] = float(recording["joint_angle"].min()) / DEGREE
    figures["lowest_engine_speed_rpm"] = float(recording["engine_speed"].min()) / RPM
    return figures


def _drive_figures(recording: Recording) -> Figures:
    """Distance, final speed and the pressure that driving took, over the last second."""
    last = recording.time > recording.time[-1] - 1.0
    path = np.hypot(np.diff(recording["position_x"]), np.diff(recording["position_y"]))
    corners = [recording[f"motor_pressure_{corner}"][last] for corner in ("fl", "fr", "rl", "rr")]
    return {
        "distance_m": float(path.sum()),
        "final_speed_m_per_s": float(recording["speed"][last].mean()),
        "final_motor_pressure_bar": float(np.mean(corners)) / BAR,
        "highest_drive_pressure_bar": float(
            np.maximum(recording["drive_pressure_forward"], recording["drive_pressure_return"]).max() / BAR
        ),
    }
