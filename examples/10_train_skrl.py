"""Train with skrl yourself: observations, rewards and actions stay tensors on the device of the twins.

You learn how the environments are handed to a library that learns on tensors; with ``DEVICE = "cuda:0"`` nothing comes to
the host. ``aoro-gym train --trainer resident`` does the same with tuned hyper-parameters. Needs the part ``resident``. A
training takes 1,000,000 steps and more; ``STEPS`` is what shows that it runs.
"""

from typing import Any

import torch
from skrl.agents.torch.ppo import PPO, PPO_CFG
from skrl.memories.torch import RandomMemory
from skrl.models.torch import DeterministicMixin, GaussianMixin, Model

from aoro_gym.agents.training.device_env import DeviceEnv
from aoro_gym.envs.turning.environment import TurningVectorEnv

DEVICE, TWINS, ROLLOUT, STEPS = "cpu", 16, 32, 128


def network(inputs, outputs):
    return torch.nn.Sequential(torch.nn.Linear(inputs, 64), torch.nn.Tanh(), torch.nn.Linear(64, outputs))


class Policy(GaussianMixin, Model):
    def __init__(self, **spaces):
        Model.__init__(self, **spaces)
        GaussianMixin.__init__(self)
        self.net = network(self.num_observations, self.num_actions)
        self.log_std = torch.nn.Parameter(torch.zeros(self.num_actions))

    def compute(self, inputs, role=""):
        return self.net(inputs["observations"]), {"log_std": self.log_std}


class Value(DeterministicMixin, Model):
    def __init__(self, **spaces):
        Model.__init__(self, **spaces)
        DeterministicMixin.__init__(self)
        self.net = network(self.num_observations, 1)

    def compute(self, inputs, role=""):
        return self.net(inputs["observations"]), {}


torch.manual_seed(1)
envs = TurningVectorEnv(TWINS, device=DEVICE, output="torch", autoreset_mode="SameStep")
env = DeviceEnv(envs)  # scales observations and rewards, and keeps what episodes ended with
spaces: dict[str, Any] = {
    "observation_space": envs.single_observation_space, "action_space": envs.single_action_space, "device": env.device,
}  # fmt: skip
policy: Any = Policy(**spaces)
agent: Any = PPO(
    models={"policy": policy, "value": Value(**spaces)},
    memory=RandomMemory(memory_size=ROLLOUT, num_envs=TWINS, device=DEVICE),
    cfg=PPO_CFG(rollouts=ROLLOUT, learning_epochs=4, mini_batches=4, experiment={"write_interval": 0}),  # pyright: ignore
    **spaces,
)
agent.init()
agent.enable_training_mode(True)

observations, rewards = env.reset(seed=1), []
for step in range(STEPS):
    now = {"timestep": step, "timesteps": STEPS}
    with torch.no_grad():
        actions, _ = agent.act(observations, None, **now)
        found = env.step(actions)
        agent.record_transition(
            observations=observations, states=None, actions=actions, rewards=found.rewards,
            next_observations=found.reached, next_states=None, terminated=found.terminated, truncated=found.truncated,
            infos={}, **now,
        )  # fmt: skip
        observations = found.observations
        rewards.append(found.rewards)
    agent.post_interaction(**now)  # learns after each rollout
torch.save(policy.state_dict(), "turning.pt")
print(f"mean reward of a step in {STEPS * TWINS} steps of learning: {torch.stack(rewards).mean():.4f}")
env.close()
