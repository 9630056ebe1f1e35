"""Episodes of ``AORO/Loading-v0`` and their metrics."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from aoro_gym.agents.evaluation.episodes import Episodes, reset_arguments
from aoro_gym.agents.evaluation.metrics import OVER, SUCCESS
from aoro_gym.agents.evaluation.runs import run_to_ends, spread
from aoro_gym.agents.policies.policy import Policy
from aoro_gym.envs.loading.environment import LoadingVectorEnv
from aoro_gym.envs.loading.logs import LogSite, held_out_sites
from aoro_gym.envs.loading.task import PLACED

EVERY = 0.5
"""Distance [s] at which what is left is kept."""
LAST = ("is_success", "work", "sway_rms", "largest_sway", "duration")
"""What the infos of an episode's last step give."""


def make_loading(num_envs: int, courses: Sequence[LogSite] | None, **arguments: Any) -> LoadingVectorEnv:
    return LoadingVectorEnv(num_envs, courses=held_out_sites() if courses is None else courses, **arguments)


def every_log(courses: Sequence[LogSite], seeds: Sequence[int]) -> NDArray[np.intp]:
    """Site and log (N, 2) of each seed: as many seeds in a row as there are logs load each once."""
    logs = np.array([(number, log) for number, site in enumerate(courses) for log in range(len(site.logs))])
    return logs[spread(seeds, len(logs))]


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
    chosen = every_log(env.task.sites, asked or seeds)
    arguments = reset_arguments(seeds, asked, {"site": chosen[:, 0], "log": chosen[:, 1]})
    runs = run_to_ends(env, policy, arguments, tell, channels=("remaining",), last=LAST)
    last, left = runs.last, runs.data["remaining"]
    placed = np.array([ending == PLACED for ending in runs.endings])
    metrics = {
        SUCCESS: last["is_success"],
        "placed_share": placed.astype(np.float64),
        "duration_s": last["duration"],
        "energy_kJ": last["work"] / 1e3,
        "sway_rms_deg": np.degrees(last["sway_rms"]),
        "largest_sway_deg": np.degrees(last["largest_sway"]),
        "return": runs.returns,
    }
    arrived = last["is_success"].astype(bool)
    metrics |= {name: np.where(arrived, values, np.nan) for name, values in metrics.items() if name in OVER}
    every = round(EVERY / env.task.control_step)
    left = np.where(np.arange(left.shape[1]) <= runs.steps[:, None], left, np.nan)[:, ::every]
    return Episodes(metrics, runs.endings, chosen, left, np.zeros((len(left), 0, 2)), runs.film)
