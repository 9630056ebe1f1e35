"""The batched ``VecEnv`` is a ``DummyVecEnv`` of the single environments, to the bit, in one launch a step."""

import warnings
from typing import Any

import gymnasium
import numpy as np
import pytest

from aoro_gym.envs import Course, register_envs
from aoro_gym.envs.turning.config import MILD
from aoro_gym.envs.turning.environment import TurningVectorEnv
from aoro_gym.terrains import Path, Plane

vec_envs = pytest.importorskip("stable_baselines3.common.vec_env")
from stable_baselines3 import PPO, SAC  # noqa: E402  # pyright: ignore[reportMissingImports]

from aoro_gym.agents.training.vec_env import TwinVecEnv, make_vec_env  # noqa: E402

register_envs()
TURNING, TRACKING = "AORO/Turning-v0", "AORO/PathTracking-v0"
# from 4 m along, and done 0.25 m before the end: at full drive within some seconds
AHEAD = Path(np.stack([np.arange(0.0, 8.0), np.zeros(8)], axis=1), name="ahead")
SHORT = {"terrain": Plane(), "path": AHEAD}
CASES = {
    "turning": (TURNING, {"max_episode_steps": 12, "randomisation": MILD}, 30, (-1.0, 1.0)),
    "tracking": (TRACKING, SHORT, 130, (0.9, 1.0)),
}


def make(name, count, **arguments) -> Any:
    return make_vec_env(name, count, **arguments)


@pytest.mark.parametrize("case", list(CASES))
def test_agrees_with_a_dummy_vec_env_step_by_step(case):
    name, arguments, steps, span = CASES[case]
    count = 3
    batch = make(name, count, seed=7, env_kwargs=arguments)
    singles: Any = vec_envs.VecMonitor(
        vec_envs.DummyVecEnv([lambda: gymnasium.make(name, **arguments) for _ in range(count)])
    )
    singles.seed(7)
    assert batch.observation_space == singles.observation_space
    assert batch.action_space == singles.action_space
    np.testing.assert_array_equal(batch.reset(), singles.reset())
    assert batch.unwrapped.reset_infos == singles.unwrapped.reset_infos
    rng, cut, ended = np.random.default_rng(0), 0, 0
    for _ in range(steps):
        actions = rng.uniform(*span, (count, *batch.action_space.shape)).astype(np.float32)
        ours, theirs = batch.step(actions), singles.step(actions)
        for mine, other in zip(ours[:3], theirs[:3], strict=True):
            np.testing.assert_array_equal(mine, other)
            assert mine.dtype == other.dtype
        for i, (mine, other) in enumerate(zip(ours[3], theirs[3], strict=True)):
            if not ours[2][i]:
                assert mine == {}
                continue
            cut, ended = cut + other["TimeLimit.truncated"], ended + 1
            np.testing.assert_array_equal(mine["terminal_observation"], other["terminal_observation"])
            for key, value in other.items():
                if key == "episode":
                    assert (mine[key]["r"], mine[key]["l"]) == (value["r"], value["l"])
                elif key != "terminal_observation":
                    assert mine[key] == value, key
            assert batch.unwrapped.reset_infos[i] == singles.unwrapped.reset_infos[i]
    assert cut == (6 if case == "turning" else 0)
    assert ended >= 3


