"""What an oracle sees that knows the deviation: how much can be asked of a diagnosis.

It is given what the same plant does with and without its deviation on exact sensors, Δ = with − without, and the noise of
the case's own sensors from its standstills.

*Visible*, one log and signal by itself. Of the hypotheses "nothing" and "Δ" in Gaussian noise with covariance C, twice the
logarithm of the likelihood ratio has the mean λ = Δᵀ C⁻¹ Δ where Δ is there (Neyman and Pearson). A sensor's zero is
nobody's to know: what a constant of each log and signal explains is projected out, λ = Δᵀ C⁻¹ Δ − (1ᵀ C⁻¹ Δ)² / 1ᵀ C⁻¹ 1.
One magnitude is at stake, so "nothing" is rejected at p < 0.01 where χ² with one degree of freedom exceeds λ with less than
1 % (Wilks).

*Detectable*, all logs and signals together. "Nothing" is not one machine: uncertain parameters lie a little elsewhere on
another day, or anywhere within their ranges where the machine was never commissioned, and what they can do in its stead
cannot be seen in Δ. With J, what a standard deviation of each does to the twin, and R their correlation, C becomes
C + J R Jᵀ, hence λ = K₀₀ − K₀ⱼ (R⁻¹ + Kⱼⱼ)⁻¹ Kⱼ₀ with K = (Δ J)ᵀ C⁻¹ (Δ J), constants projected out as above. All is read on
the clock of the log's arrival at a stop, without the bounce off it (:mod:`aoro_gym.diagnosis.arrival`). The oracle
knows the machine's laws: what the twin's lack makes nothing undetectable. As λ is the least over the uncertain
parameters of a sum of squares, another log never takes from it: logs are asked in turn, the shortest first, until
"nothing" is rejected.

*Detectable, each*, of two effects. Δ of one is what the plant does with both less what it does with the other alone. How
strong the other is, is not known: its own Δ joins J, and nothing is known of its size.

*Shrinkage.* S = 1 − (MS(y − Δ − x) − σ²) / (MS(y − x) − σ²) of a log y, with mean squares MS and x what is expected without
the deviation: the healthy machine's log of the same commands where there is one (whose noise σ² then holds, too), else what
the given twin does. The oracle takes away the very deviation, and is left with what another day, or the twin's laws, do.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cholesky, solve_triangular, toeplitz
from scipy.stats import chi2

from aoro_gym.diagnosis.arrival import arrival_of, bounce, on_clock_of
from aoro_gym.diagnosis.noise import Floats, Noise, noise_of
from aoro_gym.diagnosis.nuisances import Nuisances
from aoro_gym.diagnosis.recording import Recording
from aoro_gym.diagnosis.replay import FINE, Replay, Signals, Simulator, Variants
from aoro_gym.diagnosis_benchmark.sealing import COLUMNS
from aoro_gym.machine import Machine
from aoro_gym.recording.tables import read_table

SIGNIFICANCE = 0.01
"""Probability of rejecting "nothing" where nothing is."""
STARTS = 2
"""Decimals of the joint angle [rad] at which twins start, so that cases share J: it changes λ by a few per cent at most,
and hardly a case lies that close to the threshold."""


@dataclass(frozen=True)
class Oracle:
    """What the oracle says of one case.

    Attributes:
        noise: λ over all logs and signals, were the machine known to the last parameter.
        evidence: λ beside what another day, or another calibration, can do, over as many logs as it takes to reject
            "nothing", or over all.
        each: The same of either of two effects beside the other, by id.
        shrinkage: S by log and signal, where the deviation is visible in that one alone, and S is above 0.
    """

    noise: float
    evidence: float
    shrinkage: Mapping[tuple[str, str], float]
    each: Mapping[str, float] = field(default_factory=dict)

    @property
    def detectable(self) -> bool:
        return is_detectable(self.evidence)

    @property
    def each_detectable(self) -> bool:
        return self.detectable and all(map(is_detectable, self.each.values()))

    def as_dict(self) -> dict[str, Any]:
        """Plain data, for :meth:`of`."""
        return {**vars(self), "shrinkage": [[*key, S] for key, S in self.shrinkage.items()]}

    @classmethod
    def of(cls, data: Mapping[str, Any]) -> Oracle:
        """The oracle of :meth:`as_dict`."""
        shrinkage = {(log, signal): S for log, signal, S in data["shrinkage"]}
        return cls(data["noise"], data["evidence"], shrinkage, data["each"])


def is_detectable(evidence: float) -> bool:
    """Whether an oracle with λ = ``evidence`` rejects "nothing"; see the module."""
    return bool(chi2.sf(evidence, 1) < SIGNIFICANCE)


def information(shifts: Floats, noise: Noise) -> Floats:
    """K (k, k) of ``shifts`` (F, k) of one signal in one log; see the module."""
    factor = cholesky(toeplitz(noise.covariance[: len(shifts)]), lower=True)
    white = solve_triangular(factor, np.column_stack([shifts, np.ones(len(shifts))]), lower=True)
    own, constant = white[:, :-1], white[:, -1]
    cross = constant @ own
    return own.T @ own - np.outer(cross, cross) / (constant @ constant)


def evidence_of(deviation: Floats, noise: Noise) -> float:
    """λ of a ``deviation`` (F,) of one signal in one log in noise alone; see the module."""
    return float(max(information(deviation[:, None], noise)[0, 0], 0.0))


def evidence_given(whole: Floats, precision: Floats) -> float:
    """λ of the first of the shifts whose information is ``whole`` (1 + k, 1 + k) beside the others, whose sizes have the
    ``precision`` (k, k)."""
    cross = whole[1:, 0]
    absorbed = cross @ np.linalg.lstsq(precision + whole[1:, 1:], cross)[0]  # what does nothing at all takes nothing
    return float(max(whole[0, 0] - absorbed, 0.0))


def ideal_gap_closure(measured: Floats, deviation: Floats, expected: Floats, variance: float) -> float:
    """S of who takes away the very ``deviation``; all (F,), with the ``variance`` of the noise in measured − expected.

    NaN where there is no gap beyond noise.
    """
    before = float(np.mean(np.square(measured - expected))) - variance
    after = float(np.mean(np.square(measured - deviation - expected))) - variance
    return 1.0 - after / before if before > 0.0 else np.nan


@dataclass
class Neighbours:
    """Twins for an oracle that is asked of one case after the other.

    Attributes:
        simulator: Runs them; on the CPU by default.
    """

    simulator: Simulator = field(default_factory=Simulator)
    _known: dict[tuple[object, ...], Signals] = field(default_factory=dict, init=False)

    def replayed(self, file: bytes, spread: str, variants: Variants, logs: Sequence[Recording]) -> list[Signals]:
        """What ``variants``, the neighbours by a ``spread`` of the machine that a ``file`` holds, do under the commands of
        ``logs``, from about their start angles: what was asked before is known."""
        usual = [replace(log, start_angle=round(log.start_angle, STARTS)) for log in logs]
        keys = [(file, spread, log.signature, log.start_angle, *log.channels) for log in usual]
        new = {key: log for key, log in zip(keys, usual, strict=True) if key not in self._known}
        if new:
            tasks = [Replay(variants, log, FINE) for log in new.values()]
            self._known |= zip(new, self.simulator.run(tasks), strict=True)
        return [self._known[key] for key in keys]


def consult(place: Path, exact: Path, channels: Sequence[str], *, twins: Neighbours | None = None) -> Oracle:
    """Ask the oracle of the case at ``place``.

    Args:
        place: Its folder.
        exact: File of :func:`~aoro_gym.diagnosis_benchmark.sealing.exact_folder`.
        channels: That the diagnosis was given.
        twins: Of other cases; on the CPU by default.
    """
    twins = twins or Neighbours()
    logs = [_as_written(path, channels) for path in sorted((place / "logs").glob("*.csv"))]
    healthy = {path.stem: _as_written(path, channels) for path in sorted((place / "healthy").glob("*.csv"))}
    with np.load(exact) as arrays:
        purposes = dict.fromkeys(name.rpartition("/")[2] for name in arrays.files)

        def exactly(*purposes: str) -> list[Signals]:
            """Signals (F, n) by log and channel."""
            return [
                {c: np.stack([arrays[f"{log.name}/{c}/{one}"] for one in purposes], axis=1) for c in channels}
                for log in logs
            ]

        signals = exactly("with", "without")
        parts = {one.removeprefix("without "): one for one in purposes if one.startswith("without ")}
        of_each = {
            name: exactly("with", part, *(other for other in parts.values() if other != part))
            for name, part in parts.items()
        }
    deviations = {
        (log.name, channel): values[:, 0].astype(np.float64) - values[:, 1]
        for log, shown in zip(logs, signals, strict=True)
        for channel, values in shown.items()
    }
    longest = max(len(deviation) for deviation in deviations.values())
    noises = {channel: noise_of(logs, channel, longest) for channel in channels}
    alone = {key: evidence_of(deviation, noises[key[1]]) for key, deviation in deviations.items()}
    visible = {key for key, found in alone.items() if is_detectable(found)}
    expected = {(name, channel): log.channels[channel] for name, log in healthy.items() for channel in channels}
    if not healthy and visible:
        expected = _twin(place / "machine.toml", logs, twins.simulator)
    copies = 2.0 if healthy else 1.0  # noise is in the log, and in the healthy one that it is held against
    shrinkage = {
        (log.name, channel): ideal_gap_closure(
            log.channels[channel],
            deviations[log.name, channel],
            expected[log.name, channel],
            copies * noises[channel].std ** 2,
        )
        for log in logs
        for channel in channels
        if (log.name, channel) in visible
    }
    evidence, *each = (
        _evidence_given_calibration(place, bool(healthy), logs, shown, noises, twins)
        for shown in (signals, *of_each.values())
    )
    visible_shrinkage = {key: S for key, S in shrinkage.items() if S > 0.0}
    return Oracle(float(sum(alone.values())), evidence, visible_shrinkage, dict(zip(of_each, each, strict=True)))


def _evidence_given_calibration(
    place: Path,
    commissioned: bool,
    logs: Sequence[Recording],
    signals: Sequence[Mapping[str, NDArray[Any]]],
    noises: Mapping[str, Noise],
    twins: Neighbours,
) -> float:
    """λ (:func:`evidence_given`) of the first less the second of some machines' ``signals`` (F, 2 + n) by log, beside the
    calibration and the first less each of the others, of whose size nothing is known."""
    file = place / "machine.toml"
    spread = "day" if commissioned else "range"
    uncertain = Nuisances(Machine.load(file), spread)
    steps = uncertain.steps
    points = np.vstack([np.zeros(len(steps)), np.diag(steps)])
    variants = Variants(uncertain.machines(points), len(points))
    others = next(iter(signals[0].values())).shape[1] - 2
    precision = np.pad(np.eye(len(steps)), (0, others))
    whole, evidence = np.zeros((1 + len(precision), 1 + len(precision))), 0.0
    for index in sorted(range(len(logs)), key=lambda index: logs[index].ticks):
        log = logs[index]
        arrival = arrival_of(log.channels["joint_angle"], log.commands[:, 0])
        (around,) = twins.replayed(file.read_bytes(), spread, variants, [log])
        read, known = (on_clock_of(log, arrival, each) for each in (signals[index], around))
        for channel, values in read.items():
            slopes = np.nan_to_num(known[channel][:, 1:] - known[channel][:, :1]) / steps
            shifts = np.column_stack([values[:, 0] - values[:, 1], slopes, values[:, :1] - values[:, 2:]]).astype(
                np.float64
            )
            if channel != "joint_angle":
                shifts[bounce(arrival)] = 0.0
            whole += information(shifts, noises[channel])
        evidence = evidence_given(whole, precision)
        if is_detectable(evidence):
            break
    return evidence


def _as_written(path: Path, only: Sequence[str]) -> Recording:
    """A log of the suite, taken as it is: one that a diagnosis refuses is scored, too."""
    columns = read_table(path)
    steering = columns["steering_signal"][:-1]
    drive = columns["drive_signal"][:-1] if "drive_signal" in columns else np.zeros_like(steering)
    commands = np.stack([steering, drive], axis=1)
    named = {name: COLUMNS[name] for name in only}
    channels = {name: columns[column] * unit for name, (column, unit) in named.items() if column in columns}
    rest = int(np.argmax(np.any(commands != 0.0, axis=1))) + 1
    return Recording(path.stem, commands, channels, rest, float(np.mean(channels["joint_angle"][:rest])))


def _twin(machine: Path, logs: Sequence[Recording], simulator: Simulator) -> dict[tuple[str, str], Floats]:
    """What the twin does under the commands of ``logs``, by log and signal."""
    twin = Variants(Machine.load(machine))
    found = simulator.run([Replay(twin, log, FINE) for log in logs])
    return {
        (log.name, channel): values[:, 0].astype(np.float64)
        for log, signals in zip(logs, found, strict=True)
        for channel, values in signals.items()
    }
