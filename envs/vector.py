"""Many sub-environments that are the twins of one :class:`~aoro_gym.twin.Twin`: one launch a control step."""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
from gymnasium import spaces
from gymnasium.utils import seeding
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from aoro_gym.envs.randomisation import variants
from aoro_gym.envs.rendering import RENDER_MODES, Renderer
from aoro_gym.envs.task import Outputs, Task, channel_row
from aoro_gym.envs.terms import Array, observations_of, rewards_of
from aoro_gym.sensors.attitude import angles_of
from aoro_gym.terrains import Plane, Terrain
from aoro_gym.twin import Machine, Twin
from aoro_gym.twin.records import WHEELS
from aoro_gym.twin.twin import STATUS

Infos = dict[str, Any]
BASE_OPTIONS = ("reset_mask", "machine", "terrain")
"""Keys of ``reset(options=...)`` that every task takes."""
ANNOUNCE_AFTER = 2.0
"""Time [s] after which a start that takes longer is explained."""


class TwinVectorEnv(VectorEnv[Array, Array, Array]):
    """A task on ``num_envs`` twins that advance together.

    Seeds follow Gymnasium: ``reset(seed=s)`` gives sub-environment i the seed s + i and a generator of its own, so that
    it repeats, to the bit, the single environment that is reset with s + i.

    Autoreset: ``SAME_STEP`` (the default) resets a sub-environment in the step that ends its episode; the observation
    is the new episode's, and ``info["final_obs"]``, ``info["final_info"]`` hold the end of the old one. ``NEXT_STEP``
    resets it in the following step, whose action is ignored. ``DISABLED`` leaves it to
    ``reset(options={"reset_mask": mask})``.

    ``reset(options=...)`` holds for the episodes that this reset begins, and takes for all tasks:

    - ``reset_mask``: booleans (num_envs,), which sub-environments to reset; all by default;
    - ``machine``: values by dotted key in the machine file's unit, each a number or of shape (num_envs,); with
      ``own_machines=False`` there is but one machine and this fails;
    - ``terrain``: which of the terrains, a whole number or (num_envs,) of them; drawn by default.

    Args:
        task: What to do.
        num_envs: Sub-environments, at least 1.
        machine: Bundled name, machine file or :class:`Machine`; one machine, or ``num_envs`` variants.
        terrain: Ground: a plane (level asphalt by default), a terrain, or several that episodes choose from.
        ground: How twins feel a terrain, ``"raster"`` or ``"mesh"``; see :class:`~aoro_gym.twin.Twin`.
        device: ``"cpu"`` or ``"cuda:N"``.
        own_machines: Give every twin its own machine record, as randomised machines need it.
        autoreset_mode: See above; an :class:`AutoresetMode` or its value.
        max_episode_steps: Control steps after which an episode is truncated; never by default.
        render_mode: None, ``"rgb_array"`` or ``"human"``.

    Raises:
        ValueError: naming the argument, its value and its bound.
    """

    metadata: dict[str, Any] = {  # noqa: RUF012 (an instance replaces it)
        "render_modes": list(RENDER_MODES),
        "render_fps": 50,
        "autoreset_mode": AutoresetMode.SAME_STEP,
    }
    single_observation_space: spaces.Box[Any]
    single_action_space: spaces.Box[Any]

    def __init__(
        self,
        task: Task,
        num_envs: int = 1,
        *,
        machine: str | Path | Machine = "aoro",
        terrain: Plane | Terrain | Sequence[Terrain] | None = None,
        ground: str = "raster",
        device: str = "cpu",
        own_machines: bool = True,
        autoreset_mode: AutoresetMode | str = AutoresetMode.SAME_STEP,
        max_episode_steps: int | None = None,
        render_mode: str | None = None,
    ):
        if isinstance(num_envs, bool) or not isinstance(num_envs, int | np.integer) or num_envs < 1:
            raise ValueError(f"num_envs is {num_envs!r}, but must be a whole number of at least 1")
        if max_episode_steps is not None and (
            not isinstance(max_episode_steps, int | np.integer) or max_episode_steps < 1
        ):
            raise ValueError(f"max_episode_steps is {max_episode_steps!r}, but must be None or at least 1")
        if render_mode is not None and render_mode not in RENDER_MODES:
            raise ValueError(f"render_mode is {render_mode!r}; choose None, {' or '.join(map(repr, RENDER_MODES))}")
        if task.randomisation.varies_machine and not own_machines:
            raise ValueError("own_machines is False, but the randomisation varies machines; drop one of the two")
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

        self.generators: list[np.random.Generator | None] = [None] * self.num_envs
        with compilation_announced(device):
            self.twin = Twin(
                self.num_envs,
                machine=machine,
                terrain=terrain,
                ground=ground,
                device=device,
                own_machines=own_machines,
            )
            # compiles everything, and gives the outputs the size that they keep
            self.twin.step(duration=task.control_step, sample_every=task.sample_step)
        self._own_machines = own_machines
        self._outputs = Outputs(np.zeros_like(self.twin.outputs.numpy()))
        self._machine_changed = np.zeros(self.num_envs, dtype=bool)
        self._steps = np.zeros(self.num_envs, dtype=np.int64)
        self._done = np.ones(self.num_envs, dtype=bool)

        ground_of = self.twin.terrain
        if isinstance(ground_of, Terrain):
            ground_of = (ground_of,)
        self.task.allocate(self.num_envs, ground_of if isinstance(ground_of, Plane) else tuple(ground_of))
        self.single_action_space = task.action_space
        self.action_space = batch_space(self.single_action_space, self.num_envs)
        self.observation_layout: dict[str, slice] = {}
        """Columns of the observation by term."""
        self.single_observation_space = self._observation_space()
        self.observation_space = batch_space(self.single_observation_space, self.num_envs)
        self._observation = np.zeros((self.num_envs, *self.single_observation_space.shape), dtype=np.float32)
        self._renderer = Renderer(task, self.num_envs, self.twin.machine) if render_mode is not None else None

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
        self._seed(seed, mask)
        self._start(np.flatnonzero(mask), options)
        self._observe(mask)
        if self.render_mode == "human":
            self.render()
        return self._observation.copy(), _masked(self.task.info(), mask)

    def _seed(self, seed: int | Sequence[int | None] | None, mask: NDArray[np.bool_]) -> None:
        if seed is None or isinstance(seed, int | np.integer):
            seeds = [None if seed is None else int(seed) + i for i in range(self.num_envs)]
        else:
            seeds = list(seed)
            if len(seeds) != self.num_envs:
                raise ValueError(f"seed has {len(seeds)} entries, but must have num_envs = {self.num_envs}")
        for i in np.flatnonzero(mask):
            if seeds[i] is not None or self.generators[i] is None:
                self.generators[i], used = seeding.np_random(seeds[i])
                if i == 0:
                    self._np_random_seed = used
        self._np_random = self.generators[0]

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
        generators = [generator for i in where if (generator := self.generators[i]) is not None]
        draws = self.task.randomisation.draw(generators)
        machine = self._machines(where, draws.apply(variants(self.twin.machine, where)), options)
        start = self.task.start(where, generators, draws, machine, options)

        mask = np.zeros(self.num_envs, dtype=bool)
        mask[where] = True
        position, heading, joint_angle = np.zeros((self.num_envs, 2)), np.zeros(self.num_envs), np.zeros(self.num_envs)
        position[where], heading[where], joint_angle[where] = start.position, start.heading, start.joint_angle
        terrain = None
        if start.terrain is not None:
            terrain = np.zeros(self.num_envs, dtype=np.int32)
            terrain[where] = start.terrain
        self.twin.reset(mask, position=position, heading=heading, joint_angle=joint_angle, terrain=terrain)
        self._steps[where] = 0
        self._done[where] = False

        # the twin's outputs come with its first step: until then, what is known of a machine at rest
        self._outputs = Outputs(self._outputs.values, self.twin.state.numpy())
        values = self._outputs.values
        values[:, :, where] = 0.0
        pose = self._outputs.states("X", 3)[:, where]
        roll, pitch, yaw = angles_of(self._outputs.states("QX", 4)[:, where])
        arms = self._outputs.states("ARM_FL", len(WHEELS))[:, where]
        for channel, value in {
            "joint_angle": start.joint_angle,
            **dict(zip(("position_x", "position_y", "position_z"), pose, strict=True)),
            "roll": roll,
            "pitch": pitch,
            "yaw": yaw,
            **{f"arm_angle_{wheel}": angle for wheel, angle in zip(WHEELS, arms, strict=True)},
            "pressure_a": machine.steering.tank_line.back_pressure,
            "pressure_b": machine.steering.tank_line.back_pressure,
            "pump_pressure": machine.steering.pump.margin,
            "engine_speed": machine.engine.set_speed,
        }.items():
            values[:, channel_row(channel), where] = value
        self.task.rest(where, self._outputs)
        if self._renderer is not None:
            self._renderer.restart(where, self.task.traces())

    def _machines(self, where: NDArray[np.intp], machine: Machine, options: Mapping[str, Any]) -> Machine:
        """Machines of the sub-environments ``where`` for their next episode, handed to the twins where they changed."""
        asked = options.get("machine")
        if asked is not None:
            if not isinstance(asked, Mapping):
                raise ValueError(f"options['machine'] is {asked!r}, but must map dotted keys to values")
            if not self._own_machines:
                raise ValueError("options['machine'] needs a machine for every twin: drop own_machines=False")
            values = {}
            for key, value in asked.items():
                array = np.asarray(value)
                if array.shape not in ((), (self.num_envs,)):
                    raise ValueError(
                        f"options['machine'][{key!r}] has shape {array.shape}, but must be a number or ({self.num_envs},)"
                    )
                values[key] = array[where] if array.ndim else value
            machine = machine.set(values)
        varied = bool(asked) or self.task.randomisation.varies_machine
        if varied or self._machine_changed[where].any():
            self.twin.set_machines(where, machine)
        self._machine_changed[where] = varied
        return machine

    # ---- step --------------------------------------------------------------------------------------------------------

    def step(self, actions: Array) -> tuple[Array, Array, Array, Array, Infos]:
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
        actions = self._checked_actions(actions)
        resetting = self._done.copy()
        if resetting.any():
            fresh = any(generator is None for generator in self.generators)
            if fresh or self.autoreset_mode is not AutoresetMode.NEXT_STEP:
                raise gymnasium.error.ResetNeeded(
                    f"sub-environment {int(np.argmax(self._done))} has no running episode; call reset() first, for some "
                    "with options={'reset_mask': mask}"
                )

        self.twin.step(self.task.commands(actions), duration=self.task.control_step, sample_every=self.task.sample_step)
        self._steps += 1
        status = self._read_outputs()
        self.task.advance(self._outputs, self._steps * self.task.control_step)

        contributions = rewards_of(self.task.reward_terms, self.task.view(), self.num_envs)
        frozen = status != 0
        counted = ~(frozen | resetting)
        rewards = np.zeros(self.num_envs, dtype=np.float32)
        infos: Infos = {}
        for name, value in contributions.items():
            value = np.where(counted, value, 0.0).astype(np.float32)
            if not np.isfinite(value).all():
                raise ValueError(
                    f"reward_terms[{name!r}] is {value[~np.isfinite(value)][0]} in sub-environment "
                    f"{int(np.argmax(~np.isfinite(value)))}; return finite numbers"
                )
            rewards += value
            infos[f"reward/{name}"] = value

        ending, reasons = self.task.endings()
        terminated = (frozen | (ending != 0)) & ~resetting
        truncated = self.task.overdue()
        if self.max_episode_steps is not None:
            truncated = truncated | (self._steps >= self.max_episode_steps)
        truncated = truncated & ~terminated & ~resetting
        self.task.renew()
        infos |= self.task.info()
        ended = np.flatnonzero(terminated)
        if ended.size:
            reason = np.full(self.num_envs, None, dtype=object)
            for i in ended:
                reason[i] = f"twin lost: {STATUS[int(status[i])]}" if frozen[i] else reasons[int(ending[i])]
            infos["termination"] = reason
            if "is_success" in infos:
                infos["is_success"] &= ~frozen
        if self._renderer is not None:
            self._renderer.record(self.task.traces())

        if resetting.any():
            self._start(np.flatnonzero(resetting), {})
        self._observe(~frozen | resetting)
        self._done = terminated | truncated
        masks = dict.fromkeys(infos, ~resetting)
        if resetting.any():
            infos, masks = _replaced(infos, masks, self.task.info(), resetting)
        infos = _with_masks(infos, masks)
        if "termination" in infos:
            infos["_termination"] = terminated.copy()
        if self._done.any() and self.autoreset_mode is AutoresetMode.SAME_STEP:
            infos = self._same_step(infos)
        if self.render_mode == "human":
            self.render()
        return self._observation.copy(), rewards, terminated, truncated, infos

    def _same_step(self, infos: Infos) -> Infos:
        """Reset the sub-environments whose episode just ended, and put the end of the old one into the infos."""
        done = self._done.copy()
        where = np.flatnonzero(done)
        final = np.full(self.num_envs, None, dtype=object)
        for i in where:
            final[i] = self._observation[i].copy()
        values = {name: value for name, value in infos.items() if not name.startswith("_")}
        masks = {name: infos[f"_{name}"] for name in values}
        final_info = _with_masks(
            {name: _where(done, value) for name, value in values.items()}, {n: m & done for n, m in masks.items()}
        )
        self._start(where, {})
        self._observe(done)
        values, masks = _replaced(values, masks, self.task.info(), done)
        return {
            **_with_masks(values, masks),
            "final_obs": final,
            "_final_obs": done,
            "final_info": final_info,
            "_final_info": done.copy(),
        }

    def _checked_actions(self, actions: Array) -> NDArray[np.float32]:
        actions = np.asarray(actions, dtype=np.float32)
        if actions.shape != self.action_space.shape:
            raise ValueError(f"actions have shape {actions.shape}, but must have {self.action_space.shape}")
        if not np.isfinite(actions).all():
            raise ValueError(
                f"the action of sub-environment {int(np.argwhere(~np.isfinite(actions))[0, 0])} is not finite"
            )
        return np.clip(actions, self.single_action_space.low, self.single_action_space.high)

    def _read_outputs(self) -> NDArray[np.int32]:
        """Take over the outputs of the step; returns the status (N,) of the twins."""
        values = self.twin.outputs.numpy()  # aliases on the CPU, copies from a GPU
        status = self.twin.status.copy()
        lost = np.flatnonzero(status)
        if lost.size:
            values[:, :, lost] = np.nan_to_num(values[:, :, lost], nan=0.0, posinf=0.0, neginf=0.0)
        state = self.twin.state.numpy()
        if lost.size:
            state = np.nan_to_num(state, nan=0.0, posinf=0.0, neginf=0.0)
        self._outputs = Outputs(values, state)
        return status

    def _observe(self, mask: NDArray[np.bool_]) -> None:
        """Renew the observations where ``mask`` holds; the others keep their last one."""
        parts = observations_of(self.task.observation_terms, self.task.view(), self.num_envs)
        space = self.single_observation_space
        observation = np.concatenate(parts, axis=1).astype(np.float32)
        np.clip(observation, space.low, space.high, out=observation)
        if not mask.all():
            observation = np.where(mask[:, None], observation, self._observation)
        if not np.isfinite(observation).all():
            row, column = np.argwhere(~np.isfinite(observation))[0]
            name = next(name for name, span in self.observation_layout.items() if span.start <= column < span.stop)
            raise ValueError(
                f"observation_terms[{name!r}] is {observation[row, column]} in sub-environment {row}; return finite numbers"
            )
        self._observation = observation

    # ---- rendering ---------------------------------------------------------------------------------------------------

    def render(self) -> tuple[NDArray[np.uint8], ...] | None:  # type: ignore[override]
        """One frame (height, width, 3) a sub-environment; for ``"human"`` the first one's window, and None."""
        if self.render_mode is None:
            gymnasium.logger.warn('render() draws nothing: make the environment with render_mode="rgb_array"')
            return None
        assert self._renderer is not None, "the environment is closed"
        if self.render_mode == "human":
            self._renderer.show()
            return None
        return tuple(self._renderer.frame(i) for i in range(self.num_envs))

    def close_extras(self, **_: Any) -> None:
        """Close the window, if there is one."""
        if self._renderer is not None:
            self._renderer.close()
            self._renderer = None

    def output(self, channel: str) -> NDArray[np.float32]:
        """The twins' exact output channel at the end of the last control step, SI, shape (num_envs,)."""
        return self._outputs.last(channel).copy()

    @property
    def time(self) -> NDArray[np.floating]:
        """Time since the start of the episode [s], shape (num_envs,)."""
        return self._steps * self.task.control_step


