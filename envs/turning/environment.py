"""Environments of turning, one joint or many."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

from aoro_gym.envs.core.offered_terms import OFFERED
from aoro_gym.envs.core.randomisation import Randomisation
from aoro_gym.envs.core.single import TwinEnv
from aoro_gym.envs.core.terms import ObservationTerm, RewardTerm, changed_observations, changed_rewards
from aoro_gym.envs.core.vector import TwinVectorEnv, check_keywords
from aoro_gym.envs.turning.config import TurningConfig
from aoro_gym.envs.turning.observations import PRESSURE_TERMS
from aoro_gym.envs.turning.rewards import FURTHER_REWARD_TERMS
from aoro_gym.envs.turning.task import Turning
from aoro_gym.execution.array_api import Array


class TurningVectorEnv(TwinVectorEnv):
    """``gymnasium.make_vec("AORO/Turning-v0", num_envs=N)``: N joints to turn, the twins of one launch.

    **Action** (1,): steering signal, positive left. **Observation**: the terms of ``OBSERVATION_TERMS`` in their order;
    ``observation_layout`` gives the columns. **Reward**: the weighted terms of ``REWARD_TERMS``.

    **Episode**: truncated after 500 steps; terminated only when the simulation diverges, with the reason in
    ``info["termination"]``. ``info["is_success"]`` tells whether all targets so far were settled in time.

    ``reset(options=...)`` also takes ``joint_angle`` [rad], ``targets`` [rad] of shape (T,) or (num_envs, T), the last
    of which stays, and ``hold`` [s], the time each target but the last is held (the shortest hold if targets are given);
    ``position`` [m] of the hinge in the plan and ``heading`` [rad], by default the terrain's middle, or a plane's origin,
    and 0; in a world the place nearest to its middle where no object is in reach of the machine.

    Args:
        num_envs: Sub-environments.
        config: The task; see :class:`TurningConfig`.
        reward_terms: Changes to its reward terms by name; see :mod:`aoro_gym.envs.core.terms`.
        observation_terms: Changes to its observation terms by name; see :mod:`aoro_gym.envs.core.ray_terms` for those
            that cast rays.
        observe_pressures: Add the pressures of both ports and of the pump to the observation.
        randomisation: Instead of the configuration's: ``FIXED``, ``MILD`` or an own one.
        arguments: See :class:`TwinVectorEnv`: machine, terrain, device, output, own_machines, autoreset_mode,
            max_episode_steps, render_mode.
    """

    task: Turning

    def __init__(
        self,
        num_envs: int = 1,
        *,
        config: TurningConfig | None = None,
        reward_terms: Mapping[str, RewardTerm | tuple[float, Callable[[Any], Array]] | float | None] | None = None,
        observation_terms: Mapping[str, ObservationTerm | Callable[[Any], Array] | bool | None] | None = None,
        observe_pressures: bool | None = None,
        randomisation: Randomisation | None = None,
        **arguments: Any,
    ):
        check_keywords(type(self), arguments)
        config = TurningConfig() if config is None else config
        observe_pressures = config.observe_pressures if observe_pressures is None else observe_pressures
        observed = {**config.observation_terms, **(PRESSURE_TERMS if observe_pressures else {})}
        config = replace(
            config,
            observe_pressures=observe_pressures,
            reward_terms=changed_rewards(config.reward_terms, reward_terms, FURTHER_REWARD_TERMS),
            observation_terms=changed_observations(observed, observation_terms, OFFERED),
            randomisation=config.randomisation if randomisation is None else randomisation,
        )
        super().__init__(Turning(config), num_envs, **arguments)


class TurningEnv(TwinEnv):
    """``gymnasium.make("AORO/Turning-v0")``: one joint to turn; see :class:`TurningVectorEnv`."""

    vector_type = TurningVectorEnv
