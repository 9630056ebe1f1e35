"""Options that several commands share, and what they stand for."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from aoro_gym.checks import check_integer
from aoro_gym.cli.outcome import check_json_to
from aoro_gym.execution.device_names import SIMD
from aoro_gym.reporting import terminal

if TYPE_CHECKING:
    from aoro_gym.machine import Machine
    from aoro_gym.machine.specification import MachineSpec, RunSpec

MACHINE, DATASHEET = "aoro", "aoro_datasheet"
"""Bundled machines: the calibrated one, and the one before any calibration."""
TRACKING = "AORO/PathTracking-v0"
"""The environment that is driven where no other is asked for."""


def option(flags: str, metavar: str | None, text: str, **others: Any) -> Any:
    """An option of a command, its flags separated by spaces."""
    return typer.Option(*flags.split(), metavar=metavar, help=text, **others)


def argument(metavar: str, text: str) -> Any:
    """An argument of a command."""
    return typer.Argument(metavar=metavar, help=text)


MachineOption = Annotated[str, option("--machine", "NAME|FILE", "Bundled machine, or a machine file (.toml).")]
SetOption = Annotated[
    list[str] | None, option("--set", "KEY=VALUE", "Set a parameter, in the unit of the machine file. Repeatable.")
]
ScaleOption = Annotated[list[str] | None, option("--scale", "KEY=FACTOR", "Multiply a parameter. Repeatable.")]
LawsOption = Annotated[
    str | None,
    option(
        "--laws",
        "NAME",
        "Family of laws, see 'aoro-gym laws'; A,B, families or any: drawn by --seed. Default: the file's.",
    ),
]
DeviceOption = Annotated[
    str, option("--device", "DEVICE", "Where twins run: cpu, cpu:simd (several at once on a core) or cuda:N.")
]
DevicesOption = Annotated[
    str,
    option(
        "--device",
        "DEVICE[,...]",
        "Where twins run: cpu, cpu:simd, cuda:N; several share the work, cuda:all has all GPUs.",
    ),
]
SeedOption = Annotated[int, option("--seed", "N", "Seed of all that is random: noise and searches.")]
RepeatsOption = Annotated[
    int, option("--repeats", "N", "Times that each episode is driven, with other noise and machines drawn.")
]
WorkersOption = Annotated[int | None, option("--workers", "N", "Processes at once. Default: the number of cores.")]
QuietOption = Annotated[
    bool,
    option(
        "--quiet -q",
        None,
        "Show no progress, and no tables of what stands in files; warnings and errors remain.",
        callback=terminal.set_quiet,
    ),
]
JsonOption = Annotated[
    Path | None,
    option(
        "--json",
        "FILE|-",
        "Write the results as JSON here (.json), or alone (-) to the standard output.",
        callback=check_json_to,
    ),
]
RayOption = Annotated[
    str | None, option("--ray", "ADDRESS", "Spread over a Ray cluster: auto, local (this computer), or HOST:PORT.")
]
RestartOption = Annotated[bool, option("--restart", None, "Forget what an interrupted run has kept, and begin anew.")]
AcceptCodeChangeOption = Annotated[
    bool, option("--accept-code-change", None, "Go on with results of another version of the code, and record that.")
]
FolderOption = Annotated[Path, option("--out -o", "FOLDER", "Folder to write to.")]
EnvOption = Annotated[
    str, option("--env", "ID", "AORO/PathTracking-v0, or -v1, Turning-v0, Levelling-v0, ForestRun-v0, Loading-v0.")
]
PoliciesOption = Annotated[
    list[str] | None,
    option("--policy", "NAME|FILE", "Who drives. Repeatable. Default: all controllers and shipped policies."),
]


def run_spec(
    machine: str,
    settings: list[str] | None,
    factors: list[str] | None,
    device: str = "cpu",
    seed: int = 0,
    *,
    laws: str | None = None,
    ideal: bool = False,
) -> RunSpec:
    """Specification that the options ask for.

    Args:
        machine: Value of --machine.
        settings: Values of --set.
        factors: Values of --scale.
        device: Value of --device.
        seed: Value of --seed.
        laws: Value of --laws.
        ideal: Whether sensors are ideal.
    """
    from aoro_gym.machine.specification import MachineSpec, RunSpec

    spec = MachineSpec(machine, tuple(settings or ()), tuple(factors or ()), laws)
    return RunSpec(spec, device, seed, ideal)


def load_machine(spec: MachineSpec | str) -> Machine:
    """The machine of a specification or a file; warns of values outside their plausible ranges."""
    from aoro_gym.machine.specification import MachineSpec

    machine, warnings = (MachineSpec(spec) if isinstance(spec, str) else spec).load()
    for warning in warnings:
        terminal.warn(warning)
    return machine


def load(run: RunSpec, *, draw: bool = True, simd: bool = True, several: bool = False) -> Machine:
    """The machine of a run, whose seed and device are checked, where ``simd`` or ``several`` devices may be asked for or
    not; warns as :func:`load_machine`.

    Laws that are to be drawn are drawn once, by the seed; without ``draw`` they are the file's yet.
    """
    machine = load_machine(run.machine)
    check_seed(run.seed)
    check_device(run.device, simd=simd, several=several)
    drawn = draw and run.machine.draws_laws
    return machine.sample(1, laws=run.machine.laws, seed=run.seed).variant(0) if drawn else machine


def check_seed(seed: int) -> None:
    check_integer("--seed", seed, ge=0)


def check_device(device: str, *, simd: bool = True, several: bool = False) -> None:
    from aoro_gym.execution import devices

    if SIMD in device.split(",") and not simd:
        raise ValueError(f"--device {SIMD} is for twins alone, and this command runs other kernels, too; take cpu")
    devices.set_quiet(terminal.is_quiet())
    try:
        devices.several(device) if several else devices.find(device)
    except ValueError as error:
        raise ValueError(f"--{error}") from error


def check_workers(asked: int | None) -> int:
    from aoro_gym.twin.recorded import cores

    if asked is not None:
        check_integer("--workers", asked)
    return cores() if asked is None else asked


def check_folder(path: Path, file: str) -> None:
    from aoro_gym.execution.files import check_writable

    if path.exists() and not path.is_dir():
        raise ValueError(f"--out {path} is a file; name a folder")
    check_writable(path / file)
