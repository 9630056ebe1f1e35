"""What to record next: manoeuvres by how much each is expected to tell of which cause is right.

Causes and sizes are drawn from what the networks say of the recordings; twins with them do every manoeuvre of
:func:`catalogue` on a healthy and on a later day, and the networks are asked again with that pair of logs beside the
recordings. The gain of a manoeuvre is the mean information of the cause that was drawn,

    E_h,y log₂ q(h | y)/q(h),

with what networks say of it, q. Where q is right, that is the mutual information of cause and outcome, the expected fall of
the entropy (Lindley 1956); where it is not, it is less (Barber and Agakov 2003), while the entropy falls just as well for
networks that become sure of what is wrong.

The twins are the user's machine under one family of laws each, on two days that differ as days of the prior do. Something
outside of the catalogue cannot be simulated, so what it would show is left out of the mean; the ground is level.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import toeplitz

from aoro_gym.checks import check_integer
from aoro_gym.diagnosis.network import hypotheses
from aoro_gym.diagnosis.network.cases import Posterior, case_of, posteriors, tokens_of
from aoro_gym.diagnosis.network.features import CHANNELS
from aoro_gym.diagnosis.network.forward import Weights
from aoro_gym.diagnosis.network.shape import QUANTILES
from aoro_gym.diagnosis.noise import Floats, noise_of
from aoro_gym.diagnosis.recording import REST, TICK, Recording
from aoro_gym.diagnosis.replay import COARSE, Replay, Simulator, Variants
from aoro_gym.diagnosis.result import Cause, Experiment
from aoro_gym.diagnosis.simulation.days import another_day, draw_magnitudes
from aoro_gym.diagnosis.simulation.prior import Prior, SensorPrior
from aoro_gym.effects.catalogue import EFFECTS, IDS
from aoro_gym.effects.effect import Effect
from aoro_gym.machine import Machine
from aoro_gym.machine.laws import FAMILIES
from aoro_gym.machine.parameters import InvalidMachine
from aoro_gym.sensors.pressure import PressureNoise

Tokens = NDArray[np.float32]
Progress = Callable[[int, int], Any]

DURATION = 3.2
"""Time [s] of every manoeuvre, with the standstill before it and after it."""
SETTLE = 0.7
"""Time [s] without a command at its end (E): the joint has come to rest."""
WORLDS = 12
"""Causes that are drawn (E)."""
UNLIKELY = 0.01
"""Probability below which a hypothesis is given up."""
TRIED = 128
"""Magnitudes of an effect that are drawn, of which that is taken whose change is nearest to the one looked for."""
HALVINGS = 8
"""Times that an effect is halved which the twin's machine cannot have, before the draw is given up."""
KEPT = 0.01
"""Share of the probabilities now that is mixed into those after a manoeuvre (E): one draw costs 6.6 bit at most."""
SURE = 0.8
"""Mean probability of the right one of two causes, from which on a manoeuvre tells them apart."""
WORTH = 0.05
"""Least expected gain [bit] of what is suggested."""
SHOWN = 6
"""Suggestions, the best."""
PRESSURES = CHANNELS[1:]
"""Sensors that can be added."""


@dataclass(frozen=True)
class Candidate:
    """A manoeuvre that could be recorded.

    Attributes:
        name: As in the result.
        description: For whoever drives.
        commands: Steering and drive signal (K, 2), each held for a tick.
        start_angle: [rad].
    """

    name: str
    description: str
    commands: NDArray[np.float64]
    start_angle: float

    def blank(self, channels: Sequence[str]) -> Recording:
        """Recording with its commands and empty ``channels``."""
        empty = {channel: np.zeros(len(self.commands) + 1) for channel in channels}
        return Recording(self.name, self.commands, empty, round(REST / TICK), self.start_angle)


@dataclass(frozen=True)
class World:
    """What may be so: a hypothesis by its number, and twins of the healthy and of the later day."""

    hypothesis: int
    healthy: Variants
    later: Variants


