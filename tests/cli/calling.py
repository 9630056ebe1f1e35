"""Commands as tests call them."""

from pathlib import Path

from typer.testing import CliRunner, Result

from aoro_gym.cli import app

runner = CliRunner()


def call(*arguments: str | int | Path) -> Result:
    """Run the command; its exceptions are ours."""
    return runner.invoke(app, [str(argument) for argument in arguments], catch_exceptions=False)


def check_refused(arguments: str, message: str) -> None:
    """Check that a command ends with one line that says ``message``, and leaves the current folder as it was."""
    before = {path: path.read_bytes() for path in Path().iterdir() if path.is_file()}
    names = sorted(Path().iterdir())
    shown = call(*arguments.split())
    assert shown.exit_code == 2
    assert shown.stdout == ""
    lines = shown.stderr.strip().splitlines()
    assert len(lines) == 1, shown.stderr
    assert lines[0].startswith("error: ")
    assert message in lines[0]
    assert sorted(Path().iterdir()) == names
    assert all(path.read_bytes() == content for path, content in before.items())
