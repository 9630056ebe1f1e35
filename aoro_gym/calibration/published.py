"""The whole calibration against the published figures: procedure, fit, ensemble."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from aoro_gym.calibration.ensemble import draw_ensemble, posterior_factor
from aoro_gym.calibration.fit import least_squares_fit
from aoro_gym.calibration.procedure import meet_times_and_pressure, published_procedure, rolling_pressure
from aoro_gym.calibration.space import Space
from aoro_gym.calibration.turns import population_figures
from aoro_gym.twin import Machine
from aoro_gym.validation.key_figures import FIGURES
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

FELT = 0.02
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

Progress = Callable[[str, float], None]


@dataclass(frozen=True)
class Calibration:
    """What a calibration found."""

    machine: Machine
    ensemble: tuple[Machine, ...]
    report: dict[str, Any]


def calibrate_published(
    datasheet: Machine,
    *,
    ensemble: int = 0,
    starts: int = 2,
    population: int = 512,
    seed: int = 0,
    device: str = "cpu",
    checkpoint: Path | None = None,
    progress: Progress = lambda sentence, share: None,
) -> Calibration:
    """Calibrate ``datasheet`` against the published figures.

    First the published procedure alone; then all uncertain parameters within their ranges against the key figures of
    the published twin (rows ``mevea``), from several starts; then the procedure's iterations once more, for the other
    side and the brake. Every search is seeded and resumes from ``checkpoint``.

    Args:
        datasheet: Machine before any calibration; its ranges bound the search.
        ensemble: Further machines that fit as well, as different as the figures allow.
        starts: Searches that are refined.
        population: Machines of the first population.
        seed: Seed of population and ensemble.
        device: Where the twins run.
        checkpoint: File to resume from.
        progress: Called with a sentence and the share done.
    """
    progress("the published procedure", 0.0)
    start = published_procedure(datasheet, lambda sentence, share: progress(sentence, 0.1 * share))
    target, tolerance = _targets()

    def misses(space: Space, points: NDArray[np.float64], substeps: int = 30) -> NDArray[np.float64]:
        """Misses (figures of the turns, then single ones, N) in half tolerances."""
        machine = space.population(points).levelled()
        found = population_figures(machine, LEVELS, device=device, substeps=substeps)
        turning = ((found - target[:, :, None]) / tolerance[:, :, None]).reshape(target.size, -1)
        count = turning.shape[1]
        single = [
            np.broadcast_to((measure(machine, device, substeps) / published(name) - 1.0) / bound, count)
            for name, (measure, bound) in SINGLE_FIGURES.items()
        ]
        return 2.0 * np.vstack([turning, *single])

    progress("which parameters the figures feel", 0.1)
    uncertain = [p.key for p in start.parameters() if p.role in ("nuisance", "both")]
    whole = Space(start, uncertain)
    rng = np.random.default_rng(seed)
    probes = [whole.point(), *rng.uniform(0.1, 0.9, (PROBES, len(uncertain)))]
    felt = np.zeros(len(uncertain), dtype=bool)
    for i, probe in enumerate(probes):
        _, jacobian = posterior_factor(lambda points: misses(whole, points), probe, 0.25)
        felt |= 0.25 * np.linalg.norm(jacobian, axis=0) / 2.0 > FELT
        progress("which parameters the figures feel", 0.1 + 0.05 * (i + 1) / len(probes))
    space = Space(start, [key for key, is_felt in zip(uncertain, felt, strict=True) if is_felt])

    def residuals(points: NDArray[np.float64]) -> NDArray[np.float64]:
        return misses(space, points)

    single = [(name, published(name), bound) for name, (_, bound) in SINGLE_FIGURES.items()]
    problem = space.describe() + repr((target.tolist(), tolerance.tolist(), single))
    fits = least_squares_fit(
        residuals, space.point(), prior_weight=PRIOR_WEIGHTS[0], starts=starts, population=population, seed=seed,
        problem=problem, checkpoint=checkpoint,
        progress=lambda sentence, share: progress(sentence, 0.15 + 0.5 * share),
    )  # fmt: skip
    chosen, weight = fits[0], PRIOR_WEIGHTS[0]
    for i, heavier in enumerate(PRIOR_WEIGHTS[1:]):
        progress(f"nearer to the data sheet, pull {heavier:g}", 0.65 + 0.15 * i / len(PRIOR_WEIGHTS))
        pulled = least_squares_fit(
            residuals, space.point(), prior_weight=heavier, starts=1, population=1, initial=np.array(chosen.point),
            max_iterations=PULL_ITERATIONS,
            problem=problem, checkpoint=checkpoint and checkpoint.with_name(f"{checkpoint.stem}-{heavier:g}.json"),
        )[0]  # fmt: skip
        if np.max(np.abs(pulled.residuals)) > 2.0:
            break
        chosen, weight = pulled, heavier
    best = np.array(chosen.point)

    progress("half the substep", 0.8)
    halved = misses(space, best, substeps=60)[:, 0] - misses(space, best)[:, 0]
    points = best[None]
    if ensemble:
        progress(f"an ensemble of {ensemble}", 0.82)
        fitted = np.array([chosen.point, *(fit.point for fit in fits)])
        allowed = np.abs(chosen.residuals)[:, None] + 2.0 * EQUALLY_WELL
        points = draw_ensemble(
            residuals, fitted, ensemble + 1, accept=lambda found: np.all(np.abs(found) <= allowed, axis=0), seed=seed
        )

    machines, dropped = [], []
    for i, point in enumerate(points):
        progress("right turn and disc brake", 0.88 + 0.12 * i / len(points))
        try:
            machines.append(_finished(space, point))
        except ValueError as error:
            if i == 0:
                raise
            dropped.append(str(error))
    report = {
        "method": "published procedure, then bounded least squares on the published twin's key figures of left turns",
        "starts": [{"cost": fit.cost, "evaluations": fit.evaluations} for fit in fits],
        "searched": list(space.keys),
        "not_felt": [key for key, is_felt in zip(uncertain, felt, strict=True) if not is_felt],
        "leaning_on_a_bound": [{"key": key, "end": end} for key, end in space.leaning(best)],
        "pull_to_the_data_sheet": weight,
        "largest_miss_tolerances": float(np.max(np.abs(chosen.residuals)) / 2.0),
        "misses_tolerances": {
            f"{turn.signal_percent:g}": dict(zip(FIGURES, row, strict=True))
            for turn, row in zip(
                LEVELS, (np.reshape(chosen.residuals[: target.size], target.shape) / 2.0).tolist(), strict=True
            )
        },
        "single_misses_tolerances": dict(
            zip(SINGLE_FIGURES, np.divide(chosen.residuals[target.size :], 2.0).tolist(), strict=True)
        ),
        "largest_change_at_half_the_substep_tolerances": float(np.max(np.abs(halved)) / 2.0),
        "ensemble": len(machines) - 1,
        "ensemble_wanted": ensemble,
        "ensemble_dropped": dropped,
        "seed": seed,
    }
    progress("done", 1.0)
    return Calibration(machines[0], tuple(machines[1:]), report)


def _targets() -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Figures of the published twin and their tolerances, both (levels, figures)."""
    rows = {row["signal_percent"]: row for row in published_rows() if row["source"] == "mevea"}
    target = np.array([[rows[turn.signal_percent][name] for name in FIGURES] for turn in LEVELS], dtype=np.float64)
    bounds = np.array([[bound if kind == "difference" else np.nan for kind, bound in TARGETS.values()]] * len(LEVELS))
    relative = np.array([bound for _, bound in TARGETS.values()]) * np.abs(target)
    tolerance = np.where(np.isnan(bounds), relative, bounds)
    full = [i for i, turn in enumerate(LEVELS) if turn.signal_percent == 100.0]
    tolerance[full, FIGURES.index("turn_time_s")] = TURN_TIME_TARGET
    return target, tolerance


def _finished(space: Space, point: NDArray[np.float64]) -> Machine:
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
    return meet_times_and_pressure(machine, ("left", "right"))
