"""Mixtures: parts of several families in one machine, each with its own constants, laws, effects, days and measuring."""

import importlib

import numpy as np
import pytest

from aoro_gym.diagnosis_benchmark import component_families as component
from aoro_gym.diagnosis_benchmark.component_families.parts import (
    ALL_FAMILIES,
    CONSTANTS,
    FAMILIES,
    LAWS,
    PART_OF,
    PARTS,
    SEALED,
    Family,
    family_of,
    laws_of,
    mixture,
)

DRAWN = [mixture(FAMILIES, number) for number in range(100)]
MIXED = next(name for name in DRAWN if set(family_of(name).parts.values()) == set(FAMILIES))
"""A machine with a part of every family."""


def module(family: str):
    return importlib.import_module(f"aoro_gym.diagnosis_benchmark.component_families.{family}")


def log_of(name: str, machine: dict[str, float]) -> dict[str, np.ndarray]:
    """A start and a held turn with a slow drive, noise and all."""
    steering, drive = np.r_[np.zeros(8), np.full(40, 0.8)], np.full(48, 0.2)
    (log,) = component.record([component.Run(name, machine, steering, {"oil_temperature": 12.0}, drive, 0.1, 5)])
    return log


@pytest.mark.parametrize("family", FAMILIES)
def test_a_mixture_of_one_family_is_that_family(family: str) -> None:
    alone = mixture([family], 3)
    machine = component.machine(family, np.random.default_rng(2))
    assert list(machine.items()) == list(component.machine(alone, np.random.default_rng(2)).items())
    days = [component.another_day(name, machine, np.random.default_rng(3)) for name in (family, alone)]
    assert days[0] == days[1] != machine
    assert component.magnitudes(family, days[0]) == component.magnitudes(alone, days[0])
    for one, other in zip(*(log_of(name, days[0]).values() for name in (family, alone)), strict=True):
        np.testing.assert_array_equal(one, other)


def test_every_constant_is_of_one_part() -> None:
    names = [name for part in CONSTANTS.values() for name in part]
    assert len(names) == len(set(names))
    assert set(names) == {name for family in ALL_FAMILIES for name in module(family).TABLE}
    for family in ALL_FAMILIES:
        assert dict(family_of(family).TABLE) == dict(module(family).TABLE)
        for constants in module(family).REALISED.values():
            assert len({PART_OF[name] for name in constants}) == 1  # an effect has one part


def test_no_mixture_has_a_part_of_a_family_that_judges() -> None:
    assert not set(FAMILIES) & set(SEALED)
    assert mixture(ALL_FAMILIES, 3) == mixture(FAMILIES, 3)
    for family in SEALED:
        with pytest.raises(ValueError, match="family must be one of"):
            family_of(f"mixed_elm_{family}_0001")


def test_a_mixture_has_the_constants_of_its_parts() -> None:
    found = family_of(MIXED)
    assert set(found.parts.values()) == set(FAMILIES) and tuple(found.parts) == PARTS
    for part, family in found.parts.items():
        own = {name: one for name, one in module(family).TABLE.items() if PART_OF[name] == part}
        assert {name: found.TABLE[name] for name in own} == own
    assert len(found.TABLE) == sum(PART_OF[n] == part for part, f in found.parts.items() for n in module(f).TABLE)
    assert set(component.magnitudes(MIXED, component.nominal(MIXED))) == set(component.EFFECTS)


def test_draws_differ_and_take_every_family_for_every_part() -> None:
    some = [family_of(name).parts for name in DRAWN]
    assert all({one[part] for one in some} == set(FAMILIES) for part in PARTS)
    assert len({tuple(one.values()) for one in some}) == len(some)
    assert set(family_of("mixed_elm_hazel_0004").parts.values()) <= {"elm", "hazel"}
    assert family_of(MIXED).parts == family_of.__wrapped__(MIXED).parts


def test_each_law_is_that_of_its_part() -> None:
    laws = laws_of(MIXED, component.GROUP.structure(MIXED))
    for part, names in LAWS.items():
        own = importlib.import_module(
            f"{module(family_of(MIXED).parts[part]).__package__}.laws.{family_of(MIXED).parts[part]}"
        )
        assert all(getattr(laws, law) is getattr(own, law) for law in names)


def test_warm_oil_is_thin_for_hydraulics_and_seals_alike() -> None:
    """The oil's law is that of the hydraulics; seals of whatever family read the same viscosity [Pa s] off the inputs."""
    for number in range(12):
        name = mixture(FAMILIES, number)
        oil = family_of(name).parts["hydraulics"]
        machine = component.nominal(name)
        warm = component.apply("oil_temperature", name, machine, 20.0)
        both = [family_of(name).derived(one)["viscosity"] for one in (machine, warm)]
        kelvin = np.array([machine["temperature"], warm["temperature"]])
        same = [family_of(oil).derived(component.nominal(oil) | {"temperature": t})["viscosity"] for t in kelvin]
        assert both == same
        assert 0.3 < both[1] / both[0] < 0.6  # VG46 from 35 to 55 °C: 57 to 25 mm²/s


def test_days_vary_as_those_of_each_part() -> None:
    rng, machine = np.random.default_rng(3), component.nominal(MIXED)
    days = [component.another_day(MIXED, machine, rng) for _ in range(400)]
    for name in ("seal_force", "hinge_torque", "temperature", "ground_friction", "brake_torque"):
        spread = np.std(np.log([day[name] / machine[name] for day in days]))
        expected = module(family_of(MIXED).parts[PART_OF[name]]).TABLE[name].day
        assert spread == pytest.approx(expected, rel=0.15)  # 400 days: 3.5 % and the cut at two deviations: 5 %


@pytest.mark.parametrize(
    "name",
    ["spruce", "mixed", "mixed_0001", "mixed_fir_elm_0001", "mixed_elm_elm_0001", "mixed_elm_7", "mixed_pine_0001"],
)
def test_what_is_no_family_is_an_error(name: str) -> None:
    with pytest.raises(ValueError, match="family must be one of"):
        family_of(name)


def test_a_family_has_no_formula_of_that_name() -> None:
    with pytest.raises(AttributeError, match="no 'colour'"):
        _ = Family("elm", dict.fromkeys(PARTS, "elm")).colour
