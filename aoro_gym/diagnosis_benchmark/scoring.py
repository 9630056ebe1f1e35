"""The score of a diagnosis on cases whose answers were withheld: figures with intervals, and every failure by name.

A diagnosis *names* the effects of its first cause if its verdict is that there is a cause, or several that it cannot tell
apart; no gap, calibration, unknown and inconclusive name nothing, whatever stands first. Effects that no log of a kind can
tell apart (classes) count as one. What can be seen of a case at all, an oracle says (:mod:`.oracle`). A case whose diagnosis
failed counts against every share that it belongs to.
"""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import warp as wp
from scipy.stats import binomtest

from aoro_gym.diagnosis.recording import SENSORS
from aoro_gym.diagnosis.replay import Simulator
from aoro_gym.diagnosis.result import CALIBRATION, UNKNOWN, VERDICTS
from aoro_gym.diagnosis_benchmark.cases import KINDS
from aoro_gym.diagnosis_benchmark.oracle import Neighbours, Oracle, consult
from aoro_gym.diagnosis_benchmark.running import read_diagnoses
from aoro_gym.diagnosis_benchmark.sealing import exact_folder, open_seal
from aoro_gym.execution.digest import code_digest, digest
from aoro_gym.execution.files import read_json, write_json
from aoro_gym.execution.locking import locked
from aoro_gym.execution.workers import Tell, spread

CONFIDENCE = 0.95
"""Of the figures' intervals."""
RESAMPLES = 9999
"""Of a bootstrap."""
SURE = 0.8
"""Probability from which a wrong name is a grave error."""
FAILED = "failed"
"""Verdict of a diagnosis that ended with an error."""
NAMING = ("cause", "ambiguous")
"""Verdicts that name the effects of the first cause."""
KNOWN = ("single", "pair")
"""Kinds of cases whose effects are in the catalogue."""
CLASSES = Path(__file__).with_name("classes.json")

Classes = Sequence[frozenset[str]]
"""Sets of effects that cannot be told apart."""


@dataclass(frozen=True)
class ScoredCase:
    """Truth and diagnosis of a case.

    Attributes:
        name: Its number.
        kind: One of :data:`aoro_gym.diagnosis_benchmark.cases.KINDS`.
        level: Of the plant's laws.
        truth: By effect: component, unit, magnitude (ΔQ, SI, one a part), severity.
        oracle: What can be seen; None if nothing is wrong.
        verdict: One of :data:`VERDICTS`, or :data:`FAILED`.
        diagnosis: As in ``diagnosis.json``; of a failed one its ``error``.
        classes: That effects are counted by.
    """

    name: str
    kind: str
    level: int
    truth: Mapping[str, Mapping[str, Any]]
    oracle: Oracle | None
    verdict: str
    diagnosis: Mapping[str, Any]
    classes: Classes = ()

    @property
    def detectable(self) -> bool:
        return self.oracle is not None and self.oracle.detectable

    @property
    def each_detectable(self) -> bool:
        return self.oracle is not None and self.oracle.each_detectable

    @property
    def first(self) -> Mapping[str, Any]:
        """The first cause."""
        return next(iter(self.diagnosis.get("causes", ())), {"effects": [], "probability": 0.0})

    @property
    def named(self) -> tuple[str, ...]:
        """Effects that the diagnosis names."""
        effects = tuple(self.first["effects"]) if self.verdict in NAMING else ()
        return () if effects in ((UNKNOWN,), (CALIBRATION,)) else effects

    def alike(self, effects: Iterable[str]) -> Counter[str]:
        """``effects``, each by the first of its class."""
        return Counter(next((min(c) for c in self.classes if effect in c), effect) for effect in effects)

    @property
    def right(self) -> bool:
        """Whether the first cause is the truth, named or not."""
        return self.alike(self.first["effects"]) == self.alike(self.truth)

    @property
    def failed(self) -> bool:
        return self.verdict == FAILED

    @property
    def said(self) -> str:
        """What it says in a word: the effect, or why none."""
        if self.verdict in NAMING:
            return {0: "nothing", 1: "".join(self.first["effects"])}.get(len(self.first["effects"]), TWO)
        return {"no_gap": "nothing"}.get(self.verdict, self.verdict)


TWO = "two effects"


