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
from aoro_gym.calibration.procedure import meet_times_and_pressure, published_procedure, rolling_pressure
from aoro_gym.calibration.progress import Progress, Work
from aoro_gym.calibration.resuming import resumable
from aoro_gym.calibration.space import Space
from aoro_gym.calibration.turns import population_figures
from aoro_gym.execution.digest import digest
from aoro_gym.machine import Machine
from aoro_gym.simulation.key_figures import FIGURES
from aoro_gym.validation.published import published, published_rows
from aoro_gym.validation.study import (
    BARE_PRESSURE_TARGET,
    MASS_TARGET,
    MOTOR_PRESSURE_TARGET,
    RIM_SPEED_TARGET,
    TARGETS,
    TURN_TIME_TARGET,
)
from aoro_gym.validation.turns import Turn, rim_speed

LEVELS = tuple(Turn("left", percent) for percent in (100.0, 75.0, 50.0))
"""Turns that the published twin's figures are known of."""

PRIOR_WEIGHTS = (0.15, 0.3, 0.5, 0.7, 1.0)
"""Pulls to the data-sheet machine, tried one after the other as long as every figure stays within its tolerance. At 1
the fit is the most probable machine where a range is read as 95 % and so is a tolerance; below it figures count more."""

IDENTIFIABLE = 0.02
"""A parameter is searched if a quarter of its range moves the figures by more than this many tolerances, at the start
or at one of :data:`PROBES` random points: a relief valve is only felt where it is reached."""

PROBES = 3
"""Random points at which the parameters are tried as well."""

PULL_ITERATIONS = 8
"""Steps that each heavier pull is given."""

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
    the published twin (rows ``mevea``), from several starts; then the procedure's iterations once more, for the other
    side and the brake. Every search is seeded and resumes from ``folder``.

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
        comparison = _Comparison(*published_targets(), device=device, work=work)
        work.begin("procedure", "the published procedure")
        start = published_procedure(datasheet.set(held), comparison.told("procedure", PROCEDURE), device)
        identifiable = comparison.identifiable(Space(start, uncertain), seed)
        space = Space(start, list(compress(uncertain, identifiable)))
        work.expect(_phases(len(space.keys), starts, population, ensemble))
        fits, chosen, weight = _searched(comparison, space, starts, population, seed, folder)
        points = _ensemble(comparison, space, fits, chosen, ensemble, seed)
        machines, dropped = _machines(comparison, space, points)
        report = {
            "verdict": comparison.verdict(chosen, len(space.at_bounds(chosen.point)), len(space.keys)),
            "method": "published procedure, then bounded least squares on the published twin's key figures of left turns",
            "starts": [{"cost": fit.cost, "evaluations": fit.evaluations} for fit in fits],
            "searched": list(space.keys),
            "held": list(held),
            "not_felt": list(compress(uncertain, ~identifiable)),
            "leaning_on_a_bound": [{"key": key, "end": end} for key, end in space.at_bounds(chosen.point)],
            "pull_to_the_data_sheet": weight,
            **comparison.described(space, chosen),
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
        **{f"pull {weight:g}": 0.5 * PULL_ITERATIONS * step for weight in PRIOR_WEIGHTS[1:]},
        "substeps": 3.0,
        **({"ensemble": float(CANDIDATES)} if ensemble else {}),
        "finishing": 2.0 * PROCEDURE * (1 + ensemble),
    }


