"""Equal inputs have equal digests, and different ones have different ones."""

import itertools
import threading
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from aoro_gym.execution.digest import Contents, code_digest, digest, sources


@dataclass(frozen=True)
class Point:
    x: float
    y: float


class Counter:
    def __init__(self, start: int):
        self.start = start


def scaled(factor: float):
    def apply(value: float) -> float:
        return factor * value

    return apply


DIFFERENT = [
    None, True, 1, 1.0, "1", b"1", 0.1 + 0.2, 0.3, -0.0, 0.0, float("nan"), (1, 2), [1, 2], ((1,), 2), {1, 2},
    {"a": 1}, {"a": 1.0}, {"a": 2}, {"b": 1}, ("ab", "c"), ("a", "bc"), [], (), {}, Path("a"), "a", len, max,
    np.array([1, 2]), np.array([1.0, 2.0]), np.array([[1.0, 2.0]]), np.array([1.0, 2.0], np.float32),
    np.array(["a", 1], dtype=object), Point(1.0, 2.0), Point(2.0, 1.0), Point, Counter(1), Counter(2), Counter,
    scaled(1.0), scaled(2.0), partial(scaled, 1.0), partial(scaled, 2.0),
]  # fmt: skip


def test_what_differs_has_another_digest():
    found = [digest(value) for value in DIFFERENT]
    same = [
        (DIFFERENT[i], DIFFERENT[k]) for i, k in itertools.combinations(range(len(found)), 2) if found[i] == found[k]
    ]
    assert same == []


def test_what_is_equal_has_the_same_digest():
    assert digest({"a": 1, "b": [2.0]}) == digest({"b": [2.0], "a": 1})
    assert digest(Counter(3), np.arange(3)) == digest(Counter(3), np.arange(3))
    assert digest(np.arange(6).reshape(2, 3).T) == digest(np.ascontiguousarray(np.arange(6).reshape(2, 3).T))
    assert digest(scaled(2.0)) == digest(scaled(2.0))
    looped: list = [1]
    looped.append(looped)
    assert digest(looped) == digest(looped)


def test_files_count_by_their_contents(tmp_path: Path):
    first, second = tmp_path / "a.toml", tmp_path / "b.toml"
    first.write_text("length = 0.6")
    second.write_text("length = 0.6")
    assert digest(Contents(first)) == digest(Contents(second))
    before = digest(Contents(tmp_path))
    second.write_text("length = 0.7")
    assert digest(Contents(first)) != digest(Contents(second))
    assert digest(Contents(tmp_path)) != before
    with pytest.raises(FileNotFoundError):
        digest(Contents(tmp_path / "missing"))


def test_what_cannot_be_told_apart_is_refused():
    with pytest.raises(TypeError, match="lock"):
        digest({"a": [threading.Lock()]})


def test_tensors_count_by_their_values():
    torch = pytest.importorskip("torch")
    assert digest(torch.tensor([1.0])) == digest(torch.tensor([1.0])) != digest(torch.tensor([2.0]))


def test_every_source_of_the_package_counts():
    names = set(sources())
    assert {
        "twin/kernels.py",
        "envs/vector.py",
        "terrains/loading.py",
        "agents/training.py",
        "machines/aoro.toml",
    } <= names
    assert not any("__pycache__" in name for name in names)
    assert len(code_digest()) == 64
