"""What the networks of the diagnosis name in a judged suite, beside what the judge says can be named.

``python -m studies.seal_score FOLDER ANSWERS OUT [--families GROUP] [--workers N]`` reads the cases in ``FOLDER/stock``,
which :mod:`studies.seal` has made, asks the networks that come with the package with every usual set of sensors, and with
all of them without the healthy day, and writes ``seal.json`` and ``seal.md`` into ``OUT``; what was said is kept there, and
the cases are not needed again. Names, declared sets and sizes are the networks' in
:func:`aoro_gym.diagnosis.diagnose.diagnose`, too, which looks first whether logs are credible and fits afterwards: neither
is done here.
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np

from aoro_gym.diagnosis.network.cases import Posterior, case_of, posterior
from aoro_gym.diagnosis.network.decision import SENSOR_SETS, Calibration, decide, shipped
from aoro_gym.diagnosis.network.forward import TRAINED, networks_in, trained
from aoro_gym.diagnosis.network.hypotheses import MEMBERS
from aoro_gym.diagnosis.recording import logs_in, read_recording
from aoro_gym.diagnosis_benchmark.judge.plants import JUDGED, judged_plants
from aoro_gym.diagnosis_benchmark.judge.score import ROWS, Figure, Judged, figure, score
from aoro_gym.diagnosis_benchmark.judge.suite import SUITES, Plan, plan
from aoro_gym.diagnosis_benchmark.sealing import digests
from aoro_gym.effects.catalogue import EFFECTS, IDS
from aoro_gym.execution.digest import Contents, digest
from aoro_gym.execution.files import read_json, write_json, write_text, written_whole
from studies.development.cases import SIZE_UNITS

LISTED = 20
"""Hypotheses of a case that are kept."""
DAY_ONE = "day_one"
"""Name of what is asked with all sensors and without the healthy day."""
ASKED = {**SENSOR_SETS, DAY_ONE: SENSOR_SETS["pressures"]}
"""Channels of what is asked, by name."""
FIVE = 5
"""Effects of a day-one set."""


@dataclass(frozen=True)
class Said:
    """What K networks say of N cases, by name of :data:`ASKED`.

    Attributes:
        refused: Whether a case's logs were refused by their reader (N,).
        probabilities: Of the hypotheses (K, N, hypotheses); zeros where logs were refused.
        quantiles: Of sizes [SI] (K, N, effects, quantiles).
    """

    refused: np.ndarray
    probabilities: Mapping[str, np.ndarray]
    quantiles: Mapping[str, np.ndarray]

    def save(self, path: Path) -> None:
        """Write to a file (.npz)."""
        arrays = {f"probabilities/{name}": values for name, values in self.probabilities.items()}
        arrays |= {f"quantiles/{name}": values for name, values in self.quantiles.items()}
        with written_whole(path) as temporary:
            np.savez_compressed(temporary, allow_pickle=False, refused=self.refused, **arrays)

    @classmethod
    def load(cls, path: Path) -> Said:
        """Read what :meth:`save` has written."""
        with np.load(path) as kept:
            parts = [{name: kept[f"{part}/{name}"] for name in ASKED} for part in ("probabilities", "quantiles")]
            return cls(kept["refused"], *parts)


def asked(place: Path) -> tuple[list[np.ndarray], list[np.ndarray]] | None:
    """Probabilities (K, hypotheses) and quantiles [SI] (K, effects, quantiles) that each network says of a case, in the
    order of :data:`ASKED`; none where a log is refused."""
    try:
        days = [[read_recording(path) for path in logs_in(place / day)] for day in ("logs", "healthy")]
    except ValueError:
        return None
    probabilities, quantiles = [], []
    for name, channels in ASKED.items():
        later, healthy = (
            [replace(one, channels={key: one.channels[key] for key in channels}) for one in day] for day in days
        )
        case = case_of(later, () if name == DAY_ONE else healthy)
        each = [posterior([network], case) for network in trained()]
        probabilities.append(np.array([one.probabilities for one in each], dtype=np.float32))
        quantiles.append(np.array([one.quantiles for one in each], dtype=np.float32))
    return probabilities, quantiles


def said_of(places: Sequence[Path], workers: int) -> Said:
    """What the networks of the package say of cases."""
    with ProcessPoolExecutor(workers, mp_context=get_context("spawn")) as pool:
        found = []
        for one in pool.map(asked, places, chunksize=4):
            found.append(one)
            if len(found) % 100 == 0 or len(found) == len(places):
                print(f"{len(found)} of {len(places)} cases", flush=True)
    refused = np.array([one is None for one in found])
    blank = next(one for one in found if one is not None)
    blank = tuple([np.zeros_like(values) for values in part] for part in blank)
    parts = [
        {name: np.stack([(one or blank)[part][number] for one in found], axis=1) for number, name in enumerate(ASKED)}
        for part in range(2)
    ]
    return Said(refused, *parts)


def diagnoses(said: Said, name: str, calibration: Calibration, units: Mapping[str, str]) -> list[dict[str, Any]]:
    """What the diagnosis says of cases with a set of sensors, as ``diagnosis.json`` has it, magnitudes in ``units`` by
    effect. Where a log is refused, its reader has told that something is wrong which no effect explains: ``unknown``."""
    found: list[dict[str, Any]] = []
    means = said.probabilities[name].mean(axis=0, dtype=np.float64), said.quantiles[name].mean(axis=0, dtype=np.float64)
    for refused, probabilities, quantiles in zip(said.refused, *means, strict=True):
        if refused:
            found.append({"verdict": "unknown", "causes": [], "declared_set": []})
            continue
        decision = decide(probabilities, calibration)
        sizes = Posterior(probabilities, quantiles).widened(calibration.widening).quantiles
        named = [
            {"effects": list(effects), "probability": share, "magnitudes": _magnitudes(effects, sizes, units)}
            for effects, share in decision.hypotheses[:LISTED]
        ]
        found.append({"verdict": decision.verdict, "causes": named, "declared_set": list(decision.declared)})
    return found


def day_one(said: Said, cases: Sequence[Judged]) -> Figure:
    """Share of the detectable single effects that are among the :data:`FIVE` likeliest without a healthy day."""
    effects = said.probabilities[DAY_ONE].mean(axis=0, dtype=np.float64) @ MEMBERS
    likeliest = np.argsort(-effects, axis=1)[:, :FIVE]
    held = [
        [float(one.truth <= {IDS[number] for number in row})] if one.seen("single") else []
        for one, row in zip(cases, likeliest, strict=True)
    ]
    return figure(held, [(one.case.family, one.case.machine) for one in cases])


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


def judged(made: Plan, answers: Mapping[str, Any], said: Sequence[Mapping[str, Any]], name: str) -> list[Judged]:
    """Cases with the judge's verdict and what was said, in their order, for a set of sensors."""
    told = answers["cases"]
    return [
        Judged(case, told[case.name]["verdicts"][name], told[case.name]["effects"], one)
        for case, one in zip(made.cases, said, strict=True)
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
    answers = read_json(options.answers)
    families = judged_plants(options.families)
    made = plan(SUITES[answers["suite"]], families, answers["seed"])
    networks = digest(*map(Contents, networks_in(TRAINED)))
    kept = options.out / f"said_{made.digest[:8]}_{networks[:8]}.npz"
    if not kept.exists():
        suite = options.folder / "stock"
        if digests(suite, options.answers) != read_json(suite / "seal.json")["sha256"]:
            raise SystemExit(f"{suite}: cases or answers are not those that were sealed")
        said_of([suite / "cases" / case.name for case in made.cases], options.workers).save(kept)
    said, units = Said.load(kept), {effect: one.unit for effect, one in families[0].PACKAGE.EFFECTS.items()}
    found = {
        name: score(judged(made, answers, diagnoses(said, name, calibration, units), name), name)
        for name, calibration in shipped().items()
    }
    cases = judged(made, answers, [{}] * len(made.cases), "pressures")
    first = vars(day_one(said, cases))
    write_json(options.out / "seal.json", {"plan": made.digest, "networks": networks, "score": found, DAY_ONE: first})
    write_text(options.out / "seal.md", text(found))
    print(text(found))
    print(DAY_ONE, first)


if __name__ == "__main__":
    main()
