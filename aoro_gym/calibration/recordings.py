"""Logs as a calibration takes them: every command, the measured channels behind a low-pass, and the noise of each."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from aoro_gym.recording import logs
from aoro_gym.recording.cells import listed
from aoro_gym.recording.logs import TICK
from aoro_gym.recording.manifest import Manifest
from aoro_gym.sensors.chain import low_pass
from aoro_gym.terrains import Plane
from aoro_gym.twin.records import State
from aoro_gym.units import BAR

EVERY = 4
"""Every so many ticks enter the fit: at 25 Hz the 7 Hz low-pass leaves little that is new between samples."""

CUTOFF = 7.0
"""Cut-off [Hz] of the low-pass."""


class Channel(NamedTuple):
    """A measured output of the twin; SI."""

    state: int
    """Row of the twin's state that shows it at the start."""
    least: float
    """Least standard deviation: rounding of logs and of the twin's single precision."""
    zero: float = 0.0
    """Zero error, rms, constant in a log; 0.25 % of 400 bar is typical of pressure sensors."""


CHANNELS: Mapping[str, Channel] = {
    "joint_angle": Channel(int(State.JOINT), 2e-4),
    "pressure_a": Channel(int(State.PORT_A), 0.5 * BAR, BAR),
    "pressure_b": Channel(int(State.PORT_B), 0.5 * BAR, BAR),
    "pump_pressure": Channel(int(State.SUPPLY), 0.5 * BAR, BAR),
    "drive_pressure_forward": Channel(int(State.FORWARD), 0.5 * BAR, BAR),
    "drive_pressure_return": Channel(int(State.BACK), 0.5 * BAR, BAR),
    "engine_speed": Channel(int(State.ENGINE_SPEED), 0.2),
}
"""Measured channels that a calibration compares, by the twin's outputs: those that a diagnosis does."""


@dataclass(frozen=True)
class FilteredLog:
    """A log on the tick grid; F samples."""

    path: Path
    commands: Mapping[str, NDArray[np.float64]]
    """(F,) of the commands that the log has, each held from a tick to the next."""
    channels: Mapping[str, NDArray[np.float64]]
    """(F,) low-passed, SI."""
    std: Mapping[str, float]
    """Of a sample that enters the fit, SI."""
    rest: int
    """Samples of standstill at the begin."""
    start_angle: float
    """[rad]"""
    manifest: Manifest
    used: tuple[str, ...] = ()
    """What is taken from the log and its manifest, in words."""
    warnings: tuple[str, ...] = ()
    """What limits the log, and what of it and its manifest is not used."""

    @property
    def count(self) -> int:
        """F."""
        return len(next(iter(self.commands.values())))


def read_filtered_log(path: Path) -> FilteredLog:
    """Read a log (:func:`aoro_gym.recording.logs.read_log`) and the manifest beside it for calibration.

    Raises:
        ValueError: names the file, the column and what is missing or inconsistent.
    """
    log = logs.read_log(path, purpose="a calibration", channels=tuple(CHANNELS))
    commands = {name: np.append(values, values[-1]) for name, values in log.commands.items()}
    channels, std = {}, {}
    for name, values in log.channels.items():
        channels[name] = low_pass(values, rate=1.0 / TICK, cutoff=CUTOFF)
        # the standstill alone: the low-pass has no phase and shows the first motion before it begins
        noise = float(np.std(low_pass(values[: log.rest], rate=1.0 / TICK, cutoff=CUTOFF)))
        # neighbouring samples share what the low-pass leaves: each counts for less than one
        shared = np.sqrt(max(1.0, 1.0 / (TICK * EVERY) / (2.0 * CUTOFF)))
        std[name] = shared * float(np.hypot(noise, CHANNELS[name].least))
    unread = [f"{path.name}: columns that were not read: {listed(log.unread)}"] if log.unread else []
    return FilteredLog(
        path, commands, channels, std, log.rest, log.start_angle, log.manifest, _used(log),
        (*log.limitations, *unread, *_unused(log.manifest)),
    )  # fmt: skip


def _used(log: logs.Log) -> tuple[str, ...]:
    """What a calibration takes from a log and its manifest, in words."""
    manifest = log.manifest
    found = [
        f"commands {', '.join(log.commands)}",
        f"measured {', '.join(log.channels)}",
        f"start at rest, joint angle {np.degrees(log.start_angle):.2f}°",
    ]
    if manifest.ground is not None:
        plane = Plane(**manifest.ground)
        found.append(
            f"ground: slope {plane.slope_deg:g}° towards {plane.direction_deg:g}°, friction x {plane.friction:g}, rolling"
            f" resistance x {plane.rolling_resistance:g}"
        )
    for value, text in (
        (manifest.engine_speed_rpm, "engine at {:.5g} rpm"),
        (manifest.oil_temperature_C, "oil at {:g} °C"),
        (manifest.payload_kg, "payload {:g} kg"),
        (None if "gear" in log.commands else manifest.gear, "gear {}"),
    ):
        if value is not None:
            found.append(text.format(value))
    return tuple(found)


def _unused(manifest: Manifest) -> list[str]:
    """What a manifest says of the conditions that the twin cannot take over."""
    sentences = []
    if "world" in manifest.values:
        sentences.append(
            f"manifest {manifest.path}: the world that was driven in was not used; the twin drives on level asphalt"
        )
    if manifest.tire_pressure_bar is not None:
        sentences.append(
            f"manifest {manifest.path}: tire_pressure_bar = {manifest.tire_pressure_bar:g} was not used; tires"
            " are searched instead"
        )
    if manifest.filters:
        sentences.append(
            f"manifest {manifest.path}: filters ({'; '.join(manifest.filters)[:120]}) were not used; the twin's signals go"
            f" through the {CUTOFF:g} Hz low-pass alone"
        )
    return sentences


def whitened(miss: NDArray[np.float64], std: float, zero: float) -> NDArray[np.float64]:
    """Misses (F, N) in standard deviations, uncorrelated.

    A sensor's zero error shifts all samples of a log alike: their covariance is std² I + zero² 1 1ᵀ, whose inverse root
    leaves what has no mean and shrinks the mean.
    """
    kept = 1.0 / np.sqrt(1.0 + len(miss) * (zero / std) ** 2)
    return (miss - (1.0 - kept) * np.mean(miss, axis=0)) / std
