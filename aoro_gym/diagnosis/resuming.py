"""Launches that are kept on disk while a diagnosis runs, so that one that was killed goes on where it was.

A diagnosis is deterministic, and nearly all of its time goes into launches. Begun again it asks for the same ones in the
same order, and those that were kept cost no more than to read them. With the whole catalogue they take about 2 MB a signal
and second of log until the diagnosis is done; compressed it would be two thirds.
"""

from __future__ import annotations

import shutil
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import fields
from pathlib import Path
from typing import Any

import warp as wp

from aoro_gym.diagnosis.replay import Request, Signals, Simulator
from aoro_gym.execution.arrays import read_arrays, write_arrays
from aoro_gym.execution.digest import digest
from aoro_gym.execution.locking import locked
from aoro_gym.execution.provenance import PROVENANCE, check_provenance

FOLDER = ".launches"
"""In that of the result."""


@contextmanager
def resumable(
    device: str,
    out: Path,
    inputs: Mapping[str, Any] | None = None,
    *,
    restart: bool = False,
    accept_code_change: bool = False,
) -> Iterator[Kept]:
    """Hold ``out`` and give a simulator that keeps its launches beside the result there until the context ends well.

    Args:
        device: See :class:`Simulator`.
        out: Folder of the result.
        inputs: What the diagnosis follows from, by name; an unfinished one that was begun with others is refused.
        restart: Forget what an unfinished one has kept.
        accept_code_change: Go on with what was kept by other code, and record that.

    Raises:
        FolderInUse: another process writes into ``out``.
        ChangedInput, ChangedCode: see :func:`~aoro_gym.execution.provenance.check_provenance`.
    """
    with locked(out):
        folder = out / FOLDER
        if restart:
            shutil.rmtree(folder, ignore_errors=True)
        asked = {"device": device, "processor": wp.get_device(device).name, **(inputs or {})}
        begun = any(folder.glob("*.npz"))
        changes = check_provenance(folder / PROVENANCE, asked, begun=begun, accept_code_change=accept_code_change)
        try:
            yield Kept(device, folder, changes)
        except BaseException:
            if not any(folder.glob("*.npz")):  # nothing to go on from
                shutil.rmtree(folder, ignore_errors=True)
            raise
        shutil.rmtree(folder, ignore_errors=True)


class Kept(Simulator):
    """Keeps what it launches, and reads what was kept.

    Files are numbered, and named by a digest of all requests and the device. Where an earlier run was another one, what it
    kept from there on is removed, so that a folder never holds more than one run.

    Args:
        device: See :class:`Simulator`.
        folder: Where launches are kept; it is made with the first.
        code_changes: What of the code differs from that of launches which were kept before, in words.
    """

    def __init__(self, device: str, folder: Path, code_changes: Sequence[str] = ()):
        super().__init__(device)
        self.code_changes = tuple(code_changes)
        self._folder = folder
        self._launches = 0
        self._processor = wp.get_device(device).name

    def launch_together(self, requests: Sequence[Request]) -> list[Signals]:
        """See :meth:`Simulator.launch_together`."""
        number, self._launches = self._launches, self._launches + 1
        path = self._folder / f"{number:04d}-{self._digest(requests)}.npz"
        found = _read(path, requests)
        if found is None:
            for other in self._folder.glob("[0-9]*-*.npz"):
                if int(other.name.partition("-")[0]) >= number:
                    other.unlink(missing_ok=True)
            found = super().launch_together(requests)
            _write(path, found)
        return found

    def _digest(self, requests: Sequence[Request]) -> str:
        machines = {id(one.machine): one.machine for one in requests}  # recordings are repeated by the same variants
        known = {key: digest(machine.identity) for key, machine in machines.items()}
        parts = [
            {"machine": known[id(one.machine)]}
            | {field.name: getattr(one, field.name) for field in fields(one) if field.name != "machine"}
            for one in requests
        ]
        return digest(self.device, self._processor, parts)


def _read(path: Path, requests: Sequence[Request]) -> list[Signals] | None:
    """What was kept; None if nothing was, or not whole."""
    arrays = read_arrays(path) or {}
    try:
        return [{name: arrays[f"{i} {name}"] for name in one.channels} for i, one in enumerate(requests)]
    except KeyError:
        return None


def _write(path: Path, found: Sequence[Signals]) -> None:
    write_arrays(path, {f"{i} {name}": values for i, one in enumerate(found) for name, values in one.items()})
