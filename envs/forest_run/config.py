"""Configuration of a forest run, and how its episodes differ."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import ClassVar

from aoro_gym.checks import check_range
from aoro_gym.envs.core.randomisation import COMMISSIONED, Range
from aoro_gym.envs.core.terms import Frozen, ObservationTerm, RewardTerm
from aoro_gym.envs.forest_run.observations import OBSERVATION_TERMS
from aoro_gym.envs.forest_run.obstacles import obstacles
from aoro_gym.envs.forest_run.rewards import REWARD_TERMS
from aoro_gym.envs.path_tracking.config import PathTrackingConfig, PathTrackingRandomisation
from aoro_gym.sensors import GpsNoise, ImuNoise, JointAngleNoise, WheelSpeedNoise


@dataclass(frozen=True)
class ForestRunRandomisation(PathTrackingRandomisation):
    """Also how difficult the world is. ``start`` is no share of a route here but stays at its beginning, 0."""

    BOUNDS: ClassVar[Mapping[str, Range]] = {
        **PathTrackingRandomisation.BOUNDS,
        "start": (0.0, 0.0),
        "difficulty": (0.0, 1.0),
    }

    joint_angle: Range = (0.0, 0.0)
    difficulty: Range = (0.0, 1.0)
    """Which of the worlds, in their order, as a share [-] of all: those of the package become denser, and goals farther."""


FIXED = ForestRunRandomisation()
"""The machine as it is, with typical sensor noise; world, run and start still differ."""
MILD = ForestRunRandomisation(
    machine_scale=Frozen({**COMMISSIONED, "tire.stiffness": (0.8, 1.25)}),
    ground_friction=(0.7, 1.1),
    sensor_noise=(0.5, 1.5),
    heading_offset=(-0.1, 0.1),
)
"""Spread of a commissioned machine over grounds, payloads and receptions."""


@dataclass(frozen=True)
class ForestRunConfig:
    """The task as data; SI. Raises ValueError naming the field, its value and its bound."""

    control_step: float = 0.1
    """[s] between two actions: a sweep of the lidar."""
    sample_step: float = 0.01
    """[s] between two samples of the joint-angle sensor."""
    working_speed: float = 0.75
    """[m/s] that an episode's time is reckoned with, and that progress is measured by: the published driving speed."""
    time_margin: float = 1.6
    """An episode is truncated after this many times what a route to its goal takes at the working speed."""
    goal_tolerance: float = 1.5
    """The goal is reached this far [m] from it."""
    chassis_force_limit: float = 50e3
    """Force [N] of objects on a chassis beyond which an episode ends: half of the machine's weight."""
    stuck_distance: float = 0.5
    """A machine is stuck that moves less than this [m] …"""
    stuck_time: float = 12.0
    """… in this time [s]."""
    joint_angle_noise: JointAngleNoise = field(default_factory=JointAngleNoise.published)
    gps_noise: GpsNoise = field(default_factory=GpsNoise.typical)
    imu_noise: ImuNoise = field(default_factory=ImuNoise.typical)
    wheel_speed_noise: WheelSpeedNoise = field(default_factory=WheelSpeedNoise.typical)
    reward_terms: Mapping[str, RewardTerm] = field(default_factory=lambda: REWARD_TERMS)
    observation_terms: Mapping[str, ObservationTerm] = field(
        default_factory=lambda: Frozen({**OBSERVATION_TERMS, "obstacles": obstacles()})
    )
    randomisation: ForestRunRandomisation = FIXED

    def __post_init__(self) -> None:
        for name in ("goal_tolerance", "stuck_distance", "stuck_time"):
            check_range(name, getattr(self, name), gt=0.0, lt=math.inf)
        check_range("chassis_force_limit", self.chassis_force_limit, "N", ge=0.0)
        if not isinstance(self.randomisation, ForestRunRandomisation):
            raise ValueError(f"randomisation is {self.randomisation!r}, but must be a ForestRunRandomisation")
        self.path_tracking()

    def path_tracking(self) -> PathTrackingConfig:
        """That of the machine's sensors, arms, traction and time; there is no path that it could lose."""
        return PathTrackingConfig(
            control_step=self.control_step,
            sample_step=self.sample_step,
            working_speed=self.working_speed,
            time_margin=self.time_margin,
            observe_inertial=True,
            path_limit=_FAR,
            stuck_time=_FAR,
            joint_angle_noise=self.joint_angle_noise,
            gps_noise=self.gps_noise,
            imu_noise=self.imu_noise,
            wheel_speed_noise=self.wheel_speed_noise,
            randomisation=self.randomisation,
        )


_FAR = 1e9  # [m], [s]: never
