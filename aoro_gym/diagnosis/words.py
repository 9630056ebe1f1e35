"""A diagnosis in words and in numbers that people read: what its page and its printed summary have in common.

Numbers stand in field units (:func:`readable_unit`) with the digits that they deserve; intervals hold 90 %.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from aoro_gym.diagnosis.result import (
    CALIBRATION,
    KEY_FIGURES,
    UNKNOWN,
    VERDICTS,
    Cause,
    CredibleInterval,
    Diagnosis,
    GapClosure,
    Place,
    presence,
)
from aoro_gym.effects.catalogue import EFFECTS
from aoro_gym.effects.effect import Effect
from aoro_gym.simulation import log
from aoro_gym.units import BAR, DEGREE, LITRE_PER_MINUTE

WORTH_NAMING = 0.05
"""Probability from which a cause is named among those that cannot be told apart."""
SPACE = "\N{NO-BREAK SPACE}"
"""Between a number and its unit."""
MOST_NAMED = 3
"""Of them in a headline."""
FARTHEST = 10.0
"""Share of a gap beyond which it is not said how far it lies."""
LEAST_FIT = 0.05
"""Probability of the residuals below which something is said to be left."""

_UNITS: Mapping[str, Sequence[tuple[float, str, float]]] = {
    # SI unit: least size [SI], field unit from there on, its SI value; smallest first
    "m^3/s": ((0.0, "L/min", LITRE_PER_MINUTE),),
    "Pa": ((0.0, "bar", BAR), (1000.0 * BAR, "GPa", 1e9)),
    "m^3/Pa": ((0.0, "cm³/bar", 1e-6 / BAR),),
    "s": ((0.0, "ms", 1e-3), (1.0, "s", 1.0)),
    "rad": ((0.0, "°", DEGREE),),
    "rad/(N*m)": ((0.0, "°/(kN m)", DEGREE / 1e3),),
    "N": ((0.0, "N", 1.0), (1e3, "kN", 1e3)),
    "N*m": ((0.0, "N m", 1.0), (1e3, "kN m", 1e3)),
    "N/m": ((0.0, "kN/m", 1e3),),
    "1": ((0.0, "%", 0.01),),
}
WITHOUT_CAUSE = ("no_gap", "calibration")
"""Verdicts after which nothing is left to be placed."""

_CONTROLS = {
    "cause": "the best explanation",
    "wrong_cause": "a wrong cause of the same freedom",
    "black_box": "a black box",
}
_SIGNALS = {"pressure_a": "port A pressure", "pressure_b": "port B pressure"}


# --- numbers and names ---


def readable_unit(unit: str, largest: float) -> tuple[str, float]:
    """The unit that people use for quantities of an SI ``unit`` up to ``largest``, and its SI value.

    Fractions become per cent; a unit that is not known stays as it is.
    """
    fitting = [(name, size) for start, name, size in _UNITS.get(unit, ()) if abs(largest) >= start]
    return fitting[-1] if fitting else (unit, 1.0)


def shown(interval: CredibleInterval) -> tuple[str, str]:
    """Median with its unit, and the 90 % interval without, in field units, signed: how far something lies from the twin.

    Both have the decimals that give half the interval's width two digits.
    """
    values = (interval.median, interval.low90, interval.high90)
    unit, size = readable_unit(interval.unit, max(abs(value) for value in values))
    half = 0.5 * (interval.high90 - interval.low90) / size
    decimals = _decimals(half, 2) if half > 0.0 else _decimals(interval.median / size, 3)
    median, low, high = (signed(value / size, decimals) for value in values)
    return with_unit(median, unit), f"{low} to {high}"


def with_unit(text: str, unit: str) -> str:
    """A number with its unit; degrees stand next to it."""
    return f"{text}{unit}" if unit.startswith("°") else f"{text}{SPACE}{unit}"


def probability(p: float) -> str:
    """In per cent; never rounded to certainty."""
    if p < 0.001:
        return f"<{SPACE}0.1{SPACE}%"
    if p > 0.999:
        return f">{SPACE}99.9{SPACE}%"
    return f"{100.0 * p:.{0 if 0.01 <= p <= 0.99 else 1}f}{SPACE}%"


def gap_closure(S: float) -> str:
    """How much of a gap is gone, in per cent; negative where it grew."""
    return f"{per_cent(S, 1 if 0.99 < S < 1.0 else 0)}{SPACE}%"


def per_cent(share: float, decimals: int = 0) -> str:
    """A share without its sign of per cent; how far it lies beyond ten times the whole says nothing."""
    if abs(share) > FARTHEST:
        return f"{'<' if share < 0.0 else '>'}{SPACE}{number(math.copysign(100.0 * FARTHEST, share), 0)}"
    return number(100.0 * share, decimals)


def title(effects: Sequence[str]) -> str:
    """A hypothesis in words."""
    known = {(): "no cause", (UNKNOWN,): "something outside the catalogue", (CALIBRATION,): "calibration alone"}
    return known.get(tuple(effects)) or " and ".join(name.replace("_", " ") for name in effects)


def readable(name: str) -> str:
    """A signal, phase, component or manoeuvre in words."""
    return _SIGNALS.get(name) or name.replace("_", " ")


def capital(text: str) -> str:
    """``text`` as a sentence or a cell begins."""
    return text[:1].upper() + text[1:]


def _decimals(value: float, digits: int) -> int:
    """Decimals that show ``digits`` digits of ``value``."""
    return 0 if value == 0.0 else min(max(digits - 1 - math.floor(math.log10(abs(value))), 0), 9)


def number(value: float, decimals: int) -> str:
    """``value`` with a real minus sign, and none before zero."""
    text = f"{value:.{decimals}f}"
    return text.replace("-", "−") if float(text) else text.removeprefix("-")


def signed(value: float, decimals: int) -> str:
    """The same with a plus, too."""
    text = number(value, decimals)
    return text if text.startswith("−") or not float(text) else f"+{text}"


def three_digits(value: float) -> str:
    """``value`` to three digits."""
    return number(value, _decimals(value, 3))


def p_value(value: float) -> str:
    """A tail probability, which no line parts."""
    text = "p < 0.001" if value < 0.001 else f"p = {value:.{3 if value < 0.1 else 2}f}"
    return text.replace(" ", SPACE)


def count(how_many: int, what: str) -> str:
    """``3 logs``, ``1 log``."""
    return f"{how_many} {what}{'' if how_many == 1 else 's'}"


def control(name: str) -> str:
    """What a figure of ``Diagnosis.controls`` belongs to."""
    return _CONTROLS.get(name, readable(name))


def listed(names: Sequence[str], last: str = "and") -> str:
    """At least one name: ``a, b and c``."""
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} {last} {names[-1]}"


def signal_unit(signal: str) -> tuple[str, float]:
    """Field unit of a signal and its SI value."""
    if signal == KEY_FIGURES:
        return "σ", 1.0
    unit, size = log.field_unit(signal)
    return {"deg": "°"}.get(unit, unit), size


def is_named(cause: Cause) -> bool:
    """Whether it has effects of the catalogue."""
    return cause.effects not in ((), (UNKNOWN,), (CALIBRATION,))


def suspected(diagnosis: Diagnosis) -> list[Cause]:
    """Hypotheses that the verdict is about: one, or those that cannot be told apart; none of other verdicts."""
    if diagnosis.verdict == "cause":
        return [one for one in diagnosis.causes if is_named(one)][:1]
    if diagnosis.verdict == "ambiguous":
        return [one for one in diagnosis.causes if one.probability >= WORTH_NAMING]
    return []


def machine_file(diagnosis: Diagnosis) -> str:
    """Of the machine to go on with; empty if that is the one given."""
    best = diagnosis.causes[:1] if diagnosis.verdict == "calibration" else suspected(diagnosis)
    return next((one.machine_file for one in best if one.machine_file), "")


def twin_with(causes: Sequence[Cause]) -> str:
    """The twin with the first of ``causes``, in words."""
    if causes and is_named(causes[0]):
        return f"twin with {title(causes[0].effects)}"
    return "recalibrated twin" if causes and causes[0].effects == (CALIBRATION,) else "refitted twin"


def magnitudes(cause: Cause) -> list[tuple[str, str, str]]:
    """Quantity, median and 90 % interval of every part of every effect."""
    return [
        (capital(part.quantity or title([name])), *shown(part))
        for name, parts in cause.magnitudes.items()
        for part in parts
    ]


def total_shares(
    places: Iterable[Place], key: Callable[[Place], tuple[str, str]] = lambda place: (place.signal, place.phase)
) -> dict[tuple[str, str], float]:
    """Shares by a ``key``: by default over all manoeuvres, by signal and phase."""
    sums: dict[tuple[str, str], float] = {}
    for place in places:
        sums[key(place)] = sums.get(key(place), 0.0) + place.share
    return sums


# --- sentences ---


@dataclass(frozen=True)
class Conclusions:
    """What a diagnosis says, a sentence or two each."""

    headline: str
    why: str
    where: str
    magnitude: str
    confidence: str
    closure: str
    next: str

    @property
    def answers(self) -> dict[str, str]:
        """By question, in the order in which one asks."""
        return {
            "Where": self.where,
            "Why": self.why,
            "How much": self.magnitude,
            "How sure": self.confidence,
            "How far it shrinks": self.closure,
            "What next": self.next,
        }


def conclusions(diagnosis: Diagnosis, *, effects: Mapping[str, Effect] = EFFECTS) -> Conclusions:
    """The verdict in words.

    Args:
        diagnosis: Of any verdict; parts may be empty.
        effects: Catalogue that its causes are from.
    """
    return Conclusions(
        headline=_headline(diagnosis),
        why=_why(diagnosis, effects),
        where=_where(diagnosis),
        magnitude=_magnitude(diagnosis),
        confidence=_confidence(diagnosis),
        closure=_closure(diagnosis),
        next=_next(diagnosis),
    )


def _headline(diagnosis: Diagnosis) -> str:
    blamed = [title(one.effects) for one in suspected(diagnosis)]
    if blamed:
        more = ["others"] if len(blamed) > MOST_NAMED else []
        return capital(listed([*blamed[:MOST_NAMED], *more], "or"))
    if _usual_figures(diagnosis):
        return "No cause shows in these figures"
    return {
        "no_gap": "No gap",
        "calibration": "Calibration removes the gap",
        "unknown": "Something outside the catalogue",
        "inconclusive": "The data cannot tell",
    }.get(diagnosis.verdict, VERDICTS[diagnosis.verdict].rstrip("."))


def _usual_figures(diagnosis: Diagnosis) -> bool:
    """Whether all that is said is that a healthy machine may have such key figures, whatever the twin's are."""
    return diagnosis.verdict == "no_gap" and diagnosis.signals == (KEY_FIGURES,) and not diagnosis.healthy


