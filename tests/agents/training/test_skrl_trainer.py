"""PPO on the device: its policy is the one that is written, time limits are bootstrapped, wrong hyper-parameters are named.

That trainings resume, start from a policy and log is tested for all trainers in ``test_training.py``.
"""

from copy import deepcopy
from typing import Any

import numpy as np
import pytest

torch: Any = pytest.importorskip("torch")
for library in ("skrl", "array_api_compat", "stable_baselines3", "yaml"):
    pytest.importorskip(library)

from aoro_gym.agents.training.callbacks import ProgressCallback, StepCounter  # noqa: E402
from aoro_gym.agents.training.learner import versions  # noqa: E402
from aoro_gym.agents.training.plan import TrainingPlan  # noqa: E402
from aoro_gym.agents.training.skrl_trainer import Hyperparams, SkrlPPO  # noqa: E402
from tests.agents.training.waits import Waits  # noqa: E402

TURNING = "AORO/Turning-v0"
SMALL = {"n_timesteps": 1000, "n_envs": 3, "n_steps": 8, "batch_size": 12, "n_epochs": 2, "normalize": True}


def learner_of(clock: StepCounter | None = None, limit: int = 3, **changes) -> SkrlPPO:
    """Episodes of 3 steps: a rollout of 8 has two ends of each."""
    plan = TrainingPlan(env=TURNING, trainer="resident", seed=changes.pop("seed", 1))
    return SkrlPPO(plan, SMALL | changes, clock or StepCounter(1000), {"max_episode_steps": limit})


def callback(learner: SkrlPPO, clock: StepCounter | None = None) -> ProgressCallback:
    return ProgressCallback(clock or StepCounter(1000), learner.episodes, lambda progress: None, every=0.0)


def test_the_policy_is_the_one_that_learned():
    learner = learner_of(policy_kwargs={"net_arch": [16, 8], "log_std_init": -1.0})
    learner.learn(48, callback(learner), seed=3)
    policy = learner.policy(environment=TURNING)
    assert policy.sizes == [8, 16, 8, 1]
    with torch.no_grad():  # where actions are neither all alike nor all at a bound
        learner._agent.policy.net[-1].bias += 0.5
        learner._agent.policy.net[-1].weight *= 30.0
    policy = learner.policy(environment=TURNING)
    observations = learner.envs.reset(seed=9)[0]
    wanted = learner._agent.policy.compute({"observations": learner._env._normalised(observations)})[0]
    wanted = wanted.detach().clip(-1.0, 1.0).numpy()
    assert np.ptp(wanted) > 0.1 and np.abs(wanted).min() < 1.0
    np.testing.assert_allclose(policy(observations.numpy()), wanted, atol=1e-6)


def test_time_limits_are_worth_what_follows_and_ends_nothing(monkeypatch):
    learner = learner_of(gamma=0.9, n_epochs=1)
    agent, made = learner._agent, []
    step = learner._env.step

    def stepped(actions):
        transition = step(actions)
        if len(made) == 5:  # as if one of them had ended for a reason
            transition.truncated[1] = False
            transition.terminated[1] = True
        with torch.no_grad():
            value = agent.value.act({"observations": transition.reached}, role="value")[0]
        kept = transition.rewards.clone()  # what is handed on is changed in place
        made.append((kept, transition.terminated, transition.truncated, value, transition.observations))
        return transition

    monkeypatch.setattr(learner._env, "step", stepped)
    monkeypatch.setattr(agent, "update", lambda **_: None)
    learner.learn(24, callback(learner), seed=2)
    rewards = agent.memory.get_tensor_by_name("rewards")
    for k, (reward, _, truncated, value, _) in enumerate(made):
        assert value.abs().min() > 1e-4
        worth = torch.where(truncated, 0.9 * value, 0.0)
        torch.testing.assert_close(rewards[k], reward + worth, rtol=0.0, atol=1e-6)
    for name, wanted in (("terminated", [0, 1, 0]), ("truncated", [2, 1, 2])):
        assert agent.memory.get_tensor_by_name(name).sum(dim=(0, 2)).tolist() == wanted
    # what is acted on next is the new episode's beginning
    assert torch.equal(agent.memory.get_tensor_by_name("observations")[3], made[2][4])


