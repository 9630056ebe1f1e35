"""Drives along paths to their ends, of which tasks take their own metrics."""

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
from aoro_gym.envs.path_tracking.courses import Course

STATION = 0.25
"""Distance [m] at which the error of a drive is kept."""


@dataclass(frozen=True)
class Drives:
    """What N sub-environments did until the last of them was done.

    Attributes:
        course: Which course, and which of its paths (N, 2).
        whole: Length of the path at the start [m] (N,).
        returns: Sums of rewards (N,).
        steps: Control steps (N,).
        endings: Why each ended (N,).
        last: Infos of each one's last step, by name (N,).
        data: Channels by name (N, 1 + T), which go on after an episode has ended.
        film: All channels of the first sub-environment (frames, channels).
    """

    course: NDArray[np.intp]
    whole: Floats
    returns: Floats
    steps: NDArray[np.intp]
    endings: list[str]
    last: Mapping[str, Floats]
    data: Mapping[str, Floats]
    film: NDArray[np.float32]

    @property
    def parts(self) -> list[slice]:
        """Of ``data``: the steps of each episode (N,)."""
        return [slice(1, 1 + count) for count in self.steps]

    @property
    def tilt(self) -> Floats:
        """Angle [deg] of the front frame's upward axis to the vertical (N, 1 + T)."""
        upright = np.cos(self.data["roll"]) * np.cos(self.data["pitch"])
        return np.degrees(np.arccos(np.clip(upright, -1.0, 1.0)))

    def at_stations(self, errors: Sequence[Floats], along: str = "s") -> tuple[Floats, Floats]:
        """Errors (N, K) and places (N, K, 2) [m] at every :data:`STATION`, NaN beyond the end.

        Args:
            errors: Of the steps of each episode (N,), as long as its part.
            along: Channel [m] that says how far each has come.
        """
        farthest = max(float(np.ptp(self.data[along][i, : part.stop])) for i, part in enumerate(self.parts))
        stations = STATION * np.arange(1 + math.ceil(max(float(self.whole.max()), farthest) / STATION))
        n = len(self.steps)
        found, places = np.full((n, len(stations)), np.nan), np.full((n, len(stations), 2), np.nan)
        for i, part in enumerate(self.parts):
            # a vehicle may slide back: the first time that it came so far counts
            ahead = np.maximum.accumulate(self.data[along][i, part]) - self.data[along][i, 0]
            there = stations <= ahead[-1]
            when = np.searchsorted(ahead, stations[there])
            found[i, there] = errors[i][when]
            for axis, name in enumerate(("reference_x", "reference_y")):
                places[i, there, axis] = self.data[name][i, part][when]
        return found, places


def every_path(courses: Sequence[Course], seeds: Sequence[int]) -> dict[str, Any]:
    """Options of a reset that give each seed (N,) a path: as many seeds in a row as there are paths drive each once."""
    ground = np.array([number for number, course in enumerate(courses) for _ in course.paths])
    path = np.array([number for course in courses for number in range(len(course.paths))])
    # neighbours are far apart, so that few seeds, too, see easy and difficult grounds
    stride = next(
        k for k in range(round(0.382 * len(ground)) or 1, 2 * len(ground) + 2) if math.gcd(k, len(ground)) == 1
    )
    chosen = np.asarray(seeds) * stride % len(ground)
    return {"terrain": ground[chosen], "path": path[chosen]}


def drive_to_ends(
    env: TwinVectorEnv,
    policy: Policy,
    reset: Mapping[str, Any],
    tell: Callable[[float], Any],
    *,
    channels: Sequence[str],
    last: Sequence[str],
) -> Drives:
    """Drive every sub-environment through one episode.

    Args:
        env: Of a task along paths, made with ``autoreset_mode="Disabled"``.
        policy: Who drives; reset first.
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
    course, whole = np.stack([infos["terrain"], infos["path"]], axis=1), infos["remaining"]
    running, returns, steps = np.ones(n, dtype=bool), np.zeros(n), np.zeros(n, dtype=np.intp)
    endings, ends = [""] * n, {name: np.zeros(n) for name in last}
    first = np.array(env.traces(), dtype=np.float32)
    kept, film = [first[rows]], [first[:, 0]]
    while running.any():
        observations, rewards, terminated, truncated, infos = env.step(policy(observations))
        returns += running * rewards
        steps += running
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
        if ended.any() and running.any():  # who is done drives on, unseen
            observations, _ = env.reset(options={"reset_mask": ended})
            policy.reset(ended)
    data = dict(zip(channels, np.array(kept, dtype=np.float64).transpose(1, 2, 0), strict=True))  # (N, 1 + T) each
    return Drives(course, whole, returns, steps, endings, ends, data, np.array(film))
