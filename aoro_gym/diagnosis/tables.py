"""From a table of key figures to a diagnosis: for machines of which no log exists, only what was published of full turns.

A row is one full turn with its figures (:mod:`aoro_gym.simulation.key_figures`). What may part them from the twin's is a
:class:`~aoro_gym.diagnosis.problem.Problem` whose measurements are figures instead of samples, so that all of day one's
method holds: uncertain parameters within their ranges, every effect and pair with the same freedom, Laplace's evidence.
*Nothing* is the twin as it was given; *calibration* is other parameters within their ranges. As no healthy log says that
the twin was made for this very machine, these two are equally likely beforehand.

How far figures scatter:

- The twin's own error and that between runs together: half of what a validation allows
  (:data:`~aoro_gym.validation.study.TARGETS`).
- Reading: ``std_*`` columns, where the table has them. Without, the joint's sensor is taken to have its published noise,
  which widens all figures and moves the extremes: noise makes peaks higher and undershoots lower. Whether a table's figures
  have it in them is not known: half of its mean is taken off, and as much is uncertain.
- What no twin has exactly as its machine has it: a share of the gap that is seen, as with logs.
"""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cholesky, solve_triangular
from scipy.stats import chi2

from aoro_gym.calibration.procedure import CURVE_SOURCE
from aoro_gym.calibration.published import FIGURES_SOURCE
from aoro_gym.calibration.turns import PATIENCE, longest
from aoro_gym.diagnosis.attribution import Trust, log_priors, weigh
from aoro_gym.diagnosis.axes import PRIOR_INFORMATION
from aoro_gym.diagnosis.closures import CLEAR, typical
from aoro_gym.diagnosis.experiments import next_experiments
from aoro_gym.diagnosis.findings import (
    alike_effects,
    cause_of,
    components_of,
    declared_of,
    moved_by,
    row_of,
    verdict_of,
)
from aoro_gym.diagnosis.linear import Hypothesis, Linear
from aoro_gym.diagnosis.noise import Floats, ModelError, Whitener
from aoro_gym.diagnosis.nuisances import Nuisances
from aoro_gym.diagnosis.problem import Problem, Progress
from aoro_gym.diagnosis.recording import TICK, Recording
from aoro_gym.diagnosis.replay import FINE, Replay, Simulator, Steps, Variants
from aoro_gym.diagnosis.result import CALIBRATION, KEY_FIGURES, UNKNOWN, Cause, Diagnosis, GapClosure, Place
from aoro_gym.diagnosis.search import ALL, Search, refine, trade
from aoro_gym.diagnosis.where import SIGNIFICANT, beyond, probability
from aoro_gym.effects.catalogue import EFFECTS
from aoro_gym.effects.effect import Effect
from aoro_gym.machine import Machine
from aoro_gym.recording.cells import listed, parse_number, shown
from aoro_gym.recording.tables import read_table
from aoro_gym.sensors.chain import STANDSTILL
from aoro_gym.sensors.joint_angle import JointAngleSensor
from aoro_gym.simulation.key_figures import FIGURES, key_figures_batch
from aoro_gym.units import LITRE_PER_MINUTE
from aoro_gym.validation.published import published_rows
from aoro_gym.validation.study import TARGETS
from aoro_gym.validation.turns import REST_AFTER, REST_BEFORE, Turn

STD = "std_"
"""What a column of standard deviations is called before the figure's own name."""
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
SAME_OIL = 0.1
"""Share by which turn time times mean flow may miss the oil of a full turn, until units must be wrong."""
FULL = 0.9
"""Share of the way from stop to stop that a turn must make to have figures."""
FAILED = 20.0
"""Standard deviations by which a figure that does not exist deviates."""
NOISE_RUNS = 256
"""Noisy readings of each turn."""
CONTENDERS = 12
"""Hypotheses, the likeliest, that are refined with slopes of their own; pairs that are refined at once."""
ROUNDS = 5
"""Gauss–Newton steps with slopes that all share."""
WHOLE = 4
"""Rounds of the former."""
MOST_LISTED = 12
"""Causes that are listed, the likeliest: of those that few figures cannot tell apart there are hundreds."""
DRAWS = 32
"""Machines drawn from the posterior, for intervals of what is gone."""
ERROR = ModelError(rate=0.003, pressure=0.010, swing=0.06, change=0.1, phase=0.05, sways=1.0)
"""The twin's own error: what remains between it and machines of other laws once it was fitted to them (E)."""
LISTED = 1e-3
"""Probability below which a hypothesis is not listed."""
RESAMPLES = 2000
"""Of every interval."""
SURVIVING = 0.02
"""Probability below which a hypothesis gets no machine file."""
TRUST = Trust(temperature=1.0, doubt=0.003)
"""Key figures are few, and each has a tolerance of its own."""
SURPRISES = (0.3, 0.6, 1.2)
"""Sizes of an unknown cause, as shares of the gap that is seen."""
GAP = 0.01
"""Probability of figures as far off as these without a gap, below which there is one. Few figures cannot prove parameters
within wide ranges against a twin that was made to agree: without a test of its own *nothing* would be named although it is
wrong (Lindley 1957)."""


