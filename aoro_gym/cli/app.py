"""The application: its commands in the order of the help, and its entry point."""

from __future__ import annotations

from typing import Annotated, Any

import typer
from typer.core import TyperGroup

from aoro_gym.cli import (
    bench,
    blind,
    calibration,
    camera,
    dataset,
    demo,
    diagnosis,
    diagnosis_training,
    doctor,
    evaluation,
    export,
    hub,
    laboratory,
    laws,
    lidar,
    log,
    parameters,
    serve,
    simulation,
    terrain,
    training,
    view,
    world,
)
from aoro_gym.cli.application import Application
from aoro_gym.cli.outcome import interrupted, say_interrupted
from aoro_gym.version import VERSION

BEGINS_ANEW = "the same command begins anew"
"""What one does after an interruption that nothing else is said of."""


class _Commands(TyperGroup):
    """Commands; an interrupted one that says nothing of its own ends with one line."""

    def invoke(self, ctx: typer.Context) -> Any:
        try:
            return super().invoke(ctx)
        except KeyboardInterrupt:
            interrupted(BEGINS_ANEW)


app = Application(
    name="aoro-gym",
    cls=_Commands,
    no_args_is_help=True,
    add_completion=False,
    rich_markup_mode="rich",
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)
for command in (
    parameters.parameters,
    laws.laws,
    simulation.simulate,
    demo.demo,
    calibration.validate,
    calibration.study,
    calibration.calibrate,
    diagnosis.diagnose,
    terrain.terrain,
    world.world,
    lidar.lidar,
    camera.camera,
    dataset.dataset,
    evaluation.evaluate,
    evaluation.leaderboard,
    evaluation.robustness,
    evaluation.curves,
    evaluation.gap,
    training.train,
    view.view,
    serve.serve,
    laboratory.laboratory,
    bench.bench,
    doctor.doctor,
):
    app.command()(command)
app.add_typer(export.app, name="export")
app.add_typer(hub.app, name="hub")
app.add_typer(log.app, name="log")
app.add_typer(blind.app, name="blind")
app.add_typer(diagnosis_training.app, name="diagnosis")


def main() -> None:
    """Entry point of ``aoro-gym``."""
    try:
        app()
    except KeyboardInterrupt:  # before a command was reached: typer builds all of them first
        say_interrupted(BEGINS_ANEW)
        raise SystemExit(130) from None


def _show_version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"aoro-gym {VERSION}")
        raise typer.Exit


@app.callback()
def _top(
    version: Annotated[
        bool, typer.Option("--version", help="Show the version.", callback=_show_version, is_eager=True)
    ] = False,
) -> None:
    """A fast digital twin of AORO, a 10 t articulated forestry research machine.

    [bold]Try[/]

      aoro-gym demo                         validation, a controlled turn and a forest drive, as one page
      aoro-gym simulate --help              any other manoeuvre
      aoro-gym validate                     the twin beside the published machine
      aoro-gym calibrate --help             make a twin agree with your own logs
      aoro-gym parameters steering.valve    what the machine is made of, with sources
      aoro-gym laws                         which laws its parts may obey
      aoro-gym evaluate --help              controllers and policies side by side, on any ground
      aoro-gym train --help                 a policy of your own, on your machine and your ground
      aoro-gym view                         see it move in the browser, and drive it
      aoro-gym serve --help                 a twin on sockets, for the machine's own tracking script
      aoro-gym diagnose --help              why your machine and its twin disagree
      aoro-gym blind --help                 machines with a withheld deviation, to check a diagnosis on
    """
