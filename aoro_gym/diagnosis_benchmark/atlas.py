"""Which effects look alike, from which sensors and manoeuvres: computed beforehand, from twins of the ensemble alone.

A machine with effect i shows the shift s_i beyond its healthy twin. What the best magnitude z of effect j and the best
nuisances u of a commissioned machine leave of it,

    d²(i→j) = min |s_i − S_j φ(z) − J u|² + uᵀ P u,

whitened as a diagnosis of that very machine whitens it (:mod:`aoro_gym.diagnosis.linear`), is how far j is from what i
does; without j it is how far i stands out, d²(i→∅). Half of it is the mean of the log evidence against j. A diagnosis
weighs that tempered (:func:`~aoro_gym.diagnosis.attribution.weigh`), so that i is :data:`ODDS` times as likely as j
from

    d²(i→j) = 2 ln ODDS · (temperature + ½ doubt d²(i→∅))

on, with a temperature and a doubt that stay as they are (:data:`TRUST`), for the classes score. Where it is less, j stands
for i; two effects are *alike* where each stands for the other, whichever way it deviates.

Each effect is asked at the median of those of its magnitudes that stand out, spread as cases of the blind check have them:
evenly by the logarithm, from the weakest to the end of its range. The weakest is the least that stands out, and
:data:`~aoro_gym.diagnosis_benchmark.cases.WEAKEST` of the end at least.

Alike is not transitive: classes are those of complete linkage, in which every two effects are alike.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from copy import copy
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Any

import numpy as np
from scipy.cluster.hierarchy import fcluster, linkage
from scipy.spatial.distance import squareform

from aoro_gym.diagnosis.attribution import Trust
from aoro_gym.diagnosis.axes import Axis, axes_of
from aoro_gym.diagnosis.diagnose import ERROR
from aoro_gym.diagnosis.linear import Linear, Tangent
from aoro_gym.diagnosis.noise import Floats, Noise, noise_of
from aoro_gym.diagnosis.nuisances import Nuisances
from aoro_gym.diagnosis.problem import Problem, Progress, Reference
from aoro_gym.diagnosis.recording import COMMANDS, SENSORS, TICK, Recording
from aoro_gym.diagnosis.replay import Replay, Simulator, Variants
from aoro_gym.diagnosis_benchmark.cases import FAMILIES, MACHINES, REST, WEAKEST, Excitation
from aoro_gym.effects.catalogue import EFFECTS
from aoro_gym.effects.effect import Effect
from aoro_gym.machine import Machine
from aoro_gym.sensors.joint_angle import JointAngleSensor
from aoro_gym.sensors.pressure import PressureSensor

MEMBERS = FAMILIES["development"].members[:3]
"""Of the calibrated ensemble: none that machines of a scored suite descend from."""
SEED = 0
"""Of what the machines are told to do; its draw has a drive."""
TRUST = Trust(temperature=2.0, doubt=0.003)
"""Of the diagnosis for which the classes were frozen."""
ODDS = 100.0
"""How much likelier the true effect must be than another: with thirty of them it is then three quarters."""
SHARES = 41
"""Magnitudes between which the weakest that stands out is sought."""
STANDSTILLS = 64
"""Standstills that the sensors' noise is taken from."""
ALL = "all"
"""Name of all manoeuvres together that every case has."""
WEAK, STRONG = "all, weak", "all, strong"
"""The same, of the weakest deviation that stands out, and of that at the end of its range."""
TOGETHER = (ALL, WEAK, STRONG)
SOMETIMES = ("drive",)
"""Manoeuvres that few cases have."""


# ---- one machine ----


@dataclass(frozen=True)
class Side:
    """Deviations of one effect along one of its magnitudes, from ``none`` towards one end of the range."""

    axis: Axis
    end: float  # place, 0 or 1

    @property
    def effect(self) -> str:
        return self.axis.effect.id

    @property
    def name(self) -> str:
        """``effect``, with the magnitude's name where there are two, and with a sign where either can be."""
        words = [self.effect]
        if len(self.axis.effect.magnitudes) > 1:
            words.append(self.axis.magnitude.name)
        if 1e-9 < self.axis.none < 1.0 - 1e-9:
            words.append("+" if self.end else "-")
        return " ".join(words)

    def place(self, share: Floats | float) -> Floats:
        """Place of a ``share`` of the way from ``none`` to the end."""
        return self.axis.none + np.asarray(share) * (self.end - self.axis.none)

    def weights(self, share: Floats | float) -> Floats:
        """Of the axis's nodes (…, nodes) in what it does at a ``share``."""
        return self.axis.spline(self.place(share))


