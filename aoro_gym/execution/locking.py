"""Locks of output folders: one run at a time writes into a folder, and a second one is told who does."""

from __future__ import annotations

import json
import os
import platform
import shutil
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from datetime import UTC, datetime
from pathlib import Path

from filelock import FileLock, Timeout

from aoro_gym.execution.files import LOCK, remove_partial_files, write_json

HOLDER = ".lock.json"
"""In a locked folder: who holds it."""


class FolderInUse(ValueError):
    """Another run writes into the folder."""


@contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Hold ``folder`` for this process until the context ends; it is made if it is missing.

    The lock goes with its process, however that ends. What a killed holder left unfinished is removed. A process may lock
    a folder that it holds already: the lock is freed when the outermost context ends. A folder that was made here goes
    again if an error ends the context before anything is written there.

    Raises:
        FolderInUse: another process holds it; the message names process, host, command and since when.
    """
    is_new = not folder.exists()
    folder.mkdir(parents=True, exist_ok=True)
    lock = FileLock(folder / LOCK, timeout=0.0, is_singleton=True, thread_local=False)
    try:
        lock.acquire()
    except Timeout:
        raise FolderInUse(f"{folder} is in use by {_holder(folder)}; wait for it, or name another folder") from None
    try:
        if lock.lock_counter == 1:
            remove_partial_files(folder)
            with suppress(OSError):  # who holds it is a help, not a condition
                write_json(folder / HOLDER, _this_process())
        yield
    except BaseException:
        if is_new and folder.is_dir() and {file.name for file in folder.iterdir()} <= {LOCK, HOLDER}:
            shutil.rmtree(folder, ignore_errors=True)
        raise
    finally:
        if lock.lock_counter == 1:
            (folder / HOLDER).unlink(missing_ok=True)
        lock.release()


def _this_process() -> dict[str, str | int]:
    return {
        "pid": os.getpid(),
        "host": platform.node(),
        "command": " ".join([Path(sys.argv[0]).name, *sys.argv[1:]])[:500],
        "since": datetime.now(UTC).isoformat(timespec="seconds"),
    }


def _holder(folder: Path) -> str:
    """Who holds ``folder``, as far as it has said."""
    try:
        about = json.loads((folder / HOLDER).read_text(encoding="utf-8"))
        return f"process {about['pid']} on {about['host']} ({about['command']}, since {about['since']})"
    except (OSError, ValueError, KeyError, TypeError):
        return "another process"
