"""Trials: hyper-parameters that are searched, by Optuna's tree of Parzen estimators, with Ray Tune on a cluster.

Every trial is a training in a folder of its own, as ``aoro-gym train`` would make it, and can be had again by its command.
Trials that fall behind are ended early (asynchronous successive halving). One whose process or node dies goes on from its
last checkpoint; so does the search, when the same call is made again.
"""

from __future__ import annotations

import logging
import math
import os
import shutil
import threading
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from aoro_gym.agents.training.plan import HYPERPARAMS, TrainingPlan
from aoro_gym.agents.training.recipe import entry_of, read_recipe
from aoro_gym.agents.training.run_folder import EVALUATIONS, continued
from aoro_gym.agents.training.train import inputs_of, train
from aoro_gym.checks import check_range
from aoro_gym.envs.path_tracking.courses import Course
from aoro_gym.execution.cluster import RETRIES, connected
from aoro_gym.execution.device_names import on_cpu
from aoro_gym.execution.files import read_json, write_json, write_text
from aoro_gym.execution.locking import locked
from aoro_gym.execution.provenance import PROVENANCE, check_provenance
from aoro_gym.machine import Machine

SPACES = HYPERPARAMS / "spaces.yml"
"""What is searched, by algorithm."""
SEARCH, TUNE, TRIALS, RESULT, BEST = "search.json", "tune", "trials", "trials.json", "best.yml"
"""In the folder of a search: what was asked for, what Ray Tune knows, the trainings, what they came to, and the best one's
hyper-parameters. ``provenance.json`` tells what the search follows from."""
METRIC = "return"
"""Of an evaluation: its mean is to be large."""
REDUCTION = 3
"""One in so many trials goes on from each rung of the halving."""
WATCHED_EVERY = 2.0
"""Time [s] between two looks at what trials have done."""
WORST = -1e30
"""Metric of a trial that failed."""


@dataclass(frozen=True)
class Dimension:
    """What is tried of one hyper-parameter: ``choices``, or a number from ``low`` to ``high``.

    Raises ValueError naming it.
    """

    name: str
    choices: tuple[Any, ...] = ()
    low: float = math.nan
    high: float = math.nan
    log: bool = False
    """Whether ratios, not differences, are equally likely."""
    form: str = "{:.3g}"
    """How a number is written, such as ``lin_{:.3g}``."""

    def __post_init__(self) -> None:
        if self.choices:
            return
        if not (math.isfinite(self.low) and math.isfinite(self.high) and self.low < self.high):
            raise ValueError(f"{self.name} lies from {self.low} to {self.high}; give low < high, or a list of choices")
        if self.log:
            check_range(f"low of {self.name}", self.low, gt=0.0, note=" where log is true")

    def text(self, value: Any) -> str:
        """A value as ``NAME=VALUE``."""
        return f"{self.name}={value if self.choices else self.form.format(value)}"


def read_space(path: Path, algo: str) -> tuple[Dimension, ...]:
    """What the file says of an algorithm.

    Raises ValueError naming the file and what is missing or wrong, OSError if there is no such file.
    """
    entries = entry_of(path, algo)
    if not isinstance(entries, dict) or not entries:
        raise ValueError(f"{path}: {algo} is {entries!r}; give it hyper-parameters by name")
    found = []
    for name, entry in entries.items():
        try:
            if isinstance(entry, list) and entry:
                found.append(Dimension(name, choices=tuple(map(str, entry))))
            else:
                found.append(Dimension(name, **{str(key): value for key, value in dict(entry).items()}))
        except (TypeError, ValueError) as error:
            raise ValueError(f"{path}, {algo}: {error}") from error
    return tuple(found)


@dataclass(frozen=True)
class Trial:
    """One trial, in the order of what its best evaluation found."""

    folder: Path
    params: tuple[str, ...]
    """NAME=VALUE."""
    evaluations: Sequence[Mapping[str, Any]]
    """See :func:`aoro_gym.agents.training.train.train`."""
    failed: str = ""
    """Why it has come to nothing, if it has."""

    @property
    def best(self) -> Mapping[str, Any] | None:
        """Its best evaluation."""
        return max(self.evaluations, key=lambda one: one["figures"][METRIC]["mean"], default=None)

    @property
    def value(self) -> float:
        return WORST if self.best is None else self.best["figures"][METRIC]["mean"]


