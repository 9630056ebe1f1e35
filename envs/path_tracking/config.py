"""Configuration of path tracking, and how its episodes differ."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import ClassVar

from aoro_gym.checks import check_integer, check_range
from aoro_gym.envs.core.randomisation import COMMISSIONED, Randomisation, Range
from aoro_gym.envs.core.task import divides
from aoro_gym.envs.core.terms import Frozen, ObservationTerm, RewardTerm
from aoro_gym.envs.path_tracking.assistance import ArmControl, GearShift, TractionControl
from aoro_gym.envs.path_tracking.observations import OBSERVATION_TERMS
from aoro_gym.envs.path_tracking.rewards import REWARD_TERMS
from aoro_gym.sensors import (
    Antennas,
    GpsNoise,
    ImuNoise,
    JointAngleNoise,
    LocalisationGains,
    PoseFilterSettings,
    PressureNoise,
    WheelSpeedNoise,
)


@dataclass(frozen=True)
class PathTrackingRandomisation(Randomisation):
    """Also where an episode starts; terrain and path are drawn among the courses."""

    BOUNDS: ClassVar[Mapping[str, Range]] = {
        **Randomisation.BOUNDS,
        "start": (0.0, 1.0),
        "lateral_offset": (-5.0, 5.0),
        "heading_offset": (-1.0, 1.0),
    }

    joint_angle: Range = (-0.1, 0.1)
    """Joint angle at the start beyond what the path's bend asks for, as a share [-] of the largest one."""
    start: Range = (0.0, 0.0)
    """Where on the path an episode starts, as a share [-] of what can be started from."""
    lateral_offset: Range = (-0.2, 0.2)
    """Cross-track error at the start [m]."""
    heading_offset: Range = (-0.05, 0.05)
    """Heading error at the start [rad]."""


FIXED = PathTrackingRandomisation()
"""The machine as it is, with typical sensor noise; terrain, path and start still differ."""
MILD = PathTrackingRandomisation(
    machine_scale=Frozen({**COMMISSIONED, "tire.stiffness": (0.8, 1.25)}),
    ground_friction=(0.5, 1.1),
    sensor_noise=(0.5, 1.5),
    start=(0.0, 0.8),
    lateral_offset=(-0.5, 0.5),
    heading_offset=(-0.15, 0.15),
)
"""Spread of a commissioned machine over grounds, payloads and receptions, and starts anywhere on a path."""


