"""Configuration of loading, and how its episodes differ."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import ClassVar

from aoro_gym.checks import check_range
from aoro_gym.envs.core.randomisation import Randomisation, Range
from aoro_gym.envs.core.task import divides
from aoro_gym.envs.core.terms import Frozen, ObservationTerm, RewardTerm
from aoro_gym.envs.loading.observations import OBSERVATION_TERMS
from aoro_gym.envs.loading.rewards import REWARD_TERMS
from aoro_gym.machine.vehicle_crane import VehicleCrane
from aoro_gym.sensors import CraneNoise, JointAngleNoise, PressureNoise

SIGNALS = ("crane_slew", "crane_lift", "crane_fold", "crane_telescope", "rotator", "grapple")
"""Names of the actions."""


@dataclass(frozen=True)
class LoadingRandomisation(Randomisation):
    """Also how difficult the logs are."""

    BOUNDS: ClassVar[Mapping[str, Range]] = {**Randomisation.BOUNDS, "difficulty": (0.0, 1.0)}

    joint_angle: Range = (0.0, 0.0)
    difficulty: Range = (0.0, 1.0)
    """Which of the sites, in their order, as a share [-] of all: those of the package go from easy to difficult."""


FIXED = LoadingRandomisation()
"""The machine as it is, with typical sensor noise; the log still differs."""
MILD = LoadingRandomisation(
    machine_scale=Frozen(
        {
            "steering.pump.margin": (0.9, 1.1),
            "steering.pump.stroke_up_time": (0.8, 1.25),
            "oil.bulk_modulus": (0.85, 1.15),
            "tire.stiffness": (0.8, 1.25),
        }
    ),
    ground_friction=(0.7, 1.1),
    sensor_noise=(0.5, 1.5),
)
"""Spread of a commissioned machine's pump, oil and tires."""


@dataclass(frozen=True)
class LoadingConfig:
    """The task as data; SI. Raises ValueError naming the field, its value and its bound."""

    control_step: float = 0.1
    """[s] between two actions."""
    sample_step: float = 0.02
    """[s] between two samples of the twin that power and sway are taken from."""
    time_limit: float = 60.0
    """An episode is truncated after this long [s]."""
    rotator_rate: float = 0.6
    """Of the grapple at full signal [rad/s] (E)."""
    grasp_distance: float = 0.35
    """Largest distance [m] in plan from the log's middle at which the grapple gets hold of it …"""
    grasp_height: float = 0.3
    """… and in height …"""
    grasp_angle: float = math.radians(20.0)
    """… and largest angle [rad] to it …"""
    grasp_speed: float = 0.5
    """… and largest speed of the tip [m/s]."""
    bunk_length: float = 0.6
    """Largest distance [m] along the bunk from the middle of its place at which a log counts as placed …"""
    bunk_height: float = 0.6
    """… and height [m] over it from which it may drop …"""
    bunk_angle: float = math.radians(15.0)
    """… and largest angle to it [rad]."""
    sway_limit: float = math.radians(10.0)
    """Root mean square swing [rad] over an episode with which it may succeed."""
    ground_limit: float = 0.3
    """Depth [m] of the grapple's middle below the ground that ends an episode."""
    tilt_limit: float = math.radians(15.0)
    """Tilt [rad] of the front frame that ends an episode."""
    joint_angle_noise: JointAngleNoise = field(default_factory=lambda: CraneNoise().angle)
    """Of slew, lift and fold."""
    telescope_noise: float = CraneNoise.telescope
    """Standard deviation [m] of the telescope's length. E"""
    pressure_noise: PressureNoise = field(default_factory=PressureNoise.typical)
    load_noise: PressureNoise = field(default_factory=lambda: CraneNoise().load)
    log_offset: float = 0.05
    """Standard deviation [m] of where a camera sees the log, drawn each episode. E"""
    log_angle_offset: float = math.radians(3.0)
    """The same of its angle [rad]. E"""
    crane: VehicleCrane = field(default_factory=lambda: VehicleCrane(start=(0.0, 0.61, -1.75, 0.0)))
    """Its crane, which begins unfolded, the grapple a metre over the ground ahead of the machine."""
    reward_terms: Mapping[str, RewardTerm] = field(default_factory=lambda: REWARD_TERMS)
    observation_terms: Mapping[str, ObservationTerm] = field(default_factory=lambda: OBSERVATION_TERMS)
    randomisation: LoadingRandomisation = FIXED

    def __post_init__(self) -> None:
        for name in ("control_step", "time_limit", "rotator_rate", "grasp_distance", "grasp_height", "grasp_angle",
                     "grasp_speed", "bunk_length", "bunk_height", "bunk_angle", "sway_limit", "tilt_limit"):  # fmt: skip
            check_range(name, getattr(self, name), gt=0.0, lt=math.inf)
        for name in ("ground_limit", "telescope_noise", "log_offset", "log_angle_offset"):
            check_range(name, getattr(self, name), ge=0.0, lt=math.inf)
        if not divides(self.sample_step, self.control_step):
            raise ValueError(
                f"sample_step is {self.sample_step} s, but must divide control_step = {self.control_step} s"
            )
        if self.crane.drive != "cylinders":
            raise ValueError(
                f"crane.drive is {self.crane.drive!r}, but must be 'cylinders': the actions are signals of valves"
            )
        if not isinstance(self.randomisation, LoadingRandomisation):
            raise ValueError(f"randomisation is {self.randomisation!r}, but must be a LoadingRandomisation")
