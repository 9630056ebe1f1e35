"""Closure of the gap: S of gaps that are known, its intervals, what refitting may and may not take, and the black box."""

from typing import Any

import numpy as np
import pytest
from scipy.linalg import toeplitz

from aoro_gym.diagnosis.gap_closure import _absorbed, _noise, _ridge, black_box, gap_closures, typical
from aoro_gym.diagnosis.noise import Noise
from aoro_gym.diagnosis.problem import START_JITTER, ZEROS, Reference
from aoro_gym.diagnosis.recording import TICK
from tests.diagnosis.synthetic import STD, problem_of

COUNT = 300
TIME = TICK * np.arange(COUNT)
WAVE = np.sin(2.0 * np.pi * 1.3 * TIME)
QUIET = {name: 1e-9 * std for name, std in STD.items()}


def stacked(problem: Any, parts: dict[str, np.ndarray]) -> Any:
    return np.concatenate([parts[name] for _, name in problem.blocks])


def test_half_of_a_gap_leaves_a_quarter_of_its_square():
    """Without noise: S = 1 − (1/2)² at every sample, so that a resample gives the same."""
    gap = {"joint_angle": 0.02 * WAVE, "pressure_a": 4e5 * np.abs(WAVE)}
    problem = problem_of({"turn": gap}, std=QUIET)
    half = stacked(problem, gap) / 2.0
    found = gap_closures(problem, np.zeros_like(half), half, held_out=True)
    plain = [one for one in found if not one.refitted]
    assert [one.signal for one in plain] == list(gap)
    for one in plain:
        assert (one.S, one.low90, one.high90) == pytest.approx((0.75, 0.75, 0.75), abs=1e-9)
        assert one.before == pytest.approx(np.sqrt(np.mean(gap[one.signal] ** 2)))
        assert one.after == pytest.approx(one.before / 2.0)
        assert one.held_out
    assert typical(found) == pytest.approx(0.75)


def test_noise_is_taken_off():
    """Gaps of three standard deviations in noise, half of each predicted: S is 0.75 on average, and its interval holds that
    nine times of ten, both within four standard errors of 150 draws."""
    rng = np.random.default_rng(1)
    gap = 3.0 * STD["joint_angle"] * WAVE
    found = []
    for _ in range(150):
        problem = problem_of({"turn": {"joint_angle": gap + rng.normal(0.0, STD["joint_angle"], COUNT)}})
        found.append(gap_closures(problem, 0.0 * gap, 0.5 * gap, held_out=False)[0])
    S = np.array([one.S for one in found])
    assert np.mean(S) == pytest.approx(0.75, abs=4.0 * float(np.std(S)) / np.sqrt(150.0))
    held = np.mean([one.low90 <= 0.75 <= one.high90 for one in found])
    assert held == pytest.approx(0.9, abs=4.0 * np.sqrt(0.09 / 150.0))


def test_draws_widen_the_interval():
    """Draws that predict shares a of the gap, without noise: S = 1 − (1 − a)² each, nothing else scatters."""
    gap = 0.02 * WAVE
    problem = problem_of({"turn": {"joint_angle": gap}}, std=QUIET)
    shares = np.linspace(0.5, 1.0, 101)
    one = gap_closures(problem, 0.0 * gap, 0.8 * gap, held_out=True, draws=gap[:, None] * shares)[0]
    np.testing.assert_allclose(one.S, 0.96)
    assert one.low90 == pytest.approx(1.0 - (1.0 - 0.525) ** 2, abs=0.02)
    assert one.high90 == pytest.approx(1.0 - (1.0 - 0.975) ** 2, abs=0.02)


def test_where_there_is_no_gap_there_is_nothing_to_shrink():
    """Noise alone exceeds four standard deviations of its mean square less than once in a thousand times."""
    rng = np.random.default_rng(2)
    for _ in range(30):
        problem = problem_of({"turn": {name: rng.normal(0.0, std, COUNT) for name, std in STD.items()}})
        nothing = np.zeros_like(problem.measured)
        assert gap_closures(problem, nothing, nothing, held_out=True) == ()
    assert typical([]) is None


def test_independent_samples_of_a_known_process():
    """x_k = ρ x_{k−1} + w: Σ ρ^{2|k|} = (1 + ρ²) / (1 − ρ²), so that n is F over that; ends of the record give 2 %."""
    rho, count = 0.8, 1000
    problem = problem_of({"turn": {"joint_angle": np.zeros(count)}})
    problem.noise["joint_angle"] = Noise(1e-6 * rho ** np.arange(count))
    variance, n = _noise(problem, 0)
    assert variance == pytest.approx(1e-6)
    assert n == pytest.approx(count * (1.0 - rho**2) / (1.0 + rho**2), rel=0.02)


