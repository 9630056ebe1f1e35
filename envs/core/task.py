"""What a task adds to a batch of twins: goals, measurements, judgement, and the terms of reward and observation.

A task is a class with the members of :class:`Task`; it derives from nothing. One that straightens the joint, whole but for
``traces`` and ``scene``, which only rendering needs::

    class View(NamedTuple):
        xp: Any
        angle: Array

    class Straighten:
        option_names, termination_reasons = (), ("",)
        control_step, sample_step = 0.02, 0.01
        action_space = spaces.Box(-1.0, 1.0, (1,), np.float32)
        reward_terms = {"angle": RewardTerm(-1.0, lambda view: view.xp.abs(view.angle))}
        observation_terms = {"angle": ObservationTerm(lambda view: view.angle, low=-2.0, high=2.0)}
        randomisation = Randomisation()

        def allocate(self, num_envs, terrains, arrays=HOST):
            self._arrays = arrays
            self._angle = arrays.zeros(num_envs, arrays.xp.float32)

        def start(self, where, generators, draws, machine, options):
            angle = draws.joint_angle * np.asarray(machine.joint.range)
            self._arrays.put(self._angle, self._arrays.index(where), angle)
            return Start(angle, heading=np.zeros(len(where)), position=np.zeros((len(where), 2)))

        def rest(self, where, outputs):
            pass  # it measures nothing at rest

        def commands(self, actions):
            return {"steering_signal": actions[:, 0]}

        def advance(self, outputs, time):
            xp = self._arrays.xp
            self._angle = xp.asarray(outputs.last("joint_angle"), copy=True)
            return StepResult(self.view(), terminal=xp.zeros_like(time, dtype=xp.int64), time_limit=time > 0.99)

        def view(self):
            return View(self._arrays.xp, self._angle)

        def info(self):
            return {"is_success": self._arrays.xp.abs(self._angle) < 0.02}

    envs = TwinVectorEnv(Straighten(), num_envs=2)
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, Protocol, TypeVar

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from aoro_gym.envs.core.randomisation import Draws, Randomisation
from aoro_gym.envs.core.terms import ObservationTerm, RewardTerm
from aoro_gym.execution.array_api import HOST, Array, Arrays, Index
from aoro_gym.execution.streams import Generators, whole_numbers
from aoro_gym.machine import Machine
from aoro_gym.terrains import Plane, Terrain
from aoro_gym.terrains.world.world import World
from aoro_gym.twin.records import (
    CRANE_OUTPUT_UNITS,
    FIRST_OBJECT_OUTPUT,
    FIRST_SOIL_OUTPUT,
    OBJECT_OUTPUT_UNITS,
    SOIL_OUTPUT_UNITS,
    Output,
    State,
    row_of,
)

Drawing = TypeVar("Drawing", bound=Generators)
Terrains = Plane | tuple[Terrain | World, ...]
"""What the twins stand on: one plane, or terrains and worlds to choose from."""
_OBJECT_ROWS = {name: FIRST_OBJECT_OUTPUT + i for i, name in enumerate(OBJECT_OUTPUT_UNITS)}
_SOIL_ROWS = {name: FIRST_SOIL_OUTPUT + i for i, name in enumerate(SOIL_OUTPUT_UNITS)}
_CRANE_ROWS = {name: len(Output) + i for i, name in enumerate(CRANE_OUTPUT_UNITS)}


@dataclass(frozen=True)
class Outputs:
    """Sampled outputs of the twins over one control step.

    ``values`` has shape (frames, channels, N), float32, SI units as in ``aoro_gym.twin.records.OUTPUT_UNITS``; among solid
    objects the channels of ``OBJECT_OUTPUT_UNITS`` follow, on soil those of ``SOIL_OUTPUT_UNITS``, and with a crane those of
    ``CRANE_OUTPUT_UNITS``. They alias the twins' memory, as all that the methods give: they hold until the next step or
    reset.
    """

    values: Array
    state: Array | None = None
    """Rows of the twins' exact state at the end of the step, (rows, N), as in ``aoro_gym.twin.records.State``."""

    def last(self, channel: str) -> Array:
        """Channel at the end of the step, shape (N,)."""
        return self.values[-1, self._row(channel)]

    def samples(self, channel: str) -> Array:
        """All samples of the channel over the step, oldest first, shape (frames, N)."""
        return self.values[:, self._row(channel)]

    def group(self, first: str, count: int) -> Array:
        """Samples of ``count`` channels from the channel ``first`` on, shape (frames, count, N)."""
        row = self._row(first)
        return self.values[:, row : row + count]

    def states(self, first: str, count: int) -> Array:
        """``count`` rows of the state from the row ``first`` on, shape (count, N)."""
        if self.state is None:
            raise ValueError("these outputs come without the twins' state")
        row = int(State[first])
        return self.state[row : row + count]

    def _row(self, channel: str) -> int:
        for rows, where in (
            (_OBJECT_ROWS, "in a world with solid objects"),
            (_SOIL_ROWS, "on soil"),
            (_CRANE_ROWS, "with a crane on hard, bare ground"),
        ):
            if channel in rows and self.values.shape[1] != max(rows.values()) + 1:
                raise ValueError(f"there is no output '{channel}' here: only twins {where} have it")
        return channel_row(channel)


