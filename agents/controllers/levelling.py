"""Reference controllers for ``AORO/Levelling-v0``: four ways to move four arms by what the machine measures.

Four wheels under a frame that is rigid but for its joint stand on four modes: height, roll, pitch, and the twist, in which
the ends of one diagonal rise and those of the other sink. Roll and pitch are seen by the inertial unit, the twist by the
pressures in the arms' cylinders (a twisted ground loads one diagonal), the height by the arms' angles. All controllers give
each mode a demand, spread the demands over the corners, and lift what comes out over the valves' dead band.

All of them see nothing but the observation; what a driver knows of the machine stands in :class:`Stance`. Gains are numbers,
or arrays (N,) that give every sub-environment its own. The defaults are what ``python -m aoro_gym.agents.training.tuning
--env AORO/Levelling-v0`` finds for the default machine ``aoro`` (seed 0, 112 candidates each), to three digits.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.linalg import solve_discrete_are

from aoro_gym.agents.controllers.turning import require_terms
from aoro_gym.agents.policies.policy import Actions, Observations

Floats = NDArray[np.float64]

NEEDED = ("roll", "pitch", "tilt_rates", "arm_angles", "supports", "joint_angle")
"""Observation terms that the controllers read."""
AHEAD = ("ground", "speed")
"""What those read besides that look ahead."""
TWIST = np.array([1.0, -1.0, -1.0, 1.0])
"""Signs of the corners (front left, front right, rear left, rear right) in the twist."""
MODES = ("roll", "pitch", "twist", "height")
"""In the order of their demands: each, where it is positive, takes back a positive roll (left side up) or pitch (nose down),
a twist that loads the front left and the rear right cylinder, frames that are too low."""


@dataclass(frozen=True)
class Stance:
    """What a controller knows beside the observation: its columns, and the machine's measures.

    Raises ValueError if the observation lacks a term that the controllers need.
    """

    layout: Mapping[str, slice]
    """``env.unwrapped.observation_layout``"""
    front: float = 1.7
    """Hinge to front axle [m]."""
    rear: float = 1.7
    """Hinge to rear axle [m]."""
    half_track: float = 0.95
    """Middle to wheel [m]."""
    arm_length: float = 0.7
    """[m]"""
    dead_band: float = 0.1
    """Of the arm valves [-]."""
    wheel_speed: float = 0.245
    """Of a wheel against its frame at full signal [m/s]."""
    ground_ahead: tuple[float, ...] = tuple(0.5 * k for k in range(-5, 8))
    """Places ahead of the hinge [m] at which the ground is seen in both tracks."""
    control_step: float = 0.05
    """[s]"""

    def __post_init__(self) -> None:
        require_terms(self.layout, *NEEDED)

    @classmethod
    def of(cls, env: Any) -> Stance:
        """That of an environment, wrapped or not, single or vector; where its machines differ, their mean."""
        env = env.unwrapped
        env = getattr(env, "vector", env)
        machine = env.twin.machine
        arm, cylinder = machine.arm, machine.arm.cylinder
        full = arm.valve.nominal_flow / cylinder.bore_area / cylinder.linkage.mean_lever * arm.length
        return cls(
            env.observation_layout,
            front=float(np.mean(machine.frame.front.axle_distance)),
            rear=float(np.mean(machine.frame.rear.axle_distance)),
            half_track=float(np.mean(0.5 * machine.frame.track)),
            arm_length=float(np.mean(machine.arm.length)),
            dead_band=float(np.mean(machine.arm.valve.dead_band)),
            wheel_speed=float(np.mean(full)),
            ground_ahead=env.task.config.ground_ahead,
            control_step=env.task.config.control_step,
        )

    def see(self, observations: Observations) -> dict[str, Floats]:
        """The observation's terms by name, each (N, columns)."""
        rows = np.asarray(observations, dtype=np.float64)
        return {name: rows[:, self.layout[name]] for name in (*NEEDED, *AHEAD) if name in self.layout}

    def corners(self, joint_angle: Floats) -> tuple[Floats, Floats]:
        """x forward and y left [m] of the wheels in the front frame's axes (N, 4), at joint angles [rad] (N,).

        The rear frame is turned by the joint angle, clockwise where that is positive.
        """
        s, c = np.sin(joint_angle), np.cos(joint_angle)
        whole = np.ones_like(joint_angle)
        x = [
            self.front * whole,
            self.front * whole,
            self.half_track * s - self.rear * c,
            -self.half_track * s - self.rear * c,
        ]
        y = [self.half_track * whole, -self.half_track * whole]
        y += [self.rear * s + self.half_track * c, self.rear * s - self.half_track * c]
        return np.stack(x, axis=1), np.stack(y, axis=1)

    def spread(self, demands: Floats, joint_angle: Floats) -> Floats:
        """Demands of the corners (N, 4) for those of the modes (N, 4), in the order of :data:`MODES`: a corner moves in
        proportion to how far it lies off the axis of roll or pitch."""
        x, y = self.corners(joint_angle)
        roll, pitch, twist, height = (demands[:, [k]] for k in range(len(MODES)))
        return pitch * x / self.front - roll * y / self.half_track - twist * TWIST + height

    def signals(self, corners: Floats, rest: ArrayLike) -> Actions:
        """Valve signals (N, 4) for demands of the corners: nothing within ``rest`` (a number or (N,)), else lifted over the
        dead band."""
        size = np.minimum(np.abs(corners), 1.0)
        signal = np.sign(corners) * (self.dead_band + (1.0 - self.dead_band) * size)
        return np.where(size > _column(rest), signal, 0.0).astype(np.float32)


