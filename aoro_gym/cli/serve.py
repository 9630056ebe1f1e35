"""Command that puts a twin on sockets."""

from __future__ import annotations

import math
import signal
from contextlib import ExitStack, closing
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from aoro_gym.cli import options
from aoro_gym.cli.options import option
from aoro_gym.cli.outcome import checking_input, conclude, fail, interrupted, running, say_error
from aoro_gym.cli.place import (
    GroundOption,
    StartOption,
    TerrainOption,
    TrackOption,
    bare,
    check_start,
    check_track,
    load_ground,
    load_line,
    put,
)
from aoro_gym.reporting import terminal

if TYPE_CHECKING:
    from aoro_gym.cosimulation.server.geodesy import Origin
    from aoro_gym.cosimulation.server.server import Server
    from aoro_gym.cosimulation.server.session import Sensing
    from aoro_gym.machine.specification import RunSpec
    from aoro_gym.terrains import Path as Line
    from aoro_gym.twin import Twin
    from aoro_gym.view.mirror import MirrorPage

PathOption = Annotated[Path | None, option("--path", "FILE", "Start on this path (GPX, CSV, ...), 4 m from its begin.")]
OriginOption = Annotated[
    str | None,
    option(
        "--origin", "LAT,LON[,HEIGHT]", "Where x = y = z = 0 lies, in degrees and m, if the ground does not say it."
    ),
]
HostOption = Annotated[str, option("--host", "ADDRESS", "Address to bind. Any but 127.0.0.1 needs --token.")]
UdpOption = Annotated[int, option("--udp-port", "N", "Commands in, telemetry out; 0: any free one.")]
TcpOption = Annotated[int, option("--tcp-port", "N", "GPS sentences out; 0: any free one.")]
TokenOption = Annotated[
    str | None,
    typer.Option("--token", metavar="TEXT", help="Secret that authenticates all datagrams.", envvar="AORO_TOKEN"),
]
LockStepOption = Annotated[bool, option("--lock-step", None, "Clients grant each step; no real time.")]
RateOption = Annotated[int, option("--telemetry-rate", "100|50|20", "Records of telemetry a second.")]
DurationOption = Annotated[float | None, option("--duration", "S", "Simulated time to end after. Default: none.")]
FifoOption = Annotated[
    int | None, option("--fifo", "PRIORITY", "First-in-first-out scheduling (1 to 99), locked memory.")
]
SpinOption = Annotated[bool, option("--spin", None, "Wait with the processor running; fewer steps are late.")]
LossOption = Annotated[
    float | None, option("--gps-loss", "S", "Mean time between two losses of the fixed solution. Default: none.")
]
IdealOption = Annotated[bool, option("--ideal-sensors", None, "Sensors without errors.")]
ViewOption = Annotated[
    int | None, option("--view", "PORT", "Show it in the browser, see 'aoro-gym view'; 0: any free port. Default: no.")
]
PosesOption = Annotated[
    str | None,
    option("--poses", "HOST:PORT", "Send the poses of the machine's parts there, for a renderer. Default: nowhere."),
]
OutOption = Annotated[
    Path | None, option("--out -o", "FOLDER", "Write a log (.csv), events (.log) and results (.json) here.")
]
LogOption = Annotated[
    Path | None,
    option("--log", "FILE", "Log of all sensors and commands to write: .csv, .parquet, .mcap or .rosbag2 (a folder)."),
]


