"""PPO behind a memory that no longer learns: it sees what the policy would, and changes what lies behind it alone."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest

from aoro_gym import Machine
from aoro_gym.agents.policies.policy import LearnedPolicy, Normalisation
from aoro_gym.agents.training.plan import TrainingPlan
from aoro_gym.agents.training.run_folder import begin
from aoro_gym.envs import register_envs
from tests.agents.training.small import plan_of

torch: Any = pytest.importorskip("torch")
for library in ("skrl", "array_api_compat", "stable_baselines3", "yaml"):
    pytest.importorskip(library)

from aoro_gym.agents.training.callbacks import ProgressCallback, StepCounter  # noqa: E402
from aoro_gym.agents.training.memory_network import MemoryNetwork  # noqa: E402
from aoro_gym.agents.training.remembering_env import RememberingEnv  # noqa: E402
from aoro_gym.agents.training.skrl_trainer import SkrlPPO  # noqa: E402

TURNING = "AORO/Turning-v0"
SMALL = {
    "n_timesteps": 1000, "n_envs": 3, "n_steps": 8, "batch_size": 12, "n_epochs": 2, "normalize": True,
    "policy_kwargs": {"net_arch": [16]},
}  # fmt: skip


@pytest.fixture
def remembering(tmp_path) -> Path:
    """File of a policy with a memory of 5 units."""
    register_envs()
    torch.manual_seed(3)
    env: Any = gymnasium.make(TURNING).unwrapped
    moments = np.linspace(-0.2, 0.2, 8), np.linspace(0.5, 1.5, 8)
    policy = MemoryNetwork(8, 5, [16], 1, 0).policy(
        env.action_space,
        environment=TURNING,
        layout=dict(env.observation_layout),
        normalisation=Normalisation(*moments, 1e-8, 10.0),
    )
    env.close()
    policy.save(tmp_path / "first.json")
    return tmp_path / "first.json"


def learner_from(file: Path, **changes: Any) -> SkrlPPO:
    """Episodes of 3 steps: a rollout of 8 has two ends of each."""
    plan = TrainingPlan(env=TURNING, trainer="resident", seed=1, start=str(file))
    learner = SkrlPPO(plan, SMALL | changes, StepCounter(1000), {"max_episode_steps": 3})
    learner.start_from(LearnedPolicy.load(file))
    return learner


def test_what_is_seen_is_what_the_policys_memory_gives(remembering, monkeypatch):
    learner, seen = learner_from(remembering), []
    env, policy = learner._env, LearnedPolicy.load(remembering)
    assert isinstance(env, RememberingEnv) and policy.memory is not None and policy.normalisation is not None
    assert env.observation_space.shape == (10,)
    step = learner.envs.step
    monkeypatch.setattr(learner.envs, "step", lambda actions: seen.append(step(actions)) or seen[-1])
    given = [env.reset(4)]
    raw = [learner.envs.reset(seed=4)[0].numpy().copy()]
    made = []
    for _ in range(4):  # the third step ends all episodes
        made.append(env.step(torch.full((3, 1), 0.3)))
        given.append(made[-1].observations)
        raw.append(seen[-1][0].numpy().copy())

    def normalised(values: np.ndarray) -> np.ndarray:
        assert policy.normalisation is not None
        deviations = np.sqrt(policy.normalisation.variance + policy.normalisation.epsilon)
        return ((values - policy.normalisation.mean) / deviations).astype(np.float32)

    state = np.zeros((3, 5), dtype=np.float32)
    for k, (one, values) in enumerate(zip(given, raw, strict=True)):
        if k == 3:
            assert bool(made[2].truncated.all())
            reached, _ = policy.memory(normalised(seen[2][4]["final_obs"].numpy()), state)
            np.testing.assert_allclose(made[2].reached.numpy(), reached, atol=2e-6)
            state = np.zeros_like(state)
        wanted, state = policy.memory(normalised(values), state)
        np.testing.assert_allclose(one.numpy(), wanted, atol=2e-6)
    learner.close()


def test_what_lies_behind_the_memory_alone_learns(remembering):
    learner, first = learner_from(remembering), LearnedPolicy.load(remembering)
    values = np.random.default_rng(0).normal(size=(3, 8)).astype(np.float32)
    np.testing.assert_array_equal(learner.policy(environment=TURNING)(values), first(values))
    learner.learn(48, ProgressCallback(StepCounter(1000), learner.episodes, lambda progress: None, every=9.0), seed=3)
    after = learner.policy(environment=TURNING)
    assert after.memory is not None and first.memory is not None
    for name, kept in first.memory.arrays().items():
        np.testing.assert_array_equal(after.memory.arrays()[name], kept)
    assert all(np.any(one != other) for one, other in zip(after.weights, first.weights, strict=True))
    learner.close()


def test_another_layout_or_network_is_refused(remembering):
    with pytest.raises(ValueError, match=r"layers \[10, 16, 1\] with tanh, but the network to train \[10, 8, 1\]"):
        learner_from(remembering, policy_kwargs={"net_arch": [8]})
    learner = learner_from(remembering)
    memory = MemoryNetwork(4, 5, [16], 1, 0).policy(learner.envs.single_action_space, environment=TURNING).memory
    assert memory is not None
    with pytest.raises(ValueError, match=r"the memory takes 4 numbers, but the environment gives \(8,\)"):
        RememberingEnv(learner.envs, memory)
    learner.close()


def test_a_training_goes_on_where_it_stopped_to_the_bit(remembering, training, tmp_path):
    small = plan_of(trainer="resident", start=str(remembering))
    plan = replace(small, param=[*(small.param or []), "normalize=True", "policy_kwargs={net_arch: [16]}"])
    machine, whole, parted = Machine.load("aoro"), tmp_path / "whole", tmp_path / "parted"
    training.train(plan, begin(plan, whole), whole, machine=machine)

    class Stop(Exception):
        pass

    def stop(evaluation: Any) -> None:
        raise Stop

    recipe = begin(plan, parted)
    with pytest.raises(Stop):
        training.train(plan, recipe, parted, machine=machine, evaluated=stop)
    training.train(plan, recipe, parted, machine=machine)
    policies = [LearnedPolicy.load(folder / "policy.json") for folder in (whole, parted)]
    for name, values in policies[0].arrays().items():
        np.testing.assert_array_equal(policies[1].arrays()[name], values, err_msg=name)
    assert policies[0].memory is not None
