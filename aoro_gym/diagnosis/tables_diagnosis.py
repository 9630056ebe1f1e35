"""From a table of key figures to a diagnosis: for machines of which no log exists, only what was published of full turns.

Rows of a healthy machine beside rows of the same turns ask what has changed since; rows alone, what the machine does
otherwise than any of its kind. As with logs (:mod:`.diagnose`), networks that were trained on simulated machines weigh every
cause (:mod:`.network.tables_dataset`), and nothing overrules the name. How far the gap shrinks is told by twins: with
the cause at the size that networks say, against without, over figures in their scatter. A row that the size is asked
without, or that was held out, is a test; the others are not.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from aoro_gym.diagnosis.closures import CLEAR, typical
from aoro_gym.diagnosis.diagnose import (
    LISTED,
    MEDIAN,
    Progress,
    alike_causes,
    components_of,
    first_finding,
    interval_of,
    sizes_of,
)
from aoro_gym.diagnosis.network.cases import Posterior
from aoro_gym.diagnosis.network.decision import Calibration, Decision, decide
from aoro_gym.diagnosis.network.forward import Weights
from aoro_gym.diagnosis.network.shape import QUANTILES
from aoro_gym.diagnosis.network.tables_features import features
from aoro_gym.diagnosis.network.tables_forward import DAY_ONE, PAIRED, posterior, shipped, trained
from aoro_gym.diagnosis.noise import Floats
from aoro_gym.diagnosis.replay import Simulator, Variants
from aoro_gym.diagnosis.result import KEY_FIGURES, Cause, Diagnosis, GapClosure, Place
from aoro_gym.diagnosis.signatures import axes_of, settings_of
from aoro_gym.diagnosis.simulation.turns import READ, SLOWEST
from aoro_gym.diagnosis.tables import Row, built_in
from aoro_gym.diagnosis.tables_twin import TwinTurns, turn_time
from aoro_gym.effects.catalogue import EFFECTS, IDS
from aoro_gym.effects.effect import ChainEffect, GroundEffect
from aoro_gym.machine import Machine
from aoro_gym.machine.parameters import InvalidMachine
from aoro_gym.simulation.key_figures import FIGURES
from aoro_gym.validation.study import TARGETS

SHOWN: Mapping[str, tuple[str, str]] = {
    "turn_time_s": ("joint_angle", "stop"),
    "mean_flow_L_per_min": ("joint_flow", "steady"),
    "steady_flow_L_per_min": ("joint_flow", "steady"),
    "first_peak_L_per_min": ("joint_flow", "first_peak"),
    "first_peak_time_s": ("joint_flow", "onset"),
    "lowest_undershoot_L_per_min": ("joint_flow", "undershoot"),
    "second_peak_L_per_min": ("joint_flow", "second_peak"),
}
"""Signal and phase that a figure is read from."""
MOST_LISTED = 12
"""Causes that are listed, the likeliest."""
SET = 4
"""Of these that the twin is set to, the likeliest that the declared set holds."""
SIZES = 8
"""Sizes of a cause, evenly likely, for intervals of what is gone."""
RESAMPLES = 2000
"""Of every interval."""
BEYOND = 2.0
"""Standard deviations beyond which it is said that a figure is not the twin's."""
PLACES = {1: 401, 2: 41}
"""Magnitudes that are tried for a size, along each of an effect's axes, by the number of these."""


@dataclass(frozen=True)
class Pair:
    """A row that is to be explained, and one of the same turn of the healthy machine, if there is any."""

    later: Row
    healthy: Row | None = None

    @property
    def title(self) -> str:
        return self.later.title

    @property
    def compared(self) -> tuple[str, ...]:
        """Figures that both have."""
        if self.healthy is None:
            return self.later.compared
        return tuple(name for name in self.later.compared if name in self.healthy.figures)

    def scatter(self, name: str) -> float:
        """Standard deviation of the figure ``name``, or of its change."""
        rows = [self.later] if self.healthy is None else [self.later, self.healthy]
        return float(np.sqrt(sum(_scatter(row, name) ** 2 for row in rows)))


