"""What the tests of agents share."""

from collections.abc import Iterator

import pytest

from tests.agents.episodes import shortened_episodes


@pytest.fixture
def short_episodes() -> Iterator[None]:
    """Evaluations of the turning task are short; see :func:`tests.agents.episodes.shortened_episodes`."""
    with shortened_episodes():
        yield
