"""What the tests of the independent plants share."""

import numpy as np

from aoro_gym.diagnosis_benchmark.independent import FAMILIES, Run, nominal

FRICTIONLESS = {
    "ground_friction": 1e-6, "swivel_friction": 1e-6, "joint_friction": 1e-3, "seal_friction": 1e-3, "seal_pressure": 0.0,
    "seal_viscous": 0.0, "wheel_brake": 1e-6, "air": 1e-7, "joint_damping": 0.0, "joint_play": 0.0, "cylinder_leakage": 0.0,
    "cross_leakage": 0.0, "slope_along": 0.0, "slope_across": 0.0,
}  # fmt: skip
"""A machine on ice without friction, air and leakage."""


def turn(family: str, share: float, duration: float, rest: float = 0.3, **more) -> Run:
    """A turn from one stop towards the other."""
    machine = more.pop("machine", nominal(family))
    command = np.full(round(duration * 100), share)
    command[: round(rest * 100)] = 0.0
    start = -np.sign(share) * (machine["stop_angle"] - 2e-4)
    return Run(family, machine, command, joint_angle=more.pop("joint_angle", start), **more)


def back_and_forth(family: str, **more) -> Run:
    """A short manoeuvre in both directions."""
    command = np.zeros(130)
    command[20:60] = 0.9
    command[75:] = -0.6
    return Run(family, more.pop("machine", nominal(family)), command, **more)


__all__ = ["FAMILIES", "FRICTIONLESS", "back_and_forth", "turn"]
