"""Processes that are killed, and disks without room, for what must go on afterwards."""

import contextlib
import resource
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from typer.testing import CliRunner

from aoro_gym.cli import app

ROOT = Path(__file__).resolve().parents[2]

KILLS = """
import os, random, signal, sys, time
from pathlib import Path

def child(work):
    begun = os.fork()
    if begun:
        return begun
    try:
        work()
        os._exit(0)
    except BaseException:
        import traceback
        traceback.print_exc()
        os._exit(1)

def whole(work):
    ended = os.waitpid(child(work), 0)[1]
    assert ended == 0, ended

def killed(work, longest, times, rng):
    'Begin again and again, kill at random moments; how often it was killed before it was done.'
    count = 0
    while count < times:
        begun = child(work)
        time.sleep(rng.uniform(0.0, longest))
        os.kill(begun, signal.SIGKILL)
        if os.WIFSIGNALED(os.waitpid(begun, 0)[1]):
            count += 1
    return count

def killed_at(work, call):
    'Die just before the file operation of this number.'
    replace, done = os.replace, [0]
    def counted(*names):
        done[0] += 1
        if done[0] == call:
            os.kill(os.getpid(), signal.SIGKILL)
        replace(*names)
    def mortal():
        os.replace = counted
        work()
    ended = os.waitpid(child(mortal), 0)[1]
    return os.WIFSIGNALED(ended)
"""

COMPARISON = """began = time.perf_counter()
whole(work_in(out / "whole"))
took = time.perf_counter() - began
if mode == "moments":
    killed(work_in(out / "parted"), took / 3.0, 10, random.Random(int(sys.argv[3])))
else:
    for call in map(int, sys.argv[3].split(",")):
        assert killed_at(work_in(out / "parted"), call)
whole(work_in(out / "parted"))
"""
"""Once without, and once with kills."""


def ran(program: str, *arguments: object) -> None:
    done = subprocess.run(
        [sys.executable, "-c", KILLS + program + COMPARISON, *map(str, arguments)],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr[-3000:]


@contextlib.contextmanager
def largest_file(size: int) -> Iterator[None]:
    """A limit on the size of files, which the kernel reports much as it does a full disk."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    handler = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    try:
        resource.setrlimit(resource.RLIMIT_FSIZE, (size, before[1]))
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
        signal.signal(signal.SIGXFSZ, handler)


@contextlib.contextmanager
def small_disk(folder: Path) -> Iterator[Path]:
    """A file system of 1 MB of which 0.1 MB are free until its file ``filler`` goes."""
    folder.mkdir()
    mounted = subprocess.run(
        ["mount", "-t", "tmpfs", "-o", "size=1m", "tmpfs", str(folder)], capture_output=True, check=False
    )
    if mounted.returncode:
        pytest.skip(f"no file system of 1 MB: {mounted.stderr.decode().strip()}")
    try:
        (folder / "filler").write_bytes(bytes(920_000))
        yield folder
    finally:
        subprocess.run(["umount", str(folder)], check=True)


def said(command: list[str]) -> tuple[int, str]:
    shown = CliRunner().invoke(app, command, catch_exceptions=False)
    return shown.exit_code, " ".join(shown.stderr.split())