@dataclass(frozen=True, eq=False)
class Prospects:
    """What networks would say once a manoeuvre was recorded; NaN where a twin diverged.

    Attributes:
        candidates: C manoeuvres.
        truths: Numbers of the hypotheses that were drawn (W,).
        now: Probabilities of all as recordings have them (hypotheses,).
        after: With one manoeuvre more (C, W, hypotheses).
        recorded: What networks keep of the recordings, one array (J, kept, width) a network.
        added: What they keep of the manoeuvres' logs, (C, W, kept, width).
    """

    candidates: tuple[Candidate, ...]
    truths: NDArray[np.int64]
    now: Floats
    after: Floats
    recorded: Sequence[Tokens]
    added: Sequence[Tokens]

    @property
    def gains(self) -> Floats:
        """Information [bit] of the cause that was drawn, by manoeuvre and draw (C, W)."""
        return self._information(self.after)

    def _information(self, after: Floats) -> Floats:
        """Of probabilities (..., W, hypotheses), which count with a share of :data:`KEPT` of those now: no draw by itself
        rules a manoeuvre out."""
        told = after[..., np.arange(len(self.truths)), self.truths]
        return np.log2((1.0 - KEPT) * told / self.now[self.truths] + KEPT)

    def gains_beside(self, networks: Sequence[Weights], first: int) -> Floats:
        """The same (C, W) with manoeuvre number ``first`` recorded, too."""
        out = np.empty(self.after.shape[:2])
        for index in range(len(out)):
            logs = [np.stack([every[first], every[index]], axis=1) for every in self.added]
            out[index] = self._information(_asked(networks, self.recorded, logs))
        return out

    def apart(self, candidate: int) -> tuple[tuple[str, str], ...]:
        """Pairs of drawn causes, the likelier first, of which the right one has a mean probability of :data:`SURE`, given
        that it is one of the two, whichever it is."""
        rivals = [number for number in np.argsort(-self.now) if number in self.truths]

        def told(right: int, wrong: int) -> bool:
            of_two = self.after[candidate][self.truths == right][:, [right, wrong]]
            shares = of_two[:, 0] / of_two.sum(axis=1)
            return bool(np.isfinite(shares).any()) and float(np.nanmean(shares)) >= SURE

        return tuple((title_of(a), title_of(b)) for a, b in combinations(rivals, 2) if told(a, b) and told(b, a))


def catalogue(machine: Machine) -> tuple[Candidate, ...]:
    """Manoeuvres that can be recorded on any test ground, of :data:`DURATION` each."""
    stop = float(np.asarray(machine.joint.range))
    count, first, last = round(DURATION / TICK), round(REST / TICK), round((DURATION - SETTLE) / TICK)
    since = np.arange(count) - first  # ticks
    moving = (since >= 0) & (np.arange(count) < last)
    period, pulse = round(0.5 / TICK), round(0.2 / TICK)
    active = f"{DURATION - SETTLE - REST:.0f} s"

    def signal(*pieces: tuple[float, float]) -> Floats:
        """Signals (K,) by pieces: time [s] since the rest, level."""
        values = np.zeros(count)
        for begin, level in pieces:
            values[first + round(begin / TICK) : last] = level
        return values

    def candidate(name: str, description: str, steering: Floats, start: float, drive: float = 0.0) -> Candidate:
        commands = np.array([steering, drive * moving], dtype=np.float64).T
        return Candidate(name, description, commands, start)

    half = signal((0.0, 0.6))
    return (
        candidate("turn_30", f"Left from the right stop, 30 % signal for {active}.", signal((0.0, 0.3)), -stop),
        candidate("turn_60", f"Left from the right stop, 60 % signal for {active}.", half, -stop),
        candidate("turn_90", f"Left from the right stop, 90 % signal for {active}.", signal((0.0, 0.9)), -stop),
        candidate("turn_right_60", f"Right from the left stop, 60 % signal for {active}.", -half, stop),
        candidate(
            "slow_ramp", f"From straight ahead, signal from 0 to 60 % left within {active}.",
            0.6 * moving * np.maximum(since, 0) / (last - first), 0.0,
        ),
        candidate(
            "reversal", "60 % signal to the left for 1 s, then at once as much to the right for another.",
            signal((0.0, 0.6), (1.0, -0.6)), -0.3,
        ),
        candidate(
            "pulses", f"Pulses of 80 % signal to the left, 0.2 s each, every 0.5 s, for {active}.",
            0.8 * (moving & (since % period < pulse)), -0.3,
        ),
        candidate(
            "pause", "60 % signal to the left, half a second without signal after 0.8 s, then 60 % for 0.7 s.",
            signal((0.0, 0.6), (0.8, 0.0), (1.3, 0.6)), -0.5,
        ),
        candidate(
            "hold_at_the_stop", f"Full signal to the left from just before the stop, {active} in all.",
            signal((0.0, 1.0)), stop - 0.2,
        ),
        candidate(
            "turn_while_driving", f"Left from the right stop, 60 % signal for {active}, while driving at 30 %.", half, -stop,
            0.3,
        ),
    )  # fmt: skip