def serve(
    terrain: TerrainOption = None,
    ground: GroundOption = "raster",
    path: PathOption = None,
    track: TrackOption = None,
    start: StartOption = None,
    origin: OriginOption = None,
    host: HostOption = "127.0.0.1",
    udp_port: UdpOption = 47800,
    tcp_port: TcpOption = 47801,
    token: TokenOption = None,
    lock_step: LockStepOption = False,
    telemetry_rate: RateOption = 100,
    duration: DurationOption = None,
    fifo: FifoOption = None,
    spin: SpinOption = False,
    gps_loss: LossOption = None,
    ideal: IdealOption = False,
    view: ViewOption = None,
    poses: PosesOption = None,
    out: OutOption = None,
    log: LogOption = None,
    json_to: options.JsonOption = None,
    machine: options.MachineOption = options.MACHINE,
    set_: options.SetOption = None,
    scale: options.ScaleOption = None,
    laws: options.LawsOption = None,
    seed: options.SeedOption = 0,
    quiet: options.QuietOption = False,
) -> None:
    """Put a twin on sockets, so that a controller meets it as it meets the machine.

    Over TCP it sends NMEA 0183 (GGA, RMC, VTG, HDT) ten times a second, of two antennas on the front frame; over UDP the
    other sensors a hundred times a second, to whom said hello. Commands come back over UDP in volts, as binary records or as
    lines of JSON. Without a valid command for 200 ms the valves go to the middle and the brakes on; the next one is obeyed
    again.

    It runs in real time, with steps of 1 ms at absolute deadlines, or with --lock-step as far as clients grant. How late
    steps were is told at the end: an ordinary scheduler misses deadlines on a busy computer; --fifo 50 --spin help.

    [bold]Examples[/]

      aoro-gym serve
      aoro-gym serve --terrain scan.ply --path lap.gpx --seed 3 --out session
      aoro-gym serve --lock-step --telemetry-rate 20 --log session.mcap
      aoro-gym serve --terrain scan.ply --ground mesh --fifo 50 --spin --duration 60 --json -
      AORO_TOKEN=correct-horse-battery aoro-gym serve --host 0.0.0.0
    """
    with ExitStack() as held:
        with checking_input():
            from aoro_gym.cosimulation.server.report import Log
            from aoro_gym.cosimulation.server.server import Server, Settings
            from aoro_gym.twin import Twin

            check_start(path, start)
            check_track(path, track)
            _check_written(out, log)
            _check_fifo(fifo)
            run = options.run_spec(machine, set_, scale, "cpu", seed, laws=laws, ideal=ideal)
            chosen = options.load(run)
            settings = Settings(
                host=host, udp_port=udp_port, tcp_port=tcp_port, token=token, lock_step=lock_step, spin=spin,
                duration=math.inf if duration is None else duration, telemetry_rate=telemetry_rate,
                origin=_origin(origin), sensing=_sensing(ideal, gps_loss), seed=seed, poses=_address(poses),
            )  # fmt: skip
            land = load_ground(terrain)
            twin = Twin(machine=chosen, terrain=land, ground=ground, threads=1)
            line = None if path is None else load_line(path, track, bare(land))
            put(twin, chosen, line, start)
            page = None if view is None else held.enter_context(closing(_page(twin, ground, line, view)))
            _permit(fifo)  # after the page, which keeps an ordinary priority
            told = held.enter_context(closing(Log(out, _tell_event)))
            tick = {} if page is None else {"on_tick": page.publish}
            server = Server(
                twin, settings, path=line, on_event=told.event, on_log=told.row, recording=log is not None, **tick
            )
        _say_where(server)
        _run(server)
    _report(server, out, json_to, _write_log(server, log, run, terrain))
    _exit(server)


def _address(text: str | None) -> tuple[str, int] | None:
    """Host and port of --poses."""
    if text is None:
        return None
    host, _, port = text.rpartition(":")
    if not host or not port.isdecimal() or not 1 <= int(port) <= 65_535:
        raise ValueError(f"--poses is {text!r}, but must be HOST:PORT, such as 127.0.0.1:47900")
    return host.strip("[]"), int(port)


def _page(twin: Twin, ground: str, line: Line | None, port: int) -> MirrorPage:
    """A page of the twin in a process of its own, whose address is told."""
    from aoro_gym.checks import check_integer
    from aoro_gym.view.extras import viser
    from aoro_gym.view.mirror import MirrorPage

    viser()
    check_integer("--view", port, ge=0, le=65535)
    try:
        page = MirrorPage(twin, ground=ground, path=line, port=port)
    except OSError as error:
        raise OSError(error.errno, f"{error.strerror}".replace("port is", "--view is", 1)) from None
    typer.echo(f"view: {page.address}", err=True)
    return page


