"""Imitation with a memory: what is kept of a drive, what is learned from it, and that it goes on where it stopped."""

import copy
from typing import Any

import numpy as np
import pytest

from aoro_gym import Machine
from aoro_gym.agents.training.callbacks import ProgressCallback, StepCounter
from aoro_gym.agents.training.plan import TrainingPlan

pytest.importorskip("stable_baselines3")
pytest.importorskip("yaml")
import torch

from aoro_gym.agents.training.dagger import CLIP, EPSILON, Hyperparams
from aoro_gym.agents.training.learner import learner_of
from aoro_gym.agents.training.recurrent_dagger import RecurrentDagger, Rollout

TURNING = "AORO/Turning-v0"
SMALL = {
    "n_timesteps": 800, "n_envs": 4, "n_steps": 20, "buffer_size": 160, "batch_size": 40, "net_arch": [16], "memory": 8,
    "teacher": "proportional-derivative", "learning_rate": 1e-3,
}  # fmt: skip


def made(**changes: Any) -> RecurrentDagger:
    plan = TrainingPlan(env=TURNING, algo="dagger")
    learner = learner_of(plan, SMALL | changes, StepCounter(800), {"machine": Machine.load("aoro")})
    assert isinstance(learner, RecurrentDagger)
    return learner


def learn(learner: RecurrentDagger, steps: int, seed: int | None = 3) -> None:
    callback = ProgressCallback(StepCounter(800), learner.episodes, lambda progress: None, every=9.0)
    learner.learn(steps, callback, seed=seed)


def test_the_teacher_drives_first_and_then_the_network_as_its_policy_does(monkeypatch):
    learner, driven = made(action_noise=0.0), []
    step = learner._env.step
    monkeypatch.setattr(learner._env, "step", lambda actions: (driven.append(actions.numpy().copy()), step(actions))[1])
    learn(learner, 80)
    first = learner._rollouts[0]
    np.testing.assert_array_equal(np.clip(first.actions.numpy(), -1.0, 1.0), driven)
    assert first.begins[0].all() and not first.begins[1].any()
    driven.clear()
    policy = learner.policy()  # the network does not change before the next fit
    learn(learner, 80, seed=None)
    second = learner._rollouts[1]
    assert policy.normalisation is not None
    deviation = np.sqrt(policy.normalisation.variance + EPSILON)
    object.__setattr__(policy, "_state", second.state.numpy())
    for begins, seen, acted in zip(second.begins.numpy(), second.observations.numpy(), driven, strict=True):
        assert np.abs(seen).max() < CLIP
        policy.reset(begins)
        # normalised and back: float32 of numbers up to 10 deviations
        np.testing.assert_allclose(policy(seen * deviation + policy.normalisation.mean), acted, atol=3e-5)
    learner.close()


def test_errors_are_true_values_less_measured_ones_in_deviations(monkeypatch):
    learner, seen = made(), []
    layout = learner.envs.observation_layout
    columns = [layout[name].start for name in learner._exact if name in layout]
    assert learner._measured == columns and columns
    teacher = learner._teacher
    monkeypatch.setattr(learner, "_teacher", lambda told: (seen.append(told.copy()), teacher(told))[1])
    learn(learner, 80)
    kept = learner._rollouts[0]
    assert learner._moments is not None
    mean, deviation = (values.numpy() for values in learner._moments)
    measured = kept.observations.numpy() * deviation + mean
    expected = (np.array(seen) - measured)[..., columns] / deviation[columns]
    np.testing.assert_allclose(kept.errors, np.clip(expected, -5.0, 5.0), atol=1e-4)
    assert np.abs(expected).max() > 0.01
    learner.close()


def test_it_learns_what_only_a_memory_can_know():
    """What is seen at the beginning alone is to be done ever after: who forgets it is wrong by 1 on the mean."""
    learner = made(n_epochs=300, batch_size=640, buffer_size=2000, error_weight=0.0)
    t, n, seen = 10, 64, learner.envs.single_observation_space.shape[0]
    rng = np.random.default_rng(0)
    shown = torch.from_numpy(rng.choice([-1.0, 1.0], n).astype(np.float32))
    observations = torch.zeros(t, n, seen)
    observations[0, :, 0] = shown
    begins = torch.zeros(t, n, dtype=torch.bool)
    begins[0] = True
    actions = shown.expand(t, n)[..., None].contiguous()
    stale = torch.full((n, 8), 0.9)  # of another episode
    learner._rollouts = [Rollout(observations, actions, torch.zeros(t, n, len(learner._measured)), begins, stale)]
    learner._fit(5e-3)
    with torch.no_grad():
        acted, _ = learner._net(observations, stale, begins)
    assert float((acted - actions).abs().mean()) < 0.1
    learner.close()


def test_it_goes_on_where_it_stopped_to_the_bit():
    learner, other = made(), made()
    learn(learner, 160)
    other.restore(copy.deepcopy(learner.state()))
    for each in (learner, other):
        torch.manual_seed(5)
        learn(each, 160, seed=9)
    assert other.steps == learner.steps == 320
    for name, value in learner._net.state_dict().items():
        assert torch.equal(value, other._net.state_dict()[name]), name
    assert sum(one.pairs for one in learner._rollouts) == 160
    learner.close()
    other.close()


def test_it_learns_on_from_its_policy_and_from_no_other():
    learner, other = made(), made()
    learn(learner, 80)
    other.start_from(learner.policy())
    seen = np.zeros((2, learner.envs.single_observation_space.shape[0]), dtype=np.float32)
    np.testing.assert_array_equal(other.policy()(seen), learner.policy()(seen))
    with pytest.raises(ValueError, match="but the network to train one of"):
        made(memory=4).start_from(learner.policy())
    with pytest.raises(ValueError, match="memory is -1, but must be"):
        Hyperparams(n_timesteps=1, n_envs=1, teacher="preview", memory=-1)