def next_experiments(
    recordings: Sequence[Recording],
    healthy: Sequence[Recording],
    machine: Machine,
    networks: Sequence[Weights],
    posterior: Posterior,
    *,
    simulator: Simulator,
    seed: int = 0,
    worlds: int = WORLDS,
    progress: Progress = lambda done, total: None,
) -> tuple[Experiment, ...]:
    """Manoeuvres by expected gain, the best first; none where no two hypotheses survive that can be simulated.

    Where pressures were not logged, the best manoeuvre with their sensors added is among them.

    Args:
        recordings: Of the later day.
        healthy: Of the healthy day; without any, manoeuvres are taken to be recorded on the later day alone.
        machine: The user's twin.
        networks: Those that ``posterior`` is from.
        posterior: What they say of the recordings.
        simulator: Of the twins.
        seed: Of all draws.
        worlds: How many causes are drawn, at least 2: the time is in proportion, the gain's error falls with its root.
        progress: Told the manoeuvres that networks were asked about, and all.
    """
    logged = _logged(recordings, healthy)
    added = tuple(name for name in PRESSURES if name not in logged)
    sets = [logged, tuple(name for name in CHANNELS if name in logged or name in added)] if added else [logged]
    found = prospects(
        recordings, healthy, machine, networks, posterior, sets, simulator=simulator, seed=seed, worlds=worlds,
        progress=progress,
    )  # fmt: skip
    if not found:
        return ()
    suggested = experiments_of(found[0])
    if added:
        best = max(experiments_of(found[1]), key=lambda one: one.gain)
        told = f"{best.description} Log the pressures of both ports and of the pump, too."
        suggested.append(replace(best, name=f"{best.name}_with_pressures", description=told))
    suggested.sort(key=lambda one: -one.gain)
    return tuple(one for one in suggested if one.gain >= WORTH)[:SHOWN]


def experiments_of(found: Prospects) -> list[Experiment]:
    """Every manoeuvre with its gain and the standard error of that, in the order of the candidates."""
    out = []
    for index, (candidate, gains) in enumerate(zip(found.candidates, found.gains, strict=True)):
        known = gains[np.isfinite(gains)]
        if len(known) < 2:
            continue
        error = float(np.std(known, ddof=1) / np.sqrt(len(known)))
        out.append(
            Experiment(
                candidate.name, candidate.description, float(np.mean(known)), found.apart(index), gain_error=error
            )
        )
    return out


def prospects(
    recordings: Sequence[Recording],
    healthy: Sequence[Recording],
    machine: Machine,
    networks: Sequence[Weights],
    posterior: Posterior,
    sets: Sequence[Sequence[str]],
    *,
    simulator: Simulator,
    seed: int = 0,
    worlds: int = WORLDS,
    progress: Progress = lambda done, total: None,
) -> list[Prospects]:
    """What every manoeuvre of the catalogue promises, by each of ``sets``; empty where no two hypotheses survive.

    Args:
        sets: Channels that would be logged.
        recordings, healthy, machine, networks, posterior, simulator, seed, worlds, progress: As those of
            :func:`next_experiments`.
    """
    check_integer("worlds", worlds, ge=2)
    rng = np.random.default_rng(seed)
    numbers = drawn_hypotheses(posterior.probabilities, worlds, rng)
    if len(np.unique(numbers)) < 2:
        return []
    drawn = drawn_worlds(machine, posterior, numbers, rng)
    if len(drawn) < 2:
        return []
    candidates = catalogue(machine)
    sensors = _Sensors.drawn([*recordings, *healthy], len(drawn), len(candidates[0].commands) + 1, rng)
    recorded = tokens_of(networks, case_of(recordings, healthy).rows)
    simulated = _simulated(candidates, drawn, simulator)
    truths = np.array([world.hypothesis for world in drawn])
    found = []
    for place, channels in enumerate(sets):
        after, added = [], []
        for index, (candidate, signals) in enumerate(zip(candidates, simulated, strict=True)):
            rows = [sensors.rows(candidate, w, one, channels, bool(healthy)) for w, one in enumerate(signals)]
            added.append(tokens_of(networks, np.concatenate(rows)))
            after.append(_asked(networks, recorded, [tokens[:, None] for tokens in added[-1]]))
            progress(place * len(candidates) + index + 1, len(sets) * len(candidates))
        tokens = [np.stack(of_network) for of_network in zip(*added, strict=True)]
        found.append(Prospects(candidates, truths, posterior.probabilities, np.stack(after), recorded, tokens))
    return found


