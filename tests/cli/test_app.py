"""The command as a whole: its version, its help, and that it runs as a module."""

import re
import subprocess
import sys
from pathlib import Path

import pytest
import typer
from rich.text import Text
from typer.core import TyperGroup

from aoro_gym import __version__
from aoro_gym.cli import app, main
from aoro_gym.cli.application import flowing
from tests.cli.calling import call, runner

GROUPS = ("blind", "diagnosis", "export", "hub", "log")
"""Commands that have commands."""


def _commands(group):
    assert isinstance(group, TyperGroup)
    return group.commands


def test_version_and_help():
    assert call("--version").stdout == f"aoro-gym {__version__}\n"
    verbs = (
        "parameters simulate validate study calibrate demo terrain world evaluate leaderboard curves gap train bench"
    )
    for verb in [*verbs.split(), "serve", "robustness", "view", "export policy", "export twin", "laboratory"]:
        shown = call(*verb.split(), "--help")
        assert shown.exit_code == 0
        assert "Examples" in shown.stdout
        assert f"aoro-gym {verb}" in shown.stdout


def test_help_shows_every_word():
    # rich takes words in brackets for styles and leaves them out
    group = typer.main.get_command(app)
    assert isinstance(group, TyperGroup)
    for verb, command in group.commands.items():
        for text in (command.help, *(getattr(parameter, "help", None) for parameter in command.params)):
            styles = {str(span.style) for span in Text.from_markup(text or "").spans}
            assert styles <= {"bold"}, f"{verb}: {text}"


def test_paragraphs_of_help_fill_the_terminal():
    assert (
        flowing("""Do it.

        A sentence that
        goes on.

          aoro-gym a
          aoro-gym b
        """)
        == "Do it.\n\nA sentence that goes on.\n\n  aoro-gym a\n  aoro-gym b"
    )
    shown = runner.invoke(app, ["bench", "--help"], env={"COLUMNS": "80", "TERMINAL_WIDTH": "80"}).stdout
    sentence = next(line for line in shown.splitlines() if line.startswith(" Twins steer and drive at random"))
    assert len(sentence.rstrip()) > 70


def test_help_fits_80_columns():
    group = typer.main.get_command(app)
    assert isinstance(group, TyperGroup)
    nested = [f"{of} {name}" for of in GROUPS for name in _commands(group.commands[of])]
    for verb in [*group.commands, *nested]:
        shown = runner.invoke(app, [*verb.split(), "--help"], env={"COLUMNS": "80", "TERMINAL_WIDTH": "80"})
        assert shown.exit_code == 0
        for line in shown.stdout.splitlines():
            assert len(line) <= 80 and "…" not in line, f"{verb}: {line}"


def _every_command():
    """All commands by their names, those within groups by two words."""
    group = typer.main.get_command(app)
    assert isinstance(group, TyperGroup)
    commands = {name: one for name, one in group.commands.items() if name not in GROUPS}
    for of in GROUPS:
        commands |= {f"{of} {name}": one for name, one in _commands(group.commands[of]).items()}
    return commands


@pytest.mark.parametrize("option", ["--quiet", "--json"])
def test_every_command_has_the_options_of_all(option):
    found = {name: {text: p for p in one.params for text in p.opts} for name, one in _every_command().items()}
    assert [name for name, known in found.items() if option not in known] == []
    # one declaration: the same words everywhere
    assert len({(getattr(known[option], "help", None), known[option].metavar) for known in found.values()}) == 1


def test_every_command_has_a_row_in_the_list_of_commands():
    page = (Path(__file__).parents[2] / "docs/howto/commands.md").read_text(encoding="utf-8")
    rows = [line.split("|")[1] for line in page.splitlines() if line.startswith("| `aoro-gym ")]
    listed = [name.removeprefix("aoro-gym ") for row in rows for name in re.findall(r"`([^`]+)`", row)]
    assert sorted(listed) == sorted(_every_command())


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ("--crane-pose 0 -10 20 --out log.csv", "--crane-pose takes 4 numbers, DEG DEG DEG M, but got 3: 0 -10 20"),
        ("--held --quiet", "--held takes 3 numbers, KG M M, but got 0: none"),
    ],
)
def test_an_option_of_several_numbers_says_how_many_it_lacks(given, said):
    done = call("simulate", "--manoeuvre", "crane", *given.split())
    assert done.exit_code == 2
    assert said in " ".join(done.stderr.replace("│", " ").split())


def test_runs_as_a_module():
    command = [sys.executable, "-m", "aoro_gym", "--version"]
    assert subprocess.run(command, capture_output=True, text=True, check=True).stdout.split()[1] == __version__


def test_an_interruption_before_any_command_is_one_line(monkeypatch, capsys):
    def stop():
        raise KeyboardInterrupt

    monkeypatch.setattr(sys.modules["aoro_gym.cli.app"], "app", stop)
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code == 130
    assert capsys.readouterr().err == "interrupted: the same command begins anew\n"


@pytest.mark.parametrize("command", ["camera", "dataset", "lidar", "diagnose later.csv"])
def test_commands_of_other_kernels_refuse_lanes(command, tmp_path, monkeypatch):
    """Nothing but twins runs on lanes; Warp knows no device of that name."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "later.csv").write_text("time_s\n0\n")
    refused = call(*command.split(), "--device", "cpu:simd")
    assert refused.exit_code == 2
    assert "--device cpu:simd is for twins alone" in refused.stderr
    assert [file.name for file in tmp_path.iterdir()] == ["later.csv"]
