"""Calibrates the networks on development plants, and tries that on families of plants left out.

``python -m studies.development FOLDER [--seed S] [--write]`` simulates 2,324 cases of plants with laws of four kinds (some
minutes of two cores), asks the networks that come with the package, and writes ``development.json`` and ``development.md``
into the folder: each level decided with what the others taught, for every set of sensors. With ``--write`` what all of
them teach goes to the package as ``calibration.json``.
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from aoro_gym.diagnosis.network import hypotheses
from aoro_gym.diagnosis.network.cases import case_of, posteriors, tokens_of
from aoro_gym.diagnosis.network.decision import SENSOR_SETS, Calibration, as_dict, calibrated, decide
from aoro_gym.diagnosis.network.forward import TRAINED, trained
from aoro_gym.effects.catalogue import IDS
from aoro_gym.execution.files import write_json, write_text, written_whole
from studies.development.cases import LEVELS, DevelopmentCase, kept, planned
from studies.development.rates import ROWS, Decided, Rate, rates

BATCH = 16
"""Cases that networks are asked about together."""


def truth_of(one: DevelopmentCase) -> int:
    """Number of the true hypothesis."""
    numbers = [IDS.index(name) for name in one.case.effects]
    effects = np.array([*numbers, -1, -1][:2])
    return int(hypotheses.number_of(effects, np.array(one.case.kind == "outside")))


def said(path: Path, cases: Sequence[DevelopmentCase], channels: Sequence[str]) -> np.ndarray:
    """Probabilities of the hypotheses (N, hypotheses), asked for where ``path`` has none."""
    if not path.exists():
        shown = [one.with_channels(channels) for one in cases]
        found = []
        for first in range(0, len(shown), BATCH):
            part = [case_of(one.later, one.healthy) for one in shown[first : first + BATCH]]
            tokens = tokens_of(trained(), np.concatenate([one.rows for one in part]))
            ends = np.cumsum([len(one.rows) for one in part]).tolist()
            for end, one in zip(ends, part, strict=True):
                own = [kept_tokens[None, end - len(one.rows) : end] for kept_tokens in tokens]
                found.append(posteriors(trained(), own)[0][0])
            print(f"{path.stem}: {min(first + BATCH, len(shown))} of {len(shown)} cases", flush=True)
        with written_whole(path) as temporary:
            np.save(temporary, np.array(found, dtype=np.float32), allow_pickle=False)
    return np.load(path).astype(np.float64)


def left_out(cases: Sequence[DevelopmentCase], probabilities: np.ndarray, truth: np.ndarray) -> list[Decided]:
    """Decisions on each level, calibrated on the others."""
    family = np.array([one.case.family for one in cases])
    found = []
    for name in dict.fromkeys(family.tolist()):
        calibration = calibrated(probabilities[family != name], truth[family != name])
        own = np.flatnonzero(family == name).tolist()
        found += [Decided(cases[k].case, decide(probabilities[k], calibration)) for k in own]
    return found


def table(by_set: Mapping[str, Mapping[str, Mapping[str, Rate]]]) -> str:
    """Markdown, a row a figure, a column a set of sensors, and the range over levels."""
    lines = ["| | " + " | ".join(by_set) + " |", "|---|" + "---|" * len(by_set)]
    for row, (title, _) in ROWS.items():
        cells = []
        for levels in by_set.values():
            whole = levels["all"].get(row)
            if whole is None:
                cells.append("-")
                continue
            scale, unit = (1.0, "") if row == "declared_size" else (100.0, " %")
            digits = 2 if row == "declared_size" else 1
            each = [scale * one[row].value for name, one in levels.items() if name != "all" and row in one]
            cells.append(
                f"{scale * whole.value:.{digits}f}{unit} ({scale * whole.low95:.{digits}f} to "
                f"{scale * whole.high95:.{digits}f}; by level {', '.join(f'{value:.{digits}f}' for value in each)})"
            )
        lines.append(f"| {title} | " + " | ".join(cells) + " |")
    return "\n".join(lines) + "\n"


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument(
        "--seed", type=int, default=7002, help="of the cases; those of the shipped calibration by default"
    )
    parser.add_argument("--write", action="store_true", help="calibrate the networks of the package")
    options = parser.parse_args()
    options.folder.mkdir(parents=True, exist_ok=True)
    made = planned(options.seed)
    cases = [one for level in LEVELS for one in kept(options.folder, made, level)]
    truth = np.array([truth_of(one) for one in cases])
    result: dict[str, Any] = {"seed": options.seed, "plan": made.digest, "cases": len(cases), "sets": {}}
    found: dict[str, Calibration] = {}
    by_set: dict[str, dict[str, dict[str, Rate]]] = {}
    for name, channels in SENSOR_SETS.items():
        probabilities = said(options.folder / f"said_{made.digest[:8]}_{name}.npy", cases, channels)
        decided = left_out(cases, probabilities, truth)
        levels = sorted({one.case.family for one in decided})
        by_set[name] = {"all": rates(decided)} | {
            level: rates([one for one in decided if one.case.family == level]) for level in levels
        }
        found[name] = calibrated(probabilities, truth)
        result["sets"][name] = {
            level: {row: asdict(rate) for row, rate in of.items()} for level, of in by_set[name].items()
        }
    write_json(options.folder / "development.json", result)
    write_text(options.folder / "development.md", table(by_set))
    print(table(by_set))
    if options.write:
        about = {"cases": "development plants", "seed": options.seed, "plan": made.digest}
        write_json(TRAINED / "calibration.json", about | {"sets": as_dict(found)})


if __name__ == "__main__":
    main()
