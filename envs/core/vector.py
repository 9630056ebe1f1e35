"""Many sub-environments that are the twins of one :class:`~aoro_gym.twin.Twin`: one launch a control step."""

from __future__ import annotations

import difflib
import inspect
import warnings
from collections.abc import Callable, Mapping, Sequence
from contextlib import nullcontext
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
from gymnasium import spaces
from gymnasium.utils import seeding
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from aoro_gym.checks import check_choice, check_integer
from aoro_gym.envs.core.contacts import contact_infos
from aoro_gym.envs.core.copying import copied, pickled
from aoro_gym.envs.core.handing_out import brought, calculates_there
from aoro_gym.envs.core.kernel_step import KernelStep, kernel_step
from aoro_gym.envs.core.next_episodes import NextEpisodes
from aoro_gym.envs.core.rendering import RENDER_MODES, Renderer
from aoro_gym.envs.core.ruts import rut_infos
from aoro_gym.envs.core.step_results import StepResults, step_results
from aoro_gym.envs.core.task import Outputs, Start, Task, channel_row
from aoro_gym.envs.core.terms import observations_of, rewards_of
from aoro_gym.execution.array_api import HOST, Array, Arrays, Index, floats, namespace
from aoro_gym.machine import Machine
from aoro_gym.machine.parameters import InvalidMachine, OutsideRangeWarning, shortened
from aoro_gym.sensors.attitude import angles_of
from aoro_gym.terrains import Plane, Terrain
from aoro_gym.terrains.soil import Soil
from aoro_gym.terrains.world.world import World
from aoro_gym.twin import Twin
from aoro_gym.twin.records import WHEELS, command_row
from aoro_gym.twin.twin import STATUS

Infos = dict[str, Any]
Result = tuple[Array, Array, Array, Array, Infos]
"""Of a step: observations, rewards, terminations, truncations and infos."""
BASE_OPTIONS = ("reset_mask", "machine", "terrain", "sensor_seed")
"""Keys of ``reset(options=...)`` that every task takes."""
BASE_OPTIONS_SET = frozenset(BASE_OPTIONS)
ENDS = ((False, False), (False, True), (True, True))
"""Whether in a step any episode terminates, and whether any ends."""
OUTPUTS = ("numpy", "torch")
"""Kinds of arrays that environments hand out."""


@dataclass(frozen=True)
class Judged:
    """What a control step came to; arrays of shape (N,), contributions of the reward terms (T, N)."""

    meant: Callable[[], Array]
    """Gives whose actions are finite."""
    values: Array
    rewards: Array
    ending: Array
    terminated: Array
    truncated: Array
    done: Array
    running: Array
    diverged: Array
    infos: Infos
    """Those of the task."""


