"""What may part recordings from the twin that should explain them, linear around a fit.

Stacked over recordings, channels and samples, the whitened residual is

    r(u, z) = r₀ − J u − Σ s_e(z_e),

with nuisances u in prior standard deviations (the machine's, and each recording's own clock and zeros) and the shift s_e
that an effect at the place z_e of its range adds to the prediction. J and the shifts are simulated around the centre.
Whoever has recordings of the same commands from the healthy machine subtracts their residuals: what the twin's laws do
otherwise than the machine's then cancels, up to its own change.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cholesky, solve_triangular
from scipy.ndimage import gaussian_filter1d
from scipy.stats import chi2

from aoro_gym.diagnosis.arrival import NEVER, arrival_of, arrivals, bounce, on_clock
from aoro_gym.diagnosis.axes import Axis, axes_of
from aoro_gym.diagnosis.noise import MERGED, Floats, ModelError, Noise, Whitener, merged, noise_of, whitener
from aoro_gym.diagnosis.nuisances import Nuisances
from aoro_gym.diagnosis.recording import TICK, Recording
from aoro_gym.diagnosis.replay import COARSE, SIGNALS, USUAL, Replay, Simulator, Steps, Variants
from aoro_gym.effects.effect import Effect
from aoro_gym.machine import Machine

STEP = 0.5
"""Finite-difference step of nuisances, in prior standard deviations."""
LARGEST_STEP = 0.02
"""The same as a share of the range: where priors are wide, slopes are those at the centre."""
STRAIGHT = 10.0
"""Whitened length of what a step of a nuisance does, up to which it counts as straight."""
FELT = 0.2
"""Whitened length of what one standard deviation of a nuisance does, below which it is left alone."""
WINDOW = 12
"""Whitened samples of a window that a signal's loudness is taken of."""
START_JITTER = 1e-3
"""Standard deviation [s] of a recording's clock against its commands."""
ZEROS: Mapping[str, float] = {
    "joint_angle": np.radians(0.03), "pressure_a": 1e5, "pressure_b": 1e5, "pump_pressure": 1e5,
    "drive_pressure_forward": 1e5, "drive_pressure_return": 1e5,
}  # fmt: skip
"""Standard deviation [SI] of a sensor's zero, anew in each recording: a quarter of a per cent of 400 bar."""
JUMP = 0.1
"""Change of a command within a tick that is an event: all sways anew."""
CLOCKED = ("joint_angle", "pressure_a", "pressure_b", "pump_pressure")
"""Signals that the joint's arrival at a stop shows in."""
KINDS: Mapping[str, str] = {
    "joint_angle": "angle", "pressure_a": "pressure", "pressure_b": "pressure", "pump_pressure": "pressure",
    "drive_pressure_forward": "pressure", "drive_pressure_return": "pressure",
}  # fmt: skip
"""Of channels, by name."""
SWAY = 15
"""Standard deviation, in samples, of the window that parts a signal's sway, of about 3 Hz, from its slow course."""
MISFITS = (0.03, 0.06, 0.12, 0.25, 0.5, 1.0, 2.0, 4.0)
"""Factors on the twin's own error that are told apart."""
WANDERS = (0.0, 0.1, 0.2, 0.3, 0.4, 0.6)
"""Standard deviations of an angle sensor's wandering zero that are told apart, in those of its noise."""
SPARSE = 2
"""Of the averaged samples, every so many tell these factors apart: neighbours say the same."""
KNOWN: Mapping[str, float] = {"angle": 0.3, "pressure": 1.0, "": 1.0}
"""Share of the twin's own error that is left where the healthy machine's residual of the same commands is subtracted, by
kind of channel: pressures of a machine that differs sway otherwise than they did (E, machines of the development family),
and of channels that are of no kind nothing better is known."""

Progress = Callable[[str, float], None]


@dataclass(frozen=True)
class Reference:
    """Mean residual (F,) SI of the healthy machine under the same commands, and what it showed, over so many recordings."""

    residual: Floats
    shown: Floats
    repeats: int
    arrival: int  # sample at which the joint came to its stop


References = Mapping[tuple[bytes, str], Reference]
"""By the commands' signature and the channel."""


