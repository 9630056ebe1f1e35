"""Plans a second of model-predictive path integral control, by task, rollouts and device.

A plan is one update: the copies of the episode are loaded and driven over the horizon, then weighted. The median of several,
by the clock, and by the cores' time, which does not depend on what else a computer does.
``python -m studies.planning_rate --device cpu,cpu:simd --samples 64,256,1024``
"""

import argparse
import json
import os
import time
from dataclasses import replace

import numpy as np

from aoro_gym.agents.controllers.mppi import SETTINGS, Mppi
from aoro_gym.agents.evaluation.tasks import TASKS


def rate(environment: str, device: str, samples: int, repeats: int) -> dict[str, float]:
    """Plans a second by the clock and of a core's time, and how many times as fast as the machine the copies drive by it."""
    env = TASKS[environment].make(1, courses=None, device=device, autoreset_mode="Disabled")
    planner = Mppi(env, replace(SETTINGS[environment], samples=samples))
    observations, _ = env.reset(seed=0)
    wall, busy = [], []
    for _ in range(1 + repeats):  # the first one warms up
        began = time.perf_counter(), time.process_time()
        actions = planner(observations)
        wall.append(time.perf_counter() - began[0])
        busy.append(time.process_time() - began[1])
        observations, *_ = env.step(actions)
    by_clock, of_core = float(np.median(wall[1:])), float(np.median(busy[1:]))
    horizon = planner.settings.horizon * env.task.control_step
    return {
        "plans_per_s": 1.0 / by_clock,
        "plans_per_core_s": 1.0 / of_core,
        "real_time_factor_of_core": samples * horizon / of_core,
        "horizon_s": horizon,
    }


def main() -> None:
    """Print the rates as JSON."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--env", default=",".join(SETTINGS))
    parser.add_argument("--device", default="cpu,cpu:simd")
    parser.add_argument("--samples", default="64,256,1024")
    parser.add_argument("--repeats", type=int, default=5)
    asked = parser.parse_args()
    for environment in asked.env.split(","):
        for device in asked.device.split(","):
            for samples in map(int, asked.samples.split(",")):
                found = rate(environment, device, samples, asked.repeats)
                told = {"env": environment, "device": device, "samples": samples, "cores": os.cpu_count()}
                print(json.dumps(told | {name: round(value, 3) for name, value in found.items()}), flush=True)


if __name__ == "__main__":
    main()
