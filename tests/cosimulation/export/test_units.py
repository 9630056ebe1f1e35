"""Units as FMI defines them."""

import math

import pytest

from aoro_gym.cosimulation.export.units import base_units, definitions
from aoro_gym.machine.quantities import UNITS


@pytest.mark.parametrize(
    ("unit", "exponents", "factor"),
    [
        ("1", {}, 1.0),
        ("bar", {"kg": 1, "m": -1, "s": -2}, 1e5),
        ("N*m*s/rad", {"kg": 1, "m": 2, "s": -1, "rad": -1}, 1.0),
        ("rad/N/m", {"rad": 1, "kg": -1, "m": -2, "s": 2}, 1.0),
        ("L/min", {"m": 3, "s": -1}, 1e-3 / 60.0),
        ("cm^3/rev", {"m": 3, "rad": -1}, 1e-6 / (2.0 * math.pi)),
        ("m^3/s/Pa", {"m": 4, "s": 1, "kg": -1}, 1.0),
        ("N/Pa", {"m": 2}, 1.0),
        ("V", {"kg": 1, "m": 2, "s": -3, "A": -1}, 1.0),
    ],
)
def test_units_by_base_units(unit, exponents, factor):
    found, size = base_units(unit)
    assert found == exponents
    assert size == pytest.approx(factor, rel=1e-15)


def test_every_unit_of_the_machine_file_has_the_exponents_of_its_si_unit():
    for unit, (si, _) in UNITS.items():
        assert base_units(unit)[0] == base_units(si)[0], unit
    assert definitions(["bar", "bar", "1"]) == {"1": {}, "bar": {"kg": "1", "m": "-1", "s": "-2", "factor": "100000.0"}}
