"""Files are written whole or not at all."""

import errno
import os
import resource
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from aoro_gym.execution.files import (
    folder_written_whole,
    read_json,
    read_toml,
    remove_partial_files,
    write_json,
    write_text,
    written_whole,
)


def test_new_content_replaces_the_old_at_once(tmp_path: Path):
    path = tmp_path / "made" / "table.csv"
    write_text(path, "old")
    with written_whole(path) as temporary:
        temporary.write_text("new")
        assert path.read_text() == "old"
        assert temporary.suffix == ".csv"
    assert path.read_text() == "new"
    assert [file.name for file in path.parent.iterdir()] == ["table.csv"]


@pytest.mark.parametrize("fault", [ValueError, KeyboardInterrupt])
def test_an_interrupted_write_leaves_what_was_there(tmp_path: Path, fault: type[BaseException]):
    path = tmp_path / "a.json"
    write_text(path, "old")
    with pytest.raises(fault), written_whole(path) as temporary:
        temporary.write_text("half of the n")
        raise fault
    assert path.read_text() == "old"
    assert len(list(tmp_path.iterdir())) == 1


def test_a_full_disk_leaves_what_was_there_and_names_the_file(tmp_path: Path):
    """A limit on the size of files stands in for the disk; the kernel reports it as it reports a full one."""
    path = tmp_path / "big.json"
    write_text(path, "old")
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    handler = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    try:
        resource.setrlimit(resource.RLIMIT_FSIZE, (1000, before[1]))
        with pytest.raises(OSError) as caught:
            write_json(path, {"text": "x" * 10_000})
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
        signal.signal(signal.SIGXFSZ, handler)
    assert caught.value.errno == errno.EFBIG
    assert caught.value.filename == str(path)
    assert path.read_text() == "old"
    assert len(list(tmp_path.iterdir())) == 1


def test_toml_is_read_anew(tmp_path: Path):
    """Whoever changes what was read changes nobody else's, and a file that changed is not what it was."""
    path = tmp_path / "a.toml"
    path.write_text("[a]\nb = [1, 2]\nc = {d = 3}\n")
    first = read_toml(path)
    first["a"]["b"].append(9)
    first["a"]["c"]["d"] = 9
    assert read_toml(path) == {"a": {"b": [1, 2], "c": {"d": 3}}}
    path.write_text("a = 2\n")
    assert read_toml(path) == {"a": 2}


def test_a_killed_writer_leaves_what_was_there(tmp_path: Path):
    path = tmp_path / "a.csv"
    write_text(path, "old")
    script = (
        "import os, signal, sys; from pathlib import Path; from aoro_gym.execution.files import written_whole\n"
        "with written_whole(Path(sys.argv[1])) as temporary:\n"
        "    temporary.write_text('half'); os.kill(os.getpid(), signal.SIGKILL)\n"
    )
    done = subprocess.run([sys.executable, "-c", script, str(path)], check=False)
    assert done.returncode == -signal.SIGKILL
    assert path.read_text() == "old"
    assert len(list(tmp_path.iterdir())) == 2
    remove_partial_files(tmp_path)
    assert [file.name for file in tmp_path.iterdir()] == ["a.csv"]


def test_a_folder_is_written_whole_or_not_at_all(tmp_path: Path):
    path = tmp_path / "bag.x"
    for text in ("old", "new"):
        with folder_written_whole(path) as temporary:
            (temporary / "inner").mkdir(parents=True)
            (temporary / "inner/a.txt").write_text(text)
        assert (path / "inner/a.txt").read_text() == text
    with pytest.raises(KeyboardInterrupt), folder_written_whole(path) as temporary:
        temporary.mkdir()
        raise KeyboardInterrupt
    with pytest.raises(OSError, match=r"bag\.x"), folder_written_whole(path) as temporary:
        raise OSError(errno.ENOSPC, "no space", str(temporary))
    assert [one.name for one in tmp_path.iterdir()] == ["bag.x"] and (path / "inner/a.txt").read_text() == "new"


def test_a_folder_that_cannot_take_its_name_leaves_what_was_there(tmp_path: Path, monkeypatch):
    path = tmp_path / "bag.x"
    path.mkdir()
    (path / "a.txt").write_text("old")
    true = os.replace

    def replace(source: Path, target: Path) -> None:
        if target == path and (source / "b.txt").exists():
            raise OSError(errno.EIO, "broken", str(target))
        true(source, target)

    monkeypatch.setattr(os, "replace", replace)
    with pytest.raises(OSError, match="broken"), folder_written_whole(path) as temporary:
        temporary.mkdir()
        (temporary / "b.txt").write_text("new")
    assert [one.name for one in tmp_path.iterdir()] == ["bag.x"] and (path / "a.txt").read_text() == "old"


def test_a_killed_writer_of_a_folder_leaves_nothing_that_stays(tmp_path: Path):
    (tmp_path / ".bag.1.partial.x").mkdir()
    (tmp_path / ".bag.1.partial.x/a.txt").write_text("half")
    (tmp_path / "kept").mkdir()
    remove_partial_files(tmp_path)
    assert [one.name for one in tmp_path.iterdir()] == ["kept"]


def test_files_get_the_usual_permissions(tmp_path: Path):
    path = tmp_path / "a.txt"
    mask = os.umask(0o022)
    try:
        write_text(path, "x")
    finally:
        os.umask(mask)
    assert path.stat().st_mode & 0o777 == 0o644


@pytest.mark.parametrize(
    ("content", "says"),
    [
        (b"[" * 100_000 + b"]" * 100_000, "nested too deeply"),
        (b'{"a": ' + b"1" * 10_000 + b"}", "is not JSON"),
        (b'{"a": "\xff"}', "is not JSON"),
        (b"[1, 2]", "holds no JSON object"),
        (b'{"a": 1', "is not JSON"),
    ],
)
def test_foreign_json_is_one_error_that_names_the_file(tmp_path: Path, content: bytes, says: str):
    path = tmp_path / "a.json"
    path.write_bytes(content)
    with pytest.raises(ValueError, match=says) as caught:
        read_json(path)
    assert str(path) in str(caught.value)


def test_json_without_numbers_for_nan(tmp_path: Path):
    with pytest.raises(ValueError):
        write_json(tmp_path / "a.json", {"a": float("nan")})
    assert list(tmp_path.iterdir()) == []
