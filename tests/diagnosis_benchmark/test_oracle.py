"""What an oracle sees and removes, against closed forms."""

from typing import Any

import numpy as np
import pytest
from scipy.linalg import cholesky, toeplitz

from aoro_gym.diagnosis.noise import Noise
from aoro_gym.diagnosis.nuisances import Nuisances
from aoro_gym.diagnosis.recording import read_recording
from aoro_gym.diagnosis.replay import Replay, Simulator, Variants
from aoro_gym.diagnosis_benchmark.oracle import (
    Neighbours,
    consult,
    evidence_given,
    evidence_of,
    ideal_gap_closure,
    information,
    is_detectable,
)
from aoro_gym.machine import Machine
from aoro_gym.simulation.log import write_log
from tests.diagnosis_benchmark.suites import NOISE, RESTING, SAMPLES, deviation, write_case

COUNT = 60
SHAPE = np.sin(np.linspace(0.0, np.pi, COUNT)) ** 2
WHITE = Noise(np.r_[4.0, np.zeros(COUNT - 1)])
COLOURED = Noise(4.0 * 0.8 ** np.arange(COUNT))


@pytest.fixture(scope="module")
def twins() -> Neighbours:
    """Of all tests, whose cases are of one machine under the same commands: it is simulated once."""
    return Neighbours()


def test_evidence_in_white_noise_is_the_squared_ratio():
    assert evidence_of(SHAPE, WHITE) == pytest.approx(np.sum(np.square(SHAPE - SHAPE.mean())) / 4.0, rel=1e-12)
    assert evidence_of(3.0 * SHAPE, WHITE) == pytest.approx(9.0 * evidence_of(SHAPE, WHITE), rel=1e-12)
    assert evidence_of(SHAPE + 7.0, COLOURED) == pytest.approx(evidence_of(SHAPE, COLOURED), rel=1e-9)
    assert evidence_of(np.full(COUNT, 7.0), WHITE) == pytest.approx(0.0, abs=1e-12)


def test_evidence_is_the_mean_of_the_likelihood_ratio():
    """Twice its logarithm, either hypothesis with the zero that suits it best: mean λ, variance 4 λ."""
    covariance = toeplitz(COLOURED.covariance)
    inverse, ones = np.linalg.inv(covariance), np.ones(COUNT)
    free = inverse - np.outer(inverse @ ones, inverse @ ones) / (ones @ inverse @ ones)
    rng = np.random.default_rng(3)
    noise = cholesky(covariance, lower=True) @ rng.standard_normal((COUNT, 20_000))
    seen = 2.0 * SHAPE[:, None] + noise + rng.standard_normal(20_000)  # any zero
    miss = seen - 2.0 * SHAPE[:, None]
    ratio = np.einsum("ij,ik,kj->j", seen, free, seen) - np.einsum("ij,ik,kj->j", miss, free, miss)
    evidence = evidence_of(2.0 * SHAPE, COLOURED)
    assert np.mean(ratio) == pytest.approx(evidence, abs=4.0 * np.sqrt(4.0 * evidence / 20_000))


def test_what_may_be_elsewhere_anyway_adds_to_the_noise():
    """λ = Δᵀ (C + J R Jᵀ)⁻¹ Δ, the zero held by nothing: a constant of a standard deviation of 1e6 beside them."""
    rng = np.random.default_rng(4)
    slopes = np.column_stack([SHAPE + 0.3 * rng.standard_normal(COUNT), np.linspace(0.0, 2.0, COUNT)])
    correlation = np.array([[1.0, 0.6], [0.6, 1.0]])
    whole = information(np.column_stack([2.0 * SHAPE, slopes]), COLOURED)
    covariance = toeplitz(COLOURED.covariance) + slopes @ correlation @ slopes.T + 1e12
    expected = 4.0 * SHAPE @ np.linalg.solve(covariance, SHAPE)
    # the constant's 1e12 costs as many digits of the sixteen as it is larger than the noise
    assert evidence_given(whole, np.linalg.inv(correlation)) == pytest.approx(expected, rel=1e-3)
    assert evidence_given(whole, 1e12 * np.eye(2)) == pytest.approx(evidence_of(2.0 * SHAPE, COLOURED), rel=1e-6)


