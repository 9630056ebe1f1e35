"""Tires and hulls on plane ground in float64 NumPy: the reference for the device laws.

Vectors are arrays (3, ...) in the axes of the half-frame that carries the wheel (x forward, y left, z up); `...` is any
trailing shape, (4,) wheels and a batch axis for instance.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

DISC_BLEND = 0.002  # [m] of depth by which discs differ that share the contact
ROLLING_SPEED = 0.05  # [rad/s] width of the rolling resistance's sign change
HULL_SLIP_SPEED = 0.05  # [m/s] width of the hull friction's sign change


@dataclass(frozen=True)
class Plane:
    """Plane z = slope_x x + slope_y y + height, with multipliers of the tire's friction and rolling resistance."""

    slope_x: float = 0.0
    slope_y: float = 0.0
    height: float = 0.0
    friction: float = 1.0
    rolling_resistance: float = 1.0

    @property
    def normal(self):
        """Unit normal in the world (3,)."""
        n = np.array([-self.slope_x, -self.slope_y, 1.0])
        return n / np.linalg.norm(n)

    def gap(self, point):
        """Height of the ground above a world point [m]: positive where the point is under ground."""
        return self.slope_x * point[0] + self.slope_y * point[1] + self.height - point[2]


def cross(a, b):
    """Cross product along the first axis, with broadcasting of the rest."""
    return np.stack(
        np.broadcast_arrays(a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])
    )


class Tire:
    """Five discs, one contact point on or between the deepest, spring and damper along the normal, LuGre bristles."""

    def __init__(self, tire):
        self.p = tire
        inner, outer = tire.disc_offset_inner, tire.disc_offset_outer
        self.offsets = np.array([0.0, -inner, inner, -outer, outer])
        self.radii = tire.radius - np.array(
            [0.0, tire.disc_drop_inner, tire.disc_drop_inner, tire.disc_drop_outer, tire.disc_drop_outer]
        )

    def contact(self, center_gap, n, normal_z, z, center_velocity, angular, spin, friction, rolling):
        """Force and moment of one or more wheels.

        center_gap (...): height of the ground above the wheel centre [m] (negative: above ground); n (3, ...): ground
        normal; normal_z: its z part in the world; z (2, ...): bristles [m]; center_velocity (3, ...): of the wheel
        centre; angular (3, ...): angular velocity of the half-frame; spin (...): absolute spin about y.
        Returns force on the wheel (3, ...), its moment about the wheel centre (3, ...) with rolling resistance in the
        y part, bristle rates (2, ...), and a dictionary of depth, load, slip velocity and dissipated power.
        """
        p = self.p
        in_plane = np.hypot(n[0], n[2])
        down = np.stack([-n[0] / in_plane, np.zeros_like(n[0]), -n[2] / in_plane])
        shape = (5,) + (1,) * (n.ndim - 1)
        y, r = self.offsets.reshape(shape), self.radii.reshape(shape)
        # On a plane: gap(P)*n_z = gap(centre)*n_z - n.(P - centre); exact, no world position needed.
        depths = center_gap * normal_z - (n[1] * y + (n[0] * down[0] + n[2] * down[2]) * r)
        deepest = depths.max(axis=0)
        weight = np.exp((depths - deepest) / DISC_BLEND)
        level = np.exp((self.radii - p.radius) / DISC_BLEND).sum()
        depth = deepest + DISC_BLEND * np.log(weight.sum(axis=0) / level)
        share = weight / weight.sum(axis=0)
        y, r = (share * y).sum(axis=0), (share * r).sum(axis=0)
        arm = np.stack([r * down[0], y * np.ones_like(r), r * down[2]]) - (depth - (share * depths).sum(axis=0)) * n
        rotation = np.stack(np.broadcast_arrays(angular[0], spin, angular[2]))
        velocity = center_velocity + cross(rotation, arm)
        n_velocity = (n * velocity).sum(axis=0)
        touching = depth > 0.0
        load = np.where(touching, np.maximum(0.0, p.stiffness * depth - p.damping * n_velocity), 0.0)
        t_x = np.stack([n[2] / in_plane, np.zeros_like(n[0]), -n[0] / in_plane])
        t_y = cross(n, t_x)
        v = np.stack([(t_x * velocity).sum(axis=0), (t_y * velocity).sum(axis=0)])
        slip = np.hypot(v[0], v[1])
        g = friction * (
            p.friction_coulomb + (p.friction_static - p.friction_coulomb) * np.exp(-((slip / p.stribeck_velocity) ** 2))
        )
        column = (2,) + (1,) * (n.ndim - 1)
        sigma0 = np.array([p.sigma0_longitudinal, p.sigma0_lateral]).reshape(column)
        sigma1 = np.array([p.sigma1_longitudinal, p.sigma1_lateral]).reshape(column)
        sigma2 = np.array([p.sigma2_longitudinal, p.sigma2_lateral]).reshape(column)
        z_rate = v - sigma0 * slip * z / g
        push = load * (sigma0 * z + sigma1 * z_rate + sigma2 * v)
        z_rate = np.where(touching, z_rate, -z / 1e-3)
        force = load * n - push[0] * t_x - push[1] * t_y
        moment = cross(arm, force)
        resistance = -rolling * p.rolling_resistance * load * (arm * down).sum(axis=0) * np.tanh(spin / ROLLING_SPEED)
        moment = np.stack([moment[0], moment[1] + resistance, moment[2]])
        info = {
            "depth": depth,
            "load": load,
            "slip": v,
            "push": push,
            "arm": arm,
            "velocity": velocity,
            "rolling_power": resistance * spin,
        }
        return force, moment, z_rate, info


def hull_force(hull, depth, n, velocity):
    """Penalty force (3, ...) on hull corners: spring and damper along the normal, regularised Coulomb friction."""
    n_velocity = (n * velocity).sum(axis=0)
    load = np.where(depth > 0.0, np.maximum(0.0, hull.stiffness * depth - hull.damping * n_velocity), 0.0)
    tangent = velocity - n_velocity * n
    speed = np.sqrt((tangent**2).sum(axis=0) + HULL_SLIP_SPEED**2)
    return load * n - hull.friction * load * tangent / speed
