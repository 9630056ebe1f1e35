"""Arrays on disc that follow from sources, so that work that was killed goes on where it was."""

from __future__ import annotations

import hashlib
import zipfile
from collections.abc import Iterable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import warp as wp

import aoro_gym


def sources(packages: Iterable[str]) -> str:
    """Digest of the versions of aoro_gym and Warp, and of all sources of aoro_gym's ``packages``."""
    total = hashlib.sha256(f"{aoro_gym.__version__} {wp.config.version}".encode())
    for package in packages:
        for path in sorted((Path(aoro_gym.__file__).parent / package).rglob("*.py")):
            total.update(path.read_bytes())
    return total.hexdigest()


def read_arrays(path: Path) -> dict[str, Any] | None:
    """What :func:`write_arrays` wrote; None if nothing was, or not whole."""
    try:
        with path.open("rb") as file, np.load(file) as arrays:
            return dict(arrays)
    except (OSError, ValueError, EOFError, zipfile.BadZipFile):
        return None


def write_arrays(path: Path, arrays: Mapping[str, Any]) -> None:
    """Whole or not at all, and without an error: a full disc is no reason to end the work. Missing folders are made."""
    partial = path.with_name(f"{path.name}.partial")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with partial.open("wb") as file:
            np.savez(file, **arrays)
        partial.replace(path)
    except OSError:
        with suppress(OSError):
            partial.unlink()
