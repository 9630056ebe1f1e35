"""From recordings to a diagnosis: where the twin and its machine part, why, by how much, and what to record next.

Two questions, one path. *Commissioned*: healthy recordings exist. The twin is fitted to them first, what it still misses
there is subtracted from recordings of the same commands, and uncertain parameters may only have moved as from one day to
another. *Day one*: none exist; parameters may lie anywhere within their ranges, and are fitted to the recordings themselves.
"""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from aoro_gym.diagnosis.attribution import Trust, attribute, fit_p, trust_of, without
from aoro_gym.diagnosis.boundaries import boundaries, faulty_component
from aoro_gym.diagnosis.credible import credible
from aoro_gym.diagnosis.cross_entropy import Population, evolve
from aoro_gym.diagnosis.experiments import next_experiments
from aoro_gym.diagnosis.figures import key_figures
from aoro_gym.diagnosis.findings import (
    alike_effects,
    cause_of,
    components_of,
    declared_of,
    moved_by,
    row_of,
    verdict_of,
)
from aoro_gym.diagnosis.gap_closure import black_box, gap_closures, typical
from aoro_gym.diagnosis.linear import Hypothesis, Linear, Tangent
from aoro_gym.diagnosis.noise import Floats, ModelError, Noise, noise_of
from aoro_gym.diagnosis.nuisances import Nuisances
from aoro_gym.diagnosis.problem import Problem, Progress, references_of
from aoro_gym.diagnosis.recording import SENSORS, TICK, Recording, logs_in, read_recording
from aoro_gym.diagnosis.replay import Simulator, Variants
from aoro_gym.diagnosis.result import Curve, Diagnosis, GapClosure
from aoro_gym.diagnosis.search import settle
from aoro_gym.diagnosis.where import places
from aoro_gym.effects.catalogue import EFFECTS
from aoro_gym.effects.effect import Effect
from aoro_gym.machine import Machine

ERROR = ModelError(rate=0.003, pressure=0.010, swing=0.06, change=0.1, phase=0.05, sways=1.0)
"""The twin's own error: what remains between it and machines of other laws once it was fitted to them. While causes are
searched, pressures may sway as if it were not fitted, however well it was: with the least change of a machine, oscillations
that are hardly damped stay or die, and no search finds the fit that would follow them (E, machines of the development
family)."""
STAGES = 2
"""Of the fit of the uncertain parameters."""
FOLDS = 3
"""Parts of the recordings, each of which is left out once when it is asked how far the gap shrinks."""
LISTED = 1e-3
"""Probability below which a hypothesis is not listed."""
SURVIVING = 0.02
"""Probability below which a hypothesis gets no machine file."""


@dataclass(frozen=True)
class Logs:
    """Recordings by what they are for: to be explained, healthy, and held out of the fit."""

    recordings: Sequence[Recording]
    healthy: Sequence[Recording]
    held_out: Sequence[Recording]

    @property
    def channels(self) -> tuple[str, ...]:
        """Channels that all of them have."""
        return _common([*self.recordings, *self.healthy, *self.held_out])

    def comparable(self) -> Logs:
        """The same with their common channels only."""
        groups = (self.recordings, self.healthy, self.held_out)
        return Logs(*([_only(one, self.channels) for one in group] for group in groups))


@dataclass(frozen=True)
class Attributed:
    """A problem and its hypotheses, the likeliest first.

    Attributes:
        trust: How far what logs say is believed.
        linear: The problem's linear model around its fit.
        base: The twin that a cause is held against.
        before: What it outputs (D,) SI.
    """

    problem: Problem
    trust: Trust
    hypotheses: Sequence[Hypothesis]
    linear: Linear
    base: Machine
    before: Floats

    @property
    def best(self) -> Hypothesis | None:
        """The likeliest hypothesis whose fit was refined."""
        return next((h for h in self.hypotheses if h.refined), None)

    @property
    def best_cause(self) -> Hypothesis | None:
        """The same among those that name an effect."""
        return next((h for h in self.hypotheses if h.refined and h.effects), None)


