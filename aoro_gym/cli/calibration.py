"""Commands that validate the twin and calibrate it."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from aoro_gym.checks import check_integer
from aoro_gym.cli import options
from aoro_gym.cli.options import argument, option
from aoro_gym.cli.outcome import checking_input, conclude, resumable, running, say_error
from aoro_gym.reporting import terminal

if TYPE_CHECKING:
    from aoro_gym.calibration.published import Calibration
    from aoro_gym.machine import Machine
    from aoro_gym.machine.specification import MachineSpec, RunSpec
    from aoro_gym.validation import Validation

NONE = "none"
"""What leaves an optional machine out."""
STRUCTURES = "structures"
"""What stands for the bundled machines of other laws."""

UncalibratedOption = Annotated[str, option("--uncalibrated", "NAME|FILE", "Second machine to compare with, or none.")]
EnsembleOption = Annotated[
    list[str] | None,
    option(
        "--ensemble",
        "FILE|FOLDER",
        "Machines that fit as well: their spread is shown. Repeatable; structures: the bundled ones of other laws; or none. "
        "Default: the bundled ones of these laws.",
    ),
]
RecalibrateOption = Annotated[
    bool,
    option("--recalibrate", None, "Calibrate the uncalibrated machine first, and validate the result. Takes minutes."),
]


def validate(
    out: options.FolderOption = Path("validation"),
    uncalibrated: UncalibratedOption = options.DATASHEET,
    ensemble: EnsembleOption = None,
    recalibrate: RecalibrateOption = False,
    machine: options.MachineOption = options.MACHINE,
    set_: options.SetOption = None,
    scale: options.ScaleOption = None,
    laws: options.LawsOption = None,
    device: options.DeviceOption = "cpu",
    seed: options.SeedOption = 0,
    restart: options.RestartOption = False,
    accept_code_change: options.AcceptCodeChangeOption = False,
    json_to: options.JsonOption = None,
    quiet: options.QuietOption = False,
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
      aoro-gym validate --laws library --out library
      aoro-gym validate --ensemble structures --out structures
      aoro-gym validate --recalibrate --out again
    """
    with checking_input():
        from aoro_gym.execution.files import check_writable
        from aoro_gym.machine import Machine
        from aoro_gym.validation.report import printed, write_report

        options.check_folder(out, "index.html")
        if recalibrate and (machine != options.MACHINE or set_ or scale or laws):
            raise ValueError(
                "--recalibrate makes its machine from --uncalibrated; drop --machine, --set, --scale and --laws"
            )
        if recalibrate and uncalibrated == NONE:
            raise ValueError("--recalibrate starts from --uncalibrated, which is none; name a machine")
        run = options.run_spec(machine, set_, scale, device, seed, laws=laws)
        chosen = options.load(run)
        second = comparison_machine(run.machine, uncalibrated)
        family = ensemble_machines(run.machine, ensemble, bundled=not recalibrate)
        if recalibrate:
            check_writable(out / "calibrated.toml")
    written = []
    if recalibrate:
        from aoro_gym.calibration.published import calibrate_published

        assert second is not None
        file = out / "calibrated.toml"
        _, made = _calibrate(
            lambda **settings: calibrate_published(second, **settings), file, force=True, seed=seed, device=device,
            restart=restart, accept_code_change=accept_code_change,
        )  # fmt: skip
        written += made
        chosen = Machine.load(file)
    result = validated(chosen, second, family, run)
    with running():
        written += write_report(result, out, run.to_json() | ({"recalibrated": uncalibrated} if recalibrate else {}))
    conclude(out / "validation.json", printed(result), written, json_to=json_to, highlight=False)


def comparison_machine(spec: MachineSpec, name: str) -> Machine | None:
    """The machine ``name`` to compare with; None for none, or if it is the one of ``spec``."""
    from aoro_gym.machine import Machine

    return None if name == NONE or (spec.file == name and not spec.changed) else Machine.load(name)


def ensemble_machines(spec: MachineSpec, named: list[str] | None, *, bundled: bool = True) -> list[Machine]:
    """Machines of the files and folders ``named``; without names the bundled ensemble, where ``spec`` is its machine."""
    from aoro_gym.machine.ensemble import bundled_ensemble, bundled_structures, read_ensemble

    if named is None:
        return bundled_ensemble() if bundled and spec.file == options.MACHINE and not spec.changed else []
    if named == [NONE]:
        return []
    machines = []
    for name in named:
        found = bundled_structures() if name == STRUCTURES else read_ensemble(Path(name))
        if not found:
            raise ValueError(f"--ensemble {name} holds no machine file (.toml)")
        machines += found
    return machines


