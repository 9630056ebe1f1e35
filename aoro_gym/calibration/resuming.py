"""A calibration that was ended goes on where it was: its folder, what it was begun with, and its parts that are kept."""

from __future__ import annotations

import shutil
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from aoro_gym.execution.digest import Contents
from aoro_gym.execution.locking import locked
from aoro_gym.execution.provenance import PROVENANCE, check_provenance


def unfinished_folder(out: Path) -> Path:
    """Folder beside the machine file ``out`` that holds the parts of its calibration until it is written."""
    return out.with_name(f"{out.name}.unfinished")


@contextmanager
def resumable(
    folder: Path | None, inputs: Mapping[str, Any], *, restart: bool = False, accept_code_change: bool = False
) -> Iterator[list[str]]:
    """Hold ``folder`` for a calibration that follows from ``inputs``, and give the changes of code that were accepted.

    Without a folder nothing is kept.

    Args:
        folder: Where parts are kept; made if it is missing.
        inputs: Everything that the calibration follows from; see :func:`check_provenance`.
        restart: Remove what was kept.
        accept_code_change: Go on with changed code, which is recorded.

    Raises:
        FolderInUse: another process works in it.
        ChangedInput: it was begun with other inputs, which are named.
        ChangedCode: the code has changed since, and that is not accepted.
    """
    if folder is None:
        yield []
        return
    with locked(folder):
        if restart:
            discard_parts(folder)
        begun = any(folder.glob("search*.json"))
        yield check_provenance(folder / PROVENANCE, inputs, begun=begun, accept_code_change=accept_code_change)


def discard_parts(folder: Path) -> None:
    """Remove what is kept in ``folder``, which this process holds; the record last."""
    for path in sorted(folder.glob("*.json")):
        if not path.name.startswith(".") and path.name != PROVENANCE:
            path.unlink()
    (folder / PROVENANCE).unlink(missing_ok=True)


def remove_folder(folder: Path) -> None:
    """Remove the folder of a calibration that is written."""
    shutil.rmtree(folder, ignore_errors=True)


def log_inputs(logs: Sequence[Path]) -> dict[str, Contents]:
    """The contents of each log, and of the manifest beside it."""
    inputs = {}
    for number, path in enumerate(logs, 1):
        inputs[f"{number} {path.name}"] = Contents(path)
        manifest = path.with_suffix(".toml")
        if manifest.is_file():
            inputs[f"{number} {manifest.name}"] = Contents(manifest)
    return inputs
