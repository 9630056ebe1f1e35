"""How the reference controllers got their gains: one budget and one objective for all of them.

Objective: mean return over :data:`EPISODES` seeded episodes of ``AORO/Turning-v0`` with its default reward and sensor
noise, the same episodes for every candidate. Budget: :data:`GENERATIONS` generations of :data:`POPULATION` candidates by
SciPy's differential evolution, seeded; a generation is one batch of twins. Gains are reported on other episodes than they
were tuned on:

    python -m aoro_gym.agents.tuning

On two cores this takes some minutes. The result is the default of each controller.
"""

from __future__ import annotations

import argparse
import json
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import differential_evolution

from aoro_gym.agents.controllers import BangBang, Policy, ProportionalDerivative
from aoro_gym.agents.responses import EPISODE_STEPS, responses, rollout
from aoro_gym.envs.turning import TurningConfig, TurningVectorEnv

EPISODES = 8
POPULATION = 24
GENERATIONS = 16
TUNING_SEED, TEST_SEED = 10_000, 20_000
"""Seed of the first of the episodes to tune on, and to report on."""
TEST_EPISODES = 64


@dataclass(frozen=True)
class Tunable:
    """A controller and the ranges of its gains."""

    make: Callable[..., Policy]
    bounds: Mapping[str, tuple[float, float]]


CONTROLLERS = {
    "bang-bang": Tunable(
        BangBang,
        {"threshold": (math.radians(0.1), math.radians(5.0)), "lead_time": (0.0, 0.5)},
    ),
    "proportional-derivative": Tunable(
        ProportionalDerivative,
        {
            "gain": (0.5, 20.0),
            "lead_time": (0.0, 0.5),
            "dead_band_left": (0.0, 0.2),
            "dead_band_right": (0.0, 0.2),
            "rest_error": (0.0, math.radians(2.0)),
        },
    ),
}
"""What is tuned, by name."""


def tune(
    name: str,
    *,
    population: int = POPULATION,
    generations: int = GENERATIONS,
    episodes: int = EPISODES,
    steps: int = EPISODE_STEPS,
    seed: int = 0,
    device: str = "cpu",
    progress: Callable[[int, float], Any] | None = None,
) -> dict[str, float]:
    """Gains that reach the highest mean return.

    Args:
        name: Key of :data:`CONTROLLERS`.
        population: Candidates a generation.
        generations: How many, after the first.
        episodes: Episodes a candidate.
        steps: Control steps an episode.
        seed: Of the search.
        device: Of the twins.
        progress: Called with the generation and the best mean return so far.
    """
    controller = CONTROLLERS[name]
    env = TurningVectorEnv(population * episodes, autoreset_mode="Disabled", device=device)
    seeds = [TUNING_SEED + i % episodes for i in range(env.num_envs)]
    best, generation = -math.inf, 0

    def loss(candidates: NDArray[np.float64]) -> NDArray[np.float64]:
        nonlocal best, generation
        gains = {key: np.repeat(row, episodes) for key, row in zip(controller.bounds, candidates, strict=True)}
        run = rollout(env, controller.make(env.observation_layout, **gains), seed=seeds, steps=steps)
        returns = run.returns.reshape(-1, episodes).mean(axis=1)
        best = max(best, float(returns.max()))
        if progress is not None:
            progress(generation, best)
        generation += 1
        return -returns

    rng = np.random.default_rng(seed)
    low, high = np.array(list(controller.bounds.values())).T
    found = differential_evolution(
        loss,
        list(controller.bounds.values()),
        init=low + (high - low) * rng.random((population, len(low))),
        maxiter=generations,
        rng=rng,
        vectorized=True,
        updating="deferred",
        polish=False,
        tol=0.0,
    )
    return {key: float(value) for key, value in zip(controller.bounds, found.x, strict=True)}


def report(policy: Callable[[Mapping[str, slice]], Policy], *, device: str = "cpu") -> dict[str, float]:
    """Figures of a policy over :data:`TEST_EPISODES` episodes; ``policy`` makes it from the observation's layout."""
    env = TurningVectorEnv(TEST_EPISODES, autoreset_mode="Disabled", device=device)
    run = rollout(env, policy(env.observation_layout), seed=TEST_SEED)
    found = responses(run, tolerance=TurningConfig().tolerance)
    return {
        "return": float(run.returns.mean()),
        "success_rate": float(run.success.mean()),
        "rise_time_s": float(np.nanmean(found["rise_time"])),
        "overshoot_mean_deg": math.degrees(found["overshoot"].mean()),
        "overshoot_95_deg": math.degrees(float(np.quantile(found["overshoot"], 0.95))),
        "settling_time_s": float(np.nanmean(found["settling_time"])),
        "settled_share": float(np.isfinite(found["settling_time"]).mean()),
        "final_error_deg": math.degrees(found["final_error"].mean()),
    }


def main() -> None:
    """Tune every controller and print its gains and figures as JSON."""
    parser = argparse.ArgumentParser(description=main.__doc__)
    parser.add_argument("--device", default="cpu")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--only", choices=list(CONTROLLERS))
    parser.add_argument("--keep", action="store_true", help="report the gains as they are, without tuning")
    arguments = parser.parse_args()
    result = {}
    for name, controller in CONTROLLERS.items():
        if arguments.only not in (None, name):
            continue

        def progress(generation: int, best: float) -> None:
            print(f"generation {generation}: best return {best:.1f}", flush=True)

        gains = {}
        if not arguments.keep:
            gains = tune(name, seed=arguments.seed, device=arguments.device, progress=progress)
        make = controller.make
        figures = report(lambda layout, make=make, gains=gains: make(layout, **gains), device=arguments.device)
        result[name] = {"gains": gains, "figures": figures}
    print(json.dumps(result, indent=2))


if __name__ == "__main__":
    main()