# ---- tables ----


@dataclass(frozen=True)
class Row:
    """One full turn in a table.

    Attributes:
        figures: Those that are known, by their names in :data:`~aoro_gym.simulation.key_figures.FIGURES`.
        std: Their standard deviations, where the table has them.
    """

    turn: Turn
    figures: Mapping[str, float]
    std: Mapping[str, float] = field(default_factory=dict)

    @property
    def title(self) -> str:
        return f"{self.turn.direction}, {self.turn.signal_percent:.3g} %"

    @property
    def compared(self) -> tuple[str, ...]:
        """Figures that say something: the mean flow is the oil of a turn over its time, and so is the time once more."""
        return tuple(
            name for name in self.figures if name != "mean_flow_L_per_min" or "turn_time_s" not in self.figures
        )


def read_rows(path: Path, source: str | None = None) -> list[Row]:
    """Rows of ``source`` in a table (CSV); by default of the only source that it has.

    The table may be of any dialect (:mod:`aoro_gym.recording.tables`). Columns: ``signal_percent``, ``source``, figures,
    ``direction`` (``left`` where there is none), and ``std_*`` of figures. Empty cells are figures that are not known;
    lines that begin with ``#`` are no rows.

    Raises:
        ValueError: the table cannot be used; names the line and column, the value, and what is needed.
    """
    table = read_table(path)
    head = table.names
    missing = [name for name in ("signal_percent", "source") if name not in head]
    if missing or not set(head) & set(FIGURES):
        lacking = missing or [f"a figure (one at least of {', '.join(FIGURES)})"]
        raise ValueError(f"{path} has no column {' and '.join(lacking)}; its columns are {listed(head)}")
    allowed = {"signal_percent", "source", "direction", *FIGURES, *(STD + name for name in FIGURES)}
    strange = [name for name in head if name not in allowed]
    if strange:
        raise ValueError(
            f"{path}: unknown column {shown(strange[0])}; figures are {', '.join(FIGURES)}, or {STD} before one"
        )
    columns = {name: table.texts(name) for name in head}
    cells = {int(line): {name: columns[name][row] for name in head} for row, line in enumerate(table.lines)}
    sources = list(dict.fromkeys(one["source"] for one in cells.values()))
    source = sources[0] if source is None and len(sources) == 1 else source
    if source not in sources:
        asked = "--source is needed" if source is None else f"no row of source {source!r}"
        raise ValueError(f"{path}: {asked}; choose one of {listed(sources)}")
    rows = [
        _parsed(f"{path}, line {number}", one, table.dialect.decimal)
        for number, one in cells.items()
        if one["source"] == source
    ]
    turns = [row.turn for row in rows]
    for row in rows:
        if turns.count(row.turn) > 1:
            raise ValueError(f"{path}: {row.title} stands there twice; give means of repeats, and {STD} columns")
    return rows


def _parsed(where: str, cells: Mapping[str, str], decimal: str) -> Row:
    def number(name: str, least: float, most: float) -> float:
        text = cells[name]
        value = parse_number(text, decimal)
        if value is None:
            raise ValueError(f"{where}: {name} is {shown(text)}, but must be a number")
        if not least < value <= most:
            raise ValueError(f"{where}: {name} is {text}, but must be above {least:g} and at most {most:g}")
        return value

    direction = cells.get("direction") or "left"
    if direction not in ("left", "right"):
        raise ValueError(f"{where}: direction is {direction!r}, but must be left or right")
    percent = number("signal_percent", 0.0, 100.0)
    if percent <= 1.0:  # no machine turns at so little
        raise ValueError(f"{where}: signal_percent is {percent:g}, a share; did you mean {100.0 * percent:g}?")
    turn = Turn(direction, percent)
    figures = {name: number(name, 0.0, 1e3) for name in FIGURES if cells.get(name)}
    std = {name: number(STD + name, 0.0, 1e3) for name in figures if cells.get(STD + name)}
    if not figures:
        raise ValueError(f"{where}: no figure is known; give one at least, or leave the row out")
    return Row(turn, figures, std)


