"""What a diagnosis says: plain data, as it stands in ``diagnosis.json``."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from aoro_gym.execution.files import read_json, write_json

VERDICTS: Mapping[str, str] = {
    "no_gap": "The difference is no clearer than between healthy days.",
    "calibration": "There is a gap, and recalibrating uncertain parameters removes it; no effect is needed.",
    "cause": "One cause stands out.",
    "ambiguous": "Several causes explain the gap, and the data cannot tell them apart.",
    "unknown": "There is a gap that nothing in the catalogue explains.",
    "inconclusive": "The data cannot tell.",
}
"""Every verdict, in a sentence."""

PHASES = ("onset", "first_peak", "undershoot", "second_peak", "steady", "stop")
"""Of a manoeuvre, by the time since its command last changed; see :mod:`.places`."""

UNKNOWN = "unknown"
"""Stands for an effect outside the catalogue."""
CALIBRATION = "calibration"
"""Stands for parameters elsewhere within their ranges, and no effect."""
KEY_FIGURES = "key_figures"
"""Stands for a signal where a turn's figures are compared, in their standard deviations (:mod:`.tables`)."""


def presence(effects: Sequence[str], probabilities: Mapping[tuple[str, ...], float]) -> float:
    """Probability that ``effects`` are there, alone or beside something else, by that of every hypothesis."""
    return sum(p for those, p in probabilities.items() if set(effects) <= set(those))


@dataclass(frozen=True)
class Place:
    """Where a part of the gap lies: ``share`` of its whitened energy."""

    component: str  # likeliest to hold the cause; empty without a cause
    phase: str
    signal: str
    manoeuvre: str
    share: float


@dataclass(frozen=True)
class CredibleInterval:
    """A quantity with its 90 % interval, SI."""

    median: float
    low90: float
    high90: float
    unit: str
    quantity: str = ""


@dataclass(frozen=True)
class Cause:
    """A hypothesis: one effect or two, ``()`` for nothing, ``("unknown",)`` for something outside the catalogue,
    ``("calibration",)`` for parameters within their ranges.

    Attributes:
        magnitudes: By effect, how far its operational magnitudes lie from those of the twin without it, one or two.
        settings: By effect, the magnitudes that the twin takes (:mod:`aoro_gym.effects.catalogue`).
        components: Parts of the machine that its effects lie in.
        machine_file: Written machine with the effect, relative to the result; empty if none was written.
    """

    effects: tuple[str, ...]
    probability: float
    magnitudes: Mapping[str, tuple[CredibleInterval, ...]] = field(default_factory=dict)
    settings: Mapping[str, tuple[float, ...]] = field(default_factory=dict)
    components: tuple[str, ...] = ()
    machine_file: str = ""

    @property
    def title(self) -> str:
        return " + ".join(self.effects) if self.effects else "nothing"

    def as_dict(self) -> dict[str, Any]:
        return {
            "effects": list(self.effects),
            "probability": self.probability,
            "components": list(self.components),
            "magnitudes": {
                # the first part stands by itself, too: most effects have but one
                name: {**_plain(parts[0]), "parts": [_plain(part) for part in parts]}
                for name, parts in self.magnitudes.items()
            },
            "settings": {name: list(values) for name, values in self.settings.items()},
            "machine_file": self.machine_file,
        }


@dataclass(frozen=True)
class GapClosure:
    """How much of the gap of one signal in one manoeuvre is gone: S = 1 − (RMSE² − σ²) after / (RMSE² − σ²) before.

    Attributes:
        held_out: The manoeuvre took no part in the fit.
        refitted: Its own clock and zero were fitted nevertheless.
        before, after: RMSE, SI.
        noise: σ, SI.
    """

    manoeuvre: str
    signal: str
    S: float
    low90: float
    high90: float
    before: float
    after: float
    noise: float
    held_out: bool
    refitted: bool


@dataclass(frozen=True)
class Experiment:
    """A manoeuvre that would tell the surviving causes apart.

    Attributes:
        gain: Expected information on the cause, in bits.
        apart: Pairs of causes that it separates, by their titles.
        gain_error: Standard error of the gain, in bits.
    """

    name: str
    description: str
    gain: float
    apart: tuple[tuple[str, str], ...] = ()
    gain_error: float = 0.0


