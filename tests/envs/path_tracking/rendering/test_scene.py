"""Pictures of path tracking: their shape, and that they show what happens."""

from typing import Any

import numpy as np

from aoro_gym.envs.path_tracking.environment import PathTrackingVectorEnv
from aoro_gym.envs.path_tracking.rendering.scene import SIZE, VIEW
from tests.envs.path_tracking.paths import LEVEL


def test_path_tracking_shows_the_view_the_map_and_the_strips():
    env: Any = PathTrackingVectorEnv(2, courses=[LEVEL], render_mode="rgb_array", autoreset_mode="Disabled")
    env.reset(seed=0, options={"path": np.array([0, 1])})
    still = env.render()
    assert len(still) == 2
    assert still[0].shape == (SIZE[1], SIZE[0], 3)
    assert len(np.unique(still[0].reshape(-1, 3), axis=0)) > 300
    np.testing.assert_array_equal(env.render()[0], still[0])
    assert np.any(still[0] != still[1], axis=-1).mean() > 0.05  # another path
    for _ in range(60):
        env.step(np.full((2, 2), 0.6, dtype=np.float32))
    moved = env.render()
    for part in (np.s_[:, :VIEW], np.s_[:250, VIEW:], np.s_[450:, VIEW:]):
        assert np.any(moved[0][part] != still[0][part], axis=-1).mean() > 0.001
    env.reset(seed=0, options={"path": np.array([0, 1])})
    np.testing.assert_array_equal(env.render()[0], still[0])
