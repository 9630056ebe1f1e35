"""Many small writes into arrays on a device, as one upload and one launch."""

# pyright: reportGeneralTypeIssues=false, reportInvalidTypeForm=false, reportArgumentType=false, reportIndexIssue=false
# pyright: reportAssignmentType=false
from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray


@wp.func
def store(place: wp.int64, bits: wp.int64, size: wp.int64):
    """Write ``size`` bytes of ``bits`` to an address."""
    address = wp.uint64(place)
    if size == wp.int64(8):
        longs = wp.array(ptr=address, shape=(1,), dtype=wp.int64)
        longs[0] = bits
    elif size == wp.int64(4):
        words = wp.array(ptr=address, shape=(1,), dtype=wp.int32)
        words[0] = wp.int32(bits)
    else:
        octets = wp.array(ptr=address, shape=(1,), dtype=wp.uint8)
        octets[0] = wp.uint8(bits)


@wp.kernel(enable_backward=False)
def scatter(writes: wp.array2d(dtype=wp.int64)):
    """Write (3, M): addresses, bits, and how many bytes of them."""
    t = wp.tid()
    store(writes[0, t], writes[1, t], writes[2, t])


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


def by_row(
    tensors: Sequence[Any], indices: Sequence[Any], values: Sequence[Any], count: int
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """The same writes by rows, for :func:`store`: places (3, M), which are addresses in row 0, bytes to the next row and how
    many are written, and bits (K, M) of each of K rows.

    Args:
        tensors: See :func:`write`.
        indices: Likewise; each holds the rows as an array, or c K of them, c of each row that lie side by side.
        values: See :func:`write`.
        count: Number K of rows.
    """
    addresses, strides, sizes, lengths, bits = [], [], [], [], []
    for tensor, index, value in zip(tensors, indices, values, strict=True):
        index = index if isinstance(index, tuple) else (index,)
        if index[0] is Ellipsis:
            index = (slice(None),) * (tensor.ndim + 1 - len(index)) + index[1:]
        axis = next(number for number, part in enumerate(index) if isinstance(part, np.ndarray))
        rows = len(index[axis])
        slices = tuple(None if number == axis else part.__reduce__()[1] for number, part in enumerate(index))
        offsets, before, after = _row_offsets(tuple(tensor.shape), tensor.stride(), rows // count, slices)
        size = tensor.element_size()
        addresses.append(size * offsets + tensor.data_ptr())
        strides.append(size * tensor.stride(axis) * (rows // count))
        sizes.append(size)
        lengths.append(len(offsets))
        part = np.asarray(value, _KINDS[tensor.dtype]).view(_BITS[size])
        if part.shape != (*before, rows, *after):
            part = np.broadcast_to(part, (*before, rows, *after))
        bits.append((np.moveaxis(part, axis, 0) if axis else part).reshape(count, -1))
    places = np.stack([np.concatenate(addresses), np.repeat(strides, lengths), np.repeat(sizes, lengths)])
    return places, np.concatenate(bits, axis=1, dtype=np.int64)


@lru_cache(maxsize=1024)
def _row_offsets(
    shape: tuple[int, ...], strides: tuple[int, ...], each: int, slices: tuple[Any, ...]
) -> tuple[NDArray[np.int64], tuple[int, ...], tuple[int, ...]]:
    """Elements (M,) from the beginning of an array to the first of its rows that is written, and its shape before and after
    the axis of rows.

    Args:
        shape: Of the array.
        strides: Likewise [elements].
        each: Rows that lie side by side.
        slices: Of the other axes, as arguments of ``slice``; None for that of rows.
    """
    axis = slices.index(None)
    first = tuple(np.arange(each) if part is None else slice(*part) for part in slices)
    offsets = _offsets(shape, strides, first)
    return np.moveaxis(offsets, axis, 0).ravel(), offsets.shape[:axis], offsets.shape[axis + 1 :]


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
