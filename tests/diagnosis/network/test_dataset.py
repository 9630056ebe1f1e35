"""Simulated days with their labels: the same for the same seed, whichever processes draw them."""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np
import pytest

from aoro_gym.diagnosis.simulation.days import HEALTHY
from aoro_gym.diagnosis.simulation.prior import Prior

torch = pytest.importorskip("torch")

from aoro_gym.diagnosis.network import dataset  # noqa: E402
from aoro_gym.diagnosis.network.dataset import Amount, Labelled, simulate  # noqa: E402

AMOUNT = Amount(machines=4, later=1, manoeuvres=1, seed=3)
PRIOR = replace(Prior(), spreads=(0.3,), weights=(0.0, 1.0, 0.0, 0.0))


def test_days_come_with_their_labels_in_their_order(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(dataset, "CHUNK", 2)
    told = []
    data, scales = simulate(PRIOR, AMOUNT, "cpu", lambda *about: told.append(about))
    # machines within a chunk count while their logs are simulated, so that there is an estimate before it is done
    assert told == sorted(told) and told[-1] == (4, 4)
    assert {done for done, _ in told} == {0, 1, 2, 3, 4}
    assert data.samples.shape[:3] == (4, 3, 1) and data.machines == 4
    assert torch.all(data.hypothesis[:, :HEALTHY] == 0)
    # an effect that a machine's laws know nothing of is none
    effect = data.effects[:, HEALTHY, 0]
    np.testing.assert_array_equal(data.hypothesis[:, HEALTHY], torch.where(effect < 0, 0, effect + 2))
    assert np.all(scales > 0.0)
    # the median of what is drawn of an effect is one scale: arsinh 1 = 0.88 of the only day that has it
    alone = [i for i in range(4) if effect[i] >= 0 and int((effect == effect[i]).sum()) == 1]
    assert alone
    np.testing.assert_allclose(data.sizes[alone, HEALTHY, 0].abs().numpy(), np.arcsinh(1.0), rtol=1e-6)
    chosen = data.of(torch.tensor([2, 0]))
    assert torch.equal(chosen.samples[1], data.samples[0]) and torch.equal(chosen.effects[0], data.effects[2])


@pytest.mark.slow
def test_processes_draw_the_same_days(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(dataset, "CHUNK", 2)
    data, again = (simulate(PRIOR, replace(AMOUNT, processes=processes), "cpu")[0] for processes in (1, 2))
    for field in fields(Labelled):
        assert torch.equal(getattr(data, field.name), getattr(again, field.name)), field.name
