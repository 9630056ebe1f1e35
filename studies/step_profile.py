"""Where a step's microseconds go: of one twin, and of learning environments in kernels.

Parts are measured in turns, each several times, so that a busy computer slows all alike: on the CPU in processor time of one
thread, on CUDA from one wait for the device to the next. ``python -m studies.step_profile`` writes the table of
docs/evidence/profile.md; ``--device cuda:0 --output torch --envs 4096,65536`` that of a GPU. ``--device cpu:simd`` profiles
twins on lanes of a core.
"""

from __future__ import annotations

import argparse
import copy
import json
import statistics
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from functools import partial
from itertools import cycle
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import warp as wp

from aoro_gym.envs import register_envs
from aoro_gym.terrains import Terrain
from aoro_gym.twin import Twin

ENVIRONMENTS = ("AORO/PathTracking-v0", "AORO/Turning-v0", "AORO/Levelling-v0")
KINDS = {"step": True, "step by array operations": False}
"""Of steps, and whether they are in kernels."""
ROUNDS = 9
"""Turns of each part, whose median counts."""


def timed(parts: Mapping[str, Callable[[], Any]], device: str, seconds: float) -> dict[str, float]:
    """Median time [µs] of a call of each part; about ``seconds`` in all."""
    on_gpu = device.startswith("cuda")
    clock = time.perf_counter if on_gpu else time.process_time

    def spent(call: Callable[[], Any], times: int) -> float:
        if on_gpu:
            wp.synchronize_device(device)
        began = clock()
        for _ in range(times):
            call()
        if on_gpu:
            wp.synchronize_device(device)
        return 1e6 * (clock() - began) / times

    for call in parts.values():
        spent(call, 3)
    share = 1e6 * seconds / len(parts) / ROUNDS
    times = {name: max(1, round(share / max(spent(call, 3), 1.0))) for name, call in parts.items()}
    rounds: dict[str, list[float]] = {name: [] for name in parts}
    for _ in range(ROUNDS):
        for name, call in parts.items():
            rounds[name].append(spent(call, times[name]))
    return {name: statistics.median(values) for name, values in rounds.items()}


def one_twin(device: str, seconds: float) -> dict[str, float]:
    """Of a main step of 1 ms on a level raster."""
    ground = Terrain.from_heights([[0.0] * 200] * 200, cell=0.25)
    twin = Twin(terrain=ground, device=device)
    recorded, long = twin.advancing(0.001), twin.advancing(0.05)
    signal = {"steering_signal": 0.5}
    twin.set_commands(signal)
    parts = {
        "fifty steps in a launch": lambda: long(0, 1),
        "recorded launch": lambda: recorded(0, 1),
        "advance(0.001)": lambda: twin.advance(0.001),
        "step(commands, 0.001)": lambda: twin.step(signal, 0.001),
        "step(commands, 0.001, sample_every=0.001)": lambda: twin.step(signal, 0.001, sample_every=0.001),
    }
    found = timed(parts, device, seconds)
    found["a step of fifty"] = found.pop("fifty steps in a launch") / 50.0
    return found


def environment(
    name: str, count: int, device: str, output: str, seconds: float, kinds: Iterable[str] = KINDS
) -> dict[str, float]:
    """Of a control step of ``count`` sub-environments under random actions, whose episodes end by themselves.

    Args:
        name: Of the environment.
        count: Of sub-environments.
        device: Of the twins.
        output: ``"numpy"`` or ``"torch"``.
        seconds: Measured, about.
        kinds: Of steps, some of :data:`KINDS`.
    """
    rng, parts = np.random.default_rng(0), {}
    for kind in kinds:
        kernels = KINDS[kind]
        env: Any = gymnasium.make_vec(
            name, num_envs=count, device=device, output=output, autoreset_mode="SameStep", kernels=kernels
        ).unwrapped
        env.twin.threads = 1
        env.reset(seed=0)
        space = env.single_action_space
        given = [rng.uniform(space.low, space.high, (count, *space.shape)).astype(np.float32) for _ in range(16)]
        actions = cycle([env.handed_out.asarray(each, env.handed_out.xp.float32) for each in given])
        env.step(next(actions))
        parts[kind] = lambda env=env, actions=actions: env.step(next(actions))
        if env._kernel_step is not None:  # a copy: episodes of the environment would end where nobody sees it
            other = copy.deepcopy(env)
            advanced, act = other._in_kernels(), next(actions)
            parts["twins"] = partial(other.twin.advance, other.task.control_step, sample_every=other.task.sample_step)
            parts["twins and kernels"] = partial(advanced.run, other.arrays.asarray(act, other.arrays.xp.float32))
        _settle(env, actions)  # after the copy, before which what was drawn is given back
    found = timed(parts, device, seconds)
    if device.startswith("cuda") and env._kernel_step is not None:
        found["from a launch until its flags are there, episodes ending"] = _launched(env, actions)
    return found


def _launched(env: Any, actions: Iterator[Any], count: int = 200) -> float:
    """Mean time [µs] of ``count`` steps that a GPU takes for what it is asked for before the host waits."""
    times = []
    for _ in range(count):
        env.step(next(actions))
        times.append(1e6 * env._kernel_step.seconds)
    return statistics.mean(times)


def _settle(env: Any, actions: Iterator[Any]) -> None:
    """Step until as many episodes are drawn ahead as will be; the first steps draw many."""
    before, following = -1, env._next
    while following is not None and following.ready.sum() > before and not following.ready.all():
        before = following.ready.sum()
        env.step(next(actions))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--env", choices=ENVIRONMENTS, help="this one alone; by default all, and one twin")
    parser.add_argument("--device", default="cpu")
    parser.add_argument("--output", choices=["numpy", "torch"], default="numpy")
    parser.add_argument("--envs", default="1,64", help="numbers of sub-environments, by commas")
    parser.add_argument("--kernels-only", action="store_true", help="no steps by array operations beside")
    parser.add_argument("--seconds", type=float, default=3.0, help="measured for each case, about")
    parser.add_argument("--json", type=Path, help="file for the rows")
    asked = parser.parse_args()
    wp.config.log_level = wp.LOG_ERROR
    register_envs()
    rows: list[dict[str, Any]] = []

    def found(what: str, parts: Mapping[str, float]) -> None:
        rows.append({"what": what, **parts})
        print("\n".join([what, *(f"  {value:12.1f} µs  {part}" for part, value in parts.items())]), flush=True)
        if asked.json is not None:
            asked.json.write_text(json.dumps(rows, indent=1), encoding="utf-8")

    if asked.env is None:
        found("one twin", one_twin(asked.device, asked.seconds))
    kinds = ["step"] if asked.kernels_only else KINDS
    for name in [asked.env] if asked.env else ENVIRONMENTS:
        for count in map(int, asked.envs.split(",")):
            parts = environment(name, count, asked.device, asked.output, asked.seconds, kinds)
            found(f"{count} x {name}", parts)


if __name__ == "__main__":
    main()
