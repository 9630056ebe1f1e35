"""Next experiments: entropies in closed form, draws that keep their proportions, and observers whose gain is known."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import pytest

from aoro_gym.diagnosis import next_experiments as module
from aoro_gym.diagnosis.network import hypotheses
from aoro_gym.diagnosis.network.cases import Posterior
from aoro_gym.diagnosis.network.features import CHANNELS, FEATURES, SAMPLES
from aoro_gym.diagnosis.network.shape import QUANTILES
from aoro_gym.diagnosis.next_experiments import (
    DURATION,
    KEPT,
    SETTLE,
    UNLIKELY,
    Candidate,
    Prospects,
    catalogue,
    drawn_hypotheses,
    drawn_worlds,
    entropy,
    experiments_of,
    magnitudes_of,
    next_experiments,
)
from aoro_gym.diagnosis.recording import REST, TICK, Recording
from aoro_gym.diagnosis.replay import Simulator
from aoro_gym.effects.catalogue import EFFECTS, IDS
from aoro_gym.machine import Machine

MACHINE = Machine.load("aoro")
GAIN = hypotheses.SINGLE + IDS.index("sensor_gain")
FRICTION = hypotheses.SINGLE + IDS.index("seal_friction")
DIFFERENCE = 4  # row of the angle's difference between the days
FLAGS = FEATURES - len(CHANNELS) - 3
SIZE = {"sensor_gain": 0.1, "seal_friction": 1500.0}


def posterior_of(**probabilities: float) -> Posterior:
    """Of hypotheses by name; all effects are as large as :data:`SIZE` says."""
    shares = np.zeros(hypotheses.HYPOTHESES)
    for name, share in probabilities.items():
        shares[
            getattr(hypotheses, name.upper(), None) or (hypotheses.SINGLE + IDS.index(name) if name in IDS else 0)
        ] = share
    sizes = np.array([SIZE.get(name, 0.0) for name in IDS])
    return Posterior(shares, np.repeat(sizes[:, None], len(QUANTILES), axis=1))


def recording(name: str, channels: Sequence[str] = CHANNELS, noise: float = 3e-4) -> Recording:
    """A standstill."""
    rng = np.random.default_rng(len(name))
    scale = {"joint_angle": noise}
    values = {channel: scale.get(channel, 1e8 * noise) * rng.standard_normal(301) for channel in channels}
    return Recording(name, np.zeros((300, 2)), values, 300, 0.0)


def test_catalogue_can_be_recorded() -> None:
    candidates = catalogue(MACHINE)
    assert len({one.name for one in candidates}) == len(candidates)
    for one in candidates:
        assert one.commands.shape == (round(DURATION / TICK), 2)
        assert len(one.commands) < SAMPLES
        assert np.all(np.abs(one.commands) <= 1.0)
        moves = np.flatnonzero(np.any(one.commands, axis=1))
        assert moves[0] >= round(REST / TICK)
        assert moves[-1] < round((DURATION - SETTLE) / TICK)
        assert abs(one.start_angle) <= float(np.asarray(MACHINE.joint.range))


def test_entropy_in_bits() -> None:
    np.testing.assert_allclose(entropy(np.array([[0.125] * 8, [1.0] + [0.0] * 7])), [3.0, 0.0], atol=1e-12)


def test_hypotheses_are_drawn_as_often_as_they_are_likely() -> None:
    """Up to one draw: systematic resampling; what is unlikely or outside of the catalogue is not."""
    shares = np.zeros(hypotheses.HYPOTHESES)
    shares[[hypotheses.NOTHING, hypotheses.OUTSIDE, GAIN, FRICTION]] = 0.4, 0.395, 0.13, 0.07
    shares[hypotheses.PAIR] = 0.5 * UNLIKELY
    for seed in range(20):
        drawn = drawn_hypotheses(shares, 12, np.random.default_rng(seed))
        for number in (hypotheses.NOTHING, GAIN, FRICTION):
            assert abs(np.sum(drawn == number) - 12 * shares[number] / 0.6) < 1.0
        assert set(drawn) <= {hypotheses.NOTHING, GAIN, FRICTION}


@pytest.mark.parametrize("name", ["seal_friction", "valve_hysteresis", "oil_temperature", "sensor_delay"])
@pytest.mark.parametrize("share", [0.2, 0.8])
def test_magnitudes_bring_the_change_that_is_asked_for(name: str, share: float) -> None:
    """Of 64 logarithmically even sizes a side, from a tenth of it, none lies within a tenth of the one that is looked
    for in 0.3 % of draws, (1 − 0.2 / ln 10)⁶⁴."""
    effect = EFFECTS[name]
    end = tuple(one.none + share * (one.high - one.none) for one in effect.magnitudes)
    without = float(np.asarray(effect.measured(MACHINE, *effect.none)[0]))
    wanted = float(np.asarray(effect.measured(MACHINE, *end)[0])) - without
    found = magnitudes_of(effect, MACHINE, wanted, np.random.default_rng(3))
    assert float(np.asarray(effect.measured(MACHINE, *found)[0])) - without == pytest.approx(wanted, rel=0.1)


def test_worlds_differ_by_day_and_effect() -> None:
    posterior = posterior_of(nothing=0.5, seal_friction=0.5)
    worlds = drawn_worlds(MACHINE, posterior, np.array([0, FRICTION]), np.random.default_rng(1))
    assert [world.hypothesis for world in worlds] == [0, FRICTION]
    measured = [
        [float(np.asarray(EFFECTS["seal_friction"].measured(day.machine, 0.0)[0])) for day in (one.healthy, one.later)]
        for one in worlds
    ]
    for (before, after), change in zip(measured, (0.0, SIZE["seal_friction"]), strict=True):
        assert before != after
        # a day changes friction by some per cent of it; nearest draws miss a change by as much
        assert after - before == pytest.approx(change, abs=0.1 * (before + change))


def observer(
    monkeypatch: pytest.MonkeyPatch,
    now: Posterior,
    said: Callable[[np.ndarray], int | None],
    candidates: int | None = None,
) -> None:
    """Networks that keep a log's features as they are, and that are sure of the hypothesis which ``said`` makes of the
    features (FEATURES, SAMPLES) of the log that was added, or of as much as ``now`` where that is None."""

    def posteriors(networks: Any, tokens: Sequence[np.ndarray]) -> tuple[np.ndarray, None]:
        answers = [said(rows[-1]) for rows in tokens[0]]
        sure = np.eye(hypotheses.HYPOTHESES)
        return np.stack([now.probabilities if one is None else sure[one] for one in answers]), None

    monkeypatch.setattr(module, "tokens_of", lambda networks, rows: [rows])
    monkeypatch.setattr(module, "posteriors", posteriors)
    few = catalogue(MACHINE)[-2:][:candidates]
    monkeypatch.setattr(module, "catalogue", lambda machine: few)


def asked(now: Posterior, channels: Sequence[str] = CHANNELS, healthy: bool = True) -> tuple[Any, ...]:
    logs = [recording("later", channels)]
    before = [recording("before", channels)] if healthy else []
    return next_experiments(logs, before, MACHINE, (), now, simulator=Simulator(), worlds=4)


def told_by_gain(rows: np.ndarray) -> int:
    """Held at the stop, a gain of a tenth shows by 0.05 rad, days alone by 0.02 rad; the features' unit is 0.01 rad."""
    return GAIN if np.abs(np.sinh(rows[DIFFERENCE])).max() > 3.5 else hypotheses.NOTHING