def diagnose(
    recordings: Sequence[Recording],
    machine: Machine | str | Path = "aoro",
    effects: Mapping[str, Effect] = EFFECTS,
    *,
    healthy: Sequence[Recording] = (),
    held_out: Sequence[Recording] = (),
    commissioned: bool | None = None,
    simulator: Simulator | None = None,
    out: Path | None = None,
    progress: Progress = lambda sentence, share: None,
) -> Diagnosis:
    """Why ``recordings`` of a machine and its twin part. Those that no such machine can have made are left out
    (:mod:`.credible`); where none is left, the verdict is inconclusive.

    Args:
        recordings: To be explained (:func:`~aoro_gym.diagnosis.recording.read_recording`).
        machine: The twin.
        effects: Catalogue by id.
        healthy: Of the same machine while nothing was wrong; best of the same commands.
        held_out: Take no part in the fit; how far the gap shrinks is asked of them. By default every recording is left out
            once in turn of a fit of the cause that all of them name.
        commissioned: The machine file was fitted to this very machine; by default that is so where ``healthy`` is given.
        simulator: Where twins run; on the CPU by default.
        out: Folder for the machine files of the causes; none are written without it.
        progress: Called with a sentence and the share done.

    Raises:
        ValueError: there is no recording.
    """
    began = time.monotonic()
    if not recordings:
        raise ValueError("no recording given; name at least one log")
    given = machine if isinstance(machine, Machine) else Machine.load(machine)
    simulator = simulator or Simulator()
    mode = "commissioned" if commissioned or (healthy and commissioned is None) else "day-one"
    kept, doubts = credible((recordings, healthy, held_out), given, simulator)
    logs = Logs(*kept)
    if not logs.recordings or (healthy and not logs.healthy):
        doubts.append(f"No {'healthy ' if logs.recordings else ''}log is left, and nothing was diagnosed.")
        return _nothing_left(given, mode, recordings, healthy, doubts, began)
    logs = logs.comparable()
    found = _attributed(logs, given, mode, effects, simulator, progress)
    progress("where, how far, and what next", 0.85)
    return replace(
        _concluded(found, logs, given.name, mode, out),
        limitations=(*doubts, *_limitations(recordings, healthy, mode, logs.channels, effects)),
        seconds=time.monotonic() - began,
    )


def _attributed(
    logs: Logs, given: Machine, mode: str, effects: Mapping[str, Effect], simulator: Simulator, progress: Progress
) -> Attributed:
    """The hypotheses that explain the recordings."""
    problem, base, before = _fitted_problem(logs, given, mode, effects, simulator, progress)
    progress("what every effect does", 0.4)
    problem.learn()
    trust = trust_of(problem)
    hypotheses, linear = attribute(problem, trust, lambda s, share: progress(s, 0.5 + 0.35 * share))
    return Attributed(problem, trust, hypotheses, linear, base, before)


def _fitted_problem(
    logs: Logs, given: Machine, mode: str, effects: Mapping[str, Effect], simulator: Simulator, progress: Progress
) -> tuple[Problem, Machine, Floats]:
    """The problem of the recordings at the best fit of its uncertain parameters, the twin that a cause is held against, and
    what it outputs."""
    noise = _noise([*logs.healthy, *logs.recordings, *logs.held_out], logs.channels)
    of: dict[str, Any] = {"error": ERROR, "noise": noise, "simulator": simulator}
    twin, uncertain = given, None
    if logs.healthy:
        twin, uncertain, found = _commissioned(logs.healthy, given, of, lambda s, share: progress(s, 0.3 * share))
        of |= found
    elif mode == "day-one":
        twin = given.with_default_priors()
    nuisances = Nuisances(twin, "day" if mode == "commissioned" else "range", uncertain)
    problem = Problem(logs.recordings, nuisances, effects, **of)
    base, before = twin, problem.given
    if mode == "day-one":
        base, before = given, problem.simulate([Variants(given)])[:, 0]
        _fit(problem, lambda s, share: progress(s, 0.4 * share))
    return problem, base, before


def _concluded(found: Attributed, logs: Logs, machine: str, mode: str, out: Path | None) -> Diagnosis:
    """What follows from the hypotheses."""
    problem, hypotheses, linear, best = found.problem, found.hypotheses, found.linear, found.best
    where, where_p = places(problem, linear)
    parts = boundaries(problem, logs.healthy)
    fitted = None if best is None else problem.at(best.nuisances[None], best.effects, row_of(best))
    after = found.before if fitted is None else problem.simulate([fitted])[:, 0]
    shrinkage, controls = _gap_closure(found, after, logs.held_out)
    components = components_of(hypotheses, problem.effects)
    component = faulty_component(parts, components)
    nothing = next(h for h in hypotheses if not h.effects)
    return Diagnosis(
        machine=machine,
        mode=mode,
        logs=tuple(one.name for one in logs.recordings),
        healthy=tuple(one.name for one in logs.healthy),
        signals=logs.channels,
        verdict=verdict_of(hypotheses),
        where=tuple(replace(place, component=component) for place in where),
        where_p=where_p,
        boundaries=parts,
        components=components,
        causes=tuple(
            cause_of(problem, h, found.trust.laws, out if h.probability > SURVIVING else None)
            for h in hypotheses
            if h.probability > LISTED
        ),
        declared_set=declared_of(hypotheses, found.trust.declared),
        fit_test_p=None if best is None else fit_p(best, found.trust, nothing),
        shrinkage=shrinkage,
        controls=controls,
        key_figures={} if fitted is None else key_figures(problem, Variants(found.base), fitted),
        next_experiments=next_experiments(linear, hypotheses),
        calibration=moved_by(problem, best),
        alike=alike_effects(linear),
        curves=_curves(problem, found.before, after),
    )


