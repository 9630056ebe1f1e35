"""Twins under changing commands, and the memory that they take."""

from __future__ import annotations

from typing import Any

import numpy as np
import warp as wp

from aoro_gym.benchmark.scene import CHANGES, CONTROL_STEP, signals, starts, terrain
from aoro_gym.benchmark.timing import Subject
from aoro_gym.execution import devices
from aoro_gym.execution.device_names import on_cpu
from aoro_gym.machine import Machine
from aoro_gym.simulation.manoeuvres import SimulationDiverged
from aoro_gym.terrains import Plane
from aoro_gym.twin import Twin
from aoro_gym.twin.sharded import ShardedTwins

SPREAD = 0.05
"""Uncertain parameters are drawn within this share of their value to either side."""


def randomised(machine: Machine, count: int, seed: int) -> Machine:
    """``count`` variants of ``machine``: every parameter that is not known hardware, drawn for each."""
    rng = np.random.default_rng((seed, 2))
    uncertain = [p.key for p in machine.parameters() if p.role in ("nuisance", "both")]
    return machine.scale({key: rng.uniform(1.0 - SPREAD, 1.0 + SPREAD, count) for key in uncertain}, check_ranges=False)


def twins(
    count: int,
    *,
    machine: Machine,
    ground: str = "plane",
    randomise: bool = False,
    device: str = "cpu",
    threads: int | None = None,
    roles: bool | None = None,
    seed: int = 0,
) -> Subject:
    """``count`` twins that steer and drive at random over ``ground``, one of :data:`~aoro_gym.benchmark.scene.GROUNDS`.

    What is timed is :meth:`Twin.step`, as every study calls it, and so the one kernel that
    :func:`aoro_gym.twin.kernels.build.build` keeps for a kind of ground: on the plane the one that ``validate`` runs.
    Commands come from NumPy and are uploaded within the timed span.

    Args:
        count: Number N of twins.
        machine: Machine of all of them.
        ground: What they drive on.
        randomise: Whether every twin has parameters of its own.
        device: ``"cpu"``, ``"cpu:simd"`` or ``"cuda:N"``; several share the twins, see
            :func:`aoro_gym.execution.devices.several`.
        threads: CPU threads; all cores if None.
        roles: Whether warps of a GPU share twins, see :class:`~aoro_gym.twin.twin.Twin`.
        seed: Of ground, parameters and commands.
    """
    names = devices.several(device)
    options: dict[str, Any] = {"threads": threads, "roles": roles}
    if ground == "plane":
        options["terrain"] = Plane()
    else:
        options |= {"terrain": terrain(), "ground": ground}
    if devices.find(names[0]).is_cuda:
        Twin(1, machine=machine, device=names[0], **options).step()  # that takes the kernel's memory, not the twins'
    before = _free(names[0])
    options["machine"] = randomised(machine, count, seed) if randomise else machine
    twin = Twin(count, device=device, **options) if len(names) == 1 else ShardedTwins(count, device=device, **options)
    shards = (twin,) if isinstance(twin, Twin) else twin.shards
    first = shards[0]
    twin.step()
    memory = count_memory(first) | ({} if before is None else {"device_bytes": before - (_free(names[0]) or 0)})
    position, heading = starts(count, seed)
    schedule = [{"steering_signal": steering, "drive_signal": drive} for steering, drive in signals(count, seed)]

    def advance(steps: int) -> None:
        for index in range(steps):
            twin.step(schedule[index % CHANGES], duration=CONTROL_STEP)
        for shard in shards:
            wp.synchronize_device(shard.device)

    def check() -> dict[str, Any]:
        if twin.diverged:
            index, reason = twin.diverged[0]
            number = len(twin.diverged)
            raise SimulationDiverged(f"simulation diverged in {number} of {count} twins (first {index}: {reason})")
        return {}

    return Subject(
        description={
            "what": "twin",
            "device": device,
            "twins": count,
            "threads": min(first.threads, count) if on_cpu(device) else None,
            "ground": ground,
            "randomised": randomise,
            "main_step_s": first.main_step,
            "substeps": first.substeps,
            "control_step_s": CONTROL_STEP,
            "memory": memory,
        },
        copies=count,
        steps=round(CONTROL_STEP / first.main_step),
        step_time=first.main_step,
        restart=lambda: twin.reset(position=position, heading=heading),
        advance=advance,
        check=check,
    )


def count_memory(twin: Twin) -> dict[str, int]:
    """Bytes of the arrays that ``twin`` holds: ``bytes_per_twin`` of its own, ``shared_bytes`` of ground and machine.

    The tree over a mesh's triangles is Warp's and not counted. :func:`twins` adds ``device_bytes``, by which the free
    memory of a GPU has shrunk: all of it, in the allocator's blocks.
    """
    ground = twin.ground
    fields = {name: getattr(ground, name) for name in type(ground)._cls.vars}
    own = [array for array in vars(twin).values() if isinstance(array, wp.array) and twin.num_twins in array.shape]
    own.append(fields.pop("twins"))
    held = [array for array in (*vars(twin).values(), *fields.values()) if isinstance(array, wp.array)]
    shared = [array for array in held if not any(array is one for one in own)]
    return {
        "bytes_per_twin": round(sum(array.capacity for array in own) / twin.num_twins),
        "shared_bytes": sum(array.capacity for array in shared),
    }


def _free(device: str) -> int | None:
    """Free memory [bytes] of a GPU."""
    here = devices.find(device)
    wp.synchronize_device(here)
    return here.free_memory if here.is_cuda else None
