"""Learning on the device sees the environment's tensors, normalised as Stable-Baselines3 does; time limits are no ends."""

from typing import Any

import gymnasium
import numpy as np
import pytest

torch: Any = pytest.importorskip("torch")
pytest.importorskip("array_api_compat")

from aoro_gym.agents.policies.policy import Normalisation  # noqa: E402
from aoro_gym.agents.training.device_env import DeviceEnv, Moments  # noqa: E402
from aoro_gym.envs import Course, register_envs  # noqa: E402
from aoro_gym.terrains import Path as Line  # noqa: E402
from aoro_gym.terrains import Plane  # noqa: E402

TURNING, TRACKING = "AORO/Turning-v0", "AORO/PathTracking-v0"
COUNT = 3


def make(env: str = TURNING, *, output: str = "torch", **arguments) -> Any:
    register_envs()
    arguments = {"autoreset_mode": "SameStep", **arguments}
    return gymnasium.make_vec(env, num_envs=COUNT, output=output, **arguments).unwrapped


def raw(limit: int | None = None) -> DeviceEnv:
    return DeviceEnv(make(max_episode_steps=limit), norm_obs=False, norm_reward=False)


def drawn(steps: int, actions: int = 1) -> Any:
    return torch.from_numpy(np.random.default_rng(0).uniform(-1.5, 1.5, (steps, COUNT, actions)).astype(np.float32))


# ---- what is handed on -----------------------------------------------------------------------------------------------


def test_time_limits_are_no_ends_and_episodes_begin_anew():
    limited, endless = raw(5), raw()
    first, other = limited.reset(7), endless.reset(7)
    for k, actions in enumerate(drawn(5)):
        made, went_on = limited.step(actions), endless.step(actions)
        assert torch.equal(made.reached, went_on.observations)  # also where the limit is: the end of the old episode
        assert torch.equal(made.rewards, went_on.rewards)
        assert made.truncated.tolist() == [[k == 4]] * COUNT
        assert not made.terminated.any()
        if k < 4:
            assert torch.equal(made.observations, made.reached)
    assert torch.equal(first, other)
    # the joint stands still again
    assert not torch.equal(made.observations, made.reached)
    rate = limited.envs.observation_layout["joint_rate"]
    moving = made.reached[:, rate].abs() > 1e-3  # a signal in the dead band moves no joint
    assert moving.sum() > COUNT // 2
    assert made.observations[:, rate].abs().max() < made.reached[:, rate].abs()[moving].min()
    for values, width in ((made.observations, first.shape[1]), (made.rewards, 1)):
        assert (tuple(values.shape), values.dtype, values.device) == ((COUNT, width), torch.float32, limited.device)
    for flags in (made.terminated, made.truncated):
        assert (tuple(flags.shape), flags.dtype) == ((COUNT, 1), torch.bool)


def test_who_leaves_the_path_terminates():
    course = Course(Plane(), (Line(np.array([[0.0, 0.0], [60.0, 0.0]]), name="ahead"),), name="ahead")
    env = DeviceEnv(make(TRACKING, courses=[course]))
    env.reset(3)
    actions = torch.ones(COUNT, *env.envs.single_action_space.shape)
    ends = torch.zeros(COUNT, dtype=torch.bool)
    for _ in range(400):
        made = env.step(actions)
        ends |= made.terminated[:, 0]
        assert not made.truncated.any()
        if ends.all():
            break
    assert ends.all()
    assert env.ended()["success"] == 0.0


def test_seeds_repeat_and_differ():
    def course(seed: int) -> list[Any]:
        env = DeviceEnv(make(max_episode_steps=6))
        seen = [env.reset(seed)]
        for actions in drawn(14):
            made = env.step(actions)
            seen += [made.observations, made.rewards]
        return seen

    one, same, other = course(5), course(5), course(6)
    assert all(torch.equal(a, b) for a, b in zip(one, same, strict=True))
    assert not torch.equal(one[0], other[0])


def test_means_are_those_of_the_episodes_that_ended():
    env = raw(4)
    env.reset(1)
    returns = torch.zeros(COUNT)
    assert env.ended() == {}
    for k, actions in enumerate(drawn(10)):
        made = env.step(actions)
        if k < 8:
            returns += made.rewards[:, 0]
        if k == 2:
            assert env.ended() == {}
    found = env.ended()  # two episodes of each; the third ones go on
    assert found["length"] == 4.0
    # sums of 4 rewards of about 1 in float32
    assert found["return"] == pytest.approx(float(returns.sum()) / (2 * COUNT), abs=1e-5)
    terms = [value for name, value in found.items() if name.startswith("reward/")]
    assert len(terms) == 5
    assert sum(terms) == pytest.approx(found["return"], abs=1e-5)
    assert env.ended() == {}
    for actions in drawn(2):
        env.step(actions)
    assert env.ended()["length"] == 4.0
    env.step(drawn(1)[0])
    env.reset(1)  # forgets those that ran
    for actions in drawn(4):
        env.step(actions)
    assert env.ended()["length"] == 4.0


