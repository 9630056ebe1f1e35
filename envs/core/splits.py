"""Courses by seed and difficulty, in three parts that share none: those to learn on, those that trainings are evaluated on,
and those that are held out.

>>> from aoro_gym.envs.core.splits import Splits
>>> splits = Splits(lambda seed, difficulty: (seed, difficulty), least_difficulty=0.5)
>>> splits.learned(3)
((0, 0.5), (1, 0.75), (2, 1.0))
>>> splits.held_out(1)
((1000, 0.5),)
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import Any, Generic, TypeVar

import numpy as np

from aoro_gym.checks import check_range

T = TypeVar("T")
LEARNED, VALIDATED, HELD_OUT = 8, 8, 40
"""Courses of each part."""


@dataclass(frozen=True)
class Splits(Generic[T]):
    """The three parts of an environment's courses, each from easy to difficult; a course is made once a process."""

    make: Callable[[int, float], T]
    """Makes a course from its seed and its difficulty."""
    least_difficulty: float
    """Of the first course of each part; that of the last one is 1."""
    validation_seed: int = 500
    """Of the first course that trainings are evaluated on; those that are learned on have the seeds from 0 on."""
    held_out_seed: int = 1000
    """Of the first one that is held out."""

    def learned(self, count: int = LEARNED) -> tuple[T, ...]:
        """Courses to learn and to tune on.

        Raises ValueError if there would be none, or one that trainings are evaluated on.
        """
        check_range("number of courses to learn on", count, ge=1, le=self.validation_seed)
        return self._from(0, count)

    def asked(self, count: int) -> list[tuple[int, float]]:
        """Seeds and difficulties of so many courses to learn on, which make them; raises as :meth:`learned`."""
        check_range("number of courses to learn on", count, ge=1, le=self.validation_seed)
        return _asked(self.least_difficulty, 0, count)

    def asked_to_validate(self) -> list[tuple[int, float]]:
        """The same of the courses of :meth:`validation`."""
        return _asked(self.least_difficulty, self.validation_seed, VALIDATED)

    def validation(self) -> tuple[T, ...]:
        """Courses that the evaluations of a training drive on, which choose its best policy."""
        return self._from(self.validation_seed, VALIDATED)

    def held_out(self, count: int = HELD_OUT) -> tuple[T, ...]:
        """Courses that nobody learns or is tuned on."""
        return self._from(self.held_out_seed, count)

    def _from(self, first: int, count: int) -> tuple[T, ...]:
        return _made(self.make, self.least_difficulty, first, count)


@cache
def _made(make: Callable[[int, float], Any], least: float, first: int, count: int) -> tuple[Any, ...]:
    """As many courses, of seeds from ``first`` on."""
    return tuple(make(*one) for one in _asked(least, first, count))


def _asked(least: float, first: int, count: int) -> list[tuple[int, float]]:
    """Seed and difficulty of each."""
    shares = np.round(np.linspace(least, 1.0, count), 3).tolist()
    return [(first + number, share) for number, share in enumerate(shares)]