def selected(option: str, selections: Sequence[str], rows: Sequence[Row]) -> list[Row]:
    """Rows that any of ``selections`` names: ``signal=100`` or ``direction=left``, several values with commas between.

    Raises:
        ValueError: a selection is none, or names no row.
    """
    columns = {"signal": lambda row: f"{row.turn.signal_percent:g}", "direction": lambda row: row.turn.direction}
    chosen = []
    for selection in selections:
        key, equals, values = selection.partition("=")
        if not equals or key not in columns:
            raise ValueError(f"{option} {selection!r} selects no rows; write {option} signal=100 or direction=left")
        wanted = values.split(",")
        known = [columns[key](row) for row in rows]
        absent = [value for value in wanted if value not in known]
        if absent:
            raise ValueError(
                f"{option} {selection}: no row has {key}={absent[0]}; choose of {', '.join(dict.fromkeys(known))}"
            )
        chosen += [row for row, value in zip(rows, known, strict=True) if value in wanted]
    return [row for row in rows if row in chosen]


def built_in(machine: Machine, row: Row) -> set[str]:
    """Figures of ``row`` that the machine file was made with, so that agreement with them proves nothing: the published
    ones that its sources name. Mean flow and time of a turn are one figure."""
    sources = {entry.source for entry in machine.entries.values()}
    flow = {"turn_time_s", "mean_flow_L_per_min"}
    # a fit of the published twin's figures begins with the procedure that takes the machine's mean flows
    used = {"physical": flow if sources & {CURVE_SOURCE, FIGURES_SOURCE} else set()}
    used["mevea"] = set(FIGURES) if FIGURES_SOURCE in sources else set()
    turn = (row.turn.direction, row.turn.signal_percent)
    for one in published_rows():
        if (one["direction"], one["signal_percent"]) == turn and all(
            one[name] == row.figures[name] for name in row.figures
        ):
            return used[str(one["source"])] & set(row.figures)
    return set()


# ---- what may part figures from the twin's ----


