"""The host side of the twin: errors, resets, batches, and what happens to a twin that goes non-finite."""

import math

import numpy as np
import pytest
import warp as wp

from aoro_gym.machine import Machine
from aoro_gym.terrains.plane import Plane
from aoro_gym.twin import Twin
from aoro_gym.twin.recorded import WORTH_THREADS, cores
from aoro_gym.twin.records import COMMAND_BOUNDS, OUTPUT_UNITS, Command, MachineRecord, Output, State, pack


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"num_twins": 0}, "num_twins is 0"),
        ({"num_twins": 2.5}, r"num_twins is 2\.5"),
        ({"num_twins": -3}, "num_twins is -3"),
        (
            {"num_twins": Machine.load()},
            r"^num_twins is Machine\('aoro', \d+ parameters\), but must be a positive integer$",
        ),
        ({"substeps": 0}, "substeps is 0"),
        ({"threads": 0}, "threads is 0, but must be an integer in"),
        ({"threads": 10_000}, "threads is 10000, but must be an integer in"),
        ({"main_step": 0.0}, "main_step is 0"),
        ({"main_step": 0.01}, r"main_step is 0\.01 s, but must be in \(0, 0\.002\]"),
        ({"main_step": float("nan")}, "main_step is nan"),
        ({"device": "cuda:77"}, "device 'cuda:77' is not available here; choose one of: cpu"),
        ({"device": "tpu"}, "device 'tpu' is not available"),
        ({"machine": "no-such-machine"}, "no-such-machine"),
        ({"num_twins": 3, "terrain": Plane(slope_deg=np.zeros(2))}, "the terrain has 2 variants, but must have 1 or"),
        ({"gravity": float("inf")}, "gravity is inf"),
    ],
)
def test_bad_arguments_are_named(arguments, message):
    with pytest.raises((ValueError, FileNotFoundError), match=message):
        Twin(**arguments)


def test_a_twin_is_shown_in_a_line():
    assert repr(Twin()) == "Twin(1, machine='aoro', device='cpu')"
    assert repr(Twin(8, device="cpu:simd")) == "Twin(8, machine='aoro', device='cpu:simd')"


@pytest.mark.parametrize(
    ("commands", "message"),
    [
        ({"steering_signal": float("nan")}, "steering_signal is nan"),
        ({"steering_signal": 1.01}, r"steering_signal is 1\.0.*must be in \[-1, 1\]"),
        ({"steering_signal": [0.0, -2.0, 0.0]}, r"steering_signal\[1\] is -2"),
        ({"drive_signal": np.zeros(2)}, r"drive_signal has shape \(2,\), but must be a scalar or \(3,\)"),
        ({"gear": 4}, "gear is 4"),
        ({"gear": 1.5}, r"gear is 1\.5, but must be one of 1, 2, 3"),
        ({"steer": 0.0}, "there is no command 'steer'.* one of: steering_signal"),
    ],
)
def test_bad_commands_are_named_and_change_nothing(commands, message):
    twin = Twin(3)
    before = twin.state.numpy().copy(), twin.commands.numpy().copy()
    with pytest.raises(ValueError, match=message):
        twin.step({"parking_brake": 1.0, **commands})
    assert np.array_equal(before[0], twin.state.numpy())
    assert np.array_equal(before[1], twin.commands.numpy())


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"duration": 0.0}, "duration is 0"),
        ({"duration": 0.0205}, r"duration is 0\.0205"),
        ({"duration": float("nan")}, "duration is nan"),
        ({"duration": 0.02, "sample_every": 0.003}, "whole multiple of sample_every"),
    ],
)
def test_bad_durations_are_named(arguments, message):
    with pytest.raises(ValueError, match=message):
        Twin(1).step({}, **arguments)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"joint_angle": 0.8}, r"joint_angle is 0\.8000 rad, but the joint reaches only"),
        ({"joint_angle": float("nan")}, "must be finite"),
        ({"position": (0.0, 0.0, 1.0)}, "must broadcast"),
        ({"mask": np.ones(3)}, "mask has shape"),
        ({"mask": np.ones(2, dtype=bool)}, "mask has shape"),
    ],
)
def test_bad_resets_are_named(arguments, message):
    with pytest.raises(ValueError, match=message):
        Twin(3).reset(**arguments)


def test_reset_of_some_leaves_the_others_alone():
    twin = Twin(3)
    twin.step({"steering_signal": [1.0, -1.0, 0.5]}, 0.2)
    before = twin.state.numpy().copy()
    twin.reset(np.array([False, True, False]), position=(5.0, -2.0), heading=0.3, joint_angle=0.1)
    after = twin.state.numpy()
    assert np.array_equal(before[:, [0, 2]], after[:, [0, 2]])
    assert after[State.X, 1] == 5.0
    assert after[State.Y, 1] == -2.0
    assert after[State.JOINT, 1] == np.float32(0.1)
    assert np.array_equal(twin.time, [0.2, 0.0, 0.2])
    assert twin.commands.numpy()[Command.STEERING_SIGNAL].tolist() == [1.0, 0.0, 0.5]


