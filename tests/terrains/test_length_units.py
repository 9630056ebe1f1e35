"""Names of units of length: whatever people and libraries write, nothing that is another quantity."""

import doctest

import pytest

from aoro_gym.terrains import length_units
from aoro_gym.terrains.length_units import UNITS, is_unspecified, unit_named

NAMES = {
    "m": ["m", "M", "metre", "Meters", "[m]", "mètre", "metres above sea level", "m (NAVD88)", "m a.s.l.", "EPSG:9001"],
    "dm": ["dm", "decimetre", "Decimeters"],
    "cm": ["cm", "centimetre", "CENTIMETERS", "height in cm", "centi-metre"],
    "mm": ["mm", "millimetre", "milli_meter"],
    "km": ["km", "Kilometres"],
    "ft": ["ft", "foot", "Feet", "International foot", "[ft_i]", "foot_international", "9002"],
    "us-ft": [
        "us-ft",
        "ftUS",
        "Foot_US",
        "FootUS",
        "US survey foot",
        "U.S. Survey Feet",
        "feet_us",
        "survey foot",
        "US-ft",
    ],
    "in": ["in", "inch"],
}


def test_example():
    assert doctest.testmod(length_units).failed == 0


@pytest.mark.parametrize(("unit", "names"), NAMES.items())
def test_names(unit, names):
    for name in names:
        found = unit_named(name)
        assert found is not None, name
        assert found.name == unit, name
        assert found.metres == pytest.approx(UNITS[unit], rel=1e-12), name


def test_units_of_epsg_besides():
    """Factors of EPSG's register."""
    for name, metres in {
        "yard": 0.9144,
        "Fathom": 1.8288,
        "Clarke's foot": 0.3047972654,
        "Indian yards": 0.914398530744441,
    }.items():
        found = unit_named(name)
        assert found is not None
        assert found.metres == metres


@pytest.mark.parametrize(
    "name", ["m/s", "m2", "m^2", "furlong", "degrees", "dB", "K", "", "unknown", "1", "m" * 200, "\x00"]
)
def test_what_is_no_length(name):
    assert unit_named(name) is None


def test_words_that_say_nothing():
    assert all(is_unspecified(text) for text in ("", "Unknown", "N/A", "not set"))
    assert not any(is_unspecified(text) for text in ("dB", "furlong", "m"))
