"""How the reference controllers got their gains: within an environment, one budget and one objective for all of them.

A :class:`Study` is what the controllers of one environment have in common: the episodes, the same for every candidate, what
an episode costs, and the budget: generations of candidates by SciPy's differential evolution, seeded; a generation is one
batch of twins. Gains are reported on other episodes than they were tuned on:

    python -m aoro_gym.agents.training.tuning --env AORO/PathTracking-v0

``AORO/Turning-v0``: the mean return of 8 episodes with the default reward and sensor noise; 17 generations of 24 candidates.
``AORO/PathTracking-v0``: see :func:`tracking_cost`; 6 pieces of paths, 20 s each, from anywhere on the default forests'
paths; 7 generations of 10 candidates, of which one was chosen by hand.
``AORO/PathTracking-v1``: see :func:`limit_cost`; 8 whole paths, 28 s each; 7 generations of 16 candidates.
``AORO/Levelling-v0``: what the mean reward of 8 pieces of lanes, 15 s each, lacks to 1; 7 generations of 16 candidates.
``AORO/ForestRun-v0``: see :func:`return_cost`; the first 40 s of 8 runs; 7 generations of 16 candidates.
``AORO/Loading-v0``: see :func:`return_cost`; 8 logs, 40 s each; 4 generations of 8 candidates.

On two cores this takes some minutes an environment. The result is the default of each controller.
"""

from __future__ import annotations

import argparse
import json
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray
from scipy.optimize import differential_evolution

from aoro_gym.agents.controllers.forest_run import ForestDriver, LidarPlanner, StraightAhead
from aoro_gym.agents.controllers.levelling import Assistance, ModalPid, ModalRegulator, PreviewPid, Stance
from aoro_gym.agents.controllers.loading import Loader, WaypointLoader
from aoro_gym.agents.controllers.path_tracking import (
    FullSpeedSteering,
    PreviewDriver,
    PreviewRegulator,
    PurePursuit,
    Stanley,
    Vehicle,
)
from aoro_gym.agents.controllers.turning import BangBang, ProportionalDerivative
from aoro_gym.agents.evaluation.forest_run import run_forests
from aoro_gym.agents.evaluation.levelling import level_lanes
from aoro_gym.agents.evaluation.loading import load_logs
from aoro_gym.agents.evaluation.path_tracking import drive_limits
from aoro_gym.agents.evaluation.responses import responses, rollout
from aoro_gym.agents.policies.policy import Policy
from aoro_gym.envs.core.vector import TwinVectorEnv
from aoro_gym.envs.forest_run import config as forest_run
from aoro_gym.envs.forest_run.environment import ForestRunVectorEnv
from aoro_gym.envs.levelling import config as levelling
from aoro_gym.envs.levelling.environment import LevellingVectorEnv
from aoro_gym.envs.limit_tracking import config as limits
from aoro_gym.envs.limit_tracking.environment import LimitTrackingVectorEnv
from aoro_gym.envs.loading import config as loading
from aoro_gym.envs.loading.environment import LoadingVectorEnv
from aoro_gym.envs.path_tracking.config import FIXED, MILD, PathTrackingRandomisation
from aoro_gym.envs.path_tracking.environment import PathTrackingVectorEnv
from aoro_gym.envs.turning.config import TurningConfig
from aoro_gym.envs.turning.environment import TurningVectorEnv

TUNING_SEED, TEST_SEED = 10_000, 20_000
"""Seed of the first of the episodes to tune on, and to report on."""
FAILURE = 1.0
"""What an episode that ends badly costs, as a root mean square cross-track error [m]."""
VALVE_TRAVEL = 0.05
"""What a change of the steering signal by 1 in every step would cost, likewise [m]: a full stroke of the valve every second
is worth 2.5 mm."""
ANYWHERE = replace(MILD, start=(0.0, 0.6), lateral_offset=FIXED.lateral_offset, heading_offset=FIXED.heading_offset)
"""Pieces of paths to tune on, each with another machine of the commissioned spread: gains shall not fit one alone."""


@dataclass(frozen=True)
class Tunable:
    """A controller and the ranges of its gains."""

    make: Callable[..., Policy]
    """Of an environment, and gains by name, each of shape (num_envs,)."""
    bounds: Mapping[str, tuple[float, float]]
    logarithmic: tuple[str, ...] = ()
    """Gains that are searched by their logarithm."""
    start: Mapping[str, float] = field(default_factory=dict)
    """Gains of one candidate of the first generation, all or none."""


