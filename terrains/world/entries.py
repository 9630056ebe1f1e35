"""Objects of a world as entries of JSON, and back."""

from __future__ import annotations

from typing import Any

from aoro_gym.terrains.world.objects import CLASSES, Object, dimensions


def object_entry(one: Object) -> dict[str, Any]:
    """Kind and fields of an object, as JSON has them."""
    return {"kind": one.kind.name.lower()} | {name: getattr(one, name) for name in dimensions(type(one))}


def object_of(where: str, entry: Any) -> Object:
    """The object of an entry, which stands ``where``; ``ValueError`` naming that and the value."""
    if not isinstance(entry, dict) or entry.get("kind") not in CLASSES:
        kind = entry.get("kind") if isinstance(entry, dict) else entry
        raise ValueError(f"{where} has kind {f'{kind!r}'[:60]}; choose one of: {', '.join(CLASSES)}")
    made = CLASSES[entry["kind"]]
    given, wanted = set(entry) - {"kind"}, set(dimensions(made))
    if given != wanted:
        lacking, foreign = ", ".join(sorted(wanted - given)), ", ".join(sorted(given - wanted))
        raise ValueError(
            f"{where} ({entry['kind']}) "
            + (f"lacks {lacking}" if lacking else f"has {foreign}, which is no field of it")
        )
    values = {name: tuple(v) if isinstance(v, list) else v for name, v in entry.items() if name != "kind"}
    for name, value in values.items():
        parts = value if isinstance(value, tuple) else (value,)
        numbers = all(isinstance(part, int | float) and not isinstance(part, bool) for part in parts)
        if name != "species" and not numbers:
            raise ValueError(f"{where}: {name} is {f'{entry[name]!r}'[:60]}, but must be a number, or a list of them")
    try:
        return made(**values)
    except (TypeError, ValueError) as error:
        raise ValueError(f"{where}: {error}") from None
