"""The command ``aoro-gym``: one thin function a verb.

Input is checked before anything runs: what is wrong is said in one line, with exit code 2. A run that fails ends with
exit code 1. Tables and JSON go to the standard output, progress and errors to the standard error.
"""

from __future__ import annotations

import errno
import inspect
import json
import math
import shlex
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, ExitStack, contextmanager, suppress
from dataclasses import fields, replace
from fnmatch import fnmatch
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NoReturn, get_type_hints

import typer
from rich.console import RenderableType
from rich.markup import escape
from rich.padding import Padding
from rich.table import Table
from rich.text import Text
from typer.core import TyperGroup

from aoro_gym.agents.training.plan import JOIN_GAPS_HELP, PATH_CRS_HELP, PATH_HELP, TRACK_HELP, TrainingPlan
from aoro_gym.reporting import terminal
from aoro_gym.version import VERSION

if TYPE_CHECKING:
    from aoro_gym.agents.controllers.reference import Factory
    from aoro_gym.agents.evaluation.episodes import Episodes
    from aoro_gym.envs import Course
    from aoro_gym.machine import Machine
    from aoro_gym.reporting.page import Passage
    from aoro_gym.simulation.manoeuvres import Manoeuvre, Recording
    from aoro_gym.simulation.plots import Section
    from aoro_gym.terrains import Plane, Report
    from aoro_gym.twin import Twin
    from aoro_gym.validation import Validation


class _Commands(TyperGroup):
    """Ends with one line where a command is interrupted that has none of its own."""

    def invoke(self, ctx: typer.Context) -> Any:
        try:
            return super().invoke(ctx)
        except KeyboardInterrupt:
            _interrupted("the same command begins anew")


app = typer.Typer(
    name="aoro-gym",
    cls=_Commands,
    no_args_is_help=True,
    add_completion=False,
    rich_markup_mode="rich",
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)

MACHINE, DATASHEET = "aoro", "aoro_datasheet"
"""Bundled machines: the calibrated one, and the one before any calibration."""
DISK_FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
"""Errors that are no fault of the input."""
NONE = "none"
"""What leaves an optional machine out."""
SWING_TARGETS_DEG = (-22.0, 18.0, -8.0)
"""Joint angles that the demo's episode asks for one after the other, from 15 degrees to the left."""
SWING_HOLD_S = 2.5
FOREST_SEED, FOREST_SIZE, SCAN_DENSITY = 7, (60.0, 60.0), 15.0
"""The demo's forest, its sides [m], and how its scan sees it [points/m²]."""
DRIVE, DRIVE_LENGTH, DRIVERS = "AORO/PathTracking-v0", 40.0, ("paths-dagger", "pure-pursuit")
"""The demo's path over it [m], and who follows it: a shipped policy, and a reference controller beside it."""
HELD_OUT_FORESTS, HELD_OUT_PATHS = (101, 102, 103), 100
"""What trainings are evaluated on: seeds of forests, and the first seed of other paths over the same ground."""
FULL_SIGNAL_V = 2.0
"""Distance [V] of the full steering signal from the middle."""
MOST_EPISODES = 10_000
"""Of one evaluation."""
MOST_HOLES = 8
"""Places without ground that are listed; the JSON names all."""

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
blind = typer.Typer(
    no_args_is_help=True,
    help="The blind check: a diagnosis on machines whose deviation is withheld. In turn: seal, run, score; atlas.",
)
app.add_typer(blind, name="blind")


def main() -> None:
    """Entry point of ``aoro-gym``."""
    app()


def _version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"aoro-gym {VERSION}")
        raise typer.Exit


@app.callback()
def _top(
    version: Annotated[
        bool, typer.Option("--version", help="Show the version.", callback=_version, is_eager=True)
    ] = False,
) -> None:
    """A fast digital twin of AORO, a 10 t articulated forestry research machine.

    [bold]Try[/]

      aoro-gym demo                         validation, a controlled turn and a forest drive, as one page
      aoro-gym simulate --help              any other manoeuvre
      aoro-gym validate                     the twin beside the published machine
      aoro-gym calibrate --help             make a twin agree with your own logs
      aoro-gym parameters steering.valve    what the machine is made of, with sources
      aoro-gym evaluate --help              controllers and policies side by side, on any ground
      aoro-gym train --help                 a policy of your own, on your machine and your ground
      aoro-gym diagnose --help              why your machine and its twin disagree
      aoro-gym blind --help                 machines with a withheld deviation, to check a diagnosis on
    """


@app.command()
def parameters(
    pattern: Annotated[
        str | None, typer.Argument(metavar="[PATTERN]", help="Part of a key, or a glob such as 'steering.*.leakage'.")
    ] = None,
    effects: Annotated[
        bool, typer.Option("--effects", help="List the effects that may part a machine from its twin instead.")
    ] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON instead of a table.")] = False,
    machine: MachineOption = MACHINE,
    set_: SetOption = None,
    scale: ScaleOption = None,
) -> None:
    """List the machine's parameters: value, unit, range, role and source.

    A range is a soft prior of about 95 %. Keys are what --set and --scale take. With --effects: what each effect does, its
    magnitudes with their ranges, and what can be measured of it on any machine.

    [bold]Examples[/]

      aoro-gym parameters
      aoro-gym parameters --effects
      aoro-gym parameters steering.valve
      aoro-gym parameters 'driveline.*.displacement' --json
      aoro-gym parameters oil --set oil.gas_fraction=0.01
    """
    if effects:
        _list_effects(pattern, as_json, machine, set_, scale)
        return
    with _checking_input():
        found = _machine(machine, set_, scale).parameters(pattern)
        if not found:
            raise ValueError(f"no parameter matches {pattern!r}; 'aoro-gym parameters' lists all")
    if as_json:
        rows = [
            {"key": p.key, "value": p.value, "unit": p.unit, "range": list(p.range), "role": p.role, "source": p.source}
            | ({"note": p.note} if p.note else {})
            for p in found
        ]
        typer.echo(json.dumps(rows, indent=2, ensure_ascii=False))
        return
    for item in _parameter_rows(found, terminal.out().width):
        terminal.out().print(item, highlight=False)


PARAMETERS_WIDTH = 120
"""Characters from which a parameter has one row of a table."""


def _parameter_rows(found: Sequence[Any], width: int) -> Iterator[RenderableType]:
    """A table of parameters; where the console is narrow, two lines each."""
    table = Table(box=None, pad_edge=False, header_style="bold")
    table.add_column("key", style="cyan", overflow="fold")
    for name in ("value", "unit", "range", "role"):
        table.add_column(name, justify="right" if name == "value" else "left", no_wrap=True)
    table.add_column("source", style="dim", overflow="fold")
    for p in found:
        limits = f"{p.range[0]:.6g} - {p.range[1]:.6g}"
        source = f"{p.source} ({p.note})" if p.note else p.source
        unit = "" if p.unit == "1" else p.unit
        if width < PARAMETERS_WIDTH:
            yield Text.assemble((p.key, "cyan"), " = ", f"{p.value:.6g} {unit}".rstrip(), f"  ({limits}, {p.role})")
            yield Padding(Text(source, "dim"), (0, 0, 0, 4))
        else:
            table.add_row(escape(p.key), f"{p.value:.6g}", escape(unit), limits, p.role, escape(source))
    if width >= PARAMETERS_WIDTH:
        yield table


def _list_effects(
    pattern: str | None, as_json: bool, machine: str, set_: list[str] | None, scale: list[str] | None
) -> None:
    """The catalogue of effects, with what they measure without and at the ends of their ranges."""
    with _checking_input():
        from aoro_gym.effects.catalogue import matching

        chosen = _machine(machine, set_, scale)
        rows = [effect.describe(chosen) for effect in matching(pattern)]
    if as_json:
        typer.echo(json.dumps(rows, indent=2, ensure_ascii=False))
        return
    table = Table(box=None, pad_edge=False, header_style="bold")
    table.add_column("effect", style="cyan", overflow="fold")
    table.add_column("component", overflow="fold")
    table.add_column("magnitude and range", overflow="fold")
    table.add_column("what is measured: without, at the ends", overflow="fold")
    table.add_column("physics", style="dim", overflow="fold")
    for row in rows:
        magnitudes = [
            f"{one['name']} {one['range'][0]:g} - {one['range'][1]:g}"
            + ("" if one["unit"] == "1" else f" {one['unit']}")
            for one in row["magnitudes"]
        ]
        measured = [
            f"{one['quantity']}: {one['none']:.4g}, {one['low']:.4g} - {one['high']:.4g}"
            + ("" if one["unit"] == "1" else f" {one['unit']}")
            for one in row["operational"]
        ]
        table.add_row(
            row["id"],
            row["component"],
            escape("\n".join(magnitudes)),
            escape("\n".join(measured)),
            escape(row["physics"]),
        )
    terminal.out().print(table)


@app.command()
def simulate(
    manoeuvre: Annotated[
        str,
        typer.Option("--manoeuvre", "-m", metavar="left|right|drive|FILE.csv", help="What the machine is told to do."),
    ],
    out: Annotated[
        Path, typer.Option("--out", "-o", metavar="LOG", help="Log to write, .csv or .parquet; plots go beside it.")
    ] = Path("log.csv"),
    signal: Annotated[
        float | None,
        typer.Option("--signal", metavar="PERCENT", help="Share of the full signal; 100, or 50 to drive."),
    ] = None,
    duration: Annotated[
        float | None,
        typer.Option(
            "--duration",
            metavar="S",
            help="Simulated time. Default: 0.7 s past a turn's stop, 6 s of drive, a file's end.",
        ),
    ] = None,
    start_angle: Annotated[
        float | None, typer.Option("--start-angle", metavar="DEG", help="Joint angle at the start of a FILE; 0.")
    ] = None,
    slope: Annotated[float, typer.Option("--terrain-slope", metavar="DEG", help="Slope of the ground.")] = 0.0,
    slope_direction: Annotated[
        float,
        typer.Option("--terrain-direction", metavar="DEG", help="Direction of ascent, counter-clockwise from ahead."),
    ] = 0.0,
    friction: Annotated[
        float, typer.Option("--terrain-friction", metavar="FACTOR", help="Tire friction against dry asphalt.")
    ] = 1.0,
    rolling: Annotated[
        float, typer.Option("--terrain-rolling", metavar="FACTOR", help="Rolling resistance against asphalt.")
    ] = 1.0,
    ideal: Annotated[
        bool, typer.Option("--ideal-sensors", help="Measured columns without noise, zero error and quantiser.")
    ] = False,
    machine: MachineOption = MACHINE,
    set_: SetOption = None,
    scale: ScaleOption = None,
    device: DeviceOption = "cpu",
    seed: SeedOption = 0,
    quiet: QuietOption = False,
) -> None:
    """Run one manoeuvre and write its log, plots and key figures.

    left and right are full turns from the opposite stop; drive goes straight on. Each begins with 0.6 s of standstill.
    A FILE.csv has the column time_s and one or more of steering_signal (or steering_signal_V), drive_signal,
    arm_fl ... arm_rr, traction_fl ... traction_rr, gear, parking_brake; a row holds until the next. A log is one, too.

    LOG.csv gets measured columns at 100 Hz, joint angle and pressures with the noise of their sensors (drawn by --seed),
    and the simulator's exact state as true_*. Beside it come LOG.toml (how it was made), LOG.json (key figures, without
    noise), LOG.png and LOG.html (plots).

    [bold]Examples[/]

      aoro-gym simulate --manoeuvre left --out turn.csv
      aoro-gym simulate --manoeuvre right --signal 50 --out right50.csv
      aoro-gym simulate --manoeuvre drive --signal 40 --duration 8 --terrain-slope 5 --out hill.csv
      aoro-gym simulate --manoeuvre left --scale steering.valve.spool_time_constant=5 --out slow_spool.csv
      aoro-gym simulate --manoeuvre my_commands.csv --start-angle 10 --out mine.csv
    """
    with _checking_input():
        from aoro_gym.simulation.log import check_log_path
        from aoro_gym.terrains import Plane

        check_log_path(out)
        chosen = _machine(machine, set_, scale)
        terrain = Plane(slope_deg=slope, direction_deg=slope_direction, friction=friction, rolling_resistance=rolling)
        plan = _manoeuvre(manoeuvre, signal, duration, start_angle, chosen, out)
        twin = _twin(chosen, terrain, device, seed)
    made_by = _made_by(machine, set_, scale, device, seed, ideal=ideal)
    section = _run(twin, plan)
    written = _write(section, twin, out, made_by)
    terminal.out().print(_figure_table(section))
    if section.recording.manoeuvre.turn and section.figures["turn_time_s"] is None:
        terminal.out().print("The turn did not reach its stop, so it has no key figures; a longer --duration may help.")
    _say(written)


