"""Calibration from a user's logs of standing turns: full turns, ramps, anything that the steering signal commands.

The twin repeats the log's commands and its angle and pressures are compared sample by sample, both behind the same
zero-phase 7 Hz low-pass. What the data fix and what they leave open is said parameter by parameter.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from aoro_gym.calibration.ensemble import draw_ensemble, posterior_factor
from aoro_gym.calibration.fit import least_squares_fit
from aoro_gym.calibration.published import FELT, Calibration
from aoro_gym.calibration.space import Space
from aoro_gym.recording import logs
from aoro_gym.recording.logs import TICK
from aoro_gym.sensors.chain import low_pass
from aoro_gym.twin import Machine, Twin

EVERY = 4
"""Every so many ticks enter the fit: at 25 Hz the 7 Hz low-pass leaves little that is new between samples."""

CUTOFF = 7.0
"""Cut-off [Hz] of the low-pass."""

CHANNELS: dict[str, tuple[str, float, float]] = {
    # column: output of the twin, SI value of the column's unit, least standard deviation [column's unit]
    "joint_angle_rad": ("joint_angle", 1.0, 2e-4),
    "pressure_a_bar": ("pressure_a", 1e5, 0.5),
    "pressure_b_bar": ("pressure_b", 1e5, 0.5),
    "pump_pressure_bar": ("pump_pressure", 1e5, 0.5),
}

TWIN_CHANNELS = tuple(name for name, _, _ in CHANNELS.values())

PRIOR_STD = 0.25
"""Standard deviation that a range, read as 95 %, gives a parameter in the unit cube."""

IDENTIFIED = 0.5
"""A parameter counts as identified if the data shrink its standard deviation below this share of the prior one."""


@dataclass(frozen=True)
class Recording:
    """A log on the tick grid."""

    path: Path
    signal: NDArray[np.float64]  # (F,) steering signal held from tick to tick
    channels: dict[str, NDArray[np.float64]]  # (F,) low-passed, in the column's unit
    std: dict[str, float]  # of a sample that enters the fit, in the column's unit
    start_angle: float  # [rad]


def read_recording(path: Path) -> Recording:
    """Read a log (:func:`aoro_gym.recording.logs.read_recording`) for calibration.

    Raises:
        ValueError: names the file, the column and what is missing or inconsistent.
    """
    log = logs.read_recording(path, purpose="a calibration", commands=("steering_signal",), channels=TWIN_CHANNELS)
    signal = log.commands["steering_signal"]
    channels, std = {}, {}
    for column, (name, unit, least) in CHANNELS.items():
        if name in log.channels:
            filtered = low_pass(log.channels[name] / unit, rate=1.0 / TICK, cutoff=CUTOFF)
            channels[column] = filtered
            # neighbouring samples share what the low-pass leaves: each counts for less than one
            shared = np.sqrt(max(1.0, 1.0 / (TICK * EVERY) / (2.0 * CUTOFF)))
            std[column] = shared * float(np.hypot(np.std(filtered[: log.rest - 1]), least))
    return Recording(path, np.append(signal, signal[-1]), channels, std, log.start_angle)


def repeat(machine: Machine, recording: Recording, *, device: str = "cpu") -> dict[str, NDArray[np.float64]]:
    """What the twins of ``machine`` (N variants) log under a recording's commands: (F, N) a column, low-passed."""
    twin = Twin(machine.num_variants, machine=machine, device=device, check_step=False)
    limit = np.asarray(machine.joint.range)
    twin.reset(joint_angle=np.clip(recording.start_angle, -limit, limit))
    parts: dict[str, list[NDArray]] = {column: [] for column in recording.channels}
    for column, part in parts.items():
        part.append(twin_value(twin, column)[None])
    # the sample at a tick shows what the commands before it have done
    changes = np.flatnonzero(np.diff(recording.signal[:-1])) + 1
    edges = [0, *changes.tolist(), len(recording.signal) - 1]
    for begin, end in pairwise(edges):
        trace = twin.step(
            {"steering_signal": recording.signal[begin]}, round((end - begin) * TICK, 6), sample_every=TICK
        )
        assert trace is not None
        for column, part in parts.items():
            name, unit, _ = CHANNELS[column]
            part.append(trace[name] / unit)
    out = {}
    for column, part in parts.items():
        values = np.concatenate(part).astype(np.float64)
        values[:, twin.status != 0] = np.nan
        out[column] = low_pass(np.nan_to_num(values), rate=1.0 / TICK, cutoff=CUTOFF)
        out[column][:, twin.status != 0] = np.nan
    return out


def twin_value(twin: Twin, column: str) -> NDArray[np.float64]:
    """Value (N,) of a column right after a reset, from the state."""
    from aoro_gym.twin.records import State

    row = {
        "joint_angle_rad": State.JOINT, "pressure_a_bar": State.PORT_A, "pressure_b_bar": State.PORT_B,
        "pump_pressure_bar": State.SUPPLY,
    }[column]  # fmt: skip
    return twin.state.numpy()[row].astype(np.float64) / CHANNELS[column][1]


