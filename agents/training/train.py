"""Training on the batched twin: in parts, each of which can be the last one.

    python -m aoro_gym train --env AORO/Turning-v0 --out runs/turning

A part is ``checkpoint_every`` steps of each sub-environment. Before it all environments begin anew, with seeds that follow
from the plan's seed and from the steps done; after it the policy is evaluated on seeds and terrains that are held out, and
everything is written:

- ``training.json``: the plan, with its hyper-parameters and its curriculum as they were then;
- ``provenance.json``: what the training follows from: it goes on with nothing else; see
  :mod:`aoro_gym.execution.provenance`;
- ``checkpoint.pt``: what the training goes on from; see :mod:`aoro_gym.agents.training.checkpoints`;
- ``evaluations.json``: every evaluation, with the steps and the time that had passed;
- ``policy.json``, ``policy.safetensors``: the policy as it is, and ``best.*``, that of the best return with the rewards of
  the curriculum's last stage, which all evaluations count;
- ``log``: TensorBoard's files, and the same as CSV, for each start of the training.

So a training that was killed goes on from its last checkpoint as if nothing had been: on a CPU the weights are the same to
the bit. The checkpoint holds policies and evaluations, too, which are written from it: whenever the training was killed,
they are its own.

The restarts are part of every training, interrupted or not. They cut each sub-environment's running episode once a part,
where its value is bootstrapped as at the end of a rollout; parts shall be several episodes long, so that all of an episode
is seen.
"""

from __future__ import annotations

import json
import math
import platform
import shutil
import subprocess
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from functools import partial
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from aoro_gym.agents.evaluation.evaluate import evaluate, inputs
from aoro_gym.agents.evaluation.perturbations import PERTURBATIONS
from aoro_gym.agents.evaluation.tasks import TASKS
from aoro_gym.agents.policies.description import shortened
from aoro_gym.agents.policies.policy import LearnedPolicy
from aoro_gym.agents.training.curriculum import curriculum, stage_at
from aoro_gym.agents.training.plan import TrainingPlan
from aoro_gym.envs.path_tracking.courses import Course
from aoro_gym.execution.cluster import ClusterError, Failed, connected, on_ray
from aoro_gym.execution.digest import digest
from aoro_gym.execution.files import read_json, write_json
from aoro_gym.execution.locking import locked
from aoro_gym.execution.provenance import PROVENANCE, check_provenance
from aoro_gym.machine import Machine

if TYPE_CHECKING:
    from aoro_gym.agents.training.callbacks import Clock, Progress, Watch
    from aoro_gym.envs.core.vector import TwinVectorEnv

EVALUATION_SEED = 30_000
"""Of the first episode of every evaluation; other than those that controllers are tuned and reported on."""
COMMON = "stable-baselines3", "torch", "pyyaml", "tensorboard"
LIBRARIES = {"sb3": ("agents", COMMON), "resident": ("resident", ("skrl", *COMMON))}
"""By trainer, the extra that it needs and what of it reads recipes, learns and logs."""
DRAWN_SEED = 1_000_000
"""Of the first machine that is drawn to learn on, as many further for each seed of a training: no evaluation's."""
CRITIC_FIRST = 0.1
"""Share of the steps of a training with ``--start`` in which the critic alone learns: what it does not know yet would lead
the policy astray."""
RECORD, CHECKPOINT, EVALUATIONS, LOG = "training.json", "checkpoint.pt", "evaluations.json", "log"
POLICIES, SUFFIXES = ("policy", "best"), (".json", ".safetensors")
"""What is written of the policies."""


@dataclass(frozen=True)
class Recipe:
    """What YAML says of an environment: hyper-parameters in the RL Zoo's format, and a curriculum."""

    hyperparams: Mapping[str, Any]
    stages: Sequence[Mapping[str, Any]]


