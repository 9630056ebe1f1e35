"""Packets are late by what was asked, never out of order, and lost as often as was asked."""

from typing import Any

import numpy as np
import pytest

from aoro_gym.cosimulation.laboratory.delays import DelayLine


def passed(line: DelayLine, count: int, machines: int) -> np.ndarray:
    """What is held (count, machines) where the packet of period k is k."""
    rest = np.full((1, machines), -1.0, dtype=np.float32)
    return np.array([line.pass_on(np.full((1, machines), k, dtype=np.float32), rest)[0] for k in range(count)])


def test_delay_of_each_machine() -> None:
    held = passed(DelayLine([0, 1, 5], num_machines=3), 20, 3)
    periods = np.arange(20)
    for machine, delay in enumerate((0, 1, 5)):
        assert np.array_equal(held[:, machine], np.where(periods >= delay, periods - delay, -1))


def test_jitter_never_turns_order_around() -> None:
    held = passed(DelayLine(2, 3, num_machines=200, seed=4), 300, 200)
    assert np.all(np.diff(held, axis=0) >= 0.0)
    age = np.arange(300)[20:, None] - held[20:]
    assert age.min() == 2
    assert age.max() <= 5
    # age is 2 + j unless a packet has arrived that was sent later: P(2) = 1/4, P(3) = 3/4 · 2/4, P(4) = 3/8 · 3/4
    shares = [np.mean(age == 2 + j) for j in range(4)]
    assert shares == pytest.approx([1 / 4, 3 / 8, 9 / 32, 3 / 32], abs=0.01)  # 56,000 draws, 4 standard errors


def test_loss() -> None:
    held = passed(DelayLine(0, 0, 0.2, num_machines=100, seed=1), 500, 100)
    arrived = held == np.arange(500)[:, None]
    assert arrived.mean() == pytest.approx(0.8, abs=4.0 * np.sqrt(0.16 / 50_000))


def test_seed_makes_the_run() -> None:
    runs = [passed(DelayLine(1, 4, 0.1, num_machines=5, seed=seed), 100, 5) for seed in (3, 3, 4)]
    assert np.array_equal(runs[0], runs[1])
    assert not np.array_equal(runs[0], runs[2])


def test_refusals() -> None:
    wrongs: list[dict[str, Any]] = [{"delay": -1}, {"jitter": -1}, {"loss": 1.0}, {"num_machines": 0}]
    for wrong in wrongs:
        with pytest.raises(ValueError, match=next(iter(wrong))):
            DelayLine(**wrong)
