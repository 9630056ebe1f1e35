"""Logs, shown again: one machine a log, side by side on one clock."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from aoro_gym.machine import Machine
from aoro_gym.machine.kinematics import CranePose, Floats, Kinematics, Pose
from aoro_gym.machine.vehicle_crane import VehicleCrane, size_of_log
from aoro_gym.recording.commands import JOINTS, WHEELS
from aoro_gym.recording.logs import QUANTITIES, TICK, read_log
from aoro_gym.recording.tables import read_table
from aoro_gym.sensors.attitude import quaternion_of
from aoro_gym.simulation.log import field_unit
from aoro_gym.twin.records import CHANNELS, CRANE_OUTPUT_UNITS


def log_channels(path: Path) -> tuple[Floats, dict[str, Floats]]:
    """Instants (F,) [s] from 0 on, and channels (F,) of a log in SI units: the simulator's own state where the log holds it,
    else the measured quantities alone. Raises ValueError as :func:`~aoro_gym.recording.logs.read_log`."""
    table = read_table(path)
    columns = {channel: _column(channel) for channel in (*CHANNELS, *CRANE_OUTPUT_UNITS)}
    columns |= {name: (QUANTITIES[name].column, 1.0) for name in HELD}
    if columns["position_x"][0] not in table:
        log = read_log(path, purpose="a replay")
        time = np.arange(len(log.channels["joint_angle"]), dtype=np.float64) * TICK
        return time, dict(log.channels)
    time = np.asarray(table["time_s"], dtype=np.float64)
    return time - time[0], {name: table[column] * size for name, (column, size) in columns.items() if column in table}


def _column(channel: str) -> tuple[str, float]:
    """Column of the simulator's state, and the SI value of its unit."""
    unit, size = field_unit(channel)
    return f"true_{channel}_{unit}" if unit else f"true_{channel}", size


HELD = ("crane_held_mass", "crane_held_yaw", "crane_held_axial", "crane_held_transverse")
"""Commands that say what a crane's grapple holds."""


class Recording:
    """What one log shows of a machine.

    Args:
        machine: One variant, whose proportions are drawn.
        time: Instants (F,) [s], rising from 0.
        channels: (F,) SI by the twin's output names; what is missing is drawn at rest.
    """

    def __init__(self, machine: Machine, time: Floats, channels: Mapping[str, Floats]):
        self.machine, self.time, self.channels = machine, time, dict(channels)
        rest = machine.rest
        arms = {w: float(rest.arm_angle_front if w[0] == "f" else rest.arm_angle_rear) for w in WHEELS}
        self._at_rest = {"position_z": float(rest.height), **{f"arm_angle_{w}": arms[w] for w in WHEELS}}
        for wheel in WHEELS:  # rates against the arms, by the trapezoidal rule
            rate = self.channels.get(f"wheel_rate_{wheel}", np.zeros(len(time)))
            turned = np.concatenate([[0.0], np.cumsum(0.5 * (rate[1:] + rate[:-1]) * np.diff(time))])
            self.channels[f"wheel_turn_{wheel}"] = turned
        if "yaw" in self.channels:
            self.channels["yaw"] = np.unwrap(self.channels["yaw"])
        self._kinematics = Kinematics(machine)
        self._vehicle = VehicleCrane()

    def reading(self, time: float) -> dict[str, float]:
        """All channels at ``time`` [s], linear between the samples; what is held, as it was last."""
        last = int(np.clip(np.searchsorted(self.time, time, side="right") - 1, 0, len(self.time) - 1))
        return {
            name: float(values[last] if name in HELD else np.interp(time, self.time, values))
            for name, values in self.channels.items()
        }

    def pose(self, reading: Mapping[str, float]) -> Pose:
        """Where the machine is by a reading."""

        def of(name: str) -> float:
            return reading.get(name, self._at_rest.get(name, 0.0))

        return Pose(
            np.array([of(f"position_{axis}") for axis in "xyz"]),
            np.roll(quaternion_of(of("roll"), of("pitch"), of("yaw")), 1),  # w first
            of("joint_angle"),
            tuple(of(f"arm_angle_{w}") for w in WHEELS),
            tuple(of(f"wheel_turn_{w}") for w in WHEELS),
            self._crane_pose(reading) if "crane_joint_slew" in reading else None,
        )

    def _crane_pose(self, reading: Mapping[str, float]) -> CranePose:
        """How its crane stands by a reading, and what it holds, which changes from one sample to the next."""
        mass, yaw, axial, transverse = (reading.get(name, 0.0) for name in HELD)
        joints = tuple(reading[f"crane_joint_{joint}"] for joint in JOINTS)
        return CranePose(self._vehicle, joints, yaw, size_of_log(mass, axial, transverse))

    def loads(self, reading: Mapping[str, float]) -> tuple[Floats, Floats]:
        """Lowest points of the wheels (4, 3) [m], and their loads as upright forces (4, 3) [N]."""
        pose = self.pose(reading)
        placed = self._kinematics.placed(pose.joint, pose.arms, pose.wheels)
        centres = np.array([placed[f"wheel_{w}"][0] for w in WHEELS])
        feet = pose.position + Rotation.from_quat(pose.wxyz, scalar_first=True).apply(centres)
        up = np.array([0.0, 0.0, 1.0])
        forces = np.outer([reading.get(f"wheel_load_{w}", 0.0) for w in WHEELS], up)
        return feet - float(self.machine.tire.radius) * up, forces


class Replay:
    """Recordings on one clock, in the place of live twins.

    Args:
        recordings: One a machine.
    """

    driver: Callable[..., Any] | None = None
    frozen = ""

    def __init__(self, recordings: Sequence[Recording]):
        self.recordings = tuple(recordings)
        self.machines = tuple(one.machine for one in recordings)
        self.duration = max(float(one.time[-1]) for one in recordings)
        """Of the longest [s]; a shorter one stands at its end."""
        self.time = 0.0
        """[s]"""
        self.commands: dict[str, float] = {}
        self.driven = False

    def settle(self) -> None:
        """Nothing to do."""

    def advance(self, duration: float) -> None:
        """Go on by ``duration`` [s], up to the end."""
        self.seek(self.time + duration)

    def seek(self, time: float) -> None:
        """Go to ``time`` [s]."""
        self.time = float(min(max(time, 0.0), self.duration))

    def restart(self) -> None:
        """Begin again."""
        self.time = 0.0

    def readings(self) -> list[dict[str, float]]:
        """Channels of each recording, SI."""
        return [one.reading(self.time) for one in self.recordings]

    def poses(self) -> list[Pose]:
        """Where the machines are."""
        return [one.pose(one.reading(self.time)) for one in self.recordings]

    def forces(self) -> tuple[Floats, Floats]:
        """Lowest points of the wheels [m] and their loads, upright [N], (recordings, 4, 3)."""
        both = [one.loads(one.reading(self.time)) for one in self.recordings]
        return np.array([feet for feet, _ in both]), np.array([force for _, force in both])
