"""What keeps a laboratory whole: limits, a soft start, and a stop that latches."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

import numpy as np
import numpy.typing as npt

from aoro_gym.checks import check_range

Array = npt.NDArray[np.float32]


@dataclass(frozen=True)
class Limits:
    """What a laboratory bears. All are choices of who runs it; these defaults suit the machine, not a rig (E)."""

    torque: float = 20_000.0
    """Largest torque at a hub [N m]: the motor at its relief pressure gives 18.8 kN m."""
    speed: float = 12.0
    """Largest wheel rate [rad/s]: 28 km/h."""
    acceleration: float = 200.0
    """Largest change of a set-point [rad/s²], to which it is limited, and at which it goes to rest after a stop."""
    soft_start: float = 1.0
    """Time [s] over which torques and set-points come up to full size."""
    silence: float = 0.1
    """Time [s] without the other side's packets after which each side stops."""

    def __post_init__(self) -> None:
        for name in ("torque", "speed", "acceleration", "silence"):
            check_range(f"limits.{name}", getattr(self, name), gt=0.0)
        check_range("limits.soft_start", self.soft_start, "s", ge=0.0)


class Phase(StrEnum):
    """Of a laboratory's run."""

    STARTING = "starting"
    RUNNING = "running"
    STOPPED = "stopped"


AT_REST = 1e-3
"""Wheel rate [rad/s] below which hubs stand, so that the parking brake may be set."""


class Protection:
    """Limits what passes between the sides, and stops both; a stop holds until :meth:`rearm`.

    Args:
        limits: What the laboratory bears.
        rest: Torques [N m] that hold the machine at rest, (4, N): the soft start goes from these to the measured ones.
    """

    def __init__(self, limits: Limits, rest: Array):
        self.limits = limits
        self._rest = rest.copy()
        self._setpoints = np.zeros_like(rest)
        self.phase = Phase.STARTING if limits.soft_start > 0.0 else Phase.RUNNING
        self.reason = ""
        """Of the stop, one line."""
        self._started = 0.0

    @property
    def share(self) -> float:
        """Share [-] of full size that torques and set-points have come up to."""
        return 1.0 if self.phase is Phase.RUNNING else min(self._started / max(self.limits.soft_start, 1e-9), 1.0)

    @property
    def at_rest(self) -> bool:
        """Whether all set-points are at rest."""
        return bool(np.all(np.abs(self._setpoints) < AT_REST))

    def stop(self, reason: str) -> None:
        """Stop, and keep the first reason."""
        if self.phase is not Phase.STOPPED:
            self.phase, self.reason = Phase.STOPPED, reason

    def rearm(self, rest: Array) -> None:
        """Begin anew with a soft start, the machine held at ``rest`` by torques [N m]; only once the hubs stand."""
        if self.phase is Phase.STOPPED and not self.at_rest:
            raise ValueError("the laboratory's hubs still turn; wait until their set-points are at rest, then rearm")
        self.phase = Phase.STARTING if self.limits.soft_start > 0.0 else Phase.RUNNING
        self.reason, self._started, self._rest = "", 0.0, rest.copy()

    def setpoints(self, rates: Array, period: float) -> Array:
        """Set-points [rad/s] of the dynamometers for wheel ``rates`` (4, N), after a ``period`` [s]."""
        worst = float(np.max(np.abs(rates), initial=0.0))
        if not np.all(np.isfinite(rates)):
            self.stop("a wheel rate of the twin is not finite")
        elif worst > self.limits.speed:
            self.stop(f"a wheel rate is {worst:.3g} rad/s, but the limit is {self.limits.speed:g} rad/s")
        wanted = np.zeros_like(rates) if self.phase is Phase.STOPPED else self.share * rates
        most = np.float32(self.limits.acceleration * period)
        self._setpoints = self._setpoints + np.clip(wanted - self._setpoints, -most, most)
        return np.array(self._setpoints, dtype=np.float32)

    def torques(self, measured: Array, period: float) -> Array:
        """Torques [N m] for the twin where those were ``measured`` (4, N), after a ``period`` [s]."""
        worst = float(np.max(np.abs(measured), initial=0.0))
        if not np.all(np.isfinite(measured)):
            self.stop("a measured torque is not finite")
        elif worst > self.limits.torque:
            self.stop(f"a hub's torque is {worst:.4g} N m, but the limit is {self.limits.torque:g} N m")
        share = self.share
        if self.phase is Phase.STARTING:
            self._started += period
            if self._started >= self.limits.soft_start:
                self.phase = Phase.RUNNING
        return np.asarray(self._rest + share * (measured - self._rest) if share < 1.0 else measured, dtype=np.float32)
