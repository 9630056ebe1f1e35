"""Who drives while the arms level: a path controller on what the machine measures."""

from __future__ import annotations

from dataclasses import dataclass

from aoro_gym.checks import check_range
from aoro_gym.envs.path_tracking.view import PathTrackingView
from aoro_gym.execution.array_api import Array

SLOWEST = 0.3
"""Speed [m/s] below which it steers as at this one."""


@dataclass(frozen=True)
class PathDriver:
    """Stanley's law for a machine with an articulated joint, at a constant drive signal: what
    :class:`aoro_gym.agents.controllers.path_tracking.Stanley` does, on the arrays of a task. Its gains are a part of the
    task, and stay where those of the controller are tuned anew.

    The joint turns to θ(κ) − ``heading_gain`` (e_ψ + atan(``cross_track_gain`` e / v)): the angle of the path's bend κ,
    less what closes the heading error e_ψ and the cross-track error e at the speed v.
    """

    drive_signal: float = 0.66
    """[-]"""
    heading_gain: float = 7.98
    """Joint angle per heading [-]."""
    cross_track_gain: float = 1.09
    """[1/s]"""
    look_ahead: float = 0.404
    """Where the path's bend is read [m]; at most the first distance of the preview."""
    gain: float = 1.04
    """Signal per error of the joint angle [1/rad]."""
    lead_time: float = 0.1
    """Time [s] at the present rate after which the joint's error counts."""
    rest_error: float = 0.0301
    """Error of the joint angle [rad] that is left alone."""
    dead_band_left: float = 0.135
    """Signal [-] that moves nothing to the left."""
    dead_band_right: float = 0.175
    """The same to the right."""

    def __post_init__(self) -> None:
        check_range("drive_signal", self.drive_signal, ge=-1.0, le=1.0)
        for name in ("heading_gain", "cross_track_gain", "look_ahead", "gain", "lead_time", "rest_error"):
            check_range(name, getattr(self, name), ge=0.0)
        for name in ("dead_band_left", "dead_band_right"):
            check_range(name, getattr(self, name), ge=0.0, lt=1.0)

    def signals(self, view: PathTrackingView, first: float, front: Array, rear: Array, limit: Array) -> Array:
        """Steering and drive signal (N, 2), float32.

        Args:
            view: What is measured.
            first: The preview's first distance [m].
            front: Hinge to front axle [m] (N,).
            rear: Hinge to rear axle [m] (N,).
            limit: Largest joint angle [rad] (N,).
        """
        xp = view.xp
        share = min(self.look_ahead / first, 1.0)
        curvature = (1.0 - share) * view.curvature[:, 0] + share * view.curvature[:, 1]
        # of a steady turn: sin θ = κ (f cos θ + r)
        lean = xp.atan(curvature * front)
        bend = lean + xp.asin(xp.clip(curvature * rear * xp.cos(lean), -1.0, 1.0))
        speed = xp.clip(view.measured_speed, SLOWEST, None)
        closing = xp.atan(self.cross_track_gain * view.measured_cross_track / speed)
        wanted = xp.clip(bend - self.heading_gain * (view.measured_heading_error + closing), -limit, limit)
        left = wanted - view.measured_angle - self.lead_time * view.measured_rate
        demand = xp.clip(self.gain * left, -1.0, 1.0)
        # torch makes float32 of two numbers
        skipped = xp.where(demand > 0.0, xp.full_like(demand, self.dead_band_left), self.dead_band_right)
        steering = xp.sign(demand) * (skipped + (1.0 - skipped) * xp.abs(demand))
        steering = xp.where(xp.abs(left) > self.rest_error, steering, 0.0)
        return xp.astype(xp.stack([steering, xp.full_like(steering, self.drive_signal)], axis=1), xp.float32)
