"""Command that lists a machine's parameters and the catalogue of effects."""

from __future__ import annotations

from typing import Annotated

from aoro_gym.cli import options
from aoro_gym.cli.options import argument, option
from aoro_gym.cli.outcome import checking_input, conclude
from aoro_gym.reporting import terminal

PatternArgument = Annotated[str | None, argument("[PATTERN]", "Part of a key, or a glob such as 'steering.*.leakage'.")]
EffectsOption = Annotated[
    bool, option("--effects", None, "List the effects that may part a machine from its twin instead.")
]


def parameters(
    pattern: PatternArgument = None,
    effects: EffectsOption = False,
    machine: options.MachineOption = options.MACHINE,
    set_: options.SetOption = None,
    scale: options.ScaleOption = None,
    json_to: options.JsonOption = None,
    quiet: options.QuietOption = False,
) -> None:
    """List the machine's parameters: value, unit, range, role and source.

    A range is a soft prior of about 95 %. Keys are what --set and --scale take. With --effects: what each effect does, its
    magnitudes with their ranges, and what can be measured of it on any machine.

    [bold]Examples[/]

      aoro-gym parameters
      aoro-gym parameters --effects
      aoro-gym parameters steering.valve
      aoro-gym parameters 'driveline.*.displacement' --json -
      aoro-gym parameters oil --set oil.gas_fraction=0.01
    """
    with checking_input():
        from aoro_gym.effects.catalogue import matching
        from aoro_gym.effects.report import effects_table
        from aoro_gym.machine.report import parameter_entries, parameter_table

        chosen = options.load_machine(options.run_spec(machine, set_, scale).machine)
        found = [] if effects else chosen.parameters(pattern)
        entries = [effect.describe(chosen) for effect in matching(pattern)] if effects else parameter_entries(found)
        if not entries:
            raise ValueError(f"no parameter matches {pattern!r}; 'aoro-gym parameters' lists all")
    shown = [effects_table(entries)] if effects else parameter_table(found, terminal.out().width)
    conclude(entries, shown, json_to=json_to, highlight=False)
