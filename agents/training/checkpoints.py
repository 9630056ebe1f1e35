"""All that a training has learned and drawn so far, in one file that holds no code.

A checkpoint is taken between two rollouts, when all environments begin anew: what they would draw next is then in the seeds
of the restart, and networks, optimisers, normalisation, replay buffer, counters and random states are all that there is.
It is written whole or not at all, and read by torch with ``weights_only``, which builds tensors and plain values only.
"""

from __future__ import annotations

import json
import random
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
import torch  # pyright: ignore[reportMissingImports]

from aoro_gym.execution.files import written_whole


def save_checkpoint(path: Path, state: Mapping[str, Any], notes: Mapping[str, Any]) -> None:
    """Write what a learner gives as its ``state`` (tensors and plain values), and ``notes`` that JSON can hold.

    Raises OSError if the disk is full.
    """
    with written_whole(path) as temporary, temporary.open("wb") as raw:
        file: Any = _ErrorKeepingFile(raw)
        try:
            torch.save({**state, "notes": json.dumps(notes)}, file)
        except RuntimeError:  # which torch makes of whatever went wrong while it wrote
            if file.error is None:
                raise
            raise file.error from None


def load_checkpoint(path: Path) -> tuple[dict[str, Any], dict[str, Any]]:
    """The state, on the host, and the notes.

    Raises ValueError if the file is damaged.
    """
    try:
        with zipfile.ZipFile(path) as archive:  # torch itself compares no checksums
            bad = archive.testzip()
        if bad is not None:
            raise ValueError(f"the checksum of {bad} is another")
        content = torch.load(path, map_location="cpu", weights_only=True)
        return content, json.loads(content.pop("notes"))
    except OSError:
        raise
    except Exception as error:  # whatever zipfile, zlib, pickle and torch make of a damaged file
        reason = " ".join(str(error).split())[:100]
        raise ValueError(f"{path} is damaged ({reason}); restore it, or begin anew with --restart") from None


class _ErrorKeepingFile:
    """A file that keeps the error of a write."""

    def __init__(self, file: BinaryIO):
        self._file = file
        self.error: OSError | None = None

    def write(self, content: Any) -> int:
        try:
            return self._file.write(content)
        except OSError as error:
            self.error = error
            raise

    def flush(self) -> None:
        self._file.flush()


def random_states(device: torch.device) -> dict[str, Any]:
    """States of all global generators: Python's, NumPy's, and torch's on the host and on ``device``."""
    name, keys, *rest = np.random.get_state()  # noqa: NPY002 (which Stable-Baselines3 draws from)
    states = {
        "python": json.dumps(random.getstate()),
        "numpy": json.dumps([name, np.asarray(keys).tolist(), *rest]),
        "torch": torch.get_rng_state(),
    }
    if device.type == "cuda":
        states["cuda"] = torch.cuda.get_rng_state(device)
    return states


def restore_random_states(states: Mapping[str, Any], device: torch.device) -> None:
    """Give all global generators these states again."""
    version, internal, gauss = json.loads(states["python"])
    random.setstate((version, tuple(internal), gauss))
    np.random.set_state(tuple(json.loads(states["numpy"])))  # noqa: NPY002
    torch.set_rng_state(states["torch"])
    if "cuda" in states:
        torch.cuda.set_rng_state(states["cuda"], device)
