"""Logs, shown again."""

import numpy as np
import pytest

from aoro_gym.simulation.log import log_columns, write_log
from aoro_gym.twin import Twin
from aoro_gym.twin.poses import pose_of_state
from aoro_gym.view.replay import Recording, Replay, log_channels


@pytest.fixture(scope="module")
def driven(tmp_path_factory):
    """A log, and the twin at its end."""
    twin = Twin(threads=1)
    twin.reset(heading=0.5, joint_angle=0.1)
    trace = twin.step({"drive_signal": 0.6, "steering_signal": 0.5}, 2.0, sample_every=0.01)
    assert trace is not None
    path = tmp_path_factory.mktemp("log") / "drive.csv"
    write_log(path, log_columns(trace.time, {name: values[:, 0] for name, values in trace.items()}))
    return path, twin


def test_the_last_pose_is_the_twin_s(driven):
    path, twin = driven
    recording = Recording(twin.machine, *log_channels(path))
    replay = Replay([recording])
    replay.advance(100.0)
    assert replay.time == replay.duration == pytest.approx(1.99)
    shown, true = replay.poses()[0], pose_of_state(twin.state.numpy()[:, 0])
    np.testing.assert_allclose(shown.position, true.position, atol=2e-6)  # float32, and nine digits
    assert abs(shown.wxyz @ true.wxyz) == pytest.approx(1.0, abs=1e-6)
    assert shown.joint == pytest.approx(true.joint, abs=1e-6)
    np.testing.assert_allclose(shown.arms, true.arms, atol=1e-6)
    # wheels from 0.01 s on, by the trapezoidal rule at 100 Hz
    turned = np.subtract(true.wheels, shown.wheels)
    assert np.all(np.abs((turned + np.pi) % (2.0 * np.pi) - np.pi) < 2e-3)


def test_time_goes_where_it_is_told_and_loads_are_upright(driven):
    path, twin = driven
    replay = Replay([Recording(twin.machine, *log_channels(path))] * 2)
    replay.seek(1.0)
    assert replay.time == 1.0
    feet, forces = replay.forces()
    assert feet.shape == forces.shape == (2, 4, 3)
    assert forces[0, :, 2].sum() == pytest.approx(sum(v for k, v in replay.readings()[0].items() if "wheel_load" in k))
    replay.restart()
    assert replay.time == 0.0


def test_a_log_without_pose_moves_joint_and_wheels_in_place(driven, tmp_path):
    path, twin = driven
    header, *rows = [line.split(",") for line in path.read_text().splitlines()]
    kept = [i for i, name in enumerate(header) if not name.startswith("true_")]
    idle = {"steering_signal": "0", "steering_signal_V": "2.5", "drive_signal": "0"}
    rest = [idle.get(header[i]) or rows[0][i] for i in kept[1:]]
    # a standstill, as recordings begin with
    times = [0.01 * tick for tick in range(50 + len(rows))]
    values = [rest] * 50 + [[row[i] for i in kept[1:]] for row in rows]
    lines = [",".join([f"{time:.2f}", *row]) for time, row in zip(times, values, strict=True)]
    lines.insert(0, ",".join(header[i] for i in kept))
    measured = tmp_path / "measured.csv"
    measured.write_text("\n".join(lines) + "\n")
    recording = Recording(twin.machine, *log_channels(measured))
    pose = recording.pose(recording.reading(2.0))
    assert pose.joint != 0.0 and pose.wheels[0] > 0.5
    np.testing.assert_allclose(pose.position[:2], 0.0)
    assert pose.position[2] == pytest.approx(float(twin.machine.rest.height))
