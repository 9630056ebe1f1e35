"""The command ``export machine``."""

import json
from xml.etree import ElementTree

import pytest

from aoro_gym import Machine
from tests.cli.calling import call, check_refused


@pytest.fixture(autouse=True)
def _in_an_empty_folder(monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)


@pytest.mark.parametrize(("format_", "name", "root"), [("mjcf", "m.xml", "mujoco"), ("urdf", "sub/m.urdf", "robot")])
def test_writes_file_and_figures_and_lists_what_is_missing(tmp_path, format_, name, root):
    shown = call("export", "machine", "--format", format_, "--scale", "frame.front.mass=1.01", "--out", name)
    assert shown.exit_code == 0
    assert ElementTree.parse(tmp_path / name).getroot().tag == root
    figures = json.loads((tmp_path / f"{name}.json").read_text(encoding="utf-8"))
    assert figures["made_by"]["machine"] == {"file": "aoro", "set": [], "scale": ["frame.front.mass=1.01"]}
    assert figures["bodies"]["front_frame"]["mass"] == pytest.approx(
        1.01 * float(Machine.load("aoro").frame.front.mass)
    )
    assert f"What {format_.upper()} cannot say" in shown.stdout
    assert all(one["part"] in shown.stdout for one in figures["not_said"])
    assert shown.stdout.strip().splitlines()[-2:] == [f"wrote {name}", f"wrote {name}.json"]


def test_wrong_input_is_one_line():
    check_refused("export machine --format usd --out a.usd", "format is 'usd'; choose one of: mjcf, urdf")
    check_refused(
        "export machine --format urdf --out a.xml", "a.xml ends in '.xml'; name a file that ends in .urdf for urdf"
    )
    check_refused("export machine --format urdf --out a.urdf --machine no.toml", "no.toml")
    check_refused("export machine --format mjcf --out a.xml --set arm.length=-1", "arm.length = -1 m")
