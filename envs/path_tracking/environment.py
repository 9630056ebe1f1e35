"""Environments of path tracking, one vehicle or many."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any, ClassVar

from aoro_gym.checks import check_choice
from aoro_gym.envs.core.offered_terms import OFFERED
from aoro_gym.envs.core.single import TwinEnv
from aoro_gym.envs.core.terms import ObservationTerm, RewardTerm, changed_observations, changed_rewards
from aoro_gym.envs.core.vector import TwinVectorEnv, check_keywords
from aoro_gym.envs.path_tracking.assistance import ArmControl
from aoro_gym.envs.path_tracking.config import PathTrackingConfig, PathTrackingRandomisation
from aoro_gym.envs.path_tracking.courses import Course, as_courses, ground_of
from aoro_gym.envs.path_tracking.observations import GEAR_TERMS, HEIGHT_TERMS, INERTIAL_TERMS
from aoro_gym.envs.path_tracking.rewards import FURTHER_REWARD_TERMS
from aoro_gym.envs.path_tracking.task import PathTracking
from aoro_gym.execution.array_api import Array
from aoro_gym.sensors import LocalisationGains, PoseFilterSettings
from aoro_gym.terrains import Path, Plane, Terrain
from aoro_gym.terrains.world.world import World


class PathTrackingVectorEnv(TwinVectorEnv):
    """``gymnasium.make_vec("AORO/PathTracking-v0", num_envs=N)``: N vehicles on their paths, the twins of one launch.

    **Action**: steering signal (positive left) and drive signal (positive forward), then what the options add, by
    ``action_layout``. **Observation**: the terms of ``OBSERVATION_TERMS`` in their order; ``observation_layout`` gives the
    columns. **Reward**: the weighted terms of ``REWARD_TERMS``.

    **Episode**: see :mod:`aoro_gym.envs.path_tracking.task`. ``info["is_success"]`` tells that the end of the path was
    reached, and ``info["termination"]`` why an episode terminated.

    ``reset(options=...)`` also takes ``path``, a whole number (of the terrain's paths) or (num_envs,) of them, or a
    :class:`~aoro_gym.terrains.Path`; ``start`` [m] along it; ``lateral_offset`` [m]; ``heading_offset`` [rad];
    ``joint_angle`` [rad], each a number or (num_envs,).

    Args:
        num_envs: Sub-environments.
        config: The task; see :class:`PathTrackingConfig`.
        courses: Terrains with their paths to draw from; by default a small library of generated forests.
        terrain: Instead: one ground, a world with its solid objects, too, with ``path`` or with paths that are generated.
        path: The only path on it.
        reward_terms: Changes to the reward terms by name; see :mod:`aoro_gym.envs.core.terms`.
        observation_terms: Changes to the observation terms by name; ``"lidar": True`` and ``"height_map": True`` add what
            rays show, see :mod:`aoro_gym.envs.core.ray_terms`.
        randomisation: Instead of the configuration's: ``FIXED``, ``MILD`` or an own one.
        gear: 1, 2, 3 or ``"automatic"``.
        arms: ``"share"`` the weight (the default), ``"level"`` the frames, too, or ``"hold"``; or an
            :class:`~aoro_gym.envs.path_tracking.assistance.ArmControl`.
        localisation: ``"gains"`` (the default), dead reckoning pulled toward solutions by constant gains, or ``"filter"``, a
            Kalman filter; or settings of either, see :class:`PathTrackingConfig`.
        act_arms: Add the arms to the action; likewise ``act_traction`` and ``act_gear``.
        act_traction: See :class:`PathTrackingConfig`.
        act_gear: See there.
        observe_inertial: Add roll rate, pitch rate and specific force to the observation.
        scan_x: Places ahead [m] whose ground is scanned.
        chassis_force_limit: Force [N] of objects on a chassis that ends an episode.
        arguments: See :class:`TwinVectorEnv`: machine, ground, soil, device, output, own_machines, autoreset_mode,
            max_episode_steps, render_mode.
    """

    task: PathTracking
    task_type: ClassVar[type[PathTracking]] = PathTracking
    """Of what it makes."""

    def __init__(
        self,
        num_envs: int = 1,
        *,
        config: PathTrackingConfig | None = None,
        courses: Sequence[Course] | None = None,
        terrain: Terrain | Plane | World | None = None,
        path: Path | None = None,
        reward_terms: Mapping[str, RewardTerm | tuple[float, Callable[[Any], Array]] | float | None] | None = None,
        observation_terms: Mapping[str, ObservationTerm | Callable[[Any], Array] | bool | None] | None = None,
        randomisation: PathTrackingRandomisation | None = None,
        gear: int | str | None = None,
        arms: ArmControl | str | None = None,
        localisation: LocalisationGains | PoseFilterSettings | str | None = None,
        act_arms: bool | None = None,
        act_traction: bool | None = None,
        act_gear: bool | None = None,
        observe_inertial: bool | None = None,
        scan_x: tuple[float, ...] | None = None,
        chassis_force_limit: float | None = None,
        **arguments: Any,
    ):
        check_keywords(type(self), arguments)
        config = PathTrackingConfig() if config is None else config
        if arms is not None:
            config = replace(config, arms=_arm_control(arms))
        if localisation is not None:
            config = replace(config, localisation=localisation_settings(localisation))
        changes = {
            "randomisation": randomisation,
            "gear": gear,
            "act_arms": act_arms,
            "act_traction": act_traction,
            "act_gear": act_gear,
            "observe_inertial": observe_inertial,
            "scan_x": scan_x,
            "chassis_force_limit": chassis_force_limit,
        }
        config = replace(config, **{name: value for name, value in changes.items() if value is not None})
        observed = {
            **config.observation_terms,
            **(GEAR_TERMS if config.act_gear or config.gear == "automatic" else {}),
            **(INERTIAL_TERMS if config.observe_inertial else {}),
            **(HEIGHT_TERMS if config.scan_x else {}),
        }
        config = replace(
            config,
            reward_terms=changed_rewards(config.reward_terms, reward_terms, FURTHER_REWARD_TERMS),
            observation_terms=changed_observations(observed, observation_terms, OFFERED),
        )
        library = as_courses(courses, terrain, path)
        super().__init__(self.task_type(library, config), num_envs, terrain=ground_of(library), **arguments)

    @property
    def localisation(self) -> str:
        """How the pose is estimated, ``"gains"`` or ``"filter"``."""
        return "filter" if isinstance(self.task.config.localisation, PoseFilterSettings) else "gains"


class PathTrackingEnv(TwinEnv):
    """``gymnasium.make("AORO/PathTracking-v0")``: one vehicle on its path; see :class:`PathTrackingVectorEnv`."""

    vector_type = PathTrackingVectorEnv
    vector: PathTrackingVectorEnv


def _arm_control(arms: ArmControl | str) -> ArmControl | None:
    if isinstance(arms, ArmControl):
        return arms
    known = {"hold": None, "share": ArmControl.sharing(), "level": ArmControl.levelling()}
    if arms not in known:
        raise ValueError(f"arms is {arms!r}; choose one of: {', '.join(map(repr, known))}, or give an ArmControl")
    return known[arms]


LOCALISATIONS: Mapping[str, Callable[[], LocalisationGains | PoseFilterSettings]] = {
    "gains": LocalisationGains,
    "filter": PoseFilterSettings,
}
"""How the pose is estimated, by name."""


def localisation_settings(
    localisation: LocalisationGains | PoseFilterSettings | str,
) -> LocalisationGains | PoseFilterSettings:
    """Settings by their name, or as they are; ValueError that names the known ones."""
    if not isinstance(localisation, str):
        return localisation
    check_choice("localisation", localisation, LOCALISATIONS)
    return LOCALISATIONS[localisation]()
