"""Whether what was made fast is fast here: ratios of rates that are measured in one run, each with the least that it may be.

Two ways to do the same are timed in turns, so that neither the computer nor what else it does changes their ratio much. The
least is about half of what was measured (docs/evidence/speed.md, docs/evidence/profile.md): a guard fails where the faster
way is lost, not where a computer is another one.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from importlib.util import find_spec
from typing import Any

from aoro_gym.benchmark import peers
from aoro_gym.benchmark.environments import environments
from aoro_gym.benchmark.timing import Subject, computer, measure
from aoro_gym.benchmark.twins import twins
from aoro_gym.execution.device_names import ALL_GPUS, SIMD, on_cpu
from aoro_gym.execution.devices import several
from aoro_gym.execution.lanes.library import cpp_compiler
from aoro_gym.machine import Machine

Make = Callable[..., Subject]


@dataclass(frozen=True)
class Guard:
    """Two ways to do the same."""

    name: str
    """What is over what."""
    fast: Make
    """Makes the faster one of a ``machine``."""
    slow: Make
    least: float
    """Of the ratio of their rates."""


def guards(device: str) -> list[Guard]:
    """Those that this computer can measure on a device."""
    return _of_cpu() if on_cpu(device) else _of_gpu(device)


def _of_cpu() -> list[Guard]:
    step = partial(environments, 1, ground="plane", threads=1)
    found = [
        Guard("a step of an environment in kernels over array operations", step, partial(step, kernels=False), 2.0)
    ]
    one = partial(twins, 64, ground="raster", threads=1)
    if _compiles():
        found.append(Guard("64 twins on lanes over one after the other", partial(one, device=SIMD), one, 2.0))
    if find_spec("mujoco") is not None:
        found.append(Guard("64 twins over the vehicle in MuJoCo", one, partial(peers.mujoco, 64, threads=1), 2.5))
    return found


def _of_gpu(device: str) -> list[Guard]:
    many = partial(twins, 32_768, ground="raster", device=device)
    some = partial(twins, 4096, ground="raster", device=device)
    found = [
        Guard("32,768 twins over 64", many, partial(twins, 64, ground="raster", device=device), 50.0),
        Guard("4096 twins by roles over one thread each", partial(some, roles=True), partial(some, roles=False), 1.3),
    ]
    if find_spec("torch") is not None:
        step = partial(environments, 4096, device=device, output="torch")
        home = partial(environments, 4096, device=device)
        found += [
            Guard(
                "a step of 4096 environments in kernels over array operations", step, partial(step, kernels=False), 4.0
            ),
            Guard(
                "NumPy's arrays of 4096 environments in kernels over array operations",
                home,
                partial(home, kernels=False),
                3.0,
            ),
        ]
    if find_spec("mujoco_warp") is not None:
        found.append(
            Guard("twins over the vehicle in MuJoCo Warp", many, partial(peers.mujoco_warp, 8192, device=device), 12.0)
        )
    count = len(several(ALL_GPUS))
    if count > 1:
        whole = partial(twins, 131_072, ground="raster", device=ALL_GPUS)
        found.append(
            Guard(
                f"131,072 twins on {count} GPUs over one",
                whole,
                partial(twins, 131_072, ground="raster", device=device),
                0.9 * count,
            )
        )
    return found


def _compiles() -> bool:
    try:
        cpp_compiler()
    except ValueError:
        return False
    return True


def check(
    device: str, machine: Machine, *, seconds: float, progress: Callable[[str, float], Any] | None = None
) -> dict[str, Any]:
    """Measure every guard.

    Args:
        device: One.
        machine: Of all twins.
        seconds: Measured for each of the two ways.
        progress: Called with what is happening and the share that is done.

    Returns:
        ``machine``, the computer, and ``guards`` with ``name``, ``ratio``, ``least`` and ``passes``.
    """
    found, rows = guards(device), []
    rate = "steps_per_core_s" if on_cpu(device) else "steps_per_s"
    for number, guard in enumerate(found):
        subjects = [make(machine=machine) for make in (guard.fast, guard.slow)]
        told = None if progress is None else partial(_told, progress, guard.name, number, len(found))
        fast, slow = measure(subjects, seconds=seconds, progress=told)
        ratio = fast[rate] / slow[rate]
        rows.append({"name": guard.name, "ratio": ratio, "least": guard.least, "passes": ratio >= guard.least})
    return {"machine": computer(device), "guards": rows}


def _told(progress: Callable[[str, float], Any], name: str, number: int, count: int, what: str, share: float) -> None:
    progress(name, (number + share) / count)
