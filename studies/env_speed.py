"""Environment steps a second, where their time goes, and how many kernels a step launches.

Machines, starts and sensors are randomised (``MILD``), actions are random and change every step, episodes end and begin
anew. The shares come from a second run in which the device is waited for around every part: with ``--output torch`` their
sum is more than a step, in which host and device work at the same time. One H200:
``python -m studies.env_speed --device cuda:0 --output torch --envs 4096,32768``. With ``--world`` path tracking drives on
the same paths in a world with its solid objects, on that ground without them, and so on by turns.
"""

import argparse
import json
import statistics
import time
import warnings
from collections import defaultdict
from collections.abc import Callable, Sequence
from itertools import count, product
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import warp as wp

from aoro_gym.envs import register_envs
from aoro_gym.envs.forest_run import config as forest_run
from aoro_gym.envs.levelling import config as levelling
from aoro_gym.envs.limit_tracking import config as limit_tracking
from aoro_gym.envs.loading import config as loading
from aoro_gym.envs.path_tracking import config as path_tracking
from aoro_gym.envs.path_tracking.courses import Course, generated_paths
from aoro_gym.envs.turning import config as turning
from aoro_gym.terrains.world.files import load_world

ENVIRONMENTS = {
    "AORO/PathTracking-v0": path_tracking.MILD,
    "AORO/PathTracking-v1": limit_tracking.MILD,
    "AORO/Turning-v0": turning.MILD,
    "AORO/Levelling-v0": levelling.MILD,
    "AORO/ForestRun-v0": forest_run.MILD,
    "AORO/Loading-v0": loading.MILD,
}
"""By id, with what varies from episode to episode."""


class Shares:
    """Wall time [s] of parts of an environment's step, without the parts that they call in turn."""

    def __init__(self, env: Any):
        self.spent: defaultdict[str, float] = defaultdict(float)
        self._device = env.twin.device
        self._inside: list[float] = []  # [s] spent in parts that the running ones called
        task = env.task
        sensors = [part for part in vars(task).values() if type(part).__module__.startswith("aoro_gym.sensors")]
        for name, part, methods in (
            ("twin", env.twin, ["advance"]),
            ("resets", env, ["_start"]),
            ("task", task, ["commands", "advance", "endings", "overdue", "renew", "info", "view"]),
            *(("sensors", sensor, ["measure", "update"]) for sensor in sensors),
        ):
            for method in methods:
                if hasattr(part, method):
                    setattr(part, method, self._timed(name, getattr(part, method)))

    def _timed(self, name: str, call: Callable[..., Any]) -> Callable[..., Any]:
        def timed(*arguments: Any, **named: Any) -> Any:
            wp.synchronize_device(self._device)
            self._inside.append(0.0)
            began = time.perf_counter()
            result = call(*arguments, **named)
            wp.synchronize_device(self._device)
            whole = time.perf_counter() - began
            self.spent[name] += whole - self._inside.pop()
            if self._inside:
                self._inside[-1] += whole
            return result

        return timed

    def of(self, step: Callable[[], Any], steps: int) -> dict[str, float]:
        """Milliseconds a step of every part, and of what is none of them."""
        self.spent.clear()
        whole = self._timed("vector", step)
        for _ in range(steps):
            whole()
        return {f"{name}_ms": spent / steps * 1e3 for name, spent in self.spent.items()}


def launches(env: Any, step: Callable[[], Any]) -> dict[str, Any]:
    """Kernels and copies that one step gives to a GPU, and where the host waits for it: once, in ``arrays.py``, where no
    episode ends. On a CPU the operators of torch that would be kernels."""
    import torch  # pyright: ignore[reportMissingImports]
    from torch.utils._python_dispatch import TorchDispatchMode  # pyright: ignore[reportMissingImports]

    if env.twin.device.is_cuda:
        from torch.profiler import ProfilerActivity, profile  # pyright: ignore[reportMissingImports]

        with profile(activities=[ProfilerActivity.CUDA]) as profiled:
            step()
            torch.cuda.synchronize()
        names = [event.name for event in profiled.events() or () if "CUDA" in str(event.device_type)]
        copies = sum(name.startswith(("Memcpy", "Memset")) for name in names)
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            torch.cuda.set_sync_debug_mode("warn")
            step()
            torch.cuda.set_sync_debug_mode("default")
        waits = [f"{Path(one.filename).name}:{one.lineno}" for one in caught if "synchron" in str(one.message)]
        return {"kernels": len(names) - copies, "copies": copies, "waits": waits}

    class Operators(TorchDispatchMode):
        def __init__(self) -> None:
            super().__init__()
            self.count = 0

        def __torch_dispatch__(self, func: Any, types: Any, args: Any = (), kwargs: Any = None) -> Any:
            self.count += not func.is_view
            return func(*args, **(kwargs or {}))

    with Operators() as operators:
        step()
    return {"operators": operators.count}


