"""Whether what was made fast is fast here: ratios of rates that are measured in one run, each with the least that it may be.

Two ways to do the same are timed in turns, so that neither the computer nor what else it does changes their ratio much. The
least is about half of what was measured (docs/evidence/speed.md, docs/evidence/profile.md): a guard fails where the faster
way is lost, not where a computer is another one. Numbers of twins, and what many gain over few, go by the size of the GPU.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from importlib.util import find_spec
from typing import Any

from aoro_gym.benchmark import peers
from aoro_gym.benchmark.environments import environments
from aoro_gym.benchmark.newton import newton
from aoro_gym.benchmark.timing import Subject, computer, measure
from aoro_gym.benchmark.twins import twins
from aoro_gym.execution import devices
from aoro_gym.execution.array_api import calculates_on_gpus
from aoro_gym.execution.device_names import ALL_GPUS, SIMD, on_cpu
from aoro_gym.execution.lanes.library import cpp_compiler
from aoro_gym.machine import Machine

Make = Callable[..., Subject]

PROCESSORS = 132
"""Multiprocessors of the H200 that the ratios of GPUs were measured on."""
BENCH = "pip install 'aoro-gym[bench]'"


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
    lacks: str = ""
    """What this computer has not that it takes; then it is left out."""


def guards(device: str) -> list[Guard]:
    """Those of a device, also those that this computer cannot measure."""
    return _of_cpu() if on_cpu(device) else _of_gpu(device)


def _of_cpu() -> list[Guard]:
    step = partial(environments, 1, ground="plane", threads=1)
    one = partial(twins, 64, ground="raster", threads=1)
    return [
        Guard("a step of an environment in kernels over array operations", step, partial(step, kernels=False), 2.0),
        Guard("64 twins on lanes over one after the other", partial(one, device=SIMD), one, 2.0, _compiler()),
        Guard(
            "64 twins over the vehicle in MuJoCo", one, partial(peers.mujoco, 64, threads=1), 2.5,
            _package("mujoco", BENCH),
        ),
    ]  # fmt: skip


def _of_gpu(device: str) -> list[Guard]:
    share = devices.find(device).sm_count / PROCESSORS
    few, full = round(4096 * share), round(32_768 * share)
    many = partial(twins, full, ground="raster", device=device)
    some = partial(twins, few, ground="raster", device=device)
    step = partial(environments, few, device=device, output="torch")
    home = partial(environments, few, device=device)
    worlds = {"worlds": round(8192 * share), "device": device}
    torch = "" if calculates_on_gpus() else "a torch that knows this GPU, and array-api-compat"
    mujoco_warp = _package("mujoco_warp", BENCH) or _package("mujoco", BENCH)
    count, whole = len(devices.several(ALL_GPUS)), partial(twins, 4 * full, ground="raster")
    return [
        Guard(
            f"{full:,} twins over 64", many, partial(twins, 64, ground="raster", device=device), 50.0 * share
        ),
        Guard(
            f"{few:,} twins by roles over one thread each", partial(some, roles=True), partial(some, roles=False), 1.3
        ),
        Guard(
            f"a step of {few:,} environments in kernels over array operations", step, partial(step, kernels=False), 4.0,
            torch,
        ),
        Guard(
            f"NumPy's arrays of {few:,} environments in kernels over array operations", home,
            partial(home, kernels=False), 3.0, torch,
        ),
        Guard("twins over the vehicle in MuJoCo Warp", many, partial(peers.mujoco_warp, **worlds), 12.0, mujoco_warp),
        # MuJoCo Warp, and copies to and from Newton's states: no faster than that (R)
        Guard(
            "twins over the vehicle in Newton", many, partial(newton, **worlds), 12.0,
            mujoco_warp or _package("newton", peers.NEWTON),
        ),
        Guard(
            f"{4 * full:,} twins on {count} GPUs over one", partial(whole, device=ALL_GPUS),
            partial(whole, device=device), 0.9 * count, "" if count > 1 else "a second GPU",
        ),
    ]  # fmt: skip


def _package(name: str, how: str) -> str:
    """The package, if it is not installed, and ``how`` to get it."""
    return "" if find_spec(name) is not None else f"{name} ({how})"


def _compiler() -> str:
    try:
        cpp_compiler()
    except ValueError:
        return "a C++ compiler (g++ or clang++)"
    return ""


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
        ``machine``, the computer, ``guards`` with ``name``, ``ratio``, ``least`` and ``passes``, and ``left_out`` with
        ``name`` and ``lacks``. A guard whose measurement failed has no ratio, does not pass, and has an ``error``.
    """
    known = guards(device)
    found, rows = [guard for guard in known if not guard.lacks], []
    for number, guard in enumerate(found):

        def tell(share: float, name: str = guard.name, number: int = number) -> None:
            if progress is not None:
                progress(name, (number + share) / len(found))

        tell(0.0)
        row = {"name": guard.name, "ratio": None, "least": guard.least, "passes": False}
        try:
            ratio = _ratio(guard, machine, seconds, tell)
            row |= {"ratio": ratio, "passes": ratio >= guard.least}
        except (RuntimeError, ValueError) as error:  # the others are measured nonetheless
            row["error"] = " ".join(str(error).split())
        rows.append(row)
    left_out = [{"name": guard.name, "lacks": guard.lacks} for guard in known if guard.lacks]
    return {"machine": computer(device), "guards": rows, "left_out": left_out}


def _ratio(guard: Guard, machine: Machine, seconds: float, tell: Callable[[float], None]) -> float:
    """Rate of the faster way over that of the other."""
    subjects = [make(machine=machine) for make in (guard.fast, guard.slow)]
    fast, slow = measure(subjects, seconds=seconds, progress=lambda what, share: tell(share))
    rate = "steps_per_core_s" if "steps_per_core_s" in fast else "steps_per_s"
    return fast[rate] / slow[rate]