def entropy(probabilities: Floats) -> Floats:
    """Entropy [bit] along the last axis."""
    return -np.sum(probabilities * np.log2(np.maximum(probabilities, 1e-300)), axis=-1)


def title_of(hypothesis: int) -> str:
    """Its effects, as a :class:`Cause` has them."""
    return Cause(hypotheses.names_of(hypothesis), 0.0).title


def drawn_hypotheses(probabilities: Floats, count: int, rng: np.random.Generator) -> NDArray[np.int64]:
    """Numbers (count,) of hypotheses, each as often as its probability asks for up to one (systematic resampling); without
    unlikely ones and what is outside of the catalogue. Empty where none is left."""
    likely = np.where(probabilities >= UNLIKELY, probabilities, 0.0)
    likely[hypotheses.OUTSIDE] = 0.0
    if not likely.any():
        return np.empty(0, dtype=np.int64)
    steps = (np.arange(count) + rng.uniform()) / count
    order = np.argsort(-likely)
    return order[np.searchsorted(np.cumsum(likely[order]) / likely.sum(), steps)]


def drawn_worlds(
    machine: Machine, posterior: Posterior, numbers: NDArray[np.int64], rng: np.random.Generator
) -> list[World]:
    """Twins with the effects of hypotheses ``numbers``; a draw that no machine can have is left out."""
    count = len(numbers)
    families = [str(name) for _ in range(-(-count // len(FAMILIES))) for name in rng.permutation(list(FAMILIES))]
    before = Machine.stacked([machine.with_laws(name) for name in families[:count]], [1] * count)
    after = another_day(Prior(), before, np.ones(count), rng)
    worlds = []
    for place, number in enumerate(numbers):
        effects = []
        for effect in np.flatnonzero(hypotheses.MEMBERS[number]):
            change = float(np.interp(rng.uniform(), QUANTILES, posterior.quantiles[effect]))
            effects.append((EFFECTS[IDS[effect]], change))
        later = _with_changes(after.variant(place), effects, rng)
        if later is not None:
            worlds.append(World(int(number), Variants(before.variant(place)), later))
    return worlds


def _with_changes(
    machine: Machine, effects: Sequence[tuple[Effect, float]], rng: np.random.Generator
) -> Variants | None:
    """``machine`` with effects that change their first operational magnitude by as much [SI], or by less where it cannot
    have that much; None if it can have none of it."""
    share = 1.0
    for _ in range(HALVINGS):
        try:
            sized = [(effect, magnitudes_of(effect, machine, share * change, rng)) for effect, change in effects]
            return Variants.of(machine, sized, 1)
        except InvalidMachine:
            share *= 0.5
    return None


def magnitudes_of(effect: Effect, machine: Machine, change: float, rng: np.random.Generator) -> tuple[float, ...]:
    """Magnitudes with which ``effect`` changes its first operational magnitude on ``machine`` by about ``change`` [SI]: the
    nearest of :data:`TRIED` of the effect's range. Where an effect has two, many pairs do; this is one of them.

    Raises InvalidMachine where the machine can hardly have any.
    """
    drawn, _ = draw_magnitudes(effect, TRIED, (Prior().weakest, 1.0), rng)
    none = np.array(effect.none)[:, None]
    without = float(np.asarray(effect.measured(machine, *effect.none)[0]))
    share = np.ones(TRIED)
    for attempt in range(HALVINGS):
        tried = none + share * (drawn - none)
        try:
            found = np.broadcast_to(effect.measured(machine, *tried)[0], TRIED) - without
            return tuple(tried[:, int(np.argmin(np.abs(found - change)))].tolist())
        except InvalidMachine as error:
            if attempt == HALVINGS - 1:
                raise
            share = np.where(np.broadcast_to(error.shown[0][1], TRIED), 0.5 * share, share)
    raise AssertionError


@dataclass(frozen=True)
class _Sensors:
    """What sensors add to the logs of every world and day, the same in all manoeuvres.

    Attributes:
        noise: (W, days, channels, F) [SI].
    """

    noise: Floats

    @classmethod
    def drawn(cls, recordings: Sequence[Recording], worlds: int, count: int, rng: np.random.Generator) -> _Sensors:
        """As the standstill of ``recordings`` has it, and zeros of the day; of a sensor that none has, a common one's."""
        prior, common = SensorPrior(), PressureNoise.typical()
        noise = np.zeros((worlds, 2, len(CHANNELS), count))
        for place, channel in enumerate(CHANNELS):
            zero = prior.pressure_zero if channel in PRESSURES else prior.angle_zero
            normal = rng.standard_normal((worlds, 2, count))
            if any(channel in one.channels for one in recordings):
                covariance = toeplitz(noise_of(recordings, channel, count).covariance[:count])
                power, axes = np.linalg.eigh(covariance)
                normal = (normal * np.sqrt(np.maximum(power, 0.0))) @ axes.T
            else:
                normal *= np.hypot(common.white, common.resolution / np.sqrt(12.0))
            noise[:, :, place] = normal + zero * rng.standard_normal((worlds, 2, 1))
        return cls(noise)

    def rows(self, candidate: Candidate, world: int, signals: Floats, channels: Sequence[str], paired: bool) -> Tokens:
        """Features (1, FEATURES, SAMPLES) of what would be added to the recordings, all NaN where some of ``signals`` are.

        Args:
            candidate: Manoeuvre that is recorded.
            world: Number of the drawn world.
            signals: Exact signals (days, channels, F).
            channels: Those that are logged.
            paired: Whether a pair of logs is added, or the later one alone.
        """
        shown = np.array(signals + self.noise[world], dtype=np.float64)
        blank = candidate.blank(())
        days = [replace(blank, channels={name: day[CHANNELS.index(name)] for name in channels}) for day in shown]
        rows = case_of([days[1]], [days[0]] if paired else []).rows
        return rows if np.isfinite(shown).all() else np.full_like(rows, np.nan)


def _logged(recordings: Sequence[Recording], healthy: Sequence[Recording]) -> tuple[str, ...]:
    """Channels that the networks take and all logs have."""
    return tuple(name for name in CHANNELS if all(name in one.channels for one in (*recordings, *healthy)))


def _simulated(candidates: Sequence[Candidate], worlds: Sequence[World], simulator: Simulator) -> Floats:
    """Exact signals (C, W, days, channels, F) [SI]; NaN where a twin diverged."""
    blanks = [candidate.blank(CHANNELS) for candidate in candidates]
    twins = [variants for world in worlds for variants in (world.healthy, world.later)]
    found = simulator.run([Replay(variants, blank, COARSE) for blank in blanks for variants in twins])
    signals = np.stack([np.stack([one[name][:, 0] for name in CHANNELS]) for one in found])
    return signals.astype(np.float64).reshape(len(candidates), len(worlds), 2, len(CHANNELS), -1)


def _asked(networks: Sequence[Weights], recorded: Sequence[Tokens], added: Sequence[Tokens]) -> Floats:
    """Probabilities (N, hypotheses) with N times some logs (N, j, kept, width) beside the ``recorded`` (J, kept, width),
    both by network."""
    told = [
        np.concatenate([np.broadcast_to(kept, (len(new), *kept.shape)), new], axis=1)
        for kept, new in zip(recorded, added, strict=True)
    ]
    return posteriors(networks, told)[0]
