"""Calibrates the networks on development plants, and tries that on families of plants left out.

``python -m studies.development FOLDER [--networks NETWORKS] [--device cuda:0] [--seed S] [--write]`` simulates 2,324 cases
of layered plants, whose laws are of four kinds, and 1,515 each of the independent and of the component ones, of three
families each, asks of some networks, those that come with the package by default, such as never saw the family
(``studies.cross_fitting``), and writes ``development.json`` and ``development.md`` into the folder: each family decided with
what the other hand-written ones taught, for every set of sensors. With ``--write`` what the hand-written ones teach goes
beside the networks as ``calibration.json``. ``--cases 60`` tries all that out on the first 60 cases of each plan.
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, replace
from multiprocessing import get_context
from pathlib import Path

import numpy as np

from aoro_gym.diagnosis.network import hypotheses
from aoro_gym.diagnosis.network.decision import SENSOR_SETS, Calibration, as_dict, calibrated, decide, widening_of
from aoro_gym.diagnosis.network.forward import TRAINED
from aoro_gym.diagnosis_benchmark.judge.plants import Plants
from aoro_gym.diagnosis_benchmark.judge.suite import JudgedCase, Plan
from aoro_gym.effects.catalogue import EFFECTS, IDS
from aoro_gym.execution.files import write_json, write_text
from studies.development.answers import said
from studies.development.cases import (
    COMPONENT,
    DEVICE_TOGETHER,
    INDEPENDENT,
    LAYERED,
    SIZE_UNITS,
    TOGETHER,
    magnitudes,
    opened,
    planned,
    simulated,
)
from studies.development.rates import ROWS, Decided, Rate, rates
from studies.development.teachers import unbiased


def truth_of(case: JudgedCase) -> int:
    """Number of the true hypothesis."""
    numbers = [IDS.index(name) for name in case.effects]
    effects = np.array([*numbers, -1, -1][:2])
    return int(hypotheses.number_of(effects, np.array(case.kind == "outside")))


def true_sizes(made: Plan, plants: Plants) -> list[dict[str, float]]:
    """True change of each effect's magnitude by case of a family [SI], where plants and twin measure the same quantity."""
    own = [case for case in made.cases if case.family == plants.name]
    machines = {number: made.machine(plants, number) for number in {case.machine for case in own}}
    found = []
    for case in own:
        run = made.runs(case, plants, machines[case.machine])["logs"][0]
        sizes = {}
        for name, true in magnitudes(plants, case, run).items():
            unit = SIZE_UNITS.get((true["unit"], EFFECTS[name].operational[0].unit))
            if unit is not None:
                sizes[name] = unit * true["magnitude"][0]
        found.append(sizes)
    return found


def widened(
    decided: Sequence[Decided], quantiles: np.ndarray, sizes: Sequence[Mapping[str, float]], weights: np.ndarray
) -> float:
    """Factor on intervals of sizes: of the effects in the declared sets of noticed cases."""
    rows = [
        (k, IDS.index(name), size)
        for k, (one, true) in enumerate(zip(decided, sizes, strict=True))
        for name, size in true.items()
        if name in one.decision.declared
    ]
    case, effect = np.array([row[:2] for row in rows]).T
    return widening_of(quantiles[case, effect], np.array([row[2] for row in rows]), weights[case])


def calibrating(family: np.ndarray) -> np.ndarray:
    """Which cases (N,) networks are calibrated on: those of the hand-written families. Layered plants share the twin's
    circuit, and networks are surer of them than of a machine that nobody has modelled."""
    return np.isin(family, [plants.name for plants in (*INDEPENDENT, *COMPONENT)])


def family_weights(family: np.ndarray) -> np.ndarray:
    """Weights (N,) by which every family counts as much as another, whatever its number of cases."""
    names, place, counts = np.unique(family, return_inverse=True, return_counts=True)
    return len(family) / (len(names) * counts[place])


def left_out(cases: Sequence[JudgedCase], probabilities: np.ndarray, truth: np.ndarray) -> list[Decided]:
    """Decisions on each family, calibrated on the others that calibrate."""
    family = np.array([one.family for one in cases])
    found = []
    for name in dict.fromkeys(family.tolist()):
        own, others = family == name, calibrating(family) & (family != name)
        calibration = calibrated(probabilities[others], truth[others], family_weights(family[others]))
        found += [Decided(cases[k], decide(probabilities[k], calibration)) for k in np.flatnonzero(own).tolist()]
    return found