def test_batches_hold_every_sample_once(monkeypatch):
    learner, seen = learner_of(), []
    minibatches = learner._agent._minibatches
    gradients = minibatches.gradients
    monkeypatch.setattr(minibatches, "gradients", lambda samples, rows: seen.append(rows) or gradients(samples, rows))
    learner.learn(24, callback(learner), seed=0)
    assert [len(rows) for rows in seen] == [12, 12, 12, 12]
    for epoch in (torch.cat(seen[:2]).tolist(), torch.cat(seen[2:]).tolist()):
        assert sorted(epoch) == list(range(24)) != epoch


@pytest.mark.parametrize("changes", [{}, {"clip_range_vf": 0.1}, {"ent_coef": 0.01}])
def test_updates_as_skrl_does(changes, monkeypatch):
    """From one memory, in the same batches: weights, and what is logged."""
    from skrl.agents.torch.ppo import PPO  # pyright: ignore[reportMissingImports]

    learner = learner_of(n_envs=16, batch_size=32, n_epochs=5, learning_rate=1e-3, **changes)
    ours = learner._agent
    monkeypatch.setattr(ours, "update", lambda **_: None)
    learner.learn(8 * 16, callback(learner), seed=2)
    monkeypatch.undo()
    spaces = {"observation_space": ours.observation_space, "action_space": ours.action_space, "device": "cpu"}
    models = {name: deepcopy(model) for name, model in ours.models.items()}
    theirs = PPO(models=models, memory=deepcopy(ours.memory), cfg=ours.cfg, **spaces)
    theirs.init()
    theirs._current_next_observations = ours._current_next_observations
    for group in theirs.optimizer.param_groups:
        group["lr"] = 1e-3
    orders = iter([torch.randperm(128, generator=torch.Generator().manual_seed(k)) for k in range(5)] * 2)
    monkeypatch.setattr(torch, "randperm", lambda count, device: next(orders))
    before = iter([one.detach().clone() for name in ("policy", "value") for one in ours.models[name].parameters()])
    ours.tracking_data.clear()
    ours.update(timestep=0, timesteps=1)

    memory: Any = theirs.memory

    def sample(names, *, batch_size, mini_batches):
        batches = torch.tensor_split(next(orders), mini_batches)
        views = memory.tensors_view
        return [[views[name][rows] if name in views else None for name in names] for rows in batches]

    monkeypatch.setattr(memory, "sample", sample)
    theirs.update(timestep=0, timesteps=1)
    for name in ("policy", "value"):
        for one, other in zip(theirs.models[name].parameters(), ours.models[name].parameters(), strict=True):
            # 20 updates round in the last place of weights below 2
            torch.testing.assert_close(one, other, rtol=0.0, atol=20 * 2.0**-23)
            assert not torch.equal(other, next(before))
    assert ours.tracking_data.keys() == theirs.tracking_data.keys()
    for name, (value,) in theirs.tracking_data.items():
        # the deviation is logged after the last update here, before it there
        bound = 1.1e-3 if "deviation" in name else 20 * 2.0**-23 * max(1.0, abs(value))
        assert ours.tracking_data[name][0] == pytest.approx(value, rel=0.0, abs=bound), name


def test_the_host_waits_at_the_end_of_an_update():
    """However many minibatches there are: for what is logged, and for the deviation."""
    learner = learner_of()
    learner.learn(24, callback(learner), seed=0)
    found = []
    for learner._agent.cfg.learning_epochs in (1, 7):
        with Waits() as counted:
            learner._agent.update(timestep=0, timesteps=1)
        found.append(counted.count)
    assert found == [1, 1]


