"""Command that parts the machine at its hubs: driveline in one process, bodies in another."""

from __future__ import annotations

from contextlib import nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from aoro_gym.cli import options
from aoro_gym.cli.options import option
from aoro_gym.cli.outcome import checking_input, conclude, running, say_error
from aoro_gym.reporting import terminal

if TYPE_CHECKING:
    from aoro_gym.cosimulation.laboratory.run import Outcome

DrivelineOption = Annotated[
    bool, option("--driveline", None, "Be the driveline: answer on a UDP socket until interrupted.")
]
ConnectOption = Annotated[
    str | None, option("--connect", "HOST:PORT", "Where a driveline answers. Default: one of its own is started.")
]
HostOption = Annotated[str, option("--host", "ADDRESS", "Address that a driveline binds to.")]
PortOption = Annotated[int, option("--port", "N", "Port that a driveline binds to; 0: any free one, which is printed.")]
TokenOption = Annotated[
    str | None, option("--token", "TEXT", "Secret of both sides; needed to bind to more than this computer.")
]
ManoeuvreOption = Annotated[str, option("--manoeuvre -m", "drive|turn|kerb|park", "What is driven.")]
PeriodOption = Annotated[int, option("--period", "MS", "Time between two exchanges, whole milliseconds.")]
DelayOption = Annotated[float, option("--delay", "MS", "Simulated round trip, a whole number of periods.")]
JitterOption = Annotated[float, option("--jitter", "MS", "Delay that comes and goes on top, both ways together.")]
LossOption = Annotated[float, option("--loss", "SHARE", "Of packets that are lost each way, 0 to 1.")]
InertiaOption = Annotated[
    float, option("--hub-inertia", "KG_M2", "Inertia that turns with a hub, on the driveline's side.")
]
TorqueOption = Annotated[float, option("--limit-torque", "N_M", "Torque at a hub beyond which both sides stop.")]
SpeedOption = Annotated[float, option("--limit-speed", "RAD_PER_S", "Wheel rate beyond which both sides stop.")]
SoftStartOption = Annotated[float, option("--soft-start", "S", "Time over which torques and set-points come up.")]
SilenceOption = Annotated[
    float, option("--limit-silence", "MS", "Time without a demand after which a driveline stops.")
]


