"""Commands of the diagnosis benchmark: machines whose deviation is withheld."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from rich.markup import escape

from aoro_gym.checks import check_choice
from aoro_gym.cli import options
from aoro_gym.cli.application import Application
from aoro_gym.cli.options import argument, option
from aoro_gym.cli.outcome import checking_input, conclude, resumable, running, say_error
from aoro_gym.reporting import terminal

app = Application(
    no_args_is_help=True,
    help="The blind check: a diagnosis on machines whose deviation is withheld. In turn: seal, run, score.",
)

NewSuiteArgument = Annotated[Path, argument("DIR", "Folder to write to.")]
SuiteOption = Annotated[str, option("--suite", "quick|standard|full", "12, 240 or 800 cases.")]
ModeOption = Annotated[
    str, option("--mode", "day-one|commissioned", "Without logs of the healthy machine, or with them.")
]
LoggedSensorsOption = Annotated[
    str, option("--sensors", "angle|full", "Joint angle alone, or three pressures besides.")
]
FamilyOption = Annotated[
    str, option("--family", "score|development", "Cases that score, or others to develop a diagnosis on.")
]
AnswersOption = Annotated[
    Path | None, option("--answers", "FILE", "Answers (.json). Default: beside DIR, DIR.answers.json.")
]
SuiteSeedOption = Annotated[int | None, option("--seed", "N", "Makes the same cases again, which are then not blind.")]


@app.command()
def seal(
    folder: NewSuiteArgument,
    suite: SuiteOption = "quick",
    mode: ModeOption = "commissioned",
    sensors: LoggedSensorsOption = "full",
    family: FamilyOption = "score",
    answers: AnswersOption = None,
    seed: SuiteSeedOption = None,
    workers: options.WorkersOption = None,
    accept_code_change: options.AcceptCodeChangeOption = False,
    json_to: options.JsonOption = None,
    quiet: options.QuietOption = False,
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
    with checking_input():
        from aoro_gym.diagnosis_benchmark.cases import FAMILIES, SUITES
        from aoro_gym.diagnosis_benchmark.sealing import answers_file, write_cases
        from aoro_gym.execution.files import check_writable

        for option, value, known in (("suite", suite, SUITES), ("family", family, FAMILIES)):
            check_choice(f"--{option}", value, known)
        if seed is not None:
            options.check_seed(seed)
        file = answers_file(folder, answers)
        if file.suffix != ".json":
            raise ValueError(f"--answers {file} must end in .json")
        check_writable(folder / "seal.json")
        check_writable(file)
        processes = options.check_workers(workers)
        with running(), resumable(), terminal.progress("simulating plants") as tell:
            write_cases(
                SUITES[suite], folder, file, mode=mode, sensors=sensors, family=FAMILIES[family], seed=seed,
                workers=processes, accept_code_change=accept_code_change, progress=tell,
            )  # fmt: skip
    conclude(folder / "seal.json", written=[folder / "seal.json", file], json_to=json_to)


SuiteArgument = Annotated[Path, argument("DIR", "Folder of a sealed suite.")]
ReadSensorsOption = Annotated[
    str | None, option("--sensors", "angle|full", "What the diagnosis may read. Default: all that is logged.")
]
DiagnosesFolderOption = Annotated[
    Path | None, option("--out -o", "FOLDER", "Folder to write to. Default: DIR/diagnoses-SENSORS.")
]


@app.command()
def run(
    folder: SuiteArgument,
    sensors: ReadSensorsOption = None,
    out: DiagnosesFolderOption = None,
    workers: options.WorkersOption = None,
    ray: options.RayOption = None,
    device: options.DevicesOption = "cpu",
    restart: options.RestartOption = False,
    accept_code_change: options.AcceptCodeChangeOption = False,
    json_to: options.JsonOption = None,
    quiet: options.QuietOption = False,
) -> None:
    """Diagnose every case of a sealed suite.

    Each case is diagnosed by itself, from its machine.toml, logs and healthy logs alone: the answers are not asked for.
    FOLDER/NNN/diagnosis.json says what was found. A case that fails leaves FOLDER/NNN/error.txt, is named at the end, and
    stops no other; the exit code is then 1.

    Each of --workers processes diagnoses one case at a time. With --ray, each case is a job on a cluster whose nodes share
    DIR and FOLDER. A case takes about a minute of a core. Ctrl-C is safe: the same command goes on with the cases that have
    no diagnosis, those that failed among them.

    [bold]Examples[/]

      aoro-gym blind run blind_quick
      aoro-gym blind run blind_quick --sensors angle
      aoro-gym blind run blind_standard --workers 8
      aoro-gym blind run blind_standard --device cuda:all --workers 8
    """
    with checking_input():
        from aoro_gym.diagnosis_benchmark.running import diagnoses_folder, logged_sensors, run_cases
        from aoro_gym.execution.files import check_writable

        given = logged_sensors(folder) if sensors is None else sensors
        target = diagnoses_folder(folder, given) if out is None else out
        check_writable(target / "run.json")
        options.check_device(device, simd=False, several=True)
        processes = options.check_workers(workers)
        with running(), resumable(), terminal.progress("diagnosing") as tell:
            failures = run_cases(
                folder, target, sensors=given, device=device, workers=processes, ray=ray,
                restart=restart, accept_code_change=accept_code_change, progress=tell,
            )  # fmt: skip
    for name, reason in failures.items():
        say_error(reason, f"[bold red]case {escape(name)} failed:[/]")
    conclude({"folder": str(target), "failures": dict(failures)}, written=[target], json_to=json_to)
    if failures:
        raise typer.Exit(1)


DiagnosedSuiteArgument = Annotated[Path, argument("DIR", "Folder of a sealed suite whose cases were diagnosed.")]
DiagnosesOption = Annotated[
    Path | None,
    option("--diagnoses", "FOLDER", "What 'blind run' wrote. Default: DIR/diagnoses-SENSORS of all sensors."),
]
ScoreFolderOption = Annotated[
    Path | None, option("--out -o", "FOLDER", "Folder to write to. Default: that of the diagnoses.")
]


@app.command()
def score(
    folder: DiagnosedSuiteArgument,
    answers: AnswersOption = None,
    diagnoses: DiagnosesOption = None,
    out: ScoreFolderOption = None,
    workers: options.WorkersOption = None,
    device: options.DeviceOption = "cpu",
    json_to: options.JsonOption = None,
    quiet: options.QuietOption = False,
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
    with checking_input():
        from aoro_gym.diagnosis_benchmark.running import diagnoses_folder, logged_sensors
        from aoro_gym.diagnosis_benchmark.scoring import score_cases
        from aoro_gym.diagnosis_benchmark.scoring_report import tables, write_score
        from aoro_gym.diagnosis_benchmark.sealing import answers_file

        found = diagnoses_folder(folder, logged_sensors(folder)) if diagnoses is None else diagnoses
        target = found if out is None else out
        options.check_folder(target, "score.json")
        options.check_device(device, simd=False)
        file = answers_file(folder, answers)
        processes = options.check_workers(workers)
        with running(), resumable(), terminal.progress("opening the seal") as tell:
            result = score_cases(
                folder, file, found, target / "oracle", device=device, workers=processes, progress=tell
            )
    with running():
        written = write_score(result, target)
    conclude(target / "score.json", tables(result), written, json_to=json_to)
