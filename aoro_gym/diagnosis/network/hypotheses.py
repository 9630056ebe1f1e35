"""What may be wrong, by number: nothing, something that the catalogue lacks, one effect, two effects."""

from __future__ import annotations

from functools import cache
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from aoro_gym.effects.catalogue import IDS

PAIRS = tuple(combinations(range(len(IDS)), 2))
"""Numbers of the effects of each pair, in their order."""
NOTHING, OUTSIDE, SINGLE = 0, 1, 2
"""Numbers of the hypotheses that there is nothing, something outside, and of the first single effect."""
PAIR = SINGLE + len(IDS)
"""Number of the first pair."""
HYPOTHESES = PAIR + len(PAIRS)


def _members() -> NDArray[np.float32]:
    members = np.zeros((HYPOTHESES, len(IDS)), dtype=np.float32)
    members[SINGLE + np.arange(len(IDS)), np.arange(len(IDS))] = 1.0
    for number, pair in enumerate(PAIRS):
        members[PAIR + number, pair] = 1.0
    members.flags.writeable = False
    return members


MEMBERS = _members()
"""(HYPOTHESES, effects): 1 where an effect is part of a hypothesis."""


def number_of(effects: NDArray[np.integer], outside: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Numbers (...) of hypotheses from numbers of effects (..., 2), −1 for none, and whether it is ``outside`` (...)."""
    pairs = np.zeros((len(IDS), len(IDS)), dtype=np.int64)
    for number, (a, b) in enumerate(PAIRS):
        pairs[a, b] = pairs[b, a] = PAIR + number
    first, second = effects[..., 0], effects[..., 1]
    return np.select([outside, first < 0, second < 0], [OUTSIDE, NOTHING, SINGLE + first], pairs[first, second])


@cache
def names_of(number: int) -> tuple[str, ...]:
    """Ids of the effects of a hypothesis."""
    return tuple(IDS[i] for i in np.flatnonzero(MEMBERS[number]))