def calibrate_logs(
    machine: Machine,
    logs: Sequence[Path],
    *,
    keys: Sequence[str] | None = None,
    ensemble: int = 0,
    starts: int = 2,
    population: int = 64,
    seed: int = 0,
    device: str = "cpu",
    checkpoint: Path | None = None,
    progress: Callable[[str, float], None] = lambda sentence, share: None,
) -> Calibration:
    """Calibrate ``machine`` against logs of standing turns.

    All uncertain parameters that the logs feel are searched within their ranges. The report gives every one its value
    and 95 % interval (Gauss–Newton posterior, widened where the residuals are larger than the noise explains) and says
    whether the data identify it.

    Args:
        machine: Start of the search; its ranges bound it.
        logs: Files with ``time_s``, ``steering_signal`` (or ``_V``), ``joint_angle_rad`` (or ``_deg``), and pressures
            ``pressure_a_bar``, ``pressure_b_bar``, ``pump_pressure_bar`` if they were measured.
        keys: Parameters that may change; by default all that are uncertain.
        ensemble: Further machines that fit as well, as different as the logs allow.
        starts: Searches that are refined.
        population: Machines of the first population.
        seed: Seed of population and ensemble.
        device: Where the twins run.
        checkpoint: File to resume from.
        progress: Called with a sentence and the share done.

    Raises:
        ValueError: a log cannot be used; the message names file, line and reason.
    """
    recordings = [read_recording(Path(path)) for path in logs]
    if not recordings:
        raise ValueError("no log given; name at least one")

    def misses(space: Space, points: NDArray[np.float64]) -> NDArray[np.float64]:
        population = space.population(points)
        rows = []
        for recording in recordings:
            found = repeat(population, recording, device=device)
            for column, measured in recording.channels.items():
                rows.append((found[column] - measured[:, None])[::EVERY] / recording.std[column])
        return np.concatenate(rows)

    progress("which parameters the logs feel", 0.0)
    uncertain = list(keys or (p.key for p in machine.parameters() if p.role in ("nuisance", "both")))
    whole = Space(machine, uncertain)
    _, jacobian = posterior_factor(lambda points: misses(whole, points), whole.point(), PRIOR_STD)
    felt = PRIOR_STD * np.linalg.norm(jacobian, axis=0) > FELT
    space = Space(machine, [key for key, is_felt in zip(uncertain, felt, strict=True) if is_felt])

    def residuals(points: NDArray[np.float64]) -> NDArray[np.float64]:
        return misses(space, points)

    fits = least_squares_fit(
        residuals, space.point(), prior_weight=1.0, starts=starts, population=population, seed=seed,
        problem=space.describe() + repr([(r.signal.tobytes(), r.channels["joint_angle_rad"].tobytes()) for r in recordings]),
        checkpoint=checkpoint, progress=lambda sentence, share: progress(sentence, 0.1 + 0.8 * share),
    )  # fmt: skip
    best = np.array(fits[0].point)
    data = np.array(fits[0].residuals)

    progress("what the logs identify", 0.9)
    factor, _ = posterior_factor(residuals, best, PRIOR_STD)
    birge = max(1.0, float(np.sqrt(np.mean(data**2))))
    std = np.minimum(birge * np.linalg.norm(factor, axis=1), PRIOR_STD)
    low, high = (space.values(np.clip(best + sign * 1.96 * std, 0.0, 1.0)) for sign in (-1.0, 1.0))
    values = space.values(best)

    points = best[None]
    if ensemble:
        progress(f"an ensemble of {ensemble}", 0.92)
        allowed = float(np.sum(data**2)) + birge**2 * float(chi2.ppf(0.95, len(best)))
        points = draw_ensemble(
            residuals, np.array([fit.point for fit in fits]), ensemble + 1, prior_std=PRIOR_STD, seed=seed,
            accept=lambda found: np.sum(found**2, axis=0) <= allowed,
        )  # fmt: skip
    names = ", ".join(recording.path.name for recording in recordings)
    machines = [
        machine.set(
            {key: float(v) for key, v in zip(space.keys, space.values(point), strict=True)},
            source=f"C: calibrated on {names}",
        )
        for point in points
    ]
    report = {
        "method": "bounded least squares on joint angle and pressures, behind a zero-phase 7 Hz low-pass",
        "logs": [str(recording.path) for recording in recordings],
        "starts": [{"cost": fit.cost, "evaluations": fit.evaluations} for fit in fits],
        "rms_residual_std": float(np.sqrt(np.mean(data**2))),
        "parameters": [
            {
                "key": key, "unit": machine.entries[key].unit, "value": float(v), "low95": float(a), "high95": float(b),
                "identified": bool(s < IDENTIFIED * PRIOR_STD),
            }
            for key, v, a, b, s in zip(space.keys, values, low, high, std, strict=True)
        ],
        "not_felt": [key for key, is_felt in zip(uncertain, felt, strict=True) if not is_felt],
        "leaning_on_a_bound": [{"key": key, "end": end} for key, end in space.leaning(best)],
        "seed": seed,
    }  # fmt: skip
    progress("done", 1.0)
    return Calibration(machines[0], tuple(machines[1:]), report)
