"""Reference controller of ``AORO/Loading-v0``: inverse kinematics and proportional-derivative control along way-points.

It goes round a list of way-points: over the log, down to it, close, up, over the bunk, down to it, open. Of each it makes
joints by the crane's inverse kinematics, and signals of the valves by a proportional law on the joints, with the rate of the
joints' own velocities taken off (PD), in units of what a section gives at full signal, lifted over the valves' dead band.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from aoro_gym.agents.controllers.turning import require_terms
from aoro_gym.agents.policies.policy import Actions, Observations
from aoro_gym.envs.loading.config import SIGNALS, LoadingConfig
from aoro_gym.machine.vehicle_crane import VehicleCrane

Floats = NDArray[np.float64]

NEEDED = ("joints", "joint_rates", "grapple", "log", "log_angle", "bunk", "bunk_angle")
"""Observation terms that it reads."""
OVER_LOG, GRASP, RAISE, OVER_BUNK, LOWER = range(5)
"""Phases: over the log, down to it, up with it, over the bunk, down on it."""


@dataclass(frozen=True)
class Loader:
    """What the controller knows beside the observation: its columns, and the crane.

    Raises ValueError if the observation lacks a term that it needs.
    """

    layout: Mapping[str, slice]
    """``env.unwrapped.observation_layout``"""
    vehicle: VehicleCrane
    config: LoadingConfig

    def __post_init__(self) -> None:
        require_terms(self.layout, *NEEDED)

    @classmethod
    def of(cls, env: Any) -> Loader:
        """That of an environment, wrapped or not, single or vector."""
        env = env.unwrapped
        env = getattr(env, "vector", env)
        return cls(env.observation_layout, env.task.crane, env.task.config)

    def see(self, observations: Observations) -> dict[str, Floats]:
        """The observation's terms by name, each (N, columns)."""
        rows = np.asarray(observations, dtype=np.float64)
        return {name: rows[:, self.layout[name]] for name in NEEDED}

    def full_rates(self, joints: Floats) -> Floats:
        """Rates (N, 4) of the joints at full signal [rad/s, m/s]: nominal flows over the displacements."""
        valves = self.vehicle.mount.valves
        flows = np.array([valves.slew_flow, valves.lift_flow, valves.fold_flow, valves.telescope_flow])
        return flows / np.abs(self.vehicle.crane.displacements(joints.T)).T