@dataclass(frozen=True)
class Curve:
    """One signal of one manoeuvre, SI over time [s], for plots; all arrays (F,)."""

    manoeuvre: str
    signal: str
    held_out: bool
    time: NDArray[np.floating[Any]]
    measured: NDArray[np.floating[Any]]
    before: NDArray[np.floating[Any]]  # the given twin
    after: NDArray[np.floating[Any]]  # with the first cause
    spread: NDArray[np.floating[Any]]  # standard deviation of noise and of the twin's own error; NaN: not compared


@dataclass(frozen=True)
class Diagnosis:
    """What parts a machine from its twin; see the fields' classes.

    Attributes:
        verdict: One of :data:`VERDICTS`.
        where: Parts of the gap, largest first.
        where_p: Probability of a gap as large as this without any cause.
        components: Probability that a cause lies in a component, largest first.
        causes: Best first; probabilities add up to one over all hypotheses, of which unlikely ones are left out.
        declared_set: Ids of the effects in the least set of hypotheses that should hold the truth; with the verdict "no_gap"
            of those that may be behind one that is not ruled out.
        fit_test_p: Probability of residuals as large as those that the first cause leaves, if it is right.
        shrinkage: By manoeuvre and signal, fitted and held out.
        controls: Median S of held-out manoeuvres for the cause, a wrong cause of the same freedom, a black box.
        key_figures: By full turn and figure: measured, before, after (field units).
        calibration: Parameters that moved most: key, unit, before, after, how many prior standard deviations.
        alike: Pairs of effects that these logs cannot tell apart.
        limitations: Sentences.
    """

    machine: str
    mode: str  # "commissioned" or "day-one"
    logs: tuple[str, ...]
    healthy: tuple[str, ...]
    signals: tuple[str, ...]
    verdict: str
    where: tuple[Place, ...] = ()
    where_p: float | None = None
    components: Mapping[str, float] = field(default_factory=dict)
    causes: tuple[Cause, ...] = ()
    declared_set: tuple[str, ...] = ()
    fit_test_p: float | None = None
    shrinkage: tuple[GapClosure, ...] = ()
    controls: Mapping[str, float | None] = field(default_factory=dict)
    key_figures: Mapping[str, Mapping[str, Mapping[str, float | None]]] = field(default_factory=dict)
    next_experiments: tuple[Experiment, ...] = ()
    calibration: tuple[Mapping[str, Any], ...] = ()
    alike: tuple[tuple[str, str], ...] = ()
    limitations: tuple[str, ...] = ()
    seconds: float = 0.0
    curves: tuple[Curve, ...] = ()

    def as_dict(self) -> dict[str, Any]:
        """As it stands in ``diagnosis.json``: everything but the curves."""
        return {
            "machine": self.machine,
            "mode": self.mode,
            "logs": list(self.logs),
            "healthy": list(self.healthy),
            "signals": list(self.signals),
            "verdict": self.verdict,
            "sentence": VERDICTS[self.verdict],
            "where": [_plain(place) for place in self.where],
            "where_p": self.where_p,
            "components": dict(self.components),
            "causes": [cause.as_dict() for cause in self.causes],
            "declared_set": list(self.declared_set),
            "fit_test_p": self.fit_test_p,
            "shrinkage": [_plain(one) for one in self.shrinkage],
            "controls": dict(self.controls),
            "key_figures": {
                turn: {name: dict(values) for name, values in figures.items()}
                for turn, figures in self.key_figures.items()
            },
            "next_experiments": [
                {**_plain(one), "apart": [list(pair) for pair in one.apart]} for one in self.next_experiments
            ],
            "calibration": [dict(one) for one in self.calibration],
            "alike": [list(pair) for pair in self.alike],
            "limitations": list(self.limitations),
            "seconds": self.seconds,
        }

    def save(self, folder: Path) -> Path:
        """Write ``diagnosis.json`` into ``folder``. Machine files of the diagnosis that it takes the place of go."""
        path = folder / "diagnosis.json"
        before = _machine_files(path)
        write_json(path, self.as_dict())
        for stale in before - {one.machine_file for one in self.causes}:
            (folder / stale).unlink(missing_ok=True)
        return path


def _machine_files(path: Path) -> set[str]:
    """Of the causes of a written diagnosis, relative to its folder; none where there is no such file."""
    with suppress(OSError, ValueError, KeyError, TypeError):
        named = {str(one["machine_file"]) for one in read_json(path)["causes"]}
        return {name for name in named if Path(name).parent == Path("machines") and Path(name).suffix == ".toml"}
    return set()


def _plain(one: Any) -> dict[str, Any]:
    return dict(vars(one))
