"""Short episodes of the turning task."""

from collections.abc import Iterator
from contextlib import contextmanager

import pytest

SHORT = 110
"""Control steps [0.02 s] of a short episode: its first target stands for at least 125 of them, so it has no other;
metrics look at the first 100 after it was set."""


@contextmanager
def shortened_episodes() -> Iterator[None]:
    """Evaluations of the turning task are short, for tests that do not ask how well somebody turns."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("aoro_gym.agents.evaluation.turning.EPISODE_STEPS", SHORT)
        yield
