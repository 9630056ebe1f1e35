"""The report beside a saved mesh gives its place on Earth, or a warning that names the file."""

import json

import numpy as np
import pytest

from aoro_gym.terrains import Terrain, load
from aoro_gym.terrains.io import loading
from aoro_gym.terrains.io.check import Report

PLACE = {"origin_m": [430_000.0, 5_150_000.0, 300.0], "crs": "EPSG:32632"}


@pytest.fixture
def saved(tmp_path):
    """A function that saves a mesh with some text beside it and loads it again."""
    x, y = np.meshgrid(np.arange(20.0), np.arange(20.0))
    terrain = Terrain.from_heights(0.1 * x + 0.05 * y, cell=1.0)
    path, beside = loading.save(loading.Loaded(terrain, Report("made")), tmp_path / "ground.ply")

    def again(text: str):
        beside.write_text(text)
        return load(path)

    return again


def test_whole(saved):
    terrain, report = saved(json.dumps(PLACE))
    assert (list(terrain.origin), terrain.crs) == (PLACE["origin_m"], PLACE["crs"])
    assert report.warnings == []


@pytest.mark.parametrize(
    "text", ["[]", "{}", '{"name": "some other program"}', '{"origin_m": [0, 0, 0], "crs": null}', "3"]
)
def test_other_files_are_none_of_ours(saved, text):
    terrain, report = saved(text)
    assert terrain.crs is None
    assert report.warnings == []


BROKEN = {
    "NaN": json.dumps(PLACE | {"origin_m": [float("nan"), 0.0, 0.0]}),
    "infinite": json.dumps(PLACE | {"origin_m": [0.0, float("inf"), 0.0]}),
    "text": json.dumps(PLACE | {"origin_m": ["430000", "5150000", "0"]}),
    "two numbers": json.dumps(PLACE | {"origin_m": [1.0, 2.0]}),
    "booleans": json.dumps(PLACE | {"origin_m": [True, False, True]}),
    "nested": json.dumps(PLACE | {"origin_m": [[1.0], 2.0, 3.0]}),
    "a dictionary": json.dumps(PLACE | {"origin_m": {"x": 1.0}}),
    "400 digits": json.dumps(PLACE).replace("430000.0", "9" * 400),
    "5000 digits": json.dumps(PLACE).replace("430000.0", "9" * 5000),
    "crs unknown": json.dumps(PLACE | {"crs": "EPSG:1"}),
    "crs in degrees": json.dumps(PLACE | {"crs": "EPSG:4326"}),
    "crs a number": json.dumps(PLACE | {"crs": 32632}),
    "deep": "[" * 100_000,
    "cut off": json.dumps(PLACE)[:30],
    "no JSON": "origin: 1 2 3",
}


@pytest.mark.parametrize("name", BROKEN)
def test_what_is_broken_is_passed_over_with_a_warning(saved, name):
    terrain, report = saved(BROKEN[name])
    assert terrain.crs is None
    assert terrain.origin == (0.0, 0.0, 0.0)
    (text,) = report.warnings
    assert "ground.json is passed over" in text
    assert "\n" not in text
    assert len(text) < 500


def test_lengths_that_are_not_those_on_the_ground_are_said(saved):
    _, report = saved(json.dumps({"origin_m": [2_671_667.0, 8_399_737.0, 0.0], "crs": "EPSG:3857"}))
    assert any("2 times those on the ground" in text for text in report.warnings)