class Learner(Protocol):
    """A library's algorithm with its environments."""

    envs: TwinVectorEnv
    """All sub-environments that it learns in."""

    @property
    def steps(self) -> int:
        """Environment steps done, of the whole training."""
        ...

    def log_to(self, logger: Any) -> None:
        """Where to log to: a logger of Stable-Baselines3."""
        ...

    def learn(self, steps: int, watch: Watch, *, seed: int | None) -> None:
        """Learn for so many environment steps, or a rollout's rest more.

        Before, all environments begin anew with ``seed``; None goes on with the episodes that run.
        """
        ...

    def episodes(self) -> tuple[float, float]:
        """Mean return and success of the last episodes, NaN before the first one has ended; waits for no device."""
        ...

    def policy(self, **about: Any) -> LearnedPolicy:
        """The policy as it is, acting without exploration; ``about`` are the other fields of a learned policy."""
        ...

    def start_from(self, policy: LearnedPolicy) -> None:
        """Act as ``policy`` does. Raises ValueError if its network is another one."""
        ...

    def hold_actor(self, held: bool) -> None:
        """Whether the critic alone learns from now on, if there is one."""
        ...

    def state(self) -> dict[str, Any]:
        """All that was learned and drawn, as tensors and plain values; complete between two calls of :meth:`learn`."""
        ...

    def restore(self, state: Mapping[str, Any]) -> None:
        """Take up what :meth:`state` gave to one that was made as this one was."""
        ...

    def close(self) -> None:
        """Close the environments."""
        ...


def read_recipe(plan: TrainingPlan) -> Recipe:
    """What the plan's files say.

    Raises ValueError naming the file and what is missing or wrong, OSError if there is no such file.
    """
    entry = entry_of(plan.hyperparams_file, plan.env)
    if not isinstance(entry, Mapping):
        raise ValueError(f"{plan.hyperparams_file}: {plan.env} is {entry!r}; give it hyper-parameters by name")
    hyperparams = dict(entry)
    for text in plan.param or []:
        name, equals, value = (part.strip() for part in text.partition("="))
        if not (name and equals):
            raise ValueError(f"param {text!r} is not NAME=VALUE, such as learning_rate=1e-4")
        hyperparams[name] = _value(value)
    for name, value in (("n_timesteps", plan.steps), ("n_envs", plan.n_envs)):
        if value is not None:
            hyperparams[name] = value
        if not isinstance(hyperparams.get(name), int | float):
            raise ValueError(
                f"{plan.hyperparams_file}: {name} of {plan.env} is {hyperparams.get(name)!r}; give a number"
            )
    stages = _plain(plan.curriculum_file, entry_of(plan.curriculum_file, plan.env))
    curriculum(plan.env, stages)
    return Recipe(_plain(plan.hyperparams_file, hyperparams), stages)


def _plain(file: Path, entry: Any) -> Any:
    """What a YAML file says, as JSON gives it back; ValueError if JSON has nothing like it."""
    try:
        return json.loads(json.dumps(entry, allow_nan=False))
    except (TypeError, ValueError) as error:
        raise ValueError(f"{file} holds what JSON has not: {error}; write numbers, texts, lists and tables") from None


def begin(plan: TrainingPlan, folder: Path, *, restart: bool = False) -> Recipe:
    """Write the plan and its recipe to ``folder``, where nothing has been trained yet, or to ``restart`` there.

    Raises ValueError if something has, or if the recipe or the policy to start from is wrong; OSError if a file is missing.
    """
    if (folder / CHECKPOINT).exists() and not restart:
        raise ValueError(
            f"{folder} holds a training; give --resume {folder} to go on, --restart to begin anew, or another --out"
        )
    if plan.env not in TASKS:
        raise ValueError(f"env is {plan.env!r}; choose one of: {', '.join(TASKS)}")
    if plan.perturbation is not None and plan.perturbation not in PERTURBATIONS:
        raise ValueError(f"perturbation is {plan.perturbation!r}; choose one of: {', '.join(PERTURBATIONS)}")
    recipe = read_recipe(plan)
    if plan.start is not None:
        LearnedPolicy.load(Path(plan.start))
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


def _clear(folder: Path) -> None:
    """Remove what a training has written, its checkpoint first: without it nothing goes on."""
    for name in (
        CHECKPOINT,
        PROVENANCE,
        EVALUATIONS,
        RECORD,
        *(f"{name}{end}" for name in POLICIES for end in SUFFIXES),
    ):
        (folder / name).unlink(missing_ok=True)
    shutil.rmtree(folder / LOG, ignore_errors=True)


def continued(plan: TrainingPlan, folder: Path, *, restart: bool = False) -> Recipe:
    """The recipe of ``plan``, whose training in ``folder`` begins if none was begun there; :func:`train` refuses to go on
    with another one. Raises as :func:`begin`."""
    if restart or not (folder / CHECKPOINT).exists():
        return begin(plan, folder, restart=restart)
    return read_recipe(plan)


def recall(folder: Path) -> tuple[TrainingPlan, Recipe]:
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