@dataclass
class WaypointLoader:
    """Way-points, inverse kinematics, and PD on the joints."""

    loader: Loader
    """What is known of the crane."""
    gain: float = 0.5
    """Of the joints' errors [1/s]."""
    damping: float = 0.3
    """Share [-] of the measured rates that is taken off."""
    ramp: float = 2.1
    """Time [s] over which a signal goes from 0 to 1: that of a swing of the grapple leaves none of it. 0: at once."""
    clearance: float = 1.0
    """Height [m] over log and bunk from which the grapple goes down."""
    slow: float = 0.4
    """Largest signal [-] on the way down."""
    _phase: NDArray[np.int64] | None = field(default=None, init=False, repr=False)
    _demand: Floats = field(default_factory=lambda: np.zeros((0, 4)), init=False, repr=False)

    def reset(self, mask: NDArray[np.bool_] | None = None) -> None:
        """Begin with the first way-point in all sub-environments, or in those of the mask (N,)."""
        if mask is None or self._phase is None:
            self._phase = None
            return
        self._phase[mask] = OVER_LOG
        self._demand[mask] = 0.0

    def __call__(self, observations: Observations) -> Actions:
        seen = self.loader.see(observations)
        count = len(seen["joints"])
        if self._phase is None or len(self._phase) != count:
            self._phase, self._demand = np.full(count, OVER_LOG), np.zeros((count, 4))
        joints, held = seen["joints"], seen["grapple"][:, 1] > 0.5
        tip = self.loader.vehicle.tip(joints.T).T
        to_log, to_bunk = seen["log"], seen["bunk"]
        self._advance(held, to_log, to_bunk, np.abs(seen["joint_rates"]).max(axis=1))
        phase = self._phase[:, None]
        up = np.array([0.0, 0.0, self.clearance])
        way = np.select(
            [phase == OVER_LOG, phase == GRASP, phase == RAISE, phase == OVER_BUNK],
            [to_log + up, to_log, self._upwards(tip), to_bunk + up],
            to_bunk + np.array([0.0, 0.0, 0.25]),
        )
        wanted = self._joints(tip + way, joints)
        signals = self._signals(wanted, seen)
        signals[:, 4] = self._turning(phase[:, 0], seen)
        close = (phase[:, 0] == GRASP) & (np.hypot(to_log[:, 0], to_log[:, 1]) < 0.2) & (np.abs(to_log[:, 2]) < 0.2)
        drop = (phase[:, 0] == LOWER) & (np.abs(to_bunk[:, :2]).max(axis=1) < 0.25) & (to_bunk[:, 2] > -0.45)
        signals[:, 5] = np.where((held & ~drop) | close, 1.0, -1.0)
        return signals.astype(np.float32)

    def _advance(self, held: NDArray[np.bool_], to_log: Floats, to_bunk: Floats, rates: Floats) -> None:
        """Go on to the next way-point where this one is reached."""
        phase = self._phase
        assert phase is not None
        over_log = np.hypot(to_log[:, 0], to_log[:, 1]) < 0.3
        over_bunk = np.hypot(to_bunk[:, 0], to_bunk[:, 1]) < 0.3
        lifted = to_bunk[:, 2] < -0.3
        for was, when, then in (
            (OVER_LOG, over_log & ~held, GRASP),
            (GRASP, held, RAISE),
            (RAISE, lifted & held, OVER_BUNK),
            (OVER_BUNK, over_bunk & held, LOWER),
        ):
            phase[(phase == was) & when] = then
        phase[(phase == GRASP) & (np.hypot(to_log[:, 0], to_log[:, 1]) > 0.8)] = OVER_LOG

    def _upwards(self, tip: Floats) -> Floats:
        """Way straight up to where a log passes over the stakes (N, 3)."""
        way = np.zeros_like(tip)
        way[:, 2] = 4.1 - tip[:, 2]
        return way

    def _joints(self, tip: Floats, joints: Floats) -> Floats:
        """Joints (N, 4) that bring the tip to places (N, 3) of the front frame, with the telescope out as little as reach
        and fold's range ask; where none do, the nearest along the way from the pillar that do."""
        crane = self.loader.vehicle.crane
        x, y, z = self.loader.vehicle.at_foot(tip.T)
        along, over = np.hypot(x, y) - crane.lift.offset, z - crane.lift.height
        far = np.hypot(along, over)
        boom = float(np.asarray(crane.boom.length))
        least, most = (
            float(np.asarray(crane.stick.length)),
            float(np.asarray(crane.stick.length + crane.telescope.stroke)),
        )
        stick = np.clip(far - 0.93 * boom, least, most)
        nearest = np.sqrt(boom**2 + stick**2 + 2.0 * boom * stick * np.cos(crane.fold.low + 0.05))
        reach = np.clip(far, nearest, boom + stick - 0.02)
        cosine = (reach**2 - boom**2 - stick**2) / (2.0 * boom * stick)
        fold = -np.arccos(np.clip(cosine, -1.0, 1.0))
        lift = np.arctan2(over, along) - np.arctan2(stick * np.sin(fold), boom + stick * np.cos(fold))
        slew = np.arctan2(y, x)
        # by the way that the joint has: not over the end of its range
        turn = np.mod(slew - joints[:, 0] + np.pi, 2.0 * np.pi) - np.pi
        limit = float(np.asarray(crane.slew.range)) - 0.02
        slew = joints[:, 0] + turn
        slew = np.where(np.abs(slew) > limit, slew - 2.0 * np.pi * np.sign(slew), slew)
        lift = np.clip(lift, np.asarray(crane.lift.low) + 0.01, np.asarray(crane.lift.high) - 0.01)
        return np.stack([slew, lift, fold, stick - least], axis=1)

    def _signals(self, wanted: Floats, seen: Mapping[str, Floats]) -> Floats:
        """Signals (N, 6) of the valves for joints (N, 4); those of the grapple are left at 0."""
        joints, rates = seen["joints"], seen["joint_rates"]
        full = self.loader.full_rates(joints)
        demand = (self.gain * (wanted - joints) - self.damping * rates) / full
        phase = self._phase
        assert phase is not None
        most = np.where((phase == GRASP) | (phase == LOWER), self.slow, 1.0)[:, None]
        # all joints are slowed down alike, so that they arrive together
        largest = np.abs(demand).max(axis=1, keepdims=True)
        demand = demand * np.minimum(1.0, most / np.maximum(largest, 1e-9))
        if self.ramp > 0.0:
            step = self.loader.config.control_step / self.ramp
            demand = self._demand + np.clip(demand - self._demand, -step, step)
        self._demand = demand
        dead = float(np.asarray(self.loader.vehicle.mount.valves.dead_band))
        lifted = np.sign(demand) * (dead + (1.0 - dead) * np.abs(demand))
        out = np.zeros((len(joints), len(SIGNALS)))
        out[:, :4] = np.where(np.abs(demand) > 0.02, np.clip(lifted, -1.0, 1.0), 0.0)
        return out

    def _turning(self, phase: NDArray[np.int64], seen: Mapping[str, Floats]) -> Floats:
        """Signals of the rotator (N,): along the log before the grasp, then along the bunk."""
        config = self.loader.config
        angle = np.where(phase <= GRASP, seen["log_angle"][:, 0], seen["bunk_angle"][:, 0])
        return np.clip(1.5 * angle / config.rotator_rate, -1.0, 1.0)
