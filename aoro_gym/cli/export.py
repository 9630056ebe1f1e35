"""Commands that export: a policy, a twin or a machine, each for a reader that has no Python."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from typer.core import TyperGroup

from aoro_gym.cli import export_machine, options
from aoro_gym.cli.options import argument, option
from aoro_gym.cli.outcome import checking_input, say_written
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


app = typer.Typer(
    cls=_Exports,
    no_args_is_help=True,
    rich_markup_mode="rich",
    help="A policy, a twin or a machine for other programs.",
)

PolicyArgument = Annotated[Path, argument("FILE", "Policy (.json with its .safetensors).")]
OnnxOption = Annotated[Path | None, option("--out -o", "FILE.onnx", "File to write. Default: beside the policy.")]
TrustPickleOption = Annotated[
    bool, option("--trust-pickle", None, "Load a .zip of Stable-Baselines3, which runs code of its maker.")
]


@app.callback()
def _exports() -> None:
    """A policy, a twin or a machine for other programs."""


@app.command()
def policy(
    policy: PolicyArgument,
    out: OnnxOption = None,
    trust_pickle: TrustPickleOption = False,
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
    say_written([target])


app.command()(export_machine.machine)
