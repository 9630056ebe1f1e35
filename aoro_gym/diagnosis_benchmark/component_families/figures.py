"""Figures of the component families: healthy turns beside the published ones, and speed. ``python -m`` prints them."""

import math
import sys
from collections.abc import Mapping

import numpy as np
from scipy.signal import butter, sosfiltfilt

from aoro_gym.diagnosis_benchmark.independent.figures import speed
from aoro_gym.units import BAR, DEGREE, LITRE_PER_MINUTE

from . import EFFECTS, FAMILIES, GROUP, OUTSIDE, Run, machine, nominal, trace, vehicle

PUBLISHED = {
    100: (1.98, 70.6, 69.0, 104.4, 0.15, 46.8, 88.7),
    75: (2.53, 55.3, 53.5, 92.3, 0.14, 40.9, 60.7),
    50: (6.86, 20.4, 19.9, 32.4, 0.08, 15.4, 24.7),
    -100: (2.14, 65.4, math.nan, math.nan, math.nan, math.nan, math.nan),
    -75: (3.24, 43.2, math.nan, math.nan, math.nan, math.nan, math.nan),
    -50: (11.2, 12.5, math.nan, math.nan, math.nan, math.nan, math.nan),
}
"""Of the real machine by share of the full signal [%], left positive: turn time [s], mean and steady flow, first peak
[L/min], its time [s], lowest undershoot, second peak [L/min]; right times follow from the measured mean flows."""
NAMES = ("turn time", "mean flow", "steady flow", "first peak", "its time", "undershoot", "second peak")
DURATION = {100: 3.2, 75: 4.4, 50: 10.5, -100: 3.4, -75: 5.2, -50: 16.0}
REST = 0.5
"""Rest [s] before a turn's command."""


def turn(family: str, made: Mapping[str, float], percent: int) -> Run:
    """A turn from one stop to the other."""
    command = np.full(round(DURATION[percent] / 0.01), percent / 100)
    command[: round(REST / 0.01)] = 0.0
    return Run(family, made, command, joint_angle=-float(np.sign(percent)) * (made["stop_angle"] - 2e-4))


def key_figures(angle: np.ndarray, made: Mapping[str, float], period: float = 0.01) -> np.ndarray:
    """The figures of :data:`PUBLISHED` of a turn by its angle (K,); nan where a turn is not whole."""
    shape = vehicle.geometry(made)
    sign = np.sign(angle[-1] - angle[0])
    turned = sign * (angle - angle[0])
    left = np.flatnonzero(turned > 0.1 * DEGREE)
    whole = np.flatnonzero(turned > 2 * made["stop_angle"] - 0.15 * DEGREE)
    if not len(left) or not len(whole):
        return np.full(len(NAMES), math.nan)
    start, stop = left[0], whole[0]
    smooth = sosfiltfilt(butter(4, 7.0, fs=1.0 / period, output="sos"), angle)
    even = shape["mount_squares"] - 2 * shape["mount_across"] * np.cos(smooth)
    odd = 2 * shape["mount_along"] * np.sin(smooth)
    volume = shape["bore_area"] * np.sqrt(even + odd) - shape["annulus_area"] * np.sqrt(even - odd)
    flow = sign * np.gradient(volume, period) / LITRE_PER_MINUTE
    span = (stop - start) * period

    def part(low: float, high: float) -> np.ndarray:
        return flow[start + round(low / period) : start + round(high / period)]

    first = int(np.argmax(part(0.0, 0.3))) * period
    mean = (shape["bore_area"] + shape["annulus_area"]) * shape["stroke"] / span / LITRE_PER_MINUTE
    peaks = part(0.0, 0.3).max(), first, part(first, 0.7).min(), part(0.55, 0.85).max()
    return np.array([span, mean, part(0.48 * span, 0.92 * span).mean(), *peaks])


def healthy_turns(count: int, seed: int = 11) -> list[str]:
    """Table rows of key figures: the nominal machine, and the middle 90 % of drawn ones."""
    rows = ["| family | signal | " + " | ".join(NAMES) + " | a, b in 0.3–0.9 T [bar] |", "|---" * 10 + "|"]
    for percent, published in PUBLISHED.items():
        rows.append(f"| published | {percent} % | " + " | ".join(f"{one:.2f}" for one in published) + " | |")
        for family in FAMILIES:
            rng = np.random.default_rng(seed)
            machines = [nominal(family), *(machine(family, rng) for _ in range(count))]
            logs = trace([turn(family, one, percent) for one in machines], period=0.01)
            got = np.array([key_figures(log["angle"], one) for log, one in zip(logs, machines, strict=True)])
            low, high = np.nanquantile(got[-count:], [0.05, 0.95], axis=0)
            cells = [f"{a:.2f} ({b:.2f}–{c:.2f})" for a, b, c in zip(got[0], low, high, strict=True)]
            middle = slice(*(round((REST + share * published[0]) / 0.01) for share in (0.3, 0.9)))
            ports = [np.mean(logs[0][name][middle]) / BAR for name in ("exact_a", "exact_b")]
            rows.append(f"| {family} | {percent} % | " + " | ".join(cells) + f" | {ports[0]:.0f}, {ports[1]:.0f} |")
    return rows


def tables() -> list[str]:
    """Table rows of all effects and deviations."""
    rows = ["| effect | magnitude | unit | signs | weak | strong |", "|---" * 6 + "|"]
    rows += [
        f"| `{name}` | {one.magnitude} | {one.unit} | {one.signs} | {one.weak:g} | {one.strong:g} |"
        for name, one in EFFECTS.items()
    ]
    return [*rows, "", *(f"- `{name}`: {one.what}" for name, one in OUTSIDE.items())]


def main() -> None:
    """Print all tables; the first argument is the number of machines and logs, the second the device for speed."""
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 16
    device = sys.argv[2] if len(sys.argv) > 2 else "cpu"
    print(*healthy_turns(count), "", *speed(count, device, GROUP), "", *tables(), sep="\n")


if __name__ == "__main__":
    main()