def _why(diagnosis: Diagnosis, effects: Mapping[str, Effect]) -> str:
    sentence = VERDICTS[diagnosis.verdict]
    if _usual_figures(diagnosis):
        return (
            "A healthy machine of the kind may have figures like these. That the twin has others is no sign of a cause."
        )
    known = dict.fromkeys(name for one in suspected(diagnosis) for name in one.effects if name in effects)
    if diagnosis.verdict == "cause":
        return " ".join(effects[name].physics for name in known) or sentence
    if diagnosis.verdict == "ambiguous":
        return " ".join([sentence, *(f"{capital(title([name]))}: {effects[name].physics}" for name in known)])
    if diagnosis.verdict == "inconclusive":
        best = [f"The likeliest, {title(c.effects)}, has {probability(c.probability)}." for c in diagnosis.causes[:1]]
        return " ".join(diagnosis.limitations[:2] or [sentence, *best])
    return sentence


def _where(diagnosis: Diagnosis) -> str:
    if _usual_figures(diagnosis):
        return "Nowhere that healthy machines of the kind do not differ, too."
    if diagnosis.verdict == "no_gap":
        return "Nowhere: healthy days differ as much."
    if diagnosis.verdict == "calibration":
        p = "" if diagnosis.where_p is None else f" ({p_value(diagnosis.where_p)})"
        return f"In parameters that were uncertain: what they cannot absorb looks like noise{p}."
    sentences = []
    if suspected(diagnosis) and diagnosis.components:
        likely = {name: p for name, p in diagnosis.components.items() if p >= WORTH_NAMING}
        named = [f"{readable(name)} ({probability(p)})" for name, p in likely.items()]
        sentences += [f"In the {listed(named, 'or')}."] if named else []
    if diagnosis.where:
        (signal, phase), share = max(total_shares(diagnosis.where).items(), key=lambda item: item[1])
        sentences.append(
            f"It shows most in the {readable(signal)} ({readable(phase)}): {probability(share)} of the gap."
        )
    if diagnosis.where and diagnosis.verdict == "inconclusive":
        sentences.append("Take this as a hint only.")
    return " ".join(sentences) or "No part of the gap stands out."