class TwinVectorEnv(VectorEnv[Array, Array, Array]):
    """A task on ``num_envs`` twins that advance together.

    Seeds follow Gymnasium: ``reset(seed=s)`` gives sub-environment i the seed s + i and a generator of its own, so that
    it repeats, to the bit, the single environment that is reset with s + i.

    Autoreset: ``NEXT_STEP``, the default as it is Gymnasium's, resets a sub-environment in the step after the one that ends
    its episode; that step's action is ignored. Gymnasium's own vector wrappers need it. ``SAME_STEP`` resets it in the step
    that ends its episode; the observation is the new episode's, and ``info["final_obs"]``, ``info["final_info"]`` hold the
    end of the old one. Training asks for it, as no step is lost. ``DISABLED`` leaves it to
    ``reset(options={"reset_mask": mask})``.

    ``reset(options=...)`` holds for the episodes that this reset begins, and takes for all tasks:

    - ``reset_mask``: booleans (num_envs,), which sub-environments to reset; all by default;
    - ``machine``: values by dotted key in the machine file's unit, each a number or of shape (num_envs,); with
      ``own_machines=False`` there is but one machine and this fails;
    - ``terrain``: which of the terrains, a whole number or (num_envs,) of them; drawn by default;
    - ``sensor_seed``: whole numbers (num_envs,) that draw the sensors' errors, by which an episode is repeated with others;
      by default the episode's own seed draws them, too.

    With NumPy's arrays of twins on a GPU a step in kernels has its arrays there all the same, and brings what it hands out
    to the host at its end (:mod:`aoro_gym.envs.core.handing_out`); with terms of your own, or without torch, it
    calculates with NumPy, which takes longer. Terms that replace others later are given tensors then.

    With ``output="torch"`` all that :meth:`reset` and :meth:`step` hand out are tensors on the twins' device, and actions
    may be such tensors; nothing of it comes to the host, which reads a few flags a step, and who ended.
    Starts are drawn on the host, by each sub-environment's generator, and uploaded for those that begin. Where the step is
    in kernels, and resets are automatic, they are drawn ahead while the device computes; with ``SAME_STEP`` the launches of
    a step begin them (:mod:`aoro_gym.envs.core.next_episodes`).
    What differs from NumPy's arrays:

    - Observations are not copied: the environment reads its tensor once more in the next step. Keep it as long as you
      like, but do not write to it. Rewards, terminations, truncations and infos are yours.
    - Where the launches of a step begin episodes, the environment holds what its last two steps handed out, too: to free so
      many tensors takes time, of which there is some while the device computes.
    - What :meth:`output` gives, and ``view.output`` in a term, aliases the twins' memory: it holds until the next step or
      reset.
    - ``info["termination"]`` are numbers, indices into ``termination_reasons``; ``info["final_obs"]`` is a tensor like
      the observations, which holds where ``info["_final_obs"]`` does.
    - Masks of infos (``info["_NAME"]``) that are equal may be one tensor.
    - Actions that are not finite count as 0 until the error is raised at the end of the step.
    - Launches run on torch's current stream.

    Args:
        task: What to do.
        num_envs: Sub-environments, at least 1.
        machine: Bundled name, machine file or :class:`Machine`; one machine, or ``num_envs`` variants.
        terrain: Ground: a plane (level asphalt by default), a terrain or a world, or several that episodes choose from. The
            solid objects of a world push back; ``info`` then has ``chassis_contact`` and ``chassis_force`` [N], see
            :mod:`aoro_gym.envs.core.contacts`.
        ground: How twins feel a terrain, ``"raster"`` or ``"mesh"``; see :class:`~aoro_gym.twin.Twin`.
        soil: What the ground is made of, where it is soft, see :class:`~aoro_gym.twin.Twin`; ``info`` then has
            ``rut_depth`` [m],
            the mean of the ruts below the wheels, see :mod:`aoro_gym.envs.core.ruts`.
        device: ``"cpu"``, ``"cpu:simd"`` or ``"cuda:N"``.
        output: ``"numpy"``, or ``"torch"`` for tensors on the device (needs ``aoro-gym[torch]``).
        own_machines: Give every twin its own machine record, as randomised machines need it.
        autoreset_mode: See above; an :class:`AutoresetMode` or its value.
        max_episode_steps: Control steps after which an episode is truncated; never by default.
        render_mode: None, ``"rgb_array"``, or ``"human"``: the first one in the browser, where viser is installed.
        kernels: Whether a step is made of the task's kernels where it has some (see
            :mod:`aoro_gym.envs.core.kernel_step`); else of array operations, one by one, which give the same up to rounding.

    Raises:
        ValueError: naming the argument, its value and its bound.
    """

    metadata: dict[str, Any] = {  # noqa: RUF012 (an instance replaces it)
        "render_modes": list(RENDER_MODES),
        "render_fps": 50,
        "autoreset_mode": AutoresetMode.NEXT_STEP,
    }
    single_observation_space: spaces.Box[Any]
    single_action_space: spaces.Box[Any]

    def __init__(
        self,
        task: Task,
        num_envs: int = 1,
        *,
        machine: str | Path | Machine = "aoro",
        terrain: Plane | Terrain | World | Sequence[Terrain | World] | None = None,
        ground: str = "raster",
        soil: str | Soil | None = None,
        device: str = "cpu",
        output: str = "numpy",
        own_machines: bool = True,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        max_episode_steps: int | None = None,
        render_mode: str | None = None,
        kernels: bool = True,
    ):
        check_integer("num_envs", num_envs)
        if max_episode_steps is not None:
            check_integer("max_episode_steps", max_episode_steps, note=", or None")
        if render_mode is not None and render_mode not in RENDER_MODES:
            raise ValueError(f"render_mode is {render_mode!r}; choose None, {' or '.join(map(repr, RENDER_MODES))}")
        if task.randomisation.varies_machine and not own_machines:
            raise ValueError("own_machines is False, but the randomisation varies machines; drop one of the two")
        check_choice("output", output, OUTPUTS)
        if render_mode is not None and output != "numpy":
            raise ValueError(f"render_mode is {render_mode!r}, but pictures are drawn on the host: take output='numpy'")
        self.task = task
        self.num_envs = int(num_envs)
        self.max_episode_steps = max_episode_steps
        self.render_mode = render_mode
        self.autoreset_mode = _autoreset_mode(autoreset_mode)
        self.metadata = {
            **type(self).metadata,
            "render_fps": round(1.0 / task.control_step),
            "autoreset_mode": self.autoreset_mode,
        }

        self._generators: list[np.random.Generator | None] = [None] * self.num_envs
        self.twin = Twin(
            self.num_envs,
            machine=machine,
            terrain=terrain,
            ground=ground,
            soil=soil,
            device=device,
            own_machines=own_machines,
            carry_load=True if task.randomisation.varies_load else None,
            crane=getattr(task, "crane", False),
        )
        # gives the outputs the size that they keep
        self.twin.step(duration=task.control_step, sample_every=task.sample_step)
        there = kernels and render_mode is None and calculates_there(task, self.twin)
        self.arrays = HOST if output == "numpy" and not there else Arrays.torch(str(self.twin.device))
        """Where the arrays live that the task calculates with."""
        self.handed_out = HOST if output == "numpy" else self.arrays
        """Where those live that :meth:`reset` and :meth:`step` give."""
        self._own_machines = own_machines
        self._kernels = kernels
        self._kernel_step: KernelStep | None = None  # made when it is first asked for, as it shares memory
        self._next: NextEpisodes | None = None  # likewise
        self._machine_changed = np.zeros(self.num_envs, dtype=bool)
        self._warned_of: set[str] = set()  # parameters outside of their ranges
        self._done = np.ones(self.num_envs, dtype=bool)  # the host knows who waits for a reset
        self._held: list[Any] = []  # what steps have handed out, until the device computes
        with self.arrays.ordered():
            self._allocate()
        self._renderer = Renderer(task, self.num_envs, self.twin.machine) if render_mode is not None else None

    def _allocate(self) -> None:
        arrays, n = self.arrays, self.num_envs
        self._outputs = self._read_outputs()
        self._commands = arrays.alias(self.twin.commands)
        self._steps = arrays.zeros(n, arrays.xp.int64)

        ground = self.twin.terrain
        if not isinstance(ground, Plane):
            ground = (ground,) if isinstance(ground, Terrain | World) else tuple(ground)
        self.task.allocate(n, ground, arrays)
        self.termination_reasons = [
            *self.task.termination_reasons,
            *(f"simulation diverged: {reason}" for reason in STATUS.values()),
            *(reason for code, reason in self.twin.status_reasons.items() if code not in STATUS),
        ]
        """Why episodes terminate; the first one, which is empty, goes on."""
        self.single_action_space = self.task.action_space
        self.action_space = batch_space(self.single_action_space, n)
        self.observation_layout: dict[str, slice] = {}
        """Columns of the observation by term."""
        self.single_observation_space = self._observation_space()
        self.observation_space = batch_space(self.single_observation_space, n)
        self._observation = arrays.zeros((n, *self.single_observation_space.shape), arrays.xp.float32)
        self._lowest, self._highest, self._least_action, self._largest_action = (
            arrays.asarray(bound, arrays.xp.float32)
            for space in (self.single_observation_space, self.single_action_space)
            for bound in (space.low, space.high)
        )

    @property
    def action_layout(self) -> dict[str, slice]:
        """Where each signal stands in the action, of tasks that name their signals."""
        task: Any = self.task
        return task.action_layout

    def _observation_space(self) -> spaces.Box:
        parts = observations_of(self.task.observation_terms, self.task.view(), self.num_envs)
        low, high, end = [], [], 0
        for (name, term), part in zip(self.task.observation_terms.items(), parts, strict=True):
            size = part.shape[1]
            self.observation_layout[name] = slice(end, end + size)
            end += size
            low += [term.low] * size
            high += [term.high] * size
        return spaces.Box(np.array(low, dtype=np.float32), np.array(high, dtype=np.float32))

    # ---- copies ------------------------------------------------------------------------------------------------------

    def __deepcopy__(self, memo: dict[int, Any]) -> TwinVectorEnv:
        return copied(self, memo)

    def __reduce__(self) -> tuple[Any, ...]:
        return pickled(self)

    def aliases(self, twin: Twin | None = None) -> tuple[Array, ...]:
        """This environment's arrays that are the memory of its twin; as they are of another ``twin`` like it."""
        if self.arrays.on_host and self.twin.device.is_cuda:  # these are copies of it
            return ()
        if twin is None and hasattr(self, "_outputs"):
            return self._commands, self._status, self._outputs.values, self._outputs.state
        twin = self.twin if twin is None else twin
        return tuple(self.arrays.alias(array) for array in (twin.commands, twin.status_codes, twin.outputs, twin.state))

    def copied_state(self) -> dict[str, Any]:
        """Everything but the twin, for :meth:`restore_state`."""
        traces = None if self._renderer is None else self._renderer.traces()
        self._forget_next()  # generators as they are to be
        state = {name: value for name, value in vars(self).items() if name != "twin"}
        return {**state, "_renderer": traces, "_kernel_step": None, "_next": None, "_held": []}

    def restore_state(self, state: Mapping[str, Any]) -> None:
        """Take up what :meth:`copied_state` gave; pictures are drawn anew."""
        vars(self).update({**state, "_renderer": None})
        if state["_renderer"] is not None:
            self._renderer = Renderer(self.task, self.num_envs, self.twin.machine)
            self._renderer.take_up(state["_renderer"])

    # ---- reset -------------------------------------------------------------------------------------------------------

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: Mapping[str, Any] | None = None
    ) -> tuple[Array, Infos]:
        """Begin episodes; see the class for seeds and options.

        Returns:
            Observations (num_envs, …) and infos.
        """
        options = {} if options is None else options
        mask = self._reset_mask(options)
        self._forget_next(np.flatnonzero(mask))
        self._seed(seed, mask)
        with self.arrays.ordered():
            self._start(np.flatnonzero(mask), options)
            chosen = self.arrays.asarray(mask, self.arrays.xp.bool)
            self._observe(chosen)
            if self.arrays.host(self._wrong_observation()):
                self._complain_of_observation()
            infos = self._logged(self.task.info())
            infos = _with_masks(_where(chosen, infos), dict.fromkeys(infos, chosen))
        if self.render_mode == "human":
            self.render()
        if self._brings_home:
            (observation,), infos = brought(self.arrays, [self._observation], infos)
            return observation, infos
        return self._handed_out(self._observation), infos

    @property
    def generators(self) -> list[np.random.Generator | None]:
        """One a sub-environment (num_envs,), None before its first reset; as if no episode were drawn ahead. Ask for it anew
        after steps, which draw for some time without telling them."""
        self._forget_next()
        return self._generators

    @property
    def np_random(self) -> np.random.Generator:
        """That of the first sub-environment, likewise."""
        self._forget_next(np.zeros(1, dtype=np.intp))
        return super().np_random

    @np_random.setter
    def np_random(self, value: np.random.Generator) -> None:
        self._np_random, self._np_random_seed = value, -1

    def _seed(self, seed: int | Sequence[int | None] | None, mask: NDArray[np.bool_]) -> None:
        if seed is None or isinstance(seed, int | np.integer):
            seeds = [None if seed is None else int(seed) + i for i in range(self.num_envs)]
        else:
            seeds = list(seed)
            if len(seeds) != self.num_envs:
                raise ValueError(f"seed has {len(seeds)} entries, but must have num_envs = {self.num_envs}")
        for i in np.flatnonzero(mask):
            if seeds[i] is not None or self._generators[i] is None:
                self._generators[i], used = seeding.np_random(seeds[i])
                if i == 0:
                    self._np_random_seed = used
        self._np_random = self._generators[0]

    def _reset_mask(self, options: Mapping[str, Any]) -> NDArray[np.bool_]:
        known = (*BASE_OPTIONS, *self.task.option_names)
        for key in options:
            if key not in known:
                raise ValueError(f"options has the unknown key {key!r}; choose from: {', '.join(known)}")
        if options.get("reset_mask") is None:
            return np.ones(self.num_envs, dtype=bool)
        mask = np.asarray(options["reset_mask"])
        if mask.shape != (self.num_envs,) or mask.dtype != bool:
            raise ValueError(
                f"options['reset_mask'] has shape {mask.shape} and type {mask.dtype}, but must be ({self.num_envs},) of bool"
            )
        if not mask.any():
            raise ValueError("options['reset_mask'] selects no sub-environment; set at least one entry")
        return mask

    def _start(self, where: NDArray[np.intp], options: Mapping[str, Any]) -> None:
        """Begin the episodes of the sub-environments ``where``."""
        if not BASE_OPTIONS_SET.issuperset(options):
            self._kernel_step = None  # a task's own options may bring along what its kernels have to share anew
            self._forget_next()
        if self._next is not None and not options and self._in_kernels() is not None:
            where = self._next.begin(self, where)
            if not len(where):
                return
        generators = [generator for i in where if (generator := self._generators[i]) is not None]
        draws = self.task.randomisation.draw(generators)
        machine = self._machines(where, draws.apply(self.twin.machine.variants(where)), options)
        rows = self.arrays.index(where)
        # what a task of one's own writes is there at once
        with self.arrays.together() if getattr(self.task, "has_kernels", False) else nullcontext():
            start = self.task.start(where, generators, draws, machine, options)
            self.arrays.put(self._steps, rows, 0)

        mask = np.zeros(self.num_envs, dtype=bool)
        mask[where] = True
        position, heading, joint_angle = np.zeros((self.num_envs, 2)), np.zeros(self.num_envs), np.zeros(self.num_envs)
        position[where], heading[where], joint_angle[where] = start.position, start.heading, start.joint_angle
        terrain = None
        if start.terrain is not None:
            terrain = np.zeros(self.num_envs, dtype=np.int32)
            terrain[where] = start.terrain
        self.twin.reset(mask, position=position, heading=heading, joint_angle=joint_angle, terrain=terrain)
        if self._in_kernels() is not None:
            self._rest_in_kernels(where, rows, self._known_at_rest(start, machine))
        else:
            self._done[where] = False
            self._rest(rows, start, machine)
        if self._renderer is not None:
            self._renderer.restart(where, self.traces())

    def _known_at_rest(self, start: Start, machine: Machine) -> tuple[Any, ...]:
        """What :meth:`KernelStep.rest` takes as ``known``."""
        steering = machine.steering
        back = steering.tank_line.back_pressure
        return start.joint_angle, back, back, steering.pump.margin, machine.engine.set_speed

    def _rest_in_kernels(self, where: NDArray[np.intp], rows: Index, known: Sequence[Any]) -> None:
        """What :meth:`_rest` does, by kernels; ``rows`` are ``where`` on the device."""
        assert self._kernel_step is not None
        self._kernel_step.rest(rows, known)
        self._rested_in_kernels(where)

    def _rested_in_kernels(self, where: NDArray[np.intp]) -> None:
        """Kernels have begun episodes of the sub-environments ``where``."""
        kernels = self._kernel_step
        assert kernels is not None
        self._done[where] = False
        self._outputs, self._status = kernels.outputs, kernels.status
        kernels.told()

    def _rest(self, rows: Index, start: Start, machine: Machine) -> None:
        """First outputs and measurements of the sub-environments ``rows``, by array operations."""
        # the twin's outputs come with its first step: until then, what is known of a machine at rest
        values = self._outputs.values
        self._outputs = Outputs(values, self.arrays.alias(self.twin.state))
        values[:, :, rows] = 0.0
        for channel, value in {
            "position_x": self._outputs.states("X", 3)[:, rows],
            "roll": self.arrays.xp.stack(angles_of(self._outputs.states("QX", 4)[:, rows])),
            f"arm_angle_{WHEELS[0]}": self._outputs.states("ARM_FL", len(WHEELS))[:, rows],
            "joint_angle": start.joint_angle,
            "pressure_a": machine.steering.tank_line.back_pressure,
            "pressure_b": machine.steering.tank_line.back_pressure,
            "pump_pressure": machine.steering.pump.margin,
            "engine_speed": machine.engine.set_speed,
        }.items():
            row, count = channel_row(channel), len(value) if getattr(value, "ndim", 0) == 2 else 1
            self.arrays.put(values, (slice(None), slice(row, row + count), rows), value)
        self.task.rest(rows, self._outputs)

    def _machines(self, where: NDArray[np.intp], machine: Machine, options: Mapping[str, Any]) -> Machine:
        """Machines of the sub-environments ``where`` for their next episode, handed to the twins where they changed."""
        asked = options.get("machine")
        if asked is not None:
            machine = self._asked_machines(where, machine, asked)
        varied = bool(asked) or self.task.randomisation.varies_machine
        if varied or self._machine_changed[where].any():
            self.twin.set_machines(where, machine)
        self._machine_changed[where] = varied
        return machine

    def _asked_machines(self, where: NDArray[np.intp], machine: Machine, asked: Any) -> Machine:
        """``machine`` with the values of ``options["machine"]``: checked, and named by key and sub-environment."""
        if not isinstance(asked, Mapping):
            raise ValueError(f"options['machine'] is {shortened(asked)}, but must map dotted keys to values")
        if not self._own_machines:
            raise ValueError("options['machine'] is given, but own_machines is False; drop one of the two")
        values = {}
        for key, value in asked.items():
            try:
                array = np.asarray(value)
            except (TypeError, ValueError, RuntimeError):  # ragged lists, tensors of a device
                array = np.asarray(None)
            if array.shape not in ((), (self.num_envs,)):
                raise ValueError(
                    f"options['machine'][{key!r}] has shape {array.shape}, but must be a number or ({self.num_envs},)"
                )
            if array.dtype.kind not in "iuf":
                raise ValueError(
                    f"options['machine'][{key!r}] is {shortened(value)}, but must be a number or ({self.num_envs},) numbers"
                )
            values[key] = array[where] if array.ndim else array.item()

        lone = f" of sub-environment {where[0]}" if len(where) == 1 < self.num_envs else ""
        option = f"options['machine']{lone}"

        def called(index: int) -> str:
            return f" of sub-environment {where[index]}"

        try:
            machine = machine.set(values, check_ranges=False)
        except InvalidMachine as error:
            raise ValueError(f"{option}: {error.told(called)}") from None
        except ValueError as error:
            raise ValueError(f"{option}: {error}") from None
        for key, message in machine.outside_ranges(values, called).items():
            if key not in self._warned_of:
                warnings.warn(f"{option}: {message}", OutsideRangeWarning, stacklevel=2)
                self._warned_of.add(key)
        return machine

    # ---- step --------------------------------------------------------------------------------------------------------

    def step(self, actions: Array) -> Result:
        """Advance every sub-environment by one control step in one launch.

        Args:
            actions: (num_envs, A); clipped into the action space.

        Returns:
            Observations (num_envs, …), rewards, terminations, truncations (each (num_envs,)) and infos.
            ``info["reward/NAME"]`` is the weighted contribution of each reward term; ``info["termination"]`` the
            reason of each terminated episode.

        Raises:
            ValueError: actions of the wrong shape, or not finite; a term that returns what it must not.
            gymnasium.error.ResetNeeded: a sub-environment has not been reset, or its episode has ended.
        """
        if self._done.any():
            fresh = any(generator is None for generator in self._generators)
            if fresh or self.autoreset_mode is not AutoresetMode.NEXT_STEP:
                raise gymnasium.error.ResetNeeded(
                    f"sub-environment {int(np.argmax(self._done))} has no running episode; call reset() first, for some "
                    "with options={'reset_mask': mask}"
                )
        actions = self._checked_actions(actions)
        with self.arrays.ordered():
            result = self._advance(actions)
        if self.render_mode == "human":
            self.render()
        return result

    def _advance(self, actions: Array) -> Result:
        """A control step; those whose episode ended in the last one begin another in it, unless the last one did that."""
        arrays, kernels = self.arrays, self._in_kernels()
        if kernels is not None and self._next is not None:
            self._next.renew(self)
            if kernels.begins:
                return self._advance_and_begin(kernels, self._next, actions)
        resetting = self._done.copy()
        judged = self._judged(actions, resetting) if kernels is None else self._told(kernels, actions, resetting)
        infos = {f"reward/{name}": value for name, value in zip(self.task.reward_terms, judged.values, strict=True)}
        infos |= self._logged(judged.infos)
        if self._renderer is not None:
            self._renderer.record(self.traces())
        masks = dict.fromkeys(infos, judged.running)

        if resetting.any():
            self._start(np.flatnonzero(resetting), {})
        if kernels is None:
            self._observe(~(judged.diverged & judged.running))
        elif resetting.any() or kernels.own_observations:
            self._observe_in_kernels(kernels, again=bool(resetting.any()))
        # all that the host waits for
        flags = self._flags(judged) if kernels is None or kernels.has_own else kernels.flags
        *wrong, any_terminated, any_done = arrays.host(flags)
        if any(wrong):
            self._complain(wrong, judged.meant(), judged.values)
        observation = self._observation
        if self._brings_home:
            judged, infos, observation = self._brought(judged, infos)
            masks = dict.fromkeys(infos, judged.running)
        if resetting.any():
            infos, masks = _replaced(infos, masks, self._begun()[0], ~judged.running)
        if any_terminated:
            infos["termination"], masks["termination"] = self._reasons(judged.ending), judged.terminated
        self._done = np.array(self.handed_out.host(judged.done)) if any_done else np.zeros(self.num_envs, dtype=bool)
        if any_done and self.autoreset_mode is AutoresetMode.SAME_STEP:
            observation, infos = self._same_step(observation, infos, masks, judged.done)
        else:
            infos = _with_masks(infos, masks)
        observation = observation if self._brings_home else self._handed_out(self._observation)
        return observation, judged.rewards, judged.terminated, judged.truncated, infos

    def _advance_and_begin(self, kernels: KernelStep, following: NextEpisodes, actions: Array) -> Result:
        """A control step whose launches also begin the episodes ``following``, those that are drawn, where others end.

        A GPU that has begun them has nothing to do until the next step is launched: what can be done before is.
        """
        kernels.run(actions)
        following.launched()
        del self._held[:-1]
        self._outputs, self._status = kernels.outputs, kernels.status
        kernels.told()
        results = None if self._brings_home else self._results(kernels, ENDS)
        following.draw_during(self, kernels)
        flags, done = kernels.wait()
        *wrong, any_terminated, any_done, begun, left, wrong_beginning = flags
        if begun:
            following.began(self, done)
        if any(wrong):
            self._complain(wrong, self._meant(kernels), kernels.values())
        if wrong_beginning:
            self._complain_of_observation()
        if left:
            self._begin_others(following.undrawn(done))
            results = None
        ends = bool(any_terminated), bool(any_done)
        if results is None:
            results = self._results(kernels, [ends])
        self._held.append(results)
        return results[ends]

    def _results(self, kernels: KernelStep, cases: Sequence[tuple[bool, bool]]) -> dict[tuple[bool, bool], Result]:
        """What the last step of ``kernels`` hands out in each of the ``cases``, of :data:`ENDS`, which share it."""
        results = step_results(kernels, self.arrays, on_host=self._brings_home)
        observation, rewards, terminated, truncated = results[:4]
        return {ends: (observation, rewards, terminated, truncated, self._infos(results, *ends)) for ends in cases}

    def _infos(self, results: StepResults, any_terminated: bool, any_done: bool) -> Infos:
        """Infos of a step that comes to ``results``, with those of ends, where there are any."""
        infos, final = dict(results.contributions), dict(results.final_infos)
        if any_terminated:
            reasons = self._reasons(results.ending)
            nothing = np.full(self.num_envs, None) if self._brings_home else self.arrays.xp.zeros_like(reasons)
            infos["termination"], infos["_termination"] = nothing, results.nobody
            final["termination"], final["_termination"] = reasons, results.terminated
        infos |= results.told
        if any_done:
            final_obs = results.final_observation
            if self._brings_home:
                final_obs = _those(final_obs, results.done)
            infos["final_obs"], infos["_final_obs"] = final_obs, results.done
            infos["final_info"], infos["_final_info"] = final, results.done
        return infos

    def _begin_others(self, where: NDArray[np.intp]) -> None:
        """Begin episodes of the sub-environments ``where`` after the launches of a step that did not."""
        begins = np.zeros(self.num_envs, dtype=bool)
        begins[where] = self._done[where] = True
        self._start(where, {})
        self._observe(self.arrays.asarray(begins, self.arrays.xp.bool))
        if self.arrays.host(self._wrong_observation()):
            self._complain_of_observation()

    def _brought(self, judged: Judged, infos: Infos) -> tuple[Judged, Infos, Array]:
        """What a step came to, its infos and the observation, on the host."""
        names = ("rewards", "ending", "terminated", "truncated", "done", "running")
        told = [getattr(judged, name) for name in names]
        (observation, *told), infos = brought(self.arrays, [self._observation, *told], infos)
        return replace(judged, **dict(zip(names, told, strict=True))), infos, observation

    def _begun(self) -> tuple[Infos, Array]:
        """Infos of the task after episodes have begun, and the observation, where they are handed out."""
        infos = self._logged(self.task.info())
        if not self._brings_home:
            return infos, self._observation
        (observation,), infos = brought(self.arrays, [self._observation], infos)
        return infos, observation

    def _judged(self, actions: Array, resetting: NDArray[np.bool_]) -> Judged:
        """A control step by array operations, up to the observation."""
        arrays, xp = self.arrays, self.arrays.xp
        finite = xp.isfinite(actions)
        actions = xp.clip(xp.where(finite, actions, 0.0), self._least_action, self._largest_action)
        for name, command in self.task.commands(actions).items():
            self._commands[command_row(name)] = command
        if arrays.on_host and self.twin.device.is_cuda:
            self.twin.commands.assign(self._commands)
        self.twin.advance(self.task.control_step, sample_every=self.task.sample_step)
        self._steps += 1
        self._outputs = self._read_outputs()
        diverged = self._status != 0
        judged = self.task.advance(self._outputs, floats(self._steps) * self.task.control_step)

        running = xp.ones_like(diverged)
        if resetting.any():
            running = ~arrays.asarray(resetting, xp.bool)
        contributions = rewards_of(self.task.reward_terms, judged.view, self.num_envs)
        values = xp.stack([xp.astype(value, xp.float32) for value in contributions.values()])
        values = xp.where(running & ~diverged, values, 0.0)

        ending = xp.where(diverged, self._status + (len(self.task.termination_reasons) - 1), judged.terminal)
        ending = xp.where(running, ending, 0)
        terminated = ending != 0
        truncated = judged.time_limit
        if self.max_episode_steps is not None:
            truncated = truncated | (self._steps >= self.max_episode_steps)
        truncated = truncated & running & ~terminated
        infos = self.task.info()
        if "is_success" in infos:
            infos["is_success"] &= ~diverged
        meant = xp.all(finite, axis=1)
        return Judged(
            lambda: meant, values, _sum(values), ending, terminated, truncated, terminated | truncated, running, diverged,
            infos,
        )  # fmt: skip

    def _flags(self, judged: Judged) -> Array:
        """What the host has to know of a step (5,)."""
        xp = self.arrays.xp
        unmeant, wrong_reward = ~xp.all(judged.meant()), ~xp.all(xp.isfinite(judged.rewards))
        ended = xp.any(judged.terminated), xp.any(judged.done)
        return xp.stack([unmeant, wrong_reward, self._wrong_observation(), *ended])

    # ---- in kernels

    def _in_kernels(self) -> KernelStep | None:
        """The task's kernels, put together anew where what they were made of was replaced."""
        if not self._kernels:
            self._forget_next()
            return None
        if self._kernel_step is None or not self._kernel_step.fits(self):
            self._forget_next()
            self._kernel_step = kernel_step(self)
            self._kernels = self._kernel_step is not None
            by_itself = self.autoreset_mode is not AutoresetMode.DISABLED and not self.twin.has_objects
            ahead = not self.arrays.on_host and by_itself
            kernels, same_step = self._kernel_step, self.autoreset_mode is AutoresetMode.SAME_STEP
            self._next = None
            if kernels is not None and ahead:
                in_step = same_step and not kernels.has_own and self.twin.resets_in_one_launch
                self._next = NextEpisodes(self.num_envs, in_step=in_step)
        return self._kernel_step

    def _forget_next(self, where: NDArray[np.intp] | None = None) -> None:
        """Give back what was drawn of episodes that have not begun."""
        if self._next is not None:
            self._next.forget(self, where)

    def _told(self, kernels: KernelStep, actions: Array, resetting: NDArray[np.bool_]) -> Judged:
        """What :meth:`_judged` does, by the task's kernels, which observe, too."""
        arrays, xp, anew = self.arrays, self.arrays.xp, bool(resetting.any())
        if anew:
            arrays.put(kernels.resetting, slice(None), resetting)
        kernels.run(actions)
        if anew:
            kernels.resetting[...] = False
        if self._next is not None:
            self._next.draw_during(self, kernels)
        self._outputs, self._status = kernels.outputs, kernels.status
        kernels.told()
        ending, terminated, truncated, done, running = kernels.ended()
        values, rewards, diverged = kernels.values(), kernels.rewards(), self._status != 0
        if kernels.own_rewards:
            names = list(self.task.reward_terms)
            own = {name: self.task.reward_terms[name] for name in kernels.own_rewards}
            for name, value in rewards_of(own, kernels.judged_view(), self.num_envs).items():
                values[names.index(name)] = xp.where(running & ~diverged, xp.astype(value, xp.float32), 0.0)
            rewards = _sum(values)
        return Judged(
            lambda: self._meant(kernels), values, rewards, ending, terminated, truncated, done,
            running, diverged, kernels.infos(),
        )  # fmt: skip

    def _meant(self, kernels: KernelStep) -> Array:
        """Whose actions are finite (N,)."""
        return self.arrays.xp.all(self.arrays.xp.isfinite(kernels.given), axis=1)

    def _observe_in_kernels(self, kernels: KernelStep, *, again: bool = True) -> None:
        """Renew the observation where ``kernels.keeps`` does not hold: ``again``, or only by terms of the user's own."""
        if again:
            kernels.observe()
        arrays, xp = self.arrays, self.arrays.xp
        own = {name: self.task.observation_terms[name] for name in kernels.own_observations}
        for name, part in zip(own, observations_of(own, self.task.view(), self.num_envs) if own else [], strict=True):
            columns = self.observation_layout[name]
            bounds = self._lowest[columns], self._highest[columns]
            value = xp.clip(xp.astype(part, xp.float32), *bounds)
            if not arrays.known_all_false(kernels.keeps):
                value = xp.where(kernels.keeps[:, None], self._observation[:, columns], value)
            self._observation[:, columns] = value

    def _same_step(self, observation: Array, infos: Infos, masks: dict[str, Array], done: Array) -> tuple[Array, Infos]:
        """Reset the sub-environments whose episode just ended, and put the end of the old one into the infos.

        Args:
            observation: At its end, where it is handed out.
            infos: Likewise, and what follows.
            masks: Of the infos.
            done: Whose episode has ended (N,).

        Returns:
            The observation and infos that follow.
        """
        # a new one follows
        final = _those(observation, done) if self.handed_out.on_host else self._handed_out(observation)
        final_info = _with_masks(_where(done, infos), _each(masks, lambda mask: mask & done))
        self._start(np.flatnonzero(self._done), {})
        self._observe(self.arrays.asarray(done, self.arrays.xp.bool))
        if self.arrays.host(self._wrong_observation()):
            self._complain_of_observation()
        begun, observation = self._begun()
        infos, masks = _replaced(infos, masks, begun, done)
        return observation, {
            **_with_masks(infos, masks),
            "final_obs": final,
            "_final_obs": done,
            "final_info": final_info,
            "_final_info": done,
        }

    def _checked_actions(self, actions: Array) -> Array:
        """Actions (N, A) where the arrays live, of the right shape; those of the host are finite."""
        on_host = namespace(actions) is np
        actions = np.asarray(actions, dtype=np.float32) if on_host else actions
        if tuple(actions.shape) != self.action_space.shape:
            raise ValueError(f"actions have shape {tuple(actions.shape)}, but must have {self.action_space.shape}")
        if on_host and not np.isfinite(actions).all():
            self._complain_of_action(np.isfinite(actions).all(axis=1))
        return self.arrays.asarray(actions, self.arrays.xp.float32)

    def _complain(self, wrong: Sequence[int], meant: Array, values: Array) -> None:
        """Raise where actions, contributions of the reward terms or observations are ``wrong``."""
        unmeant, wrong_reward, wrong_observation = wrong
        if unmeant:
            self._complain_of_action(meant)
        if wrong_reward:
            self._complain_of_reward(values)
        if wrong_observation:
            self._complain_of_observation()

    def _complain_of_action(self, meant: Array) -> None:
        meant = meant if isinstance(meant, np.ndarray) else self.arrays.host(meant)
        raise ValueError(f"the action of sub-environment {int(np.argmin(meant))} is not finite; give finite numbers")

    def _complain_of_reward(self, values: Array) -> None:
        values = self.arrays.host(values)
        term, i = np.argwhere(~np.isfinite(values))[0]
        name = list(self.task.reward_terms)[term]
        raise ValueError(f"reward_terms[{name!r}] is {values[term, i]} in sub-environment {i}; return finite numbers")

    def _complain_of_observation(self) -> None:
        observation = self.arrays.host(self._observation)
        wrong = np.argwhere(~np.isfinite(observation))
        if not len(wrong):  # it was the first of an episode, which this step has overwritten
            raise ValueError(
                "an observation was not finite where an episode began in the last step; return finite numbers"
            )
        row, column = wrong[0]
        name = next(name for name, span in self.observation_layout.items() if span.start <= column < span.stop)
        raise ValueError(
            f"observation_terms[{name!r}] is {observation[row, column]} in sub-environment {row}; return finite numbers"
        )

    def _read_outputs(self) -> Outputs:
        """The outputs and the status of the twins at the end of a step."""
        arrays, xp = self.arrays, self.arrays.xp
        values = arrays.alias(self.twin.outputs)
        self._status = arrays.alias(self.twin.status_codes)
        if not arrays.known_all_false(self._status != 0):  # a twin that diverged shows what is no number
            values[...] = xp.where(xp.isfinite(values), values, 0.0)
        return Outputs(values, arrays.alias(self.twin.state))  # which stays at the last good one

    def _observe(self, mask: Array) -> None:
        """Renew the observations where ``mask`` holds; the others keep their last one."""
        arrays, xp, kernels = self.arrays, self.arrays.xp, self._in_kernels()
        if kernels is not None:
            kernels.keeps[...] = ~mask
            self._observe_in_kernels(kernels)
            return
        parts = observations_of(self.task.observation_terms, self.task.view(), self.num_envs)
        observation = xp.clip(xp.astype(xp.concat(parts, axis=1), xp.float32), self._lowest, self._highest)
        if not arrays.known_all_false(~mask):
            observation = xp.where(mask[:, None], observation, self._observation)
        self._observation = observation

    def _logged(self, infos: Infos) -> Infos:
        """``infos`` of the task, what twins among solid objects touch, and the ruts of those on soil."""
        if self.twin.soil is not None:
            return infos | rut_infos(self._outputs)
        return infos | contact_infos(self._outputs) if self.twin.has_objects else infos

    def _wrong_observation(self) -> Array:
        """Whether any observation is not finite."""
        return ~self.arrays.xp.all(self.arrays.xp.isfinite(self._observation))

    def _handed_out(self, observation: Array) -> Array:
        alone = self._kernel_step is None and not self.arrays.on_host
        return observation if alone else self.arrays.copy(observation)

    def _reasons(self, ending: Array) -> Array:
        """Why episodes terminate (N,): words, or None for those that go on; indices on a device."""
        if not self.handed_out.on_host:
            return ending
        reasons = np.full(self.num_envs, None, dtype=object)
        for i in np.flatnonzero(ending):
            reasons[i] = self.termination_reasons[ending[i]]
        return reasons

    # ---- rendering ---------------------------------------------------------------------------------------------------

    def render(self) -> tuple[NDArray[np.uint8], ...] | None:  # type: ignore[override]
        """One frame (height, width, 3) a sub-environment; for ``"human"`` None: the first one is in the browser."""
        if self.render_mode is None:
            gymnasium.logger.warn('render() draws nothing: make the environment with render_mode="rgb_array"')
            return None
        assert self._renderer is not None, "the environment is closed"
        if self.render_mode == "human":
            self._renderer.show(self.twin)
            return None
        return tuple(self._renderer.frame(i) for i in range(self.num_envs))

    def close_extras(self, **_: Any) -> None:
        """Close the window, if there is one."""
        if self._renderer is not None:
            self._renderer.close()
            self._renderer = None

    def output(self, channel: str) -> Array:
        """The twins' exact output channel at the end of the last control step, SI, float32 (num_envs,); a tensor aliases the
        twins' memory."""
        last = self._outputs.last(channel)
        return np.array(self.arrays.host(last)) if self.handed_out.on_host else last

    def traces(self) -> NDArray[Any]:
        """The task's ``render_channels`` at the end of the last control step (channels, num_envs), on the host."""
        return self.arrays.host(self.task.traces())

    @property
    def time(self) -> Array:
        """Time since the start of the episode [s], shape (num_envs,)."""
        time = floats(self._steps) * self.task.control_step
        return self.arrays.host(time) if self.handed_out.on_host else time

    @property
    def _brings_home(self) -> bool:
        """Whether what is handed out has to be brought to the host."""
        return self.handed_out is not self.arrays


