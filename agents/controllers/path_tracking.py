"""Reference controllers for ``AORO/PathTracking-v0`` and ``-v1``: ways to steer an articulated machine along a path.

The reference point F is the middle of the front axle. With the hinge ``front`` = f [m] behind it, the rear axle
``rear`` = r [m] behind the hinge, no sideslip of either axle, the joint angle θ (positive left) and the speed v of F, the
rear axle's condition v sin θ − ψ̇ (f cos θ + r) + r θ̇ = 0 gives the front frame's yaw rate

    ψ̇ = (v sin θ + r θ̇) / (f cos θ + r),

so F runs at rest of the joint on the curvature κ(θ) = sin θ / (f cos θ + r) (P. Corke and P. Ridley, "Steering kinematics
for a center-articulated mobile robot", IEEE Trans. Robotics and Automation 17, 2001, with the other axle in front).

All of them see nothing but the observation; what a driver knows of the vehicle stands in :class:`Vehicle`. Gains are
numbers, or arrays (N,) that give every sub-environment its own.

The defaults of PurePursuit, Stanley, PreviewRegulator and FullSpeedSteering are what ``python -m
aoro_gym.agents.training.tuning --env AORO/PathTracking-v0`` finds for the default machine ``aoro`` (seed 0, 160
candidates each), to three digits; but FullSpeedSteering keeps gains of an earlier search, with which it strays less
over whole paths (0.035 m against 0.038 m). The drive signal and the dead bands are the machine's own values. The drive
signal is constant: on these paths at this speed, no slowing down was needed. For ``-v1`` gains are those of
:data:`aoro_gym.agents.controllers.reference.LIMIT_GAINS`; PreviewDriver, which slows down, has defaults for who knows the
true errors.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.linalg import expm, solve_discrete_are

from aoro_gym.agents.controllers.turning import dead_band_compensated, require_terms
from aoro_gym.agents.policies.policy import Actions, Observations
from aoro_gym.envs.path_tracking.assistance import GEAR_DISPLACEMENT
from aoro_gym.machine import Machine

Floats = NDArray[np.float64]

NEEDED = ("cross_track", "heading_error", "preview", "curvature", "speed", "joint_angle", "joint_rate")
"""Observation terms that the controllers read."""
SLOWEST = 0.3
"""Speed [m/s] below which the controllers steer as at this one: at rest, no steering leads back to a path."""
DRIVE_SIGNAL = 0.66
"""Drive signal [-]: 0.82 m/s in first gear, on the mean over forest ground. The published working speed is 0.75 m/s."""


def turn_curvature(joint_angle: ArrayLike, front: float, rear: float) -> Floats:
    """Curvature [1/m], positive left, of the front axle's path at a constant joint angle [rad]; shape of the angle."""
    angle = np.asarray(joint_angle, dtype=np.float64)
    return np.sin(angle) / (front * np.cos(angle) + rear)


def turn_angle(curvature: ArrayLike, front: float, rear: float) -> Floats:
    """Joint angle [rad] that leads the front axle along ``curvature`` [1/m]: the inverse of :func:`turn_curvature`.

    sin θ − κ f cos θ = κ r is sin(θ − α) = κ r cos α with tan α = κ f. Beyond the tightest curvature of all, the angle of
    the tightest one.
    """
    curvature = np.asarray(curvature, dtype=np.float64)
    lean = np.arctan(curvature * front)
    return lean + np.arcsin(np.clip(curvature * rear * np.cos(lean), -1.0, 1.0))


