"""The network: hypotheses by number, features alike in NumPy and torch, the same forward pass without torch, learning."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from aoro_gym.diagnosis.network import hypotheses
from aoro_gym.diagnosis.network.features import CHANNELS, FEATURES, SAMPLES, features
from aoro_gym.diagnosis.network.forward import Weights, forward, trained
from aoro_gym.diagnosis.network.shape import QUANTILES, Shape
from aoro_gym.effects.catalogue import IDS

torch = pytest.importorskip("torch")

from aoro_gym.diagnosis.network.model import Network  # noqa: E402

SMALL = Shape(width=24, heads=2, within=1, across=2, kept=2, rank=3)


def test_hypotheses_are_told_by_their_effects() -> None:
    effects = np.array([[-1, -1], [-1, -1], [4, -1], [7, 2], [2, 7]])
    outside = np.array([False, True, False, False, False])
    numbers = hypotheses.number_of(effects, outside)
    assert numbers[:3].tolist() == [hypotheses.NOTHING, hypotheses.OUTSIDE, hypotheses.SINGLE + 4]
    assert numbers[3] == numbers[4] >= hypotheses.PAIR
    assert hypotheses.names_of(int(numbers[3])) == (IDS[2], IDS[7])
    assert hypotheses.names_of(int(numbers[2])) == (IDS[4],)
    assert hypotheses.names_of(0) == hypotheses.names_of(1) == ()
    assert hypotheses.MEMBERS.sum() == len(IDS) + 2 * len(hypotheses.PAIRS)


def drawn(seed: int, *shape: int) -> np.ndarray:
    return np.random.default_rng(seed).standard_normal(shape).astype(np.float32)


def shown() -> tuple[np.ndarray, ...]:
    unit = np.array([0.3, *[5e6] * (len(CHANNELS) - 1)], dtype=np.float32)[:, None]
    healthy, later = (unit * drawn(seed, 3, 2, len(CHANNELS), SAMPLES) for seed in (1, 2))
    return (
        drawn(3, 3, 2, 2, SAMPLES),
        healthy,
        later,
        np.ones((3, 2, len(CHANNELS)), np.float32),
        np.ones((3, 2, 2), np.float32),
        np.zeros((3, 2), np.float32),
    )


def test_features_are_the_same_for_training_and_for_diagnosis() -> None:
    ours = features(np, *shown())
    theirs = features(torch, *(torch.as_tensor(part) for part in shown()))
    assert ours.shape == (3, 2, FEATURES, SAMPLES)
    np.testing.assert_allclose(ours, theirs.numpy(), rtol=1e-5, atol=1e-5)


def test_what_is_missing_cannot_be_seen() -> None:
    """Neither a channel that no sensor has nor a day without a log."""
    commands, healthy, later, has, days, repeat = shown()
    has[..., 2:] = 0.0
    days[..., 0] = 0.0
    seen = features(np, commands, healthy, later, has, days, repeat)
    other = later.copy()
    other[..., 2:, :] += 1e6
    np.testing.assert_array_equal(seen, features(np, commands, healthy + 1.0, other, has, days, repeat))
    assert not np.array_equal(seen, features(np, commands, healthy, later + 1.0, has, days, repeat))


def test_without_torch_it_computes_the_same(tmp_path: Path) -> None:
    torch.manual_seed(0)
    network = Network(SMALL).eval()
    rows, present = (
        drawn(5, 4, 3, FEATURES, SAMPLES),
        np.array([[1, 1, 1], [1, 0, 0], [1, 1, 0], [0, 1, 1]], dtype=bool),
    )
    with torch.no_grad():
        logits, sizes = network(torch.as_tensor(rows), torch.as_tensor(present))
    weights = network.weights(np.ones(len(IDS)))
    ours, own_sizes = forward(weights, rows, present)
    assert ours.shape == (4, hypotheses.HYPOTHESES) and own_sizes.shape == (4, len(IDS), len(QUANTILES))
    np.testing.assert_allclose(ours, logits.numpy(), atol=2e-5)
    np.testing.assert_allclose(own_sizes, sizes.numpy(), atol=2e-5)
    weights.save(tmp_path / "network.safetensors")
    again, _ = forward(Weights.load(tmp_path / "network.safetensors"), rows, present)
    # halves have 11 bits: 5e-4 of each weight, hardly correlated
    np.testing.assert_allclose(again, ours, atol=5e-3 * np.abs(ours).max())


def test_the_order_of_logs_and_those_that_are_missing_change_nothing() -> None:
    torch.manual_seed(0)
    weights = Network(SMALL).weights(np.ones(len(IDS)))
    rows, present = drawn(6, 1, 3, FEATURES, SAMPLES), np.ones((1, 3), dtype=bool)
    whole, _ = forward(weights, rows, present)
    np.testing.assert_allclose(forward(weights, rows[:, ::-1], present)[0], whole, atol=1e-4)
    beside = np.concatenate([rows, drawn(7, 1, 2, FEATURES, SAMPLES)], axis=1)
    hidden = np.array([[True] * 3 + [False] * 2])
    np.testing.assert_allclose(forward(weights, beside, hidden)[0], whole, atol=1e-4)


def test_a_network_for_other_effects_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    place = tmp_path / "network.safetensors"
    Network(SMALL).weights(np.ones(len(IDS))).save(place)
    monkeypatch.setattr("aoro_gym.diagnosis.network.forward.IDS", IDS[:-1])
    with pytest.raises(ValueError, match=r"network\.safetensors: trained for 33 effects .* 32; train"):
        Weights.load(place)


def test_a_network_of_before_effects_had_tokens_is_refused(tmp_path: Path) -> None:
    place = tmp_path / "network.safetensors"
    weights = Network(SMALL).weights(np.ones(len(IDS)))
    without = {name: values for name, values in weights.arrays.items() if name != "effects"}
    replace(weights, arrays=without).save(place)
    with pytest.raises(ValueError, match=r"network\.safetensors: its effects have no tokens"):
        Weights.load(place)


def test_a_file_that_is_no_network_is_named(tmp_path: Path) -> None:
    place = tmp_path / "other.safetensors"
    place.write_bytes(b"nothing")
    with pytest.raises(ValueError, match=r"other\.safetensors: not a network"):
        Weights.load(place)


def test_networks_come_with_the_package() -> None:
    """Three that were trained apart, for the catalogue as it is."""
    first, *others = trained()
    assert len(others) == 2
    for other in others:
        assert first.shape == other.shape
        assert not np.array_equal(first.arrays["cause"], other.arrays["cause"])
    assert np.all(first.scales > 0.0)
