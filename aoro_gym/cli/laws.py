"""Command that lists laws and families of them."""

from __future__ import annotations

import json
from typing import Annotated

import typer

from aoro_gym.cli import options
from aoro_gym.cli.options import argument, option
from aoro_gym.cli.outcome import checking_input, print_all

PatternArgument = Annotated[str | None, argument("[PATTERN]", "Part of a law's name, or a glob such as '*line'.")]
JsonOption = Annotated[bool, option("--json", None, "Print JSON instead of tables.")]


def laws(
    pattern: PatternArgument = None,
    as_json: JsonOption = False,
    machine: options.MachineOption = options.MACHINE,
    set_: options.SetOption = None,
    scale: options.ScaleOption = None,
    laws: options.LawsOption = None,
) -> None:
    """List the laws that parts of the machine may obey, and families of them.

    Nobody knows a machine's laws exactly: each has options, the default twin's first, some with parameters of their own. A
    family chooses an option of every law, as one modeller would; --laws takes its name wherever a machine is simulated,
    validated, evaluated on or learned on, and a machine file its table \\[laws]. What the machine asked for obeys is marked.

    [bold]Examples[/]

      aoro-gym laws
      aoro-gym laws hose
      aoro-gym laws --laws library
      aoro-gym laws --json
      aoro-gym simulate --manoeuvre left --laws library --out library.csv
      aoro-gym train --env AORO/Turning-v0 --laws families --out runs/turning
    """
    with checking_input():
        from aoro_gym.machine.report import family_table, law_entries, law_table

        chosen = options.load(options.run_spec(machine, set_, scale, laws=laws))
        entries = law_entries(chosen, pattern)
        if not entries:
            raise ValueError(f"no law matches {pattern!r}; 'aoro-gym laws' lists all")
    if as_json:
        from aoro_gym.machine.laws import FAMILIES

        families = {name: dict(family) for name, family in FAMILIES.items()}
        typer.echo(json.dumps({"laws": entries, "families": families}, indent=2, ensure_ascii=False))
    else:
        print_all([law_table(entries), "", family_table([entry["law"] for entry in entries])], highlight=False)
