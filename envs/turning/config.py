"""Configuration of turning, and how its episodes differ."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

from aoro_gym.checks import check_integer, check_range
from aoro_gym.envs.core.randomisation import COMMISSIONED, Randomisation
from aoro_gym.envs.core.task import divides
from aoro_gym.envs.core.terms import Frozen, ObservationTerm, RewardTerm
from aoro_gym.envs.turning.observations import OBSERVATION_TERMS
from aoro_gym.envs.turning.rewards import REWARD_TERMS
from aoro_gym.sensors import JointAngleNoise, PressureNoise

FIXED = Randomisation()
"""The machine as it is, with the published sensor noise; targets and the start angle still differ."""
MILD = Randomisation(
    machine_scale=Frozen(
        {
            **COMMISSIONED,
            "steering.valve.spool_time_constant": (0.7, 1.4),
            "steering.valve.compensator_time_constant": (0.7, 1.4),
            "steering.pump.stroke_up_time": (0.8, 1.25),
            "steering.pump.margin": (0.9, 1.1),
            "steering.hose_volume": (0.8, 1.25),
            "oil.bulk_modulus": (0.85, 1.15),
            "joint.friction_torque": (0.5, 2.0),
        }
    ),
    ground_friction=(0.5, 1.1),
    sensor_noise=(0.5, 1.5),
)
"""Spread of a commissioned machine over grounds and temperatures, within the ranges of the machine file."""


@dataclass(frozen=True)
class TurningConfig:
    """The task as data; SI. Raises ValueError naming the field, its value and its bound."""

    control_step: float = 0.02
    """[s] between two actions."""
    sample_step: float = 0.01
    """[s] between two samples of the joint-angle sensor."""
    target_clearance: float = math.radians(4.0)
    """Targets and start angles keep this far [rad] from the joint's stops."""
    target_change: float = math.radians(8.0)
    """Successive targets, and the first one and the start angle, differ by at least this much [rad]."""
    hold: tuple[float, float] = (2.5, 4.0)
    """Shortest and longest time [s] until the next target."""
    tolerance: float = math.radians(1.0)
    """Error [rad] within which a target counts as reached."""
    dwell: float = 0.3
    """A target is settled when the error has stayed within the tolerance for this long [s]."""
    rate_samples: int = 6
    """Angle samples that the rate estimate takes its slope from."""
    signal_memory: int = 4
    """Past steering signals in the observation."""
    observe_pressures: bool = False
    """Add the pressures of both ports and of the pump to the observation."""
    joint_angle_noise: JointAngleNoise = field(default_factory=JointAngleNoise.published)
    pressure_noise: PressureNoise = field(default_factory=PressureNoise.typical)
    reward_terms: Mapping[str, RewardTerm] = field(default_factory=lambda: REWARD_TERMS)
    observation_terms: Mapping[str, ObservationTerm] = field(default_factory=lambda: OBSERVATION_TERMS)
    randomisation: Randomisation = FIXED

    def __post_init__(self) -> None:
        low, high = self.hold
        check_range("control_step", self.control_step, "s", gt=0.0)
        check_range("target_clearance", self.target_clearance, "rad", ge=0.0)
        check_range("target_change", self.target_change, "rad", ge=0.0)
        check_range("tolerance", self.tolerance, "rad", gt=0.0, lt=math.inf)
        check_range("dwell", self.dwell, "s", ge=0.0, le=low, note=", the shortest hold")
        check_integer("rate_samples", self.rate_samples, ge=2)
        check_integer("signal_memory", self.signal_memory, ge=2)
        for holds, message in (
            (divides(self.sample_step, self.control_step), f"sample_step is {self.sample_step} s, but must divide "
             f"control_step = {self.control_step} s"),
            (self.control_step <= low <= high < math.inf, f"hold is ({low}, {high}) s, but must be at least one control "
             "step, low before high"),
        ):  # fmt: skip
            if not holds:
                raise ValueError(message)
