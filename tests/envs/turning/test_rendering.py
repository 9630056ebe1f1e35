"""Pictures of turning: their shape, and that they show what happens."""

from typing import Any

import gymnasium
import numpy as np

from aoro_gym.envs import register_envs
from aoro_gym.envs.turning.rendering import SIZE

register_envs()


def test_a_frame_shows_the_machine_and_its_motion():
    env: Any = gymnasium.make("AORO/Turning-v0", render_mode="rgb_array")
    env.reset(seed=0, options={"joint_angle": -0.4, "targets": [0.4]})
    still = env.render()
    assert still.shape == (SIZE, SIZE, 3)
    assert still.dtype == np.uint8
    assert len(np.unique(still.reshape(-1, 3), axis=0)) > 100
    np.testing.assert_array_equal(env.render(), still)
    for _ in range(20):
        env.step(np.ones(1, dtype=np.float32))
    moved = env.render()
    plan, traces = np.s_[:470, :450], np.s_[480:]
    for part in (plan, traces):
        assert np.any(moved[part] != still[part], axis=-1).mean() > 0.002
    env.close()
