"""Units as people write them, and names that carry one: ``Speed (km/h)``, ``speed_km_per_h``, ``speedKmh``.

>>> find_unit("km/h", "speed").to_si(7.2)
2.0
>>> parse_name("Wheel speed (km/h)", {"wheel_speed"}, "speed").unit.symbol
'km/h'
"""

from __future__ import annotations

import itertools
import math
import re
import unicodedata
from collections.abc import Container, Iterator
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, NamedTuple

from aoro_gym.units import (
    ATMOSPHERIC_PRESSURE,
    BAR,
    DEGREE,
    KNOT,
    LITRE_PER_MINUTE,
    RPM,
    STANDARD_GRAVITY,
    ZERO_CELSIUS,
)

Vector = tuple[int, int, int, int, int, int]
"""Exponents of length, time, mass, angle, current and temperature."""

DIMENSIONS: dict[str, Vector] = {
    "ratio": (0, 0, 0, 0, 0, 0),
    "length": (1, 0, 0, 0, 0, 0),
    "volume": (3, 0, 0, 0, 0, 0),
    "time": (0, 1, 0, 0, 0, 0),
    "mass": (0, 0, 1, 0, 0, 0),
    "moment_of_inertia": (2, 0, 1, 0, 0, 0),
    "angle": (0, 0, 0, 1, 0, 0),
    "current": (0, 0, 0, 0, 1, 0),
    "temperature": (0, 0, 0, 0, 0, 1),
    "speed": (1, -1, 0, 0, 0, 0),
    "acceleration": (1, -2, 0, 0, 0, 0),
    "angular_rate": (0, -1, 0, 1, 0, 0),
    "frequency": (0, -1, 0, 0, 0, 0),
    "curvature": (-1, 0, 0, 0, 0, 0),
    "flow": (3, -1, 0, 0, 0, 0),
    "force": (1, -2, 1, 0, 0, 0),
    "pressure": (-1, -2, 1, 0, 0, 0),
    "torque": (2, -2, 1, 0, 0, 0),
    "voltage": (2, -3, 1, 0, -1, 0),
}
"""What is measured; ``rotational_speed`` is an angular rate that may be written as revolutions without saying so (Hz)."""

_NAMES = {vector: name for name, vector in DIMENSIONS.items()}


class _Atom(NamedTuple):
    vector: Vector
    factor: float
    offset: float = 0.0


@dataclass(frozen=True)
class Unit:
    """A unit: SI value = ``factor`` · value + ``offset``."""

    symbol: str
    """As it was written."""
    dimension: str
    factor: float
    offset: float = 0.0

    def to_si(self, values: Any) -> Any:
        """Values in SI; angles in rad, temperatures in K."""
        return values * self.factor + self.offset if self.offset else values * self.factor


@dataclass(frozen=True)
class NamedQuantity:
    """A name taken apart."""

    base: str
    """The name without its unit: lower-case words joined by underscores."""
    unit: Unit | None
    """None if no unit is written, or one that is unknown or measures something else (then ``unit_text`` says it)."""
    unit_text: str = ""

    @property
    def is_unknown(self) -> bool:
        """Whether a unit is written that cannot be one of this quantity."""
        return self.unit is None and bool(self.unit_text)