class Problem:
    """Recordings, the twin that should have made them, and what may part the two.

    Args:
        recordings: To be explained.
        nuisances: Around the twin.
        effects: Catalogue by id.
        error: The twin's own.
        references: Of the healthy machine.
        noise: By channel; from the recordings' standstill by default.
        misfit: Factor on the twin's own error by channel; one by default.
        simulator: Runs the twins; on the CPU by default.
        sound: Nothing is wrong in the recordings: where they sway more than the twin, so much is as uncertain.
    """

    kinds: Mapping[str, str] = KINDS
    """Of the channels that show by how much a hypothesis fits worse than the right cause does."""

    def __init__(
        self,
        recordings: Sequence[Recording],
        nuisances: Nuisances,
        effects: Mapping[str, Effect],
        *,
        error: ModelError,
        references: References | None = None,
        noise: Mapping[str, Noise] | None = None,
        misfit: Mapping[str, float] | None = None,
        simulator: Simulator | None = None,
        sound: bool = False,
    ):
        self.recordings = tuple(recordings)
        self.nuisances = nuisances
        self.effects = dict(effects)
        self.error = error
        self.references = dict(references or {})
        self.simulator = simulator or Simulator()
        self.sound = sound
        self.signals = tuple(name for name in SIGNALS if any(name in r.channels for r in self.recordings))
        longest = max(len(r.channels["joint_angle"]) for r in recordings)
        self.misfit = dict(misfit or {})
        self.noise = dict(noise or {})
        for name in self.signals:
            if name not in self.noise:
                self.noise[name] = noise_of(recordings, name, longest)
        self.blocks = [(index, name) for index, r in enumerate(self.recordings) for name in r.channels]
        """Recording and channel of every part of a stacked residual."""
        self.arrivals = [arrival_of(r.channels["joint_angle"], r.commands[:, 0]) for r in self.recordings]
        """Sample at which each recording's joint comes to its stop."""
        self.axes: dict[str, list[Axis]] = {name: axes_of(effect) for name, effect in self.effects.items()}
        self.felt: NDArray[np.intp] = np.arange(len(nuisances.keys))
        """Nuisances that show; the others stay where they are."""
        self._chosen = False
        zeros = [(k, name) for k, name in self.blocks if name in ZEROS]
        self._own: list[tuple[int, str]] = [*((k, "") for k in range(len(self.recordings))), *zeros]
        self.centre: Floats = np.zeros(len(nuisances.keys) + len(self._own))
        """Nuisances around which all is linear: the felt ones, then the recordings' own."""
        self._held = self.centre
        self.predicted: Floats = np.empty(0)
        """Stacked prediction (D,) SI at the centre."""
        self.slopes: Floats = np.empty((0, 0))
        """Its change (D, felt) SI a standard deviation of each felt nuisance."""
        self._holding: dict[ModelError, list[Whitener]] = {}
        self.shifts: dict[tuple[str, int], Floats] = {}
        """What effects add to it (D, nodes) SI, by effect and number of its axis."""

    # ---- stacking ----

    def split(self, stacked: Floats) -> list[Floats]:
        """Parts of a stacked array by block."""
        ends = np.cumsum([len(self.recordings[index].channels[name]) for index, name in self.blocks])
        return np.split(stacked, ends[:-1])

    @cached_property
    def measured(self) -> Floats:
        """Stacked measurements (D,) SI, less what the healthy machine did otherwise than its twin."""
        parts = []
        for index, name in self.blocks:
            recording = self.recordings[index]
            values = recording.channels[name].astype(np.float64)
            known = self.references.get((recording.signature, name))
            parts.append(values if known is None else values - self._read(index, name, known))
        return np.concatenate(parts)

    def _read(self, index: int, name: str, known: Reference) -> Floats:
        """A healthy machine's residual (F,) on the clock of a recording: all that is slow in it, and what is fast as far as
        the two machines sway in step."""
        residual, healthy = self._aligned(index, name, known)
        slow = gaussian_filter1d(residual, SWAY)
        mine = self.recordings[index].channels[name].astype(np.float64)
        return slow + in_step(mine, healthy, self.noise[name].std) * (residual - slow)

    def _aligned(self, index: int, name: str, known: Reference) -> tuple[Floats, Floats]:
        """Residual and signal (F,) of a healthy machine on the clock of a recording."""
        if name not in CLOCKED:
            return known.residual, known.shown
        both = np.stack([known.residual, known.shown], axis=1)
        steering = self.recordings[index].commands[:, 0]
        return tuple(on_clock(both, np.full(2, float(known.arrival)), self.arrivals[index], steering).T)

    def _counting(self, index: int, channel: str) -> NDArray[np.bool_]:
        """Samples (F,) of a recording that are compared: all but the bounce. Where only one of the recording and the given
        twin comes to a stop, pressures count until then: a machine on its way and one at its stop have nothing in common."""
        recording, arrival = self.recordings[index], self.arrivals[index]
        counts = np.ones(recording.ticks + 1, dtype=bool)
        counts[bounce(arrival)] = False
        if channel in CLOCKED and channel != "joint_angle" and (arrival != NEVER) != self.given_stops[index]:
            moving = np.flatnonzero(recording.commands[:, 0])
            counts[arrival if arrival != NEVER else moving[-1] :] = False
        return counts

    @cached_property
    def _since(self) -> list[Floats]:
        """Time [s] of every sample (F,) of each recording since its command last changed or its joint came to a stop."""
        out = []
        for recording, arrival in zip(self.recordings, self.arrivals, strict=True):
            jumps = np.flatnonzero(np.any(np.abs(np.diff(recording.commands, axis=0)) > JUMP, axis=1)) + 1
            events = np.concatenate([[0], jumps, [arrival] if arrival != NEVER else []])
            time = np.arange(recording.ticks + 1)
            out.append(TICK * (time - np.max(np.where(events <= time[:, None], events, 0), axis=1)))
        return out

    @property
    def machine(self) -> Machine:
        """The twin at the centre."""
        return self.at(self.centre[None]).machine

    def of(self, recordings: Sequence[Recording]) -> Problem:
        """The same problem with other recordings, not learned."""
        other = Problem(
            recordings, self.nuisances, self.effects, error=self.error, references=self.references, noise=self.noise,
            misfit=self.misfit, simulator=self.simulator, sound=self.sound,
        )  # fmt: skip
        other.felt, other._chosen = self.felt, True
        return other

    def part(self, indices: Sequence[int]) -> tuple[Problem, NDArray[np.intp]]:
        """The same problem with some of its recordings only, and their rows in a stacked array of all."""
        numbers = self.split(np.arange(len(self.measured), dtype=np.float64))
        rows = dict(zip(self.blocks, numbers, strict=True))
        mine = [rows[index, name] for index in indices for name in self.recordings[index].channels]
        return self.of([self.recordings[index] for index in indices]), np.concatenate(mine).astype(np.intp)

    def spread(self, predicted: Floats) -> list[Floats]:
        """Standard deviation (F,) SI of noise and of the twin's own error by block, around a stacked prediction (D,); NaN
        where samples are not compared."""
        out = []
        for w, part in zip(self.whiteners(self.error, predicted), self.split(predicted), strict=True):
            std = np.full(len(w.counts), np.nan)
            std[w.counts] = np.linalg.norm(w.factor, axis=1)
            std = np.repeat(std, MERGED)
            out.append(np.append(std, np.full(len(part) - len(std), std[-1])))
        return out

    @cached_property
    def given(self) -> Floats:
        """Stacked prediction (D,) SI of the given twin, around which all hypotheses are held to the same error."""
        return self._given[0]

    @cached_property
    def given_stops(self) -> list[bool]:
        """In which recordings the joint of the given twin comes to a stop."""
        return self._given[1]

    @cached_property
    def _given(self) -> tuple[Floats, list[bool]]:
        found, stops = self.repeated([self.at(self._held[None])])
        return found[:, 0], [bool(one[0]) for one in stops]

    def hold_to(self, point: Floats) -> None:
        """Move the centre to nuisances (u,), and hold all hypotheses to the error of the twin there."""
        self.centre = self._held = point
        for known in ("_given", "given", "given_stops"):
            self.__dict__.pop(known, None)
        self._holding = {}
        self.predicted = self.given

    def hold_to_that_of(self, other: Problem) -> None:
        """Hold all hypotheses to the error of another problem's given twin, under the same recordings and noise."""
        self.given, self.given_stops, self._holding = other.given, other.given_stops, other._holding

    @property
    def left(self) -> Floats:
        """Stacked residual (D,) SI at the centre, less the recordings' own part."""
        return self.measured - self.predicted - self.own(self.predicted) @ self.centre[len(self.felt) :]

    # ---- predictions ----

    def at(self, points: Floats, effects: Sequence[str] = (), places: Floats | None = None) -> Variants:
        """Machines at ``points`` (N, u) of the nuisances with ``effects`` at ``places`` (N, axes)."""
        count = len(points)
        deviations = np.zeros((count, len(self.nuisances.keys)))
        deviations[:, self.felt] = points[:, : len(self.felt)]
        machine = self.nuisances.machines(deviations)
        magnitudes, column = [], 0
        for name in effects:
            assert places is not None
            values = [axis.value(places[:, column + i]) for i, axis in enumerate(self.axes[name])]
            magnitudes.append((self.effects[name], tuple(v if count > 1 else float(v[0]) for v in values)))
            column += len(values)
        return Variants.of(machine, magnitudes, count)

    def simulate(self, variants: Sequence[Variants], steps: Steps = USUAL) -> Floats:
        """Stacked predictions (D, N), SI, on the recordings' clocks (:mod:`.arrival`); what diverges is NaN."""
        return self.repeated(variants, steps)[0]

    def repeated(self, variants: Sequence[Variants], steps: Steps = USUAL) -> tuple[Floats, list[NDArray[np.bool_]]]:
        """See :meth:`simulate`; and by recording whose joint (N,) comes to a stop."""
        stacked, stops = [], []
        for signals, stopped in self.shown(variants, steps):
            stacked += signals.values()
            stops.append(stopped)
        return np.concatenate(stacked).astype(np.float64), stops

    def residuals(self, whiteners: Sequence[Whitener], variants: Sequence[Variants], steps: Steps = USUAL) -> Floats:
        """Whitened residuals (D', N) of what :meth:`simulate` gives; NaN of variants that diverge."""
        ends = np.cumsum([0, *(len(one.factor) for one in whiteners)])
        blocks = zip(whiteners, ends[:-1], ends[1:], self.split(self.measured), strict=True)
        white = np.empty((ends[-1], sum(one.count for one in variants)), order="F")  # each column is used by itself
        for signals, _ in self.shown(variants, steps):
            for values in signals.values():
                whiten, begin, end, measured = next(blocks)
                white[begin:end] = whiten(measured[:, None] - values)
        return white

    def shown(
        self, variants: Sequence[Variants], steps: Steps = USUAL
    ) -> Iterator[tuple[dict[str, NDArray[Any]], NDArray[np.bool_]]]:
        """By recording: its channels (F, N) SI as the twins show them, on its clock; whose joint (N,) comes to a stop."""
        tasks = [Replay(one, recording, steps) for recording in self.recordings for one in variants]
        found = iter(self.simulator.run(tasks, lent=True))
        for recording, arrival in zip(self.recordings, self.arrivals, strict=True):
            parts = [next(found) for _ in variants]
            signals = {name: np.concatenate([part[name] for part in parts], axis=1) for name in recording.channels}
            yield on_clock_of(recording, arrival, signals)

    def own(self, predicted: Floats) -> Floats:
        """Shifts (D, c), SI, by one standard deviation of what belongs to the recordings themselves: each one's clock
        and the zeros of its sensors."""
        parts = list(zip(self.blocks, self.split(predicted), strict=True))

        def column(k: int, channel: str) -> Floats:
            def shift(at: int, name: str, part: Floats) -> Floats:
                if at == k and not channel:
                    return START_JITTER * np.gradient(part) / TICK
                return np.full(part.shape, ZEROS[name] if (at, name) == (k, channel) else 0.0)

            return np.concatenate([shift(at, name, part) for (at, name), part in parts])

        return np.stack([column(k, channel) for k, channel in self._own], axis=1)

    @property
    def bounds(self) -> tuple[Floats, Floats]:
        """Ends (u,) of the nuisances: of the machine's, those of :attr:`.nuisances.Nuisances.ends`."""
        place, std = self.nuisances.place[self.felt], self.nuisances.std[self.felt]
        low, high = ((end[self.felt] - place) / std for end in self.nuisances.ends)
        free = np.full(len(self._own), np.inf)
        return np.concatenate([low, -free]), np.concatenate([high, free])

    @property
    def precision(self) -> Floats:
        """Of the nuisances' prior (u, u), which a recording's own have of one each."""
        out = np.eye(len(self.centre))
        d = len(self.felt)
        out[:d, :d] = np.linalg.inv(self.nuisances.correlation[np.ix_(self.felt, self.felt)])
        return out

    def neighbours(self, point: Floats, sizes: Floats | None = None) -> tuple[Floats, Floats]:
        """Nuisances (felt, u) next to a ``point`` (u,) along each of the machine's, and how far (felt,).

        Args:
            point: In prior standard deviations.
            sizes: Whitened length (felt,) of the slopes, as far as they are known: what moves the prediction by far more
                than its noise is bent on the way.
        """
        d = len(self.felt)
        place, std = self.nuisances.place[self.felt], self.nuisances.std[self.felt]
        h = np.minimum(STEP, LARGEST_STEP / std)
        if sizes is not None:
            h = np.minimum(h, STRAIGHT / np.maximum(sizes, 1e-9))
        h = np.where(place + (point[:d] + h) * std <= 1.0, h, -h)
        return point + np.eye(d, len(point)) * h[:, None], h

    # ---- whitening ----

    def held(self, error: ModelError) -> list[Whitener]:
        """:meth:`whiteners` around the prediction of the :attr:`given` twin, which all hypotheses are held to."""
        if error not in self._holding:
            self._holding[error] = self.whiteners(error, self.given)
        return self._holding[error]

    def whiteners(self, error: ModelError, predicted: Floats) -> list[Whitener]:
        """One a block, around a stacked prediction (D,). What is seen beyond the twin is that of the :attr:`given` one,
        whatever the prediction, lest a better one be held to a smaller error."""
        out = []
        parts = zip(self.blocks, self.split(predicted), self.split(self.measured - self.given), strict=True)
        for (index, name), mine, seen in parts:
            known = self.references.get((self.recordings[index].signature, name))
            noise, since, counts = self.noise[name], self._since[index], self._counting(index, name)
            own = (replace(error, sways=0.0) if self.sound else error).found(self.misfit.get(name, 1.0))
            of = {"seen": seen, "since": since, "counts": counts}
            if known is None:
                shown = self.recordings[index].channels[name].astype(np.float64) if self.sound else None
                out.append(whitener(noise, name, mine, own, healthy=shown, **of))
            else:
                _, healthy = self._aligned(index, name, known)
                own = own.scaled(KNOWN[KINDS.get(name, "")])
                out.append(whitener(noise, name, mine, own, repeats=known.repeats, healthy=healthy, **of))
        return out

    def white(self, whiteners: Sequence[Whitener], stacked: Floats) -> Floats:
        """``stacked`` (D,) or (D, N) of differences, whitened."""
        return np.concatenate([w(part) for w, part in zip(whiteners, self.split(stacked), strict=True)])

    # ---- learning ----

    def _slopes(self, more: Sequence[Variants] = ()) -> Floats:
        """Prediction and slopes at the centre; the first time chooses what is felt. Returns what ``more`` add (D, N)."""
        d = len(self.felt)
        points, h = self.neighbours(self.centre)
        self.predicted = self.simulate([self.at(self.centre[None])])[:, 0]
        found = self.simulate([self.at(np.vstack([self.centre, points])), *more], COARSE)
        shifts = np.nan_to_num(found[:, 1:] - found[:, :1])
        self.slopes, added = shifts[:, :d] / h, shifts[:, d:]
        if self._chosen:
            return added
        self._chosen = True
        white = self.white(self.held(self.error), self.slopes)
        shown = np.flatnonzero(np.linalg.norm(white, axis=0) > FELT)
        self.slopes, self.felt = self.slopes[:, shown], self.felt[shown]
        self.centre = np.concatenate([self.centre[:d][shown], self.centre[d:]])
        return added

    def uncertain(self, covariance: Floats) -> Floats:
        """Covariance (d, d), in the unit cube, of the machine, given that (u, u) of the nuisances."""
        std, felt = self.nuisances.std, self.felt
        out = np.diag(std**2)
        out[np.ix_(felt, felt)] = covariance[: len(felt), : len(felt)] * np.outer(std[felt], std[felt])
        return out

    def louder(self) -> dict[str, Noise]:
        """Its noise, as loud as :meth:`loudness` says and with zeros that wander by :meth:`wander`, which is what it has
        from now on."""
        self.noise = {name: self.noise[name].inflated(loud) for name, loud in self.loudness().items()}
        self.noise |= {name: self.noise[name].wandering(std) for name, std in self.wander().items()}
        self._holding = {}
        return self.noise

    def be_found(self, misfit: Mapping[str, float]) -> None:
        """Its error is so many times what was assumed, from now on; see :meth:`misfits`."""
        self.misfit = dict(misfit)
        self._holding = {}

    def _left_by_channel(self) -> dict[str, list[Floats]]:
        """Whitened residuals (n,) of every recording at the centre, once the nuisances were fitted."""
        found: dict[str, list[Floats]] = {}
        whiteners = self.whiteners(self.error, self.predicted)
        for (_, name), w, part in zip(self.blocks, whiteners, self.split(self.left), strict=True):
            found.setdefault(name, []).append(w(part))
        return found

    def misfits(self) -> dict[str, float]:
        """By how much the twin's own error is larger or smaller than assumed, by channel: the factor f, of :data:`MISFITS`,
        of which what is left at the centre is likeliest, normal with covariance N + f² E of noise and error, once the
        nuisances were fitted."""
        likely = self._likely(self.signals, (0.0,))
        return {name: MISFITS[int(np.argmax(of[:, 0]))] for name, of in likely.items()}

    def wander(self) -> dict[str, float]:
        """How far [SI] the zeros of angle sensors wander, by channel: what of :data:`WANDERS` is likeliest, whatever the
        factor on the twin's own error, which grows on the way while a zero wanders at rest, too."""
        angles = [name for name in self.signals if self.kinds.get(name) == "angle"]
        likely = self._likely(angles, WANDERS)
        return {name: WANDERS[int(np.argmax(of.max(axis=0)))] * self.noise[name].std for name, of in likely.items()}

    def _likely(self, names: Sequence[str], wanders: Sequence[float]) -> dict[str, Floats]:
        """Log likelihood (misfits, wanders) by channel of what is left at the centre, for each of :data:`MISFITS` and of
        ``wanders``, standard deviations of wandering zeros in those of the noise."""
        found: dict[str, Floats] = {name: np.zeros((len(MISFITS), len(wanders))) for name in names}
        builds = [self.whiteners(self.error.scaled(factor), self.predicted) for factor in (0.0, 1.0)]
        for (_, name), part, *both in zip(self.blocks, self.split(self.left), *builds, strict=True):
            if name not in found:
                continue
            counts, held = both[0].counts, self.misfit.get(name, 1.0)
            noise, whole = (w.factor[::SPARSE] @ w.factor[::SPARSE].T for w in both)
            zero = Noise(np.zeros(len(part) + MERGED)).wandering(self.noise[name].std).merged(len(counts))
            zero = zero[np.ix_(counts, counts)][::SPARSE, ::SPARSE]
            left = merged(part)[counts][::SPARSE]
            for k, j in np.ndindex(found[name].shape):
                covariance = noise + (MISFITS[k] / held) ** 2 * (whole - noise) + wanders[j] ** 2 * zero
                factors = cholesky(covariance, lower=True)
                white = solve_triangular(factors, left, lower=True)
                found[name][k, j] -= 0.5 * float(white @ white) + float(np.sum(np.log(np.diag(factors))))
        return found

    def loudness(self) -> dict[str, float]:
        """How much more power the residual at the centre has than the noise of the standstill explains, by channel, once
        the nuisances were fitted: a quantiser is quieter at rest than on the way. Of most windows of a quarter of a second,
        as where the twin errs is no noise."""

        def powers(white: Floats) -> Floats:
            count = len(white) // WINDOW
            return np.mean(white[: count * WINDOW].reshape(count, WINDOW) ** 2, axis=1)

        typical = float(chi2.median(WINDOW)) / WINDOW
        return {
            name: max(1.0, float(np.median(np.concatenate([powers(white) for white in parts]))) / typical)
            for name, parts in self._left_by_channel().items()
        }

    def learn(self, *, effects: bool = True) -> None:
        """Simulate around the centre what every nuisance and, if so asked, every effect does."""
        nodes = self.at_nodes(self.axes, self.centre) if effects else {}
        shifts = self._slopes(list(nodes.values()))
        ends = np.cumsum([0, *(one.count for one in nodes.values())])
        self.shifts = {key: shifts[:, a:b] for key, a, b in zip(nodes, ends[:-1], ends[1:], strict=True)}

    def at_nodes(
        self,
        axes: Mapping[str, Sequence[Axis]],
        point: Floats,
        beside: Sequence[str] = (),
        places: Sequence[float] = (),
    ) -> dict[tuple[str, int], Variants]:
        """Machines at a ``point`` (u,) of the nuisances with one effect at each of the nodes of one of its ``axes``, by
        effect and number of its axis, and the effects ``beside`` it at their ``places``."""
        found = {}
        for name, mine in axes.items():
            for axis in mine:
                nodes = np.tile([*places, *(a.none for a in mine)], (len(axis.nodes), 1))
                nodes[:, len(places) + axis.index] = axis.nodes
                found[name, axis.index] = self.at(np.tile(point, (len(nodes), 1)), (*beside, name), nodes)
        return found