def laboratory(
    manoeuvre: ManoeuvreOption = "drive",
    driveline: DrivelineOption = False,
    connect: ConnectOption = None,
    host: HostOption = "127.0.0.1",
    port: PortOption = 0,
    token: TokenOption = None,
    period: PeriodOption = 1,
    delay: DelayOption = 0.0,
    jitter: JitterOption = 0.0,
    loss: LossOption = 0.0,
    hub_inertia: InertiaOption = 4.0,
    limit_torque: TorqueOption = 20_000.0,
    limit_speed: SpeedOption = 12.0,
    limit_silence: SilenceOption = 100.0,
    soft_start: SoftStartOption = 0.0,
    machine: options.MachineOption = options.MACHINE,
    out: options.FolderOption = Path("laboratory"),
    seed: options.SeedOption = 0,
    json_to: options.JsonOption = None,
    quiet: options.QuietOption = False,
) -> None:
    """Vehicle in the loop: the driveline in a process of its own, bodies, tires and steering here.

    The machine is parted at the flanges between hubs and wheels. Once a period the wheels' rates go to the driveline as
    set-points, and the torques at the flanges come back, as between dynamometers and the twin. The run is in lock-step, so
    that its result does not depend on how busy the computer is; a delay is simulated. It is compared with the whole twin.

    [bold]Examples[/]

      aoro-gym laboratory --manoeuvre turn
      aoro-gym laboratory --manoeuvre park --delay 2 --jitter 1 --loss 0.01
      aoro-gym laboratory --driveline --port 5005
      aoro-gym laboratory --manoeuvre kerb --connect 127.0.0.1:5005 --out kerb
    """
    with checking_input():
        from aoro_gym.checks import check_choice, check_integer, check_range
        from aoro_gym.cosimulation.laboratory.manoeuvres import MANOEUVRES
        from aoro_gym.cosimulation.laboratory.protection import Limits
        from aoro_gym.cosimulation.laboratory.run import Line, driveline_process, run, write

        check_choice("--manoeuvre", manoeuvre, MANOEUVRES)
        check_integer("--period", period, ge=1, le=1000)
        check_range("--limit-torque", limit_torque, "N m", gt=0.0)
        check_range("--limit-speed", limit_speed, "rad/s", gt=0.0)
        check_range("--limit-silence", limit_silence, "ms", gt=0.0)
        check_range("--soft-start", soft_start, "s", ge=0.0)
        check_range("--hub-inertia", hub_inertia, "kg m²", ge=0.0)
        for name, value in (("--delay", delay), ("--jitter", jitter)):
            check_range(name, value, "ms", ge=0.0)
        limits = Limits(torque=limit_torque, speed=limit_speed, soft_start=soft_start, silence=1e-3 * limit_silence)
        secret = None if token is None else token.encode()
        if host != "127.0.0.1" and secret is None:
            raise ValueError(f"--host is {host}, which others may reach; give --token, or take 127.0.0.1")
        loaded = options.load_machine(machine)
        place = None if connect is None else _address(connect)
        line = Line(1e-3 * delay, 1e-3 * jitter, loss, seed)
    if driveline:
        _be_driveline(machine, hub_inertia, (host, port), limits, secret, json_to)
        return
    with running(), checking_input():
        of_its_own = driveline_process(machine, hub_inertia) if place is None else nullcontext(place)
        with of_its_own as address, terminal.progress("laboratory") as tell:
            found = run(
                loaded, manoeuvre, address, steps=period, line=line, limits=limits, token=secret if connect else None,
                hub_inertia=hub_inertia, done=tell,
            )  # fmt: skip
    with running():
        file = write(found, out)
    if found.reason:
        say_error(f"the laboratory stopped: {found.reason}")
    conclude(file, [] if found.reason else [_table(found)], [file], json_to=json_to)
    if found.reason:
        raise typer.Exit(1)


def _address(text: str) -> tuple[str, int]:
    host, _, port = text.rpartition(":")
    if not host or not port.isdigit():
        raise ValueError(f"--connect is {text!r}, but must be HOST:PORT, such as 127.0.0.1:5005")
    return host, int(port)


def _be_driveline(
    machine: str,
    hub_inertia: float,
    place: tuple[str, int],
    limits: object,
    token: bytes | None,
    json_to: Path | None,
) -> None:
    """Answer until interrupted, and tell where.

    Args:
        machine: Name or file.
        hub_inertia: Inertia that turns with a hub [kg m²].
        place: Host and port.
        limits: Beyond which it stops.
        token: Secret of both sides.
        json_to: Value of --json.
    """
    from aoro_gym.cosimulation.laboratory.process import DrivelineProcess
    from aoro_gym.cosimulation.laboratory.protection import Limits
    from aoro_gym.cosimulation.laboratory.run import LISTENING
    from aoro_gym.twin.driveline import Driveline

    with checking_input():
        assert isinstance(limits, Limits)
        note = _ignore if terminal.is_quiet() else _say
        process = DrivelineProcess(
            Driveline(machine=machine, hub_inertia=hub_inertia),
            host=place[0], port=place[1], limits=limits, token=token, say=_say, note=note,
        )  # fmt: skip
    found, port = process.address[:2]
    conclude({"host": found, "port": port}, [f"{LISTENING}{found}:{port}"], json_to=json_to, highlight=False)
    try:
        process.run()
    finally:
        process.close()


def _ignore(text: str) -> None:
    pass


def _say(text: str) -> None:
    typer.echo(text, err=True)


def _table(found: Outcome) -> terminal.Comparison:
    """Differences to the whole twin."""
    rows = [[one.channel, f"{100.0 * one.rms:.3f}", f"{100.0 * one.largest:.3f}"] for one in found.differences]
    trips = ", ".join(f"{name} {value:.0f} µs" for name, value in found.round_trip_us.items())
    return terminal.Comparison(
        f"{found.manoeuvre}: difference to the whole twin",
        ["channel", "rms [% of range]", "largest [% of range]"],
        rows,
        note=f"round trip of the sockets: {trips}",
    )
