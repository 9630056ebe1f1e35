"""Many small writes into arrays on a device, as one upload and one launch."""

# pyright: reportGeneralTypeIssues=false, reportInvalidTypeForm=false, reportArgumentType=false, reportIndexIssue=false
from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray


@wp.kernel(enable_backward=False)
def scatter(writes: wp.array2d(dtype=wp.int64)):
    """Write (3, M): addresses, bits, and how many bytes of them."""
    t = wp.tid()
    address = wp.uint64(writes[0, t])
    bits = writes[1, t]
    size = writes[2, t]
    if size == wp.int64(8):
        longs = wp.array(ptr=address, shape=(1,), dtype=wp.int64)
        longs[0] = bits
    elif size == wp.int64(4):
        words = wp.array(ptr=address, shape=(1,), dtype=wp.int32)
        words[0] = wp.int32(bits)
    else:
        octets = wp.array(ptr=address, shape=(1,), dtype=wp.uint8)
        octets[0] = wp.uint8(bits)


def write(tensors: Sequence[Any], indices: Sequence[Any], values: Sequence[Any], device: str) -> None:
    """``tensor[index] = value`` for each of them, no place twice.

    Args:
        tensors: torch's, on ``device``.
        indices: Slices and at most one array of rows of the host, one an axis or fewer; an ellipsis may come first.
        values: Of the host; each broadcasts to its place.
        device: Warp's name of it.
    """
    known: dict[Any, NDArray[np.int64]] = {}  # many tensors are of one shape
    addresses, bits, sizes = [], [], []
    for tensor, index, value in zip(tensors, indices, values, strict=True):
        shape, strides, size = tuple(tensor.shape), tensor.stride(), tensor.element_size()
        index = index if isinstance(index, tuple) else (index,)
        key = shape, strides, size, *(part.__reduce__()[1] if isinstance(part, slice) else id(part) for part in index)
        offsets = known.get(key)
        if offsets is None:
            offsets = known[key] = size * _offsets(shape, strides, index)
        addresses.append((offsets + tensor.data_ptr()).ravel())
        bits.append(np.broadcast_to(np.asarray(value, _KINDS[tensor.dtype]).view(_BITS[size]), offsets.shape).ravel())
        sizes.append(np.full(offsets.size, size))
    if addresses:
        parts = [np.concatenate(each) for each in (addresses, bits, sizes)]
        writes: Any = wp.array(np.stack(parts), dtype=wp.int64, device=device)
        wp.launch(scatter, dim=writes.shape[1], inputs=[writes], device=device)


_BITS = {8: np.int64, 4: np.int32, 1: np.uint8}


class _Kinds(dict[Any, str]):
    """NumPy's names of torch's types."""

    def __missing__(self, dtype: Any) -> str:
        self[dtype] = str(dtype).removeprefix("torch.")
        return self[dtype]


_KINDS = _Kinds()


def _offsets(shape: tuple[int, ...], strides: tuple[int, ...], index: tuple[Any, ...]) -> NDArray[np.int64]:
    """Of the places in an array that ``index`` names, by axis."""
    if index[0] is Ellipsis:
        index = (slice(None),) * (len(shape) + 1 - len(index)) + index[1:]
    out: Any = np.zeros((1,) * len(shape), dtype=np.int64)
    for axis, (length, stride) in enumerate(zip(shape, strides, strict=True)):
        part = index[axis] if axis < len(index) else slice(None)
        numbers = np.arange(length)[part] if isinstance(part, slice) else np.asarray(part)
        out = out + (numbers * stride).reshape(-1, *(1,) * (len(shape) - 1 - axis))
    return out