def channel_row(channel: str) -> int:
    """Row of an output channel; ValueError that lists the channels if there is none of that name."""
    further = _OBJECT_ROWS | _SOIL_ROWS | _CRANE_ROWS
    return further[channel] if channel in further else row_of(Output, channel, "output")


def chosen(
    options: Mapping[str, Any],
    name: str,
    count: NDArray[np.intp] | int,
    where: NDArray[np.intp],
    num_envs: int,
    generators: Generators,
) -> NDArray[np.intp]:
    """Which of ``count`` things (for all, or (K,) for each) the sub-environments ``where`` (K,) take: that of
    ``options[name]``, a whole number or (num_envs,), or drawn. Where there is but one, nothing is drawn.

    Args:
        options: Of ``reset``.
        name: Key of the option.
        count: How many there are to choose from.
        where: Sub-environments.
        num_envs: Number N of all of them.
        generators: One a sub-environment of ``where``, to draw with.

    Raises ValueError that names the option and its bound.
    """
    counts = np.broadcast_to(count, where.shape)
    if options.get(name) is None:
        return whole_numbers(generators, counts)
    asked = np.asarray(options[name])
    if asked.shape not in ((), (num_envs,)) or not np.issubdtype(asked.dtype, np.integer):
        raise ValueError(f"options[{name!r}] is {options[name]!r}, but must be a whole number or ({num_envs},) of them")
    asked = asked[where] if asked.ndim else np.broadcast_to(asked, where.shape)
    if not np.all((asked >= 0) & (asked < counts)):
        bad = int(np.argmin((asked >= 0) & (asked < counts)))
        raise ValueError(f"options[{name!r}] is {asked[bad]}, but must be in [0, {counts[bad] - 1}]")
    return asked.astype(np.intp)


def given(
    options: Mapping[str, Any],
    name: str,
    where: NDArray[np.intp],
    num_envs: int,
    default: NDArray[np.float64],
    low: Array,
    high: Array,
    unit: str,
) -> NDArray[np.float64]:
    """Values (K,) for the sub-environments ``where`` (K,): of ``options[name]``, a number or (num_envs,), or ``default``.

    Args:
        options: Of ``reset``.
        name: Key of the option.
        where: Sub-environments.
        num_envs: Number N of all of them.
        default: Values (K,) without the option.
        low: Smallest value that is taken.
        high: Largest one.
        unit: Of the values, for the message.

    Raises ValueError that names the option unless low ≤ value ≤ high, each a number or (K,).
    """
    if options.get(name) is None:
        return default
    array = np.asarray(options[name], dtype=np.float64)
    if array.shape not in ((), (num_envs,)):
        raise ValueError(f"options[{name!r}] has shape {array.shape}, but must be a number or ({num_envs},)")
    array = array[where] if array.ndim else np.full(len(where), float(array))
    within = (array >= low) & (array <= high)
    if not within.all():
        bad = int(np.argmin(within))
        ends = (float(np.broadcast_to(end, where.shape)[bad]) for end in (low, high))
        raise ValueError(
            f"options[{name!r}] is {array[bad]:g} {unit}, but must be in [{', '.join(f'{e:.4g}' for e in ends)}] {unit}"
        )
    return array


def sensing(
    options: Mapping[str, Any],
    where: NDArray[np.intp],
    num_envs: int,
    generators: Drawing,
) -> Drawing | list[np.random.Generator]:
    """What draws the sensors' errors of the sub-environments ``where`` (K,): generators of the seeds
    ``options["sensor_seed"]`` (num_envs,), or the episodes' own ``generators`` (K,).

    Raises ValueError naming the option if it is something else.
    """
    if options.get("sensor_seed") is None:
        return generators
    asked = np.asarray(options["sensor_seed"])
    if asked.shape != (num_envs,) or not np.issubdtype(asked.dtype, np.integer) or np.any(asked < 0):
        raise ValueError(
            f"options['sensor_seed'] is {options['sensor_seed']!r}, but must be ({num_envs},) whole numbers of at least 0"
        )
    return [np.random.default_rng(int(seed)) for seed in asked[where]]


