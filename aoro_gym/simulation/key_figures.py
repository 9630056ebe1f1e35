"""Key figures, in field units: the seven of a full turn, defined once for the twin and for the machine, and others.

t = 0 is the first sample whose unfiltered angle has left the start by 0.1°; the turn lasts until the first sample whose
unfiltered angle is within 0.1° of the stop it goes to. Oil of a full turn over that time is the mean flow. The other
figures are read from a flow curve, by default that of the measuring chain (:mod:`aoro_gym.sensors.chain`):

* steady flow: mean over [0.48 T, 0.92 T]
* first peak: largest flow in [0, 0.3 s), and its time
* lowest undershoot: smallest flow between the first peak and 0.7 s
* second peak: largest flow in [0.55, 0.85 s]

All of it works on many turns at once, without a loop over them. Figures of a twin's recording are exact, without sensor
noise: those of a turn through the measuring chain, and with the prefix ``raw_`` from the unfiltered simulated flow.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from aoro_gym.machine import Machine
from aoro_gym.machine.sections import SteeringCylinder
from aoro_gym.recording.commands import JOINTS
from aoro_gym.sensors.chain import PUBLISHED, STANDSTILL, MeasuringChain, measured_flow, sampling_rate
from aoro_gym.units import BAR, DEGREE, LITRE_PER_MINUTE, RPM

if TYPE_CHECKING:
    from aoro_gym.simulation.manoeuvres import Trajectory

TOLERANCE = math.radians(0.1)
"""Angle [rad] within which a joint has not left its start, or has reached its stop."""

FIGURES = (
    "turn_time_s",
    "mean_flow_L_per_min",
    "steady_flow_L_per_min",
    "first_peak_L_per_min",
    "first_peak_time_s",
    "lowest_undershoot_L_per_min",
    "second_peak_L_per_min",
)
"""Names of the figures, the most important first; the columns of the published table."""

SWING = ("steady_rise", "steady_fall")
"""Names of how far the flow swings about its straight line in the steady period: see :func:`steady_swing_batch`."""

UNFILTERED = ("turn_time_s", "mean_flow_L_per_min")
"""Figures that the filter does not enter."""

STEADY = (0.48, 0.92)
"""Steady period, as shares of the turn time."""
FIRST_PEAK_END = 0.3
"""End [s] of the search for the first peak."""
UNDERSHOOT_END = 0.7
"""End [s] of the search for the lowest undershoot."""
SECOND_PEAK = (0.55, 0.85)
"""Period [s] of the second peak."""

_RESTLESS = math.radians(0.5)
"""A joint whose angle strays that far [rad] in the first half second does not rest."""
_STIRRED = 3.0
"""Nor does one whose angle strays this many times further in the second quarter of a second than in the first."""
_SLACK = 1e-6
"""Share of a sample by which an instant may miss the end of a period and still count."""


def key_figures_batch(
    time: ArrayLike,
    angle: ArrayLike,
    machine: Machine | SteeringCylinder,
    *,
    flow: ArrayLike | None = None,
    stop: ArrayLike | None = None,
    interpolate: bool = False,
    chain: MeasuringChain = PUBLISHED,
) -> dict[str, NDArray[np.float64]]:
    """Key figures of N full turns: one array (N,) a name of :data:`FIGURES`.

    Left and right turns may be mixed: the direction of each follows from where it goes. NaN stands everywhere where the
    joint never reaches its stop, or does not rest for half a second before t = 0; it stands in the figures that the
    filter enters where less than half a second is recorded after the stop.

    Args:
        time: Evenly spaced instants [s] (F,); 100 samples a second for the published chain.
        angle: Unfiltered joint angle [rad] (F, N) or (F,), at rest in the first and in the last 0.5 s.
        machine: The machine, or one of its steering cylinders, with one variant or N.
        flow: Joint flow [m³/s] like ``angle``, positive in the direction of the turn; by default the measuring chain's.
        stop: Angle [rad] of the stop that each turn ends at, scalar or (N,); by default the machine's. Logs whose stop
            is not known take the mean angle of their last half second.
        interpolate: Instants and extremes between samples, by straight lines and parabolas: smooth functions of the
            parameters, for optimisers. The published definition reads samples.
        chain: What makes the flow of the angle; ``time`` has its samples.
    """
    clock = np.asarray(time, dtype=np.float64)
    theta = np.asarray(angle, dtype=np.float64)
    theta = theta[:, None] if theta.ndim == 1 else theta
    rate = sampling_rate(clock)
    if theta.ndim != 2 or theta.shape[0] != clock.size:
        raise ValueError(f"angle has shape {np.shape(angle)}, but must be ({clock.size},) or ({clock.size}, N)")
    cylinder = machine.steering.cylinder if isinstance(machine, Machine) else machine
    frames, count = theta.shape
    each = np.arange(count)
    span = turn_span(clock, theta, cylinder.half_range, stop=stop, interpolate=interpolate)
    complete, began = span.complete, span.began
    turn_time = np.where(complete, span.ended - began, np.nan)

    if flow is None:
        q = measured_flow(cylinder, theta, span.direction, rate=rate, chain=chain)
        clear = complete & (frames - 1 - span.last >= STANDSTILL * rate - _SLACK)
    else:
        q = np.asarray(flow, dtype=np.float64).reshape(frames, -1)
        clear = complete
    since = clock[:, None] - began
    slack = _SLACK / rate

    def within(low: ArrayLike, high: ArrayLike) -> NDArray[np.bool_]:
        return (since >= np.asarray(low) - slack) & (since <= np.minimum(high, turn_time) + slack)

    onset = (since >= -slack) & (since < FIRST_PEAK_END - slack) & (since <= turn_time + slack)
    first_peak, peak_row = _extreme(q, onset, interpolate)
    valley, _ = _extreme(-q, within(since[np.rint(peak_row).astype(int), each], UNDERSHOOT_END), interpolate)
    second_peak, _ = _extreme(q, within(*SECOND_PEAK), interpolate)
    period = within(STEADY[0] * turn_time, STEADY[1] * turn_time)
    with np.errstate(invalid="ignore", divide="ignore"):
        steady = np.where(period, q, 0.0).sum(axis=0) / period.sum(axis=0)

    volume = (cylinder.bore_area + cylinder.annulus_area) * cylinder.stroke
    values = (
        turn_time,
        volume / turn_time / LITRE_PER_MINUTE,
        *(
            np.where(clear, value, np.nan)
            for value in (
                steady / LITRE_PER_MINUTE,
                first_peak / LITRE_PER_MINUTE,
                clock[0] + peak_row / rate - began,
                -valley / LITRE_PER_MINUTE,
                second_peak / LITRE_PER_MINUTE,
            )
        ),
    )
    return dict(zip(FIGURES, values, strict=True))


def steady_swing_batch(
    time: ArrayLike, angle: NDArray[np.float64], machine: Machine | SteeringCylinder
) -> dict[str, NDArray[np.float64]]:
    """How far the flow of N full turns rises above and falls below its straight line in the steady period: (N,) by the
    names of :data:`SWING`, as shares of the line's mean; NaN where :func:`key_figures_batch` has no steady flow.

    The line is that of least squares, so a flow that only drifts does not swing. Extremes are read between samples.

    Args:
        time: Evenly spaced instants [s] (F,), as of :func:`key_figures_batch`.
        angle: Unfiltered joint angle [rad] (F, N).
        machine: The machine, or one of its steering cylinders, with one variant or N.
    """
    clock = np.asarray(time, dtype=np.float64)
    rate, cylinder = sampling_rate(clock), machine.steering.cylinder if isinstance(machine, Machine) else machine
    span = turn_span(clock, angle, cylinder.half_range, interpolate=True)
    clear = span.complete & (len(clock) - 1 - span.last >= STANDSTILL * rate - _SLACK)
    since, turn_time = clock[:, None] - span.began, span.ended - span.began
    period = (since >= STEADY[0] * turn_time) & (since <= STEADY[1] * turn_time) & clear
    flow = measured_flow(cylinder, angle, span.direction, rate=rate)
    with np.errstate(invalid="ignore", divide="ignore"):
        count = period.sum(axis=0)
        mean = np.where(period, flow, 0.0).sum(axis=0) / count
        later = np.where(period, since - np.where(period, since, 0.0).sum(axis=0) / count, 0.0)
        slope = (later * (flow - mean)).sum(axis=0) / np.square(later).sum(axis=0)
        swing = (flow - mean - slope * later) / mean
    return {name: _extreme(sign * swing, period, True)[0] for name, sign in zip(SWING, (1.0, -1.0), strict=True)}


def key_figures(
    time: ArrayLike,
    angle: ArrayLike,
    machine: Machine | SteeringCylinder,
    *,
    flow: ArrayLike | None = None,
    chain: MeasuringChain = PUBLISHED,
) -> dict[str, float | None]:
    """Key figures of one full turn, None where there is none.

    Args:
        time: See :func:`key_figures_batch`, as for the other arguments.
        angle: See there.
        machine: See there.
        flow: See there.
        chain: See there.
    """
    figures = key_figures_batch(time, angle, machine, flow=flow, chain=chain)
    return {name: float(value[0]) if math.isfinite(value[0]) else None for name, value in figures.items()}


def turn_start(recording: Trajectory) -> float | None:
    """Time [s] at which the joint has left its start by 0.1°."""
    moved = np.abs(recording["joint_angle"] - recording["joint_angle"][0]) > TOLERANCE
    return float(recording.time[np.argmax(moved)]) if moved.any() else None


def recording_figures(
    recording: Trajectory, cylinder: SteeringCylinder, chain: MeasuringChain = PUBLISHED
) -> dict[str, float | None]:
    """Figures of a recording by its kind: a full turn, a drive, or any other commands.

    Args:
        recording: What the twin did.
        cylinder: One of the machine's two steering cylinders.
        chain: What samples the angle of a full turn, and makes its flow.
    """
    turn = recording.manoeuvre.turn
    figures: dict[str, float | None] = {}
    if turn:
        ticks, angle = chain.sampled(recording.time, recording["joint_angle"])
        figures |= key_figures(ticks, angle, cylinder, chain=chain)
        raw = key_figures(recording.time, recording["joint_angle"], cylinder, flow=recording["joint_flow"])
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
    if "crane_tip_load" in recording:
        figures |= _crane_figures(recording)
    figures["lowest_engine_speed_rpm"] = float(recording["engine_speed"].min()) / RPM
    return figures


def _crane_figures(recording: Trajectory) -> dict[str, float | None]:
    """How far each joint of a crane came, the highest pressure, flow and force on its tip, and how far the machine leant."""
    ends = {joint: recording[f"crane_joint_{joint}"][-1] - recording[f"crane_joint_{joint}"][0] for joint in JOINTS}
    chambers = [recording[f"crane_pressure_{side}_{joint}"].max() for side in ("bore", "annulus") for joint in JOINTS]
    flow = np.sum([recording[f"crane_flow_{joint}"] for joint in JOINTS], axis=0)
    lean = np.arccos(np.cos(recording["roll"]) * np.cos(recording["pitch"]))
    return {
        **{f"crane_{joint}_travel_deg": float(ends[joint]) / DEGREE for joint in JOINTS[:3]},
        "crane_telescope_travel_m": float(ends["telescope"]),
        "highest_crane_pressure_bar": float(np.max(chambers)) / BAR,
        "highest_crane_flow_L_per_min": float(flow.max()) / LITRE_PER_MINUTE,
        "largest_tip_load_kN": float(recording["crane_tip_load"].max()) / 1e3,
        "largest_lean_deg": float(lean.max()) / DEGREE,
    }


def _drive_figures(recording: Trajectory) -> dict[str, float | None]:
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


@dataclass(frozen=True)
class Span:
    """Where N turns begin and end in their recordings; every attribute has shape (N,)."""

    direction: NDArray[np.float64]  # +1 left, -1 right, 0 nowhere
    first: NDArray[np.int64]  # sample at t = 0
    last: NDArray[np.int64]  # sample at the stop
    began: NDArray[np.float64]  # [s] instant of t = 0
    ended: NDArray[np.float64]  # [s] instant at the stop
    complete: NDArray[np.bool_]  # False: no rest before it, or never at its stop; `last` and `ended` mean nothing then


def turn_span(
    time: NDArray[np.float64],
    angle: NDArray[np.float64],
    half_range: ArrayLike,
    *,
    stop: ArrayLike | None = None,
    interpolate: bool = False,
) -> Span:
    """Begin and end of full turns, from their unfiltered angles.

    The start is the mean angle of the first half second. The joint has left it when it does so for good, and by more
    than it ever did in that half second, where noise makes that more than 0.1°. Without noise these are the angle at
    rest, and the first sample beyond 0.1°.

    Args:
        time: Evenly spaced instants [s] (F,).
        angle: Unfiltered joint angle [rad] (F, N).
        half_range: Angle [rad] of the stops, scalar or (N,).
        stop: Angle [rad] of the stop that each turn ends at, instead of ± ``half_range``.
        interpolate: Instants between samples, by straight lines.
    """
    frames, count = angle.shape
    rate = (frames - 1) / (time[-1] - time[0])
    each, rows = np.arange(count), np.arange(frames)[:, None]
    rest = round(STANDSTILL * rate)
    begin = angle[:rest]
    start = begin.mean(axis=0)
    direction = np.sign(angle[-1] - start)
    end = direction * half_range if stop is None else np.broadcast_to(np.asarray(stop, dtype=np.float64), count)
    turned, to_go = direction * (angle - start), direction * (end - angle)
    early, late = (np.abs(half - start).max(axis=0, initial=0.0) for half in (begin[: rest // 2], begin[rest // 2 :]))
    leaves = np.maximum(np.maximum(early, late), TOLERANCE)
    rested = (leaves <= _RESTLESS) & (late <= _STIRRED * np.maximum(early, TOLERANCE))

    second_half = to_go < turned
    halfway = np.where(second_half.any(axis=0), np.argmax(second_half, axis=0), frames)
    first = np.where((turned <= leaves) & (rows < halfway), rows, -1).max(axis=0) + 1
    there = (to_go <= TOLERANCE) & (rows > first)
    last = np.argmax(there, axis=0)
    complete = rested & (first >= rest) & there.any(axis=0)
    first = np.minimum(first, frames - 1)
    began, ended = time[first], time[last]
    if interpolate:
        began = began - np.clip(_crossing(turned[first - 1, each], turned[first, each], leaves), 0.0, 1.0) / rate
        # by the speed before it: the sample after the crossing may already stand on the stop
        two, one = to_go[last - 2, each], to_go[last - 1, each]
        ended = time[last - 1] + np.clip(-_crossing(two, one, TOLERANCE), 0.0, 1.0) / rate
    return Span(direction, first, last, began, ended, complete)


def _crossing(before: NDArray[np.float64], at: NDArray[np.float64], level: ArrayLike) -> NDArray[np.float64]:
    """Samples by which the straight line through two samples meets ``level`` before the second one."""
    step = at - before
    return np.where(step == 0.0, 0.0, (at - np.asarray(level)) / np.where(step == 0.0, 1.0, step))


def _extreme(
    values: NDArray[np.float64], within: NDArray[np.bool_], interpolate: bool
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Largest value (N,) of ``values`` (F, N) ``within``, and its row, with a part of a row if interpolated.

    NaN where there is nothing to look at. A maximum at the edge of the period stays a sample.
    """
    each = np.arange(values.shape[1])
    masked = np.where(within, values, -np.inf)
    row = np.argmax(masked, axis=0)
    top = np.where(within.any(axis=0), values[row, each], np.nan)
    if not interpolate:
        return top, row.astype(np.float64)
    lift, shift = vertex(values, row, within)
    return top + lift, row + shift


def vertex(
    values: NDArray[np.float64], row: NDArray[np.int64], within: NDArray[np.bool_] | None = None
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Vertex of the parabola through a maximum (N,) of ``values`` (F, N) and its neighbours: its height above the sample,
    and its distance from it in rows. Both are zero where a neighbour is missing, or not ``within``."""
    each = np.arange(values.shape[1])
    below, above = np.maximum(row - 1, 0), np.minimum(row + 1, values.shape[0] - 1)
    inside = (below < row) & (above > row)
    if within is not None:
        inside &= within[below, each] & within[above, each]
    rise, fall = values[row, each] - values[below, each], values[row, each] - values[above, each]
    curvature = rise + fall
    usable = inside & (curvature > 0.0)
    shift = np.where(usable, 0.5 * (rise - fall) / np.where(usable, curvature, 1.0), 0.0)
    return np.where(usable, 0.25 * (rise - fall) * shift, 0.0), shift
