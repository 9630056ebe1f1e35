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

import math
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from aoro_gym.agents.evaluation.evaluate import evaluate, inputs, localised
from aoro_gym.agents.evaluation.perturbations import drawn_machines
from aoro_gym.agents.evaluation.tasks import TASKS
from aoro_gym.agents.policies.policy import LearnedPolicy
from aoro_gym.agents.training import callbacks
from aoro_gym.agents.training.callbacks import Progress, ProgressCallback, StepCounter
from aoro_gym.agents.training.courses import meet_worlds
from aoro_gym.agents.training.curriculum import curriculum, stage_at
from aoro_gym.agents.training.learner import Learner, learner_of
from aoro_gym.agents.training.plan import TrainingPlan
from aoro_gym.agents.training.recipe import Recipe, first_policy
from aoro_gym.agents.training.results import TrainingResults
from aoro_gym.agents.training.run_folder import LOG, check_resumable, empty_folder, revision
from aoro_gym.envs.path_tracking.courses import Course
from aoro_gym.execution.digest import digest
from aoro_gym.execution.locking import locked
from aoro_gym.machine import Machine

EVALUATION_SEED = 30_000
"""Of the first episode of every evaluation; other than those that controllers are tuned and reported on."""
DRAWN_SEED = 1_000_000
"""Of the first machine that is drawn to learn on, as many further for each seed of a training: no evaluation's."""
CRITIC_FIRST = 0.1
"""Share of the steps of a training with ``--start`` in which the critic alone learns: what it does not know yet would lead
the policy astray."""


def inputs_of(
    plan: TrainingPlan,
    recipe: Recipe,
    *,
    machine: Machine,
    courses: Sequence[Course] | None = None,
    held_out: Sequence[Course] | None = None,
) -> dict[str, Any]:
    """All that a training follows from, by name.

    Args:
        plan: See :func:`train`, as for the other arguments.
        recipe: See there.
        machine: See there.
        courses: See there.
        held_out: See there.

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
        **({} if plan.laws is None else {"laws": plan.laws}),
        **localised(plan.env, plan.localisation),
        **({} if plan.observe is None else {"observe": plan.observe}),
        "hyperparams": hyperparams,
        "curriculum": recipe.stages,
        "start": None if plan.start is None else inputs.policy_content(first_policy(plan)),
        "ranges": None if plan.perturbation is None else inputs.machine_ranges(machine),
        "terrain": inputs.grounds(courses),
        "path": inputs.paths(courses),
        **evaluation_inputs(plan, machine, held_out),
    }


def evaluation_inputs(plan: TrainingPlan, machine: Machine, held_out: Sequence[Course] | None) -> dict[str, Any]:
    """Of the inputs of a training, those that its evaluations follow from, beside the policy."""
    return {
        "env": plan.env,
        "eval_episodes": plan.eval_episodes,
        "machine": inputs.machine_values(machine),
        **({} if plan.soil is None else {"soil": plan.soil}),
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
        plan: As :mod:`~aoro_gym.agents.training.run_folder` begins or recalls it.
        recipe: Likewise.
        folder: To read from and write to.
        machine: To learn on.
        courses: Where to learn; None where the task is no drive.
        held_out: Where to evaluate; likewise.
        accept_code_change: Whether to go on from a checkpoint of other code, and to record that.
        tell: Called with where the training stands.
        evaluated: Called with every evaluation, once it and the checkpoint are saved.

    Returns:
        All evaluations, those before the checkpoint, too: ``steps``, ``elapsed_s`` and ``figures``, metrics with intervals.

    Raises:
        ValueError: names a wrong hyper-parameter, what differs from the training that the folder holds, who writes to the
            folder, or a damaged checkpoint.
        OSError: a file cannot be read or written.
    """
    _tell_of(tell, "checking the inputs")
    # after the checks that need it not: importing it takes seconds
    from stable_baselines3.common.logger import configure  # pyright: ignore[reportMissingImports]

    with locked(folder), ExitStack() as stack:
        asked = inputs_of(plan, recipe, machine=machine, courses=courses, held_out=held_out)
        check_resumable(folder, asked, accept_code_change)
        stages, clock = curriculum(plan.env, recipe.stages), StepCounter(int(recipe.hyperparams["n_timesteps"]))
        _tell_of(tell, "making the environments")
        machines = _training_machines(plan, machine, int(recipe.hyperparams["n_envs"]))
        learner = learner_of(plan, recipe.hyperparams, clock, _env_kwargs(plan, machines, courses))
        stack.callback(learner.close)
        meet_worlds(courses, learner.envs, partial(_tell_of, tell, "making what rays meet in the worlds"))
        results = TrainingResults(folder, plan.env, digest(asked))
        if results.exist:
            results.restore(learner)
            results.publish()
        elif plan.start is not None:
            learner.start_from(first_policy(plan).made_for(learner.envs))
        clock.done, before, began = learner.steps, results.elapsed, time.perf_counter()
        logger = configure(str(empty_folder(folder / LOG / f"from_{clock.done}")), ["csv", "tensorboard"])
        stack.callback(logger.close)
        learner.log_to(logger)
        callback = ProgressCallback(clock, learner.episodes, tell, every=callbacks.REPORT_EVERY)
        rewards = dict(learner.envs.task.reward_terms)
        while clock.done < clock.total:
            stage_at(stages, clock.done / clock.total).apply(learner.envs.task, rewards)
            _learn(plan, learner, clock, callback)
            callback.report("evaluating")
            policy = _policy(plan, learner, machine, clock.done)
            metrics = _evaluated(plan, policy, machine, held_out, stages[-1].reward_terms)
            for name, metric in metrics.items():
                if metric["mean"] is not None:
                    logger.record(f"evaluation/{name}", metric["mean"])
            logger.dump(clock.done)
            elapsed = before + time.perf_counter() - began
            results.add({"steps": clock.done, "elapsed_s": round(elapsed, 3), "figures": metrics}, policy, elapsed)
            results.save(learner)
            results.publish()
            evaluated(results.evaluations[-1])
        return results.evaluations