def test_terms_add_up_to_the_return_of_the_episode():
    batch = make(TURNING, 3, seed=2, env_kwargs={"max_episode_steps": 9})
    batch.reset()
    seen = 0
    for step in range(20):
        *_, dones, infos = batch.step(np.full((3, 1), (-1.0) ** (step // 5), dtype=np.float32))
        for info in (infos[i] for i in np.flatnonzero(dones)):
            terms = [value for key, value in info.items() if key.startswith("return/")]
            # 9 sums of 5 terms up to 1 in float32
            assert sum(terms) == pytest.approx(info["episode"]["r"], abs=45 * 1.2e-7 * 10)
            seen += 1
    assert seen == 6


def test_a_step_is_one_launch(monkeypatch):
    batch = make(TURNING, 5, seed=0)
    batch.reset()
    step, launches = batch.unwrapped.envs._kernel_step, []
    advance = step._advance
    monkeypatch.setattr(step, "_advance", lambda *a: launches.append(a) or advance(*a))
    batch.step(np.zeros((5, 1), dtype=np.float32))
    assert len(launches) == 1


def test_seeds_and_options_hold_for_one_reset():
    batch = make(TURNING, 2, seed=3)
    first = batch.reset()
    assert not np.array_equal(first, batch.reset())
    assert batch.seed(3) == [3, 4]
    batch.set_options({"joint_angle": 0.25})
    shared = batch.reset()
    assert [info["joint_angle"] for info in batch.unwrapped.reset_infos] == [0.25, 0.25]
    batch.seed(3)
    batch.set_options([{"joint_angle": 0.25}, {"joint_angle": -0.25}])
    each = batch.reset()
    assert [info["joint_angle"] for info in batch.unwrapped.reset_infos] == [0.25, -0.25]
    np.testing.assert_array_equal(each[0], shared[0])
    batch.seed(3)
    np.testing.assert_array_equal(batch.reset(), first)
    with pytest.raises(ValueError, match="one dictionary, or 2 with the same keys"):
        batch.set_options([{"joint_angle": 0.0}, {}])


def test_attributes_and_methods_are_those_of_the_environment():
    batch = make(TURNING, 3, seed=0)
    batch.reset()
    batch.step(np.ones((3, 1), dtype=np.float32))
    assert batch.get_attr("time") == [0.02] * 3
    assert batch.get_attr("time", [1]) == [0.02]
    assert batch.get_attr("action_space") == [batch.action_space] * 3
    assert batch.get_attr("max_episode_steps", 0) == [500]
    angles = batch.env_method("output", "joint_angle", indices=[2, 0])
    np.testing.assert_array_equal(angles, batch.unwrapped.envs.output("joint_angle")[[2, 0]])
    batch.set_attr("max_episode_steps", 2)
    assert batch.step(np.ones((3, 1), dtype=np.float32))[2].all()
    with pytest.raises(ValueError, match="'max_episode_steps' is shared by all sub-environments"):
        batch.set_attr("max_episode_steps", 3, indices=0)
    assert not batch.has_attr("trees")
    assert batch.env_is_wrapped(gymnasium.Wrapper) == [False] * 3


def test_pictures_are_tiled():
    batch = make(TURNING, 2, seed=0, env_kwargs={"render_mode": "rgb_array"})
    batch.reset()
    picture = batch.render()
    one = batch.get_images()[0]
    assert one is not None and picture is not None
    assert picture.shape == (2 * one.shape[0], one.shape[1], 3)
    np.testing.assert_array_equal(picture[: one.shape[0]], one)


def test_other_autoresets_do_not_fit():
    with pytest.raises(ValueError, match="autoreset_mode is 'Disabled', but Stable-Baselines3 needs 'SameStep'"):
        TwinVecEnv(TurningVectorEnv(1, autoreset_mode="Disabled"))


def test_tensors_on_the_device_give_the_same():
    pytest.importorskip("array_api_compat")
    arguments = {"max_episode_steps": 7}
    host = make(TURNING, 2, seed=1, env_kwargs=arguments)
    torch = make(TURNING, 2, seed=1, env_kwargs={**arguments, "output": "torch"})
    # sums in another order: see tests/envs/core/test_torch_output.py
    np.testing.assert_allclose(torch.reset(), host.reset(), atol=1e-6)
    for step in range(16):
        actions = np.full((2, 1), np.cos(step), dtype=np.float32)
        (seen, rewards, dones, infos), others = torch.step(actions), host.step(actions)
        np.testing.assert_allclose(seen, others[0], atol=1e-5)
        np.testing.assert_allclose(rewards, others[1], atol=1e-5)
        assert seen.dtype == rewards.dtype == np.float32
        np.testing.assert_array_equal(dones, others[2])
        for mine, other in zip(infos, others[3], strict=True):
            assert mine.keys() == other.keys()
            for key in mine.keys() - {"episode"}:
                np.testing.assert_allclose(mine[key], other[key], atol=1e-4, err_msg=key)


def test_lost_twins_say_so():
    from aoro_gym.twin.records import State

    for output in ("numpy", "torch"):
        batch = make(TURNING, 2, seed=1, env_kwargs={"output": output})
        batch.reset()
        batch.unwrapped.envs.twin.state.numpy()[State.JOINT_RATE, 1] = np.nan
        *_, dones, infos = batch.step(np.zeros((2, 1), dtype=np.float32))
        np.testing.assert_array_equal(dones, [False, True])
        assert infos[1]["termination"] == "simulation diverged: non-finite state"
        assert not infos[1]["TimeLimit.truncated"]


@pytest.mark.parametrize(
    "algorithm",
    [
        lambda env: PPO("MlpPolicy", env, n_steps=16, batch_size=32, n_epochs=1, seed=0, device="cpu"),
        lambda env: SAC("MlpPolicy", env, learning_starts=20, batch_size=16, buffer_size=100, seed=0, device="cpu"),
    ],
    ids=["ppo", "sac"],
)
def test_algorithms_learn_on_it_normalised(algorithm):
    env = vec_envs.VecNormalize(make(TURNING, 4, env_kwargs={"max_episode_steps": 10}))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        model = algorithm(env).learn(128)
    assert model.num_timesteps == 128
    assert len(model.ep_info_buffer) == 12
    assert len(model.ep_success_buffer) == 12
    assert env.obs_rms.count > 128


def test_paths_of_ones_own():
    course = Course(Plane(), (AHEAD,))
    batch = make(TRACKING, 2, seed=0, env_kwargs={"courses": [course]})
    assert batch.reset().shape == (2, *batch.observation_space.shape)
