"""Several trainings on a Ray cluster."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from aoro_gym.agents.training.plan import TrainingPlan
from aoro_gym.agents.training.recipe import Recipe
from aoro_gym.agents.training.train import train
from aoro_gym.envs.path_tracking.courses import Course
from aoro_gym.execution.cluster import ClusterError, Failed, connected, on_ray
from aoro_gym.machine import Machine


def train_seeds(
    plans: Mapping[Path, TrainingPlan],
    recipes: Mapping[Path, Recipe],
    *,
    ray: str,
    machine: Machine,
    courses: Sequence[Course] | None = None,
    held_out: Sequence[Course] | None = None,
    accept_code_change: bool = False,
    progress: Callable[[str, float], Any] = lambda what, share: None,
) -> dict[Path, list[dict[str, Any]]]:
    """Train several plans on a Ray cluster, a job each, in folders that its nodes share.

    One whose process or node dies goes on elsewhere from its last checkpoint, so on CPUs it comes to the same weights, to
    the bit. The other arguments are those of :func:`~aoro_gym.agents.training.train.train`.

    Args:
        plans: By folder, as :mod:`~aoro_gym.agents.training.run_folder` begins or recalls them; likewise
            ``recipes``.
        recipes: See there.
        ray: Address of the cluster, see :func:`aoro_gym.execution.cluster.connected`.
        machine: To learn on.
        courses: Where to learn.
        held_out: Where to evaluate.
        accept_code_change: Whether to go on from checkpoints of other code.
        progress: Called with the folder that is done and the share that are.

    Returns the evaluations by folder.

    Raises ClusterError if one failed; the others have ended.
    """
    work = partial(train, machine=machine, courses=courses, held_out=held_out, accept_code_change=accept_code_change)
    folders = {str(folder): folder for folder in plans}
    jobs = {name: (plans[folder], recipes[folder], folder.absolute()) for name, folder in folders.items()}
    found, failures = {}, []
    with connected(ray):
        for name, result in on_ray(work, jobs, device=next(iter(plans.values())).device):
            if isinstance(result, Failed):
                failures.append(f"{name}: {result.reason}")
            else:
                found[folders[name]] = result
            progress(name, (len(found) + len(failures)) / len(jobs))
    if failures:
        raise ClusterError("; ".join(failures))
    return found
