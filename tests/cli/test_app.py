"""The command as a whole: its version, its help, and that it runs as a module."""

import subprocess
import sys

import pytest
import typer
from rich.text import Text
from typer.core import TyperGroup

from aoro_gym import __version__
from aoro_gym.cli import app, main
from tests.cli.calling import call, runner

GROUPS = ("blind", "diagnosis", "export", "log")
"""Commands that have commands."""


def _commands(group):
    assert isinstance(group, TyperGroup)
    return group.commands


def test_version_and_help():
    assert call("--version").stdout == f"aoro-gym {__version__}\n"
    verbs = (
        "parameters simulate validate calibrate demo terrain world evaluate leaderboard curves gap train serve bench"
    )
    for verb in [*verbs.split(), "view", "export policy", "export twin", "laboratory"]:
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


def test_help_fits_80_columns():
    group = typer.main.get_command(app)
    assert isinstance(group, TyperGroup)
    nested = [f"{of} {name}" for of in GROUPS for name in _commands(group.commands[of])]
    for verb in [*group.commands, *nested]:
        shown = runner.invoke(app, [*verb.split(), "--help"], env={"COLUMNS": "80", "TERMINAL_WIDTH": "80"})
        assert shown.exit_code == 0
        for line in shown.stdout.splitlines():
            assert len(line) <= 80 and "…" not in line, f"{verb}: {line}"


def test_long_commands_can_be_quiet():
    group = typer.main.get_command(app)
    assert isinstance(group, TyperGroup)
    commands = dict(group.commands)
    for of in GROUPS:
        commands |= {f"{of} {name}": one for name, one in _commands(group.commands[of]).items()}
    lacking = {name for name, one in commands.items() if "--quiet" not in {text for p in one.params for text in p.opts}}
    assert lacking == {"parameters", "laws", *GROUPS}


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
