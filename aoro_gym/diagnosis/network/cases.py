"""From recordings to what the network takes, and from what it says to probabilities.

Recordings of the same commands on a healthy and on a later day are compared with one another, and healthy ones that repeat
a command with the first of them; the others stand alone.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from aoro_gym.diagnosis.network import hypotheses
from aoro_gym.diagnosis.network.features import CHANNELS, SAMPLES, features
from aoro_gym.diagnosis.network.forward import Weights, decided, encoded
from aoro_gym.diagnosis.recording import Recording
from aoro_gym.diagnosis.simulation.manoeuvres import REST, TICK

BEGIN = round(REST / TICK)
"""Sample at which the first command begins."""
ALIKE = 0.05
"""Root mean square of the difference of two commands below which a machine was told the same."""

ELSEWHERE = 0.25
"""Difference [rad] of start angles that makes another manoeuvre of the same command."""

CHUNK = 16
"""Logs that a network reads at once: more take memory and no less time."""

Floats = NDArray[np.float32]


@dataclass(frozen=True)
class Case:
    """J logs as the network takes them.

    Attributes:
        rows: Features (J, FEATURES, SAMPLES).
        names: Of the healthy and of the later recording of each, empty for none.
        repeats: Which of them are two healthy recordings (J,).
    """

    rows: Floats
    names: tuple[tuple[str, str], ...]
    repeats: tuple[bool, ...]


@dataclass(frozen=True)
class Posterior:
    """What networks say of a case.

    Attributes:
        probabilities: Of the hypotheses (hypotheses,).
        quantiles: Of the change of every effect's operational magnitude [SI], were it there (effects, quantiles).
    """

    probabilities: NDArray[np.float64]
    quantiles: NDArray[np.float64]

    def widened(self, factor: float) -> Posterior:
        """The same with quantiles that lie farther from their medians by a ``factor``."""
        middle = self.quantiles[:, self.quantiles.shape[1] // 2, None]
        return Posterior(self.probabilities, middle + factor * (self.quantiles - middle))

    @property
    def effects(self) -> NDArray[np.float64]:
        """Probability (effects,) that an effect is there, alone or with another."""
        return self.probabilities @ hypotheses.MEMBERS


def case_of(later: Sequence[Recording], healthy: Sequence[Recording] = ()) -> Case:
    """The recordings of a case, paired by what the machine was told.

    Raises:
        ValueError: there is no recording of the later day.
    """
    if not later:
        raise ValueError("no recording given; name at least one log")
    pairs = paired(later, healthy)
    parts = [[None if one is None else aligned(one) for one in (pair.healthy, pair.later)] for pair in pairs]
    count = len(pairs)
    commands, signals = np.zeros((count, 2, SAMPLES), np.float32), np.zeros((2, count, len(CHANNELS), SAMPLES))
    has, days = np.ones((count, len(CHANNELS)), np.float32), np.zeros((count, 2), np.float32)
    for row, pair in enumerate(parts):
        for day, part in enumerate(pair):
            if part is None:
                continue
            commands[row], signals[day, row] = part.commands, np.nan_to_num(part.signals)
            days[row, day] = 1.0
            has[row] *= np.isfinite(part.signals).all(axis=1)
    before, after = signals.astype(np.float32)
    repeats = np.array([pair.repeat for pair in pairs])
    rows = features(np, commands, before, after, has, days, repeats.astype(np.float32))
    names = tuple((_name(pair.healthy), _name(pair.later)) for pair in pairs)
    return Case(rows.astype(np.float32), names, tuple(repeats.tolist()))


def posterior(networks: Sequence[Weights], case: Case) -> Posterior:
    """The mean of what ``networks`` say of a case."""
    tokens = [one[None] for one in tokens_of(networks, case.rows)]
    probabilities, quantiles = posteriors(networks, tokens)
    return Posterior(probabilities[0], quantiles[0])


def _name(recording: Recording | None) -> str:
    return "" if recording is None else recording.name


def tokens_of(networks: Sequence[Weights], rows: Floats) -> list[Floats]:
    """What each of the ``networks`` keeps of N logs, each by itself, (N, kept, width); ``rows`` as in :class:`Case`."""
    return [
        np.concatenate([encoded(one, rows[first : first + CHUNK]) for first in range(0, len(rows), CHUNK)])
        for one in networks
    ]


def posteriors(
    networks: Sequence[Weights], tokens: Sequence[Floats]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Probabilities (B, hypotheses) and quantiles [SI] (B, effects, quantiles) of B cases, all of J logs: means over
    ``networks``.

    Args:
        networks: Trained ones.
        tokens: What each keeps of the cases' logs (B, J, kept, width), see :func:`tokens_of`.
    """
    said = (
        decided(weights, kept, np.ones(kept.shape[:2], dtype=bool))
        for weights, kept in zip(networks, tokens, strict=True)
    )
    return averaged(networks, said)


