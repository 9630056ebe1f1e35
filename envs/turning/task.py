"""``AORO/Turning-v0``: bring the articulated joint to a commanded angle, at standstill, at 50 Hz.

Several targets follow each other in an episode of 10 s. Wanted is a fast turn without overshoot and with little
oscillation of the joint flow, from what the real machine measures: the joint angle at 100 Hz with its noise, and, as an
option, three pressures. The action is the valve's ``steering_signal`` in [-1, 1], positive to the left.

The configuration, the terms and the judgement stand here; a default is changed by name when the environment is made.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from aoro_gym.envs.core.joint import MeasuredJoint
from aoro_gym.envs.core.randomisation import COMMISSIONED, Draws, Randomisation
from aoro_gym.envs.core.single import TwinEnv
from aoro_gym.envs.core.task import Outputs, Start, Terrains, chosen, divides, given, sensing
from aoro_gym.envs.core.terms import Frozen, ObservationTerm, RewardTerm, changed_observations, changed_rewards
from aoro_gym.envs.core.vector import TwinVectorEnv, check_keywords
from aoro_gym.execution.array_api import HOST, Array, Arrays, Index, floats
from aoro_gym.machine import Machine
from aoro_gym.sensors import JointAngleNoise, PressureNoise, PressureSensor
from aoro_gym.terrains import Plane
from aoro_gym.twin.records import Output

FULL_FLOW = 1.2e-3
"""Joint flow [m³/s] that stands for 1: about that of a turn at full signal."""
TRACKING_SCALE = 0.2
"""Error [rad] at which the tracking term has fallen to 1/e."""
TARGETS_DRAWN = 32
"""Targets drawn for an episode; the last one stays."""
LAST_STEP = 2**62
"""Step that never comes."""

# ---- what the terms see ----------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class TurningView:
    """All sub-environments at the end of a control step; arrays of shape (N,) unless said otherwise, SI.

    Angles are positive to the left. In reward terms ``target`` is the one that the step pursued; in observation terms
    it is the one that the next step shall pursue.
    """

    xp: Any
    """Array namespace of all arrays."""
    control_step: float
    """[s]"""
    tolerance: float
    """Error [rad] within which a target counts as reached."""
    target: Array
    """[rad]"""
    target_age: Array
    """Time since the target was set [s]."""
    error: Array
    """Target less true joint angle [rad]."""
    overshoot: Array
    """How far [rad] the joint is beyond the target, seen from where it stood when the target was set; at least 0."""
    measured_angle: Array
    """Joint angle [rad] as the sensor gives it."""
    measured_rate: Array
    """Joint rate [rad/s] as the controller can know it: slope of the line through the last measured angles."""
    signals: Array
    """Steering signals of the last steps, newest first, shape (N, M)."""
    flows: Array
    """True joint flow [m³/s], positive left, at the end of the last three steps, newest first, shape (3, N)."""
    measured_pressures: Array
    """Ports A and B and the pump [Pa] as their sensors give them, shape (N, 3); (N, 0) if they are not observed."""
    outputs: Outputs
    """Exact output channels of the twins over the step."""

    def output(self, channel: str) -> Array:
        """Any exact output channel of the twin at the end of the step, SI; see ``aoro_gym.twin.records.Output``."""
        return self.outputs.last(channel)

    def samples(self, channel: str) -> Array:
        """The channel's samples over the step, 100 a second, oldest first, shape (frames, N)."""
        return self.outputs.samples(channel)


# ---- reward terms: each a number a sub-environment, weighted below ---------------------------------------------------


def tracking(view: TurningView) -> Array:
    """1 on target, falling exponentially with the error: every moment away from the target costs."""
    return view.xp.exp(-view.xp.abs(view.error) / TRACKING_SCALE)


def precision(view: TurningView) -> Array:
    """1 on target, 1/e at the tolerance, nothing beyond: worth the last degree."""
    return view.xp.exp(-((view.error / view.tolerance) ** 2))


def overshoot(view: TurningView) -> Array:
    """How far the joint is beyond its target [rad]."""
    return view.overshoot


def flow_oscillation(view: TurningView) -> Array:
    """Second difference of the joint flow over three steps, in units of the full flow: a steady ramp is free."""
    newest, middle, oldest = view.flows
    return view.xp.abs(newest - 2.0 * middle + oldest) / FULL_FLOW


def flow_excess(view: TurningView) -> Array:
    """How far the joint flow is above the full one, in units of it: the first peak of a turn, above what it settles at."""
    return view.xp.clip(view.xp.abs(view.flows[0]) / FULL_FLOW - 1.0, 0.0, None)