def validated(machine: Machine, uncalibrated: Machine | None, ensemble: list[Machine], run: RunSpec) -> Validation:
    """Validation of a machine, under a progress bar."""
    from aoro_gym.validation import validate

    with terminal.progress("validation") as tell, running():
        return validate(
            machine, uncalibrated=uncalibrated, ensemble=ensemble, device=run.device, seed=run.seed, progress=tell
        )


RestoreOption = Annotated[
    bool,
    option("--recalibrate", None, "Find the valve's edges anew, so that turns at full signal take the time they took."),
]


def study(
    out: options.FolderOption = Path("study"),
    recalibrate: RestoreOption = False,
    machine: options.MachineOption = options.MACHINE,
    set_: options.SetOption = None,
    scale: options.ScaleOption = None,
    device: options.DeviceOption = "cpu",
    json_to: options.JsonOption = None,
    quiet: options.QuietOption = False,
) -> None:
    """What a change of parameters does to full turns and to a straight drive.

    Left and right turns at 100, 75 and 50 % signal of the machine as it is
    and with --set and --scale: seven key figures with their changes, flow
    curves over each other, and the motors' pressure at 0.75 m/s. With
    --recalibrate the pressure drop of the valve's edges restores the turn
    times first, as the publication does, so that what differs is what the
    parameter does beside the time.

    FOLDER gets study.json, the curves (PNG) and index.html.

    [bold]Examples[/]

      aoro-gym study --scale steering.hose_bulk_modulus=0.5
      aoro-gym study --scale steering.hose_bulk_modulus=0.5 --recalibrate --out softer
      aoro-gym study --set oil.gas_fraction=0.02 --set joint.friction_torque=0 --recalibrate
    """
    with checking_input():
        from aoro_gym.calibration.change import study_change
        from aoro_gym.calibration.change_report import sentence, tables, write_change

        options.check_folder(out, "index.html")
        if not (set_ or scale):
            raise ValueError("nothing is changed; give --set KEY=VALUE or --scale KEY=FACTOR")
        before = options.load(options.run_spec(machine, None, None, device))
        run = options.run_spec(machine, set_, scale, device)
        after = options.load(run)
    with terminal.progress("study") as tell, running(), checking_input():
        found = study_change(before, after, recalibrate=recalibrate, device=device, progress=tell)
    with running():
        written = write_change(found, out, run.to_json())
    shown = [sentence(found), *tables(found)]
    conclude(out / "study.json", shown, written, json_to=json_to, highlight=False)


LogsArgument = Annotated[list[Path] | None, argument("[LOG]...", "Logs (.csv, .parquet or a bag), after --logs.")]
PublishedOption = Annotated[bool, option("--published", None, "Calibrate against the published figures.")]
UseLogsOption = Annotated[bool, option("--logs", None, "Calibrate against the LOGs that follow.")]
ProcedureOption = Annotated[
    bool, option("--procedure", None, "Take the published procedure's steps on the LOGs that follow.")
]
DriveSpeedOption = Annotated[
    float | None, option("--drive-speed", "M/S", "With --procedure: speed that the straight drives held.")
]
MembersOption = Annotated[int, option("--ensemble", "N", "Further machines that fit as well, as different as can be.")]
StartsOption = Annotated[int | None, option("--starts", "N", "Searches that are refined. Default: 2.")]
PopulationOption = Annotated[
    int | None, option("--population", "N", "Machines tried at first. Default: 512, or 64 on logs.")
]
ChosenLawsOption = Annotated[
    str | None,
    option(
        "--laws",
        "NAME",
        "Family of laws, see 'aoro-gym laws', or file: the file's. With --logs A,B: to choose from. Default: the file's; "
        "with --logs all, to choose from.",
    ),
]
QuickOption = Annotated[
    bool, option("--quick", None, "With --logs: a look. Laws by the quick searches alone, and a short search.")
]
HoldPublishedOption = Annotated[
    bool,
    option("--hold-published", None, "With --published: what the publication gives of a parameter stays as it is."),
]
MachineFileOption = Annotated[Path, option("--out -o", "FILE", "Machine file to write, .toml.")]
ForceOption = Annotated[bool, option("--force", None, "Write FILE even if the machine that was found does not fit.")]