# ------------------------------------------------------------------------------------------------------------------ figures
@dataclass(frozen=True)
class Figure:
    """One thing that a diagnosis must show.

    Attributes:
        id: Key of the JSON.
        title: What is counted.
        statistic: ``share`` of values that are 1, ``mean`` or ``median``.
        values: Of a case; none if it does not belong.
        bounds: By sensors, the least and largest value that is asked of the standard suite; none if nothing is.
        detectable: Whether only cases with a detectable deviation are judged.
        each: Whether a deviation is detectable only if each of its effects is.
        good: The value of a share that is no failure.
    """

    id: str
    title: str
    statistic: str
    values: Callable[[ScoredCase], Sequence[float]]
    bounds: Mapping[str, tuple[float, float]]
    detectable: bool = False
    each: bool = False
    good: float = 1.0


def _of(
    kinds: Sequence[str], question: Callable[[ScoredCase], bool], *, failed: bool
) -> Callable[[ScoredCase], Sequence[float]]:
    """Values of a share: the answer to ``question`` for cases of these ``kinds``, and ``failed`` for failed ones."""
    return lambda case: [float(failed if case.failed else question(case))] if case.kind in kinds else []


def _wrong_and_sure(case: ScoredCase) -> bool:
    effects = tuple(case.first["effects"])
    return effects not in ((), (UNKNOWN,), (CALIBRATION,)) and case.first["probability"] >= SURE and not case.right


def _false_and_sure(case: ScoredCase) -> bool:
    return _wrong_and_sure(case) and not case.alike(case.first["effects"]) <= case.alike(case.truth)


def _declared(case: ScoredCase) -> bool:
    return bool(case.alike(case.truth) & case.alike(case.diagnosis["declared_set"]))


def _declared_size(case: ScoredCase) -> Sequence[float]:
    return [float(len(case.alike(case.diagnosis["declared_set"])))] if case.kind == "single" and not case.failed else []


def _right_component(case: ScoredCase) -> bool:
    components = case.diagnosis["components"]
    return bool(components) and max(components, key=components.__getitem__) in {
        one["component"] for one in case.truth.values()
    }


def _covered(case: ScoredCase) -> Sequence[float]:
    """One a quantity that plant and twin both measure: the twin has a second one for some effects."""
    values = []
    for effect in (name for name in case.truth if name in case.named):
        true, found = case.truth[effect], case.first["magnitudes"].get(effect)
        if found is None:
            values += [0.0] * len(true["magnitude"])
            continue
        for size, part in zip(true["magnitude"], found["parts"], strict=False):
            if part["unit"] != true["unit"]:
                raise ValueError(
                    f"case {case.name}: the size of {effect} is in {part['unit']}, but its plant's in {true['unit']}; let "
                    "both measure the same quantity"
                )
            values.append(float(part["low90"] <= size <= part["high90"]))
    return values


def _shrunk(refitted: bool) -> Callable[[ScoredCase], Sequence[float]]:
    """Median over the left-out logs and signals in which the deviation shows of S over S of the oracle.

    A diagnosis that has none of them has shrunk nothing, unless there is but one log, of which none can be left out.
    """

    def values(case: ScoredCase) -> Sequence[float]:
        if case.kind not in KNOWN or case.oracle is None or not case.oracle.shrinkage:
            return []
        if len(case.diagnosis.get("logs", ())) == 1:
            return []
        ratios = [
            one["S"] / case.oracle.shrinkage[one["manoeuvre"], one["signal"]]
            for one in case.diagnosis.get("shrinkage", ())
            if one["held_out"]
            and one["refitted"] == refitted
            and (one["manoeuvre"], one["signal"]) in case.oracle.shrinkage
        ]
        return [float(np.median(ratios)) if ratios else 0.0]

    return values


def _at_most(angle: float, full: float) -> dict[str, tuple[float, float]]:
    return {"angle": (0.0, angle), "full": (0.0, full)}


def _at_least(angle: float, full: float) -> dict[str, tuple[float, float]]:
    return {"angle": (angle, np.inf), "full": (full, np.inf)}


