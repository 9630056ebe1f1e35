"""Commands that train policies."""

from __future__ import annotations

import inspect
import shlex
import time
from collections.abc import Callable
from dataclasses import fields
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, get_type_hints

import typer

from aoro_gym.agents.training.plan import TrainingPlan
from aoro_gym.checks import check_integer
from aoro_gym.cli import options
from aoro_gym.cli.courses import training_courses
from aoro_gym.cli.options import option
from aoro_gym.cli.outcome import checking_input, conclude, entered, fail, resumable, running
from aoro_gym.reporting import terminal

if TYPE_CHECKING:
    from aoro_gym.agents.controllers.reference import Factory
    from aoro_gym.machine import Machine

RunFolderOption = Annotated[
    Path | None, option("--out -o", "FOLDER", "Folder to write to. Default: runs/TASK_ALGO_SEED.")
]
ResumeOption = Annotated[
    Path | None, option("--resume", "FOLDER", "Go on with the training there, from its last checkpoint.")
]
SeedsOption = Annotated[
    int | None, option("--seeds", "N", "With --ray: so many trainings, from --seed on, a job each.")
]
TrialsOption = Annotated[
    int | None, option("--trials", "N", "With --ray: so many trainings to search hyper-parameters by.")
]
SpaceOption = Annotated[Path | None, option("--space", "FILE.yml", "With --trials: what is searched. Default: ours.")]


def _options_of(plan: type) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Puts the fields of a dataclass in the place of a command's ``**planned``."""

    def decorate(command: Callable[..., None]) -> Callable[..., None]:
        hints, signature = get_type_hints(plan), inspect.signature(command, eval_str=True)
        own = [one for one in signature.parameters.values() if one.kind is not one.VAR_KEYWORD]
        asked = [
            inspect.Parameter(
                one.name,
                inspect.Parameter.KEYWORD_ONLY,
                default=one.default,
                annotation=Annotated[
                    hints[one.name], typer.Option(f"--{one.name.replace('_', '-')}", show_default=True, **one.metadata)
                ],
            )
            for one in fields(plan)
        ]
        command.__signature__ = signature.replace(parameters=[*own, *asked])  # pyright: ignore[reportFunctionMemberAccess]
        return command

    return decorate


@_options_of(TrainingPlan)
def train(
    context: typer.Context,
    out: RunFolderOption = None,
    resume: ResumeOption = None,
    ray: options.RayOption = None,
    seeds: SeedsOption = None,
    trials: TrialsOption = None,
    space: SpaceOption = None,
    restart: options.RestartOption = False,
    accept_code_change: options.AcceptCodeChangeOption = False,
    json_to: options.JsonOption = None,
    quiet: options.QuietOption = False,
    **planned: Any,
) -> None:
    """Train a policy, on many twins at once.

    With Stable-Baselines3's PPO or SAC, or with --trainer resident by skrl's PPO, whose arrays never leave the device: for
    GPUs (on a CPU it works, too). Both take the same hyper-parameters and write the same files. --algo dagger imitates a
    reference controller that is told the true errors, from what the sensors say; --start lets PPO learn on from there.

    Hyper-parameters are in the RL Zoo's format, a curriculum says what differs from episode to episode; the package has
    both, for CPUs and for GPUs. The training is evaluated and saved every --checkpoint-every steps of each sub-environment,
    and can be killed at any time: --resume goes on from the last checkpoint, on a CPU to the same weights to the bit, and
    with nothing else: a machine, ground, policy or file that has changed since is named.

    With --laws families every sub-environment has laws of its own, drawn by --seed and the same in all of its episodes
    (--perturbation: parameters, too); evaluations are on the machine of the file.

    With --ray, N trainings run on a cluster whose nodes share FOLDER, each in FOLDER/seed_K. One whose node dies goes on
    elsewhere; after Ctrl-C the same command goes on with all. With --trials, Ray Tune searches hyper-parameters for the best
    return: Optuna proposes, trials that fall behind end early; FOLDER/best.yml is for --hyperparams.

    FOLDER gets training.json (all that was asked), provenance.json (what it follows from), checkpoint.pt, evaluations.json,
    policy.json with policy.safetensors (and best.*, of the best return), and log, for TensorBoard. Needs
    pip install 'aoro-gym\\[agents]', --trainer resident 'aoro-gym\\[resident]'.

    [bold]Examples[/]

      aoro-gym train --env AORO/Turning-v0 --out runs/turning
      aoro-gym train --env AORO/PathTracking-v0 --terrain forest.laz --machine mine.toml --device cuda:0
      aoro-gym train --resume runs/turning
      aoro-gym train --env AORO/Turning-v0 --laws families --perturbation perturbed --out runs/robust
      aoro-gym train --env AORO/Turning-v0 --trainer resident --device cuda:0
      aoro-gym train --env AORO/Turning-v0 --ray auto --seeds 3 --out /shared/turning
      aoro-gym train --env AORO/Turning-v0 --ray local --trials 20 --steps 300000 --checkpoint-every 1000 --out runs/search
      aoro-gym train --env AORO/PathTracking-v0 --algo dagger --out runs/taught
      aoro-gym train --algo sac --param learning_rate=1e-4 --param 'policy_kwargs={net_arch: [128, 128]}' --seed 1
      aoro-gym evaluate --env AORO/Turning-v0 --policy proportional-derivative --policy runs/turning/best.json
    """
    with checking_input():
        _check_combination(context, resume=resume, ray=ray, seeds=seeds, trials=trials, space=space, planned=planned)
        plan = TrainingPlan(**planned)
    how = {"restart": restart, "accept_code_change": accept_code_change, "json_to": json_to}
    if resume is not None:
        _train(None, resume, **how)
    elif ray is None:
        _train(plan, out or plan.folder(f"_{plan.seed}"), **how)
    elif trials is None:
        _train_on_cluster(plan, out or plan.folder(), ray, 1 if seeds is None else seeds, **how)
    else:
        _search_on_cluster(plan, out or plan.folder("_search"), ray, trials, space, **how)


