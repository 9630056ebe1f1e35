"""Arrays of a device in one piece of memory: one copy brings all of them home."""

from __future__ import annotations

from collections.abc import Sequence
from math import prod
from typing import Any, cast

import numpy as np
import warp as wp
from numpy.typing import NDArray

ALIGNED = 256
"""Bytes at whose multiples arrays begin, as CUDA's own do."""


class Together:
    """Arrays that kernels write.

    Args:
        shapes: Of each.
        kinds: Warp's type of each.
        device: Where they live.
    """

    def __init__(self, shapes: Sequence[tuple[int, ...]], kinds: Sequence[Any], *, device: Any):
        sizes = [prod(shape) * wp.types.type_size_in_bytes(kind) for shape, kind in zip(shapes, kinds, strict=True)]
        starts = np.cumsum([0, *(-(-size // ALIGNED) * ALIGNED for size in sizes)])
        self._memory: Any = wp.empty(int(starts[-1]), dtype=cast(Any, wp.uint8), device=device)
        begin = int(self._memory.ptr or 0)
        self.arrays: list[Any] = [
            wp.array(ptr=begin + int(start), dtype=kind, shape=shape, device=device)
            for start, kind, shape in zip(starts, kinds, shapes, strict=False)
        ]
        """Views of it, as long as this lives."""
        self._parts = list(zip(starts.tolist(), sizes, shapes, kinds, strict=False))

    def home(self) -> list[NDArray[Any]]:
        """All of them on the host by one copy, vectors as a last axis more; on the CPU they are the memory itself."""
        memory = self._memory.numpy()
        return [_seen(memory[start : start + size], shape, kind) for start, size, shape, kind in self._parts]


def _seen(memory: NDArray[Any], shape: tuple[int, ...], kind: Any) -> NDArray[Any]:
    scalar = np.dtype(wp.dtype_to_numpy(getattr(kind, "_wp_scalar_type_", kind)))
    inner = tuple(getattr(kind, "_shape_", ()))
    return memory.view(scalar).reshape(*shape, *inner)
