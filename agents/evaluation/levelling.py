"""Episodes of ``AORO/Levelling-v0`` and their metrics."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode

from aoro_gym.agents.evaluation.episodes import TIME_IS_UP, Episodes, reset_arguments
from aoro_gym.agents.evaluation.metrics import SUCCESS
from aoro_gym.agents.evaluation.path_tracking import STATION
from aoro_gym.agents.policies.policy import Policy
from aoro_gym.envs.levelling.courses import held_out_courses
from aoro_gym.envs.levelling.environment import LevellingVectorEnv
from aoro_gym.envs.path_tracking.courses import Course

CHANNELS = ("s", "reference_x", "reference_y", "roll", "pitch", "unevenness")
"""Channels of a drive that its metrics and plots need."""
LAST = (
    "is_success", "tilt_rms", "unevenness_rms", "lifted_share", "pump_work", "arm_way", "remaining",
)  # fmt: skip
"""What the infos of an episode's last step give."""


def make_levelling(num_envs: int, courses: Sequence[Course] | None, **arguments: Any) -> LevellingVectorEnv:
    return LevellingVectorEnv(num_envs, courses=held_out_courses() if courses is None else courses, **arguments)


def lanes(courses: Sequence[Course], seeds: Sequence[int]) -> dict[str, Any]:
    """Options of a reset that give each seed (N,) a lane: as many seeds in a row as there are lanes drive each once."""
    ground = np.array([number for number, course in enumerate(courses) for _ in course.paths])
    path = np.array([number for course in courses for number in range(len(course.paths))])
    # neighbours are far apart, so that few seeds, too, see easy and difficult grounds
    stride = next(
        k for k in range(round(0.382 * len(ground)) or 1, 2 * len(ground) + 2) if math.gcd(k, len(ground)) == 1
    )
    chosen = np.asarray(seeds) * stride % len(ground)
    return {"terrain": ground[chosen], "path": path[chosen]}


def level_lanes(
    env: LevellingVectorEnv,
    policy: Policy,
    seeds: list[int],
    tell: Callable[[float], Any] = lambda share: None,
    *,
    asked: list[int] | None = None,
) -> Episodes:
    """Drive every sub-environment through one episode, each on the lane of its seed.

    Args:
        env: Made with ``autoreset_mode="Disabled"``.
        policy: Who levels; reset first.
        seeds: One each.
        tell: Called with the share that is done.
        asked: Seeds of what is asked for, where ``seeds`` draw the sensors' errors alone.

    Raises ValueError if the environment resets by itself.
    """
    if env.autoreset_mode is not AutoresetMode.DISABLED:
        raise ValueError(f"autoreset_mode is {env.autoreset_mode.value!r}, but an evaluation needs 'Disabled'")
    n = env.num_envs
    rows = [env.task.render_channels.index(name) for name in CHANNELS]
    arguments = reset_arguments(seeds, asked)
    arguments["options"] = arguments.get("options", {}) | lanes(env.task.courses, seeds if asked is None else asked)
    policy.reset()
    observations, infos = env.reset(**arguments)
    course, whole = np.stack([infos["terrain"], infos["path"]], axis=1), infos["remaining"]
    running, returns, steps = np.ones(n, dtype=bool), np.zeros(n), np.zeros(n, dtype=np.intp)
    endings, last = [""] * n, {name: np.zeros(n) for name in LAST}
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
    driven = whole - last["remaining"]
    metrics = {
        SUCCESS: last["is_success"],
        "tilt_rms_deg": np.degrees(last["tilt_rms"]),
        "tilt_p95_deg": np.array([np.quantile(tilt[i, part], 0.95) for i, part in enumerate(parts)]),
        "largest_tilt_deg": np.array([tilt[i, part].max() for i, part in enumerate(parts)]),
        "unevenness_rms": last["unevenness_rms"],
        "unevenness_p95": np.array([np.quantile(data["unevenness"][i, part], 0.95) for i, part in enumerate(parts)]),
        "lifted_share": last["lifted_share"],
        "pump_kJ_per_m": last["pump_work"] / 1e3 / np.maximum(driven, 0.1),
        "arm_way_m_per_m": last["arm_way"] / np.maximum(driven, 0.1),
        "driven_m": driven,
        "return": returns,
    }
    stations = STATION * np.arange(1 + math.ceil(float(whole.max()) / STATION))
    errors, places = np.full((n, len(stations)), np.nan), np.full((n, len(stations), 2), np.nan)
    for i, part in enumerate(parts):
        # a vehicle may slide back: the first time that it came so far counts
        ahead = np.maximum.accumulate(data["s"][i, part]) - data["s"][i, 0]
        there = stations <= ahead[-1]
        when = np.searchsorted(ahead, stations[there])
        errors[i, there] = tilt[i, part][when]
        for axis, name in enumerate(("reference_x", "reference_y")):
            places[i, there, axis] = data[name][i, part][when]
    return Episodes(metrics, endings, course, errors, places, np.array(film))