def averaged(
    networks: Sequence[Weights], said: Iterable[tuple[Floats, Floats]]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Probabilities and quantiles [SI] as in :func:`posteriors`, of the logits and scaled quantiles that each of the
    ``networks`` said."""
    shares, sizes = [], []
    for weights, (logits, quantiles) in zip(networks, said, strict=True):
        odds = np.exp(logits.astype(np.float64) - logits.max(axis=1, keepdims=True))
        shares.append(odds / odds.sum(axis=1, keepdims=True))
        sizes.append(np.sinh(np.sort(quantiles.astype(np.float64), axis=-1)) * weights.scales[:, None])
    return np.mean(shares, axis=0), np.mean(sizes, axis=0)


@dataclass(frozen=True)
class Aligned:
    """A recording whose command begins at the usual sample: commands (2, SAMPLES), signals (channels, SAMPLES) [SI], NaN of
    a channel that it lacks."""

    commands: Floats
    signals: NDArray[np.float64]


def aligned(recording: Recording) -> Aligned:
    """``recording`` cut off, or continued as it began and ended."""
    moves = np.flatnonzero(np.any(np.abs(recording.commands) > 1e-3, axis=1))
    first = (int(moves[0]) if len(moves) else BEGIN) - BEGIN
    wanted = np.arange(SAMPLES) + first
    told = np.clip(wanted, 0, len(recording.commands) - 1)
    commands = np.where((wanted < 0)[:, None], 0.0, recording.commands[told])
    missing = np.full(recording.ticks + 1, np.nan)
    signals = np.stack([recording.channels.get(name, missing) for name in CHANNELS])
    return Aligned(commands.T.astype(np.float32), signals[:, np.clip(wanted, 0, recording.ticks)])


@dataclass(frozen=True)
class Pair:
    """Recordings of the same commands; where ``repeat``, the later one is healthy, too."""

    healthy: Recording | None
    later: Recording | None
    repeat: bool = False


def paired(later: Sequence[Recording], healthy: Sequence[Recording]) -> list[Pair]:
    """Healthy and later recordings of the same commands, each healthy one once; then those that are left over, beside an
    earlier one of the same commands where there is one."""
    left, pairs = list(healthy), []
    for one in later:
        found = nearest(one, left)
        pairs.append(Pair(None if found is None else left.pop(found), one))
    first = [pair.healthy for pair in pairs if pair.healthy is not None]
    for one in left:
        found = nearest(one, first)
        if found is None:
            first.append(one)
            pairs.append(Pair(one, None))
        else:
            pairs.append(Pair(first[found], one, repeat=True))
    return pairs


def nearest(one: Recording, others: Sequence[Recording]) -> int | None:
    """Number of the recording whose commands are most like those of ``one``; None if a machine was told something else in
    all of ``others``."""
    mine = aligned(one).commands
    apart = [_apart(mine, aligned(other).commands, one, other) for other in others]
    return int(np.argmin(apart)) if apart and min(apart) < ALIKE else None


def _apart(commands: Floats, others: Floats, one: Recording, other: Recording) -> float:
    """Root mean square difference of two commands, and as much again as :data:`ALIKE` for every :data:`ELSEWHERE` between
    the angles that the joint begins at."""
    started = ALIKE / ELSEWHERE * abs(one.start_angle - other.start_angle)
    return float(np.sqrt(np.mean((commands - others) ** 2)) + started)
