"""What a policy remembers: gated recurrent units, in NumPy."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from aoro_gym.checks import check_finite

Floats = NDArray[np.float32]


@dataclass(frozen=True)
class GatedMemory:
    """A layer of the observation, and U gated recurrent units that follow it (K. Cho et al., "Learning phrase
    representations using RNN encoder-decoder for statistical machine translation", EMNLP 2014), as torch has them.

    With the observation o (O,), normalised, and the logistic function σ:

        e = tanh(E o + b)                       what is taken in of it
        r, z = σ(parts of (W e + a + V h + c))  what to forget, and what to keep
        n = tanh(W_n e + a_n + r (V_n h + c_n))
        h ← (1 − z) n + z h,                    from 0 in a new episode

    Rows of W, V, a and c are those of r, z and n, U each. The rest of the policy takes (e, h).

    Raises ValueError if its parts do not fit each other.
    """

    encoder_weight: Floats
    """E (K, O)."""
    encoder_bias: Floats
    """b (K,)."""
    input_weight: Floats
    """W (3 U, K)."""
    state_weight: Floats
    """V (3 U, U)."""
    input_bias: Floats
    """a (3 U,)."""
    state_bias: Floats
    """c (3 U,)."""

    def __post_init__(self) -> None:
        encoded, units = len(self.encoder_weight), self.state_weight.shape[-1]
        for name, shape in (
            ("encoder_weight", (encoded, self.encoder_weight.shape[-1])),
            ("encoder_bias", (encoded,)),
            ("input_weight", (3 * units, encoded)),
            ("state_weight", (3 * units, units)),
            ("input_bias", (3 * units,)),
            ("state_bias", (3 * units,)),
        ):
            value = getattr(self, name)
            if value.shape != shape:
                raise ValueError(f"memory.{name} has the shape {value.shape}, but must have {shape}")
            check_finite(f"memory.{name}", value)

    @property
    def sizes(self) -> tuple[int, int, int]:
        """Numbers that it takes, that its first layer gives, and of its units: O, K, U."""
        return self.encoder_weight.shape[1], len(self.encoder_weight), self.state_weight.shape[1]

    def __call__(self, values: Floats, state: Floats) -> tuple[Floats, Floats]:
        """What the rest of the policy takes (N, K + U), and the new state (N, U).

        Args:
            values: Normalised observations (N, O).
            state: Of the units (N, U).
        """
        units = state.shape[1]
        encoded = np.tanh(np.asarray(values) @ self.encoder_weight.T + self.encoder_bias)
        taken = encoded @ self.input_weight.T + self.input_bias
        kept = state @ self.state_weight.T + self.state_bias
        gates = _logistic(taken[:, : 2 * units] + kept[:, : 2 * units])
        forget, keep = gates[:, :units], gates[:, units:]
        new = np.tanh(taken[:, 2 * units :] + forget * kept[:, 2 * units :])
        state = ((1.0 - keep) * new + keep * state).astype(np.float32)
        return np.concatenate([encoded, state], axis=1), state

    def arrays(self) -> dict[str, Floats]:
        """All numbers by name."""
        return {f"memory.{one.name}": getattr(self, one.name) for one in fields(self)}

    @classmethod
    def of(cls, arrays: Mapping[str, Any], read: Any) -> GatedMemory:
        """What :meth:`arrays` were of, each of which ``read(arrays, name, dimensions)`` checks."""
        return cls(
            **{one.name: read(arrays, f"memory.{one.name}", 2 if "weight" in one.name else 1) for one in fields(cls)}
        )


def _logistic(values: NDArray[Any]) -> Floats:
    return (0.5 * (np.tanh(0.5 * values) + 1.0)).astype(np.float32)
