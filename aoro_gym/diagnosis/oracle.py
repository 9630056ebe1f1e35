"""What an oracle sees that knows the deviation: how much can be asked of a diagnosis.

It is given what the same plant does with and without its deviation on exact sensors, Δ = with − without, and the noise of
the case's own sensors from its standstills.

*Detectable.* Of the hypotheses "nothing" and "Δ" in Gaussian noise with covariance C, twice the logarithm of the
likelihood ratio has the mean λ = Δᵀ C⁻¹ Δ where Δ is there (Neyman and Pearson). A sensor's zero is nobody's to know: what a
constant of each log and signal explains is projected out, λ = Δᵀ C⁻¹ Δ − (1ᵀ C⁻¹ Δ)² / 1ᵀ C⁻¹ 1. One magnitude is at stake,
so "nothing" is rejected at p < 0.01 where χ² with one degree of freedom exceeds λ with less than 1 % (Wilks). What uncertain
parameters or another day could do instead is not counted: nothing is called undetectable for their sake.

*Shrinkage.* S = 1 − (MS(y − Δ − x) − σ²) / (MS(y − x) − σ²) of a log y, with mean squares MS and x what is expected without
the deviation: the healthy machine's log of the same commands where there is one (whose noise σ² then holds, too), else what
the given twin does. The oracle takes away the very deviation, and is left with what another day, or the twin's laws, do.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.linalg import solve_toeplitz
from scipy.stats import chi2

from aoro_gym.diagnosis.noise import Floats, Noise, noise_of
from aoro_gym.diagnosis.recording import Recording
from aoro_gym.diagnosis.sealing import COLUMNS
from aoro_gym.log import read_table

SIGNIFICANCE = 0.01
"""Probability of rejecting "nothing" where nothing is."""


@dataclass(frozen=True)
class Oracle:
    """What the oracle says of one case.

    Attributes:
        evidence: λ over all logs and signals.
        shrinkage: S by log and signal, where the deviation can be detected in that one alone, and S is above 0.
    """

    evidence: float
    shrinkage: Mapping[tuple[str, str], float]

    @property
    def detectable(self) -> bool:
        return is_detectable(self.evidence)


def is_detectable(evidence: float) -> bool:
    """Whether an oracle with λ = ``evidence`` rejects "nothing"; see the module."""
    return bool(chi2.sf(evidence, 1) < SIGNIFICANCE)


def evidence_of(deviation: Floats, noise: Noise) -> float:
    """λ of a ``deviation`` (F,) of one signal in one log; see the module. Linear solves by Levinson's recursion."""
    ones = np.ones_like(deviation)
    solved = solve_toeplitz(noise.covariance[: len(deviation)], np.stack([deviation, ones], axis=1))
    (own, cross), (_, constant) = np.stack([deviation, ones]) @ solved
    return float(max(own - cross**2 / constant, 0.0))


def removed_share(measured: Floats, deviation: Floats, expected: Floats, variance: float) -> float:
    """S of who takes away the very ``deviation``; all (F,), with the ``variance`` of the noise in measured − expected.

    NaN where there is no gap beyond noise.
    """
    before = float(np.mean(np.square(measured - expected))) - variance
    after = float(np.mean(np.square(measured - deviation - expected))) - variance
    return 1.0 - after / before if before > 0.0 else np.nan


def consult(place: Path, exact: Path, channels: Sequence[str], *, device: str = "cpu") -> Oracle:
    """Ask the oracle of the case at ``place``.

    Args:
        place: Its folder.
        exact: File of :func:`~aoro_gym.diagnosis.sealing.exact_folder`.
        channels: That the diagnosis was given.
        device: Where the twin runs, if the case has no healthy logs.
    """
    logs = [_as_written(path) for path in sorted((place / "logs").glob("*.csv"))]
    healthy = {path.stem: _as_written(path) for path in sorted((place / "healthy").glob("*.csv"))}
    with np.load(exact) as arrays:
        deviations = {
            (log.name, channel): (
                arrays[f"{log.name}/{channel}/with"].astype(np.float64)
                - arrays[f"{log.name}/{channel}/without"].astype(np.float64)
            )
            for log in logs
            for channel in channels
        }
    longest = max(len(deviation) for deviation in deviations.values())
    noises = {channel: noise_of(logs, channel, longest) for channel in channels}
    evidence = {key: evidence_of(deviation, noises[key[1]]) for key, deviation in deviations.items()}
    visible = {key for key, found in evidence.items() if is_detectable(found)}
    expected = {(name, channel): log.channels[channel] for name, log in healthy.items() for channel in channels}
    if not healthy and visible:
        expected = _twin(place / "machine.toml", logs, device)
    copies = 2.0 if healthy else 1.0  # noise is in the log, and in the healthy one that it is held against
    shrinkage = {
        (log.name, channel): removed_share(
            log.channels[channel],
            deviations[log.name, channel],
            expected[log.name, channel],
            copies * noises[channel].std ** 2,
        )
        for log in logs
        for channel in channels
        if (log.name, channel) in visible
    }
    return Oracle(float(sum(evidence.values())), {key: S for key, S in shrinkage.items() if S > 0.0})


def _as_written(path: Path) -> Recording:
    """A log of the suite, taken as it is: one that a diagnosis refuses is scored, too."""
    columns = read_table(path).columns
    steering = columns["steering_signal"][:-1]
    commands = np.stack([steering, columns.get("drive_signal", np.zeros(len(steering) + 1))[:-1]], axis=1)
    channels = {name: columns[column] * unit for name, (column, unit) in COLUMNS.items() if column in columns}
    rest = int(np.argmax(np.any(commands != 0.0, axis=1))) + 1
    return Recording(path.stem, commands, channels, rest, float(np.mean(channels["joint_angle"][:rest])))


def _twin(machine: Path, logs: Sequence[Recording], device: str) -> dict[tuple[str, str], Floats]:
    """What the twin does under the commands of ``logs``, by log and signal."""
    from aoro_gym.diagnosis.replay import Simulator, Task, Variants
    from aoro_gym.twin import Machine

    twin = Variants(Machine.load(machine))
    found = Simulator(device).run([Task(twin, log) for log in logs])
    return {
        (log.name, channel): values[:, 0].astype(np.float64)
        for log, signals in zip(logs, found, strict=True)
        for channel, values in signals.items()
    }
