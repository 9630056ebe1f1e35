"""Episodes that are kept on disk while an evaluation runs, so that one that was killed goes on where it was.

What a policy does in some episodes follows from the policy, the seeds, the machines, the grounds, the rewards, the device
and the sources. A file is named by a digest of all these, so that what is read is what would be driven. Policies and rewards
of one's own count by their source and their state; those that cannot be told apart are driven again.
"""

from __future__ import annotations

import shutil
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from aoro_gym.agents.evaluation.episodes import Episodes
from aoro_gym.agents.evaluation.inputs import machine_values, policy_content
from aoro_gym.execution.arrays import read_arrays, write_arrays
from aoro_gym.execution.digest import code_digest, digest
from aoro_gym.execution.locking import locked
from aoro_gym.execution.provenance import PROVENANCE, accepted_code_changes, check_provenance
from aoro_gym.machine import Machine

FOLDER = ".episodes"
"""In that of the result."""


@contextmanager
def resumable(
    out: Path, inputs: Mapping[str, Any], *, restart: bool = False, accept_code_change: bool = False
) -> Iterator[Path]:
    """A folder beside the result in ``out`` to keep episodes in; it goes once the context ends well. ``out`` is locked.

    Args:
        out: The result's folder.
        inputs: By name, all that the result depends on.
        restart: Whether to forget what an interrupted run has kept.
        accept_code_change: Whether to go on with what other code has kept; the record in the folder then tells of it.

    Raises:
        FolderInUse: another process writes to ``out``.
        ChangedInput: an interrupted run has kept episodes of other inputs, which the message names.
        ChangedCode: likewise of other code.
    """
    folder = out / FOLDER
    with locked(out):
        if restart or not any(folder.glob("*.npz")):
            shutil.rmtree(folder, ignore_errors=True)
        check_provenance(folder / PROVENANCE, inputs, accept_code_change=accept_code_change)
        yield folder
        shutil.rmtree(folder, ignore_errors=True)


def accepted(folder: Path) -> dict[str, Any]:
    """What a result says of other code that has driven some of the episodes that are kept in ``folder``."""
    found = accepted_code_changes(folder / PROVENANCE)
    return {"accepted_code_changes": found} if found else {}


class EpisodeCache:
    """Cache of episodes on disk.

    Args:
        folder: Where they are kept, made with the first; None keeps nothing. In one of :func:`resumable`, whose record says
            which code has driven them, the code is no part of a file's name.
        about: What all of them have in common.
    """

    def __init__(self, folder: Path | None, *about: Any):
        self._folder = folder
        self._origin = ""
        if folder is not None:
            code = None if (folder / PROVENANCE).exists() else code_digest()
            self._origin = self._digest(code, about)

    def file(self, policy: Any, seeds: Sequence[int], machine: Machine) -> Path | None:
        """File for what ``policy`` does with ``seeds`` on the machines that were drawn for them; None if it cannot be told
        apart. Ask before it drives, which may change it."""
        if self._folder is None:
            return None
        name = self._digest(self._origin, policy_content(policy), list(seeds), machine_values(machine))
        return None if self._folder is None else self._folder / f"{name}.npz"

    def read(self, file: Path | None) -> Episodes | None:
        """Episodes of ``file``; None if there are none, or they are damaged."""
        arrays = None if file is None else read_arrays(file)
        return None if arrays is None else Episodes.of(arrays)

    def write(self, file: Path | None, episodes: Episodes) -> None:
        """Write ``episodes`` for :meth:`read`."""
        if file is not None:
            write_arrays(file, episodes.arrays())

    def _digest(self, *what: Any) -> str:
        try:
            return digest(*what)
        except TypeError:
            self._folder = None
            return ""
