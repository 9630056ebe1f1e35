"""Results that are kept on disk between processes, found by the digest of everything that they depend on.

They lie in ``$XDG_CACHE_HOME/aoro-gym`` (``~/.cache/aoro-gym`` by default); the environment variable ``AORO_GYM_CACHE``
names another folder, or ``off`` for none. What is damaged is made again, what cannot be written is only not kept, and the
oldest goes when the folder outgrows :data:`LARGEST`. Files appear whole, so processes may share the folder.
"""

from __future__ import annotations

import os
import platform
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from aoro_gym.execution.arrays import read_arrays, write_arrays
from aoro_gym.execution.digest import Contents, digest, versions

VARIABLE = "AORO_GYM_CACHE"
"""Environment variable that moves the cache or switches it off."""
OFF = ("", "off", "0", "none")
LARGEST = 1024 * 2**20
"""Bytes that the cache may hold."""
LARGEST_RESULT = LARGEST // 16
"""Bytes of a result that is kept; what is larger would drive out too much."""
NAMES = "names"
"""Array of a file that lists the others: a name that is damaged is no other name."""

T = TypeVar("T")


def cache_folder() -> Path | None:
    """Where results are kept; None if nowhere."""
    asked = os.environ.get(VARIABLE)
    if asked is not None:
        return None if asked.strip().lower() in OFF else Path(asked).expanduser()
    base = os.environ.get("XDG_CACHE_HOME", "")
    if not os.path.isabs(base):  # as the XDG Base Directory Specification says
        try:
            base = Path.home() / ".cache"
        except RuntimeError:  # a user without a home
            return None
    return Path(base) / "aoro-gym"


def computed_with(*sources: Path) -> tuple[Any, ...]:
    """What bits depend on beside the inputs: versions, the instructions that NumPy chose here, and ``sources``, files or
    folders."""
    chosen = np.lib.introspect.opt_func_info(func_name="^(cos|exp|log|power|sin)$", signature="float64")
    return versions(), platform.machine(), chosen, tuple(Contents(path) for path in sources)


def cached(
    kind: str,
    parts: tuple[Any, ...],
    make: Callable[[], T],
    pack: Callable[[T], Mapping[str, Any]],
    unpack: Callable[[Mapping[str, Any]], T],
) -> T:
    """What ``make`` gives, from the cache if it is there.

    Args:
        kind: What it is; a folder of the cache.
        parts: All that it depends on, versions and sources included; see :func:`~aoro_gym.execution.digest.digest`.
        make: Makes it.
        pack: Arrays by name that hold it.
        unpack: The same from such arrays; what it raises for damaged ones only has it made again.
    """
    folder = cache_folder()
    if folder is None:
        return make()
    path = _file(folder, kind, parts)
    arrays = read_arrays(path)
    if arrays is not None:
        with suppress(Exception):  # whatever damaged arrays lead to
            if sorted(arrays.pop(NAMES).tolist()) == sorted(arrays):
                result = unpack(arrays)
                with suppress(OSError):
                    os.utime(path)  # the oldest use goes first
                return result
    result = make()
    arrays = {name: np.asarray(value) for name, value in pack(result).items()}
    if sum(array.nbytes for array in arrays.values()) <= LARGEST_RESULT:
        write_arrays(path, {**arrays, NAMES: np.array(sorted(arrays))})
        _shrink(folder)
    return result


def is_kept(kind: str, parts: tuple[Any, ...]) -> bool:
    """Whether there is a file of what :func:`cached` gives for these; it may be damaged."""
    folder = cache_folder()
    return folder is not None and _file(folder, kind, parts).exists()


def _file(folder: Path, kind: str, parts: tuple[Any, ...]) -> Path:
    return folder / kind / f"{digest(kind, *parts)}.npz"


def _shrink(folder: Path, largest: int | None = None) -> None:
    """Remove what was not used for longest until the rest fits into ``largest`` bytes."""
    found = []
    for path in folder.glob("*/*.npz"):
        with suppress(OSError):  # another process may have removed it
            status = path.stat()
            found.append((status.st_mtime, status.st_size, path))
    total = sum(size for _, size, _ in found)
    for age, size, path in sorted(found):
        if total <= (LARGEST if largest is None else largest):
            break
        if path.name.startswith(".") and time.time() - age < 60.0:
            continue  # being written
        with suppress(OSError):
            path.unlink()
        total -= size
