"""Pictures without a display: one a sub-environment, traces of its episode only, and that a video can be made of them."""

import re
import time
from typing import Any

import gymnasium
import numpy as np
import pytest

from aoro_gym.envs import ENVIRONMENTS, register_envs
from aoro_gym.envs.turning.environment import TurningVectorEnv
from aoro_gym.terrains import Path, Plane

register_envs()


def test_every_sub_environment_has_its_frame():
    env = TurningVectorEnv(2, render_mode="rgb_array")
    env.reset(seed=0)
    env.step(np.array([[1.0], [-1.0]], dtype=np.float32))
    frames = env.render()
    assert frames is not None and len(frames) == 2
    assert np.any(frames[0] != frames[1])


def test_traces_begin_anew_with_the_episode():
    env = TurningVectorEnv(1, render_mode="rgb_array", autoreset_mode="Disabled")
    options = {"joint_angle": 0.2, "targets": [0.3]}
    env.reset(seed=0, options=options)
    first = env.render()
    for _ in range(10):
        env.step(np.ones((1, 1), dtype=np.float32))
    env.reset(seed=0, options=options)
    again = env.render()
    assert first is not None and again is not None
    np.testing.assert_array_equal(again[0], first[0])


def test_lists_of_frames_come_from_gymnasium():
    env: Any = gymnasium.make("AORO/Turning-v0", render_mode="rgb_array_list")
    env.reset(seed=0)
    for _ in range(2):
        env.step(np.zeros(1, dtype=np.float32))
    assert len(env.render()) == 3


def test_human_rendering_says_so_once_where_there_is_no_display(monkeypatch, capsys):
    """Where viser is not installed."""
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr("sys.platform", "linux")
    monkeypatch.setattr("aoro_gym.view.extras.is_installed", lambda: False)
    env: Any = gymnasium.make("AORO/Turning-v0", render_mode="human")
    env.reset(seed=0)
    for _ in range(2):
        env.step(np.zeros(1, dtype=np.float32))
    assert env.render() is None
    env.close()
    said = capsys.readouterr().err
    assert said.count('render_mode="human" needs the part view') == 1


def test_human_rendering_is_a_page(capsys):
    """Ground, path and machine of the first of two, and a picture a step where somebody looks."""
    pytest.importorskip("viser")
    x = np.linspace(-10.0, 10.0, 41)
    env: Any = gymnasium.make_vec(
        "AORO/PathTracking-v0", num_envs=2, render_mode="human", terrain=Plane(), path=Path(np.stack([x, 0.0 * x], 1))
    )
    env.reset(seed=0)
    page = env.unwrapped._renderer._page
    address = re.search(r"the environment is at (http://127\.0\.0\.1:\d+)", capsys.readouterr().err)
    assert address is not None and page.address == address[1]
    page.server.get_clients = lambda: {0: None}
    began = time.monotonic()
    for _ in range(3):
        env.step(np.zeros((2, 2), dtype=np.float32))
    assert time.monotonic() - began > 2 * env.unwrapped.task.control_step, "in real time"
    assert page.frames == 3
    node = page._scene._machines[0]._base
    np.testing.assert_allclose(node.position, env.unwrapped.twin.state.numpy()[:3, 0], atol=1e-6)
    nodes = list(page._nodes)
    env.reset(seed=1)
    assert page._nodes == nodes, "the same ground and path are not drawn again"
    env.close()


def test_rendering_without_a_mode_warns():
    env = TurningVectorEnv(1)
    env.reset()
    with pytest.warns(UserWarning, match='render_mode="rgb_array"'):
        assert env.render() is None


@pytest.mark.parametrize("name", list(ENVIRONMENTS))
def test_a_video_can_be_recorded(tmp_path, name):
    pytest.importorskip("moviepy")
    env: Any = gymnasium.make(name, render_mode="rgb_array")
    env = gymnasium.wrappers.RecordVideo(env, str(tmp_path / "video"), episode_trigger=lambda episode: True)
    env.reset(seed=0)
    for _ in range(5):
        env.step(env.action_space.sample())
    env.close()
    (video,) = (tmp_path / "video").glob("*.mp4")
    assert video.stat().st_size > 1000