@dataclass(frozen=True)
class Study:
    """What all controllers of an environment are tuned by."""

    controllers: Mapping[str, Tunable]
    make: Callable[[int, str], Any]
    """Vector environment of so many sub-environments on a device."""
    cost: Callable[[Any, Policy, list[int], int], NDArray[np.float64]]
    """Of one episode of each sub-environment (N,), from their seeds and the control steps."""
    report: Callable[[Callable[[Any], Policy], str], dict[str, float]]
    """Metrics of a policy, made from an environment, on a device."""
    episodes: int
    """A candidate."""
    steps: int
    """Control steps an episode."""
    population: int
    """Candidates a generation."""
    generations: int
    """How many, after the first."""


def tune(
    name: str,
    env: str = "AORO/Turning-v0",
    *,
    population: int | None = None,
    generations: int | None = None,
    episodes: int | None = None,
    steps: int | None = None,
    seed: int = 0,
    device: str = "cpu",
    progress: Callable[[int, float], Any] = lambda generation, cost: None,
) -> dict[str, float]:
    """Gains of the least mean cost.

    Args:
        name: Of the controller.
        env: Key of :data:`STUDIES`.
        population: Instead of the study's; likewise ``generations``, ``episodes`` and ``steps``.
        generations: See there.
        episodes: See there.
        steps: See there.
        seed: Of the search.
        device: Of the twins.
        progress: Called with the generation and the least mean cost so far.
    """
    study = STUDIES[env]
    controller = study.controllers[name]
    population = population or study.population
    episodes = episodes or study.episodes
    steps = steps or study.steps
    vector = study.make(population * episodes, device)
    seeds = [TUNING_SEED + i % episodes for i in range(vector.num_envs)]
    logarithmic = np.isin(list(controller.bounds), controller.logarithmic)
    low, high = np.array(list(controller.bounds.values())).T
    low, high = (np.where(logarithmic, np.log(np.where(logarithmic, edge, 1.0)), edge) for edge in (low, high))
    best, generation = math.inf, 0

    def gains_of(place: NDArray[np.float64]) -> dict[str, Any]:
        values = np.where(logarithmic, np.exp(np.where(logarithmic, place.T, 0.0)), place.T).T
        return dict(zip(controller.bounds, values, strict=True))

    def loss(candidates: NDArray[np.float64]) -> NDArray[np.float64]:
        nonlocal best, generation
        gains = gains_of(np.repeat(candidates, episodes, axis=1))
        costs = study.cost(vector, controller.make(vector, **gains), seeds, steps).reshape(-1, episodes).mean(axis=1)
        best = min(best, float(costs.min()))
        progress(generation, best)
        generation += 1
        return costs

    rng = np.random.default_rng(seed)
    first: Any = low + (high - low) * rng.random((population, len(low)))
    if controller.start:
        by_hand = np.array([controller.start[key] for key in controller.bounds])
        first[0] = np.where(logarithmic, np.log(np.where(logarithmic, by_hand, 1.0)), by_hand)
    found = differential_evolution(
        loss,
        list(zip(low, high, strict=True)),
        init=first,
        maxiter=study.generations if generations is None else generations,
        rng=rng,
        vectorized=True,
        updating="deferred",
        polish=False,
        tol=0.0,
    )
    return {key: float(value) for key, value in gains_of(found.x).items()}


# ---- AORO/Turning-v0 -------------------------------------------------------------------------------------------------


def _turning_env(num_envs: int, device: str) -> TurningVectorEnv:
    return TurningVectorEnv(num_envs, autoreset_mode="Disabled", device=device)


def turning_cost(env: TurningVectorEnv, policy: Policy, seeds: list[int], steps: int) -> NDArray[np.float64]:
    """The return, negative (N,)."""
    return -rollout(env, policy, seed=seeds, steps=steps).returns


def turning_report(make: Callable[[Any], Policy], device: str = "cpu") -> dict[str, float]:
    """Metrics of a policy over 64 episodes; ``make`` makes it from the environment."""
    env = _turning_env(64, device)
    run = rollout(env, make(env), seed=TEST_SEED)
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


