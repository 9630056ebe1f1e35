"""Pictures of levelling show its own readings."""

from typing import Any

import numpy as np

from aoro_gym.envs.levelling.config import ARM_SIGNALS
from aoro_gym.envs.levelling.environment import LevellingVectorEnv
from aoro_gym.envs.levelling.rendering import LevellingScene
from aoro_gym.envs.levelling.task import Levelling
from aoro_gym.envs.path_tracking.rendering.scene import MAP_HEIGHT, SIZE, VIEW

BARS = slice(MAP_HEIGHT + 90, MAP_HEIGHT + 150), slice(VIEW, None)
"""Rows and columns of the arms' bars."""


def test_arms_and_unevenness_are_drawn():
    env: Any = LevellingVectorEnv(1, render_mode="rgb_array", autoreset_mode="Disabled")
    env.reset(seed=0)
    env.step(np.zeros((1, 4), dtype=np.float32))
    (picture,) = env.render()
    assert picture.shape == (SIZE[1], SIZE[0], 3)
    scene = LevellingScene(env.twin.machine, env.task.driving, Levelling.render_channels)
    columns = {name: i for i, name in enumerate(Levelling.render_channels)}
    row = np.zeros((1, len(columns)), dtype=np.float32)
    still = scene.draw(row)
    for name in ARM_SIGNALS:
        moved = row.copy()
        moved[0, columns[f"signal_{name}"]] = 0.8
        changed = np.any(scene.draw(moved) != still, axis=-1)
        assert changed[BARS].sum() == changed.sum() > 100, name  # its bar and nothing else
    row[0, columns["unevenness"]] = 0.3
    changed = np.any(scene.draw(row) != still, axis=-1)
    assert changed[:, VIEW:].sum() == changed.sum() > 100
