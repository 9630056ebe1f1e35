"""The network: windows of each log, attention within it, attention across logs, and a distribution over causes.

A cause is a hypothesis (:mod:`.hypotheses`). The logit of a single effect stands on its own; that of a pair is a sum of
what stands for either effect and of a product of what they are to each other, so that rare pairs learn from all others.
:mod:`.forward` computes the same without torch.
"""

from __future__ import annotations

from typing import Self

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from aoro_gym.diagnosis.network.features import FEATURES, SAMPLES
from aoro_gym.diagnosis.network.forward import Weights
from aoro_gym.diagnosis.network.hypotheses import PAIRS, SINGLE
from aoro_gym.diagnosis.network.shape import QUANTILES, STRIDE, WINDOW, Shape
from aoro_gym.effects.catalogue import IDS


class Windows(nn.Module):
    """Overlapping windows of samples, each through two layers."""

    def __init__(self, width: int):
        super().__init__()
        self.wide, self.narrow = nn.Linear(FEATURES * WINDOW, 2 * width), nn.Linear(2 * width, width)

    def forward(self, x: Tensor) -> Tensor:
        """Rows (B, FEATURES, SAMPLES) to tokens (B, SAMPLES / STRIDE, width)."""
        margin = (WINDOW - STRIDE) // 2
        windows = nn.functional.pad(x, (margin, margin)).unfold(2, WINDOW, STRIDE)
        return self.narrow(nn.functional.gelu(self.wide(windows.permute(0, 2, 1, 3).flatten(2))))


class Block(nn.Module):
    """A transformer's block, normalised first."""

    def __init__(self, width: int, heads: int):
        super().__init__()
        self.heads = heads
        self.first, self.second = nn.LayerNorm(width), nn.LayerNorm(width)
        self.attention = nn.Linear(width, 3 * width)
        self.out = nn.Linear(width, width)
        self.wide, self.narrow = nn.Linear(width, 4 * width), nn.Linear(4 * width, width)

    def forward(self, x: Tensor, mask: Tensor | None = None) -> Tensor:
        """``x`` (B, N, width); ``mask`` (B, N or 1, N), true where a token (rows) may see another (columns)."""
        batch, count, width = x.shape
        parts = self.attention(self.first(x)).reshape(batch, count, 3, self.heads, width // self.heads)
        q, k, v = parts.permute(2, 0, 3, 1, 4)
        keep = None if mask is None else mask[:, None]
        mixed = nn.functional.scaled_dot_product_attention(q, k, v, attn_mask=keep)
        x = x + self.out(mixed.transpose(1, 2).reshape(batch, count, width))
        return x + self.narrow(nn.functional.gelu(self.wide(self.second(x))))


class Causes(nn.Module):
    """A distribution over causes, and sizes, from the tokens of a case: attention across them, and the heads.

    One token stands for the cause, and one for each effect, which asks the case's tokens and the other effects for itself;
    the case's tokens and the cause do not see the effects.
    """

    def __init__(self, shape: Shape):
        super().__init__()
        self.shape = shape
        width, count = shape.width, len(IDS)
        self.cause = nn.Parameter(0.02 * torch.randn(1, width))
        self.effects = nn.Parameter(0.02 * torch.randn(count, width))
        self.across = nn.ModuleList(Block(width, shape.heads) for _ in range(shape.across))
        self.norm = nn.LayerNorm(width)
        self.single = nn.Linear(width, SINGLE + count)
        self.member = nn.Linear(width, count)
        self.left, self.right = nn.Linear(width, count * shape.rank), nn.Linear(width, count * shape.rank)
        self.register_buffer("pairs", torch.tensor(PAIRS).T, persistent=False)
        self.size = nn.Sequential(nn.Linear(width, width), nn.GELU(), nn.Linear(width, count * len(QUANTILES)))
        self.own = nn.Parameter(torch.zeros(count, width, 2 + len(QUANTILES)))
        self.one, self.other = nn.Linear(width, 2 * shape.rank), nn.Linear(width, 2 * shape.rank)
        nn.init.zeros_(self.other.weight)
        nn.init.zeros_(self.other.bias)

    def concluded(self, tokens: Tensor, present: Tensor) -> tuple[Tensor, Tensor]:
        """Logits (B, hypotheses) and quantiles of scaled sizes (B, effects, quantiles).

        Args:
            tokens: Of the case (B, N, width).
            present: Which of them are there (B, N).
        """
        batch, count = len(tokens), len(IDS)
        x = torch.cat([self.effects.expand(batch, -1, -1), self.cause.expand(batch, -1, -1), tokens], dim=1)
        seen = torch.cat([present.new_zeros(batch, count), present.new_ones(batch, 1), present], dim=1)
        mask = seen[:, None].repeat(1, x.shape[1], 1)
        mask[:, :count, :count] = True
        for block in self.across:
            x = block(x, mask)
        x = self.norm(x)
        asked, h = x[:, :count], x[:, count]
        own = torch.einsum("bcw,cwk->bck", asked, self.own)
        first, second = self.get_buffer("pairs")
        member = self.member(h) + own[..., 1]
        left, right = (part(h).reshape(batch, count, self.shape.rank) for part in (self.left, self.right))
        both = torch.einsum("bir,bjr->bij", left, right) + torch.einsum(
            "bir,bjr->bij", self.one(asked), self.other(asked)
        )
        pair = member[:, first] + member[:, second] + both[:, first, second] / self.shape.rank**0.5
        single = self.single(h)
        single = torch.cat([single[:, :SINGLE], single[:, SINGLE:] + own[..., 0]], dim=1)
        sizes = self.size(h).reshape(batch, count, len(QUANTILES)) + own[..., 2:]
        return torch.cat([single, pair], dim=1), sizes

    def weights(self, scales: NDArray[np.float64]) -> Weights:
        """What :mod:`.forward` computes with; ``scales`` [SI] of the effects' sizes."""
        arrays = {name: values.detach().float().cpu().numpy() for name, values in self.state_dict().items()}
        return Weights(self.shape, arrays, scales)

    @classmethod
    def of(cls, weights: Weights) -> Self:
        """The network that has these weights."""
        network = cls(weights.shape)
        network.load_state_dict({name: torch.tensor(values) for name, values in weights.arrays.items()})
        return network


class Network(Causes):
    """Causes and sizes from the logs of a case."""

    def __init__(self, shape: Shape | None = None):
        super().__init__(shape or Shape())
        width = self.shape.width
        self.embed = Windows(width)
        self.place = nn.Parameter(0.02 * torch.randn(SAMPLES // STRIDE, width))
        self.kept = nn.Parameter(0.02 * torch.randn(self.shape.kept, width))
        self.within = nn.ModuleList(Block(width, self.shape.heads) for _ in range(self.shape.within))

    def forward(self, rows: Tensor, present: Tensor) -> tuple[Tensor, Tensor]:
        """Logits (B, hypotheses) and quantiles of scaled sizes (B, effects, quantiles).

        Args:
            rows: Features (B, J, FEATURES, SAMPLES).
            present: Which logs are there (B, J).
        """
        batch, each = present.shape
        x = self.embed(rows.flatten(0, 1)) + self.place
        x = torch.cat([self.kept.expand(len(x), -1, -1), x], dim=1)
        for block in self.within:
            x = block(x)
        kept = self.shape.kept
        tokens = x[:, :kept].reshape(batch, each * kept, -1)
        return self.concluded(tokens, present.repeat_interleave(kept, dim=1))
