"""Machines as commands ask for them: files, changes, laws."""

import pytest

from aoro_gym.machine import Machine
from aoro_gym.machine.specification import MachineSpec, RunSpec


def test_a_specification_gives_the_machine_with_its_changes_and_laws():
    spec = MachineSpec("aoro", ("frame.front.mass=3900",), ("oil.gas_fraction=2",), "library")
    machine, warnings = spec.load()
    plain = Machine.load("aoro")
    assert machine.entries["frame.front.mass"].value == 3900.0
    assert machine.entries["oil.gas_fraction"].value == 2.0 * plain.entries["oil.gas_fraction"].value
    assert machine.laws.names == plain.with_laws("library").laws.names
    assert all(sentence.startswith(("frame.front.mass", "oil.gas_fraction")) for sentence in warnings)
    assert spec.changed
    assert spec.sentence == "Machine aoro, with frame.front.mass=3900, oil.gas_fraction x 2, library laws."


def test_results_record_laws_that_are_not_the_files():
    assert RunSpec(MachineSpec("aoro", laws="any")).to_json()["machine"]["laws"] == "any"
    assert MachineSpec("aoro").to_json() == {"file": "aoro", "set": [], "scale": []}


@pytest.mark.parametrize("laws", ["families", "any", "library,vehicle"])
def test_laws_that_are_to_be_drawn_are_the_files_yet(laws):
    spec = MachineSpec("aoro", laws=laws)
    assert spec.draws_laws
    assert spec.load()[0].laws.default
    assert spec.sentence == f"Machine aoro, with laws drawn from {laws}."


def test_an_unknown_family_is_named_with_those_that_there_are():
    with pytest.raises(
        ValueError, match=r"^--laws libary: there is no family of laws 'libary': did you mean 'library'\?"
    ):
        MachineSpec("aoro", laws="libary").load()