def _scatter(row: Row, name: str) -> float:
    """As the table says, else half of what a validation allows."""
    kind, bound = TARGETS[name]
    return row.std.get(name, 0.5 * bound * (row.figures[name] if kind == "relative" else 1.0))


def paired(rows: Sequence[Row], healthy: Sequence[Row]) -> list[Pair]:
    """``rows`` with the ``healthy`` ones of the same turns."""
    of = {row.turn: row for row in healthy}
    return [Pair(row, of.get(row.turn)) for row in rows]


def diagnose_rows(
    rows: Sequence[Row],
    machine: Machine | str | Path = "aoro",
    *,
    healthy: Sequence[Row] = (),
    held_out: Sequence[Row] = (),
    networks: Sequence[Weights] | None = None,
    calibrations: Mapping[str, Calibration] | None = None,
    simulator: Simulator | None = None,
    out: Path | None = None,
    progress: Progress = lambda sentence, share: None,
) -> Diagnosis:
    """Why ``rows`` of key figures and those of a healthy machine, or the twin, part.

    Args:
        rows: To be explained (:func:`~aoro_gym.diagnosis.tables.read_rows`).
        machine: The twin.
        healthy: Rows of the same machine, or of what it is compared with, while nothing was wrong.
        held_out: Not asked of; how far the gap shrinks is. By default every row is left out once in turn.
        networks: That weigh causes; those of the package by default.
        calibrations: Theirs, by set of tables.
        simulator: Where twins run; on the CPU by default.
        out: Folder for the machine files of the causes; none are written without it.
        progress: Called with a sentence and the share done.

    Raises:
        ValueError: there is no row, none of a healthy machine's turns, or one that cannot be of this machine.
    """
    began = time.monotonic()
    if not rows:
        raise ValueError("no row to fit; select one at least")
    twin = machine if isinstance(machine, Machine) else Machine.load(machine)
    told, others = paired(rows, healthy), paired(held_out, healthy)
    if healthy and not any(pair.healthy for pair in told):
        raise ValueError(
            f"no healthy row has a turn of {', '.join(row.title for row in rows)}; there are "
            f"{', '.join(row.title for row in healthy)}"
        )
    networks = trained() if networks is None else networks
    calibrations = shipped() if calibrations is None else calibrations
    said = _asked(told, twin, networks)
    decision = decide(said.probabilities, calibrations[PAIRED if healthy else DAY_ONE])
    progress(f"first finding: {first_finding(decision)}", 0.1)
    turns = TwinTurns([pair.later for pair in (*told, *others)], twin, simulator or Simulator())
    gap = _Gap(told, others, turns, twin)
    causes = _causes(decision, said, twin, out)
    cause = causes[0].effects if causes[0].settings else ()
    shrinkage, controls = gap.closed(cause, _rival(decision, cause), lambda pairs: _asked(pairs, twin, networks))
    progress("figures beside the twin's", 0.9)
    components = components_of(decision)
    blamed = next(iter(components), "") if decision.verdict in ("cause", "ambiguous") else ""
    return Diagnosis(
        machine=twin.name,
        mode="commissioned" if healthy else "day-one",
        logs=tuple(row.title for row in rows),
        healthy=tuple(pair.healthy.title for pair in told if pair.healthy),
        signals=(KEY_FIGURES,),
        verdict=decision.verdict,
        where=() if decision.verdict == "no_gap" else gap.places(blamed),
        where_p=decision.null_p,
        components=components,
        causes=causes,
        declared_set=decision.declared,
        shrinkage=shrinkage,
        controls=controls,
        key_figures=gap.table(),
        alike=alike_causes(decision),
        limitations=_limitations(told, others, gap, decision.verdict),
        seconds=time.monotonic() - began,
    )


# ---- what networks are asked ----


def _asked(pairs: Sequence[Pair], twin: Machine, networks: Sequence[Weights]) -> Posterior:
    return posterior(networks, rows_of(pairs, twin))