@app.command()
def demo(
    out: Annotated[Path, typer.Option("--out", "-o", metavar="FOLDER", help="Folder to write to.")] = Path("demo"),
    machine: MachineOption = MACHINE,
    set_: SetOption = None,
    scale: ScaleOption = None,
    device: DeviceOption = "cpu",
    seed: SeedOption = 0,
    quiet: QuietOption = False,
) -> None:
    """Validate the twin, let controllers steer and policies drive it, turn fully left and drive straight on: one page.

    FOLDER/index.html holds it all; the whole validation stands in FOLDER/validation, as from 'aoro-gym validate'. The
    controlled turn is an episode of the learning environment AORO/Turning-v0 with its reference controller, the drive one
    of AORO/PathTracking-v0 with a learned policy, beside pure pursuit: over a forest that is scanned with noise and holes,
    saved, loaded back and repaired.

    [bold]Examples[/]

      aoro-gym demo
      aoro-gym demo --out cold --scale steering.valve.spool_time_constant=5
    """
    with _checking_input():
        from aoro_gym.simulation.manoeuvres import standing_turn, straight_drive

        _check_folder(out, "index.html")
        chosen = _machine(machine, set_, scale)
        plans = {"left_turn": standing_turn(1, 1.0, float(chosen.joint.range)), "straight_drive": straight_drive(0.5)}
        second = _second_machine(machine, set_, scale, DATASHEET)
        family = _ensemble(None, bundled=_is_bundled(machine, set_, scale))
        twin = _twin(chosen, None, device, seed)
    made_by = _made_by(machine, set_, scale, device, seed)
    result = _validated(chosen, second, family, device, seed)
    passages = [
        _validation_passage(result, out / "validation"),
        _swing(chosen, device, seed, out / "turning.gif"),
        _forest_drive(chosen, device, seed, out / "drive"),
    ]
    sections = []
    for name, plan in plans.items():
        sections.append(_run(twin, plan))
        _write(sections[-1], twin, out / f"{name}.csv", made_by, page=False)
        terminal.out().print(_figure_table(sections[-1]))
    from aoro_gym.simulation.plots import write_html

    page = out / "index.html"
    write_html(page, "AORO twin: demo", _lead(made_by), sections, passages)
    _say([page.resolve()])


@app.command()
def validate(
    out: Annotated[Path, typer.Option("--out", "-o", metavar="FOLDER", help="Folder to write to.")] = Path(
        "validation"
    ),
    uncalibrated: Annotated[
        str, typer.Option("--uncalibrated", metavar="NAME|FILE", help="Second machine to compare with, or none.")
    ] = DATASHEET,
    ensemble: Annotated[
        list[str] | None,
        typer.Option(
            "--ensemble",
            metavar="FILE|FOLDER",
            help="Machines that fit as well: their spread is shown. Repeatable, or none. Default: the bundled ones.",
        ),
    ] = None,
    recalibrate: Annotated[
        bool,
        typer.Option(
            "--recalibrate", help="Calibrate the uncalibrated machine first, and validate the result. Takes minutes."
        ),
    ] = False,
    machine: MachineOption = MACHINE,
    set_: SetOption = None,
    scale: ScaleOption = None,
    device: DeviceOption = "cpu",
    seed: SeedOption = 0,
    restart: RestartOption = False,
    accept_code_change: AcceptCodeChangeOption = False,
    quiet: QuietOption = False,
) -> None:
    """Full turns of the twin beside the published machine and its published twin.

    Left and right turns at 100, 75 and 50 % signal, each from the opposite stop, go through the published measuring
    chain; their seven key figures stand beside the published ones with relative errors, then what the sensor's noise
    does to them, the machine before its calibration, and the spread of machines that fit as well.

    FOLDER gets validation.json, plots (PNG) and index.html.

    [bold]Examples[/]

      aoro-gym validate
      aoro-gym validate --machine mine.toml --ensemble mine_ensemble --out mine
      aoro-gym validate --scale steering.valve.spool_time_constant=5 --uncalibrated none
      aoro-gym validate --recalibrate --out again
    """
    with _checking_input():
        from aoro_gym.execution.files import check_writable
        from aoro_gym.machine import Machine

        _check_folder(out, "index.html")
        if recalibrate and (machine != MACHINE or set_ or scale):
            raise ValueError("--recalibrate makes its machine from --uncalibrated; drop --machine, --set and --scale")
        if recalibrate and uncalibrated == NONE:
            raise ValueError("--recalibrate starts from --uncalibrated, which is none; name a machine")
        chosen = _machine(machine, set_, scale)
        second = _second_machine(machine, set_, scale, uncalibrated)
        family = _ensemble(ensemble, bundled=_is_bundled(machine, set_, scale) and not recalibrate)
        _check_seed(seed)
        _check_device(device)
        if recalibrate:
            check_writable(out / "calibrated.toml")
    written = []
    if recalibrate:
        from aoro_gym.calibration.published import calibrate_published

        assert second is not None
        file = out / "calibrated.toml"
        written += _calibrate(
            lambda **options: calibrate_published(second, **options), file, force=True, seed=seed, device=device,
            restart=restart, accept_code_change=accept_code_change,
        )  # fmt: skip
        chosen = Machine.load(file)
    from aoro_gym.validation.report import print_tables, write_report

    result = _validated(chosen, second, family, device, seed)
    with _running():
        written += write_report(result, out)
    print_tables(terminal.out(), result)
    _say(written)


@app.command()
def calibrate(
    logs: Annotated[
        list[Path] | None, typer.Argument(metavar="[LOG]...", help="Logs (.csv or .parquet), after --logs.")
    ] = None,
    published: Annotated[bool, typer.Option("--published", help="Calibrate against the published figures.")] = False,
    use_logs: Annotated[bool, typer.Option("--logs", help="Calibrate against the LOGs that follow.")] = False,
    ensemble: Annotated[
        int, typer.Option("--ensemble", metavar="N", help="Further machines that fit as well, as different as can be.")
    ] = 0,
    starts: Annotated[
        int | None, typer.Option("--starts", metavar="N", help="Searches that are refined. Default: 2.")
    ] = None,
    population: Annotated[
        int | None,
        typer.Option("--population", metavar="N", help="Machines tried at first. Default: 512, or 64 on logs."),
    ] = None,
    out: Annotated[Path, typer.Option("--out", "-o", metavar="FILE", help="Machine file to write, .toml.")] = Path(
        "machine.toml"
    ),
    machine: MachineOption = DATASHEET,
    set_: SetOption = None,
    scale: ScaleOption = None,
    device: DeviceOption = "cpu",
    seed: SeedOption = 0,
    force: Annotated[
        bool, typer.Option("--force", help="Write FILE even if the machine that was found does not fit.")
    ] = False,
    restart: RestartOption = False,
    accept_code_change: AcceptCodeChangeOption = False,
    quiet: QuietOption = False,
) -> None:
    """Fit the machine's uncertain parameters within their ranges, to published figures or to your logs.

    --published: the published procedure (valve curve, dead band, turn times, driving pressure), then all uncertain
    parameters against the key figures of the published twin. --logs: the twin repeats all commands of each LOG (steering,
    drive, arms, traction, gear, parking brake) on the ground and under the conditions of the manifest beside it, and its
    joint angle, pressures and engine speed are compared sample by sample. A LOG needs time_s, a command such as
    steering_signal, joint_angle_rad (or _deg) and a rest at its begin; pressures help. Full turns and slow ramps say most.

    First comes the verdict: whether the machine that was found does what it was calibrated to. If not, the exit code is 1
    and FILE is not written, unless by --force.

    Writes FILE, its report beside it (.json) and, with --ensemble, the folder FILE_ensemble. Ctrl-C is safe: the same
    command goes on where it stopped.

    [bold]Examples[/]

      aoro-gym calibrate --published --out machine.toml
      aoro-gym calibrate --published --ensemble 8 --out machine.toml
      aoro-gym calibrate --logs turn_left.csv turn_right.csv ramp.csv --out mine.toml
      aoro-gym validate --machine mine.toml
    """
    with _checking_input():
        from aoro_gym.calibration.recordings import read_recording
        from aoro_gym.execution.files import check_writable

        if published == use_logs:
            raise ValueError("give one of --published and --logs LOG...")
        if published and logs:
            raise ValueError(f"--published takes no logs, but got {logs[0]}; give --logs instead to calibrate on logs")
        if use_logs and not logs:
            raise ValueError("--logs needs the logs behind it, such as --logs turn_left.csv turn_right.csv")
        for option, value, least in (("ensemble", ensemble, 0), ("starts", starts, 1), ("population", population, 2)):
            if value is not None and value < least:
                raise ValueError(f"--{option} = {value} is below {least}")
        if out.suffix != ".toml":
            raise ValueError(f"--out {out} must end in .toml")
        check_writable(out)
        for path in logs or []:
            if out.resolve() in (path.resolve(), path.with_suffix(".toml").resolve()):
                raise ValueError(f"--out {out} would replace the manifest of {path}; name another file")
        chosen = _machine(machine, set_, scale)
        _check_seed(seed)
        _check_device(device)
        for path in logs or []:
            read_recording(path)
    from aoro_gym.calibration.logs import calibrate_logs
    from aoro_gym.calibration.published import calibrate_published

    sizes = {name: n for name, n in (("starts", starts), ("population", population)) if n is not None}

    def fit(**options: Any) -> Any:
        return calibrate_published(chosen, **options) if published else calibrate_logs(chosen, logs or [], **options)

    _say(
        _calibrate(
            fit, out, force=force, ensemble=ensemble, seed=seed, device=device, restart=restart,
            accept_code_change=accept_code_change, **sizes,
        )
    )  # fmt: skip


@app.command()
def diagnose(
    logs: Annotated[
        list[Path] | None, typer.Argument(metavar="[LOG]...", help="Logs (.csv or .parquet) to be explained.")
    ] = None,
    metrics: Annotated[
        Path | None,
        typer.Option("--metrics", metavar="TABLE", help="Key figures of full turns (.csv), instead of logs."),
    ] = None,
    source: Annotated[
        str | None,
        typer.Option("--source", metavar="NAME", help="Rows of TABLE that are the machine's, by their source."),
    ] = None,
    healthy: Annotated[
        list[Path] | None,
        typer.Option(
            "--healthy", metavar="LOG|DIR", help="Log of the same machine while nothing was wrong, or a folder of them."
        ),
    ] = None,
    holdout: Annotated[
        list[str] | None,
        typer.Option(
            "--holdout",
            metavar="NAME",
            help="Logs, by name or glob, that take no part in the fit; or rows: signal=75,50.",
        ),
    ] = None,
    fit: Annotated[
        list[str] | None,
        typer.Option("--fit", metavar="NAME", help="Logs or rows that do; the others are held out."),
    ] = None,
    commissioned: Annotated[
        bool, typer.Option("--commissioned", help="The machine file was fitted to this very machine.")
    ] = False,
    check: Annotated[
        bool,
        typer.Option("--check", help="Read the logs, say what was read, in which units, what is missing; no more."),
    ] = False,
    out: Annotated[Path, typer.Option("--out", "-o", metavar="DIR", help="Folder to write to.")] = Path("diagnosis"),
    machine: MachineOption = MACHINE,
    set_: SetOption = None,
    scale: ScaleOption = None,
    device: DeviceOption = "cpu",
    restart: RestartOption = False,
    accept_code_change: AcceptCodeChangeOption = False,
    quiet: QuietOption = False,
) -> None:
    """Say why a machine and its twin disagree: where, because of what, by how much, and what to record next.

    The twin repeats every LOG with each effect of the catalogue (aoro-gym parameters --effects) and with pairs of them, all
    with the same freedom in uncertain parameters. A LOG needs time_s, steering_signal (or steering_signal_V),
    joint_angle_rad (or joint_angle_deg) and half a second of rest at its begin; port and pump pressures tell far more.

    With --healthy logs, best of the same commands, the twin is fitted to those first, and the question is what has changed
    since. Without, parameters may lie anywhere in their ranges, and what the twin's laws do otherwise cannot be told from an
    effect.

    Where only key figures of full turns are known, --metrics takes a TABLE with the columns signal_percent, source and
    figures such as turn_time_s (aoro-gym validate writes them all), std_turn_time_s and so on if their standard deviations
    are known, and direction. --fit and --holdout then select rows: signal=100, or direction=left.

    Writes DIR/diagnosis.json, DIR/report.html and a machine file for every cause that survives. A verdict of a cause is
    only as good as the blind check says (aoro-gym blind --help). Killed at any time, the same command goes on where it was.

    --check reads LOGs and --healthy as a diagnosis would, says what it read, in which units, what is missing and what is
    doubtful, and stops: with exit code 2 if a log is refused.

    [bold]Examples[/]

      aoro-gym diagnose --check later/*.csv
      aoro-gym diagnose later/*.csv --healthy healthy --machine mine.toml --out diagnosis
      aoro-gym diagnose left.csv right.csv ramp.csv --holdout ramp
      aoro-gym diagnose later/*.csv --healthy healthy --device cuda:0
      aoro-gym diagnose --metrics table.csv --source physical --fit signal=100
    """
    with _checking_input():
        from aoro_gym.diagnosis.recording import read_recording
        from aoro_gym.execution.files import check_writable

        if bool(logs) == bool(metrics):
            raise ValueError("give LOGs or --metrics TABLE, and not both")
        if check:
            if metrics:
                raise ValueError("--check reads LOGs, not --metrics TABLE; leave one out")
            _check_logs([*(logs or []), *(path for one in healthy or [] for path in _logs_in(one))])
            return
        if fit and holdout:
            raise ValueError("give --fit or --holdout, not both: what is not fitted is held out")
        check_writable(out / "diagnosis.json")
        chosen = _machine(machine, set_, scale)
        _check_device(device)
        if metrics:
            if healthy or commissioned:
                raise ValueError("--metrics knows no healthy machine: leave out --healthy and --commissioned")
            _diagnose_table(metrics, source, fit, holdout, chosen, device, out, restart, accept_code_change)
            return
        if source:
            raise ValueError(f"--source {source} belongs to --metrics TABLE; logs have no sources")
        recordings = [read_recording(path) for path in logs or []]
        before = [read_recording(path) for one in healthy or [] for path in _logs_in(one)]
        left_out = _selected("--holdout", holdout, recordings)
        if fit:
            kept = _selected("--fit", fit, recordings)
            left_out = [one for one in recordings if not any(one is other for other in kept)]
        used = [one for one in recordings if not any(one is other for other in left_out)]
        if not used:
            raise ValueError("--holdout leaves no log to fit; leave one at least")
    from aoro_gym.diagnosis.diagnose import diagnose as find
    from aoro_gym.diagnosis.report import summary, write_report
    from aoro_gym.diagnosis.resuming import resumable

    inputs = {"machine": chosen.identity, "commissioned": commissioned}
    for role, those in (("log", used), ("healthy log", before), ("held-out log", left_out)):
        inputs[role] = {one.name: one for one in those}
    with (
        _running(),
        _resumable(),
        terminal.progress("diagnosing") as tell,
        resumable(device, out, inputs, restart=restart, accept_code_change=accept_code_change) as simulator,
    ):
        found = find(
            used,
            chosen,
            healthy=before,
            held_out=left_out,
            commissioned=True if commissioned else None,
            simulator=simulator,
            out=out,
            progress=tell,
        ).with_code_changes(simulator.code_changes)
        written = [found.save(out), write_report(found, out)]
    for item in summary(found):
        terminal.out().print(item)
    _say(written)