def test_detectable_begins_where_chi_square_leaves_a_hundredth():
    assert is_detectable(6.64) and not is_detectable(6.63)  # 2.5758²: the normal's 99 %, two-sided


def test_what_another_day_does_remains():
    """A day that adds a tenth of the deviation leaves (1/11)² of the gap."""
    deviation, expected = SHAPE, np.linspace(0.0, 3.0, COUNT)
    assert ideal_gap_closure(expected + 1.1 * deviation, deviation, expected, 0.0) == pytest.approx(1.0 - 1.0 / 121.0)
    assert ideal_gap_closure(expected + deviation, deviation, expected, 0.0) == pytest.approx(1.0)
    assert ideal_gap_closure(expected + 0.5 * deviation, deviation, expected, 0.0) == pytest.approx(0.0)
    assert np.isnan(ideal_gap_closure(expected, deviation, expected, 0.1))


def test_a_case_is_seen_through_the_noise_of_its_own_sensors(tmp_path, twins):
    write_case(tmp_path / "case", tmp_path / "exact.npz", 0.05, day=0.025, seed=5)
    oracle = consult(tmp_path / "case", tmp_path / "exact.npz", ["joint_angle"], twins=twins)
    bump = deviation(0.05)
    # two logs; the variance of white noise from 2 x 71 samples of rest has a standard error of sqrt(2 / 142)
    expected = 2.0 * np.sum(np.square(bump - bump.mean())) / NOISE**2
    assert oracle.noise == pytest.approx(expected, rel=4.0 * np.sqrt(2.0 / (2 * (RESTING + 1))))
    assert oracle.detectable and oracle.evidence < oracle.noise
    assert set(oracle.shrinkage) == {("left_100", "joint_angle"), ("steps", "joint_angle")}
    # gap 1.5, left 0.5 of the bump; the mean square of noise differs from its variance by sqrt(2 / F) of it
    slack = 4.0 * 2.0 * NOISE**2 * np.sqrt(2.0 / SAMPLES + 2.0 / RESTING) / np.mean(np.square(1.5 * bump))
    cross = 4.0 * 2.0 * np.sqrt(2.0) * NOISE / np.sqrt(np.sum(np.square(1.5 * bump)))
    for share in oracle.shrinkage.values():
        assert share == pytest.approx(1.0 - 1.0 / 9.0, abs=slack + cross)


def test_noise_is_no_gap(tmp_path, twins):
    """Where nothing but the deviation differs, S is 1, however much noise there is in the logs of both days."""
    found = []
    for seed in range(6):
        write_case(tmp_path / f"{seed}", tmp_path / f"{seed}.npz", 0.006, seed=seed)
        found += consult(
            tmp_path / f"{seed}", tmp_path / f"{seed}.npz", ["joint_angle"], twins=twins
        ).shrinkage.values()
    # standard errors of the 12 logs' mean squares and of the 6 variances that 142 samples of rest give, both of two noises
    error = 2.0 * NOISE**2 * np.sqrt(2.0 / SAMPLES / 12.0 + 2.0 / (2.0 * RESTING) / 6.0)
    gap = np.mean(np.square(deviation(0.006)))
    assert len(found) == 12
    assert 4.0 * error < 0.5 * NOISE**2, "noise that is forgotten, of one day at least, would show"
    assert np.mean(found) == pytest.approx(1.0, abs=4.0 * error / gap)


def test_what_cannot_be_seen_is_not_asked_for(tmp_path, twins):
    write_case(tmp_path / "case", tmp_path / "exact.npz", 1e-5, seed=6)
    oracle = consult(tmp_path / "case", tmp_path / "exact.npz", ["joint_angle"], twins=twins)
    assert not oracle.detectable and not oracle.shrinkage


@pytest.mark.parametrize(("size", "asked"), [(0.05, 1), (1e-4, 2)])
def test_logs_are_asked_until_nothing_is_rejected(tmp_path, twins, size, asked):
    """What one log shows is enough, or all are asked, and another one takes nothing away."""
    place, exact, found = tmp_path / "case", tmp_path / "exact.npz", []
    write_case(place, exact, size, seed=5)
    for remaining in (2, 1):
        oracle = consult(place, exact, ["joint_angle"], twins=twins)
        found.append(oracle.evidence)
        assert oracle.detectable == (asked < 2)
        if remaining == 2:
            for purpose in ("logs", "healthy"):
                sorted((place / purpose).glob("*.csv"))[-1].unlink()
    # the noise of two logs' rests is not quite that of one's
    assert found[0] == pytest.approx(found[1], rel=0.5) if asked == 1 else found[0] > found[1]