def twist_of(supports: Floats) -> Floats:
    """Twist [100 bar] (N,) of what the cylinders bear (N, 4): a quarter of one diagonal's less the other's."""
    return 0.25 * (supports @ TWIST)


class ModalController(ABC):
    """Demands of the modes, spread over the corners.

    Args:
        stance: What is known of the machine.
        gains: Values of :attr:`GAINS` by name, numbers or arrays (N,).

    Raises ValueError if a gain is none of the controller's.
    """

    GAINS: ClassVar[Mapping[str, float]]
    """Names of the gains, and their defaults."""

    def __init__(self, stance: Stance, **gains: ArrayLike):
        for name in gains:
            if name not in self.GAINS:
                raise ValueError(f"{type(self).__name__} has no gain {name!r}; choose one of: {', '.join(self.GAINS)}")
        self.stance = stance
        self.gains: dict[str, Any] = {name: np.asarray(gains.get(name, value)) for name, value in self.GAINS.items()}
        self._memory: dict[str, Floats] = {}

    def with_gains(self, **gains: ArrayLike) -> Self:
        """The same controller with other values of some gains; it remembers nothing."""
        return type(self)(self.stance, **{**self.gains, **gains})

    def reset(self, mask: NDArray[np.bool_] | None = None) -> None:
        """Forget the past of all sub-environments, or of those of the mask (N,)."""
        if mask is None:
            self._memory = {}
        for values in self._memory.values():
            values[mask] = 0.0

    def __call__(self, observations: Observations) -> Actions:
        seen = self.stance.see(observations)
        return self.act(seen)

    @abstractmethod
    def act(self, seen: Mapping[str, Floats]) -> Actions:
        """Valve signals (N, 4) for the terms that are seen, each (N, columns)."""

    def remembered(self, name: str, like: Floats) -> Floats:
        """What was kept under a name, in the shape of ``like``; zeros at first."""
        if name not in self._memory or self._memory[name].shape != like.shape:
            self._memory[name] = np.zeros_like(like)
        return self._memory[name]

    def sunk(self, seen: Mapping[str, Floats]) -> Floats:
        """Mean height [m] (N,) that the frames lack to their arms' rest."""
        return self.stance.arm_length * seen["arm_angles"].mean(axis=1)


class Assistance(ModalController):
    """The law that moves the arms in ``AORO/PathTracking-v0`` with ``arms="level"``, with gains that were tuned here: the
    twist by smoothed pressures, each corner by the height that it lacks to level, the mean height back to rest; see
    :class:`aoro_gym.envs.path_tracking.assistance.ArmController`."""

    GAINS: ClassVar[Mapping[str, float]] = {
        "share_gain": 3.87,  # [1/100 bar]
        "share_band": 0.00525,  # [100 bar]
        "share_time": 0.149,  # [s]
        "level_gain": 8.69,  # [1/m]
        "level_band": 0.00433,  # [m]
        "height_gain": 0.186,  # [1/m]
    }

    def act(self, seen: Mapping[str, Floats]) -> Actions:
        gains, stance = self.gains, self.stance
        twist = twist_of(seen["supports"])
        smooth = self.remembered("twist", twist)
        smooth += stance.control_step / (stance.control_step + gains["share_time"]) * (twist - smooth)
        x, y = stance.corners(seen["joint_angle"][:, 0])
        low = x * np.sin(seen["pitch"]) - y * np.sin(seen["roll"])
        demand = -TWIST * (gains["share_gain"] * _beyond(smooth, gains["share_band"]))[:, None]
        demand = demand + (gains["height_gain"] * self.sunk(seen))[:, None]
        demand = demand + _column(gains["level_gain"]) * _beyond(low, _column(gains["level_band"]))
        return stance.signals(np.clip(demand, -1.0, 1.0), 0.02)