def _magnitude(diagnosis: Diagnosis) -> str:
    if diagnosis.verdict == "calibration":
        moved = [_moved(one) for one in diagnosis.calibration[:2]]
        return f"Moved most: {listed(moved)}." if moved else "No parameter moved far."
    lines = dict.fromkeys(
        f"{quantity}: {median} against the twin (90 %: {interval})."
        for one in suspected(diagnosis)
        for quantity, median, interval in magnitudes(one)
    )
    if lines:
        return " ".join(lines)
    sentences = []
    if diagnosis.shrinkage:
        worst = max(diagnosis.shrinkage, key=lambda one: one.before / one.noise)
        unit, size = signal_unit(worst.signal)
        error, noise = (with_unit(three_digits(value / size), unit) for value in (worst.before, worst.noise))
        where = f"{readable(worst.signal)} of {worst.manoeuvre}"
        sentences.append(f"The twin is off by {error} (rms) where it is worst, in the {where}; noise is {noise}.")
    if diagnosis.where_p is not None:
        sentences.append(f"Without any cause a gap as large as this comes with {p_value(diagnosis.where_p)}.")
    return " ".join(sentences) or "It was not measured."


def _moved(one: Mapping[str, Any]) -> str:
    unit = "" if one["unit"] == "1" else f" {one['unit']}"
    return f"{one['key']} {one['before']:.4g} → {one['after']:.4g}{unit}"


