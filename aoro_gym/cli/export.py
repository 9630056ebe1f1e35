"""Commands that export: a policy, a twin, a machine or a scene, each for a reader that has no Python."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from typer.core import TyperGroup

from aoro_gym.cli import export_machine, export_scene, options
from aoro_gym.cli.application import Application
from aoro_gym.cli.options import argument, option
from aoro_gym.cli.outcome import checking_input, conclude
from aoro_gym.reporting import terminal

POLICY_SUFFIXES = (".json", ".zip")
"""Ends of the names of policies' files."""


class _Exports(TyperGroup):
    """The exports; the form without ``policy``, of version 0.1, still means a policy's and is said to end."""

    def parse_args(self, ctx: typer.Context, args: list[str]) -> list[str]:
        named = args and args[0] in self.commands
        if not named and any(Path(text).suffix in POLICY_SUFFIXES for text in args):
            terminal.warn(
                "'aoro-gym export POLICY' is deprecated and ends with the next version; add the word 'policy'"
            )
            args = ["policy", *args]
        return super().parse_args(ctx, args)


app = Application(
    cls=_Exports,
    no_args_is_help=True,
    rich_markup_mode="rich",
    help="A policy, a twin, a machine or a scene for other programs.",
)

PolicyArgument = Annotated[Path, argument("FILE", "Policy (.json with its .safetensors).")]
OnnxOption = Annotated[Path | None, option("--out -o", "FILE.onnx", "File to write. Default: beside the policy.")]
TrustPickleOption = Annotated[
    bool, option("--trust-pickle", None, "Load a .zip of Stable-Baselines3, which runs code of its maker.")
]


@app.callback()
def _exports() -> None:
    """A policy, a twin, a machine or a scene for other programs."""


@app.command()
def policy(
    policy: PolicyArgument,
    out: OnnxOption = None,
    trust_pickle: TrustPickleOption = False,
    json_to: options.JsonOption = None,
    quiet: options.QuietOption = False,
) -> None:
    """Write a learned policy as ONNX, for the vehicle's computer.

    One input, observations (N, O), and one output, actions (N, A), both float32; normalisation and bounds are inside, and
    the metadata has the environment and the columns of its observation. Needs pip install 'aoro-gym\\[onnx]'.

    [bold]Examples[/]

      aoro-gym export policy runs/turning/policy.json
      aoro-gym export policy runs/turning/policy.json --out turning.onnx
    """
    with checking_input():
        from aoro_gym.agents.policies.files import load_policy
        from aoro_gym.agents.policies.onnx_file import write_onnx
        from aoro_gym.execution.files import check_writable
        from aoro_gym.execution.locking import locked

        target = policy.with_suffix(".onnx") if out is None else out
        check_writable(target)
        loaded = load_policy(policy, trust_pickle=trust_pickle)
        with locked(target.parent):
            write_onnx(loaded, target)
    conclude(written=[target], json_to=json_to)


FormatOption = Annotated[str, option("--format", "fmi2|fmi3|c", "Functional mock-up unit, or a library of C.")]
TwinOutOption = Annotated[Path, option("--out -o", "FILE|FOLDER", "Unit to write (.fmu); of c the folder.")]
TerrainOption = Annotated[
    Path | None, option("--terrain", "FILE", "Ground: a mesh, raster or cloud. Default: level asphalt.")
]
EffectsOption = Annotated[
    list[str] | None, option("--effects", "ID=VALUE", "Effect that the machine has, in SI. Repeatable.")
]


@app.command()
def twin(
    format: FormatOption,
    out: TwinOutOption,
    machine: options.MachineOption = options.MACHINE,
    set_: options.SetOption = None,
    scale: options.ScaleOption = None,
    laws: options.LawsOption = None,
    terrain: TerrainOption = None,
    effects: EffectsOption = None,
    json_to: options.JsonOption = None,
    quiet: options.QuietOption = False,
) -> None:
    """Write the twin as a unit of FMI 2.0 or 3.0 for co-simulation, or as a library of C: no Python inside.

    Needs a C compiler ($CC, cc, gcc or clang). Inputs are the commands, outputs what the log has, and every parameter of
    the machine file can be set before initialisation, in the unit of the file. Steps are whole milliseconds. Results are
    those of the Python twin, to the bit where it is compiled for any CPU, too. A terrain becomes a raster of 25 cm, which
    lies in the file; triangles themselves are not exported. The unit runs on Linux, on CPUs of this computer's kind.

    [bold]Examples[/]

      aoro-gym export twin --format fmi2 --out aoro.fmu
      aoro-gym export twin --format fmi3 --terrain scan.laz --out forest.fmu
      aoro-gym export twin --format fmi2 --effects seal_friction=3000 --out worn.fmu
      aoro-gym export twin --format c --out libaoro
    """
    with checking_input():
        from aoro_gym.cosimulation.export.build import check_output, export_twin
        from aoro_gym.cosimulation.export.effects import with_effects
        from aoro_gym.machine.specification import MachineSpec
        from aoro_gym.terrains import Plane, load

        check_output(format, out)
        options.check_device("cpu")
        spec = MachineSpec(machine, tuple(set_ or ()), tuple(scale or ()), laws)
        if spec.draws_laws:
            raise ValueError(f"--laws {laws} draws laws, but a unit has its laws for good; name one family")
        chosen, plane = with_effects(options.load_machine(spec), None if terrain else Plane(), effects or [])
        ground = plane
        if terrain is not None:
            with terminal.progress(terrain.name) as tell:
                ground, report = load(terrain, progress=lambda share: tell(terrain.name, share))
            for warning in report.warnings:
                terminal.warn(warning)
    with checking_input():
        written = export_twin(format, out, machine=chosen, terrain=ground)
    conclude(written=written, json_to=json_to)


app.command()(export_machine.machine)
app.command()(export_scene.scene)