def test_reset_restores_initial_commands():
    twin = Twin(1)
    names = [command.name.lower() for command in Command]
    twin.set_commands({name: COMMAND_BOUNDS[name][1] for name in names})
    twin.reset()
    assert twin.commands.numpy()[:, 0].tolist() == [COMMAND_BOUNDS[name][2] for name in names]


def test_a_twin_does_not_depend_on_its_neighbours():
    """Twins of one launch equal single twins to the bit, also with machines of their own."""
    machine = Machine.load()
    key = "steering.valve.compensator_pressure"
    settings = np.array([5e5, 7e5, 9e5])
    signals = np.array([1.0, -0.6, 0.8])
    many = Twin(3, machine=machine.set({key: settings}, si=True))
    trace = many.step({"steering_signal": signals}, 0.4, sample_every=0.01)
    assert trace is not None
    for i in range(3):
        one = Twin(1, machine=machine.set({key: settings[i]}, si=True))
        alone = one.step({"steering_signal": signals[i]}, 0.4, sample_every=0.01)
        assert alone is not None
        assert np.array_equal(alone.samples[:, :, 0], trace.samples[:, :, i])


def test_one_long_launch_equals_many_short_ones():
    long, short = Twin(1), Twin(1)
    long.step({"steering_signal": 0.7, "drive_signal": 0.3}, 0.3)
    for _ in range(15):
        short.step({"steering_signal": 0.7, "drive_signal": 0.3}, 0.02)
    assert np.array_equal(long.state.numpy(), short.state.numpy())


@pytest.mark.skipif(cores() < 2, reason="one core")
def test_threads_share_the_twins_and_change_nothing():
    alone, shared = Twin(21, threads=1), Twin(21, threads=2)
    signals = np.linspace(-1.0, 1.0, 21)
    for twin in (alone, shared):
        twin.step({"steering_signal": signals, "drive_signal": signals[::-1]}, 0.1)
    assert alone.num_twins * 100 >= WORTH_THREADS
    assert np.array_equal(alone.state.numpy(), shared.state.numpy())


def test_trace_samples_the_end_of_every_interval():
    fine, coarse = Twin(2), Twin(2)
    every = fine.step({"steering_signal": 1.0}, 0.06, sample_every=0.001)
    tenth = coarse.step({"steering_signal": 1.0}, 0.06, sample_every=0.01)
    assert every is not None and tenth is not None
    assert np.allclose(tenth.time, 0.01 * np.arange(1, 7), rtol=0.0, atol=1e-12)
    assert np.array_equal(tenth.samples, every.samples[9::10])
    assert np.array_equal(coarse.output("joint_angle"), tenth["joint_angle"][-1])
    with pytest.raises(ValueError, match="there is no output 'joint'"):
        coarse.output("joint")


def test_a_trace_is_a_mapping_of_channel_names():
    twin = Twin(2)
    trace = twin.step({"steering_signal": 1.0}, 0.03, sample_every=0.01)
    assert trace is not None
    assert list(trace) == list(trace.keys()) == list(trace.channels) == list(OUTPUT_UNITS)
    assert len(trace) == len(Output)
    assert "pitch" in trace and "nothing" not in trace and 3 not in trace
    copied = dict(trace)
    for row, (name, samples) in enumerate(trace.items()):
        assert samples.shape == (3, 2)
        assert np.array_equal(samples, trace.samples[:, row]) and np.array_equal(copied[name], samples)
    assert [samples.shape for samples in trace.values()] == [(3, 2)] * len(trace)
    assert trace.get("nothing") is None
    assert trace == trace and trace != twin.step({}, 0.03, sample_every=0.01)
    with pytest.raises(KeyError) as error:
        trace["ptich"]
    assert str(error.value).startswith(
        "there is no output 'ptich': did you mean 'pitch'? Choose one of: steering_signal,"
    )
    with pytest.raises(KeyError, match="there is no output '7'; choose one of: steering_signal"):
        trace[7]  # pyright: ignore[reportArgumentType]