def _confidence(diagnosis: Diagnosis) -> str:
    sentences = []
    if diagnosis.causes:
        first = diagnosis.causes[0]
        best = [f"{probability(one.probability)} for {title(one.effects)}" for one in diagnosis.causes[:2]]
        there = presence(first.effects, {one.effects: one.probability for one in diagnosis.causes})
        if is_named(first) and there - first.probability >= WORTH_NAMING:
            best[0] += f", {probability(there)} for it alone or beside something else"
        sentences.append(f"{'; '.join(best)}.")
    if diagnosis.fit_test_p is not None:
        left = "More is left than" if diagnosis.fit_test_p < LEAST_FIT else "What is left is no more than"
        sentences.append(f"{left} the right cause would leave ({p_value(diagnosis.fit_test_p)}).")
    return " ".join(sentences) or "No hypothesis was weighed."


def _closure(diagnosis: Diagnosis) -> str:
    if _usual_figures(diagnosis):
        return "No cause was tried."
    if diagnosis.verdict == "no_gap":
        return "There is nothing to shrink."
    if not diagnosis.shrinkage:
        return "It was not measured."
    left_out = [one for one in diagnosis.shrinkage if one.held_out]
    if not left_out:
        return f"Where it was fitted, which proves little, {_by_signal(diagnosis.shrinkage)}."
    # without its own clock and zero refitted a manoeuvre proves more: the other figure is for comparison
    plain = [one for one in left_out if not one.refitted]
    text = f"On manoeuvres left out of the fit {_by_signal(plain or left_out)} (medians)"
    if plain and len(plain) < len(left_out):
        text += f". With their own clock and zero refitted {_by_signal([one for one in left_out if one.refitted])}"
    controls = [
        f"{control(name)} {gap_closure(value)}" for name, value in diagnosis.controls.items() if value is not None
    ]
    return f"{text}. Median of all signals: {', '.join(controls)}." if len(controls) > 1 else f"{text}."