def calibrate(
    logs: LogsArgument = None,
    published: PublishedOption = False,
    use_logs: UseLogsOption = False,
    procedure: ProcedureOption = False,
    drive_speed: DriveSpeedOption = None,
    ensemble: MembersOption = 0,
    starts: StartsOption = None,
    population: PopulationOption = None,
    quick: QuickOption = False,
    hold_published: HoldPublishedOption = False,
    out: MachineFileOption = Path("machine.toml"),
    machine: options.MachineOption = options.DATASHEET,
    set_: options.SetOption = None,
    scale: options.ScaleOption = None,
    laws: ChosenLawsOption = None,
    device: options.DeviceOption = "cpu",
    seed: options.SeedOption = 0,
    force: ForceOption = False,
    restart: options.RestartOption = False,
    accept_code_change: options.AcceptCodeChangeOption = False,
    json_to: options.JsonOption = None,
    quiet: options.QuietOption = False,
) -> None:
    """Fit the machine's uncertain parameters within their ranges, to published figures or to your logs.

    --published: the published procedure (valve curve, turn times, driving pressure), then all uncertain parameters: the
    most probable machine, ranges read as 95 %, that has the key figures of the published twin's left turns within their
    tolerances, and a steady flow that swings by 2 % at most; then the valve's right side by right turns. --logs: the
    twin repeats all commands of each LOG (steering, drive, arms, traction, gear, parking brake) on the ground and under
    the conditions of the manifest beside it, and its joint angle, pressures and engine speed are compared sample by
    sample. A LOG needs time_s, a command such as steering_signal, joint_angle_rad (or _deg) and a rest at its begin;
    pressures help. Full turns and slow ramps say most. Logs choose the family of laws, too: the one that best predicts
    logs that it was not fitted to. That takes some four times as long as one family (--laws NAME); --quick takes a fifth
    of it for a look, and --device cpu:simd is several times as fast.

    --procedure: the published procedure on LOGs, by what their commands are. Slow ramps to one side give its dead band, full
    turns at three levels or more its nominal flow, openings and pressure drop, straight drives at --drive-speed with both
    drive pressures the disc brake. What the LOGs do not hold stays as it is.

    First comes the verdict: whether the machine that was found does what it was calibrated to. If not, the exit code is 1
    and FILE is not written, unless by --force.

    Writes FILE, its report beside it (.json) and, with --ensemble, the folder FILE_ensemble. Ctrl-C is safe: the same
    command goes on where it stopped.

    [bold]Examples[/]

      aoro-gym calibrate --published --out machine.toml
      aoro-gym calibrate --published --ensemble 8 --out machine.toml --device cpu:simd
      aoro-gym calibrate --published --hold-published --out held.toml
      aoro-gym calibrate --logs turn_left.csv turn_right.csv ramp.csv --out mine.toml
      aoro-gym calibrate --logs turn_left.csv turn_right.csv ramp.csv --laws default,materials --out mine.toml
      aoro-gym calibrate --procedure turns/*.csv ramps/*.csv drive.csv --drive-speed 0.75 --out mine.toml
      aoro-gym calibrate --published --laws library --out library.toml
      aoro-gym validate --machine mine.toml
    """
    with checking_input():
        from aoro_gym.calibration.output import check_output

        _check_source(published, use_logs, procedure, hold_published, logs)
        _check_procedure(procedure, drive_speed, bool(ensemble or starts or population))
        for option, value, least in (("ensemble", ensemble, 0), ("starts", starts, 1), ("population", population, 2)):
            if value is not None:
                check_integer(f"--{option}", value, ge=least)
        check_output(out, logs or [])
        sizes = {name: n for name, n in (("starts", starts), ("population", population)) if n is not None}
        chosen = options.load(options.run_spec(machine, set_, scale, device, seed, laws=_fixed_laws(laws, use_logs)))
        if use_logs:
            fit = _fit_to_logs(chosen, logs or [], laws, sizes | {"ensemble": ensemble}, device, quick=quick)
        else:
            fit = _fit_without_choice(chosen, logs or [], drive_speed, hold_published=hold_published, quick=quick)

    report, written = _calibrate(
        fit, out, force=force, ensemble=ensemble, seed=seed, device=device, restart=restart,
        accept_code_change=accept_code_change, goes_on="the same command begins anew" if procedure else GOES_ON, **sizes,
    )  # fmt: skip
    _conclude_calibration(report, written, out, force=force, json_to=json_to)


def _check_source(
    published: bool, use_logs: bool, procedure: bool, hold_published: bool, logs: list[Path] | None
) -> None:
    """ValueError unless the options name one thing to calibrate against."""
    if published + use_logs + procedure != 1:
        raise ValueError("give one of --published, --logs LOG... and --procedure LOG...")
    if hold_published and not published:
        raise ValueError("--hold-published needs --published; drop it to calibrate on logs")
    if published and logs:
        raise ValueError(f"--published takes no logs, but got {logs[0]}; give --logs instead to calibrate on logs")
    if not published and not logs:
        option = "--logs" if use_logs else "--procedure"
        raise ValueError(f"{option} needs the logs behind it, such as {option} turn_left.csv turn_right.csv")


