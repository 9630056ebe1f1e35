"""What learns on the device: skrl's PPO on the tensors of the twins, of which nothing comes to the host but a few metrics.

Hyper-parameters have the names and the meaning of Stable-Baselines3's PPO, in the same files. What differs: advantages are
normalised over a rollout, not over each batch; schedules are read when a rollout begins. Of a policy with a memory only what
lies behind the memory learns.
"""

from __future__ import annotations

import math
import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import gymnasium
import torch  # pyright: ignore[reportMissingImports]
from gymnasium.vector import AutoresetMode
from stable_baselines3.common.logger import Logger  # pyright: ignore[reportMissingImports]
from torch.distributions import Normal  # pyright: ignore[reportMissingImports]
from torch.nn import Parameter  # pyright: ignore[reportMissingImports]

from aoro_gym.agents.policies.networks import into_network, of_network
from aoro_gym.agents.policies.policy import LearnedPolicy
from aoro_gym.agents.training.callbacks import ProgressCallback, StepCounter
from aoro_gym.agents.training.checkpoints import random_states, restore_random_states
from aoro_gym.agents.training.device_env import DeviceEnv
from aoro_gym.agents.training.minibatches import Figures, Minibatches, Samples
from aoro_gym.agents.training.perceptron import perceptron
from aoro_gym.agents.training.plan import TrainingPlan
from aoro_gym.agents.training.recipe import check_positive_integers, first_policy
from aoro_gym.agents.training.remembering_env import RememberingEnv
from aoro_gym.envs import register_envs
from aoro_gym.envs.core.vector import TwinVectorEnv

try:
    from skrl.agents.torch.ppo import PPO, PPO_CFG  # pyright: ignore[reportMissingImports]
    from skrl.agents.torch.ppo.ppo import compute_gae  # pyright: ignore[reportMissingImports]
    from skrl.memories.torch import RandomMemory  # pyright: ignore[reportMissingImports]
    from skrl.models.torch import DeterministicMixin, GaussianMixin, Model  # pyright: ignore[reportMissingImports]
except ImportError as error:
    raise ImportError(f"{error.name} is missing: pip install 'aoro-gym[resident]'", name=error.name) from error

LOGGED = {
    "Loss / Policy loss": "train/policy_gradient_loss",
    "Loss / Value loss": "train/weighted_value_loss",
    "Loss / Entropy loss": "train/weighted_entropy_loss",
    "Policy / Standard deviation": "train/std",
}
"""What skrl tracks, by the names of Stable-Baselines3's log where they mean the same."""
EPISODES = {"return": "rollout/ep_rew_mean", "length": "rollout/ep_len_mean", "success": "rollout/success_rate"}
"""Likewise what episodes that ended say."""


@dataclass(frozen=True, kw_only=True)
class Hyperparams:
    """Those of Stable-Baselines3's PPO that there are here, with its defaults.

    Raises ValueError naming one, its value and its bound.
    """

    n_timesteps: float
    n_envs: int
    policy: str = "MlpPolicy"
    normalize: bool | Mapping[str, Any] = False
    n_steps: int = 2048
    batch_size: int = 64
    n_epochs: int = 10
    learning_rate: float | str = 3e-4
    gamma: float = 0.99
    gae_lambda: float = 0.95
    clip_range: float | str = 0.2
    clip_range_vf: float | str | None = None
    ent_coef: float = 0.0
    vf_coef: float = 0.5
    max_grad_norm: float = 0.5
    policy_kwargs: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if self.policy != "MlpPolicy":
            raise ValueError(f"policy is {self.policy!r}, but the resident trainer has 'MlpPolicy' only")
        check_positive_integers(self, "n_envs", "n_steps", "batch_size", "n_epochs")
        if self.n_steps * self.n_envs % self.batch_size:
            raise ValueError(
                f"batch_size is {self.batch_size}, but must divide n_steps * n_envs = {self.n_steps * self.n_envs}"
            )
        unknown = set(self.policy_kwargs) - {"log_std_init", "net_arch"}
        if unknown:
            raise ValueError(
                f"policy_kwargs has {', '.join(sorted(unknown))}, but the resident trainer takes log_std_init, net_arch"
            )

    @property
    def normalised(self) -> dict[str, Any]:
        """Arguments of :class:`DeviceEnv`."""
        if not self.normalize:
            return {"norm_obs": False, "norm_reward": False}
        return {"gamma": self.gamma, **(self.normalize if isinstance(self.normalize, Mapping) else {})}

    def hidden(self, network: str) -> list[int]:
        """Sizes of the hidden layers of ``"pi"``, the policy, or ``"vf"``, the value."""
        asked = self.policy_kwargs.get("net_arch", [64, 64])
        return list(asked[network] if isinstance(asked, Mapping) else asked)


