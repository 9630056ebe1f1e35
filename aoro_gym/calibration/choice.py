"""Which family of laws a machine's logs speak for: the one that predicts what it was not fitted to.

Logs are left out in turn (of a single log one half of its movement), each family is fitted to the rest and predicts what was
left out. A quick search screens all families; the two that predict best are fitted in full. A family is chosen by what it
predicts, never by its fit, and it is said where two of them cannot be told apart: where the 95 % interval of the ratio of
their errors, by the paired bootstrap over half seconds of the logs (Efron and Tibshirani, An Introduction to the Bootstrap,
1993), holds 1, or where both predict to within the noise.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import compress
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.stats import bootstrap

from aoro_gym.calibration.comparison import Comparison, Masks, joined
from aoro_gym.calibration.fit import (
    BOXES,
    USUAL_STEPS,
    costs,
    inward_steps,
    least_squares_fit,
    sound,
    steps_within,
)
from aoro_gym.calibration.published import IDENTIFIABLE
from aoro_gym.calibration.recordings import EVERY, FilteredLog
from aoro_gym.calibration.space import PRIOR_STD, Space
from aoro_gym.execution.digest import digest
from aoro_gym.execution.files import read_json, write_json
from aoro_gym.machine import Machine
from aoro_gym.machine.laws import FAMILIES, LAWS, OPTIONS, family

OWN = "file"
"""Name of the machine's own laws, where they are of no family."""
MOST_FOLDS = 3
"""Logs that are left out are dealt to so many parts at most."""
FINALISTS = 2
"""Families that are fitted in full."""
SCREENING_STEPS = 2
"""Gauss–Newton steps of the search that screens, from the data sheets on."""
FINAL_STEPS = 12
"""Gauss–Newton steps of a full fit, at most."""
BLOCK = 12
"""Samples of 40 ms of a block of the bootstrap: about half a second, longer than what parts machine and log holds on."""
WITHIN_NOISE = 1.0
"""Error [standard deviations of noise] below which nothing is told apart."""
DRAWS = 2000
"""Of the bootstrap."""
SCREENING = "search-screening.json"
"""What is kept of the screening, in the folder of an unfinished calibration."""

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Fold:
    """Samples that families are fitted to, and those that they predict."""

    name: str
    fitted: Masks
    left_out: Masks


@dataclass(frozen=True)
class Choice:
    """The machine of the laws that were chosen, and the report."""

    machine: Machine
    report: dict[str, Any]


@dataclass(frozen=True)
class _Candidate:
    """A family, and its parameters that the logs feel."""

    name: str
    space: Space
    points: tuple[Floats, ...]
    """Of each fold, where the screening came to."""
    blocks: Floats
    """Mean square of what is left of each block of what is predicted (B,), variances of noise."""


def searchable(machine: Machine) -> list[str]:
    """Keys that a calibration may change: uncertain parameters, and those of the laws that the machine obeys."""
    chosen = {law: OPTIONS[law][int(choice)] for law, choice in machine.laws.choices.items()}
    own = {key for law, option in chosen.items() for key in LAWS[law].parameters.get(option, ())}
    return [
        p.key
        for p in machine.parameters()
        if (p.role in ("nuisance", "both") or p.key in own) and p.range[0] < p.range[1]
    ]


def families_of(machine: Machine) -> list[str]:
    """Names of all families, and :data:`OWN` where the machine's laws are of none."""
    is_known = any(machine.laws.names == family(name).names for name in FAMILIES)
    return [*FAMILIES, *([] if is_known else [OWN])]


