"""The network without torch: what :mod:`.model` computes, in NumPy, from weights that came with the package."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import erf

from aoro_gym.diagnosis.network.features import FEATURES, SAMPLES
from aoro_gym.diagnosis.network.hypotheses import PAIRS, SINGLE
from aoro_gym.diagnosis.network.shape import QUANTILES, STRIDE, WINDOW, Shape
from aoro_gym.effects.catalogue import IDS

Array = NDArray[np.float32]
TRAINED = Path(__file__).with_name("trained")
_FIRST, _SECOND = np.array(PAIRS).T


@dataclass(frozen=True)
class Weights:
    """A trained network: its sizes, its weights by name, and the scales [SI] of the effects' sizes (effects,)."""

    shape: Shape
    arrays: Mapping[str, Array]
    scales: NDArray[np.float64]

    @classmethod
    def load(cls, path: Path) -> Weights:
        """Read what :meth:`save` wrote; ValueError naming the file where it is something else, or for other effects."""
        from safetensors import SafetensorError, safe_open

        try:
            with safe_open(path, framework="numpy") as file:
                told = json.loads(file.metadata()["network"])
                arrays = {name: file.get_tensor(name).astype(np.float32) for name in file.keys()}  # noqa: SIM118
        except (SafetensorError, KeyError, TypeError) as error:
            raise ValueError(
                f"{path}: not a network of a diagnosis ({error}); train one by `aoro-gym diagnosis train`"
            ) from error
        if told.get("effects") != list(IDS):
            raise ValueError(
                f"{path}: trained for {len(told.get('effects', ()))} effects that are not the catalogue's {len(IDS)}; "
                "train one by `aoro-gym diagnosis train`"
            )
        if "effects" not in arrays:
            raise ValueError(
                f"{path}: its effects have no tokens, as networks had before them; train one by `aoro-gym diagnosis train`"
            )
        return cls(Shape(**told["shape"]), arrays, np.array(told["scales"]))

    def save(self, path: Path) -> None:
        """Write the network, half as precise as it computes."""
        from safetensors.numpy import save_file

        told = {"shape": self.shape.as_dict(), "scales": self.scales.tolist(), "effects": IDS}
        halves = {name: np.ascontiguousarray(values, dtype=np.float16) for name, values in self.arrays.items()}
        save_file(halves, path, metadata={"network": json.dumps(told)})


@cache
def trained() -> tuple[Weights, ...]:
    """The networks that come with the package; how they were trained stands beside them in ``training.json``."""
    return tuple(Weights.load(path) for path in networks_in(TRAINED))


def networks_in(folder: Path) -> tuple[Path, ...]:
    """Files of the networks in a folder, in their order; ValueError where there is none."""
    found = tuple(sorted(folder.glob("network_*.safetensors")))
    if not found:
        raise ValueError(f"{folder}: no network_*.safetensors there; train networks by `aoro-gym diagnosis train`")
    return found


def forward(weights: Weights, rows: Array, present: NDArray[np.bool_]) -> tuple[Array, Array]:
    """Logits (B, hypotheses) and quantiles of scaled sizes (B, effects, quantiles).

    Args:
        weights: Of the network.
        rows: Features (B, J, FEATURES, SAMPLES).
        present: Which logs are there (B, J).
    """
    batch, each = present.shape
    tokens = encoded(weights, rows.reshape(batch * each, FEATURES, SAMPLES))
    return decided(weights, tokens.reshape(batch, each, *tokens.shape[1:]), present)


def encoded(weights: Weights, rows: Array) -> Array:
    """Tokens (N, kept, width) that stand for N logs, each by itself; ``rows`` are features (N, FEATURES, SAMPLES)."""
    w, shape = weights.arrays, weights.shape
    x = _windows(w, rows) + w["place"]
    x = np.concatenate([np.broadcast_to(w["kept"], (len(x), *w["kept"].shape)), x], axis=1)
    for i in range(shape.within):
        x = _block(w, f"within.{i}", x, shape.heads)
    return x[:, : shape.kept]


def decided(weights: Weights, tokens: Array, present: NDArray[np.bool_]) -> tuple[Array, Array]:
    """What :func:`forward` gives, from the logs' ``tokens`` (B, J, kept, width)."""
    batch, each = present.shape
    kept = weights.shape.kept
    return concluded(weights, tokens.reshape(batch, each * kept, -1), np.repeat(present, kept, axis=1))


