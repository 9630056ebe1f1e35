"""Policies that are told what no observation has, by name: how much of a task can be done at all."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import Any

from aoro_gym.agents.controllers.exact import EXACT, Informed
from aoro_gym.agents.controllers.forest_arcs import ArcPlanner
from aoro_gym.agents.controllers.forest_run import ForestDriver, MapPlanner
from aoro_gym.agents.controllers.mppi import SETTINGS, Mppi
from aoro_gym.agents.controllers.path_tracking import PreviewDriver, Vehicle
from aoro_gym.agents.controllers.reference import Factory
from aoro_gym.agents.policies.policy import Policy

LIMITS = "AORO/PathTracking-v1"


def _expert(env: Any) -> Policy:
    """Who knows the true errors, and drives by the gains that are good then."""
    return Informed(PreviewDriver(Vehicle.of(env)), env, EXACT[LIMITS])


def _map_planner(env: Any) -> Policy:
    return MapPlanner(ForestDriver.of(env), env)


def _map_arcs(env: Any) -> Policy:
    return ArcPlanner(ForestDriver.of(env), env)


_OF_A_TASK: Mapping[str, Mapping[str, Factory]] = {
    LIMITS: {"expert": _expert},
    "AORO/ForestRun-v0": {"map-planner": _map_planner, "map-arcs": _map_arcs},
}
PRIVILEGED_POLICIES: Mapping[str, Mapping[str, Factory]] = {
    environment: {**_OF_A_TASK.get(environment, {}), "mppi": partial(Mppi, settings=settings)}
    for environment, settings in SETTINGS.items()
}
"""By the environment's id, then by name. They drive only where they are asked for: planning takes time."""


def made_to_drive(policy: Factory, known: Any, env: Any) -> Policy:
    """The policy that is made for the environment ``known``, to drive in ``env``, whose machines may be others. One that
    looks at the environment itself has a method ``watching``, by which it is told which one."""
    made: Any = policy(known)
    return made.watching(env) if hasattr(made, "watching") else made
