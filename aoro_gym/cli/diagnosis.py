"""Command that diagnoses why a machine and its twin disagree."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from aoro_gym.cli import options
from aoro_gym.cli.options import argument, option
from aoro_gym.cli.outcome import checking_input, conclude, running, say_error
from aoro_gym.reporting import terminal

if TYPE_CHECKING:
    from aoro_gym.diagnosis.recording import Recording
    from aoro_gym.diagnosis.result import Diagnosis
    from aoro_gym.machine import Machine

LogsArgument = Annotated[list[Path] | None, argument("[LOG]...", "Logs (.csv, .parquet or a bag) to be explained.")]
MetricsOption = Annotated[
    Path | None, option("--metrics", "TABLE", "Key figures of full turns (.csv), instead of logs.")
]
SourceOption = Annotated[
    str | None, option("--source", "NAME", "Rows of TABLE that are the machine's, by their source.")
]
HealthySourceOption = Annotated[
    str | None, option("--healthy-source", "NAME", "Rows of TABLE of the machine while nothing was wrong.")
]
HealthyOption = Annotated[
    list[Path] | None,
    option("--healthy", "LOG|DIR", "Log of the same machine while nothing was wrong, or a folder of them."),
]
HoldoutOption = Annotated[
    list[str] | None,
    option("--holdout", "NAME", "Logs, by name or glob, that take no part in the fit; or rows: signal=75,50."),
]
FitOption = Annotated[list[str] | None, option("--fit", "NAME", "Logs or rows that do; the others are held out.")]
CheckOption = Annotated[
    bool, option("--check", None, "Read the logs, say what was read, in which units, what is missing; no more.")
]
OutOption = Annotated[Path, option("--out -o", "DIR", "Folder to write to.")]


def diagnose(
    logs: LogsArgument = None,
    metrics: MetricsOption = None,
    source: SourceOption = None,
    healthy_source: HealthySourceOption = None,
    healthy: HealthyOption = None,
    holdout: HoldoutOption = None,
    fit: FitOption = None,
    check: CheckOption = False,
    out: OutOption = Path("diagnosis"),
    machine: options.MachineOption = options.MACHINE,
    set_: options.SetOption = None,
    scale: options.ScaleOption = None,
    device: options.DeviceOption = "cpu",
    json_to: options.JsonOption = None,
    quiet: options.QuietOption = False,
) -> None:
    """Say why a machine and its twin disagree: where, because of what, by how much, and what to record next.

    Networks that were trained on simulated machines of many laws weigh each effect of the catalogue (aoro-gym parameters
    --effects), pairs of them, and something that the catalogue lacks; the twin then fits the size of those that may be. A
    LOG is a manoeuvre of some seconds and needs time_s, steering_signal (or steering_signal_V), joint_angle_rad (or
    joint_angle_deg) and half a second of rest at its begin; port and pump pressures tell far more.

    With --healthy logs, best of the same commands, the question is what has changed since; repeats of a command show what
    changes by itself. Without, what this machine does otherwise than others of its kind cannot be told from an effect.

    Where only key figures of full turns are known, --metrics takes a TABLE with the columns signal_percent, source and
    figures such as turn_time_s (aoro-gym validate writes them all), std_turn_time_s and so on if their standard deviations
    are known, and direction. Rows of the --healthy-source are what the same turns of the --source are compared with; without
    them the question is what the machine does otherwise than others of its kind. --fit and --holdout then select rows:
    signal=100, or direction=left.

    Writes DIR/diagnosis.json, DIR/report.html and a machine file for every cause that was fitted. A verdict of a cause is
    only as good as the blind check says (aoro-gym blind --help).

    --check reads LOGs and --healthy as a diagnosis would, says what it read, in which units, what is missing and what is
    doubtful, and stops: with exit code 2 if a log is refused.

    [bold]Examples[/]

      aoro-gym diagnose --check later/*.csv
      aoro-gym diagnose later/*.csv --healthy healthy --machine mine.toml --out diagnosis
      aoro-gym diagnose left.csv right.csv ramp.csv --holdout ramp
      aoro-gym diagnose later/*.csv --healthy healthy --device cuda:0
      aoro-gym diagnose --metrics table.csv --source later --healthy-source before
      aoro-gym diagnose --metrics table.csv --source physical --holdout signal=50
    """
    how = {"device": device, "out": out, "json_to": json_to}
    with checking_input():
        from aoro_gym.diagnosis.recording import read_recording
        from aoro_gym.diagnosis.selection import log_files, split_recordings
        from aoro_gym.execution.files import check_writable

        if bool(logs) == bool(metrics):
            raise ValueError("give LOGs or --metrics TABLE, and not both")
        if check:
            if metrics:
                raise ValueError("--check reads LOGs, not --metrics TABLE; leave one out")
            _check_logs([*(logs or []), *log_files(healthy)], json_to)
            return
        if fit and holdout:
            raise ValueError("give --fit or --holdout, not both: what is not fitted is held out")
        check_writable(out / "diagnosis.json")
        chosen = options.load(options.run_spec(machine, set_, scale, device), simd=False)
        if metrics:
            if healthy:
                raise ValueError("--healthy takes logs; with --metrics give --healthy-source NAME")
            _diagnose_table(metrics, (source, healthy_source), fit, holdout, chosen, how)
            return
        for name, value in (("--source", source), ("--healthy-source", healthy_source)):
            if value:
                raise ValueError(f"{name} {value} belongs to --metrics TABLE; logs have no sources")
        recordings = [read_recording(path) for path in logs or []]
        before = [read_recording(path) for path in log_files(healthy)]
        used, held_out = split_recordings(recordings, fit=fit, holdout=holdout)
    _diagnose_logs(used, before, held_out, chosen, how)


def _check_logs(paths: Sequence[Path], json_to: Path | None) -> None:
    """Say what a diagnosis would read of every log; ValueError if it refuses one."""
    from aoro_gym.diagnosis.recording import CHANNELS, read_log
    from aoro_gym.recording.summary import describe

    read: dict[str, list[str]] = {}
    refused: dict[str, str] = {}
    for path in paths:
        try:
            read[str(path)] = describe(read_log(path), channels=CHANNELS)
        except (ValueError, OSError) as error:
            refused[str(path)] = str(error)
            say_error(str(error))
    shown = ["\n".join(lines) for lines in read.values()]
    conclude({"read": read, "refused": refused}, shown, json_to=json_to, soft_wrap=True, highlight=False, markup=False)
    if refused:
        raise ValueError(f"{len(refused)} of {len(paths)} logs cannot be used")


def _diagnose_logs(
    used: Sequence[Recording],
    healthy: Sequence[Recording],
    held_out: Sequence[Recording],
    machine: Machine,
    how: dict[str, Any],
) -> None:
    """Diagnose logs, print a summary and write the result."""
    from aoro_gym.diagnosis.diagnose import diagnose as find

    json_to = how.pop("json_to")
    with _simulating(**how) as shared:
        found = find(used, machine, healthy=healthy, held_out=held_out, **shared)
        written = _written(found, shared["out"])
    _conclude(found, written, json_to)


def _diagnose_table(
    table: Path,
    sources: tuple[str | None, str | None],
    fit: list[str] | None,
    holdout: list[str] | None,
    machine: Machine,
    how: dict[str, Any],
) -> None:
    """Diagnose key figures of a table, print a summary and write the result; ``sources`` are those of the machine and of
    the healthy one."""
    from aoro_gym.diagnosis.selection import split_rows
    from aoro_gym.diagnosis.tables import read_rows
    from aoro_gym.diagnosis.tables_diagnosis import diagnose_rows

    source, healthy_source = sources
    rows = read_rows(table, source)
    healthy = [] if healthy_source is None else read_rows(table, healthy_source)
    if healthy and healthy == rows:
        raise ValueError(f"--healthy-source {healthy_source} is the --source itself; name another one")
    used, held_out = split_rows(rows, fit=fit, holdout=holdout)
    json_to = how.pop("json_to")
    with _simulating(**how) as shared:
        found = diagnose_rows(used, machine, healthy=healthy, held_out=held_out, **shared)
        written = _written(found, shared["out"])
    _conclude(found, written, json_to)


@contextmanager
def _simulating(*, device: str, out: Path) -> Iterator[dict[str, Any]]:
    """Simulator, folder and progress of a diagnosis, as keyword arguments."""
    from aoro_gym.diagnosis.replay import Simulator
    from aoro_gym.execution.locking import locked

    with running(), terminal.progress("diagnosing") as tell, locked(out):
        yield {"simulator": Simulator(device), "out": out, "progress": tell}


def _written(found: Diagnosis, out: Path) -> list[Path]:
    from aoro_gym.diagnosis.report import write_report

    return [found.save(out), write_report(found, out)]


def _conclude(found: Diagnosis, written: Sequence[Path], json_to: Path | None) -> None:
    from aoro_gym.diagnosis.report import summary

    conclude(written[0], summary(found), written, json_to=json_to)