def measure(asked: argparse.Namespace, num_envs: int, ground: Course | None = None) -> dict[str, Any]:
    """One row: steps a second of all sub-environments on a ``ground``, by default the environment's own, median of ``runs``
    that last ``seconds`` in all."""
    name, device, output, runs = asked.env, asked.device, asked.output, asked.runs
    given: dict[str, Any] = {} if ground is None else {"courses": [ground]}
    began = time.perf_counter()
    made: Any = gymnasium.make_vec(
        name,
        num_envs=num_envs,
        device=device,
        output=output,
        randomisation=ENVIRONMENTS[name],
        **given,
        observation_terms=dict.fromkeys(asked.terms, True),
    )
    built = time.perf_counter()
    env = made.unwrapped
    env.reset(seed=0)
    started = time.perf_counter()
    rng = np.random.default_rng(0)
    schedule = [
        env.handed_out.asarray(rng.uniform(-1.0, 1.0, env.action_space.shape), env.handed_out.xp.float32)
        for _ in range(16)
    ]
    turn, ended = count(), 0

    def step() -> None:
        nonlocal ended
        _, _, _, _, infos = env.step(schedule[next(turn) % len(schedule)])
        if "_final_info" in infos:
            ended += int(infos["_final_info"].sum())

    def run(steps: int) -> float:
        wp.synchronize_device(device)
        start = time.perf_counter()
        for _ in range(steps):
            step()
        wp.synchronize_device(device)
        return time.perf_counter() - start

    steps = 2
    while (spent := run(steps)) < asked.seconds / runs:
        steps *= 2
    ended = 0
    worked = time.process_time()
    spent = [run(steps) for _ in range(runs)]
    worked = time.process_time() - worked
    rates = [num_envs * steps / one for one in spent]
    ends = ended / (runs * steps)
    row = {
        "environment": name,
        "device": env.twin.device.name,
        "output": output,
        "terms": asked.terms,
        "objects": ground is not None and ground.world is not None,
        "columns": env.single_observation_space.shape[0],
        "envs": num_envs,
        "steps_per_s": statistics.median(rates),
        "steps_per_cpu_s": num_envs * steps * runs / worked,
        "min": min(rates),
        "max": max(rates),
        "step_ms": statistics.median(spent) / steps * 1e3,
        "episodes_ended_per_step": ends,
        "build_s": built - began,
        "reset_s": started - built,
    }
    if output == "torch":
        row |= launches(env, step)
    return row | Shares(env).of(step, steps)


def grounds(asked: argparse.Namespace) -> Sequence[Course | None]:
    """What to drive on, one after the other."""
    if asked.world is None:
        return [None]
    made = load_world(asked.world)
    paths = generated_paths(made)
    return asked.turns * [Course.over(made, paths), Course(made.terrain, paths)]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--env", choices=list(ENVIRONMENTS), default="AORO/PathTracking-v0")
    parser.add_argument("--device", default="cpu")
    parser.add_argument("--envs", default="64,1024", help="numbers of sub-environments, by commas")
    parser.add_argument("--output", choices=["numpy", "torch"], default="numpy")
    parser.add_argument("--seconds", type=float, default=3.0, help="measured for each number, at least")
    parser.add_argument("--runs", type=int, default=5)
    parser.add_argument("--terms", nargs="*", default=[], help="terms that cast rays: lidar, height_map, depth, camera")
    parser.add_argument("--world", type=Path, help="folder of 'aoro-gym world'")
    parser.add_argument("--turns", type=int, default=3, help="with --world, of each ground")
    parser.add_argument("--json", type=Path, help="file for the rows")
    asked = parser.parse_args()
    wp.config.log_level = wp.LOG_ERROR
    register_envs()
    rows = []
    for num_envs, ground in product(map(int, asked.envs.split(",")), grounds(asked)):
        rows.append(measure(asked, num_envs, ground))
        print(
            json.dumps({k: float(f"{v:.4g}") if isinstance(v, float) else v for k, v in rows[-1].items()}), flush=True
        )
        if asked.json is not None:
            asked.json.write_text(json.dumps(rows, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
