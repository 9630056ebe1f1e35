"""Launches that are kept on disc while a diagnosis runs, so that one that was killed goes on where it was.

A diagnosis is deterministic, and nearly all of its time goes into launches. Begun again it asks for the same ones in the
same order, and those that were kept cost no more than to read them. With the whole catalogue they take about 2 MB a signal
and second of log until the diagnosis is done; compressed it would be two thirds.
"""

from __future__ import annotations

import hashlib
import shutil
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import fields
from pathlib import Path

import numpy as np
import warp as wp
from numpy.typing import ArrayLike

from aoro_gym.diagnosis.replay import Request, Signals, Simulator
from aoro_gym.kept import read_arrays, sources, write_arrays
from aoro_gym.twin import Machine

FOLDER = ".launches"
"""In that of the result."""
PACKAGES = "twin", "terrains", "diagnosis"
"""Of aoro_gym: their sources make a launch what it is."""


@contextmanager
def resumable(device: str, out: Path) -> Iterator[Simulator]:
    """A simulator that keeps its launches beside the result in ``out`` until the context ends well."""
    yield Kept(device, out / FOLDER)
    shutil.rmtree(out / FOLDER, ignore_errors=True)


class Kept(Simulator):
    """Keeps what it launches, and reads what was kept.

    Files are numbered, and named by a digest of all that a launch follows from: requests, device, sources. Where an earlier
    run was another one, what it kept from there on is removed, so that a folder never holds more than one run.

    Args:
        device: See :class:`Simulator`.
        folder: Where launches are kept; it is made with the first.
    """

    def __init__(self, device: str, folder: Path):
        super().__init__(device)
        self._folder = folder
        self._launches = 0
        origin = f"{sources(PACKAGES)} {device} {wp.get_device(device).name}"
        self._origin = hashlib.sha256(origin.encode())

    def launch_together(self, requests: Sequence[Request]) -> list[Signals]:
        """See :meth:`Simulator.launch_together`."""
        number, self._launches = self._launches, self._launches + 1
        path = self._folder / f"{number:04d}-{self._digest(requests)}.npz"
        found = _read(path, requests)
        if found is None:
            for other in self._folder.glob("*-*.npz*"):
                if int(other.name.partition("-")[0]) >= number:
                    other.unlink(missing_ok=True)
            found = super().launch_together(requests)
            _write(path, found)
        return found

    def _digest(self, requests: Sequence[Request]) -> str:
        total = self._origin.copy()
        machines: dict[int, bytes] = {}  # recordings are repeated by the same variants
        for one in requests:
            if id(one.machine) not in machines:
                machines[id(one.machine)] = _of_machine(one.machine)
            total.update(machines[id(one.machine)])
            for part in (one.start, one.commands, *(getattr(one.plane, field.name) for field in fields(one.plane))):
                total.update(_of_numbers(part))
            total.update(f"{one.channels} {one.frames} {one.steps}".encode())
            for part in (one.measured, one.zeros):
                total.update(b"" if part is None else _of_numbers(part))
        return total.hexdigest()


def _of_machine(machine: Machine) -> bytes:
    total = hashlib.sha256()
    for key, entry in machine.entries.items():
        total.update(f"{key} {entry.unit} ".encode() + _of_numbers(entry.value))
    return total.digest()


def _of_numbers(values: ArrayLike) -> bytes:
    numbers = np.asarray(values, dtype=np.float64)
    return f"{numbers.shape} ".encode() + numbers.tobytes()


def _read(path: Path, requests: Sequence[Request]) -> list[Signals] | None:
    """What was kept; None if nothing was, or not whole."""
    arrays = read_arrays(path) or {}
    try:
        return [{name: arrays[f"{i} {name}"] for name in one.channels} for i, one in enumerate(requests)]
    except KeyError:
        return None


def _write(path: Path, found: Sequence[Signals]) -> None:
    write_arrays(path, {f"{i} {name}": values for i, one in enumerate(found) for name, values in one.items()})
