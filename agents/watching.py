"""What looks on while Stable-Baselines3 learns: the steps done, the log of the episodes, and reports of progress."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from stable_baselines3.common.callbacks import BaseCallback  # pyright: ignore[reportMissingImports]

REPORT_EVERY = 0.5
"""Time [s] between two reports of progress."""


@dataclass(frozen=True)
class Progress:
    """Where a training stands."""

    steps: int
    total: int
    steps_per_s: float
    episode_return: float
    """Mean of the last episodes; NaN before the first one has ended, as ``success``."""
    success: float
    """Share of them."""
    doing: str


class Clock:
    """Steps done of a whole training, which schedules follow: ``learn`` knows only those of its own call.

    Args:
        total: Steps of the training.
    """

    def __init__(self, total: int):
        self.total = total
        self.done = 0

    def linear(self, first: float) -> Callable[[float], float]:
        """A schedule for Stable-Baselines3 that falls from ``first`` to 0 over the training."""
        return lambda _: first * max(1.0 - self.done / self.total, 0.0)


class Watch(BaseCallback):
    """Moves the clock, logs the reward terms of episodes that ended, and tells where the training stands.

    Args:
        clock: To move.
        tell: Whom to tell.
        every: Least time [s] between two reports.
    """

    def __init__(self, clock: Clock, tell: Callable[[Progress], Any], *, every: float):
        super().__init__()
        self._clock, self._tell, self._every = clock, tell, every
        self._began, self._first, self._told = time.perf_counter(), clock.done, -math.inf

    def _on_step(self) -> bool:
        self._clock.done = self.num_timesteps
        for info in self.locals["infos"]:
            if info:
                for name, value in info.items():
                    if name.startswith("return/"):
                        self.logger.record_mean(f"terms/{name.removeprefix('return/')}", value)
        if time.perf_counter() - self._told >= self._every:
            self.report("learning")
        return True

    def report(self, doing: str) -> None:
        """Tell where the training stands, and what is being done."""
        self._told = time.perf_counter()
        returns = [one["r"] for one in self.model.ep_info_buffer or ()]
        success = self.model.ep_success_buffer or ()
        self._tell(
            Progress(
                self._clock.done,
                self._clock.total,
                (self._clock.done - self._first) / max(self._told - self._began, 1e-9),
                float(np.mean(returns)) if returns else math.nan,
                float(np.mean(success)) if success else math.nan,
                doing,
            )
        )
