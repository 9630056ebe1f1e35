"""Episodes of ``AORO/Loading-v0`` and their metrics."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray

from aoro_gym.agents.evaluation.episodes import TIME_IS_UP, Episodes, reset_arguments
from aoro_gym.agents.evaluation.metrics import OVER, SUCCESS
from aoro_gym.agents.policies.policy import Policy
from aoro_gym.envs.loading.environment import LoadingVectorEnv
from aoro_gym.envs.loading.logs import LogSite, held_out_sites
from aoro_gym.envs.loading.task import PLACED

EVERY = 0.5
"""Distance [s] at which what is left is kept."""


def make_loading(num_envs: int, courses: Sequence[LogSite] | None, **arguments: Any) -> LoadingVectorEnv:
    return LoadingVectorEnv(num_envs, courses=held_out_sites() if courses is None else courses, **arguments)


def every_log(courses: Sequence[LogSite], seeds: Sequence[int]) -> NDArray[np.intp]:
    """Site and log (N, 2) of each seed: as many seeds in a row as there are logs load each once."""
    logs = np.array([(number, log) for number, site in enumerate(courses) for log in range(len(site.logs))])
    # neighbours are far apart, so that few seeds, too, see easy and difficult logs
    stride = next(k for k in range(round(0.382 * len(logs)) or 1, 2 * len(logs) + 2) if np.gcd(k, len(logs)) == 1)
    return logs[np.asarray(seeds) * stride % len(logs)]


def load_logs(
    env: LoadingVectorEnv,
    policy: Policy,
    seeds: list[int],
    tell: Callable[[float], Any] = lambda share: None,
    *,
    asked: list[int] | None = None,
) -> Episodes:
    """Load one log a sub-environment, each that of its seed.

    Args:
        env: Made with ``autoreset_mode="Disabled"``.
        policy: Who loads; reset first.
        seeds: One each.
        tell: Called with the share that is done.
        asked: Seeds of what is asked for, where ``seeds`` draw the sensors' errors alone.

    Raises ValueError if the environment resets by itself.
    """
    if env.autoreset_mode is not AutoresetMode.DISABLED:
        raise ValueError(f"autoreset_mode is {env.autoreset_mode.value!r}, but an evaluation needs 'Disabled'")
    n, chosen = env.num_envs, every_log(env.task.sites, asked or seeds)
    policy.reset()
    observations, infos = env.reset(**reset_arguments(seeds, asked, {"site": chosen[:, 0], "log": chosen[:, 1]}))
    running, returns, steps = np.ones(n, dtype=bool), np.zeros(n), np.zeros(n, dtype=np.intp)
    endings, whole = [""] * n, infos["remaining"]
    last = {name: np.zeros(n) for name in ("is_success", "work", "sway_rms", "largest_sway", "duration")}
    left, film = [np.array(whole)], [np.array(env.traces()[:, 0], dtype=np.float32)]
    while running.any():
        observations, rewards, terminated, truncated, infos = env.step(policy(observations))
        returns += running * rewards
        steps += running
        left.append(np.where(running, infos["remaining"], np.nan))
        if running[0]:
            film.append(np.array(env.traces()[:, 0], dtype=np.float32))
        ended = np.asarray(terminated | truncated)
        for i in np.flatnonzero(ended & running):
            endings[i] = infos["termination"][i] if terminated[i] else TIME_IS_UP
            for name, values in last.items():
                values[i] = infos[name][i]
        running &= ~ended
        tell(float(np.where(running, 1.0 - infos["remaining"] / whole, 1.0).mean()))
        if ended.any() and running.any():  # who is done goes on, unseen
            observations, _ = env.reset(options={"reset_mask": ended})
            policy.reset(ended)
    placed = np.array([ending == PLACED for ending in endings])
    metrics = {
        SUCCESS: last["is_success"],
        "placed_share": placed.astype(np.float64),
        "duration_s": last["duration"],
        "energy_kJ": last["work"] / 1e3,
        "sway_rms_deg": np.degrees(last["sway_rms"]),
        "largest_sway_deg": np.degrees(last["largest_sway"]),
        "return": returns,
    }
    arrived = last["is_success"].astype(bool)
    metrics |= {name: np.where(arrived, values, np.nan) for name, values in metrics.items() if name in OVER}
    every = round(EVERY / env.task.control_step)
    return Episodes(metrics, endings, chosen, np.array(left)[::every].T, np.zeros((n, 0, 2)), np.array(film))
