"""Whether chosen manoeuvres name the cause more often than random ones: on development plants with one effect each.

``python -m studies.next_experiments FOLDER [--cases N] [--worlds K] [--seed S]`` diagnoses plants of all levels of laws by
three logs, keeps those of whose cause the networks are not sure, and adds two manoeuvres of the catalogue: those that
promise most, two at random (the mean over all pairs), or all. Cases that the folder has are not done again;
``next_experiments.json`` and ``.md`` are written at the end. On a busy machine set ``OPENBLAS_NUM_THREADS=1``.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from aoro_gym.diagnosis.network import hypotheses
from aoro_gym.diagnosis.network.cases import case_of, posterior, posteriors, tokens_of
from aoro_gym.diagnosis.network.forward import trained
from aoro_gym.diagnosis.next_experiments import Prospects, catalogue, entropy, prospects
from aoro_gym.diagnosis.recording import REST, TICK, Recording
from aoro_gym.diagnosis.replay import Simulator
from aoro_gym.diagnosis_benchmark.cases import Excitation
from aoro_gym.diagnosis_benchmark.judge.plants import LayeredPlants, Log
from aoro_gym.diagnosis_benchmark.judge.suite import JudgedCase, Plan, Suite, plan
from aoro_gym.effects.catalogue import IDS
from aoro_gym.execution.files import write_json, write_text
from aoro_gym.machine import Machine

LEVELS = (0, 1, 2, 3)
LOGS = 3
ADDED = 2
"""Manoeuvres that are added."""
UNSURE = 0.9
"""Probability of the likeliest effect, below which there is something to find out."""
RESAMPLES = 10_000
"""Of the bootstrap over cases."""
CHANNELS = ("joint_angle", "pressure_a", "pressure_b", "pump_pressure")

CHOICES = ("chosen", "each", "fall")
TITLES = {
    "now": "three logs",
    "chosen": "two more, by what both promise",
    "each": "two more, by what each promises",
    "fall": "two more, by the fall of the entropy",
    "random": "two random more",
    "all": "all of the catalogue",
}
DAYS = ("healthy", "logs")

Floats = NDArray[np.floating[Any]]
Answer = dict[str, Any]
Days = dict[str, list[Recording]]


def recorded(log: Log, excitation: Excitation, name: str) -> Recording:
    """A plant's log as a diagnosis reads it."""
    drive = np.zeros_like(excitation.steering) if excitation.drive is None else excitation.drive
    count = len(log["joint_angle"])
    commands = np.stack([excitation.steering, drive], axis=1)[: count - 1]
    rest = round(REST / TICK)
    start = float(np.mean(log["joint_angle"][:rest]))
    channels = {channel: np.array(log[channel], dtype=np.float64) for channel in CHANNELS}
    return Recording(name, commands, channels, rest, start)


def excitations_of(machine: Machine) -> dict[str, Excitation]:
    """The catalogue of manoeuvres, as plants take them."""
    reach = float(np.asarray(machine.joint.range))
    return {one.name: Excitation(one.name, one.start_angle / reach, *one.commands.T) for one in catalogue(machine)}


def logs_of(
    made: Plan, plants: LayeredPlants, cases: Sequence[JudgedCase], more: Mapping[str, Excitation] | None = None
) -> list[Days]:
    """Recordings of each case of a level by day: of its own manoeuvres, or of ``more``."""
    told = []
    for case in cases:
        own = made.runs(case, plants, made.machine(plants, case.machine))
        if more is not None:
            seeds = np.random.default_rng([case.seed, 1]).integers(2**62, size=(2, len(more)))
            own = {
                day: [replace(own[day][0], excitation=e, seed=int(s)) for e, s in zip(more.values(), each, strict=True)]
                for day, each in zip(DAYS, seeds, strict=True)
            }
        told.append({day: own[day] for day in DAYS})
    logs = iter(plants.record([run for days in told for runs in days.values() for run in runs], exact=False))
    return [
        {
            day: [recorded(next(logs), run.excitation, f"{day}_{run.excitation.name}") for run in runs]
            for day, runs in days.items()
        }
        for days in told
    ]