@dataclass(frozen=True)
class _Comparison:
    """Machines beside the published figures, (levels, figures), and their tolerances."""

    target: NDArray[np.float64]
    tolerance: NDArray[np.float64]
    device: str
    work: Work

    def misses(self, machine: Machine, substeps: int = 30) -> NDArray[np.float64]:
        """Misses (figures of the turns, then single ones, N) of the variants of ``machine`` in half tolerances."""
        levelled = machine.levelled()
        found = population_figures(levelled, LEVELS, device=self.device, substeps=substeps, progress=self.work.did)
        turning = ((found - self.target[:, :, None]) / self.tolerance[:, :, None]).reshape(self.target.size, -1)
        count = turning.shape[1]
        single = [
            np.broadcast_to((measure(levelled, self.device, substeps) / published(name) - 1.0) / bound, count)
            for name, (measure, bound) in SINGLE_FIGURES.items()
        ]
        return 2.0 * np.vstack([turning, *single])

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

    def described(self, space: Space, fit: Fit) -> dict[str, Any]:
        """The misses of a fit, figure by figure, and what half the substep changes."""
        self.work.begin("substeps", "half the substep")
        machine = space.population(np.array(fit.point))
        halved = self.misses(machine, substeps=60)[:, 0] - self.misses(machine)[:, 0]
        change = float(np.max(np.abs(halved)) / 2.0)
        rows = np.reshape(fit.residuals[: self.target.size], self.target.shape) / 2.0
        return {
            "largest_miss_tolerances": float(np.max(np.abs(fit.residuals)) / 2.0),
            "misses_tolerances": {
                f"{turn.signal_percent:g}": dict(zip(FIGURES, row, strict=True))
                for turn, row in zip(LEVELS, rows.tolist(), strict=True)
            },
            "single_misses_tolerances": dict(
                zip(SINGLE_FIGURES, np.divide(fit.residuals[self.target.size :], 2.0).tolist(), strict=True)
            ),
            # none where a turn fails at one of the substeps
            "largest_change_at_half_the_substep_tolerances": change if np.isfinite(change) else None,
        }


def _searched(
    comparison: _Comparison, space: Space, starts: int, population: int, seed: int, folder: Path | None
) -> tuple[list[Fit], Fit, float]:
    """All fits, the one of the heaviest pull to the data sheet that leaves every figure within its tolerance, the pull."""
    single = [(name, published(name), bound) for name, (_, bound) in SINGLE_FIGURES.items()]
    problem = digest(space.describe(), comparison.target, comparison.tolerance, single)
    residuals = comparison.residuals(space)
    fits = least_squares_fit(
        residuals, space.point(), prior_weight=PRIOR_WEIGHTS[0], starts=starts, population=population, seed=seed,
        problem=problem, checkpoint=folder / "search.json" if folder else None, work=comparison.work,
    )  # fmt: skip
    chosen, weight = fits[0], PRIOR_WEIGHTS[0]
    for heavier in PRIOR_WEIGHTS[1:]:
        comparison.work.begin(f"pull {heavier:g}", f"nearer to the data sheet, pull {heavier:g}")
        pulled = least_squares_fit(
            residuals, space.point(), prior_weight=heavier, starts=1, population=1, initial=np.array(chosen.point),
            max_iterations=PULL_ITERATIONS, problem=problem, work=comparison.work,
            checkpoint=folder / f"search-{heavier:g}.json" if folder else None,
        )[0]  # fmt: skip
        if np.max(np.abs(pulled.residuals)) > 2.0:
            break
        chosen, weight = pulled, heavier
    return fits, chosen, weight


def _ensemble(
    comparison: _Comparison, space: Space, fits: list[Fit], chosen: Fit, count: int, seed: int
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


def _machines(comparison: _Comparison, space: Space, points: NDArray[np.float64]) -> tuple[list[Machine], list[str]]:
    """The machines of ``points``, finished by the procedure, and why others than the first could not be."""
    comparison.work.begin("finishing", "right turn and disc brake")
    machines, dropped = [], []
    for i, point in enumerate(points):
        try:
            machines.append(_finished(space, point, comparison.device))
        except ValueError as error:
            if i == 0:
                raise
            dropped.append(str(error))
        comparison.work.did(2.0 * PROCEDURE)
    return machines, dropped


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


def _finished(space: Space, point: NDArray[np.float64], device: str) -> Machine:
    """The machine of a fitted point, with the right edge and the disc brake set by the procedure.

    The figures of left turns do not see the right port's return edge; it is taken to be made like the left one's.
    """
    values = {}
    for key, value in zip(space.keys, space.values(point), strict=True):
        low, high = space.machine.entries[key].range
        values[key] = min(max(float(f"{value:.6g}"), low), high)
    machine = space.machine.set(values, source=FIGURES_SOURCE).levelled()
    out = machine.entries["steering.valve.nominal_drop_out_left"].value
    machine = machine.set(
        {"steering.valve.nominal_drop_out_right": float(out)},
        source="C: taken to be made like the left edge",
        check_ranges=False,
    )
    return meet_times_and_pressure(machine, ("left", "right"), device=device)
