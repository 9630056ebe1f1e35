"""The whole calibration against the published figures: procedure, fit, ensemble."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from itertools import compress
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from aoro_gym.calibration.ensemble import CANDIDATES, draw_ensemble, posterior_factor
from aoro_gym.calibration.fit import BOXES, USUAL_STEPS, Fit, Residuals, least_squares_fit
from aoro_gym.calibration.probable import most_probable_fit, prior_cost
from aoro_gym.calibration.procedure import measured_curve, published_procedure, rolling_pressure
from aoro_gym.calibration.progress import Progress, Work
from aoro_gym.calibration.resuming import resumable
from aoro_gym.calibration.right_turns import EDGE, KEYS, with_right_turns
from aoro_gym.calibration.space import Space
from aoro_gym.calibration.turns import population_figures
from aoro_gym.execution.digest import digest
from aoro_gym.machine import Machine
from aoro_gym.simulation.key_figures import FIGURES, SWING
from aoro_gym.validation.published import published, published_rows
from aoro_gym.validation.study import (
    BARE_PRESSURE_TARGET,
    MASS_TARGET,
    MOTOR_PRESSURE_TARGET,
    RIM_SPEED_TARGET,
    SWING_TARGET,
    TARGETS,
    TURN_TIME_TARGET,
)
from aoro_gym.validation.turns import Turn, rim_speed

LEVELS = tuple(Turn("left", percent) for percent in (100.0, 75.0, 50.0))
"""Turns that the published twin's figures are known of."""

PRIOR_WEIGHT = 0.15
"""Pull to the data-sheet machine in the first search, which finds where figures are met: at 1 a tolerance would weigh as
much as a range, both read as 95 %; below it figures count more."""

IDENTIFIABLE = 0.02
"""A parameter is searched if a quarter of its range moves the figures by more than this many tolerances, at the start
or at one of :data:`PROBES` random points: a relief valve is only felt where it is reached."""

PROBES = 3
"""Random points at which the parameters are tried as well."""

FIGURES_SOURCE = "C: published key figures of left turns"
"""Of what the fit found, in a machine file."""

EQUALLY_WELL = 0.3
"""Ensemble members may miss a figure by this much of its tolerance more than the best fit does."""

SINGLE_FIGURES: Mapping[str, tuple[Callable[[Machine, str, int], NDArray[np.float64]], float]] = {
    "motor_pressure": (lambda machine, device, substeps: rolling_pressure(machine), MOTOR_PRESSURE_TARGET),
    "motor_pressure_without_brake": (
        lambda machine, device, substeps: rolling_pressure(machine, brake=False),
        BARE_PRESSURE_TARGET,
    ),
    "rim_speed": (
        lambda machine, device, substeps: rim_speed(machine, device=device, substeps=substeps),
        RIM_SPEED_TARGET,
    ),
    "mass": (lambda machine, device, substeps: np.atleast_1d(machine.mass), MASS_TARGET),
}
"""Published figures beside those of the turns: how a machine's (N,) is found, and its relative tolerance."""

LARGEST_MISS = 3.0
"""Tolerances by which a machine of this kind may miss a figure. Tolerances are read as 95 %: three of them are six standard
deviations, which no figure of 25 misses by chance."""

PROBABLE_STEPS = 25
"""Steps that the search for the most probable machine usually takes, for the estimate of its end."""

PROCEDURE = 15.0
"""Work of the published procedure, in machines that do all turns of :data:`LEVELS`."""


@dataclass(frozen=True)
class Calibration:
    """What a calibration found."""

    machine: Machine
    ensemble: tuple[Machine, ...]
    report: dict[str, Any]

    @property
    def fits(self) -> bool:
        """Whether the machine does what it was calibrated to."""
        return bool(self.report["verdict"]["fits"])


