"""The ground under the wheels: the one seam between the vehicle and any terrain.

Every contact asks :func:`ground_height` at a point of the plan, and :func:`ground_surface` once a wheel.
"""

# pyright: reportGeneralTypeIssues=false, reportInvalidTypeForm=false
import warp as wp


@wp.struct
class Ground:
    """A plane through the world's origin."""

    normal: wp.vec3  # unit, upward, world frame
    friction: float  # [-] multiplier of the tire's friction (1 = dry asphalt)
    rolling_resistance: float  # [-] multiplier of the tire's rolling resistance
    gravity: float  # [m/s²]


@wp.func
def ground_height(ground: Ground, x: float, y: float):
    """Height [m] of the ground at the plan position (x, y) [m]."""
    return -(ground.normal[0] * x + ground.normal[1] * y) / ground.normal[2]


@wp.func
def ground_normal(ground: Ground, x: float, y: float):
    """Upward unit normal (world) at the plan position (x, y) [m]."""
    return ground.normal


@wp.func
def penetration(ground: Ground, point: wp.vec3, normal: wp.vec3):
    """Depth [m] of a world point under the ground, along ``normal``; negative above it."""
    return (ground_height(ground, point[0], point[1]) - point[2]) * normal[2]
