"""What the tests of plants share."""

import pytest

from aoro_gym.diagnosis_benchmark.plants.constants import constants_of


@pytest.fixture(scope="module")
def constants(machine):
    return constants_of([machine.entries])
