"""Command that shows machines in the browser."""

from __future__ import annotations

import webbrowser
from collections.abc import Callable
from contextlib import nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from aoro_gym.cli import options
from aoro_gym.cli.options import option
from aoro_gym.cli.outcome import checking_input, conclude, interrupted
from aoro_gym.cli.place import (
    GroundOption,
    SoilOption,
    StartOption,
    TerrainOption,
    TrackOption,
    WorldOption,
    bare,
    check_one_ground,
    check_start,
    check_track,
    load_ground,
    load_line,
    load_soil,
    put,
)
from aoro_gym.reporting import terminal
from aoro_gym.reporting.display import has_display

if TYPE_CHECKING:
    from aoro_gym.machine import Machine
    from aoro_gym.terrains import Path as Line
    from aoro_gym.terrains import Plane, Terrain
    from aoro_gym.terrains.soil import Soil
    from aoro_gym.terrains.world.world import World
    from aoro_gym.view.live import LiveTwins
    from aoro_gym.view.replay import Replay

PORT = 8080
PathOption = Annotated[Path | None, option("--path", "FILE", "A path (GPX, CSV, ...) that is shown; starts on it.")]
PortOption = Annotated[int, option("--port", "N", "Port of the page on 127.0.0.1; 0: any free one.")]
GamepadOption = Annotated[
    Path | None, option("--gamepad", "FILE", "Drive by this gamepad, too, such as /dev/input/js0 (Linux).")
]
LidarOption = Annotated[
    str | None, option("--lidar", "MODEL", "Show what a lidar sees: vlp-16, os1-64, os1-128 or mid-360. Default: none.")
]
CameraOption = Annotated[
    str | None,
    option(
        "--camera", "MODEL", "Show what a camera sees: stereo, stereo-wide, stereo-rolling or stereo-hd. Default: none."
    ),
]
NoBrowserOption = Annotated[bool, option("--no-browser", None, "Open no browser; the address is told.")]
LogsArgument = Annotated[
    list[Path] | None, options.argument("[LOG]...", "Logs to show again, one machine each, instead of a live twin.")
]
PolicyOption = Annotated[
    list[str] | None,
    option("--policy", "NAME|FILE", "Let a controller or a policy drive episodes. Repeatable: side by side."),
]
EnvOption = Annotated[
    str | None, option("--env", "ID", f"Environment whose episodes they drive. Default: {options.TRACKING}.")
]
CraneOption = Annotated[bool, option("--crane", None, "Cranes on the front frames, whose four sections have sliders.")]
MachinesOption = Annotated[
    list[str] | None,
    option("--machine", "NAME|FILE", "Bundled machine, or a machine file. Repeatable: side by side. Default: aoro."),
]


def view(
    logs: LogsArgument = None,
    machine: MachinesOption = None,
    terrain: TerrainOption = None,
    world: WorldOption = None,
    ground: GroundOption = "raster",
    soil: SoilOption = None,
    crane: CraneOption = False,
    path: PathOption = None,
    track: TrackOption = None,
    start: StartOption = None,
    policy: PolicyOption = None,
    env: EnvOption = None,
    gamepad: GamepadOption = None,
    lidar: LidarOption = None,
    camera: CameraOption = None,
    port: PortOption = PORT,
    no_browser: NoBrowserOption = False,
    set_: options.SetOption = None,
    scale: options.ScaleOption = None,
    laws: options.LawsOption = None,
    seed: options.SeedOption = 0,
    json_to: options.JsonOption = None,
    quiet: options.QuietOption = False,
) -> None:
    """See a twin move in the browser, in real time, and drive it.

    The machine in its real proportions on its ground, forces of the ground on the tires, pressures, angles and wheel loads.
    Sliders and keys drive it: W S forward and back, A D left and right, X stops, C steers straight, space pauses, N is a
    single step; --gamepad drives, too. Several --machine stand in one place and obey the same commands.

    With LOGs it shows these again, side by side on one clock with a slider. Logs of the simulator hold the pose; of others,
    the joint and the wheels move and the machine stays in its place.

    On --soil the wheels sink in, and their ruts are drawn.

    In a --world trees, stumps, boulders and logs push back. It starts at --start, by default at the free place nearest to
    the middle.

    With --policy it shows episodes of an environment that controllers or policies drive, from --seed on; --terrain or
    --world and --path say where.

    --lidar shows the points that a lidar on the first machine gets of the ground, and of what stands there; --camera what
    the left one of its stereo cameras sees, and how far away that is, up to four times a second.

    The page is for this computer alone (127.0.0.1). Ctrl-C ends it.

    [bold]Examples[/]

      aoro-gym view
      aoro-gym view --terrain scan.ply --path lap.gpx --gamepad /dev/input/js0
      aoro-gym view before.csv after.csv
      aoro-gym view --world forest --lidar os1-64 --camera stereo
      aoro-gym view --soil peat --crane
      aoro-gym view --policy preview --policy stanley
      aoro-gym view --machine aoro --machine mine.toml
      aoro-gym view --set joint.compliance=1e-8 --no-browser --port 8090
    """
    with checking_input():
        from aoro_gym.view.extras import viser

        viser()
        check_track(path, track)
        _check_together(logs, machine, path, start, policy)
        _check_sensors({"--lidar": lidar, "--camera": camera}, policy)
        _check_used(policy, env, logs, start, {"--soil": soil, "--crane": crane or None})
        check_one_ground(terrain, world)
        _check_gamepad(gamepad, logs, policy)
        names = machine or [options.MACHINE]
        machines = [options.load(options.run_spec(name, set_, scale, "cpu", seed, laws=laws)) for name in names]
        if policy:
            page, run = _driven_by(policy, env, machines[0], (world or terrain, path, track), seed, port)
        else:
            land = load_ground(terrain, world)
            line = None if path is None else load_line(path, track, bare(land))
            names = [log.stem for log in logs] if logs else names
            made_of = load_soil(soil, world)
            twins = _replay(logs, machines) if logs else _twins(machines, land, (ground, made_of, crane), line, start)
            page, run = _driven_by_hand(twins, names, (land, line, terrain), gamepad, (lidar, camera), port)
    _serve(page, run, no_browser, json_to)


