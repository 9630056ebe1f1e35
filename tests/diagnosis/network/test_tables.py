"""Networks of tables: what they are shown, that training and diagnosis compute the same, and that they learn."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from aoro_gym.diagnosis.network import hypotheses
from aoro_gym.diagnosis.network.decision import calibrations_of
from aoro_gym.diagnosis.network.forward import Weights
from aoro_gym.diagnosis.network.shape import QUANTILES, Shape
from aoro_gym.diagnosis.network.tables_features import CHANGE, FEATURES, LEAST_CHANGE, SIZES, features
from aoro_gym.diagnosis.network.tables_forward import (
    CALIBRATION,
    DAY_ONE,
    PAIRED,
    TRAINING,
    forward,
    posterior,
    shipped,
    trained,
)
from aoro_gym.diagnosis.simulation.prior import Prior, SensorPrior
from aoro_gym.diagnosis.simulation.turns import READ
from aoro_gym.effects.catalogue import IDS

torch = pytest.importorskip("torch")

from aoro_gym.diagnosis.network import tables_program  # noqa: E402
from aoro_gym.diagnosis.network.dataset import Amount  # noqa: E402
from aoro_gym.diagnosis.network.program import Program  # noqa: E402
from aoro_gym.diagnosis.network.sensing import Draw  # noqa: E402
from aoro_gym.diagnosis.network.tables_dataset import TablePrior, Tables, draw_batch, simulate  # noqa: E402
from aoro_gym.diagnosis.network.tables_model import TablesNetwork  # noqa: E402

SMALL = Shape(width=16, heads=2, within=0, across=1, kept=1, rank=2)
MACHINES, TURNS = 200, 6
USUAL = np.array([2.0, 69.0, 99.0, 0.11, 63.0, 77.0])
"""Figures of a full turn."""
PEAK = READ.index("first_peak_L_per_min")


@pytest.fixture(scope="module")
def data() -> Tables:
    """Machines that are healthy on their second day, or whose first peaks are higher with effect 3 and lower with effect 9,
    by a fifth."""
    rng = np.random.default_rng(0)
    wrong = rng.choice([-1, 3, 9], (MACHINES, 2))
    wrong[:, 0] = -1
    figures = USUAL * np.exp(0.05 * rng.standard_normal((MACHINES, 1, TURNS, len(READ)))) * np.ones((1, 2, 1, 1))
    figures[..., PEAK] *= np.select([wrong == 3, wrong == 9], [1.2, 0.8], 1.0)[..., None]
    figures[0, 1, 0] = np.nan
    effects = np.stack([wrong, -np.ones_like(wrong)], axis=-1)
    return Tables(
        figures=torch.as_tensor(figures, dtype=torch.float32),
        signals=torch.as_tensor(np.tile([1.0, 0.75, 0.5, -1.0, -0.75, -0.5], (MACHINES, 1)), dtype=torch.float32),
        hypothesis=torch.as_tensor(hypotheses.number_of(effects, np.zeros(wrong.shape, dtype=bool))),
        effects=torch.as_tensor(effects),
        sizes=torch.ones(MACHINES, 2, 2),
    )


def batch_of(data: Tables, machines: Any, *, day_one: bool | None = None, prior: TablePrior | None = None):
    return draw_batch(
        data, machines, tables_program.course(1, 1), Draw(torch.Generator().manual_seed(1)),
        prior=prior or TablePrior(), sensors=SensorPrior(), day_one=day_one,
    )  # fmt: skip


def columns(rows) -> tuple[np.ndarray, ...]:
    """Parts of features (..., FEATURES): the signal's three, and nine of all figures."""
    values = np.asarray(rows)
    return values[..., :3], *np.split(values[..., 3:], 9, axis=-1)


# ---- what is shown ----