class Turns(Problem):
    """Key figures of full turns, and what may part them from the twin's. Of their own, turns have one nuisance together: how
    much of the sensor's noise is in their extremes.

    Args:
        rows: To be explained.
        nuisances: Around the twin.
        effects: Catalogue by id.
        simulator: Runs the twins; on the CPU by default.

    Raises:
        ValueError: figures cannot be those of this machine, or the twin does not complete a turn.
    """

    kinds: Mapping[str, str] = {}

    def __init__(
        self,
        rows: Sequence[Row],
        nuisances: Nuisances,
        effects: Mapping[str, Effect],
        *,
        simulator: Simulator | None = None,
    ):
        machine = nuisances.machine
        blanks = [_blank(row, machine) for row in rows]
        super().__init__(blanks, nuisances, effects, error=ERROR, simulator=simulator)
        self.rows = tuple(rows)
        self.compared = [(k, name) for k, row in enumerate(rows) for name in row.compared]
        """Row and figure of every measurement."""
        self._own = [(0, "noise")]
        self.centre = np.zeros(len(nuisances.keys) + len(self._own))
        given = self._angles([Variants(machine)])
        reach = float(np.asarray(machine.joint.range))
        self._give = [row.turn.sign * _rests(angle)[0] - reach for row, angle in zip(rows, given, strict=True)]
        """Angle [rad] by which every turn comes to rest beyond its stop, which gives."""
        self.bias: Floats = np.zeros(len(self.compared))
        """What the sensor's noise adds to figures (D,) on average, where the table does not say how they scatter."""
        self.covariance: Floats = np.diag(self._own_error() ** 2)
        """Of figures (D, D), but for what no twin has exactly as its machine has it."""
        start = 0
        for k, (row, angle) in enumerate(zip(rows, given, strict=True)):
            shown = self._figures(k, angle, machine)
            unfinished = [name for name in row.compared if not np.isfinite(shown[name][0])]
            if unfinished:
                raise ValueError(
                    f"the twin's turn {row.title} has no {unfinished[0]} within {len(angle) * TICK:.0f} s; leave that row "
                    "out, or calibrate the machine file first"
                )
            mine = slice(start, start + len(row.compared))
            self.bias[mine], self.covariance[mine, mine] = self._reading(row, angle, self.covariance[mine, mine])
            start = mine.stop

    def _own_error(self) -> Floats:
        """Standard deviations (D,) of the twin's own error and between runs."""
        found = []
        for k, name in self.compared:
            kind, bound = TARGETS[name]
            found.append(0.5 * bound * (self.rows[k].figures[name] if kind == "relative" else 1.0))
        return np.array(found)

    def _reading(self, row: Row, angle: Floats, covariance: Floats) -> tuple[Floats, Floats]:
        """Mean (n,) and ``covariance`` (n, n), which it adds to, of what the reading does to the figures of a row with
        the exact angle (F, 1)."""
        machine = self.nuisances.machine
        clock = TICK * np.arange(len(angle))
        rng = np.random.default_rng(0)
        _, noisy = JointAngleSensor().record(np.repeat(angle, NOISE_RUNS, axis=1), clock, rng)
        read, exact = (key_figures_batch(clock, values, machine) for values in (noisy, angle))
        off = np.stack([read[name] - exact[name] for name in row.compared])
        off = off[:, np.all(np.isfinite(off), axis=0)]
        unknown = np.array([name not in row.std for name in row.compared])
        given = np.array([row.std.get(name, 0.0) for name in row.compared])
        return unknown * np.mean(off, axis=1), covariance + np.cov(off) * np.outer(unknown, unknown) + np.diag(given**2)

    # ---- instead of samples ----

    @cached_property
    def measured(self) -> Floats:
        """Figures (D,), less half of what the sensor's noise may have added to them."""
        return np.array([self.rows[k].figures[name] for k, name in self.compared]) - 0.5 * self.bias

    def own(self, predicted: Floats) -> Floats:
        """Shift (D, 1) by one standard deviation of how much of the sensor's noise is in the figures."""
        return 0.5 * self.bias[:, None]

    def repeated(self, variants: Sequence[Variants], steps: Steps = FINE) -> tuple[Floats, list[NDArray[np.bool_]]]:
        """Figures (D, N), between samples, by fine steps always; those that do not exist are :data:`FAILED` off. No turn is
        told by its stop."""
        geometry = self.nuisances.machine
        shown = [self._figures(k, angle, geometry) for k, angle in enumerate(self._angles(variants))]
        found = np.stack([shown[k][name] for k, name in self.compared])
        lost = self.measured + FAILED * np.sqrt(np.diag(self.covariance))
        return np.where(np.isfinite(found), found, lost[:, None]), []

    def residuals(self, whiteners: Sequence[Whitener], variants: Sequence[Variants], steps: Steps = FINE) -> Floats:
        """Whitened residuals (D, N) of the figures of :meth:`repeated`."""
        return self.white(whiteners, self.measured[:, None] - self.simulate(variants))

    def figures(self, variants: Variants) -> list[dict[str, float | None]]:
        """All figures of one machine by row, None where there is none."""
        geometry = self.nuisances.machine
        shown = [self._figures(k, angle, geometry) for k, angle in enumerate(self._angles([variants]))]
        return [
            {name: float(value[0]) if np.isfinite(value[0]) else None for name, value in one.items()} for one in shown
        ]

    def _angles(self, variants: Sequence[Variants]) -> list[Floats]:
        """Joint angles (F, N) [rad] by row, as the measuring chain shows them."""
        tasks = [Replay(one, turn, FINE) for turn in self.recordings for one in variants]
        found = iter(self.simulator.run(tasks))
        return [
            np.concatenate([next(found)["joint_angle"] for _ in variants], axis=1).astype(np.float64)
            for _ in self.recordings
        ]

    def _figures(self, row: int, angle: Floats, geometry: Machine) -> Mapping[str, Floats]:
        """Of a row's turns (F, N): the stop is where an angle comes to rest, less what the given twin's stop gives."""
        sign = self.rows[row].turn.sign
        complete = sign * (angle[-1] - angle[0]) > 2.0 * FULL * float(np.asarray(geometry.joint.range))
        stop = _rests(angle) - sign * self._give[row]
        shown = key_figures_batch(TICK * np.arange(len(angle)), angle, geometry, stop=stop, interpolate=True)
        return {name: np.where(complete, values, np.nan) for name, values in shown.items()}

    def std(self, error: ModelError = ERROR) -> Floats:
        """Standard deviations (D,) of figures around those of the right machine, noise in extremes included."""
        return np.sqrt(np.diag(self._spread(error)) + 0.25 * self.bias**2)

    def _spread(self, error: ModelError) -> Floats:
        """Covariance (D, D) with the share of the gap that ``error`` says: of all figures together, lest what one of them
        shows make the error that it is judged by."""
        power = np.diag(self.covariance)
        seen = max(float(np.mean((self.measured - self.given) ** 2 / power)) - 1.0, 0.0)
        return self.covariance + np.diag(error.change**2 * seen * power)

    def whiteners(self, error: ModelError, predicted: Floats) -> list[Whitener]:
        """One for all figures; see :meth:`Problem.whiteners`."""
        return [Whitener(cholesky(self._spread(error), lower=True), np.ones(len(self.compared), dtype=bool))]

    def white(self, whiteners: Sequence[Whitener], stacked: Floats) -> Floats:
        """``stacked`` (D,) or (D, N) of differences, whitened."""
        return solve_triangular(whiteners[0].factor, stacked, lower=True)