def sides_of(axes: Mapping[str, Sequence[Axis]]) -> list[Side]:
    """All that the effects of a problem have."""
    ends = [Side(axis, end) for each in axes.values() for axis in each for end in (0.0, 1.0)]
    return [side for side in ends if side.axis.reach(side.end) > 1e-9]


def commissioned(
    machine: Machine,
    excitations: Sequence[Excitation],
    effects: Mapping[str, Effect] = EFFECTS,
    *,
    simulator: Simulator | None = None,
    progress: Progress = lambda sentence, share: None,
) -> Problem:
    """The learned problem of a machine that was commissioned with the twin ``machine`` and is healthy: its logs, full and
    without noise, are the twin's own, and so were those that it was commissioned with."""
    simulator = simulator or Simulator()
    logs = [_blank(machine, excitation) for excitation in excitations]
    found = simulator.run([Replay(Variants(machine), log) for log in logs])
    logs = [
        replace(log, channels={name: values[:, 0].astype(np.float64) for name, values in signals.items()})
        for log, signals in zip(logs, found, strict=True)
    ]
    noise = noise_of_sensors(max(log.ticks + 1 for log in logs))
    progress("what every parameter and every effect does", 0.0)
    around = Nuisances(machine, "commissioning")
    problem = Problem(logs, around, effects, error=ERROR, noise=noise, simulator=simulator)
    problem.learn()
    day = Nuisances(machine, "day", problem.uncertain(Linear(problem, problem.error).tangent.covariance))
    problem.slopes *= (day.std / around.std)[problem.felt]
    problem.nuisances = day
    problem.references = {
        (logs[index].signature, name): Reference(
            np.zeros(logs[index].ticks + 1), logs[index].channels[name], 1, problem.arrivals[index]
        )
        for index, name in problem.blocks
    }
    problem.measured = problem.given  # on the clock that predictions are read on
    return problem


def _blank(machine: Machine, excitation: Excitation) -> Recording:
    """A log of the commands of an ``excitation``, its channels empty."""
    commands = np.zeros((len(excitation.steering), len(COMMANDS)))
    commands[:, 0] = excitation.steering
    if excitation.drive is not None:
        commands[:, 1] = excitation.drive
    empty = {name: np.zeros(len(commands) + 1) for name in SENSORS["full"]}
    start = excitation.start * float(np.asarray(machine.joint.range))
    return Recording(excitation.name, commands, empty, round(REST / TICK), start)


def noise_of_sensors(lags: int) -> dict[str, Noise]:
    """Of the machine's sensors as :mod:`aoro_gym.sensors` has them, by channel, from :data:`STANDSTILLS` rests."""
    rng = np.random.default_rng(SEED)
    time = TICK * np.arange(round(REST / TICK))
    at_rest = np.ones((len(time), 1))
    angle = JointAngleSensor().record(at_rest * rng.uniform(-0.5, 0.5, STANDSTILLS), time, rng)[1]
    pressure = PressureSensor().record(at_rest * rng.uniform(20e5, 120e5, STANDSTILLS), time, rng)[1]
    standstills = [
        Recording(
            str(number), np.zeros((len(time) - 1, len(COMMANDS))),
            {name: (angle if name == "joint_angle" else pressure)[:, number] for name in SENSORS["full"]},
            len(time), float(angle[0, number]),
        )
        for number in range(STANDSTILLS)
    ]  # fmt: skip
    return {name: noise_of(standstills, name, lags) for name in SENSORS["full"]}


def narrowed(problem: Problem, channels: Sequence[str]) -> Problem:
    """A learned ``problem`` of which only some ``channels`` were logged."""
    logs = [
        replace(log, channels={name: values for name, values in log.channels.items() if name in channels})
        for log in problem.recordings
    ]
    parts = zip(problem.blocks, problem.split(problem.predicted), strict=True)
    rows = np.concatenate([np.full(len(part), name in channels) for (_, name), part in parts])
    other = problem.of(logs)
    other.measured = other.given = problem.given[rows]
    other.given_stops = problem.given_stops
    other.predicted, other.slopes = problem.predicted[rows], problem.slopes[rows]
    other.shifts = {key: shifts[rows] for key, shifts in problem.shifts.items()}
    other.centre = np.zeros(len(problem.felt) + other.own(other.predicted).shape[1])
    return other


