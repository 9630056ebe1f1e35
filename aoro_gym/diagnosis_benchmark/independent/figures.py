"""Figures of the independent plants: healthy turns, accuracy and speed. ``python -m`` prints them."""

import sys
import time

import numpy as np

from aoro_gym.units import BAR

from . import EFFECTS, FAMILIES, GROUP, OUTSIDE, Run, machine, nominal, recording, trace
from .group import Group
from .recording import STEP
from .turns import PUBLISHED, key_figures, turn_command

DURATION = {100: 3.2, 75: 4.2, 50: 9.5}  # [s] of a turn by share of the signal [%]
RULE = "|---|---|---|---|---|"
NAMES = ("turn_time", "mean_flow", "first_peak", "undershoot")


def turn(family: str, constants: dict[str, float], share: float, duration: float) -> Run:
    """A turn from one stop to the other."""
    start = -np.sign(share) * (constants["stop_angle"] - 2e-4)
    return Run(family, constants, turn_command(share, duration, 0.3), joint_angle=float(start))


def healthy_turns(count: int, seed: int = 11) -> list[str]:
    """Table rows of key figures: the nominal machine, and the middle 90 % of drawn ones with their share within 25 %."""
    rows = ["| family | signal | " + " | ".join(NAMES) + " |", "|---|---|---|---|---|---|"]
    for share, published in PUBLISHED.items():
        rows.append(f"| published | {share} % | " + " | ".join(f"{published[name]:.2f}" for name in NAMES) + " |")
    for family in FAMILIES:
        rng = np.random.default_rng(seed)
        machines = [nominal(family), *(machine(family, rng) for _ in range(count))]
        for share, published in PUBLISHED.items():
            logs = trace([turn(family, one, share / 100, DURATION[share]) for one in machines], period=0.01)
            got = [key_figures(log["angle"], one) for log, one in zip(logs, machines, strict=True)]
            cells = []
            for name in NAMES:
                values = np.array([one[name] for one in got])
                low, high = np.quantile(values[1:], [0.05, 0.95])
                within = 100 * np.mean(np.abs(values[1:] / published[name] - 1.0) < 0.25)
                cells.append(f"{values[0]:.2f} ({low:.2f}–{high:.2f}, {within:.0f} %)")
            rows.append(f"| {family} | {share} % | " + " | ".join(cells) + " |")
    return rows


def accuracy(count: int, seed: int = 2) -> list[str]:
    """Table rows of what half the step changes, over turns of drawn machines: largest and middle."""
    rows = ["| family | pressures, largest rms [bar] | median | angle, largest rms [rad] | median |", RULE]
    for family in FAMILIES:
        rng = np.random.default_rng(seed)
        shares = rng.uniform(0.4, 1.0, count) * rng.choice((-1.0, 1.0), count)
        runs = [turn(family, machine(family, rng), share, 3.0) for share in shares]
        whole, half = trace(runs, period=0.01), trace(runs, period=0.01, step=0.5 * STEP)

        def rms(name: str, whole: list = whole, half: list = half) -> np.ndarray:
            return np.array([np.sqrt(np.mean((a[name] - b[name]) ** 2)) for a, b in zip(whole, half, strict=True)])

        pressure = np.max([rms(name) for name in ("exact_a", "exact_b", "exact_pump")], axis=0) / BAR
        angle = rms("angle")
        cells = pressure.max(), np.median(pressure), angle.max(), np.median(angle)
        rows.append(f"| {family} | " + " | ".join(f"{value:.2g}" for value in cells) + " |")
    return rows


def speed(count: int, device: str = "cpu", group: Group = GROUP) -> list[str]:
    """Table rows of the time that logs of 4 s of a group's families take."""
    rows = ["| family | logs | wall clock [s] | processor time [s] | 10,000 logs on 2 free cores [min] |", RULE]
    command = np.r_[np.zeros(30), np.full(370, 0.7)]
    for family in group.families:
        runs = [Run(family, group.nominal(family), command, joint_angle=-0.6, seed=seed) for seed in range(count)]
        recording.record(group, runs[:1], device)
        wall, processor = time.perf_counter(), time.process_time()
        recording.record(group, runs, device)
        wall, processor = time.perf_counter() - wall, time.process_time() - processor
        minutes = processor / count * 1e4 / 2 / 60
        rows.append(f"| {family} | {count} | {wall:.1f} | {processor:.1f} | {minutes:.1f} |")
    return rows


def effects() -> list[str]:
    """Table rows of all effects."""
    signs = {(1,): "+", (-1,): "−", (1, -1): "±"}
    rows = ["| effect | magnitude | unit | sizes | note |", RULE]
    for name, one in EFFECTS.items():
        size = f"{signs[one.signs]} {one.weak:g} … {one.strong:g}"
        rows.append(f"| `{name}` | {one.magnitude} | {one.unit} | {size} | {one.note} |")
    return rows


def deviations() -> list[str]:
    """Table rows of all deviations outside of the catalogue."""
    return ["| deviation | what |", "|---|---|", *(f"| `{name}` | {one.what} |" for name, one in OUTSIDE.items())]


def main() -> None:
    """Print all tables; the first argument is the number of machines and logs."""
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 64
    for title, rows in (
        ("Healthy turns", healthy_turns(count)),
        ("Accuracy", accuracy(count)),
        ("Speed", speed(count)),
        ("Effects", effects()),
        ("Deviations outside of the catalogue", deviations()),
    ):
        print(f"\n{title}\n", *rows, sep="\n")


if __name__ == "__main__":
    main()
