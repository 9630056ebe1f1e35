"""The judge's verdicts on a suite, its validation on families left out, and the score of the matcher and of the oracle.

``python -m studies.judge FOLDER [--suite NAME] [--seed S] [--device cuda:0]`` simulates what is not in the folder yet and
writes ``judge.json`` and ``judge.md`` into it. The small suite takes about a quarter of an hour on two busy cores.
"""

from __future__ import annotations

import argparse
from collections import defaultdict
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from aoro_gym.diagnosis_benchmark.judge.features import CHANNEL_SETS
from aoro_gym.diagnosis_benchmark.judge.library import Extent, Library, build
from aoro_gym.diagnosis_benchmark.judge.matcher import Matcher
from aoro_gym.diagnosis_benchmark.judge.observed import Observed, changed, judge_cases, observe
from aoro_gym.diagnosis_benchmark.judge.plants import LayeredPlants, Plants, judged_plants
from aoro_gym.diagnosis_benchmark.judge.score import ROWS, Judged, score
from aoro_gym.diagnosis_benchmark.judge.suite import SUITES, Plan, plan
from aoro_gym.diagnosis_benchmark.judge.verdicts import Reference, Verdict, validate
from aoro_gym.execution.files import write_json, write_text, written_whole

EXTENTS = {"small": Extent(12, 3, 2, (0.2, 0.6, 1.0)), "seal": Extent()}
LEVELS = (0, 1, 2, 3)


def library(folder: Path, made: Plan, device: str, plants: Plants) -> Library:
    """Library of a family, simulated on the device where the folder has none."""
    path = folder / f"library_{plants.name}_{made.digest[:8]}.npz"
    if not path.exists():
        told = list(made.excitations.values())
        together = 1 if device == "cpu" else len(told)
        extent = EXTENTS[made.suite.name]
        build(plants, told, extent, made.seed, lambda s: print(s, flush=True), together).save(path)
    return Library.load(path)


def changes(
    folder: Path, made: Plan, families: Sequence[Plants]
) -> tuple[dict[str, dict[str, Any]], dict[str, Observed]]:
    """Noisy differences (channels, means) of all cases by manoeuvre, and exact ones; simulated where the folder has none."""
    found: dict[str, dict[str, dict[str, Any]]] = defaultdict(lambda: defaultdict(dict))
    for plants in families:
        path = folder / f"changes_{plants.name}_{made.digest[:8]}.npz"
        if not path.exists():
            seen = observe(made, plants)
            arrays: dict[str, Any] = {}
            for name, one in seen.items():
                sets = {"noisy": changed(made, one.healthy, one.logs), "exact": one.change, **one.without}
                arrays |= {f"{name}/{s}/{m}": values for s, each in sets.items() for m, values in each.items()}
            with written_whole(path) as temporary:
                np.savez_compressed(temporary, **arrays)
            print(f"{plants.name}: {len(seen)} cases", flush=True)
        with np.load(path) as kept:
            for key in kept.files:
                case, what, manoeuvre = key.split("/")
                found[case][what][manoeuvre] = kept[key]
    noisy = {name: sets.pop("noisy") for name, sets in found.items()}
    return noisy, {name: Observed({}, {}, sets.pop("exact"), sets) for name, sets in found.items()}


def scores(
    made: Plan, books: Sequence[Library], noisy: Mapping[str, Any], verdicts: Mapping[str, Verdict], channel_set: str
) -> dict[str, Any]:
    """Scores of the matcher and of the oracle for one channel set.

    Args:
        made: The plan.
        books: Libraries of its families and of others.
        noisy: Differences by case.
        verdicts: Of the judge.
        channel_set: Which channels are read.
    """
    judged: dict[str, list[Judged]] = {"matcher": [], "oracle": []}
    for family, number in sorted({(case.family, case.protocol) for case in made.cases}):
        others = [one for one in books if one.family != family]
        (own,) = [one for one in books if one.family == family]
        matcher = Matcher.of(others, made.protocols[number], channel_set)
        oracle = matcher.knowing(Reference.of(others, made.protocols[number], channel_set, own=own))
        for case in made.cases:
            if (case.family, case.protocol) == (family, number):
                for name, method in (("matcher", matcher), ("oracle", oracle)):
                    verdict = verdicts[case.name].as_dict()
                    judged[name].append(Judged(case, verdict, {}, method.diagnose(noisy[case.name])))
    return {name: score(cases, channel_set) for name, cases in judged.items()}


def text(found: dict[str, Any]) -> str:
    """The score and the validation as Markdown."""
    sets = list(CHANNEL_SETS)

    def cell(one: dict[str, Any]) -> str:
        if one["value"] is None:
            return "–"
        return f"{one['value']:.2f} ({one['low95']:.2f}–{one['high95']:.2f}), {one['count']}"

    lines = ["| | " + " | ".join(f"{m}, {s}" for s in sets for m in ("matcher", "oracle")) + " |"]
    lines.append("|---|" + "---|" * (2 * len(sets)))
    titles = {row.id: row.title for row in ROWS} | {"loss": "loss from the easiest to the hardest family"}
    for row, title in titles.items():
        cells = [cell(found["score"][s][m][row]) for s in sets for m in ("matcher", "oracle")]
        lines.append(f"| {title} | " + " | ".join(cells) + " |")
    lines += [
        "",
        "| family left out | channels | false alarms | detectable | isolable | best by itself |",
        "|---|---|---|---|---|---|",
    ]
    for name in sets:
        for family, one in found["validation"][name].items():
            lines.append(
                f"| {family} | {name} | {one['false_alarms']} of {one['healthy']} | "
                f"{one['detectable']} of {one['effects']} | {one['isolable']} | {one['best']} |"
            )
    return "\n".join([*lines, ""])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--suite", choices=SUITES, default="small")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--device", default="cpu")
    options = parser.parse_args()
    judged = judged_plants("independent", options.device)
    made = plan(SUITES[options.suite], judged, options.seed)
    options.folder.mkdir(parents=True, exist_ok=True)
    print(f"plan {made.digest}: {len(made.cases)} cases", flush=True)
    families: list[Plants] = [*(LayeredPlants(level, options.device) for level in LEVELS), *judged]
    books = [library(options.folder, made, options.device, plants) for plants in families]
    noisy, seen = changes(options.folder, made, judged)
    verdicts = judge_cases(made, seen, books)
    found = {
        "suite": options.suite,
        "seed": options.seed,
        "plan": made.digest,
        "validation": {name: validate(books, made.protocols[0], name) for name in CHANNEL_SETS},
        "verdicts": {name: {case: one.as_dict() for case, one in each.items()} for name, each in verdicts.items()},
        "score": {name: scores(made, books, noisy, verdicts[name], name) for name in CHANNEL_SETS},
    }
    write_json(options.folder / "judge.json", found)
    write_text(options.folder / "judge.md", text(found))


if __name__ == "__main__":
    main()
