"""The log of a served twin: what clients were told, to the last digit, in three formats."""

import numpy as np
import pytest

from aoro_gym.cosimulation.server.geodesy import Geodesy, Origin
from aoro_gym.cosimulation.server.nmea import Solution
from aoro_gym.cosimulation.server.recorder import COMMANDED, SHOWN, Recorder, manifest
from aoro_gym.cosimulation.server.records import neutral
from aoro_gym.cosimulation.server.session import Session
from aoro_gym.machine.specification import MachineSpec, RunSpec
from aoro_gym.recording.bag_writing import WRITTEN
from aoro_gym.recording.bags import topics_of
from aoro_gym.recording.logs import read_log
from aoro_gym.recording.tables import read_table
from aoro_gym.sensors.gps import NONE
from aoro_gym.twin import Twin

BEFORE, AFTER = 60, 140
"""Records of telemetry before and after the command."""


@pytest.fixture(scope="module")
def recorded():
    """A recorder, what was told, solutions of the receiver with the number of records before each, and the twin."""
    twin = Twin(threads=1)
    geodesy = Geodesy(twin.terrain, Origin(60.0, 25.0, 10.0))  # pyright: ignore[reportArgumentType]
    recorder = Recorder(geodesy)
    told: list[dict] = []
    solutions: list[tuple[int, Solution]] = []

    def publish(values, instant):
        told.append(dict(values) | {"time": instant})
        recorder.take(values, instant, *session.measured)

    def solve(solution):
        solutions.append((len(told), solution))
        recorder.solve(solution)

    session = Session(twin, geodesy, seed=2, on_telemetry=publish, on_solution=solve)
    session.run(10 * BEFORE)
    session.command({**neutral(1.0), "parking_brake": 0.0, "drive_signal": 0.5, "steering_signal": 0.8})
    session.run(10 * AFTER)
    yield recorder, told, solutions, twin
    recorder.close()


def test_columns_are_what_clients_were_told(recorded):
    recorder, told, _solutions, _twin = recorded
    columns = recorder.columns()
    assert len(recorder) == len(told) == BEFORE + AFTER
    np.testing.assert_array_equal(columns["time_s"], [one["time"] for one in told])
    for column, (field, size) in SHOWN.items():
        np.testing.assert_array_equal(columns[column], [one[field] / size for one in told], err_msg=column)
    assert columns["true_yaw_deg"][-1] > 1.0 and columns["true_position_x_m"][-1] > 0.1
    # the command holds from the last record's instant before it on
    np.testing.assert_array_equal(np.flatnonzero(columns["steering_signal"]), np.arange(BEFORE - 1, BEFORE + AFTER))
    assert set(columns["gear"]) == {1.0} and columns["parking_brake"][0] == 1.0
    assert all(name in columns for name in COMMANDED)


def test_solutions_stay_until_the_next_one(recorded):
    recorder, told, solutions, twin = recorded
    columns = recorder.columns()
    assert len(solutions) > 10
    first = solutions[0][0]
    assert (
        np.isnan(columns["gps_latitude_deg"][:first]).all() and np.isfinite(columns["gps_latitude_deg"][first:]).all()
    )
    geodesy = Geodesy(twin.terrain, Origin(60.0, 25.0, 10.0))  # pyright: ignore[reportArgumentType]
    ends = [at for at, _ in solutions[1:]] + [len(told)]
    for (begin, solution), end in zip(solutions, ends, strict=True):
        latitude, longitude, height = geodesy.place(*map(float, solution.position))
        for name, value in (("latitude_deg", latitude), ("longitude_deg", longitude), ("altitude_m", height)):
            np.testing.assert_array_equal(columns[f"gps_{name}"][begin:end], value)
        np.testing.assert_array_equal(columns["gps_status"][begin:end], 2.0)


def test_a_receiver_without_solution_keeps_its_place_and_says_so():
    twin = Twin(threads=1)
    geodesy = Geodesy(twin.terrain)  # pyright: ignore[reportArgumentType]
    recorder, seen = Recorder(geodesy), []
    session = Session(twin, geodesy, seed=1, on_solution=seen.append)
    session.run(200)
    recorder.solve(seen[-1])
    recorder.take(dict.fromkeys((field for field, _ in SHOWN.values()), 0.0), 0.2, *session.measured)
    lost = Solution(seen[-1].utc, seen[-1].position + 5.0, seen[-1].heading, NONE)
    recorder.solve(lost)
    recorder.take(dict.fromkeys((field for field, _ in SHOWN.values()), 0.0), 0.3, *session.measured)
    columns = recorder.columns()
    np.testing.assert_array_equal(columns["gps_status"], [2.0, -1.0])
    assert columns["gps_latitude_deg"][0] == columns["gps_latitude_deg"][1]
    recorder.close()


@pytest.mark.parametrize(("suffix", "digits"), [(".mcap", 0.0), (".rosbag2", 0.0), (".parquet", 0.0), (".csv", 0.5e-8)])
def test_a_log_comes_back(recorded, tmp_path, suffix, digits):
    """To the last digit, but for CSV, which has nine."""
    recorder, _told, _, twin = recorded
    run = RunSpec(MachineSpec("aoro"))
    file = tmp_path / f"session{suffix}"
    written = recorder.write(file, manifest(twin, run, None, 1.5))
    assert written == [file, tmp_path / "session.toml"]
    table, columns = read_table(file), recorder.columns()
    assert set(table.names) == set(columns)
    for name, values in columns.items():
        nanoseconds = 1e-9 if suffix in WRITTEN and name == "time_s" else 0.0
        np.testing.assert_allclose(table.numbers_or_blank(name), values, rtol=digits, atol=nanoseconds, err_msg=name)
    log = read_log(file)
    assert log.manifest.ground == {"slope_deg": 0.0, "direction_deg": 0.0, "friction": 1.0, "rolling_resistance": 1.0}
    # the hinge's sensor, on the grid of the log
    np.testing.assert_allclose(log.channels["joint_angle"], columns["joint_angle_rad"], atol=1e-6)
    if suffix in WRITTEN:
        kinds = {topic: kind for topic, (kind, _) in topics_of(file).items()}
        assert kinds["/imu"] == "sensor_msgs/msg/Imu" and kinds["/gps/fix"] == "sensor_msgs/msg/NavSatFix"
        assert kinds["/tf"] == "tf2_msgs/msg/TFMessage"