def folds_of(recordings: Sequence[FilteredLog]) -> tuple[Fold, ...]:
    """Logs dealt to :data:`MOST_FOLDS` parts, each left out once; of a single log the halves of its movement.

    Standstill at the begin is predicted by any machine, and not scored.
    """
    times = [np.arange(0, recording.count, EVERY) for recording in recordings]
    moving = [time >= recording.rest for time, recording in zip(times, recordings, strict=True)]
    if len(recordings) == 1:
        middle = times[0] >= (recordings[0].rest + recordings[0].count) // 2
        halves = (moving[0] & ~middle, moving[0] & middle)
        names = ("the first half of the movement", "the second half of the movement")
        return tuple(Fold(name, (~half,), (half,)) for name, half in zip(names, halves, strict=True))
    parts = min(MOST_FOLDS, len(recordings))
    folds = []
    for part in range(parts):
        out = [number % parts == part for number in range(len(recordings))]
        fitted = tuple(np.full(len(time), not left) for time, left in zip(times, out, strict=True))
        left_out = tuple(move & left for move, left in zip(moving, out, strict=True))
        folds.append(Fold(", ".join(one.path.name for one in compress(recordings, out)), fitted, left_out))
    return tuple(folds)


def choose_laws(
    comparison: Comparison,
    machine: Machine,
    families: Sequence[str],
    *,
    keys: Sequence[str] | None = None,
    pinned: Sequence[str] = (),
    quick: bool = False,
    seed: int = 0,
    folder: Path | None = None,
) -> Choice:
    """Choose the laws that predict best.

    Args:
        comparison: Recordings, and where machines repeat them.
        machine: Start of the searches; its ranges bound them.
        families: Names of the families, :data:`OWN` for the machine's own laws; at least two.
        keys: Parameters that may change; by default :func:`searchable` ones of each.
        pinned: Parameters that manifests fix.
        quick: Whether the screening decides alone, after one step.
        seed: Seed of the bootstrap.
        folder: Where finished parts are kept.

    Raises:
        ValueError: there is no family of a name, or no parameter shows in the logs.
    """
    candidates = {name: machine if name == OWN else machine.with_laws(name) for name in families}
    folds = folds_of(comparison.recordings)
    screened = _screened(comparison, candidates, folds, keys, pinned, 1 if quick else SCREENING_STEPS, folder)
    order = sorted(screened, key=lambda one: _score(one.blocks))
    for place, one in enumerate(order[:FINALISTS]):
        comparison.work.expect(
            {f"final {place} fold {k}": _full_work(len(one.space.keys), len(folds)) for k in range(len(folds))}
        )
    finals: dict[str, tuple[Floats, float]] = {}
    for place, one in enumerate(() if quick else order[:FINALISTS]):
        finals[one.name] = _full(comparison, one, folds, place, folder)
    scored = {one.name: finals[one.name][0] if one.name in finals else one.blocks for one in order}
    ranked = sorted(finals or scored, key=lambda name: _score(scored[name]))
    best = ranked[0]
    quickly = {one.name: one.blocks for one in order}
    rows, alike, unsure = [], [], []
    for one in sorted(order, key=lambda one: (one.name not in finals, _score(scored[one.name]))):
        known = finals.get(one.name)
        pair = (quickly if finals and known is None else scored)[best], scored[one.name]
        interval = None if one.name == best else ratio_interval(*pair, seed)
        if interval is not None and not is_apart(interval, *map(_score, pair)):
            (unsure if finals and known is None else alike).append(one.name)
        rows.append({
            "family": one.name, "searched": len(one.space.keys), "screening": _score(one.blocks),
            "predicted": None if known is None else _score(known[0]), "fit": None if known is None else known[1],
            "ratio_to_the_best_95": None if interval is None else list(interval),
        })  # fmt: skip
    report = {
        "chosen": best, "told_apart": not alike, "alike": alike, "alike_by_the_screening": unsure, "families": rows,
        "quick": quick, "left_out": [fold.name for fold in folds],
        "sentence": _sentence(best, scored, ranked, alike, unsure, quick=quick),
    }  # fmt: skip
    return Choice(candidates[best], report)


