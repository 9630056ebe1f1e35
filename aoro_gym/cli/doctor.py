"""Command that says what is installed."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

from aoro_gym.cli import options
from aoro_gym.cli.options import option
from aoro_gym.cli.outcome import checking_input, print_all, running, say_written
from aoro_gym.reporting import terminal

JsonOption = Annotated[
    Path | None, option("--json", "FILE|-", "Write the results here, or (-) to the standard output.")
]


def doctor(json_file: JsonOption = None, quiet: options.QuietOption = False) -> None:
    """Say what is installed here, what is missing for what, and how fast one twin steps.

    Versions that decide results; the optional parts, what each is for, and which packages it lacks; devices, with the time
    of a step of 1 ms of one twin. Add the file of --json to a report of a fault.

    [bold]Examples[/]

      aoro-gym doctor
      aoro-gym doctor --json -
    """
    with checking_input():
        from aoro_gym.benchmark import installation
        from aoro_gym.execution.files import check_writable, write_json

        if json_file is not None and str(json_file) != "-":
            check_writable(json_file)
    with running(), terminal.progress("stepping a twin"):
        found = installation.parts(), installation.speeds()
    if str(json_file) == "-":
        typer.echo(json.dumps(installation.to_json(*found), indent=2))
        return
    print_all(installation.tables(*found))
    if json_file is not None:
        write_json(json_file, installation.to_json(*found))
        say_written([json_file])
