"""What a machine of this kind is commanded: names, bounds and what they are at rest."""

from __future__ import annotations

WHEELS = ("fl", "fr", "rl", "rr")
"""Order of wheels and arms everywhere: front left, front right, rear left, rear right."""

COMMAND_BOUNDS: dict[str, tuple[float, float, float]] = {
    "steering_signal": (-1.0, 1.0, 0.0),
    "drive_signal": (-1.0, 1.0, 0.0),
    **{f"arm_{wheel}": (-1.0, 1.0, 0.0) for wheel in WHEELS},
    **{f"traction_{wheel}": (0.0, 1.0, 1.0) for wheel in WHEELS},
    "gear": (1.0, 3.0, 1.0),
    "parking_brake": (0.0, 1.0, 0.0),
}
"""Lowest, highest and initial value of every command; a share where it is none of 1, 2, 3 (gear)."""
