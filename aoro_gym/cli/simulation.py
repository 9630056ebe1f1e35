"""Command that simulates one manoeuvre."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from aoro_gym.cli import options
from aoro_gym.cli.options import option
from aoro_gym.cli.outcome import checking_input, conclude, running
from aoro_gym.cli.place import (
    CranePoseOption,
    SoilOption,
    StartOption,
    WorldOption,
    load_ground,
    load_soil,
    posed_crane,
)
from aoro_gym.reporting import terminal

if TYPE_CHECKING:
    from aoro_gym.machine.vehicle_crane import VehicleCrane
    from aoro_gym.simulation.manoeuvres import Manoeuvre
    from aoro_gym.simulation.plots import Section
    from aoro_gym.terrains import Plane
    from aoro_gym.terrains.world.world import World
    from aoro_gym.twin import Twin

ManoeuvreOption = Annotated[
    str, option("--manoeuvre -m", "left|right|drive|crane|FILE.csv", "What the machine is told to do.")
]
LogOption = Annotated[
    Path, option("--out -o", "LOG", "Log to write, .csv, .parquet, .mcap or .rosbag2 (a folder); plots go beside it.")
]
SignalOption = Annotated[
    float | None, option("--signal", "PERCENT", "Share of the full signal; 100, or 50 to drive, 60 of the crane.")
]
DurationOption = Annotated[
    float | None,
    option("--duration", "S", "Simulated time. Default: 0.7 s past a turn's stop, 6 s of drive, a file's end."),
]
StartAngleOption = Annotated[float | None, option("--start-angle", "DEG", "Joint angle at the start of a FILE; 0.")]
OF_A_PLANE = {
    "slope_deg": "--terrain-slope",
    "direction_deg": "--terrain-direction",
    "friction": "--terrain-friction",
    "rolling_resistance": "--terrain-rolling",
}
"""Options by what a plane calls them."""
SlopeOption = Annotated[float, option("--terrain-slope", "DEG", "Slope of the ground.")]
SlopeDirectionOption = Annotated[
    float, option("--terrain-direction", "DEG", "Direction of ascent, counter-clockwise from ahead.")
]
FrictionOption = Annotated[float, option("--terrain-friction", "FACTOR", "Tire friction against dry asphalt.")]
RollingOption = Annotated[float, option("--terrain-rolling", "FACTOR", "Rolling resistance against asphalt.")]
CraneOption = Annotated[
    bool,
    option("--crane", None, "A crane on the front frame whose joints move; there by itself where it is told to move."),
]
HeldOption = Annotated[
    tuple[float, float, float] | None,
    option("--held", "KG M M", "Log in the crane's grapple: mass, length, diameter."),
]
IdealOption = Annotated[
    bool, option("--ideal-sensors", None, "Measured columns without noise, zero error and quantiser.")
]


def simulate(
    manoeuvre: ManoeuvreOption,
    out: LogOption = Path("log.csv"),
    signal: SignalOption = None,
    duration: DurationOption = None,
    start_angle: StartAngleOption = None,
    slope: SlopeOption = 0.0,
    slope_direction: SlopeDirectionOption = 0.0,
    friction: FrictionOption = 1.0,
    rolling: RollingOption = 1.0,
    soil: SoilOption = None,
    world: WorldOption = None,
    start: StartOption = None,
    crane: CraneOption = False,
    crane_pose: CranePoseOption = None,
    held: HeldOption = None,
    ideal: IdealOption = False,
    machine: options.MachineOption = options.MACHINE,
    set_: options.SetOption = None,
    scale: options.ScaleOption = None,
    laws: options.LawsOption = None,
    device: options.DeviceOption = "cpu",
    seed: options.SeedOption = 0,
    json_to: options.JsonOption = None,
    quiet: options.QuietOption = False,
) -> None:
    """Run one manoeuvre and write its log, plots and key figures.

    left and right are full turns from the opposite stop; drive goes straight on; crane moves its sections in turn, then all
    at once. Each begins with 0.6 s of standstill. A FILE.csv has the column time_s and one or more of steering_signal (or
    steering_signal_V), drive_signal, arm_fl ... arm_rr, traction_fl ... traction_rr, gear, parking_brake, crane_slew,
    crane_lift, crane_fold, crane_telescope, crane_held_mass_kg; a row holds until the next. A log is one, too.

    LOG.csv gets measured columns at 100 Hz, joint angle and pressures with the noise of their sensors (drawn by --seed),
    and the simulator's exact state as true_*. Beside it come LOG.toml (how it was made), LOG.json (key figures, without
    noise), LOG.png and LOG.html (plots).

    In a --world what is solid pushes back: stems stop the machine, tires climb logs or do not. The log gets the forces
    and numbers of the objects, a table tells what was touched. It starts at --start, by default at the free place
    nearest to the middle.

    On --soil wheels sink in, and the next ones in their ruts sink less. clay:0.3 has 30 % of water by dry mass, +passes is
    for ruts that deepen with every wheel. The log gets sinkages, ruts and the soil's resistance, LOG_ruts.png shows them.
    With a --crane it gets joints, rates, pressures and load cell; nothing has validated its figures.

    [bold]Examples[/]

      aoro-gym simulate --manoeuvre left --out turn.csv
      aoro-gym simulate --manoeuvre drive --signal 40 --duration 8 --terrain-slope 5 --out hill.csv
      aoro-gym simulate --manoeuvre left --scale steering.valve.spool_time_constant=5 --out slow_spool.csv
      aoro-gym simulate --manoeuvre left --laws library --out library.csv
      aoro-gym simulate --manoeuvre drive --world forest --start -10 14 225 --duration 20 --out stopped.csv
      aoro-gym simulate --manoeuvre drive --soil peat --duration 12 --out mire.csv
      aoro-gym simulate --manoeuvre crane --held 180 4 0.26 --out crane.csv
      aoro-gym simulate --manoeuvre my_commands.csv --start-angle 10 --out mine.csv
    """
    with checking_input():
        from aoro_gym.simulation import output
        from aoro_gym.simulation.named import named_manoeuvre
        from aoro_gym.twin import Twin

        output.check_output(out, manoeuvre)
        run = options.run_spec(machine, set_, scale, device, seed, laws=laws, ideal=ideal)
        chosen = options.load(run)
        made_of = load_soil(soil, world, device)
        terrain = _ground(world, slope, slope_direction, friction, rolling)
        place = _place(terrain, start)
        plan = named_manoeuvre(
            manoeuvre, chosen, signal=signal, duration=duration, start_angle=start_angle, warn=terminal.warn
        )
        plan, carried = _with_crane(plan, crane, crane_pose, held, device)
        twin = Twin(machine=chosen, terrain=terrain, soil=made_of, crane=carried, device=device)
        if world is not None:
            twin.set_ground([0], friction=friction, rolling_resistance=rolling)
        twin.reset(position=place[:2], heading=place[2], joint_angle=plan.start_angle)
        twin.step(duration=twin.main_step)  # says so where kernels are compiled first
    section = simulated(twin, plan, place)
    with running():
        written = output.write(section, twin, out, run)
    conclude(out.with_suffix(".json"), _tables(section, twin), written, json_to=json_to)


def _with_crane(
    plan: Manoeuvre,
    wanted: bool,
    pose: tuple[float, float, float, float] | None,
    held: tuple[float, float, float] | None,
    device: str,
) -> tuple[Manoeuvre, VehicleCrane | bool]:
    """The ``plan`` with a log that is ``held``, and the crane of the twin: none where neither plan nor option asks for one.

    Args:
        plan: What is to be done.
        wanted: Value of --crane.
        pose: Of --crane-pose [deg, deg, deg, m].
        held: Of --held [kg, m, m].
        device: Of --device.
    """
    from aoro_gym.execution.device_names import SIMD
    from aoro_gym.machine.vehicle_crane import VehicleCrane
    from aoro_gym.simulation.manoeuvres import holding

    plan = plan if held is None else holding(plan, *held)
    if not (wanted or pose is not None or plan.moves_crane):
        return plan, False
    if device == SIMD:
        raise ValueError(f"--device is {SIMD}, where twins have no crane; take cpu")
    carried = VehicleCrane(start=plan.crane_pose) if pose is None else posed_crane(pose)
    if held is not None:
        _check_above_ground(carried, diameter=held[2])
    return plan, carried


def _check_above_ground(crane: VehicleCrane, diameter: float) -> None:
    """Refuse a log of a ``diameter`` [m] that would begin in the level ground, which would throw the machine up."""
    from aoro_gym.machine.vehicle_crane import GRAPPLE_DROP

    deep = GRAPPLE_DROP + 0.5 * diameter - float(crane.tip(crane.start_joints)[2])
    if deep > 0.0:
        raise ValueError(
            f"--held: a log {diameter:g} m thick would begin {deep:.2f} m in the ground, as the crane stands; unfold "
            "it, for example by --crane-pose 0 35 -100 0"
        )


def _tables(section: Section, twin: Twin) -> list[Any]:
    """What is shown of a recording: key figures, and what the machine touched or pressed."""
    from aoro_gym.simulation import output
    from aoro_gym.simulation.contacts import contact_table
    from aoro_gym.simulation.ruts import rut_figures, rut_table
    from aoro_gym.terrains.world.world import World

    shown: list[Any] = [output.figure_table(section)]
    if section.recording.manoeuvre.turn and section.figures["turn_time_s"] is None:
        shown.append("The turn did not reach its stop, so it has no key figures; a longer --duration may help.")
    if isinstance(twin.terrain, World):
        shown.append(contact_table(output.touched(section.recording, twin)))
    if twin.soil is not None:
        shown.append(rut_table(rut_figures(twin.rut_raster())))
    return shown


def simulated(twin: Twin, manoeuvre: Manoeuvre, place: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> Section:
    """Recording of a manoeuvre from a ``place`` (x, y [m], heading [rad]) with its key figures, under a progress bar."""
    from aoro_gym.simulation import output

    with terminal.progress(manoeuvre.title) as tell, running():
        return output.simulate(twin, manoeuvre, tell, place)


def _ground(folder: Path | None, slope: float, direction: float, friction: float, rolling: float) -> Plane | World:
    """The world of a folder, or the plane that options describe.

    Args:
        folder: Value of --world.
        slope: Of --terrain-slope [deg].
        direction: Of --terrain-direction [deg].
        friction: Of --terrain-friction; in a world, on top of its own.
        rolling: Of --terrain-rolling, likewise.
    """
    from aoro_gym.terrains import Plane
    from aoro_gym.terrains.world.world import World

    try:
        plane = Plane(slope_deg=slope, direction_deg=direction, friction=friction, rolling_resistance=rolling)
    except ValueError as error:
        name, _, rest = str(error).removeprefix("terrain ").partition(" ")
        raise ValueError(f"{OF_A_PLANE.get(name, name)} {rest}") from None
    if folder is None:
        return plane
    if slope or direction:
        raise ValueError(
            f"--terrain-slope {slope:g} is that of a plane, but --world {folder} has its own ground; drop one"
        )
    ground = load_ground(None, folder)
    assert isinstance(ground, World)
    return ground


def _place(ground: Plane | World, start: tuple[float, float, float] | None) -> tuple[float, float, float]:
    """x, y [m] and heading [rad] of a start (heading in degrees); by default the origin, or in a world the free place
    nearest to its middle."""
    from aoro_gym.checks import check_finite, check_range
    from aoro_gym.terrains import Plane
    from aoro_gym.terrains.world.places import free_place

    if start is None:
        return (0.0, 0.0, 0.0) if isinstance(ground, Plane) else free_place(ground)
    check_finite("--start", start)
    if not isinstance(ground, Plane):
        low, high = ground.terrain.extent
        for i, axis in enumerate("xy"):
            check_range(f"--start {axis}", start[i], "m", ge=float(low[i]), le=float(high[i]), note=", on the ground")
    return start[0], start[1], math.radians(start[2])
