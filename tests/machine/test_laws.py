"""Choices of laws: names and numbers, families, machine files, variants, samples."""

import numpy as np
import pytest

from aoro_gym.machine import Machine
from aoro_gym.machine.laws import FAMILIES, LAWS, OPTIONS, Laws, drawn_laws, draws, family
from aoro_gym.twin.records import LAW_FIELDS, pack


def at(record, path):
    for name in path.split("."):
        record = record[name]
    return record


def test_the_default_laws_are_the_first_options(machine: Machine) -> None:
    assert machine.laws.default
    assert machine.laws.names == {law: options[0] for law, options in OPTIONS.items()}
    assert "laws" not in machine.identity


@pytest.mark.parametrize("law", OPTIONS)
def test_every_option_reaches_the_device(machine: Machine, law: str) -> None:
    chosen = machine.with_laws(**{law: OPTIONS[law]})
    record = pack(chosen)
    assert np.array_equal(at(record, LAW_FIELDS[law]), np.arange(len(OPTIONS[law])))
    assert np.all(record["varies_laws"] == 1)
    others = {name: number for name, number in chosen.laws.choices.items() if name != law}
    assert not any(others.values())


def test_families_differ_and_every_option_but_few_is_in_one() -> None:
    assert len(FAMILIES) >= 5
    numbers = {name: tuple(family(name).choices.values()) for name in FAMILIES}
    assert len(set(numbers.values())) == len(FAMILIES)
    used = {(law, option) for name in FAMILIES for law, option in family(name).names.items()}
    assert used == {(law, option) for law, options in OPTIONS.items() for option in options}


@pytest.mark.parametrize("base", [None, "aoro"])
def test_a_machine_file_carries_the_choice(machine: Machine, tmp_path, base) -> None:
    path = tmp_path / "own.toml"
    for chosen in (machine.with_laws("materials", hose="linear"), machine):
        chosen.save(path, base=base)
        assert Machine.load(path).laws.names == chosen.laws.names
    over = tmp_path / "over.toml"
    machine.with_laws("library").save(path, base=base)
    machine.save(over, base="own.toml")  # back to the default ones
    assert Machine.load(over).laws.default


def test_a_file_without_the_parameters_of_laws_has_those_of_the_data_sheet(machine: Machine, tmp_path) -> None:
    path = tmp_path / "old.toml"
    machine.save(path)
    tables = path.read_text().split("\n\n[")
    path.write_text("\n\n[".join(table for table in tables if 'role = "law"' not in table))
    assert Machine.load(path).value("oil.solution_pressure") == machine.value("oil.solution_pressure")


@pytest.mark.parametrize(
    ("table", "names"),
    [
        ('[laws]\nfamily = "libary"', ["'libary'", "'library'"]),
        ('[laws]\ngas = "steam"', ["laws.gas", "'steam'", "dissolving"]),
        ('[laws]\ngasses = "isothermal"', ["'gasses'", "'gas'"]),
        ("[laws]\ngas = 1", ["laws.gas = 1", "text"]),
        ('laws = "library"', ["laws", "table"]),
    ],
)
def test_a_wrong_choice_is_named_with_what_there_is(tmp_path, table: str, names: list[str]) -> None:
    path = tmp_path / "own.toml"
    path.write_text(f'base = "aoro"\n{table}\n')
    with pytest.raises(ValueError, match=r"own\.toml") as error:
        Machine.load(path)
    assert all(name in str(error.value) for name in names)


def test_variants_keep_their_laws(machine: Machine) -> None:
    batch = machine.with_laws(gas=["isothermal", "adiabatic", "dissolving"])
    assert batch.num_variants == 3
    assert batch.variant(-1).laws.names["gas"] == "dissolving"
    assert batch.variants([2, 0, 0]).laws.names["gas"] == ["dissolving", "isothermal", "isothermal"]
    assert batch.set({"frame.front.mass": 3900.0}).laws.names == batch.laws.names
    with pytest.raises(ValueError, match="laws"):
        batch.set({"frame.front.mass": [3900.0, 4000.0]})
    with pytest.raises(ValueError, match="laws"):
        batch.save("never.toml")