FIGURES: tuple[Figure, ...] = (
    Figure(
        "false_alarms", "nothing wrong: a cause, or something unknown, is reported", "share",
        _of(("null",), lambda case: case.verdict in (*NAMING, "unknown"), failed=True), _at_most(0.03, 0.03), good=0.0,
    ),
    Figure(
        "nuisances_recognised", "only nuisances moved: calibration or no gap is reported", "share",
        _of(("nuisance",), lambda case: case.verdict in ("calibration", "no_gap"), failed=False), {},
    ),
    Figure(
        "named_first", "one effect: it is named first", "share",
        _of(("single",), lambda case: bool(case.named) and case.right, failed=False), _at_least(0.80, 0.92),
        detectable=True,
    ),
    Figure(
        "declared", "one effect: it is in the declared set", "share", _of(("single",), _declared, failed=False),
        _at_least(0.95, 0.97),
    ),
    Figure("declared_size", "one effect: size of the declared set", "mean", _declared_size, _at_most(3.0, 1.5)),
    Figure(
        "pairs_both", "two effects: both are named", "share",
        _of(("pair",), lambda case: bool(case.named) and case.right, failed=False), _at_least(0.65, 0.85), each=True,
    ),
    Figure(
        "pairs_one", "two effects: at least one is named", "share",
        _of(("pair",), lambda case: bool(case.alike(case.named) & case.alike(case.truth)), failed=False),
        _at_least(0.95, 0.98),
    ),
    Figure(
        "outside_recognised", "an effect that the catalogue lacks: unknown is reported", "share",
        _of(("outside",), lambda case: case.verdict == "unknown", failed=False), _at_least(0.60, 0.90),
    ),
    Figure(
        "known_rejected", "one or two effects of the catalogue: unknown is reported", "share",
        _of(KNOWN, lambda case: case.verdict == "unknown", failed=True), _at_most(0.03, 0.03), detectable=True, good=0.0,
    ),
    Figure(
        "wrong_and_sure", f"any case: the first cause is wrong, at a probability of {SURE} or more", "share",
        _of(KINDS, _wrong_and_sure, failed=True), _at_most(0.05, 0.03),
        good=0.0,
    ),
    Figure(
        "false_and_sure", "the same, with an effect that is not there", "share",
        _of(KINDS, _false_and_sure, failed=True), {}, good=0.0,
    ),
    Figure(
        "coverage", "effects that are named: the 90 % interval holds the size", "share", _covered,
        {"angle": (0.86, 0.94), "full": (0.86, 0.94)},
    ),
    Figure(
        "shrinkage", "one or two effects: S over S of the oracle, left-out manoeuvres", "median", _shrunk(False),
        _at_least(0.90, 0.95), detectable=True,
    ),
    Figure(
        "shrinkage_refitted", "the same, left-out logs' clock and zero refitted", "median", _shrunk(True), {},
        detectable=True,
    ),
    Figure(
        "component", "one or two effects: the likeliest component is right", "share",
        _of(KNOWN, _right_component, failed=False), _at_least(0.75, 0.95),
    ),
)  # fmt: skip
"""What a diagnosis must show."""


@dataclass(frozen=True)
class Estimate:
    """A figure with its 95 % interval, of shares Wilson's, else of a bootstrap; None where no value gives it."""

    value: float | None
    low95: float | None
    high95: float | None
    count: int


def estimate(values: Sequence[float], statistic: str) -> Estimate:
    """``share`` of ones, ``mean`` or ``median`` of ``values``."""
    count = len(values)
    if not count:
        return Estimate(None, None, None, 0)
    if statistic == "share":
        ones = round(sum(values))
        interval = binomtest(ones, count).proportion_ci(CONFIDENCE, method="wilson")
        return Estimate(ones / count, float(interval.low), float(interval.high), count)
    reduce = {"mean": np.mean, "median": np.median}[statistic]
    value = float(reduce(values))
    if count == 1:
        return Estimate(value, None, None, 1)
    drawn = np.random.default_rng(0).choice(values, (RESAMPLES, count))
    tail = 0.5 * (1.0 - CONFIDENCE)
    low, high = np.quantile(reduce(drawn, axis=1), [tail, 1.0 - tail])
    return Estimate(value, float(low), float(high), count)


@dataclass(frozen=True)
class Outcome:
    """A figure over all cases that belong, over those with a detectable deviation, and of those that are judged by level
    and by effect."""

    figure: Figure
    all: Estimate
    detectable: Estimate
    levels: Mapping[int, Estimate]
    effects: Mapping[str, Estimate]
    bounds: tuple[float, float] | None

    @property
    def judged(self) -> Estimate:
        return self.detectable if self.figure.detectable else self.all

    @property
    def met(self) -> bool | None:
        """Whether the value lies within the bounds; None without bounds or value."""
        if self.bounds is None or self.judged.value is None:
            return None
        return self.bounds[0] <= self.judged.value <= self.bounds[1]