def _env_kwargs(plan: TrainingPlan, machines: Machine, courses: Sequence[Course] | None) -> dict[str, Any]:
    """Arguments of the environment to learn in, with a machine or one for each sub-environment."""
    found: dict[str, Any] = {"machine": machines}
    if courses is not None:
        found["courses"] = courses
    if plan.soil is not None:
        found["soil"] = plan.soil
    if plan.observe is not None:
        found["observation_terms"] = dict.fromkeys(plan.observe, True)
    return found | localised(plan.env, plan.localisation)


def _tell_of(tell: Callable[[Progress], Any], doing: str, part: float = 0.0) -> None:
    """Tell what is being done before the first step, and the share of it that is done."""
    tell(Progress(0, 0, 0.0, math.nan, math.nan, doing, part))


def _learn(plan: TrainingPlan, learner: Learner, clock: StepCounter, callback: ProgressCallback) -> None:
    """Learn until the next checkpoint, or until the actor no longer waits for its critic."""
    held_until = 0 if plan.start is None else math.ceil(CRITIC_FIRST * clock.total)
    held = clock.done < held_until
    learner.hold_actor(held)
    learner.learn(
        min(plan.checkpoint_every * learner.envs.num_envs, (held_until if held else clock.total) - clock.done),
        callback,
        seed=int(np.random.SeedSequence([plan.seed, clock.done]).generate_state(1)[0]),
    )


def _policy(plan: TrainingPlan, learner: Learner, machine: Machine, steps: int) -> LearnedPolicy:
    """The policy as it is, with how it came about."""
    about = {"command": plan.command, "seed": plan.seed, "revision": revision(), "machine": machine.name}
    layout = dict(learner.envs.observation_layout)
    about |= localised(plan.env, plan.localisation)
    return learner.policy(environment=plan.env, layout=layout, training={**about, "steps": steps})


def _training_machines(plan: TrainingPlan, machine: Machine, count: int) -> Machine:
    """What ``count`` sub-environments learn on: the machine, or one each that differs from it as the plan says."""
    first = DRAWN_SEED * (1 + plan.seed)
    drawn = TASKS[plan.env].drawing(drawn_machines(plan.laws, plan.perturbation))
    return drawn(machine, range(first, first + count))


def _evaluated(
    plan: TrainingPlan,
    policy: LearnedPolicy,
    machine: Machine,
    held_out: Sequence[Course] | None,
    reward_terms: Mapping[str, Any],
) -> dict[str, dict[str, float]]:
    """Means and intervals of the policy's metrics."""
    result = evaluate(
        plan.env,
        {"policy": policy.made_for},
        episodes=plan.eval_episodes,
        seed=EVALUATION_SEED,
        courses=held_out,
        machine=machine,
        soil=plan.soil,
        device=plan.device,
        reward_terms=reward_terms,
        localisation=plan.localisation,
    )
    return result.to_json()["policies"]["policy"]
