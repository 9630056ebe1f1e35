"""What the tests of plants share."""

from typing import Any

import numpy as np
import pytest
import warp as wp

from aoro_gym.diagnosis_benchmark.plants.constants import constants_of
from aoro_gym.diagnosis_benchmark.plants.records import f64


@pytest.fixture(scope="module")
def constants(machine):
    return constants_of([machine.entries])


@pytest.fixture(scope="session")
def mapped():
    """Asks a Warp function of numbers for arrays (N,) of them."""

    def ask(function, *arguments):
        arrays = np.broadcast_arrays(*(np.asarray(a, dtype=np.float64) for a in arguments))
        found: Any = wp.map(function, *(wp.array(np.atleast_1d(a), dtype=f64, device="cpu") for a in arrays))
        return found.numpy()

    return ask