# ---- AORO/PathTracking-v0 --------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Drives:
    """The first episode of each of N sub-environments; arrays of shape (N,), SI."""

    cross_track_rms: NDArray[np.float64]
    cross_track_max: NDArray[np.float64]
    speed: NDArray[np.float64]
    """Mean [m/s]."""
    valve_travel: NDArray[np.float64]
    """Mean change of the steering signal a step [-]."""
    ending: list[str]
    """Why the episode terminated; empty if it did not."""
    success: NDArray[np.bool_]

    @property
    def failed(self) -> NDArray[np.bool_]:
        """Whether an episode terminated before the path's end."""
        return np.array([bool(reason) for reason in self.ending]) & ~self.success


def drive(env: PathTrackingVectorEnv, policy: Policy, seeds: list[int] | int, steps: int | None = None) -> Drives:
    """Drive every sub-environment through one episode, or through its first ``steps`` control steps.

    Args:
        env: Made with ``autoreset_mode="SameStep"``; what follows the first episode does not count.
        policy: Who drives; reset first.
        seeds: Of sub-environment 0, or one each.
        steps: Largest number of control steps; by default until all episodes have ended.
    """
    if env.autoreset_mode is not AutoresetMode.SAME_STEP:
        raise ValueError(f"autoreset_mode is {env.autoreset_mode.value!r}, but a comparison needs 'SameStep'")
    n = env.num_envs
    policy.reset()
    observations, infos = env.reset(seed=seeds)
    running, last = np.ones(n, dtype=bool), np.zeros(n)
    count, squares, largest, speed, travel = (np.zeros(n) for _ in range(5))
    ending, success = [""] * n, np.zeros(n, dtype=bool)
    step = 0
    while running.any() and (steps is None or step < steps):
        actions = policy(observations)
        observations, _, terminated, truncated, infos = env.step(actions)
        step += 1
        ended = running & (terminated | truncated)
        for i in np.flatnonzero(ended):
            ending[i] = infos["final_info"]["termination"][i] if terminated[i] else ""
            success[i] = infos["final_info"]["is_success"][i]
        running &= ~ended
        error = np.abs(infos["cross_track"])
        count += running
        squares += running * error**2
        largest = np.maximum(largest, running * error)
        speed += running * env.output("speed")
        travel += running * np.abs(actions[:, 0] - last)
        last = actions[:, 0]
    count = np.maximum(count, 1.0)
    return Drives(np.sqrt(squares / count), largest, speed / count, travel / count, ending, success)


def _tracking_env(
    num_envs: int, device: str, randomisation: PathTrackingRandomisation = FIXED
) -> PathTrackingVectorEnv:
    return PathTrackingVectorEnv(num_envs, randomisation=randomisation, device=device, autoreset_mode="SameStep")


def tracking_cost(env: PathTrackingVectorEnv, policy: Policy, seeds: list[int], steps: int) -> NDArray[np.float64]:
    """Root mean square cross-track error [m], and a little for the valve's travel, and much for failure (N,)."""
    run = drive(env, policy, seeds, steps)
    return run.cross_track_rms + VALVE_TRAVEL * run.valve_travel + FAILURE * run.failed


def tracking_report(make: Callable[[Any], Policy], device: str = "cpu") -> dict[str, float]:
    """Metrics of a policy over 12 whole paths; ``make`` makes it from the environment."""
    env = _tracking_env(12, device)
    run = drive(env, make(env), TEST_SEED)
    return {
        "cross_track_rms_m": float(np.sqrt((run.cross_track_rms**2).mean())),
        "cross_track_rms_worst_m": float(run.cross_track_rms.max()),
        "cross_track_max_m": float(run.cross_track_max.max()),
        "speed_m_per_s": float(run.speed.mean()),
        "valve_travel": float(run.valve_travel.mean()),
        "success_rate": float(run.success.mean()),
    }


# ---- AORO/PathTracking-v1 --------------------------------------------------------------------------------------------

ANY_MACHINE = replace(
    limits.MILD, start=(0.0, 0.0), lateral_offset=limits.FIXED.lateral_offset, heading_offset=(0.0, 0.0)
)
"""Whole paths to tune on, each with another machine of the commissioned spread."""


def _limit_env(
    num_envs: int, device: str, randomisation: limits.LimitRandomisation = limits.FIXED
) -> LimitTrackingVectorEnv:
    return LimitTrackingVectorEnv(num_envs, randomisation=randomisation, device=device, autoreset_mode="SameStep")


