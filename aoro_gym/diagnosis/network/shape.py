"""Sizes of the network."""

from __future__ import annotations

from dataclasses import asdict, dataclass

WINDOW, STRIDE = 16, 8
"""Samples of a window that makes a token, and from one to the next."""
QUANTILES = (0.05, 0.25, 0.5, 0.75, 0.95)
"""Of the sizes that are estimated."""


@dataclass(frozen=True)
class Shape:
    """Sizes of a network.

    Attributes:
        width: Numbers a token.
        heads: Of every attention.
        within: Blocks within a log.
        across: Blocks across logs.
        kept: Tokens that stand for a log.
        rank: Of what a pair of effects adds.
    """

    width: int = 192
    heads: int = 6
    within: int = 3
    across: int = 4
    kept: int = 4
    rank: int = 16

    def as_dict(self) -> dict[str, int]:
        """As it is stored with the weights."""
        return asdict(self)