def rows_of(pairs: Sequence[Pair], twin: Machine) -> Any:
    """Features (J, features) of the turns of a table, as networks take them.

    Raises:
        ValueError: figures of a row contradict each other.
    """
    signal = np.array([pair.later.turn.sign * pair.later.turn.signal_percent / 100.0 for pair in pairs])
    shape = (len(pairs), 2, len(READ))
    figures, std = np.full(shape, np.nan), np.full(shape, np.nan)
    for k, pair in enumerate(pairs):
        for day, row in enumerate((pair.healthy, pair.later)):
            if row is None:
                continue
            known = {**row.figures, "turn_time_s": turn_time(row, twin)}
            figures[k, day] = [np.nan if (value := known.get(name)) is None else value for name in READ]
            std[k, day] = [row.std.get(name, np.nan) for name in READ]
    has, has_std = np.isfinite(figures), np.isfinite(std)
    parts = (signal, np.nan_to_num(figures), has, np.nan_to_num(std), has_std)
    return features(np, *(np.asarray(part, dtype=np.float32) for part in parts))


# ---- causes and their sizes ----


def _causes(decision: Decision, said: Posterior, twin: Machine, out: Path | None) -> tuple[Cause, ...]:
    """Hypotheses worth listing, with the sizes that networks say; the likeliest that the declared set holds with the
    magnitudes that the twin takes, and a machine file."""
    sizes = sizes_of(said)
    found: list[Cause] = []
    for place, (effects, share) in enumerate(decision.hypotheses[:MOST_LISTED]):
        if share < LISTED and place:
            break
        known = [name for name in effects if name in EFFECTS]
        settings = {}
        told = decision.verdict != "no_gap" and known and set(known) <= set(decision.declared)
        if told and sum(bool(one.settings) for one in found) < SET:
            settings = {name: _setting(name, twin, sizes[name][MEDIAN]) for name in known}
        found.append(
            Cause(
                effects,
                share,
                magnitudes={name: (interval_of(name, sizes[name]),) for name in known},
                settings=settings,
                components=tuple(dict.fromkeys(EFFECTS[name].component for name in known)),
                machine_file=_machine_file(settings, twin, out),
            )
        )
    return tuple(found)


def _setting(name: str, twin: Machine, change: float) -> tuple[float, ...]:
    """Magnitudes of an effect, within its range, that change its operational magnitude on the ``twin`` most nearly by
    ``change`` [SI]."""
    effect = EFFECTS[name]
    axes = axes_of(effect)
    each = [np.linspace(0.0, 1.0, PLACES[len(axes)]) for _ in axes]
    places = [one.ravel() for one in np.meshgrid(*each, indexing="ij")]
    tried = settings_of(axes, [axis.value(place) for axis, place in zip(axes, places, strict=True)])
    tried = np.stack([np.broadcast_to(value, len(places[0])) for value in tried])
    without = float(np.ravel(effect.measured(twin, *effect.none)[0])[0])
    off = np.abs(_measured(name, twin, tried) - without - change)
    if not np.any(np.isfinite(off)):
        return effect.none
    return tuple(float(value) for value in tried[:, int(np.nanargmin(off))])


def _measured(name: str, twin: Machine, tried: Floats) -> Floats:
    """First operational magnitude (n,) at magnitudes (m, n); NaN where no machine can have the effect."""
    try:
        return np.broadcast_to(np.asarray(EFFECTS[name].measured(twin, *tried)[0], dtype=np.float64), tried.shape[1])
    except InvalidMachine as error:
        impossible = np.broadcast_to(error.shown[0][1], tried.shape[1])
        if np.all(impossible):
            return np.full(tried.shape[1], np.nan)
        found = np.full(tried.shape[1], np.nan)
        found[~impossible] = _measured(name, twin, tried[:, ~impossible])
        return found


def _machine_file(settings: Mapping[str, tuple[float, ...]], twin: Machine, out: Path | None) -> str:
    """Write the machine with its effects, where they all lie in the machine and there can be one."""
    if out is None or not settings or any(isinstance(EFFECTS[name], ChainEffect | GroundEffect) for name in settings):
        return ""
    with_effects = _with(twin, settings)
    if with_effects is None:
        return ""
    file = f"machines/{'+'.join(settings)}.toml"
    (out / "machines").mkdir(parents=True, exist_ok=True)
    with_effects.machine.save(out / file)
    return file


def _with(twin: Machine, settings: Mapping[str, tuple[float, ...]]) -> Variants | None:
    """The twin with effects; None where there can be no such machine."""
    try:
        return Variants.of(twin, [(EFFECTS[name], values) for name, values in settings.items()], 1)
    except InvalidMachine:
        return None


