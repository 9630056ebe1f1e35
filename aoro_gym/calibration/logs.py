"""Calibration from a user's logs: full turns, ramps, drives, anything that the commands of a log tell the machine to do.

The twin repeats all commands of each log, on its ground, and its angle and pressures are compared sample by sample, both
behind the same zero-phase 7 Hz low-pass. What the data fix and what they leave open is said parameter by parameter, and
whether any machine of this kind does what the logs say (:mod:`.verdict`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from itertools import compress
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from aoro_gym.calibration.choice import choose_laws, folds_of, phases, searchable
from aoro_gym.calibration.comparison import Comparison
from aoro_gym.calibration.ensemble import CANDIDATES, draw_ensemble, posterior_factor
from aoro_gym.calibration.fit import BOXES, USUAL_STEPS, Fit, least_squares_fit
from aoro_gym.calibration.progress import Progress, Work
from aoro_gym.calibration.published import Calibration
from aoro_gym.calibration.recordings import FilteredLog, read_filtered_log
from aoro_gym.calibration.replay import ENGINE_SPEED
from aoro_gym.calibration.resuming import log_inputs, resumable
from aoro_gym.calibration.space import PRIOR_STD, Space
from aoro_gym.calibration.verdict import judge
from aoro_gym.execution.digest import digest
from aoro_gym.machine import Machine

IDENTIFIED = 0.5
"""A parameter counts as identified if the data shrink its standard deviation below this share of the prior one."""

MOST_STEPS = 25
"""Steps of a search, at most."""
QUICK_STEPS = 3
"""The same of a quick one."""

SEARCH = "search.json"
"""What is kept of the search, in the folder of an unfinished calibration."""


def calibrate_logs(
    machine: Machine,
    logs: Sequence[Path],
    *,
    keys: Sequence[str] | None = None,
    families: Sequence[str] = (),
    quick: bool = False,
    ensemble: int = 0,
    starts: int = 2,
    population: int = 64,
    seed: int = 0,
    device: str = "cpu",
    folder: Path | None = None,
    restart: bool = False,
    accept_code_change: bool = False,
    progress: Progress = lambda sentence, share: None,
) -> Calibration:
    """Calibrate ``machine`` against logs.

    All uncertain parameters that the logs feel are searched within their ranges, of several families of laws with those of
    the one that predicts best (:mod:`.choice`). The report gives every one its value
    and 95 % interval (Gauss–Newton posterior, widened where the residuals are larger than the noise explains), says
    whether the data identify it, and begins with the verdict: whether the machine that was found does what the logs say.

    Args:
        machine: Start of the search; its ranges bound it.
        logs: Files with ``time_s``, the commands that the machine was given, ``joint_angle_rad`` (or ``_deg``), and
            pressures and the engine's speed as far as they were measured; beside them the manifests, if there are any.
        keys: Parameters that may change; by default all that are uncertain.
        families: Families of laws to choose from, ``"file"`` for the machine's own laws, which are kept by default.
        quick: Choose the laws by the screening alone, and end a search after :data:`QUICK_STEPS` steps.
        ensemble: Further machines that fit as well, as different as the logs allow.
        starts: Searches that are refined.
        population: Machines of the first population.
        seed: Seed of population and ensemble.
        device: Where the twins run.
        folder: Where finished parts are kept, to resume from; it is locked.
        restart: Begin anew, whatever the folder holds.
        accept_code_change: Resume though the code has changed since, and record that.
        progress: Called with a sentence and the share done.

    Raises:
        ValueError: a log cannot be used; the message names file, line and reason. Or ``folder`` was begun with other
            inputs or code, which are named, or another process works in it.
    """
    paths = [Path(path) for path in logs]
    if not paths:
        raise ValueError("no log given; name at least one")
    recordings = [read_filtered_log(path) for path in paths]
    inputs = {
        "machine": machine.identity,
        "logs": log_inputs(paths),
        "keys": None if keys is None else list(keys),
        **({"families": list(families)} if families else {}), **({"quick": True} if quick else {}),
        "ensemble": ensemble, "starts": starts, "population": population, "seed": seed, "device": device,
    }  # fmt: skip
    pinned = [ENGINE_SPEED] if any(r.manifest.engine_speed_rpm for r in recordings) else []
    search = _Search(starts, population, QUICK_STEPS if quick else MOST_STEPS, ensemble, seed, folder)
    free = len(keys or searchable(machine))
    expected = phases(free, len(families), len(folds_of(recordings)), quick=quick) if families else {}
    comparison = Comparison(recordings, device, Work(progress, expected | search.phases(free)))
    with resumable(folder, inputs, restart=restart, accept_code_change=accept_code_change) as accepted:
        chosen = None
        if families:
            chosen = choose_laws(
                comparison, machine, families, keys=keys, pinned=pinned, quick=quick, seed=seed, folder=folder
            )
            machine = chosen.machine
        uncertain = list(keys or searchable(machine))
        found = _fitted(comparison, machine, [key for key in uncertain if key not in pinned], search)
        found.report.update(
            ({} if chosen is None else {"laws": chosen.report}), seed=seed, accepted_code_changes=accepted,
            fixed_by_manifests=[key for key in pinned if key in uncertain],
        )  # fmt: skip
        comparison.work.end()
        return found


@dataclass(frozen=True)
class _Search:
    """Sizes of a search; see :func:`calibrate_logs`."""

    starts: int
    population: int
    steps: int
    ensemble: int
    seed: int
    folder: Path | None

    def phases(self, free: int) -> dict[str, float]:
        """Work that is expected of each phase with so many ``free`` parameters, in machines that repeat all logs."""
        start = float(min(USUAL_STEPS, self.steps) * (free + 1 + len(BOXES) + 1))
        return {
            "sensitivity": free + 1.0,
            "population": float(self.population),
            **{f"start {index + 1}": start for index in range(self.starts)},
            "intervals": free + 2.0,
            **({"ensemble": float(CANDIDATES)} if self.ensemble else {}),
        }


def times_one_family(
    machine: Machine,
    recordings: Sequence[FilteredLog],
    families: int,
    *,
    ensemble: int = 0,
    starts: int = 2,
    population: int = 64,
) -> float:
    """How many times the work of one family's calibration a choice among several and its calibration are expected to be.

    Args:
        machine: Start of the search.
        recordings: Logs that it is calibrated to.
        families: How many there are to choose from.
        ensemble: Further machines that fit as well.
        starts: Searches that are refined.
        population: Machines of the first population.
    """
    free = len(searchable(machine))
    one = sum(_Search(starts, population, MOST_STEPS, ensemble, 0, None).phases(free).values())
    return 1.0 + sum(phases(free, families, len(folds_of(recordings)), quick=False).values()) / one


def _fitted(comparison: Comparison, machine: Machine, uncertain: Sequence[str], search: _Search) -> Calibration:
    """The machine of the best fit to all logs, over those of the ``uncertain`` parameters that they feel."""
    identifiable = comparison.identifiable(Space(machine, uncertain))
    space = Space(machine, list(compress(uncertain, identifiable)))
    if not space.keys:
        raise ValueError("no parameter that may change shows in the logs; the machine hardly moves in them")
    comparison.work.expect(search.phases(len(space.keys)))
    fits = least_squares_fit(
        comparison.residuals(space), space.point(), prior_weight=1.0, starts=search.starts, population=search.population,
        seed=search.seed, max_iterations=search.steps,
        problem=digest(space.describe(), machine.laws.names, comparison.recordings),
        checkpoint=search.folder / SEARCH if search.folder else None, work=comparison.work,
    )  # fmt: skip
    found = _found(comparison, space, fits, search.ensemble, search.seed)
    found.report.update(not_felt=list(compress(uncertain, ~identifiable)))
    return found


def _found(comparison: Comparison, space: Space, fits: Sequence[Fit], ensemble: int, seed: int) -> Calibration:
    """The machine of the best fit, its verdict, intervals and ensemble."""
    comparison.work.begin("intervals", "what the logs identify")
    best = np.array(fits[0].point)
    residuals = comparison.residuals(space)
    at_bounds = space.at_bounds(best)
    verdict = judge(comparison.repeated(space.population(best)), len(at_bounds), len(space.keys))
    data = np.array(fits[0].residuals)
    birge = max(1.0, float(np.sqrt(np.mean(data**2))))
    factor, _ = posterior_factor(residuals, best, PRIOR_STD)
    std = np.minimum(birge * np.linalg.norm(factor, axis=1), PRIOR_STD)
    points = best[None]
    if ensemble:
        comparison.work.begin("ensemble", f"an ensemble of {ensemble}")
        allowed = float(np.sum(data**2)) + birge**2 * float(chi2.ppf(0.95, len(best)))
        points = draw_ensemble(
            residuals, np.array([fit.point for fit in fits]), ensemble + 1, prior_std=PRIOR_STD, seed=seed,
            candidates=CANDIDATES, accept=lambda found: np.sum(found**2, axis=0) <= allowed,
        )  # fmt: skip
    names = ", ".join(recording.path.name for recording in comparison.recordings)
    source = f"C: calibrated on {names}" + ("" if verdict.fits else f"; {verdict.sentence}")
    machines = [
        space.machine.set(
            {key: float(v) for key, v in zip(space.keys, space.values(point), strict=True)}, source=source
        )
        for point in points
    ]
    report = {
        "verdict": asdict(verdict),
        "method": "bounded least squares on joint angle and pressures, behind a zero-phase 7 Hz low-pass",
        "logs": [str(recording.path) for recording in comparison.recordings],
        "conditions": [_conditions(recording) for recording in comparison.recordings],
        "warnings": [
            f"{message}; the search begins at that end"
            for message in space.machine.outside_ranges(space.keys).values()
        ],
        "starts": [{"cost": fit.cost, "evaluations": fit.evaluations} for fit in fits],
        "rms_residual_std": verdict.residual_std,
        "parameters": _parameters(space, best, std),
        "leaning_on_a_bound": [{"key": key, "end": end} for key, end in at_bounds],
    }  # fmt: skip
    return Calibration(machines[0], tuple(machines[1:]), report)


def _parameters(space: Space, best: NDArray[np.float64], std: NDArray[np.float64]) -> list[dict[str, Any]]:
    """Value and 95 % interval of each parameter, from the standard deviations (d,) of the point."""
    low, high = (space.values(np.clip(best + sign * 1.96 * std, 0.0, 1.0)) for sign in (-1.0, 1.0))
    return [
        {
            "key": key, "unit": space.machine.entries[key].unit, "value": float(v), "low95": float(a), "high95": float(b),
            "identified": bool(s < IDENTIFIED * PRIOR_STD),
        }
        for key, v, a, b, s in zip(space.keys, space.values(best), low, high, std, strict=True)
    ]  # fmt: skip


def _conditions(recording: FilteredLog) -> dict[str, Any]:
    """What is used of a log and of its manifest, and what not."""
    return {"log": str(recording.path), "used": list(recording.used), "warnings": list(recording.warnings)}
