"""The network of tables without torch, and what comes with the package."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cache

import numpy as np
from numpy.typing import NDArray

from aoro_gym.diagnosis.network.cases import Posterior, averaged
from aoro_gym.diagnosis.network.decision import Calibration, calibrations_of
from aoro_gym.diagnosis.network.forward import TRAINED, Array, Weights, concluded, gelu, linear

NETWORKS = "tables_*.safetensors"
"""Files of networks."""
CALIBRATION = "tables_calibration.json"
"""File of what was learnt of how sure they may be."""
TRAINING = "tables_training.json"
"""File of how they were trained, and of how well they do."""
PAIRED, DAY_ONE = "figures", "figures_day_one"
"""Sets of tables that are calibrated: with figures of a healthy day, and without."""


def file_name(number: int) -> str:
    """Of a network."""
    return NETWORKS.replace("*", str(number))


@cache
def trained() -> tuple[Weights, ...]:
    """The networks of tables that come with the package."""
    return tuple(Weights.load(path) for path in sorted(TRAINED.glob(NETWORKS)))


@cache
def shipped() -> Mapping[str, Calibration]:
    """Their calibrations, by set of tables."""
    return calibrations_of(TRAINED / CALIBRATION)


def forward(weights: Weights, rows: Array, present: NDArray[np.bool_]) -> tuple[Array, Array]:
    """Logits (B, hypotheses) and quantiles of scaled sizes (B, effects, quantiles).

    Args:
        weights: Of the network.
        rows: Features (B, J, FEATURES).
        present: Which turns are there (B, J).
    """
    w = weights.arrays
    return concluded(weights, linear(w, "narrow", gelu(linear(w, "wide", rows))), present)


def posterior(networks: Sequence[Weights], rows: Array) -> Posterior:
    """The mean of what ``networks`` say of a table of J turns, given their features (J, FEATURES)."""
    present = np.ones((1, len(rows)), dtype=bool)
    said = (forward(weights, rows[None].astype(np.float32), present) for weights in networks)
    probabilities, quantiles = averaged(networks, said)
    return Posterior(probabilities[0], quantiles[0])