class SkrlPPO:
    """A :class:`aoro_gym.agents.training.learner.Learner`: PPO, on the device of the twins.

    Args:
        plan: What to train; of it the environment, the seed and the device count here.
        hyperparams: In the RL Zoo's format, see :class:`Hyperparams`.
        clock: That schedules follow.
        env_kwargs: Arguments of the environment.

    Raises ValueError naming a wrong hyper-parameter.
    """

    def __init__(
        self, plan: TrainingPlan, hyperparams: Mapping[str, Any], clock: StepCounter, env_kwargs: Mapping[str, Any]
    ):
        try:
            asked = Hyperparams(**hyperparams)
        except TypeError as error:
            raise ValueError(
                f"hyper-parameters of {plan.env} that the resident trainer does not take: {error}"
            ) from error
        self._schedules = {
            name: clock.schedule(name, value)
            for name in ("learning_rate", "clip_range", "clip_range_vf")
            if (value := getattr(asked, name)) is not None
        }
        self._rollout = int(asked.n_steps)
        register_envs()
        made: Any = gymnasium.make_vec(
            plan.env,
            num_envs=int(asked.n_envs),
            device=plan.device,
            output="torch",
            autoreset_mode=AutoresetMode.SAME_STEP,
            **env_kwargs,
        )
        self.envs: TwinVectorEnv = made.unwrapped
        self._memory = None if plan.start is None else first_policy(plan).memory
        try:
            self._env = (
                DeviceEnv(self.envs, **asked.normalised)
                if self._memory is None
                else RememberingEnv(self.envs, self._memory, **asked.normalised)
            )
        except TypeError as error:
            raise ValueError(f"normalize is {asked.normalize!r}: {error}") from error
        torch.manual_seed(plan.seed)
        self._agent = _agent(asked, self._env)
        self._observations: torch.Tensor | None = None
        self._logger: Any = Logger(folder=None, output_formats=[])
        self._last_episodes = (math.nan, math.nan)
        self.steps = 0

    def log_to(self, logger: Any) -> None:
        self._logger = logger

    def learn(self, steps: int, callback: ProgressCallback, *, seed: int | None) -> None:
        observations = self._observations if seed is None else self._env.reset(seed)
        if observations is None:
            raise ValueError("seed is None, but there are no running episodes to go on with; give a seed")
        end = self.steps + steps
        while self.steps < end:
            began = time.perf_counter()
            self._follow_schedules()
            for _ in range(self._rollout):
                observations = self._step(observations)
                self.steps += self.envs.num_envs
                callback.on_step(self.steps)
            self._log(self._rollout * self.envs.num_envs / (time.perf_counter() - began))
        self._observations = observations

    def _step(self, observations: torch.Tensor) -> torch.Tensor:
        """One step of all sub-environments, with the learning that follows the last one of a rollout."""
        timing: dict[str, int] = {"timestep": self.steps, "timesteps": self.steps + 1}  # for what is switched off here
        with torch.no_grad():
            actions, _ = self._agent.act(observations, None, **timing)
            made = self._env.step(actions)
            self._agent.record_transition(
                observations=observations,
                states=None,
                actions=actions,
                rewards=made.rewards,
                next_observations=made.reached,
                next_states=None,
                terminated=made.terminated,
                truncated=made.truncated,
                infos={},
                **timing,
            )
        self._agent.post_interaction(**timing)
        return made.observations

    def _follow_schedules(self) -> None:
        now = {name: schedule(0.0) for name, schedule in self._schedules.items()}
        for group in self._agent.optimizer.param_groups:
            group["lr"] = now["learning_rate"]
        self._agent.cfg.ratio_clip = now["clip_range"]
        self._agent.cfg.value_clip = now.get("clip_range_vf", 0.0)
        self._logger.record("train/learning_rate", now["learning_rate"])

    def _log(self, rate: float) -> None:
        ended = self._env.ended()
        if ended:
            self._last_episodes = (ended["return"], ended["success"])
        for name, value in ended.items():
            self._logger.record(EPISODES.get(name, name.replace("reward/", "terms/")), value)
        for name, values in self._agent.tracking_data.items():
            if name in LOGGED:
                self._logger.record(LOGGED[name], values[-1])
        self._agent.tracking_data.clear()
        self._logger.record("time/fps", int(rate))
        self._logger.record("time/total_timesteps", self.steps)
        self._logger.dump(self.steps)

    def episodes(self) -> tuple[float, float]:
        return self._last_episodes

    def policy(self, **about: Any) -> LearnedPolicy:
        space = self.envs.single_action_space
        return of_network(
            self._agent.policy.net, space, normalisation=self._env.normalisation, memory=self._memory, **about
        )

    def start_from(self, policy: LearnedPolicy) -> None:
        into_network(policy, self._agent.policy.net, normalised=self._env.normalisation is not None)
        self._env.start_from(policy.normalisation)

    def hold_actor(self, held: bool) -> None:
        self._agent.policy.requires_grad_(not held)

    def state(self) -> dict[str, Any]:
        return {
            "modules": {name: module.state_dict() for name, module in self._agent.checkpoint_modules.items()},
            "normaliser": self._env.state(),
            "steps": self.steps,
            "statistics": list(self._last_episodes),
            "random": random_states(self._env.device),
        }

    def restore(self, state: Mapping[str, Any]) -> None:
        for name, module in self._agent.checkpoint_modules.items():
            module.load_state_dict(state["modules"][name])
        self._env.restore(state["normaliser"])
        self.steps = state["steps"]
        self._last_episodes = tuple(state["statistics"])
        restore_random_states(state["random"], self._env.device)

    def close(self) -> None:
        self._env.close()