def _rival(decision: Decision, cause: tuple[str, ...]) -> tuple[str, ...]:
    """The likeliest other cause of as many effects that shares none with ``cause``; none without a cause."""
    named = [effects for effects, _ in decision.hypotheses if effects and set(effects) <= set(IDS)]
    return next((one for one in named if cause and len(one) == len(cause) and not set(one) & set(cause)), ())


# ---- the gap, and what a cause closes of it ----


class _Gap:
    """What the rows of a table show, beside what twins would.

    Args:
        told: Rows that networks are asked of.
        held_out: Rows that they are not.
        turns: Of all of them, in this order.
        twin: Without a cause.
    """

    def __init__(self, told: Sequence[Pair], held_out: Sequence[Pair], turns: TwinTurns, twin: Machine):
        self.told, self.pairs = list(told), [*told, *held_out]
        self.turns, self.twin = turns, twin
        self.before = [_first(one) for one in turns.given]
        self.after: list[dict[str, float]] = [{} for _ in self.pairs]

    def measured(self, pair: int, name: str) -> float:
        """Change of a figure since the healthy day, or its distance from the twin's."""
        one = self.pairs[pair]
        return one.later.figures[name] - self.base(pair, name)

    def base(self, pair: int, name: str) -> float:
        """What a figure was on the healthy day, or is of the twin."""
        healthy = self.pairs[pair].healthy
        return self.before[pair][name] if healthy is None else healthy.figures[name]

    def parts(self, pair: int) -> list[tuple[str, float]]:
        """Figures of a row that can be compared, and their gap in its standard deviations."""
        one = self.pairs[pair]
        found = [(name, self.measured(pair, name) / one.scatter(name)) for name in one.compared]
        return [(name, gap) for name, gap in found if np.isfinite(gap)]

    def places(self, component: str) -> tuple[Place, ...]:
        """Which figures have moved beyond their scatter, and how much of the gap each is."""
        excess = {(k, name): max(gap**2 - 1.0, 0.0) for k in range(len(self.told)) for name, gap in self.parts(k)}
        whole = sum(excess.values())
        found = [
            Place(component, SHOWN[name][1], SHOWN[name][0], self.pairs[k].title, energy / whole)
            for (k, name), energy in excess.items()
            if energy > 0.0
        ]
        return tuple(sorted(found, key=lambda place: -place.share))

    def closed(
        self, cause: tuple[str, ...], rival: tuple[str, ...], asked: Callable[[Sequence[Pair]], Posterior]
    ) -> tuple[tuple[GapClosure, ...], dict[str, float | None]]:
        """How far every row's gap shrinks with a ``cause`` of the size that networks say, and with others: a ``rival``, and
        what a model that knows no physics makes of it. Without held-out rows each is left out of the question once."""
        if not cause:
            return (), {}
        count = len(self.told)
        held_out = list(range(count, len(self.pairs)))
        said = dict.fromkeys(range(len(self.pairs)), sizes_of(asked(self.told)))
        without = {}
        if not held_out and count > 1:
            without = {k: sizes_of(asked([one for one in self.told if one is not self.pairs[k]])) for k in range(count)}
        tests = without or {k: said[k] for k in held_out}
        variants: list[list[Variants]] = [[] for _ in self.pairs]
        own = {k: self._sized(cause, sizes, variants[k]) for k, sizes in said.items()}
        tested = {k: self._sized(cause, sizes, variants[k]) for k, sizes in tests.items()} if without else own
        wrong = {k: self._sized(rival, sizes, variants[k], few=True) for k, sizes in tests.items()}
        shown = self.turns.figures([one or [Variants(self.twin)] for one in variants])
        self.after = [
            {name: float(values[own[k].start]) for name, values in shown[k].items()} if _some(own[k]) else {}
            for k in range(len(self.pairs))
        ]
        found = [self._closure(k, shown[k], own[k], held_out=False) for k in range(count)]
        left_out = [self._closure(k, shown[k], tested[k], held_out=True) for k in tests]
        rivals = [self._closure(k, shown[k], wrong[k], held_out=True) for k in tests]
        boxes = [self._closure(k, self._black_box(k, held_out), slice(0, 1), held_out=True) for k in tests]
        S = {"cause": left_out, "wrong_cause": rivals, "black_box": boxes}
        controls = {name: typical(one for one in many if one) for name, many in S.items()} if tests else {}
        return tuple(one for one in (*found, *left_out) if one), controls

    def _sized(
        self, cause: tuple[str, ...], sizes: Mapping[str, Sequence[float]], into: list[Variants], *, few: bool = False
    ) -> slice:
        """Add twins with a ``cause`` to those of a row: at the median size, and unless ``few`` at others as likely. Where
        they stand there; nowhere if there can be no such machine."""
        first = len(into)
        levels = np.append(0.5, [] if few else (np.arange(SIZES) + 0.5) / SIZES)
        rng = np.random.default_rng(0)
        changes = {}
        for name in cause:
            order = np.append(0, 1 + rng.permutation(len(levels) - 1))  # of a pair each size by itself
            changes[name] = np.interp(levels[order], QUANTILES, sizes[name])
        for k in range(len(levels) if cause else 0):
            one = _with(
                self.twin, {name: _setting(name, self.twin, float(values[k])) for name, values in changes.items()}
            )
            if one is None and not k:
                break
            into += [] if one is None else [one]
        return slice(first, len(into))

    def _closure(self, pair: int, shown: Mapping[str, Floats], which: slice, *, held_out: bool) -> GapClosure | None:
        """Of figures ``shown`` by twins, the best first; None where a row shows no gap, or twins no figures."""
        one = self.pairs[pair]
        known = built_in(self.twin, one.later) if held_out and one.healthy is None else set()
        parts = [
            (name, gap) for name, gap in self.parts(pair) if name not in known and np.isfinite(self.before[pair][name])
        ]
        if not _some(which) or not parts:
            return None
        predicted = np.array([(shown[name][which] - self.before[pair][name]) / one.scatter(name) for name, _ in parts])
        predicted = predicted[:, np.all(np.isfinite(predicted), axis=0)]
        gaps = np.array([gap for _, gap in parts])
        if not predicted.size or np.mean(gaps**2) - 1.0 <= CLEAR * np.sqrt(2.0 / len(gaps)):
            return None
        return _gap_closure(one.title, gaps, predicted, held_out=held_out)

    def _black_box(self, pair: int, held_out: Sequence[int]) -> dict[str, Floats]:
        """Figures (1,) of a model that knows no physics: each changes by the factor by which it does on average in the rows
        that were told."""
        learned = [k for k in range(len(self.told)) if held_out or k != pair]
        found = {}
        for name in self.pairs[pair].compared:
            factors = [
                1.0 + self.measured(k, name) / self.base(k, name) for k in learned if name in self.pairs[k].compared
            ]
            change = self.base(pair, name) * (float(np.mean(factors)) - 1.0) if factors else 0.0
            found[name] = np.array([self.before[pair][name] + change])
        return found

    def table(self) -> dict[str, dict[str, dict[str, Any]]]:
        """By row and figure: measured, on the healthy day, of the twin before and after, standard deviation, and whether
        the machine file was made with it, or it was held out."""
        return {
            one.title: {name: self._figure(k, name, built_in(self.twin, one.later)) for name in FIGURES}
            for k, one in enumerate(self.pairs)
        }

    def _figure(self, pair: int, name: str, known: set[str]) -> dict[str, Any]:
        one = self.pairs[pair]
        later, healthy = one.later.figures.get(name), one.healthy.figures.get(name) if one.healthy else None
        return {
            "measured": later,
            "healthy": healthy,
            "before": _finite(self.before[pair].get(name)),
            "after": _finite(self.after[pair].get(name)),
            "std": None if later is None else _scatter(one.later, name),
            "built_in": name in known,
            "held_out": pair >= len(self.told) and not (name in known and one.healthy is None),
        }