# ---- normalisation ---------------------------------------------------------------------------------------------------


def test_moments_are_those_of_all_samples():
    rng, moments = np.random.default_rng(1), Moments((2,), torch.device("cpu"))
    batches = [rng.normal(3.0, [0.1, 5.0], (count, 2)) for count in (4, 1, 300)]
    for batch in batches:
        moments.update(torch.from_numpy(batch))
    samples = np.concatenate(batches)
    # 1e-4 samples at 0 ± 1 count, too
    np.testing.assert_allclose(moments.mean, samples.mean(axis=0), rtol=1e-5)
    np.testing.assert_allclose(moments.variance, samples.var(axis=0), rtol=1e-3)
    assert moments.count == pytest.approx(305.0, abs=1e-3)


def test_normalised_as_stable_baselines3_does(monkeypatch):
    pytest.importorskip("stable_baselines3")
    from stable_baselines3.common.running_mean_std import RunningMeanStd  # pyright: ignore[reportMissingImports]
    from stable_baselines3.common.vec_env import VecNormalize  # pyright: ignore[reportMissingImports]

    from aoro_gym.agents.training.vec_env import make_vec_env

    # in float64, as here: it takes means in float32
    update = RunningMeanStd.update
    monkeypatch.setattr(RunningMeanStd, "update", lambda self, batch: update(self, np.asarray(batch, np.float64)))
    asked: dict[str, Any] = {"gamma": 0.9, "clip_obs": 2.0, "clip_reward": 1.5}
    theirs: Any = VecNormalize(
        make_vec_env(TURNING, COUNT, env_kwargs={"max_episode_steps": 6, "output": "torch"}), **asked
    )
    ours = DeviceEnv(make(max_episode_steps=6), **asked)
    theirs.seed(2)
    np.testing.assert_allclose(ours.reset(2), theirs.reset(), atol=1e-6)
    ended, largest = 0, torch.zeros(2)
    for actions in drawn(20):
        made = ours.step(actions)
        observations, rewards, dones, infos = theirs.step(actions.numpy())
        np.testing.assert_allclose(made.observations, observations, atol=1e-6)
        np.testing.assert_allclose(made.rewards[:, 0], rewards, atol=1e-6)
        np.testing.assert_array_equal((made.terminated | made.truncated)[:, 0], dones)
        largest = torch.maximum(largest, torch.stack([one.abs().max() for one in (made.observations, made.rewards)]))
        for i in np.flatnonzero(dones):
            ended += 1
            np.testing.assert_allclose(made.reached[i], infos[i]["terminal_observation"], atol=1e-6)
    assert ended == 3 * COUNT
    assert largest.tolist() == [2.0, 1.5]  # both were clipped
    normalisation = ours.normalisation
    assert normalisation is not None
    np.testing.assert_allclose(normalisation.mean, theirs.obs_rms.mean, rtol=1e-12, atol=1e-15)
    np.testing.assert_allclose(normalisation.variance, theirs.obs_rms.var, rtol=1e-9, atol=1e-15)


def test_normalisation_is_the_one_that_policies_carry():
    env = DeviceEnv(make())
    seen = env.reset(4)
    normalisation = env.normalisation
    assert normalisation is not None
    twin = make()
    observations, _ = twin.reset(seed=4)
    np.testing.assert_array_equal(normalisation(observations.numpy()), seen)


def test_state_is_taken_up():
    one, other = (DeviceEnv(make(max_episode_steps=5)) for _ in range(2))
    one.reset(1)
    for actions in drawn(7):
        one.step(actions)
    other.restore(one.state())
    assert torch.equal(one.reset(2), other.reset(2))
    for actions in drawn(3):
        made, same = one.step(actions), other.step(actions)
        assert torch.equal(made.observations, same.observations)
        assert torch.equal(made.rewards, same.rewards)


def test_what_a_policy_was_made_for_stays():
    env = DeviceEnv(make())
    size = env.envs.single_observation_space.shape
    env.start_from(Normalisation(np.full(size, 2.0), np.full(size, 9.0), 1e-8, 10.0))
    env.reset(0)
    found = env.normalisation
    assert found is not None
    np.testing.assert_allclose(found.mean, 2.0, rtol=1e-12)
    np.testing.assert_allclose(found.variance, 9.0, rtol=1e-12)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"output": "numpy"}, "output is 'numpy', but learning on the device needs 'torch'"),
        ({"autoreset_mode": "NextStep"}, "autoreset_mode is 'NextStep', but learning needs 'SameStep'"),
    ],
)
def test_other_environments_are_refused(arguments, message):
    with pytest.raises(ValueError, match=message):
        DeviceEnv(make(**arguments))