def _check_logs(paths: list[Path]) -> None:
    """Say what a diagnosis would read of every log; exit with 2 if it refuses one."""
    from aoro_gym.diagnosis.recording import CHANNELS, read_log
    from aoro_gym.recording.summary import describe

    refused = 0
    for path in paths:
        try:
            lines = describe(read_log(path), channels=CHANNELS)
        except (ValueError, OSError) as error:
            refused += 1
            terminal.err().print(f"[bold red]error:[/] {escape(str(error))}", soft_wrap=True, highlight=False)
            continue
        terminal.out().print("\n".join(lines), soft_wrap=True, highlight=False, markup=False)
    if refused:
        raise ValueError(f"{refused} of {len(paths)} logs cannot be used")


def _diagnose_table(
    table: Path,
    source: str | None,
    fit: list[str] | None,
    holdout: list[str] | None,
    machine: Machine,
    device: str,
    out: Path,
    restart: bool,
    accept_code_change: bool,
) -> None:
    from aoro_gym.diagnosis.report import summary, write_report
    from aoro_gym.diagnosis.resuming import resumable
    from aoro_gym.diagnosis.tables import diagnose_rows, read_rows, selected

    rows = read_rows(table, source)
    left_out = selected("--holdout", holdout or [], rows)
    if fit:
        kept = selected("--fit", fit, rows)
        left_out = [row for row in rows if row not in kept]
    used = [row for row in rows if row not in left_out]
    if not used:
        raise ValueError("--holdout leaves no row to fit; leave one at least")
    inputs = {"machine": machine.identity, "rows": used, "held-out rows": left_out}
    with (
        _running(),
        _resumable(),
        terminal.progress("diagnosing") as tell,
        resumable(device, out, inputs, restart=restart, accept_code_change=accept_code_change) as simulator,
    ):
        found = diagnose_rows(used, machine, held_out=left_out, simulator=simulator, out=out, progress=tell)
        found = found.with_code_changes(simulator.code_changes)
        written = [found.save(out), write_report(found, out)]
    for item in summary(found):
        terminal.out().print(item)
    _say(written)


@app.command()
def terrain(
    file: Annotated[
        Path, typer.Argument(metavar="FILE", help="Mesh, elevation raster, point cloud or .npy heights to drive on.")
    ],
    out: Annotated[
        Path | None,
        typer.Option("--out", "-o", metavar="MESH", help="Terrain to write (.ply). Default: FILE_terrain.ply, here."),
    ] = None,
    units: Annotated[
        str | None, typer.Option("--units", metavar="UNIT", help="m, km, dm, cm, mm, ft, us-ft or in.")
    ] = None,
    z_units: Annotated[str | None, typer.Option("--z-units", metavar="UNIT", help="Of heights, if another.")] = None,
    up: Annotated[str | None, typer.Option("--up", metavar="AXIS", help="Axis that points up: x, y or z.")] = None,
    crs: Annotated[
        str | None, typer.Option("--crs", metavar="CODE", help="Coordinate system, such as EPSG:32633.")
    ] = None,
    cell: Annotated[float | None, typer.Option("--cell", metavar="M", help="Distance of heights.")] = None,
    window: Annotated[
        tuple[float, float, float, float] | None,
        typer.Option("--window", metavar="W S E N", help="West, south, east, north of the part to take, in metres."),
    ] = None,
    hole_limit: Annotated[float, typer.Option("--hole-limit", metavar="M", help="Widest gap that is bridged.")] = 5.0,
    spike_limit: Annotated[float, typer.Option("--spike-limit", metavar="M", help="Height of spikes to remove.")] = 0.5,
    ground: Annotated[
        str | None,
        typer.Option("--ground", metavar="class|filter|all", help="What is ground. Default: the class, if given."),
    ] = None,
    quiet: QuietOption = False,
    nodata: Annotated[
        list[str] | None,
        typer.Option(
            "--nodata", metavar="VALUE", help="Height that means unknown; none: there is no other. Repeatable."
        ),
    ] = None,
    band: Annotated[int | None, typer.Option("--band", metavar="N", help="Band of a raster with the heights.")] = None,
) -> None:
    """Load ground to drive on, check and repair it, and say what was done.

    Units, up axis and coordinate system are taken from the options, the file, or recognised. Trees and buildings are
    told from the ground, gaps up to --hole-limit are bridged, wider ones are named. What cannot be driven on is refused.

    Writes MESH in local metres, and beside it the report (.json, with the origin of the local frame) and a plan (.png).

    [bold]Examples[/]

      aoro-gym terrain dem.tif
      aoro-gym terrain forest.laz --hole-limit 10 --out forest.ply
      aoro-gym terrain scan.obj --units mm --up y
      aoro-gym terrain big.tif --window 430000 5150000 430400 5150400
      aoro-gym terrain depth.tif --z-units dm --nodata 0 --nodata -999 --band 1
    """
    with _checking_input():
        from aoro_gym.execution.files import check_writable
        from aoro_gym.terrains.figures import draw_terrain
        from aoro_gym.terrains.io.loading import load, save

        mesh = out if out is not None else Path(f"{file.stem}_terrain.ply")
        if mesh.suffix != ".ply":
            raise ValueError(f"--out {mesh} must end in .ply")
        for path in (mesh, mesh.with_suffix(".json"), mesh.with_suffix(".png")):
            if path.resolve() == file.resolve():
                raise ValueError(f"--out {mesh} would overwrite {file}; choose another name")
            check_writable(path)
        with terminal.progress(file.name) as tell:
            loaded = load(
                file,
                units=units,
                z_units=z_units,
                up=up,
                crs=crs,
                cell=cell,
                window=window,
                hole_limit=hole_limit,
                spike_limit=spike_limit,
                ground=ground,  # pyright: ignore[reportArgumentType]  load checks it
                nodata=_nodata(nodata),
                band=band,
                progress=lambda share: tell(file.name, share),
            )
    with _running():
        written = save(loaded, mesh)
        written.append(mesh.with_suffix(".png"))
        draw_terrain(loaded.terrain).savefig(written[-1], bbox_inches="tight")
    for item in _terrain_tables(loaded.report):
        terminal.out().print(item, highlight=False)
    _say(written)


@app.command()
def evaluate(
    env: Annotated[
        str,
        typer.Option(
            "--env", metavar="ID", show_default=False, help="AORO/PathTracking-v0 by default, or AORO/Turning-v0."
        ),
    ] = "AORO/PathTracking-v0",
    policy: Annotated[
        list[str] | None,
        typer.Option(
            "--policy",
            metavar="NAME|FILE",
            help="Who drives. Repeatable. Default: all controllers and shipped policies.",
        ),
    ] = None,
    trust_pickle: Annotated[
        bool,
        typer.Option("--trust-pickle", help="Load .zip files of Stable-Baselines3, which run code of their maker."),
    ] = False,
    terrain: Annotated[
        Path | None,
        typer.Option("--terrain", metavar="FILE", help="Ground: a mesh, raster or cloud. Default: generated forests."),
    ] = None,
    path: Annotated[
        Path | None,
        typer.Option("--path", metavar="FILE", help=PATH_HELP),
    ] = None,
    track: Annotated[str | None, typer.Option("--track", metavar="NAME|N", help=TRACK_HELP)] = None,
    join_gaps: Annotated[bool, typer.Option("--join-gaps", help=JOIN_GAPS_HELP)] = False,
    path_crs: Annotated[str | None, typer.Option("--path-crs", metavar="CRS", help=PATH_CRS_HELP)] = None,
    path_length: Annotated[
        float, typer.Option("--path-length", metavar="M", help="Of the paths that are generated on --terrain.")
    ] = 60.0,
    episodes: Annotated[int, typer.Option("--episodes", metavar="N", help="Episodes a policy.")] = 32,
    repeats: RepeatsOption = 1,
    out: Annotated[Path, typer.Option("--out", "-o", metavar="FOLDER", help="Folder to write to.")] = Path(
        "evaluation"
    ),
    films: Annotated[bool, typer.Option("--films/--no-films", help="Draw each policy's first episode.")] = True,
    restart: RestartOption = False,
    accept_code_change: AcceptCodeChangeOption = False,
    ray: RayOption = None,
    machine: MachineOption = MACHINE,
    set_: SetOption = None,
    scale: ScaleOption = None,
    device: DeviceOption = "cpu",
    seed: SeedOption = 0,
    quiet: QuietOption = False,
) -> None:
    """Drive the same episodes under several policies, and compare them.

    A policy is a reference controller, one that comes with the package, or a file that 'aoro-gym train' wrote.

    Means over the episodes with 95 % intervals: success, cross-track error, speed, energy, tilt, return and how episodes
    ended; of turning, the joint's responses. Episode i has the seed --seed + i for every policy. A terrain file is loaded,
    checked and repaired as 'aoro-gym terrain' does it.

    FOLDER gets evaluation.json, plots, films (MP4 with the extra 'video', else GIF) and index.html. Ctrl-C is safe: the
    same command goes on where it stopped.

    [bold]Examples[/]

      aoro-gym evaluate
      aoro-gym evaluate --policy preview --policy stanley --episodes 64
      aoro-gym evaluate --terrain forest.laz --path lap.gpx --policy preview
      aoro-gym evaluate --env AORO/Turning-v0 --scale steering.valve.spool_time_constant=5
      aoro-gym evaluate --env AORO/Turning-v0 --policy proportional-derivative --policy runs/turning/policy.json
    """
    with _checking_input():
        from aoro_gym.agents.evaluation import evaluate as evaluation

        _check_folder(out, "index.html")
        policies = _policies(env, policy, trust_pickle=trust_pickle)
        _check_episodes(episodes, repeats)
        chosen = _machine(machine, set_, scale)
        _check_seed(seed)
        _check_device(device)
        courses = _courses(env, terrain, path, path_length, track=track, join_gaps=join_gaps, path_crs=path_crs)
    made_by = _made_by(machine, set_, scale, device, seed)
    made_by |= {"terrain": None if terrain is None else str(terrain), "path": None if path is None else str(path)}
    made_by |= {"track": track, "join_gaps": join_gaps, "path_crs": path_crs}
    from aoro_gym.agents.evaluation.cached_episodes import accepted, resumable
    from aoro_gym.agents.evaluation.report import table, write_report

    asked: dict[str, Any] = {
        "episodes": episodes, "repeats": repeats, "seed": seed, "courses": courses, "machine": chosen, "device": device,
    }  # fmt: skip
    inputs = evaluation.asked_of(env, policies, **asked)
    episodes_of = resumable(out, inputs, restart=restart, accept_code_change=accept_code_change)
    with _resumable(), _running(), _entered(episodes_of) as kept, terminal.progress(env) as tell:
        driven = 0.5 if films else 0.95
        with _checking_input():  # such as paths that leave the ground
            result = evaluation.evaluate(
                env, policies, **asked, ray=ray, kept=kept, progress=terminal.within(tell, 0.0, driven)
            )
        made_by |= accepted(kept)
        drawing = terminal.within(tell, driven, 1.0)
        written = write_report(result, out, films=films, lead=_lead(made_by), made_by=made_by, progress=drawing)
    terminal.out().print(table(result))
    _say(written)


@app.command()
def leaderboard(
    env: Annotated[str, typer.Option("--env", metavar="ID", help="AORO/PathTracking-v0 or AORO/Turning-v0.")] = DRIVE,
    policy: Annotated[
        list[str] | None,
        typer.Option(
            "--policy",
            metavar="NAME|FILE",
            help="Who drives. Repeatable. Default: all controllers and shipped policies.",
        ),
    ] = None,
    episodes: Annotated[
        int, typer.Option("--episodes", metavar="N", help="Episodes a policy, under each perturbation.")
    ] = 100,
    repeats: RepeatsOption = 1,
    out: Annotated[Path, typer.Option("--out", "-o", metavar="FOLDER", help="Folder to write to.")] = Path(
        "leaderboard"
    ),
    readme: Annotated[
        Path | None,
        typer.Option("--readme", metavar="FILE.md", help="Put the table between the marks of this file, too."),
    ] = None,
    restart: RestartOption = False,
    accept_code_change: AcceptCodeChangeOption = False,
    ray: RayOption = None,
    machine: MachineOption = MACHINE,
    set_: SetOption = None,
    scale: ScaleOption = None,
    device: DeviceOption = "cpu",
    seed: Annotated[
        int | None, typer.Option("--seed", help="Of the first episode. Default: one that is held out.")
    ] = None,
    quiet: QuietOption = False,
) -> None:
    """Rank policies and tuned controllers on seeds, grounds and machines that none of them saw.

    All drive the same episodes three times: on the machine as it is; with all of its uncertain parameters drawn within
    their ranges; and with an effect of the catalogue switched on in addition. Figures are means of the middle half of the
    episodes (interquartile means), with bootstrapped 95 % intervals, and differences from the best controller, episode by
    episode. With --repeats the same is asked for N times, with other noise and other machines: beside the interval over
    episodes, which might have been others, there is one over what might have happened in these (stratified bootstrap).

    Ctrl-C is safe: the same command goes on where it stopped. FOLDER gets leaderboard.json, leaderboard.md and
    leaderboard.png. In --readme the table replaces what stands between
    <!-- leaderboard ID --> and <!-- leaderboard ID end -->.

    [bold]Examples[/]

      aoro-gym leaderboard
      aoro-gym leaderboard --env AORO/Turning-v0 --episodes 350 --repeats 4 --readme README.md
      aoro-gym leaderboard --policy preview --policy runs/mine/best.json
    """
    with _checking_input():
        from aoro_gym.agents.evaluation import leaderboard as board
        from aoro_gym.agents.evaluation.cached_episodes import accepted, resumable
        from aoro_gym.agents.evaluation.evaluate import asked_of
        from aoro_gym.agents.evaluation.inputs import machine_ranges

        _check_folder(out, "leaderboard.json")
        policies = _policies(env, policy)
        _check_episodes(episodes, repeats)
        if readme is not None:
            board.around_table(readme, env)
        seed = board.SEED if seed is None else seed
        chosen = _machine(machine, set_, scale)
        _check_seed(seed)
        _check_device(device)
    asked: dict[str, Any] = {
        "episodes": episodes, "repeats": repeats, "seed": seed, "machine": chosen, "device": device,
    }  # fmt: skip
    inputs = asked_of(env, policies, **asked) | {"machine ranges": machine_ranges(chosen)}
    episodes_of = resumable(out, inputs, restart=restart, accept_code_change=accept_code_change)
    with _resumable(), _running(), _entered(episodes_of) as kept, terminal.progress(env) as tell:
        with _checking_input():  # such as a cluster that is not there
            result = board.compare(env, policies, **asked, ray=ray, kept=kept, progress=tell)
        made_by = _made_by(machine, set_, scale, device, seed) | accepted(kept)
        written = board.write(result, out, readme=readme, made_by=made_by)
    terminal.out().print(board.table(result))
    _say(written)


