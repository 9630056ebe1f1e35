"""Cells of a table: numbers, times, and how a message quotes them."""

from __future__ import annotations

import re
from collections.abc import Sequence
from datetime import date

import numpy as np

THOUSANDS = re.compile(
    r"(?<![\d.,])\d{1,3}(?:(?:,\d{3})+\.\d|(?:\.\d{3})+,\d|(?:['’\u00a0\u202f]\d{3})+)\d*(?:[.,]\d+)?"
)
"""Numbers with separators of thousands; nobody can tell them from two numbers for sure, so they are not read."""
LONGEST_ECHO = 40
"""Characters of a cell, or a name, that a message repeats."""
_NUMBER = re.compile(r"[+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]{1,6})?")
_EITHER_NUMBER = re.compile(r"[+\-−]?(?:[0-9]+[.,]?[0-9]*|[.,][0-9]+)(?:[eE][+-]?[0-9]{1,6})?|[+-]?(?:nan|inf)", re.I)
MISSING = {"", "na", "n/a", "nan", "null", "none", "-", "--", "#n/a"}
_STAMP = re.compile(
    r"(?:(?P<year>\d{4})-(?P<month>\d\d)-(?P<day>\d\d)[T ]|(?P<day2>\d\d?)\.(?P<month2>\d\d?)\.(?P<year2>\d{4})[T ,]\s*|"
    r"\d\d?/\d\d?/\d{4}[T ,]\s*)?"
    r"(?P<hour>\d\d?):(?P<minute>\d\d)(?::(?P<second>\d\d)(?:[.,](?P<part>\d{1,15}))?)?"
    r"\s*(?:Z|UTC|GMT|(?P<zone>[+-]\d\d(?::?\d\d)?))?",
    re.ASCII,
)


def is_number(cell: str) -> bool:
    """Whether ``cell`` is a number with a decimal point or comma, NaN and infinity included."""
    return _EITHER_NUMBER.fullmatch(cell.strip()) is not None


def parse_number(cell: str, decimal: str = ".") -> float | None:
    """The number in ``cell``; None if it is none (1_0, 0x10, two marks), not finite or too large for a float."""
    text = cell.strip().replace("−", "-")
    if decimal == ",":
        if "." in text:
            return None
        text = text.replace(",", ".")
    if not _NUMBER.fullmatch(text):
        return None
    value = float(text)
    return value if np.isfinite(value) else None


def time_stamp(cell: str) -> int | None:
    """Nanoseconds of a date and time (ISO 8601, or day.month.year), or of a time of day; None if it is neither.

    Day and month cannot be told apart between slashes: such a date counts for nothing.
    """
    match = _STAMP.fullmatch(cell.strip()) if len(cell) < 80 else None
    if match is None:
        return None
    year, month, day = (match[key] or match[f"{key}2"] for key in ("year", "month", "day"))
    try:
        days = date(int(year), int(month), int(day)).toordinal() if year else 0
    except ValueError:
        return None
    hour, minute, second = int(match["hour"]), int(match["minute"]), int(match["second"] or 0)
    if hour > 24 or minute > 59 or second > 60:
        return None
    zone = match["zone"] or "+0000"
    offset = int(zone[1:3]) * 60 + int(zone[3:].lstrip(":") or 0)
    minutes = (days * 24 + hour) * 60 + minute - (offset if zone[0] == "+" else -offset)
    return (minutes * 60 + second) * 10**9 + int((match["part"] or "0").ljust(9, "0")[:9])


def shown(text: str) -> str:
    """``text`` quoted for a message, not longer than :data:`LONGEST_ECHO`."""
    text = text.strip()
    return repr(text if len(text) <= LONGEST_ECHO else text[: LONGEST_ECHO - 1] + "…")


def listed(names: Sequence[str], limit: int = 120) -> str:
    """``names`` for a message, in ``limit`` characters; more are counted."""
    text = ""
    for index, name in enumerate(names):
        name = name if len(name) <= LONGEST_ECHO else name[: LONGEST_ECHO - 1] + "…"
        if len(text) + len(name) > limit:
            return f"{text}, … ({len(names):,} in all)" if index else f"{name} … ({len(names):,} in all)"
        text += f", {name}" if index else name
    return text