def _autoreset_mode(mode: AutoresetMode | str) -> AutoresetMode:
    try:
        return AutoresetMode(mode)
    except ValueError:
        known = ", ".join(repr(m.value) for m in AutoresetMode)
        raise ValueError(f"autoreset_mode is {mode!r}; choose one of: {known}") from None


def _where(mask: NDArray[np.bool_], values: Array) -> Array:
    """``values`` where ``mask`` holds, else zero, or None for objects."""
    return np.where(mask, values, None if values.dtype == object else np.zeros((), values.dtype))


def _masked(values: dict[str, Array], mask: NDArray[np.bool_]) -> Infos:
    return _with_masks({name: _where(mask, value) for name, value in values.items()}, dict.fromkeys(values, mask))


def _with_masks(values: dict[str, Array], masks: dict[str, Array]) -> Infos:
    """Gymnasium's vector infos: every key has a mask that says which sub-environments it holds for."""
    infos: Infos = {}
    for name, value in values.items():
        infos[name] = value
        infos[f"_{name}"] = masks[name].copy()
    return infos


def _replaced(
    values: dict[str, Array], masks: dict[str, Array], begun: dict[str, Array], where: NDArray[np.bool_]
) -> tuple[dict[str, Array], dict[str, Array]]:
    """Infos of a step, with those of a reset ``begun`` in its place where ``where`` holds."""
    values = {
        name: np.where(where, begun[name], v) if name in begun else _where(~where, v) for name, v in values.items()
    }
    masks = {name: mask | where if name in begun else mask & ~where for name, mask in masks.items()}
    return values, masks


@contextmanager
def compilation_announced(device: str) -> Iterator[None]:
    """Says so on the standard error if what runs inside takes long, as the first compilation of the kernels does."""
    began = time.perf_counter()
    said = threading.Event()

    def announce() -> None:
        said.set()
        print(
            f"aoro-gym: preparing the twin for {device}; the first time on a computer this compiles it ...",
            file=sys.stderr,
            flush=True,
        )

    timer = threading.Timer(ANNOUNCE_AFTER, announce)
    timer.daemon = True
    timer.start()
    try:
        yield
    finally:
        timer.cancel()
    if said.is_set():
        print(f"aoro-gym: ready after {time.perf_counter() - began:.0f} s", file=sys.stderr, flush=True)