def part_of(linear: Linear, logs: Sequence[int]) -> Linear:
    """A linear model of some of its ``logs`` (their numbers) only."""
    ends = np.cumsum([len(w.factor) for w in linear.whiteners])
    pieces = zip(linear.problem.blocks, np.split(np.arange(ends[-1]), ends[:-1]), strict=True)
    rows = np.concatenate([piece for (index, _), piece in pieces if index in logs])
    part, tangent = copy(linear), linear.tangent
    part.residual = linear.residual[rows]
    part.tangent = Tangent(tangent.jacobian[rows], tangent.precision, tangent.bounds)
    part.shifts = {key: shifts[rows] for key, shifts in linear.shifts.items()}
    return part


def weakest(healthy: Linear, side: Side) -> float:
    """Share of the way to a side's end from which it stands out, :data:`WEAKEST` at least; infinite if nowhere.

    The twin's own error, which grows with what is seen, is still small beside the noise there.
    """
    nodes = healthy.shifts[side.effect, side.axis.index]
    gram = healthy.tangent.projected(nodes, nodes)
    shares = np.geomspace(WEAKEST, 1.0, SHARES)
    weights = side.weights(shares)
    squares = np.einsum("si,ij,sj->s", weights, gram, weights)
    out = np.flatnonzero(squares > needed(squares))
    return float(shares[out[0]]) if out.size else np.inf


def needed(outstanding: Floats | float) -> Floats:
    """d² from which a diagnosis tells effects apart, where the true one stands out by d² = ``outstanding``."""
    return 2.0 * np.log(ODDS) * (TRUST.temperature + 0.5 * TRUST.doubt * np.asarray(outstanding))


def deviating(problem: Problem, side: Side, share: float) -> Linear:
    """The linear model of a machine that deviates by a ``share`` of a side, for one that is healthy."""
    other = copy(problem)
    other.measured = problem.measured + problem.shifts[side.effect, side.axis.index] @ side.weights(share)
    return Linear(other, other.error)


def distances(linear: Linear) -> Floats:
    """d² (1 + effects,) that nothing, then every effect, leaves of the residual."""
    found = linear.screen(pairs=False)
    costs = np.array([found[()].cost, *(found[(name,)].cost for name in linear.problem.axes)])
    return np.maximum(costs, 0.0)  # but for rounding they are


Look = tuple[Floats, dict[str, Floats]]
"""Shares (s,) at which the sides of effects were asked, infinite where they never stand out, and d² (s, 1 + effects), NaN
there, by manoeuvre and for :data:`TOGETHER`."""


def looked_at(problem: Problem, progress: Progress) -> Look:
    """What the effects of a healthy machine's ``problem`` look like."""
    sides = sides_of(problem.axes)
    names = [log.name for log in problem.recordings]
    always = [k for k, name in enumerate(names) if name not in SOMETIMES]
    healthy = part_of(Linear(problem, problem.error), always)
    least = np.array([weakest(healthy, side) for side in sides])
    shares = np.sqrt(least)  # half-way to 1 by their logarithms
    found = {name: np.full((len(sides), 1 + len(problem.axes)), np.nan) for name in (*TOGETHER, *names)}
    for k, side in enumerate(sides):
        progress(f"what looks like {side.name}", k / len(sides))
        if not np.isfinite(least[k]):
            continue
        weak = copy(healthy)
        weak.residual = healthy.shifts[side.effect, side.axis.index] @ side.weights(least[k])
        median, strong = deviating(problem, side, shares[k]), deviating(problem, side, 1.0)
        found[WEAK][k] = distances(weak)
        found[STRONG][k] = distances(part_of(strong, always))
        found[ALL][k] = distances(part_of(median, always))
        for number, name in enumerate(names):
            found[name][k] = distances(part_of(median, [number]))
    return shares, found


# ---- the atlas ----


@dataclass(frozen=True)
class View:
    """What logs of some sensors show.

    Attributes:
        sides: Names (s,) of the deviations that were asked.
        of: Their effects (s,).
        shares: Of the way to the end of the range (s,), at which they were asked; NaN where they never stand out.
        values: Magnitudes there (s,), SI.
        distances: d² (s, 1 + effects) by manoeuvre and for :data:`TOGETHER`: of nothing first, then of every effect.
    """

    sides: tuple[str, ...]
    of: tuple[str, ...]
    shares: Floats
    values: Floats
    distances: Mapping[str, Floats]


