"""``AORO/Levelling-v0``: keep the frames level and the wheels' loads even over rough ground, by the pendulum arms, at 20 Hz.

The action are the signals of the four arm valves: what opens is a valve, behind which the twin's pump 2 with its limits, the
other arms and the steering decide how fast an arm moves. A path controller (:mod:`aoro_gym.envs.levelling.driving`) steers
and drives meanwhile by what the machine measures. The observation is what sensors give; the reward sees the true motion.

Driving, its measurements and the ends of an episode are those of :class:`aoro_gym.envs.path_tracking.task.PathTracking`,
which this task holds. An episode succeeds that reaches the path's end with small tilt and even loads
(``tilt_limit``, ``unevenness_limit``).
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from typing import Any, ClassVar

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from aoro_gym.envs.core.randomisation import Draws
from aoro_gym.envs.core.task import Outputs, Start, StepResult, Terrains, sensing
from aoro_gym.envs.levelling.config import ARM_SIGNALS, LevellingConfig
from aoro_gym.envs.levelling.driving import PathDriver
from aoro_gym.envs.levelling.rewards import LIFTED
from aoro_gym.envs.levelling.sensing import CORNERS, ArmSensors, GroundMap
from aoro_gym.envs.levelling.view import LevellingView
from aoro_gym.envs.path_tracking.courses import Course, drawn_by_difficulty
from aoro_gym.envs.path_tracking.task import PROJECTION_REACH, TERMINATION_REASONS, PathTracking
from aoro_gym.execution.array_api import HOST, Array, Arrays, Index, floats, namespace
from aoro_gym.machine import Machine
from aoro_gym.terrains import Path, Plane, Terrain
from aoro_gym.terrains.world.world import World
from aoro_gym.twin.records import WHEELS


class Levelling:
    """Arms and loads of N vehicles on their paths; see :class:`aoro_gym.envs.core.task.Task`."""

    option_names: ClassVar[tuple[str, ...]] = PathTracking.option_names
    termination_reasons: ClassVar[tuple[str, ...]] = TERMINATION_REASONS
    render_channels: ClassVar[tuple[str, ...]] = (
        *PathTracking.render_channels, "unevenness", *(f"signal_{name}" for name in ARM_SIGNALS)
    )  # fmt: skip
    render_span: ClassVar[float] = PathTracking.render_span

    def __init__(self, courses: Sequence[Course], config: LevellingConfig | None = None):
        self.config = LevellingConfig() if config is None else config
        self.driving = PathTracking(courses, self.config.path_tracking())
        """The task of the path controller."""
        self.courses = self.driving.courses
        self.control_step, self.sample_step = self.config.control_step, self.config.sample_step
        self.reward_terms = self.config.reward_terms
        self.observation_terms = self.config.observation_terms
        self.randomisation = self.config.randomisation
        self.action_layout = {name: slice(k, k + 1) for k, name in enumerate(ARM_SIGNALS)}
        """Columns of the action by name."""
        self.action_space: spaces.Box[Any] = spaces.Box(-1.0, 1.0, (CORNERS,), np.float32)

    def allocate(self, num_envs: int, terrains: Terrains, arrays: Arrays = HOST) -> None:
        n, xp = num_envs, arrays.xp
        self._arrays = arrays
        self.driving.observation_terms = self.observation_terms  # for rays that look back
        self.driving.allocate(n, terrains, arrays)
        self._outputs = self.driving._outputs
        self._sensors = ArmSensors(n, self.config, arrays)
        self._ground = GroundMap(n, self.config, arrays)
        self._signals = arrays.zeros((self.config.signal_memory, n, CORNERS), xp.float32)
        # of the machines
        self._arm_length, self._largest_angle = arrays.ones(n), arrays.ones(n)
        self._rest_angles, self._rest_share = arrays.zeros((CORNERS, n)), arrays.full((CORNERS, n), 0.25)
        self._weight = arrays.ones(n)  # [N] of all wheels at rest
        # true motion
        self._loads, self._power = arrays.zeros((CORNERS, n)), arrays.zeros(n)
        self._unevenness, self._tilt = arrays.zeros(n), arrays.zeros(n)
        self._work, self._travel, self._lifted = arrays.zeros(n), arrays.zeros(n), arrays.zeros(n)
        self._tilt_squares, self._load_squares = arrays.zeros(n), arrays.zeros(n)
        self._view: LevellingView | None = None

    # ---- start

    def start(
        self,
        where: NDArray[np.intp],
        generators: list[np.random.Generator],
        draws: Draws,
        machine: Machine,
        options: Mapping[str, Any],
    ) -> Start:
        arrays, n = self._arrays, len(self._tilt)
        options = drawn_by_difficulty(options, draws, where, n, len(self.courses))
        start = self.driving.start(where, generators, draws, machine, options)
        rows, rest = arrays.index(where), machine.rest
        front, rear = np.broadcast_arrays(rest.arm_angle_front, rest.arm_angle_rear)
        load_front, load_rear = np.broadcast_arrays(rest.wheel_load_front, rest.wheel_load_rear)
        loads = np.stack([load_front, load_front, load_rear, load_rear]).reshape(CORNERS, -1)
        weight = loads[0] + loads[1] + loads[2] + loads[3]  # in an order that does not depend on how many begin
        for state, value in (
            (self._arm_length, machine.arm.length), (self._largest_angle, machine.joint.range),
            (self._weight, weight), (self._unevenness, 0.0), (self._tilt, 0.0), (self._work, 0.0),
            (self._power, 0.0), (self._travel, 0.0), (self._lifted, 0.0), (self._tilt_squares, 0.0),
            (self._load_squares, 0.0),
        ):  # fmt: skip
            arrays.put(state, rows, value)
        corners = (slice(None), rows)
        arrays.put(self._rest_angles, corners, np.stack([front, front, rear, rear]).reshape(CORNERS, -1))
        arrays.put(self._rest_share, corners, loads / weight)
        arrays.put(self._loads, corners, loads)
        arrays.put(self._signals, corners, 0.0)
        own = [generator.spawn(1)[0] for generator in sensing(options, where, n, generators)]
        self._sensors.reset(where, own, draws.sensor_noise)
        self._ground.reset(where, own, draws.sensor_noise)
        return start

    def rest(self, where: Index, outputs: Outputs) -> None:
        self._outputs, self._view = outputs, None
        self.driving.rest(where, outputs)
        self._sensors.begin(outputs, where)
        self._read_ground(self._arrays.zeros(len(where)), where)

    # ---- step

    def commands(self, actions: Array) -> Mapping[str, Array]:
        xp, measures = self._arrays.xp, self.driving._measures
        self._signals = xp.concat([actions[None], self._signals[:-1]])
        driven = self.config.driver.signals(
            self.driving.view(), self.driving.config.preview[0], measures.front, measures.rear, self._largest_angle
        )
        return self.driving.commands(xp.concat([driven, actions], axis=1))

    def advance(self, outputs: Outputs, time: Array) -> StepResult:
        xp, step = self._arrays.xp, self.config.control_step
        self._outputs, self._view = outputs, None
        result = self.driving.advance(outputs, time)
        self._sensors.update(outputs, time)
        self._read_ground(time, slice(None))
        self._loads = _mean(outputs.group(f"wheel_load_{WHEELS[0]}", CORNERS))
        fl, fr, rl, rr = self._loads
        total = xp.clip(fl + fr + rl + rr, 1.0, None)
        off = (self._loads - total * self._rest_share) ** 2
        self._unevenness = 2.0 * xp.sqrt(off[0] + off[1] + off[2] + off[3]) / total
        self._tilt = _tilt(outputs)
        self._power = _mean(outputs.samples("pump_pressure") * outputs.samples("pump_flow"))
        self._work = self._work + self._power * step
        self._travel = self._travel + self._arm_way()
        self._lifted = self._lifted + self._share_lifted()
        self._tilt_squares = self._tilt_squares + self._tilt**2
        self._load_squares = self._load_squares + self._unevenness**2
        return StepResult(self.view(), result.terminal, result.time_limit)

    def _read_ground(self, time: Array, rows: Index) -> None:
        driving = self.driving
        self._ground.read(self._outputs, driving.height_map, driving._course, driving._measures.half_track, time, rows)

    def _arm_way(self) -> Array:
        """Mean way [m] of a wheel against its frame over a step, by the arms' rates at its end (N,)."""
        xp = self._arrays.xp
        fl, fr, rl, rr = xp.abs(floats(self._outputs.states("ARM_RATE_FL", CORNERS)))
        return 0.25 * (fl + fr + rl + rr) * self._arm_length * self.config.control_step

    def _share_lifted(self) -> Array:
        """Share [-] of the wheels that are lifted (N,)."""
        fl, fr, rl, rr = floats(self._loads < LIFTED * self._weight * self._rest_share)
        return 0.25 * (fl + fr + rl + rr)

    # ---- step in kernels

    @property
    def has_kernels(self) -> bool:
        """Whether kernels do the same as this class and its driver: not as ones that are derived from them."""
        return type(self) is Levelling and type(self.config.driver) is PathDriver and self.driving.has_kernels

    @property
    def kernel_terms(self) -> Collection[Callable[[Any], Array]]:
        """Functions of reward and observation terms that the kernels know."""
        from aoro_gym.envs.levelling.kernels.judge import REWARDED
        from aoro_gym.envs.levelling.kernels.observe import OBSERVED

        return (*REWARDED, *OBSERVED)

    def kernels(self, memory: Any) -> Any:
        """What :meth:`commands` and :meth:`advance` do, and the terms, as kernels
        (:class:`aoro_gym.envs.core.kernel_step.TaskKernels`) with the ``memory`` of the step."""
        from aoro_gym.envs.levelling.kernels.step import levelling_kernels

        return levelling_kernels(self, memory, self._arrays, reach=PROJECTION_REACH)

    def took(self, outputs: Outputs) -> None:
        """The kernels have taken in ``outputs`` of a control step."""
        self._outputs, self._view = outputs, None
        self.driving.took(outputs)

    def judged_view(self) -> LevellingView:
        """What reward terms see of the step that the kernels took."""
        return self.view()

    # ---- what others see

    def view(self) -> LevellingView:
        if self._view is None:
            self._view = self._seen()
        return self._view

    def _seen(self) -> LevellingView:
        xp, driving, sensors = self._arrays.xp, self.driving.view(), self._sensors
        rates = floats(self._outputs.states("WX", 2))
        fl, fr, rl, rr = floats(self._outputs.group(f"arm_angle_{WHEELS[0]}", CORNERS)[-1]) - self._rest_angles
        return LevellingView(
            xp=xp,
            control_step=self.control_step,
            pace=driving.progress / (self.control_step * self.config.working_speed),
            tilt=self._tilt,
            tilt_rate=xp.sqrt(rates[0] ** 2 + rates[1] ** 2),
            loads=self._loads.T,
            unevenness=self._unevenness,
            lifted=self._share_lifted(),
            sunk=0.25 * (fl + fr + rl + rr) * self._arm_length,
            arm_travel=self._arm_way(),
            hydraulic_power=self._power,
            tipping_margin=driving.tipping_margin,
            finished=driving.finished,
            failed=driving.failed,
            measured_roll=driving.measured_roll,
            measured_pitch=driving.measured_pitch,
            measured_rates=driving.measured_rates,
            measured_force=driving.measured_force,
            measured_arms=(sensors.angles - self._rest_angles).T,
            measured_arm_rates=sensors.rates.T,
            measured_supports=sensors.supports(self.driving._measures.rod_share).T,
            measured_supply=sensors.supply,
            measured_angle=driving.measured_angle,
            measured_speed=driving.measured_speed,
            measured_ground=self._ground.heights,
            signals=xp.permute_dims(self._signals, (1, 0, 2)),
            step=driving.step,
            driving=driving,
            rays=driving.rays,
            outputs=self._outputs,
        )

    def info(self) -> dict[str, Array]:
        """``is_success``: the path's end was reached with a root mean square tilt and unevenness within their limits. Over
        the episode: ``tilt_rms`` [rad], ``unevenness_rms`` [-], ``lifted_share`` [-] of wheels and time, ``pump_work`` [J]
        of pump 2, ``arm_way`` [m] of a wheel against its frame in the mean; and what path tracking tells."""
        xp, config, told = self._arrays.xp, self.config, self.driving.info()
        steps = xp.clip(floats(self.driving._step), 1.0, None)
        tilt, unevenness = xp.sqrt(self._tilt_squares / steps), xp.sqrt(self._load_squares / steps)
        calm = (tilt <= config.tilt_limit) & (unevenness <= config.unevenness_limit)
        return {
            "tilt": xp.asarray(self._tilt, copy=True),
            "tilt_rms": tilt,
            "unevenness": xp.asarray(self._unevenness, copy=True),
            "unevenness_rms": unevenness,
            "lifted_share": self._lifted / steps,
            "pump_work": xp.asarray(self._work, copy=True),
            "arm_way": xp.asarray(self._travel, copy=True),
            **{name: told[name] for name in (
                "cross_track", "cross_track_rms", "mean_speed", "remaining", "tipping_margin", "engine_work", "terrain",
                "path",
            )},
            "is_success": told["is_success"] & calm,
        }  # fmt: skip

    def traces(self) -> Array:
        xp = self._arrays.xp
        return xp.concat([floats(self.driving.traces()), self._unevenness[None], floats(self._signals[0].T)])

    def surroundings(self) -> tuple[Plane | Terrain | World, Path]:
        """Ground and path of the first sub-environment."""
        return self.driving.surroundings()

    def scene(self, machine: Machine) -> Any:
        from aoro_gym.envs.levelling.rendering import LevellingScene

        return LevellingScene(machine, self.driving, self.render_channels)


def _tilt(outputs: Outputs) -> Array:
    """Angle [rad] of the front frame's vertical axis off the world's (N,): cos = cos(roll) cos(pitch), by the tangent, as a
    cosine near 1 tells nothing of small angles."""
    roll, pitch = floats(outputs.last("roll")), floats(outputs.last("pitch"))
    xp = namespace(roll)
    across, along = xp.sin(roll), xp.cos(roll) * xp.sin(pitch)
    return xp.atan2(xp.sqrt(across**2 + along**2), xp.cos(roll) * xp.cos(pitch))


def _mean(samples: Array) -> Array:
    """Mean over the frames (F, ...), in an order that does not depend on their number of columns."""
    total = floats(samples[0])
    for frame in samples[1:]:
        total = total + floats(frame)
    return total / len(samples)