def _blank(row: Row, machine: Machine) -> Recording:
    """The turn's commands, and its sensor at rest; from beyond the stop, so that every machine starts at its own."""
    cylinder = machine.steering.cylinder
    oil = float(np.asarray((cylinder.bore_area + cylinder.annulus_area) * cylinder.stroke))
    lasts, flow = row.figures.get("turn_time_s"), row.figures.get("mean_flow_L_per_min")
    if flow is not None:
        by_flow = oil / (flow * LITRE_PER_MINUTE)
        if lasts is not None and abs(lasts / by_flow - 1.0) > SAME_OIL:
            raise ValueError(
                f"{row.title}: {flow:g} L/min for {lasts:g} s are {1e3 * oil * lasts / by_flow:.3g} L, but a full turn "
                f"takes {1e3 * oil:.3g} L; check the units of turn_time_s and mean_flow_L_per_min"
            )
        lasts = lasts or by_flow
    driven = max(longest(row.turn), PATIENCE * (lasts or 0.0))
    commands = np.zeros((round((REST_BEFORE + driven + REST_AFTER) / TICK), 2))
    rest = round(REST_BEFORE / TICK)
    commands[rest:, 0] = row.turn.sign * row.turn.signal_percent / 100.0
    clock = TICK * np.arange(len(commands) + 1)
    _, still = JointAngleSensor().record(np.zeros(len(clock)), clock, np.random.default_rng(0))
    beyond_the_stop = -2.0 * row.turn.sign * float(np.asarray(machine.joint.range))
    return Recording(row.title, commands, {"joint_angle": still}, rest, beyond_the_stop)


def _rests(angle: Floats) -> Floats:
    """Angle (N,) [rad] at which turns (F, N) come to rest."""
    return np.mean(angle[-round(STANDSTILL / TICK) :], axis=0)


# ---- which effect ----


def attribute(problem: Turns, progress: Progress = lambda sentence, share: None) -> tuple[list[Hypothesis], Linear]:
    """All hypotheses of a problem with their probabilities, the likeliest first, and the linear model around the best
    calibration. Every fit begins twice, around the twin as it was given and around that calibration: parameters that have
    swallowed an effect do not let go of it by small steps."""
    searches: dict[tuple[str, ...], Search] = {}
    for begin, share in ((0.0, 0.3), (0.3, 0.3)):
        progress("what every effect does", begin)
        if searches:
            _refined_whole([searches[()]])
            problem.centre = searches[()].point[0]
        problem.learn()
        linear = Linear(problem, problem.error)
        found = linear.screen()
        pairs = _likeliest([h for h in found.values() if len(h.effects) == 2])
        new = [
            Search(linear, h.effects, [h.places])
            for h in found.values()
            if len(h.effects) < 2 or any(h is one for one in pairs)
        ]
        refine(new, ROUNDS, lambda s, x, begin=begin, share=share: progress(s, begin + share * x))
        for one in new:
            old = searches.get(one.effects)
            if np.isfinite(one.cost) and (old is None or one.cost < old.cost):
                searches[one.effects] = one
    found |= {effects: one.weighed() for effects, one in searches.items()}
    likeliest = _likeliest([h for h in found.values() if h.refined])
    contenders = [searches[e] for e in dict.fromkeys([(), *(h.effects for h in likeliest)])]
    _refined_whole(contenders, lambda s, x: progress(s, 0.6 + 0.2 * x))
    trade(contenders)
    _refined_whole(contenders, lambda s, x: progress(s, 0.8 + 0.2 * x))
    found |= {one.effects: one.weighed() for one in contenders}
    prior = log_priors(problem.axes)
    innocent = float(np.logaddexp(prior[()], prior[CALIBRATION,])) - np.log(2.0)
    prior |= {(): innocent, (CALIBRATION,): innocent}
    others = [replace(found.pop(()), effects=(CALIBRATION,)), unknown(problem)]
    weighed = weigh([nothing(problem, linear), *found.values(), *others], prior, TRUST)
    if fit_p(linear, next(h for h in weighed if not h.effects)) < GAP:
        left = 1.0 - sum(h.probability for h in weighed if not h.effects)
        weighed = [replace(h, probability=h.probability / left) for h in weighed if h.effects]
    return weighed, linear