def diagnose_case(place: Path, out: Path, *, sensors: str, device: str) -> Diagnosis:
    """Diagnose a case of the blind check: ``machine.toml``, ``logs/*.csv`` and, if there, ``healthy/*.csv`` in ``place``;
    writes ``diagnosis.json`` to ``out``."""
    from aoro_gym.diagnosis.sharing import simulator

    recordings, healthy = (
        [_only(read_recording(path), SENSORS[sensors]) for path in logs_in(place / purpose)]
        for purpose in ("logs", "healthy")
    )
    found = diagnose(recordings, place / "machine.toml", healthy=healthy, simulator=simulator(device))
    found.save(out)
    return found


def _fit(problem: Problem, progress: Progress) -> Tangent:
    """Move a problem to the best fit of its uncertain parameters, with its noise as loud as it is there. Slopes alone would
    lead to the valley that is next to the given machine, so a population goes first. Returns the tangent there."""
    problem.learn(effects=False)
    population = Population(problem)
    evolve([population], progress=lambda s, share: progress(s, 0.4 * share))
    problem.hold_to(population.best[0])
    settle(problem, 1, lambda s, share: progress(s, 0.4 + 0.25 * share))
    problem.louder()
    if problem.sound:
        problem.be_found(problem.misfits())
    return settle(problem, STAGES - 1, lambda s, share: progress(s, 0.65 + 0.35 * share))


def _commissioned(
    healthy: Sequence[Recording], given: Machine, of: Mapping[str, Any], progress: Progress
) -> tuple[Machine, Floats, dict[str, Any]]:
    """What ``healthy`` logs say: the twin that was fitted to them, the covariance of what they leave open, and the noise,
    the references and the misfit that a :class:`Problem` of later logs takes."""
    fit = Problem(healthy, Nuisances(given.with_default_priors(), "commissioning"), {}, sound=True, **of)
    tangent = _fit(fit, progress)
    found = {"noise": fit.noise, "references": references_of(fit), "misfit": fit.misfits()}
    return fit.machine, fit.uncertain(tangent.covariance), found


# ---- recordings ----


def _only(recording: Recording, channels: Sequence[str]) -> Recording:
    return replace(
        recording, channels={name: values for name, values in recording.channels.items() if name in channels}
    )


def _common(recordings: Sequence[Recording]) -> tuple[str, ...]:
    """Channels that all recordings have: one that is missing in some would be explained in others only."""
    return tuple(name for name in recordings[0].channels if all(name in one.channels for one in recordings))


def _noise(recordings: Sequence[Recording], channels: Sequence[str]) -> dict[str, Noise]:
    longest = max(one.ticks + 1 for one in recordings)
    return {name: noise_of(recordings, name, longest) for name in channels}


# ---- how far ----


def _gap_closure(
    found: Attributed, after: Floats, held_out: Sequence[Recording]
) -> tuple[tuple[GapClosure, ...], dict[str, float | None]]:
    """Closure of the gap in fitted and in held-out recordings, against the twin as it was given, and what a wrong cause and
    a black box get of the latter."""
    problem, best = found.problem, found.best_cause
    if best is None:
        return (), {"cause": None, "wrong_cause": None, "black_box": None}
    rivals = (h for h in found.hypotheses if h.refined and len(h.effects) == len(best.effects))
    wrong = next((h for h in rivals if not set(h.effects) & set(best.effects)), None)
    fitted = gap_closures(problem, found.before, after, held_out=False)
    if held_out:
        other = problem.of(held_out)
        start = other.simulate([Variants(found.base)])[:, 0]
        outputs = other.simulate(
            [other.at(_own_free(problem, other, h), h.effects, row_of(h)) for h in (best, wrong) if h]
        )
        left = gap_closures(other, start, outputs[:, 0], held_out=True)
        of_wrong = typical(gap_closures(other, start, outputs[:, 1], held_out=True)) if wrong else None
        of_box = black_box(problem, found.before, other, start)
    else:
        left, of_wrong, of_box = _in_turn(problem, found.linear, best, wrong, found.before)
    return (*fitted, *left), {"cause": typical(left), "wrong_cause": of_wrong, "black_box": of_box}