def calibrate_published(
    datasheet: Machine,
    *,
    ensemble: int = 0,
    starts: int = 2,
    population: int = 512,
    seed: int = 0,
    device: str = "cpu",
    folder: Path | None = None,
    restart: bool = False,
    accept_code_change: bool = False,
    hold_published: bool = False,
    progress: Progress = lambda sentence, share: None,
) -> Calibration:
    """Calibrate ``datasheet`` against the published figures.

    First the published procedure alone; then all uncertain parameters within their ranges against the key figures of
    the published twin (rows ``mevea``) and its steady flow, which hardly swings: least squares from several starts, and
    from each the most probable machine that has all figures within their tolerances (:mod:`.probable`); then likewise the
    right side of the valve against right turns (:mod:`.right_turns`). Every search is seeded and resumes from ``folder``.

    Args:
        datasheet: Machine before any calibration; its ranges bound the search.
        ensemble: Further machines that fit as well, as different as the figures allow.
        starts: Searches that are refined.
        population: Machines of the first population.
        seed: Seed of population and ensemble.
        device: Where the twins run.
        folder: Where finished parts are kept, to resume from; it is locked.
        restart: Begin anew, whatever the folder holds.
        accept_code_change: Resume though the code has changed since, and record that.
        hold_published: Parameters that the publication gives a value of keep it; only the others are searched.
        progress: Called with a sentence and the share done.

    Raises:
        ValueError: a step of the procedure cannot be done within the ranges. Or ``folder`` was begun with other inputs or
            code, which are named, or another process works in it.
    """
    inputs = {
        "machine": datasheet.identity, "published": True, "ensemble": ensemble, "starts": starts,
        "population": population, "seed": seed, "device": device, **({"hold_published": True} if hold_published else {}),
    }  # fmt: skip
    with resumable(folder, inputs, restart=restart, accept_code_change=accept_code_change) as accepted:
        held = _published_values(datasheet) if hold_published else {}
        uncertain = [p.key for p in datasheet.parameters() if p.role in ("nuisance", "both") and p.key not in held]
        work = Work(progress, _phases(len(uncertain), starts, population, ensemble))
        comparison = PublishedFigures(*published_targets(), device=device, work=work)
        work.begin("procedure", "the published procedure")
        prior = measured_curve(datasheet.set(held))
        start = published_procedure(datasheet.set(held), comparison.told("procedure", PROCEDURE), device)
        identifiable = comparison.identifiable(Space(start, uncertain), seed)
        space = Space(start, list(compress(uncertain, identifiable)))
        work.expect(_phases(len(space.keys), starts, population, ensemble))
        fits, chosen = _searched(comparison, space, space.point(prior), starts, population, seed, folder)
        points = _ensemble(comparison, space, fits, chosen, ensemble, seed)
        machines, right, dropped = _machines(comparison, space, points, prior, held)
        searched = Space(start, [*space.keys, *(key for key in (*KEYS, EDGE) if key not in held)])
        bounds = searched.at_bounds(searched.point(machines[0]))
        report = {
            "verdict": comparison.verdict(chosen, len(bounds), len(searched.keys)),
            "method": "published procedure, then the most probable machine that has the published twin's key figures of "
            "left turns, then its right side by right turns",
            "starts": [{"cost": fit.cost, "evaluations": fit.evaluations} for fit in fits],
            "searched": list(searched.keys),
            "held": list(held),
            "not_felt": [key for key in compress(uncertain, ~identifiable) if key not in searched.keys],
            "leaning_on_a_bound": [{"key": key, "end": end} for key, end in bounds],
            "prior_cost": float(prior_cost(np.array(chosen.point), space.point(prior))),
            **comparison.described(space, chosen, right),
            "ensemble": len(machines) - 1,
            "ensemble_wanted": ensemble,
            "ensemble_dropped": dropped,
            "seed": seed,
            "accepted_code_changes": accepted,
        }
        work.end()
        return Calibration(machines[0], tuple(machines[1:]), report)


def _published_values(machine: Machine) -> dict[str, float]:
    """What the publication gives of uncertain parameters, by key, in the file's units."""
    return {
        p.key: p.published for p in machine.parameters() if p.published is not None and p.role in ("nuisance", "both")
    }


def _phases(free: int, starts: int, population: int, ensemble: int) -> dict[str, float]:
    """Work that is expected of each phase with so many ``free`` parameters, in machines that do all turns."""
    step = free + 1 + len(BOXES) + 1
    return {
        "procedure": PROCEDURE,
        "sensitivity": (1 + PROBES) * (free + 1.0),
        "population": float(population),
        **{f"start {index + 1}": float(USUAL_STEPS * step) for index in range(starts)},
        **{f"probable {index + 1}": float(PROBABLE_STEPS * step) for index in range(starts)},
        "substeps": 3.0,
        **({"ensemble": float(CANDIDATES)} if ensemble else {}),
        "finishing": PROCEDURE * (1 + ensemble),
    }