_SPELLINGS: dict[str, list[tuple[str, float]]] = {
    # dimension: spellings, parted by blanks, and their SI value; where only the case parts two, the likelier comes first
    "ratio": [
        ("% percent pct prozent", 1e-2),
        ("‰ permille promille permil", 1e-3),
        ("ppm", 1e-6),
        ("1 - unitless dimensionless fraction", 1.0),
    ],
    "length": [
        ("m metre metres meter meters mtr", 1.0),
        ("km kilometre kilometres kilometer kilometers", 1e3),
        ("dm decimetre decimetres decimeter decimeters", 1e-1),
        ("cm centimetre centimetres centimeter centimeters", 1e-2),
        ("mm millimetre millimetres millimeter millimeters", 1e-3),
        ("um micrometre micrometres micrometer micrometers micron microns", 1e-6),
        ("ft foot feet ' internationalfoot internationalfeet", 0.3048),
        ("usft ftus footus usfoot usfeet ussurveyfoot ussurveyfeet surveyfoot surveyfeet", 1200 / 3937),
        ('in inch inches "', 0.0254),
        ("yd yard yards", 0.9144),
        ("mi mile miles", 1609.344),
        ("nmi nauticalmile nauticalmiles", 1852.0),
        ("thou", 2.54e-5),
    ],
    "volume": [
        ("l litre litres liter liters ltr", 1e-3),
        ("ml millilitre millilitres milliliter milliliters cc ccm", 1e-6),
        ("gal gallon gallons usgal", 3.785411784e-3),
    ],
    "time": [
        ("s sec secs second seconds", 1.0),
        ("ms msec msecs milli millis millisec millisecs millisecond milliseconds", 1e-3),
        ("us usec usecs micro micros microsec microsecs microsecond microseconds", 1e-6),
        ("ns nsec nsecs nano nanos nanosec nanosecs nanosecond nanoseconds", 1e-9),
        ("min mins minute minutes", 60.0),
        ("h hr hrs hour hours", 3600.0),
        ("d day days", 86400.0),
    ],
    "mass": [("kg kilogram kilograms", 1.0), ("g gram grams", 1e-3), ("t tonne tonnes", 1e3), ("lb lbs", 0.45359237)],
    "angle": [
        ("rad rads radian radians", 1.0),
        ("mrad mrads milliradian milliradians", 1e-3),
        ("urad urads microradian microradians", 1e-6),
        ("deg degs degree degrees °", DEGREE),
        ("mdeg millidegree millidegrees", 1e-3 * DEGREE),
        ("gon gons gradian gradians", math.pi / 200),  # "grad" is the degree in German
        ("mgon", math.pi / 200e3),
        ("mil mils", 2 * math.pi / 6400),
        ("rev revs revolution revolutions turn turns cycle cycles", 2 * math.pi),
        ("arcmin arcmins arcminute arcminutes", math.pi / 10800),
        ("arcsec arcsecs arcsecond arcseconds", math.pi / 648000),
    ],
    "current": [("A amp amps ampere amperes", 1.0), ("mA milliamp milliamps milliampere milliamperes", 1e-3)],
    "temperature": [("K kelvin kelvins degK °K", 1.0), ("mK", 1e-3)],
    "speed": [
        ("kn kt kts knot knots", KNOT),
        ("mph", 1609.344 / 3600),
        ("kmh kmph kph kmhr", 1000 / 3600),
        ("mps ms", 1.0),
        ("mmps", 1e-3),
        ("cmps", 1e-2),
        ("fps ftps", 0.3048),
    ],
    "acceleration": [("g g0 gee", STANDARD_GRAVITY), ("mps2 mpss", 1.0)],
    "angular_rate": [
        ("rpm rev/min r/min u/min tr/min", RPM),
        ("krpm", 1e3 * RPM),
        ("rps", 2 * math.pi),
        ("dps degps", DEGREE),
        ("radps", 1.0),
    ],
    "frequency": [("Hz hertz", 1.0), ("mHz", 1e-3), ("kHz", 1e3)],
    "flow": [("lpm lmin", LITRE_PER_MINUTE), ("lps", 1e-3), ("gpm usgpm", 3.785411784e-3 / 60)],
    "force": [
        ("N newton newtons", 1.0),
        ("kN kilonewton kilonewtons", 1e3),
        ("MN meganewton meganewtons", 1e6),
        ("daN", 10.0),
        ("kgf kp", STANDARD_GRAVITY),
        ("lbf lb lbs", 4.4482216152605),
    ],
    "pressure": [
        ("bar bars barg bar(g)", BAR),
        ("mbar mbars millibar millibars", 1e2),
        ("MPa megapascal megapascals", 1e6),
        ("mPa", 1e-3),
        ("kPa kilopascal kilopascals", 1e3),
        ("hPa hectopascal hectopascals", 1e2),
        ("GPa gigapascal gigapascals", 1e9),
        ("Pa pascal pascals", 1.0),
        ("psi psig psia lbf/in2", 6894.757293168361),
        ("ksi", 6894757.293168361),
        ("atm", ATMOSPHERIC_PRESSURE),
        ("mmHg torr", 133.322387415),
        ("inHg", 3386.389),
    ],
    "torque": [("Nm", 1.0), ("kNm", 1e3)],
    "voltage": [("V volt volts", 1.0), ("mV millivolt millivolts", 1e-3), ("uV", 1e-6), ("kV kilovolt kilovolts", 1e3)],
}  # fmt: skip
_CELSIUS = "°C degC celsius centigrade C"
_FAHRENHEIT = "°F degF fahrenheit F"