@app.command()
def curves(
    folders: Annotated[
        list[Path], typer.Argument(metavar="FOLDER...", help="Of 'aoro-gym train', done or on the way.")
    ],
    out: Annotated[Path, typer.Option("--out", "-o", metavar="FOLDER", help="Folder to write to.")] = Path("curves"),
    restart: RestartOption = False,
    accept_code_change: AcceptCodeChangeOption = False,
    quiet: QuietOption = False,
) -> None:
    """Learning curves of trainings, beside the reference controllers on the episodes that they were evaluated on.

    Trainings that differ by their seed alone make one curve, the mean over the seeds, with a band from the least to the
    largest of them. FOLDER gets curves.png and curves.json.

    [bold]Examples[/]

      for s in 0 1 2; do aoro-gym train --env AORO/Turning-v0 --seed $s --out runs/turning_$s; done
      aoro-gym curves runs/turning_*
    """
    with _checking_input():
        from aoro_gym.agents.evaluation.cached_episodes import accepted, resumable
        from aoro_gym.agents.training import curves as drawing

        _check_folder(out, "curves.json")
        found = drawing.read(folders)
        plan = found[0].plan
        chosen = _machine(plan.machine, plan.set, plan.scale)
        _check_device(plan.device)
        held_out = _training_courses(replace(plan, forests=1))[1]
        for warning in drawing.check_inputs(folders, chosen, held_out):
            terminal.warn(warning)
    inputs = drawing.references_asked(plan, chosen, held_out)
    episodes_of = resumable(out, inputs, restart=restart, accept_code_change=accept_code_change)
    with _resumable(), _running(), _entered(episodes_of) as kept, terminal.progress(plan.env) as tell:
        beside = drawing.references(plan, chosen, held_out, tell, kept)
        picture = out / "curves.png"
        _write_json(out / "curves.json", drawing.to_json(found, beside) | accepted(kept))
        drawing.write_figure(found, beside, picture)
    terminal.out().print(drawing.table(found, beside))
    _say([picture, out / "curves.json"])


@app.command()
def gap(
    policy: Annotated[
        str,
        typer.Option("--policy", metavar="NAME|FILE", help="Who drives; with --retrain a file of 'aoro-gym train'."),
    ],
    env: Annotated[str, typer.Option("--env", metavar="ID", help="AORO/PathTracking-v0 or AORO/Turning-v0.")] = DRIVE,
    plant: Annotated[
        str | None, typer.Option("--plant", metavar="NAME|FILE", help="Machine to drive. Default: --machine.")
    ] = None,
    effect: Annotated[
        list[str] | None,
        typer.Option("--effect", metavar="NAME=VALUE", help="Effect that the plant has, too, in SI. Repeatable."),
    ] = None,
    diagnosis: Annotated[
        Path | None,
        typer.Option("--diagnosis", metavar="FOLDER", help="What 'aoro-gym diagnose' wrote: its likeliest machine."),
    ] = None,
    improved: Annotated[
        str | None, typer.Option("--improved", metavar="NAME|FILE", help="Instead: machine of the improved twin.")
    ] = None,
    retrain: Annotated[
        int, typer.Option("--retrain", metavar="STEPS", help="Environment steps of retraining; 0 does not retrain.")
    ] = 0,
    episodes: Annotated[int, typer.Option("--episodes", metavar="N", help="Episodes in each place.")] = 64,
    out: Annotated[Path, typer.Option("--out", "-o", metavar="FOLDER", help="Folder to write to.")] = Path("gap"),
    restart: RestartOption = False,
    accept_code_change: AcceptCodeChangeOption = False,
    machine: MachineOption = MACHINE,
    set_: SetOption = None,
    scale: ScaleOption = None,
    device: DeviceOption = "cpu",
    seed: SeedOption = 0,
    quiet: QuietOption = False,
) -> None:
    """What a gap costs a policy, how much of that a diagnosis foresees, and how much retraining wins back.

    The policy drives the same episodes in the baseline (--machine), in the plant (--plant, --effect) and in the twin that a
    diagnosis improved (--diagnosis or --improved). With --retrain it learns on for so many steps in the improved twin, and
    as many in the baseline for comparison, and both drive in the plant. Ctrl-C is safe: the same command goes on where it
    stopped, and a retraining that is done is not done again. With another twin or policy --restart begins anew.

    FOLDER gets gap.json, and the retrained policies.

    [bold]Examples[/]

      aoro-gym gap --policy runs/mine/best.json --effect spool_lag=0.05 --diagnosis diagnosis
      aoro-gym gap --policy preview --plant field.toml --improved diagnosis/cause_1.toml
      aoro-gym gap --policy runs/mine/best.json --plant field.toml --diagnosis diagnosis --retrain 500000
    """
    with _checking_input():
        from aoro_gym.agents.evaluation.cached_episodes import accepted, resumable
        from aoro_gym.agents.evaluation.evaluate import asked_of
        from aoro_gym.agents.evaluation.inputs import machine_values
        from aoro_gym.agents.evaluation.leaderboard import forests
        from aoro_gym.agents.training import gap as gaps

        _check_folder(out, "gap.json")
        _, make = next(iter(_policies(env, [policy]).items()))
        _check_episodes(episodes)
        if retrain < 0:
            raise ValueError(f"--retrain = {retrain} is below 0")
        if diagnosis is not None and improved is None:
            improved = str(gaps.diagnosed(diagnosis))
        elif improved is None or diagnosis is not None:
            raise ValueError("give one of --diagnosis and --improved")
        chosen = _machine(machine, set_, scale)
        driven = gaps.with_effects(chosen if plant is None else _machine(plant, None, None), effect or [])
        if plant is None and not effect:
            raise ValueError("the plant is the baseline; give --plant or --effect")
        found = _machine(improved, None, None)
        _check_seed(seed)
        _check_device(device)
        plan = gaps.retraining_plan(env, policy, steps=retrain, seed=seed, device=device) if retrain else None
    asked: dict[str, Any] = {
        "episodes": episodes, "seed": gaps.SEED + seed, "courses": forests() if env == DRIVE else None, "device": device,
    }  # fmt: skip
    inputs = asked_of(env, {policy: make}, machine=chosen, retrain=retrain, **asked)
    inputs |= {"plant": machine_values(driven), "improved": machine_values(found)}
    episodes_of = resumable(out, inputs, restart=restart, accept_code_change=accept_code_change)
    made_by = _made_by(machine, set_, scale, device, seed)
    made_by |= {"policy": policy, "plant": plant, "effects": effect, "improved": found.name, "retrain": retrain}
    with _resumable(), _running(), _entered(episodes_of) as kept:
        others: dict[str, Factory] = {}
        if plan is not None:
            for name, where in (("retrained", found), ("control", chosen)):
                others[name] = _learned_on(
                    plan, out / name, machine=where, restart=restart, accept_code_change=accept_code_change
                )
        with terminal.progress(env) as tell:
            result = gaps.measure(
                env, make, baseline=chosen, plant=driven, improved=found, **others, **asked, kept=kept, progress=tell
            )
        made_by |= accepted(kept)
        _write_json(out / "gap.json", result.to_json() | {"made_by": made_by})
    terminal.out().print(gaps.table(result))
    _say([out / "gap.json"])


def _learned_on(
    plan: TrainingPlan, folder: Path, *, machine: Machine, restart: bool, accept_code_change: bool
) -> Factory:
    """The policy that a plan starts from after learning on, or what an earlier call of the same has come to."""
    with _checking_input():
        from aoro_gym.agents.policies.files import load_policy
        from aoro_gym.agents.training import train as training

        training.versions(plan.trainer)  # all is there
        recipe = training.continued(plan, folder, restart=restart)
        courses, held_out = _training_courses(plan)
    doing = f"{plan.env}, {folder.name}"
    with terminal.progress(doing) as tell, _checking_input(), _running():
        training.train(
            plan, recipe, folder, machine=machine, courses=courses, held_out=held_out,
            accept_code_change=accept_code_change, tell=terminal.learning(tell, doing),
        )  # fmt: skip
    return load_policy(folder / "best.json").made_for


def _options_of(plan: type) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Puts the fields of a dataclass in the place of a command's ``**options``."""

    def decorate(command: Callable[..., None]) -> Callable[..., None]:
        hints, signature = get_type_hints(plan), inspect.signature(command, eval_str=True)
        own = [one for one in signature.parameters.values() if one.kind is not one.VAR_KEYWORD]
        asked = [
            inspect.Parameter(
                one.name,
                inspect.Parameter.KEYWORD_ONLY,
                default=one.default,
                annotation=Annotated[
                    hints[one.name], typer.Option(f"--{one.name.replace('_', '-')}", show_default=True, **one.metadata)
                ],
            )
            for one in fields(plan)
        ]
        command.__signature__ = signature.replace(parameters=[*own, *asked])  # pyright: ignore[reportFunctionMemberAccess]
        return command

    return decorate


@app.command()
@_options_of(TrainingPlan)
def train(
    context: typer.Context,
    out: Annotated[
        Path | None,
        typer.Option("--out", "-o", metavar="FOLDER", help="Folder to write to. Default: runs/TASK_ALGO_SEED."),
    ] = None,
    resume: Annotated[
        Path | None,
        typer.Option("--resume", metavar="FOLDER", help="Go on with the training there, from its last checkpoint."),
    ] = None,
    ray: RayOption = None,
    seeds: Annotated[
        int | None,
        typer.Option("--seeds", metavar="N", help="With --ray: so many trainings, from --seed on, a job each."),
    ] = None,
    trials: Annotated[
        int | None,
        typer.Option("--trials", metavar="N", help="With --ray: so many trainings to search hyper-parameters by."),
    ] = None,
    space: Annotated[
        Path | None, typer.Option("--space", metavar="FILE.yml", help="With --trials: what is searched. Default: ours.")
    ] = None,
    restart: RestartOption = False,
    accept_code_change: AcceptCodeChangeOption = False,
    quiet: QuietOption = False,
    **options: Any,
) -> None:
    """Train a policy, on many twins at once.

    With Stable-Baselines3's PPO or SAC, or with --trainer resident by skrl's PPO, whose arrays never leave the device: for
    GPUs (on a CPU it works, too). Both take the same hyper-parameters and write the same files. --algo dagger imitates a
    reference controller that is told the true errors, from what the sensors say; --start lets PPO learn on from there.

    Hyper-parameters are in the RL Zoo's format, a curriculum says what differs from episode to episode; the package has
    both, for CPUs and for GPUs. The training is evaluated and saved every --checkpoint-every steps of each sub-environment,
    and can be killed at any time: --resume goes on from the last checkpoint, on a CPU to the same weights to the bit, and
    with nothing else: a machine, ground, policy or file that has changed since is named.

    With --ray, N trainings run on a cluster whose nodes share FOLDER, each in FOLDER/seed_K. One whose node dies goes on
    elsewhere; after Ctrl-C the same command goes on with all. With --trials, Ray Tune searches hyper-parameters for the best
    return: Optuna proposes, trials that fall behind end early; FOLDER/best.yml is for --hyperparams.

    FOLDER gets training.json (all that was asked), provenance.json (what it follows from), checkpoint.pt, evaluations.json,
    policy.json with policy.safetensors (and best.*, of the best return), and log, for TensorBoard. Needs
    pip install 'aoro-gym\\[agents]', --trainer resident 'aoro-gym\\[resident]'.

    [bold]Examples[/]

      aoro-gym train --env AORO/Turning-v0 --out runs/turning
      aoro-gym train --env AORO/PathTracking-v0 --terrain forest.laz --machine mine.toml --device cuda:0
      aoro-gym train --resume runs/turning
      aoro-gym train --env AORO/Turning-v0 --trainer resident --device cuda:0
      aoro-gym train --env AORO/Turning-v0 --ray auto --seeds 3 --out /shared/turning
      aoro-gym train --env AORO/Turning-v0 --ray local --trials 20 --steps 300000 --checkpoint-every 1000 --out runs/search
      aoro-gym train --env AORO/PathTracking-v0 --algo dagger --out runs/taught
      aoro-gym train --algo sac --param learning_rate=1e-4 --param 'policy_kwargs={net_arch: [128, 128]}' --seed 1
      aoro-gym evaluate --env AORO/Turning-v0 --policy proportional-derivative --policy runs/turning/best.json
    """
    if space is not None and trials is None:
        _fail(ValueError("--space needs --trials; without it nothing is searched"), 2)
    if ray is not None:
        if resume is not None:
            _fail(ValueError("--resume and --ray are both given; with --ray the same command goes on"), 2)
        if trials is not None:
            if seeds is not None:
                _fail(
                    ValueError("--seeds and --trials are both given; search first, then train seeds with best.yml"), 2
                )
            _search_on_cluster(
                options, out=out, ray=ray, trials=trials, space=space,
                restart=restart, accept_code_change=accept_code_change,
            )  # fmt: skip
            return
        _train_on_cluster(
            options, out=out, ray=ray, seeds=1 if seeds is None else seeds,
            restart=restart, accept_code_change=accept_code_change,
        )  # fmt: skip
        return
    folder: Path | None = None

    def goes_on() -> str:
        if folder is None or not (folder / "training.json").exists():
            return "nothing was begun yet; the same command begins"
        return f"aoro-gym train --resume {shlex.quote(str(folder))} goes on"

    with _resumable(goes_on):
        with _checking_input():
            from aoro_gym.agents.training import train as training
            from aoro_gym.execution.locking import locked

            if seeds is not None:
                raise ValueError("--seeds needs --ray; without it, give --seed of each training")
            if trials is not None:
                raise ValueError("--trials needs --ray; --ray local is this computer alone")
            if resume is not None:
                for name in ("out", *options):
                    source = context.get_parameter_source(name)
                    if source is not None and source.name != "DEFAULT":
                        option = name.replace("_", "-")
                        raise ValueError(f"--{option} was settled when the training began; leave it out")
                plan, recipe = training.recall(resume)
                folder = resume
            else:
                plan = TrainingPlan(**options)
                folder = out or Path("runs") / f"{plan.env.split('/')[-1]}_{plan.algo}_{plan.seed}"
                _check_folder(folder, training.RECORD)
            chosen = _machine(plan.machine, plan.set, plan.scale)
            _check_device(plan.device)
            courses, held_out = _training_courses(plan)
            training.versions(plan.trainer)  # all is there
        began = time.perf_counter()
        with _entered(locked(folder)), _checking_input():
            if resume is None or restart:
                recipe = training.begin(plan, folder, restart=restart)
            with terminal.progress(plan.env) as tell, _running():
                found = training.train(
                    plan, recipe, folder, machine=chosen, courses=courses, held_out=held_out,
                    accept_code_change=accept_code_change, tell=terminal.learning(tell, plan.env),
                )  # fmt: skip
    terminal.out().print(_training_table(found))
    typer.echo(f"trained for {time.perf_counter() - began:.0f} s")
    _say([folder / name for name in (training.RECORD, training.EVALUATIONS, "policy.json", "best.json")])


