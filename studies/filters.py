"""Which conclusions hang on the filter: key figures of the twin and of a machine by four filters.

    python -m studies.filters --out studies/filters_results

How the published curves were filtered is known in part: a fourth-order Butterworth low-pass at 7 Hz, seemingly without
phase. Here left turns at 100, 75 and 50 % go through it and through what could be meant by it or stand in its place: one
pass, the second order twice, a mean of seven samples. Three conclusions are drawn with each filter: which figures of the
published twin ``aoro`` meets, which figures of the published machine ``aoro_physical`` meets, and, where ``aoro_physical``
is the machine and turns five times with the sensor's noise, which figures of ``aoro``, means of as noisy turns, are
excellent or good (:mod:`aoro_gym.calibration.grades`). ``FOLDER`` gets ``figures.json`` and ``table.md``.
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from aoro_gym.calibration.grades import GRADES, graded
from aoro_gym.execution.files import read_json, write_json, write_text
from aoro_gym.machine import Machine
from aoro_gym.sensors.chain import PUBLISHED, SAMPLE_RATE, MeasuringChain, sample
from aoro_gym.sensors.joint_angle import JointAngleNoise, JointAngleSensor
from aoro_gym.simulation.key_figures import FIGURES, key_figures_batch
from aoro_gym.validation.published import published_rows
from aoro_gym.validation.study import TARGETS
from aoro_gym.validation.turns import Turn, TurnRecording, run_turns

FILTERS: Mapping[str, MeasuringChain] = {
    "fourth order twice": PUBLISHED,
    "one pass": MeasuringChain(zero_phase=False),
    "second order twice": MeasuringChain(order=2),
    "7-point mean": MeasuringChain(filter="moving_average", window=0.07),
}
"""Filters by name, the published one first."""
LEVELS = (100.0, 75.0, 50.0)
"""Signal [%] of the left turns."""
REPEATS = 5
"""Noisy turns of the machine that grades go by."""
SPREAD_RUNS = 200
"""Noisy turns that the noise of a figure is read from."""

Floats = NDArray[np.float64]


def figures_by_filter(recording: TurnRecording) -> dict[str, Floats]:
    """Key figures (levels, figures) of exact left turns, by filter."""
    ticks, angle = sample(recording.time, recording.angle[:, :, 0])
    return {
        name: np.stack(
            list(key_figures_batch(ticks, angle, recording.machine.variant(0), chain=chain).values()), axis=1
        )
        for name, chain in FILTERS.items()
    }


def noisy_figures(recording: TurnRecording, runs: int, seed: int) -> dict[str, Floats]:
    """Key figures (levels, figures, runs) of turns with the sensor's noise, the same turns for every filter."""
    every = round(1.0 / (SAMPLE_RATE * (recording.time[1] - recording.time[0])))
    sensor = JointAngleSensor(noise=JointAngleNoise.published())
    machine, count = recording.machine.variant(0), (len(recording.time) - every + 1) // every
    found: dict[str, list[Floats]] = {name: [] for name in FILTERS}
    for level, rng in enumerate(np.random.default_rng(seed).spawn(len(LEVELS))):
        picked = np.arange(count)[:, None] * every + rng.integers(every, size=runs)
        ticks, measured = sensor.record(recording.angle[picked, level, 0], np.arange(count) / SAMPLE_RATE, rng)
        for name, chain in FILTERS.items():
            found[name].append(np.stack(list(key_figures_batch(ticks, measured, machine, chain=chain).values())))
    return {name: np.stack(levels) for name, levels in found.items()}


def in_bounds(figures: Floats, source: str) -> NDArray[np.bool_]:
    """Which figures (levels, figures) are within the validation's bounds of a published row."""
    rows = {
        row["signal_percent"]: row for row in published_rows() if (row["source"], row["direction"]) == (source, "left")
    }
    known = np.array([[rows[level][name] for name in FIGURES] for level in LEVELS], dtype=np.float64)
    bounds = np.array([[limit * (one if kind == "relative" else 1.0) for one, (kind, limit) in
                        zip(row, TARGETS.values(), strict=True)] for row in known])  # fmt: skip
    return np.abs(figures - known) <= bounds + 1e-9


def grades_of(repeats: Floats, twin: Floats) -> list[list[str | None]]:
    """Grade of each figure (levels, figures) of the twin, by repeats (levels, figures, runs) of the machine."""
    out = []
    for runs, own in zip(repeats, twin, strict=True):
        time = float(np.nanmean(runs[0]))
        found = [graded(name, run, one, turn_time=time) for name, run, one in zip(FIGURES, runs, own, strict=True)]
        out.append([None if one is None else one.grade for one in found])
    return out