def _by_signal(found: Sequence[GapClosure]) -> str:
    """``98 % of the gap is gone in joint angle and 40 % in pump pressure``: medians, as a small gap of one signal says
    nothing of a large one of another."""
    shares: dict[str, list[float]] = {}
    for one in found:
        shares.setdefault(readable(one.signal), []).append(one.S)
    medians = {signal: float(np.median(values)) for signal, values in shares.items()}
    less = [(gap_closure(S), signal) for signal, S in medians.items() if S >= 0.0]
    more = [f"by {gap_closure(-S)} in {signal}" for signal, S in medians.items() if S < 0.0]
    parts = []
    if less:
        (share, signal), *others = less
        parts.append(
            listed([f"{share} of the gap is gone in {signal}", *(f"{part} in {name}" for part, name in others)])
        )
    if more:
        parts.append(f"the gap has grown {listed(more)}")
    return "; ".join(parts)


def _doubt(diagnosis: Diagnosis) -> str:
    """What is likelier than no cause, though healthy days differ as much."""
    nothing = sum(one.probability for one in diagnosis.causes if not one.effects)
    likelier = [one for one in diagnosis.causes if one.effects and one.probability > nothing]
    if not likelier:
        return ""
    best = max(likelier, key=lambda one: one.probability)
    return (
        f" {capital(title(best.effects))} is likelier than no cause, but not clear: record more logs, and repeat commands "
        "while nothing is wrong."
    )


def _next(diagnosis: Diagnosis) -> str:
    file = machine_file(diagnosis)
    components = list(dict.fromkeys(readable(name) for one in suspected(diagnosis) for name in one.components))
    on = f" Go on with {file}." if file else ""
    text = {
        "no_gap": f"Go on with the machine file that you have.{_doubt(diagnosis)}",
        "calibration": on or "Calibrate the twin with them.",
        "cause": f"Look at the machine's {listed(components)}.{on}" if components else on,
        "ambiguous": "",
        "unknown": "Look at the machine where the gap shows.",
        "inconclusive": "Mend what the limitations name, and record again.",
    }[diagnosis.verdict]
    if diagnosis.next_experiments:
        best = diagnosis.next_experiments[0]
        what = f"Record {readable(best.name)}: {best.description.rstrip('.')} (expected gain {best.gain:.2f} bit)."
        return f"{text} {what}".strip()
    if _usual_figures(diagnosis):
        return (
            "Compare with the same turns of a healthy day (--healthy-source), or calibrate the twin to these figures."
        )
    if diagnosis.verdict != "no_gap" and diagnosis.signals == (KEY_FIGURES,):
        return f"{text} Record logs of these turns, with the pressures of both ports and of the pump.".strip()
    if diagnosis.verdict in ("ambiguous", "unknown", "inconclusive") and "pressure_a" not in diagnosis.signals:
        return f"{text} Log the pressures of both ports and of the pump, too.".strip()
    return text.strip() or "Record other manoeuvres: other levels, ramps, reversals."