def _agent(asked: Hyperparams, env: DeviceEnv) -> Any:
    """skrl's PPO, ready to learn in ``env``."""
    spaces = {
        "observation_space": env.observation_space,
        "action_space": env.envs.single_action_space,
        "device": env.device,
    }
    configuration = PPO_CFG(
        rollouts=int(asked.n_steps),
        learning_epochs=int(asked.n_epochs),
        mini_batches=int(asked.n_steps) * int(asked.n_envs) // int(asked.batch_size),
        discount_factor=asked.gamma,
        gae_lambda=asked.gae_lambda,
        entropy_loss_scale=asked.ent_coef,
        value_loss_scale=asked.vf_coef,
        grad_norm_clip=asked.max_grad_norm,
        time_limit_bootstrap=True,
        # the training logs and saves by itself
        experiment={"write_interval": 0, "checkpoint_interval": 0},  # pyright: ignore[reportArgumentType]
    )
    log_std = float(asked.policy_kwargs.get("log_std_init", 0.0))
    agent = _PPO(
        models={"policy": _Actor(asked.hidden("pi"), log_std, spaces), "value": _Critic(asked.hidden("vf"), spaces)},
        memory=RandomMemory(memory_size=int(asked.n_steps), num_envs=int(asked.n_envs), device=env.device),
        cfg=configuration,
        **spaces,
    )
    agent.init()
    agent.enable_training_mode(True)
    return agent