def search(
    plan: TrainingPlan,
    space: Sequence[Dimension],
    folder: Path,
    *,
    trials: int,
    ray: str,
    machine: Machine,
    courses: Sequence[Course] | None = None,
    held_out: Sequence[Course] | None = None,
    restart: bool = False,
    accept_code_change: bool = False,
    progress: Callable[[str, float], Any] = lambda what, share: None,
) -> list[Trial]:
    """Search hyper-parameters on a cluster; goes on where an interrupted call stopped.

    Args:
        plan: A training like the trials, but for what is searched.
        space: What is searched.
        folder: Gets ``trials`` with a training each, ``search.json``, ``trials.json`` and ``best.yml``; all nodes see it.
        trials: How many, those included that fall behind.
        ray: Address of the cluster, see :func:`aoro_gym.execution.cluster.connected`.
        machine: To learn on.
        courses: Where to learn.
        held_out: Where to evaluate.
        restart: Whether to begin anew where there is a search already.
        accept_code_change: Whether to go on with a search that other code began.
        progress: Called with what is done and the share that is.

    Returns:
        All trials, the best first.

    Raises:
        ValueError: Ray Tune or Optuna is missing, there is no such cluster, the recipe is wrong, ``folder`` holds another
            search, which the message names, or another process writes to it.
    """
    # nodes work in other folders
    files = {name: getattr(plan, name) for name in ("hyperparams", "curriculum", "start")}
    plan = replace(plan, **{name: str(Path(file).absolute()) for name, file in files.items() if file is not None})
    recipe = read_recipe(plan)
    total = recipe.hyperparams["n_timesteps"]
    os.environ.setdefault("TUNE_DISABLE_SIGINT_HANDLER", "1")  # Ctrl-C ends the search here, as everything else
    os.environ.setdefault("RAY_AIR_NEW_OUTPUT", "0")  # of its two ways to report, the one that can be silent
    with locked(folder), connected(ray):
        try:
            import optuna  # pyright: ignore[reportMissingImports]
            from ray import tune  # pyright: ignore[reportMissingImports]
        except ImportError as error:
            raise ValueError(f"{error.name} is missing: pip install 'aoro-gym[ray]'") from error

        asked = inputs_of(plan, recipe, machine=machine, courses=courses, held_out=held_out)
        asked |= {"space": {one.name: repr(one) for one in space}, "trials": trials}
        if restart or not (folder / TRIALS).exists():
            _clear(folder)
        check_provenance(folder / PROVENANCE, asked, accept_code_change=accept_code_change)
        write_json(folder / SEARCH, {"command": plan.command, "space": [repr(one) for one in space], "trials": trials})
        optuna.logging.set_verbosity(optuna.logging.WARNING)
        logging.getLogger("ray.tune").setLevel(logging.WARNING)
        known = {
            "plan": plan, "space": tuple(space), "folder": folder.absolute(), "machine": machine, "courses": courses,
            "held_out": held_out, "accept_code_change": accept_code_change,
        }  # fmt: skip
        resources: dict[str, float] = {"cpu": 1, "gpu": 0 if on_cpu(plan.device) else 1}
        work = tune.with_resources(tune.with_parameters(_trial, **known), resources)
        tuner = _tuner(work, plan, space, folder.absolute() / TUNE, trials=trials, total=int(total))
        with _watched(folder, trials * total, progress), warnings.catch_warnings():
            # a trial that goes on counts its evaluations from one again, which decides nothing
            warnings.filterwarnings("ignore", "The reported value is ignored", UserWarning)
            tuner.fit()
    found = read_trials(folder)
    _write(plan, found, folder)
    return found