def _train_on_cluster(
    options: dict[str, Any], *, out: Path | None, ray: str, seeds: int, restart: bool, accept_code_change: bool
) -> None:
    """``train --ray``."""
    with _checking_input():
        from aoro_gym.agents.training import train as training
        from aoro_gym.execution.locking import locked

        if seeds < 1:
            raise ValueError(f"--seeds = {seeds} is below 1")
        first = TrainingPlan(**options)
        folder = out or Path("runs") / f"{first.env.split('/')[-1]}_{first.algo}"
        _check_folder(folder, training.RECORD)
        chosen = _machine(first.machine, first.set, first.scale)
        courses, held_out = _training_courses(first)
        training.versions(first.trainer)  # all is there
    with _resumable(), _running(), _entered(locked(folder)), _checking_input():
        plans = {folder / f"seed_{seed}": replace(first, seed=seed) for seed in range(first.seed, first.seed + seeds)}
        recipes = {place: training.continued(plan, place, restart=restart) for place, plan in plans.items()}
        with terminal.progress(first.env) as tell:
            found = training.train_seeds(
                plans, recipes, ray=ray, machine=chosen, courses=courses, held_out=held_out,
                accept_code_change=accept_code_change, progress=tell,
            )  # fmt: skip
    for place, evaluations in sorted(found.items()):
        terminal.out().print(_training_table(evaluations))
        _say([place / "best.json"])


def _search_on_cluster(
    options: dict[str, Any],
    *,
    out: Path | None,
    ray: str,
    trials: int,
    space: Path | None,
    restart: bool,
    accept_code_change: bool,
) -> None:
    """``train --ray --trials``."""
    with _checking_input():
        from aoro_gym.agents.training import search as searching
        from aoro_gym.agents.training import train as training

        if trials < 1:
            raise ValueError(f"--trials = {trials} is below 1")
        plan = TrainingPlan(**options)
        folder = out or Path("runs") / f"{plan.env.split('/')[-1]}_{plan.algo}_search"
        _check_folder(folder, searching.KEPT)
        dimensions = searching.read_space(searching.SPACES if space is None else space, plan.algo)
        chosen = _machine(plan.machine, plan.set, plan.scale)
        courses, held_out = _training_courses(plan)
        training.versions(plan.trainer)  # all is there
    with terminal.progress(plan.env) as tell, _running(), _resumable(), _checking_input():
        found = searching.search(
            plan, dimensions, folder,
            trials=trials, ray=ray, machine=chosen, courses=courses, held_out=held_out,
            restart=restart, accept_code_change=accept_code_change, progress=tell,
        )  # fmt: skip
    terminal.out().print(_trials_table(found))
    if not found or found[0].best is None:
        why = found[0].failed if found else "none began"
        _fail(ValueError(f"no trial came to an evaluation; the first says: {why}"), 1)
    _say([folder / "trials.json", folder / "best.yml"])


def _trials_table(found: Sequence[Any]) -> Table:
    """The trials of a search, the best first."""
    table = Table(header_style="bold")
    for head in ("trial", "return", "steps", "hyper-parameters"):
        table.add_column(head, justify="right" if head in ("return", "steps") else "left", overflow="fold")
    for one in found:
        if one.best is None:
            table.add_row(escape(one.folder.name), "-", "0", escape(one.failed or "did not begin"))
        else:
            steps, mean = one.evaluations[-1]["steps"], one.best["figures"]["return"]["mean"]
            table.add_row(escape(one.folder.name), f"{mean:.4g}", f"{steps:,}", escape(", ".join(one.params)))
    return table


@app.command()
def export(
    policy: Annotated[Path, typer.Argument(metavar="FILE", help="Policy (.json with its .safetensors).")],
    out: Annotated[
        Path | None, typer.Option("--out", "-o", metavar="FILE.onnx", help="File to write. Default: beside the policy.")
    ] = None,
    trust_pickle: Annotated[
        bool, typer.Option("--trust-pickle", help="Load a .zip of Stable-Baselines3, which runs code of its maker.")
    ] = False,
    quiet: QuietOption = False,
) -> None:
    """Write a learned policy as ONNX, for the vehicle's computer.

    One input, observations (N, O), and one output, actions (N, A), both float32; normalisation and bounds are inside, and
    the metadata has the environment and the columns of its observation. Needs pip install 'aoro-gym\\[onnx]'.

    [bold]Examples[/]

      aoro-gym export runs/turning/policy.json
      aoro-gym export runs/turning/policy.json --out turning.onnx
    """
    with _checking_input():
        from aoro_gym.agents.policies.files import load_policy
        from aoro_gym.agents.policies.onnx_file import write_onnx
        from aoro_gym.execution.files import check_writable
        from aoro_gym.execution.locking import locked

        target = policy.with_suffix(".onnx") if out is None else out
        check_writable(target)
        loaded = load_policy(policy, trust_pickle=trust_pickle)
        with locked(target.parent):
            write_onnx(loaded, target)
    _say([target])


@app.command()
def bench(
    twins: Annotated[
        str, typer.Option("--twins", metavar="N[,N...]", help="Numbers of twins, or of environments, stepped together.")
    ] = "1,64,4096",
    what: Annotated[
        str, typer.Option("--what", metavar="twin|env|train[,...]", help="Twins, environments, PPO learning in them.")
    ] = "twin",
    env: Annotated[
        str, typer.Option("--env", metavar="ID", help="The environment of --what env and train.")
    ] = "AORO/PathTracking-v0",
    trainer: Annotated[
        str, typer.Option("--trainer", metavar="sb3|resident[,...]", help="Who learns, see 'aoro-gym train'.")
    ] = "sb3",
    ground: Annotated[
        str, typer.Option("--ground", metavar="plane|raster|mesh", help="Level asphalt, or a generated forest.")
    ] = "plane",
    randomise: Annotated[
        bool, typer.Option("--randomise", help="Give every twin parameters of its own, 5 % to either side.")
    ] = False,
    output: Annotated[
        str, typer.Option("--output", metavar="numpy|torch", help="What environments take and give.")
    ] = "numpy",
    threads: Annotated[
        str | None, typer.Option("--threads", metavar="N[,N...]", help="CPU threads. Default: one, and all cores.")
    ] = None,
    peer: Annotated[
        list[str] | None,
        typer.Option("--peer", metavar="mujoco|mujoco_warp", help="Time the vehicle in this engine, too. Repeatable."),
    ] = None,
    worlds: Annotated[
        str | None, typer.Option("--worlds", metavar="N[,N...]", help="Batches of the peers. Default: several.")
    ] = None,
    startup: Annotated[
        bool, typer.Option("--startup", help="Time fresh processes, too, with compiled kernels and without.")
    ] = False,
    seconds: Annotated[float, typer.Option("--seconds", metavar="S", help="Time to measure for, each case.")] = 5.0,
    json_file: Annotated[Path | None, typer.Option("--json", metavar="FILE", help="Write the results here.")] = None,
    machine: MachineOption = MACHINE,
    set_: SetOption = None,
    scale: ScaleOption = None,
    device: DeviceOption = "cpu",
    seed: SeedOption = 0,
    quiet: QuietOption = False,
) -> None:
    """Measure how fast twins and environments step, beside other engines, and how fast a policy learns.

    Twins steer and drive at random, with new commands every 20 ms; environments take random actions; learning is PPO's,
    rollouts and updates, with the packaged hyper-parameters for the device. Five runs a case, in
    rounds over all cases, compilation excluded: the table shows the median, the slowest and the fastest. The file of --json
    is written anew after each run ("runs" says how many a case has had), so that an interrupted benchmark keeps what it has.

    The share of the ceiling sets twins beside a roofline: operations and bytes of a step, counted from the kernel's code,
    over what small kernels reach here in the same run. On a CPU it is of one core without SIMD, as one thread is one twin,
    and steps count by core seconds; on a GPU it is of the whole device. In the file: "ceiling" of the machine; of a case
    "operations_per_step", "bytes_per_step", "ceiling_steps_per_s" by resource, and "share_of_ceiling", of the lower of them.
    Triangles (--ground mesh) have none: their query is not counted.

    A peer is the same vehicle without hydraulics (two frames, four sprung arms, four driven spheres as wheels, the forest
    as a height field of 256 x 256, steps of 1 ms) in MuJoCo on the CPU or in MuJoCo Warp on a GPU; each counts at its
    best batch. Peers need pip install 'aoro-gym\\[bench]'.

    [bold]Examples[/]

      aoro-gym bench
      aoro-gym bench --ground raster --randomise --twins 1,64 --peer mujoco --startup
      aoro-gym bench --what twin,env --ground raster --device cuda:0 --twins 4096,65536 --peer mujoco_warp --json b.json
      aoro-gym bench --what train --trainer sb3,resident --ground raster --device cuda:0 --twins 4096,16384
    """
    with _checking_input():
        from aoro_gym.execution.files import check_writable

        counts = _counts("--twins", twins)
        if json_file is not None:
            check_writable(json_file)
        chosen = _machine(machine, set_, scale)
        _check_seed(seed)
        _check_device(device)
        from aoro_gym.benchmark.run import Plan, run

        plan = Plan(
            twins=counts,
            what=tuple(part.strip() for part in what.split(",")),
            env=env,
            trainers=tuple(part.strip() for part in trainer.split(",")),
            ground=ground,
            randomise=randomise,
            output=output,
            device=device,
            threads=_counts("--threads", threads) if threads else (),
            peers=tuple(peer or ()),
            worlds=_counts("--worlds", worlds) if worlds else (),
            startup=startup,
            seconds=seconds,
            seed=seed,
        )
    from aoro_gym.benchmark.report import tables

    def save(so_far: dict[str, Any]) -> None:
        if json_file is not None:
            _write_json(json_file, so_far)

    with terminal.progress("bench") as tell, _running():
        result = run(plan, chosen, tell, save)
    for table in tables(result):
        terminal.out().print(table)
    if json_file is not None:
        _say([json_file])