def test_a_non_finite_twin_is_frozen_and_named_while_the_others_go_on():
    twin, reference = Twin(3), Twin(3)
    for t in (twin, reference):
        t.step({"steering_signal": 1.0}, 0.1)
    state = twin.state.numpy()
    state[State.PORT_A, 1] = np.nan
    twin.state.assign(state)
    twin.step({}, 0.1)
    reference.step({}, 0.1)
    assert twin.diverged == [(1, "non-finite state")]
    assert twin.status.tolist() == [0, 1, 0]
    assert np.array_equal(twin.state.numpy()[:, [0, 2]], reference.state.numpy()[:, [0, 2]])
    frozen = twin.state.numpy()[:, 1]
    twin.step({}, 0.1)
    assert np.array_equal(frozen, twin.state.numpy()[:, 1], equal_nan=True)
    assert np.array_equal(twin.time, [0.3, 0.1, 0.3])
    twin.reset(np.array([False, True, False]))
    twin.step({}, 0.1)
    assert twin.diverged == []


@pytest.mark.parametrize("row", [row for row in State if row.name not in ("FLOW_IN", "FLOW_OUT")])
def test_no_non_finite_state_goes_unseen(row):
    """Whatever state is spoilt, the twin is named within 20 ms, or the spoilt value is one that nothing depends on."""
    twin = Twin(1, choose_laws=row >= State.SPOOL_RATE)  # the states of other laws are the last rows
    twin.step({"steering_signal": 0.5, "drive_signal": 0.3}, 0.05)
    state = twin.state.numpy()
    state[row, 0] = np.nan
    twin.state.assign(state)
    twin.step({}, 0.02)
    assert twin.diverged or np.all(np.isfinite(twin.state.numpy())), row.name


def test_a_far_away_twin_creeps_as_one_at_the_origin():
    """At 1000 m a float32 resolves 6e-5 m, more than a main step of slow driving; the position keeps its remainder."""
    near, far = Twin(1), Twin(1)
    far.reset(position=(1000.0, -1000.0))
    for twin in (near, far):
        twin.step({"drive_signal": 0.02}, 20.0)
    travelled = near.output("position_x")[0]
    assert travelled > 0.2
    # half a unit in the last place of the start and of the end
    assert abs(far.output("position_x")[0] - 1000.0 - travelled) < 2 * np.spacing(np.float32(1000.0))


def test_every_output_has_a_unit_and_every_device_field_a_value():
    assert set(OUTPUT_UNITS) == {output.name.lower() for output in Output}
    row = pack(Machine.load())[0]

    def leaves(record, dtype, path=""):
        for name in dtype.names:
            if dtype[name].names:
                yield from leaves(record[name], dtype[name], f"{path}{name}.")
            else:
                yield f"{path}{name}", record[name]

    for name, value in leaves(row, row.dtype):
        assert np.all(np.isfinite(value)), name


def test_device_memory_of_a_twin_is_small():
    """At most 8 KiB a twin, machine record of its own included."""
    twin = Twin(100)
    arrays = [value for value in vars(twin).values() if isinstance(value, wp.array)]
    a_twin = (
        sum(a.capacity / a.shape[-1] for a in arrays if a.shape[-1] == 100) + MachineRecord.numpy_dtype()["itemsize"]
    )
    assert a_twin < 8192


def test_machines_can_be_exchanged_one_by_one():
    machine = Machine.load()
    key = "steering.valve.spool_time_constant"
    slow = machine.set({key: 0.06}, si=True)
    twin = Twin(3, own_machines=True)
    twin.set_machines([1], slow)
    twin.reset()
    twin.step({"steering_signal": 1.0}, 0.3)
    angle = twin.output("joint_angle")
    assert angle[0] == angle[2]
    alone = Twin(1, machine=slow)
    alone.step({"steering_signal": 1.0}, 0.3)
    assert angle[1] == alone.output("joint_angle")[0] != angle[0]
    with pytest.raises(ValueError, match="own_machines=True"):
        Twin(3).set_machines([0], slow)
    with pytest.raises(ValueError, match=r"indices\[.*, but must be in \[0, 2\]"):
        twin.set_machines([3], slow)
    with pytest.raises(ValueError, match="the machine has 2 variants"):
        twin.set_machines([0, 1, 2], machine.set({key: [0.01, 0.02]}, si=True))


@pytest.mark.parametrize("count", [1, 300])
def test_advancing_again_and_again_is_to_advance(count):
    """To the bit: states and samples, of one launch and of slices on several threads."""
    twins = [Twin(count, device="cpu") for _ in range(2)]
    for twin in twins:
        twin.set_commands({"steering_signal": 0.7})
    advance = twins[1].advancing(0.01, sample_every=0.005)
    for _ in range(20):
        twins[0].advance(0.01, sample_every=0.005)
        advance(0, count)
    np.testing.assert_array_equal(twins[0].state.numpy(), twins[1].state.numpy())
    np.testing.assert_array_equal(twins[0].outputs.numpy(), twins[1].outputs.numpy())