@dataclass(frozen=True)
class PathTrackingConfig:
    """The task as data; SI. Raises ValueError naming the field, its value and its bound."""

    control_step: float = 0.05
    """[s] between two actions."""
    sample_step: float = 0.01
    """[s] between two samples of the joint-angle sensor."""
    working_speed: float = 0.75
    """[m/s] that an episode's time is reckoned with, and that progress is measured by: the published driving speed."""
    time_margin: float = 2.0
    """An episode is truncated after this many times what its path takes at the working speed."""
    preview: tuple[float, ...] = (1.0, 2.0, 3.0, 5.0, 8.0)
    """Distances along the path [m] at which it is previewed."""
    action_memory: int = 2
    """Past actions in the observation."""
    rate_samples: int = 6
    """Angle samples that the joint's rate estimate takes its slope from."""
    start_distance: float = 4.0
    """Open paths are started this far [m] from their first point, so that the rear axle stands on the path, too."""
    end_tolerance: float = 0.25
    """The path's end is reached this far [m] before it."""
    path_limit: float = 3.0
    """Cross-track error [m] beyond which the path is lost."""
    rollover: float = math.radians(45.0)
    """Tilt [rad] of the front frame beyond which the machine has rolled over."""
    stuck_distance: float = 0.5
    """A machine is stuck that gains less than this [m] …"""
    stuck_time: float = 20.0
    """… in this time [s]."""
    chassis_force_limit: float = math.inf
    """Force [N] of the objects of a world on a chassis beyond which it has hit an object, which ends the episode; 0: any
    touch does, by default none. See :func:`aoro_gym.envs.core.contacts.chassis_force`."""
    gear: int | str = 1
    """1, 2, 3 or ``"automatic"``; see :class:`aoro_gym.envs.path_tracking.assistance.AutomaticGear`."""
    gear_shift: GearShift = field(default_factory=GearShift)
    arms: ArmControl | None = field(default_factory=ArmControl.sharing)
    """How the pendulum arms move; None: they hold."""
    traction: TractionControl | None = field(default_factory=TractionControl)
    """How the traction valves throttle spinning wheels; None: they stay open."""
    act_arms: bool = False
    """Add the four pendulum arms to the action, in place of ``arms``."""
    act_traction: bool = False
    """Add the four traction valves to the action, in place of ``traction``: 0 and above is open, −1 is closed."""
    act_gear: bool = False
    """Add the gear to the action: thirds of its range."""
    observe_inertial: bool = False
    """Add roll rate, pitch rate and specific force to the observation."""
    scan_x: tuple[float, ...] = ()
    """Places ahead of the reference point [m] whose ground is scanned, each at all of ``scan_y``; none by default."""
    scan_y: tuple[float, ...] = (-1.5, -0.75, 0.0, 0.75, 1.5)
    """Places to its left [m]."""
    antennas: Antennas = field(default_factory=Antennas)
    gps_latency: float = 0.04
    """[s]"""
    gps_noise: GpsNoise = field(default_factory=GpsNoise.typical)
    imu_noise: ImuNoise = field(default_factory=ImuNoise.typical)
    wheel_speed_noise: WheelSpeedNoise = field(default_factory=WheelSpeedNoise.typical)
    joint_angle_noise: JointAngleNoise = field(default_factory=JointAngleNoise.published)
    pressure_noise: PressureNoise = field(default_factory=PressureNoise.typical)
    localisation: LocalisationGains | PoseFilterSettings = field(default_factory=LocalisationGains)
    """How the pose is estimated: dead reckoning pulled toward solutions by constant gains, or a Kalman filter
    (:class:`aoro_gym.sensors.pose_filter.PoseFilter`)."""
    reward_terms: Mapping[str, RewardTerm] = field(default_factory=lambda: REWARD_TERMS)
    observation_terms: Mapping[str, ObservationTerm] = field(default_factory=lambda: OBSERVATION_TERMS)
    randomisation: PathTrackingRandomisation = FIXED

    def __post_init__(self) -> None:
        for name in ("working_speed", "stuck_distance", "stuck_time", "path_limit", "end_tolerance"):
            check_range(name, getattr(self, name), gt=0.0, lt=math.inf)
        check_range("control_step", self.control_step, "s", gt=0.0, le=0.1)
        check_range("chassis_force_limit", self.chassis_force_limit, "N", ge=0.0)
        check_range("time_margin", self.time_margin, ge=1.0)
        check_integer("action_memory", self.action_memory, ge=2)
        check_integer("rate_samples", self.rate_samples, ge=2)
        check_range("start_distance", self.start_distance, "m", ge=0.0)
        check_range("rollover", self.rollover, "rad", gt=0.0, lt=0.5 * math.pi)
        for holds, message in (
            (divides(self.sample_step, self.control_step), f"sample_step is {self.sample_step} s, but must divide "
             f"control_step = {self.control_step} s"),
            (len(self.preview) > 0 and all(0.0 < d <= 50.0 for d in self.preview), f"preview is {self.preview} m, but must "
             "be at least one distance in (0, 50] m"),
            (self.gear in (1, 2, 3, "automatic"), f"gear is {self.gear!r}; choose 1, 2, 3 or 'automatic'"),
            (not (self.act_gear and self.gear == "automatic"), "act_gear is set and gear is 'automatic'; drop one of them"),
            (isinstance(self.randomisation, PathTrackingRandomisation), f"randomisation is {self.randomisation!r}, but must "
             "be a PathTrackingRandomisation"),
            (isinstance(self.localisation, LocalisationGains | PoseFilterSettings), f"localisation is "
             f"{self.localisation!r}, but must be LocalisationGains or PoseFilterSettings"),
        ):  # fmt: skip
            if not holds:
                raise ValueError(message)
