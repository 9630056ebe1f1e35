"""What learns by Stable-Baselines3: PPO or SAC on the host or a GPU, with the twins behind a ``VecEnv``."""

from __future__ import annotations

import json
import math
import warnings
from collections import deque
from collections.abc import Mapping
from copy import deepcopy
from typing import Any

import numpy as np
import stable_baselines3  # pyright: ignore[reportMissingImports]
import torch  # pyright: ignore[reportMissingImports]
from stable_baselines3.common.base_class import BaseAlgorithm  # pyright: ignore[reportMissingImports]
from stable_baselines3.common.callbacks import BaseCallback  # pyright: ignore[reportMissingImports]
from stable_baselines3.common.save_util import recursive_getattr  # pyright: ignore[reportMissingImports]
from stable_baselines3.common.vec_env import VecNormalize  # pyright: ignore[reportMissingImports]

from aoro_gym.agents.policies.networks import into_stable_baselines3, of_stable_baselines3
from aoro_gym.agents.policies.policy import LearnedPolicy
from aoro_gym.agents.training.callbacks import ProgressCallback, StepCounter
from aoro_gym.agents.training.checkpoints import random_states, restore_random_states
from aoro_gym.agents.training.plan import TrainingPlan
from aoro_gym.agents.training.stable_ppo import StablePPO
from aoro_gym.agents.training.vec_env import make_vec_env
from aoro_gym.envs.core.vector import TwinVectorEnv
from aoro_gym.execution.device_names import base

SCHEDULED = ("learning_rate", "clip_range", "clip_range_vf")
"""Hyper-parameters that may fall linearly to 0: ``lin_3e-4``."""
COUNTERS = ("num_timesteps", "_episode_num", "_n_updates")
STATISTICS = ("ep_info_buffer", "ep_success_buffer")
"""The last episodes, for the log."""
TRANSITIONS = ("observations", "next_observations", "actions", "rewards", "dones", "timeouts")
"""Arrays of a replay buffer."""


