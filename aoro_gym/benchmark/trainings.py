"""Learning: rollouts of a learning environment with the updates between them."""

from __future__ import annotations

import math

import warp as wp

from aoro_gym.agents.training.curriculum import curriculum
from aoro_gym.agents.training.plan import TrainingPlan
from aoro_gym.benchmark.environments import ENVIRONMENT, placed
from aoro_gym.benchmark.timing import Subject
from aoro_gym.execution.device_names import base, on_cpu
from aoro_gym.machine import Machine


def trainings(
    count: int,
    *,
    machine: Machine,
    trainer: str = "sb3",
    environment: str = ENVIRONMENT,
    ground: str = "raster",
    device: str = "cpu",
    threads: int | None = None,
    seed: int = 0,
) -> Subject:
    """PPO on ``count`` sub-environments, as ``aoro-gym train --trainer TRAINER`` learns by the packaged hyper-parameters,
    with as many batches a rollout, in the first stage of the curriculum. What is timed are whole rollouts, each with the
    updates that follow it; episodes go on from one to the next.

    Args:
        count: Number N of sub-environments.
        machine: Machine of all of them.
        trainer: Who learns.
        environment: Its id.
        ground: ``plane``, ``raster`` or ``mesh``.
        device: ``"cpu"``, ``"cpu:simd"`` or ``"cuda:N"``.
        threads: CPU threads; all cores if None.
        seed: Of everything that is drawn.

    Raises ValueError if a library of the trainer's is missing.
    """
    from aoro_gym.agents.training.callbacks import ProgressCallback, StepCounter
    from aoro_gym.agents.training.learner import learner_of
    from aoro_gym.agents.training.recipe import read_recipe

    plan = TrainingPlan(env=environment, trainer=trainer, device=device, seed=seed)
    recipe = read_recipe(plan)
    usual, rollout = recipe.hyperparams, int(recipe.hyperparams["n_steps"])
    batches = usual["n_envs"] * rollout // usual["batch_size"]
    hyperparams = {**usual, "n_envs": count, "batch_size": max(count * rollout // batches, 1)}
    clock = StepCounter(int(hyperparams["n_timesteps"]))
    learner = learner_of(plan, hyperparams, clock, {"machine": machine, **placed(ground)})
    task = learner.envs.task
    stage = curriculum(environment, recipe.stages)[0]
    stage.apply(task, dict(task.reward_terms))
    if threads is not None:
        learner.envs.twin.threads = threads
    callback = ProgressCallback(clock, learner.episodes, lambda progress: None, every=math.inf)

    def advance(rollouts: int, first_seed: int | None = None) -> None:
        learner.learn(rollouts * rollout * count, callback, seed=first_seed)
        wp.synchronize_device(base(device))

    advance(1, seed)
    return Subject(
        description={
            "what": "train",
            "trainer": trainer,
            "environment": environment,
            "device": device,
            "twins": count,
            "threads": min(learner.envs.twin.threads, count) if on_cpu(device) else None,
            "ground": ground,
            "randomised": stage.randomisation.varies_machine,
            "control_step_s": float(task.control_step),
            **{name: hyperparams[name] for name in ("n_steps", "batch_size", "n_epochs")},
        },
        copies=count,
        steps=rollout,
        step_time=float(task.control_step),
        restart=lambda: None,
        advance=advance,
        check=dict,
    )