def inputs_of(
    plan: TrainingPlan,
    recipe: Recipe,
    *,
    machine: Machine,
    courses: Sequence[Course] | None = None,
    held_out: Sequence[Course] | None = None,
) -> dict[str, Any]:
    """All that a training follows from, by name; the arguments are those of :func:`train`.

    Raises ValueError or OSError if the policy to start from cannot be read.
    """
    hyperparams = {name: value for name, value in recipe.hyperparams.items() if name != "n_timesteps"}
    return {
        "env": plan.env,
        "algo": plan.algo,
        "trainer": plan.trainer,
        "device": plan.device,
        "seed": plan.seed,
        "steps": recipe.hyperparams["n_timesteps"],
        "checkpoint_every": plan.checkpoint_every,
        "perturbation": plan.perturbation,
        "hyperparams": hyperparams,
        "curriculum": recipe.stages,
        "start": None if plan.start is None else inputs.policy_content(LearnedPolicy.load(Path(plan.start))),
        "ranges": None if plan.perturbation is None else inputs.machine_ranges(machine),
        "terrain": inputs.grounds(courses),
        "path": inputs.paths(courses),
        **judged_by(plan, machine, held_out),
    }


def judged_by(plan: TrainingPlan, machine: Machine, held_out: Sequence[Course] | None) -> dict[str, Any]:
    """Of the inputs of a training, those that its evaluations follow from, beside the policy."""
    return {
        "env": plan.env,
        "eval_episodes": plan.eval_episodes,
        "machine": inputs.machine_values(machine),
        "held-out terrain": inputs.grounds(held_out),
        "held-out path": inputs.paths(held_out),
    }


def train(
    plan: TrainingPlan,
    recipe: Recipe,
    folder: Path,
    *,
    machine: Machine,
    courses: Sequence[Course] | None = None,
    held_out: Sequence[Course] | None = None,
    accept_code_change: bool = False,
    tell: Callable[[Progress], Any] = lambda progress: None,
    evaluated: Callable[[Mapping[str, Any]], Any] = lambda evaluation: None,
) -> list[dict[str, Any]]:
    """Train, from the checkpoint in ``folder`` if there is one. The folder is locked meanwhile.

    Args:
        plan: What :func:`begin` or :func:`recall` was given or gave.
        recipe: Likewise.
        folder: To read from and write to.
        machine: To learn on.
        courses: Where to learn; None where the task is no drive.
        held_out: Where to evaluate; likewise.
        accept_code_change: Whether to go on from a checkpoint of other code, and to record that.
        tell: Called with where the training stands.
        evaluated: Called with every evaluation, once it and the checkpoint are saved.

    Returns:
        All evaluations, those before the checkpoint, too: ``steps``, ``elapsed_s``, and ``figures`` with their intervals.

    Raises:
        ValueError: names a wrong hyper-parameter, what differs from the training that the folder holds, who writes to the
            folder, or a damaged checkpoint.
        OSError: a file cannot be read or written.
    """
    # after the checks that need neither: importing them takes seconds
    from stable_baselines3.common.logger import configure  # pyright: ignore[reportMissingImports]

    from aoro_gym.agents.training.callbacks import REPORT_EVERY, Clock, Watch

    with locked(folder), ExitStack() as open_:
        asked = inputs_of(plan, recipe, machine=machine, courses=courses, held_out=held_out)
        _check_goes_on(folder, asked, accept_code_change)
        total = int(recipe.hyperparams["n_timesteps"])
        stages = curriculum(plan.env, recipe.stages)
        clock = Clock(total)
        learned_on = _drawn(plan, machine, int(recipe.hyperparams["n_envs"]))
        env_kwargs = {"machine": learned_on} | ({} if courses is None else {"courses": courses})
        learner = learner_of(plan, recipe.hyperparams, clock, env_kwargs)
        open_.callback(learner.close)
        task = learner.envs.task
        rewards = dict(task.reward_terms)
        about = {"command": plan.command, "seed": plan.seed, "revision": revision(), "machine": machine.name}
        saved = _Saved(folder, plan.env, digest(asked))
        if saved.there:
            saved.restore(learner)
            saved.publish()
        elif plan.start is not None:
            learner.start_from(LearnedPolicy.load(Path(plan.start)).made_for(learner.envs))
        clock.done, before, began = learner.steps, saved.elapsed, time.perf_counter()
        logger = configure(str(_emptied(folder / LOG / f"from_{clock.done}")), ["csv", "tensorboard"])
        open_.callback(logger.close)
        learner.log_to(logger)
        watch = Watch(clock, learner.episodes, tell, every=REPORT_EVERY)
        held_until = 0 if plan.start is None else math.ceil(CRITIC_FIRST * total)
        while clock.done < total:
            stage_at(stages, clock.done / total).apply(task, rewards)
            held = clock.done < held_until
            learner.hold_actor(held)
            learner.learn(
                min(plan.checkpoint_every * learner.envs.num_envs, (held_until if held else total) - clock.done),
                watch,
                seed=int(np.random.SeedSequence([plan.seed, clock.done]).generate_state(1)[0]),
            )
            watch.report("evaluating")
            policy = learner.policy(
                environment=plan.env,
                layout=dict(learner.envs.observation_layout),
                training={**about, "steps": clock.done},
            )
            figures = _evaluated(plan, policy, machine, held_out, stages[-1].reward_terms)
            for name, figure in figures.items():
                if figure["mean"] is not None:
                    logger.record(f"evaluation/{name}", figure["mean"])
            logger.dump(clock.done)
            elapsed = before + time.perf_counter() - began
            saved.add({"steps": clock.done, "elapsed_s": round(elapsed, 3), "figures": figures}, policy, elapsed)
            saved.save(learner)
            saved.publish()
            evaluated(saved.evaluations[-1])
        return saved.evaluations