@blind.command()
def seal(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="Folder to write to.")],
    suite: Annotated[
        str, typer.Option("--suite", metavar="quick|standard|full", help="12, 240 or 800 cases.")
    ] = "quick",
    mode: Annotated[
        str,
        typer.Option(
            "--mode", metavar="day-one|commissioned", help="Without logs of the healthy machine, or with them."
        ),
    ] = "commissioned",
    sensors: Annotated[
        str, typer.Option("--sensors", metavar="angle|full", help="Joint angle alone, or three pressures besides.")
    ] = "full",
    family: Annotated[
        str,
        typer.Option(
            "--family", metavar="score|development", help="Cases that score, or others to develop a diagnosis on."
        ),
    ] = "score",
    answers: Annotated[
        Path | None,
        typer.Option("--answers", metavar="FILE", help="Answers (.json). Default: beside DIR, DIR.answers.json."),
    ] = None,
    seed: Annotated[
        int | None, typer.Option("--seed", metavar="N", help="Makes the same cases again, which are then not blind.")
    ] = None,
    workers: WorkersOption = None,
    accept_code_change: AcceptCodeChangeOption = False,
    quiet: QuietOption = False,
) -> None:
    """Make cases whose answers are withheld, and publish the digest of the answers.

    A case is a plant, a machine whose laws share no code with the twin: with nothing wrong, one effect, two, one that the
    catalogue lacks, or only other nuisances. DIR/cases/NNN gets what a user has: machine.toml, logs/*.csv, and for
    commissioned machines healthy/*.csv. DIR/seal.json gets SHA-256 digests. The answers, with the secret seed and a salt, go
    to FILE, and logs without noise, with and without the deviation, to a folder beside it that ends in .exact.

    Takes two core minutes for the quick suite, whose cases have one log a day, an hour for the standard one and hours for
    the full one, shared by --workers; files are the same however many there are. Ctrl-C is safe: the same command goes on
    where it stopped.

    [bold]Examples[/]

      aoro-gym blind seal blind_quick
      aoro-gym blind seal --suite standard --mode day-one --sensors angle blind_day_one
      aoro-gym blind seal --suite quick --family development --seed 1 tuning
    """
    with _checking_input():
        from aoro_gym.diagnosis_benchmark.cases import FAMILIES, SUITES
        from aoro_gym.diagnosis_benchmark.sealing import write_cases
        from aoro_gym.execution.files import check_writable

        for option, value, known in (("suite", suite, SUITES), ("family", family, FAMILIES)):
            if value not in known:
                raise ValueError(f"--{option} {value!r} is unknown; choose one of: {', '.join(known)}")
        if seed is not None:
            _check_seed(seed)
        file = folder.with_name(f"{folder.name}.answers.json") if answers is None else answers
        if file.suffix != ".json":
            raise ValueError(f"--answers {file} must end in .json")
        check_writable(folder / "seal.json")
        check_writable(file)
        processes = _workers(workers)
        with _running(), _resumable(), terminal.progress("simulating plants") as tell:
            write_cases(
                SUITES[suite],
                folder,
                file,
                mode=mode,
                sensors=sensors,
                family=FAMILIES[family],
                seed=seed,
                workers=processes,
                accept_code_change=accept_code_change,
                progress=tell,
            )
    _say([folder / "seal.json", file])


@blind.command("run")
def blind_run(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="Folder of a sealed suite.")],
    sensors: Annotated[
        str | None,
        typer.Option(
            "--sensors", metavar="angle|full", help="What the diagnosis may read. Default: all that is logged."
        ),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option("--out", "-o", metavar="FOLDER", help="Folder to write to. Default: DIR/diagnoses-SENSORS."),
    ] = None,
    workers: WorkersOption = None,
    ray: RayOption = None,
    device: DeviceOption = "cpu",
    restart: RestartOption = False,
    accept_code_change: AcceptCodeChangeOption = False,
    quiet: QuietOption = False,
) -> None:
    """Diagnose every case of a sealed suite.

    Each case is diagnosed by itself, from its machine.toml, logs and healthy logs alone: the answers are not asked for.
    FOLDER/NNN/diagnosis.json says what was found. A case that fails leaves FOLDER/NNN/error.txt, is named at the end, and
    stops no other; the exit code is then 1.

    Each of --workers processes diagnoses one case at a time; on a GPU, too, which they share, and which 50 or more of them
    keep busy. With --ray, each case is a job on a cluster whose nodes share DIR and FOLDER. On a core a case of the quick
    suite takes six to nine minutes, so that two cores take about three quarters of an hour for all. Ctrl-C is safe: the same
    command goes on with the cases that have no diagnosis, those that failed among them.

    [bold]Examples[/]

      aoro-gym blind run blind_quick
      aoro-gym blind run blind_quick --sensors angle
      aoro-gym blind run blind_standard --device cuda:0,cuda:1 --workers 120
    """
    with _checking_input():
        from aoro_gym.diagnosis_benchmark.running import diagnoses_folder, logged_sensors, run_cases
        from aoro_gym.execution.files import check_writable

        given = logged_sensors(folder) if sensors is None else sensors
        target = diagnoses_folder(folder, given) if out is None else out
        check_writable(target / "run.json")
        _check_device(device)
        processes = _workers(workers)
        with _running(), _resumable(), terminal.progress("diagnosing") as tell:
            failures = run_cases(
                folder,
                target,
                sensors=given,
                device=device,
                workers=processes,
                ray=ray,
                restart=restart,
                accept_code_change=accept_code_change,
                progress=tell,
            )
    for name, reason in failures.items():
        terminal.err().print(
            f"[bold red]case {escape(name)} failed:[/] {escape(reason)}", soft_wrap=True, highlight=False
        )
    _say([target])
    if failures:
        raise typer.Exit(1)


@blind.command("score")
def blind_score(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="Folder of a sealed suite whose cases were diagnosed.")],
    answers: Annotated[
        Path | None,
        typer.Option("--answers", metavar="FILE", help="Answers (.json). Default: beside DIR, DIR.answers.json."),
    ] = None,
    diagnoses: Annotated[
        Path | None,
        typer.Option(
            "--diagnoses",
            metavar="FOLDER",
            help="What 'blind run' wrote. Default: DIR/diagnoses-SENSORS of all sensors.",
        ),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option("--out", "-o", metavar="FOLDER", help="Folder to write to. Default: that of the diagnoses."),
    ] = None,
    workers: WorkersOption = None,
    device: DeviceOption = "cpu",
    quiet: QuietOption = False,
) -> None:
    """Open the seal, and hold every diagnosis against its answer.

    Refused while a case has no diagnosis, and where cases or answers are not those that were sealed. Every figure comes with
    its 95 % interval and count, over all cases and over those whose deviation an oracle can detect that knows it, by level
    of the plants' laws and by effect; every failure is listed. Writes score.json, score.md, and confusion.png: what is true
    by what was said.

    The oracle repeats logs of a case with every uncertain parameter moved, the shortest first, until it can tell: a few core
    seconds a case. What it says is kept in oracle/NNN.json. Ctrl-C is safe: the same command goes on where it stopped.

    [bold]Examples[/]

      aoro-gym blind score blind_quick
      aoro-gym blind score blind_quick --diagnoses blind_quick/diagnoses-angle
      aoro-gym blind score blind_standard --answers kept_elsewhere.json --out score_standard
    """
    with _checking_input():
        from aoro_gym.diagnosis_benchmark.running import diagnoses_folder, logged_sensors
        from aoro_gym.diagnosis_benchmark.scoring import score_cases
        from aoro_gym.diagnosis_benchmark.scoring_report import tables, write_score

        found = diagnoses_folder(folder, logged_sensors(folder)) if diagnoses is None else diagnoses
        target = found if out is None else out
        _check_folder(target, "score.json")
        _check_device(device)
        file = folder.with_name(f"{folder.name}.answers.json") if answers is None else answers
        processes = _workers(workers)
        with _running(), _resumable(), terminal.progress("opening the seal") as tell:
            result = score_cases(
                folder, file, found, target / "oracle", device=device, workers=processes, progress=tell
            )
    for table in tables(result):
        terminal.out().print(table)
    with _running():
        _say(write_score(result, target))


@blind.command()
def atlas(
    out: Annotated[Path, typer.Option("--out", "-o", metavar="FOLDER", help="Folder to write to.")],
    device: DeviceOption = "cpu",
    quiet: QuietOption = False,
) -> None:
    """Which effects look alike, from which sensors and manoeuvres, whatever a diagnosis makes of them.

    Asked of twins of the calibrated ensemble, of no case: what an effect does, less the best that another effect and another
    day can do instead, against what a decision needs. Writes atlas.json (all distances, by sensors and manoeuvre),
    classes.json (effects that 'blind score' counts as one) and atlas.png. The classes that score are those shipped with the
    package: they are frozen. Takes about 40 minutes of one core.

    [bold]Example[/]

      aoro-gym blind atlas --out atlas
    """
    with _checking_input():
        from aoro_gym.diagnosis.replay import Simulator
        from aoro_gym.diagnosis_benchmark.atlas import survey
        from aoro_gym.diagnosis_benchmark.atlas_report import tables, write_atlas

        _check_folder(out, "atlas.json")
        _check_device(device)
    with _running(), terminal.progress("twins") as tell:
        found = survey(simulator=Simulator(device), progress=tell)
        written = write_atlas(found, out)
    for table in tables(found):
        terminal.out().print(table)
    _say(written)


# --- input ---


@contextmanager
def _checking_input() -> Iterator[None]:
    """Turn what is wrong with the input into one line and exit code 2."""
    try:
        yield
    except (ValueError, OSError) as error:
        _fail(error, 2)


@contextmanager
def _running() -> Iterator[None]:
    """Turn a run that failed into one line and exit code 1; with 2 where its folder is another run's."""
    from aoro_gym.execution.cluster import ClusterError
    from aoro_gym.execution.locking import FolderInUse
    from aoro_gym.execution.provenance import ChangedCode, ChangedInput
    from aoro_gym.simulation.manoeuvres import TwinLost

    try:
        yield
    except (ChangedCode, ChangedInput, FolderInUse) as error:
        _fail(error, 2)
    except (TwinLost, ClusterError, OSError) as error:
        _fail(error, 1)


@contextmanager
def _resumable(
    goes_on: Callable[[], str] = lambda: "the same command goes on from where it stopped",
) -> Iterator[None]:
    """Turn Ctrl-C into one line that says how to go on, and exit code 130; a full disk gets that line, too."""
    try:
        yield
    except KeyboardInterrupt:
        _interrupted(goes_on())
    except _DiskFull:
        terminal.err().print(f"[bold]afterwards:[/] {escape(goes_on())}", soft_wrap=True, highlight=False)
        raise


class _DiskFull(typer.Exit):
    """No room for what was to be written."""


def _interrupted(what_next: str) -> NoReturn:
    terminal.err().print(f"[bold]interrupted:[/] {escape(what_next)}", soft_wrap=True, highlight=False)
    raise typer.Exit(130) from None


@contextmanager
def _entered(context: AbstractContextManager[Any]) -> Iterator[Any]:
    """Hold ``context``; what keeps it from being entered, such as a folder in use, is wrong input."""
    with ExitStack() as held:
        with _checking_input():
            found = held.enter_context(context)
        yield found


def _fail(error: Exception, code: int) -> NoReturn:
    message, full = str(error), isinstance(error, OSError) and error.errno in DISK_FULL
    if isinstance(error, OSError) and error.strerror:
        message = error.strerror if error.filename is None else f"{error.filename}: {error.strerror}"
    if full:
        message += "; make room and try again"
    terminal.err().print(f"[bold red]error:[/] {escape(' '.join(message.split()))}", soft_wrap=True, highlight=False)
    raise (_DiskFull(1) if full else typer.Exit(code)) from None


def _machine(name: str, settings: list[str] | None, factors: list[str] | None) -> Machine:
    from aoro_gym.machine import Machine

    chosen = Machine.load(name)
    values, scales = _assignments("--set", settings), _assignments("--scale", factors)
    for key in values.keys() & scales.keys():
        raise ValueError(f"{key} is given to both --set and --scale; give one")
    chosen = chosen.set(values, check_ranges=False) if values else chosen
    chosen = chosen.scale(scales, check_ranges=False) if scales else chosen
    for message in chosen.outside_ranges([*values, *scales]).values():
        terminal.warn(message)
    return chosen


def _logs_in(path: Path) -> list[Path]:
    """The log at ``path``, or all logs in that folder."""
    from aoro_gym.diagnosis.recording import logs_in

    if not path.is_dir():
        return [path]
    found = logs_in(path)
    if not found:
        raise ValueError(f"--healthy {path} holds no .csv or .parquet log")
    return found


def _selected(option: str, patterns: list[str] | None, recordings: list[Any]) -> list[Any]:
    """Recordings whose name matches any of ``patterns``."""
    chosen = []
    for pattern in patterns or []:
        mine = [one for one in recordings if fnmatch(one.name, pattern)]
        if not mine:
            raise ValueError(
                f"{option} {pattern}: no log has that name; choose of {', '.join(r.name for r in recordings)}"
            )
        chosen += [one for one in mine if not any(one is other for other in chosen)]
    return chosen


def _assignments(option: str, texts: list[str] | None) -> dict[str, float]:
    """``KEY=NUMBER`` texts as a dict."""
    from aoro_gym.recording.cells import parse_number

    pairs: dict[str, float] = {}
    for text in texts or []:
        key, equals, number = (part.strip() for part in text.partition("="))
        if not (key and equals):
            raise ValueError(f"{option} {text!r} is not KEY=NUMBER, such as {option} oil.gas_fraction=0.01")
        value = parse_number(number)
        if value is None:
            raise ValueError(f"{option} {key}={number}: {number!r} is not a finite number")
        if key in pairs:
            raise ValueError(f"{option} names {key} twice; give it once")
        pairs[key] = value
    return pairs