@dataclass(frozen=True)
class Atlas:
    """How far apart effects look.

    Attributes:
        members: Of the ensemble; all figures are medians over them.
        effects: Their ids.
        views: By sensors, ``angle`` and ``full``.
    """

    members: tuple[str, ...]
    effects: tuple[str, ...]
    views: Mapping[str, View]

    def seen(self, sensors: str) -> tuple[str, ...]:
        """Effects that stand out at all, on one side of theirs at least."""
        view = self.views[sensors]
        found = {name for name, share in zip(view.of, view.shares, strict=True) if np.isfinite(share)}
        return tuple(name for name in self.effects if name in found)

    def towards(self, sensors: str, manoeuvre: str = ALL) -> Floats:
        """How far each effect (rows) is from being explained by each other (E, E), 1.0 where it can be told; that of the
        deviation which is told best. NaN rows do not stand out, whatever is recorded."""
        view = self.views[sensors]
        d2 = view.distances[manoeuvre]
        ratios = d2[:, 1:] / needed(d2[:, :1])
        out = np.full((len(self.effects),) * 2, np.nan)
        for row, name in zip(ratios, view.of, strict=True):
            index = self.effects.index(name)
            out[index] = np.fmax(out[index], row)
        return out

    def apart(self, sensors: str, manoeuvre: str = ALL) -> Floats:
        """How far apart effects look (E, E), alike below 1.0; NaN where one of them does not stand out."""
        one_way = self.towards(sensors, manoeuvre)
        return np.maximum(one_way, one_way.T)

    def classes(self, sensors: str) -> list[list[str]]:
        """Effects that no log can tell apart, every two of them; see the module."""
        names = self.seen(sensors)
        kept = [self.effects.index(name) for name in names]
        return grouped(names, self.apart(sensors)[np.ix_(kept, kept)])

    def bridges(self, sensors: str) -> list[tuple[str, str]]:
        """Pairs that look alike, but are of different classes, as something in one of these is apart from the other."""
        own = {name: group for group in self.classes(sensors) for name in group}
        apart = self.apart(sensors)
        return [
            (self.effects[i], self.effects[j])
            for i, j in combinations(range(len(self.effects)), 2)
            if apart[i, j] < 1.0 and self.effects[j] not in own.get(self.effects[i], ())
        ]

    def best(self, sensors: str, a: str, b: str) -> tuple[str, float]:
        """The manoeuvre that tells two effects apart best by itself, and how far."""
        i, j = self.effects.index(a), self.effects.index(b)
        found = {
            name: float(self.apart(sensors, name)[i, j])
            for name in self.views[sensors].distances
            if name not in TOGETHER
        }
        return max(found.items(), key=lambda item: item[1])

    def as_dict(self) -> dict[str, Any]:
        """Content of ``atlas.json``; figures rounded to three digits."""
        return {
            **made(self),
            "effects": list(self.effects),
            "sensors": {
                name: {
                    "sides": [
                        {"side": side, "effect": of, "share": _plain(share), "magnitude": _plain(value)}
                        for side, of, share, value in zip(view.sides, view.of, view.shares, view.values, strict=True)
                    ],
                    "d2": {
                        manoeuvre: [[_plain(value) for value in row] for row in d2]
                        for manoeuvre, d2 in view.distances.items()
                    },
                }
                for name, view in self.views.items()
            },
        }

    @classmethod
    def from_dict(cls, content: Mapping[str, Any]) -> Atlas:
        """Of what :meth:`as_dict` gave."""
        views = {
            name: View(
                tuple(side["side"] for side in view["sides"]),
                tuple(side["effect"] for side in view["sides"]),
                np.array([side["share"] for side in view["sides"]], dtype=np.float64),
                np.array([side["magnitude"] for side in view["sides"]], dtype=np.float64),
                {manoeuvre: np.array(d2, dtype=np.float64) for manoeuvre, d2 in view["d2"].items()},
            )
            for name, view in content["sensors"].items()
        }
        return cls(tuple(content["members"]), tuple(content["effects"]), views)