def named(probabilities: Floats, truth: int) -> dict[str, float]:
    """Whether the true effect is the likeliest, its probability, and the entropy [bit]."""
    effects = probabilities @ hypotheses.MEMBERS
    return {
        "first": float(effects.argmax() == truth),
        "alone": float(probabilities.argmax() == hypotheses.SINGLE + truth),
        "probability": float(effects[truth]),
        "entropy": float(entropy(probabilities)),
    }


def judged(days: Days, more: Days, truth: int, worlds: int, seed: int) -> Answer:
    """What comes of a case by every way to choose from the catalogue, whose logs are ``more``."""
    machine, networks = Machine.load("aoro"), trained()
    now = posterior(networks, case_of(days["logs"], days["healthy"]))
    (found,) = prospects(
        days["logs"], days["healthy"], machine, networks, now, [CHANNELS], simulator=Simulator("cpu"), seed=seed,
        worlds=worlds,
    ) or (None,)  # fmt: skip
    count = len(more["logs"])
    tokens = tokens_of(networks, case_of(*(days[day] + more[day] for day in ("logs", "healthy"))).rows)

    def with_more(added: Sequence[int]) -> dict[str, float]:
        rows = [*range(LOGS), *(LOGS + number for number in added)]
        return named(posteriors(networks, [kept[None, rows] for kept in tokens])[0][0], truth)

    random = [with_more(pair) for pair in combinations(range(count), ADDED)]
    choices = ways(found) if found else {}
    said = {way: with_more(pair) for way, pair in choices.items()}
    chance = {key: float(np.mean([one[key] for one in random])) for key in random[0]}
    return {
        "now": named(now.probabilities, truth),
        **{way: said.get(way, chance) for way in CHOICES},
        "random": chance,
        "all": with_more(range(count)),
        "best": float(max(one["first"] for one in random)),
        "one": [with_more([number])["first"] for number in range(count)],
        "names": {way: [catalogue(machine)[number].name for number in pair] for way, pair in choices.items()},
        "pairs": random,
        "draws": draws(found) if found else {},
    }


def draws(found: Prospects) -> dict[str, Any]:
    """What choices are made by: of every draw the truth's probability and the entropy now and with each manoeuvre."""
    each = np.arange(len(found.truths))
    return {
        "truths": found.truths.tolist(),
        "now": found.now[found.truths].tolist(),
        "after": found.after[:, each, found.truths].tolist(),
        "entropy": entropy(found.after).tolist(),
    }


def ways(found: Prospects) -> dict[str, list[int]]:
    """Pairs of manoeuvres: by what both promise together, by what each promises, and by how far the entropy falls."""
    each = np.argsort(-np.nanmean(found.gains, axis=1))
    first = int(each[0])
    beside = np.nanmean(found.gains_beside(trained(), first), axis=1)
    beside[first] = -np.inf
    fall = np.argsort(np.nanmean(entropy(found.after), axis=1))
    return {"chosen": [first, int(beside.argmax())], "each": each[:ADDED].tolist(), "fall": fall[:ADDED].tolist()}


def open_cases(folder: Path, made: Plan, level: int) -> list[JudgedCase]:
    """Cases of a level that three logs leave open: something is likely, but no effect is sure. Kept in the folder."""
    path = folder / f"open_{made.digest[:8]}_{level}.json"
    plants = LayeredPlants(level)
    cases = [case for case in made.cases if case.family == plants.name]
    if not path.exists():
        names = []
        for case, days in zip(cases, logs_of(made, plants, cases), strict=True):
            now = posterior(trained(), case_of(days["logs"], days["healthy"]))
            if now.effects.max() < UNSURE and now.probabilities[hypotheses.NOTHING] < 0.5:
                names.append(case.name)
        write_json(path, {"open": names, "of": len(cases)})
        print(f"level {level}: {len(names)} of {len(cases)} cases are open", flush=True)
    names = json.loads(path.read_text(encoding="utf-8"))["open"]
    return [case for case in cases if case.name in names]


