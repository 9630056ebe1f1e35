"""Arrays in one piece of memory are as those that have their own."""

from typing import Any, cast

import numpy as np
import warp as wp

from aoro_gym.execution.together import Together

KINDS: Any = (wp.vec3, wp.bool, wp.uint16, wp.float32)
SHAPES = ((2, 3), (5,), (2, 2, 3), (7,))


def test_one_copy_brings_home_what_each_array_was_given() -> None:
    home = Together(SHAPES, KINDS, device="cpu")
    rng = np.random.default_rng(1)
    given = [
        rng.integers(0, 2, (*shape, *getattr(kind, "_shape_", ()))) for shape, kind in zip(SHAPES, KINDS, strict=True)
    ]
    for array, values, kind in zip(home.arrays, given, KINDS, strict=True):
        wp.copy(array, wp.array(values, dtype=kind, device="cpu"))
    for found, values in zip(home.home(), given, strict=True):
        np.testing.assert_array_equal(cast(Any, found), values)
    assert [found.dtype for found in home.home()] == [np.float32, np.bool_, np.uint16, np.float32]
