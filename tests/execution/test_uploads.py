"""Rows that go to a device beside what it computes."""

import numpy as np
import pytest
import warp as wp

from aoro_gym.execution.array_api import Arrays
from aoro_gym.execution.uploads import Uploads

torch = pytest.importorskip("torch")
pytest.importorskip("array_api_compat")
DEVICES = [
    "cpu",
    pytest.param("cuda:0", marks=pytest.mark.skipif(not wp.is_cuda_available(), reason="needs a CUDA device")),
]


@pytest.mark.parametrize("device", DEVICES)
def test_rows_are_there_for_what_follows_and_the_others_stay(device):
    """Many times over, while the device has much to do: whoever reads too early, or writes too early, would see it."""
    arrays = Arrays.torch(device)
    there, busy = arrays.zeros((50, 400), torch.int64), arrays.ones((500, 500))
    uploads, expected = Uploads(arrays), np.zeros((50, 400), dtype=np.int64)
    uploads.follow()
    for turn in range(20):
        rows = np.arange(turn % 7, 50, 7)
        values = np.arange(400) + 1000 * turn + rows[:, None]
        before = there.clone()  # reads what was there, after much else
        for _ in range(10):
            busy = busy @ busy / 500.0
        before = before + there
        uploads.follow()
        index = uploads.send(there, rows, lambda here, values=values: np.copyto(here, values))
        uploads.arrive(index)
        marked = arrays.zeros(50, torch.bool).index_fill_(0, index, True)
        np.testing.assert_array_equal(before.cpu().numpy(), 2 * expected)
        expected[rows] = values
        np.testing.assert_array_equal(there.cpu().numpy(), expected)
        assert np.flatnonzero(marked.cpu().numpy()).tolist() == rows.tolist()


@pytest.mark.parametrize("device", DEVICES)
def test_rows_follow_what_was_asked_for_a_turn_before(device):
    """Each turn reads some rows, after much else, and sends those that the turn before read."""
    arrays = Arrays.torch(device)
    there, busy = arrays.zeros((50, 400), torch.int64), arrays.ones((500, 500))
    uploads, expected = Uploads(arrays), np.zeros((50, 400), dtype=np.int64)
    uploads.follow()
    index = [arrays.uploaded(np.arange(start, 50, 5)) for start in range(5)]
    seen = []
    for turn in range(20):
        for _ in range(10):
            busy = busy @ busy / 500.0
        seen.append((there[index[turn % 5]], expected[turn % 5 :: 5].copy()))
        uploads.follow_last()
        if turn > 0:
            rows = np.arange((turn - 1) % 5, 50, 5)
            values = np.arange(400) + 1000 * turn + rows[:, None]
            sent = uploads.send(there, rows, lambda here, values=values: np.copyto(here, values))
            expected[rows] = values
            if turn % 5 == 4:  # before rows are read again
                uploads.arrive(sent)
    for read, then in seen:
        np.testing.assert_array_equal(read.cpu().numpy(), then)