def phases(free: int, families: int, folds: int, *, quick: bool) -> dict[str, float]:
    """Work that a choice is expected to take, in machines that repeat all logs."""
    steps = 1 if quick else SCREENING_STEPS
    again = (folds * (free + 1) + 1) * (steps - 1)
    screening = {f"family {n}": free + 1.0 + again + steps * folds * (len(BOXES) + 1.0) for n in range(families)}
    full = {
        f"final {n} fold {k}": _full_work(free, folds) for n in range(min(FINALISTS, families)) for k in range(folds)
    }
    return screening | ({} if quick else full)


def _full_work(free: int, folds: int) -> float:
    """Work that a full fit without one of the folds is expected to take, in machines that repeat all logs."""
    share = 1.0 if folds < 2 else (folds - 1.0) / folds
    return USUAL_STEPS * (free + 1.0 + len(BOXES) + 1.0) * share


def ratio_interval(best: Floats, other: Floats, seed: int = 0) -> tuple[float, float]:
    """95 % interval of how many times as large the error of ``other`` is, both (B,) mean squares of the same blocks."""

    def ratio(one: Floats, two: Floats, axis: int = -1) -> Floats:
        return np.sqrt(np.mean(two, axis=axis) / np.mean(one, axis=axis))

    found = bootstrap(
        (best, other), ratio, paired=True, vectorized=True, method="percentile", n_resamples=DRAWS,
        rng=np.random.default_rng(seed),
    ).confidence_interval  # fmt: skip
    return float(found.low), float(found.high)


def is_apart(ratio: tuple[float, float], *errors: float) -> bool:
    """Whether two errors [standard deviations of noise] are told apart, by the 95 % interval of their ratio."""
    return not (ratio[0] <= 1.0 <= ratio[1] or max(errors) <= WITHIN_NOISE)


def _score(blocks: Floats) -> float:
    """Root mean square, standard deviations of noise."""
    return float(np.sqrt(np.mean(blocks)))


def _sentence(
    best: str,
    scored: Mapping[str, Floats],
    ranked: Sequence[str],
    alike: Sequence[str],
    unsure: Sequence[str],
    *,
    quick: bool,
) -> str:
    def named(names: Sequence[str]) -> str:
        return ", ".join(f"{name} ({_score(scored[name]):.3g})" for name in names)

    how = "by quick searches alone" if quick else f"{FINALISTS} of them fitted in full"
    said = (
        f"laws: {best}, of {len(scored)} families, {how}; predicts what was left out to {_score(scored[best]):.3g} standard"
        " deviations of noise"
    )
    said += f"; cannot be told apart from {named(alike)}" if alike else f"; told apart from {named(ranked[1:2])}"
    return f"{said}; nor did the quick searches tell it from {named(unsure)}" if unsure else said


def _screened(
    comparison: Comparison,
    candidates: Mapping[str, Machine],
    folds: Sequence[Fold],
    keys: Sequence[str] | None,
    pinned: Sequence[str],
    steps: int,
    folder: Path | None,
) -> list[_Candidate]:
    """All candidates after a quick search; what an interrupted call has found is kept."""
    file = None if folder is None else folder / SCREENING
    kept: dict[str, Any] = read_json(file) if file is not None and file.exists() else {}
    out = []
    for number, (name, machine) in enumerate(candidates.items()):
        free = [key for key in (keys or searchable(machine)) if key not in pinned]
        signature = digest(Space(machine, free).describe(), machine.laws.names, comparison.recordings, steps)
        known = kept.get(name)
        if known is None or known["signature"] != signature:
            comparison.work.begin(f"family {number}", f"screening laws: {name}, {number + 1} of {len(candidates)}")
            found = _quick(comparison, name, Space(machine, free), folds, steps)
            kept[name] = {
                "signature": signature, "keys": list(found.space.keys), "blocks": found.blocks.tolist(),
                "points": [point.tolist() for point in found.points],
            }  # fmt: skip
            if file is not None:
                write_json(file, kept)
        one = kept[name]
        points = tuple(np.array(point) for point in one["points"])
        out.append(_Candidate(name, Space(machine, one["keys"]), points, np.array(one["blocks"])))
    return out


