"""What to record next: manoeuvres by how much each is expected to tell of which cause is right.

Every surviving hypothesis is simulated under every manoeuvre of :func:`catalogue`, at its best fit. What the
fits leave open is a normal spread on top of noise and of the twin's own error, taken as the same for all: machines drawn
from the posterior of the nuisances under the likeliest hypothesis, with the prior of those that the recordings do not show;
the magnitudes of every hypothesis, to first order and weighed by its probability; the new recording's own clock and zeros.
The expected gain is then the mutual information of cause and outcome,

    I = Σ_h p_h E[log₂ p(y | h) / p(y)],    y ~ N(μ_h, Σ),

by Monte Carlo in the span of the means μ_h, where alone they differ, with the same normals for every manoeuvre.

Only the first seconds of a manoeuvre are simulated, and no healthy recording of the same commands is taken to exist: what
is left out would add to the gain.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
from scipy.special import logsumexp

from aoro_gym.diagnosis.linear import Hypothesis, Linear
from aoro_gym.diagnosis.noise import Floats, Noise, noise_of
from aoro_gym.diagnosis.problem import Problem
from aoro_gym.diagnosis.recording import COMMANDS, REST, TICK, Recording
from aoro_gym.diagnosis.replay import FINE, Replay, Signals, Simulator, Variants
from aoro_gym.diagnosis.result import Cause, Experiment
from aoro_gym.diagnosis.where import beyond
from aoro_gym.machine import Machine
from aoro_gym.sensors.pressure import PressureNoise

DURATION = 2.5
"""Simulated time [s] of every manoeuvre, with the standstill before it."""
RIVALS = 6
"""Hypotheses, the likeliest, that are to be told apart."""
UNLIKELY = 0.01
"""Probability below which one is given up."""
DRAWS = 6
"""Machines drawn from the posterior of the nuisances."""
OUTCOMES = 4096
"""Of the Monte Carlo, for each hypothesis."""
APART = 4.0
"""Standard deviations between the means of hypotheses that a manoeuvre separates."""
WORTH = 0.05
"""Least expected gain [bit] of what is suggested."""
SHOWN = 6
"""Suggestions, the best."""
PRESSURES = ("pressure_a", "pressure_b", "pump_pressure")
"""Sensors that can be added."""
SLIPPERY = 0.02
"""Friction of the ground, as a share of that of asphalt, which stands for wheels that are lifted: the machine's weight
stays on its tires, but hardly anything holds them."""


@dataclass(frozen=True)
class Candidate:
    """A manoeuvre that could be recorded."""

    name: str
    description: str
    steering: Floats  # (K,) signals, each held for a tick
    start_angle: float  # [rad]
    drive: float = 0.0  # signal
    engine_rpm: float | None = None  # if not the machine's own
    lifted: bool = False  # wheels off the ground

    def under(self, variants: Variants) -> Variants:
        """``variants`` as the manoeuvre asks for them."""
        machine, plane = variants.machine, variants.plane
        if self.engine_rpm is not None:
            machine = machine.set({"engine.set_speed": self.engine_rpm}, check_ranges=False)
        if self.lifted:
            plane = replace(plane, friction=SLIPPERY)
        return replace(variants, machine=machine, plane=plane)

    def blank(self, channels: Sequence[str]) -> Recording:
        """Recording with its commands and empty ``channels``."""
        commands = np.zeros((len(self.steering), len(COMMANDS)))
        commands[:, 0] = self.steering
        commands[round(REST / TICK) :, 1] = self.drive
        empty = {channel: np.zeros(len(commands) + 1) for channel in channels}
        return Recording(self.name, commands, empty, round(REST / TICK), self.start_angle)


def catalogue(machine: Machine) -> tuple[Candidate, ...]:
    """Manoeuvres that can be recorded on any test ground, of :data:`DURATION` each."""
    stop = float(np.asarray(machine.joint.range))
    half = _signal((0.0, 0.6))
    since = np.arange(len(half)) - round(REST / TICK)  # ticks
    ramp = 0.6 * np.maximum(since, 0) / float(since[-1])
    pulses = 0.8 * ((since >= 0) & (since % round(0.5 / TICK) < round(0.2 / TICK)))
    return (
        Candidate("turn_30", "Full left turn from the right stop, 30 % signal.", _signal((0.0, 0.3)), -stop),
        Candidate("turn_60", "Full left turn from the right stop, 60 % signal.", half, -stop),
        Candidate("turn_90", "Full left turn from the right stop, 90 % signal.", _signal((0.0, 0.9)), -stop),
        Candidate("turn_right_60", "Full right turn from the left stop, 60 % signal.", -half, stop),
        Candidate("slow_ramp", "From straight ahead, signal from 0 to 60 % left within 2 s.", ramp, 0.0),
        Candidate(
            "reversal", "60 % signal to the left for 1 s, then at once as much to the right.",
            _signal((0.0, 0.6), (1.0, -0.6)), -0.3,
        ),
        Candidate("pulses", "Pulses of 80 % signal to the left, 0.2 s each, every 0.5 s.", pulses, -0.3),
        Candidate(
            "pause", "60 % signal to the left, half a second without signal after 0.8 s, then on.",
            _signal((0.0, 0.6), (0.8, 0.0), (1.3, 0.6)), -0.5,
        ),
        Candidate(
            "hold_at_the_stop", "Full signal to the left from just before the stop, held for 2 s once it is reached.",
            _signal((0.0, 1.0)), stop - 0.2,
        ),
        Candidate(
            "low_engine_speed", "Full left turn from the right stop, 60 % signal, engine at 1200 rpm.", half, -stop,
            engine_rpm=1200.0,
        ),
        Candidate(
            "high_engine_speed", "Full left turn from the right stop, 60 % signal, engine at 2000 rpm.", half, -stop,
            engine_rpm=2000.0,
        ),
        Candidate(
            "wheels_lifted", "Full left turn from the right stop, 60 % signal, wheels off the ground or on greased plates.",
            half, -stop, lifted=True,
        ),
        Candidate(
            "turn_while_driving", "Full left turn from the right stop, 60 % signal, while driving at half signal.",
            half, -stop, drive=0.5,
        ),
    )  # fmt: skip


def _signal(*pieces: tuple[float, float]) -> Floats:
    """Signals (K,) at rest and then by pieces: time [s] since the rest, level."""
    signal = np.zeros(round(DURATION / TICK))
    for begin, level in pieces:
        signal[round((REST + begin) / TICK) :] = level
    return signal


def next_experiments(linear: Linear, hypotheses: Sequence[Hypothesis]) -> tuple[Experiment, ...]:
    """Manoeuvres by expected gain, the best first; none where fewer than two refined hypotheses survive.

    Where pressures were not logged, the best manoeuvre with their sensors added is among them.

    Args:
        linear: Of the problem that was attributed.
        hypotheses: With their probabilities, the likeliest first.
    """
    problem = linear.problem
    rivals = [h for h in hypotheses if h.refined and h.probability > UNLIKELY][:RIVALS]
    if len(rivals) < 2:
        return ()
    weights = np.array([h.probability for h in rivals])
    weights /= np.sum(weights)
    more = tuple(name for name in PRESSURES if name not in problem.signals)
    candidates = catalogue(problem.nuisances.machine)
    predictions = _predictions(linear, rivals, weights, candidates, problem.signals + more)
    titles = [Cause(h.effects, h.probability).title for h in rivals]

    def suggested(candidate: Candidate, prediction: Prediction, signals: Sequence[str]) -> Experiment:
        means = prediction.means(signals)
        pairs = [
            (titles[i], titles[j])
            for i, j in combinations(range(len(means)), 2)
            if np.linalg.norm(means[i] - means[j]) > APART
        ]
        return Experiment(candidate.name, candidate.description, information(means, weights), tuple(pairs))

    found = [suggested(*one, problem.signals) for one in zip(candidates, predictions, strict=True)]
    if more:
        every = [suggested(*one, problem.signals + more) for one in zip(candidates, predictions, strict=True)]
        best = max(every, key=lambda one: one.gain)
        added = f"{best.description} Log the pressures of both ports and of the pump, too."
        found.append(replace(best, name=f"{best.name}_with_pressures", description=added))
    found.sort(key=lambda one: -one.gain)
    return tuple(one for one in found if one.gain > WORTH)[:SHOWN]


def information(means: Floats, weights: Floats) -> float:
    """Mutual information [bit] of a cause of H with probabilities ``weights`` (H,), and an outcome that is normal around the
    cause's row of ``means`` (H, k) with unit covariance. Its standard error is 0.02 bit or less."""
    normal = np.random.default_rng(0).standard_normal((OUTCOMES, means.shape[1]))
    squares = np.sum((normal + (means[:, None] - means)[:, :, None]) ** 2, axis=-1)  # (true, other, outcomes)
    ratio = logsumexp(np.log(weights)[:, None] - 0.5 * squares, axis=1) + 0.5 * np.sum(normal**2, axis=1)
    return float(-weights @ np.mean(ratio, axis=1) / np.log(2.0))