class _Saved:
    """What a training has come to: kept in its checkpoint, and written from there to files of their own.

    Args:
        folder: Of the training.
        env: Id of its environment.
        origin: Digest of what it follows from.
    """

    def __init__(self, folder: Path, env: str, origin: str):
        self._folder, self._env, self._origin = folder, env, origin
        self._policies: dict[str, LearnedPolicy] = {}
        self.evaluations: list[dict[str, Any]] = []
        self.elapsed = 0.0
        """Time [s] that the training has taken."""

    @property
    def there(self) -> bool:
        """Whether there is a checkpoint."""
        return (self._folder / CHECKPOINT).exists()

    def add(self, evaluation: dict[str, Any], policy: LearnedPolicy, elapsed: float) -> None:
        """Add an evaluation of the policy as it is."""
        best = max((one["figures"]["return"]["mean"] for one in self.evaluations), default=-np.inf)
        self._policies["policy"] = policy
        if evaluation["figures"]["return"]["mean"] > best:
            self._policies["best"] = policy
        self.evaluations.append(evaluation)
        self.elapsed = elapsed

    def save(self, learner: Learner) -> None:
        """Write the checkpoint."""
        import torch  # pyright: ignore[reportMissingImports]

        from aoro_gym.agents.training.checkpoints import save_checkpoint

        policies = {
            name: {key: torch.from_numpy(np.array(array)) for key, array in policy.arrays().items()}
            for name, policy in self._policies.items()
        }
        notes = {
            "evaluations": self.evaluations,
            "elapsed_s": self.elapsed,
            "policies": {name: policy.description() for name, policy in self._policies.items()},
            "origin": self._origin,
        }
        save_checkpoint(self._folder / CHECKPOINT, {**learner.state(), "policies": policies}, notes)

    def restore(self, learner: Learner) -> None:
        """Take up the checkpoint; ValueError if it is damaged, or another training's."""
        from aoro_gym.agents.training.checkpoints import load_checkpoint

        file = self._folder / CHECKPOINT
        state, notes = load_checkpoint(file)
        if notes.get("origin") != self._origin:
            raise ValueError(f"{file} is another training's; restore it, or begin anew with --restart")
        try:
            policies = state.pop("policies")
            learner.restore(state)
            self.evaluations, self.elapsed = notes["evaluations"], notes["elapsed_s"]
            self._policies = {
                name: LearnedPolicy.of(about, {key: array.numpy() for key, array in policies[name].items()})
                for name, about in notes["policies"].items()
            }
        except (KeyError, TypeError, AttributeError, RuntimeError, ValueError) as error:  # written by other code
            reason = f"{type(error).__name__}: {shortened(error)}"
            raise ValueError(f"{file} does not fit this version ({reason}); begin anew with --restart") from error

    def publish(self) -> None:
        """Write policies and evaluations as the checkpoint has them."""
        for name, policy in self._policies.items():
            policy.save(self._folder / name)
        write_json(self._folder / EVALUATIONS, {"env": self._env, "evaluations": self.evaluations})


