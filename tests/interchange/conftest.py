"""Machines that are exported: the calibrated one, and uneven ones whose values no two are alike, one of them with logs."""

import numpy as np
import pytest

from aoro_gym import Machine
from tests.oracles.bodies import uneven_machines


@pytest.fixture(scope="package")
def calibrated():
    return Machine.load("aoro")


@pytest.fixture(scope="package")
def machines(calibrated):
    uneven = uneven_machines(calibrated, np.random.default_rng(4), 3)
    variants = [uneven.variant(i) for i in range(3)]
    return [*variants[:2], variants[2].set({"payload.count": 25.0})]
