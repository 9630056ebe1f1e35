"""Twins that are dealt out to devices move as those of one; two shards of the CPU stand for two devices."""

from typing import Any

import numpy as np
import pytest
import warp as wp

from aoro_gym.machine import Machine
from aoro_gym.terrains import Plane
from aoro_gym.twin import Twin
from aoro_gym.twin.sharded import ShardedTwins

COUNT = 5
COMMANDS = {"steering_signal": np.linspace(-1.0, 1.0, COUNT), "drive_signal": 0.4}
DEVICES = [
    "cpu,cpu,cpu",
    pytest.param("cuda:0,cuda:0", marks=pytest.mark.skipif(not wp.is_cuda_available(), reason="needs a CUDA device")),
]


def pair(device: str = "cpu,cpu,cpu", **arguments: Any) -> tuple[Twin, ShardedTwins]:
    return Twin(COUNT, device=device.split(",")[0], **arguments), ShardedTwins(COUNT, device=device, **arguments)


@pytest.mark.parametrize("device", DEVICES)
def test_they_move_as_twins_of_one_device_to_the_bit(device):
    """Machines, slopes, starts and commands of every twin's own go to where it is."""
    machine = Machine.load("aoro").scale({"steering.valve.spool_time_constant": np.linspace(0.8, 1.2, COUNT)})
    terrain = Plane(slope_deg=np.linspace(-4.0, 4.0, COUNT), friction=0.8)
    one, many = pair(device, machine=machine, terrain=terrain)
    for twins in (one, many):
        twins.reset(position=np.arange(2.0 * COUNT).reshape(COUNT, 2), heading=np.arange(COUNT), joint_angle=0.1)
        twins.reset(np.arange(COUNT) == 3, joint_angle=np.linspace(0.0, 0.2, COUNT))
    found, expected = (twins.step(COMMANDS, 0.3, sample_every=0.1) for twins in (many, one))
    assert found is not None and expected is not None and found.channels == expected.channels
    np.testing.assert_array_equal(found.samples, expected.samples)
    np.testing.assert_array_equal(found.time, expected.time)
    for twins in (one, many):
        twins.advance(0.1)
    many.synchronize()
    for channel in ("joint_angle", "position_x", "pressure_a"):
        np.testing.assert_array_equal(many.output(channel), one.output(channel))
    np.testing.assert_array_equal(many.time, one.time)
    np.testing.assert_array_equal(many.status, one.status)


def test_commands_are_written_where_the_twins_are():
    one, many = pair()
    one.set_commands(COMMANDS)
    for memory, span in zip(many.commands, many.spans, strict=True):
        memory.assign(np.ascontiguousarray(one.commands.numpy()[:, span]))
    for twins in (one, many):
        twins.advance(0.2)
    np.testing.assert_array_equal(np.concatenate([out.numpy() for out in many.outputs], axis=-1), one.outputs.numpy())


def test_machines_are_given_to_some_twins():
    one, many = pair(own_machines=True)
    slow = Machine.load("aoro").scale({"steering.valve.spool_time_constant": [2.0, 4.0, 8.0]})
    for twins in (one, many):
        twins.set_machines([4, 0, 2], slow)
        twins.step(COMMANDS, 0.2)
    np.testing.assert_array_equal(many.output("joint_angle"), one.output("joint_angle"))
    with pytest.raises(ValueError, match=r"the machine has 3 variants, but must have 1 or 2"):
        many.set_machines([0, 1], slow)


def test_a_load_of_one_twin_puts_all_into_the_same_kernel():
    machine = Machine.load("aoro").set({"payload.count": [0.0, 0.0, 0.0, 0.0, 20.0]})
    one, many = pair(machine=machine)
    for twins in (one, many):
        twins.step(COMMANDS, 0.1)
    assert all(shard.carries_load for shard in many.shards)
    np.testing.assert_array_equal(many.output("pitch"), one.output("pitch"))


def test_twins_that_diverge_have_their_number():
    _, many = pair()
    many.shards[1].state.assign(np.full(many.shards[1].state.shape, np.nan, dtype=np.float32))
    many.advance(0.01)
    assert [number for number, _ in many.diverged] == list(range(many.spans[1].start, many.spans[1].stop))


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (
            {"device": "cpu,cpu,cpu", "num_twins": 2},
            r"device is cpu,cpu,cpu, 3 devices, but there are 2 twins; name 2 devices",
        ),
        ({"device": "cpu,gpu"}, r"device 'gpu' is not available here; choose one of: cpu"),
        (
            {"device": "cpu", "machine": Machine.load("aoro").scale({"engine.set_speed": [1.0, 0.9]})},
            "has 2 variants, but",
        ),
        (
            {"device": "cpu,cpu", "terrain": Plane(slope_deg=[1.0, 2.0])},
            "plane slope_deg has 2 variants, but must",
        ),
        ({"device": "cpu,cpu", "substeps": 1}, "take substeps of at least"),
    ],
)
def test_what_cannot_be_dealt_out_is_said(arguments, message):
    with pytest.raises(ValueError, match=message):
        ShardedTwins(**{"num_twins": COUNT, **arguments})


def test_commands_of_a_wrong_shape_are_said():
    _, many = pair()
    with pytest.raises(ValueError, match=r"steering_signal has shape \(2,\), but must be a scalar or \(5\)"):
        many.step({"steering_signal": [0.0, 1.0]})
    with pytest.raises(ValueError, match=r"position has shape \(3, 2\), but must be \(2,\) or \(5, 2\)"):
        many.reset(position=np.zeros((3, 2)))