def _check_goes_on(folder: Path, asked: Mapping[str, Any], accept_code_change: bool) -> None:
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


def _emptied(folder: Path) -> Path:
    """A folder without what a run that was killed before its next checkpoint has logged in it."""
    shutil.rmtree(folder, ignore_errors=True)
    return folder


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
    the bit. The other arguments are those of :func:`train`.

    Args:
        plans: By folder, as :func:`begin` or :func:`recall` were given or gave; likewise ``recipes``.
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


def learner_of(
    plan: TrainingPlan, hyperparams: Mapping[str, Any], clock: Clock, env_kwargs: Mapping[str, Any]
) -> Learner:
    """What learns for this plan.

    Args:
        plan: What to train.
        hyperparams: In the RL Zoo's format.
        clock: That schedules follow.
        env_kwargs: Arguments of the environment.

    Raises ValueError naming a wrong hyper-parameter.
    """
    import torch  # pyright: ignore[reportMissingImports]

    if plan.device == "cpu":
        torch.set_num_threads(1)  # layers this small lose more by being shared out than they gain
    if plan.algo == "dagger":
        from aoro_gym.agents.training.dagger import Dagger as Trainer
    elif plan.trainer == "resident":
        from aoro_gym.agents.training.skrl_trainer import Resident as Trainer
    else:
        from aoro_gym.agents.training.stable_baselines import StableBaselines as Trainer
    return Trainer(plan, hyperparams, clock, env_kwargs)


def _drawn(plan: TrainingPlan, machine: Machine, count: int) -> Machine:
    """What ``count`` sub-environments learn on: the machine, or one each that differs from it as the plan says."""
    if plan.perturbation is None:
        return machine
    first = DRAWN_SEED * (1 + plan.seed)
    return PERTURBATIONS[plan.perturbation](machine, range(first, first + count))


def _evaluated(
    plan: TrainingPlan,
    policy: LearnedPolicy,
    machine: Machine,
    held_out: Sequence[Course] | None,
    reward_terms: Mapping[str, Any],
) -> dict[str, dict[str, float]]:
    """Means and intervals of the policy's figures."""
    result = evaluate(
        plan.env,
        {"policy": policy.made_for},
        episodes=plan.eval_episodes,
        seed=EVALUATION_SEED,
        courses=held_out,
        machine=machine,
        device=plan.device,
        reward_terms=reward_terms,
    )
    return result.to_json()["policies"]["policy"]


def versions(trainer: str) -> dict[str, str]:
    """Of what a training by ``trainer`` depends on; ValueError that names the extra if a library is missing."""
    extra, libraries = LIBRARIES[trainer]
    try:
        return {name: version(name) for name in (*libraries, "numpy", "warp-lang")}
    except PackageNotFoundError as error:
        raise ValueError(f"trainer {trainer!r} needs {error.name}: pip install 'aoro-gym[{extra}]'") from error


def revision() -> str:
    """Of the source: the package's version, and the commit if it is a checkout of one."""
    from aoro_gym.version import VERSION

    here = Path(__file__).resolve().parent
    try:
        found = subprocess.run(
            ["git", "describe", "--always", "--dirty", "--abbrev=12"],
            cwd=here,
            capture_output=True,
            text=True,
            check=True,
        )
    except (OSError, subprocess.CalledProcessError):
        return VERSION
    return f"{VERSION}+{found.stdout.strip()}"


def entry_of(file: Path, name: str) -> Any:
    """What a YAML file says of an environment, or of an algorithm.

    Raises ValueError naming the file and what is missing or wrong, OSError if there is no such file.
    """
    try:
        import yaml  # pyright: ignore[reportMissingModuleSource]
    except ImportError as error:
        raise ValueError(f"training needs {error.name}: pip install 'aoro-gym[agents]'") from error
    try:
        content = yaml.safe_load(file.read_text(encoding="utf-8"))
    except yaml.YAMLError as error:
        raise ValueError(f"{file} is no YAML: {error}") from error
    if not isinstance(content, Mapping) or name not in content:
        raise ValueError(f"{file} says nothing of {name}; it needs an entry of this name")
    return content[name]


def _value(text: str) -> Any:
    """A value as YAML has it, and numbers such as 1e-4, which YAML takes for words."""
    import yaml  # pyright: ignore[reportMissingModuleSource]

    value = yaml.safe_load(text)
    try:
        return float(value) if isinstance(value, str) else value
    except ValueError:
        return value