def table(by_set: Mapping[str, Mapping[str, Mapping[str, Rate]]], families: Sequence[str]) -> str:
    """Markdown, a row a figure, a column a set of sensors: of some families together, and of each.

    Args:
        by_set: Rates by set of sensors and family; those of all ``families`` together under their names, joined by a space.
        families: Which are shown.
    """
    lines = ["| | " + " | ".join(by_set) + " |", "|---|" + "---|" * len(by_set)]
    for row, (title, _) in ROWS.items():
        cells = []
        for of in by_set.values():
            whole = of[" ".join(families)].get(row)
            if whole is None:
                cells.append("-")
                continue
            scale, unit = (1.0, "") if row == "declared_size" else (100.0, " %")
            digits = 2 if row == "declared_size" else 1
            each = [f"{scale * of[name][row].value:.{digits}f}" for name in families if row in of[name]]
            cells.append(
                f"{scale * whole.value:.{digits}f}{unit} ({scale * whole.low95:.{digits}f} to "
                f"{scale * whole.high95:.{digits}f}; each {', '.join(each)})"
            )
        lines.append(f"| {title} | " + " | ".join(cells) + " |")
    return "\n".join(lines) + "\n"


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument(
        "--seed", type=int, default=7002, help="of the layered plants; those of the shipped calibration by default"
    )
    parser.add_argument(
        "--networks", type=Path, default=TRAINED, help="folder of networks; those of the package by default"
    )
    parser.add_argument("--device", default="cpu", help="that simulates plants")
    parser.add_argument(
        "--workers",
        type=int,
        default=1,
        help="that simulate a family each, then ask networks of it, a set of sensors each",
    )
    parser.add_argument("--cases", type=int, help="of each plan, to try the study out; all by default")
    parser.add_argument("--write", action="store_true", help="calibrate the networks")
    options = parser.parse_args()
    options.folder.mkdir(parents=True, exist_ok=True)
    plans = [
        (replace(made, cases=made.cases[: options.cases]), [replace(one, device=options.device) for one in several])
        for made, several in ((planned(options.seed), LAYERED), *opened())
    ]
    together = TOGETHER if options.device == "cpu" else DEVICE_TOGETHER
    with ProcessPoolExecutor(options.workers, mp_context=get_context("spawn")) as pool:
        asked = [
            pool.submit(simulated, options.folder, made, plants, together)
            for made, several in plans
            for plants in several
        ]
        for number, one in enumerate(asked):
            print(f"{one.result().name}: {number + 1} of {len(asked)} families", flush=True)
        answers = {
            name: [
                pool.submit(said, options.folder, unbiased(options.networks, plants.name), made, plants, name)
                for made, several in plans
                for plants in several
            ]
            for name in SENSOR_SETS
        }
    cases = [case for made, several in plans for plants in several for case in made.cases if case.family == plants.name]
    truth, family = np.array([truth_of(one) for one in cases]), np.array([one.family for one in cases])
    sizes = [size for made, several in plans for plants in several for size in true_sizes(made, plants)]
    groups = [[plants.name for plants in several] for _, several in plans]
    tables = [*groups, [name for group in groups[1:] for name in group]]
    found: dict[str, Calibration] = {}
    by_set: dict[str, dict[str, dict[str, Rate]]] = {}
    for name in SENSOR_SETS:
        parts = [one.result() for one in answers[name]]
        probabilities, quantiles = (np.concatenate(part) for part in zip(*parts, strict=True))
        decided = left_out(cases, probabilities, truth)
        by_set[name] = {
            " ".join(names): rates([one for one in decided if one.case.family in names])
            for names in [*tables, *([one] for group in groups for one in group)]
        }
        own = np.flatnonzero(calibrating(family))
        weights = family_weights(family[own])
        found[name] = replace(
            calibrated(probabilities[own], truth[own], weights),
            widening=widened([decided[k] for k in own], quantiles[own], [sizes[k] for k in own], weights),
        )
    digests = [made.digest for made, _ in plans]
    shares = {
        name: {of: {row: asdict(rate) for row, rate in own.items()} for of, own in each.items()}
        for name, each in by_set.items()
    }
    write_json(
        options.folder / "development.json",
        {"seed": options.seed, "plans": digests, "cases": len(cases), "sets": shares},
    )
    told = "\n".join(f"{' '.join(names)}\n\n{table(by_set, names)}" for names in tables)
    write_text(options.folder / "development.md", told)
    print(told)
    if options.write:
        about = {"cases": "hand-written families of plants, each alike", "seed": options.seed, "plans": digests}
        write_json(options.networks / "calibration.json", about | {"sets": as_dict(found)})


if __name__ == "__main__":
    main()