def test_the_manoeuvre_that_alone_tells_gains_all_that_is_open(monkeypatch: pytest.MonkeyPatch) -> None:
    """The observer tells causes at the stop alone; the simulated logs show it which is right."""
    now = posterior_of(nothing=0.5, sensor_gain=0.5)
    observer(monkeypatch, now, lambda rows: told_by_gain(rows) if rows[0].max() > 0.95 else None, 2)
    (found,) = asked(now)
    assert (found.name, found.gain) == ("hold_at_the_stop", pytest.approx(np.log2(2.0 * (1.0 - KEPT) + KEPT)))
    assert found.gain_error == pytest.approx(0.0, abs=1e-12)
    assert [set(pair) for pair in found.apart] == [{"nothing", "sensor_gain"}]


def test_an_observer_that_is_sure_of_the_wrong_one_gains_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    """Though its entropy falls to zero."""
    now = posterior_of(nothing=0.5, sensor_gain=0.5)
    observer(monkeypatch, now, lambda rows: GAIN, 1)
    assert asked(now) == ()


def test_nothing_is_told_apart_by_being_sure_of_one() -> None:
    after = np.broadcast_to(np.eye(hypotheses.HYPOTHESES)[GAIN], (1, 2, hypotheses.HYPOTHESES))
    now = posterior_of(nothing=0.5, sensor_gain=0.5).probabilities
    assert Prospects(catalogue(MACHINE)[:1], np.array([0, GAIN]), now, after, [], []).apart(0) == ()


