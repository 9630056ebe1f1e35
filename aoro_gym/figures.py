"""Key figures of a manoeuvre, in field units.

The figures of a full turn are defined once, for the twin and for the machine, on a joint angle and a joint flow. What
the flow is derived from is the caller's choice: here it is the simulated one, unfiltered, hence the prefix ``raw_``.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from aoro_gym.log import BAR, DEGREE, LITRE_PER_MINUTE, RPM

if TYPE_CHECKING:
    from aoro_gym.manoeuvres import Recording
    from aoro_gym.twin.sections import SteeringCylinder

TOLERANCE = math.radians(0.1)
"""Angle [rad] within which a joint has not left its start, or has reached its stop."""

Figures = dict[str, float | None]


def turn_flow(cylinder: SteeringCylinder, angle: ArrayLike, rate: ArrayLike, direction: int) -> Any:
    """Joint flow [m³/s] of a turn from the joint's motion: what the strokes draw through the pressurised port.

    A turn fills the bore of one cylinder and the annulus of the other, and the right turn is the mirrored left one:
    Q = (A_bore l(σθ) + A_annulus l(-σθ)) σ dθ/dt, with the lever l(θ) = dL/dθ of the extending cylinder, σ = +1 left.

    Args:
        cylinder: One of the two steering cylinders with its linkage.
        angle: Joint angle [rad], scalar or (F,).
        rate: Joint rate [rad/s], likewise.
        direction: +1 left, -1 right.
    """
    turned = direction * np.asarray(angle, dtype=np.float64)
    extends, retracts = cylinder.linkage.lever(turned), cylinder.linkage.lever(-turned)
    return (cylinder.bore_area * extends + cylinder.annulus_area * retracts) * direction * np.asarray(rate)


def turn_figures(
    time: NDArray[np.float64],
    angle: NDArray[np.float64],
    flow: NDArray[np.float64],
    *,
    stop: float,
    volume: float,
    prefix: str = "",
) -> Figures:
    """The seven key figures of a full turn; all None where the turn does not reach its stop.

    Args:
        time: Instants [s] (F,).
        angle: Unfiltered joint angle [rad] (F,), at its start stop in the first sample.
        flow: Joint flow [m³/s] (F,), positive in the direction of the turn.
        stop: Joint angle [rad] of the stop the turn ends at.
        volume: Oil [m³] of a full turn.
        prefix: Put before the names of the figures that depend on how ``flow`` was filtered.

    t = 0 is the first sample whose angle has left the start by 0.1°; the turn lasts until the angle is within 0.1° of
    the stop. Steady flow: mean over [0.48 T, 0.92 T]. First peak: largest flow in t < 0.3 s. Lowest undershoot:
    smallest flow between the first peak and 0.7 s. Second peak: largest flow in 0.55-0.85 s.
    """
    names = [
        "turn_time_s",
        "mean_flow_L_per_min",
        *(
            f"{prefix}{name}"
            for name in (
                "steady_flow_L_per_min",
                "first_peak_L_per_min",
                "first_peak_time_s",
                "lowest_undershoot_L_per_min",
                "second_peak_L_per_min",
            )
        ),
    ]
    nothing: Figures = dict.fromkeys(names)
    moved = np.abs(angle - angle[0]) > TOLERANCE
    arrived = np.sign(stop - angle[0]) * (stop - angle) <= TOLERANCE
    if not moved.any() or not arrived.any():
        return nothing
    since = time - time[np.argmax(moved)]
    turn_time = float(since[np.argmax(arrived)])
    if turn_time <= 0:
        return nothing

    def span(low: float, high: float) -> NDArray[np.bool_]:
        return (since >= low) & (since <= min(high, turn_time))

    def extreme(within: NDArray[np.bool_], pick: np.ufunc) -> float | None:
        return float(pick.reduce(flow[within])) / LITRE_PER_MINUTE if within.any() else None

    onset = np.flatnonzero((since >= 0) & (since < 0.3))
    peak = onset[np.argmax(flow[onset])]
    steady = flow[span(0.48 * turn_time, 0.92 * turn_time)]
    figures = [
        turn_time,
        volume / turn_time / LITRE_PER_MINUTE,
        float(steady.mean()) / LITRE_PER_MINUTE if steady.size else None,
        float(flow[peak]) / LITRE_PER_MINUTE,
        float(since[peak]),
        extreme(span(float(since[peak]), 0.7), np.minimum),
        extreme(span(0.55, 0.85), np.maximum),
    ]
    return dict(zip(names, figures, strict=True))


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
        area = cylinder.bore_area + cylinder.annulus_area
        figures |= turn_figures(
            recording.time,
            recording["joint_angle"],
            recording["turn_flow"],
            stop=turn * float(cylinder.half_range),
            volume=float(area * cylinder.stroke),
            prefix="raw_",
        )
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
