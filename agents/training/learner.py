"""The interface of what learns, and what implements it for a plan."""

from __future__ import annotations

from collections.abc import Mapping
from importlib.metadata import PackageNotFoundError, version
from typing import TYPE_CHECKING, Any, Protocol

from aoro_gym.agents.policies.policy import LearnedPolicy
from aoro_gym.agents.training.plan import TrainingPlan
from aoro_gym.execution.device_names import on_cpu

if TYPE_CHECKING:
    from aoro_gym.agents.training.callbacks import ProgressCallback, StepCounter
    from aoro_gym.envs.core.vector import TwinVectorEnv


COMMON = "stable-baselines3", "torch", "pyyaml", "tensorboard"
LIBRARIES = {"sb3": ("agents", COMMON), "resident": ("resident", ("skrl", *COMMON))}
"""By trainer, the extra that it needs and what of it reads recipes, learns and logs."""


class Learner(Protocol):
    """A library's algorithm with its environments."""

    envs: TwinVectorEnv
    """All sub-environments that it learns in."""

    @property
    def steps(self) -> int:
        """Environment steps done, of the whole training."""
        ...

    def log_to(self, logger: Any) -> None:
        """Where to log to: a logger of Stable-Baselines3."""
        ...

    def learn(self, steps: int, callback: ProgressCallback, *, seed: int | None) -> None:
        """Learn for so many environment steps, or a rollout's rest more.

        Before, all environments begin anew with ``seed``; None goes on with the episodes that run.
        """
        ...

    def episodes(self) -> tuple[float, float]:
        """Mean return and success of the last episodes, NaN before the first one has ended; waits for no device."""
        ...

    def policy(self, **about: Any) -> LearnedPolicy:
        """The policy as it is, acting without exploration; ``about`` are the other fields of a learned policy."""
        ...

    def start_from(self, policy: LearnedPolicy) -> None:
        """Act as ``policy`` does. Raises ValueError if its network is another one."""
        ...

    def hold_actor(self, held: bool) -> None:
        """Whether the critic alone learns from now on, if there is one."""
        ...

    def state(self) -> dict[str, Any]:
        """All that was learned and drawn, as tensors and plain values; complete between two calls of :meth:`learn`."""
        ...

    def restore(self, state: Mapping[str, Any]) -> None:
        """Take up what :meth:`state` gave to one that was made as this one was."""
        ...

    def close(self) -> None:
        """Close the environments."""
        ...


def learner_of(
    plan: TrainingPlan, hyperparams: Mapping[str, Any], clock: StepCounter, env_kwargs: Mapping[str, Any]
) -> Learner:
    """What learns for this plan.

    Args:
        plan: What to train.
        hyperparams: In the RL Zoo's format.
        clock: That schedules follow.
        env_kwargs: Arguments of the environment.

    Raises ValueError naming a wrong hyper-parameter.
    """
    import torch  # pyright: ignore[reportMissingImports]

    if on_cpu(plan.device):
        torch.set_num_threads(1)  # layers this small lose more by being shared out than they gain
    if plan.algo == "dagger":
        from aoro_gym.agents.training.dagger import Dagger as Trainer
        from aoro_gym.agents.training.dagger import Hyperparams

        if hyperparams.get("memory"):
            from aoro_gym.agents.training.recurrent_dagger import RecurrentDagger

            return RecurrentDagger(plan, Hyperparams.of(plan, hyperparams), clock, env_kwargs)
    elif plan.trainer == "resident":
        from aoro_gym.agents.training.skrl_trainer import SkrlPPO as Trainer
    else:
        from aoro_gym.agents.training.stable_baselines import StableBaselines as Trainer
    return Trainer(plan, hyperparams, clock, env_kwargs)


def versions(trainer: str) -> dict[str, str]:
    """Of what a training by ``trainer`` depends on; ValueError that names the extra if a library is missing."""
    extra, libraries = LIBRARIES[trainer]
    try:
        return {name: version(name) for name in (*libraries, "numpy", "warp-lang")}
    except PackageNotFoundError as error:
        raise ValueError(f"trainer {trainer!r} needs {error.name}: pip install 'aoro-gym[{extra}]'") from error
