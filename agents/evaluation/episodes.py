"""What a policy did in several episodes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from aoro_gym.agents.evaluation.metrics import BOUNDED
from aoro_gym.agents.evaluation.statistics import Floats

TIME_IS_UP = "time is up"
"""Ending of an episode that was truncated."""
METRIC_PREFIX = "figure "
"""Before the name of a metric in a file."""


@dataclass(frozen=True)
class Episodes:
    """What one policy did in N episodes."""

    metrics: Mapping[str, Floats]
    """By name, (N,); NaN where an episode has none."""
    endings: list[str]
    """(N,)"""
    course: NDArray[np.intp]
    """(N, 2) which course, and which of its paths."""
    errors: Floats
    """(N, K) magnitude of the error along the episode, at multiples of the task's ``interval``; NaN beyond the end."""
    places: Floats
    """(N, K, 2) where the vehicle's reference point was [m]; no rows where the task is no drive."""
    film: NDArray[np.float32]
    """(T, channels) of the first episode, as a task's scene draws them."""

    def __repr__(self) -> str:
        return f"Episodes({len(self.endings)}, {len(self.metrics)} metrics)"

    def bounded(self, name: str) -> NDArray[np.bool_]:
        """Whether a metric is a lower bound, (N,)."""
        if name not in BOUNDED:
            return np.zeros(len(self.endings), dtype=bool)
        return self.metrics[BOUNDED[name]] < 1.0

    def exact(self, name: str) -> Floats:
        """A metric (N,), NaN where it is a lower bound: of those no difference says anything."""
        return np.where(self.bounded(name), np.nan, self.metrics[name])

    def joined(self, other: Episodes) -> Episodes:
        """These episodes, then the ``other`` ones; the film is the first one's."""
        width = max(self.errors.shape[1], other.errors.shape[1])

        def wide(values: Floats) -> Floats:
            lacking = [(0, width - n if axis == 1 else 0) for axis, n in enumerate(values.shape)]
            return np.pad(values, lacking, constant_values=np.nan)

        return Episodes(
            {name: np.concatenate([values, other.metrics[name]]) for name, values in self.metrics.items()},
            self.endings + other.endings,
            np.concatenate([self.course, other.course]),
            np.concatenate([wide(self.errors), wide(other.errors)]),
            np.concatenate([wide(self.places), wide(other.places)]),
            self.film,
        )

    def part(self, which: slice) -> Episodes:
        """Some of these episodes; the film stays."""
        metrics = {name: values[which] for name, values in self.metrics.items()}
        return Episodes(
            metrics, self.endings[which], self.course[which], self.errors[which], self.places[which], self.film
        )

    def arrays(self) -> dict[str, NDArray[Any]]:
        """All of it by name, as a file without code can hold it."""
        metrics = {METRIC_PREFIX + name: values for name, values in self.metrics.items()}
        endings = np.array(self.endings, dtype=np.str_)
        return metrics | {
            "endings": endings, "course": self.course, "errors": self.errors, "places": self.places, "film": self.film,
        }  # fmt: skip

    @classmethod
    def of(cls, arrays: Mapping[str, NDArray[Any]]) -> Episodes:
        """What :meth:`arrays` were of."""
        metrics = {name.removeprefix(METRIC_PREFIX): arrays[name] for name in arrays if name.startswith(METRIC_PREFIX)}
        rest = (arrays[name] for name in ("course", "errors", "places", "film"))
        return cls(metrics, arrays["endings"].tolist(), *rest)


def reset_arguments(
    seeds: list[int], asked: list[int] | None, options: Mapping[str, Any] | None = None
) -> dict[str, Any]:
    """Arguments of a reset by ``seeds`` and further ``options``, or of what ``asked`` (seeds, too) ask for with the sensors'
    errors of ``seeds``."""
    options = {} if options is None else dict(options)
    if asked is not None:
        options["sensor_seed"] = np.array(seeds)
    return {"seed": seeds if asked is None else asked, "options": options}
