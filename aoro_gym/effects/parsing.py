"""Effects as they are written on a command line: ``seal_friction=3000``, of two magnitudes ``ID=FIRST,SECOND``."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TypeVar

from aoro_gym.checks import check_range
from aoro_gym.effects.effect import Effect
from aoro_gym.recording.cells import parse_number

AnEffect = TypeVar("AnEffect", bound=Effect)


def parse_effect(option: str, text: str, among: Mapping[str, AnEffect]) -> tuple[AnEffect, list[float]]:
    """The effect that ``text`` names, and its magnitudes in SI as the catalogue has them.

    Raises ValueError naming ``option`` (``"--effect"``) and what is wrong: a name that is not ``among`` the effects, a value
    that is no number, too few or too many of them, one out of its range.
    """
    name, _, written = text.partition("=")
    effect = among.get(name)
    if effect is None:
        raise ValueError(f"{option} {text}: {name!r} is no effect here; choose from: {', '.join(among)}")
    values = [value for value in map(parse_number, written.split(",")) if value is not None]
    if len(values) != written.count(",") + 1 or len(values) != len(effect.magnitudes):
        form = ",".join(one.name.upper() for one in effect.magnitudes)
        raise ValueError(f"{option} {text} is not {name}={form}, numbers in SI")
    for value, one in zip(values, effect.magnitudes, strict=True):
        check_range(f"{option} {name}: {one.name}", value, one.unit, ge=one.low, le=one.high)
    return effect, values
