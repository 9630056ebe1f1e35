"""With ``--json -`` a command prints its results as JSON, and nothing else; ``--quiet`` leaves its tables out."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from aoro_gym.cli import outcome
from aoro_gym.reporting import terminal
from tests.cli.calling import call, check_refused

TURNING = ("--env", "AORO/Turning-v0")
TINY = ("--steps", 500, "--n-envs", 2, "--checkpoint-every", 250, "--eval-episodes", 1, "--param", "batch_size=64")


@pytest.fixture(scope="module")
def place(tmp_path_factory, turn) -> Path:
    """A folder with a log, a bag and a ground."""
    folder = tmp_path_factory.mktemp("json")
    np.save(folder / "ground.npy", np.add.outer(np.zeros(61), 0.02 * np.arange(61.0)))
    for suffix in (".csv", ".toml"):
        (folder / "log").with_suffix(suffix).write_bytes(turn[0].with_suffix(suffix).read_bytes())
    return folder


def check(place, monkeypatch, *arguments: object) -> Any:
    """JSON of a command, which stands alone on the standard output."""
    monkeypatch.chdir(place)
    shown = call(*[str(one) for one in arguments], "--json", "-", "--quiet")
    assert shown.exit_code == 0, shown.output
    found = json.loads(shown.stdout)
    assert found
    return found


@pytest.mark.parametrize(
    ("command", "key"),
    [
        ("parameters steering.valve", None),
        ("laws hose", "laws"),
        ("simulate -m drive --duration 0.7 --out drive.csv", "figures"),
        ("terrain ground.npy --cell 1", "warnings"),
        ("log convert log.csv log.mcap", "written"),
        ("log map log.mcap", "columns"),
        ("diagnose --check log.csv", "read"),
        ("export machine --format urdf --out aoro.urdf", "not_said"),
    ],
    ids=lambda one: one and one.split(" -")[0],
)
def test_results_are_json_alone(place, monkeypatch, command, key):
    found = check(place, monkeypatch, *command.split())
    assert isinstance(found, list) if key is None else key in found


@pytest.mark.slow
@pytest.mark.parametrize(
    "command",
    [
        ("demo",),
        ("validate", "--ensemble", "none"),
        ("study", "--scale", "steering.hose_bulk_modulus=0.9"),
        ("calibrate", "--logs", "log.csv", "--laws", "default", "--starts", 1, "--population", 2, "--force"),
        ("diagnose", "log.csv"),
        ("world", "--size", 30, 30),
        ("lidar", "--model", "vlp-16"),
        ("evaluate", *TURNING, "--policy", "bang-bang", "--episodes", 1, "--no-films"),
        ("leaderboard", *TURNING, "--policy", "bang-bang", "--episodes", 1),
        ("robustness", *TURNING, "--policy", "bang-bang", "--episodes", 1),
        ("train", *TURNING, *TINY, "--out", "run"),
        ("curves", "run"),
        ("gap", *TURNING, "--policy", "bang-bang", "--effect", "spool_lag=0.05", "--improved", "aoro", "--episodes", 1),
        ("export", "policy", "run/best.json"),
        ("export", "twin", "--format", "c", "--out", "libaoro"),
        ("serve", "--udp-port", 0, "--tcp-port", 0, "--duration", 0.3),
        ("laboratory", "-m", "park"),
        ("bench", "--twins", 1, "--seconds", 0.02),
        ("doctor",),
    ],
    ids=lambda one: " ".join(map(str, one[:2])),
)
def test_results_of_long_commands_are_json_alone(place, monkeypatch, command):
    needs = {"train": "stable_baselines3", "curves": "stable_baselines3", "policy": "onnx"}
    for word in command[:2]:
        if word in needs:
            pytest.importorskip(needs[word])
    check(place, monkeypatch, *command)


def test_a_file_gets_what_the_standard_output_would_get(place, monkeypatch):
    found = check(place, monkeypatch, "parameters", "oil")
    shown = call("parameters", "oil", "--json", "oil.json")
    assert json.loads((place / "oil.json").read_text()) == found
    assert "oil.bulk_modulus" in shown.stdout and "wrote oil.json" in shown.stdout


def test_without_a_file_it_is_the_standard_output():
    assert json.loads(call("parameters", "oil", "--json").stdout) == json.loads(
        call("parameters", "oil", "--json", "-", "--quiet").stdout
    )


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ("parameters --json steering.valve", "--json is 'steering.valve', but must be - or end in .json"),
    ],
)
def test_a_file_that_cannot_be_is_refused(files, arguments, message):
    check_refused(arguments, message)


def test_quiet_leaves_out_tables_of_what_stands_in_files(capsys, monkeypatch):
    monkeypatch.setattr(terminal, "_quiet", True)
    outcome.conclude(None, ["table"], [Path("file")])
    assert capsys.readouterr().out == "wrote file\n"
    outcome.conclude(None, ["table"], [])
    assert capsys.readouterr().out == "table\n"
    monkeypatch.setattr(terminal, "_quiet", False)
    outcome.conclude(None, ["table"], [Path("file")])
    assert capsys.readouterr().out == "table\nwrote file\n"
