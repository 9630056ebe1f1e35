"""One run at a time writes into a folder."""

import signal
import subprocess
import sys
from pathlib import Path

import pytest

from aoro_gym.execution.locking import LOCK, FolderInUse, locked

HOLD = (
    "import sys, time; from pathlib import Path; from aoro_gym.execution.locking import locked\n"
    "with locked(Path(sys.argv[1])):\n"
    "    print('held', flush=True); time.sleep(60)\n"
)


def test_a_second_process_is_told_who_holds_the_folder(tmp_path: Path):
    with subprocess.Popen([sys.executable, "-c", HOLD, str(tmp_path)], stdout=subprocess.PIPE) as holder:
        assert holder.stdout is not None and holder.stdout.readline() == b"held\n"
        try:
            with pytest.raises(FolderInUse, match=rf"{tmp_path} is in use by process {holder.pid} on .* since"):
                locked(tmp_path).__enter__()
        finally:
            holder.kill()
    with locked(tmp_path):  # the lock goes with its process
        pass


def test_what_a_killed_holder_left_unfinished_is_removed(tmp_path: Path):
    (tmp_path / "deep").mkdir()
    (tmp_path / "deep" / ".policy.77.partial.json").write_text("half")
    (tmp_path / "deep" / "policy.json").write_text("whole")
    with locked(tmp_path):
        assert [file.name for file in (tmp_path / "deep").iterdir()] == ["policy.json"]


def test_what_is_being_written_in_a_folder_of_its_own_lock_stays(tmp_path: Path):
    """A run of its own writes there, while this one begins in the folder around it."""
    with locked(tmp_path / "seed_1"):
        (tmp_path / "seed_1" / ".policy.77.partial.json").write_text("half")
        with locked(tmp_path):
            assert (tmp_path / "seed_1" / ".policy.77.partial.json").exists()
    with locked(tmp_path / "seed_1"):
        assert not (tmp_path / "seed_1" / ".policy.77.partial.json").exists()


def test_a_process_may_lock_its_folder_again(tmp_path: Path):
    script = (
        "import sys; from pathlib import Path; from aoro_gym.execution.locking import FolderInUse, locked\n"
        "try: locked(Path(sys.argv[1])).__enter__()\n"
        "except FolderInUse: sys.exit(3)\n"
    )

    def another() -> int:
        return subprocess.run([sys.executable, "-c", script, str(tmp_path)], check=False).returncode

    with locked(tmp_path):
        with locked(tmp_path):
            assert another() == 3
        assert another() == 3
    assert another() == 0
    assert {file.name for file in tmp_path.iterdir()} <= {LOCK}


def test_what_is_refused_leaves_no_folder(tmp_path: Path):
    with pytest.raises(ValueError), locked(tmp_path / "new"):
        raise ValueError("refused")
    assert not (tmp_path / "new").exists()
    with pytest.raises(ValueError), locked(tmp_path / "begun"):
        (tmp_path / "begun" / "result.json").write_text("{}")
        raise ValueError("failed")
    assert (tmp_path / "begun" / "result.json").exists()


def test_the_lock_is_freed_by_an_error(tmp_path: Path):
    before = signal.signal(signal.SIGINT, signal.default_int_handler)  # who tests in the background may ignore it
    try:
        with pytest.raises(KeyboardInterrupt), locked(tmp_path):
            signal.raise_signal(signal.SIGINT)  # in this thread: of the process, another one may be given it, and later
    finally:
        signal.signal(signal.SIGINT, before)
    with locked(tmp_path):
        pass
