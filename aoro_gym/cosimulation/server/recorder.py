"""What a served machine's sensors showed, as a log: measured while it runs, written when it is over."""

from __future__ import annotations

import math
import tempfile
from array import array
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from aoro_gym.cosimulation.server.geodesy import Geodesy
from aoro_gym.cosimulation.server.nmea import Solution
from aoro_gym.cosimulation.server.records import MEASURED_PRESSURES
from aoro_gym.machine.specification import RunSpec
from aoro_gym.recording.bag_writing import FLOAT_FIX, NO_FIX, RTK_FIX
from aoro_gym.recording.commands import COMMAND_BOUNDS, WHEELS
from aoro_gym.sensors.gps import FIXED, FLOAT, NONE
from aoro_gym.simulation.log import IDEAL, field_unit, write_log
from aoro_gym.terrains import Plane
from aoro_gym.twin import Twin
from aoro_gym.twin.records import Output
from aoro_gym.units import BAR, RPM
from aoro_gym.version import VERSION

STATUS = {NONE: NO_FIX, FLOAT: FLOAT_FIX, FIXED: RTK_FIX}
"""Column ``gps_status`` by the receiver's quality."""
COMMANDED = tuple(COMMAND_BOUNDS)
SHOWN: dict[str, tuple[str, float]] = {
    "joint_angle_rad": ("joint_angle", 1.0),
    **{f"{name}_bar": (name, BAR) for name in MEASURED_PRESSURES},
    "engine_speed_rpm": ("engine_speed", RPM),
    **{f"wheel_speed_{wheel}_rad_per_s": (f"wheel_speed_{wheel}", 1.0) for wheel in WHEELS},
    **{f"imu_rate_{axis}_rad_per_s": (f"rate_{axis}", 1.0) for axis in "xyz"},
    **{f"imu_force_{axis}_m_per_s2": (f"force_{axis}", 1.0) for axis in "xyz"},
    "imu_roll_rad": ("roll", 1.0),
    "imu_pitch_rad": ("pitch", 1.0),
}
"""Measured columns: field of the telemetry, and SI value of the column's unit."""
RECEIVED = ("gps_latitude_deg", "gps_longitude_deg", "gps_altitude_m", "gps_status", "gps_heading_deg")
TRUE = (
    "joint_angle", "position_x", "position_y", "position_z", "roll", "pitch", "yaw", "speed",
    *(f"arm_angle_{wheel}" for wheel in WHEELS), *(f"wheel_rate_{wheel}" for wheel in WHEELS),
    *(f"wheel_load_{wheel}" for wheel in WHEELS),
)  # fmt: skip
"""The twin's own state, for plots and replays."""


class Recorder:
    """Rows that a session measures, in a file without a name until :meth:`write` makes a log of them: memory stays flat.

    Args:
        geodesy: Where the ground lies.
    """

    def __init__(self, geodesy: Geodesy):
        self._geodesy = geodesy
        self._file = tempfile.TemporaryFile()  # noqa: SIM115 (closed by close)
        self._count = 0
        self._received = [math.nan] * len(RECEIVED)
        self._rows = [Output[name.upper()] for name in TRUE]
        self._sizes = [field_unit(name) for name in TRUE]

    def solve(self, solution: Solution) -> None:
        """Take a solution of the receiver; the heading is clockwise from true north, as a compass has it."""
        x, y, z = (float(value) for value in solution.position)
        status = STATUS[solution.quality]
        if status == NO_FIX:  # the last place stays
            self._received[RECEIVED.index("gps_status")] = float(status)
            return
        self._received = [*self._geodesy.place(x, y, z), float(status), self._geodesy.azimuth(x, y, solution.heading)]

    def take(self, shown: Mapping[str, float], instant: float, outputs: Any, commands: Mapping[str, float]) -> None:
        """A row of the log.

        Args:
            shown: Record of telemetry, SI.
            instant: Time [s] that it shows.
            outputs: All outputs of the twin then.
            commands: Which were obeyed up to then.
        """
        row = [instant, *(float(commands[name]) for name in COMMANDED)]
        row += [shown[name] / size for name, size in SHOWN.values()]
        row += self._received
        row += [float(outputs[number]) / size for number, (_, size) in zip(self._rows, self._sizes, strict=True)]
        array("d", row).tofile(self._file)
        self._count += 1

    def __len__(self) -> int:
        return self._count

    def columns(self) -> dict[str, NDArray[np.float64]]:
        """The log so far, by column (F,). A command is the one that was obeyed last before the next row, as in all logs it
        holds from its row on."""
        true = [
            f"true_{name}_{unit}" if unit else f"true_{name}" for name, (unit, _) in zip(TRUE, self._sizes, strict=True)
        ]
        names = ["time_s", *COMMANDED, *SHOWN, *RECEIVED, *true]
        self._file.flush()
        self._file.seek(0)
        rows = np.fromfile(self._file, dtype=np.float64).reshape(-1, len(names))
        commanded = slice(1, 1 + len(COMMANDED))
        rows[:-1, commanded] = rows[1:, commanded]
        return dict(zip(names, rows.T, strict=True))

    def write(self, path: Path, manifest: Mapping[str, Any]) -> list[Path]:
        """Write log and manifest, see :func:`~aoro_gym.simulation.log.write_log`; returns the files."""
        return write_log(path, self.columns(), manifest)

    def close(self) -> None:
        """Let the rows go."""
        self._file.close()


def manifest(twin: Twin, run: RunSpec, terrain: Path | None, duration: float) -> dict[str, Any]:
    """Manifest of a served twin's log.

    Args:
        twin: Which was served.
        run: Its machine and seed.
        terrain: File of its ground; None: a plane.
        duration: [s]
    """
    ground = twin.terrain
    about: dict[str, Any] = {
        "duration_s": round(duration, 9),
        "sensors": IDEAL if run.ideal else "as served: the machine's sensors with their typical errors",
        "filters": [],
        "engine_speed_rpm": float(twin.machine.engine.set_speed) / RPM,
    }
    if isinstance(ground, Plane):
        about["ground"] = {
            "slope_deg": ground.slope_deg,
            "direction_deg": ground.direction_deg,
            "friction": ground.friction,
            "rolling_resistance": ground.rolling_resistance,
        }
    elif terrain is not None:
        about["terrain"] = str(terrain)
    simulation = {"aoro_gym": VERSION, "seed": run.seed, "main_step_s": twin.main_step, "substeps": twin.substeps}
    return about | {"machine": run.machine.to_json(), "simulation": simulation}