def _gap_closure(title: str, gaps: Floats, predicted: Floats, *, held_out: bool) -> GapClosure:
    """S over the figures of a row in their standard deviations.

    Intervals are of the influences (see :mod:`.closures`) of resampled figures, under sizes that are as likely.

    Args:
        title: Of the row.
        gaps: What was measured (F,).
        predicted: What twins say (F, 1 + n): of the best size, and of others.
        held_out: The row was not asked of.
    """
    before, left = gaps**2 - 1.0, (gaps[:, None] - predicted) ** 2 - 1.0
    gap = float(np.mean(before))
    S = 1.0 - float(np.mean(left[:, 0])) / gap
    influence = S - (left - (1.0 - S) * before[:, None]) / gap
    rng, count = np.random.default_rng(0), len(gaps)
    column = rng.integers(influence.shape[1], size=(RESAMPLES, 1))
    means = np.mean(influence[rng.integers(count, size=(RESAMPLES, count)), column], axis=1)
    low, high = np.quantile(means, [0.05, 0.95])
    rms = [float(np.sqrt(np.mean(part + 1.0))) for part in (before, left[:, 0])]
    return GapClosure(
        title, KEY_FIGURES, S, float(min(low, S)), float(max(high, S)), rms[0], rms[1], 1.0, held_out, refitted=False
    )


