"""What looks on while a policy learns: the steps done, what follows from them, and reports of progress."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

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
    part: float | None = None
    """Share of what is being done before the first step; None while steps are."""


class StepCounter:
    """Steps done of a whole training, which schedules follow: who learns knows only those of the running part.

    Args:
        total: Steps of the training.
    """

    def __init__(self, total: int):
        self.total = total
        self.done = 0

    def schedule(self, name: str, value: float | str) -> Callable[[float], float]:
        """The hyper-parameter ``name`` over the training, as Stable-Baselines3 calls it: a number, or from the one in
        ``lin_NUMBER`` down to 0.

        Raises ValueError if ``value`` is neither.
        """
        if isinstance(value, int | float):
            return lambda _: float(value)
        kind, _, number = value.partition("_")
        try:
            if kind == "lin":
                first = float(number)
                return lambda _: first * max(1.0 - self.done / self.total, 0.0)
        except ValueError:
            pass
        raise ValueError(f"{name} is {value!r}, but must be a number, or lin_NUMBER to let it fall to 0")


class ProgressCallback:
    """Moves the clock, and tells where the training stands.

    Args:
        clock: To move.
        episodes: Gives mean return and success of the last episodes, NaN before the first one has ended.
        tell: Whom to tell.
        every: Least time [s] between two reports.
    """

    def __init__(
        self,
        clock: StepCounter,
        episodes: Callable[[], tuple[float, float]],
        tell: Callable[[Progress], Any],
        *,
        every: float,
    ):
        self._clock, self._episodes, self._tell, self._every = clock, episodes, tell, every
        self._began, self._first, self._told = time.perf_counter(), clock.done, -math.inf

    def on_step(self, steps: int) -> None:
        """So many steps are done, of the whole training."""
        self._clock.done = steps
        if time.perf_counter() - self._told >= self._every:
            self.report("learning")

    def report(self, doing: str, part: float | None = None) -> None:
        """Tell where the training stands, and what is being done; ``part``: which share of it."""
        self._told = time.perf_counter()
        rate = (self._clock.done - self._first) / max(self._told - self._began, 1e-9)
        self._tell(Progress(self._clock.done, self._clock.total, rate, *self._episodes(), doing, part))