def _likeliest(hypotheses: Sequence[Hypothesis]) -> list[Hypothesis]:
    return sorted(hypotheses, key=lambda h: -h.log_evidence)[:CONTENDERS]


def _refined_whole(searches: Sequence[Search], progress: Progress = lambda sentence, share: None) -> None:
    """With slopes of their own."""
    for one in searches:
        one.directions = ALL
    refine(searches, WHOLE, progress)


def nothing(problem: Turns, linear: Linear) -> Hypothesis:
    """The twin as it was given; only how much of the sensor's noise is in the figures is open."""
    left = problem.white(linear.whiteners, problem.measured - problem.given)
    (own,) = problem.white(linear.whiteners, problem.own(problem.given)).T
    power = 1.0 + float(own @ own)
    noise = float(own @ left) / power
    nuisances = np.append(np.zeros(len(problem.felt)), noise)
    cost = float(left @ left) - power * noise**2
    evidence = -0.5 * (cost + np.log(power)) - linear.log_volume
    return Hypothesis((), evidence, nuisances=nuisances, cost=cost, left=left - noise * own, refined=True)


def unknown(problem: Turns) -> Hypothesis:
    """Something outside of the catalogue that moves all figures, with nuisances within their ranges as in every other fit:
    around few figures they reach the ends."""
    evidence, costs = [], []
    for change in SURPRISES:
        linear = Linear(problem, replace(problem.error, change=change), effects=False)
        tangent = linear.tangent
        nuisances = tangent.best(linear.residual)
        left = linear.residual - tangent.moved(nuisances)
        costs.append(float(left @ left + nuisances @ tangent.precision @ nuisances))
        evidence.append(-0.5 * costs[-1] + tangent.shrunk - linear.log_volume)
    whole = float(np.logaddexp.reduce(evidence)) - float(np.log(len(evidence)))
    return Hypothesis((UNKNOWN,), whole, cost=costs[int(np.argmax(evidence))])


def fit_p(linear: Linear, hypothesis: Hypothesis) -> float:
    """Probability of residuals at least as large as those of a fitted hypothesis, if it holds."""
    return float(np.asarray(chi2.sf(hypothesis.cost, len(linear.residual) - len(hypothesis.places))))


# ---- the diagnosis ----