def divides(part: float, whole: float) -> bool:
    """Whether the time ``whole`` is a whole number of ``part``."""
    return part > 0 and abs(whole / part - round(whole / part)) < 1e-6 and round(whole / part) >= 1


@dataclass(frozen=True)
class Start:
    """Where K sub-environments start: arrays of shape (K,), ``position`` (K, 2)."""

    joint_angle: NDArray[np.float64]
    """[rad]"""
    heading: NDArray[np.float64]
    """Of the front frame [rad]."""
    position: NDArray[np.float64]
    """Of the hinge in the plan [m]."""
    terrain: NDArray[np.intp] | None = None
    """Which of the terrains to stand on; None where there is nothing to choose from."""


@dataclass(frozen=True)
class StepResult:
    """What a control step came to; arrays of shape (N,)."""

    view: Any
    """What the reward terms see: a snapshot with the goals that the step pursued."""
    terminal: Array
    """Why each sub-environment terminates, well or badly, as an index into ``Task.termination_reasons``; 0 goes on."""
    time_limit: Array
    """Which sub-environments have used up the time that the task gives them: they are truncated."""


class Task(Protocol):
    """A task for N twins. It is given data and returns data; it knows nothing of the environment that calls, in this order:

    ``allocate`` once, then ``start`` and ``rest`` for those that reset; and every control step ``commands`` and
    ``advance``, then ``info`` and ``view`` for what is logged and observed, after resets that fall into the step.

    Everything random is drawn in ``start``, on the host, from one generator a sub-environment, so that no sub-environment
    depends on its neighbours. All other arrays are those of ``allocate``: what runs every control step may neither look at
    their values nor select rows by booleans, as either waits for the device.
    """

    option_names: ClassVar[tuple[str, ...]]
    """Keys of ``reset(options=...)`` that the task takes."""
    termination_reasons: ClassVar[tuple[str, ...]]
    """Why an episode may terminate; the first one, which is empty, goes on."""
    render_channels: ClassVar[tuple[str, ...]]
    """Names of what :meth:`traces` gives."""
    render_span: ClassVar[float]
    """Time [s] of the traces that rendering keeps."""

    control_step: float
    """[s] between two actions."""
    sample_step: float
    """[s] between two output samples."""
    action_space: spaces.Box[Any]
    """Of one sub-environment."""
    # ``draws_together``, which a task may have: whether ``start`` draws by :mod:`aoro_gym.execution.streams` alone, so that
    # ``generators`` may be its Streams
    # ``crane``, which a task may have: the VehicleCrane of its twins
    reward_terms: Mapping[str, RewardTerm]
    observation_terms: Mapping[str, ObservationTerm]

    @property
    def randomisation(self) -> Randomisation:
        """What differs from episode to episode."""
        ...

    def allocate(self, num_envs: int, terrains: Terrains, arrays: Arrays = HOST) -> None:
        """Make the arrays of the state, for twins on ``terrains``, where ``arrays`` live."""
        ...

    def start(
        self,
        where: NDArray[np.intp],
        generators: list[np.random.Generator],
        draws: Draws,
        machine: Machine,
        options: Mapping[str, Any],
    ) -> Start:
        """Begin the episodes of the sub-environments ``where`` (K,), whose machines are ``machine`` (1 or K variants).

        Args:
            where: Sub-environments (K,).
            generators: One for each, to draw with.
            draws: What the randomisation has drawn for them.
            machine: Their machines, 1 or K variants.
            options: Of ``reset``.

        Raises ValueError naming a wrong option.
        """
        ...

    def rest(self, where: Index, outputs: Outputs) -> None:
        """First measurements of the sub-environments ``where``, at rest."""
        ...

    def commands(self, actions: Array) -> Mapping[str, Array]:
        """Commands of the twins for ``actions`` (N, A) within the action space; remembers them."""
        ...

    def advance(self, outputs: Outputs, time: Array) -> StepResult:
        """Take in and judge what happened over a control step that ended at ``time`` (N,) [s]; then update the goals for
        the next one."""
        ...

    def view(self) -> Any:
        """What the observation terms see: an immutable snapshot with an ``xp`` and :class:`Outputs`."""
        ...

    def info(self) -> dict[str, Array]:
        """What is logged beside the reward, by name, each a fresh array of shape (N,). ``is_success`` is set false
        where the simulation diverged."""
        ...

    def traces(self) -> Array:
        """What rendering keeps of this control step, shape (len(render_channels), N)."""
        ...

    def scene(self, machine: Machine) -> Any:
        """A :class:`aoro_gym.envs.core.rendering.Scene` of one sub-environment with this machine."""
        ...