class _PPO(PPO):
    """skrl's PPO, whose update waits for nothing: its losses, in minibatches that are shuffled where they lie."""

    policy: Any
    value: Any
    memory: Any

    def __init__(self, **arguments: Any):
        super().__init__(**arguments)
        parameters = [*self.policy.parameters(), *self.value.parameters()]
        self.optimizer = torch.optim.Adam(parameters, fused=True)  # one launch a step, by the rate of the schedule
        self.checkpoint_modules["optimizer"] = self.optimizer
        self._minibatches = Minibatches(
            self._evaluate,
            parameters,
            value_weight=self.cfg.value_loss_scale,
            entropy_weight=self.cfg.entropy_loss_scale,
            max_norm=self.cfg.grad_norm_clip,
            normalised=False,  # a rollout's are
        )

    def update(self, *, timestep: int, timesteps: int) -> None:
        self._estimate()
        samples = self._samples()
        self._minibatches.clip(self.cfg.ratio_clip, self.cfg.value_clip or None)
        figures: list[torch.Tensor] = []
        for _ in range(self.cfg.learning_epochs):
            order = torch.randperm(len(samples.values), device=self.device)
            for rows in torch.tensor_split(order, self.cfg.mini_batches):
                figures.append(self._minibatches.gradients(samples, rows))
                self.optimizer.step()
        self._track(
            Figures(*torch.stack(figures).numpy(force=True).mean(axis=0, dtype=float).tolist())
        )  # waits for all of it

    def _estimate(self) -> None:
        """Returns and advantages of the rollout, into the memory."""
        memory = self.memory
        with torch.no_grad():
            last, _ = self.value.act({"observations": self._current_next_observations}, role="value")
            returns, advantages = compute_gae(
                **{name: memory.get_tensor_by_name(name) for name in ("rewards", "terminated", "truncated", "values")},
                last_values=last,
                discount_factor=self.cfg.discount_factor,
                lambda_coefficient=self.cfg.gae_lambda,
                time_limit_bootstrap=self.cfg.time_limit_bootstrap,
            )
        memory.set_tensor_by_name("returns", returns)
        memory.set_tensor_by_name("advantages", advantages)

    def _samples(self) -> Samples:
        names = ("values", "log_prob", "advantages", "returns")
        views = self.memory.tensors_view
        return Samples(views["observations"], views["actions"], *(views[name][:, 0] for name in names))

    def _evaluate(
        self, observations: torch.Tensor, actions: torch.Tensor
    ) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
        distribution = self.policy.of(observations)
        values, _ = self.value.act({"observations": observations}, role="value")
        return values[:, 0], distribution.log_prob(actions).sum(dim=-1), distribution.entropy().sum(dim=-1)

    def _track(self, means: Figures) -> None:
        self.track_data("Loss / Policy loss", means.policy_loss)
        self.track_data("Loss / Value loss", self.cfg.value_loss_scale * means.value_loss)
        if self.cfg.entropy_loss_scale:
            self.track_data("Loss / Entropy loss", self.cfg.entropy_loss_scale * means.entropy_loss)
        self.track_data("Policy / Standard deviation", self.policy.deviation().mean().item())


class _Actor(GaussianMixin, Model):
    """Mean of a Gaussian over actions, whose deviation is the same everywhere; the environment clips what is drawn."""

    def __init__(self, hidden: list[int], log_std: float, spaces: Mapping[str, Any]):
        Model.__init__(self, **spaces)
        GaussianMixin.__init__(self)
        self.net = perceptron([self.num_observations, *hidden, self.num_actions], last_gain=0.01)
        self.log_std = Parameter(torch.full((self.num_actions,), log_std))

    def compute(self, inputs: Mapping[str, Any], role: str = "") -> tuple[torch.Tensor, dict[str, Any]]:
        return self.net(inputs["observations"]), {"log_std": self.log_std}

    def of(self, observations: torch.Tensor) -> Normal:
        """What ``act`` draws from, of which this draws nothing."""
        return Normal(self.net(observations), self.deviation())

    def deviation(self) -> torch.Tensor:
        """Of each action (A,)."""
        return torch.clamp(self.log_std, self._g_min_log_std, self._g_max_log_std).exp()


class _Critic(DeterministicMixin, Model):
    """The value of an observation."""

    def __init__(self, hidden: list[int], spaces: Mapping[str, Any]):
        Model.__init__(self, **spaces)
        DeterministicMixin.__init__(self)
        self.net = perceptron([self.num_observations, *hidden, 1], last_gain=1.0)

    def compute(self, inputs: Mapping[str, Any], role: str = "") -> tuple[torch.Tensor, dict[str, Any]]:
        return self.net(inputs["observations"]), {}