class StableBaselines:
    """A :class:`aoro_gym.agents.training.learner.Learner` of the plan's algorithm.

    Args:
        plan: What to train; of it the environment, the algorithm, the seed and the device count here.
        hyperparams: In the RL Zoo's format.
        clock: That schedules follow.
        env_kwargs: Arguments of the environment.

    Raises ValueError naming a wrong hyper-parameter.
    """

    def __init__(
        self, plan: TrainingPlan, hyperparams: Mapping[str, Any], clock: StepCounter, env_kwargs: Mapping[str, Any]
    ):
        arguments = deepcopy(dict(hyperparams))  # Stable-Baselines3 adds to what is nested in it
        arguments.pop("n_timesteps")
        env: Any = make_vec_env(plan.env, int(arguments.pop("n_envs")), device=plan.device, env_kwargs=env_kwargs)
        self.envs: TwinVectorEnv = env.unwrapped.envs
        normalise = arguments.pop("normalize", False)
        if normalise:
            asked = normalise if isinstance(normalise, Mapping) else {}
            env = VecNormalize(env, **{"gamma": arguments.get("gamma", 0.99), **asked})
        for name in SCHEDULED:
            if isinstance(arguments.get(name), str):
                arguments[name] = clock.schedule(name, arguments[name])
        for name, value in arguments.items():
            if isinstance(value, str) and "(" in value:
                raise ValueError(f"{name} is {value!r}, which is code; write what it says as YAML")
        if isinstance(arguments.get("train_freq"), list):
            arguments["train_freq"] = tuple(arguments["train_freq"])
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", "You are trying to run StablePPO on the GPU")
            try:
                made = StablePPO if plan.algo == "ppo" else getattr(stable_baselines3, plan.algo.upper())
                self._model: BaseAlgorithm = made(
                    arguments.pop("policy", "MlpPolicy"), env, seed=plan.seed, device=base(plan.device), **arguments
                )
            except TypeError as error:
                raise ValueError(
                    f"hyper-parameters of {plan.env} that {plan.algo.upper()} does not take: {error}"
                ) from error
        self._env = env
        self._log_interval = 1 if plan.algo == "ppo" else env.num_envs  # rollouts, or episodes

    @property
    def steps(self) -> int:
        return self._model.num_timesteps

    def log_to(self, logger: Any) -> None:
        self._model.set_logger(logger)

    def learn(self, steps: int, callback: ProgressCallback, *, seed: int | None) -> None:
        if seed is not None:
            self._env.seed(seed)
            self._model._last_obs = None  # so that learn() resets the environments
        self._model.learn(
            steps, callback=_StepCallback(callback), reset_num_timesteps=False, log_interval=self._log_interval
        )

    def episodes(self) -> tuple[float, float]:
        returns = [one["r"] for one in self._model.ep_info_buffer or ()]
        success = self._model.ep_success_buffer or ()
        return (
            float(np.mean(returns)) if returns else math.nan,
            float(np.mean(success)) if success else math.nan,
        )

    def policy(self, **about: Any) -> LearnedPolicy:
        return of_stable_baselines3(self._model.policy, self._model.get_vec_normalize_env(), **about)

    def start_from(self, policy: LearnedPolicy) -> None:
        into_stable_baselines3(policy, self._model.policy, self._model.get_vec_normalize_env())

    def hold_actor(self, held: bool) -> None:
        policy: Any = self._model.policy
        if hasattr(policy, "actor"):  # SAC
            parameters = policy.actor.parameters()
        else:
            parameters = (
                *policy.mlp_extractor.policy_net.parameters(),
                *policy.action_net.parameters(),
                policy.log_std,
            )
        for one in parameters:
            one.requires_grad_(not held)

    def state(self) -> dict[str, Any]:
        model = self._model
        _, variables = model._get_torch_save_params()
        actions = {"actions": json.dumps(model.action_space.np_random.bit_generator.state)}
        content = {
            "parameters": model.get_parameters(),
            "variables": {name: recursive_getattr(model, name).detach() for name in variables},
            "counters": {name: getattr(model, name) for name in COUNTERS if hasattr(model, name)},
            "statistics": json.dumps({name: list(getattr(model, name)) for name in STATISTICS}, default=float),
            "normaliser": None,
            "replay": None,
            "random": random_states(model.device) | actions,
        }
        normaliser = model.get_vec_normalize_env()
        if normaliser is not None:
            content["normaliser"] = {
                name: {"mean": _tensor(rms.mean), "var": _tensor(rms.var), "count": float(rms.count)}
                for name, rms in _moments(normaliser).items()
            }
        replay = getattr(model, "replay_buffer", None)
        if replay is not None:
            count = replay.buffer_size if replay.full else replay.pos
            content["replay"] = {
                "position": replay.pos,
                "full": replay.full,
                "arrays": {name: torch.from_numpy(getattr(replay, name)[:count]) for name in TRANSITIONS},
            }
        return content

    def restore(self, state: Mapping[str, Any]) -> None:
        model = self._model
        model.set_parameters(state["parameters"], exact_match=True, device=model.device)
        with torch.no_grad():
            for name, value in state["variables"].items():
                recursive_getattr(model, name).copy_(value)
        for name, value in state["counters"].items():
            setattr(model, name, value)
        for name, values in json.loads(state["statistics"]).items():
            setattr(model, name, deque(values, maxlen=model._stats_window_size))
        normaliser = model.get_vec_normalize_env()
        if normaliser is not None:
            for name, rms in _moments(normaliser).items():
                saved = state["normaliser"][name]
                rms.mean, rms.var, rms.count = saved["mean"].numpy(), saved["var"].numpy(), saved["count"]
        replay: Any = getattr(model, "replay_buffer", None)
        if replay is not None:
            saved = state["replay"]
            replay.pos, replay.full = saved["position"], saved["full"]
            for name, values in saved["arrays"].items():
                getattr(replay, name)[: len(values)] = values.numpy()
        model.action_space.np_random.bit_generator.state = json.loads(state["random"]["actions"])
        restore_random_states(state["random"], model.device)

    def close(self) -> None:
        self._env.close()


class _StepCallback(BaseCallback):
    """Tells a callback of every step, and logs the reward terms of episodes that ended."""

    def __init__(self, callback: ProgressCallback):
        super().__init__()
        self._callback = callback

    def _on_step(self) -> bool:
        infos = self.locals["infos"]
        for i in np.flatnonzero(self.locals["dones"]):
            for name, value in infos[i].items():
                if name.startswith("return/"):
                    self.logger.record_mean(f"terms/{name.removeprefix('return/')}", value)
        self._callback.on_step(self.num_timesteps)
        return True


def _moments(normaliser: Any) -> dict[str, Any]:
    """Running means and variances of a ``VecNormalize``."""
    return {"returns": normaliser.ret_rms} | ({"observations": normaliser.obs_rms} if normaliser.norm_obs else {})


def _tensor(values: Any) -> torch.Tensor:
    return torch.from_numpy(np.array(values, dtype=np.float64))
