"""One episode of every sub-environment, until the last of them is done."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray

from aoro_gym.agents.evaluation.episodes import TIME_IS_UP
from aoro_gym.agents.evaluation.statistics import Floats
from aoro_gym.agents.policies.policy import Policy
from aoro_gym.envs.core.vector import TwinVectorEnv


@dataclass(frozen=True)
class Runs:
    """What N sub-environments did until the last of them was done.

    Attributes:
        first: Infos of the reset.
        returns: Sums of rewards (N,).
        steps: Control steps (N,).
        endings: Why each ended (N,).
        last: Infos of each one's last step, by name (N,).
        data: Channels by name (N, 1 + T), which go on after an episode has ended.
        film: All channels of the first sub-environment (frames, channels).
        rut_depth: Mean depth of the ruts below the wheels over each episode [m] (N,); None on hard ground.
    """

    first: Mapping[str, Any]
    returns: Floats
    steps: NDArray[np.intp]
    endings: list[str]
    last: Mapping[str, Floats]
    data: Mapping[str, Floats]
    film: NDArray[np.float32]
    rut_depth: Floats | None

    @property
    def on_soil(self) -> dict[str, Floats]:
        """The metric of drives on soil; none on hard ground."""
        return {} if self.rut_depth is None else {"rut_depth_m": self.rut_depth}

    @property
    def whole(self) -> Floats:
        """What remains at the start [m] (N,): of a drive, the length of its path."""
        return self.first["remaining"]

    @property
    def parts(self) -> list[slice]:
        """Of ``data``: the steps of each episode (N,)."""
        return [slice(1, 1 + count) for count in self.steps]


def spread(seeds: Sequence[int], count: int) -> NDArray[np.intp]:
    """Which of ``count`` each seed (N,) is given: as many seeds in a row are given each once."""
    # neighbours are far apart, so that few seeds, too, see easy and difficult ones
    stride = next(k for k in range(round(0.382 * count) or 1, 2 * count + 2) if math.gcd(k, count) == 1)
    return np.asarray(seeds) * stride % count


def run_to_ends(
    env: TwinVectorEnv,
    policy: Policy,
    reset: Mapping[str, Any],
    tell: Callable[[float], Any],
    *,
    channels: Sequence[str],
    last: Sequence[str],
) -> Runs:
    """Bring every sub-environment through one episode.

    Args:
        env: Made with ``autoreset_mode="Disabled"``.
        policy: Who acts; reset first.
        reset: Arguments of the environment's reset.
        tell: Called with the share that is done.
        channels: Render channels to keep.
        last: Infos of the last step to keep.

    Raises ValueError if the environment resets by itself.
    """
    if env.autoreset_mode is not AutoresetMode.DISABLED:
        raise ValueError(f"autoreset_mode is {env.autoreset_mode.value!r}, but an evaluation needs 'Disabled'")
    n = env.num_envs
    rows = [env.task.render_channels.index(name) for name in channels]
    policy.reset()
    observations, infos = env.reset(**reset)
    start = {name: np.array(values) for name, values in infos.items()}
    whole = start["remaining"]
    running, returns, steps = np.ones(n, dtype=bool), np.zeros(n), np.zeros(n, dtype=np.intp)
    ruts = None if env.twin.soil is None else np.zeros(n)
    endings, ends = [""] * n, {name: np.zeros(n) for name in last}
    first = np.array(env.traces(), dtype=np.float32)
    kept, film = [first[rows]], [first[:, 0]]
    while running.any():
        observations, rewards, terminated, truncated, infos = env.step(policy(observations))
        returns += running * rewards
        steps += running
        if ruts is not None:
            ruts += np.where(running, infos["rut_depth"], 0.0)
        traces = np.asarray(env.traces(), dtype=np.float32)
        kept.append(traces[rows])
        if running[0]:
            film.append(traces[:, 0].copy())
        ended = np.asarray(terminated | truncated)
        for i in np.flatnonzero(ended & running):
            endings[i] = infos["termination"][i] if terminated[i] else TIME_IS_UP
            for name, values in ends.items():
                values[i] = infos[name][i]
        running &= ~ended
        tell(float(np.where(running, 1.0 - infos["remaining"] / whole, 1.0).mean()))
        if ended.any() and running.any():  # who is done goes on, unseen
            observations, _ = env.reset(options={"reset_mask": ended})
            policy.reset(ended)
    data = dict(zip(channels, np.array(kept, dtype=np.float64).transpose(1, 2, 0), strict=True))  # (N, 1 + T) each
    mean = None if ruts is None else ruts / steps
    return Runs(start, returns, steps, endings, ends, data, np.array(film), mean)
