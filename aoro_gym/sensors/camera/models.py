"""Stereo cameras by name."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

from aoro_gym.checks import check_range
from aoro_gym.sensors.camera.film import SensorModel
from aoro_gym.sensors.camera.lens import Intrinsics


@dataclass(frozen=True)
class CameraModel:
    """Two equal cameras side by side, their rows in line. Raises ``ValueError`` naming the field."""

    name: str
    intrinsics: Intrinsics
    sensor: SensorModel = field(default_factory=SensorModel)
    baseline: float = 0.12
    """Distance [m] of the right camera from the left one."""
    line_time: float = 0.0
    """[s] from the exposure of a row to that of the next one; 0: a global shutter."""
    rate: float = 15.0
    """Pictures a second."""
    exposures: tuple[float, float] = (20e-6, 8e-3)
    """Shortest and longest [s] of the automatic exposure."""
    reach: float = 300.0
    """Distance [m] up to which surfaces are seen."""

    def __post_init__(self) -> None:
        check_range("baseline", self.baseline, "m", ge=0.0, le=10.0)
        check_range("line_time", self.line_time, "s", ge=0.0, le=1e-3)
        check_range("rate", self.rate, "1/s", gt=0.0, le=1000.0)
        check_range("exposures", self.exposures, "s", gt=0.0, le=1.0)
        check_range("second of exposures", self.exposures[1], "s", ge=self.exposures[0], note=", the first one")
        check_range("reach", self.reach, "m", gt=0.0, lt=math.inf)

    def resized(self, width: int) -> CameraModel:
        """The same camera with pictures ``width`` [pixels] wide, which see as much: its pixels are binned, or finer."""
        share = width / self.intrinsics.width
        sensor = replace(self.sensor, pitch=self.sensor.pitch / share, full_well=self.sensor.full_well / share**2)
        return replace(self, intrinsics=self.intrinsics.scaled(share), sensor=sensor)


MODELS = {
    one.name: one
    for one in (
        CameraModel("stereo", Intrinsics.of_view(640, 480, 75.0)),
        CameraModel(
            "stereo-wide",
            Intrinsics.of_view(640, 480, 95.0, distortion=(-0.12, 0.02, 4e-4, -3e-4, 0.0)),
        ),
        CameraModel(
            "stereo-rolling",
            Intrinsics.of_view(640, 480, 75.0, distortion=(-0.05, 0.01, 0.0, 0.0, 0.0)),
            line_time=30e-6,
        ),
        CameraModel(
            "stereo-hd",
            Intrinsics.of_view(1280, 720, 75.0),
            SensorModel(pitch=3.45e-6, full_well=10_400.0, dark_noise=2.3),
        ),
    )
}
"""Generic ones, all numbers (E): no distortion; a wide lens with distortion; a rolling shutter; more pixels."""