def _check_together(
    logs: list[Path] | None,
    machines: list[str] | None,
    path: Path | None,
    start: tuple[float, float, float] | None,
    policies: list[str] | None,
) -> None:
    """ValueError for options that contradict each other; named as the command names them."""
    check_start(path, start)
    if policies and logs:
        raise ValueError("--policy drives a live twin, but a LOG is shown again; drop one of them")
    if policies and start is not None:
        raise ValueError("--policy drives episodes, which have their own start; drop --start")
    if policies and len(machines or []) > 1:
        raise ValueError("--machine is given several times, but policies drive one; give it once")


def _check_sensors(sensors: dict[str, str | None], policies: list[str] | None) -> None:
    """ValueError for models, by their options, that there are not, or that nobody carries."""
    from importlib import import_module

    from aoro_gym.checks import check_choice

    for name, model in sensors.items():
        if model is None:
            continue
        check_choice(name, model, import_module(f"aoro_gym.sensors.{name.lstrip('-')}").MODELS)
        if policies:
            raise ValueError(f"{name} is on a live twin or on the machine of a LOG; drop --policy")


def _check_used(
    policies: list[str] | None,
    env: str | None,
    logs: list[Path] | None,
    start: tuple[float, float, float] | None,
    live: dict[str, str | bool | None],
) -> None:
    """ValueError for options that would do nothing; ``live``: those of a live twin, by their names."""
    for name, value in live.items():
        if value is not None and (logs or policies):
            said = name if value is True else f"{name} {value}"
            raise ValueError(f"{said} is that of a live twin, but a LOG or episodes are shown; drop one of them")
    if env is not None and not policies:
        raise ValueError(f"--env {env} has episodes that policies drive; name one with --policy, or drop --env")
    if logs and start is not None:
        raise ValueError("--start is a live twin's, but a LOG is shown again; drop one of them")


def _check_gamepad(gamepad: Path | None, logs: list[Path] | None, policies: list[str] | None) -> None:
    """ValueError for a gamepad that drives nothing, or is none."""
    from glob import glob

    from aoro_gym.view.gamepad import DEVICES

    if gamepad is None:
        return
    if logs or policies:
        shown = "a LOG is" if logs else "episodes are"
        raise ValueError(f"--gamepad drives a live twin, but {shown} shown; drop one of them")
    if not gamepad.exists():
        there = ", ".join(sorted(glob(DEVICES))) or f"none ({DEVICES})"
        raise ValueError(f"--gamepad {gamepad} does not exist; there are: {there}")


