"""Recordings as a diagnosis takes them: those commands and channels of a log that it replays and compares."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from aoro_gym.recording import logs
from aoro_gym.recording.logs import REST, TICK
from aoro_gym.simulation.log import SUFFIXES
from aoro_gym.twin.records import Command

__all__ = ["CHANNELS", "COMMANDS", "REST", "SUFFIXES", "TICK", "Recording", "logs_in", "read_log", "read_recording"]

PURPOSE = "a diagnosis"

COMMANDS = {"steering_signal": Command.STEERING_SIGNAL, "drive_signal": Command.DRIVE_SIGNAL}
"""Columns that command the machine; zero where a log has none."""

CHANNELS = (
    "joint_angle", "pressure_a", "pressure_b", "pump_pressure", "drive_pressure_forward", "drive_pressure_return",
    "engine_speed",
)  # fmt: skip
"""Measured quantities that a diagnosis compares, by the twin's output."""

SENSORS = {"angle": CHANNELS[:1], "full": CHANNELS[:4]}
"""Channels that a kind of logger records."""


@dataclass(frozen=True)
class Recording:
    """One manoeuvre on an even grid of :data:`TICK`; F samples, F − 1 ticks between them."""

    name: str
    commands: NDArray[np.float64]  # (F − 1, len(COMMANDS)), each held from one sample to the next
    channels: dict[str, NDArray[np.float64]]  # (F,) SI, by the twin's output names
    rest: int  # samples of standstill at the beginning
    start_angle: float  # [rad] mean over them
    limitations: tuple[str, ...] = ()
    manifest: dict[str, Any] = field(default_factory=dict)

    @property
    def ticks(self) -> int:
        return len(self.commands)

    @property
    def signature(self) -> bytes:
        """Equal for two recordings of the same commands."""
        return np.round(self.commands, 3).tobytes()


def read_recording(path: Path) -> Recording:
    """Read a log (:func:`aoro_gym.recording.logs.read_log`) and the manifest beside it.

    Raises:
        ValueError: the log cannot be used; names the file, the line or column, the value, and what is needed.
    """
    log = read_log(path)
    ticks = len(log.channels["joint_angle"]) - 1
    commands = np.stack([log.commands.get(name, np.zeros(ticks)) for name in COMMANDS], axis=1)
    return Recording(
        log.name, commands, log.channels, log.rest, log.start_angle, log.limitations, dict(log.manifest.values)
    )


def read_log(path: Path) -> logs.Log:
    """A log as a diagnosis reads it, with what was read of it; ``ValueError`` as :func:`read_recording`."""
    return logs.read_log(path, purpose=PURPOSE, commands=tuple(COMMANDS), channels=CHANNELS)


def logs_in(folder: Path) -> list[Path]:
    """All logs in a folder, by their names; none if there is no such folder."""
    return sorted(path for ending in SUFFIXES for path in folder.glob(f"*{ending}"))
