"""What results follow from: a ground by its shape, not by the rounding of the computer that made it."""

import numpy as np

from aoro_gym.agents.evaluation import inputs
from aoro_gym.envs import Course
from aoro_gym.execution.digest import digest
from aoro_gym.terrains import Path, Terrain


def digest_of(shift: float) -> str:
    """Of a course over hilly ground that lies higher by ``shift`` [m]."""
    x, y = np.meshgrid(np.arange(5.0), np.arange(5.0))
    z = 0.3 * np.sin(x) * np.cos(y) + shift
    first = (np.arange(4)[:, None] * 5 + np.arange(4)).ravel()
    faces = np.concatenate([np.stack([first, first + 1, first + 5], 1), np.stack([first + 1, first + 6, first + 5], 1)])
    ground = Terrain(np.stack([x, y, z], axis=-1).reshape(-1, 3), faces)
    return digest(inputs.grounds([Course(ground, (Path(np.array([[1.0, 2.0], [3.0, 2.0]])),))]))


def test_a_ground_is_the_same_on_computers_that_round_otherwise():
    assert digest_of(1e-13) == digest_of(0.0)
    assert digest_of(1e-4) != digest_of(0.0)
