"""What is said of an installation."""

import tomllib
from importlib import metadata
from pathlib import Path

import pytest

from aoro_gym.benchmark import installation
from aoro_gym.benchmark.installation import DISTRIBUTION, PURPOSES, Part, Speed, parts, tables, to_json

PROJECT = tomllib.loads((Path(__file__).parents[2] / "pyproject.toml").read_text())["project"]


def test_every_part_has_its_purpose():
    assert set(PURPOSES) == set(PROJECT["optional-dependencies"])


def test_what_is_missing_is_named(monkeypatch):
    """Parts of parts included, each package once, and versions that do not fit."""
    lines = [
        "numpy>=2.0", "nobody>=1; extra == 'inner'", "numpy>=99; extra == 'outer'", "nobody; extra == 'outer'",
        f"{DISTRIBUTION}[inner]; extra == 'outer'", "pytest; extra == 'full'",
    ]  # fmt: skip
    about = metadata.metadata(DISTRIBUTION)
    monkeypatch.setattr(metadata, "requires", lambda name: lines)
    monkeypatch.setattr(type(about), "get_all", lambda self, name: ["inner", "outer", "full"])
    here = metadata.version("numpy")
    assert [(one.name, one.missing) for one in parts()] == [
        ("inner", ("nobody",)),
        ("outer", (f"numpy >=99 ({here} is here)", "nobody")),
        ("full", ()),
    ]


def test_this_installation_has_the_tests():
    assert {one.name: one.missing for one in parts()}["test"] == ()


def test_one_twin_is_faster_than_real_time(monkeypatch):
    monkeypatch.setattr(installation, "SIMULATED", 0.1)
    found = installation.speeds()
    assert found[0].device == "cpu" and found[0].step_us > 0.0
    assert found[0].real_time == pytest.approx(1e3 / found[0].step_us)


def test_tables_and_file_say_the_same():
    found = [Part("view", "see", ("viser",)), Part("video", "films", ())], [Speed("cpu", "one", 20.0)]
    content = to_json(*found)
    assert content["parts"][0] == {"part": "view", "for": "see", "missing": ["viser"]}
    assert content["devices"] == [{"device": "cpu", "name": "one", "step_us": 20.0, "times_real_time": 50.0}]
    versions, optional, speeds = tables(*found)
    assert [str(cell) for cell in versions.rows[0]] == ["aoro-gym", content["versions"]["aoro-gym"]]
    assert optional.rows == [["view", "see", "viser"], ["video", "films", "nothing"]]
    assert speeds.rows == [["cpu", "one", "20.0", "50"]]