def answers_of(folder: Path, made: Plan, level: int, most: int, worlds: int) -> list[Answer]:
    """Answers of up to ``most`` open cases of a level; those that the folder lacks are found and kept."""
    cases = open_cases(folder, made, level)[:most]
    paths = [folder / f"case_{made.digest[:8]}_{worlds}_{case.name}.json" for case in cases]
    missing = [(case, path) for case, path in zip(cases, paths, strict=True) if not path.exists()]
    if missing:
        plants, left = LayeredPlants(level), [case for case, _ in missing]
        own = logs_of(made, plants, left)
        more = logs_of(made, plants, left, excitations_of(Machine.load("aoro")))
        for (case, path), days, others in zip(missing, own, more, strict=True):
            (effect,) = case.effects
            found = judged(days, others, IDS.index(effect), worlds, case.seed % 2**32)
            write_json(path, {"effect": effect, "level": level, **found})
            print(f"{case.name} {effect} {found['names'].get('chosen')}", flush=True)
    return [json.loads(path.read_text(encoding="utf-8")) for path in paths]


def summary(answers: Sequence[Answer], seed: int) -> dict[str, Any]:
    """Means by choice, and what choosing gains over chance with a bootstrap interval over cases."""
    keys = ("first", "alone", "probability", "entropy")
    means = {way: {key: float(np.mean([one[way][key] for one in answers])) for key in keys} for way in TITLES}
    rows = np.random.default_rng(seed).integers(len(answers), size=(RESAMPLES, len(answers)))
    over_random: dict[str, dict[str, Any]] = {}
    for way in (*CHOICES, "all"):
        over_random[way] = {}
        for key in keys:
            difference = np.array([one[way][key] - one["random"][key] for one in answers])
            low, high = np.quantile(difference[rows].mean(axis=1), [0.025, 0.975])
            over_random[way][key] = {"value": float(difference.mean()), "low95": float(low), "high95": float(high)}
    best = float(np.mean([one["best"] for one in answers]))
    return {"cases": len(answers), "means": means, "over_random": over_random, "some_pair_first": best}


def text(found: Mapping[str, Any]) -> str:
    """The summary as Markdown."""
    lines = [
        f"{found['cases']} open cases with one effect; {found['worlds']} causes drawn to choose by. Some pair of manoeuvres "
        f"names the cause first in {found['some_pair_first']:.3f}.", "",
        "| | named first | over random (95 %) | its hypothesis first | probability | entropy [bit] |",
        "|---|---|---|---|---|---|",
    ]  # fmt: skip
    for way, title in TITLES.items():
        one, over = found["means"][way], found["over_random"].get(way)
        gain = "–"
        if over:
            first = over["first"]
            gain = f"{first['value']:+.3f} ({first['low95']:+.3f} to {first['high95']:+.3f})"
        lines.append(
            f"| {title} | {one['first']:.3f} | {gain} | {one['alone']:.3f} | {one['probability']:.3f} | "
            f"{one['entropy']:.2f} |"
        )
    return "\n".join([*lines, ""])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--cases", type=int, default=120, help="open cases, at most")
    parser.add_argument("--singles", type=int, default=66, help="plants of each level, of which some are open")
    parser.add_argument("--worlds", type=int, default=8, help="causes that are drawn to choose by")
    parser.add_argument(
        "--level", type=int, choices=LEVELS, help="of the plants' laws: no more than its cases' answers"
    )
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    suite = Suite("next_experiments", 0, options.singles, 0, 0, machines=12, protocols=12, logs=LOGS, draws=4)
    made = plan(suite, [LayeredPlants(level) for level in LEVELS], options.seed)
    options.folder.mkdir(parents=True, exist_ok=True)
    most = -(-options.cases // len(LEVELS))
    answers = [
        one
        for level in (LEVELS if options.level is None else [options.level])
        for one in answers_of(options.folder, made, level, most, options.worlds)
    ]
    if options.level is not None:
        return
    found = {"plan": made.digest, "seed": options.seed, "worlds": options.worlds, **summary(answers, options.seed)}
    write_json(options.folder / "next_experiments.json", found)
    write_text(options.folder / "next_experiments.md", text(found))
    print(text(found))


if __name__ == "__main__":
    main()
