"""Rows that the host sends to a device beside what that computes."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from typing import Any

import numpy as np
from numpy.typing import NDArray

from aoro_gym.execution.array_api import Array, Arrays


class Uploads:
    """Rows sent to arrays on a device, whose other rows it may be reading meanwhile.

    On a GPU they go through a stream of their own: they are there before what was asked for earlier is done, and what is
    asked for later waits for them once :meth:`arrive` says so. On a CPU they are there at once.

    Args:
        arrays: torch's, where the rows go.
    """

    def __init__(self, arrays: Arrays):
        self._arrays = arrays
        self._stream: Any = None
        self._mark: Any = None  # of what was asked for, see follow_last()
        if arrays.device.type != "cpu":
            import torch  # pyright: ignore[reportMissingImports]

            self._torch, self._stream = torch, torch.cuda.Stream(arrays.device)

    def send(self, array: Array, rows: NDArray[np.intp], fill: Callable[[NDArray[Any]], None]) -> Array:
        """Send ``rows`` (K,) of ``array`` (N, M), which nothing uses before :meth:`arrive`; gives them as an index there.

        ``fill`` writes what they are to be (K, M) into memory of the host.
        """
        with self._beside():
            index = self._arrays.uploaded(rows)
            here = self._arrays.pinned((len(rows), *array.shape[1:]), array.dtype)
            fill(here.numpy())
            array.index_copy_(0, index, here.to(array.device, non_blocking=True))
        return index

    def arrive(self, *indices: Array) -> None:
        """Let what is asked for from now on, and uses ``indices`` that :meth:`send` gave, wait for all that was sent."""
        if self._stream is not None:
            now = self._torch.cuda.current_stream(self._arrays.device)
            now.wait_stream(self._stream)
            for index in indices:
                index.record_stream(now)  # its memory is free once that has used it

    def follow(self) -> None:
        """Let what is sent from now on wait for all that was asked for before."""
        if self._stream is not None:
            self._stream.wait_stream(self._torch.cuda.current_stream(self._arrays.device))

    def follow_last(self) -> None:
        """Let what is sent from now on wait for all that had been asked for when this was called last."""
        if self._stream is None:
            return
        if self._mark is not None:
            self._stream.wait_event(self._mark)
        self._mark = self._torch.cuda.current_stream(self._arrays.device).record_event(self._mark)

    def _beside(self) -> AbstractContextManager[Any]:
        return nullcontext() if self._stream is None else self._torch.cuda.stream(self._stream)
