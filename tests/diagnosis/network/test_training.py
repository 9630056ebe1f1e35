"""Training: labels, what a user may lack, and that a network learns what can be learnt."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from aoro_gym.diagnosis.network import hypotheses
from aoro_gym.diagnosis.network.features import CHANNELS, FEATURES, SAMPLES
from aoro_gym.diagnosis.network.shape import QUANTILES, Shape
from aoro_gym.diagnosis.simulation.days import HEALTHY
from aoro_gym.diagnosis.simulation.logs import UNITS
from aoro_gym.diagnosis.simulation.prior import SensorPrior

torch = pytest.importorskip("torch")

from aoro_gym.diagnosis.network.dataset import Labelled  # noqa: E402
from aoro_gym.diagnosis.network.sensing import Draw  # noqa: E402
from aoro_gym.diagnosis.network.training import (  # noqa: E402
    WARM,
    Batch,
    Course,
    draw_batch,
    learning_rate,
    loss_of,
    train,
)

SMALL = Shape(width=16, heads=2, within=1, across=1, kept=1, rank=2)
COURSE = Course(steps=80, batch=16, rate=4e-3, logs=2)
MACHINES = 64


@pytest.fixture(scope="module")
def data() -> Labelled:
    """Machines whose joint turns too far with effect 3 and not far enough with effect 9, by 5 % of the angle."""
    rng = np.random.default_rng(0)
    wrong = rng.choice([3, 9], MACHINES)
    ramp = np.clip(np.arange(SAMPLES) - 50, 0, 250) / 250.0
    angle = np.empty((MACHINES, 1 + HEALTHY, 2, SAMPLES))
    angle[:, 0] = rng.uniform(0.4, 0.6, (MACHINES, 2, 1)) * ramp
    angle[:, 1] = angle[:, 0]
    angle[:, 2] = angle[:, 0] * np.where(wrong == 3, 1.05, 0.95)[:, None, None]
    samples = np.zeros((MACHINES, 1 + HEALTHY, 2, len(CHANNELS), SAMPLES), dtype=np.int16)
    samples[..., 0, :] = np.round(angle / UNITS[0])
    effects = np.full((MACHINES, 1 + HEALTHY, 2), -1)
    effects[:, 2, 0] = wrong
    return Labelled(
        samples=torch.as_tensor(samples),
        commands=torch.ones(MACHINES, 2, 2, SAMPLES),
        chain=torch.zeros(MACHINES, 1 + HEALTHY, 4),
        outsider=torch.full((MACHINES, 1 + HEALTHY), -1),
        hypothesis=torch.as_tensor(hypotheses.number_of(effects, np.zeros((MACHINES, 1 + HEALTHY), dtype=bool))),
        effects=torch.as_tensor(effects),
        sizes=torch.ones(MACHINES, 1 + HEALTHY, 2),
    )


def test_a_network_learns_what_tells_two_effects_apart(data: Labelled) -> None:
    told = []
    network = train(data, COURSE, shape=SMALL, held_out=16, seed=1, progress=lambda *about: told.append(about))
    draw = Draw(torch.Generator().manual_seed(2))
    batch = draw_batch(data, torch.arange(MACHINES - 16, MACHINES), COURSE, SensorPrior(), draw, "pressures")
    with torch.no_grad():
        logits, sizes = network.eval()(batch.rows, batch.present)
    # sixteen cases: fifteen are right by chance with a probability of 3e-4
    assert int((logits.argmax(dim=1) == batch.hypothesis).sum()) >= 15
    assert sizes[:, 3, QUANTILES.index(0.5)].median() == pytest.approx(1.0, abs=0.5)
    assert told[0][2]["cause"] > 5.0  # ln 563 = 6.3 with nothing learnt


def test_training_ends_when_its_time_is_over(data: Labelled) -> None:
    steps = []
    train(
        data, replace(COURSE, steps=100000), shape=SMALL, seconds=0.5, progress=lambda step, *about: steps.append(step)
    )
    assert steps[-1] < 50000


def test_the_learning_rate_rises_soon_whether_steps_or_time_end_a_training() -> None:
    """A training that its time ends has more steps than it ever does: its rate must not wait for a share of them."""
    course = Course(steps=1_000_000, rate=1e-3)
    rates = [learning_rate(course, done) for done in np.linspace(0.0, 1.0, 201)]
    assert rates[0] == pytest.approx(course.rate / (WARM * course.steps))
    top = int(np.argmax(rates))
    assert 0.98 * course.rate < rates[top] <= course.rate and top / 200 == pytest.approx(WARM, abs=0.006)
    assert np.all(np.diff(rates[top:]) < 0.0) and rates[-1] == pytest.approx(0.02 * course.rate)


def test_a_user_may_lack_channels_logs_and_healthy_days(data: Labelled) -> None:
    draw = Draw(torch.Generator().manual_seed(4))
    batch = draw_batch(data, torch.arange(MACHINES).repeat(4), COURSE, SensorPrior(), draw)
    assert batch.rows.shape == (4 * MACHINES, 2, FEATURES, SAMPLES)
    flags = batch.rows[:, :, -len(CHANNELS) - 3 :, 0]
    channels, days, repeats = flags.split([len(CHANNELS), 2, 1], dim=-1)
    assert torch.all(channels.sum(dim=-1) >= 1.0) and torch.any(channels[..., 0] == 0.0)
    assert torch.all(days.sum(dim=-1) >= 1.0) and torch.all(days[:, 0, 1] == 1.0)
    day_one = (days[..., 0] == 0.0).all(dim=1).float().mean()
    # 256 cases at 12 %: four standard deviations are 8 %
    assert day_one == pytest.approx(COURSE.day_one, abs=0.08)
    again = repeats[..., 0] == 1.0
    assert torch.all(days[again] == 1.0) and not torch.any(again[:, 0])
    # a case in 0.88 · 0.3 has them, and its second log is one of them in 0.4: 27 of 256, within four deviations of 5
    assert int(again.sum()) == pytest.approx(27, abs=20)
    assert torch.all(batch.present[:, 0]) and not torch.all(batch.present)


def test_the_loss_is_least_for_the_truth() -> None:
    """Certain and right costs nothing but the sizes; certain and wrong costs much."""
    effects = torch.tensor([[3, -1]])
    batch = Batch(
        torch.zeros(1), torch.zeros(1), torch.tensor([hypotheses.SINGLE + 3]), effects, torch.tensor([[0.7, 0.0]])
    )
    logits = torch.full((1, hypotheses.HYPOTHESES), -30.0)
    logits[0, hypotheses.SINGLE + 3] = 30.0
    sizes = torch.full((1, hypotheses.MEMBERS.shape[1], len(QUANTILES)), 0.7)
    right = loss_of(logits, sizes, batch, COURSE)
    assert float(right["cause"]) == pytest.approx(0.0, abs=1e-6) and float(right["size"]) == 0.0
    wrong = loss_of(logits.roll(1, dims=1), sizes + 0.2, batch, COURSE)
    assert float(wrong["cause"]) > 50.0
    # the mean of (1 − level) · 0.2 over the levels, whose mean is one half
    assert float(wrong["size"]) == pytest.approx(0.1, rel=1e-5)


def test_sizes_that_nobody_knows_cost_nothing() -> None:
    effects = torch.tensor([[3, 5], [4, -1]])
    sizes = torch.tensor([[0.7, float("nan")], [float("nan"), float("nan")]])
    truth = torch.from_numpy(hypotheses.number_of(effects.numpy(), np.zeros(2, dtype=bool)))
    batch = Batch(torch.zeros(2), torch.zeros(2), truth, effects, sizes)
    said = torch.full((2, hypotheses.MEMBERS.shape[1], len(QUANTILES)), 0.9, requires_grad=True)
    losses = loss_of(torch.zeros(2, hypotheses.HYPOTHESES), said, batch, COURSE)
    assert losses["size"].item() == pytest.approx(0.1, rel=1e-5)
    losses["size"].backward()
    assert said.grad is not None and torch.all(torch.isfinite(said.grad))
    assert torch.count_nonzero(said.grad) == torch.count_nonzero(said.grad[0, 3])