def signal_change(view: TurningView) -> Array:
    """Square of the steering signal's change."""
    return (view.signals[:, 0] - view.signals[:, 1]) ** 2


REWARD_TERMS = Frozen(
    {
        "tracking": RewardTerm(0.6, tracking),
        "precision": RewardTerm(0.4, precision),
        "overshoot": RewardTerm(-10.0, overshoot),
        "flow_oscillation": RewardTerm(-0.2, flow_oscillation),
        "signal_change": RewardTerm(-0.1, signal_change),
    }
)
"""The reward: at most 1 a step, so 500 an episode."""
FURTHER_REWARD_TERMS = Frozen({"flow_excess": flow_excess})
"""What it can be made of besides, by name."""

# ---- observation terms -----------------------------------------------------------------------------------------------


def joint_angle(view: TurningView) -> Array:
    """Measured joint angle [rad]."""
    return view.measured_angle


def joint_rate(view: TurningView) -> Array:
    """Estimated joint rate [rad/s]."""
    return view.measured_rate


def target(view: TurningView) -> Array:
    """Target [rad]."""
    return view.target


def target_error(view: TurningView) -> Array:
    """Target less measured angle [rad]."""
    return view.target - view.measured_angle


def signals(view: TurningView) -> Array:
    """The last steering signals, newest first (N, M)."""
    return view.signals


def pressures(view: TurningView) -> Array:
    """Measured pressures of port A, port B and the pump, in units of 100 bar (N, 3)."""
    return view.measured_pressures / 1e7


OBSERVATION_TERMS = Frozen(
    {
        "joint_angle": ObservationTerm(joint_angle, -math.pi, math.pi),
        "joint_rate": ObservationTerm(joint_rate, -5.0, 5.0),
        "target": ObservationTerm(target, -math.pi, math.pi),
        "error": ObservationTerm(target_error, -math.pi, math.pi),
        "signals": ObservationTerm(signals, -1.0, 1.0),
    }
)
"""What the real machine knows with its joint-angle sensor alone."""
EXACT_TERMS: Mapping[str, Callable[[TurningView], Array]] = {
    "joint_angle": lambda view: view.target - view.error,
    "error": lambda view: view.error,
}
"""True values of measured terms, for teachers."""
PRESSURE_TERMS = Frozen({"pressures": ObservationTerm(pressures, -1.0, 10.0)})
"""What ``observe_pressures=True`` adds."""
PRESSURE_CHANNELS = ("pressure_a", "pressure_b", "pump_pressure")

# ---- randomisation and configuration ---------------------------------------------------------------------------------

FIXED = Randomisation()
"""The machine as it is, with the published sensor noise; targets and the start angle still differ."""
MILD = Randomisation(
    machine_scale=Frozen(
        {
            **COMMISSIONED,
            "steering.valve.spool_time_constant": (0.7, 1.4),
            "steering.valve.compensator_time_constant": (0.7, 1.4),
            "steering.pump.stroke_up_time": (0.8, 1.25),
            "steering.pump.margin": (0.9, 1.1),
            "steering.hose_volume": (0.8, 1.25),
            "oil.bulk_modulus": (0.85, 1.15),
            "joint.friction_torque": (0.5, 2.0),
        }
    ),
    ground_friction=(0.5, 1.1),
    sensor_noise=(0.5, 1.5),
)
"""Spread of a commissioned machine over grounds and temperatures, within the ranges of the machine file."""