@dataclass(frozen=True)
class PublishedFigures:
    """Machines beside the published figures, (levels, figures), and their tolerances."""

    target: NDArray[np.float64]
    tolerance: NDArray[np.float64]
    device: str
    work: Work

    def misses(self, machine: Machine, substeps: int = 30) -> NDArray[np.float64]:
        """Misses (figures of the turns, swings of their steady flow, single figures, N) of the variants of ``machine`` in
        half tolerances."""
        levelled = machine.levelled()
        found = population_figures(
            levelled, LEVELS, device=self.device, substeps=substeps, swing=True, progress=self.work.did
        )
        key, swing = found[:, : len(FIGURES)], found[:, len(FIGURES) :]
        turning = ((key - self.target[:, :, None]) / self.tolerance[:, :, None]).reshape(self.target.size, -1)
        count = turning.shape[1]
        single = [
            np.broadcast_to((measure(levelled, self.device, substeps) / published(name) - 1.0) / bound, count)
            for name, (measure, bound) in SINGLE_FIGURES.items()
        ]
        return 2.0 * np.vstack([turning, swing.reshape(-1, count) / SWING_TARGET, *single])

    def residuals(self, space: Space) -> Residuals:
        """The misses of points."""
        return lambda points: self.misses(space.population(points))

    def told(self, phase: str, expected: float) -> Progress:
        """Progress of something that tells shares of a phase."""
        before = 0.0

        def tell(sentence: str, share: float) -> None:
            nonlocal before
            self.work.say(sentence)
            self.work.did(expected * max(share - before, 0.0))
            before = max(share, before)

        return tell

    def identifiable(self, space: Space, seed: int) -> NDArray[np.bool_]:
        """Which parameters of ``space`` the figures feel, at its machine or at one of some random points."""
        self.work.begin("sensitivity", "which parameters the figures feel")
        rng = np.random.default_rng(seed)
        identifiable = np.zeros(len(space.keys), dtype=bool)
        for probe in (space.point(), *rng.uniform(0.1, 0.9, (PROBES, len(space.keys)))):
            _, jacobian = posterior_factor(self.residuals(space), probe, 0.25)
            identifiable |= 0.25 * np.linalg.norm(jacobian, axis=0) / 2.0 > IDENTIFIABLE
        return identifiable

    def verdict(self, fit: Fit, on_a_bound: int, parameters: int) -> dict[str, Any]:
        """Whether a machine of this kind has the figures."""
        worst = float(np.max(np.abs(fit.residuals)) / 2.0)
        fits = worst <= LARGEST_MISS
        bound = f"{on_a_bound} of {parameters} parameters on a bound of their range"
        sentence = (
            f"fits: the largest miss is {worst:.2f} tolerances, {bound}"
            if fits
            else f"does not fit: the largest miss is {worst:.1f} tolerances, where {LARGEST_MISS:g} are the most, {bound};"
            " no machine within these ranges has the published figures"
        )
        return {
            "fits": fits, "sentence": sentence, "largest_miss_tolerances": worst, "bound_tolerances": LARGEST_MISS,
            "on_a_bound": on_a_bound, "parameters": parameters,
        }  # fmt: skip

    def described(self, space: Space, fit: Fit, right: dict[str, float]) -> dict[str, Any]:
        """The misses of a fit and of right turns, figure by figure, and what half the substep changes."""
        self.work.begin("substeps", "half the substep")
        machine = space.population(np.array(fit.point))
        halved = self.misses(machine, substeps=60)[:, 0] - self.misses(machine)[:, 0]
        change = float(np.max(np.abs(halved)) / 2.0)
        turning, swing, single = np.split(
            np.divide(fit.residuals, 2.0), [self.target.size, self.target.size + len(LEVELS) * len(SWING)]
        )
        return {
            "largest_miss_tolerances": float(np.max(np.abs(fit.residuals)) / 2.0),
            "misses_tolerances": {
                f"{turn.signal_percent:g}": dict(zip(FIGURES, row, strict=True))
                for turn, row in zip(LEVELS, turning.reshape(self.target.shape).tolist(), strict=True)
            },
            "swings_tolerances": {
                f"{turn.signal_percent:g}": dict(zip(SWING, row, strict=True))
                for turn, row in zip(LEVELS, swing.reshape(len(LEVELS), -1).tolist(), strict=True)
            },
            "single_misses_tolerances": dict(zip(SINGLE_FIGURES, single.tolist(), strict=True)) | right,
            # none where a turn fails at one of the substeps
            "largest_change_at_half_the_substep_tolerances": change if np.isfinite(change) else None,
        }