def contributions(infos: Infos) -> dict[str, Array]:
    """What each reward term gave in the step of these infos (num_envs,), as ``reward/NAME``, ends of episodes included."""
    final = infos.get("final_info", {})
    return {
        name: value + final[name] if final else value  # either is 0 where the other holds
        for name, value in infos.items()
        if name.startswith("reward/")
    }


class UnknownArgument(TypeError, ValueError):
    """A keyword that an environment does not take."""


def check_keywords(kind: type[TwinVectorEnv], arguments: Mapping[str, Any], without: Sequence[str] = ()) -> None:
    """Raise :class:`UnknownArgument`, which lists the keywords of ``kind`` less those ``without``, if ``arguments`` holds
    another."""
    known: list[str] = []
    for one in kind.__mro__:
        if issubclass(one, TwinVectorEnv) and "__init__" in vars(one):
            signature = inspect.signature(one.__init__).parameters.values()
            known += [each.name for each in signature if each.kind is not inspect.Parameter.VAR_KEYWORD]
    known = [name for name in dict.fromkeys(known) if name not in ("self", "task", *without)]
    for name in arguments:
        if name not in known:
            near = difflib.get_close_matches(name, known, n=1)
            hint = f": did you mean {near[0]!r}? It takes" if near else "; it takes"
            raise UnknownArgument(
                f"{kind.__name__.replace('Vector', '')} has no argument {name!r}{hint} {', '.join(known)}"
            )


