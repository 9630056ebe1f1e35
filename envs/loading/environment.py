"""Environments of loading, one crane or many."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

from aoro_gym.envs.core.offered_terms import changed_config
from aoro_gym.envs.core.single import TwinEnv
from aoro_gym.envs.core.terms import ObservationTerm, RewardTerm
from aoro_gym.envs.core.vector import TwinVectorEnv, check_keywords
from aoro_gym.envs.loading.config import LoadingConfig, LoadingRandomisation
from aoro_gym.envs.loading.logs import LogSite, learned_sites
from aoro_gym.envs.loading.rewards import FURTHER_REWARD_TERMS
from aoro_gym.envs.loading.task import Loading
from aoro_gym.execution.array_api import Array


class LoadingVectorEnv(TwinVectorEnv):
    """``gymnasium.make_vec("AORO/Loading-v0", num_envs=N)``: N cranes on their vehicles, the twins of one launch.

    **Action**: signals of slew (positive left), lift (up), fold (up) and telescope (out), of the rotator (left), and of the
    grapple, closed where it is above 0. **Observation**: the terms of ``OBSERVATION_TERMS`` in their order;
    ``observation_layout`` gives the columns. **Reward**: the weighted terms of ``REWARD_TERMS``.

    **Episode**: see :mod:`aoro_gym.envs.loading.task`. ``info["is_success"]`` tells that the log was put on the bunk with
    little swing, and ``info["termination"]`` why an episode terminated.

    ``reset(options=...)`` also takes ``site`` and ``log``, which of the sites and of its logs, whole numbers or (num_envs,)
    of them.

    Args:
        num_envs: Sub-environments.
        config: The task; see :class:`LoadingConfig`.
        courses: Sites with logs to draw from; by default those of :data:`~aoro_gym.envs.loading.logs.SPLITS` to learn on.
        reward_terms: Changes to the reward terms by name; see :mod:`aoro_gym.envs.core.terms`.
        observation_terms: Changes to the observation terms by name.
        randomisation: Instead of the configuration's: ``FIXED``, ``MILD`` or an own one.
        arguments: See :class:`TwinVectorEnv`: machine, device, output, own_machines, autoreset_mode, max_episode_steps,
            render_mode; ``terrain`` is a level plane.
    """

    task: Loading

    def __init__(
        self,
        num_envs: int = 1,
        *,
        config: LoadingConfig | None = None,
        courses: Sequence[LogSite] | None = None,
        reward_terms: Mapping[str, RewardTerm | tuple[float, Callable[[Any], Array]] | float | None] | None = None,
        observation_terms: Mapping[str, ObservationTerm | Callable[[Any], Array] | bool | None] | None = None,
        randomisation: LoadingRandomisation | None = None,
        **arguments: Any,
    ):
        check_keywords(type(self), arguments)
        if arguments.get("soil") is not None:
            raise ValueError(
                "AORO/Loading-v0 is on hard ground, as cranes tell nothing of their valves on soil; drop the soil"
            )
        config = LoadingConfig() if config is None else config
        config = changed_config(config, reward_terms, observation_terms, randomisation, FURTHER_REWARD_TERMS)
        super().__init__(Loading(learned_sites() if courses is None else courses, config), num_envs, **arguments)


class LoadingEnv(TwinEnv):
    """``gymnasium.make("AORO/Loading-v0")``: one crane on its vehicle; see :class:`LoadingVectorEnv`."""

    vector_type = LoadingVectorEnv
    vector: LoadingVectorEnv