def _quick(comparison: Comparison, name: str, space: Space, folds: Sequence[Fold], steps: int) -> _Candidate:
    """Some Gauss–Newton steps of each fold from the data sheets; the Jacobian there serves all folds."""
    prior = space.point()
    ahead = inward_steps(prior)
    parts = comparison.parts(space.population(np.vstack([prior, prior + np.diag(ahead)])))
    whole = sound(joined(comparison.rows(parts)))
    felt = PRIOR_STD * np.linalg.norm((whole[:, 1:] - whole[:, :1]) / ahead, axis=0) > IDENTIFIABLE
    if not np.any(felt):
        raise ValueError("no parameter that may change shows in the logs; the machine hardly moves in them")
    space, prior, which = Space(space.machine, list(compress(space.keys, felt))), prior[felt], np.r_[True, felt]
    points = []
    for fold in folds:
        fitted = replace(comparison, masks=fold.fitted)
        point, rows = prior, sound(joined(fitted.rows(parts)))[:, which]
        for step in range(steps):
            ahead = inward_steps(point)
            if step:
                rows = sound(fitted.misses(space.population(np.vstack([point, point + np.diag(ahead)]))))
            point = _step(fitted, space, point, (rows[:, 1:] - rows[:, :1]) / ahead, rows[:, 0])
        points.append(point)
    return _Candidate(name, space, tuple(points), _predicted(comparison, space, points, folds))


def _step(fitted: Comparison, space: Space, point: Floats, slopes: Floats, at: Floats) -> Floats:
    """The best of the points that a step within each box leads to, and of ``point`` itself."""
    prior, pull = space.point(), 1.0 / PRIOR_STD
    tried = steps_within(BOXES, slopes, at, point, prior, pull)
    rows = sound(fitted.misses(space.population(tried)))
    return tried[int(np.argmin(costs(rows, tried, prior, pull)))]


def _full(
    comparison: Comparison, one: _Candidate, folds: Sequence[Fold], place: int, folder: Path | None
) -> tuple[Floats, float]:
    """Blocks (B,) of what full fits predict, and the root mean square of what they leave of what they are fitted to."""
    points, squares = [], []
    for number, (fold, start) in enumerate(zip(folds, one.points, strict=True)):
        fitted = replace(comparison, masks=fold.fitted)
        comparison.work.begin(
            f"final {place} fold {number}", f"laws: {one.name}, without {fold.name}, {place + 1} of {FINALISTS}"
        )
        found = least_squares_fit(
            fitted.residuals(one.space), one.space.point(), prior_weight=1.0, starts=1, population=1, initial=start,
            max_iterations=FINAL_STEPS,
            problem=digest(one.space.describe(), one.space.machine.laws.names, comparison.recordings, fold.name),
            checkpoint=None if folder is None else folder / f"search-{one.name}-{number}.json",
        )[0]  # fmt: skip
        points.append(np.array(found.point))
        squares.append(np.square(found.residuals))
    return _predicted(comparison, one.space, points, folds), float(np.sqrt(np.mean(np.concatenate(squares))))


def _predicted(comparison: Comparison, space: Space, points: Sequence[Floats], folds: Sequence[Fold]) -> Floats:
    """Mean square (B,) of what is left of each block of the samples that were left out, over all channels."""
    blocks: list[float] = []
    for fold, point in zip(folds, points, strict=True):
        left_out = replace(comparison, masks=fold.left_out)
        for channels in left_out.rows(left_out.parts(space.population(point))).values():
            squares = np.mean(np.square(sound(np.hstack(channels))), axis=1)
            parts = np.array_split(squares, max(1, len(squares) // BLOCK))
            blocks += [float(np.mean(part)) for part in parts]
    return np.array(blocks)
