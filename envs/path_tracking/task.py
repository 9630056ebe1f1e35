"""``AORO/PathTracking-v0``: drive along a path over rough ground, at 20 Hz.

The **reference point** is the middle of the front axle: its distance to the path is the cross-track error, positive where
it is LEFT of the path; its heading is the front frame's, and the heading error is positive where that points left of the
path. The action steers and drives; the observation is what the machine's own sensors give: GPS with two antennas, inertial
unit, wheel speeds, joint angle, and the path, which is known. The true errors are seen by the reward only.

An episode ends well at the path's end, badly when the machine rolls over, leaves the terrain, loses the path or is stuck
(``info["termination"]`` says which), and is truncated when its time is up: ``time_margin`` times what the rest of the path
takes at ``working_speed``.

Goals, measurements and judgement stand here; the configuration and the terms stand beside, and a default is changed by name
when the environment is made.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, ClassVar

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from aoro_gym.envs.core.joint import MeasuredJoint
from aoro_gym.envs.core.randomisation import Draws
from aoro_gym.envs.core.task import Outputs, Start, StepResult, Terrains, chosen, given, sensing
from aoro_gym.envs.path_tracking.assistance import (
    ArmController,
    AutomaticGear,
    Stance,
)
from aoro_gym.envs.path_tracking.config import PathTrackingConfig
from aoro_gym.envs.path_tracking.courses import Course, HeightMap
from aoro_gym.envs.path_tracking.path_table import PathTable
from aoro_gym.envs.path_tracking.view import PathTrackingView
from aoro_gym.execution.array_api import HOST, Array, Arrays, Index, floats
from aoro_gym.machine import Machine
from aoro_gym.sensors import (
    Gps,
    GpsReading,
    Imu,
    Localisation,
    PressureSensor,
    WheelSpeedSensor,
)
from aoro_gym.sensors.attitude import in_world, wrapped
from aoro_gym.sensors.imu import specific_force
from aoro_gym.sensors.wheel_speed import ground_speed
from aoro_gym.terrains import Path, Plane
from aoro_gym.twin.records import WHEELS, Output, State

PROJECTION_REACH = 1.5
"""Distance [m] along the path from the last projection within which the next one is looked for: 30 m/s at 20 Hz."""
ALL = slice(None)
"""Rows of all sub-environments."""
STEERING, DRIVE, ARMS, TRACTION, GEAR = "steering_signal", "drive_signal", "arms", "traction", "gear"

END_OF_PATH = "end of path reached"
TERMINATION_REASONS = ("", END_OF_PATH, "rolled over", "left the terrain", "lost the path", "stuck")
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
        # the machine
        self._front, self._rear, self._half_track = arrays.ones(n), arrays.ones(n), arrays.ones(n)
        self._rolling_radius, self._top_speed = arrays.ones(n), arrays.ones(n)
        self._rod_share, self._arm_length, self._arm_dead_band = arrays.ones(n), arrays.ones(n), arrays.zeros(n)
        self._arm_rest = arrays.zeros((4, n))
        # true motion
        self._s, self._start_s, self._progress = arrays.zeros(n), arrays.zeros(n), arrays.zeros(n)
        self._reference, self._rear_axle = arrays.zeros((n, 2)), arrays.zeros((n, 2))
        self._cross_track, self._heading_error = arrays.zeros(n), arrays.zeros(n)
        self._tipping_margin, self._power, self._work = arrays.ones(n), arrays.zeros(n), arrays.zeros(n)
        self._squares = arrays.zeros(n)  # [m²] sum of the squared cross-track errors
        self._mark_s, self._mark_step = arrays.zeros(n), arrays.zeros(n, xp.int64)
        self._ending = arrays.zeros(n, xp.int64)
        # measurement
        self._noise = arrays.ones(n)
        self._measured_s, self._measured_cross_track = arrays.zeros(n), arrays.zeros(n)
        self._measured_heading_error = arrays.zeros(n)
        self._roll, self._pitch = arrays.zeros(n), arrays.zeros(n)
        self._rates, self._force = arrays.zeros((n, 3)), arrays.zeros((n, 3))
        self._wheel_rates, self._speed = arrays.zeros((n, 4)), arrays.zeros(n)
        self._actions = arrays.zeros((config.action_memory, n, self.action_space.shape[0]), xp.float32)
        self._view: PathTrackingView | None = None
        # sensors and controllers
        self._joint = MeasuredJoint(
            n,
            config.joint_angle_noise,
            interval=config.sample_step,
            frames=frames,
            kept=config.rate_samples,
            arrays=arrays,
        )
        self._imu = Imu(n, config.imu_noise, accelerometers=config.observe_inertial, arrays=arrays)
        self._wheel_sensor = WheelSpeedSensor(n, config.wheel_speed_noise, arrays=arrays)
        self._gps = Gps(
            n, config.gps_noise, antennas=config.antennas, latency=config.gps_latency, interval=config.control_step,
            arrays=arrays,
        )  # fmt: skip
        self._localisation = Localisation(n, antennas=config.antennas, gains=config.localisation, arrays=arrays)
        self._pressure_rows = {channel: row for row, channel in enumerate(self._pressures_used())}
        self._pressures = arrays.zeros((len(self._pressure_rows), n))
        self._pressure_sensor = PressureSensor(n, config.pressure_noise, count=len(self._pressure_rows), arrays=arrays)
        self._gear = AutomaticGear(n, config.gear_shift, arrays)
        self._arms = ArmController(n, config.arms, arrays)
        self._openings = arrays.ones((n, 4))

    def _pressures_used(self) -> list[str]:
        """Channels of the pressure sensors that a controller reads."""
        used = ["drive_pressure_forward", "drive_pressure_return"] if self.config.gear == "automatic" else []
        if self.config.arms is not None and not self.config.act_arms:
            used += [f"arm_pressure_{end}_{wheel}" for end in ("bore", "rod") for wheel in WHEELS]
        return used

    # ---- start

    def start(
        self,
        where: NDArray[np.intp],
        generators: list[np.random.Generator],
        draws: Draws,
        machine: Machine,
        options: Mapping[str, Any],
    ) -> Start:
        config, arrays, n = self.config, self._arrays, len(self._s)
        course = chosen(options, "terrain", len(self.courses), where, n, generators)
        path = self._asked_path(options, course, where, generators)
        front, rear = self._know(machine, where)

        # the front axle's middle and, one machine behind, the rear one's
        length = self.table.lengths[path]
        first = np.array([0.0 if self.table.paths[row].closed else config.start_distance for row in path])
        last = np.maximum(length - 2.0, first)
        s = given(options, "start", where, n, first + draws.task["start"] * (last - first), 0.0, np.inf, "m")
        if np.any(s > last):
            bad = int(np.argmax(s > last))
            raise ValueError(
                f"options['start'] is {s[bad]:g} m, but that path is {length[bad]:.2f} m long; start 2 m before its end"
            )
        offset = given(options, "lateral_offset", where, n, draws.task["lateral_offset"], -np.inf, np.inf, "m")
        turned = given(options, "heading_offset", where, n, draws.task["heading_offset"], -np.pi, np.pi, "rad")
        place, along, bend = map(arrays.host, self.table.at(arrays.index(path), arrays.asarray(s)))
        heading = wrapped(along + turned)
        reference = place + offset[:, None] * np.stack([-np.sin(along), np.cos(along)], axis=1)
        hinge = reference - front[:, None] * np.stack([np.cos(heading), np.sin(heading)], axis=1)
        limit = np.broadcast_to(np.asarray(machine.joint.range, dtype=np.float64), len(where))
        # a steady turn of curvature κ bends the joint by κ times the wheelbase, at small angles
        angle = bend * (front + rear) + draws.joint_angle * limit
        angle = given(options, "joint_angle", where, n, np.clip(angle, -limit, limit), -limit, limit, "rad")
        behind = hinge - rear[:, None] * np.stack([np.cos(heading - angle), np.sin(heading - angle)], axis=1)
        axles = arrays.asarray(np.stack([reference, behind]))
        there = arrays.host(self.height_map.known(arrays.index(course), axles)).all(axis=0)
        if not there.all():
            bad = int(np.argmin(there))
            raise ValueError(
                f"path {self.table.paths[path[bad]].name!r} starts at "
                f"({reference[bad, 0]:.1f}, {reference[bad, 1]:.1f}) m, where "
                f"terrain {course[bad]} has no ground for both axles; give a path within it"
            )

        rows = arrays.index(where)
        duration = (length - s) / config.working_speed * config.time_margin
        allowed = np.maximum(np.ceil(duration / config.control_step), 1)
        number = np.where(path < self._library, path - self._first_path[course], path)
        values = arrays.asarray(np.stack([course, path, number, length, s, allowed, draws.sensor_noise]))
        for states, value in zip(
            (
                (self._course,), (self._path,), (self._path_number,), (self._length,), (self._s, self._measured_s),
                (self._steps_allowed,), (self._noise, self._joint.scale, self._gps.scale, self._imu.scale),
            ),
            values, strict=True,
        ):  # fmt: skip
            for state in states:
                arrays.put(state, rows, value)
        for state in (
            self._step, self._mark_step, self._ending, self._progress, self._power, self._work, self._squares,
        ):  # fmt: skip
            state[rows] = 0
        self._tipping_margin[rows] = 1.0
        sensor_draws = sensing(options, where, n, generators)
        for sensor in (self._joint, self._imu, self._wheel_sensor, self._gps, self._pressure_sensor):
            sensor.reset(rows, sensor_draws)
        self._actions[:, rows] = 0.0
        self._gear.reset(rows)
        self._arms.reset(rows)
        self._openings[rows] = 1.0
        if config.gear != "automatic":
            self._gear.gear[rows] = 1.0 if config.act_gear else float(config.gear)
        return Start(
            joint_angle=angle,
            heading=heading,
            position=hinge,
            terrain=None if isinstance(self.courses[0].terrain, Plane) else course,
        )

    def _asked_path(
        self,
        options: Mapping[str, Any],
        course: NDArray[np.intp],
        where: NDArray[np.intp],
        generators: list[np.random.Generator],
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

    def _know(self, machine: Machine, where: NDArray[np.intp]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Take over the machine's measures: the controller knows its vehicle. Gives the distances (K,) [m] of the front and
        of the rear axle from the hinge."""
        arrays, rows, driveline, tire = self._arrays, self._arrays.index(where), machine.driveline, machine.tire
        radius = tire.radius  # the rims of the twin's discs roll where the ground is pressed in: calibrated, as it were
        flow = driveline.pump.displacement * machine.engine.set_speed
        front, rear = (
            np.broadcast_to(np.asarray(frame.axle_distance, dtype=np.float64), where.shape)
            for frame in (machine.frame.front, machine.frame.rear)
        )
        for state, value in (
            (self._front, front),
            (self._rear, rear),
            (self._half_track, 0.5 * machine.frame.track),
            (self._rolling_radius, radius),
            (self._top_speed, flow / (4.0 * driveline.motor.displacement) * radius),
            (self._arm_length, machine.arm.length),
            (self._arm_dead_band, machine.arm.valve.dead_band),
            (self._rod_share, machine.arm.cylinder.annulus_area / machine.arm.cylinder.bore_area),
        ):
            arrays.put(state, rows, value)
        arrays.put(self._arm_rest, (slice(0, 2), rows), machine.rest.arm_angle_front)
        arrays.put(self._arm_rest, (slice(2, 4), rows), machine.rest.arm_angle_rear)
        return front, rear

    def rest(self, where: Index, outputs: Outputs) -> None:
        self._outputs, self._view = outputs, None
        self._joint.begin(outputs.last("joint_angle")[where], where)
        fix = self._sense(where, self._arrays.zeros(len(where)))
        self._localisation.begin(fix, self._roll[where], self._pitch[where], self._place()[where], where)
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
            rows = self._pressure_rows
            drop = self._pressures[rows["drive_pressure_forward"]] - self._pressures[rows["drive_pressure_return"]]
            self._gear.update(drive, self._speed, drop, self._top_speed, self.control_step)
        commands[GEAR] = self._gear.gear
        if config.act_arms:
            commands |= _each("arm", actions[:, layout[ARMS]].T)
        elif config.arms is not None:
            commands |= _each("arm", self._arm_signals())
        if config.act_traction:
            commands |= _each("traction", xp.clip(1.0 + actions[:, layout[TRACTION]], None, 1.0).T)
        elif config.traction is not None:
            self._openings = config.traction.openings(self._openings, self._wheel_rates, self.control_step)
            commands |= _each("traction", self._openings.T)
        return commands

    def _arm_signals(self) -> Array:
        stance = Stance(
            self._front, self._rear, self._half_track, self._arm_length, self._arm_rest, self._arm_dead_band
        )
        # the channels of the four corners follow each other
        first = (self._pressure_rows[f"arm_pressure_{end}_{WHEELS[0]}"] for end in ("bore", "rod"))
        bore, rod = (self._pressures[row : row + len(WHEELS)] for row in first)
        return self._arms.update(
            bore - self._rod_share * rod, self._arm_angles(), self._roll, self._pitch, self._joint.angle, stance,
            self.control_step,
        )  # fmt: skip

    def advance(self, outputs: Outputs, time: Array) -> StepResult:
        xp, config = self._arrays.xp, self.config
        self._outputs, self._view = outputs, None
        self._step = self._step + 1

        # what is measured
        self._joint.update(outputs.samples("joint_angle"), time)
        fix = self._sense(ALL, time)
        self._localisation.update(
            fix, self._roll, self._pitch, self._place(),
            speed=self._speed, yaw_rate=self._rates[:, 2], step=config.control_step,
        )  # fmt: skip

        # what happened
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
            ("rolled over", xp.cos(roll) * xp.cos(pitch) < math.cos(config.rollover)),
        ):
            ending = xp.where(holds, TERMINATION_REASONS.index(reason), ending)
        self._ending = ending

    # ---- geometry and sensors

    def _place(self) -> Array:
        """The reference point in the front frame's axes [m] (N, 3)."""
        zero = self._arrays.xp.zeros_like(self._front)
        return self._arrays.xp.stack([self._front, zero, zero], axis=1)

    def _true_pose(self, rows: Index) -> tuple[Array, Array, Array, Array]:
        """Position of the hinge [m] (K, 3), roll, pitch and yaw [rad] (K,) of the sub-environments ``rows``."""
        values = floats(self._outputs.group("position_x", 6)[-1][:, rows])
        return values[:3].T, values[3], values[4], values[5]

    def _follow(self, rows: Index) -> None:
        """Where the sub-environments ``rows`` are, and where on their paths they are and believe to be."""
        xp = self._arrays.xp
        position, roll, pitch, yaw = self._true_pose(rows)
        reference = (position + in_world(roll, pitch, yaw, self._place()[rows]))[:, :2]
        rear = yaw - self._outputs.last("joint_angle")[rows]
        behind = self._rear[rows][:, None] * xp.stack([xp.cos(rear), xp.sin(rear)], axis=1)
        self._reference[rows], self._rear_axle[rows] = reference, position[:, :2] - behind

        path = xp.concat([self._path[rows]] * 2)
        s, cross_track = self.table.project(
            path,
            xp.concat([reference, self._localisation.position[rows]]),
            xp.concat([self._s[rows], self._measured_s[rows]]),
            reach=PROJECTION_REACH,
        )
        _, _, cosine, sine, _ = self.table.places(path, s)
        error = wrapped(xp.concat([yaw, self._localisation.heading[rows]]) - xp.atan2(sine, cosine))
        for value, (true, measured) in (
            (s, (self._s, self._measured_s)),
            (cross_track, (self._cross_track, self._measured_cross_track)),
            (error, (self._heading_error, self._measured_heading_error)),
        ):
            true[rows], measured[rows] = value[: len(yaw)], value[len(yaw) :]

    def _arm_angles(self) -> Array:
        return self._outputs.group(f"arm_angle_{WHEELS[0]}", len(WHEELS))[-1]

    def _sense(self, rows: Index, time: Array) -> GpsReading:
        """One reading of every other sensor of the sub-environments ``rows``; gives that of the GPS."""
        xp, config, outputs = self._arrays.xp, self.config, self._outputs
        asked = None if rows is ALL else rows
        position, roll, pitch, yaw = self._true_pose(rows)
        noise = self._noise[rows]

        rates, force = floats(outputs.states("WX", 3)[:, rows]).T, None
        if config.observe_inertial:
            force = specific_force(
                outputs.states("VX", 3)[:, rows].T, outputs.states("AVX", 3)[:, rows].T, rates,
                outputs.states("AWX", 3)[:, rows].T, roll, pitch,
            )  # fmt: skip
        inertial = self._imu.measure(rates, force, roll, pitch, time, asked)
        self._roll[rows], self._pitch[rows], self._rates[rows] = inertial.roll, inertial.pitch, inertial.rates
        if inertial.force is not None:
            self._force[rows] = inertial.force

        true = floats(outputs.group(f"wheel_rate_{WHEELS[0]}", len(WHEELS))[-1][:, rows]).T
        shown = true + noise[:, None] * (self._wheel_sensor.measure(true, time, asked) - true)
        self._wheel_rates[rows] = shown
        self._speed[rows] = ground_speed(shown, self._rolling_radius[rows])
        if self._pressure_rows:
            level = floats(xp.stack([outputs.last(channel)[rows] for channel in self._pressure_rows]))
            self._pressures[:, rows] = level + noise * (self._pressure_sensor.measure(level, time, asked) - level)
        return self._gps.measure(position, roll, pitch, yaw, time, asked)

    # ---- what others see

    def view(self) -> PathTrackingView:
        if self._view is None:
            self._view = self._seen()
        return self._view

    def _seen(self) -> PathTrackingView:
        xp, config = self._arrays.xp, self.config
        here, heading = self._localisation.position, self._localisation.heading
        x, y, _, _, bends = self.table.places(self._path[:, None], self._measured_s[:, None] + self._distances)
        x, y = x[:, 1:] - here[:, :1], y[:, 1:] - here[:, 1:]
        s, c = xp.sin(heading)[:, None], xp.cos(heading)[:, None]
        return PathTrackingView(
            xp=xp,
            control_step=self.control_step,
            working_speed=config.working_speed,
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
            preview=xp.stack([c * x + s * y, c * y - s * x], axis=-1),
            curvature=bends,
            measured_speed=self._speed,
            measured_angle=self._joint.angle,
            measured_rate=self._joint.rate,
            measured_roll=self._roll,
            measured_pitch=self._pitch,
            measured_rates=self._rates,
            measured_force=self._force,
            measured_wheel_rates=self._wheel_rates,
            gear=self._gear.gear,
            actions=xp.permute_dims(self._actions, (1, 0, 2)),
            heights=self._heights(),
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
            "gps_quality": xp.asarray(self._gps.quality, copy=True),
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
