"""What the network of tables is shown of a turn: its signal, and its figures on the healthy and on the later day.

One function for NumPy and for torch, so that training and diagnosis cannot differ.
"""

from __future__ import annotations

from collections.abc import Sequence
from types import ModuleType
from typing import Any

from aoro_gym.diagnosis.simulation.turns import READ

SIZES = (4.0, 40.0, 60.0, 0.1, 40.0, 50.0)
"""Usual sizes of :data:`~aoro_gym.diagnosis.simulation.turns.READ`: [s] and [L/min]."""
CHANGE = 0.005
"""Change, as a share of a figure, that is shown as one ..."""
LEAST_CHANGE = (0.01, 0.1, 0.2, 0.003, 0.2, 0.2)
"""... when this is added [s] and [L/min]."""
FEATURES = 3 + 9 * len(READ)
"""Numbers of :func:`features`."""


def features(xp: ModuleType, signal: Any, figures: Any, has: Any, std: Any, has_std: Any) -> Any:
    """Rows (..., FEATURES) that the network's first layer takes.

    Args:
        xp: ``numpy`` or ``torch``, whose arrays the others are.
        signal: Of the turn in [-1, 1], left positive (...).
        figures: Of the healthy and of the later day (..., 2, figures); anything finite where one is not known.
        has: Which of them are known (..., 2, figures), 0 or 1.
        std: Their standard deviations (..., 2, figures); anything finite where one is not known.
        has_std: Which of these are known (..., 2, figures), 0 or 1.
    """
    (before, after), (known, knows) = (_days(figures), _days(has))
    unit = change_unit(xp, xp.where(known > 0.0, before, after))
    spread = xp.arcsinh(std / unit[..., None, :]) * has_std
    parts = [
        _over(xp, before, SIZES) * known, _over(xp, after, SIZES) * knows,
        xp.arcsinh((after - before) / unit) * known * knows, known, knows, *_days(spread), *_days(has_std),
    ]  # fmt: skip
    return xp.concatenate([xp.stack([signal, xp.abs(signal), xp.sign(signal)], -1), *parts], -1)


def change_unit(xp: ModuleType, figures: Any) -> Any:
    """Changes (..., figures) of ``figures`` that just count."""
    return xp.stack([CHANGE * xp.abs(figures[..., k]) + least for k, least in enumerate(LEAST_CHANGE)], -1)


def _days(values: Any) -> tuple[Any, Any]:
    return values[..., 0, :], values[..., 1, :]


def _over(xp: ModuleType, values: Any, sizes: Sequence[float]) -> Any:
    return xp.stack([values[..., k] / size for k, size in enumerate(sizes)], -1)