def _autoreset_mode(mode: AutoresetMode | str) -> AutoresetMode:
    try:
        return AutoresetMode(mode)
    except ValueError:
        known = ", ".join(repr(m.value) for m in AutoresetMode)
        raise ValueError(f"autoreset_mode is {mode!r}; choose one of: {known}") from None


def _sum(values: Array) -> Array:
    """Sum over the terms (T, N), one after the other."""
    total = values[0]
    for value in values[1:]:
        total = total + value
    return total


def _those(observations: NDArray[Any], where: NDArray[np.bool_]) -> NDArray[Any]:
    """Observations (N,) as objects, each of its own memory, where ``where`` holds; else None."""
    out = np.full(len(where), None, dtype=object)
    for i in np.flatnonzero(where):
        out[i] = observations[i].copy()
    return out


def _where(mask: Array, values: Mapping[str, Array]) -> dict[str, Array]:
    """``values`` where ``mask`` holds, else zero, or None for objects."""
    xp = namespace(mask)
    if xp is np:
        return {
            name: np.where(mask, value, None if value.dtype == object else np.zeros_like(value))
            for name, value in values.items()
        }
    return _together(lambda value: xp.where(mask, value, xp.zeros_like(value)), values)


def _together(change: Callable[..., Array], *tensors: Mapping[str, Array]) -> dict[str, Array]:
    """``change`` of the tensors (N,) of each name, of those of one type in few launches."""
    names: dict[Any, list[str]] = {}
    for name, value in tensors[0].items():
        names.setdefault(value.dtype, []).append(name)
    changed: dict[str, Array] = {}
    for alike in names.values():
        xp = namespace(tensors[0][alike[0]])
        changed |= zip(alike, change(*(xp.stack([each[name] for name in alike]) for each in tensors)), strict=True)
    return {name: changed[name] for name in tensors[0]}