def _check_written(out: Path | None, log: Path | None) -> None:
    """ValueError unless results can be written."""
    from aoro_gym.cosimulation.server.report import RESULT
    from aoro_gym.simulation.log import check_log_path

    if log is not None:
        check_log_path(log)
    if out is not None:
        options.check_folder(out, RESULT)


def _exit(server: Server) -> None:
    """Leave with the code that the server's end earns."""
    if server.ended == "interrupted":
        interrupted("the twin stands still; the same command begins anew")
    if server.ended == "diverged":
        say_error(f"simulation diverged (non-finite state at t = {server.session.time:.3f} s)")
        raise typer.Exit(1)


def _sensing(ideal: bool, gps_loss: float | None) -> Sensing:
    """Errors of the sensors."""
    from aoro_gym.cosimulation.server.session import Sensing
    from aoro_gym.sensors import FixLoss, GpsNoise

    if ideal:
        return Sensing.ideal()
    return Sensing() if gps_loss is None else Sensing(gps=GpsNoise.typical(FixLoss(gps_loss)))


def _run(server: Server) -> None:
    """Serve until the end, or until a signal asks for it."""
    signal.signal(signal.SIGTERM, lambda *_: server.stop("terminated"))
    signal.signal(signal.SIGINT, lambda *_: server.stop("interrupted"))
    try:
        with running():
            server.run()
    finally:
        signal.signal(signal.SIGINT, signal.default_int_handler)


def _write_log(server: Server, log: Path | None, run: RunSpec, terrain: Path | None) -> list[Path]:
    """Write what the sensors showed, with a manifest; the files, none where no log is asked for or nothing was measured."""
    from aoro_gym.cosimulation.server.recorder import manifest

    recorder = server.recorder
    if log is None or recorder is None:
        return []
    with closing(recorder), running(), terminal.progress("writing the log"):
        if not len(recorder):
            terminal.warn(f"nothing was measured in {server.session.time:g} s: {log} is not written")
            return []
        return recorder.write(log, manifest(server.session.twin, run, terrain, server.session.time))


def _report(server: Server, out: Path | None, json_to: Path | None, logged: list[Path]) -> None:
    """Print and write what the server measured; the files of its log are ``logged``."""
    from aoro_gym.cosimulation.server.report import EVENTS, LOG, RESULT, tables
    from aoro_gym.execution.files import write_json

    result = server.to_json()
    written = list(logged)
    with running():
        if out is not None:
            write_json(out / RESULT, result)
            written += [out / LOG, out / EVENTS, out / RESULT]
    conclude(result, tables(result), written, json_to=json_to)


def _say_where(server: Server) -> None:
    """Where clients find the server, at once, on the standard error so that results can be piped."""
    settings, place = server.settings, server.geodesy.place(0.0, 0.0, 0.0)
    typer.echo(
        f"serving {'in lock-step' if settings.lock_step else 'in real time'}: udp {settings.host}:{server.link.port}"
        f" tcp {settings.host}:{server.publisher.port} session {server.link.session}"
        f" origin {place[0]:.7f},{place[1]:.7f},{place[2]:.2f}",
        err=True,
    )


def _tell_event(text: str) -> None:
    if not terminal.is_quiet():
        typer.echo(text, err=True)


def _check_fifo(priority: int | None) -> None:
    """ValueError for what is no priority."""
    from aoro_gym.checks import check_integer

    if priority is not None:
        check_integer("--fifo", priority, ge=1, le=99)


def _permit(priority: int | None) -> None:
    """Ask for FIFO priority, if any is wanted."""
    from aoro_gym.cosimulation.realtime import NotPermitted, request_realtime

    if priority is None:
        return
    try:
        request_realtime(priority)
    except NotPermitted as error:
        fail(ValueError(f"--fifo {priority}: {error}"), 2)


def _origin(text: str | None) -> Origin:
    from aoro_gym.cosimulation.server.geodesy import Origin

    if text is None:
        return Origin()
    try:
        numbers = [float(part) for part in text.split(",")]
        if len(numbers) not in (2, 3):
            raise ValueError
    except ValueError:
        raise ValueError(
            f"--origin is {text!r}, but must be LAT,LON or LAT,LON,HEIGHT, such as 66.5,25.7,100"
        ) from None
    return Origin(*numbers)