def _tuner(work: Any, plan: TrainingPlan, space: Sequence[Dimension], place: Path, *, trials: int, total: int) -> Any:
    """Ray's tuner: the one that ``place`` holds, or a new one there.

    Args:
        work: What a trial does.
        plan: Of its training; its seed is that of the search.
        space: What is searched.
        place: Folder of what Ray Tune knows.
        trials: How many.
        total: Environment steps of a trial that does not fall behind.
    """
    from ray import tune  # pyright: ignore[reportMissingImports]
    from ray.tune.schedulers import AsyncHyperBandScheduler  # pyright: ignore[reportMissingImports]
    from ray.tune.search.optuna import OptunaSearch  # pyright: ignore[reportMissingImports]

    if tune.Tuner.can_restore(str(place)):
        return tune.Tuner.restore(str(place), work, resume_unfinished=True, restart_errored=True)
    return tune.Tuner(
        work,
        param_space={one.name: _domain(tune, one) for one in space},
        tune_config=tune.TuneConfig(
            metric=METRIC,
            mode="max",
            num_samples=trials,
            search_alg=OptunaSearch(seed=plan.seed),
            scheduler=AsyncHyperBandScheduler(
                time_attr="steps", max_t=total + 1, grace_period=max(total // REDUCTION**2, 1),
                reduction_factor=REDUCTION,
            ),
        ),
        run_config=tune.RunConfig(
            name=place.name,
            storage_path=str(place.parent),
            failure_config=tune.FailureConfig(max_failures=RETRIES),
            verbose=0,
        ),
    )  # fmt: skip


def read_trials(folder: Path) -> list[Trial]:
    """The trials of a search, the best first."""
    found = []
    for file in sorted(folder.glob(f"{TRIALS}/*/trial.json")):
        record, place, failed = read_json(file), file.parent, file.with_name("error.txt")
        evaluations = read_json(place / EVALUATIONS)["evaluations"] if (place / EVALUATIONS).exists() else []
        why = failed.read_text(encoding="utf-8").strip() if failed.exists() else ""
        found.append(Trial(place, tuple(record["params"]), evaluations, why))
    return sorted(found, key=lambda one: -one.value)


def _clear(folder: Path) -> None:
    """Remove what a search has written."""
    for name in (TUNE, TRIALS):
        shutil.rmtree(folder / name, ignore_errors=True)
    for name in (PROVENANCE, SEARCH, RESULT, BEST):
        (folder / name).unlink(missing_ok=True)


def _domain(tune: Any, one: Dimension) -> Any:
    if one.choices:
        return tune.choice(list(one.choices))
    return (tune.loguniform if one.log else tune.uniform)(one.low, one.high)


def _trial(
    config: Mapping[str, Any],
    *,
    plan: TrainingPlan,
    space: Sequence[Dimension],
    folder: Path,
    machine: Machine,
    courses: Sequence[Course] | None,
    held_out: Sequence[Course] | None,
    accept_code_change: bool,
) -> None:
    """What a node does: a training that says what every evaluation finds, from its last checkpoint if there is one."""
    from ray import tune  # pyright: ignore[reportMissingImports]

    told = []

    def tell(evaluation: Mapping[str, Any]) -> None:
        told.append(evaluation["steps"])
        tune.report({"steps": evaluation["steps"], METRIC: evaluation["figures"][METRIC]["mean"]})

    params = [one.text(config[one.name]) for one in space]
    place = folder / TRIALS / tune.get_context().get_trial_id()
    write_json(place / "trial.json", {"params": params})
    own = replace(plan, param=[*(plan.param or []), *params])
    try:
        recipe = continued(own, place)
        if (place / EVALUATIONS).exists():  # its process may have died before it told
            tell(read_json(place / EVALUATIONS)["evaluations"][-1])
        found = train(
            own, recipe, place, machine=machine, courses=courses, held_out=held_out,
            accept_code_change=accept_code_change, evaluated=tell,
        )  # fmt: skip
        if found and found[-1]["steps"] not in told:  # it died between its checkpoint and its last evaluation's file
            tell(found[-1])
    except (ValueError, RuntimeError) as error:  # it would fail again
        write_text(place / "error.txt", f"{type(error).__name__}: {error}\n")
        tune.report({"steps": 0, METRIC: WORST})


@contextmanager
def _watched(folder: Path, total: float, progress: Callable[[str, float], Any]) -> Iterator[None]:
    """Tells ``progress`` what of ``total`` steps the trials have done, as their evaluations say."""
    ended = threading.Event()

    def watch() -> None:
        while not ended.wait(WATCHED_EVERY):
            found = read_trials(folder)
            done = sum(one.evaluations[-1]["steps"] for one in found if one.evaluations)
            progress(f"{len(found)} trials begun", min(done / total, 1.0))

    watcher = threading.Thread(target=watch, daemon=True)
    watcher.start()
    try:
        yield
    finally:
        ended.set()
        watcher.join()


def _write(plan: TrainingPlan, found: Sequence[Trial], folder: Path) -> None:
    """``trials.json``, and ``best.yml`` in the RL Zoo's format."""
    import yaml  # pyright: ignore[reportMissingModuleSource]

    content = {
        "env": plan.env,
        "algo": plan.algo,
        "metric": METRIC,
        "trials": [
            {"folder": one.folder.name, "params": list(one.params), "best": one.best, "failed": one.failed}
            for one in found
        ],
    }
    write_json(folder / RESULT, content)
    if found and found[0].best is not None:
        recipe = read_recipe(replace(plan, param=[*(plan.param or []), *found[0].params]))
        text = yaml.safe_dump({plan.env: dict(recipe.hyperparams)}, sort_keys=False, default_flow_style=None)
        write_text(folder / BEST, text)