def _driven_by_hand(
    twins: LiveTwins | Replay,
    names: list[str],
    place: tuple[Terrain | Plane | World, Line | None, Path | None],
    gamepad: Path | None,
    sensors: tuple[str | None, str | None],
    port: int,
) -> tuple[Any, Callable[[], None]]:
    """A server whose page has the place, and what keeps it up to date.

    Args:
        twins: Live ones or a replay.
        names: Of the machines.
        place: Ground and path, and the ground's file.
        gamepad: File of one, if any.
        sensors: Models of a lidar and of a camera, if any.
        port: Of the page.
    """
    from aoro_gym.terrains import Terrain
    from aoro_gym.terrains.colours import scan_colours
    from aoro_gym.view.camera_picture import CameraPicture
    from aoro_gym.view.lidar_cloud import LidarCloud
    from aoro_gym.view.live_view import LiveView
    from aoro_gym.view.server import start

    (land, line, file), (lidar, camera) = place, sensors
    server = start(port)
    cloud = None if lidar is None else LidarCloud(server, land, lidar)
    with terminal.progress("a camera's first picture") if camera else nullcontext():
        picture = None if camera is None else CameraPicture(server, land, camera)
    colours = None if file is None or not isinstance(land, Terrain) else scan_colours(file, land)
    twins.forces()  # says so where their kernel is compiled first
    shown = LiveView(server, twins, names, gamepad=gamepad, lidar=cloud, camera=picture)
    shown.page.surround(land, line, colours)
    return server, shown.run


def _driven_by(
    policies: list[str],
    env: str | None,
    machine: Machine,
    place: tuple[Path | None, Path | None, str | None],
    seed: int,
    port: int,
) -> tuple[Any, Callable[[], None]]:
    """A page of episodes under policies, and what drives them; ``place``: files of ground and path, and its track."""
    from aoro_gym.agents.evaluation.selection import named_policies
    from aoro_gym.agents.evaluation.watching import WatchedEpisodes
    from aoro_gym.cli.courses import load_courses
    from aoro_gym.envs.core.rendering import surroundings
    from aoro_gym.envs.path_tracking.course_files import CourseFiles
    from aoro_gym.view.page import page_of

    env = env or options.TRACKING
    makers = named_policies(env, policies)
    terrain, path, track = place
    courses = load_courses(CourseFiles(env, terrain, path, track=track))
    episodes = WatchedEpisodes(env, makers, machine=machine, courses=courses, seed=seed)
    task, twin = episodes.env.task, episodes.env.twin
    page = page_of(twin, episodes.names, port)

    def run() -> None:
        while True:
            page.surround(*surroundings(task, twin))
            page.show(task.control_step)
            episodes.step()

    return page.server, run


def _replay(logs: list[Path], machines: list[Machine]) -> Replay:
    """The logs, each with its machine, or with the one that there is."""
    from aoro_gym.view.replay import Recording, Replay, log_channels

    if len(machines) not in (1, len(logs)):
        raise ValueError(
            f"--machine is given {len(machines)} times, but must be given once, or once for each of the logs"
        )
    of = machines * len(logs) if len(machines) == 1 else machines
    return Replay([Recording(one, *log_channels(log)) for one, log in zip(of, logs, strict=True)])


def _twins(
    machines: list[Machine],
    land: Terrain | Plane | World,
    felt: tuple[str, Soil | None, bool],
    line: Line | None,
    start: tuple[float, float, float] | None,
) -> LiveTwins:
    """Twins of all machines at their start; ``felt``: how they feel the ``land``, what it is made of, and whether they have
    cranes."""
    from aoro_gym.twin import Twin
    from aoro_gym.view.live import LiveTwins

    count = len(machines)
    chooses = any(not one.laws.default for one in machines)
    twin = Twin(
        count,
        machine=machines[0],
        terrain=land,
        ground=felt[0],
        soil=felt[1],
        crane=felt[2],
        own_machines=True,
        carry_load=any(one.loaded for one in machines),
        choose_laws=chooses,
        threads=1,
    )
    for i, one in enumerate(machines):
        twin.set_machines([i], one)

    def begin() -> None:
        put(twin, machines[0], line, start)

    begin()
    return LiveTwins(twin, machines, begin=begin)


def _serve(page: Any, run: Callable[[], None], no_browser: bool, json_to: Path | None) -> None:
    """Tell where the page is and keep it up to date until Ctrl-C."""
    from aoro_gym.view.server import stop

    try:
        _say_where(page, no_browser, json_to)
        run()
    except KeyboardInterrupt:
        stop(page)
        interrupted("the page is closed; the same command begins anew")


def _say_where(server: Any, no_browser: bool, json_to: Path | None) -> None:
    """Tell the address, and open it."""
    address = f"http://127.0.0.1:{server.get_port()}"
    if json_to is not None:
        conclude({"address": address, "port": server.get_port()}, json_to=json_to)
    if not terminal.is_quiet():
        typer.echo(f"view: {address} (Ctrl-C ends it)", err=True)
    if not no_browser and has_display():
        webbrowser.open(address)