@dataclass(frozen=True)
class TurningConfig:
    """The task as data; SI. Raises ValueError naming the field, its value and its bound."""

    control_step: float = 0.02
    """[s] between two actions."""
    sample_step: float = 0.01
    """[s] between two samples of the joint-angle sensor."""
    target_clearance: float = math.radians(4.0)
    """Targets and start angles keep this far [rad] from the joint's stops."""
    target_change: float = math.radians(8.0)
    """Successive targets, and the first one and the start angle, differ by at least this much [rad]."""
    hold: tuple[float, float] = (2.5, 4.0)
    """Shortest and longest time [s] until the next target."""
    tolerance: float = math.radians(1.0)
    """Error [rad] within which a target counts as reached."""
    dwell: float = 0.3
    """A target is settled when the error has stayed within the tolerance for this long [s]."""
    rate_samples: int = 6
    """Angle samples that the rate estimate takes its slope from."""
    signal_memory: int = 4
    """Past steering signals in the observation."""
    observe_pressures: bool = False
    """Add the pressures of both ports and of the pump to the observation."""
    joint_angle_noise: JointAngleNoise = field(default_factory=JointAngleNoise.published)
    pressure_noise: PressureNoise = field(default_factory=PressureNoise.typical)
    reward_terms: Mapping[str, RewardTerm] = field(default_factory=lambda: REWARD_TERMS)
    observation_terms: Mapping[str, ObservationTerm] = field(default_factory=lambda: OBSERVATION_TERMS)
    randomisation: Randomisation = FIXED

    def __post_init__(self) -> None:
        low, high = self.hold
        for holds, message in (
            (self.control_step > 0, f"control_step is {self.control_step} s, but must be positive"),
            (divides(self.sample_step, self.control_step), f"sample_step is {self.sample_step} s, but must divide "
             f"control_step = {self.control_step} s"),
            (self.target_clearance >= 0, f"target_clearance is {self.target_clearance} rad, but must be at least 0"),
            (self.target_change >= 0, f"target_change is {self.target_change} rad, but must be at least 0"),
            (self.control_step <= low <= high < math.inf, f"hold is ({low}, {high}) s, but must be at least one control "
             "step, low before high"),
            (0 < self.tolerance < math.inf, f"tolerance is {self.tolerance} rad, but must be positive"),
            (0 <= self.dwell <= low, f"dwell is {self.dwell} s, but must be in [0, {low}] s, the shortest hold"),
            (self.rate_samples >= 2, f"rate_samples is {self.rate_samples}, but must be at least 2"),
            (self.signal_memory >= 2, f"signal_memory is {self.signal_memory}, but must be at least 2"),
        ):  # fmt: skip
            if not holds:
                raise ValueError(message)


# ---- the task --------------------------------------------------------------------------------------------------------