def _atoms() -> tuple[dict[str, list[_Atom]], dict[str, list[_Atom]]]:
    """Atoms by exact and by case-folded spelling."""
    listed = [
        (spelling, _Atom(DIMENSIONS[dimension], factor))
        for dimension, rows in _SPELLINGS.items()
        for spellings, factor in rows
        for spelling in spellings.split()
    ]
    theta = DIMENSIONS["temperature"]
    listed += [(spelling, _Atom(theta, 1.0, ZERO_CELSIUS)) for spelling in _CELSIUS.split()]
    listed += [(spelling, _Atom(theta, 5 / 9, 459.67 * 5 / 9)) for spelling in _FAHRENHEIT.split()]
    exact: dict[str, list[_Atom]] = {}
    folded: dict[str, list[_Atom]] = {}
    for spelling, atom in listed:
        exact.setdefault(spelling, []).append(atom)
        folded.setdefault(spelling.lower(), []).append(atom)
    return exact, folded


_EXACT, _FOLDED = _atoms()


def plain_text(text: str) -> str:
    """``text`` with one sign for each of its look-alikes: superscripts, micro, minus, degree."""
    text = unicodedata.normalize("NFKC", text.replace("º", "°").replace("˚", "°").replace("²", "^2").replace("³", "^3"))
    return text.translate(str.maketrans("−–μ⋅·×*", "--u    ")).strip()


def find_unit(text: str, *dimensions: str) -> Unit | None:
    """The unit that ``text`` means, of the first of ``dimensions`` that fits; None if there is none.

    Case decides where two units differ by nothing else (mPa, MPa); elsewhere it does not matter.
    """
    for dimension in dimensions:
        for unit in _units(text):
            if unit.dimension == dimension:
                return unit
            if dimension == "rotational_speed" and unit.dimension == "angular_rate":
                return unit
            if dimension == "rotational_speed" and unit.dimension == "frequency":
                return Unit(unit.symbol, "angular_rate", unit.factor * 2 * math.pi)
    return None


@lru_cache(maxsize=4096)
def _units(text: str) -> tuple[Unit, ...]:
    """Every unit that ``text`` may mean, one a dimension."""
    if len(text) > 40:
        return ()
    symbol = text.strip()
    expression = plain_text(text)
    expression = re.sub(r"(?i)(°|\bdegs?\.?|\bdegrees?)[\s_]*(celsius|fahrenheit|[cf])\b", r"deg\2", expression)
    expression = re.sub(r"(?i)deg(celsius|fahrenheit)", r"\1", expression)
    found: dict[str, Unit] = {}
    whole = re.sub(r"[\s_\-]+", "", expression)
    for vector, factor, offset in _lookup(expression) or _lookup(whole) or ():
        dimension = _NAMES.get(vector)
        if dimension:
            found.setdefault(dimension, Unit(symbol, dimension, factor, offset))
    for vector, factor in _compound(expression):
        dimension = _NAMES.get(vector)
        if dimension:
            found.setdefault(dimension, Unit(symbol, dimension, factor))
    return tuple(found.values())


def _lookup(spelling: str) -> list[_Atom]:
    return _EXACT.get(spelling) or _FOLDED.get(spelling.lower()) or []


def _compound(text: str) -> Iterator[tuple[Vector, float]]:
    """Products and quotients of atoms: m/s^2, km per h, l min^-1, m_s (read as a quotient where the product is nothing)."""
    text = text.replace("_", " ").replace("(", " ").replace(")", " ").replace("**", "^")
    text = re.sub(r"(?i)(?:^|\s)(?:per|pro)\s", " / ", f"{text} ")
    text = re.sub(r"(?i)\s*\b(squared|cubed)\b", lambda m: "^2" if m[1].lower() == "squared" else "^3", text)
    text = re.sub(r"(?<=[A-Za-z])\.(?=[A-Za-z])", " ", text)
    over, *under = text.split("/")
    factors = [(part, 1) for part in over.split()] + [(part, -1) for parts in under for part in parts.split()]
    if not factors or len(factors) > 6:
        return
    yield from _products(factors)
    if not under and len(factors) == 2:
        yield from _products([factors[0], (factors[1][0], -1)])


def _products(factors: list[tuple[str, int]]) -> Iterator[tuple[Vector, float]]:
    choices = []
    for part, sign in factors:
        match = re.fullmatch(r"(\D+?|1)\^?([+-]?\d)?", part)
        if match is None:
            return
        power = sign * int(match[2] or 1)
        atoms = _lookup(match[1])
        if not atoms or not power:
            return
        choices.append([(atom, power) for atom in atoms if not atom.offset])
    for combination in itertools.islice(itertools.product(*choices), 64):
        vector = [0] * 6
        factor = 1.0
        for atom, power in combination:
            vector = [total + power * exponent for total, exponent in zip(vector, atom.vector, strict=True)]
            factor = factor * atom.factor**power if power > 0 else factor / atom.factor**-power
        yield (vector[0], vector[1], vector[2], vector[3], vector[4], vector[5]), factor


