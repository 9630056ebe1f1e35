"""Many small writes into arrays on a device, as one upload and one launch."""

# pyright: reportGeneralTypeIssues=false, reportInvalidTypeForm=false, reportArgumentType=false, reportIndexIssue=false
# pyright: reportAssignmentType=false
from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from operator import is_
from typing import Any, NamedTuple

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


class RowWrites:
    """The same writes by rows, for :func:`store`: into the same parts of the same arrays, whichever rows and values.

    Args:
        tensors: See :func:`write`.
        indices: Likewise; each holds the rows as an array, or c K of them, c of each row that lie side by side.
        count: Number K of rows.
    """

    def __init__(self, tensors: Sequence[Any], indices: Sequence[Any], count: int):
        self._tensors = tensors
        self._forms = [_form(index, count) for index in indices]
        self._parts: list[_Part] = []
        addresses, strides, sizes, lengths = [], [], [], []
        for tensor, (each, *slices) in zip(tensors, self._forms, strict=True):
            if slices[0] is Ellipsis:
                slices = [slice(None)] * (tensor.ndim + 1 - len(slices)) + slices[1:]
            axis, size = slices.index(None), tensor.element_size()
            known = tuple(None if part is None else part.__reduce__()[1] for part in slices)
            offsets, before, after = _row_offsets(tuple(tensor.shape), tensor.stride(), each, known)
            begin = sum(lengths)
            addresses.append(size * offsets + tensor.data_ptr())
            strides.append(size * tensor.stride(axis) * each)
            sizes.append(size)
            lengths.append(len(offsets))
            columns = slice(begin, begin + len(offsets))
            self._parts.append(_Part(_KINDS[tensor.dtype], _BITS[size], columns, each, before, after))
        self.places = np.stack([np.concatenate(addresses), np.repeat(strides, lengths), np.repeat(sizes, lengths)])
        """What is written of a row (3, M): addresses in row 0, bytes to the next row and how many are written."""

    def fits(self, tensors: Sequence[Any], indices: Sequence[Any], count: int) -> bool:
        """Whether these writes of ``count`` rows, with arguments as above, are into the same places."""
        return (
            len(tensors) == len(self._tensors)
            and all(map(is_, tensors, self._tensors))
            and [_form(index, count) for index in indices] == self._forms
        )

    def fill(self, bits: NDArray[np.int64], values: Sequence[Any]) -> None:
        """Write the bits of ``values``, each of which broadcasts to its place, into ``bits`` (K, M) of K rows."""
        count = len(bits)
        for (kind, word, columns, each, before, after), value in zip(self._parts, values, strict=True):
            part = np.asarray(value, kind).view(word)
            if each == 1:
                there = bits[:, columns].reshape(count, *before, *after)
                axes = *range(1, len(before) + 1), 0, *range(len(before) + 1, there.ndim)
                there.transpose(axes)[...] = part
            else:
                rows = np.moveaxis(np.broadcast_to(part, (*before, each * count, *after)), len(before), 0)
                bits[:, columns] = rows.reshape(count, -1)


class _Part(NamedTuple):
    """Of what is written of a row, that of one array."""

    kind: str
    """NumPy's name of its type."""
    word: type[np.signedinteger]
    """Integers as large."""
    columns: slice
    """Of the bits."""
    each: int
    """Its rows that are written as one."""
    before: tuple[int, ...]
    """Its shape before the axis of rows ..."""
    after: tuple[int, ...]
    """... and after it."""


def _form(index: Any, count: int) -> list[Any]:
    """What ``index`` says whichever the ``count`` rows: how many of an array are written as one, then its parts, None for
    the rows."""
    parts = index if isinstance(index, tuple) else (index,)
    each = sum(len(part) for part in parts if isinstance(part, np.ndarray)) // count
    return [each, *(None if isinstance(part, np.ndarray) else part for part in parts)]


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