def limit_cost(env: LimitTrackingVectorEnv, policy: Policy, seeds: list[int], steps: int) -> NDArray[np.float64]:
    """1 without success, and the share of the path that was not driven (N,)."""
    policy.reset()
    observations, infos = env.reset(seed=seeds)
    whole, left = infos["remaining"], infos["remaining"].copy()
    running, success = np.ones(env.num_envs, dtype=bool), np.zeros(env.num_envs, dtype=bool)
    for _ in range(steps):
        observations, _, terminated, truncated, infos = env.step(policy(observations))
        ended = running & (terminated | truncated)
        if ended.any():
            left = np.where(ended, infos["final_info"]["remaining"], left)
            success |= ended & infos["final_info"]["is_success"]
        running &= ~ended
        if not running.any():
            break
    return 1.0 - success + left / whole


def limit_report(make: Callable[[Any], Policy], device: str = "cpu") -> dict[str, float]:
    """Mean metrics of a policy over the 40 paths that it was tuned on; ``make`` makes it from the environment."""
    env = LimitTrackingVectorEnv(40, device=device, autoreset_mode="Disabled")
    run = drive_limits(env, make(env), list(range(TEST_SEED, TEST_SEED + 40)))
    return {name: float(np.nanmean(values)) for name, values in run.metrics.items()}


# ---- AORO/Levelling-v0 -----------------------------------------------------------------------------------------------

ANY_LANE = replace(levelling.MILD, lateral_offset=FIXED.lateral_offset, heading_offset=FIXED.heading_offset)
"""Lanes to tune on, likewise."""


def _levelling_env(
    num_envs: int, device: str, randomisation: levelling.LevellingRandomisation = levelling.FIXED
) -> LevellingVectorEnv:
    return LevellingVectorEnv(num_envs, randomisation=randomisation, device=device, autoreset_mode="SameStep")


def levelling_cost(env: LevellingVectorEnv, policy: Policy, seeds: list[int], steps: int) -> NDArray[np.float64]:
    """What the mean reward a step lacks to 1 (N,)."""
    total, count = _rewarded(env, policy, seeds, steps)
    return 1.0 - total / count