@dataclass(frozen=True)
class Prediction:
    """What hypotheses expect of one manoeuvre, whitened by noise and the twin's own error; by signal.

    Attributes:
        differences: From the likeliest hypothesis (n, H).
        spread: Of all of them, in standard deviations (n, r).
    """

    differences: Mapping[str, Floats]
    spread: Mapping[str, Floats]

    def means(self, signals: Sequence[str]) -> Floats:
        """Coordinates (H, k) of the hypotheses, among which what ``signals`` show is normal with unit covariance."""
        differences, spread = (
            np.concatenate([parts[signal] for signal in signals]) for parts in (self.differences, self.spread)
        )
        return np.linalg.qr(beyond(spread, differences))[1].T


class ExperimentSimulator(Simulator):
    """Repeats recordings of ``candidates`` under their conditions, on another's device."""

    def __init__(self, simulator: Simulator, candidates: Sequence[Candidate]):
        super().__init__(simulator.device)
        self._simulator = simulator
        self._candidates = {candidate.name: candidate for candidate in candidates}

    def run(self, tasks: Sequence[Replay], *, lent: bool = False) -> list[Signals]:
        """See :meth:`Simulator.run`."""
        # on ground so slippery that wheels count as lifted, longer steps err by bars
        tasks = [Replay(self._candidates[one.recording.name].under(one.variants), one.recording, FINE) for one in tasks]
        return self._simulator.run(tasks, lent=lent)