@dataclass(frozen=True)
class Vehicle:
    """What a controller knows beside the observation: its columns, and the vehicle's measures.

    Raises ValueError if the observation lacks a term that the controllers need.
    """

    layout: Mapping[str, slice]
    """``env.unwrapped.observation_layout``"""
    front: float = 1.7
    """Hinge to front axle [m]."""
    rear: float = 1.7
    """Hinge to rear axle [m]."""
    largest_angle: float = math.radians(40.0)
    """Joint angle at its stops [rad]."""
    preview: tuple[float, ...] = (1.0, 2.0, 3.0, 5.0, 8.0)
    """Distances [m] at which the path is previewed."""
    control_step: float = 0.05
    """[s]"""
    top_speed: float = 1.17
    """At full drive signal [m/s], in the gear that is held, the first one where it changes."""

    def __post_init__(self) -> None:
        require_terms(self.layout, *NEEDED)

    @classmethod
    def of(cls, env: Any) -> Vehicle:
        """That of an environment, wrapped or not, single or vector; where its machines differ, their mean.

        Raises ValueError if the action holds more than steering and drive.
        """
        env = env.unwrapped
        env = getattr(env, "vector", env)
        if list(env.action_layout) != ["steering_signal", "drive_signal"]:
            raise ValueError(
                f"the environment acts on {', '.join(env.action_layout)}, but the reference controllers steer and drive "
                "only; leave out act_arms, act_traction and act_gear"
            )
        frame, config = env.twin.machine.frame, env.task.config
        gear = config.gear if isinstance(config.gear, int) else 1
        return cls(
            env.observation_layout,
            front=float(np.mean(frame.front.axle_distance)),
            rear=float(np.mean(frame.rear.axle_distance)),
            largest_angle=float(np.mean(env.twin.machine.joint.range)),
            preview=config.preview,
            control_step=config.control_step,
            top_speed=_top_speed(env.twin.machine) / GEAR_DISPLACEMENT[gear - 1],
        )

    def see(self, observations: Observations) -> VehicleState:
        """The observation by name."""
        rows = np.asarray(observations, dtype=np.float64)
        return VehicleState(self, {name: rows[:, columns] for name, columns in self.layout.items()})


def _top_speed(machine: Machine) -> float:
    """Of the pump's full flow through the motors' full displacement [m/s]; where machines differ, their mean."""
    driveline = machine.driveline
    flow = driveline.pump.displacement * machine.engine.set_speed
    return float(np.mean(np.asarray(flow / (4.0 * driveline.motor.displacement) * machine.tire.radius)))


@dataclass(frozen=True)
class VehicleState:
    """What N controllers see; arrays (N,), SI."""

    vehicle: Vehicle
    terms: Mapping[str, Floats]

    def __getitem__(self, name: str) -> Floats:
        """A term of one column (N,)."""
        return self.terms[name][:, 0]

    @property
    def speed(self) -> Floats:
        """Speed to steer for [m/s]: at least ``SLOWEST``."""
        return np.maximum(self["speed"], SLOWEST)

    def curvature(self, ahead: ArrayLike) -> Floats:
        """Curvature [1/m] of the path ``ahead`` [m] of the vehicle, linear between the preview's places."""
        return _between((0.0, *self.vehicle.preview), self.terms["curvature"], ahead)

    def place(self, ahead: ArrayLike) -> tuple[Floats, Floats]:
        """x forward and y left [m] of the path ``ahead`` [m] of the vehicle's projection."""
        offset, turned = self["cross_track"], self["heading_error"]
        preview = self.terms["preview"].reshape(len(offset), -1, 2)
        # the projection itself lies across the path's heading
        x = np.column_stack([-offset * np.sin(turned), preview[..., 0]])
        y = np.column_stack([-offset * np.cos(turned), preview[..., 1]])
        nodes = (0.0, *self.vehicle.preview)
        return _between(nodes, x, ahead), _between(nodes, y, ahead)


def _between(nodes: tuple[float, ...], values: Floats, where: ArrayLike) -> Floats:
    """Values (N,) at ``where``, linear between ``nodes`` (K,), at which they are ``values`` (N, K)."""
    where = np.broadcast_to(np.clip(where, nodes[0], nodes[-1]), (len(values),))
    last = np.clip(np.searchsorted(nodes, where, side="right") - 1, 0, len(nodes) - 2)
    low, high = np.asarray(nodes)[last], np.asarray(nodes)[last + 1]
    share, rows = (where - low) / (high - low), np.arange(len(values))
    return (1.0 - share) * values[rows, last] + share * values[rows, last + 1]


