"""What a machine of this kind is commanded: names, bounds and what they are at rest."""

from __future__ import annotations

WHEELS = ("fl", "fr", "rl", "rr")
"""Order of wheels and arms everywhere: front left, front right, rear left, rear right."""
JOINTS = ("slew", "lift", "fold", "telescope")
"""Order of a crane's joints everywhere, from the foot out."""

COMMAND_BOUNDS: dict[str, tuple[float, float, float]] = {
    "steering_signal": (-1.0, 1.0, 0.0),
    "drive_signal": (-1.0, 1.0, 0.0),
    **{f"arm_{wheel}": (-1.0, 1.0, 0.0) for wheel in WHEELS},
    **{f"traction_{wheel}": (0.0, 1.0, 1.0) for wheel in WHEELS},
    "gear": (1.0, 3.0, 1.0),
    "parking_brake": (0.0, 1.0, 0.0),
}
"""Lowest, highest and initial value of every command; a share where it is none of 1, 2, 3 (gear)."""

CRANE_COMMAND_BOUNDS: dict[str, tuple[float, float, float]] = {
    **{f"crane_{joint}": (-1.0, 1.0, 0.0) for joint in JOINTS},
    "crane_held_mass": (0.0, 1e4, 0.0),
    "crane_held_yaw": (-100.0, 100.0, 0.0),
    "crane_held_axial": (0.0, 5e4, 0.0),
    "crane_held_transverse": (0.0, 5e4, 0.0),
}
"""The same of the commands that only machines with a crane have, after the others: signals of its valve sections, and the
log that its grapple holds: mass [kg] (0: none), angle to the pillar [rad], moments of inertia along and across [kg m²]."""

ALL_COMMAND_BOUNDS = {**COMMAND_BOUNDS, **CRANE_COMMAND_BOUNDS}
"""Of all commands, those of a crane last."""
