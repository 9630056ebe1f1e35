"""The command that writes a machine for another simulator."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from aoro_gym.cli import options
from aoro_gym.cli.options import option
from aoro_gym.cli.outcome import checking_input, conclude
from aoro_gym.reporting import terminal

FormatOption = Annotated[str, option("--format", "mjcf|urdf", "MuJoCo's model format, or URDF.")]
FileOption = Annotated[
    Path, option("--out -o", "FILE", "File to write: .xml for mjcf, .urdf for urdf; a .json goes beside it.")
]
RootOption = Annotated[
    str,
    option("--root", "world|frame", "Of a URDF: an empty link that the machine floats on, or the front frame itself."),
]


def machine(
    format_: FormatOption,
    out: FileOption,
    machine: options.MachineOption = options.MACHINE,
    set_: options.SetOption = None,
    scale: options.ScaleOption = None,
    root: RootOption = "world",
    json_to: options.JsonOption = None,
    quiet: options.QuietOption = False,
) -> None:
    """Write the machine for another simulator: bodies, masses, hinges, limits and, as far as the format has them, actuators,
    tires as springs, and sensors.

    What the format cannot say is listed, and stands in the file as comments and, with figures, in the .json beside it.
    docs/howto/interchange.md loads both formats. PyBullet, which frees the root itself, wants a URDF with --root frame.

    [bold]Examples[/]

      aoro-gym export machine --format mjcf --out aoro.xml
      aoro-gym export machine --format urdf --machine my.toml --out my.urdf
      aoro-gym export machine --format mjcf --set joint.range=40 --scale frame.front.mass=1.1 --out heavy.xml
    """
    with checking_input():
        from aoro_gym.execution.files import check_writable
        from aoro_gym.interchange.export import beside_of, check_target, export_machine
        from aoro_gym.interchange.report import limitation_table

        check_target(format_, out, root)
        check_writable(out)
        check_writable(beside_of(out))
        spec = options.run_spec(machine, set_, scale).machine
        chosen = options.load_machine(spec)
        written, unsaid = export_machine(chosen, format_, out, {"machine": spec.to_json()}, root_link=root)
    shown = limitation_table(unsaid, format_, terminal.out().width)
    conclude(beside_of(out), shown, written, json_to=json_to, highlight=False)
