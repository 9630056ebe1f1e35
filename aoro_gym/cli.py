"""The command ``aoro-gym``: one thin function a verb.

Input is checked before anything runs: what is wrong is said in one line, with exit code 2. A run that fails ends with
exit code 1. Tables and JSON go to the standard output, progress and errors to the standard error.
"""

from __future__ import annotations

import json
import math
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NoReturn

import typer
from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Table

from aoro_gym import __version__

if TYPE_CHECKING:
    from aoro_gym.manoeuvres import Manoeuvre, Recording
    from aoro_gym.report import Section
    from aoro_gym.terrains import Plane
    from aoro_gym.twin import Machine, Twin

app = typer.Typer(
    name="aoro-gym",
    no_args_is_help=True,
    add_completion=False,
    rich_markup_mode="rich",
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)

MOST_TWINS = 1_000_000
"""Most twins that bench takes at once; more need more memory than one device has."""

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
SeedOption = Annotated[
    int, typer.Option("--seed", metavar="N", help="Seed of all that is random. The twin itself is deterministic.")
]


def main() -> None:
    """Entry point of ``aoro-gym``."""
    app()


def _version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"aoro-gym {__version__}")
        raise typer.Exit


@app.callback()
def _top(
    version: Annotated[
        bool, typer.Option("--version", help="Show the version.", callback=_version, is_eager=True)
    ] = False,
) -> None:
    """A fast digital twin of AORO, a 10 t articulated forestry research machine.

    [bold]Try[/]

      aoro-gym demo                         a turn and a drive, as one page of plots
      aoro-gym simulate --help              any other manoeuvre
      aoro-gym parameters steering.valve    what the machine is made of, with sources
    """


