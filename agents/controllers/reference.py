"""The reference controllers of every environment, by name.

>>> import gymnasium
>>> from aoro_gym.agents.controllers.reference import reference_policy
>>> from aoro_gym.envs import register_envs
>>> register_envs()
>>> envs = gymnasium.make_vec("AORO/Turning-v0", num_envs=2)
>>> policy = reference_policy("AORO/Turning-v0", "bang-bang", envs)
>>> policy(envs.reset(seed=1)[0]).shape
(2, 1)
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

from aoro_gym.agents.controllers.forest_run import ForestDriver, LidarPlanner, StraightAhead
from aoro_gym.agents.controllers.levelling import Assistance, ModalPid, ModalRegulator, PreviewPid, Stance
from aoro_gym.agents.controllers.loading import Loader, WaypointLoader
from aoro_gym.agents.controllers.path_tracking import (
    FullSpeedSteering,
    PreviewDriver,
    PreviewRegulator,
    PurePursuit,
    Stanley,
    Vehicle,
)
from aoro_gym.agents.controllers.turning import BangBang, ProportionalDerivative
from aoro_gym.agents.policies.policy import Policy

Factory = Callable[[Any], Policy]
"""Makes the policy for an environment, wrapped or not; its observations come with a leading axis of sub-environments."""


def _observing(controller: Callable[[Any], Policy], env: Any) -> Policy:
    return controller(env.unwrapped.observation_layout)


def _steering(controller: Callable[[Vehicle], Policy], env: Any) -> Policy:
    return controller(Vehicle.of(env))


def _levelling(controller: Callable[[Stance], Policy], env: Any) -> Policy:
    return controller(Stance.of(env))


def _through_forest(controller: Callable[[ForestDriver], Policy], env: Any) -> Policy:
    return controller(ForestDriver.of(env))


def _loading(controller: Callable[[Loader], Policy], env: Any) -> Policy:
    return controller(Loader.of(env))


LIMIT_GAINS: Mapping[str, tuple[Callable[..., Policy], Mapping[str, float]]] = {
    "pure-pursuit": (
        PurePursuit,
        {"drive_signal": 0.611, "look_ahead": 2.21, "gain": 1.23, "lead_time": 0.174},
    ),
    "stanley": (
        Stanley,
        {"drive_signal": 0.711, "heading_gain": 8.32, "cross_track_gain": 1.08, "look_ahead": 0.155, "gain": 1.31},
    ),
    "preview": (
        PreviewRegulator,
        {"drive_signal": 0.7, "heading_weight": 0.0145, "rate_weight": 0.0276, "lag": 0.036},
    ),
    "preview-speed": (
        PreviewDriver,
        {
            "heading_weight": 0.0807,
            "rate_weight": 0.392,
            "lag": 0.0613,
            "largest_rate": 1.44,
            "braking": 0.596,
            "climbing": 0.347,
            "fastest": 1.67,
        },
    ),
}
"""Controllers of ``AORO/PathTracking-v1``, with the gains that their tuning found, to three digits: on today's ``aoro``,
or, of Stanley's law and of the preview regulator, on ``aoro_least_squares``, since these succeed more often on the 40 paths
that trainings are evaluated on."""

REFERENCE_POLICIES: Mapping[str, Mapping[str, Factory]] = {
    "AORO/Turning-v0": {
        "bang-bang": partial(_observing, BangBang),
        "proportional-derivative": partial(_observing, ProportionalDerivative),
    },
    "AORO/PathTracking-v0": {
        "pure-pursuit": partial(_steering, PurePursuit),
        "stanley": partial(_steering, Stanley),
        "preview": partial(_steering, PreviewRegulator),
        "bang-bang": partial(_steering, FullSpeedSteering),
    },
    "AORO/PathTracking-v1": {
        name: partial(_steering, partial(kind, **gains)) for name, (kind, gains) in LIMIT_GAINS.items()
    },
    "AORO/Levelling-v0": {
        "assistance": partial(_levelling, Assistance),
        "modal-pid": partial(_levelling, ModalPid),
        "preview-pid": partial(_levelling, PreviewPid),
        "modal-lqr": partial(_levelling, ModalRegulator),
    },
    "AORO/ForestRun-v0": {
        "straight": partial(_through_forest, StraightAhead),
        "lidar-planner": partial(_through_forest, LidarPlanner),
    },
    "AORO/Loading-v0": {
        "waypoints": partial(_loading, WaypointLoader),
        "fast-waypoints": partial(_loading, partial(WaypointLoader, gain=1.2, damping=0.25, ramp=0.0, slow=0.45)),
    },
}
"""By the environment's id, then by the controller's name."""


def reference_policy(environment: str, name: str, env: Any) -> Policy:
    """The reference controller ``name`` of ``environment`` for its instance ``env``.

    Raises ValueError if there is none of this name, naming those that there are.
    """
    for key, known, what in (
        (environment, REFERENCE_POLICIES, "environment with reference controllers"),
        (name, REFERENCE_POLICIES.get(environment, {}), f"reference controller of {environment}"),
    ):
        if key not in known:
            raise ValueError(f"{key!r} is no {what}; choose one of: {', '.join(map(repr, known))}")
    return REFERENCE_POLICIES[environment][name](env)
