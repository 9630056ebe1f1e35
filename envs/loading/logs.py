"""Logs to load, by seed and difficulty: where they lie beside the machine, and what they weigh.

>>> from aoro_gym.envs.loading.logs import log_site
>>> site = log_site(3, difficulty=0.5)
>>> len(site.logs), round(site.logs[0].mass)
(5, 146)
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from aoro_gym.checks import check_integer, check_range
from aoro_gym.envs.core.splits import Splits

LOGS = 5
"""Logs of a site."""
DENSITY = (750.0, 950.0)
"""Green wood with bark [kg/m³] (R: spruce to birch)."""


@dataclass(frozen=True)
class GroundLog:
    """A log on level ground, in the axes of the machine at its start: x ahead of the hinge, y left."""

    x: float
    """Of its middle [m]."""
    y: float
    yaw: float
    """Of its axis against x [rad]."""
    length: float
    """[m]"""
    diameter: float
    """[m]"""
    density: float
    """[kg/m³]"""

    @property
    def mass(self) -> float:
        """[kg]"""
        return 0.25 * math.pi * self.diameter**2 * self.length * self.density


@dataclass(frozen=True)
class LogSite:
    """Logs beside one machine, to load one an episode."""

    logs: tuple[GroundLog, ...]
    name: str = "site"

    def __post_init__(self) -> None:
        if not self.logs:
            raise ValueError("logs are empty; give a site at least one log")


def log_site(seed: int, difficulty: float = 1.0) -> LogSite:
    """Five logs beside the machine; the same for the same seed and difficulty.

    Args:
        seed: Of the logs, at least 0.
        difficulty: In [0, 1]: at 0 logs of 100 kg lie along the machine 3.5 m beside it, at 1 logs of up to 400 kg lie
            at any angle, 3 to 5.5 m from the crane.

    Raises ValueError naming the argument and its bound.
    """
    check_integer("seed", seed, ge=0)
    check_range("difficulty", difficulty, ge=0.0, le=1.0)
    rng = np.random.default_rng([seed, round(1000 * difficulty)])
    logs = tuple(_log(rng, difficulty) for _ in range(LOGS))
    return LogSite(logs, f"logs {seed}, difficulty {difficulty:g}")


def _log(rng: np.random.Generator, difficulty: float) -> GroundLog:
    side = rng.choice([-1.0, 1.0])
    y = rng.uniform(3.5 - 0.3 * difficulty, 3.5 + 1.3 * difficulty)
    x = rng.uniform(-1.0, 1.0) * (0.3 + 1.2 * difficulty)
    return GroundLog(
        x=float(x),
        y=float(side * y),
        yaw=float(rng.uniform(-1.0, 1.0) * difficulty * math.radians(40.0)),
        length=float(rng.uniform(3.0, 3.0 + 1.2 * difficulty)),
        diameter=float(rng.uniform(0.22, 0.24 + 0.1 * difficulty)),
        density=float(rng.uniform(*DENSITY)),
    )


SPLITS: Splits[LogSite] = Splits(log_site, least_difficulty=0.0)
"""Sites to learn on, to validate trainings on, and held out: 40 sites with 200 logs."""
learned_sites, validation_sites, held_out_sites = SPLITS.learned, SPLITS.validation, SPLITS.held_out
