"""What the tests of agents share."""

import pytest

SHORT = 150
"""Control steps [0.02 s] of a short episode of the turning task: its first target stands for at least 125 of them, and the
metrics look at the first 100 after it was set."""


@pytest.fixture
def short_episodes(monkeypatch: pytest.MonkeyPatch) -> None:
    """Evaluations of the turning task are short, for tests that do not ask how well somebody turns."""
    monkeypatch.setattr("aoro_gym.agents.evaluation.turning.EPISODE_STEPS", SHORT)