@dataclass(frozen=True)
class PathController(ABC):
    """A way to steer, at a constant drive signal."""

    vehicle: Vehicle
    drive_signal: ArrayLike = field(default=DRIVE_SIGNAL, kw_only=True)
    """[-]"""
    dead_band_left: ArrayLike = field(default=0.135, kw_only=True)
    """Signal [-] without motion to the left that is skipped: 0.27 V of 2 V."""
    dead_band_right: ArrayLike = field(default=0.175, kw_only=True)
    """The same to the right: 0.35 V."""

    @abstractmethod
    def steer(self, seen: VehicleState) -> Floats:
        """Steering signal (N,)."""

    def __call__(self, observations: Observations) -> Actions:
        steering = self.steer(self.vehicle.see(observations))
        return np.stack(np.broadcast_arrays(steering, self.drive_signal), axis=1).astype(np.float32)

    def reset(self, mask: NDArray[np.bool_] | None = None) -> None:  # noqa: B027 (all there is to do)
        """Nothing to forget."""


@dataclass(frozen=True)
class JointController(PathController):
    """A way to choose the joint angle, and an inner loop that brings the joint there.

    Signal in proportion to the error that ``lead_time`` will leave, lifted over the valve's dead band; see
    :class:`~aoro_gym.agents.controllers.turning.ProportionalDerivative`.
    """

    gain: ArrayLike = field(default=4.0, kw_only=True)
    """Signal per error of the joint angle [1/rad]."""
    lead_time: ArrayLike = field(default=0.1, kw_only=True)
    """[s]"""
    rest_error: ArrayLike = field(default=0.01, kw_only=True)
    """Error of the joint angle [rad] that is left alone."""

    @abstractmethod
    def joint_angle(self, seen: VehicleState) -> Floats:
        """Joint angle (N,) [rad] that would lead onto the path."""

    def left(self, seen: VehicleState) -> Floats:
        """Error of the joint angle (N,) [rad] after ``lead_time`` at the present rate."""
        limit = self.vehicle.largest_angle
        wanted = np.clip(self.joint_angle(seen), -limit, limit)
        return wanted - seen["joint_angle"] - np.asarray(self.lead_time) * seen["joint_rate"]

    def steer(self, seen: VehicleState) -> Floats:
        left = self.left(seen)
        signal = dead_band_compensated(np.asarray(self.gain) * left, self.dead_band_left, self.dead_band_right)
        return np.where(np.abs(left) > self.rest_error, signal, 0.0)


def pursued_angle(seen: VehicleState, distance: ArrayLike) -> Floats:
    """Joint angle (N,) [rad] of the turn that leads from F, along the front frame, through the path ``distance`` [m] ahead.

    The circle through (0, 0) with the tangent (1, 0) and through (x, y) has the curvature 2 y / (x² + y²); see R. C.
    Coulter, "Implementation of the pure pursuit path tracking algorithm", CMU-RI-TR-92-01, 1992.
    """
    x, y = seen.place(distance)
    return turn_angle(2.0 * y / (x * x + y * y), seen.vehicle.front, seen.vehicle.rear)


@dataclass(frozen=True)
class PurePursuit(JointController):
    """The joint turns to where a steady turn would lead through the path, ``look_ahead`` in front of the vehicle."""

    look_ahead: ArrayLike = field(default=0.865, kw_only=True)
    """[m]"""
    gain: ArrayLike = field(default=1.03, kw_only=True)
    lead_time: ArrayLike = field(default=0.00478, kw_only=True)
    rest_error: ArrayLike = field(default=0.0313, kw_only=True)

    def joint_angle(self, seen: VehicleState) -> Floats:
        return pursued_angle(seen, self.look_ahead)