def test_stacked_laws_stand_one_after_the_other() -> None:
    stacked = Laws.stacked([Laws(), family("library").with_options({"gas": ["isothermal", "adiabatic"]})], [2, 2])
    assert stacked.names["gas"] == ["polytropic", "polytropic", "isothermal", "adiabatic"]
    assert stacked.names["slip"] == ["lugre", "lugre", "relaxation", "relaxation"]
    assert stacked.hose == 0


def test_samples_stay_within_their_share_of_the_ranges_and_repeat_by_seed(machine: Machine) -> None:
    share, count = 0.5, 200
    drawn = machine.sample(count, laws="families", parameters=share, seed=4)
    again = machine.sample(count, laws="families", parameters=share, seed=4)
    assert drawn.num_variants == count
    for key, entry in drawn.entries.items():
        assert np.array_equal(entry.value, again.entries[key].value)
        own = machine.entries[key]
        if own.role in ("fixed", "effect"):
            assert np.all(entry.value == own.value)
            continue
        (low, high), value = own.range, own.value
        assert np.all(entry.value >= value + share * min(low - value, 0.0) - 1e-9 * abs(value))
        assert np.all(entry.value <= value + share * max(high - value, 0.0) + 1e-9 * abs(value))
    shares = np.bincount(drawn.laws.gas, minlength=4) / count
    expected = np.bincount([int(family(name).gas) for name in FAMILIES], minlength=4) / len(FAMILIES)
    assert np.all(np.abs(shares - expected) < 4.0 * np.sqrt(0.25 / count))  # four standard deviations at most


def test_samples_of_any_laws_have_every_option(machine: Machine) -> None:
    drawn = machine.sample(400, laws="any", seed=1)
    for law, options in OPTIONS.items():
        assert set(np.unique(drawn.laws.choices[law])) == set(range(len(options))), law
    assert machine.sample(1).laws.default


@pytest.mark.parametrize(
    ("given", "named"),
    [
        ({"count": 0}, "count"),
        ({"count": 2, "parameters": 1.5}, "parameters"),
        ({"count": 2, "laws": "librari"}, "library"),
    ],
)
def test_a_wrong_sample_is_refused(machine: Machine, given, named) -> None:
    with pytest.raises(ValueError, match=named):
        machine.sample(given.pop("count"), **given)


def test_every_parameter_of_the_role_belongs_to_an_option(machine: Machine) -> None:
    named = {key for law in LAWS.values() for keys in law.parameters.values() for key in keys}
    assert named == {key for key, entry in machine.entries.items() if entry.role == "law"}
    for law in LAWS.values():
        assert set(law.parameters) <= set(law.options[1:]), law


def test_what_leaves_laws_to_be_drawn() -> None:
    assert not any(draws(which) for which in (None, "default", "library"))
    assert all(draws(which) for which in ("families", "any", "library,vehicle"))
    drawn = drawn_laws("library, vehicle", 50, np.random.default_rng(0))
    assert drawn.names["slip"] == "relaxation"  # of both
    assert set(drawn.names["friction"]) == {"stribeck_tanh", "coulomb_viscous"}
    for which in ("libary", "library,libary", "library,any"):
        with pytest.raises(ValueError, match=r"there is no family of laws '(libary|any)'.*, materials, families, any"):
            draws(which)


def test_machines_are_stacked_with_their_values_and_laws() -> None:
    """One after the other, each as often as it counts; what all share stays one value."""
    shipped = Machine.load("aoro")
    heavier = shipped.scale({"frame.rear.mass": 1.1}).with_laws("materials")
    drawn = shipped.sample(2, laws="any", parameters=0.2, seed=1)
    stacked = Machine.stacked([heavier, drawn, shipped], [3, 2, 1])
    assert stacked.num_variants == 6
    for place, one in enumerate([heavier, heavier, heavier, drawn.variant(0), drawn.variant(1), shipped]):
        again = stacked.variant(place)
        assert {key: again.value(key) for key in shipped.entries} == {key: one.value(key) for key in shipped.entries}
        assert again.laws.names == one.laws.names
    assert isinstance(stacked.value("steering.cylinder.bore"), float)
    assert Machine.stacked([shipped], [1]).num_variants == 1