class Turning:
    """Targets, measurements and judgement of N turning joints; see :class:`aoro_gym.envs.core.task.Task`."""

    option_names: ClassVar[tuple[str, ...]] = ("joint_angle", "targets", "hold", "position", "heading")
    render_channels: ClassVar[tuple[str, ...]] = (
        "time", "x", "y", "yaw", "joint_angle", "target", "steering_signal", "joint_flow", "settled", "missed",
    )  # fmt: skip
    render_span: ClassVar[float] = 6.0

    def __init__(self, config: TurningConfig | None = None):
        self.config = TurningConfig() if config is None else config
        self.control_step = self.config.control_step
        self.sample_step = self.config.sample_step
        self.reward_terms = self.config.reward_terms
        self.observation_terms = self.config.observation_terms
        self.randomisation = self.config.randomisation
        self.action_space: spaces.Box[Any] = spaces.Box(-1.0, 1.0, (1,), np.float32)

    def allocate(self, num_envs: int, terrains: Terrains, arrays: Arrays = HOST) -> None:
        self._arrays, xp = arrays, arrays.xp
        n, config = num_envs, self.config
        self._terrains = terrains
        frames = round(config.control_step / config.sample_step)
        self._outputs = Outputs(arrays.zeros((frames, len(Output), n), xp.float32))
        # goals
        self._table = arrays.zeros((n, TARGETS_DRAWN), xp.float32)  # [rad]
        self._until = arrays.full((n, TARGETS_DRAWN), LAST_STEP, xp.int64)  # step that ends each target
        self._cursor = arrays.zeros(n, xp.int64)
        self._step = arrays.zeros(n, xp.int64)
        self._set_at = arrays.zeros(n, xp.int64)
        self._target = arrays.zeros(n, xp.float32)
        self._approach = arrays.ones(n, xp.float32)
        # motion and measurement, newest first
        self._angle = arrays.zeros(n, xp.float32)
        self._signals = arrays.zeros((config.signal_memory, n), xp.float32)
        self._flows = arrays.zeros((3, n), xp.float32)
        self._noise = arrays.ones(n, xp.float32)
        # judgement
        self._inside = arrays.zeros(n, xp.int64)
        self._settled = arrays.zeros(n, xp.int64)
        self._missed = arrays.zeros(n, xp.int64)
        self._largest_overshoot = arrays.zeros(n, xp.float32)
        # sensors
        self._joint = MeasuredJoint(
            n,
            config.joint_angle_noise,
            interval=config.sample_step,
            frames=frames,
            kept=config.rate_samples,
            arrays=arrays,
        )
        self._pressure_sensor = (
            PressureSensor(n, config.pressure_noise, count=len(PRESSURE_CHANNELS), arrays=arrays)
            if config.observe_pressures
            else None
        )
        self._pressures = arrays.zeros((n, 3 * config.observe_pressures), xp.float32)

    # ---- start

    def start(
        self,
        where: NDArray[np.intp],
        generators: list[np.random.Generator],
        draws: Draws,
        machine: Machine,
        options: Mapping[str, Any],
    ) -> Start:
        count, config = len(where), self.config
        limit = np.broadcast_to(np.asarray(machine.joint.range, dtype=np.float64), count)
        reach = limit - config.target_clearance
        if np.any(reach <= config.target_change):
            raise ValueError(
                f"target_change is {config.target_change:.3f} rad, but targets span only ±{reach.min():.3f} rad; lower "
                "it, or target_clearance"
            )
        uniform = np.stack([generator.random((2, TARGETS_DRAWN)) for generator in generators])
        angle = draws.joint_angle * reach
        angle = given(options, "joint_angle", where, len(self._target), angle, -limit, limit, "rad")

        if options.get("targets") is not None:
            targets = np.atleast_1d(np.asarray(options["targets"], dtype=np.float64))
            if targets.ndim > 2 or (targets.ndim == 2 and len(targets) != len(self._target)) or targets.size == 0:
                raise ValueError(
                    f"options['targets'] has shape {targets.shape}, but must be (T,) or ({len(self._target)}, T) [rad]"
                )
            targets = targets[where] if targets.ndim == 2 else np.broadcast_to(targets, (count, len(targets)))
            if not np.all(np.abs(targets) <= limit[:, None]):
                worst = targets[~(np.abs(targets) <= limit[:, None])][0]
                raise ValueError(
                    f"options['targets'] has {worst:g} rad, but the joint reaches only ±{limit.min():.4f} rad (joint.range)"
                )
            targets = targets[:, :TARGETS_DRAWN]
            hold = np.full(targets.shape, config.hold[0])
        else:
            targets = apart(angle, reach, config.target_change, uniform[:, 0])
            low, high = config.hold
            hold = low + (high - low) * uniform[:, 1]
        if options.get("hold") is not None:
            asked = np.asarray(options["hold"], dtype=np.float64)
            if asked.ndim or not asked >= config.control_step:
                raise ValueError(
                    f"options['hold'] is {options['hold']!r} s, but must be one number, at least {config.control_step}"
                )
            hold = np.full(targets.shape, float(asked))

        missing = TARGETS_DRAWN - targets.shape[1]
        table = np.pad(targets, ((0, 0), (0, missing)), mode="edge").astype(np.float32)
        ends = np.cumsum(np.rint(hold / config.control_step).astype(np.int64), axis=1)[:, :-1]
        until = np.pad(ends, ((0, 0), (0, missing + 1)), constant_values=LAST_STEP)
        rows, put = self._arrays.index(where), self._arrays.put
        for state, value in (
            (self._table, table),
            (self._until, until),
            (self._target, table[:, 0]),
            (self._angle, angle),
            (self._approach, np.sign(table[:, 0] - angle.astype(np.float32))),
            (self._noise, draws.sensor_noise),
            (self._joint.scale, draws.sensor_noise),
        ):
            put(state, rows, value)
        for state in (
            self._cursor, self._step, self._set_at, self._inside, self._settled, self._missed, self._largest_overshoot,
        ):  # fmt: skip
            state[rows] = 0
        self._signals[:, rows] = 0.0
        self._flows[:, rows] = 0.0
        sensor_draws = sensing(options, where, len(self._target), generators)
        for sensor in (self._joint, self._pressure_sensor):
            if sensor is not None:
                sensor.reset(rows, sensor_draws)
        heading = given(options, "heading", where, len(self._target), np.zeros(count), -math.tau, math.tau, "rad")
        return Start(angle, heading, *self._standpoint(where, generators, options))

    def _standpoint(
        self, where: NDArray[np.intp], generators: list[np.random.Generator], options: Mapping[str, Any]
    ) -> tuple[NDArray[np.float64], NDArray[np.intp] | None]:
        """Where in the plan (K, 2), and on which terrain (K,): the middle of the one that was asked for or drawn."""
        middle, terrain = np.zeros((len(where), 2)), None
        if not isinstance(self._terrains, Plane):
            terrain = chosen(options, "terrain", len(self._terrains), where, len(self._target), generators)
            middle = np.array([0.5 * np.add(*one.extent)[:2] for one in self._terrains])[terrain]
        elif options.get("terrain") is not None:
            raise ValueError("options['terrain'] chooses a terrain, but the twins stand on a plane; give terrain=[...]")
        if options.get("position") is not None:
            asked = np.asarray(options["position"], dtype=np.float64)
            if asked.shape not in ((2,), (len(self._target), 2)) or not np.isfinite(asked).all():
                raise ValueError(
                    f"options['position'] is {options['position']!r}, but must be (2,) or ({len(self._target)}, 2) [m]"
                )
            middle = asked[where] if asked.ndim == 2 else np.tile(asked, (len(where), 1))
        return middle, terrain

    def rest(self, where: Index, outputs: Outputs) -> None:
        self._outputs = outputs
        self._joint.begin(self._angle[where], where)
        self._pressures[where] = self._measure_pressures(0.0, where)

    # ---- step

    def commands(self, actions: Array) -> Mapping[str, Array]:
        self._signals = self._arrays.xp.concat([actions.T, self._signals[:-1]])
        return {"steering_signal": actions[:, 0]}

    def advance(self, outputs: Outputs, time: Array) -> None:
        xp, config = self._arrays.xp, self.config
        self._outputs = outputs
        angles = outputs.samples("joint_angle")
        self._joint.update(angles, time)
        self._pressures = self._measure_pressures(time)
        # the channel is positive in the direction of the commanded turn
        flow = xp.abs(outputs.last("joint_flow")) * xp.sign(outputs.last("joint_rate"))
        self._flows = xp.stack([flow, *self._flows[:-1]])
        self._angle = xp.asarray(angles[-1], copy=True)
        self._step = self._step + 1

        error = xp.abs(self._target - self._angle)
        self._inside = xp.where(error <= config.tolerance, self._inside + 1, 0)
        self._largest_overshoot = xp.maximum(self._largest_overshoot, self._overshoot())

    def _measure_pressures(self, time: Array, where: Index = None) -> Array:
        xp, rows = self._arrays.xp, slice(None) if where is None else where
        if self._pressure_sensor is None:
            return self._pressures[rows]
        true = xp.stack([self._outputs.last(channel)[rows] for channel in PRESSURE_CHANNELS])
        shown = true + self._noise[rows] * (self._pressure_sensor.measure(true, time, where) - true)
        return xp.astype(shown.T, xp.float32)

    def _overshoot(self) -> Array:
        return self._arrays.xp.clip(self._approach * (self._angle - self._target), 0.0, None)

    def endings(self) -> tuple[Array, list[str]]:
        return self._arrays.xp.zeros_like(self._cursor), [""]

    def overdue(self) -> Array:
        return self._arrays.xp.zeros_like(self._cursor, dtype=self._arrays.xp.bool)

    def renew(self) -> None:
        xp, rows = self._arrays.xp, self._arrays.arange(len(self._cursor))
        due = self._step >= self._until[rows, self._cursor]
        if self._arrays.known_all_false(due):
            return
        settled = self._is_settled()
        self._settled = self._settled + xp.astype(due & settled, xp.int64)
        self._missed = self._missed + xp.astype(due & ~settled, xp.int64)
        self._cursor = self._cursor + xp.astype(due, xp.int64)
        self._target = self._table[rows, self._cursor]
        self._approach = xp.where(due, xp.sign(self._target - self._angle), self._approach)
        self._set_at = xp.where(due, self._step, self._set_at)
        self._inside = xp.where(due, 0, self._inside)

    def _is_settled(self) -> Array:
        return self._inside >= math.ceil(self.config.dwell / self.control_step - 1e-6)

    def _age(self) -> Array:
        """Time since the target was set [s]."""
        return floats(self._step - self._set_at) * self.control_step

    # ---- what others see

    def view(self) -> TurningView:
        return TurningView(
            xp=self._arrays.xp,
            control_step=self.control_step,
            tolerance=self.config.tolerance,
            target=self._target,
            target_age=self._age(),
            error=self._target - self._angle,
            overshoot=self._overshoot(),
            measured_angle=self._joint.angle,
            measured_rate=self._joint.rate,
            signals=self._signals.T,
            flows=self._flows,
            measured_pressures=self._pressures,
            outputs=self._outputs,
        )

    def info(self) -> dict[str, Array]:
        """``is_success``: at least one target was settled, and none was missed: replaced unsettled, or unsettled after
        the shortest hold."""
        xp, settled = self._arrays.xp, self._is_settled()
        overdue = ~settled & (self._age() >= self.config.hold[0])
        done = self._settled + xp.astype(settled, xp.int64)
        missed = self._missed + xp.astype(overdue, xp.int64)
        return {
            "target": xp.asarray(self._target, copy=True),
            "joint_angle": xp.asarray(self._angle, copy=True),
            "largest_overshoot": xp.asarray(self._largest_overshoot, copy=True),
            "targets_settled": done,
            "targets_missed": missed,
            "is_success": (done > 0) & (missed == 0),
        }

    def traces(self) -> Array:
        output, judged = self._outputs.last, self.info()
        return self._arrays.xp.stack(
            [
                self._step * self.control_step,
                *(output(channel) for channel in ("position_x", "position_y", "yaw")),
                self._angle,
                self._target,
                self._signals[0],
                self._flows[0],
                judged["targets_settled"],
                judged["targets_missed"],
            ]
        )

    def scene(self, machine: Machine) -> Any:
        from aoro_gym.envs.core.rendering import TurningScene

        return TurningScene(machine, tolerance=self.config.tolerance)


