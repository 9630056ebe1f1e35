"""The joint between the frames: torque of oil, seals, bearing and end stops; play and frame where it is elastic."""

# device code: its types are Warp's
# pyright: reportGeneralTypeIssues=false, reportInvalidTypeForm=false, reportOperatorIssue=false
# pyright: reportCallIssue=false, reportIndexIssue=false, reportArgumentType=false, reportAssignmentType=false
from typing import Any

import numpy as np
import warp as wp

from aoro_gym.diagnosis_benchmark.plants.friction import BEARING_RATIO, dry_law, prandtl_force, stribeck_level
from aoro_gym.diagnosis_benchmark.plants.linkage import Cylinders, Displacement, cylinders_of
from aoro_gym.diagnosis_benchmark.plants.records import Constants, clipped, f64, positive, record, square

PISTON_INERTIA = wp.constant(f64(2.0))
"""[kg m²] about the joint of what moves between play and oil: rods and pistons, about 30 kg each at 0.18 m."""

PIN_STIFFNESS = 1.3e7
"""[N m/rad] about the joint of pins that touch: 2e8 N/m each at a lever of 0.18 m."""

LEAST_COMPLIANCE = 1e-8
"""[rad/(N m)] below which a frame's flexibility cannot be stepped, nor seen: 0.005° at 10 kN m."""

Joint = record(
    "Joint",
    "preload pressed static_ratio stribeck viscous bearing bump presliding presliding_damping stop stop_damping play series "
    "series_damping",
    cylinders=Cylinders,
    level=wp.int32,
    elastic=wp.int32,
)
"""Seals [N, N/Pa, 1, m/s, N s/m], bearing and its damaged spot [N m], bristles and stops [N m/rad, N m s/rad], half play
[rad], and the spring and damper of pins and frame; which law of friction, and whether pins and frame yield."""


def joint_of(p: Constants, level: int) -> dict[str, Any]:
    """Fields of :data:`Joint` (R,)."""
    part, cylinders = "steering.cylinder.", cylinders_of(p)
    elastic = (p["joint.play"] > 0.0) | (p["joint.compliance"] > 0.0)
    compliance = np.where(p["joint.compliance"] > 0.0, np.maximum(p["joint.compliance"], LEAST_COMPLIANCE), 0.0)
    compliance = compliance + np.where(p["joint.play"] > 0.0, 1.0 / PIN_STIFFNESS, 0.0)
    series = np.where(elastic, 1.0 / np.where(elastic, compliance, 1.0), 0.0)
    stop = 2.0 * np.square(cylinders["mean_lever"])
    return {
        "preload": p[part + "seal_preload"], "pressed": p[part + "seal_pressure_coefficient"],
        "static_ratio": p[part + "seal_static_ratio"], "stribeck": p[part + "seal_stribeck_velocity"],
        "viscous": p[part + "seal_viscous"], "bearing": p["joint.friction_torque"], "bump": p["joint.bump"],
        "presliding": p["joint.presliding_stiffness"], "presliding_damping": p["joint.presliding_damping"],
        "stop": stop * p["joint.stop_stiffness"], "stop_damping": stop * p["joint.stop_damping"],
        "play": 0.5 * p["joint.play"], "series": series,
        "series_damping": np.sqrt(2.0 * series * float(PISTON_INERTIA)),  # 0.7 of critical for rods and pistons alone
        "cylinders": cylinders, "level": level, "elastic": elastic,
    }  # fmt: skip


@wp.func
def bearing_torque(j: Joint, angle: f64):
    """Breakaway torque of the joint's bearing [N m]; a damaged spot 0.1 rad wide lies at 0.4 rad to the right."""
    torque = j.bearing
    if j.bump != f64(0.0):
        torque += j.bump * wp.exp(-square((angle + f64(0.4)) / f64(0.1)))
    return torque


@wp.func
def seal_torque(j: Joint, lever: f64, pressed: f64):
    """Sliding torque [N m] of the seals of one cylinder; ``pressed`` [Pa]: sum of its ports' pressures."""
    return wp.abs(lever) * (j.preload + j.pressed * pressed)


@wp.func
def capacity(j: Joint, at: Displacement, angle: f64, rate: f64, p_a: f64, p_b: f64):
    """Torque [N m] at which the dry friction of level 0 slides.

    Args:
        at: Geometry of the cylinders at ``angle``.
        angle: Joint angle [rad].
        rate: Joint rate [rad/s].
        p_a: Pressure [Pa] of port A.
        p_b: Pressure [Pa] of port B.
    """
    pressed = positive(p_a) + positive(p_b)
    right = stribeck_level(seal_torque(j, at.right, pressed), j.static_ratio, at.right * rate, j.stribeck)
    left = stribeck_level(seal_torque(j, at.left, pressed), j.static_ratio, at.left * rate, j.stribeck)
    return bearing_torque(j, angle) + right + left


@wp.func
def end_stop(j: Joint, angle: f64, rate: f64):
    """Torque [N m] of the cylinders' ends, which push only."""
    side, depth = wp.sign(angle), wp.abs(angle) - j.cylinders.reach
    torque = f64(0.0)
    if depth > f64(0.0):
        torque = -side * positive(j.stop * depth + j.stop_damping * side * rate)
    return torque


@wp.func
def cylinder_torque(j: Joint, at: Displacement, angle: f64, rate: f64, stretch: f64, p_a: f64, p_b: f64):
    """Torque [N m] of oil, seals, bearing and end stops on the joint angle.

    Args:
        at: Geometry of the cylinders at ``angle``.
        angle: Joint angle [rad].
        rate: Joint rate [rad/s].
        stretch: Bristle [rad] of the dry friction of level 0.
        p_a: Pressure [Pa] of port A.
        p_b: Pressure [Pa] of port B.
    """
    torque = p_a * at.slope_a + p_b * at.slope_b - j.viscous * (square(at.right) + square(at.left)) * rate
    torque += end_stop(j, angle, rate)
    if j.level == 0:
        held = capacity(j, at, angle, rate, p_a, p_b)
        torque += prandtl_force(stretch, rate, j.presliding, j.presliding_damping, held)
    else:
        bearing, pressed = bearing_torque(j, angle), positive(p_a) + positive(p_b)
        torque += dry_law(j.level, j.cylinders.mean_lever * rate, bearing / BEARING_RATIO, bearing)
        right, left = seal_torque(j, at.right, pressed), seal_torque(j, at.left, pressed)
        torque += dry_law(j.level, wp.abs(at.right) * rate, right, right * j.static_ratio)
        torque += dry_law(j.level, wp.abs(at.left) * rate, left, left * j.static_ratio)
    return torque


@wp.func
def series_torque(j: Joint, pin: f64, pin_rate: f64, angle: f64, rate: f64):
    """Torque [N m] that play and frame pass on to the joint; zero within the play, and it never pulls at the edge."""
    apart = pin - angle
    stretch = apart - clipped(apart, j.play)
    torque = j.series * stretch + j.series_damping * (pin_rate - rate)
    touching = j.play == f64(0.0) or torque * stretch > f64(0.0)
    return wp.where(touching, torque, f64(0.0))
