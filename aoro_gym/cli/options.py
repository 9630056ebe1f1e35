"""Options that several commands share, and what they stand for."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from aoro_gym.reporting import terminal

if TYPE_CHECKING:
    from aoro_gym.machine import Machine
    from aoro_gym.machine.specification import MachineSpec, RunSpec

MACHINE, DATASHEET = "aoro", "aoro_datasheet"
"""Bundled machines: the calibrated one, and the one before any calibration."""
TRACKING = "AORO/PathTracking-v0"
"""The environment that is driven where no other is asked for."""

MachineOption = Annotated[
    str, typer.Option("--machine", metavar="NAME|FILE", help="Bundled machine, or a machine file (.toml).")
]
SetOption = Annotated[
    list[str] | None,
    typer.Option("--set", metavar="KEY=VALUE", help="Set a parameter, in the unit of the machine file. Repeatable."),
]
ScaleOption = Annotated[
    list[str] | None, typer.Option("--scale", metavar="KEY=FACTOR", help="Multiply a parameter. Repeatable.")
]
DeviceOption = Annotated[str, typer.Option("--device", metavar="cpu|cuda:N", help="Where the twin runs.")]
SeedOption = Annotated[int, typer.Option("--seed", metavar="N", help="Seed of all that is random: noise and searches.")]
RepeatsOption = Annotated[
    int,
    typer.Option(
        "--repeats", metavar="N", help="Times that each episode is driven, with other noise and machines drawn."
    ),
]
WorkersOption = Annotated[
    int | None, typer.Option("--workers", metavar="N", help="Processes at once. Default: the number of cores.")
]
QuietOption = Annotated[
    bool,
    typer.Option(
        "--quiet", "-q", callback=terminal.set_quiet, help="Show no progress; results, warnings and errors remain."
    ),
]
RayOption = Annotated[
    str | None,
    typer.Option(
        "--ray", metavar="ADDRESS", help="Spread over a Ray cluster: auto, local (this computer), or HOST:PORT."
    ),
]
RestartOption = Annotated[
    bool, typer.Option("--restart", help="Forget what an interrupted run has kept, and begin anew.")
]
AcceptCodeChangeOption = Annotated[
    bool,
    typer.Option("--accept-code-change", help="Go on with results of another version of the code, and record that."),
]
FolderOption = Annotated[Path, typer.Option("--out", "-o", metavar="FOLDER", help="Folder to write to.")]
EnvOption = Annotated[str, typer.Option("--env", metavar="ID", help="AORO/PathTracking-v0 or AORO/Turning-v0.")]
PoliciesOption = Annotated[
    list[str] | None,
    typer.Option(
        "--policy",
        metavar="NAME|FILE",
        help="Who drives. Repeatable. Default: all controllers and shipped policies.",
    ),
]


def run_spec(
    machine: str,
    settings: list[str] | None,
    factors: list[str] | None,
    device: str = "cpu",
    seed: int = 0,
    *,
    ideal: bool = False,
) -> RunSpec:
    """Specification that the options ask for.

    Args:
        machine: Value of --machine.
        settings: Values of --set.
        factors: Values of --scale.
        device: Value of --device.
        seed: Value of --seed.
        ideal: Whether sensors are ideal.
    """
    from aoro_gym.machine.specification import MachineSpec, RunSpec

    return RunSpec(MachineSpec(machine, tuple(settings or ()), tuple(factors or ())), device, seed, ideal)


def load_machine(spec: MachineSpec | str) -> Machine:
    """The machine of a specification or a file; warns of values outside their plausible ranges."""
    from aoro_gym.machine.specification import MachineSpec

    machine, warnings = (MachineSpec(spec) if isinstance(spec, str) else spec).load()
    for warning in warnings:
        terminal.warn(warning)
    return machine


def load(run: RunSpec) -> Machine:
    """The machine of a run, whose seed and device are checked; warns as :func:`load_machine`."""
    machine = load_machine(run.machine)
    check_seed(run.seed)
    check_device(run.device)
    return machine


def check_seed(seed: int) -> None:
    if seed < 0:
        raise ValueError(f"--seed = {seed} is below 0")


def check_device(device: str) -> None:
    from aoro_gym.execution import devices

    devices.set_quiet(terminal.is_quiet())
    try:
        devices.find(device)
    except ValueError as error:
        raise ValueError(f"--{error}") from error


def check_workers(asked: int | None) -> int:
    from aoro_gym.twin.twin import cores

    if asked is not None and asked < 1:
        raise ValueError(f"--workers = {asked} is below 1")
    return cores() if asked is None else asked


def check_folder(path: Path, file: str) -> None:
    from aoro_gym.execution.files import check_writable

    if path.exists() and not path.is_dir():
        raise ValueError(f"--out {path} is a file; name a folder")
    check_writable(path / file)