def _fixed_laws(laws: str | None, use_logs: bool) -> str | None:
    """What --laws changes of the machine itself: nothing where it names the file's laws, or what logs choose from."""
    return None if laws == "file" or (use_logs and _is_choice(laws)) else laws


def _is_choice(laws: str | None) -> bool:
    return laws is None or laws == "families" or "," in laws


def _families(laws: str | None, machine: Machine) -> list[str]:
    """Families that logs choose from; none where the laws are fixed.

    Raises:
        ValueError: names a family that there is not, or one twice.
    """
    from aoro_gym.calibration.choice import OWN, families_of
    from aoro_gym.machine.laws import family

    if not _is_choice(laws):
        return []
    if laws is None or laws == "families":
        return families_of(machine)
    names = [name.strip() for name in laws.split(",")]
    for name in names:
        try:
            _ = name == OWN or family(name)
        except ValueError as error:
            raise ValueError(f"--laws {laws}: {error}") from None
        if names.count(name) > 1:
            raise ValueError(f"--laws {laws} names {name} twice; name it once")
    return names


def _fit_to_logs(
    machine: Machine, logs: list[Path], laws: str | None, sizes: dict[str, int], device: str, *, quick: bool
) -> Callable[..., Calibration]:
    """What calibrates to logs that can be read, with laws that they choose; says first what the choice costs."""
    from aoro_gym.calibration.logs import calibrate_logs, times_one_family
    from aoro_gym.calibration.recordings import read_filtered_log

    families = _families(laws, machine)
    recordings = [read_filtered_log(path) for path in logs]
    if len(families) > 1 and not quick and not terminal.is_quiet():
        times = times_one_family(machine, recordings, len(families), **sizes)
        terminal.err().print(
            f"choosing among {len(families)} families of laws takes some {times:.1f} times as long as calibrating one; "
            "--laws NAME fixes it, --quick takes a look"
            + (", --device cpu:simd is several times as fast" if device == "cpu" else ""),
            highlight=False,
        )  # fmt: skip
    return partial(calibrate_logs, machine, logs, families=families, quick=quick)


def _fit_without_choice(
    machine: Machine, logs: list[Path], drive_speed: float | None, *, hold_published: bool, quick: bool
) -> Callable[..., Calibration]:
    """The published procedure on ``logs``, or without any the calibration to published figures."""
    from aoro_gym.calibration.published import calibrate_published

    if quick:
        raise ValueError("--quick needs --logs; drop it")
    if logs:
        return partial(_take_procedure, machine, logs, drive_speed)
    return partial(calibrate_published, machine, hold_published=hold_published)


def _take_procedure(
    machine: Machine, logs: list[Path], drive_speed: float | None, *, device: str, progress: Any, **_: Any
) -> Calibration:
    """The published procedure on logs; what belongs to searches has no meaning there."""
    from aoro_gym.calibration.procedure_logs import calibrate_procedure

    return calibrate_procedure(machine, logs, drive_speed=drive_speed, device=device, progress=progress)


def _check_procedure(procedure: bool, drive_speed: float | None, searches: bool) -> None:
    """ValueError for options that do not go with --procedure, or need it."""
    if drive_speed is not None and not (procedure and drive_speed > 0.0):
        raise ValueError(f"--drive-speed {drive_speed:g} needs --procedure, and must be positive")
    if procedure and searches:
        raise ValueError("--procedure searches nothing; drop --ensemble, --starts and --population")


GOES_ON = "the same command goes on from where it stopped"


def _calibrate(
    fit: Callable[..., Any], out: Path, *, force: bool = False, goes_on: str = GOES_ON, **settings: Any
) -> tuple[Calibration, list[Path]]:
    """Calibrate, and write machine, ensemble and report; gives what was found, and the paths."""
    from aoro_gym.calibration.output import calibrate_to

    with checking_input(), resumable(lambda: goes_on), terminal.progress("calibration") as tell:
        return calibrate_to(out, lambda folder: fit(folder=folder, progress=tell, **settings), force=force)


def _conclude_calibration(
    found: Calibration, written: list[Path], out: Path, *, force: bool, json_to: Path | None
) -> None:
    """Show the verdict and what was found; exit code 1 where no machine was written."""
    from aoro_gym.calibration.report import tables

    conclude(written[-1], tables(found.report), written, json_to=json_to, highlight=False)
    if found.fits or force:
        return
    say_error(
        f"{out} was not written, as no machine that was tried does what it was calibrated to;"
        " --force writes it all the same"
    )
    raise typer.Exit(1)