def test_noise_of_healthy_recordings_adds_to_it():
    rng = np.random.default_rng(3)
    gap = 0.02 * WAVE
    plain = problem_of({"turn": {"joint_angle": gap}})
    signature = plain.recordings[0].signature
    known = Reference(rng.normal(0.0, STD["joint_angle"], COUNT), np.zeros(COUNT), 2, -1)
    problem = problem_of({"turn": {"joint_angle": gap}}, references={(signature, "joint_angle"): known})
    one = gap_closures(problem, 0.0 * gap, gap, held_out=True)[0]
    assert one.noise == pytest.approx(np.sqrt(1.5) * STD["joint_angle"])


def test_refitting_takes_clock_and_zeros():
    """A twin that is right but for a zero and for what a shifted clock does to first order: as it is nothing is gained, and
    refitted there is no gap before."""
    prediction = {"joint_angle": 0.3 * TIME, "pressure_a": 50e5 * WAVE}
    shifted = {
        name: part + 3.0 * ZEROS[name] + 2.0 * START_JITTER * np.gradient(part) / TICK
        for name, part in prediction.items()
    }
    problem = problem_of({"turn": shifted}, std=QUIET)
    before = stacked(problem, prediction)
    found = gap_closures(problem, before, before, held_out=True)
    np.testing.assert_allclose([one.S for one in found], [0.0, 0.0], atol=1e-12)
    assert not any(one.refitted for one in found)


def test_refitting_absorbs_as_much_noise_as_a_projection_does():
    """tr((I − P) R (I − P)) of each block, dense; P of two signals' shared clock and their zeros."""
    rng = np.random.default_rng(4)
    problem = problem_of({"turn": {name: np.zeros(COUNT) for name in STD}})
    correlations = [0.9 ** np.arange(COUNT), 0.5 ** np.arange(COUNT)]
    for name, correlation in zip(STD, correlations, strict=True):
        problem.noise[name] = Noise(STD[name] ** 2 * correlation)
    basis = np.linalg.qr(rng.standard_normal((2 * COUNT, 3)))[0]
    R = np.zeros((2 * COUNT, 2 * COUNT))
    R[:COUNT, :COUNT], R[COUNT:, COUNT:] = (toeplitz(one) for one in correlations)
    off = np.eye(2 * COUNT) - basis @ basis.T
    left = np.diag(off @ R @ off)
    exact = [1.0 - np.mean(left[:COUNT]), 1.0 - np.mean(left[COUNT:])]
    np.testing.assert_allclose(_absorbed(problem, basis), exact, atol=1e-12)


def test_what_refitting_absorbs_is_not_counted_as_gained():
    """Slow noise, of which a zero takes a good part, and a prediction that is right: S is 1 on average refitted, too, within
    four standard errors."""
    rng = np.random.default_rng(7)
    correlation = 0.97 ** np.arange(COUNT)
    factor = STD["joint_angle"] * np.linalg.cholesky(toeplitz(correlation))
    gap = 3.0 * STD["joint_angle"] * WAVE
    found = []
    for _ in range(100):
        problem = problem_of({"turn": {"joint_angle": gap + factor @ rng.standard_normal(COUNT)}})
        problem.noise["joint_angle"] = Noise(STD["joint_angle"] ** 2 * correlation)
        found += [one.S for one in gap_closures(problem, 0.0 * gap, gap, held_out=True) if one.refitted]
    assert len(found) == 100
    assert np.mean(found) == pytest.approx(1.0, abs=4.0 * float(np.std(found)) / 10.0)


def test_ridge_finds_exact_weights_and_leaves_noise_alone():
    rng = np.random.default_rng(5)
    x, weights = rng.standard_normal((200, 5)), np.arange(1.0, 6.0)
    np.testing.assert_allclose(_ridge(x, x @ weights), weights, rtol=1e-5)
    assert np.linalg.norm(_ridge(x, rng.standard_normal(200))) < np.sqrt(5.0 / 200.0) * 2.0


def boxed(level: float, gap: np.ndarray) -> tuple[Any, Any]:
    """A turn whose angle is off by ``gap``, and what the twin predicted."""
    prediction = np.cumsum(np.r_[np.zeros(60), np.full(COUNT - 60, level)]) * TICK
    return problem_of({"turn": {"joint_angle": prediction + gap}}, level=level), prediction


def test_black_box_learns_what_its_features_tell():
    """A gap that is a delayed share of the command is gone at another level; one of no relation to it is not."""
    rng = np.random.default_rng(6)

    def late(level):
        return level * 0.02 * np.r_[np.zeros(70), np.ones(COUNT - 110), np.zeros(40)]

    fitted, before = boxed(0.6, late(0.6))
    left_out, before_left_out = boxed(0.9, late(0.9))
    S = black_box(fitted, before, left_out, before_left_out)
    assert S is not None
    assert S > 0.95
    strange, prediction = boxed(0.9, 0.02 * np.cumsum(rng.standard_normal(COUNT)) / np.sqrt(COUNT))
    S = black_box(fitted, before, strange, prediction)
    assert S is not None
    assert S < 0.5
