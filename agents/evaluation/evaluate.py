"""How well policies do: the same episodes for every one of them, and metrics with 95 % intervals.

>>> from aoro_gym.agents.evaluation.evaluate import evaluate
>>> from aoro_gym.agents.controllers.reference import REFERENCE_POLICIES
>>> policies = REFERENCE_POLICIES["AORO/Turning-v0"]
>>> found = evaluate("AORO/Turning-v0", policies, episodes=4)  # doctest: +SKIP
>>> found.summary["bang-bang"]["settling_time_s"].mean  # doctest: +SKIP

Episode i has the seed ``seed`` + i whoever drives, and with it its course, its machine, its start and its noise. Metrics
say their unit in their name. Who fails is not the better for it: metrics that failing would flatter are those of what was
achieved, and say over how many episodes, or are lower bounds; see :mod:`aoro_gym.agents.evaluation.metrics`. Policies are
ranked by their success first.

Two questions have two intervals; see :mod:`aoro_gym.agents.evaluation.statistics`. What would other episodes give? The
episodes are resampled. What would other noise and other machines give in these episodes? With ``repeats``, each is driven
several times: repeat r of episode i asks for what the seed ``seed`` + i asks for, and ``seed`` + r ``episodes`` + i draws
the sensors' errors and the machine; repeats are resampled, within each episode alone.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from aoro_gym.agents.controllers.privileged import PRIVILEGED_POLICIES
from aoro_gym.agents.controllers.reference import REFERENCE_POLICIES, Factory
from aoro_gym.agents.evaluation import inputs
from aoro_gym.agents.evaluation.batches import (
    Driver,
    at_once,
    drive_locally,
    drive_on_cluster,
    drive_repeats,
)
from aoro_gym.agents.evaluation.cached_episodes import EpisodeCache
from aoro_gym.agents.evaluation.result import Evaluation
from aoro_gym.agents.evaluation.tasks import TASKS
from aoro_gym.agents.policies.files import load_policy, policy_file
from aoro_gym.agents.policies.policy import LearnedPolicy
from aoro_gym.checks import check_choice, check_integer
from aoro_gym.envs.core.offered_terms import FURTHER
from aoro_gym.envs.path_tracking.courses import Course
from aoro_gym.envs.path_tracking.environment import LOCALISATIONS
from aoro_gym.execution.devices import several
from aoro_gym.machine import Machine
from aoro_gym.terrains.soil import Soil


def asked_of(
    env: str,
    policies: Mapping[str, Factory],
    *,
    machine: Machine,
    courses: Sequence[Course] | None = None,
    soil: Soil | None = None,
    **others: Any,
) -> dict[str, Any]:
    """What an evaluation with these arguments depends on, by name.

    Args:
        env: See :func:`evaluate`, as for the other arguments.
        policies: See there.
        machine: See there.
        courses: See there.
        soil: See there.
        others: See there.
    """
    return {
        "env": env,
        "policy": {name: inputs.policy_content(policy) for name, policy in policies.items()},
        "machine": inputs.machine_values(machine),
        "terrain": inputs.grounds(courses),
        "path": inputs.paths(courses),
        **inputs.soft(soil),
        **others,
    }


def policy_factory(env: str, name: str, *, trust_pickle: bool = False) -> Factory:
    """What makes the policy that is called ``name`` for an environment: a reference controller, one that is told more than
    the observation (:mod:`aoro_gym.agents.controllers.privileged`), a policy that comes with the package, or that of a
    file; see :mod:`aoro_gym.agents.policies.files`.

    Raises ValueError if there is none of this name, naming those that there are, or if the file does not hold a policy for
    this environment; OSError if there is no such file.
    """
    check_choice("env", env, TASKS)
    controllers = {**REFERENCE_POLICIES[env], **PRIVILEGED_POLICIES[env]}
    if name in controllers:
        return controllers[name]
    policy = load_policy(policy_file(env, name, controllers), trust_pickle=trust_pickle)
    if policy.environment not in ("", env):
        raise ValueError(f"{name} was trained in {policy.environment}, not in {env}")
    return policy.made_for


def evaluate(
    env: str,
    policies: Mapping[str, Factory],
    *,
    episodes: int = 32,
    repeats: int = 1,
    same_noise: bool = False,
    seed: int = 0,
    courses: Sequence[Course] | None = None,
    machine: str | Machine = "aoro",
    drawn: Callable[[Machine, Sequence[int]], Machine] = lambda machine, seeds: machine,
    soil: str | Soil | None = None,
    device: str = "cpu",
    reward_terms: Mapping[str, Any] | None = None,
    localisation: str | None = None,
    ray: str | None = None,
    kept: Path | None = None,
    progress: Callable[[str, float], Any] = lambda policy, share: None,
) -> Evaluation:
    """Drive the same episodes under every policy.

    Args:
        env: Id of the environment, a key of :data:`TASKS`.
        policies: What makes each policy for a vector environment, by a name of your choice.
        episodes: A policy.
        repeats: How often each is driven, with other noise of the sensors, and on another machine if machines are ``drawn``.
        same_noise: Whether repeats differ in the machines alone.
        seed: Of the first episode.
        courses: Where to drive; by default the environment's own. Not for the turning task.
        machine: Bundled name, machine file or Machine: the one that policies are made for.
        drawn: Gives the machines that are driven, one a seed, such as :mod:`aoro_gym.agents.evaluation.perturbations`
            does; by default the same.
        soil: What the ground of every course is made of, see :class:`aoro_gym.twin.Twin`; hard by default. Drives then have
            the metric ``rut_depth_m``: the mean of the ruts below the wheels over the episode.
        device: ``"cpu"``, ``"cpu:simd"`` or ``"cuda:N"``; several with commas between them, or ``"cuda:all"``, share the
            episodes, see :func:`aoro_gym.execution.devices.several`. On a cluster each job has one of the first one's kind.
        reward_terms: Changes by name to what the return is made of; see :mod:`aoro_gym.envs.core.terms`.
        localisation: How the pose is estimated, ``"gains"`` or ``"filter"``; of path tracking alone. See
            :class:`aoro_gym.envs.path_tracking.environment.PathTrackingVectorEnv`.
        ray: Address of the Ray cluster to drive on, see :func:`aoro_gym.execution.cluster.connected`; here by default.
            The episodes are the same.
        kept: Folder to keep episodes in, by parts, and to read those from that were driven before; see
            :mod:`aoro_gym.agents.evaluation.cached_episodes`.
        progress: Called with a policy's name and the share of everything that is done.

    Raises:
        ValueError: naming what is wrong.
        SimulationDiverged: a twin diverged in the turning task.
        ClusterError: a job on the cluster failed.
    """
    _check(env, policies, episodes, repeats)
    machine = machine if isinstance(machine, Machine) else Machine.load(machine)
    task, names = TASKS[env], several(device)
    soil = Soil.named(soil) if isinstance(soil, str) else soil
    made_of = {**localised(env, localisation), **({} if soil is None else {"soil": soil}), **observing(policies)}
    make = partial(task.make, courses=courses, autoreset_mode="Disabled", reward_terms=reward_terms, **made_of)
    drive = task.drive if repeats == 1 else partial(drive_repeats, task.drive, seed, episodes, same_noise)
    cache = EpisodeCache(
        kept,
        env,
        None if courses is None else (inputs.grounds(courses), inputs.paths(courses)),
        inputs.machine_values(machine),
        _alike(names) or device,
        None if reward_terms is None else list(reward_terms.items()),  # their sum depends on their order
        None if repeats == 1 else (seed, episodes, same_noise),
        *inputs.soft(soil).values(),
        *localised(env, localisation).values(),
    )
    drivers = [Driver(partial(make, device=one), drive, machine, task.drawing(drawn), at_once(one)) for one in names]
    todo = (policies, seed + np.arange(episodes * repeats), cache, progress)
    runs = (
        drive_locally(drivers, *todo) if ray is None else drive_on_cluster(drivers[0], *todo, ray=ray, device=names[0])
    )
    # films are drawn from arrays on the host, as environments with a render mode have them
    made = drivers[0].make(1, machine=machine, render_mode="rgb_array").task
    return Evaluation(
        env, episodes, seed, tuple(getattr(made, "courses", ())), runs, machine, made.control_step,
        lambda: made.scene(machine), repeats,
    )  # fmt: skip


def _alike(names: Sequence[str]) -> str | None:
    """The first of the devices that are called ``names`` if all are of one kind, on which episodes are the same."""
    kinds = {name.partition(":")[0] if name.startswith("cuda") else name for name in names}
    return names[0] if len(kinds) == 1 else None


def observing(policies: Mapping[str, Factory]) -> dict[str, Any]:
    """The environment's argument that asks for what learned policies observe and no environment has unasked; none for
    none."""
    learned = (getattr(policy, "__self__", None) for policy in policies.values())
    names = {name: None for policy in learned if isinstance(policy, LearnedPolicy) for name in policy.layout}
    terms = {name: True for name in names if name in FURTHER}
    return {"observation_terms": terms} if terms else {}


def localised(env: str, localisation: str | None) -> dict[str, str]:
    """The environment's argument that says how it estimates the pose; none for None.

    Raises ValueError if the environment estimates none, or not so.
    """
    if localisation is None:
        return {}
    check_choice("env with a localisation", env, ("AORO/PathTracking-v0", "AORO/PathTracking-v1"))
    check_choice("localisation", localisation, LOCALISATIONS)
    return {"localisation": localisation}


def _check(env: str, policies: Mapping[str, Factory], episodes: int, repeats: int) -> None:
    """Raise ValueError that names an argument of :func:`evaluate` which is wrong."""
    check_choice("env", env, TASKS)
    check_integer("episodes", episodes)
    check_integer("repeats", repeats)
    if not policies:
        raise ValueError("policies is empty; give at least one")