def _first(figures: Mapping[str, Floats]) -> dict[str, float]:
    return {name: float(values[0]) for name, values in figures.items()}


def _some(which: slice) -> bool:
    return which.stop > which.start


def _finite(value: float | None) -> float | None:
    return value if value is not None and np.isfinite(value) else None


# ---- what figures cannot say ----


def _limitations(told: Sequence[Pair], held_out: Sequence[Pair], gap: _Gap, verdict: str) -> tuple[str, ...]:
    every = [*told, *held_out]
    count = sum(len(pair.compared) for pair in told)
    found = [
        f"{count} figures tell few causes apart. Logs of the same turns tell far more, above all with the pressures of both "
        "ports and of the pump (aoro-gym diagnose LOG)."
    ]
    alone = [pair.title for pair in told if pair.healthy is None]
    if len(alone) == len(told):
        found.append(
            "No healthy machine was measured: what this machine does otherwise than others of its kind cannot be told from "
            "an effect."
        )
        off = [abs(size) for k in range(len(told)) for _, size in gap.parts(k)]
        if verdict == "no_gap" and off:
            beyond = sum(size > BEYOND for size in off)
            found.append(
                f"{beyond} of {len(off)} figures lie more than {BEYOND:g} of their standard deviations from the twin's, at "
                f"most {max(off):.1f}; whether a healthy machine may have them is all that was asked."
            )
    elif alone:
        found.append(f"No row of the healthy machine has the turn of {'; '.join(alone)}.")
    unknown = any(
        name not in row.std for pair in every for row in (pair.later, pair.healthy) if row for name in row.compared
    )
    if unknown:
        bounds = [
            f"{100.0 * bound / 2.0:g} % of the {_plain(name)}"
            for name, (kind, bound) in TARGETS.items()
            if kind == "relative"
        ]
        found.append(
            f"Where the table gives no standard deviations, figures are taken to scatter by estimates: {', '.join(bounds)}."
        )
    slow = [pair.title for pair in told if pair.later.turn.signal_percent < 100.0 * SLOWEST]
    if slow:
        found.append(f"Networks know turns from {100.0 * SLOWEST:g} % signal on, and not {'; '.join(slow)}.")
    stuck = [pair.title for k, pair in enumerate(every) if not np.isfinite(gap.before[k]["turn_time_s"])]
    if stuck:
        found.append(f"The twin does not complete {'; '.join(stuck)}: its figures are not compared there.")
    known = {pair.title: built_in(gap.twin, pair.later) for pair in every if pair.healthy is None}
    if any(known.values()):
        named = [
            f"{', '.join(_plain(name) for name in FIGURES if name in mine)} ({title})"
            for title, mine in known.items()
            if mine
        ]
        found.append(
            f"The machine file was made with these figures, which prove nothing where left out: {'; '.join(named)}."
        )
    hidden = [name for name, effect in EFFECTS.items() if effect.hidden]
    found.append(f"Full turns do not show {', '.join(hidden)}, or hardly.")
    return tuple(found)


def _plain(figure: str) -> str:
    """A figure's name without its unit."""
    return figure.removesuffix("_L_per_min").removesuffix("_s").replace("_", " ")
