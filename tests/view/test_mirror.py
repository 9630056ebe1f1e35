"""A twin that another process shows: what goes through the memory that both share."""

from multiprocessing.shared_memory import SharedMemory
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from aoro_gym.machine import Machine
from aoro_gym.twin import Twin
from aoro_gym.view.live import LiveTwins
from aoro_gym.view.mirror import MirroredTwin, MirrorPage, SharedTwin


@pytest.fixture
def driven():
    twin = Twin()
    twin.step({"drive_signal": 0.5, "steering_signal": 0.4}, 0.8)
    return twin


@pytest.mark.parametrize("logs", [0.0, 20.0])
def test_the_mirror_shows_what_the_twin_does(logs):
    machine = Machine.load().set({"payload.count": logs})
    driven = Twin(machine=machine)
    driven.step({"drive_signal": 0.5, "steering_signal": 0.4}, 0.8)
    shared = SharedTwin(driven)
    mirrored, live = MirroredTwin(shared.memory, Twin(machine=machine)), LiveTwins(driven, [machine])
    for _ in range(2):
        assert mirrored.look()
        assert mirrored.time == live.time
        assert mirrored.readings() == live.readings()
        (seen,), (true,) = mirrored.poses(), live.poses()
        np.testing.assert_array_equal(seen.position, true.position)
        for ours, theirs in zip(mirrored.forces(), live.forces(), strict=True):
            np.testing.assert_array_equal(ours, theirs)
        driven.step({}, 0.3)
        shared.publish()
    del mirrored._shared  # a view into the memory, which would keep it from being closed
    shared.close()


def test_what_is_being_written_is_not_read(driven):
    """An odd count is read again until it is even; a twin that is shown no more says so."""
    shared = SharedTwin(driven)
    mirrored = MirroredTwin(shared.memory, Twin())
    counts = iter([3, 4, 6, 6, 6])

    copies = []

    class Record:
        def __getitem__(self, name):
            return next(counts)

        def copy(self):
            copies.append(1)
            return np.zeros((), dtype=mirrored._record.dtype)

    record: Any = Record()
    plain, mirrored._shared = mirrored._shared, record
    assert mirrored.look()
    assert len(copies) == 3, "odd, then changed meanwhile, then whole"
    mirrored._shared = plain
    shared._record["count"] = -1
    assert not mirrored.look()
    del mirrored._shared, plain
    shared.close()


def test_an_interrupted_start_leaves_neither_process_nor_memory(driven, monkeypatch):
    killed, names = [], []

    class Process:
        """In place of the page's: Ctrl-C comes before it has told its address."""

        def __init__(self, *, args=(), **_):
            names.append(args[0])

        def kill(self):
            killed.append(self)

        def start(self):
            pass

        def join(self, timeout):
            pass

        def is_alive(self):
            return False

    class Pipe:
        def recv(self):
            raise KeyboardInterrupt

        def close(self):
            pass

    context = SimpleNamespace(Process=Process, Pipe=lambda: (Pipe(), Pipe()))
    monkeypatch.setattr("multiprocessing.get_context", lambda _: context)
    with pytest.raises(KeyboardInterrupt):
        MirrorPage(driven)
    with pytest.raises(FileNotFoundError):
        SharedMemory(names[0])
    assert len(killed) == 1


@pytest.mark.slow
def test_a_page_in_another_process(driven):
    pytest.importorskip("viser")
    page = MirrorPage(driven)
    assert page.address.startswith("http://127.0.0.1:")
    page.publish()
    page.close()
    assert page._process.exitcode == 0
    with pytest.raises(ValueError, match="port is 70000"):
        MirrorPage(driven, port=70_000)
