"""Grades of key figures by repeated turns: excellent, good, or missed.

A figure of the twin is *excellent* where it could be one more run of the machine: it lies within the 95 % prediction
interval of the repeats, mean ± t s √(1 + 1/n) with Student's t of n - 1 degrees of freedom (Hahn and Meeker, Statistical
Intervals, 1991). It is *good* where it is not, but within the bound that the validation has for that figure, and else
*missed*. The two words are the publication's; their bounds are ours (E), for of its run-to-run spread nothing was published.
Fewer than three repeats give no grade: of two the interval is nine spreads wide.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.stats import t as student

from aoro_gym.sensors.chain import SAMPLE_RATE
from aoro_gym.validation.study import TARGETS

LEAST_REPEATS = 3
"""Turns of one level and direction that grades need."""
COVERAGE = 0.95
"""Share of further runs that the interval of the repeats holds."""
GRADES = ("excellent", "good", "missed")
TICK_STD = 1.0 / SAMPLE_RATE / np.sqrt(12.0)
"""Standard deviation [s] of an instant that is read from samples."""


@dataclass(frozen=True)
class Grade:
    """How near a figure of the twin is to that of repeated turns."""

    figure: str
    repeats: int
    mean: float
    std: float
    """Between runs, that of the ticks at least."""
    run_to_run: float
    """Half width of the interval that a further run falls into."""
    bound: float
    """Of the validation, in the figure's unit."""
    twin: float | None
    grade: str

    @property
    def deviation(self) -> float | None:
        """Of the twin from the mean, in the figure's unit."""
        return None if self.twin is None else self.twin - self.mean


def least_std(figure: str, values: NDArray[np.float64], turn_time: float) -> float:
    """Standard deviation that ticks of :data:`SAMPLE_RATE` alone give a figure; of a mean flow by the turn's time [s]."""
    if figure == "mean_flow_L_per_min":
        return float(np.mean(values)) * TICK_STD / turn_time
    return TICK_STD if figure.endswith("_s") else 0.0


def half_width(std: float, repeats: int) -> float:
    """How far from the mean of ``repeats`` runs a further one falls, in :data:`COVERAGE` of all cases."""
    return float(student.ppf(0.5 + 0.5 * COVERAGE, repeats - 1)) * std * float(np.sqrt(1.0 + 1.0 / repeats))


def graded(figure: str, repeats: ArrayLike, twin: float, *, turn_time: float) -> Grade | None:
    """The grade of a figure, None where there are fewer than :data:`LEAST_REPEATS` repeats that have it.

    Args:
        figure: One of :data:`~aoro_gym.simulation.key_figures.FIGURES`.
        repeats: Values of the machine's turns (n,), NaN where a turn has none.
        twin: Value of the twin's turn, as noisy as theirs in the mean, NaN where it has none, which is missed.
        turn_time: Mean time [s] of these turns.
    """
    values = np.asarray(repeats, dtype=np.float64)
    values = values[np.isfinite(values)]
    count = len(values)
    if count < LEAST_REPEATS:
        return None
    mean = float(np.mean(values))
    std = max(float(np.std(values, ddof=1)), least_std(figure, values, turn_time))
    kind, limit = TARGETS[figure]
    bound = limit * abs(mean) if kind == "relative" else limit
    width = half_width(std, count)
    miss = abs(twin - mean) if np.isfinite(twin) else np.inf
    grade = GRADES[0] if miss <= width else GRADES[1] if miss <= bound else GRADES[2]
    return Grade(figure, count, mean, std, width, bound, float(twin) if np.isfinite(twin) else None, grade)


def sentence(grades: Sequence[Grade]) -> str:
    """How many figures have which grade."""
    counts = ", ".join(f"{sum(one.grade == grade for one in grades)} {grade}" for grade in GRADES)
    return f"key figures of turns with {LEAST_REPEATS} repeats or more: {counts}"
