"""``AORO/Turning-v0``: bring the articulated joint to a commanded angle, at standstill, at 50 Hz.

Several targets follow each other in an episode of 10 s. Wanted is a fast turn without overshoot and with little
oscillation of the joint flow, from what the real machine measures: the joint angle at 100 Hz with its noise, and, as an
option, three pressures. The action is the valve's ``steering_signal`` in [-1, 1], positive to the left.

Goals, measurements and judgement stand here; the configuration and the terms stand beside, and a default is changed by name
when the environment is made.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Mapping
from dataclasses import replace
from typing import Any, ClassVar

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from aoro_gym.envs.core.joint import MeasuredJoint
from aoro_gym.envs.core.randomisation import Draws
from aoro_gym.envs.core.ray_sensing import RaySensing, looks_back
from aoro_gym.envs.core.task import Outputs, Start, StepResult, Terrains, chosen, given, sensing
from aoro_gym.envs.turning.config import TurningConfig
from aoro_gym.envs.turning.view import TurningView
from aoro_gym.execution.array_api import HOST, Array, Arrays, Index, floats
from aoro_gym.execution.streams import Generators, uniforms
from aoro_gym.machine import Machine
from aoro_gym.sensors import PressureSensor
from aoro_gym.terrains import Plane
from aoro_gym.terrains.world.places import open_place
from aoro_gym.terrains.world.world import World
from aoro_gym.twin.records import Output, State

TARGETS_DRAWN = 32
"""Targets drawn for an episode; the last one stays."""
LAST_STEP = 2**62
"""Step that never comes."""
PRESSURE_CHANNELS = ("pressure_a", "pressure_b", "pump_pressure")


class Turning:
    """Targets, measurements and judgement of N turning joints; see :class:`aoro_gym.envs.core.task.Task`."""

    option_names: ClassVar[tuple[str, ...]] = ("joint_angle", "targets", "hold", "position", "heading")
    termination_reasons: ClassVar[tuple[str, ...]] = ("",)
    render_channels: ClassVar[tuple[str, ...]] = (
        "time", "x", "y", "yaw", "joint_angle", "target", "steering_signal", "joint_flow", "settled", "missed",
    )  # fmt: skip
    draws_together: ClassVar[bool] = True
    render_span: ClassVar[float] = 6.0

    def __init__(self, config: TurningConfig | None = None):
        self.config = TurningConfig() if config is None else config
        self.control_step = self.config.control_step
        self.sample_step = self.config.sample_step
        self.reward_terms = self.config.reward_terms
        self.observation_terms = self.config.observation_terms
        self.randomisation = self.config.randomisation
        self.action_layout = {"steering_signal": slice(0, 1)}
        """Columns of the action by name."""
        self.action_space: spaces.Box[Any] = spaces.Box(-1.0, 1.0, (1,), np.float32)

    def allocate(self, num_envs: int, terrains: Terrains, arrays: Arrays = HOST) -> None:
        self._arrays, xp = arrays, arrays.xp
        n, config = num_envs, self.config
        self._terrains = terrains
        self._middles: dict[int, NDArray[np.float64]] = {}
        frames = round(config.control_step / config.sample_step)
        self._outputs = Outputs(
            arrays.zeros((frames, len(Output), n), xp.float32), arrays.zeros((len(State), n), xp.float32)
        )
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
        grounds = [terrains] if isinstance(terrains, Plane) else list(terrains)
        self._rays = RaySensing(n, grounds, config.control_step, looks_back(self.observation_terms), arrays)
        # what the kernels' last step pursued: target, error and overshoot [rad], and the target's age [s]
        self._pursued, self._pursued_age = arrays.zeros((3, n), xp.float32), arrays.zeros(n)

    # ---- start

    def start(
        self,
        where: NDArray[np.intp],
        generators: Generators,
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
        uniform = uniforms(generators, 2, TARGETS_DRAWN)
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
            targets = spaced_targets(angle, reach, config.target_change, uniform[:, 0])
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
            put(state, rows, 0)
        for state in (self._signals, self._flows):
            put(state, (slice(None), rows), 0.0)
        sensor_draws = sensing(options, where, len(self._target), generators)
        for sensor in (self._joint, self._pressure_sensor):
            if sensor is not None:
                sensor.reset(rows, sensor_draws)
        heading = given(options, "heading", where, len(self._target), np.zeros(count), -math.tau, math.tau, "rad")
        middle, terrain = self._standpoint(where, generators, options)
        self._rays.reset(rows, np.zeros(count) if terrain is None else terrain, draws.sensor_noise, sensor_draws)
        return Start(angle, heading, middle, terrain)

    def _standpoint(
        self, where: NDArray[np.intp], generators: Generators, options: Mapping[str, Any]
    ) -> tuple[NDArray[np.float64], NDArray[np.intp] | None]:
        """Where in the plan (K, 2), and on which terrain (K,): the middle of the one that was asked for or drawn."""
        middle, terrain = np.zeros((len(where), 2)), None
        if not isinstance(self._terrains, Plane):
            terrain = chosen(options, "terrain", len(self._terrains), where, len(self._target), generators)
            if options.get("position") is None:
                middle = np.array([self._middle(number) for number in terrain.tolist()])
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

    def _middle(self, number: int) -> NDArray[np.float64]:
        """Where to turn [m] (2,): the middle of a terrain, in a world the open place nearest to it."""
        if number not in self._middles:
            ground = self._terrains[number]  # pyright: ignore[reportIndexIssue]
            found = open_place(ground) if isinstance(ground, World) else 0.5 * np.add(*ground.extent)[:2]
            self._middles[number] = np.asarray(found)
        return self._middles[number]

    def rest(self, where: Index, outputs: Outputs) -> None:
        self._outputs = outputs
        self._joint.begin(self._angle[where], where)
        self._pressures[where] = self._measure_pressures(0.0, where)

    # ---- step

    def commands(self, actions: Array) -> Mapping[str, Array]:
        self._signals = self._arrays.xp.concat([actions.T, self._signals[:-1]])
        return {"steering_signal": actions[:, 0]}

    def advance(self, outputs: Outputs, time: Array) -> StepResult:
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
        never = xp.zeros_like(self._cursor)
        result = StepResult(self.view(), terminal=never, time_limit=xp.zeros_like(never, dtype=xp.bool))
        self._update_goals()
        return result

    # ---- step in kernels

    @property
    def has_kernels(self) -> bool:
        """Whether kernels do the same as this class: not as one that is derived from it."""
        return type(self) is Turning

    @property
    def kernel_terms(self) -> Collection[Callable[[Any], Array]]:
        """Functions of reward and observation terms that the kernels know."""
        from aoro_gym.envs.turning.kernels.judge import REWARDED
        from aoro_gym.envs.turning.kernels.observe import OBSERVED

        return (*REWARDED, *OBSERVED)

    def kernels(self, memory: Any) -> Any:
        """What :meth:`commands` and :meth:`advance` do, and the terms, as kernels
        (:class:`aoro_gym.envs.core.kernel_step.TaskKernels`) with the ``memory`` of the step."""
        from aoro_gym.envs.turning.kernels.step import turning_kernels

        return turning_kernels(self, memory, self._arrays)

    def took(self, outputs: Outputs) -> None:
        """The kernels have taken in ``outputs`` of a control step."""
        self._outputs = outputs

    def judged_view(self) -> TurningView:
        """What reward terms see of the step that the kernels took: with the goals that it pursued."""
        target, error, overshoot = self._pursued
        return replace(self.view(), target=target, target_age=self._pursued_age, error=error, overshoot=overshoot)

    def _measure_pressures(self, time: Array, where: Index = None) -> Array:
        xp, rows = self._arrays.xp, slice(None) if where is None else where
        if self._pressure_sensor is None:
            return self._pressures[rows]
        true = xp.stack([self._outputs.last(channel)[rows] for channel in PRESSURE_CHANNELS])
        shown = true + self._noise[rows] * (self._pressure_sensor.measure(true, time, where) - true)
        return xp.astype(shown.T, xp.float32)

    def _overshoot(self) -> Array:
        return self._arrays.xp.clip(self._approach * (self._angle - self._target), 0.0, None)

    def _update_goals(self) -> None:
        """Set the next target where the time of the last one is up."""
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
        return self._inside >= self.dwell_steps

    @property
    def dwell_steps(self) -> int:
        """Steps within the tolerance that settle a target."""
        return math.ceil(self.config.dwell / self.control_step - 1e-6)

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
            step=self._step,
            rays=self._rays,
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
        from aoro_gym.envs.turning.rendering import TurningScene

        return TurningScene(machine, tolerance=self.config.tolerance)


def spaced_targets(
    start: NDArray[np.float64], reach: NDArray[np.float64], spacing: float, uniform: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Targets (K, T) [rad], uniform over ±``reach`` (K,) less what is nearer than ``spacing`` to the one before."""
    targets = np.empty_like(uniform)
    before = start
    for t in range(uniform.shape[1]):
        below = np.clip(before - spacing, -reach, reach) + reach  # length of the free interval on either side
        above = np.clip(before + spacing, -reach, reach)
        along = uniform[:, t] * (below + reach - above)
        before = targets[:, t] = np.where(along < below, along - reach, above + along - below)
    return targets