@dataclass(frozen=True)
class Score:
    """Figures of all cases."""

    about: Mapping[str, Any]
    cases: tuple[ScoredCase, ...]
    outcomes: Mapping[str, Outcome]

    @property
    def undetectable(self) -> tuple[ScoredCase, ...]:
        """Cases with a deviation that no oracle sees."""
        return tuple(case for case in self.cases if case.oracle is not None and not case.detectable)

    @property
    def confusion(self) -> dict[str, Counter[str]]:
        """How often what was said, by what is true; cases with two effects, which have no one truth, are left out."""
        table: dict[str, Counter[str]] = {}
        for case in self.cases:
            if case.kind != "pair":
                true = {"null": "nothing", "nuisance": CALIBRATION}.get(case.kind, "".join(case.truth))
                table.setdefault(true, Counter())[case.said] += 1
        return table

    def failures(self, case: ScoredCase) -> list[str]:
        """Ids of the shares in which ``case`` counts against the diagnosis, judged or not."""
        return [
            figure.id
            for figure in FIGURES
            if figure.statistic == "share" and any(value != figure.good for value in figure.values(case))
        ]

    def as_dict(self) -> dict[str, Any]:
        """Content of ``score.json``."""
        return {
            **self.about,
            "cases": len(self.cases),
            "figures": {
                name: {
                    "title": outcome.figure.title,
                    "statistic": outcome.figure.statistic,
                    "judged": "detectable" if outcome.figure.detectable else "all",
                    "bounds": outcome.bounds and [bound if np.isfinite(bound) else None for bound in outcome.bounds],
                    "met": outcome.met,
                    "all": vars(outcome.all),
                    "detectable": vars(outcome.detectable),
                    "levels": {str(level): vars(found) for level, found in outcome.levels.items()},
                    "effects": {effect: vars(found) for effect, found in outcome.effects.items()},
                }
                for name, outcome in self.outcomes.items()
            },
            "confusion": {true: dict(said) for true, said in self.confusion.items()},
            "by_case": {
                case.name: {
                    "kind": case.kind,
                    "level": case.level,
                    "effects": {name: dict(one) for name, one in case.truth.items()},
                    "evidence": case.oracle and case.oracle.evidence,
                    "evidence_in_noise": case.oracle and case.oracle.noise,
                    "evidence_of_each": case.oracle and dict(case.oracle.each),
                    "detectable": case.detectable,
                    "each_detectable": case.each_detectable,
                    "verdict": case.verdict,
                    "first_cause": list(case.first["effects"]),
                    "probability": case.first["probability"],
                    "declared_set": list(case.diagnosis.get("declared_set", ())),
                    "components": dict(case.diagnosis.get("components", {})),
                    "error": case.diagnosis.get("error"),
                    "values": {figure.id: list(values) for figure in FIGURES if (values := figure.values(case))},
                    "failures": self.failures(case),
                }
                for case in self.cases
            },
        }


def score(
    answers: Mapping[str, Any],
    diagnoses: Mapping[str, Mapping[str, Any] | str],
    oracles: Mapping[str, Oracle],
    *,
    sensors: str,
    classes: Classes = (),
) -> Score:
    """Hold diagnoses against the answers.

    Args:
        answers: Of the seal.
        diagnoses: Contents of ``diagnosis.json`` by case, or why there is none.
        oracles: By case that has a deviation.
        sensors: ``angle`` or ``full``: what the diagnoses were given.
        classes: Effects that count as one.

    Raises:
        ValueError: a case has no diagnosis, a verdict is unknown, or a size is of another quantity.
    """
    cases = []
    for name, answer in answers["cases"].items():
        if name not in diagnoses:
            raise ValueError(f"case {name} has no diagnosis; let 'aoro-gym blind run' end")
        found = diagnoses[name]
        diagnosis = {"error": found} if isinstance(found, str) else found
        verdict = FAILED if isinstance(found, str) else found["verdict"]
        if verdict not in (*VERDICTS, FAILED):
            raise ValueError(f"case {name} has the verdict {verdict!r}, but there are {', '.join(VERDICTS)}")
        oracle = oracles[name] if answer["effects"] else None
        cases.append(
            ScoredCase(
                name, answer["kind"], answer["level"], answer["effects"], oracle, verdict, diagnosis, tuple(classes)
            )
        )
    about = {key: answers[key] for key in ("suite", "mode", "family", "blind")}
    about |= {"sensors": sensors, "classes": [sorted(one) for one in classes]}
    outcomes = {figure.id: _outcome(figure, cases, sensors) for figure in FIGURES}
    return Score(about, tuple(cases), outcomes)