def survey(
    members: Sequence[str] = MEMBERS,
    excitations: Sequence[Excitation] | None = None,
    effects: Mapping[str, Effect] = EFFECTS,
    *,
    simulator: Simulator | None = None,
    progress: Progress = lambda sentence, share: None,
) -> Atlas:
    """The atlas of ``effects`` for machines that do ``excitations``, by default those of a case under development."""
    asked = FAMILIES["development"].excitations(np.random.default_rng(SEED)) if excitations is None else excitations
    found = []
    for k, member in enumerate(members):

        def tell(sentence: str, share: float, k: int = k) -> None:
            progress(f"machine {k + 1} of {len(members)}: {sentence}", (k + share) / len(members))

        machine = Machine.load(MACHINES / "ensemble" / f"{member}.toml")
        problem = commissioned(
            machine, asked, effects, simulator=simulator, progress=lambda s, x, t=tell: t(s, 0.5 * x)
        )
        found.append(looks(problem, lambda s, x, t=tell: t(s, 0.5 + 0.5 * x)))
    return assembled(members, effects, found)


def looks(problem: Problem, progress: Progress = lambda sentence, share: None) -> dict[str, Look]:
    """What the effects of a healthy machine's ``problem`` look like, by sensors."""
    count = len(SENSORS)
    return {
        name: looked_at(narrowed(problem, channels), lambda s, x, k=k: progress(s, (k + x) / count))
        for k, (name, channels) in enumerate(SENSORS.items())
    }


def assembled(members: Sequence[str], effects: Mapping[str, Effect], found: Sequence[Mapping[str, Look]]) -> Atlas:
    """Of what each of the ``members`` shows."""
    sides = sides_of({name: axes_of(effect) for name, effect in effects.items()})
    views = {name: _median(sides, [each[name] for each in found]) for name in SENSORS}
    return Atlas(tuple(members), tuple(effects), views)


def _median(sides: Sequence[Side], found: Sequence[Look]) -> View:
    """Of what members show; a side that does not stand out in most of them, does not."""
    shares = np.median([one for one, _ in found], axis=0)
    seen = np.isfinite(shares)
    distances = {}
    for name in found[0][1]:
        d2 = np.full_like(found[0][1][name], np.nan)
        d2[seen] = np.nanmedian([each[name][seen] for _, each in found], axis=0)
        distances[name] = d2
    shares[~seen] = np.nan
    values = np.array([float(side.axis.value(side.place(share))) for side, share in zip(sides, shares, strict=True)])
    return View(tuple(side.name for side in sides), tuple(side.effect for side in sides), shares, values, distances)


def grouped(names: Sequence[str], apart: Floats) -> list[list[str]]:
    """Classes of two or more of the ``names``, by complete linkage of how far ``apart`` (n, n) they are, below 1.0."""
    if len(names) < 2:
        return []
    far = np.array(apart)
    np.fill_diagonal(far, 0.0)
    labels = fcluster(linkage(squareform(far), "complete"), np.nextafter(1.0, 0.0), "distance")
    groups = [[name for name, label in zip(names, labels, strict=True) if label == one] for one in np.unique(labels)]
    return sorted((group for group in groups if len(group) > 1), key=lambda group: names.index(group[0]))


def classes_of(atlas: Atlas) -> dict[str, Any]:
    """Content of ``classes.json``: classes by sensors, and how they were made."""
    return {**made(atlas), **{name: atlas.classes(name) for name in atlas.views}}


def made(atlas: Atlas) -> dict[str, Any]:
    """How an atlas was made."""
    manoeuvres = next(iter(atlas.views.values())).distances
    return {
        "command": "aoro-gym blind atlas",
        "members": list(atlas.members),
        "manoeuvres": [name for name in manoeuvres if name not in (*TOGETHER, *SOMETIMES)],
        "seed": SEED,
        "weakest": WEAKEST,
        "odds": ODDS,
        "temperature": TRUST.temperature,
        "doubt": TRUST.doubt,
        "magnitude": "median, by its logarithm, from the weakest that stands out (weakest of the range's end) to that end",
        "alike": (
            "d² < 2 ln(odds) (temperature + doubt d²(nothing) / 2), of either by the other, whichever way it deviates; "
            "medians over members; classes by complete linkage"
        ),
        "error_of_the_twin": vars(ERROR),
    }


def _plain(value: float) -> float | None:
    """With three digits; None for what is not finite."""
    return float(f"{value:.3g}") if np.isfinite(value) else None
