"""Stable-Baselines3's ``VecEnv`` over the batched twin: all sub-environments advance in one launch a step.

>>> from stable_baselines3 import PPO  # doctest: +SKIP
>>> from aoro_gym.agents import make_vec_env
>>> PPO("MlpPolicy", make_vec_env("AORO/Turning-v0", n_envs=64, seed=1)).learn(100_000)  # doctest: +SKIP

Stable-Baselines3's own ``make_vec_env`` works too, with a twin and a launch for each sub-environment. Both give the same
observations, rewards and ends of episodes to the bit; see :class:`TwinVecEnv` for what differs.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import gymnasium
import numpy as np
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray

from aoro_gym.envs import register_envs
from aoro_gym.envs.core.vector import TwinVectorEnv, contributions
from aoro_gym.execution.array_api import Array
from aoro_gym.execution.device_names import on_cpu

try:
    from stable_baselines3.common.vec_env import VecEnv, VecMonitor  # pyright: ignore[reportMissingImports]
except ImportError as error:
    raise ImportError(f"{error.name} is missing: pip install 'aoro-gym[agents]'", name=error.name) from error

Indices = int | Iterable[int] | None


def make_vec_env(
    env_id: str,
    n_envs: int = 1,
    seed: int | None = None,
    *,
    device: str = "cpu",
    env_kwargs: Mapping[str, Any] | None = None,
    monitor_dir: str | None = None,
    monitor_kwargs: Mapping[str, Any] | None = None,
) -> VecMonitor:
    """A monitored :class:`TwinVecEnv`; mirrors ``stable_baselines3.common.env_util.make_vec_env``.

    Args:
        env_id: Such as ``"AORO/Turning-v0"``.
        n_envs: Sub-environments.
        seed: Sub-environment i gets ``seed`` + i.
        device: Of the twins, ``"cpu"``, ``"cpu:simd"`` or ``"cuda:N"``; on a GPU observations and rewards are calculated
            there, too.
        env_kwargs: Arguments of the environment: ``machine``, ``terrain``, ``path``, ``randomisation``, ``reward_terms``, …
        monitor_dir: File to write the episodes' returns to; none by default.
        monitor_kwargs: Of ``VecMonitor``.

    Raises ValueError naming a wrong argument.
    """
    register_envs()
    arguments = {
        "device": device,
        "output": "numpy" if on_cpu(device) else "torch",
        "autoreset_mode": AutoresetMode.SAME_STEP,
        **(env_kwargs or {}),
    }
    if arguments.get("render_mode") is not None:
        arguments["output"] = "numpy"
    envs = gymnasium.make_vec(env_id, num_envs=n_envs, **arguments)
    vec_env = TwinVecEnv(envs)  # pyright: ignore[reportArgumentType]
    vec_env.seed(seed)
    return VecMonitor(vec_env, filename=monitor_dir, **(monitor_kwargs or {}))


class TwinVecEnv(VecEnv):
    """A :class:`~aoro_gym.envs.core.vector.TwinVectorEnv` as Stable-Baselines3 takes it.

    Differs from a ``DummyVecEnv`` of the single environments by what costs time without being read, and by there being
    one environment:

    - The info of an episode that goes on is an empty dictionary. That of one that ended has everything: the last step's
      infos, ``terminal_observation``, ``TimeLimit.truncated`` and, as ``return/NAME``, the sum of each reward term over
      the episode.
    - :meth:`get_attr`, :meth:`set_attr` and :meth:`env_method` go to the vector environment, once. An array with a row for
      each sub-environment is handed out row by row; anything else is what all of them share.
    - :meth:`set_options` also takes one dictionary with arrays of shape (num_envs,), as the vector environment does.

    Args:
        envs: Made with ``autoreset_mode="SameStep"``.

    Raises ValueError if it resets otherwise.
    """

    def __init__(self, envs: TwinVectorEnv):
        if envs.autoreset_mode is not AutoresetMode.SAME_STEP:
            raise ValueError(f"autoreset_mode is {envs.autoreset_mode.value!r}, but Stable-Baselines3 needs 'SameStep'")
        self.envs = envs
        """The environment behind this one."""
        self.spec = envs.spec
        self._given: dict[str, Any] = {}
        self._actions: NDArray[np.float32] = np.zeros(0, dtype=np.float32)
        self._returns: dict[str, Array] = {}
        super().__init__(envs.num_envs, envs.single_observation_space, envs.single_action_space)

    # ---- episodes

    def set_options(self, options: Sequence[Mapping[str, Any]] | Mapping[str, Any] | None = None) -> None:
        """Options of the next reset: for all, or a list with those of each sub-environment, all with the same keys."""
        if options is None:
            self._given = {}
        elif isinstance(options, Mapping):
            self._given = dict(options)
        elif len(options) != self.num_envs or any(one.keys() != options[0].keys() for one in options):
            raise ValueError(
                f"options has {len(options)} dictionaries, but must be one dictionary, or {self.num_envs} with the same keys"
            )
        else:
            self._given = {key: np.array([one[key] for one in options]) for key in options[0]}

    def reset(self) -> NDArray[np.float32]:
        seeds = None if all(seed is None for seed in self._seeds) else self._seeds
        observations, infos = self.envs.reset(seed=seeds, options=self._given)
        self._reset_seeds()
        self.set_options()
        self._returns = {}
        self.reset_infos = self._of_rows(infos, np.arange(self.num_envs))
        return self._host(observations)

    def step_async(self, actions: NDArray[np.float32]) -> None:
        self._actions = actions

    def step_wait(self) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.bool_], list[dict[str, Any]]]:
        """Observations (num_envs, …), rewards and ends (num_envs,), and infos."""
        observations, rewards, terminated, truncated, infos = self.envs.step(self._actions)
        final = infos.get("final_info", {})
        for name, value in contributions(infos).items():
            self._returns[name] = self._returns[name] + value if name in self._returns else value
        described: list[dict[str, Any]] = [{} for _ in range(self.num_envs)]
        shown, earned, ended, cut = self.envs.handed_out.hosts(observations, rewards, terminated | truncated, truncated)
        dones = np.array(ended)
        if final:
            rows = np.flatnonzero(dones)
            index = self.envs.handed_out.index(rows)
            last, *returns = self.envs.handed_out.hosts(
                infos["final_obs"][index], *(value[index] for value in self._returns.values())
            )
            last = np.stack(list(last)) if self.envs.handed_out.on_host else last
            sums = {f"return{name.removeprefix('reward')}": r for name, r in zip(self._returns, returns, strict=True)}
            begun = self._of_rows({k: v for k, v in infos.items() if "final_" not in k}, rows)
            for k, (i, info) in enumerate(zip(rows.tolist(), self._of_rows(final, rows), strict=True)):
                info |= {name: float(value[k]) for name, value in sums.items()}
                info["terminal_observation"] = last[k]
                info["TimeLimit.truncated"] = bool(cut[i])
                described[i] = info
                self.reset_infos[i] = begun[k]
            for value in self._returns.values():
                value[index] = 0.0
        return shown, earned, dones, described

    def _of_rows(self, infos: Mapping[str, Any], rows: NDArray[np.intp]) -> list[dict[str, Any]]:
        """Gymnasium's vector infos as one dictionary for each of the sub-environments ``rows``."""
        index = self.envs.handed_out.index(rows)
        names = [name for name in infos if not name.startswith("_")]
        masks = {id(mask): mask for mask in (infos[f"_{name}"] for name in names)}  # many are one array
        taken = self.envs.handed_out.hosts(
            *(infos[name][index] for name in names), *(mask[index] for mask in masks.values())
        )
        held = dict(zip(masks, (mask.tolist() for mask in taken[len(names) :]), strict=True))
        found: list[dict[str, Any]] = [{} for _ in rows]
        for name, values in zip(names, taken, strict=False):
            chosen: list[Any] = values.tolist()
            if name == "termination" and not self.envs.handed_out.on_host:
                chosen = [self.envs.termination_reasons[number] for number in chosen]
            for info, value, holds in zip(found, chosen, held[id(infos[f"_{name}"])], strict=True):
                if holds:
                    info[name] = value
        return found

    def _host(self, values: Array) -> NDArray[Any]:
        return self.envs.handed_out.host(values)

    def close(self) -> None:
        self.envs.close()

    # ---- the environment behind

    def get_attr(self, attr_name: str, indices: Indices = None) -> list[Any]:
        """An attribute of the environment; its spaces are those of one sub-environment."""
        name = f"single_{attr_name}" if attr_name in ("observation_space", "action_space") else attr_name
        return self._dealt(getattr(self.envs, name), indices)

    def set_attr(self, attr_name: str, value: Any, indices: Indices = None) -> None:
        """Set an attribute of the environment, or its rows ``indices``.

        Raises ValueError if ``indices`` are given for what all sub-environments share.
        """
        if indices is None:
            setattr(self.envs, attr_name, value)
            return
        rows = getattr(self.envs, attr_name)
        if not self._has_rows(rows):
            raise ValueError(f"{attr_name!r} is shared by all sub-environments; set it without indices")
        rows[list(self._get_indices(indices))] = value

    def env_method(
        self, method_name: str, *method_args: Any, indices: Indices = None, **method_kwargs: Any
    ) -> list[Any]:
        """Call a method of the environment, once."""
        return self._dealt(getattr(self.envs, method_name)(*method_args, **method_kwargs), indices)

    def env_is_wrapped(self, wrapper_class: type[gymnasium.Wrapper], indices: Indices = None) -> list[bool]:
        """Never: wrappers of single environments do not fit a batch."""
        return [False for _ in self._get_indices(indices)]

    def get_images(self) -> Sequence[NDArray[np.uint8] | None]:
        frames = self.envs.render() if self.render_mode == "rgb_array" else None
        return [None] * self.num_envs if frames is None else list(frames)

    def _dealt(self, value: Any, indices: Indices) -> list[Any]:
        rows = self._has_rows(value)
        return [value[i] if rows else value for i in self._get_indices(indices)]

    def _has_rows(self, value: Any) -> bool:
        shape = getattr(value, "shape", (len(value),) if isinstance(value, tuple) else ())  # frames are a tuple
        return len(shape) > 0 and shape[0] == self.num_envs
