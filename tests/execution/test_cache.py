"""What is kept on disk comes back as it was made, and damage, other users and a full or forbidden disk only cost time."""

import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from aoro_gym.execution import cache
from aoro_gym.execution.cache import cache_folder, cached, computed_with, is_kept

VALUES = {
    "a": np.arange(12.0).reshape(3, 4),
    "b": np.array([1, 2], dtype=np.int32),
    "word": np.array("Föhre"),
    "c": 3.0,
}


class Maker:
    """Counts how often it had to make something."""

    def __init__(self) -> None:
        self.count = 0

    def __call__(self) -> dict[str, Any]:
        self.count += 1
        return dict(VALUES)

    def cached(self, *parts: Any) -> dict[str, Any]:
        return cached("things", parts, self, lambda made: made, dict)


@pytest.fixture
def folder(tmp_path: Path, monkeypatch) -> Path:
    monkeypatch.setenv("AORO_GYM_CACHE", str(tmp_path / "cache"))
    return tmp_path / "cache"


@pytest.fixture
def maker() -> Maker:
    return Maker()


def files(folder: Path) -> list[Path]:
    return sorted(path for path in folder.rglob("*") if path.is_file())


def test_what_was_made_once_is_read_to_the_bit(folder, maker):
    maker.cached(1, "x")
    again = maker.cached(1, "x")
    assert maker.count == 1
    assert again.keys() == VALUES.keys()
    for name, value in VALUES.items():
        assert again[name].dtype == np.asarray(value).dtype
        np.testing.assert_array_equal(again[name], value)


def test_what_is_kept_can_be_asked_for(folder, maker, monkeypatch):
    assert not is_kept("things", (1, "x"))
    maker.cached(1, "x")
    assert is_kept("things", (1, "x"))
    assert not is_kept("things", (1, "y")) and not is_kept("others", (1, "x"))
    monkeypatch.setenv("AORO_GYM_CACHE", "off")
    assert not is_kept("things", (1, "x"))


def test_other_parts_are_other_results(folder, maker, tmp_path):
    source = tmp_path / "law.py"
    for number, parts in enumerate(
        ((1, "x"), (1.0, "x"), (1, "y"), (np.zeros(3),), (np.zeros(4),), (np.zeros(3, "f4"),))
    ):
        maker.cached(*parts)
        assert maker.count == number + 1
    for number, text in enumerate(("g = 9.81", "g = 9.82")):  # a changed source
        source.write_text(text)
        maker.cached(computed_with(source))
        assert maker.count == 7 + number
    assert len(files(folder)) == 8


@pytest.mark.parametrize("damage", ["empty", "cut", "text", "foreign", "less", "folder"])
def test_what_is_damaged_is_made_again(folder, maker, damage):
    maker.cached(0)
    (path,) = files(folder)
    content = path.read_bytes()
    if damage == "foreign":
        np.savez(path, other=np.zeros(3))
    elif damage == "less":
        np.savez(path, a=VALUES["a"], names=np.array(["a", "b", "c", "word"]))
    elif damage == "folder":
        path.unlink()
        path.mkdir()
    else:
        path.write_bytes({"empty": b"", "cut": content[: len(content) // 2], "text": b"no archive"}[damage])
    np.testing.assert_array_equal(maker.cached(0)["a"], VALUES["a"])
    assert maker.count == 2
    if damage != "folder":
        maker.cached(0)
        assert maker.count == 2


def test_no_flipped_bit_changes_a_result(folder, maker):
    """Every byte of the file in turn: what comes back is what was made, read or made again."""
    maker.cached(0)
    (path,) = files(folder)
    content = path.read_bytes()
    rng = np.random.default_rng(0)
    for place in rng.choice(len(content), size=150, replace=False):
        damaged = bytearray(content)
        damaged[place] ^= 1 << int(rng.integers(8))
        path.write_bytes(damaged)
        found = maker.cached(0)
        assert found.keys() == VALUES.keys()
        for name, value in VALUES.items():
            np.testing.assert_array_equal(found[name], value)


def test_a_forbidden_or_impossible_folder_is_no_error(maker, tmp_path, monkeypatch):
    (tmp_path / "file").write_text("no folder")
    for place in (tmp_path / "file", tmp_path / "file" / "below", Path("/proc/none"), Path("/dev/null/x")):
        monkeypatch.setenv("AORO_GYM_CACHE", str(place))
        maker.cached(0)
        maker.cached(0)
    assert maker.count == 8


def test_the_folder_is_the_users_to_choose(maker, tmp_path, monkeypatch):
    for off in ("", "off", "OFF", "0", "none"):
        monkeypatch.setenv("AORO_GYM_CACHE", off)
        assert cache_folder() is None
        maker.cached(0)
    assert maker.count == 5
    monkeypatch.setenv("AORO_GYM_CACHE", "~/elsewhere")
    monkeypatch.setenv("HOME", str(tmp_path))
    assert cache_folder() == tmp_path / "elsewhere"
    monkeypatch.delenv("AORO_GYM_CACHE")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "xdg"))
    assert cache_folder() == tmp_path / "xdg" / "aoro-gym"
    monkeypatch.setenv("XDG_CACHE_HOME", "relative")  # to be ignored, says the specification
    assert cache_folder() == tmp_path / ".cache" / "aoro-gym"


def test_the_oldest_goes_when_the_cache_is_full(folder, maker, monkeypatch):
    for number in range(4):
        maker.cached(number)
        newest = max(files(folder), key=lambda path: path.stat().st_mtime_ns)
        os.utime(newest, (1000.0 + number, 1000.0 + number))
    size = sum(path.stat().st_size for path in files(folder))
    maker.cached(0)  # used: now the youngest
    monkeypatch.setattr(cache, "LARGEST", size)
    maker.cached(4)
    assert len(files(folder)) == 4 and maker.count == 5
    maker.cached(0)
    assert maker.count == 5
    maker.cached(1)
    assert maker.count == 6
    monkeypatch.setattr(cache, "LARGEST_RESULT", 10)
    maker.cached(9)
    maker.cached(9)
    assert maker.count == 8


def test_processes_may_share_the_folder(folder):
    code = """
import numpy as np
from aoro_gym.execution.cache import cached
for number in range(40):
    want = np.arange(1000.0) + number
    found = cached("shared", (number,), lambda: {"a": want}, lambda made: made, dict)
    np.testing.assert_array_equal(found["a"], want)
"""
    running = [subprocess.Popen([sys.executable, "-c", code]) for _ in range(3)]
    assert [process.wait(60) for process in running] == [0, 0, 0]
    assert len(files(folder)) == 40
