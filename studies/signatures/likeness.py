"""Inner products of signatures, with and without what nuisances could explain, and which signature is nearest to which."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from aoro_gym.diagnosis.noise import Floats

CHANNELS: Mapping[str, tuple[int, ...]] = {
    "angle": (0,),
    "angle and ports": (0, 1, 2),
    "pressures": (1, 2, 3),
    "all": (0, 1, 2, 3),
}
"""Sets of channels that are compared: joint angle, port A, port B, pump."""
SEEN = 3.0
"""Length of a signature, in standard deviations of the noise, below which no recording shows it."""


def products(signatures: Floats, nuisances: Floats | None = None) -> Floats:
    """Inner products (S, S) of signatures (S, n) of unit noise; with nuisances (K, n), each a prior standard deviation,
    those of the metric (1 + JᵀJ)⁻¹, which counts what they cannot explain."""
    gram = signatures @ signatures.T
    if nuisances is not None:
        mixed = nuisances @ signatures.T
        gram = gram - mixed.T @ np.linalg.solve(np.eye(len(nuisances)) + nuisances @ nuisances.T, mixed)
    return gram


def cosines(gram: Floats, least: Floats | float = SEEN) -> Floats:
    """Cosines (S, S) of inner products; NaN of signatures that are no longer than ``least``."""
    length = np.sqrt(np.maximum(np.diag(gram), 0.0))
    length = np.where(length > least, length, np.nan)
    return gram / np.outer(length, length)


def between_families(cosine: Floats) -> Floats:
    """Cosines (E, pairs) of each effect's own signatures between families, of all cosines (families, E, families, E)."""
    pairs = np.triu_indices(len(cosine), 1)
    own = np.einsum("aebe->abe", cosine)
    return own[pairs].T


def between_effects(cosine: Floats) -> float:
    """Median size of the cosines of all signatures of different effects of different families; NaN if none is seen."""
    families, effects = cosine.shape[:2]
    others = ~np.eye(families, dtype=bool)[:, None, :, None] & ~np.eye(effects, dtype=bool)[None, :, None, :]
    sizes = np.abs(cosine[others & np.isfinite(cosine)])
    return float(np.median(sizes)) if sizes.size else np.nan


def nearest(cosine: Floats, either_sign: np.ndarray[Any, Any]) -> dict[str, Any]:
    """Which signature of another family is the nearest.

    Args:
        cosine: (families, E, families, E), NaN of signatures that are not seen.
        either_sign: Effects (E,) that have both signs, so that the opposite signature is theirs, too.

    Returns:
        ``other`` (families, E): the effect whose signature of any other family is nearer than the effect's own, -1 where its
        own is the nearest, -2 where it shows in no other family; ``right`` (families, families, E): whether among one other
        family's signatures its own is the nearest, NaN where it does not show in both.
    """
    like = np.where(np.isnan(cosine), -np.inf, np.where(either_sign, np.abs(cosine), cosine))
    families, effects = like.shape[:2]
    other, right = np.full((families, effects), -2), np.full((families, families, effects), np.nan)
    for f, e in np.ndindex(families, effects):
        rest = like[f, e, np.arange(families) != f]  # (other families, E)
        if np.isfinite(rest[:, e]).any():
            best = int(np.argmax(rest.max(axis=0)))
            other[f, e] = -1 if best == e else best
        for g in range(families):
            if g != f and np.isfinite(like[f, e, g, e]):
                right[f, g, e] = np.argmax(like[f, e, g]) == e
    return {"other": other, "right": right}
