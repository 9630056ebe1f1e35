"""``AORO/ForestRun-v0``: from a start to a goal between trees, stumps, boulders, logs and wet ground, at 10 Hz.

The action steers and drives, as in path tracking. The observation is what the machine's own sensors give: where the goal
lies (by its GPS), what stands up around it (by its lidar), inertial unit, joint angle and wheel speeds. There is no path to
follow: a route through each course is known to exist (:mod:`aoro_gym.envs.forest_run.courses`) and gives the start and the
time, nothing else.

Objects push back. Their force on a chassis is damage; a force beyond ``chassis_force_limit`` ends the episode. It ends well
within ``goal_tolerance`` of the goal, badly also where the machine rolls over, leaves the ground or is stuck
(``info["termination"]`` says which), and is truncated when its time is up.

Sensors, assistance of arms and traction, and the ends by roll-over and at the ground's end are those of
:class:`aoro_gym.envs.path_tracking.task.PathTracking`, which this task holds.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, ClassVar

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from aoro_gym.envs.core.contacts import chassis_force
from aoro_gym.envs.core.randomisation import Draws
from aoro_gym.envs.core.task import Outputs, Start, StepResult, Terrains
from aoro_gym.envs.forest_run.config import ForestRunConfig
from aoro_gym.envs.forest_run.view import ForestRunView
from aoro_gym.envs.path_tracking.courses import Course, drawn_by_difficulty
from aoro_gym.envs.path_tracking.task import TERMINATION_REASONS as DRIVING_REASONS
from aoro_gym.envs.path_tracking.task import PathTracking
from aoro_gym.execution.array_api import HOST, Array, Arrays, Index, floats
from aoro_gym.machine import Machine
from aoro_gym.terrains import Path, Plane, Terrain
from aoro_gym.terrains.world.world import World

GOAL = "goal reached"
TERMINATION_REASONS = ("", GOAL, "rolled over", "left the terrain", "stuck", "hit an object")
"""Why an episode terminates, besides a simulation that diverged."""


class ForestRun:
    """Goals, measurements and judgement of N vehicles; see :class:`aoro_gym.envs.core.task.Task`."""

    option_names: ClassVar[tuple[str, ...]] = tuple(name for name in PathTracking.option_names if name != "start")
    termination_reasons: ClassVar[tuple[str, ...]] = TERMINATION_REASONS
    render_channels: ClassVar[tuple[str, ...]] = (*PathTracking.render_channels, "remaining", "chassis_force", "way")
    render_span: ClassVar[float] = PathTracking.render_span

    def __init__(self, courses: Sequence[Course], config: ForestRunConfig | None = None):
        self.config = ForestRunConfig() if config is None else config
        self.driving = PathTracking(courses, self.config.path_tracking())
        """The machine with its sensors, on the routes."""
        self.courses = self.driving.courses
        self.control_step, self.sample_step = self.config.control_step, self.config.sample_step
        self.reward_terms = self.config.reward_terms
        self.observation_terms = self.config.observation_terms
        self.randomisation = self.config.randomisation
        self.action_layout = self.driving.action_layout
        """Columns of the action by name."""
        self.action_space: spaces.Box[Any] = self.driving.action_space

    def allocate(self, num_envs: int, terrains: Terrains, arrays: Arrays = HOST) -> None:
        n, xp = num_envs, arrays.xp
        self._arrays = arrays
        self.driving.observation_terms = self.observation_terms  # for rays that look back
        self.driving.allocate(n, terrains, arrays)
        self._outputs = self.driving._outputs
        self._goal, self._last = arrays.zeros((n, 2)), arrays.zeros((n, 2))  # [m]
        self._remaining, self._nearer = arrays.ones(n), arrays.zeros(n)
        self._force, self._impulse, self._contacts = arrays.zeros(n), arrays.zeros(n), arrays.zeros(n)
        self._way, self._worst_margin = arrays.zeros(n), arrays.ones(n)
        self._mark, self._mark_step = arrays.zeros((n, 2)), arrays.zeros(n, xp.int64)
        self._ending = arrays.zeros(n, xp.int64)
        self._view: ForestRunView | None = None

    # ---- start

    def start(
        self,
        where: NDArray[np.intp],
        generators: list[np.random.Generator],
        draws: Draws,
        machine: Machine,
        options: Mapping[str, Any],
    ) -> Start:
        arrays = self._arrays
        options = drawn_by_difficulty(options, draws, where, len(self._remaining), len(self.courses))
        start = self.driving.start(where, generators, draws, machine, options)
        rows = arrays.index(where)
        for state, value in (
            (self._nearer, 0.0), (self._force, 0.0), (self._impulse, 0.0), (self._contacts, 0.0), (self._way, 0.0),
            (self._worst_margin, 1.0), (self._mark_step, 0), (self._ending, 0),
        ):  # fmt: skip
            arrays.put(state, rows, value)
        return start

    def rest(self, where: Index, outputs: Outputs) -> None:
        self._outputs, self._view = outputs, None
        driving = self.driving
        driving.rest(where, outputs)
        x, y, *_ = driving.table.places(driving._path[where], driving._length[where])
        here, goal = driving._reference[where], self._arrays.xp.stack([x, y], axis=1)
        self._goal[where], self._last[where], self._mark[where] = goal, here, here
        self._remaining[where] = _length(self._arrays.xp, goal - here)

    # ---- step

    def commands(self, actions: Array) -> Mapping[str, Array]:
        return self.driving.commands(actions)

    def advance(self, outputs: Outputs, time: Array) -> StepResult:
        xp, step, driving = self._arrays.xp, self.config.control_step, self.driving
        self._outputs, self._view = outputs, None
        driven = driving.advance(outputs, time)
        here = driving._reference
        remaining = _length(xp, self._goal - here)
        self._nearer, self._remaining = self._remaining - remaining, remaining
        self._way = self._way + _length(xp, here - self._last)
        self._last = xp.asarray(here, copy=True)
        self._force = floats(chassis_force(outputs))
        self._impulse = self._impulse + self._force * step
        self._contacts = self._contacts + floats(self._force > 0.0)
        self._worst_margin = xp.minimum(self._worst_margin, driving._tipping_margin)
        self._judge(driven.terminal)
        return StepResult(self.view(), self._ending, driven.time_limit)

    def _judge(self, driven: Array) -> None:
        """How episodes end; of several reasons the worst. ``driven`` (N,) are those of path tracking."""
        xp, config, driving = self._arrays.xp, self.config, self.driving
        moved = _length(xp, driving._reference - self._mark) >= config.stuck_distance
        self._mark = xp.where(moved[:, None], driving._reference, self._mark)
        self._mark_step = xp.where(moved, driving._step, self._mark_step)
        ending = xp.zeros_like(self._ending)
        for reason, holds in (
            ("stuck", floats(driving._step - self._mark_step) * config.control_step >= config.stuck_time),
            (GOAL, self._remaining <= config.goal_tolerance),
            ("left the terrain", driven == DRIVING_REASONS.index("left the terrain")),
            ("hit an object", self._force > config.chassis_force_limit),
            ("rolled over", driven == DRIVING_REASONS.index("rolled over")),
        ):
            ending = xp.where(holds, TERMINATION_REASONS.index(reason), ending)
        self._ending = ending

    # ---- what others see

    def view(self) -> ForestRunView:
        if self._view is None:
            self._view = self._seen()
        return self._view

    def _seen(self) -> ForestRunView:
        xp, driving, goal = self._arrays.xp, self.driving.view(), TERMINATION_REASONS.index(GOAL)
        localisation = self.driving._sensors.localisation
        heading = xp.asarray(localisation.heading, copy=True)
        away = self._goal - localisation.position
        s, c = xp.sin(heading), xp.cos(heading)
        return ForestRunView(
            xp=xp,
            control_step=self.control_step,
            working_speed=self.config.working_speed,
            nearer=self._nearer,
            remaining=self._remaining,
            chassis_force=self._force,
            engine_power=driving.engine_power,
            tipping_margin=driving.tipping_margin,
            finished=self._ending == goal,
            failed=self._ending > goal,
            measured_goal=xp.stack([c * away[:, 0] + s * away[:, 1], c * away[:, 1] - s * away[:, 0]], axis=1),
            measured_heading=heading,
            measured_roll=driving.measured_roll,
            measured_pitch=driving.measured_pitch,
            driving=driving,
            step=driving.step,
            rays=driving.rays,
            outputs=self._outputs,
        )

    def info(self) -> dict[str, Array]:
        """``is_success``: the goal was reached. ``remaining`` [m] to the goal; over the episode ``damage`` [N s], the
        impulse of objects on a chassis, ``contact_time`` [s] in which there was any, ``way`` [m] of the reference point,
        ``least_tipping_margin`` [-], ``engine_work`` [J]; ``route_length`` [m] of the route that is known to exist."""
        xp, told, step = self._arrays.xp, self.driving.info(), self.control_step
        return {
            "remaining": xp.asarray(self._remaining, copy=True),
            "damage": xp.asarray(self._impulse, copy=True),
            "contact_time": self._contacts * step,
            "way": xp.asarray(self._way, copy=True),
            "route_length": self.driving._length - self.driving._start_s,
            "mean_speed": self._way / (step * xp.clip(floats(self.driving._step), 1.0, None)),
            "least_tipping_margin": xp.asarray(self._worst_margin, copy=True),
            **{name: told[name] for name in ("tipping_margin", "engine_work", "gps_quality", "terrain", "path")},
            "is_success": self._ending == TERMINATION_REASONS.index(GOAL),
        }

    def traces(self) -> Array:
        xp = self._arrays.xp
        return xp.concat([floats(self.driving.traces()), self._remaining[None], self._force[None], self._way[None]])

    def runs(self) -> tuple[NDArray[Any], NDArray[Any]]:
        """On the host, of each sub-environment: which course (N,), and where the goal lies in its world [m] (N, 2)."""
        course, goal = self._arrays.hosts(self.driving._course, self._goal)
        return course, goal

    def surroundings(self) -> tuple[Plane | Terrain | World, Path]:
        """Ground and route of the first sub-environment."""
        return self.driving.surroundings()

    def scene(self, machine: Machine) -> Any:
        from aoro_gym.envs.forest_run.rendering import ForestRunScene

        return ForestRunScene(machine, self.driving)


def _length(xp: Any, offsets: Array) -> Array:
    """Lengths [m] (N,) of offsets in plan (N, 2)."""
    return xp.sqrt(offsets[:, 0] ** 2 + offsets[:, 1] ** 2)
