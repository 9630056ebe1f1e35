"""The command ``laws``."""

import json

import pytest

from aoro_gym.cli import options
from aoro_gym.machine import Machine
from aoro_gym.machine.laws import FAMILIES, OPTIONS
from tests.cli.calling import call, check_refused


def test_laws_options_and_families_are_listed():
    shown = call("laws")
    assert shown.exit_code == 0
    for name in (*OPTIONS, *(option for each in OPTIONS.values() for option in each), *FAMILIES):
        assert name in shown.stdout, name


def test_a_pattern_and_the_machine_choose_what_is_shown(tmp_path):
    file = tmp_path / "mine.toml"
    Machine.load("aoro").with_laws(hose="viscoelastic").save(file, base="aoro")
    shown = call("laws", "hose", "--machine", file).stdout
    assert "* viscoelastic" in shown
    assert "* linear" not in shown
    assert "spool" not in shown
    assert "* stiffening" in call("laws", "hose", "--machine", file, "--laws", "vehicle").stdout


def test_json_has_parameters_by_option():
    content = json.loads(call("laws", "*_ground", "--json", "--set", "tire.bulldozing_resistance=0.1").stdout)
    assert content["families"] == FAMILIES
    (law,) = content["laws"]
    assert (law["law"], law["chosen"]) == ("soft_ground", "rolling")
    rolling, bulldozing = law["options"]
    assert rolling == {"option": "rolling", "parameters": []}
    assert [(one["key"], one["value"]) for one in bulldozing["parameters"]] == [("tire.bulldozing_resistance", 0.1)]


def test_one_machine_has_laws_drawn_by_the_seed():
    def drawn(seed, **more):
        return options.load(options.run_spec("aoro", None, None, seed=seed, laws="any"), **more).laws

    assert drawn(3).names == drawn(3).names == Machine.load("aoro").sample(1, laws="any", seed=3).variant(0).laws.names
    assert drawn(3).names != drawn(4).names
    assert drawn(3, draw=False).default


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ("laws nothing", "no law matches 'nothing'; 'aoro-gym laws' lists all"),
        (
            "laws --laws libary",
            "--laws libary: there is no family of laws 'libary': did you mean 'library'? Choose one of",
        ),
        (
            "simulate -m left --laws steam",
            "--laws steam: there is no family of laws 'steam': choose one of default, library",
        ),
        ("validate --laws libary", "--laws libary: "),
        ("validate --recalibrate --laws library", "drop --machine, --set, --scale and --laws"),
        ("bench --laws libary", "--laws libary: "),
        ("evaluate --laws library,any", "--laws library,any: there is no family of laws 'any'"),
        (
            "evaluate --perturbation odd",
            "perturbation is 'odd'; choose one of: as calibrated, perturbed, with an effect",
        ),
        ("train --laws libary", "--laws libary: "),
        ("calibrate --published --laws libary", "--laws libary: "),
        ("leaderboard --laws libary", "--laws libary: "),
        ("gap --policy preview --improved aoro --laws libary", "--laws libary: "),
    ],
)
def test_wrong_input_is_one_line_before_anything_runs(files, arguments, message):
    check_refused(arguments, message)