def _searched(
    comparison: PublishedFigures,
    space: Space,
    prior: NDArray[np.float64],
    starts: int,
    population: int,
    seed: int,
    folder: Path | None,
) -> tuple[list[Fit], Fit]:
    """All least-squares fits, the best first, and the most probable machine that has all figures of those that they lead to.

    Args:
        comparison: Machines beside the figures.
        space: What is searched, and from where.
        prior: Most probable point (d,) before any turn.
        starts: Least-squares searches.
        population: Machines of their first population.
        seed: Its seed.
        folder: Where steps are kept.
    """
    single = [(name, published(name), bound) for name, (_, bound) in SINGLE_FIGURES.items()]
    problem = digest(space.describe(), comparison.target, comparison.tolerance, single)
    residuals = comparison.residuals(space)
    fits = least_squares_fit(
        residuals, space.point(), prior_weight=PRIOR_WEIGHT, starts=starts, population=population, seed=seed,
        problem=problem, checkpoint=folder / "search.json" if folder else None, work=comparison.work,
    )  # fmt: skip
    chosen = most_probable_fit(
        residuals, prior, np.array([fit.point for fit in fits]), problem=problem, work=comparison.work,
        checkpoint=folder / "search-probable.json" if folder else None,
    )  # fmt: skip
    return fits, chosen


def _ensemble(
    comparison: PublishedFigures, space: Space, fits: list[Fit], chosen: Fit, count: int, seed: int
) -> NDArray[np.float64]:
    """The chosen point and up to ``count`` others that fit as well, (1 + count, d)."""
    if not count:
        return np.array([chosen.point])
    comparison.work.begin("ensemble", f"an ensemble of {count}")
    fitted = np.array([chosen.point, *(fit.point for fit in fits)])
    allowed = np.abs(chosen.residuals)[:, None] + 2.0 * EQUALLY_WELL
    return draw_ensemble(
        comparison.residuals(space), fitted, count + 1, candidates=CANDIDATES, seed=seed,
        accept=lambda found: np.all(np.abs(found) <= allowed, axis=0),
    )  # fmt: skip


def _machines(
    comparison: PublishedFigures, space: Space, points: NDArray[np.float64], prior: Machine, held: Mapping[str, float]
) -> tuple[list[Machine], dict[str, float], list[str]]:
    """The machines of ``points`` with their right sides, the first one's misses, and why others could not be finished."""
    comparison.work.begin("finishing", "right turns")
    machines, right, dropped = [], {}, []
    for i, point in enumerate(points):
        machine = space.machine.set(space.rounded(point), source=FIGURES_SOURCE).levelled()
        try:
            machine, misses = with_right_turns(machine, prior, set(held), comparison.device)
        except ValueError as error:
            if i == 0:
                raise
            dropped.append(str(error))
        else:
            machines.append(machine)
            right = right or misses
        comparison.work.did(PROCEDURE)
    return machines, right, dropped


def published_targets() -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Figures of the published twin at :data:`LEVELS` and their tolerances, both (levels, figures)."""
    rows = {row["signal_percent"]: row for row in published_rows() if row["source"] == "mevea"}
    target = np.array([[rows[turn.signal_percent][name] for name in FIGURES] for turn in LEVELS], dtype=np.float64)
    bounds = np.array([[bound if kind == "difference" else np.nan for kind, bound in TARGETS.values()]] * len(LEVELS))
    relative = np.array([bound for _, bound in TARGETS.values()]) * np.abs(target)
    tolerance = np.where(np.isnan(bounds), relative, bounds)
    full = [i for i, turn in enumerate(LEVELS) if turn.signal_percent == 100.0]
    tolerance[full, FIGURES.index("turn_time_s")] = TURN_TIME_TARGET
    return target, tolerance
