"""Arrays that are kept on disk, so that work that was ended goes on where it was."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

from aoro_gym.execution.files import written_whole


def read_arrays(path: Path) -> dict[str, Any] | None:
    """What :func:`write_arrays` wrote; None if nothing was, or it was damaged."""
    try:
        with path.open("rb") as file, np.load(file, allow_pickle=False) as arrays:
            return dict(arrays)
    except Exception:  # whatever NumPy, zipfile or zlib make of a file that is missing or damaged
        return None


def write_arrays(path: Path, arrays: Mapping[str, Any]) -> None:
    """Write ``arrays`` whole or not at all, and without an error: a full disk is no reason to end the work."""
    with suppress(OSError), written_whole(path) as temporary, temporary.open("wb") as file:
        np.savez(file, **arrays)