def diagnose_rows(
    rows: Sequence[Row],
    machine: Machine | str | Path = "aoro",
    effects: Mapping[str, Effect] = EFFECTS,
    *,
    held_out: Sequence[Row] = (),
    simulator: Simulator | None = None,
    out: Path | None = None,
    progress: Progress = lambda sentence, share: None,
) -> Diagnosis:
    """Why ``rows`` of key figures and the twin's part.

    Args:
        rows: To be explained (:func:`read_rows`).
        machine: The twin.
        effects: Catalogue by id.
        held_out: Take no part in the fit; how far the gap shrinks is asked of them.
        simulator: Where twins run; on the CPU by default.
        out: Folder for the machine files of the causes; none are written without it.
        progress: Called with a sentence and the share done.

    Raises:
        ValueError: there is no row, or one that cannot be of this machine.
    """
    began = time.monotonic()
    if not rows:
        raise ValueError("no row to fit; select one at least")
    given = machine if isinstance(machine, Machine) else Machine.load(machine)
    around = Nuisances(given, "range")
    problem = Turns(rows, around, effects, simulator=simulator)
    others = Turns(held_out, around, effects, simulator=simulator) if held_out else None
    hypotheses, linear = attribute(problem, lambda s, share: progress(s, 0.8 * share))

    progress("where, how far, and what next", 0.8)
    best = next(h for h in hypotheses if h.refined)
    after = _variants(problem, best)
    rivals = [h for h in hypotheses if h.refined and h.tangent and not set(h.effects) & {*best.effects, CALIBRATION}]
    wrong = next((h for h in rivals if len(h.effects) == len(best.effects) and best.tangent), None)
    fits = [after, *_drawn(problem, best)]
    shrunk = _shrinkages(problem, problem.simulate(fits), held_out=False)
    controls: dict[str, float | None] = {}
    if others is not None:
        left = _shrinkages(others, others.simulate(fits), held_out=True)
        shrunk += left
        rival = others.simulate([_variants(problem, wrong)]) if wrong else None
        controls = {
            name: None if predicted is None else typical(_shrinkages(others, predicted, held_out=True))
            for name, predicted in (("wrong_cause", rival), ("black_box", _black_box(problem, others)))
        }
        controls = {"cause": typical(left), **controls}
    # the twin as it was given is one calibration of all
    open_to = [replace(h, effects=()) if h.effects == (CALIBRATION,) else h for h in hypotheses if h.effects]
    gap, gap_p = _where(problem, linear)
    components = components_of(hypotheses, effects)
    likeliest = next(iter(components), "")
    figures = {
        row.title: entry
        for part in (problem, others)
        if part is not None
        for row, entry in zip(part.rows, _compared(part, after, held_out=part is others), strict=True)
    }
    listed = [h for h in hypotheses[:MOST_LISTED] if h.probability > LISTED]
    causes = (_with_file(problem, h, out if h.probability > SURVIVING else None) for h in listed)
    return Diagnosis(
        machine=given.name,
        mode="day-one",
        logs=tuple(row.title for row in rows),
        healthy=(),
        signals=(KEY_FIGURES,),
        verdict=verdict_of(hypotheses),
        where=tuple(replace(place, component=likeliest) for place in gap),
        where_p=gap_p,
        components=components,
        causes=tuple(causes),
        declared_set=declared_of(hypotheses, TRUST.declared),
        fit_test_p=fit_p(linear, best),
        shrinkage=shrunk,
        controls=controls,
        key_figures=figures,
        next_experiments=next_experiments(linear, open_to),
        calibration=moved_by(problem, best),
        alike=alike_effects(linear),
        limitations=_limitations(problem, others),
        seconds=time.monotonic() - began,
    )


def _variants(problem: Turns, hypothesis: Hypothesis) -> Variants:
    """The machine of a hypothesis at its best fit."""
    known = tuple(name for name in hypothesis.effects if name in problem.effects)
    return problem.at(hypothesis.nuisances[None], known, row_of(hypothesis))


def _with_file(problem: Turns, hypothesis: Hypothesis, out: Path | None) -> Cause:
    """Also for calibration alone."""
    cause = cause_of(problem, hypothesis, TRUST.laws, out)
    if out is None or hypothesis.effects != (CALIBRATION,):
        return cause
    file = f"machines/{CALIBRATION}.toml"
    (out / "machines").mkdir(parents=True, exist_ok=True)
    _variants(problem, hypothesis).machine.save(out / file)
    return replace(cause, machine_file=file)


def _drawn(problem: Turns, hypothesis: Hypothesis) -> list[Variants]:
    """Machines of the posterior of a hypothesis; none of one that leaves nothing open."""
    tangent = hypothesis.tangent
    if tangent is None:
        return []
    u, z = hypothesis.nuisances, np.array(hypothesis.places, dtype=np.float64)
    root = np.linalg.cholesky(tangent.beside(hypothesis.slopes, PRIOR_INFORMATION).covariance)
    normal = np.random.default_rng(0).standard_normal((DRAWS, len(root)))
    points, places = np.split(np.append(u, z) + normal @ root.T, [len(u)], axis=1)
    known = tuple(name for name in hypothesis.effects if name in problem.effects)
    return [problem.at(np.clip(points, *tangent.bounds), known, np.clip(places, 0.0, 1.0))]


def _shrinkages(problem: Turns, predicted: Floats, *, held_out: bool, seed: int = 0) -> tuple[GapClosure, ...]:
    """S of every row whose figures show a gap, over them in their standard deviations; of rows that took no part in the fit
    by those only that the machine file was not made with.

    Intervals are of the influences (see :mod:`.closures`) of resampled figures, under machines drawn from the posterior.

    Args:
        problem: Its rows are compared.
        predicted: Figures (D, 1 + n) of the best fit, and of machines drawn.
        held_out: The rows took no part in the fit.
        seed: Of the resamples.
    """
    std = problem.std()
    before = ((problem.measured - problem.given) / std) ** 2 - 1.0
    left = ((problem.measured[:, None] - predicted) / std[:, None]) ** 2 - 1.0
    rng = np.random.default_rng(seed)
    found = []
    for k, row in enumerate(problem.rows):
        known = built_in(problem.nuisances.machine, row) if held_out else set()
        mine = [i for i, (at, name) in enumerate(problem.compared) if at == k and name not in known]
        count = len(mine)
        if not mine or np.mean(before[mine]) <= CLEAR * np.sqrt(2.0 / count):
            continue
        gap = float(np.mean(before[mine]))
        S = 1.0 - float(np.mean(left[mine, 0])) / gap
        influence = S - (left[mine] - (1.0 - S) * before[mine, None]) / gap
        column = rng.integers(influence.shape[1], size=(RESAMPLES, 1))
        means = np.mean(influence[rng.integers(count, size=(RESAMPLES, count)), column], axis=1)
        low, high = np.quantile(means, [0.05, 0.95])
        rms = [float(np.sqrt(np.mean(part[mine] + 1.0))) for part in (before, left[:, 0])]
        found.append(
            GapClosure(
                row.title, KEY_FIGURES, S, float(low), float(high), rms[0], rms[1], 1.0, held_out, refitted=False
            )
        )
    return tuple(found)