@app.command()
def parameters(
    pattern: Annotated[
        str | None, typer.Argument(metavar="[PATTERN]", help="Part of a key, or a glob such as 'steering.*.leakage'.")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON instead of a table.")] = False,
    machine: MachineOption = "aoro",
    set_: SetOption = None,
    scale: ScaleOption = None,
) -> None:
    """List the machine's parameters: value, unit, range, role and source.

    A range is a soft prior of about 95 %. Keys are what --set and --scale take.

    [bold]Examples[/]

      aoro-gym parameters
      aoro-gym parameters steering.valve
      aoro-gym parameters 'driveline.*.displacement' --json
      aoro-gym parameters oil --set oil.gas_fraction=0.01
    """
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
    table = Table(box=None, pad_edge=False, header_style="bold", title_justify="left")
    table.add_column("key", style="cyan", no_wrap=True)
    table.add_column("value", justify="right", no_wrap=True)
    table.add_column("unit", no_wrap=True)
    table.add_column("range", no_wrap=True)
    table.add_column("role", no_wrap=True)
    table.add_column("source", style="dim", overflow="fold")
    for p in found:
        limits = f"{p.range[0]:.6g} - {p.range[1]:.6g}"
        source = f"{p.source} ({p.note})" if p.note else p.source
        table.add_row(p.key, f"{p.value:.6g}", "" if p.unit == "1" else p.unit, limits, p.role, escape(source))
    _out().print(table)


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
        typer.Option("--signal", metavar="PERCENT", help="Share of the full signal [%]; 100, or 50 to drive."),
    ] = None,
    duration: Annotated[
        float | None,
        typer.Option(
            "--duration",
            metavar="S",
            help="Simulated time [s]. Default: 0.7 s past a turn's stop, 6 s of drive, a file's end.",
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
    machine: MachineOption = "aoro",
    set_: SetOption = None,
    scale: ScaleOption = None,
    device: DeviceOption = "cpu",
    seed: SeedOption = 0,
) -> None:
    """Run one manoeuvre and write its log, plots and key figures.

    left and right are full turns from the opposite stop; drive goes straight on. Each begins with 0.6 s of standstill.
    A FILE.csv has the column time_s and one or more of steering_signal (or steering_signal_V), drive_signal,
    arm_fl ... arm_rr, traction_fl ... traction_rr, gear, parking_brake; a row holds until the next. A log is one, too.

    LOG.csv gets measured columns at 100 Hz and the simulator's own state as true_*; beside it come LOG.toml (how it was
    made), LOG.json (key figures), LOG.png and LOG.html (plots).

    [bold]Examples[/]

      aoro-gym simulate --manoeuvre left --out turn.csv
      aoro-gym simulate --manoeuvre right --signal 50 --out right50.csv
      aoro-gym simulate --manoeuvre drive --signal 40 --duration 8 --terrain-slope 5 --out hill.csv
      aoro-gym simulate --manoeuvre left --scale steering.valve.spool_time_constant=2 --out slow_spool.csv
      aoro-gym simulate --manoeuvre my_commands.csv --start-angle 10 --out mine.csv
    """
    with _checking_input():
        from aoro_gym.log import check_log_path
        from aoro_gym.terrains import Plane

        check_log_path(out)
        chosen = _machine(machine, set_, scale)
        terrain = Plane(slope_deg=slope, direction_deg=slope_direction, friction=friction, rolling_resistance=rolling)
        plan = _manoeuvre(manoeuvre, signal, duration, start_angle, chosen, out)
        twin = _twin(chosen, terrain, device, seed)
    made_by = {"machine": _machine_record(machine, set_, scale), "device": device, "seed": seed}
    section = _run(twin, plan)
    written = _write(section, twin, out, made_by)
    _out().print(_figure_table(section))
    if section.recording.manoeuvre.turn and section.figures["turn_time_s"] is None:
        typer.echo("The turn did not reach its stop, so it has no key figures; a longer --duration may help.")
    _say(written)


@app.command()
def demo(
    out: Annotated[Path, typer.Option("--out", "-o", metavar="FOLDER", help="Folder to write to.")] = Path("demo"),
    machine: MachineOption = "aoro",
    set_: SetOption = None,
    scale: ScaleOption = None,
    device: DeviceOption = "cpu",
    seed: SeedOption = 0,
) -> None:
    """Turn fully left at full signal, then drive straight on: every plot on one page.

    [bold]Examples[/]

      aoro-gym demo
      aoro-gym demo --out cold --scale steering.valve.spool_time_constant=2
    """
    with _checking_input():
        from aoro_gym.log import check_writable
        from aoro_gym.manoeuvres import standing_turn, straight_drive

        if out.exists() and not out.is_dir():
            raise ValueError(f"--out {out} is a file; name a folder")
        check_writable(out / "index.html")
        chosen = _machine(machine, set_, scale)
        plans = {"left_turn": standing_turn(1, 1.0, float(chosen.joint.range)), "straight_drive": straight_drive(0.5)}
        twin = _twin(chosen, None, device, seed)
    made_by = {"machine": _machine_record(machine, set_, scale), "device": device, "seed": seed}
    sections = []
    for name, plan in plans.items():
        sections.append(_run(twin, plan))
        _write(sections[-1], twin, out / f"{name}.csv", made_by, page=False)
        _out().print(_figure_table(sections[-1]))
    from aoro_gym.report import write_html

    page = out / "index.html"
    write_html(page, "AORO twin: demo", _lead(made_by), sections)
    _say([page.resolve()])


@app.command()
def bench(
    twins: Annotated[
        str, typer.Option("--twins", metavar="N[,N...]", help="Numbers of twins stepped together.")
    ] = "1,64,4096",
    seconds: Annotated[float, typer.Option("--seconds", metavar="S", help="Time to measure for, each number.")] = 5.0,
    json_file: Annotated[Path | None, typer.Option("--json", metavar="FILE", help="Write the results here.")] = None,
    machine: MachineOption = "aoro",
    set_: SetOption = None,
    scale: ScaleOption = None,
    device: DeviceOption = "cpu",
    seed: SeedOption = 0,
) -> None:
    """Measure how fast the twin steps.

    Twins steer and drive at random, with new commands every 20 ms. Five runs a number, compilation excluded:
    the table shows the median, the slowest and the fastest.

    [bold]Examples[/]

      aoro-gym bench
      aoro-gym bench --twins 1,1024 --device cuda:0 --json bench.json
    """
    with _checking_input():
        from aoro_gym.log import check_writable

        counts = _counts(twins)
        if not (math.isfinite(seconds) and 0.0 < seconds <= 600.0):
            raise ValueError(f"--seconds = {seconds:g} is outside (0, 600] s")
        if json_file is not None:
            check_writable(json_file)
        chosen = _machine(machine, set_, scale)
        _check_seed(seed)
        _check_device(device)
    from aoro_gym.benchmark import computer, time_twin

    cases = []
    with _progress() as progress:
        task = progress.add_task("stepping", total=len(counts))
        for done, count in enumerate(counts):
            progress.update(task, description=f"{count} twin{'s' * (count > 1)}")
            with _running():
                case = time_twin(
                    count,
                    machine=chosen,
                    device=device,
                    seconds=seconds,
                    seed=seed,
                    progress=lambda share, done=done: progress.update(task, completed=done + share),
                )
            cases.append(case)
    on = computer(device)
    table = Table(
        title=f"Main steps of {cases[0]['main_step_s'] * 1e3:g} ms, {cases[0]['substeps']} substeps, on {on['device']}",
        title_justify="left",
        header_style="bold",
    )
    for column in ("twins", "steps/s (median)", "slowest", "fastest", "x real time, each", "x real time, all"):
        table.add_column(column, justify="right")
    for case in cases:
        factor = case["real_time_factor"]
        cells = (case["steps_per_s"], case["min"], case["max"])
        everything = factor * case["twins"]
        table.add_row(f"{case['twins']}", *(f"{cell:,.0f}" for cell in cells), f"{factor:.3g}", f"{everything:,.1f}")
    _out().print(table)
    if json_file is not None:
        _write_json(json_file, {"machine": on, "cases": cases, "peers": [], "ratios": {}})
        _say([json_file])


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
    """Turn a run that failed into one line and exit code 1."""
    from aoro_gym.manoeuvres import TwinLost

    try:
        yield
    except (TwinLost, OSError) as error:
        _fail(error, 1)


def _fail(error: Exception, code: int) -> NoReturn:
    message = str(error)
    if isinstance(error, OSError) and error.strerror:
        message = f"{error.filename}: {error.strerror}"
    _err().print(f"[bold red]error:[/] {escape(' '.join(message.split()))}", soft_wrap=True, highlight=False)
    raise typer.Exit(code) from None


def _machine(name: str, settings: list[str] | None, factors: list[str] | None) -> Machine:
    import warp

    warp.config.log_level = warp.LOG_ERROR  # no banner, no compile times and no missing-driver notes between the tables
    from aoro_gym.twin import Machine

    chosen = Machine.load(name)
    values, scales = _assignments("--set", settings), _assignments("--scale", factors)
    for key in values.keys() & scales.keys():
        raise ValueError(f"{key} is given to both --set and --scale; give one")
    if values:
        chosen = chosen.set(values)
    return chosen.scale(scales) if scales else chosen


def _assignments(option: str, texts: list[str] | None) -> dict[str, float]:
    """``KEY=NUMBER`` texts as a dict."""
    pairs: dict[str, float] = {}
    for text in texts or []:
        key, equals, number = (part.strip() for part in text.partition("="))
        if not (key and equals):
            raise ValueError(f"{option} {text!r} is not KEY=NUMBER, such as {option} oil.gas_fraction=0.01")
        try:
            value = float(number)
        except ValueError:
            value = math.nan
        if not math.isfinite(value):
            raise ValueError(f"{option} {key}={number}: {number!r} is not a finite number")
        if key in pairs:
            raise ValueError(f"{option} names {key} twice; give it once")
        pairs[key] = value
    return pairs


def _manoeuvre(
    name: str, signal: float | None, duration: float | None, start_angle: float | None, machine: Machine, out: Path
) -> Manoeuvre:
    from aoro_gym import manoeuvres

    joint_range = float(machine.joint.range)
    if name in ("left", "right", "drive"):
        if start_angle is not None:
            raise ValueError(f"--start-angle serves a command file only; {name} starts at its own angle")
        if name == "drive":
            return manoeuvres.straight_drive(0.5 if signal is None else signal / 100.0, duration=duration)
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
    return manoeuvres.from_file(path, start_angle=angle, duration=duration)


def _twin(machine: Machine, terrain: Plane | None, device: str, seed: int) -> Twin:
    """A twin of ``machine``; says so where its kernels must be compiled first."""
    _check_seed(seed)
    _check_device(device)
    from aoro_gym.twin import Twin

    with _err().status("preparing the twin (the first run on a computer compiles it)"):
        twin = Twin(machine=machine, terrain=terrain, device=device)
        twin.step(duration=twin.main_step)
    return twin


def _check_device(device: str) -> None:
    import warp

    known = [known.alias for known in warp.get_devices()]
    if device not in (*known, *(["cuda"] if warp.is_cuda_available() else [])):
        raise ValueError(f"--device {device!r} is not available here; choose one of: {', '.join(known)}")


def _check_seed(seed: int) -> None:
    if seed < 0:
        raise ValueError(f"--seed = {seed} is below 0")


def _counts(text: str) -> list[int]:
    counts = []
    for part in text.split(","):
        if not part.strip().isdecimal() or not 1 <= int(part) <= MOST_TWINS:
            raise ValueError(f"--twins {text!r}: {part.strip()!r} is no whole number from 1 to {MOST_TWINS}")
        counts.append(int(part))
    return counts


# --- running and writing ---


def _run(twin: Twin, plan: Manoeuvre) -> Section:
    from aoro_gym.figures import key_figures
    from aoro_gym.manoeuvres import run
    from aoro_gym.report import Section

    with _progress() as progress, _running():
        task = progress.add_task(plan.title, total=plan.duration)
        recording = run(
            twin,
            plan,
            keep_every=1e-3 if plan.duration <= 120.0 else 1e-2,
            progress=lambda now: progress.update(task, completed=now),
        )
        progress.update(task, completed=plan.duration)
    return Section(recording, key_figures(recording, twin.machine.steering.cylinder))


def _write(section: Section, twin: Twin, out: Path, made_by: dict[str, Any], *, page: bool = True) -> list[Path]:
    """Log, manifest, key figures and plots; returns the paths."""
    from aoro_gym.log import log_columns, write_log
    from aoro_gym.report import write_html, write_png

    plan = section.recording.manoeuvre
    about = _about(section.recording, twin, made_by)
    with _running():
        written = write_log(out, log_columns(section.recording.time, section.recording.channels), about)
        _write_json(out.with_suffix(".json"), {**about, "figures": dict(section.figures)})
        write_png(out.with_suffix(".png"), section)
        written += [out.with_suffix(".json"), out.with_suffix(".png")]
        if page:
            write_html(out.with_suffix(".html"), f"AORO twin: {plan.title}", _lead(made_by), [section])
            written.append(out.with_suffix(".html"))
    return written


def _about(recording: Recording, twin: Twin, made_by: dict[str, Any]) -> dict[str, Any]:
    """The manifest of a log."""
    plan, terrain = recording.manoeuvre, twin.terrain
    about: dict[str, Any] = {"manoeuvre": plan.name}
    if plan.signal_percent is not None:
        about["signal_percent"] = plan.signal_percent
    return about | {
        "duration_s": round(float(recording.time[-1]), 9),
        "start_angle_deg": math.degrees(plan.start_angle),
        "sensors": "ideal",
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
            "aoro_gym": __version__,
            "device": made_by["device"],
            "seed": made_by["seed"],
            "main_step_s": twin.main_step,
            "substeps": twin.substeps,
        },
    }