def apart(
    start: NDArray[np.float64], reach: NDArray[np.float64], apart: float, uniform: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Targets (K, T) [rad], uniform over ±``reach`` (K,) less what is nearer than ``apart`` to the one before."""
    targets = np.empty_like(uniform)
    before = start
    for t in range(uniform.shape[1]):
        below = np.clip(before - apart, -reach, reach) + reach  # length of the free interval on either side
        above = np.clip(before + apart, -reach, reach)
        along = uniform[:, t] * (below + reach - above)
        before = targets[:, t] = np.where(along < below, along - reach, above + along - below)
    return targets


# ---- the environments ------------------------------------------------------------------------------------------------


class TurningVectorEnv(TwinVectorEnv):
    """``gymnasium.make_vec("AORO/Turning-v0", num_envs=N)``: N joints to turn, the twins of one launch.

    **Action** (1,): steering signal, positive left. **Observation**: the terms of ``OBSERVATION_TERMS`` in their order;
    ``observation_layout`` gives the columns. **Reward**: the weighted terms of ``REWARD_TERMS``.

    **Episode**: truncated after 500 steps; terminated only when the twin is lost, with the reason in
    ``info["termination"]``. ``info["is_success"]`` tells whether all targets so far were settled in time.

    ``reset(options=...)`` also takes ``joint_angle`` [rad], ``targets`` [rad] of shape (T,) or (num_envs, T), the last
    of which stays, and ``hold`` [s], the time each target but the last is held (the shortest hold if targets are given);
    ``position`` [m] of the hinge in the plan and ``heading`` [rad], by default the terrain's middle, or a plane's origin,
    and 0.

    Args:
        num_envs: Sub-environments.
        config: The task; see :class:`TurningConfig`.
        reward_terms: Changes to its reward terms by name; see :mod:`aoro_gym.envs.core.terms`.
        observation_terms: Changes to its observation terms by name.
        observe_pressures: Add the pressures of both ports and of the pump to the observation.
        randomisation: Instead of the configuration's: ``FIXED``, ``MILD`` or an own one.
        arguments: See :class:`TwinVectorEnv`: machine, terrain, device, output, own_machines, autoreset_mode,
            max_episode_steps, render_mode.
    """

    task: Turning

    def __init__(
        self,
        num_envs: int = 1,
        *,
        config: TurningConfig | None = None,
        reward_terms: Mapping[str, RewardTerm | tuple[float, Callable[[Any], Array]] | float | None] | None = None,
        observation_terms: Mapping[str, ObservationTerm | Callable[[Any], Array] | None] | None = None,
        observe_pressures: bool | None = None,
        randomisation: Randomisation | None = None,
        **arguments: Any,
    ):
        check_keywords(type(self), arguments)
        config = TurningConfig() if config is None else config
        observe_pressures = config.observe_pressures if observe_pressures is None else observe_pressures
        observed = {**config.observation_terms, **(PRESSURE_TERMS if observe_pressures else {})}
        config = replace(
            config,
            observe_pressures=observe_pressures,
            reward_terms=changed_rewards(config.reward_terms, reward_terms),
            observation_terms=changed_observations(observed, observation_terms),
            randomisation=config.randomisation if randomisation is None else randomisation,
        )
        super().__init__(Turning(config), num_envs, **arguments)


class TurningEnv(TwinEnv):
    """``gymnasium.make("AORO/Turning-v0")``: one joint to turn; see :class:`TurningVectorEnv`."""

    vector_type = TurningVectorEnv