def test_pressures_are_offered_where_they_are_not_logged(monkeypatch: pytest.MonkeyPatch) -> None:
    now = posterior_of(nothing=0.5, sensor_gain=0.5)
    observer(monkeypatch, now, lambda rows: told_by_gain(rows) if rows[FLAGS + 1, 0] else None, 1)
    (found,) = asked(now, CHANNELS[:1])
    assert found.name.endswith("_with_pressures")
    assert "pressures of both ports" in found.description
    assert found.gain == pytest.approx(1.0, abs=KEPT)


def test_without_healthy_logs_the_later_day_is_recorded_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    now = posterior_of(nothing=0.5, sensor_gain=0.5)
    days = FLAGS + len(CHANNELS)
    seen = []
    observer(monkeypatch, now, lambda rows: seen.append(rows[days : days + 2, 0].tolist()), 1)
    assert asked(now, healthy=False) == ()
    assert seen == [[0, 1]] * 4


@pytest.mark.parametrize("now", [{"nothing": 1.0}, {"sensor_gain": 0.5, "outside": 0.5}])
def test_nothing_is_offered_where_no_two_causes_can_be_simulated(now: dict[str, float]) -> None:
    assert asked(posterior_of(**now)) == ()


def test_a_manoeuvre_whose_twins_diverge_is_left_out() -> None:
    after = np.full((2, 2, hypotheses.HYPOTHESES), np.nan)
    after[0] = np.eye(hypotheses.HYPOTHESES)[[0, GAIN]]
    now = posterior_of(nothing=0.5, sensor_gain=0.5).probabilities
    candidates = catalogue(MACHINE)[:2]
    found = experiments_of(Prospects(candidates, np.array([0, GAIN]), now, after, [], []))
    assert [(one.name, one.gain) for one in found] == [(candidates[0].name, pytest.approx(1.0, abs=KEPT))]


def test_what_a_second_manoeuvre_adds(monkeypatch: pytest.MonkeyPatch) -> None:
    """Three manoeuvres, of which each halves what is left, but the last repeats the first: tokens are their kinds."""
    kinds = np.array([1.0, 2.0, 1.0], dtype=np.float32)

    def posteriors(networks: Any, tokens: Sequence[np.ndarray]) -> tuple[np.ndarray, None]:
        left = [4 // 2 ** len(set(one.ravel()) - {0.0}) for one in tokens[0]]
        shares = np.zeros((len(left), hypotheses.HYPOTHESES))
        for row, count in enumerate(left):
            shares[row, :count] = 1.0 / count
        return shares, None

    monkeypatch.setattr(module, "posteriors", posteriors)
    now = np.zeros(hypotheses.HYPOTHESES)
    now[:4] = 0.25
    added = np.broadcast_to(kinds[:, None, None, None], (3, 2, 1, 1))
    blank = Candidate("", "", np.zeros((1, 2)), 0.0)
    found = Prospects(
        (blank,) * 3, np.zeros(2, int), now, np.zeros((3, 2, len(now))), [np.zeros((1, 1, 1), np.float32)], [added]
    )
    np.testing.assert_allclose(found.gains_beside((), 0), [[1.0] * 2, [2.0] * 2, [1.0] * 2], atol=2.0 * KEPT)


def test_simulated_sensors_are_as_noisy_as_those_that_logged() -> None:
    """400 draws of 320 samples; a standstill of 2 · 300 samples gives its deviation within 1/√1200, 3 %."""
    drawn = module._Sensors.drawn([recording("a"), recording("b")], 200, 320, np.random.default_rng(0)).noise
    within = drawn - drawn.mean(axis=-1, keepdims=True)
    np.testing.assert_allclose(within.std(axis=(0, 1, 3)), [3.5e-4, *[3.2e4] * 3], rtol=0.15)
    zeros = drawn.mean(axis=-1).std(axis=(0, 1))
    np.testing.assert_allclose(zeros, [8e-4, *[8e4] * 3], rtol=0.15)
