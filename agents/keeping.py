"""Episodes that are kept on disc while an evaluation runs, so that one that was killed goes on where it was.

What a policy does in some episodes follows from the policy, the seeds, the machines, the grounds, the device and the
sources. A file is named by a digest of all these, so that what is read is what would be driven. Of a policy or a reward of
your own the digest knows the name and the values, not the source: clear the folder when you change that.
"""

from __future__ import annotations

import hashlib
import pickle
import shutil
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from aoro_gym.kept import read_arrays, sources, write_arrays
from aoro_gym.twin import Machine

FOLDER = ".episodes"
"""In that of the result."""
PACKAGES = "twin", "terrains", "envs", "agents"
"""Of aoro_gym: their sources make episodes what they are."""


@contextmanager
def resumable(out: Path) -> Iterator[Path]:
    """A folder beside the result in ``out`` to keep episodes in; it goes once the context ends well."""
    yield out / FOLDER
    shutil.rmtree(out / FOLDER, ignore_errors=True)


class Kept:
    """Reads and writes episodes.

    Args:
        folder: Where they are kept, made with the first; None keeps nothing.
        about: What all of them have in common; what cannot be pickled is not told apart from anything, so nothing is kept
            then.
    """

    def __init__(self, folder: Path | None, *about: Any):
        self._folder = folder
        self._origin = hashlib.sha256()
        if folder is not None:
            self._origin.update(sources(PACKAGES).encode())
            self._tell(self._origin, about)

    def find(self, policy: Any, seeds: Sequence[int], machine: Machine) -> dict[str, Any] | None:
        """Arrays that were kept of what ``policy`` did with ``seeds`` on the machines that were drawn for them."""
        path = self._path(policy, seeds, machine)
        return None if path is None else read_arrays(path)

    def keep(self, policy: Any, seeds: Sequence[int], machine: Machine, arrays: Mapping[str, Any]) -> None:
        """Keep ``arrays`` for :meth:`find`."""
        path = self._path(policy, seeds, machine)
        if path is not None:
            write_arrays(path, arrays)

    def _path(self, policy: Any, seeds: Sequence[int], machine: Machine) -> Path | None:
        if self._folder is None:
            return None
        total = self._origin.copy()
        self._tell(total, (policy, list(seeds), {key: entry.value for key, entry in machine.entries.items()}))
        return None if self._folder is None else self._folder / f"{total.hexdigest()}.npz"

    def _tell(self, total: Any, what: Any) -> None:
        try:
            total.update(pickle.dumps(what))
        except (pickle.PicklingError, AttributeError, TypeError):
            self._folder = None