def _manoeuvre(
    name: str, signal: float | None, duration: float | None, start_angle: float | None, machine: Machine, out: Path
) -> Manoeuvre:
    from aoro_gym.recording.cells import listed
    from aoro_gym.simulation import manoeuvres

    joint_range = float(machine.joint.range)
    if name in ("left", "right", "drive"):
        if start_angle is not None:
            raise ValueError(f"--start-angle serves a command file only; {name} starts at its own angle")
        if name == "drive":
            _check_percent(signal, 1.0)
            return manoeuvres.straight_drive(0.5 if signal is None else signal / 100.0, duration=duration)
        valve = machine.steering.valve
        dead_band = valve.dead_band_left if name == "left" else valve.dead_band_right
        _check_percent(signal, 100.0 * float(dead_band) / FULL_SIGNAL_V)
        share = 1.0 if signal is None else signal / 100.0
        return manoeuvres.standing_turn(1 if name == "left" else -1, share, joint_range, duration=duration)
    if signal is not None:
        raise ValueError(f"--signal = {signal:g} serves left, right and drive; a command file holds its own signals")
    path = Path(name)
    if path.suffix not in (".csv", ".parquet"):
        raise ValueError(f"--manoeuvre {name!r} is none of left, right, drive, and no .csv or .parquet file")
    if path.with_suffix("").resolve() == out.with_suffix("").resolve():
        raise ValueError(f"--out {out} would overwrite the commands in {path}; choose another name")
    angle = 0.0 if start_angle is None else math.radians(start_angle)
    if not abs(angle) <= joint_range:
        limit = math.degrees(joint_range)
        raise ValueError(f"--start-angle = {start_angle:g} is outside [{-limit:g}, {limit:g}] deg (joint.range)")
    plan = manoeuvres.from_file(path, start_angle=angle, duration=duration)
    if plan.unread:
        terminal.warn(f"{path}: unknown columns were not read: {listed(plan.unread)}")
    return plan


def _check_percent(signal: float | None, dead_band: float) -> None:
    """ValueError for a share where per cent are meant; a warning for a signal [%] within the dead band [%] of the valve."""
    if signal is None:
        return
    if 0.0 < abs(signal) <= 1.0:
        raise ValueError(
            f"--signal = {signal:g} is in per cent, and {signal:g} % would move nothing; did you mean {100.0 * signal:g}?"
        )
    if 0.0 < signal <= dead_band:
        terminal.warn(
            f"--signal = {signal:g} % is within the valve's dead band, {dead_band:.3g} %; the joint will not turn"
        )


def _twin(machine: Machine, terrain: Plane | None, device: str, seed: int) -> Twin:
    """A twin of ``machine``; says so where its kernels must be compiled first."""
    _check_seed(seed)
    _check_device(device)
    from aoro_gym.twin import Twin

    twin = Twin(machine=machine, terrain=terrain, device=device)
    twin.step(duration=twin.main_step)
    return twin


def _courses(
    env: str,
    terrain: Path | None,
    path: Path | None,
    path_length: float,
    *,
    track: str | None = None,
    join_gaps: bool = False,
    path_crs: str | None = None,
) -> list[Course] | None:
    """Where to drive: a terrain from a file, with the path of a file or with paths that are generated; None leaves it to
    the environment.

    Args:
        env: Id of the environment.
        terrain: File of the ground; None: level.
        path: File of the path; None: generated ones.
        path_length: Of generated paths [m].
        track: Line of the path's file.
        join_gaps: Whether its gaps are bridged.
        path_crs: Coordinate reference system of its coordinates.
    """
    for option, given in (
        ("--track", track is not None),
        ("--join-gaps", join_gaps),
        ("--path-crs", path_crs is not None),
    ):
        if given and path is None:
            raise ValueError(f"{option} is for a path; give its file with --path")
    if terrain is None and path is None:
        return None
    if env != "AORO/PathTracking-v0":
        given = "--terrain" if path is None else "--path"
        raise ValueError(f"{given} is for AORO/PathTracking-v0; {env} turns on level ground")
    from aoro_gym.envs.path_tracking.courses import Course, generated_paths
    from aoro_gym.terrains import Plane, Terrain, load, load_path

    ground: Plane | Terrain = Plane()
    if terrain is not None:
        doing = f"loading {terrain.name}"
        with terminal.progress(doing) as tell:
            ground, report = load(terrain, progress=lambda share: tell(doing, share))
        for warning in report.warnings:
            terminal.warn(warning)
    if path is None:
        paths = generated_paths(ground, length=path_length)
    else:
        on = ground if isinstance(ground, Terrain) else None
        found, about = load_path(path, on, track=track, join_gaps=join_gaps, crs=path_crs)
        if not terminal.is_quiet():
            terminal.err().print(escape(about.summary), highlight=False, soft_wrap=True)
        for warning in about.warnings:
            terminal.warn(warning)
        if found.speed is not None:
            terminal.warn(f"{path} gives speeds, which {env} does not follow: it drives at its working speed")
        paths = (found,)
    return [Course(ground, paths, name="level ground" if isinstance(ground, Plane) else ground.name)]


def _training_courses(plan: TrainingPlan) -> tuple[list[Course] | None, list[Course] | None]:
    """Where to learn, and where to evaluate: other forests, or other paths over the same ground, or the only path."""
    terrain, path = (None if name is None else Path(name) for name in (plan.terrain, plan.path))
    how = {"track": plan.track, "join_gaps": plan.join_gaps, "path_crs": plan.path_crs}
    courses = _courses(plan.env, terrain, path, plan.path_length, **how)
    if plan.env != DRIVE:
        return None, None
    from aoro_gym.envs.path_tracking.courses import Course, forest_course, generated_paths
    from aoro_gym.terrains.paths.planning import NoDrivablePath

    if courses is None:
        doing, grown, total = "growing forests", [], plan.forests + len(HELD_OUT_FORESTS)
        with terminal.progress(doing) as tell:
            for seed in range(1, min(HELD_OUT_FORESTS)):
                tell(doing, len(grown) / total)
                with suppress(NoDrivablePath):  # a forest too dense is passed over
                    grown.append(forest_course(seed))
                if len(grown) == plan.forests:
                    break
            else:
                raise ValueError(f"forests is {plan.forests}, but there are {len(grown)} to learn on; ask for fewer")
            held_out = []
            for seed in HELD_OUT_FORESTS:
                tell(doing, (len(grown) + len(held_out)) / total)
                held_out.append(forest_course(seed))
        return grown, held_out
    if path is not None:
        return courses, courses
    ground = courses[0].terrain
    others = generated_paths(ground, length=plan.path_length, first=HELD_OUT_PATHS)
    return courses, [Course(ground, others, name=courses[0].name)]


def _check_extra(extra: str, *modules: str) -> None:
    """ValueError unless the modules that an extra brings are there."""
    for module in modules:
        if find_spec(module) is None:
            raise ValueError(f"{module} is missing: pip install 'aoro-gym[{extra}]'")


def _check_episodes(episodes: int, repeats: int = 1) -> None:
    """ValueError unless there is something to drive, and not too much of it."""
    for option, value in (
        ("episodes", episodes),
        ("repeats", repeats),
        ("episodes times --repeats", episodes * repeats),
    ):
        if not 1 <= value <= MOST_EPISODES:
            raise ValueError(f"--{option} = {value} is outside [1, {MOST_EPISODES}]")


def _policies(env: str, asked: list[str] | None, *, trust_pickle: bool = False) -> dict[str, Factory]:
    """What makes each policy, by its name in reports; all controllers and shipped policies if none is asked for."""
    from aoro_gym.agents.controllers.reference import REFERENCE_POLICIES
    from aoro_gym.agents.evaluation import evaluate as evaluation
    from aoro_gym.agents.policies.files import shipped_policies

    if env not in evaluation.TASKS:
        raise ValueError(f"--env {env!r} cannot be evaluated; choose one of: {', '.join(evaluation.TASKS)}")
    names = asked or [*REFERENCE_POLICIES[env], *shipped_policies(env)]
    policies = {_policy_name(name): evaluation.policy_factory(env, name, trust_pickle=trust_pickle) for name in names}
    if len(policies) < len(names):
        raise ValueError("--policy names the same one twice; give each once")
    return policies


def _policy_name(name: str) -> str:
    """What reports call a policy: its name, or its file without what files cannot be called."""
    file = Path(name)
    return "-".join(part for part in file.with_suffix("").parts if part not in (file.anchor, ".", ".."))


def _check_device(device: str) -> None:
    from aoro_gym.execution import devices

    devices.set_quiet(terminal.is_quiet())
    try:
        devices.find(device)
    except ValueError as error:
        raise ValueError(f"--{error}") from error


def _workers(asked: int | None) -> int:
    from aoro_gym.twin.twin import cores

    if asked is not None and asked < 1:
        raise ValueError(f"--workers = {asked} is below 1")
    return cores() if asked is None else asked


def _check_seed(seed: int) -> None:
    if seed < 0:
        raise ValueError(f"--seed = {seed} is below 0")


def _check_folder(path: Path, file: str) -> None:
    from aoro_gym.execution.files import check_writable

    if path.exists() and not path.is_dir():
        raise ValueError(f"--out {path} is a file; name a folder")
    check_writable(path / file)


def _is_bundled(machine: str, settings: list[str] | None, factors: list[str] | None) -> bool:
    """Whether the machine is the calibrated one, as it is."""
    return machine == MACHINE and not settings and not factors


def _second_machine(
    machine: str, settings: list[str] | None, factors: list[str] | None, uncalibrated: str
) -> Machine | None:
    """The machine to compare with; None for none, or if it is the first one itself."""
    if uncalibrated == NONE or (machine == uncalibrated and not settings and not factors):
        return None
    return _machine(uncalibrated, None, None)


def _ensemble(named: list[str] | None, *, bundled: bool) -> list[Machine]:
    """Machines of the files and folders ``named``; the bundled ensemble if nothing is."""
    if named == [NONE]:
        return []
    if named is None:
        folder = Path(__file__).parent / "machines" / "ensemble"
        files = sorted(folder.glob("*.toml")) if bundled else []
    else:
        files = []
        for item in map(Path, named):
            found = sorted(item.glob("*.toml")) if item.is_dir() else [item]
            if not found:
                raise ValueError(f"--ensemble {item} holds no machine file (.toml)")
            files += found
    return [_machine(str(file), None, None) for file in files]


def _counts(option: str, text: str) -> tuple[int, ...]:
    parts = [part.strip() for part in text.split(",")]
    for part in parts:
        if not part.isdecimal() or int(part) < 1:
            raise ValueError(f"{option} {text!r}: {part!r} is no whole number from 1")
    return tuple(int(part) for part in parts)


# --- running and writing ---


def _run(twin: Twin, plan: Manoeuvre) -> Section:
    from aoro_gym.simulation.key_figures import recording_figures
    from aoro_gym.simulation.manoeuvres import run
    from aoro_gym.simulation.plots import Section

    with terminal.progress(plan.title) as tell, _running():
        recording = run(
            twin,
            plan,
            keep_every=1e-3 if plan.duration <= 120.0 else 1e-2,
            progress=lambda now: tell(plan.title, now / plan.duration),
        )
    return Section(recording, recording_figures(recording, twin.machine.steering.cylinder))


def _write(section: Section, twin: Twin, out: Path, made_by: dict[str, Any], *, page: bool = True) -> list[Path]:
    """Log, manifest, key figures and plots; returns the paths."""
    import numpy as np

    from aoro_gym.simulation.log import log_columns, write_log
    from aoro_gym.simulation.plots import write_html, write_png

    plan = section.recording.manoeuvre
    about = _about(section.recording, twin, made_by)
    rng = None if made_by["ideal"] else np.random.default_rng(made_by["seed"])
    with _running():
        written = write_log(out, log_columns(section.recording.time, section.recording.channels, rng=rng), about)
        _write_json(out.with_suffix(".json"), {**about, "figures": dict(section.figures)})
        write_png(out.with_suffix(".png"), section)
        written += [out.with_suffix(".json"), out.with_suffix(".png")]
        if page:
            write_html(out.with_suffix(".html"), f"AORO twin: {plan.title}", _lead(made_by), [section])
            written.append(out.with_suffix(".html"))
    return written


def _about(recording: Recording, twin: Twin, made_by: dict[str, Any]) -> dict[str, Any]:
    """The manifest of a log."""
    from aoro_gym.simulation.log import IDEAL, NOISY
    from aoro_gym.terrains import Plane

    plan, terrain = recording.manoeuvre, twin.terrain
    assert isinstance(terrain, Plane), "manoeuvres are run on planes"
    about: dict[str, Any] = {"manoeuvre": plan.name}
    if plan.signal_percent is not None:
        about["signal_percent"] = plan.signal_percent
    return about | {
        "duration_s": round(float(recording.time[-1]), 9),
        "start_angle_deg": math.degrees(plan.start_angle),
        "sensors": IDEAL if made_by["ideal"] else NOISY,
        "filters": [],
        "engine_speed_rpm": float(twin.machine.engine.set_speed) * 30.0 / math.pi,
        "ground": {
            "slope_deg": terrain.slope_deg,
            "direction_deg": terrain.direction_deg,
            "friction": terrain.friction,
            "rolling_resistance": terrain.rolling_resistance,
        },
        "machine": made_by["machine"],
        "simulation": {
            "aoro_gym": VERSION,
            "device": made_by["device"],
            "seed": made_by["seed"],
            "main_step_s": twin.main_step,
            "substeps": twin.substeps,
        },
    }


def _made_by(
    name: str, settings: list[str] | None, factors: list[str] | None, device: str, seed: int, *, ideal: bool = False
) -> dict[str, Any]:
    machine = {"file": name, "set": settings or [], "scale": factors or []}
    return {"machine": machine, "device": device, "seed": seed, "ideal": ideal}


def _validated(chosen: Machine, second: Machine | None, family: list[Machine], device: str, seed: int) -> Validation:
    from aoro_gym.validation import validate

    with terminal.progress("validation") as tell, _running():
        return validate(chosen, uncalibrated=second, ensemble=family, device=device, seed=seed, progress=tell)


def _validation_passage(result: Validation, folder: Path) -> Passage:
    """The report of a validation in ``folder``, and what the demo shows of it."""
    from aoro_gym.reporting.page import Passage
    from aoro_gym.validation.report import print_tables, write_report

    with _running():
        write_report(result, folder)
    print_tables(terminal.out(), result)
    text = result.headline()
    pictures = [folder / "left_turns.png", folder / "errors.png"]
    return Passage("Validation", text, pictures, more=f"{folder.name}/index.html")


