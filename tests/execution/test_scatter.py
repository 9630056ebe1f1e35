"""Writes that are kept and made together are those made one by one."""

import numpy as np
import pytest
import warp as wp

from aoro_gym.envs.core.kernels.beginning import Drawn, write_drawn
from aoro_gym.envs.core.kernels.step import BEGUN, StepMemory
from aoro_gym.execution.array_api import HOST, Arrays
from aoro_gym.execution.scatter import RowWrites

torch = pytest.importorskip("torch")
pytest.importorskip("array_api_compat")


def writes(arrays):
    """Arrays of every type, rank and kind of index that tasks and sensors write."""
    xp, rows = arrays.xp, arrays.index(np.array([3, 1]))
    made = {
        "numbers": (arrays.zeros((3, 5)), (slice(None), rows), np.arange(6.0).reshape(3, 2)),
        "part": (arrays.zeros((4, 5)), (slice(1, 3), rows), np.array([[1.5], [-2.5]])),
        "whole": (arrays.zeros(5, xp.int64), rows, np.array([7.0, -8.0])),
        "single": (arrays.zeros((5, 2), xp.float32), rows, np.array([[0.1, 0.2], [0.3, np.nan]])),
        "flag": (arrays.zeros(5, xp.bool), rows, True),
        "places": (arrays.zeros((2, 5, 3)), (slice(None), rows), 0.25),
        "pairs": (
            arrays.zeros((3, 10)),
            (slice(None), arrays.index(np.array([6, 7, 2, 3]))),
            np.arange(12.0).reshape(3, 4),
        ),
        "last": (arrays.zeros((3, 5), xp.int64), (..., rows), np.arange(6).reshape(3, 2) - 2**62),
    }
    for array, index, value in made.values():
        arrays.put(array, index, value)
    return {name: array for name, (array, *_) in made.items()}


def test_together_is_one_by_one():
    plain, arrays = writes(HOST), Arrays.torch("cpu")
    with arrays.together():
        waiting = writes(arrays)
        assert not any(array.any() for array in waiting.values())
    assert plain.keys() == waiting.keys()
    for name, array in waiting.items():
        np.testing.assert_array_equal(array.numpy(), plain[name], err_msg=name)


def test_the_later_of_two_writes_counts():
    arrays = Arrays.torch("cpu")
    array, rows = arrays.zeros(4), arrays.index(np.array([2]))
    with arrays.together():
        arrays.put(array, rows, 1.0)
        arrays.put(array, rows, np.array([2.0]))
    assert array.tolist() == [0.0, 0.0, 2.0, 0.0]


def test_nothing_is_written_after_an_error():
    arrays = Arrays.torch("cpu")
    array, rows = arrays.zeros(4), arrays.index(np.array([2]))
    with pytest.raises(RuntimeError), arrays.together():
        arrays.put(array, rows, 1.0)
        raise RuntimeError
    assert not array.any()
    arrays.put(array, rows, 1.0)
    assert array.tolist() == [0.0, 0.0, 1.0, 0.0]


def begin(rows, places, bits):
    """Write ``bits`` as a step that begins the episodes of ``rows`` does; of five rows, who has an episode left."""
    memory, drawn, flags = StepMemory(), Drawn(), np.zeros(6, dtype=np.int32)
    flags[int(BEGUN)] = len(rows)
    of_all = np.zeros((5, bits.shape[1]), dtype=np.int64)
    of_all[rows] = bits
    memory.flags, memory.begun = wp.array(flags, dtype=int, device="cpu"), wp.array(rows, dtype=wp.int64, device="cpu")
    drawn.places, drawn.bits = (wp.array(each, dtype=wp.int64, device="cpu") for each in (places, of_all))
    drawn.ready = wp.ones(5, dtype=wp.bool, device="cpu")
    wp.launch(write_drawn, dim=1, inputs=[memory, drawn, 1], device="cpu")
    return drawn.ready.numpy()


def test_by_rows_is_one_by_one():
    """What is kept is not written, and can be written into other rows of the same arrays, in any order."""
    plain, arrays = writes(HOST), Arrays.torch("cpu")
    with arrays.kept() as kept:
        waiting = writes(arrays)
    assert not any(array.any() for array in waiting.values())
    tensors, indices, values = zip(*kept, strict=True)
    by_row = RowWrites(tensors, indices, 2)
    places, bits = by_row.places, np.empty((2, by_row.places.shape[1]), dtype=np.int64)
    by_row.fill(bits, values)
    assert len(kept) == len(plain)
    for rows in ([3, 1], [0, 4]):
        ready = begin(rows, places, bits)
        assert [row for row in range(5) if not ready[row]] == sorted(rows)
        for name, array in waiting.items():
            axis = 0 if name in ("whole", "single", "flag") else 1
            now, then = (each.reshape(3, 5, 2) if name == "pairs" else each for each in (array.numpy(), plain[name]))
            np.testing.assert_array_equal(np.take(now, rows, axis), np.take(then, [3, 1], axis), err_msg=name)


def test_writes_by_rows_are_told_from_others():
    """Of other arrays, of other parts of them and of other numbers of rows that are written as one."""
    array, one, two = torch.zeros((3, 8)), np.arange(2), np.arange(4)
    writes = RowWrites([array], [(slice(1, 3), one)], 2)
    assert writes.fits([array], [(slice(1, 3), two)], 4)
    for tensors, index, count in (
        ([array[:]], (slice(1, 3), one), 2),
        ([array], (slice(None), one), 2),
        ([array], (slice(1, 3), two), 2),
        ([array], (..., one), 2),
        ([array, array], (slice(1, 3), one), 2),
    ):
        assert not writes.fits(tensors, [index] * len(tensors), count)


def test_order_and_the_device_are_not_kept():
    """Rather than losing them, an error."""
    arrays = Arrays.torch("cpu")
    array, rows = arrays.zeros(4), arrays.index(np.array([2]))
    with arrays.kept(), pytest.raises(RuntimeError, match="twice"):
        arrays.put(array, rows, 1.0)
        arrays.put(array, rows, 2.0)
    with arrays.kept(), pytest.raises(RuntimeError, match="on the device"):
        arrays.put(array, rows, arrays.ones(1))
    arrays.put(array, rows, 1.0)
    assert array.tolist() == [0.0, 0.0, 1.0, 0.0]