def test_schedules_follow_the_clock():
    clock = StepCounter(96)
    learner = learner_of(clock, learning_rate="lin_1e-2", clip_range="lin_0.4", clip_range_vf=0.3)
    seen = []
    update = learner._agent.update

    def updated(**timing):
        (rate,) = {group["lr"] for group in learner._agent.optimizer.param_groups}
        seen.append((rate, learner._agent.cfg.ratio_clip, learner._agent.cfg.value_clip))
        update(**timing)

    learner._agent.update = updated
    learner.learn(48, callback(learner, clock), seed=0)
    assert seen == [pytest.approx((1e-2, 0.4, 0.3)), pytest.approx((0.75e-2, 0.3, 0.3))]
    assert learner.steps == clock.done == 48


def test_a_rollout_that_began_is_finished():
    learner = learner_of()
    learner.learn(25, callback(learner), seed=0)
    assert learner.steps == 48
    learner.learn(1, callback(learner), seed=None)  # goes on
    assert learner.steps == 72
    assert np.isfinite(learner.episodes()).all()
    with pytest.raises(ValueError, match="no running episodes to go on with; give a seed"):
        learner_of().learn(1, callback(learner), seed=None)


def test_it_learns():
    """The signal is the reward: after 40 rollouts of 8 steps the mean action has gone up."""
    learner = learner_of(n_envs=16, batch_size=32, learning_rate=3e-3, limit=20)
    step = learner.envs.step

    def rewarded(actions):
        observations, rewards, *rest = step(actions)
        return observations, actions[:, 0].clip(-1.0, 1.0) + 0.0 * rewards, *rest

    learner.envs.step = rewarded  # pyright: ignore[reportAttributeAccessIssue]
    observations = learner.envs.reset(seed=5)[0].numpy()
    before = learner.policy()(observations).mean()
    learner.learn(40 * 8 * 16, callback(learner), seed=0)
    assert before == pytest.approx(0.0, abs=0.05)
    assert learner.policy()(observations).mean() > 0.5


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"target_kl": 0.1}, "that the resident trainer does not take: .*target_kl"),
        ({"policy": "CnnPolicy"}, "policy is 'CnnPolicy', but the resident trainer has 'MlpPolicy' only"),
        ({"n_epochs": 0}, "n_epochs is 0, but must be a positive integer"),
        ({"batch_size": 7}, r"batch_size is 7, but must divide n_steps \* n_envs = 24"),
        (
            {"policy_kwargs": {"activation": "relu"}},
            "policy_kwargs has activation, but the resident trainer takes log_std",
        ),
        ({"learning_rate": "fast_1"}, "learning_rate is 'fast_1', but must be a number, or lin_NUMBER"),
        ({"normalize": {"clip": 1.0}}, "normalize is .*unexpected keyword argument 'clip'"),
    ],
)
def test_wrong_hyperparams_are_named(changes, message):
    with pytest.raises(ValueError, match=message):
        learner_of(**changes)


def test_networks_may_differ():
    asked = Hyperparams(n_timesteps=1, n_envs=1, batch_size=1, policy_kwargs={"net_arch": {"pi": [4], "vf": [8, 8]}})
    assert (asked.hidden("pi"), asked.hidden("vf")) == ([4], [8, 8])
    assert Hyperparams(n_timesteps=1, n_envs=1).hidden("vf") == [64, 64]
    assert asked.normalised == {"norm_obs": False, "norm_reward": False}


def test_missing_library_is_named(monkeypatch, tmp_path):
    from importlib.metadata import PackageNotFoundError

    from typer.testing import CliRunner

    from aoro_gym import cli
    from aoro_gym.agents.training import learner

    def version(name: str) -> str:
        if name == "skrl":
            raise PackageNotFoundError(name)
        return "1"

    monkeypatch.setattr(learner, "version", version)
    assert "skrl" not in versions("sb3")
    with pytest.raises(ValueError, match=r"trainer 'resident' needs .*skrl: pip install 'aoro-gym\[resident\]'"):
        versions("resident")
    shown = CliRunner().invoke(cli.app, ["train", "--trainer", "resident", "--out", str(tmp_path / "made")])
    assert shown.exit_code == 2
    assert "pip install 'aoro-gym[resident]'" in " ".join(shown.stderr.split())
    assert not (tmp_path / "made").exists()