def _predictions(
    linear: Linear,
    rivals: Sequence[Hypothesis],
    weights: Floats,
    candidates: Sequence[Candidate],
    channels: Sequence[str],
) -> list[Prediction]:
    """One a candidate. A machine whose simulation diverges counts as one that does as the likeliest hypothesis does."""
    expected = _expected(linear, rivals[0], candidates, channels)
    families = [_family(linear, expected, h, _drawn(linear, h) if h is rivals[0] else None) for h in rivals]
    predicted = expected.simulate(families)
    starts = np.cumsum([0, *(family.count for family in families)])[:-1]
    spread = [expected.own(expected.measured)]
    for first, family, h, weight in zip(starts, families, rivals, weights, strict=True):
        around = predicted[:, first + 1 : first + family.count] - predicted[:, first, None]
        magnitudes = len(h.places)
        spread += [np.sqrt(weight) * around[:, :magnitudes], around[:, magnitudes:] / np.sqrt(DRAWS)]
    differences = predicted[:, starts] - predicted[:, :1]
    plain = np.nan_to_num(np.concatenate([differences, *spread], axis=1))
    whiteners = expected.whiteners(expected.error, expected.measured)
    out: list[tuple[dict[str, Floats], dict[str, Floats]]] = [({}, {}) for _ in candidates]
    for (index, signal), whitener, part in zip(expected.blocks, whiteners, expected.split(plain), strict=True):
        for kept, columns in zip(out[index], np.split(whitener(part), [len(rivals)], axis=1), strict=True):
            kept[signal] = columns
    return [Prediction(*one) for one in out]


