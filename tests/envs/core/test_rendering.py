"""Pictures without a display: their shape, that they show what happens, and that a video can be made of them."""

from typing import Any

import gymnasium
import numpy as np
import pytest

from aoro_gym.envs import ENVIRONMENTS, register_envs
from aoro_gym.envs.core.rendering import SIZE
from aoro_gym.envs.path_tracking.environment import PathTrackingVectorEnv
from aoro_gym.envs.path_tracking.rendering import SIZE as CHASE_SIZE
from aoro_gym.envs.path_tracking.rendering import VIEW, SolidMachine
from aoro_gym.envs.turning.environment import TurningVectorEnv
from tests.envs.path_tracking.paths import LEVEL

register_envs()


def distinct(frame):
    return len(np.unique(frame.reshape(-1, 3), axis=0))


def test_a_frame_shows_the_machine_and_its_motion():
    env: Any = gymnasium.make("AORO/Turning-v0", render_mode="rgb_array")
    env.reset(seed=0, options={"joint_angle": -0.4, "targets": [0.4]})
    still = env.render()
    assert still.shape == (SIZE, SIZE, 3)
    assert still.dtype == np.uint8
    assert distinct(still) > 100
    np.testing.assert_array_equal(env.render(), still)
    for _ in range(20):
        env.step(np.ones(1, dtype=np.float32))
    moved = env.render()
    plan, traces = np.s_[:470, :450], np.s_[480:]
    for part in (plan, traces):
        assert np.any(moved[part] != still[part], axis=-1).mean() > 0.002
    env.close()


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
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr("sys.platform", "linux")
    env: Any = gymnasium.make("AORO/Turning-v0", render_mode="human")
    env.reset(seed=0)
    for _ in range(2):
        env.step(np.zeros(1, dtype=np.float32))
    assert env.render() is None
    env.close()
    said = capsys.readouterr().err
    assert said.count('render_mode="human" needs a display') == 1


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


def test_path_tracking_shows_the_view_the_map_and_the_strips():
    env: Any = PathTrackingVectorEnv(2, courses=[LEVEL], render_mode="rgb_array", autoreset_mode="Disabled")
    env.reset(seed=0, options={"path": np.array([0, 1])})
    still = env.render()
    assert len(still) == 2
    assert still[0].shape == (CHASE_SIZE[1], CHASE_SIZE[0], 3)
    assert distinct(still[0]) > 300
    np.testing.assert_array_equal(env.render()[0], still[0])
    assert np.any(still[0] != still[1], axis=-1).mean() > 0.05  # another path
    for _ in range(60):
        env.step(np.full((2, 2), 0.6, dtype=np.float32))
    moved = env.render()
    for part in (np.s_[:, :VIEW], np.s_[:250, VIEW:], np.s_[450:, VIEW:]):
        assert np.any(moved[0][part] != still[0][part], axis=-1).mean() > 0.001
    env.reset(seed=0, options={"path": np.array([0, 1])})
    np.testing.assert_array_equal(env.render()[0], still[0])


def test_the_solid_machine_has_its_wheels_where_the_twin_has_them(machine):
    solid = SolidMachine(machine)
    rest = [machine.rest.arm_angle_front] * 2 + [machine.rest.arm_angle_rear] * 2
    points, starts, colours, hulls = solid.posed(np.zeros(3), 0.0, 0.0, 0.0, 0.5, rest, [0.0] * 4)
    assert len(starts) == len(colours) + 1 and starts[-1] == len(points)
    radius = machine.tire.radius
    wheels = [hull for hull in hulls if len(hull) == 48]  # two rings of 24
    assert len(wheels) == 4
    for hull, (x, y, turned) in zip(wheels, ((1, 1, 0), (1, -1, 0), (-1, 1, 1), (-1, -1, 1)), strict=True):
        angle = -0.5 * turned  # the front frame points to the left of the rear one
        x, y = x * machine.frame.front.axle_distance, 0.5 * y * machine.frame.track
        middle = (np.cos(angle) * x - np.sin(angle) * y, np.sin(angle) * x + np.cos(angle) * y)
        np.testing.assert_allclose(hull.mean(axis=0)[:2], middle, atol=0.15)  # the arms swing the axles a little
        # on the ground but for its deflection, a few centimetres
        assert hull[:, 2].min() == pytest.approx(-0.05, abs=0.06)
        assert np.ptp(hull[:, 2]) == pytest.approx(2 * (radius - 0.035), rel=0.01)
