"""Validation: the key figures of a full turn, what is published of them, and the twin beside it."""

from aoro_gym.simulation.key_figures import FIGURES, key_figures_batch
from aoro_gym.validation.published import published, published_rows, valve_flow
from aoro_gym.validation.study import Validation, validate

__all__ = [
    "FIGURES",
    "Validation",
    "key_figures_batch",
    "published",
    "published_rows",
    "validate",
    "valve_flow",
]
