"""Arrays of a device on the host."""

import numpy as np
import pytest

from aoro_gym.execution.array_api import HOST, Arrays, packed, unpacked

torch = pytest.importorskip("torch")
pytest.importorskip("array_api_compat")


@pytest.mark.parametrize("way", ["hosts", "packed"])
def test_several_arrays_come_at_once(way):
    """Of any type, order and layout, whole or parts; they are copies."""
    given = {
        "flags": np.array([True, False, True]),
        "doubles": np.linspace(0.0, 1.0, 6).reshape(3, 2),
        "singles": np.arange(12, dtype=np.float32).reshape(3, 4)[:, 1:3],
        "numbers": np.array([2**62, -1, 0]),
        "none": np.zeros((0, 2), dtype=np.float32),
        "words": np.array([1, 2], dtype=np.int32),
    }
    arrays = Arrays.torch("cpu")
    tensors = [torch.from_numpy(each.copy()) for each in given.values()]
    tensors[2] = torch.arange(12, dtype=torch.float32).reshape(3, 4)[:, 1:3]  # not contiguous
    shown = arrays.hosts(*tensors) if way == "hosts" else unpacked(packed(tensors).numpy(), tensors)
    for tensor in tensors:
        tensor.zero_()
    for (name, values), got in zip(given.items(), shown, strict=True):
        assert got.dtype == values.dtype, name
        np.testing.assert_array_equal(got, values, err_msg=name)
        assert got.flags.aligned and got.flags.writeable


def test_those_of_the_host_are_themselves():
    one = np.ones(3)
    assert HOST.hosts(one)[0] is one