def _rewarded(
    env: Any, policy: Policy, seeds: list[int], steps: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Sum of the rewards of each first episode, or of its first ``steps`` control steps, and how many steps it had (N,)."""
    policy.reset()
    observations, _ = env.reset(seed=seeds)
    running, total, count = np.ones(env.num_envs, dtype=bool), np.zeros(env.num_envs), np.zeros(env.num_envs)
    for _ in range(steps):
        observations, rewards, terminated, truncated, _ = env.step(policy(observations))
        total += running * rewards
        count += running
        policy.reset(terminated | truncated)
        running &= ~(terminated | truncated)
    return total, count


def levelling_report(make: Callable[[Any], Policy], device: str = "cpu") -> dict[str, float]:
    """Mean metrics of a policy over 40 whole lanes; ``make`` makes it from the environment."""
    env = LevellingVectorEnv(40, device=device, autoreset_mode="Disabled")
    run = level_lanes(env, make(env), list(range(TEST_SEED, TEST_SEED + 40)))
    return {name: float(values.mean()) for name, values in run.metrics.items()}


# ---- AORO/ForestRun-v0 -----------------------------------------------------------------------------------------------


def _forest_env(num_envs: int, device: str) -> ForestRunVectorEnv:
    return ForestRunVectorEnv(num_envs, randomisation=forest_run.MILD, device=device, autoreset_mode="SameStep")


def return_cost(env: TwinVectorEnv, policy: Policy, seeds: list[int], steps: int) -> NDArray[np.float64]:
    """The return, negative, in units of 100 (N,)."""
    return -_rewarded(env, policy, seeds, steps)[0] / 100.0


def forest_report(make: Callable[[Any], Policy], device: str = "cpu") -> dict[str, float]:
    """Mean metrics of a policy over 40 whole runs, those of the worlds to learn in."""
    env = ForestRunVectorEnv(40, device=device, autoreset_mode="Disabled")
    run = run_forests(env, make(env), list(range(TEST_SEED, TEST_SEED + 40)))
    return {name: float(np.nanmean(values)) for name, values in run.metrics.items()}


def _for_forest(kind: Callable[..., Policy]) -> Callable[..., Policy]:
    return lambda env, **gains: kind(ForestDriver.of(env), **gains)


_PURSUIT_BOUNDS = {"look_ahead": (1.0, 4.0), "gain": (1.0, 6.0), "drive_signal": (0.5, 1.0)}
_PURSUIT_START = {"look_ahead": 2.0, "gain": 2.0, "drive_signal": 0.66}


# ---- AORO/Loading-v0 -------------------------------------------------------------------------------------------------


def _loading_env(num_envs: int, device: str) -> LoadingVectorEnv:
    return LoadingVectorEnv(num_envs, randomisation=loading.MILD, device=device, autoreset_mode="SameStep")


def loading_report(make: Callable[[Any], Policy], device: str = "cpu") -> dict[str, float]:
    """Mean metrics of a policy over 40 logs, those to learn on."""
    env = LoadingVectorEnv(40, device=device, autoreset_mode="Disabled")
    run = load_logs(env, make(env), list(range(TEST_SEED, TEST_SEED + 40)))
    return {name: float(np.nanmean(values)) for name, values in run.metrics.items()}


def _for_crane(env: Any, **gains: Any) -> Policy:
    return WaypointLoader(Loader.of(env), **gains)


_WAYPOINTS = Tunable(
    _for_crane,
    {"gain": (0.2, 2.0), "damping": (0.0, 0.8), "ramp": (0.0, 3.0), "slow": (0.2, 0.8)},
    logarithmic=("gain", "slow"),
    start={"gain": 0.5, "damping": 0.3, "ramp": 2.1, "slow": 0.4},
)


def _for_path(kind: Callable[..., Policy]) -> Callable[..., Policy]:
    return lambda env, **gains: kind(Vehicle.of(env), **gains)


def _for_arms(kind: Callable[..., Policy]) -> Callable[..., Policy]:
    return lambda env, **gains: kind(Stance.of(env), **gains)


_PID_BOUNDS = {
    "level_gain": (0.5, 50.0),
    "level_time": (-0.1, 0.3),
    "level_integral": (0.01, 10.0),
    "share_gain": (0.2, 10.0),
    "share_integral": (0.01, 5.0),
    "height_gain": (0.05, 3.0),
    "rest": (0.005, 0.2),
}
_PID_START = {
    "level_gain": 5.0,
    "level_time": 0.05,
    "level_integral": 0.5,
    "share_gain": 1.5,
    "share_integral": 0.5,
    "height_gain": 1.0,
    "rest": 0.05,
}
_PID_LOGARITHMIC = ("level_gain", "level_integral", "share_gain", "share_integral", "height_gain", "rest")

_PREVIEW_BOUNDS = {"heading_weight": (0.01, 5.0), "rate_weight": (0.005, 1.0), "lag": (0.03, 0.3)}
_PREVIEW_START = {"heading_weight": 0.0207, "rate_weight": 0.0617, "lag": 0.0323}
_PREVIEW_LOGARITHMIC = ("heading_weight", "rate_weight", "lag")

STUDIES = {
    "AORO/Turning-v0": Study(
        {
            "bang-bang": Tunable(
                lambda env, **gains: BangBang(env.observation_layout, **gains),
                {"threshold": (math.radians(0.1), math.radians(5.0)), "lead_time": (0.0, 0.5)},
            ),
            "proportional-derivative": Tunable(
                lambda env, **gains: ProportionalDerivative(env.observation_layout, **gains),
                {
                    "gain": (0.5, 20.0),
                    "lead_time": (0.0, 0.5),
                    "dead_band_left": (0.0, 0.2),
                    "dead_band_right": (0.0, 0.2),
                    "rest_error": (0.0, math.radians(2.0)),
                },
            ),
        },
        make=_turning_env,
        cost=turning_cost,
        report=turning_report,
        episodes=8,
        steps=500,
        population=24,
        generations=16,
    ),
    "AORO/PathTracking-v0": Study(
        {
            "pure-pursuit": Tunable(
                _for_path(PurePursuit),
                {"look_ahead": (0.8, 4.0), "gain": (1.0, 10.0), "lead_time": (0.0, 0.3), "rest_error": (0.002, 0.05)},
                logarithmic=("look_ahead", "gain", "rest_error"),
                start={"look_ahead": 2.0, "gain": 4.0, "lead_time": 0.1, "rest_error": 0.01},
            ),
            "stanley": Tunable(
                _for_path(Stanley),
                {
                    "heading_gain": (0.5, 10.0),
                    "cross_track_gain": (0.1, 4.0),
                    "look_ahead": (0.0, 2.0),
                    "gain": (1.0, 10.0),
                    "rest_error": (0.002, 0.05),
                },
                logarithmic=("heading_gain", "cross_track_gain", "gain", "rest_error"),
                start={
                    "heading_gain": 2.0,
                    "cross_track_gain": 0.5,
                    "look_ahead": 0.3,
                    "gain": 4.0,
                    "rest_error": 0.01,
                },
            ),
            "preview": Tunable(
                _for_path(PreviewRegulator),
                {
                    "heading_weight": (0.01, 5.0),
                    "rate_weight": (0.005, 1.0),
                    "lag": (0.03, 0.3),
                    "rest_rate": (0.005, 0.2),
                },
                logarithmic=("heading_weight", "rate_weight", "lag", "rest_rate"),
                start={"heading_weight": 0.5, "rate_weight": 0.1, "lag": 0.12, "rest_rate": 0.01},
            ),
            "bang-bang": Tunable(
                _for_path(FullSpeedSteering),
                {"look_ahead": (0.6, 4.0), "lead_time": (0.0, 0.3), "rest_error": (0.01, 0.4)},
                logarithmic=("look_ahead", "rest_error"),
                start={"look_ahead": 2.5, "lead_time": 0.1, "rest_error": 0.05},
            ),
        },
        make=lambda num_envs, device: _tracking_env(num_envs, device, ANYWHERE),
        cost=tracking_cost,
        report=tracking_report,
        episodes=12,
        steps=400,
        population=20,  # 768,000 control steps in all, as many as the packaged policy learns from
        generations=7,
    ),
    "AORO/PathTracking-v1": Study(
        {
            "pure-pursuit": Tunable(
                _for_path(PurePursuit),
                {"drive_signal": (0.5, 1.0), "look_ahead": (0.8, 4.0), "gain": (1.0, 10.0), "lead_time": (0.0, 0.3)},
                logarithmic=("look_ahead", "gain"),
                start={"drive_signal": 0.7, "look_ahead": 0.891, "gain": 1.04, "lead_time": 0.0212},
            ),
            "stanley": Tunable(
                _for_path(Stanley),
                {
                    "drive_signal": (0.5, 1.0),
                    "heading_gain": (0.5, 10.0),
                    "cross_track_gain": (0.1, 4.0),
                    "look_ahead": (0.0, 2.0),
                    "gain": (1.0, 10.0),
                },
                logarithmic=("heading_gain", "cross_track_gain", "gain"),
                start={
                    "drive_signal": 0.7,
                    "heading_gain": 7.98,
                    "cross_track_gain": 1.09,
                    "look_ahead": 0.404,
                    "gain": 1.04,
                },
            ),
            "preview": Tunable(
                _for_path(PreviewRegulator),
                {"drive_signal": (0.5, 1.0), **_PREVIEW_BOUNDS},
                logarithmic=_PREVIEW_LOGARITHMIC,
                start={"drive_signal": 0.7, **_PREVIEW_START},
            ),
            "preview-speed": Tunable(
                _for_path(PreviewDriver),
                {
                    **_PREVIEW_BOUNDS,
                    "largest_rate": (0.3, 1.5),
                    "braking": (0.3, 2.0),
                    "climbing": (0.2, 0.6),
                    "fastest": (1.5, 2.3),
                },
                logarithmic=(*_PREVIEW_LOGARITHMIC, "largest_rate", "braking", "climbing"),
                start={**_PREVIEW_START, "largest_rate": 0.7, "braking": 0.8, "climbing": 0.34, "fastest": 2.2},
            ),
        },
        make=lambda num_envs, device: _limit_env(num_envs, device, ANY_MACHINE),
        cost=limit_cost,
        report=limit_report,
        episodes=8,
        steps=560,
        population=16,  # at most 502,000 control steps a controller in all
        generations=6,
    ),
    "AORO/Levelling-v0": Study(
        {
            "assistance": Tunable(
                _for_arms(Assistance),
                {
                    "share_gain": (0.2, 10.0),
                    "share_band": (0.005, 0.3),
                    "share_time": (0.0, 0.3),
                    "level_gain": (0.5, 30.0),
                    "level_band": (0.002, 0.06),
                    "height_gain": (0.05, 3.0),
                },
                logarithmic=("share_gain", "share_band", "level_gain", "level_band", "height_gain"),
                start={
                    "share_gain": 1.667,
                    "share_band": 0.06,
                    "share_time": 0.1,
                    "level_gain": 3.0,
                    "level_band": 0.03,
                    "height_gain": 1.0,
                },
            ),
            "modal-pid": Tunable(
                _for_arms(ModalPid),
                _PID_BOUNDS,
                logarithmic=_PID_LOGARITHMIC,
                start=_PID_START,
            ),
            "preview-pid": Tunable(
                _for_arms(PreviewPid),
                {**_PID_BOUNDS, "ahead_gain": (0.0, 1.5), "ahead": (-0.3, 0.6)},
                logarithmic=_PID_LOGARITHMIC,
                start={**_PID_START, "ahead_gain": 0.7, "ahead": 0.1},
            ),
            "modal-lqr": Tunable(
                _for_arms(ModalRegulator),
                {
                    "level_weight": (0.5, 2000.0),
                    "share_weight": (0.02, 100.0),
                    "height_weight": (0.005, 10.0),
                    "rest": (0.005, 0.2),
                },
                logarithmic=("level_weight", "share_weight", "height_weight", "rest"),
                start={"level_weight": 30.0, "share_weight": 3.0, "height_weight": 1.0, "rest": 0.05},
            ),
        },
        make=lambda num_envs, device: _levelling_env(num_envs, device, ANY_LANE),
        cost=levelling_cost,
        report=levelling_report,
        episodes=8,
        steps=300,
        population=16,  # 269,000 control steps a controller in all
        generations=6,
    ),
    "AORO/ForestRun-v0": Study(
        {
            "straight": Tunable(
                _for_forest(StraightAhead), _PURSUIT_BOUNDS, logarithmic=("look_ahead", "gain"), start=_PURSUIT_START
            ),
            "lidar-planner": Tunable(
                _for_forest(LidarPlanner),
                {**_PURSUIT_BOUNDS, "inflation": (1.3, 2.2), "hits": (1.0, 5.0)},
                logarithmic=("look_ahead", "gain"),
                start={**_PURSUIT_START, "inflation": 1.6, "hits": 2.0},
            ),
        },
        make=_forest_env,
        cost=return_cost,
        report=forest_report,
        episodes=8,
        steps=400,
        population=16,  # at most 358,000 control steps a controller in all
        generations=6,
    ),
    "AORO/Loading-v0": Study(
        {"waypoints": _WAYPOINTS, "fast-waypoints": _WAYPOINTS},
        make=_loading_env,
        cost=return_cost,
        report=loading_report,
        episodes=8,
        steps=400,
        population=8,  # 102,000 control steps a controller in all
        generations=3,
    ),
}
"""How the controllers are tuned, by environment."""


def main() -> None:
    """Tune the reference controllers of an environment; print gains and metrics as JSON."""
    parser = argparse.ArgumentParser(description=main.__doc__)
    parser.add_argument("--env", choices=list(STUDIES), default="AORO/Turning-v0")
    parser.add_argument("--device", default="cpu")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--only", metavar="NAME", help="tune this controller only")
    parser.add_argument("--keep", action="store_true", help="report the gains as they are, without tuning")
    arguments = parser.parse_args()
    study = STUDIES[arguments.env]
    if arguments.only not in (None, *study.controllers):
        parser.error(
            f"{arguments.only!r} is no controller of {arguments.env}; choose from: {', '.join(study.controllers)}"
        )
    result = {}
    for name, controller in study.controllers.items():
        if arguments.only not in (None, name):
            continue

        def progress(generation: int, best: float) -> None:
            print(f"generation {generation}: least cost {best:.4g}", flush=True)

        gains = {}
        if not arguments.keep:
            gains = tune(name, arguments.env, seed=arguments.seed, device=arguments.device, progress=progress)
        metrics = study.report(
            lambda env, controller=controller, gains=gains: controller.make(env, **gains), arguments.device
        )
        result[name] = {"gains": gains, "figures": metrics}
    print(json.dumps(result, indent=2))


if __name__ == "__main__":
    main()