def study(device: str = "cpu", seed: int = 0) -> dict[str, Any]:
    """All of it, for JSON."""
    turns = [Turn("left", level) for level in LEVELS]
    twin, machine = (run_turns(Machine.load(name), turns, device=device) for name in ("aoro", "aoro_physical"))
    exact, machines = figures_by_filter(twin), figures_by_filter(machine)
    noisy, many = noisy_figures(machine, REPEATS, seed), noisy_figures(machine, SPREAD_RUNS, seed + 1)
    twins = noisy_figures(twin, SPREAD_RUNS, seed + 2)
    return {
        "figures": list(FIGURES), "levels": list(LEVELS), "repeats": REPEATS, "seed": seed,
        "filters": {
            name: {
                "aoro": np.round(exact[name], 4).tolist(),
                "aoro_physical": np.round(machines[name], 4).tolist(),
                "meets_the_published_twin": in_bounds(exact[name], "mevea").tolist(),
                "meets_the_machine": in_bounds(machines[name], "physical").tolist(),
                "grades": grades_of(noisy[name], np.nanmean(twins[name], axis=-1)),
                "std_of_noise": np.round(np.nanstd(many[name], axis=-1, ddof=1), 4).tolist(),
            }
            for name in FILTERS
        },
    }  # fmt: skip


def named(found: Mapping[str, Any], which: NDArray[np.bool_]) -> list[str]:
    """Words for figures (levels, figures), such as ``first peak at 75 %``."""
    words = [name.rsplit("_L_", 1)[0].removesuffix("_s").replace("_", " ") for name in found["figures"]]
    return [f"{words[k]} at {found['levels'][i]:g} %" for i, k in np.argwhere(which)]


def markdown(found: Mapping[str, Any]) -> str:
    """Conclusions by filter and what changes beside the published one; then the figures and their noise at 100 %."""
    filters = found["filters"]
    first = next(iter(filters.values()))
    rows = []
    for name, one in filters.items():
        met = [np.array(one[key]) for key in ("meets_the_published_twin", "meets_the_machine")]
        base = [np.array(first[key]) for key in ("meets_the_published_twin", "meets_the_machine")]
        grades, known = np.array(one["grades"], dtype=object), np.array(first["grades"], dtype=object)
        counts = ", ".join(str(int(np.sum(grades == grade))) for grade in GRADES)
        changed = [
            ("" if one is first else f": {len(words)} change ({', '.join(words)})" if words else ": the same")
            for words in (
                *(named(found, own != old) for own, old in zip(met, base, strict=True)), named(found, grades != known)
            )
        ]  # fmt: skip
        rows.append([name, f"{met[0].sum()}{changed[0]}", f"{met[1].sum()}{changed[1]}", f"{counts}{changed[2]}"])
    head = ["filter", "met of the published twin's 21, by `aoro`", "met of the machine's 21, by `aoro_physical`",
            "`aoro` beside five turns of `aoro_physical`: excellent, good, missed"]  # fmt: skip
    flows = [k for k, name in enumerate(found["figures"]) if k > 1]
    values = [
        [name, *(f"{one['aoro'][0][k]:.3g} ({one['std_of_noise'][0][k]:.2g})" for k in flows)]
        for name, one in filters.items()
    ]
    names = [named(found, np.eye(len(found["figures"]), dtype=bool)[k][None])[0].split(" at ")[0] for k in flows]
    return f"{_table(head, rows)}\n\n{_table(['`aoro` at 100 % (noise)', *names], values)}\n"


def _table(head: list[str], rows: list[list[str]]) -> str:
    return "\n".join(f"| {' | '.join(line)} |" for line in (head, ["---"] * len(head), *rows))


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--out", type=Path, required=True, help="folder of the results")
    parser.add_argument("--device", default="cpu", help="cpu, cpu:simd or cuda:N")
    parser.add_argument("--seed", type=int, default=0, help="of the sensor's noise")
    parser.add_argument("--table", action="store_true", help="only write table.md anew from figures.json in the folder")
    given = parser.parse_args()
    given.out.mkdir(parents=True, exist_ok=True)
    file = given.out / "figures.json"
    if not given.table:
        write_json(file, study(given.device, given.seed))
    write_text(given.out / "table.md", markdown(read_json(file)))
    print(markdown(read_json(file)))


if __name__ == "__main__":
    main()