@dataclass(frozen=True)
class FullSpeedSteering(JointController):
    """Full signal left or right, as the real machine is mostly steered: towards the joint angle of pure pursuit, with a dead
    zone. Of the inner loop's gains it uses ``lead_time`` and ``rest_error``, the dead zone."""

    look_ahead: ArrayLike = field(default=1.06, kw_only=True)
    """[m]"""
    lead_time: ArrayLike = field(default=0.0592, kw_only=True)
    rest_error: ArrayLike = field(default=0.271, kw_only=True)

    def joint_angle(self, seen: VehicleState) -> Floats:
        return pursued_angle(seen, self.look_ahead)

    def steer(self, seen: VehicleState) -> Floats:
        left = self.left(seen)
        return np.where(np.abs(left) > self.rest_error, np.sign(left), 0.0)


@dataclass(frozen=True)
class Stanley(JointController):
    """Joint angle of the path's bend, and towards the heading that closes the cross-track error.

    θ = θ(κ) − ``heading_gain`` (e_ψ + atan(``cross_track_gain`` e / v)), with the path's curvature κ ``look_ahead`` in
    front. A car's front wheel is turned by that angle itself (G. M. Hoffmann et al., "Autonomous automobile trajectory
    tracking for off-road driving", ACC 2007); this machine's front frame, which is its wheel, turns only as it drives:
    the heading follows with the time constant (f + r) / (v ``heading_gain``).
    """

    heading_gain: ArrayLike = field(default=5.69, kw_only=True)
    """Joint angle per heading [-]."""
    cross_track_gain: ArrayLike = field(default=1.74, kw_only=True)
    """[1/s]"""
    look_ahead: ArrayLike = field(default=0.0466, kw_only=True)
    """[m]"""
    gain: ArrayLike = field(default=1.31, kw_only=True)
    rest_error: ArrayLike = field(default=0.00625, kw_only=True)

    def joint_angle(self, seen: VehicleState) -> Floats:
        closing = np.arctan(np.asarray(self.cross_track_gain) * seen["cross_track"] / seen.speed)
        bend = turn_angle(seen.curvature(self.look_ahead), self.vehicle.front, self.vehicle.rear)
        return bend - np.asarray(self.heading_gain) * (seen["heading_error"] + closing)


VALVE_SIGNAL = (0.5, 0.75, 1.0)
"""Steering signals [-] of the published full turns: 1.0, 1.5 and 2.0 V; below them the dead band."""
VALVE_RATE_LEFT, VALVE_RATE_RIGHT = (0.2036, 0.5519, 0.7052), (0.1248, 0.4310, 0.6525)
"""Mean joint rates [rad/s] of those turns: 80° in 6.86, 2.53 and 1.98 s to the left, 11.19, 3.24 and 2.14 s to the right."""
REACTION = 0.3
"""Way [m] before braking shows."""
DESIGN_SPEEDS = (SLOWEST, 0.5, 0.75, 1.0, 1.5, 2.0)
"""[m/s] at which the regulator's gains are found; between them they are interpolated."""


