"""Units of length by the names that files and people give them."""

from __future__ import annotations

import re
import unicodedata
from dataclasses import dataclass
from functools import lru_cache

from aoro_gym.terrains.extras import import_extra

UNITS = {
    "m": 1.0,
    "km": 1e3,
    "dm": 0.1,
    "cm": 1e-2,
    "mm": 1e-3,
    "ft": 0.3048,
    "us-ft": 1200.0 / 3937.0,
    "in": 0.0254,
}
"""Size [m] of the units that the caller may name."""

SILENT = {"", "unknown", "none", "na", "nan", "null", "unspecified", "undefined", "unset", "notset", "unitless"}
"""Words in the place of a unit that say nothing."""

_FOOT = {"ft", "foot", "feet", "fuss", "pied", "pieds"}
_SURVEY = {"us", "u", "s", "survey", "american", "united", "states"}
_INTERNATIONAL = {"international", "intl", "int", "i"}
_SPELLINGS = {
    "m": "m masl mamsl metre metres meter meters mtr metro metros metri",
    "km": "km kilometre kilometres kilometer kilometers kms",
    "dm": "dm decimetre decimetres decimeter decimeters dezimeter",
    "cm": "cm centimetre centimetres centimeter centimeters zentimeter cms",
    "mm": "mm millimetre millimetres millimeter millimeters mms",
    "us-ft": "usft ftus usfoot usfeet footus feetus surveyfoot surveyfeet surveyft ussurveyfoot ussurveyfeet ussurveyft"
    " footussurvey feetussurvey sft",
    "in": "in inch inches zoll",
}
_BY_WORD = {word: unit for unit, words in _SPELLINGS.items() for word in words.split()}
_AROUND = frozenset(("unit", "units", "height", "heights", "elevation", "elevations", "altitude", "z", "depth"))
_AFTER = _AROUND | set(
    re.findall(
        r"\w+",
        """
    above below over mean sea level asl amsl msl a s l ellipsoid ellipsoidal geoid orthometric datum vertical of the
    n nn nhn navd ngvd egm wgs dhhn nap
""",
    )
)
"""Words that may follow a unit without changing it."""


@dataclass(frozen=True)
class LengthUnit:
    """One unit of length."""

    name: str
    """Short, as in :data:`UNITS`, or as EPSG has it."""
    metres: float


def listed() -> str:
    """The units that the caller may name, for a message."""
    names = list(UNITS)
    return f"{', '.join(names[:-1])} or {names[-1]}"


@lru_cache(maxsize=256)
def unit_named(text: str) -> LengthUnit | None:
    """The unit that ``text`` names, whatever its case, separators and language of survey; None if it is unknown.

    >>> unit_named("Foot_US").name, unit_named("[Metres above sea level]").name, unit_named("m/s")
    ('us-ft', 'm', None)
    """
    if not text.isprintable() or len(text) > 100 or re.search(r"[/^*²³%]", text):
        return None
    if code := re.fullmatch(r"\s*(?:epsg\s*:+\s*)?(9\d{3})\s*", text, re.IGNORECASE):
        return _of_epsg(code=code[1])
    plain = "".join(c for c in unicodedata.normalize("NFKD", text) if not unicodedata.combining(c))
    split = re.sub(r"(?<=[a-z])(?=[A-Z])", " ", plain)  # FootUS
    for version in (plain, split):
        words = re.findall(r"[a-z]+|\d+", version.casefold())
        while len(words) > 1 and words[0] in _AROUND:
            words = words[1:]
            if len(words) > 1 and words[0] in ("in", "is"):
                words = words[1:]
        for length in range(len(words), 0, -1):
            if length < len(words) and not all(word in _AFTER or word.isdigit() for word in words[length:]):
                continue
            if length < len(words) and words[length].isdigit():
                continue  # m2, m 3
            found = _of_words(words[:length])
            if found is not None:
                return found
    return None


def is_unspecified(text: str) -> bool:
    """Whether ``text`` stands in the place of a unit without naming one."""
    return re.sub(r"[\W_]+", "", text.casefold()) in SILENT


def _of_words(words: list[str]) -> LengthUnit | None:
    feet = [word for word in words if word in _FOOT]
    others = {word for word in words if word not in _FOOT}
    if len(feet) == 1 and others <= _SURVEY | _INTERNATIONAL:
        if not others or others <= _INTERNATIONAL:
            return LengthUnit("ft", UNITS["ft"])
        if others <= _SURVEY:
            return LengthUnit("us-ft", UNITS["us-ft"])
    name = _BY_WORD.get("".join(words))
    if name is not None:
        return LengthUnit(name, UNITS[name])
    return _of_epsg(words=tuple(words))


def _of_epsg(words: tuple[str, ...] = (), code: str = "") -> LengthUnit | None:
    """One of the other units of EPSG's register, by its name (in the singular or the plural) or its code."""
    pyproj = import_extra("pyproj", "a unit of length")
    plural = words and words[-1].endswith("s") and (*words[:-1], words[-1][:-1])
    for name, unit in pyproj.database.get_units_map(auth_name="EPSG", category="linear").items():
        if (code and unit.code == code) or tuple(re.findall(r"[a-z]+|\d+", name.casefold())) in (words, plural):
            short = next((key for key, metres in UNITS.items() if abs(metres / unit.conv_factor - 1.0) < 1e-9), name)
            return LengthUnit(short, float(unit.conv_factor))
    return None
