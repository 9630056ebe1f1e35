"""What is fitted and what is left out."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from aoro_gym.calibration.published import LEVELS
from aoro_gym.simulation.key_figures import FIGURES
from aoro_gym.validation.shape import SHAPE
from studies.identification.figures import KNOWN, OF_TURNS, REFERENCES, ROWS, TRANSIENT, Found

ROW_NAMES = (
    *(f"{turn.signal_percent:g}:{name}" for turn in LEVELS for name in FIGURES), *SHAPE, *KNOWN
)  # fmt: skip
"""Of every row of :mod:`.figures`."""

KINDS: Mapping[str, tuple[str, ...]] = {
    "steady": FIGURES[:3],
    "first_peak": FIGURES[3:5],
    "undershoot": FIGURES[5:6],
    "second_peak": FIGURES[6:7],
    "shape": tuple(SHAPE),
}
"""Figures of one kind, which are left out at all levels together. The shape is published of the published twin alone."""


@dataclass(frozen=True)
class Split:
    """Rows of a reference that are fitted, and those that are predicted."""

    reference: str
    left_out: str
    """``"100"``, ``"75"``, ``"50"``: a level; a name of :data:`KINDS`; or ``"nothing"``."""

    @property
    def name(self) -> str:
        return f"{self.reference}-{self.left_out}"

    @property
    def predicted(self) -> NDArray[np.bool_]:
        """Rows (:data:`ROWS`,) that are left out and scored."""
        if self.left_out in KINDS:
            return np.array([name.split(":")[-1] in KINDS[self.left_out] for name in ROW_NAMES])
        names = {f"{self.left_out}:{name}" for name in TRANSIENT}
        return np.array([name in names for name in ROW_NAMES])

    @property
    def fitted(self) -> NDArray[np.bool_]:
        """Rows (:data:`ROWS`,) that are fitted."""
        rows = ~self.predicted
        if self.left_out not in (*KINDS, "nothing"):
            rows &= np.array([not name.startswith(f"{self.left_out}:") for name in ROW_NAMES])
        if self.reference != "mevea" or self.left_out == "100":  # the shape is that of the turn at 100 %
            rows[OF_TURNS : OF_TURNS + len(SHAPE)] = False
        return rows

    @property
    def levels(self) -> NDArray[np.bool_]:
        """Levels (3,) that the fit turns at."""
        return np.array([f"{turn.signal_percent:g}" != self.left_out for turn in LEVELS])

    def residuals(self, found: Found) -> NDArray[np.float64]:
        """Misses (R, N) of what is fitted, in half tolerances."""
        return 2.0 * found.misses(self.reference)[self.fitted]

    def score(self, found: Found) -> NDArray[np.float64]:
        """Mean error (N,) of what is left out: relative, of the shape in tolerances."""
        rows = self.predicted
        if self.left_out == "shape":
            return np.mean(np.abs(found.misses(self.reference)[rows]), axis=0)
        return np.mean(np.abs(found.errors(self.reference)[rows[:OF_TURNS]]), axis=0)


def _splits(left_out: tuple[str, ...]) -> tuple[Split, ...]:
    return tuple(Split(r, one) for r in REFERENCES for one in left_out if (r, one) != ("physical", "shape"))


BY_LEVEL = _splits(tuple(f"{turn.signal_percent:g}" for turn in LEVELS))
WHOLE = _splits(("nothing",))
BY_KIND = _splits(tuple(KINDS))

assert all(len(split.fitted) == ROWS for split in WHOLE)