@dataclass(frozen=True)
class PreviewRegulator(PathController):
    """Linear-quadratic regulator of the joint's rate that knows the path ahead.

    State x = (e, ψ, c, ω): cross-track error, heading error, joint angle as wheelbase times curvature, c = (f + r) κ(θ),
    and joint rate; input the commanded joint rate u; known disturbance the path's curvature κ. About a straight line, at
    the speed v, with the joint's lag T:

        ė = v ψ,   ψ̇ = (v c + r ω) / (f + r) − v κ,   ċ = ω,   ω̇ = (u − ω) / T.

    It minimises the sum of e² + ``heading_weight`` ψ² + ``rate_weight`` u² over all steps to come, of which the curvatures
    are known as far as the preview reaches; see :func:`preview_gains`. The valve's measured curve makes the signal of u.
    """

    heading_weight: ArrayLike = field(default=0.0314, kw_only=True)
    """[m²/rad²]"""
    rate_weight: ArrayLike = field(default=0.045, kw_only=True)
    """[m² s²/rad²]"""
    lag: ArrayLike = field(default=0.0304, kw_only=True)
    """T: delay, spool and oil column [s]."""
    rest_rate: ArrayLike = field(default=0.0162, kw_only=True)
    """Joint rate [rad/s] that is not worth a signal."""

    @cached_property
    def _gains(self) -> tuple[NDArray[np.intp], Floats]:
        """For every sub-environment the row of its gains (N,), and the gains (rows, speeds, 4 + nodes)."""
        weights = np.stack(np.broadcast_arrays(*map(np.atleast_1d, (self.heading_weight, self.rate_weight, self.lag))))
        different, row = np.unique(weights, axis=1, return_inverse=True)
        gains = [
            [np.concatenate(preview_gains(self.vehicle, speed, *column)) for speed in DESIGN_SPEEDS]
            for column in different.T
        ]
        return row.ravel(), np.array(gains)

    def joint_rate(self, seen: VehicleState) -> Floats:
        """Commanded joint rate (N,) [rad/s]."""
        vehicle = self.vehicle
        bend = (vehicle.front + vehicle.rear) * turn_curvature(seen["joint_angle"], vehicle.front, vehicle.rear)
        state = [seen["cross_track"], seen["heading_error"], bend, seen["joint_rate"]]
        known = np.column_stack([*state, seen.terms["curvature"]])
        row, gains = self._gains
        row = np.broadcast_to(row, (len(known),))
        speed = np.clip(seen.speed, DESIGN_SPEEDS[0], DESIGN_SPEEDS[-1])
        demands = -np.einsum("nsk,nk->ns", gains[row], known)
        return _between(DESIGN_SPEEDS, demands, speed)

    def steer(self, seen: VehicleState) -> Floats:
        rate = self.joint_rate(seen)
        size, signal = np.abs(rate), np.zeros(len(rate))
        for side, dead_band, rates in (
            (1.0, self.dead_band_left, VALVE_RATE_LEFT),
            (-1.0, self.dead_band_right, VALVE_RATE_RIGHT),
        ):
            # the published curve, whose foot is the dead band
            dead_band = np.asarray(dead_band)
            low = dead_band + (VALVE_SIGNAL[0] - dead_band) * size / rates[0]
            opened = np.where(size < rates[0], low, np.interp(size, rates, VALVE_SIGNAL))
            signal = np.where(side * rate > np.asarray(self.rest_rate), side * opened, signal)
        return signal


@dataclass(frozen=True)
class PreviewDriver(PreviewRegulator):
    """A preview regulator that chooses its speed by what lies ahead, too: the least of

    - √(v_i² + 2 ``braking`` s_i) for every place of the preview, s_i ahead less what braking takes to show, where
      v_i = ``largest_rate`` / ((f + r) |κ′|) is the speed at which the joint follows the path's change of curvature κ′ from
      there to the next place;
    - ``climbing`` / |sin pitch|, by the power of the engine uphill and what brakes downhill;
    - ``speeding`` above the present speed, and ``fastest``.

    ``drive_signal`` does not count. Raises ValueError if the pitch is not observed.
    """

    largest_rate: ArrayLike = field(default=0.9, kw_only=True)
    """[rad/s]"""
    braking: ArrayLike = field(default=0.8, kw_only=True)
    """[m/s²]"""
    climbing: ArrayLike = field(default=0.34, kw_only=True)
    """Up or down [m/s]."""
    speeding: ArrayLike = field(default=0.5, kw_only=True)
    """[m/s]"""
    fastest: ArrayLike = field(default=2.2, kw_only=True)
    """[m/s]"""

    def __post_init__(self) -> None:
        require_terms(self.vehicle.layout, "pitch")

    def speed(self, seen: VehicleState) -> Floats:
        """To drive at (N,) [m/s]."""
        nodes = np.array((0.0, *self.vehicle.preview))
        change = np.abs(np.diff(seen.terms["curvature"], axis=1) / np.diff(nodes))
        joint = (self.vehicle.front + self.vehicle.rear) * change
        followed = np.asarray(self.largest_rate)[..., None] / np.maximum(joint, 1e-3)
        at_once = 2.0 * np.asarray(self.braking)[..., None] * np.maximum(nodes[:-1] - REACTION, 0.0)
        limits = (
            np.sqrt(np.minimum(followed, 10.0) ** 2 + at_once).min(axis=1),
            np.asarray(self.climbing) / np.maximum(np.abs(np.sin(seen["pitch"])), 1e-3),
            np.maximum(seen["speed"], 0.0) + np.asarray(self.speeding),
            np.asarray(self.fastest),
        )
        return np.maximum(np.minimum.reduce(np.broadcast_arrays(*limits)), SLOWEST)

    def __call__(self, observations: Observations) -> Actions:
        seen = self.vehicle.see(observations)
        drive = np.clip(self.speed(seen) / self.vehicle.top_speed, 0.0, 1.0)
        return np.stack([self.steer(seen), drive], axis=1).astype(np.float32)


