"""The folder of a training: how it begins, is recalled, and is checked before it goes on."""

from __future__ import annotations

import platform
import shutil
import subprocess
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from aoro_gym.agents.evaluation.perturbations import drawn_machines
from aoro_gym.agents.evaluation.tasks import TASKS
from aoro_gym.agents.training.learner import versions
from aoro_gym.agents.training.plan import TrainingPlan
from aoro_gym.agents.training.recipe import Recipe, first_policy, read_recipe
from aoro_gym.checks import check_choice
from aoro_gym.execution.files import read_json, write_json
from aoro_gym.execution.locking import locked
from aoro_gym.execution.provenance import PROVENANCE, check_provenance
from aoro_gym.version import VERSION

RECORD, CHECKPOINT, EVALUATIONS, LOG = "training.json", "checkpoint.pt", "evaluations.json", "log"
POLICIES, SUFFIXES = ("policy", "best"), (".json", ".safetensors")
"""What is written of the policies."""


def begin(plan: TrainingPlan, folder: Path, *, restart: bool = False) -> Recipe:
    """Write the plan and its recipe to ``folder``, where nothing has been trained yet, or to ``restart`` there.

    Raises ValueError if something has, or if the recipe or the policy to start from is wrong; OSError if a file is missing.
    """
    if (folder / CHECKPOINT).exists() and not restart:
        raise ValueError(
            f"{folder} holds a training; give --resume {folder} to go on, --restart to begin anew, or another --out"
        )
    check_choice("env", plan.env, TASKS)
    drawn_machines(plan.laws, plan.perturbation)
    recipe = read_recipe(plan)
    if plan.start is not None:
        first_policy(plan)
    content = {
        "command": plan.command,
        "plan": plan.to_json(),
        "hyperparams": recipe.hyperparams,
        "curriculum": recipe.stages,
        "revision": revision(),
        "versions": versions(plan.trainer),
        "python": platform.python_version(),
    }
    with locked(folder):
        _clear(folder)
        write_json(folder / RECORD, content)
    return recipe


def continued(plan: TrainingPlan, folder: Path, *, restart: bool = False) -> Recipe:
    """The recipe of ``plan``, whose training in ``folder`` begins if none was begun there.

    :func:`~aoro_gym.agents.training.train.train` refuses to go on with another one. Raises as :func:`begin`.
    """
    if restart or not (folder / CHECKPOINT).exists():
        return begin(plan, folder, restart=restart)
    return read_recipe(plan)


def load_run(folder: Path) -> tuple[TrainingPlan, Recipe]:
    """The plan and the recipe of the training in ``folder``; what the plan's own files say, they say now.

    Raises ValueError if there is none, OSError if a file of the plan is missing.
    """
    record = folder / RECORD
    if not record.exists():
        raise ValueError(f"{folder} holds no {RECORD}; nothing was trained there")
    content = read_json(record)
    try:
        plan, recipe = TrainingPlan.of(content["plan"]), Recipe(content["hyperparams"], content["curriculum"])
    except (KeyError, TypeError) as error:
        raise ValueError(f"{record} is no training's of this version: {error}; restore it, or begin anew") from error
    if plan.hyperparams is None and plan.curriculum is None:
        return plan, recipe
    now = read_recipe(plan)
    return plan, Recipe(
        recipe.hyperparams if plan.hyperparams is None else now.hyperparams,
        recipe.stages if plan.curriculum is None else now.stages,
    )


def check_resumable(folder: Path, asked: Mapping[str, Any], accept_code_change: bool) -> None:
    """Raise unless what is asked for is what ``folder`` holds, if it holds anything."""
    record = folder / PROVENANCE
    if not (folder / CHECKPOINT).exists():
        record.unlink(missing_ok=True)
    elif not record.exists():
        raise ValueError(
            f"{folder} holds a checkpoint, but no {PROVENANCE} that says what it follows from; restore it, or begin anew"
            " with --restart"
        )
    check_provenance(record, asked, accept_code_change=accept_code_change)


def empty_folder(folder: Path) -> Path:
    """A folder without what a run that was killed before its next checkpoint has logged in it."""
    shutil.rmtree(folder, ignore_errors=True)
    return folder


def _clear(folder: Path) -> None:
    """Remove what a training has written, its checkpoint first: without it nothing goes on."""
    policies = [f"{name}{end}" for name in POLICIES for end in SUFFIXES]
    for name in (CHECKPOINT, PROVENANCE, EVALUATIONS, RECORD, *policies):
        (folder / name).unlink(missing_ok=True)
    shutil.rmtree(folder / LOG, ignore_errors=True)


def revision() -> str:
    """Of the source: the package's version, and the commit if it is a checkout of one."""
    try:
        command = ["git", "describe", "--always", "--dirty", "--abbrev=12"]
        here = Path(__file__).resolve().parent
        found = subprocess.run(command, cwd=here, capture_output=True, text=True, check=True)
    except (OSError, subprocess.CalledProcessError):
        return VERSION
    return f"{VERSION}+{found.stdout.strip()}"
