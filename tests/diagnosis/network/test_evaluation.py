"""Rates of right answers, against answers made by hand."""

from __future__ import annotations

import numpy as np
import pytest

from aoro_gym.diagnosis.network import hypotheses
from aoro_gym.effects.catalogue import IDS

pytest.importorskip("torch")

from aoro_gym.diagnosis.network.evaluation import Answers, rates


def test_rates_count_what_they_say() -> None:
    """Nothing, twice, once alarmed; three singles: one right, one missed, one confused with the second likeliest; two pairs:
    one whole, one half; one outsider that is told, and one of the singles is taken for one."""
    effects = np.array([[-1, -1], [-1, -1], [4, -1], [5, -1], [6, -1], [1, 2], [1, 2], [-1, -1]])
    outside = np.array([False] * 7 + [True])
    truth = hypotheses.number_of(effects, outside)

    def pair(a: int, b: int) -> int:
        return int(hypotheses.number_of(np.array([[a, b]]), np.array([False]))[0])

    said = [
        {0: 0.9, 2: 0.1}, {2 + 8: 0.8, 0: 0.2}, {2 + 4: 0.9, 0: 0.1}, {0: 0.7, 2 + 5: 0.3}, {1: 0.6, 2 + 7: 0.3, 2 + 6: 0.1},
        {pair(1, 2): 1.0}, {pair(2, 9): 0.8, 2 + 9: 0.1, 0: 0.1}, {1: 1.0},
    ]  # fmt: skip
    share = np.zeros((len(said), hypotheses.HYPOTHESES), dtype=np.float32)
    for row, one in enumerate(said):
        for number, value in one.items():
            share[row, number] = value
    quantiles = np.tile(np.array([-1.0, -0.5, 0.0, 0.5, 1.0], dtype=np.float32), (len(said), len(IDS), 1))
    sizes = np.zeros((len(said), 2), dtype=np.float32)
    sizes[2, 0] = 1.5
    found = rates(Answers(share, truth, quantiles, effects, sizes))
    assert found.cases == 8
    assert found.false_alarms == 0.5
    assert found.noticed == pytest.approx(2 / 3)
    assert found.named_first == pytest.approx(2 / 3)  # what is likeliest of the effects, though nothing is likelier
    assert found.named_of_noticed == 0.5
    assert found.among_three == 1.0
    assert found.both == 0.5 and found.one == 0.5
    assert found.outside == 1.0
    assert found.known_outside == pytest.approx(1 / 5)
    assert found.covered == pytest.approx(6 / 7)
    assert found.cross_entropy == pytest.approx(-np.log([0.9, 0.2, 0.9, 0.3, 0.1, 1.0, 1e-12, 1.0]).mean(), rel=1e-4)