def _machine_record(name: str, settings: list[str] | None, factors: list[str] | None) -> dict[str, Any]:
    return {"file": name, "set": settings or [], "scale": factors or []}


def _lead(made_by: dict[str, Any]) -> str:
    machine = made_by["machine"]
    changes = [*machine["set"], *(text.replace("=", " x ", 1) for text in machine["scale"])]
    return f"Machine {machine['file']}" + (f", with {', '.join(changes)}" if changes else ", as in its file") + "."


def _figure_table(section: Section) -> Table:
    from aoro_gym.report import describe, show

    table = Table(title=section.title, title_justify="left", header_style="bold")
    table.add_column("key figure")
    table.add_column("value", justify="right")
    table.add_column("unit")
    for key, value in section.figures.items():
        name, unit, _ = describe(key)
        table.add_row(name, show(key, value), unit)
    return table


def _write_json(path: Path, content: Any) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(content, indent=2, ensure_ascii=False) + "\n", encoding="utf-8")


def _say(written: list[Path]) -> None:
    for path in written:
        typer.echo(f"wrote {path}")


# --- consoles ---


def _out() -> Console:
    """Standard output; wide where it is no terminal, so that nothing is cut."""
    console = Console()
    return console if console.is_terminal else Console(width=max(200, shutil.get_terminal_size().columns))


def _err() -> Console:
    return Console(stderr=True)


def _progress() -> Progress:
    console = _err()
    columns = (TextColumn("{task.description}"), BarColumn(), TimeRemainingColumn(compact=True))
    return Progress(*columns, console=console, transient=True, disable=not console.is_terminal)
