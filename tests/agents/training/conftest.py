"""What the tests of trainings share."""

import pytest


@pytest.fixture
def training(short_episodes):
    pytest.importorskip("stable_baselines3")
    pytest.importorskip("tensorboard")
    pytest.importorskip("yaml")
    from aoro_gym.agents.training import train as training

    return training


@pytest.fixture
def learning() -> None:
    """What a training in another process needs."""
    for module in ("stable_baselines3", "tensorboard", "yaml"):
        pytest.importorskip(module)