class ModalPid(ModalController):
    """Proportional, integral and derivative action on roll and pitch, proportional and integral action on the twist,
    proportional action on the height. Integrals stop where their part of the demand reaches ±0.5."""

    GAINS: ClassVar[Mapping[str, float]] = {
        "level_gain": 14.5,  # [1/rad]
        "level_time": 0.0703,  # [s] derivative per proportion
        "level_integral": 0.245,  # [1/(rad s)]
        "share_gain": 4.65,  # [1/100 bar]
        "share_integral": 0.0141,  # [1/(100 bar s)]
        "height_gain": 1.29,  # [1/m]
        "rest": 0.0113,  # [-] demand of a corner that is not worth a signal
    }
    MOST: ClassVar[float] = 0.5
    """Largest part of a demand that an integral makes."""

    def act(self, seen: Mapping[str, Floats]) -> Actions:
        corners = self.stance.spread(self.demands(seen), seen["joint_angle"][:, 0])
        return self.stance.signals(corners, self.gains["rest"])

    def demands(self, seen: Mapping[str, Floats]) -> Floats:
        """Of the modes (N, 4)."""
        gains, step = self.gains, self.stance.control_step
        angles = np.concatenate([seen["roll"], seen["pitch"]], axis=1)
        twist = twist_of(seen["supports"])
        tilted, twisted = self.remembered("tilt", angles), self.remembered("twist", twist)
        tilted += step * _column(gains["level_integral"]) * angles
        twisted += step * gains["share_integral"] * twist
        np.clip(tilted, -self.MOST, self.MOST, out=tilted)
        np.clip(twisted, -self.MOST, self.MOST, out=twisted)
        level = _column(gains["level_gain"]) * (angles + _column(gains["level_time"]) * seen["tilt_rates"]) + tilted
        return np.column_stack([level, gains["share_gain"] * twist + twisted, gains["height_gain"] * self.sunk(seen)])


class PreviewPid(ModalPid):
    """:class:`ModalPid`, and each wheel follows the ground that it is about to meet.

    At the speed v over ground of the slope z' a wheel rises at v z'. The mean of the four is left to the height; the arms
    are opened for what each differs from it, ``ahead_gain`` times, for the ground ``ahead`` of each wheel: what a valve
    takes to open passes meanwhile.
    """

    GAINS: ClassVar[Mapping[str, float]] = {
        "level_gain": 5.4,  # those of the PID
        "level_time": 0.177,
        "level_integral": 0.395,
        "share_gain": 3.93,
        "share_integral": 0.114,
        "height_gain": 0.265,
        "rest": 0.0288,
        "ahead_gain": 0.882,  # [-]
        "ahead": 0.0193,  # [m]
    }

    def __init__(self, stance: Stance, **gains: ArrayLike):
        require_terms(stance.layout, *AHEAD)
        super().__init__(stance, **gains)

    def act(self, seen: Mapping[str, Floats]) -> Actions:
        stance = self.stance
        slopes = self.slopes(seen["ground"])
        rising = seen["speed"] * (slopes - slopes.mean(axis=1, keepdims=True))
        corners = stance.spread(self.demands(seen), seen["joint_angle"][:, 0])
        corners = corners - _column(self.gains["ahead_gain"]) * rising / stance.wheel_speed
        return stance.signals(corners, self.gains["rest"])

    def slopes(self, ground: Floats) -> Floats:
        """Slope [-] of the ground along x, ``ahead`` of each wheel (N, 4), of the heights (N, 2 K): that of the map's two
        places around it, at the middle of a rim's footing."""
        places = np.asarray(self.stance.ground_ahead)
        tracks = ground.reshape(len(ground), 2, len(places))
        each = np.diff(tracks, axis=2) / np.diff(places)
        middles, rows = 0.5 * (places[1:] + places[:-1]), np.arange(len(ground))
        found = []
        for number, x in enumerate((self.stance.front, self.stance.front, -self.stance.rear, -self.stance.rear)):
            where = np.broadcast_to(x + np.asarray(self.gains["ahead"]), (len(ground),))
            place = np.clip(np.interp(where, middles, np.arange(len(middles))), 0.0, len(middles) - 1.001)
            before = place.astype(int)
            side = each[:, number % 2]
            found.append((1.0 - place + before) * side[rows, before] + (place - before) * side[rows, before + 1])
        return np.stack(found, axis=1)


# ---- LQR -------------------------------------------------------------------------------------------------------------

