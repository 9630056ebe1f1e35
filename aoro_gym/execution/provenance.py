"""What the results in a folder follow from, so that work that goes on there is the work that was begun.

A folder's record names every input, in words or by its digest, the versions of the libraries and the sources of the package.
An input that is another one now is refused by its name: what was computed with it would be mixed with what comes. So is
changed code, unless the user accepts it, which the record then tells.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from aoro_gym.execution.digest import digest, sources, versions
from aoro_gym.execution.files import read_json, write_json

PROVENANCE = "provenance.json"
"""The record's name in a folder of results."""
DIGEST = "sha256 "
"""What the text of a value that is too long to be shown begins with."""
SHOWN = 60
"""Characters of a value that is shown, at most."""
NAMED = 3
"""Changes that a message names; it counts the others."""


class ChangedInput(ValueError):
    """What is asked for now differs from what the folder was begun with."""


class ChangedCode(ValueError):
    """The package or a library differs from what the folder was begun with."""


def check_provenance(
    file: Path,
    inputs: Mapping[str, Any],
    *,
    begun: bool = False,
    restart: str = "--restart",
    accept_code_change: bool = False,
) -> list[str]:
    """Write the record ``file`` of new work, or check that the work it tells of is what ``inputs`` ask for.

    Args:
        file: The record, usually :data:`PROVENANCE` in the folder of the results, whose lock is held.
        inputs: By name, everything that the results depend on: plain values, mappings of such, arrays, objects, and
            :class:`~aoro_gym.execution.digest.Contents` of files.
        begun: Whether there are results already: without a record nobody knows which code they come from.
        restart: What a user does to begin anew, for the message.
        accept_code_change: Whether to go on with other code or versions, which is then recorded.

    Returns:
        All changes of the code that were accepted, now and before, in words.

    Raises:
        ChangedInput: names the inputs that differ, with both values where they are short.
        ChangedCode: names files and versions that differ.
        ValueError: the record is damaged.
        TypeError: an input cannot be told from others.
    """
    asked = dict(_described("", inputs))
    code = {"versions": dict(versions()), "sources": {name: DIGEST + value for name, value in sources().items()}}
    try:
        record = read_json(file) if file.exists() else None
    except ValueError as error:
        raise ValueError(f"{error}; {restart} begins anew") from None
    if record is None:
        changes = ["results without a record of their code"] if begun else []
    else:
        other = list(_differences(_mapping(record, "inputs"), asked))
        if other:
            raise ChangedInput(f"{file.parent} was begun with other inputs: {listed(other)}; {restart} begins anew")
        changes = [change for key in code for change in _differences(_mapping(record, key), code[key])]
    if changes and not accept_code_change:
        raise ChangedCode(
            f"{file.parent} was begun with other code: {listed(changes)}; --accept-code-change goes on and records it,"
            f" {restart} begins anew"
        )
    accepted = [] if record is None else _accepted(record)
    if changes:
        accepted.append({"at": datetime.now(UTC).isoformat(timespec="seconds"), "changes": changes})
    if changes or record is None:
        write_json(file, {"inputs": asked, **code, "accepted_code_changes": accepted})
    return [change for one in accepted for change in one["changes"]]


def accepted_code_changes(file: Path) -> list[Any]:
    """The changes of code that the record ``file`` tells of: when each was accepted, and what it was."""
    return _accepted(read_json(file))


def changed_inputs(file: Path, inputs: Mapping[str, Any]) -> list[str]:
    """What of ``inputs`` differs from the record ``file``, in words; inputs that are not asked about do not count.

    Raises OSError if there is no record, ValueError if it is damaged.
    """
    before = _mapping(read_json(file), "inputs")
    asked = dict(_described("", inputs))
    about = {key: value for key, value in before.items() if any(f"{key} ".startswith(f"{name} ") for name in inputs)}
    return list(_differences(about, asked))


def _described(name: str, value: Any) -> Iterator[tuple[str, str]]:
    """Each part of an input by its dotted name: short plain values in words, all else by its digest."""
    if isinstance(value, Mapping) and value and all(isinstance(key, str) for key in value):
        for key, part in value.items():
            yield from _described(f"{name} {key}".strip(), part)
    elif _is_plain(value) and len(text := _text(value)) <= SHOWN:
        yield name, text
    else:
        yield name, f"{DIGEST}{digest(value)[:16]}"


def _is_plain(value: Any) -> bool:
    if isinstance(value, list | tuple):
        return all(map(_is_plain, value))
    return isinstance(value, bool | int | float | str) or value is None


def _text(value: Any) -> str:
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(_text, value))}]"
    return repr(float(value) if isinstance(value, float) else value)


def _differences(before: Mapping[str, str], now: Mapping[str, str]) -> Iterator[str]:
    for name in sorted({*before, *now}):
        if before.get(name) == now.get(name):
            continue
        values = [source.get(name, "absent") for source in (before, now)]
        if all(value.startswith(DIGEST) for value in values):
            yield f"{name} has changed"
        else:
            yield f"{name} was {_shown(values[0])}, is {_shown(values[1])}"


def _shown(value: str) -> str:
    return "another" if value.startswith(DIGEST) else value


def listed(changes: Sequence[str]) -> str:
    """Changes for a message: the first ones, and how many more there are."""
    more = len(changes) - NAMED
    return ", ".join(changes[:NAMED]) + (f", and {more} more" if more > 0 else "")


def _accepted(record: Mapping[str, Any]) -> list[Any]:
    found = record.get("accepted_code_changes")
    return [one for one in found if isinstance(one, dict) and "changes" in one] if isinstance(found, list) else []


def _mapping(record: Mapping[str, Any], key: str) -> Mapping[str, str]:
    found = record.get(key)
    return found if isinstance(found, Mapping) else {}
