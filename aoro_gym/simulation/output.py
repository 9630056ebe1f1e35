"""Files of a simulated manoeuvre: log, manifest, key figures and plots."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from aoro_gym.execution.files import with_nulls, write_json
from aoro_gym.machine.specification import RunSpec
from aoro_gym.recording.commands import JOINTS
from aoro_gym.reporting.page import describe, show
from aoro_gym.reporting.terminal import Comparison
from aoro_gym.simulation.contacts import contacts
from aoro_gym.simulation.key_figures import recording_figures
from aoro_gym.simulation.log import CRANE_NOISY, IDEAL, NOISY, check_log_path, log_columns, write_log
from aoro_gym.simulation.manoeuvres import Manoeuvre, Trajectory, run
from aoro_gym.simulation.plots import Section, write_html, write_png
from aoro_gym.simulation.ruts import rut_figures, write_ruts
from aoro_gym.terrains import Plane
from aoro_gym.terrains.world.world import World
from aoro_gym.twin import Twin
from aoro_gym.version import VERSION

LONG = 120.0
"""Duration [s] from which a recording keeps every 10 ms instead of every 1 ms."""


def check_output(out: Path, manoeuvre: str) -> None:
    """ValueError unless a log can be written to ``out``, beside a ``manoeuvre`` that may be a command file."""
    check_log_path(out)
    path = Path(manoeuvre)
    if path.suffix in (".csv", ".parquet") and path.with_suffix("").resolve() == out.with_suffix("").resolve():
        raise ValueError(f"--out {out} would overwrite the commands in {path}; choose another name")


def simulate(
    twin: Twin,
    manoeuvre: Manoeuvre,
    progress: Callable[[str, float], Any],
    start: tuple[float, float, float] = (0.0, 0.0, 0.0),
) -> Section:
    """Trajectory of a manoeuvre from ``start`` (x, y [m], heading [rad]) with its key figures.

    Raises SimulationDiverged if the state is no longer finite.
    """
    recording = run(
        twin,
        manoeuvre,
        start=start,
        keep_every=1e-3 if manoeuvre.duration <= LONG else 1e-2,
        progress=lambda now: progress(manoeuvre.title, now / manoeuvre.duration),
    )
    return Section(recording, recording_figures(recording, twin.machine.steering.cylinder))


def write(section: Section, twin: Twin, out: Path, spec: RunSpec, *, page: bool = True) -> list[Path]:
    """Write log, manifest, key figures and plots, and return their paths.

    Args:
        section: Trajectory and key figures.
        twin: Twin that was recorded, on a plane or in a world.
        out: Log, as :func:`~aoro_gym.simulation.log.write_log`; the other files stand beside it.
        spec: Machine, device and seed of the run.
        page: Whether to write an HTML page, too.
    """
    about = manifest(section.recording, twin, spec)
    rng = None if spec.ideal else np.random.default_rng(spec.seed)
    written = write_log(out, log_columns(section.recording.time, section.recording.channels, rng=rng), about)
    results: dict[str, Any] = {**about, "figures": dict(section.figures)}
    if isinstance(twin.terrain, World):
        results["contacts"] = touched(section.recording, twin)
    if twin.soil is not None:
        ruts = twin.rut_raster()
        results["ruts"] = rut_figures(ruts)
        written.append(out.with_name(f"{out.stem}_ruts.png"))
        write_ruts(written[-1], ruts, section.recording, twin.soil.name.replace("_", " "))
    write_json(out.with_suffix(".json"), with_nulls(results))
    write_png(out.with_suffix(".png"), section)
    written += [out.with_suffix(".json"), out.with_suffix(".png")]
    if page:
        written.append(out.with_suffix(".html"))
        write_html(written[-1], f"AORO twin: {section.title}", spec.machine.sentence, [section])
    return written


def manifest(recording: Trajectory, twin: Twin, spec: RunSpec) -> dict[str, Any]:
    """Manifest of a log: manoeuvre, sensors, ground, machine and simulation."""
    manoeuvre = recording.manoeuvre
    about: dict[str, Any] = {"manoeuvre": manoeuvre.name}
    if manoeuvre.signal_percent is not None:
        about["signal_percent"] = manoeuvre.signal_percent
    return about | {
        "duration_s": round(float(recording.time[-1]), 9),
        "start_angle_deg": math.degrees(manoeuvre.start_angle),
        "sensors": IDEAL if spec.ideal else NOISY,
        "filters": [],
        # not ``units.RPM``: pi / 30 rounded first gives other last bits
        "engine_speed_rpm": float(twin.machine.engine.set_speed) * 30.0 / math.pi,
        **_ground(twin.terrain, recording),
        **({} if twin.soil is None else {"soil": twin.soil.to_json()}),
        **({"crane": _crane(twin, spec)} if twin.has_crane else {}),
        "machine": spec.machine.to_json(),
        "simulation": {
            "aoro_gym": VERSION,
            "device": spec.device,
            "seed": spec.seed,
            "main_step_s": twin.main_step,
            "substeps": twin.substeps,
        },
    }


def _crane(twin: Twin, spec: RunSpec) -> dict[str, Any]:
    """What a manifest says of a crane: what drives it, where it begins, and its sensors."""
    start = dict(zip(JOINTS, twin.crane.vehicle.start_joints.reshape(len(JOINTS), -1)[:, 0].tolist(), strict=True))
    return {
        "drive": twin.crane.vehicle.drive,
        **{f"{joint}_deg": math.degrees(start[joint]) for joint in JOINTS[:3]},
        "telescope_m": start["telescope"],
        "sensors": IDEAL if spec.ideal else CRANE_NOISY,
    }


def _ground(terrain: Any, recording: Trajectory) -> dict[str, Any]:
    """What a manifest says of the ground: a plane, or a world and where in it the recording begins."""
    if isinstance(terrain, World):
        places = {f"{axis}_m": float(recording[f"position_{axis}"][0]) for axis in "xy"}
        heading = math.degrees(recording["yaw"][0])
        return {"world": {"name": terrain.name, "objects": len(terrain.objects), **places, "heading_deg": heading}}
    assert isinstance(terrain, Plane), "manoeuvres are run on planes and in worlds"
    names = ("slope_deg", "direction_deg", "friction", "rolling_resistance")
    return {"ground": {name: getattr(terrain, name) for name in names}}


def touched(recording: Trajectory, twin: Twin) -> list[dict[str, Any]]:
    """What a twin touched in its world; nothing where nothing is solid."""
    has_objects = "touched_object_fl" in recording
    return contacts(recording, twin.terrain) if has_objects and isinstance(twin.terrain, World) else []


def figure_table(section: Section) -> Comparison:
    """Key figures of a manoeuvre."""
    rows = []
    for key, value in section.figures.items():
        name, unit, _ = describe(key)
        rows.append([name, show(key, value), unit])
    return Comparison(section.title, ("key figure", "value", "unit"), rows)