def preview_model(vehicle: Vehicle, speed: float, lag: float) -> tuple[Floats, Floats, Floats]:
    """A (4, 4), B (4,), D (4,) of x⁺ = A x + B u + D κ over a control step; see :class:`PreviewRegulator`."""
    wheelbase = vehicle.front + vehicle.rear
    flow = np.zeros((6, 6))  # of the state, u and κ, which are held over the step
    flow[0, 1] = speed
    flow[1, [2, 3, 5]] = speed / wheelbase, vehicle.rear / wheelbase, -speed
    flow[2, 3] = 1.0
    flow[3, [3, 4]] = -1.0 / lag, 1.0 / lag
    step = np.asarray(expm(flow * vehicle.control_step), dtype=np.float64)
    return step[:4, :4], step[:4, 4], step[:4, 5]


def preview_gains(
    vehicle: Vehicle, speed: float, heading_weight: float, rate_weight: float, lag: float
) -> tuple[Floats, Floats]:
    """Gains K (4,) of the state and W (1 + K,) of the curvatures at 0 and at the preview's places: u = −K x − W κ.

    With P of the discrete algebraic Riccati equation, S = R + Bᵀ P B and the closed loop A_c = A − B K, the optimum over a
    known disturbance is u = −S⁻¹ Bᵀ P A x − Σ_i S⁻¹ Bᵀ (A_cᵀ)^i P D κ_i (M. Tomizuka, "Optimal continuous finite preview
    problem", IEEE Trans. Automatic Control 20, 1975, in discrete time); curvatures are linear between the places, and stay
    as the last one beyond.

    Args:
        vehicle: What a driver knows of it.
        speed: [m/s], above 0.
        heading_weight: [m²/rad²]
        rate_weight: [m² s²/rad²]
        lag: Of the joint [s], above 0.
    """
    a, b, d = preview_model(vehicle, speed, lag)
    cost = np.diag([1.0, heading_weight, 0.0, 0.0])
    p = solve_discrete_are(a, b[:, None], cost, np.array([[rate_weight]]))
    stiffness = rate_weight + b @ p @ b
    feedback = b @ p @ a / stiffness
    closed = a - np.outer(b, feedback)
    nodes = np.array([0.0, *vehicle.preview])
    weights, push = np.zeros(len(nodes)), p @ d
    ahead = 0.0
    while ahead < nodes[-1]:
        weights += b @ push / stiffness * np.array([np.interp(ahead, nodes, unit) for unit in np.eye(len(nodes))])
        push = closed.T @ push
        ahead += speed * vehicle.control_step
    # all that is beyond the last place: the sum of a geometric series
    weights[-1] += b @ np.linalg.solve(np.eye(4) - closed.T, push) / stiffness
    return feedback, weights