def _each(masks: Mapping[str, Array], change: Callable[[Array], Array]) -> dict[str, Array]:
    """``change`` of every mask, calculated once for those that are one array."""
    changed = {id(mask): change(mask) for mask in {id(mask): mask for mask in masks.values()}.values()}
    return {name: changed[id(mask)] for name, mask in masks.items()}


def _with_masks(values: Mapping[str, Array], masks: Mapping[str, Array]) -> Infos:
    """Gymnasium's vector infos: every key has a mask that says which sub-environments it holds for."""
    return {key: entry for name, value in values.items() for key, entry in ((name, value), (f"_{name}", masks[name]))}


def _replaced(
    values: Mapping[str, Array], masks: Mapping[str, Array], begun: Mapping[str, Array], where: Array
) -> tuple[dict[str, Array], dict[str, Array]]:
    """Infos of a step, with those of a reset ``begun`` in its place where ``where`` holds."""
    xp = namespace(where)
    kept = {name: value for name, value in values.items() if name not in begun}
    before = {name: value for name, value in values.items() if name in begun}
    if xp is np:
        renewed = {name: np.where(where, begun[name], value) for name, value in before.items()}
    else:
        renewed = _together(
            lambda value, new: xp.where(where, new, value), before, {name: begun[name] for name in before}
        )
    return {**_where(~where, kept), **renewed}, {
        **_each({name: masks[name] for name in kept}, lambda mask: mask & ~where),
        **_each({name: masks[name] for name in renewed}, lambda mask: mask | where),
    }
