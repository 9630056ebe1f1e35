"""Closure of the gap: S of gaps that are known, its intervals, what refitting may and may not take, and the black box."""

import numpy as np
import pytest
from scipy.linalg import toeplitz

from aoro_gym.diagnosis.closures import _absorbed, _noise, _ridge, black_box, gap_closures, typical
from aoro_gym.diagnosis.noise import Noise
from aoro_gym.diagnosis.recording import TICK
from aoro_gym.diagnosis.signatures import Block, Log
from tests.diagnosis.manoeuvres import blank, turn

COUNT = 300
TIME = TICK * np.arange(COUNT)
WAVE = np.sin(2.0 * np.pi * 1.3 * TIME)
STD = 1e-3
NOTHING = np.empty((COUNT, 0))


def block(measured, *, std=1e-9 * STD, log=0, before=None, copies=1.0, covariance=None, counts=None) -> Block:
    """An angle (F,) in white noise, or in noise of another covariance."""
    count = len(measured)
    noise = Noise(np.r_[std**2, np.zeros(count)] if covariance is None else covariance)
    before = np.zeros((1, count)) if before is None else before[None]
    counts = np.ones(count, dtype=bool) if counts is None else counts
    return Block(log, "joint_angle", measured, before, np.cos(9.0 * TICK * np.arange(count)), counts, noise, copies)


def test_half_of_a_gap_leaves_a_quarter_of_its_square():
    """Without noise: S = 1 − (1/2)² at every sample, so that a resample gives the same."""
    gap = 0.02 * WAVE
    plain, _ = gap_closures("turn", block(gap), 0.0 * gap, 0.5 * gap, NOTHING, held_out=True)
    assert (plain.S, plain.low90, plain.high90) == pytest.approx((0.75, 0.75, 0.75), abs=1e-9)
    assert plain.before == pytest.approx(np.sqrt(np.mean(gap**2)))
    assert plain.after == pytest.approx(plain.before / 2.0)
    assert (plain.manoeuvre, plain.signal, plain.held_out, plain.refitted) == ("turn", "joint_angle", True, False)
    assert typical([plain]) == pytest.approx(0.75)


def test_noise_is_taken_off():
    """Gaps of three standard deviations in noise, half of each predicted: S is 0.75 on average, and its interval holds that
    nine times of ten, both within four standard errors of 150 draws."""
    rng = np.random.default_rng(1)
    gap = 3.0 * STD * WAVE
    found = [
        gap_closures(
            "turn", block(gap + rng.normal(0.0, STD, COUNT), std=STD), 0.0 * gap, 0.5 * gap, NOTHING, held_out=False
        )[0]
        for _ in range(150)
    ]
    S = np.array([one.S for one in found])
    assert np.mean(S) == pytest.approx(0.75, abs=4.0 * float(np.std(S)) / np.sqrt(150.0))
    held = np.mean([one.low90 <= 0.75 <= one.high90 for one in found])
    assert held == pytest.approx(0.9, abs=4.0 * np.sqrt(0.09 / 150.0))


def test_draws_widen_the_interval():
    """Draws that predict shares a of the gap, without noise: S = 1 − (1 − a)² each, nothing else scatters."""
    gap = 0.02 * WAVE
    shares = np.linspace(0.5, 1.0, 101)
    draws = gap[:, None] * shares
    (one, _) = gap_closures("turn", block(gap), 0.0 * gap, 0.75 * gap, draws, held_out=True)
    low, high = np.quantile(1.0 - (1.0 - shares) ** 2, [0.05, 0.95])
    assert (one.low90, one.high90) == pytest.approx((low, high), abs=0.01)


def test_where_there_is_no_gap_none_closes():
    rng = np.random.default_rng(2)
    noise = rng.normal(0.0, STD, COUNT)
    assert gap_closures("turn", block(noise, std=STD), 0.0 * noise, noise, NOTHING, held_out=True) == ()


def test_samples_that_do_not_count_tell_nothing():
    gap = 0.02 * WAVE
    counts = np.arange(COUNT) < 200
    after = np.where(counts, 0.5 * gap, -7.0)
    plain = gap_closures("turn", block(gap, counts=counts), 0.0 * gap, after, NOTHING, held_out=True)[0]
    assert pytest.approx(0.75) == plain.S


def test_refitting_takes_clocks_and_zeros():
    """A gap half of which is predicted, with a zero and a clock of its own: what is refitted has S = 0.75 again, as both
    parts of the wave lose the same share to them."""
    gap = 0.02 * WAVE
    own = block(gap)
    shifted = gap + 0.5 + 0.1 * own.clock
    plain, refitted = gap_closures("turn", block(shifted), 0.0 * gap, 0.5 * gap, NOTHING, held_out=True)
    assert plain.S < 0.1
    assert refitted.refitted
    assert pytest.approx(0.75, abs=1e-6) == refitted.S


def test_what_refitting_absorbs_of_noise_is_the_trace():
    """tr(Qᵀ R Q) against the whole matrix; of white noise it is the number of columns."""
    covariance = STD**2 * 0.8 ** np.arange(COUNT + 1)
    basis = np.linalg.qr(np.column_stack([np.ones(COUNT), TIME]))[0]
    R = toeplitz(0.8 ** np.arange(COUNT))
    assert _absorbed(block(WAVE, covariance=covariance), basis) == pytest.approx(np.trace(basis.T @ R @ basis) / COUNT)
    assert _absorbed(block(WAVE, std=STD), basis) == pytest.approx(2.0 / COUNT)


def test_two_logs_have_their_noise_twice():
    assert _noise(block(WAVE, std=STD, copies=2.0), COUNT) == pytest.approx((2.0 * STD**2, COUNT))


def test_ridge_finds_weights():
    rng = np.random.default_rng(3)
    x = rng.standard_normal((500, 4))
    assert _ridge(x, x @ [1.0, -2.0, 0.0, 3.0]) == pytest.approx([1.0, -2.0, 0.0, 3.0], abs=1e-4)


def test_a_black_box_learns_what_the_command_does():
    """A change in proportion to the command a fifth of a second ago, which its features hold: nearly all of a log that was
    left out; and nothing without a log to learn from."""
    logs, blocks = [], []
    for number, level in enumerate((0.5, 0.8)):
        one = blank(f"turn {level}", turn(level, 3.0), 0.0)
        late = np.concatenate([np.zeros(20), one.commands[:, 0], [0.0]])[: one.ticks + 1]
        logs.append(Log(one, None, np.empty(0, dtype=np.intp), False))
        blocks.append(block(0.01 * late, log=number, std=1e-6))
    found = black_box(logs, blocks, [([0], 1), ([1], 0)])
    assert found is not None
    assert found > 0.95
    assert black_box(logs, blocks, []) is None
