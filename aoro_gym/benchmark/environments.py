"""Learning environments under random actions."""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np
import warp as wp

import aoro_gym  # noqa: F401 (registers the environments)
from aoro_gym.benchmark.scene import CHANGES
from aoro_gym.benchmark.timing import Subject
from aoro_gym.benchmark.twins import randomised
from aoro_gym.execution.device_names import base, on_cpu
from aoro_gym.machine import Machine
from aoro_gym.terrains import Plane

ENVIRONMENT = "AORO/PathTracking-v0"
OUTPUTS = ("numpy", "torch")
"""Where actions and observations live: on the host, or as tensors on the device."""


def placed(ground: str) -> dict[str, Any]:
    """Arguments of an environment on ``ground``, one of :data:`aoro_gym.benchmark.scene.GROUNDS`."""
    return {"terrain": Plane()} if ground == "plane" else {"ground": ground}


def environments(
    count: int,
    *,
    machine: Machine,
    environment: str = ENVIRONMENT,
    ground: str = "raster",
    randomise: bool = False,
    device: str = "cpu",
    threads: int | None = None,
    output: str = "numpy",
    kernels: bool = True,
    seed: int = 0,
) -> Subject:
    """``count`` sub-environments of ``environment`` with its default courses (``plane``: paths over level asphalt),
    stepped with random actions. Episodes that end begin anew within the timed span, as in training.

    Args:
        count: Number N of sub-environments.
        machine: Machine of all of them.
        environment: Its id.
        ground: ``plane``, ``raster`` or ``mesh``.
        randomise: Whether every twin has parameters of its own.
        device: ``"cpu"``, ``"cpu:simd"`` or ``"cuda:N"``.
        threads: CPU threads; all cores if None.
        output: ``numpy`` or ``torch``.
        kernels: Whether steps are in kernels, where the task has some.
        seed: Of ground, parameters and actions.
    """
    options = placed(ground)
    if output != "numpy":
        options["output"] = output
    env = gymnasium.make_vec(
        environment,
        num_envs=count,
        machine=randomised(machine, count, seed) if randomise else machine,
        device=device,
        autoreset_mode="SameStep",
        kernels=kernels,
        **options,
    )
    vector: Any = env.unwrapped
    if threads is not None:
        vector.twin.threads = threads
    rng = np.random.default_rng((seed, 3))
    space: Any = vector.single_action_space
    schedule: list[Any] = list(rng.uniform(space.low, space.high, (CHANGES, count, *space.shape)).astype(np.float32))
    if output == "torch":
        import torch  # pyright: ignore[reportMissingImports]

        schedule = [torch.as_tensor(actions, device=device) for actions in schedule]
    env.reset(seed=seed)
    control_step = float(vector.task.control_step)

    def advance(steps: int) -> None:
        for index in range(steps):
            env.step(schedule[index % CHANGES])
        wp.synchronize_device(base(device))

    return Subject(
        description={
            "what": "env",
            "environment": environment,
            "device": device,
            "twins": count,
            "threads": min(vector.twin.threads, count) if on_cpu(device) else None,
            "ground": ground,
            "randomised": randomise,
            "output": output,
            "main_step_s": vector.twin.main_step,
            "substeps": vector.twin.substeps,
            "control_step_s": control_step,
        },
        copies=count,
        steps=1,
        step_time=control_step,
        restart=lambda: None,  # episodes go on: they end at times of their own
        advance=advance,
        check=dict,
    )
