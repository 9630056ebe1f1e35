"""What is installed here, which devices there are, and how fast one twin steps on them."""

from __future__ import annotations

import platform
import statistics
import sys
import time
from dataclasses import dataclass
from importlib import metadata
from typing import Any

import warp as wp
from packaging.requirements import Requirement

from aoro_gym.execution import devices
from aoro_gym.execution.lanes import cpp_compiler
from aoro_gym.reporting.terminal import Comparison
from aoro_gym.twin import Twin
from aoro_gym.version import VERSION

DISTRIBUTION = "aoro-gym"
PURPOSES = {
    "torch": "environments on PyTorch's tensors",
    "agents": "training with Stable-Baselines3",
    "resident": "training with skrl that stays on the GPU",
    "ray": "clusters",
    "onnx": "policies as ONNX",
    "hub": "policies on the Hugging Face Hub",
    "parquet": "Parquet logs",
    "bags": "bags of ROS as logs",
    "terrain": "rasters, point clouds, coordinate systems",
    "bench": "the peers of 'aoro-gym bench'",
    "cosimulation": "GPS sentences and CAN of 'aoro-gym serve'",
    "odometry": "odometry from a lidar by KISS-ICP",
    "view": "the machine in the browser",
    "video": "films as MP4",
    "test": "the tests",
    "docs": "the documentation",
    "dev": "work on the project",
}
"""What each optional part is for."""
LIBRARIES = ("warp-lang", "numpy", "gymnasium", "torch", "stable-baselines3")
SIMULATED = 1.0
"""Time [s] that one twin drives for a measurement of its speed."""
RUNS = 3


@dataclass(frozen=True)
class Part:
    """An optional part of the project."""

    name: str
    purpose: str
    missing: tuple[str, ...]
    """What it needs and is not here, with the version that is where it does not fit."""


def parts() -> list[Part]:
    """The optional parts, in the order of the project's metadata."""
    found = metadata.metadata(DISTRIBUTION).get_all("Provides-Extra") or []
    return [Part(name, PURPOSES.get(name, ""), tuple(_missing(name, {name}))) for name in found]


def _missing(extra: str, seen: set[str]) -> list[str]:
    """What a part lacks, those parts that it consists of included."""
    lacking: list[str] = []
    for line in metadata.requires(DISTRIBUTION) or []:
        needed = Requirement(line)
        if needed.marker is None or not needed.marker.evaluate({"extra": extra}):
            continue
        if needed.name == DISTRIBUTION:
            for other in sorted(needed.extras - seen):
                lacking += _missing(other, seen | needed.extras)
            continue
        try:
            version = metadata.version(needed.name)
        except metadata.PackageNotFoundError:
            lacking.append(needed.name)
            continue
        if not needed.specifier.contains(version, prereleases=True):
            lacking.append(f"{needed.name} {needed.specifier} ({version} is here)")
    return list(dict.fromkeys(lacking))


def versions() -> dict[str, str]:
    """Of the project, of Python and of what decides results; "-" where one is not installed."""
    found = {DISTRIBUTION: VERSION, "Python": platform.python_version(), "system": platform.platform()}
    for name in LIBRARIES:
        try:
            found[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            found[name] = "-"
    return found


@dataclass(frozen=True)
class Speed:
    """Of one twin on a device."""

    device: str
    name: str
    step_us: float
    """Median wall time of a step of 1 ms."""

    @property
    def real_time(self) -> float:
        """Simulated seconds a second."""
        return 1e3 / self.step_us


def speeds() -> list[Speed]:
    """One twin on the CPU and on each GPU; kernels that are not compiled yet are compiled first."""
    devices.start()
    names = ["cpu", *(str(device) for device in wp.get_cuda_devices())]
    return [_speed(name) for name in names]


def _speed(device: str) -> Speed:
    twin = Twin(device=device)
    twin.step({"drive_signal": 0.5, "steering_signal": 0.3}, 0.01)
    times = []
    for _ in range(RUNS):
        wp.synchronize_device(twin.device)
        began = time.perf_counter()
        twin.advance(SIMULATED)
        wp.synchronize_device(twin.device)
        times.append(time.perf_counter() - began)
    name = str(twin.device.name) if twin.device.is_cuda else platform.processor() or platform.machine()
    return Speed(device, name, 1e6 * statistics.median(times) * twin.main_step / SIMULATED)


def _cpp_compiler() -> str | None:
    """What ``--device cpu:simd`` compiles with."""
    try:
        return " ".join(cpp_compiler())
    except ValueError:
        return None


def to_json(installed: list[Part], measured: list[Speed]) -> dict[str, Any]:
    """All of it."""
    return {
        "versions": versions(),
        "python": sys.executable,
        "kernel_cache": str(wp.config.kernel_cache_dir),
        "cpp_compiler": _cpp_compiler(),
        "parts": [{"part": one.name, "for": one.purpose, "missing": list(one.missing)} for one in installed],
        "devices": [
            {"device": one.device, "name": one.name, "step_us": one.step_us, "times_real_time": one.real_time}
            for one in measured
        ],
    }


def tables(installed: list[Part], measured: list[Speed]) -> list[Comparison]:
    """For a terminal."""
    return [
        Comparison("versions", ["what", "version"], [list(row) for row in versions().items()], lead=1),
        Comparison(
            "optional parts",
            ["part", "for", "missing"],
            [[one.name, one.purpose, ", ".join(one.missing) or "nothing"] for one in installed],
            lead=2,
            note="pip install -c constraints.txt -e '.[PART]' adds one",
        ),
        Comparison(
            "one twin",
            ["device", "name", "step of 1 ms [µs]", "times real time"],
            [[one.device, one.name, f"{one.step_us:.1f}", f"{one.real_time:.0f}"] for one in measured],
            lead=2,
            note="--device cpu:simd, for many twins on a CPU, compiles with "
            + (_cpp_compiler() or "a C++ compiler, and there is none"),
        ),
    ]
