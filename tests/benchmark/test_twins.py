"""Twins that are timed are the twins that are studied; their memory is counted."""

import numpy as np
import pytest
import warp as wp

from aoro_gym import Machine, Twin
from aoro_gym.benchmark.scene import CELL, CHANGES, CONTROL_STEP, NODES, heights, signals, starts, terrain
from aoro_gym.benchmark.twins import SPREAD, count_memory, randomised, twins
from aoro_gym.terrains import Terrain
from aoro_gym.twin.records import MachineRecord
from aoro_gym.validation.turns import Turn, run_turns


@pytest.fixture
def launched(monkeypatch):
    """Kernels by the name of their function, as they are launched."""
    kernels = {}
    launch = wp.launch

    def spy(kernel, *args, **options):
        kernels.setdefault(kernel.func.__name__, set()).add(kernel)
        return launch(kernel, *args, **options)

    monkeypatch.setattr(wp, "launch", spy)
    return kernels


def test_the_kernel_is_the_one_that_validate_uses(machine, launched, monkeypatch):
    twins(2, machine=machine).advance(1)
    timed = launched.pop("advance")
    launched.clear()
    monkeypatch.setattr("aoro_gym.validation.turns.LONGEST_TURN", 0.5)
    run_turns(machine, [Turn("left", 100.0)])
    assert launched["advance"] == timed
    assert len(timed) == 1


def test_another_ground_is_another_kernel(machine, launched):
    for ground in ("plane", "raster", "mesh"):
        twins(2, machine=machine, ground=ground).advance(1)
    assert len(launched["advance"]) == 3


def test_commands_change_every_control_step(machine, monkeypatch):
    given = []
    step = Twin.step

    def counting(twin, commands=None, duration=0.02, **options):
        given.append((commands, duration))
        return step(twin, commands, duration, **options)

    monkeypatch.setattr(Twin, "step", counting)
    subject = twins(3, machine=machine, seed=5)
    given.clear()
    subject.advance(CHANGES)
    assert {duration for _, duration in given} == {CONTROL_STEP}
    steering = np.array([commands["steering_signal"] for commands, _ in given])
    assert len(np.unique(steering)) == 3 * CHANGES
    assert subject.steps == 20 and subject.copies == 3


@pytest.mark.parametrize("ground", ["plane", "raster", "mesh"])
def test_an_episode_keeps_every_twin(ground):
    subject = twins(16, machine=Machine.load(), ground=ground, randomise=True, threads=1)
    subject.restart()
    subject.advance(100)
    assert subject.check() == {}


def test_machines_are_drawn(machine):
    drawn = randomised(machine, 50, seed=3)
    for entry in machine.parameters():
        values = np.broadcast_to(drawn.value(entry.key), 50)
        if entry.role in ("nuisance", "both") and entry.si != 0.0:
            factor = values / entry.si
            assert len(np.unique(values)) == 50, entry.key
            assert np.abs(factor - 1.0).max() <= SPREAD + 1e-12
        else:
            assert (values == entry.si).all(), entry.key
    again = randomised(machine, 50, seed=3)
    assert all(np.array_equal(drawn.value(key), again.value(key)) for key in machine.entries)


SIDE = 30


@pytest.mark.parametrize("ground", ["plane", "raster"])
def test_memory_of_a_twin(machine, ground):
    """Every byte that grows with the twins is a twin's own, and none of the others is."""

    def held(count, own=True):
        surface = None if ground == "plane" else Terrain.from_heights(np.zeros((SIDE, SIDE)), cell=CELL)
        return count_memory(Twin(count, machine=machine, terrain=surface, own_machines=own))

    few, many = held(40), held(SIDE**2)  # as many twins as the raster has nodes
    assert few == many
    assert few["bytes_per_twin"] < 8192
    record = MachineRecord.numpy_dtype()["itemsize"]
    alike = held(40, own=False)  # all twins share one record
    assert alike["bytes_per_twin"] == few["bytes_per_twin"] - record
    assert alike["shared_bytes"] == few["shared_bytes"] + record


def test_memory_on_the_device_agrees(machine):
    if not wp.is_cuda_available():
        pytest.skip("no CUDA device")
    memory = twins(65_536, machine=machine, ground="raster", randomise=True, device="cuda:0").description["memory"]
    counted = 65_536 * memory["bytes_per_twin"] + memory["shared_bytes"]
    pool = 64 * 2**20  # what the allocator keeps in reserve
    assert counted - 2**20 < memory["device_bytes"] < 1.1 * counted + pool


def test_ground_and_starts():
    ground = heights("raster")
    corner = terrain().vertices[0]
    assert ground.shape == (NODES, NODES) == heights("plane").shape
    assert ground[0, 0] == corner[2] and tuple(corner[:2]) == tuple(terrain().extent[0][:2])
    assert ground[-1, 0] == terrain().vertices[np.argmax(terrain().vertices[:, 1] - terrain().vertices[:, 0]), 2]
    position, heading = starts(1000, seed=1)
    assert np.abs(position).max() <= 0.5 * terrain().extent[1][0]
    assert heading.min() < -3.0 < 3.0 < heading.max()
    steering, drive = np.moveaxis(signals(1000, seed=1), 1, 0)
    assert np.abs(steering).max() > 0.99 and 0.49 < np.abs(drive).max() <= 0.5
