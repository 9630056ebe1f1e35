"""Command that says what is installed."""

from __future__ import annotations

from aoro_gym.cli import options
from aoro_gym.cli.outcome import checking_input, conclude, running
from aoro_gym.reporting import terminal


def doctor(json_to: options.JsonOption = None, quiet: options.QuietOption = False) -> None:
    """Say what is installed here, what is missing for what, and how fast one twin steps.

    Versions that decide results; the optional parts, what each is for, and which packages it lacks; devices, with the time
    of a step of 1 ms of one twin. Add the file of --json to a report of a fault.

    [bold]Examples[/]

      aoro-gym doctor
      aoro-gym doctor --json -
    """
    with checking_input():
        from aoro_gym.benchmark import installation
    with running(), terminal.progress("stepping a twin"):
        found = installation.parts(), installation.speeds()
    conclude(installation.to_json(*found), installation.tables(*found), json_to=json_to)
