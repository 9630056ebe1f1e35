"""Episodes of ``AORO/PathTracking-v0`` and their metrics."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode

from aoro_gym.agents.evaluation.episodes import TIME_IS_UP, Episodes, reset_arguments
from aoro_gym.agents.evaluation.metrics import OVER, SUCCESS
from aoro_gym.agents.policies.policy import Policy
from aoro_gym.envs.path_tracking.courses import Course, library
from aoro_gym.envs.path_tracking.environment import PathTrackingVectorEnv

STATION = 0.25
"""Distance [m] at which the error of a drive is kept."""
CHANNELS = ("s", "cross_track", "reference_x", "reference_y", "roll", "pitch")
"""Channels of a drive that its metrics and plots need."""


def make_tracking(num_envs: int, courses: Sequence[Course] | None, **arguments: Any) -> PathTrackingVectorEnv:
    return PathTrackingVectorEnv(num_envs, courses=library() if courses is None else courses, **arguments)


def drive_paths(
    env: PathTrackingVectorEnv,
    policy: Policy,
    seeds: list[int],
    tell: Callable[[float], Any] = lambda share: None,
    *,
    asked: list[int] | None = None,
) -> Episodes:
    """Drive every sub-environment through one episode.

    Args:
        env: Made with ``autoreset_mode="Disabled"``.
        policy: Who drives; reset first.
        seeds: One each.
        tell: Called with the share that is done.
        asked: Seeds of what is asked for, where ``seeds`` draw the sensors' errors alone.

    Raises ValueError if the environment resets by itself.
    """
    if env.autoreset_mode is not AutoresetMode.DISABLED:
        raise ValueError(f"autoreset_mode is {env.autoreset_mode.value!r}, but an evaluation needs 'Disabled'")
    n = env.num_envs
    rows = [env.task.render_channels.index(name) for name in CHANNELS]
    policy.reset()
    observations, infos = env.reset(**reset_arguments(seeds, asked))
    course, whole = np.stack([infos["terrain"], infos["path"]], axis=1), infos["remaining"]
    running, returns, steps = np.ones(n, dtype=bool), np.zeros(n), np.zeros(n, dtype=np.intp)
    endings, last = [""] * n, {name: np.zeros(n) for name in ("is_success", "mean_speed", "engine_work", "remaining")}
    first = np.array(env.task.traces(), dtype=np.float32)
    kept, film = [first[rows]], [first[:, 0]]
    while running.any():
        observations, rewards, terminated, truncated, infos = env.step(policy(observations))
        returns += running * rewards
        steps += running
        traces = np.asarray(env.task.traces(), dtype=np.float32)
        kept.append(traces[rows])
        if running[0]:
            film.append(traces[:, 0].copy())
        ended = np.asarray(terminated | truncated)
        for i in np.flatnonzero(ended & running):
            endings[i] = infos["termination"][i] if terminated[i] else TIME_IS_UP
            for name, values in last.items():
                values[i] = infos[name][i]
        running &= ~ended
        tell(float(np.where(running, 1.0 - infos["remaining"] / whole, 1.0).mean()))
        if ended.any() and running.any():  # who is done drives on, unseen
            observations, _ = env.reset(options={"reset_mask": ended})
            policy.reset(ended)
    data = dict(zip(CHANNELS, np.array(kept, dtype=np.float64).transpose(1, 2, 0), strict=True))  # (N, 1 + T) each
    tilt = np.degrees(np.arccos(np.clip(np.cos(data["roll"]) * np.cos(data["pitch"]), -1.0, 1.0)))
    parts = [slice(1, 1 + count) for count in steps]
    error = [np.abs(data["cross_track"][i, part]) for i, part in enumerate(parts)]
    arrived = last["is_success"].astype(bool)
    metrics = {
        SUCCESS: last["is_success"],
        "cross_track_rms_m": np.array([np.sqrt((e**2).mean()) for e in error]),
        "cross_track_mean_m": np.array([e.mean() for e in error]),
        "cross_track_p95_m": np.array([np.quantile(e, 0.95) for e in error]),
        "speed_m_per_s": last["mean_speed"],
        "energy_kJ": last["engine_work"] / 1e3,
        "worst_tilt_deg": np.array([tilt[i, part].max() for i, part in enumerate(parts)]),
        "driven_m": whole - last["remaining"],
        "duration_s": steps * env.task.control_step,
        "return": returns,
    }
    metrics |= {name: np.where(arrived, values, np.nan) for name, values in metrics.items() if name in OVER}
    stations = STATION * np.arange(1 + math.ceil(float(whole.max()) / STATION))
    errors, places = np.full((n, len(stations)), np.nan), np.full((n, len(stations), 2), np.nan)
    for i, part in enumerate(parts):
        # a vehicle may slide back: the first time that it came so far counts
        ahead = np.maximum.accumulate(data["s"][i, part]) - data["s"][i, 0]
        there = stations <= ahead[-1]
        when = np.searchsorted(ahead, stations[there])
        errors[i, there] = error[i][when]
        for axis, name in enumerate(("reference_x", "reference_y")):
            places[i, there, axis] = data[name][i, part][when]
    return Episodes(metrics, endings, course, errors, places, np.array(film))
