"""Full turns from stop to stop and their published key figures, from the joint angle as the logger has it."""

import math
from collections.abc import Mapping

import numpy as np
from scipy.signal import butter, sosfiltfilt

from aoro_gym.units import DEGREE, LITRE_PER_MINUTE

from .common import derived

PUBLISHED = {
    100: {"turn_time": 1.98, "mean_flow": 70.6, "first_peak": 104.4, "undershoot": 46.8},
    75: {"turn_time": 2.53, "mean_flow": 55.3, "first_peak": 92.3, "undershoot": 40.9},
    50: {"turn_time": 6.86, "mean_flow": 20.4, "first_peak": 32.4, "undershoot": 15.4},
}
"""Left turns of the real machine by share of the full signal [%]: time [s], flows [L/min]."""
PUBLISHED_RIGHT = {100: {"mean_flow": 65.4, "turn_time": 2.14}, 75: {"mean_flow": 43.2}, 50: {"mean_flow": 12.5}}
"""Right turns: mean flow [L/min] by the measured valve curve."""


def turn_command(share: float, duration: float, rest: float = 0.6, period: float = 0.01) -> np.ndarray:
    """Command of a turn: rest, then ``share`` (positive left) until ``duration`` [s]."""
    command = np.full(round(duration / period), share)
    command[: round(rest / period)] = 0.0
    return command


def key_figures(angle: np.ndarray, machine: Mapping[str, float], period: float = 0.01) -> dict[str, float]:
    """Turn time [s], mean flow, first peak and its time, lowest undershoot [L/min]; nan where a turn is not whole."""
    made = derived(machine, {})
    sign = 1.0 if angle[-1] > angle[0] else -1.0
    turned = sign * (angle - angle[0])
    end = 2 * made["stop_angle"]
    left = np.flatnonzero(turned > 0.1 * DEGREE)
    whole = np.flatnonzero(turned > end - 0.1 * DEGREE)
    if not len(left) or not len(whole):
        return dict.fromkeys(("turn_time", "mean_flow", "first_peak", "first_peak_time", "undershoot"), math.nan)
    start, stop = left[0], whole[0]
    smooth = sosfiltfilt(butter(4, 7.0, fs=1.0 / period, output="sos"), angle)
    even = made["mount_squares"] - 2 * made["mount_across"] * np.cos(smooth)
    odd = 2 * made["mount_along"] * np.sin(smooth)
    area = made["bore_area"], made["annulus_area"]
    volume = area[0] * np.sqrt(even + odd) - area[1] * np.sqrt(even - odd)
    flow = sign * np.gradient(volume, period) / LITRE_PER_MINUTE
    time = (stop - start) * period
    early = flow[start : start + round(0.3 / period)]
    first = start + int(np.argmax(early))
    late = flow[first : min(start + round(0.7 / period), stop)]
    return {
        "turn_time": time,
        "mean_flow": (area[0] + area[1]) * made["stroke"] / time / LITRE_PER_MINUTE,
        "first_peak": float(early.max()),
        "first_peak_time": (first - start) * period,
        "undershoot": float(late.min()) if len(late) else math.nan,
    }