def _expected(
    linear: Linear, hypothesis: Hypothesis, candidates: Sequence[Candidate], channels: Sequence[str]
) -> Problem:
    """What a hypothesis expects to be recorded in all ``candidates``, to be explained by machines under their conditions."""
    problem = linear.problem
    blanks = [candidate.blank(channels) for candidate in candidates]
    noise = {channel: _noise(problem, channel, blanks[0].ticks) for channel in channels}
    simulator = ExperimentSimulator(problem.simulator, candidates)

    def explained(recordings: Sequence[Recording]) -> Problem:
        return Problem(
            recordings, problem.nuisances, problem.effects, error=problem.error, noise=noise, misfit=problem.misfit,
            simulator=simulator,
        )  # fmt: skip

    best = _family(linear, explained(blanks), replace(hypothesis, covariance=np.empty((0, 0))), None)
    found = simulator.run([Replay(best, recording) for recording in blanks])
    return explained(
        [
            replace(
                one, channels={name: np.nan_to_num(values[:, 0].astype(np.float64)) for name, values in signals.items()}
            )
            for one, signals in zip(blanks, found, strict=True)
        ]
    )


def _noise(problem: Problem, channel: str, lags: int) -> Noise:
    """Of a channel as it was logged, or of a common sensor that could be added."""
    if channel in problem.signals:
        return noise_of(problem.recordings, channel, lags)
    sensor = PressureNoise.typical()
    return Noise(np.r_[sensor.white**2 + sensor.resolution**2 / 12.0, np.zeros(lags)])


def _drawn(linear: Linear, hypothesis: Hypothesis) -> Floats:
    """Nuisances (DRAWS, d), all of the machine's, in prior standard deviations: from the posterior if they are felt."""
    problem = linear.problem
    felt = len(problem.felt)
    rng = np.random.default_rng(0)
    root = np.linalg.cholesky((hypothesis.tangent or linear.tangent).covariance)
    deviations = rng.standard_normal((DRAWS, len(root))) @ root.T
    drawn = rng.standard_normal((DRAWS, len(problem.nuisances.keys)))
    drawn[:, problem.felt] = (hypothesis.nuisances + deviations)[:, :felt]
    return drawn


def _family(linear: Linear, blank: Problem, hypothesis: Hypothesis, drawn: Floats | None) -> Variants:
    """The best fit of a hypothesis, then one machine a standard deviation away along every axis of the covariance of its
    magnitudes, nuisances following, then those with nuisances ``drawn`` (n, d)."""
    felt = linear.problem.felt
    z = np.array(hypothesis.places, dtype=np.float64)
    places, nuisances = [z], [hypothesis.nuisances]
    power, axes = np.linalg.eigh(hypothesis.covariance)
    tangent = hypothesis.tangent or linear.tangent
    for step in (axes * np.sqrt(power)).T:
        # inwards, where the range ends nearer than that
        moved = max((np.clip(z + s, 0.0, 1.0) for s in (step, -step)), key=lambda to: float(np.linalg.norm(to - z)))
        slopes = hypothesis.slopes if hypothesis.tangent else np.column_stack(linear.shift(hypothesis.effects, z, 1))
        places.append(moved)
        nuisances.append(hypothesis.nuisances + tangent.best(-slopes @ (moved - z)))
    points = np.zeros((len(places), len(linear.problem.nuisances.keys)))
    points[:, felt] = np.array(nuisances)[:, : len(felt)]
    if drawn is not None:
        points = np.vstack([points, drawn])
        places += [z] * len(drawn)
    return blank.at(points, hypothesis.effects, np.array(places))
