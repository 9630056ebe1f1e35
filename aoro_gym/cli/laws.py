"""Command that lists laws and families of them."""

from __future__ import annotations

from typing import Annotated

from aoro_gym.cli import options
from aoro_gym.cli.options import argument
from aoro_gym.cli.outcome import checking_input, conclude

PatternArgument = Annotated[str | None, argument("[PATTERN]", "Part of a law's name, or a glob such as '*line'.")]


def laws(
    pattern: PatternArgument = None,
    machine: options.MachineOption = options.MACHINE,
    set_: options.SetOption = None,
    scale: options.ScaleOption = None,
    laws: options.LawsOption = None,
    json_to: options.JsonOption = None,
    quiet: options.QuietOption = False,
) -> None:
    """List the laws that parts of the machine may obey, and families of them.

    Nobody knows a machine's laws exactly: each has options, the default twin's first, some with parameters of their own. A
    family chooses an option of every law, as one modeller would; --laws takes its name wherever a machine is simulated,
    validated, evaluated on or learned on, and a machine file its table \\[laws]. What the machine asked for obeys is marked.

    [bold]Examples[/]

      aoro-gym laws
      aoro-gym laws hose
      aoro-gym laws --laws library
      aoro-gym laws --json -
      aoro-gym simulate --manoeuvre left --laws library --out library.csv
      aoro-gym train --env AORO/Turning-v0 --laws families --out runs/turning
    """
    with checking_input():
        from aoro_gym.machine.laws import FAMILIES
        from aoro_gym.machine.report import family_table, law_entries, law_table

        chosen = options.load(options.run_spec(machine, set_, scale, laws=laws))
        entries = law_entries(chosen, pattern)
        if not entries:
            raise ValueError(f"no law matches {pattern!r}; 'aoro-gym laws' lists all")
    result = {"laws": entries, "families": {name: dict(family) for name, family in FAMILIES.items()}}
    shown = [law_table(entries), "", family_table([entry["law"] for entry in entries])]
    conclude(result, shown, json_to=json_to, highlight=False)
