"""``AORO/PathTracking-v0``: drive along a path over rough ground, at 20 Hz.

The **reference point** is the middle of the front axle: its distance to the path is the cross-track error, positive where
it is LEFT of the path; its heading is the front frame's, and the heading error is positive where that points left of the
path. The action steers and drives; the observation is what the machine's own sensors give: GPS with two antennas, inertial
unit, wheel speeds, joint angle, and the path, which is known. The true errors are seen by the reward only.

An episode ends well at the path's end, badly when the machine rolls over, leaves the terrain, loses the path, is stuck or,
where the configuration limits it, hits an object (``info["termination"]`` says which), and is truncated when its time is up:
``time_margin`` times what the rest of the path takes at ``working_speed``.

Goals and judgement stand here; starts, sensors, the configuration and the terms stand beside, and a default is changed by
name when the environment is made.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Mapping, Sequence
from typing import Any, ClassVar

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from aoro_gym.envs.core.contacts import chassis_force
from aoro_gym.envs.core.randomisation import Draws
from aoro_gym.envs.core.ray_sensing import RaySensing, looks_back
from aoro_gym.envs.core.task import Outputs, Start, StepResult, Terrains, chosen, sensing
from aoro_gym.envs.path_tracking.assistance import ArmController, AutomaticGear
from aoro_gym.envs.path_tracking.config import PathTrackingConfig
from aoro_gym.envs.path_tracking.courses import Course, HeightMap
from aoro_gym.envs.path_tracking.measures import Measures
from aoro_gym.envs.path_tracking.path_table import PathTable
from aoro_gym.envs.path_tracking.sensing import ALL, VehicleSensors, true_pose
from aoro_gym.envs.path_tracking.starts import check_ground, starting_poses
from aoro_gym.envs.path_tracking.view import PathTrackingView
from aoro_gym.execution.array_api import HOST, Array, Arrays, Index, floats
from aoro_gym.execution.streams import Generators
from aoro_gym.machine import Machine
from aoro_gym.sensors.attitude import in_world, wrapped
from aoro_gym.terrains import Path, Plane, Terrain
from aoro_gym.terrains.world.places import circles
from aoro_gym.terrains.world.world import World
from aoro_gym.twin.records import WHEELS, Output, State

PROJECTION_REACH = 1.5
"""Distance [m] along the path from the last projection within which the next one is looked for: 30 m/s at 20 Hz."""
STEERING, DRIVE, ARMS, TRACTION, GEAR = "steering_signal", "drive_signal", "arms", "traction", "gear"

END_OF_PATH = "end of path reached"
TERMINATION_REASONS = ("", END_OF_PATH, "rolled over", "left the terrain", "lost the path", "stuck", "hit an object")
"""Why an episode terminates, besides a simulation that diverged."""


class PathTracking:
    """Paths, measurements and judgement of N vehicles; see :class:`aoro_gym.envs.core.task.Task`."""

    option_names: ClassVar[tuple[str, ...]] = ("path", "start", "lateral_offset", "heading_offset", "joint_angle")
    termination_reasons: ClassVar[tuple[str, ...]] = TERMINATION_REASONS
    render_channels: ClassVar[tuple[str, ...]] = (
        "time", "course", "path", "s", "x", "y", "z", "roll", "pitch", "yaw", "joint_angle",
        *(f"arm_{wheel}" for wheel in WHEELS), *(f"wheel_{wheel}" for wheel in WHEELS), "reference_x", "reference_y",
        "cross_track", "measured_cross_track", "speed", "steering_signal", "drive_signal", "gear", "tipping_margin",
    )  # fmt: skip
    draws_together: ClassVar[bool] = True
    render_span: ClassVar[float] = 90.0

    def __init__(self, courses: Sequence[Course], config: PathTrackingConfig | None = None):
        self.config = PathTrackingConfig() if config is None else config
        self.courses = tuple(courses)
        self.control_step = self.config.control_step
        self.sample_step = self.config.sample_step
        self.reward_terms = self.config.reward_terms
        self.observation_terms = self.config.observation_terms
        self.randomisation = self.config.randomisation
        config = self.config
        sizes = {
            STEERING: 1,
            DRIVE: 1,
            ARMS: 4 * config.act_arms,
            TRACTION: 4 * config.act_traction,
            GEAR: config.act_gear,
        }
        self.action_layout: dict[str, slice] = {}
        """Columns of the action by name."""
        end = 0
        for name, size in sizes.items():
            if size:
                self.action_layout[name] = slice(end, end + size)
                end += size
        self.action_space: spaces.Box[Any] = spaces.Box(-1.0, 1.0, (end,), np.float32)
        paths = [path for course in self.courses for path in course.paths]
        for path in paths:
            self._check_length(path)
        self._library = len(paths)
        self._num_paths = np.array([len(course.paths) for course in self.courses])
        self._first_path = np.cumsum(self._num_paths) - self._num_paths

    def _check_length(self, path: Path) -> None:
        least = (0.0 if path.closed else self.config.start_distance) + 2.0
        if path.length < least:
            raise ValueError(f"path {path.name!r} is {path.length:.2f} m long, but must be at least {least:.2f} m")

    def allocate(self, num_envs: int, terrains: Terrains, arrays: Arrays = HOST) -> None:
        self._arrays, xp = arrays, arrays.xp
        n, config = num_envs, self.config
        paths = [path for course in self.courses for path in course.paths]
        self.table = PathTable(paths, ahead=max(*config.preview, 10.0) + 2.0, arrays=arrays)
        """All paths, those of a course after those of the course before."""
        self.height_map = HeightMap([course.terrain for course in self.courses], arrays)
        frames = round(config.control_step / config.sample_step)
        self._outputs = Outputs(
            arrays.zeros((frames, len(Output), n), xp.float32), arrays.zeros((len(State), n), xp.float32)
        )
        self._distances = arrays.asarray([0.0, *config.preview])
        self._scan = arrays.asarray([(x, y) for x in config.scan_x for y in config.scan_y])
        # where to drive
        self._course, self._path = arrays.zeros(n, xp.int64), arrays.zeros(n, xp.int64)
        self._path_number = arrays.zeros(n, xp.int64)  # among the course's own
        self._length = arrays.zeros(n)
        self._steps_allowed = arrays.ones(n, xp.int64)
        self._step = arrays.zeros(n, xp.int64)
        self._measures = Measures(n, arrays)
        # true motion
        self._s, self._start_s, self._progress = arrays.zeros(n), arrays.zeros(n), arrays.zeros(n)
        self._reference, self._rear_axle = arrays.zeros((n, 2)), arrays.zeros((n, 2))
        self._cross_track, self._heading_error = arrays.zeros(n), arrays.zeros(n)
        self._tipping_margin, self._power, self._work = arrays.ones(n), arrays.zeros(n), arrays.zeros(n)
        self._squares = arrays.zeros(n)  # [m²] sum of the squared cross-track errors
        self._mark_s, self._mark_step = arrays.zeros(n), arrays.zeros(n, xp.int64)
        self._ending = arrays.zeros(n, xp.int64)
        # measurement
        self._sensors = VehicleSensors(n, config, arrays)
        self._measured_s, self._measured_cross_track = arrays.zeros(n), arrays.zeros(n)
        self._measured_heading_error = arrays.zeros(n)
        self._actions = arrays.zeros((config.action_memory, n, self.action_space.shape[0]), xp.float32)
        grounds = [course.surroundings for course in self.courses]
        self._rays = RaySensing(n, grounds, config.control_step, looks_back(self.observation_terms), arrays)
        worlds = [course.world for course in self.courses]
        self._solid = None if not any(worlds) else [None if each is None else circles(each) for each in worlds]
        self._view: PathTrackingView | None = None
        # controllers
        self._gear = AutomaticGear(n, config.gear_shift, arrays)
        self._arms = ArmController(n, config.arms, arrays)
        self._openings = arrays.ones((n, 4))

    # ---- start

    def start(
        self,
        where: NDArray[np.intp],
        generators: Generators,
        draws: Draws,
        machine: Machine,
        options: Mapping[str, Any],
    ) -> Start:
        config, arrays, n = self.config, self._arrays, len(self._s)
        course = chosen(options, "terrain", len(self.courses), where, n, generators)
        path = self._asked_path(options, course, where, generators)
        self._measures.take(machine, where)
        poses = starting_poses(
            self.table, path, machine, draws, options,
            where=where, num_envs=n, start_distance=config.start_distance,
            solid=None if self._solid is None else [self._solid[each] for each in course],
        )  # fmt: skip
        check_ground(poses, self.height_map, course, self.table, path)

        rows = arrays.index(where)
        length = self.table.lengths[path]
        duration = (length - poses.s) / config.working_speed * config.time_margin
        allowed = np.maximum(np.ceil(duration / config.control_step), 1)
        number = np.where(path < self._library, path - self._first_path[course], path)
        for state, value in (
            (self._course, course), (self._path, path), (self._path_number, number), (self._length, length),
            (self._s, poses.s), (self._measured_s, poses.s), (self._steps_allowed, allowed), (self._tipping_margin, 1.0),
            (self._step, 0), (self._mark_step, 0), (self._ending, 0), (self._progress, 0), (self._power, 0),
            (self._work, 0), (self._squares, 0), (self._openings, 1.0),
        ):  # fmt: skip
            arrays.put(state, rows, value)
        arrays.put(self._actions, (slice(None), rows), 0.0)
        sensor_generators = sensing(options, where, n, generators)
        self._sensors.reset(rows, sensor_generators, draws.sensor_noise)
        self._rays.reset(rows, course, draws.sensor_noise, sensor_generators)
        self._gear.reset(rows, 1.0 if config.act_gear or config.gear == "automatic" else float(config.gear))
        self._arms.reset(rows)
        return Start(
            joint_angle=poses.joint_angle,
            heading=poses.heading,
            position=poses.hinge,
            terrain=None if isinstance(self.courses[0].terrain, Plane) else course,
        )

    def _asked_path(
        self,
        options: Mapping[str, Any],
        course: NDArray[np.intp],
        where: NDArray[np.intp],
        generators: Generators,
    ) -> NDArray[np.intp]:
        """Rows (K,) of the table: a path of the course, drawn or asked for, or one that the option brings along."""
        asked = options.get("path")
        if isinstance(asked, Path):
            self._check_length(asked)
            others = np.delete(self._arrays.host(self._path), where)
            if self.table.paths[-1] is not asked:
                if not np.any(others >= self._library):  # nobody drives on what was brought before
                    self.table.shortened(self._library)
                self.table.add([asked])
            return np.full(len(where), len(self.table) - 1, dtype=np.intp)
        return self._first_path[course] + chosen(
            options, "path", self._num_paths[course], where, len(self._s), generators
        )

    def rest(self, where: Index, outputs: Outputs) -> None:
        self._outputs, self._view = outputs, None
        self._sensors.begin(outputs, self._measures.reference, self._measures.rolling_radius, where)
        self._follow(where)
        self._start_s[where] = self._mark_s[where] = self._s[where]

    # ---- step

    def commands(self, actions: Array) -> Mapping[str, Array]:
        config, layout = self.config, self.action_layout
        xp = self._arrays.xp
        self._actions = xp.concat([actions[None], self._actions[:-1]])
        drive = actions[:, layout[DRIVE]][:, 0]
        commands = {STEERING: actions[:, layout[STEERING]][:, 0], DRIVE: drive}
        if config.act_gear:
            part = actions[:, layout[GEAR]][:, 0]
            self._gear.gear = 1.0 + floats(part >= -1.0 / 3.0) + floats(part >= 1.0 / 3.0)
        elif config.gear == "automatic":
            sensors = self._sensors
            drop = sensors.pressure("drive_pressure_forward") - sensors.pressure("drive_pressure_return")
            self._gear.update(drive, sensors.speed, drop, self._measures.top_speed, self.control_step)
        commands[GEAR] = self._gear.gear
        if config.act_arms:
            commands |= _each("arm", actions[:, layout[ARMS]].T)
        elif config.arms is not None:
            commands |= _each("arm", self._arm_signals())
        if config.act_traction:
            commands |= _each("traction", xp.clip(1.0 + actions[:, layout[TRACTION]], None, 1.0).T)
        elif config.traction is not None:
            self._openings = config.traction.openings(self._openings, self._sensors.wheel_rates, self.control_step)
            commands |= _each("traction", self._openings.T)
        return commands

    def _arm_signals(self) -> Array:
        sensors, measures = self._sensors, self._measures
        return self._arms.update(
            sensors.arm_pressures("bore") - measures.rod_share * sensors.arm_pressures("rod"), self._arm_angles(),
            sensors.roll, sensors.pitch, sensors.joint.angle, measures.stance, self.control_step,
        )  # fmt: skip

    def advance(self, outputs: Outputs, time: Array) -> StepResult:
        xp, config = self._arrays.xp, self.config
        self._outputs, self._view = outputs, None
        self._step = self._step + 1
        self._sensors.update(outputs, self._measures.reference, self._measures.rolling_radius, time)

        before = xp.asarray(self._s, copy=True)
        self._follow(ALL)
        self._progress = self._s - before
        fl, fr, rl, rr = _mean(outputs.group("wheel_load_fl", len(WHEELS)))
        total = xp.clip(fl + fr + rl + rr, 1.0, None)
        self._tipping_margin = 1.0 - xp.maximum(xp.abs(fl + rl - fr - rr), xp.abs(fl + fr - rl - rr)) / total
        self._power = _mean(outputs.samples("engine_torque") * outputs.samples("engine_speed"))
        self._work = self._work + self._power * config.control_step
        self._squares = self._squares + self._cross_track**2
        self._judge()
        return StepResult(self.view(), self._ending, self._step >= self._steps_allowed)

    # ---- step in kernels

    @property
    def has_kernels(self) -> bool:
        """Whether kernels do the same as this class: not as one that is derived from it."""
        return type(self) is PathTracking

    @property
    def kernel_terms(self) -> Collection[Callable[[Any], Array]]:
        """Functions of reward and observation terms that the kernels know."""
        from aoro_gym.envs.path_tracking.kernels.judge import REWARDED
        from aoro_gym.envs.path_tracking.kernels.observe import OBSERVED

        return (*REWARDED, *OBSERVED)

    def kernels(self, memory: Any) -> Any:
        """What :meth:`commands` and :meth:`advance` do, and the terms, as kernels
        (:class:`aoro_gym.envs.core.kernel_step.TaskKernels`) with the ``memory`` of the step."""
        from aoro_gym.envs.path_tracking.kernels.step import path_tracking_kernels

        return path_tracking_kernels(self, memory, self._arrays, reach=PROJECTION_REACH)

    def took(self, outputs: Outputs) -> None:
        """The kernels have taken in ``outputs`` of a control step."""
        self._outputs, self._view = outputs, None

    def judged_view(self) -> PathTrackingView:
        """What reward terms see of the step that the kernels took."""
        return self.view()

    def _judge(self) -> None:
        """How episodes end; of several reasons the worst."""
        xp, config = self._arrays.xp, self.config
        gained = self._s >= self._mark_s + config.stuck_distance
        self._mark_s = xp.where(gained, self._s, self._mark_s)
        self._mark_step = xp.where(gained, self._step, self._mark_step)
        roll, pitch = self._outputs.last("roll"), self._outputs.last("pitch")
        on_ground = self.height_map.known(self._course, xp.stack([self._reference, self._rear_axle]))
        ending = xp.zeros_like(self._ending)
        for reason, holds in (
            (END_OF_PATH, self._s >= self._length - config.end_tolerance),
            ("stuck", floats(self._step - self._mark_step) * config.control_step >= config.stuck_time),
            ("lost the path", xp.abs(self._cross_track) > config.path_limit),
            ("left the terrain", ~(on_ground[0] & on_ground[1])),
            ("hit an object", chassis_force(self._outputs) > config.chassis_force_limit),
            ("rolled over", xp.cos(roll) * xp.cos(pitch) < math.cos(config.rollover)),
        ):
            ending = xp.where(holds, TERMINATION_REASONS.index(reason), ending)
        self._ending = ending

    # ---- geometry

    def _follow(self, rows: Index) -> None:
        """Where the sub-environments ``rows`` are, and where on their paths they are and believe to be."""
        xp = self._arrays.xp
        position, roll, pitch, yaw = true_pose(self._outputs, rows)
        reference = (position + in_world(roll, pitch, yaw, self._measures.reference[rows]))[:, :2]
        rear = yaw - self._outputs.last("joint_angle")[rows]
        behind = self._measures.rear[rows][:, None] * xp.stack([xp.cos(rear), xp.sin(rear)], axis=1)
        self._reference[rows], self._rear_axle[rows] = reference, position[:, :2] - behind

        path = xp.concat([self._path[rows]] * 2)
        s, cross_track = self.table.project(
            path,
            xp.concat([reference, self._sensors.localisation.position[rows]]),
            xp.concat([self._s[rows], self._measured_s[rows]]),
            reach=PROJECTION_REACH,
        )
        _, _, cosine, sine, _ = self.table.places(path, s)
        error = wrapped(xp.concat([yaw, self._sensors.localisation.heading[rows]]) - xp.atan2(sine, cosine))
        for value, (true, measured) in (
            (s, (self._s, self._measured_s)),
            (cross_track, (self._cross_track, self._measured_cross_track)),
            (error, (self._heading_error, self._measured_heading_error)),
        ):
            true[rows], measured[rows] = value[: len(yaw)], value[len(yaw) :]

    def _arm_angles(self) -> Array:
        return self._outputs.group(f"arm_angle_{WHEELS[0]}", len(WHEELS))[-1]

    # ---- what others see

    def view(self) -> PathTrackingView:
        if self._view is None:
            self._view = self._seen()
        return self._view

    def _seen(self) -> PathTrackingView:
        xp, sensors = self._arrays.xp, self._sensors
        here, heading = sensors.localisation.position, sensors.localisation.heading
        x, y, _, _, bends = self.table.places(self._path[:, None], self._measured_s[:, None] + self._distances)
        x, y = x[:, 1:] - here[:, :1], y[:, 1:] - here[:, 1:]
        s, c = xp.sin(heading)[:, None], xp.cos(heading)[:, None]
        return PathTrackingView(
            xp=xp,
            control_step=self.control_step,
            working_speed=self.config.working_speed,
            cross_track=self._cross_track,
            heading_error=self._heading_error,
            progress=self._progress,
            remaining=self._length - self._s,
            speed=self._outputs.last("speed"),
            tipping_margin=self._tipping_margin,
            engine_power=self._power,
            finished=self._ending == TERMINATION_REASONS.index(END_OF_PATH),
            failed=self._ending > TERMINATION_REASONS.index(END_OF_PATH),
            measured_cross_track=self._measured_cross_track,
            measured_heading_error=self._measured_heading_error,
            measured_remaining=self._length - self._measured_s,
            gps_quality=sensors.gps.quality,
            preview=xp.stack([c * x + s * y, c * y - s * x], axis=-1),
            curvature=bends,
            measured_speed=sensors.speed,
            measured_angle=sensors.joint.angle,
            measured_rate=sensors.joint.rate,
            measured_roll=sensors.roll,
            measured_pitch=sensors.pitch,
            measured_rates=sensors.rates,
            measured_force=sensors.force,
            measured_wheel_rates=sensors.wheel_rates,
            gear=self._gear.gear,
            actions=xp.permute_dims(self._actions, (1, 0, 2)),
            heights=self._heights(),
            step=self._step,
            rays=self._rays,
            outputs=self._outputs,
        )

    def _heights(self) -> Array:
        """Ground at the scan's places over that at the reference point [m] (N, G), at the true pose."""
        if not len(self._scan):
            return self._arrays.zeros((len(self._s), 0))
        xp, yaw = self._arrays.xp, floats(self._outputs.last("yaw"))[:, None]
        s, c = xp.sin(yaw), xp.cos(yaw)
        x, y = self._scan[:, 0], self._scan[:, 1]
        places = self._reference[:, None] + xp.stack([c * x - s * y, s * x + c * y], axis=-1)
        base = self.height_map.height(self._course, self._reference)
        return self.height_map.height(self._course[:, None], places) - base[:, None]

    def info(self) -> dict[str, Array]:
        """``is_success``: the end of the path was reached. Errors are true ones; ``cross_track_rms`` is over the episode,
        ``engine_work`` [J], too; ``mean_speed`` is path gained over time."""
        xp, steps = self._arrays.xp, floats(self._arrays.xp.clip(self._step, 1, None))
        return {
            "cross_track": xp.asarray(self._cross_track, copy=True),
            "heading_error": xp.asarray(self._heading_error, copy=True),
            "cross_track_rms": xp.sqrt(self._squares / steps),
            "mean_speed": (self._s - self._start_s) / (steps * self.control_step),
            "remaining": self._length - self._s,
            "tipping_margin": xp.asarray(self._tipping_margin, copy=True),
            "engine_work": xp.asarray(self._work, copy=True),
            "gear": xp.astype(self._gear.gear, xp.int64),
            "gps_quality": xp.asarray(self._sensors.gps.quality, copy=True),
            "terrain": xp.asarray(self._course, copy=True),
            "path": xp.asarray(self._path_number, copy=True),
            "is_success": self._ending == TERMINATION_REASONS.index(END_OF_PATH),
        }

    def traces(self) -> Array:
        last, layout = self._outputs.last, self.action_layout
        newest = self._actions[0]
        return self._arrays.xp.stack(
            [
                self._step * self.control_step, self._course, self._path, self._s,
                *(last(name) for name in ("position_x", "position_y", "position_z", "roll", "pitch", "yaw", "joint_angle")),
                *self._arm_angles(), *self._outputs.states("WHEEL_FL", len(WHEELS)),
                self._reference[:, 0], self._reference[:, 1], self._cross_track, self._measured_cross_track, last("speed"),
                newest[:, layout[STEERING]][:, 0], newest[:, layout[DRIVE]][:, 0], self._gear.gear, self._tipping_margin,
            ]
        )  # fmt: skip

    def surroundings(self) -> tuple[Plane | Terrain | World, Path]:
        """Ground and path of the first sub-environment."""
        course = self.courses[int(self._course[0])]
        return course.ground, course.paths[int(self._path_number[0])]

    def scene(self, machine: Machine) -> Any:
        from aoro_gym.envs.path_tracking.rendering.scene import PathTrackingScene

        return PathTrackingScene(machine, self)


def _each(name: str, rows: Array) -> dict[str, Array]:
    """Commands of the four corners from rows (4, N)."""
    return {f"{name}_{wheel}": row for wheel, row in zip(WHEELS, rows, strict=True)}


def _mean(samples: Array) -> Array:
    """Mean over the frames (F, ...), in an order that does not depend on their number of columns."""
    total = floats(samples[0])
    for frame in samples[1:]:
        total = total + frame
    return total / len(samples)
