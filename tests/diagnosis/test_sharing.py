"""Launches that are shared: everybody gets what it would get alone, and nobody waits for who is gone."""

import multiprocessing
import time
from concurrent.futures import ThreadPoolExecutor
from multiprocessing.connection import Client
from pathlib import Path

import numpy as np
import pytest

from aoro_gym.diagnosis.replay import COARSE, Replay, Simulator, Variants
from aoro_gym.diagnosis.sharing import PREFIX, Remote, sharing, simulator
from aoro_gym.effects.catalogue import EFFECTS
from aoro_gym.machine import Machine
from tests.diagnosis.manoeuvres import blank, turn

MACHINE = Machine.load("aoro")
BLANKS = [blank("left", turn(1.0, 1.5), -0.5), blank("right", turn(-0.6, 1.8), 0.3)]
TASKS = [
    [Replay(Variants(MACHINE.scale({"steering.pump.margin": np.array([0.9, 1.1])}), 2), BLANKS[0])],
    [Replay(Variants(MACHINE), recording) for recording in BLANKS],
    [Replay(Variants.of(MACHINE, [(EFFECTS["sensor_delay"], (0.02,))], 1), BLANKS[1])],
    [Replay(Variants(MACHINE), BLANKS[0], COARSE)],
]
"""Of four that share a device."""


@pytest.fixture(scope="module")
def device():
    with sharing("cpu") as name:
        yield name


def assert_same(found, expected):
    for mine, theirs in zip(found, expected, strict=True):
        assert mine.keys() == theirs.keys()
        for name, values in mine.items():
            np.testing.assert_array_equal(values, theirs[name])


def test_everybody_gets_what_it_would_get_alone(device):
    """To the bit, all at once, time and again: whatever goes into a launch together."""
    alone = [Simulator().run(tasks) for tasks in TASKS]
    members = [simulator(device) for _ in TASKS]
    assert all(isinstance(member, Remote) for member in members)
    with ThreadPoolExecutor(len(TASKS)) as pool:
        for _ in range(3):
            for found, expected in zip(pool.map(lambda m, t: m.run(t), members, TASKS), alone, strict=True):
                assert_same(found, expected)


def test_memory_for_answers_is_given_back(device, monkeypatch):
    """What a launch of eight twins needed, once one of two is asked for."""
    monkeypatch.setattr("aoro_gym.diagnosis.sharing.SPARE", 0)
    large = [Replay(Variants(MACHINE.scale({"steering.pump.margin": np.linspace(0.9, 1.1, 8)}), 8), BLANKS[0])]
    member, sizes = Remote(device), []
    for tasks in (TASKS[1], large, TASKS[1]):
        assert_same(member.run(tasks), Simulator().run(tasks))
        assert member._memory is not None
        sizes.append(len(member._memory))
    assert sizes[0] == sizes[2] < 0.5 * sizes[1]


def test_who_leaves_is_not_waited_for(device):
    stays, leaves = Remote(device), Remote(device)
    leaves.run(TASKS[1])
    leaves._connection.close()
    assert_same(stays.run(TASKS[1]), Simulator().run(TASKS[1]))


def test_an_error_reaches_who_asked_for_it_alone(device):
    """Two machines for three start angles cannot be launched; what others asked for is not lost by that."""
    wrong = [Replay(Variants(MACHINE.scale({"steering.pump.margin": np.array([0.9, 1.1])}), 3), BLANKS[0])]
    members = [simulator(device), simulator(device)]
    with ThreadPoolExecutor(2) as pool:
        for _ in range(3):
            fails, works = (pool.submit(m.run, t) for m, t in zip(members, (wrong, TASKS[1]), strict=True))
            with pytest.raises(ValueError):
                fails.result(timeout=60)
            assert_same(works.result(timeout=60), Simulator().run(TASKS[1]))


def test_without_sharing_it_is_the_device_itself():
    assert type(simulator("cpu")) is Simulator and simulator("cpu").device == "cpu"


def test_a_device_that_is_none_is_named():
    with pytest.raises(ValueError, match="cuda:99"), sharing("cuda:99") as name:
        Remote(name).run(TASKS[1])


def orphaned(address_file: str) -> None:
    """Begins to share, says where, and waits to be killed."""
    with sharing("cpu") as device:
        with open(address_file, "w", encoding="utf-8") as file:
            file.write(device)
        time.sleep(60.0)


def children(process: int) -> list[int]:
    """Processes that one has begun."""
    return [int(text) for text in Path(f"/proc/{process}/task/{process}/children").read_text().split()]


def runs(process: int) -> bool:
    """Whether there is such a process, and not only what is left of one that nobody has waited for."""
    try:
        return Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


@pytest.mark.skipif(not Path("/proc/self/task").exists(), reason="processes are looked up in /proc")
def test_nobody_is_left_of_a_parent_that_was_killed(tmp_path):
    """Without a chance to clear up: neither a process, nor one that answers at the address, nor its folder."""
    file = tmp_path / "address"
    parent = multiprocessing.get_context("spawn").Process(target=orphaned, args=(str(file),))
    parent.start()
    while not (file.exists() and file.read_text(encoding="utf-8")):
        assert parent.is_alive()
        time.sleep(0.1)
    address = file.read_text(encoding="utf-8").removeprefix(PREFIX)
    Client(address, authkey=multiprocessing.current_process().authkey).close()
    assert parent.pid is not None
    orphans = children(parent.pid)
    assert orphans and all(map(runs, orphans))
    parent.kill()
    parent.join()
    deadline = time.monotonic() + 20.0
    while any(map(runs, orphans)):
        assert time.monotonic() < deadline, "it still runs"
        time.sleep(0.1)
    with pytest.raises(OSError):
        Client(address)
    assert not Path(address).parent.exists()
