"""Problems whose recordings and predictions are made of numbers, for tests that need no twin."""

from collections.abc import Mapping

import numpy as np

from aoro_gym.diagnosis.linear import Linear
from aoro_gym.diagnosis.noise import Floats, ModelError, Noise
from aoro_gym.diagnosis.nuisances import Nuisances
from aoro_gym.diagnosis.problem import Problem, References
from aoro_gym.diagnosis.recording import Recording
from aoro_gym.machine import Machine
from tests.diagnosis.manoeuvres import turn

MACHINE = Machine.load("aoro")
STD = {"joint_angle": 1e-3, "pressure_a": 0.3e5}
"""Of white noise, SI."""


def problem_of(
    channels: Mapping[str, Mapping[str, Floats]],
    *,
    level: float = 0.6,
    std: Mapping[str, float] = STD,
    references: References | None = None,
) -> Problem:
    """Recordings with given ``channels`` by name, all of one turn, in white noise; the twin has no error of its own."""
    recordings = []
    for name, values in channels.items():
        commands = turn(level, 0.01 * (len(values["joint_angle"]) - 1))
        recordings.append(
            Recording(name, commands, {k: np.array(v, dtype=np.float64) for k, v in values.items()}, 60, 0.0)
        )
    longest = max(len(values["joint_angle"]) for values in channels.values())
    noise = {name: Noise(np.r_[one**2, np.zeros(longest)]) for name, one in std.items()}
    nuisances = Nuisances(MACHINE, "day")
    return Problem(recordings, nuisances, {}, error=ModelError(0.0, 0.0), noise=noise, references=references)


def linear_of(problem: Problem, slopes: Floats) -> Linear:
    """Of a prediction of zero with the ``slopes`` (D, n) SI of the first n nuisances."""
    problem.predicted = np.zeros(len(problem.measured))
    problem.slopes = slopes
    problem.felt = np.arange(slopes.shape[1])
    problem.centre = np.zeros(slopes.shape[1] + problem.own(problem.predicted).shape[1])
    return Linear(problem, problem.error)