def _black_box(problem: Turns, others: Turns) -> Floats:
    """What a model that knows no physics makes of other rows (D, 1): every figure is off by the factor that it is off by on
    average in those that were fitted."""
    factors: dict[str, list[float]] = {}
    for (_, name), measured, given in zip(problem.compared, problem.measured, problem.given, strict=True):
        factors.setdefault(name, []).append(measured / given)
    return (others.given * [np.mean(factors.get(name, 1.0)) for _, name in others.compared])[:, None]


def _where(problem: Turns, linear: Linear) -> tuple[tuple[Place, ...], float]:
    """See :func:`.where.places`; each figure is a part."""
    white = beyond(linear.tangent.spread, linear.residual)
    p = probability([white[[i]] for i in range(len(white))])
    excess = np.maximum(white**2 - 1.0, 0.0)
    if p > SIGNIFICANT or not np.any(excess):
        return (), p
    places = [
        Place("", SHOWN[name][1], SHOWN[name][0], problem.rows[k].title, float(share))
        for (k, name), share in zip(problem.compared, excess / np.sum(excess), strict=True)
        if share > 0.0
    ]
    return tuple(sorted(places, key=lambda place: -place.share)), p


def _compared(problem: Turns, after: Variants, *, held_out: bool) -> list[dict[str, dict[str, float | None]]]:
    """By row and figure: measured, before, after, its standard deviation, and whether it counts as held out."""
    std = dict(zip(problem.compared, problem.std().tolist(), strict=True))
    both = [problem.figures(one) for one in (Variants(problem.nuisances.machine), after)]
    tables = []
    for k, (row, before, then) in enumerate(zip(problem.rows, *both, strict=True)):
        known = built_in(problem.nuisances.machine, row)
        tables.append(
            {
                name: {
                    "measured": row.figures.get(name), "before": before[name], "after": then[name],
                    "std": std.get((k, name)), "built_in": name in known, "held_out": held_out and name not in known,
                }
                for name in FIGURES
            }
        )  # fmt: skip
    return tables


def _limitations(problem: Turns, others: Turns | None) -> tuple[str, ...]:
    """What these figures cannot say, and what was taken for granted."""
    found = [
        f"{len(problem.compared)} figures feel {len(problem.felt)} uncertain parameters: most of what a log would tell "
        "apart is not told apart.",
        "No healthy machine was measured: what the twin's laws do otherwise than the machine's cannot be told from an "
        "effect.",
    ]
    rows = [*problem.rows, *(others.rows if others else ())]
    if any(set(row.compared) - set(row.std) for row in rows):
        found.append(
            "Figures without standard deviations are taken to scatter as the published noise of the joint's sensor makes "
            "them; how much of it is in their extremes is taken to be unknown."
        )
    bounds = [
        f"{100.0 * bound / 2.0:g} % of the {_plain(name)}"
        for name, (kind, bound) in TARGETS.items()
        if kind == "relative"
    ]
    found.append(f"The twin's own error and the scatter between runs are estimates: {', '.join(bounds)}.")
    known = {row.title: built_in(problem.nuisances.machine, row) for row in rows}
    if any(known.values()):
        named = [
            f"{', '.join(_plain(name) for name in FIGURES if name in mine)} ({title})"
            for title, mine in known.items()
            if mine
        ]
        found.append(
            f"The machine file was made with these figures, which prove nothing where held out: {'; '.join(named)}."
        )
    return tuple(found)


def _plain(figure: str) -> str:
    """A figure's name without its unit."""
    return figure.removesuffix("_L_per_min").removesuffix("_s").replace("_", " ")