def _swing(chosen: Machine, device: str, seed: int, path: Path) -> Passage:
    """An episode of ``AORO/Turning-v0`` under its reference controller, drawn into the GIF ``path``."""
    import numpy as np

    from aoro_gym.agents import ProportionalDerivative
    from aoro_gym.envs import TurningEnv
    from aoro_gym.reporting.page import Passage, write_gif

    env = TurningEnv(machine=chosen, device=device, render_mode="rgb_array")
    policy = ProportionalDerivative(env.observation_layout)
    start = {"joint_angle": math.radians(15.0), "targets": np.radians(SWING_TARGETS_DEG), "hold": SWING_HOLD_S}
    observation, info = env.reset(seed=seed, options=start)
    steps = round(len(SWING_TARGETS_DEG) * SWING_HOLD_S * env.metadata["render_fps"])
    frames = []
    with terminal.progress("AORO/Turning-v0") as tell:
        for step in range(steps):
            tell("AORO/Turning-v0", step / steps)
            observation, _, terminated, _, info = env.step(policy(observation[None])[0])
            if step % 5 == 0:
                frames.append(env.render())
            if terminated:
                break
    env.close()
    with _running():
        write_gif(path, frames, frames_per_second=env.metadata["render_fps"] / 5)
    targets = ", ".join(f"{target:g}°" for target in SWING_TARGETS_DEG)
    verdict = "settled on every one in time" if info["is_success"] else "did not settle on every one in time"
    text = (
        f"The reference controller of AORO/Turning-v0 (proportional-derivative, from the noisy angle sensor alone) is asked "
        f"for joint angles of {targets}, left positive, and {verdict}."
    )
    return Passage("A controlled turn", text, [path])


def _forest_drive(chosen: Machine, device: str, seed: int, folder: Path) -> Passage:
    """An episode of ``AORO/PathTracking-v0`` on the scan of a generated forest, by a learned policy and by a controller; the
    scan, a plan view and a film of it stand in ``folder``."""
    from aoro_gym.agents.evaluation.evaluate import evaluate, policy_factory
    from aoro_gym.agents.evaluation.films import write_film
    from aoro_gym.agents.evaluation.plots import write_plans
    from aoro_gym.envs import Course
    from aoro_gym.reporting.page import Passage
    from aoro_gym.terrains import drivable_path, load
    from aoro_gym.terrains.generate.forest import forest
    from aoro_gym.terrains.generate.scan import scan

    with terminal.progress("scanning a forest") as tell, _running():
        grown = forest(FOREST_SEED, size=FOREST_SIZE)
        file = folder / "scan.ply"
        folder.mkdir(parents=True, exist_ok=True)
        scan(grown, FOREST_SEED, density=SCAN_DENSITY).save_mesh(file)
        terrain, report = load(
            file, name="scanned forest", progress=lambda share: tell("loading the scan", 0.2 * share)
        )
        path = drivable_path(terrain, FOREST_SEED, length=DRIVE_LENGTH, obstacles=grown.circles("tree"))
        result = evaluate(
            DRIVE,
            {name: policy_factory(DRIVE, name) for name in DRIVERS},
            episodes=1,
            seed=seed,
            courses=[Course(terrain, (path,), name=terrain.name, trees=grown.trees)],
            machine=chosen,
            device=device,
            progress=lambda _, share: tell(DRIVE, 0.2 + 0.4 * share),
        )
        run, other = (result.runs[name] for name in DRIVERS)
        film = write_film(
            result,
            run,
            folder / "drive",
            progress=lambda share: tell("drawing the drive", 0.6 + 0.4 * share),
        )
        plans = write_plans(result, folder)
    changes = "; ".join(change.text for change in report.changes)
    text = (
        f"A generated forest is scanned with noise and holes, saved as a mesh and loaded back ({changes}). The learned "
        f"policy {DRIVERS[0]} of {DRIVE} follows a generated path by the machine's own sensors: "
        f"{_driven(run)}; {DRIVERS[1]} on the same path: {_driven(other)}. They ended so: {run.endings[0]}; "
        f"{other.endings[0]}."
    )
    return Passage("A drive over scanned ground", text, [film, *plans])


def _driven(run: Episodes) -> str:
    """What a policy did in its first episode."""
    figures = {name: float(values[0]) for name, values in run.figures.items()}
    text = f"{figures['driven_m']:.1f} m driven"
    if not figures["success_rate"]:
        return f"{text}, not to the end"
    error, speed = figures["cross_track_rms_m"], figures["speed_m_per_s"]
    return f"{text} at {speed:.2f} m/s, {error:.3f} m off the path (root mean square)"


def _calibrate(fit: Callable[..., Any], out: Path, *, force: bool = False, **options: Any) -> list[Path]:
    """Calibrate, print the verdict and what was found, and write machine, ensemble and report; returns the paths."""
    from aoro_gym.calibration.output import calibrate_to

    with _checking_input(), _resumable(), terminal.progress("calibration") as tell:
        found, written = calibrate_to(out, lambda folder: fit(folder=folder, progress=tell, **options), force=force)
    for item in _calibration_tables(found.report):
        terminal.out().print(item, highlight=False)
    if not found.fits and not force:
        terminal.out().print(f"wrote {written[-1]}", soft_wrap=True, markup=False, highlight=False)
        terminal.err().print(
            f"[bold red]error:[/] {escape(str(out))} was not written, as no machine that was tried does what it was"
            " calibrated to; --force writes it all the same",
            soft_wrap=True,
            highlight=False,
        )
        raise typer.Exit(1)
    return written


def _training_table(found: list[dict[str, Any]]) -> terminal.Comparison:
    """The first evaluation of a training, that of the best return, and the last one."""
    from aoro_gym.agents.evaluation.metrics import MARKS, named, shown
    from aoro_gym.agents.evaluation.statistics import Interval

    best = max(found, key=lambda one: one["figures"]["return"]["mean"])
    chosen = {"first": found[0], "best return": best, "last": found[-1]}
    rows = [
        ["steps", "", *(f"{one['steps']:,}" for one in chosen.values())],
        ["after", "s", *(f"{one['elapsed_s']:.0f}" for one in chosen.values())],
    ]
    total = max(figure.get("episodes", 0) for figure in found[0]["figures"].values())
    for name in found[0]["figures"]:
        words, unit = named(name)
        cells = []
        for one in chosen.values():
            figure = one["figures"][name]
            mean = math.nan if figure["mean"] is None else figure["mean"]
            value = Interval(mean, math.nan, math.nan, figure.get("episodes"), figure.get("lower_bounds", 0))
            cells.append(shown(value, unit, total=total))
        rows.append([words, unit, *cells])
    return terminal.Comparison("Evaluations, means over episodes", ["", "unit", *chosen], rows, lead=2, note=MARKS)


def _calibration_tables(report: dict[str, Any]) -> Iterator[terminal.Comparison | str]:
    """What a calibration found: its verdict, misses of figures or intervals of parameters, then what it leaves open."""
    from aoro_gym.reporting.page import describe

    verdict = report["verdict"]
    yield f"[bold {'green' if verdict['fits'] else 'red'}]{escape(verdict['sentence'])}[/]"
    for log in report.get("conditions", []):
        yield f"{escape(log['log'])}: {escape('; '.join(log['used']))}"
        for warning in log["warnings"]:
            yield f"[yellow]warning:[/] {escape(warning)}"
    for warning in report.get("warnings", []):
        yield f"[yellow]warning:[/] {escape(warning)}"
    if report.get("accepted_code_changes"):
        yield _listed("changes of the code that were accepted", report["accepted_code_changes"])
    misses: dict[str, dict[str, float]] = report.get("misses_tolerances", {})
    if misses:
        rows = [
            [describe(name)[0], *(_miss(misses[level][name]) for level in misses)]
            for name in next(iter(misses.values()))
        ]
        head = ["key figure", *(f"{level} % signal" for level in misses)]
        yield terminal.Comparison("Misses of left turns, in tolerances", head, rows)
    single: dict[str, float] = report.get("single_misses_tolerances", {})
    if single:
        rows = [[name.replace("_", " "), _miss(miss)] for name, miss in single.items()]
        yield terminal.Comparison("Misses of single figures, in tolerances", ("figure", "miss"), rows)
    if report.get("parameters"):
        rows = []
        for p in report["parameters"]:
            mark = Text("identified", "green") if p["identified"] else Text("not identified", "yellow")
            unit = "" if p["unit"] == "1" else p["unit"]
            rows.append([p["key"], f"{p['value']:.4g}", f"{p['low95']:.4g} - {p['high95']:.4g}", unit, mark])
        head = ("key", "value", "95 % interval", "unit", "")
        yield terminal.Comparison("Parameters that the logs feel", head, rows)
    for key, text in (
        ("largest_miss_tolerances", "largest miss: {:.2f} tolerances"),
        ("largest_change_at_half_the_substep_tolerances", "largest change at half the substep: {:.2f} tolerances"),
        ("rms_residual_std", "residuals: {:.2f} standard deviations, root mean square"),
    ):
        if report.get(key) is not None:
            yield text.format(report[key])
    leaning = [f"{item['key']} ({item['end']} end)" for item in report.get("leaning_on_a_bound", [])]
    yield _listed("leaning on a bound of its range", leaning)
    if report.get("ensemble_dropped"):
        yield _listed("ensemble members that were dropped", report["ensemble_dropped"])
    yield _listed("not felt, so left as they were", report.get("not_felt", []))


def _nodata(texts: list[str] | None) -> list[float] | None:
    """Heights that mean unknown, of ``--nodata``; ``none`` says that there are no others than the file's."""
    if not texts:
        return None
    values = []
    for text in texts:
        if text.casefold() == "none":
            continue
        try:
            values.append(float(text.replace("_", "?")))
        except ValueError:
            raise ValueError(f"--nodata {text} is no number; give a height such as -9999, or none") from None
    return values


def _miss(miss: float) -> Text:
    """In tolerances, green where it is within one."""
    return Text(f"{miss:+.2f}", "green" if abs(miss) <= 1 else "red")


def _terrain_tables(report: Report) -> Iterator[Table | str]:
    """What was read, what was changed on the way, and what to mind."""
    table = Table(title=Text(f"Ground of {report.source}"), title_justify="left", header_style="bold")
    table.add_column("what", overflow="fold")
    table.add_column("value", overflow="fold")
    size_x, size_y, size_z = report.extent_m
    spacing = f"one every {report.cell_m:.3g} m" if report.cell_m is not None else "as in the file"
    for name, value in (
        ("read as", f"{report.kind}: {report.points_read:,}"),
        ("units", report.units),
        ("up", report.up),
        ("coordinate system", report.crs or "unknown"),
        ("local origin", "{:.0f}, {:.0f}, {:.0f} m".format(*report.origin_m)),
        ("extent", f"{size_x:.4g} m x {size_y:.4g} m, {size_z:.3g} m high"),
        ("triangles", f"{report.triangles:,} over {report.vertices:,} heights, {spacing}"),
        ("with ground", f"{report.ground_m2:,.0f} m², {report.ground_share:.1%} of the extent"),
        ("slope", f"median {report.slope_median_deg:.1f}°, 95 % below {report.slope_95_deg:.1f}°"),
        ("steepest", f"{report.slope_max_deg:.1f}°"),
        ("drivable (up to 45°)", f"{report.drivable_share:.1%} of the ground"),
        ("roughness", f"{report.roughness_m * 1e3:.0f} mm root mean square, within 2 m"),
    ):
        table.add_row(name, escape(value))
    yield table
    yield "changed:" if report.changes else _listed("changed", [])
    for change in report.changes:
        yield f"  {escape(change.text)}"
    for warning in report.warnings:
        yield f"[yellow]warning:[/] {escape(warning)}"
    if report.holes:
        inside = [hole for hole in report.holes if not hole.at_edge]
        area = sum(hole.area_m2 for hole in report.holes)
        plural = "" if len(report.holes) == 1 else "s"
        count = f"{len(report.holes)} place{plural} without ground, {len(inside)} of them inside"
        yield f"[yellow]warning:[/] {count}; {area:,.0f} m² in all"
        for hole in report.holes[:MOST_HOLES]:
            where = f"x {hole.west:.1f} to {hole.east:.1f} m, y {hole.south:.1f} to {hole.north:.1f} m"
            yield f"  {hole.area_m2:,.1f} m² at {where}{' (at the edge)' if hole.at_edge else ''}"
        if len(report.holes) > MOST_HOLES:
            yield f"  and {len(report.holes) - MOST_HOLES} smaller ones, in the JSON"


def _listed(what: str, items: Sequence[str]) -> str:
    return escape(f"{what}: {', '.join(items) if items else 'none'}")


def _lead(made_by: dict[str, Any]) -> str:
    machine = made_by["machine"]
    changes = [*machine["set"], *(text.replace("=", " x ", 1) for text in machine["scale"])]
    return f"Machine {machine['file']}" + (f", with {', '.join(changes)}" if changes else ", as in its file") + "."


def _figure_table(section: Section) -> terminal.Comparison:
    from aoro_gym.reporting.page import describe, show

    rows = []
    for key, value in section.figures.items():
        name, unit, _ = describe(key)
        rows.append([name, show(key, value), unit])
    return terminal.Comparison(section.title, ("key figure", "value", "unit"), rows)


def _write_json(path: Path, content: Any) -> None:
    from aoro_gym.execution.files import write_json

    write_json(path, _with_nulls(content))


def _with_nulls(content: Any) -> Any:
    """``content`` with null where a number is none: JSON has no NaN."""
    if isinstance(content, dict):
        return {key: _with_nulls(value) for key, value in content.items()}
    if isinstance(content, list | tuple):
        return [_with_nulls(value) for value in content]
    return None if isinstance(content, float) and not math.isfinite(content) else content


def _say(written: list[Path]) -> None:
    for path in written:
        typer.echo(f"wrote {path}")
