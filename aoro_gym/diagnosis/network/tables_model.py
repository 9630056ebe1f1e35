"""The network of tables: a turn's figures are one token; what concludes from tokens is that of logs (:mod:`.model`).

:mod:`.tables_forward` computes the same without torch.
"""

from __future__ import annotations

from torch import Tensor, nn

from aoro_gym.diagnosis.network.model import Causes
from aoro_gym.diagnosis.network.shape import Shape
from aoro_gym.diagnosis.network.tables_features import FEATURES

SHAPE = Shape(width=128, heads=4, within=0, across=4, kept=1)
"""Its usual sizes."""


class TablesNetwork(Causes):
    """Causes and sizes from the key figures of full turns."""

    def __init__(self, shape: Shape = SHAPE):
        super().__init__(shape)
        self.wide, self.narrow = nn.Linear(FEATURES, 2 * shape.width), nn.Linear(2 * shape.width, shape.width)

    def forward(self, rows: Tensor, present: Tensor) -> tuple[Tensor, Tensor]:
        """Logits (B, hypotheses) and quantiles of scaled sizes (B, effects, quantiles).

        Args:
            rows: Features of turns (B, J, FEATURES).
            present: Which turns are there (B, J).
        """
        return self.concluded(self.narrow(nn.functional.gelu(self.wide(rows))), present)
