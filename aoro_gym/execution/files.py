"""Files that are written whole or not at all, whatever ends the process while it writes."""

from __future__ import annotations

import json
import math
import os
import re
import shutil
import tomllib
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from functools import lru_cache
from pathlib import Path
from typing import Any

LOCK = ".lock"
"""In a folder that one process at a time writes into; see :mod:`aoro_gym.execution.locking`."""

LARGEST_TOML = 1 << 20
"""Bytes of a TOML file that is read."""
_DEEP_KEY = re.compile(r"""(?<![\w"'-])(?:[\w"'-]++[ \t]*+\.[ \t]*+){40}""")

PARTIAL = ".partial"
"""In the name of a file that is being written; see :func:`remove_partial_files`."""


@contextmanager
def written_whole(path: Path) -> Iterator[Path]:
    """Yield a temporary path beside ``path`` to write to; it becomes ``path`` when the context ends well.

    The file reaches the disk before it takes its name, so that a crash, a full disk, Ctrl-C or a power cut leave what was
    there before. Missing folders are made. The temporary name keeps the suffix, by which many writers pick their format.

    Raises:
        OSError: names ``path`` if the disk is full or the file cannot be written.
    """
    temporary = path.with_name(f".{path.stem}.{os.getpid()}{PARTIAL}{path.suffix}")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        yield temporary
        _flush_to_disk(temporary)
        os.replace(temporary, path)
        _flush_to_disk(path.parent)
    except OSError as error:
        _remove(temporary)
        if error.errno is None or error.filename not in (None, str(temporary)):
            raise
        raise OSError(error.errno, error.strerror, str(path)) from error
    except BaseException:  # Ctrl-C, too
        _remove(temporary)
        raise


@contextmanager
def folder_written_whole(path: Path) -> Iterator[Path]:
    """Yield a path beside ``path`` at which to make a folder; it becomes ``path`` when the context ends well.

    Files in it reach the disk first. A folder that was there before makes room: a crash in the moment between leaves both
    beside it, under names of their own.

    Raises:
        OSError: names ``path`` if the disk is full or the folder cannot be written.
    """
    temporary, before = (
        path.with_name(f".{path.stem}.{os.getpid()}{mark}{PARTIAL}{path.suffix}") for mark in ("", "-")
    )
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        yield temporary
        for inside in (*temporary.rglob("*"), temporary):
            _flush_to_disk(inside)
        if path.exists():
            os.replace(path, before)
        os.replace(temporary, path)
        _flush_to_disk(path.parent)
    except OSError as error:
        if error.errno is None or error.filename not in (None, str(temporary)):
            raise
        raise OSError(error.errno, error.strerror, str(path)) from error
    finally:
        if before.exists() and not path.exists():
            os.replace(before, path)
        for left in (temporary, before):
            shutil.rmtree(left, ignore_errors=True)


def write_bytes(path: Path, content: bytes) -> None:
    """Write ``content`` to ``path``, whole or not at all; see :func:`written_whole`."""
    with written_whole(path) as temporary:
        temporary.write_bytes(content)


def write_text(path: Path, text: str) -> None:
    """Write ``text`` to ``path`` in UTF-8, whole or not at all; see :func:`written_whole`."""
    write_bytes(path, text.encode())


def write_json(path: Path, content: Mapping[str, Any]) -> None:
    """Write ``content`` whole or not at all; ``ValueError`` if it holds a number that JSON has not."""
    write_text(path, json.dumps(content, indent=2, ensure_ascii=False, allow_nan=False) + "\n")


def with_nulls(content: Any) -> Any:
    """``content`` with null for every number that JSON has not: NaN and infinities."""
    if isinstance(content, Mapping):
        return {key: with_nulls(value) for key, value in content.items()}
    if isinstance(content, list | tuple):
        return [with_nulls(value) for value in content]
    return None if isinstance(content, float) and not math.isfinite(content) else content


def read_json(path: Path) -> dict[str, Any]:
    """Read a JSON object; ``ValueError`` that names the file if it holds none."""
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except RecursionError:
        raise ValueError(f"{path} is not JSON: it is nested too deeply; restore it, or name another file") from None
    except ValueError as error:  # no JSON, no UTF-8, or an integer of too many digits
        raise ValueError(f"{path} is not JSON: {error}; restore it, or name another file") from None
    if not isinstance(content, dict):
        raise ValueError(f"{path} holds no JSON object; restore it, or name another file")
    return content


def read_toml(path: Path) -> dict[str, Any]:
    """Read a TOML file; ``ValueError`` in one sentence that names the file if it holds none, or is too large or too deep."""
    if path.stat().st_size > LARGEST_TOML:
        raise ValueError(f"{path} has {path.stat().st_size:,} bytes, but a TOML file at most {LARGEST_TOML:,}")
    try:
        text = path.read_bytes().decode("utf-8-sig").replace("\r\n", "\n")
        if _DEEP_KEY.search(text):  # tomllib's time grows with the square of a key's length
            raise RecursionError
        return _copied(_parsed(text))
    except RecursionError:
        raise ValueError(f"{path} is not TOML: it is nested too deeply") from None
    except UnicodeDecodeError as error:
        raise ValueError(f"{path} is not TOML: byte {error.start + 1:,} is not UTF-8; save it as UTF-8") from None
    except ValueError as error:  # no TOML, or an integer of too many digits
        raise ValueError(f"{path} is not TOML: {_shortened(str(error))}") from None


@lru_cache(maxsize=8)
def _parsed(text: str) -> dict[str, Any]:
    """A machine file takes tens of milliseconds, and is read for every machine that stands on it."""
    return tomllib.loads(text)


def _copied(value: Any) -> Any:
    """``value`` with tables and arrays of its own."""
    if isinstance(value, dict):
        return {key: _copied(item) for key, item in value.items()}
    return [_copied(item) for item in value] if isinstance(value, list) else value


def check_writable(path: Path) -> None:
    """``ValueError`` unless a file can be written to ``path``; folders that are missing can be made."""
    if path.is_dir():
        raise ValueError(f"{path} is a folder; name a file in it")
    parent = next(parent for parent in path.absolute().parents if parent.exists())
    if not parent.is_dir():
        raise ValueError(f"{path} cannot be written: {parent} is a file, not a folder")
    if not os.access(path if path.exists() else parent, os.W_OK):
        raise ValueError(f"{path} cannot be written: no permission for {path if path.exists() else parent}")


def remove_partial_files(folder: Path) -> None:
    """Remove what killed processes left unfinished in ``folder`` and below; only for who holds the folder's lock.

    Folders below that are locked on their own are left alone: another process may be writing there.
    """
    for place, names, files in os.walk(folder):
        names[:] = [name for name in names if not (Path(place) / name / LOCK).exists()]
        unfinished = [Path(place) / name for name in (*names, *files) if name.startswith(".") and PARTIAL in name]
        for path in unfinished:
            if path.is_dir():
                shutil.rmtree(path, ignore_errors=True)
            else:
                _remove(path)


def _shortened(text: str, most: int = 200) -> str:
    """``text`` in one line of at most ``most`` characters."""
    line = " ".join(text.split())
    return line if len(line) <= most else f"{line[: most - 1]}…"


def _remove(path: Path) -> None:
    with suppress(OSError):
        path.unlink()


def _flush_to_disk(path: Path) -> None:
    """Wait until the file's, or the folder's, content has reached the disk."""
    handle = os.open(path, os.O_RDONLY)
    try:
        os.fsync(handle)
    except OSError:
        if path.is_file():
            raise  # a full disk may show only here; some file systems cannot flush folders
    finally:
        os.close(handle)
