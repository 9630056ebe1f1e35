"""Configuration of levelling, and how its episodes differ."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import ClassVar

from aoro_gym.checks import check_integer, check_range
from aoro_gym.envs.core.randomisation import COMMISSIONED, Range
from aoro_gym.envs.core.terms import Frozen, ObservationTerm, RewardTerm
from aoro_gym.envs.levelling.driving import PathDriver
from aoro_gym.envs.levelling.observations import OBSERVATION_TERMS
from aoro_gym.envs.levelling.rewards import REWARD_TERMS
from aoro_gym.envs.path_tracking.config import PathTrackingConfig, PathTrackingRandomisation
from aoro_gym.sensors import GpsNoise, ImuNoise, JointAngleNoise, PressureNoise, WheelSpeedNoise
from aoro_gym.twin.records import WHEELS

ARM_SIGNALS = tuple(f"arm_{wheel}" for wheel in WHEELS)
"""Names of the actions."""


@dataclass(frozen=True)
class LevellingRandomisation(PathTrackingRandomisation):
    """Also how difficult the ground is."""

    BOUNDS: ClassVar[Mapping[str, Range]] = {**PathTrackingRandomisation.BOUNDS, "difficulty": (0.0, 1.0)}

    joint_angle: Range = (0.0, 0.0)
    difficulty: Range = (0.0, 1.0)
    """Which of the grounds, in their order, as a share [-] of all: those of the package go from easy to difficult."""


FIXED = LevellingRandomisation()
"""The machine as it is, with typical sensor noise; ground, lane and start still differ."""
MILD = LevellingRandomisation(
    machine_scale=Frozen(
        {
            **COMMISSIONED,
            "tire.stiffness": (0.8, 1.25),
            "arm.valve.nominal_flow": (0.8, 1.25),
            "arm.valve.dead_band": (0.7, 1.4),
            "arm.valve.time_constant": (0.7, 1.4),
        }
    ),
    ground_friction=(0.7, 1.1),
    sensor_noise=(0.5, 1.5),
    start=(0.0, 0.5),
    lateral_offset=(-0.5, 0.5),
    heading_offset=(-0.1, 0.1),
)
"""Spread of a commissioned machine, its arm valves included, and starts in the first half of a lane."""


def _arm_angle_noise() -> JointAngleNoise:
    """E: a rotary sensor of 12 bits a turn with a quarter of a bit of white noise, as on the joint, without its lines."""
    return JointAngleNoise(white=math.radians(0.022), resolution=2.0 * math.pi / 2**12)


@dataclass(frozen=True)
class LevellingConfig:
    """The task as data; SI. Raises ValueError naming the field, its value and its bound."""

    control_step: float = 0.05
    """[s] between two actions."""
    sample_step: float = 0.01
    """[s] between two samples of the joint-angle sensor."""
    working_speed: float = 0.75
    """[m/s] that an episode's time is reckoned with, and that progress is measured by: the published driving speed."""
    time_margin: float = 2.0
    """An episode is truncated after this many times what its path takes at the working speed."""
    driver: PathDriver = field(default_factory=PathDriver)
    """Who steers and drives."""
    signal_memory: int = 2
    """Past arm signals in the observation."""
    tilt_limit: float = math.radians(1.0)
    """Root mean square tilt [rad] over an episode with which it may succeed."""
    unevenness_limit: float = 0.2
    """The same of the unevenness [-]."""
    arm_angle_noise: JointAngleNoise = field(default_factory=_arm_angle_noise)
    """Of the sensors on the arms, which are an assumption."""
    pressure_noise: PressureNoise = field(default_factory=PressureNoise.typical)
    imu_noise: ImuNoise = field(default_factory=ImuNoise.typical)
    joint_angle_noise: JointAngleNoise = field(default_factory=JointAngleNoise.published)
    wheel_speed_noise: WheelSpeedNoise = field(default_factory=WheelSpeedNoise.typical)
    gps_noise: GpsNoise = field(default_factory=GpsNoise.typical)
    ground_ahead: tuple[float, ...] = tuple(0.5 * k for k in range(-5, 8))
    """Places ahead of the hinge [m] at which the map of the ground is read in both tracks."""
    ground_noise: float = 0.02
    """Standard deviation [m] of each height of that map, drawn anew each step. E: a map of lidar sweeps."""
    ground_offset: float = 0.05
    """Standard deviation [m] of how far the map lies ahead and to the left of where the ground is, drawn each episode."""
    reward_terms: Mapping[str, RewardTerm] = field(default_factory=lambda: REWARD_TERMS)
    observation_terms: Mapping[str, ObservationTerm] = field(default_factory=lambda: OBSERVATION_TERMS)
    randomisation: LevellingRandomisation = FIXED

    def __post_init__(self) -> None:
        check_integer("signal_memory", self.signal_memory, ge=2)
        check_range("ground_noise", self.ground_noise, "m", ge=0.0, lt=math.inf)
        check_range("ground_offset", self.ground_offset, "m", ge=0.0, lt=math.inf)
        if not self.ground_ahead or not all(-10.0 <= x <= 10.0 for x in self.ground_ahead):
            raise ValueError(f"ground_ahead is {self.ground_ahead} m, but must be at least one distance in [-10, 10] m")
        check_range("tilt_limit", self.tilt_limit, "rad", gt=0.0, lt=math.inf)
        check_range("unevenness_limit", self.unevenness_limit, gt=0.0, lt=math.inf)
        if not isinstance(self.randomisation, LevellingRandomisation):
            raise ValueError(f"randomisation is {self.randomisation!r}, but must be a LevellingRandomisation")
        if not isinstance(self.driver, PathDriver):
            raise ValueError(f"driver is {self.driver!r}, but must be a PathDriver")
        self.path_tracking()

    def path_tracking(self) -> PathTrackingConfig:
        """That of the path that is driven meanwhile: its actions are steering, drive and the four arms."""
        return PathTrackingConfig(
            control_step=self.control_step,
            sample_step=self.sample_step,
            working_speed=self.working_speed,
            time_margin=self.time_margin,
            act_arms=True,
            observe_inertial=True,
            imu_noise=self.imu_noise,
            joint_angle_noise=self.joint_angle_noise,
            wheel_speed_noise=self.wheel_speed_noise,
            gps_noise=self.gps_noise,
            randomisation=self.randomisation,
        )