class Split(NamedTuple):
    """A way to part a name into a base and the text of a unit."""

    base: str
    unit_text: str
    is_explicit: bool
    """Whether brackets, a comma or a slash say that there is a unit."""


LONGEST_NAME = 200
"""Characters of a name that are looked at; a longer one has no unit and is known to nobody."""

_BRACKETS = re.compile(r"(.*)[\[({<]([^\[\](){}<>]*(?:\([^()]*\)[^\[\](){}<>]*)?)[\])}>]\s*", re.DOTALL)


@lru_cache(maxsize=65536)
def splits(name: str) -> tuple[Split, ...]:
    """Every way to part ``name`` into base and unit, what is explicit and longest first."""
    if len(name) > LONGEST_NAME:
        return (Split(name[:LONGEST_NAME].lower(), "", False),)
    name = name.strip()
    found: dict[Split, None] = {}
    explicit: list[tuple[str, str]] = []
    if match := _BRACKETS.fullmatch(name):
        explicit.append((match[1].rstrip(" ,;:/_"), match[2].strip()))
    for mark in ("/", ",", ";", ":"):
        base, there, unit = name.partition(mark) if mark == "/" else name.rpartition(mark)
        if there and base.strip() and unit.strip():
            explicit.append((base, unit.strip(" ()[]")))
    for base, unit in explicit:
        found[Split(canonical(base), unit, True)] = None
        for inner, its_unit in _suffixes(base):  # a unit line under names that carry their units, too
            found[Split(inner, unit if _same(its_unit, unit) else f"{its_unit} and {unit}", True)] = None
    found[Split(canonical(name), "", False)] = None
    for base, unit in _suffixes(name):
        found[Split(base, unit, False)] = None
    return tuple(found)


def _same(one: str, other: str) -> bool:
    values = {(unit.dimension, unit.factor, unit.offset) for unit in _units(one)}
    return not values.isdisjoint((unit.dimension, unit.factor, unit.offset) for unit in _units(other))


def _suffixes(name: str) -> Iterator[tuple[str, str]]:
    """Bases and units of names whose last words, or letters, are a unit."""
    spaced = re.sub(r"(?<=[a-z0-9])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z])", " ", name)
    for pattern in (r"[\s_]+", r"[\s_.\-:]+"):
        for text in (name, spaced):
            words = re.split(pattern, text.strip())
            for count in range(min(6, len(words) - 1), 0, -1):
                unit = " ".join(words[-count:])
                if _units(unit):
                    kept = words[:-count]
                    yield canonical(" ".join(kept[:-1] if len(kept) > 1 and kept[-1].lower() == "in" else kept)), unit
    for count in range(min(6, len(name) - 1), 1, -1):  # timems, speedkmh; a single letter is too often a plural
        if name[-count - 1].isalnum() and _units(name[-count:]):
            yield canonical(name[:-count]), name[-count:]


def canonical(name: str) -> str:
    """``name`` in lower-case words joined by underscores, without regard to brackets, blanks, dots and camel case."""
    text = re.sub(r"(?<=[a-z0-9])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z])", "_", plain_text(name))
    return re.sub(r"[^\w°%]+|_+", "_", text).strip("_").lower()


def parse_name(name: str, bases: Container[str] | re.Pattern[str], *dimensions: str) -> NamedQuantity | None:
    """``name`` as a quantity called one of ``bases``, with a unit of one of ``dimensions`` or without; None if it is not.

    A last word is a unit only if it is one of those dimensions and the words before it are a base, so that
    ``pressure_a`` has none. An explicit unit (brackets, slash, comma) that is unknown or measures something else makes
    :attr:`NamedQuantity.is_unknown` true.

    Args:
        name: As it stands in a header.
        bases: Canonical names (:func:`canonical`), or a pattern that fits them whole.
        dimensions: Keys of :data:`DIMENSIONS` or ``rotational_speed``; the first that fits is taken.
    """
    misfit = None
    for base, unit_text, is_explicit in splits(name):
        if not (bases.fullmatch(base) if isinstance(bases, re.Pattern) else base in bases):
            continue
        if not unit_text:
            return NamedQuantity(base, None)
        unit = find_unit(unit_text, *dimensions)
        if unit is not None:
            return NamedQuantity(base, unit, unit_text)
        if is_explicit and misfit is None:
            misfit = NamedQuantity(base, None, unit_text)
    return misfit