@pytest.mark.parametrize("count", [1, 300])
def test_what_is_done_again_and_again_is_told_once(count, monkeypatch):
    """Of one twin, and of many that threads share: nothing is told Warp anew but what differs."""
    twin = Twin(count, device="cpu")
    advance, told, real = twin.advancing(0.01), [], wp.launch
    monkeypatch.setattr(wp, "launch", lambda *given, **named: (told.append(1), real(*given, **named))[1])
    for _ in range(2):
        advance(0, count)
    assert twin.time[0] == 0.02 and len(told) < min(twin.threads, count)  # each thread's own
    for _ in range(2):
        twin.step({"steering_signal": 0.5}, 0.02)
    told.clear()
    trace = twin.step({"steering_signal": 0.5}, 0.02, sample_every=0.02)
    assert trace is not None and len(told) <= min(twin.threads, count)  # another sampling interval
    told.clear()
    for _ in range(2):
        twin.step({"steering_signal": 0.4}, 0.02)
        trace = twin.step({"steering_signal": 0.4}, 0.02, sample_every=0.02)
        assert trace is not None and trace["steering_signal"][-1, -1] == np.float32(0.4)
    assert not told
    assert np.allclose(twin.time, 0.16, rtol=0.0, atol=1e-12)


def test_outputs_of_another_length_are_told_anew():
    """Short steps between long traces, and more durations than are kept."""
    alternating, straight = Twin(1, device="cpu"), Twin(1, device="cpu")
    for twin in (alternating, straight):
        twin.set_commands({"steering_signal": 0.7})
    for number in range(1, 20):
        alternating.step(duration=0.001 * number)
        alternating.step(duration=0.02, sample_every=0.01)
        alternating.step(duration=0.02)
    straight.step(duration=0.19 + 19 * 0.04)
    assert np.array_equal(alternating.state.numpy(), straight.state.numpy())
    assert np.array_equal(alternating.output("joint_angle"), straight.output("joint_angle"))


@pytest.mark.parametrize("wrong", [1.5, -1.5, math.nan, math.inf, 2, np.float32(1.5), "left"])
def test_plain_numbers_are_checked_as_arrays_are(wrong):
    """A number of Python's takes a short way: with the same bounds, and nothing is set before all is checked."""
    twin = Twin(1, device="cpu")
    before = twin.commands.numpy().copy()
    with pytest.raises(ValueError, match=r"steering_signal is|could not convert"):
        twin.set_commands({"drive_signal": 0.5, "steering_signal": wrong})
    assert np.array_equal(twin.commands.numpy(), before)


@pytest.mark.parametrize("count", [1, 300])
def test_sets_of_commands_are_held_one_after_the_other(count):
    """To the bit: four sets of two samples each in one launch, and four launches."""
    twins = [Twin(count, device="cpu") for _ in range(2)]
    signals = [0.7, -0.4, 0.0, 1.0]
    told = np.repeat(twins[1].commands.numpy()[None], len(signals), axis=0)
    told[:, Command.STEERING_SIGNAL] = np.array(signals)[:, None]
    twins[1].advancing(0.08, sample_every=0.01, commands=wp.array(told, dtype=float, device="cpu"))(0, count)
    samples = []
    for signal in signals:
        twins[0].set_commands({"steering_signal": signal})
        twins[0].advance(0.02, sample_every=0.01)
        samples += list(twins[0].outputs.numpy().copy())
    np.testing.assert_array_equal(twins[0].state.numpy(), twins[1].state.numpy())
    np.testing.assert_array_equal(np.stack(samples), twins[1].outputs.numpy())
    with pytest.raises(ValueError, match="4 sets of commands cannot share 6 samples"):
        twins[1].advancing(0.06, sample_every=0.01, commands=wp.array(told, dtype=float, device="cpu"))


@pytest.mark.parametrize("count", [3, 300])
def test_some_are_advanced_and_the_others_stand_still(count):
    """To the bit, and with their clocks."""
    twins = [Twin(count, device="cpu") for _ in range(2)]
    for twin in twins:
        twin.set_commands({"steering_signal": 0.7})
    before, third = twins[0].state.numpy().copy(), count // 3
    advance = twins[1].advancing(0.01)
    for _ in range(20):
        twins[0].advance(0.01)
        advance(third, 2 * third)
    found = twins[1].state.numpy()
    np.testing.assert_array_equal(found[:, third : 2 * third], twins[0].state.numpy()[:, third : 2 * third])
    for others in (slice(0, third), slice(2 * third, count)):
        np.testing.assert_array_equal(found[:, others], before[:, others])
        np.testing.assert_array_equal(twins[1].time[others], 0.0)
