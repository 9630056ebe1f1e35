"""The study that measures by which form twins of a GPU are advanced."""

import sys

import pytest

from aoro_gym.twin import forms
from studies import roles


def test_rates_are_of_the_forms_that_are_asked_for():
    found = roles.rates(2, "cpu", 1, {"one_thread": False, "as it is": None})
    assert set(found) == {"one_thread", "as it is"} and min(found.values()) > 0.0


def test_it_needs_a_gpu(tmp_path, monkeypatch):
    monkeypatch.setattr(sys, "argv", ["roles", str(tmp_path / "out.json"), "--device", "cpu", "--twins", "2"])
    with pytest.raises(ValueError, match="these twins run on a CPU"):
        roles.main()


def test_the_table_of_the_package_is_one_of_it():
    table = forms.measured()
    assert set(table) == {"card", "scene", "steps_per_s"}
    assert all(set(row) == set(roles.FORMS) for row in table["steps_per_s"].values())
