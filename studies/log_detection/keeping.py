"""A training that is not done, kept on the disk so that it goes on where it was."""

from __future__ import annotations

import copy
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import torch
from torch import Tensor, nn

from aoro_gym.execution.files import written_whole

EVERY = 60.0
"""Time [s] after which a training is kept again."""


@dataclass
class Keeping:
    """Where a training is kept, and who is told of it meanwhile."""

    file: Path
    every: float = EVERY
    """[s]"""
    told: Callable[[int, Any], Any] | None = None
    """Told the batches that are done and a copy of the detector, ready to be scored, each time that it is kept."""
    _last: float = field(default_factory=time.monotonic)

    def restore(
        self, course: Mapping[str, Any], parts: Mapping[str, Any], draw: torch.Generator
    ) -> tuple[int, Tensor | None]:
        """Batches that are done and the mean loss of late, after all is as it was; 0 and None where nothing is kept.

        Args:
            course: What the training is of; what was kept of another one is not taken.
            parts: Network, optimiser and schedule, which take their states.
            draw: Of batches and variations.
        """
        try:
            kept = torch.load(self.file, map_location="cpu", weights_only=True)
            if kept["course"] != dict(course):
                return 0, None
        except Exception:  # whatever torch makes of a file that is missing or damaged
            return 0, None
        for name, part in parts.items():
            part.load_state_dict(kept["states"][name])
        draw.set_state(kept["draw"])
        return int(kept["done"]), kept["recent"]

    def keep(
        self, course: Mapping[str, Any], parts: Mapping[str, Any], draw: torch.Generator, done: int, recent: Tensor
    ) -> None:
        """Write it, if it is time to.

        Args:
            course: What the training is of.
            parts: Network first, optimiser and schedule.
            draw: Of batches and variations.
            done: Batches.
            recent: Mean loss of late.
        """
        if time.monotonic() - self._last < self.every:
            return
        states = {name: part.state_dict() for name, part in parts.items()}
        kept = {
            "course": dict(course),
            "states": states,
            "draw": draw.get_state(),
            "done": done,
            "recent": recent.cpu(),
        }
        with written_whole(self.file) as temporary:
            torch.save(kept, temporary)
        if self.told is not None:
            network: nn.Module = next(iter(parts.values()))
            self.told(done, copy.deepcopy(network).cpu().eval())
        self._last = time.monotonic()