def _check_combination(context: typer.Context, *, planned: Any, **given: Any) -> None:
    """ValueError unless the options of ``train`` may be combined.

    Args:
        context: Tells which of ``planned`` are given.
        planned: Fields of the plan.
        given: Values of the other options; None where they are not given.
    """
    ray, resume, seeds, trials = (given[name] is not None for name in ("ray", "resume", "seeds", "trials"))
    for wrong, message in (
        (given["space"] is not None and not trials, "--space needs --trials; without it nothing is searched"),
        (ray and resume, "--resume and --ray are both given; with --ray the same command goes on"),
        (
            ray and trials and seeds,
            "--seeds and --trials are both given; search first, then train seeds with best.yml",
        ),
        (seeds and not ray, "--seeds needs --ray; without it, give --seed of each training"),
        (trials and not ray, "--trials needs --ray; --ray local is this computer alone"),
    ):
        if wrong:
            raise ValueError(message)
    for name in ("seeds", "trials"):
        if given[name] is not None:
            check_integer(f"--{name}", given[name])
    for name in ("out", *planned) if resume else ():
        source = context.get_parameter_source(name)
        if source is not None and source.name != "DEFAULT":
            raise ValueError(f"--{name.replace('_', '-')} was settled when the training began; leave it out")


def _train(
    plan: TrainingPlan | None, folder: Path, *, restart: bool, accept_code_change: bool, json_to: Path | None
) -> None:
    """Train as ``plan`` says, or go on with the training in ``folder``."""

    def goes_on() -> str:
        if not (folder / "training.json").exists():
            return "nothing was begun yet; the same command begins"
        return f"aoro-gym train --resume {shlex.quote(str(folder))} goes on"

    with resumable(goes_on):
        with checking_input():
            from aoro_gym.agents.training.learner import versions
            from aoro_gym.agents.training.run_folder import EVALUATIONS, RECORD, begin, load_run
            from aoro_gym.agents.training.tables import evaluations_table
            from aoro_gym.agents.training.train import train as run_training
            from aoro_gym.execution.locking import locked

            if plan is None:
                plan, recipe = load_run(folder)
                begins = restart
            else:
                options.check_folder(folder, RECORD)
                recipe, begins = None, True
            chosen = options.load(
                options.run_spec(plan.machine, plan.set, plan.scale, plan.device, laws=plan.laws), draw=False
            )
            courses, held_out = training_courses(plan)
            versions(plan.trainer)  # all is there
        began = time.perf_counter()
        with entered(locked(folder)), checking_input():
            if recipe is None or begins:
                recipe = begin(plan, folder, restart=restart)
            with terminal.progress(plan.env) as tell, running():
                found = run_training(
                    plan, recipe, folder, machine=chosen, courses=courses, held_out=held_out,
                    accept_code_change=accept_code_change, tell=terminal.learning(tell, plan.env),
                )  # fmt: skip
    shown = [evaluations_table(found), f"trained for {time.perf_counter() - began:.0f} s"]
    written = [folder / name for name in (RECORD, EVALUATIONS, "policy.json", "best.json")]
    conclude(written[1], shown, written, json_to=json_to, highlight=False)