def _own_free(problem: Problem, other: Problem, hypothesis: Hypothesis) -> Floats:
    """The machine's nuisances of a hypothesis, with those of other recordings at zero: (1, u)."""
    felt = len(problem.felt)
    return np.concatenate([hypothesis.nuisances[:felt], np.zeros(len(other.centre) - len(other.nuisances.keys))])[None]


def _in_turn(
    problem: Problem, linear: Linear, best: Hypothesis, wrong: Hypothesis | None, before: Floats
) -> tuple[tuple[GapClosure, ...], float | None, float | None]:
    """Every recording left out once of a fit of the same cause."""
    count = len(problem.recordings)
    folds = [list(range(fold, count, FOLDS)) for fold in range(min(FOLDS, count))]
    if count < 2:
        return (), None, None
    causes = [best, *([wrong] if wrong else [])]
    refits = [[without(linear, fold, h) for fold in folds] for h in causes]
    batch = [problem.at(u[None], h.effects, z[None]) for h, fits in zip(causes, refits, strict=True) for u, z in fits]
    found = problem.simulate(batch)
    results: list[list[GapClosure]] = [[] for _ in causes]
    boxes = []
    for k in range(len(causes)):
        for f, fold in enumerate(folds):
            part, rows = problem.part(fold)
            results[k] += gap_closures(part, before[rows], found[rows, k * len(folds) + f], held_out=True)
            if k == 0:
                rest, kept = problem.part([i for i in range(count) if i not in fold])
                boxes.append(black_box(rest, before[kept], part, before[rows]))
    box = [one for one in boxes if one is not None]
    return (
        tuple(results[0]),
        typical(results[1]) if wrong else None,
        float(np.median(box)) if box else None,
    )


# ---- the rest ----


def _nothing_left(
    machine: Machine,
    mode: str,
    recordings: Sequence[Recording],
    healthy: Sequence[Recording],
    doubts: Sequence[str],
    began: float,
) -> Diagnosis:
    """Of recordings that cannot be believed."""
    return Diagnosis(
        machine=machine.name,
        mode=mode,
        logs=tuple(one.name for one in recordings),
        healthy=tuple(one.name for one in healthy),
        signals=_common(recordings),
        verdict="inconclusive",
        limitations=(*doubts, *(sentence for one in [*healthy, *recordings] for sentence in one.limitations)),
        seconds=time.monotonic() - began,
    )


def _curves(problem: Problem, before: Floats, after: Floats) -> tuple[Curve, ...]:
    stacked = (problem.measured, before, after)
    columns = zip(problem.blocks, *map(problem.split, stacked), problem.spread(after), strict=True)
    return tuple(
        Curve(
            problem.recordings[index].name, signal, False, TICK * np.arange(len(measured)), measured, old, new, spread
        )
        for (index, signal), measured, old, new, spread in columns
    )


def _limitations(
    recordings: Sequence[Recording],
    healthy: Sequence[Recording],
    mode: str,
    channels: Sequence[str],
    effects: Mapping[str, Effect],
) -> tuple[str, ...]:
    """What these recordings cannot say."""
    logs = [*healthy, *recordings]
    found = [sentence for one in logs for sentence in one.limitations]
    unused = dict.fromkeys(name for one in logs for name in one.channels if name not in channels)
    if unused:
        found.append(f"Not compared, as a log lacks it: {', '.join(unused)}.")
    if mode == "day-one":
        found.append(
            "No healthy recordings: what the twin's laws do otherwise than the machine's cannot be told from an effect, and "
            "free air in the oil and the patches that tires stand on, which data sheets leave out, not from calibration."
        )
    if not any("pressure" in name for name in channels):
        found.append("Only the joint angle was logged: effects that mainly show in pressures stay hidden.")
    if healthy and not {one.signature for one in healthy} & {one.signature for one in recordings}:
        found.append("No healthy recording has the commands of these: the twin's own error could not be subtracted.")
    hidden = [name for name, effect in effects.items() if effect.hidden]
    if hidden and not any(np.any(one.commands[:, 1]) for one in recordings):
        found.append(f"Standing turns do not show {', '.join(hidden)}, or hardly.")
    return tuple(dict.fromkeys(found))
