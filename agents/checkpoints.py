"""All that a training has learned and drawn so far, in one file that holds no code.

A checkpoint is taken between two rollouts, when all environments begin anew: what they would draw next is then in the seeds
of the restart, and networks, optimisers, normalisation, replay buffer, counters and random states are all that there is.
It is written whole or not at all, and read by torch with ``weights_only``, which builds tensors and plain values only.
"""

from __future__ import annotations

import json
import random
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import torch  # pyright: ignore[reportMissingImports]


def save_checkpoint(path: Path, state: Mapping[str, Any], notes: Mapping[str, Any]) -> None:
    """Write what a learner gives as its ``state`` (tensors and plain values), and ``notes`` that JSON can hold."""
    path.parent.mkdir(parents=True, exist_ok=True)
    partial = path.with_name(f"{path.name}.partial")
    torch.save({**state, "notes": json.dumps(notes)}, partial)
    partial.replace(path)


def load_checkpoint(path: Path) -> tuple[dict[str, Any], dict[str, Any]]:
    """The state, on the host, and the notes."""
    content = torch.load(path, map_location="cpu", weights_only=True)
    return content, json.loads(content.pop("notes"))


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