def trained(plan: TrainingPlan, folder: Path, machine: Machine, *, restart: bool, accept_code_change: bool) -> Factory:
    """The policy that a plan trains, or that an earlier call of the same has trained.

    Args:
        plan: Plan of the training.
        folder: Folder of the training.
        machine: Machine to learn on, whatever the plan says.
        restart: Whether to begin anew.
        accept_code_change: Whether to go on from checkpoints of other code.
    """
    with checking_input():
        from aoro_gym.agents.policies.files import load_policy
        from aoro_gym.agents.training.learner import versions
        from aoro_gym.agents.training.run_folder import continued
        from aoro_gym.agents.training.train import train as run_training

        versions(plan.trainer)  # all is there
        recipe = continued(plan, folder, restart=restart)
        courses, held_out = training_courses(plan)
    doing = f"{plan.env}, {folder.name}"
    with terminal.progress(doing) as tell, checking_input(), running():
        run_training(
            plan, recipe, folder, machine=machine, courses=courses, held_out=held_out,
            accept_code_change=accept_code_change, tell=terminal.learning(tell, doing),
        )  # fmt: skip
    return load_policy(folder / "best.json").made_for


def _train_on_cluster(
    first: TrainingPlan,
    folder: Path,
    ray: str,
    seeds: int,
    *,
    restart: bool,
    accept_code_change: bool,
    json_to: Path | None,
) -> None:
    """``train --ray``."""
    with checking_input():
        from aoro_gym.agents.training.learner import versions
        from aoro_gym.agents.training.run_folder import RECORD, continued
        from aoro_gym.agents.training.seeds import train_seeds
        from aoro_gym.agents.training.tables import evaluations_table
        from aoro_gym.execution.locking import locked

        options.check_folder(folder, RECORD)
        chosen = options.load_machine(options.run_spec(first.machine, first.set, first.scale, laws=first.laws).machine)
        courses, held_out = training_courses(first)
        versions(first.trainer)  # all is there
    with resumable(), running(), entered(locked(folder)), checking_input():
        plans = first.by_seed(folder, seeds)
        recipes = {place: continued(plan, place, restart=restart) for place, plan in plans.items()}
        with terminal.progress(first.env) as tell:
            found = train_seeds(
                plans, recipes, ray=ray, machine=chosen, courses=courses, held_out=held_out,
                accept_code_change=accept_code_change, progress=tell,
            )  # fmt: skip
    by_place = dict(sorted(found.items()))
    shown = [evaluations_table(evaluations) for evaluations in by_place.values()]
    result = {str(place): evaluations for place, evaluations in by_place.items()}
    conclude(result, shown, [place / "best.json" for place in by_place], json_to=json_to)


def _search_on_cluster(
    plan: TrainingPlan,
    folder: Path,
    ray: str,
    trials: int,
    space: Path | None,
    *,
    restart: bool,
    accept_code_change: bool,
    json_to: Path | None,
) -> None:
    """``train --ray --trials``."""
    with checking_input():
        from aoro_gym.agents.training import search as searching
        from aoro_gym.agents.training.learner import versions
        from aoro_gym.agents.training.tables import trials_table

        options.check_folder(folder, searching.SEARCH)
        dimensions = searching.read_space(searching.SPACES if space is None else space, plan.algo)
        chosen = options.load_machine(options.run_spec(plan.machine, plan.set, plan.scale, laws=plan.laws).machine)
        courses, held_out = training_courses(plan)
        versions(plan.trainer)  # all is there
    with terminal.progress(plan.env) as tell, running(), resumable(), checking_input():
        found = searching.search(
            plan, dimensions, folder,
            trials=trials, ray=ray, machine=chosen, courses=courses, held_out=held_out,
            restart=restart, accept_code_change=accept_code_change, progress=tell,
        )  # fmt: skip
    if not found or found[0].best is None:
        why = found[0].failed if found else "none began"
        terminal.out().print(trials_table(found))
        fail(ValueError(f"no trial came to an evaluation; the first says: {why}"), 1)
    written = [folder / "trials.json", folder / "best.yml"]
    conclude(written[0], [trials_table(found)], written, json_to=json_to)