BLOCKS: Mapping[str, tuple[str, str]] = {"lateral": ("roll", "twist"), "longitudinal": ("pitch", "height")}
"""Modes that move together on a machine whose left and right side are alike: what a block's state and input are of."""
_STEPS: Mapping[str, Any] = {
    "lateral": [
        [0.9981, 0.04484, 2.085e-05, -0.0008237, -4.574e-05, -0.00116, 2.76e-05],
        [-0.0731, 0.7791, 0.0006124, -0.03337, -0.002021, -0.04745, 0.00121],
        [-0.00625, -0.004621, 1.009, -0.002855, -0.1537, 0.002186, -0.07771],
    ],
    "longitudinal": [
        [0.9964, 0.04366, -0.0001218, -0.001063, 1.083e-05, -0.0005406, -6.637e-05],
        [-0.1298, 0.6848, -0.004092, -0.04781, 0.001041, -0.02233, -0.002793],
        [-0.001237, -0.000761, 1.003, -0.0001304, -0.009505, -0.0001043, -0.001938],
    ],
}  # rows of (A, B) of the three motions


def _model(rows: Any) -> tuple[Floats, Floats]:
    """A and B with the rows that keep the last demands."""
    whole = np.zeros((5, 7))
    whole[:3], whole[3:, 5:] = rows, np.eye(2)
    return whole[:, :5], whole[:, 5:]


MODEL: Mapping[str, tuple[Floats, Floats]] = {block: _model(rows) for block, rows in _STEPS.items()}
"""A (5, 5), B (5, 2) of x⁺ = A x + B u over a control step of 0.05 s, u the demands of a block's modes, x = (angle [rad],
its rate [rad/s], twist [100 bar] or height lacking [m], the last demands (2)): the twin of ``aoro`` linearised about driving
on level ground, by ``python -m aoro_gym.agents.training.levelling_model``, to four digits."""


class ModalRegulator(ModalController):
    """Linear-quadratic regulator on the twin linearised about level driving (:data:`MODEL`).

    u = −K x minimises the sum over the steps to come of ``level_weight`` times the angle squared [1/rad²], ``share_weight``
    times the twist squared [1/(100 bar)²], ``height_weight`` times the height squared [1/m²] and the demands squared; K is
    that of the discrete algebraic Riccati equation (B. Anderson and J. Moore, Optimal control: linear quadratic methods,
    1990). What the ground does is not known ahead, and no part of x.
    """

    GAINS: ClassVar[Mapping[str, float]] = {
        "level_weight": 99.9,
        "share_weight": 80.9,
        "height_weight": 0.937,
        "rest": 0.0218,  # [-] as of the PID
    }

    def __init__(self, stance: Stance, **gains: ArrayLike):
        super().__init__(stance, **gains)
        weights = np.broadcast_arrays(*(self.gains[name] for name in ("level_weight", "share_weight", "height_weight")))
        level, share, height = (np.atleast_1d(weight) for weight in weights)
        self._feedback = {
            "lateral": _regulated("lateral", np.stack([level, share], axis=1)),
            "longitudinal": _regulated("longitudinal", np.stack([level, height], axis=1)),
        }

    def act(self, seen: Mapping[str, Floats]) -> Actions:
        other = {"roll": twist_of(seen["supports"]), "pitch": self.sunk(seen)}
        demands: dict[str, Floats] = {}
        for column, (block, modes) in enumerate(BLOCKS.items()):
            angle = seen[modes[0]][:, 0]
            last = self.remembered(block, np.zeros((len(angle), 2)))
            state = np.column_stack([angle, seen["tilt_rates"][:, column], other[modes[0]], last])
            feedback = np.broadcast_to(self._feedback[block], (len(angle), 2, 5))
            asked = np.clip(-np.einsum("nij,nj->ni", feedback, state), -1.0, 1.0)
            last[:] = asked
            demands |= dict(zip(modes, asked.T, strict=True))
        modal = np.column_stack([demands[mode] for mode in MODES])
        return self.stance.signals(self.stance.spread(modal, seen["joint_angle"][:, 0]), self.gains["rest"])


def _regulated(block: str, weights: Floats) -> Floats:
    """Feedback (K, 2, 5) of a block for weights (K, 2) of its modes."""
    a, b = MODEL[block]
    found = []
    for angle, other in weights:
        p = solve_discrete_are(a, b, np.diag([angle, 1e-6, other, 0.0, 0.0]), np.eye(2))
        found.append(np.linalg.solve(np.eye(2) + b.T @ p @ b, b.T @ p @ a))
    return np.array(found)


def _beyond(value: Floats, band: Any) -> Floats:
    """What of ``value`` lies outside of ±``band``."""
    return value - np.clip(value, -band, band)


def _column(gain: ArrayLike) -> Floats:
    """A gain that broadcasts against (N, columns)."""
    return np.asarray(gain, dtype=np.float64).reshape(-1, 1)
