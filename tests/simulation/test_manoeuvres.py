"""Manoeuvres: what is commanded when, what a command file may hold, and what a run records."""

import re
from types import SimpleNamespace

import numpy as np
import pytest

from aoro_gym import Twin
from aoro_gym.simulation.log import log_columns, write_log
from aoro_gym.simulation.manoeuvres import (
    SETTLE,
    STANDSTILL,
    Manoeuvre,
    Segment,
    SimulationDiverged,
    from_file,
    run,
    standing_turn,
    straight_drive,
)
from aoro_gym.twin.records import NON_FINITE, RUTS_FULL


def segments(manoeuvre: Manoeuvre) -> list[tuple[int, dict[str, float]]]:
    return [(segment.steps, dict(segment.commands)) for segment in manoeuvre.segments]


def test_turns_start_at_the_opposite_stop():
    left, right = standing_turn(1, 0.5, 0.7, duration=2.0), standing_turn(-1, 1.0, 0.7, duration=2.0)
    assert (left.start_angle, right.start_angle) == (-0.7, 0.7)
    assert segments(left) == [(600, {"steering_signal": 0.0}), (1400, {"steering_signal": 0.5})]
    assert segments(right) == [(600, {"steering_signal": 0.0}), (1400, {"steering_signal": -1.0})]
    assert left.stop_angle is None
    assert standing_turn(1, 0.5, 0.7).stop_angle == 0.7


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: standing_turn(1, 0.0, 0.7), "--signal is 0 %, but must be in (0, 100] %"),
        (lambda: standing_turn(1, float("nan"), 0.7), "--signal is nan %, but must be in (0, 100] %"),
        (lambda: standing_turn(1, 1.0, 0.7, duration=0.5), "--duration is 0.5 s, but must be in [0.61, 3600] s"),
        (lambda: straight_drive(-1.01), "--signal is -101 %, but must be in [-100, 100] %"),
        (lambda: straight_drive(0.5, duration=float("inf")), "--duration is inf s, but"),
    ],
)
def test_refuses(make, message):
    with pytest.raises(ValueError, match=re.escape(message)):
        make()


def test_rows_hold_until_the_next(tmp_path):
    path = tmp_path / "commands.csv"
    path.write_text("time_s,steering_signal,gear\n0.1,0,1\n0.2,0,1\n0.35,-0.5,2\n0.5,0,2\n")
    manoeuvre = from_file(path, start_angle=0.1)
    assert manoeuvre.start_angle == 0.1
    assert segments(manoeuvre) == [
        (100, {}),
        (250, {"steering_signal": 0.0, "gear": 1.0}),
        (150, {"steering_signal": -0.5, "gear": 2.0}),
    ]
    assert manoeuvre.duration == pytest.approx(0.5)


@pytest.mark.parametrize(("duration", "steps"), [(0.3, [100, 200]), (1.0, [100, 250, 150, 500])])
def test_duration_cuts_or_holds(tmp_path, duration, steps):
    path = tmp_path / "commands.csv"
    path.write_text("time_s,steering_signal\n0.1,0\n0.35,-0.5\n0.5,0.25\n")
    assert [length for length, _ in segments(from_file(path, duration=duration))] == steps


def test_voltage_serves_as_signal(tmp_path):
    path = tmp_path / "commands.csv"
    path.write_text("time_s,steering_signal_V\n0,0.5\n1,3.5\n2,2.5\n")
    assert [commands for _, commands in segments(from_file(path))] == [
        {"steering_signal": 1.0},
        {"steering_signal": -0.5},
    ]


def test_a_recording_is_a_mapping_of_channel_names(left_turn):
    assert list(left_turn) == list(left_turn.channels) and len(left_turn) == len(left_turn.channels)
    assert "joint_angle" in left_turn and 0 not in left_turn
    assert dict(left_turn)["joint_angle"] is left_turn["joint_angle"] is left_turn.channels["joint_angle"]


def test_a_recording_covers_the_manoeuvre(left_turn, machine):
    np.testing.assert_allclose(np.diff(left_turn.time), 1e-3)
    before = left_turn.time <= STANDSTILL
    assert np.all(left_turn["steering_signal"][before] == 0.0)
    assert np.all(left_turn["steering_signal"][~before] == 1.0)
    assert np.ptp(left_turn["joint_angle"][before]) < 1e-3
    # it ends once the joint has rested at its stop, within one chunk
    reached = left_turn.time[np.argmax(left_turn["joint_angle"] >= machine.joint.range - np.radians(0.1))]
    assert reached + SETTLE <= left_turn.time[-1] <= reached + SETTLE + 0.2


def test_a_log_drives_the_twin_again(tmp_path, machine):
    path = tmp_path / "commands.csv"
    path.write_text("time_s,steering_signal,drive_signal\n0,0,0\n0.1,0.8,0.3\n0.5,0,0\n")
    twin = Twin(machine=machine)
    first = run(twin, from_file(path))
    write_log(tmp_path / "log.csv", log_columns(first.time, first.channels))
    again = run(twin, from_file(tmp_path / "log.csv", duration=0.5))
    np.testing.assert_allclose(again.time, first.time, rtol=1e-12)
    np.testing.assert_array_equal(again["joint_angle"], first["joint_angle"])


def test_kept_samples_are_those_of_the_full_recording(machine):
    plan = Manoeuvre(
        "wiggle", "Wiggle", 0.0, (Segment(33, {"steering_signal": 1.0}), Segment(240, {"steering_signal": 0.0}))
    )
    twin = Twin(machine=machine)
    full, coarse = run(twin, plan), run(twin, plan, keep_every=0.01)
    np.testing.assert_allclose(coarse.time, np.arange(1, 28) * 0.01)
    np.testing.assert_array_equal(coarse["pressure_a"], full["pressure_a"][9::10])


def test_progress_reaches_the_end(machine):
    seen = []
    run(Twin(machine=machine), straight_drive(0.2, duration=0.85), progress=seen.append)
    assert seen == sorted(seen)
    assert seen[-1] == pytest.approx(0.85)


@pytest.mark.parametrize(
    ("status", "reason", "message"),
    [
        (NON_FINITE, "non-finite state", "simulation diverged (non-finite state at t = 0.100 s)"),
        (RUTS_FULL, "memory is full", "simulation stopped at t = 0.100 s: memory is full"),
    ],
)
def test_a_lost_twin_ends_the_run(status, reason, message):
    trace = SimpleNamespace(time=np.arange(1, 101) * 1e-3, channels=())
    twin = SimpleNamespace(
        reset=lambda **_: None, step=lambda *_, **__: trace, diverged=[(0, reason)], status=np.array([status])
    )
    with pytest.raises(SimulationDiverged, match=re.escape(f"twin 0: {message}")):
        run(twin, straight_drive(0.5))  # pyright: ignore[reportArgumentType]