def _outcome(figure: Figure, cases: Sequence[ScoredCase], sensors: str) -> Outcome:
    def over(chosen: Iterable[ScoredCase]) -> Estimate:
        return estimate([value for case in chosen for value in figure.values(case)], figure.statistic)

    judged = [case for case in cases if figure.values(case) and (case.detectable or not figure.detectable)]
    return Outcome(
        figure,
        all=over(cases),
        detectable=over(case for case in cases if (case.each_detectable if figure.each else case.detectable)),
        levels={level: over(c for c in judged if c.level == level) for level in sorted({c.level for c in judged})},
        effects={
            effect: over(c for c in judged if effect in c.truth)
            for effect in sorted({e for c in judged for e in c.truth})
        },
        bounds=figure.bounds.get(sensors),
    )


def score_cases(
    folder: Path,
    answers: Path,
    diagnoses: Path,
    oracles: Path,
    *,
    device: str = "cpu",
    workers: int = 1,
    progress: Callable[[str, float], Any] = lambda sentence, share: None,
) -> Score:
    """Open the seal of a suite whose cases were all diagnosed, and score them.

    Args:
        folder: With ``cases`` and ``seal.json``.
        answers: File of the answers.
        diagnoses: Folder of the diagnoses.
        oracles: Folder that gets what an oracle says of each case, ``NNN.json``; what is there is not asked again.
        device: Where the oracle's twins run.
        workers: Processes that ask.
        progress: Called with a sentence and the share done.

    Raises:
        ValueError: cases lack a diagnosis, or cases and answers are not those that were sealed.
        ChildProcessError: no oracle can be had of a case; what others said is kept.
    """
    sensors, found = read_diagnoses(folder, diagnoses)
    sealed = open_seal(folder, answers)
    deviating = [name for name, answer in sealed["cases"].items() if answer["effects"]]
    told = _consulted(deviating, folder, answers, oracles, sensors, device, workers, progress)
    return score(sealed, found, told, sensors=sensors, classes=read_classes(sensors))


def _consulted(
    names: Sequence[str],
    folder: Path,
    answers: Path,
    out: Path,
    sensors: str,
    device: str,
    workers: int,
    progress: Callable[[str, float], Any],
) -> dict[str, Oracle]:
    """What the oracle says of the cases ``names``; files of other cases, or of another version's oracle, are replaced."""
    about = {"of": digest(code_digest(), read_json(folder / "seal.json")["sha256"], sensors, device.partition(":")[0])}

    def missing(name: str) -> bool:
        file = out / f"{name}.json"
        return not file.is_file() or read_json(file).get("of") != about["of"]

    waiting = [name for name in names if missing(name)]
    with locked(out):
        jobs = {
            name: (folder / "cases" / name, exact_folder(answers) / f"{name}.npz", sensors, device, out, about)
            for name in waiting
        }
        ended = spread(_consult, jobs, workers=workers)
        for done, (name, failure) in enumerate(ended, start=len(names) - len(jobs) + 1):
            if failure is not None:
                raise ChildProcessError(f"what can be seen of case {name} is not known: {failure.reason}")
            progress("what can be seen of each case", done / len(names))
    return {name: Oracle.of(read_json(out / f"{name}.json")) for name in names}


def _consult(
    tell: Tell, place: Path, exact: Path, sensors: str, device: str, out: Path, about: Mapping[str, Any]
) -> None:
    oracle = consult(place, exact, SENSORS[sensors], twins=_twins(device))
    write_json(out / f"{place.name}.json", {**about, **oracle.as_dict()})


@cache
def _twins(device: str) -> Neighbours:
    """Of all cases that this process asks of."""
    wp.config.log_level = wp.LOG_ERROR  # no banner of every process
    return Neighbours(Simulator(device))


def read_classes(sensors: str, path: Path = CLASSES) -> Classes:
    """Effects that logs of these ``sensors`` cannot tell apart; none without a file ``{"angle": [[ids]], "full": …}``."""
    if not path.is_file():
        return ()
    return tuple(frozenset(ids) for ids in json.loads(path.read_text(encoding="utf-8"))[sensors])
