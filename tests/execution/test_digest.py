"""Equal inputs have equal digests, and different ones have different ones."""

import importlib.util
import inspect
import itertools
import linecache
import shutil
import sys
import threading
from abc import ABC, abstractmethod
from dataclasses import dataclass
from functools import cached_property, partial
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


def at_once():
    """Two functions of one line, which have one source."""
    return (lambda value: value + 1), (lambda value: value + 2)


class Named(dict):
    """A mapping with something of its own."""

    def __init__(self, name: str):
        super().__init__(a=1)
        self.name = name


class Squared(Point):
    """A dataclass's instance may hold more than its fields, and what it has calculated from them."""

    factor: float = 1.0

    @cached_property
    def square(self) -> float:
        return self.x**2


def squared(factor: float) -> Squared:
    found = Squared(1.0, 2.0)
    object.__setattr__(found, "factor", factor)
    return found


DIFFERENT = [
    None, True, 1, 1.0, "1", b"1", 0.1 + 0.2, 0.3, -0.0, 0.0, float("nan"), (1, 2), [1, 2], ((1,), 2), {1, 2},
    {"a": 1}, {"a": 1.0}, {"a": 2}, {"b": 1}, ("ab", "c"), ("a", "bc"), [], (), {}, Path("a"), "a", len, max,
    np.array([1, 2]), np.array([1.0, 2.0]), np.array([[1.0, 2.0]]), np.array([1.0, 2.0], np.float32),
    np.array(["a", 1], dtype=object), Point(1.0, 2.0), Point(2.0, 1.0), Point, Counter(1), Counter(2), Counter,
    scaled(1.0), scaled(2.0), partial(scaled, 1.0), partial(scaled, 2.0), *at_once(), Named("a"), Named("b"),
    squared(1.0), squared(2.0), [1].count, [2].count, (1.0).hex, np.sin, np.cos,
    np.ma.array([1.0, 2.0], mask=[False, True]), np.ma.array([1.0, 2.0], mask=[True, False]),
    np.zeros(2, [("a", "f4")]), np.zeros(2, [("b", "f4")]), np.zeros(2, "datetime64[s]"), np.zeros(2, "datetime64[m]"),
    np.random.default_rng(1), np.random.default_rng(2), Path.cwd, Path.home, itertools, threading,
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
    assert digest(np.float64(0.5)) == digest(0.5)
    seen = squared(1.0)
    assert seen.square == 1.0
    assert digest(seen) == digest(squared(1.0))
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


MINE = """
from abc import ABC, abstractmethod
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import NamedTuple
import numpy as np

GAIN = 2.0
TABLE = np.array([1.0, 2.0])

def helper(x):
    return GAIN * x

class Base(ABC):
    limit = 1.0

    @abstractmethod
    def __call__(self, x): ...

@dataclass
class Policy(Base):
    factor: float = 1.0

    def __call__(self, x):
        return helper(x) + self.inner(x) + self.squared

    @staticmethod
    def inner(x):
        return 3.0 * x

    @cached_property
    def squared(self):
        return self.factor**2

class Pair(NamedTuple):
    first: float = 4.0

def made(env):
    return Policy(5.0)

def looked_up(x):
    return TABLE[0] * x

@lru_cache
def kept(x):
    return 6.0 * x

def one(x):
    return other(x)

def other(x):
    return one(7.0 * x)
"""


def loaded(path: Path, source: str):
    """The module of a user's file."""
    path.write_text(source)
    shutil.rmtree(path.parent / "__pycache__", ignore_errors=True)
    spec = importlib.util.spec_from_file_location("mine", path)
    assert spec is not None and spec.loader is not None
    module = sys.modules["mine"] = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize(
    ("was", "now", "changed"),
    [
        ("GAIN = 2.0", "GAIN = 2.5", {"policy", "made", "helper"}),
        ("GAIN * x", "GAIN + x", {"policy", "made", "helper"}),
        ("3.0 * x", "3.5 * x", {"policy", "made"}),
        ("factor**2", "factor**3", {"policy", "made"}),
        ("limit = 1.0", "limit = 1.5", {"policy", "made"}),
        ("float = 1.0", "float = 1.5", {"policy", "made"}),
        ("Policy(5.0)", "Policy(5.5)", {"made"}),
        ("[1.0, 2.0]", "[1.0, 2.5]", {"looked_up"}),
        ("6.0 * x", "6.5 * x", {"kept"}),
        ("7.0 * x", "7.5 * x", {"one"}),
        ("4.0", "4.5", {"pair"}),
    ],
)
def test_own_code_counts_with_all_that_it_uses(tmp_path: Path, was: str, now: str, changed: set[str]):
    """A policy or a reward of one's own: its source, its helpers, and the constants of its file."""

    def digests(source: str) -> dict[str, str]:
        mine = loaded(tmp_path / "mine.py", source)
        values = {
            "policy": mine.Policy(), "made": mine.made, "helper": mine.helper, "looked_up": mine.looked_up,
            "kept": mine.kept, "one": mine.one, "pair": mine.Pair(),
        }  # fmt: skip
        linecache.clearcache()
        return {name: digest(value) for name, value in values.items()}

    try:
        assert MINE.count(was) == 1
        before, after = digests(MINE), digests(MINE.replace(was, now))
        assert digests(MINE) == before
    finally:
        del sys.modules["mine"]
    assert {name for name in before if before[name] != after[name]} == changed


def test_a_class_typed_at_a_prompt_counts_by_its_code():
    def policy(gain: str):
        space: dict = {"__name__": "__main__"}
        exec(f"class P:\n  def __call__(self, x):\n    return {gain} * x\n", space)
        return space["P"]()

    assert digest(policy("2.0")) == digest(policy("2.0")) != digest(policy("3.0"))


def test_own_classes_of_every_kind_can_be_told():
    class Abstract(ABC):
        @abstractmethod
        def drive(self): ...

    class Slotted(Abstract):
        __slots__ = ("gain",)

        def __init__(self, gain: float):
            self.gain = gain

        def drive(self):
            return self.gain

    assert digest(Slotted(1.0)) == digest(Slotted(1.0)) != digest(Slotted(2.0))


def test_many_functions_that_name_one_another_take_no_longer():
    """Each names all others: paths through them are without number, but each is looked at once."""
    space: dict = {"__name__": "__main__"}
    names = [f"f{k}" for k in range(60)]
    exec("\n".join(f"def {name}(): return ({', '.join(names)})" for name in names), space)
    assert len(digest(space["f0"])) == 64


def test_deep_nesting_is_refused():
    nested: list = []
    for _ in range(100_000):
        nested = [nested]
    with pytest.raises(TypeError, match="nested too deeply"):
        digest(nested)


def test_the_source_of_a_class_is_read_once_for_all_of_its_objects(monkeypatch):
    """A world has hundreds of objects of a few classes, and to read a source its module is parsed."""

    @dataclass(frozen=True)
    class Stone:
        size: float

    read = []
    of = inspect.getsource
    monkeypatch.setattr(inspect, "getsource", lambda value: read.append(value) or of(value))
    stones = [Stone(0.5 * k) for k in range(300)]
    first = digest(stones)
    assert read.count(Stone) == 1
    assert digest(stones) == first != digest([*stones[:-1], Stone(1.0)])
    assert read.count(Stone) == 1


def test_tensors_count_by_their_values():
    torch = pytest.importorskip("torch")
    assert digest(torch.tensor([1.0])) == digest(torch.tensor([1.0])) != digest(torch.tensor([2.0]))


def test_every_source_of_the_package_counts():
    names = set(sources())
    assert {
        "twin/kernels/advance.py",
        "envs/core/vector.py",
        "terrains/io/loading.py",
        "agents/training/train.py",
        "machines/aoro.toml",
    } <= names
    assert not any("__pycache__" in name for name in names)
    assert len(code_digest()) == 64