@pytest.mark.parametrize(("size", "seen"), [(1.0, False), (5.0, True)])
def test_what_another_day_can_do_instead_is_not_detectable(tmp_path, twins, size, seen):
    """Edges of the valve a standard deviation off, as on any day, are no deviation, however far they show above the noise:
    at a price of one a side they explain themselves, where 6.6 is asked. Five standard deviations are one."""
    place = tmp_path / "case"
    write_case(place, tmp_path / "exact.npz", 0.05, seed=9)
    logs = [read_recording(path) for path in sorted((place / "logs").glob("*.csv"))]
    day = Nuisances(Machine.load(place / "machine.toml"), "day")
    points = np.zeros((2, len(day.keys)))
    points[0, day.keys.index("steering.valve.nominal_flow_left")] = size
    points[0, day.keys.index("steering.valve.nominal_flow_right")] = size
    shown = Simulator().run([Replay(Variants.of(day.machines(points), [], 2), log) for log in logs])
    arrays: dict[str, Any] = {
        f"{log.name}/joint_angle/{which}": signals["joint_angle"][:, column]
        for log, signals in zip(logs, shown, strict=True)
        for column, which in enumerate(("with", "without"))
    }
    np.savez(tmp_path / "exact.npz", **arrays)
    oracle = consult(place, tmp_path / "exact.npz", ["joint_angle"], twins=twins)
    assert oracle.noise > 100.0
    assert oracle.detectable == seen


@pytest.mark.parametrize(("later", "seen"), [(0, False), (40, True)])
def test_of_two_effects_each_is_seen_beside_the_other_at_any_strength(tmp_path, twins, later, seen):
    """Two bumps of one shape, the second ``later`` samples on: at the same place either could be all there is."""
    place, exact = tmp_path / "case", tmp_path / "exact.npz"
    write_case(place, exact, 0.05, seed=5)
    with np.load(exact) as arrays:
        both = dict(arrays)
    for key in [key for key in both if key.endswith("/without")]:
        log, healthy = key.removesuffix("/without"), both[key]
        one, other = deviation(0.05), np.roll(deviation(0.05), later)
        both[f"{log}/with"] = healthy + one + other
        both[f"{log}/without one"], both[f"{log}/without other"] = healthy + other, healthy + one
    np.savez(exact, **both)
    oracle = consult(place, exact, ["joint_angle"], twins=twins)
    assert oracle.detectable
    assert list(oracle.each) == ["one", "other"]
    assert oracle.each_detectable == seen
    assert all((oracle.each[name] > 6.64) == seen for name in oracle.each)


def test_without_a_healthy_day_the_twin_is_what_is_expected(tmp_path):
    """Logs of the twin itself, plus the deviation: the oracle leaves nothing."""
    place = tmp_path / "case"
    write_case(place, tmp_path / "exact.npz", 0.05, healthy=False, seed=7)
    rng = np.random.default_rng(8)
    logs = [read_recording(path) for path in sorted((place / "logs").glob("*.csv"))]
    twin = Variants(Machine.load(place / "machine.toml"))
    shown = Simulator().run([Replay(twin, log) for log in logs])
    for log, signals in zip(logs, shown, strict=True):
        twin = signals["joint_angle"][:, 0]
        table = {
            "time_s": 0.01 * np.arange(SAMPLES),
            "steering_signal": np.r_[log.commands[:, 0], 0.0],
            "joint_angle_rad": twin + deviation(0.05) + 1e-4 * rng.standard_normal(SAMPLES),
        }
        write_log(place / "logs" / f"{log.name}.csv", table)
    oracle = consult(place, tmp_path / "exact.npz", ["joint_angle"])
    # the twin starts where the log rests, to 1e-4 rad of noise over the root of 71 samples; the gap is 0.02 rad
    assert list(oracle.shrinkage.values()) == pytest.approx([1.0, 1.0], abs=1e-3)