def test_a_turn_is_shown_as_it_is_written():
    """Figures over their usual sizes, what changed over what just counts, standard deviations, and what is known."""
    before, after = USUAL, USUAL * 1.02
    has = np.ones((2, len(READ)))
    has[0, 1] = has[1, 2] = 0.0
    std, has_std = np.full((2, len(READ)), 0.3), np.zeros((2, len(READ)))
    has_std[1, 0] = 1.0
    rows = features(np, np.array(-0.75), np.stack([before, after]), has, std, has_std)
    assert rows.shape == (FEATURES,)
    signal, first, second, change, known, knows, std_before, std_after, said_before, said_after = columns(rows)
    np.testing.assert_allclose(signal, [-0.75, 0.75, -1.0])
    np.testing.assert_allclose(first, has[0] * before / SIZES)
    np.testing.assert_allclose(second, has[1] * after / SIZES)
    unit = CHANGE * np.where(has[0] > 0.0, before, after) + LEAST_CHANGE
    np.testing.assert_allclose(change, has[0] * has[1] * np.arcsinh(0.02 * before / unit))
    np.testing.assert_array_equal([known, knows], has)
    np.testing.assert_allclose(std_after, [np.arcsinh(0.3 / unit[0]), 0.0, 0.0, 0.0, 0.0, 0.0])
    assert not std_before.any() and not said_before.any() and said_after.tolist() == [1.0] + 5 * [0.0]


def test_training_and_diagnosis_are_shown_the_same():
    rng = np.random.default_rng(2)
    parts = [rng.uniform(-1.0, 1.0, (4, 3)), *(rng.uniform(0.1, 9.0, (4, 3, 2, len(READ))) for _ in range(4))]
    parts[2], parts[4] = np.round(parts[2] / 9.0), np.round(parts[4] / 9.0)
    found = features(torch, *map(torch.as_tensor, parts))
    np.testing.assert_allclose(np.asarray(found), features(np, *parts), rtol=1e-12)


def test_without_torch_the_same_is_computed():
    """Within single precision."""
    network = TablesNetwork(SMALL).eval()
    rows, present = (
        torch.randn(3, 5, FEATURES),
        torch.tensor([[1, 1, 1, 1, 1], [1, 0, 0, 1, 0], [1, 0, 0, 0, 0]]).bool(),
    )
    with torch.no_grad():
        expected = network(rows, present)
    found = forward(network.weights(np.ones(len(IDS))), rows.numpy(), present.numpy())
    for one, other in zip(found, expected, strict=True):
        np.testing.assert_allclose(one, other.numpy(), atol=2e-5)


def test_probabilities_and_sizes_are_means_of_networks():
    scales = np.linspace(1.0, 2.0, len(IDS))
    both = [TablesNetwork(SMALL).weights(scales) for _ in range(2)]
    rows = np.random.default_rng(3).standard_normal((2, FEATURES)).astype(np.float32)
    one, other, mean = (posterior(networks, rows) for networks in ([both[0]], [both[1]], both))
    np.testing.assert_allclose(mean.probabilities, 0.5 * (one.probabilities + other.probabilities))
    np.testing.assert_allclose(mean.quantiles, 0.5 * (one.quantiles + other.quantiles))
    assert mean.probabilities.sum() == pytest.approx(1.0) and np.all(np.diff(mean.quantiles, axis=1) >= 0.0)


# ---- what is drawn ----


def test_tables_lack_figures_rows_and_healthy_days(data):
    batch = batch_of(data, torch.arange(MACHINES).repeat(4))
    assert batch.rows.shape == (4 * MACHINES, TURNS, FEATURES)
    _, first, second, change, known, knows, *_, said_before, said_after = columns(batch.rows)
    there = batch.present.numpy()
    rows = there.sum(axis=1)
    assert set(rows.tolist()) == {1, 2, 3, 4, 5, 6} or set(rows.tolist()) == {0, 1, 2, 3, 4, 5, 6}
    assert not first[known == 0.0].any() and not second[knows == 0.0].any()
    assert not change[(known == 0.0) | (knows == 0.0)].any()
    paired = known.any(axis=(1, 2))
    assert np.mean(paired) == pytest.approx(0.65, abs=0.07)  # four standard errors of 800 cases
    assert not said_before[known == 0.0].any() and not said_after[knows == 0.0].any()
    assert np.mean(said_after.any(axis=(1, 2))) == pytest.approx(TablePrior().std_known, abs=0.07)
    assert not knows[~there].any()


