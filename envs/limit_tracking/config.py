"""Configuration of path tracking at the limits, and how its episodes differ."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

from aoro_gym.envs.core.randomisation import COMMISSIONED, Range
from aoro_gym.envs.core.terms import Frozen
from aoro_gym.envs.path_tracking.config import PathTrackingConfig, PathTrackingRandomisation
from aoro_gym.envs.path_tracking.observations import GPS_TERMS, OBSERVATION_TERMS
from aoro_gym.sensors import GpsNoise
from aoro_gym.sensors.gps import FixLoss


@dataclass(frozen=True)
class LimitRandomisation(PathTrackingRandomisation):
    """Also how difficult the course is."""

    BOUNDS: ClassVar[Mapping[str, Range]] = {**PathTrackingRandomisation.BOUNDS, "difficulty": (0.0, 1.0)}

    joint_angle: Range = (0.0, 0.0)
    lateral_offset: Range = (-0.1, 0.1)
    difficulty: Range = (0.0, 1.0)
    """Which of the courses, in their order, as a share [-] of all: those of the package go from easy to difficult."""


FIXED = LimitRandomisation()
"""The machine as it is, with its sensors' noise and losses of the fix; course and start still differ."""
MILD = LimitRandomisation(
    machine_scale=Frozen({**COMMISSIONED, "tire.stiffness": (0.8, 1.25)}),
    ground_friction=(0.9, 1.1),
    sensor_noise=(0.5, 1.5),
    start=(0.0, 0.8),
    lateral_offset=(-0.2, 0.2),
    heading_offset=(-0.1, 0.1),
)
"""Spread of a commissioned machine, and starts anywhere on a path."""

CANOPY = FixLoss(interval=15.0, float_duration=6.0, none_duration=10.0, none_share=0.6)
"""Losses of the fix under trees (E). Dead reckoning knows of no slip: in 10 s at 1.5 m/s a creep of the tires to the side
of 2 % makes 0.3 m, more than the room beside the path."""


def limit_config(**changes: Any) -> PathTrackingConfig:
    """The task as data: that of path tracking, with the room, the time, the speed and the reception of this one.

    Third gear: 2.3 m/s at full signal. 0.2 m beside the path are free; the time is up that 1.43 m/s would take, from rest;
    GPS solutions are 0.2 s old, and get lost under trees; the receiver says so.

    Raises ValueError naming a wrong field of ``changes``, its value and its bound.
    """
    settings: dict[str, Any] = {
        "gear": 3,
        "working_speed": 1.5,
        "time_margin": 1.05,
        "path_limit": 0.2,
        "preview": (0.5, 1.0, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 7.0),
        "gps_latency": 0.2,
        "gps_noise": GpsNoise.typical(CANOPY),
        "observation_terms": Frozen({**OBSERVATION_TERMS, **GPS_TERMS}),
        "randomisation": FIXED,
    }
    return PathTrackingConfig(**settings | changes)
