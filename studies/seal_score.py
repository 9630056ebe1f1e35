"""What the networks of the diagnosis name in a judged suite, beside what the judge says can be named.

``python -m studies.seal_score FOLDER ANSWERS OUT [--families sealed] [--workers N]`` reads the cases in ``FOLDER/stock``,
which :mod:`studies.seal` has made, asks the networks that come with the package with every usual set of sensors, and writes
``seal.json`` and ``seal.md`` into ``OUT``; what was asked is kept there. Names, declared sets and sizes are the networks' in
:func:`aoro_gym.diagnosis.diagnose.diagnose`, too, which looks first whether logs are credible and fits afterwards: neither
is done here.
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from functools import partial
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np

from aoro_gym.diagnosis.network.cases import case_of, posterior
from aoro_gym.diagnosis.network.decision import SENSOR_SETS, decide, shipped
from aoro_gym.diagnosis.network.forward import TRAINED, networks_in, trained
from aoro_gym.diagnosis.recording import logs_in, read_recording
from aoro_gym.diagnosis_benchmark.judge.plants import JUDGED, judged_plants
from aoro_gym.diagnosis_benchmark.judge.score import ROWS, Judged, score
from aoro_gym.diagnosis_benchmark.judge.suite import SUITES, Plan, plan
from aoro_gym.diagnosis_benchmark.sealing import digests
from aoro_gym.effects.catalogue import EFFECTS, IDS
from aoro_gym.execution.digest import Contents, digest
from aoro_gym.execution.files import read_json, write_json, write_text
from studies.development.cases import SIZE_UNITS

LISTED = 20
"""Hypotheses of a case that are kept."""


def asked(units: Mapping[str, str], place: Path) -> dict[str, Any]:
    """What the diagnosis of a case would say, by set of sensors, as ``diagnosis.json`` has it, magnitudes in ``units`` by
    effect; where a log is refused, its reader has told that something is wrong which no effect explains, which counts as
    ``unknown``."""
    try:
        days = [[read_recording(path) for path in logs_in(place / day)] for day in ("logs", "healthy")]
    except ValueError as error:
        refused = {"verdict": "unknown", "causes": [], "declared_set": [], "refused": str(error)}
        return dict.fromkeys(SENSOR_SETS, refused)
    found = {}
    for name, channels in SENSOR_SETS.items():
        later, healthy = (
            [replace(one, channels={key: one.channels[key] for key in channels}) for one in day] for day in days
        )
        said = posterior(trained(), case_of(later, healthy)).widened(shipped()[name].widening)
        decision = decide(said.probabilities, shipped()[name])
        named = [
            {"effects": list(effects), "probability": share, "magnitudes": _magnitudes(effects, said.quantiles, units)}
            for effects, share in decision.hypotheses[:LISTED]
        ]
        found[name] = {"verdict": decision.verdict, "causes": named, "declared_set": list(decision.declared)}
    return found


def _magnitudes(effects: Sequence[str], quantiles: np.ndarray, units: Mapping[str, str]) -> dict[str, dict[str, float]]:
    """Of effects whose plants measure the same quantity, in the plants' ``units``."""
    found = {}
    for effect in effects:
        if effect not in EFFECTS:
            continue
        pair = units[effect], EFFECTS[effect].operational[0].unit
        if pair in SIZE_UNITS:
            low, high = quantiles[IDS.index(effect), [0, -1]] / SIZE_UNITS[pair]
            found[effect] = {"low90": float(low), "high90": float(high)}
    return found


def judged(made: Plan, answers: Mapping[str, Any], said: Mapping[str, Any], name: str) -> list[Judged]:
    """Cases with the judge's verdict and what was said, for a set of sensors."""
    told = answers["cases"]
    return [
        Judged(case, told[case.name]["verdicts"][name], told[case.name]["effects"], said[case.name][name])
        for case in made.cases
    ]


def text(found: Mapping[str, Mapping[str, Any]]) -> str:
    """Markdown: a row a figure, a column a set of sensors; each family beside the whole."""
    lines = ["| | " + " | ".join(found) + " |", "|---|" + "---|" * len(found)]
    titles = {row.id: row.title for row in ROWS} | {"loss": "loss from the easiest family to the hardest"}
    for row, title in titles.items():
        cells = []
        for table in found.values():
            one = table[row]
            if one["value"] is None:
                cells.append("-")
                continue
            unit, scale, digits = ("", 1.0, 2) if row == "declared_size" else (" %", 100.0, 1)

            def shown(value: float, scale: float = scale, digits: int = digits) -> str:
                return f"{scale * value:.{digits}f}"

            families = ", ".join(
                f"{name} {shown(of['value'])}"
                for name, of in one.get("families", {}).items()
                if of["value"] is not None
            )
            goal = (
                ""
                if one.get("goal") is None
                else f"; asked {shown(one['goal'])}: {'met' if one['met'] else '**missed**'}"
            )
            cells.append(
                f"{shown(one['value'])}{unit} ({shown(one['low95'])} to {shown(one['high95'])}; of {one['count']}"
                f"{'; ' + families if families else ''}{goal})"
            )
        lines.append(f"| {title} | " + " | ".join(cells) + " |")
    return "\n".join(lines) + "\n"


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("answers", type=Path)
    parser.add_argument("out", type=Path)
    parser.add_argument("--families", choices=JUDGED, default="independent", help="whose plants are judged")
    parser.add_argument("--workers", type=int, default=2)
    options = parser.parse_args()
    suite, answers = options.folder / "stock", read_json(options.answers)
    sealed = read_json(suite / "seal.json")
    if digests(suite, options.answers) != sealed["sha256"]:
        raise SystemExit(f"{suite}: cases or answers are not those that were sealed")
    families = judged_plants(options.families)
    made = plan(SUITES[answers["suite"]], families, answers["seed"])
    told = digest(*map(Contents, [*networks_in(TRAINED), TRAINED / "calibration.json"]))
    kept = options.out / f"said_{made.digest[:8]}_{told[:8]}.json"
    said: dict[str, Any] = read_json(kept) if kept.exists() else {}
    units = {effect: one.unit for effect, one in families[0].PACKAGE.EFFECTS.items()}
    waiting = [case.name for case in made.cases if case.name not in said]
    with ProcessPoolExecutor(options.workers, mp_context=get_context("spawn")) as pool:
        answered = pool.map(partial(asked, units), [suite / "cases" / name for name in waiting], chunksize=4)
        for done, (name, one) in enumerate(zip(waiting, answered, strict=True), start=len(said) + 1):
            said[name] = one
            if done % 100 == 0 or done == len(made.cases):
                write_json(kept, said)
                print(f"{done} of {len(made.cases)} cases", flush=True)
    found = {name: score(judged(made, answers, said, name), name) for name in SENSOR_SETS}
    write_json(options.out / "seal.json", {"plan": made.digest, "sha256": sealed["sha256"], "score": found})
    write_text(options.out / "seal.md", text(found))
    print(text(found))


if __name__ == "__main__":
    main()