def concluded(weights: Weights, tokens: Array, present: NDArray[np.bool_]) -> tuple[Array, Array]:
    """Logits (B, hypotheses) and quantiles of scaled sizes (B, effects, quantiles).

    Args:
        weights: Of the network.
        tokens: Of each case (B, N, width).
        present: Which of them are there (B, N).
    """
    w, shape = weights.arrays, weights.shape
    batch, count = len(tokens), len(IDS)
    first = np.concatenate([w["effects"], w["cause"]])
    x = np.concatenate([np.broadcast_to(first, (batch, *first.shape)), tokens], axis=1)
    seen = np.concatenate([np.zeros((batch, count), dtype=bool), np.ones((batch, 1), dtype=bool), present], axis=1)
    mask = np.repeat(seen[:, None], x.shape[1], axis=1)
    mask[:, :count, :count] = True
    for i in range(shape.across):
        x = _block(w, f"across.{i}", x, shape.heads, mask)
    x = _norm(w, "norm", x)
    asked, h = x[:, :count], x[:, count]
    own = np.einsum("bcw,cwk->bck", asked, w["own"])
    member = linear(w, "member", h) + own[..., 1]
    left, right = (linear(w, side, h).reshape(batch, count, shape.rank) for side in ("left", "right"))
    one, other = (linear(w, side, asked) for side in ("one", "other"))
    both = np.einsum("bpr,bpr->bp", left[:, _FIRST], right[:, _SECOND])
    both += np.einsum("bpr,bpr->bp", one[:, _FIRST], other[:, _SECOND])
    pair = member[:, _FIRST] + member[:, _SECOND] + both / np.sqrt(np.float32(shape.rank))
    single = linear(w, "single", h)
    single = np.concatenate([single[:, :SINGLE], single[:, SINGLE:] + own[..., 0]], axis=1)
    sizes = linear(w, "size.2", gelu(linear(w, "size.0", h))).reshape(batch, count, len(QUANTILES)) + own[..., 2:]
    return np.concatenate([single, pair], axis=1), sizes


def linear(w: Mapping[str, Array], name: str, x: Array) -> Array:
    """``x`` (..., inputs) through the layer ``name`` of weights ``w``."""
    weight = w[f"{name}.weight"]
    # one product: threads that meet at many small ones take up to ten times as long on a busy machine
    return (x.reshape(-1, x.shape[-1]) @ weight.T + w[f"{name}.bias"]).reshape(*x.shape[:-1], len(weight))


def _norm(w: Mapping[str, Array], name: str, x: Array) -> Array:
    centred = x - x.mean(axis=-1, keepdims=True)
    scale = np.sqrt((centred**2).mean(axis=-1, keepdims=True) + np.float32(1e-5))
    return centred / scale * w[f"{name}.weight"] + w[f"{name}.bias"]


def gelu(x: Array) -> Array:
    """x Φ(x), element by element."""
    return (0.5 * x * (1.0 + erf(x / np.sqrt(np.float32(2.0))))).astype(np.float32)


def _windows(w: Mapping[str, Array], x: Array) -> Array:
    """Tokens (B, SAMPLES / STRIDE, width) of overlapping windows of rows (B, FEATURES, SAMPLES)."""
    margin = (WINDOW - STRIDE) // 2
    padded = np.pad(x, ((0, 0), (0, 0), (margin, margin)))
    windows = np.lib.stride_tricks.sliding_window_view(padded, WINDOW, axis=2)[:, :, ::STRIDE]
    flat = windows.transpose(0, 2, 1, 3).reshape(len(x), SAMPLES // STRIDE, FEATURES * WINDOW)
    return linear(w, "embed.narrow", gelu(linear(w, "embed.wide", flat)))


def _block(w: Mapping[str, Array], name: str, x: Array, heads: int, mask: NDArray[np.bool_] | None = None) -> Array:
    """A transformer's block, normalised first; ``mask`` (B, N or 1, N) is true where a token may see another."""
    batch, count, width = x.shape
    parts: Any = linear(w, f"{name}.attention", _norm(w, f"{name}.first", x))
    q, k, v = parts.reshape(batch, count, 3, heads, width // heads).transpose(2, 0, 3, 1, 4)
    score = q @ k.transpose(0, 1, 3, 2) / np.sqrt(np.float32(width // heads))
    if mask is not None:
        score = np.where(mask[:, None], score, -np.inf)
    share = np.exp(score - score.max(axis=-1, keepdims=True))
    mixed = (share / share.sum(axis=-1, keepdims=True)) @ v
    x = x + linear(w, f"{name}.out", mixed.transpose(0, 2, 1, 3).reshape(batch, count, width))
    return x + linear(w, f"{name}.narrow", gelu(linear(w, f"{name}.wide", _norm(w, f"{name}.second", x))))