def test_day_one_has_no_healthy_figures(data):
    for day_one in (True, False):
        known = columns(batch_of(data, torch.arange(MACHINES), day_one=day_one).rows)[4]
        assert bool(known.any()) != day_one


def test_a_turn_without_an_end_has_no_figures(data):
    """The first turn of the first machine's later day."""
    prior = replace(TablePrior(), columns=(1.0, 0.0, 0.0), empty=0.0, usual_rows=1.0)
    batch = batch_of(data, torch.zeros(50, dtype=torch.int64), day_one=True, prior=prior)
    assert not batch.present[:, 0].any() and torch.isfinite(batch.rows).all()


def test_what_no_effect_makes_lies_outside(data):
    prior = replace(TablePrior(), misread=1.0)
    batch = batch_of(data, torch.arange(MACHINES), prior=prior)
    assert torch.all(batch.hypothesis == hypotheses.OUTSIDE) and torch.all(batch.effects == -1)
    assert not torch.any(batch_of(data, torch.arange(MACHINES), prior=replace(prior, misread=0.0)).hypothesis == 1)


def test_simulated_tables_are_the_same_again():
    """Of two machines with one healthy and one later day; what is wrong belongs to the later one."""
    one, other = (simulate(Prior(), Amount(2, later=1, manoeuvres=1, seed=4), "cpu")[0] for _ in range(2))
    assert one.figures.shape == (2, 2, 1, len(READ))
    assert torch.equal(torch.nan_to_num(one.figures), torch.nan_to_num(other.figures))
    assert torch.all(one.hypothesis[:, 0] == hypotheses.NOTHING) and torch.equal(one.hypothesis, other.hypothesis)


# ---- training ----


def test_networks_learn_and_are_calibrated_and_kept(data, tmp_path: Path, monkeypatch):
    """What tells two effects apart; then the same command has nothing left to do."""
    monkeypatch.setattr(tables_program, "simulate", lambda *args, **kwargs: (data, np.ones(len(IDS))))
    course = replace(tables_program.course(100, 32), rate=6e-3)
    program = Program(Amount(MACHINES, later=1), 1, course, shape=SMALL)
    told: list[float] = []
    result = tables_program.run(program, "cpu", tmp_path, lambda text, share: told.append(share))
    assert told == sorted(told)
    rates = result["rates"][PAIRED]
    # of ten machines, eight days each, half of them wrong
    assert rates["cases"] == 80 and rates["named_first"] > 0.8 and result["rates"][DAY_ONE]["named_first"] > 0.5
    assert set(calibrations_of(tmp_path / CALIBRATION)) == {PAIRED, DAY_ONE}
    weights = Weights.load(tmp_path / "tables_0.safetensors")
    assert weights.shape == SMALL
    stamp = (tmp_path / "tables_0.safetensors").stat().st_mtime_ns
    assert tables_program.run(program, "cpu", tmp_path) == result
    assert (tmp_path / "tables_0.safetensors").stat().st_mtime_ns == stamp
    assert (tmp_path / TRAINING).exists()


def test_what_is_shipped_belongs_together():
    (weights,) = trained()
    assert weights.arrays["wide.weight"].shape[1] == FEATURES
    assert set(shipped()) == {PAIRED, DAY_ONE}
    found = posterior([weights], np.zeros((1, FEATURES), np.float32))
    assert found.quantiles.shape == (len(IDS), len(QUANTILES))