def on_clock_of(
    recording: Recording, arrival: int, signals: Mapping[str, NDArray[Any]]
) -> tuple[dict[str, NDArray[Any]], NDArray[np.bool_]]:
    """Signals (F, N) of machines under the commands of a ``recording`` whose joint comes to its stop at the sample
    ``arrival``, read on its clock (:mod:`.arrival`); and whose joint (N,) comes to a stop."""
    steering = recording.commands[:, 0]
    own = arrivals(signals["joint_angle"], steering)
    clocked = {
        name: on_clock(values, own, arrival, steering, goes_on=name == "joint_angle")
        for name, values in signals.items()
        if name in CLOCKED
    }
    return {**signals, **clocked}, own != NEVER


def sway(signal: Floats) -> Floats:
    """What of a ``signal`` (F,) is not its slow course."""
    return signal - gaussian_filter1d(signal, SWAY)


def in_step(one: Floats, other: Floats, noise: float) -> Floats:
    """How far (F,), from 0 to 1, two signals (F,) sway alike around their slow course: their local covariance, of the larger
    variance. What is within the ``noise`` counts as alike."""
    a, b = sway(one), sway(other)
    both, first, second = (gaussian_filter1d(x, SWAY) for x in (a * b, a * a, b * b))
    return np.clip((both + noise**2) / np.maximum(np.maximum(first, second), noise**2), 0.0, 1.0)


def references_of(problem: Problem) -> dict[tuple[bytes, str], Reference]:
    """What healthy recordings show beyond the twin that was fitted to them."""
    left: dict[tuple[bytes, str], list[tuple[Floats, Floats, int]]] = {}
    for (index, name), residual in zip(problem.blocks, problem.split(problem.left), strict=True):
        recording = problem.recordings[index]
        shown = recording.channels[name].astype(np.float64)
        left.setdefault((recording.signature, name), []).append((residual, shown, problem.arrivals[index]))
    # repeats arrive together but for a sample or two, which the first stands for
    found = {}
    for key, parts in left.items():
        residual, shown = np.mean([part[:2] for part in parts], axis=0)
        found[key] = Reference(residual, shown, len(parts), parts[0][2])
    return found
