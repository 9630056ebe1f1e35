"""What stands up around a machine, by sectors, as its lidar shows it: stems, boulders, logs and stumps, not the ground.

A pulse that meets a stem meets it above the pulse below it, at about the same distance; two that meet the ground are apart.
So two neighbouring echoes of a column, with the tilt that the inertial unit measures taken off, stand up where the line
through them is steeper than any ground that one drives on (I. Bogoslavskyi and C. Stachniss, "Fast range image-based
segmentation of sparse 3D laser scans for online operation", IROS 2016, by the angle between neighbouring beams, likewise).

What this cannot tell apart: low branches, and shrubs that are as high as the distance of two rings there. What it does not
see: what two rings do not meet: boulders and logs that are lower than about 0.7 m."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import Any

from aoro_gym.checks import check_range
from aoro_gym.envs.core.ray_terms import LidarView
from aoro_gym.envs.core.terms import ObservationTerm
from aoro_gym.execution.array_api import Array
from aoro_gym.sensors.lidar import MODELS, LidarModel, Mounting

RINGS_DEG = (1.0, -4.0, -9.0, -15.0, -22.0, -30.0)
"""Elevations: the highest looks at stems, the lowest meets level ground 2.8 m ahead. (E)"""
COLUMNS = 90
"""Of a sweep: one every 4°."""
REACH = 15.0
"""[m] up to which is looked, and what a sector shows in which nothing stands."""
PLACE = (2.4, 0.0, 1.6)
"""Of the lidar [m], from the point on the ground under the hinge at rest: on the bonnet. (E)"""


def forest_lidar(columns: int = COLUMNS, reach: float = REACH) -> LidarModel:
    """A lidar with few rings, of the noise and the beam of a VLP-16.

    Args:
        columns: Pulses of each ring a sweep.
        reach: Longest range [m].
    """
    return replace(
        MODELS["vlp-16"], name="forest", elevation_deg=RINGS_DEG, columns=columns, max_range=reach, ring_delay=0.0
    )


def _view() -> LidarView:
    return LidarView(model=forest_lidar(), mounting=Mounting(PLACE), position_error=0.02, angle_error_deg=0.5)


@dataclass(frozen=True)
class ObstacleView:
    """Distances [m] in plan from the lidar to the nearest thing that stands up in each sector, its reach where nothing does;
    from behind by the left to the front and on by the right (N, K)."""

    lidar: LidarView = field(default_factory=_view)
    """Whose rings are from the highest to the lowest."""
    steepest_deg: float = 50.0
    """Steeper lines between two echoes stand up."""

    def __post_init__(self) -> None:
        check_range("steepest_deg", self.steepest_deg, "deg", gt=0.0, lt=90.0)
        if self.lidar.model.pattern != "rings":
            raise ValueError(f"the lidar {self.lidar.model.name!r} has no rings; take one that has")

    @property
    def oldest(self) -> float:
        """Age [s] of the oldest pose that is asked for."""
        return self.lidar.oldest

    @property
    def azimuths(self) -> Any:
        """(K,) directions [rad] of the sectors' middles, positive left, in the machine's axes."""
        return self.lidar.directions[: self.lidar.model.columns, 0]

    def swept(self, view: Any) -> Array:
        """Ranges [m] of the lidar's last sweep (N, pulses), cast once a step for all terms."""
        return view.rays.once(self.lidar, view, lambda: self.lidar(view))

    def __call__(self, view: Any) -> Array:
        return view.rays.once(self, view, lambda: self._shown(view))

    def _shown(self, view: Any) -> Array:
        xp, columns = view.xp, self.lidar.model.columns
        ranges = xp.astype(self.swept(view), xp.float64)
        angles = view.rays.made(("obstacles", self.lidar), lambda: view.rays.arrays.asarray(self.lidar.directions))
        azimuth, elevation = angles[:, 0][None], angles[:, 1][None]
        roll, pitch = view.measured_roll[:, None], view.measured_pitch[:, None]
        level = elevation - pitch * xp.cos(azimuth) + roll * xp.sin(azimuth)
        count = len(self.lidar.model.elevation_deg)
        shape = (len(ranges), count, columns)
        away, up = (xp.reshape(ranges * part, shape) for part in (xp.cos(level), xp.sin(level)))
        seen = xp.reshape(ranges < self.lidar.model.max_range - 0.01, shape)
        higher, lower = slice(0, count - 1), slice(1, count)
        rise = up[:, higher] - up[:, lower]
        run = xp.abs(away[:, higher] - away[:, lower])
        stands = (rise > math.tan(math.radians(self.steepest_deg)) * run) & seen[:, higher] & seen[:, lower]
        nearer = xp.minimum(away[:, higher], away[:, lower])
        return xp.min(xp.where(stands, nearer, self.lidar.model.max_range), axis=1)


def obstacles(**settings: Any) -> ObservationTerm:
    """The term ``obstacles``; ``settings`` are fields of :class:`ObstacleView`.

    Raises ``ValueError`` naming the field, its value and its bound.
    """
    found = ObstacleView(**settings)
    return ObservationTerm(found, 0.0, found.lidar.model.max_range)
