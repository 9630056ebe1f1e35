"""Bags: this project's logs there and back to the last digit, by two readers, and other people's through a mapping."""

from __future__ import annotations

import sqlite3
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from typer.testing import CliRunner

pytest.importorskip("rosbags")

from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from aoro_gym.cli import app
from aoro_gym.diagnosis.selection import log_files
from aoro_gym.recording.bag_mapping import Mapped, columns_of, mapping_file, proposed, read_mapping
from aoro_gym.recording.bag_writing import GPS, IMU, own_column, own_place, write_bag
from aoro_gym.recording.bags import is_bag, number_in, numbers_of, topics_of
from aoro_gym.recording.logs import LOOSE, QUANTITIES, read_log
from aoro_gym.recording.tables import read_table
from aoro_gym.simulation.log import write_log

NAMES = {key: sorted(QUANTITIES[key].bases - LOOSE) for key in ("joint_angle", "pressure_a", "steering_signal")}
SAMPLES = 300
STORE = get_typestore(Stores.ROS2_HUMBLE)


def columns(rng: np.random.Generator) -> dict[str, np.ndarray]:
    """A standing turn, with numbers that no decimal fraction holds."""
    time = 0.01 * np.arange(SAMPLES)
    angle = -0.7 + 0.35 * np.clip(time - 0.5, 0.0, None)
    found = {"time_s": time, "steering_signal": np.where(time < 0.5, 0.0, 0.8)}
    found["steering_signal_V"] = 2.5 - 2.0 * found["steering_signal"]
    found["joint_angle_rad"] = angle + 1e-3 * rng.normal(size=SAMPLES)
    for name in ("pressure_a_bar", "pressure_b_bar", "pump_pressure_bar"):
        found[name] = 20.0 + rng.normal(size=SAMPLES)
    found["engine_speed_rpm"] = 1595.0 + rng.normal(size=SAMPLES)
    for wheel in ("fl", "fr", "rl", "rr"):
        found[f"wheel_speed_{wheel}_rad_per_s"] = 0.01 * rng.normal(size=SAMPLES)
    found["true_joint_flow_L_per_min"] = rng.normal(size=SAMPLES)
    for name in (*IMU, "imu_roll_rad", "imu_pitch_rad"):
        found[name] = rng.normal(size=SAMPLES)
    # the receiver has its first solution after 0.13 s, and loses it once; nine hold for ten samples
    solution = np.maximum(np.arange(SAMPLES) - 13, -1) // 10
    for name in (*GPS, "gps_heading_rad"):
        values = rng.normal(size=SAMPLES)
        values = np.where(values < 0.0, -1.0, 2.0) if name == "gps_status" else values
        found[name] = np.where(solution < 0, np.nan, values[solution])
    for name in ("position_x_m", "position_y_m", "position_z_m", "roll_deg", "pitch_deg", "yaw_deg"):
        found[f"true_{name}"] = rng.normal(size=SAMPLES)
    return found


@pytest.fixture(scope="module")
def bag(tmp_path_factory) -> tuple[Path, dict[str, np.ndarray]]:
    path, written = tmp_path_factory.mktemp("bag") / "turn.mcap", columns(np.random.default_rng(3))
    write_bag(path, written)
    return path, written


# ---- the project's own ----


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> tuple[Path, dict[str, np.ndarray]]:
    """The same log as a folder of rosbag2."""
    path, written = tmp_path_factory.mktemp("bag") / "turn.rosbag2", columns(np.random.default_rng(3))
    write_bag(path, written)
    return path, written


@pytest.mark.parametrize("form", ["bag", "folder"])
def test_a_log_comes_back_to_the_last_digit(form, request):
    path, written = request.getfixturevalue(form)
    found = columns_of(path)
    assert set(found) == set(written)
    np.testing.assert_allclose(found.pop("time_s"), written["time_s"], rtol=0.0, atol=1e-12)
    for name, values in found.items():
        np.testing.assert_array_equal(values, written[name], err_msg=name)


def test_another_reader_finds_the_same(bag):
    """The reader of the MCAP project, with the definitions in the file alone."""
    reader = pytest.importorskip("mcap_ros2.reader")
    path, written = bag
    shown: dict[str, list] = {}
    for one in reader.read_ros2_messages(str(path)):
        shown.setdefault(one.channel.topic, []).append((one.log_time_ns, one.ros_msg))
    solutions = np.ceil((SAMPLES - 13) / 10)
    assert all(len(messages) == (solutions if topic == "/gps/fix" else SAMPLES) for topic, messages in shown.items())
    tick, fix = shown["/gps/fix"][0]
    assert tick == 130_000_000 and fix.latitude == written["gps_latitude_deg"][13]
    assert fix.status.status == written["gps_status"][13]
    for _, message in shown["/imu"][:2]:
        assert message.orientation_covariance[0] == -1.0
    np.testing.assert_array_equal(
        [message.linear_acceleration.z for _, message in shown["/imu"]], written["imu_force_z_m_per_s2"]
    )
    at = [tick for tick, _ in shown["/joint_states"]]
    np.testing.assert_array_equal(at, np.rint(1e9 * written["time_s"]))
    angles = [message.position[0] for _, message in shown["/joint_states"]]
    np.testing.assert_array_equal(angles, written["joint_angle_rad"])
    assert shown["/wheel_states"][0][1].name == [f"wheel_{w}" for w in ("fl", "fr", "rl", "rr")]
    np.testing.assert_array_equal(
        [message.pressure_b_bar for _, message in shown["/pressures"]], written["pressure_b_bar"]
    )
    moved = shown["/tf"][7][1].transforms[0]
    q = moved.transform.rotation
    angles = [written[f"true_{name}_deg"][7] for name in ("yaw", "pitch", "roll")]
    turned = Rotation.from_euler("ZYX", angles, degrees=True)
    np.testing.assert_allclose(Rotation.from_quat([q.x, q.y, q.z, q.w]).as_matrix(), turned.as_matrix(), atol=1e-12)
    assert (moved.header.frame_id, moved.child_frame_id) == ("world", "front_frame")


def test_a_folder_is_what_rosbag2_asks_for(folder):
    """By its tables and its metadata, without the package that wrote them; messages by the MCAP project's decoder."""
    yaml, decoder = pytest.importorskip("ruamel.yaml"), pytest.importorskip("mcap_ros2._dynamic")
    path, written = folder
    assert sorted(file.name for file in path.iterdir()) == ["metadata.yaml", "turn.db3"]
    assert [file.name for file in path.parent.iterdir()] == ["turn.rosbag2"]
    about = yaml.YAML(typ="safe").load(path / "metadata.yaml")["rosbag2_bagfile_information"]
    assert about["version"] == 8 and about["storage_identifier"] == "sqlite3"
    assert about["relative_file_paths"] == ["turn.db3"]
    assert all(
        isinstance(one["topic_metadata"]["offered_qos_profiles"], str) for one in about["topics_with_message_count"]
    )
    assert about["duration"]["nanoseconds"] == round(1e9 * (written["time_s"][-1] - written["time_s"][0]))
    with sqlite3.connect(path / "turn.db3") as tables:
        counts = dict(
            tables.execute("SELECT name, count(*) FROM topics JOIN messages ON topics.id = topic_id GROUP BY name")
        )
        definitions = dict(tables.execute("SELECT topic_type, encoded_message_definition FROM message_definitions"))
        rows = tables.execute(
            "SELECT type, timestamp, data FROM topics JOIN messages ON topics.id = topic_id WHERE name = '/pressures'"
        ).fetchall()
    tables.close()
    assert counts == {one["topic_metadata"]["name"]: one["message_count"] for one in about["topics_with_message_count"]}
    assert about["message_count"] == sum(counts.values())
    kind = rows[0][0]
    decode = decoder.generate_dynamic(kind, definitions[kind])[kind]
    np.testing.assert_array_equal([tick for _, tick, _ in rows], np.rint(1e9 * written["time_s"]))
    found = [decode(data).pressure_b_bar for _, _, data in rows]
    np.testing.assert_array_equal(found, written["pressure_b_bar"])


def test_a_folder_takes_the_place_of_a_bag_only(tmp_path):
    path = tmp_path / "turn.rosbag2"
    for seed in (1, 2):
        written = columns(np.random.default_rng(seed))
        write_log(path, written)
        np.testing.assert_array_equal(columns_of(path)["pressure_a_bar"], written["pressure_a_bar"])
    assert [file.name for file in tmp_path.iterdir()] == ["turn.rosbag2"]
    with pytest.raises(ValueError, match="no column time_s"):
        write_log(path, {"joint_angle_rad": np.zeros(3)})
    np.testing.assert_array_equal(columns_of(path)["pressure_a_bar"], written["pressure_a_bar"])
    (tmp_path / "mine.rosbag2").mkdir()
    (tmp_path / "mine.rosbag2/diary.txt").write_text("mine")
    with pytest.raises(ValueError, match=r"mine\.rosbag2 exists and is no folder of rosbag2; remove it"):
        write_log(tmp_path / "mine.rosbag2", written)
    assert (tmp_path / "mine.rosbag2/diary.txt").read_text() == "mine"


def test_a_day_in_a_folder_may_be_of_bags(tmp_path):
    written = columns(np.random.default_rng(6))
    for name in ("left.rosbag2", "right.mcap", "other.csv"):
        write_log(tmp_path / name, written)
    assert [path.name for path in log_files([tmp_path])] == ["left.rosbag2", "other.csv", "right.mcap"]
    assert log_files([tmp_path / "left.rosbag2"]) == [tmp_path / "left.rosbag2"]
    (tmp_path / "empty").mkdir()
    with pytest.raises(ValueError, match=r"holds no log: none that ends in \.csv, \.parquet, \.mcap, \.rosbag2"):
        log_files([tmp_path / "empty"])


def test_every_column_has_a_place_of_its_own():
    names = list(columns(np.random.default_rng(0)))[1:]
    places = [own_place(name) for name in names]
    assert len(set(places)) == len(names)
    assert [own_column(*place) for place in places] == names


@pytest.mark.parametrize(
    ("name", "wrong"),
    [("imu_force_z_m_per_s2", None), ("gps_altitude_m", None), ("gps_status", 1.5), ("gps_status", 200.0)],
)
def test_what_no_message_of_ros_holds_comes_back_as_well(tmp_path, name, wrong):
    """A sensor of two axes, a receiver without height, a status that is no whole number of eight bits."""
    written = columns(np.random.default_rng(5))
    if wrong is None:
        del written[name]
    else:
        written[name] = np.where(np.arange(SAMPLES) == 200, wrong, written[name])
    write_bag(tmp_path / "turn.mcap", written)
    found = columns_of(tmp_path / "turn.mcap")
    assert set(found) == set(written)
    for column, values in written.items():
        np.testing.assert_allclose(found[column], values, rtol=0.0, atol=1e-12 if column == "time_s" else 0.0)


@pytest.mark.parametrize("form", ["bag", "folder"])
def test_a_bag_is_read_as_a_log(form, request, tmp_path):
    path, written = request.getfixturevalue(form)
    write_log(tmp_path / "turn.parquet", written)
    one, other = read_log(path), read_log(tmp_path / "turn.parquet")
    assert one.name == other.name and one.rest == other.rest
    for name, values in other.channels.items():
        np.testing.assert_allclose(one.channels[name], values, rtol=1e-12, atol=1e-12)
    np.testing.assert_array_equal(one.commands["steering_signal"], other.commands["steering_signal"])


def test_logs_are_converted(tmp_path):
    rng = np.random.default_rng(4)
    write_log(tmp_path / "turn.parquet", columns(rng), {"oil_temperature_C": 41.5})
    for source, into in (("turn.parquet", "one.mcap"), ("one.mcap", "two.rosbag2"), ("two.rosbag2", "again.parquet")):
        result = CliRunner().invoke(app, ["log", "convert", str(tmp_path / source), str(tmp_path / into)])
        assert result.exit_code == 0, result.output
    one, other = (read_table(tmp_path / name) for name in ("turn.parquet", "again.parquet"))
    assert set(one.names) == set(other.names)
    for name in one.names[1:]:
        np.testing.assert_array_equal(one.numbers_or_blank(name), other.numbers_or_blank(name), err_msg=name)
    assert read_log(tmp_path / "again.parquet").manifest.oil_temperature_C == 41.5


# ---- other people's ----


def foreign(path: Path, *, ros: int = 2, begin: int = 1_700_000_000) -> np.ndarray:
    """A bag of another machine: angle to the right positive at 50 Hz, pressure in Pa at 100 Hz, commands when they change.
    Returns the pressure."""
    store = STORE if ros == 2 else get_typestore(Stores.ROS1_NOETIC)
    types = store.types
    more = {} if ros == 2 else {"seq": 0}
    if ros == 2:
        writer = Writer(path, version=9, storage_plugin=StoragePlugin.SQLITE3)
        pack = store.serialize_cdr
    else:
        writer, pack = Writer1(path), store.serialize_ros1
    pressure = 2e6 + 1e5 * np.sin(0.05 * np.arange(400))

    def header(tick: int):
        stamp = types["builtin_interfaces/msg/Time"](sec=begin + tick // 10**9, nanosec=tick % 10**9)
        return types["std_msgs/msg/Header"](stamp=stamp, frame_id="", **more)

    with writer:
        joints, oil, told = (
            writer.add_connection(topic, kind, typestore=store)
            for topic, kind in (
                ("/machine/joints", "sensor_msgs/msg/JointState"),
                ("/port_a/pressure", "sensor_msgs/msg/FluidPressure"),
                ("/steering_cmd", "std_msgs/msg/Float64"),
            )
        )
        for k in range(400):
            tick = 10_000_000 * k
            if k % 2 == 0:
                angle = np.array([0.1, 0.6 - 0.003 * max(k - 60, 0)])
                message = types["sensor_msgs/msg/JointState"](
                    header(tick), ["arm", "articulation"], angle, np.empty(0), np.empty(0)
                )
                writer.write(joints, begin * 10**9 + tick, pack(message, "sensor_msgs/msg/JointState"))
            message = types["sensor_msgs/msg/FluidPressure"](header(tick), pressure[k], 0.0)
            writer.write(oil, begin * 10**9 + tick, pack(message, "sensor_msgs/msg/FluidPressure"))
            if k in (0, 60):
                value = types["std_msgs/msg/Float64"](0.0 if k == 0 else 0.7)
                writer.write(told, begin * 10**9 + tick, pack(value, "std_msgs/msg/Float64"))
    return pressure


@pytest.mark.parametrize("ros", [1, 2])
def test_another_machines_bag_is_read_through_a_mapping(tmp_path, ros):
    path = tmp_path / ("drive" if ros == 2 else "drive.bag")
    pressure = foreign(path, ros=ros)
    assert is_bag(path)
    with pytest.raises(ValueError, match=r"not of this project .* aoro-gym log map"):
        read_log(path)
    found, left = proposed(path, NAMES)
    assert {one.column: (one.topic, one.field, one.unit) for one in found} == {
        "joint_angle": ("/machine/joints", "position[articulation]", "rad"),
        "pressure_a": ("/port_a/pressure", "fluid_pressure", "Pa"),
        "steering_signal": ("/steering_cmd", "data", ""),
    }
    assert "/machine/joints position[arm]" in left
    assert CliRunner().invoke(app, ["log", "map", str(path)]).exit_code == 0
    beside = mapping_file(path)
    text = beside.read_text(encoding="utf-8")
    assert read_mapping(beside).columns == tuple(found)
    beside.write_text(text.replace('unit = "rad"\nsign = 1', 'unit = "rad"\nsign = -1'), encoding="utf-8")
    log = read_log(path)
    assert log.start_angle == pytest.approx(-0.6)
    assert np.flatnonzero(log.commands["steering_signal"])[0] == 60
    np.testing.assert_allclose(log.channels["pressure_a"][: 2 * 199 : 2], pressure[:398:2], rtol=1e-12)
    again = CliRunner().invoke(app, ["log", "map", str(path)])
    assert again.exit_code == 2 and "remove it" in again.output


def test_the_simulators_own_state_is_never_proposed(bag):
    found, left = proposed(bag[0], NAMES | {"joint_flow": ["joint_flow"]})
    assert {one.column for one in found} == {"joint_angle", "pressure_a", "steering_signal"}
    assert "/true_state true_joint_flow_l_per_min" in left


def test_an_unknown_unit_must_be_filled_in(tmp_path):
    path = tmp_path / "turn.map.toml"
    path.write_text('[columns.pressure_a]\ntopic = "/a"\nfield = "data"\nunit = "?"\n')
    with pytest.raises(ValueError, match=r"columns.pressure_a.unit is '\?'"):
        read_mapping(path)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "maps no column"),
        ('clock = "gps"\n[columns.a]\ntopic = "/a"\nfield = "b"\n', "clock is 'gps'"),
        ('[columns.a]\ntopic = "/a"\n', "columns.a.field is missing"),
        ('[columns.a]\ntopic = "/a"\nfield = "b"\nsign = 2\n', "columns.a.sign is '2'"),
        ('[columns.a]\ntopic = "/a"\nfield = "b"\nsing = 1\n', "unknown key 'sing'"),
    ],
)
def test_a_broken_mapping_names_its_fault(tmp_path, text, said):
    path = tmp_path / "turn.map.toml"
    path.write_text(text)
    with pytest.raises(ValueError, match=said):
        read_mapping(path)


def test_missing_topics_and_fields_are_named(bag, tmp_path):
    path = tmp_path / "turn.mcap"
    path.write_bytes(bag[0].read_bytes())
    for topic, field, said in (
        ("/oil", "data", "has no topic /oil, only"),
        ("/pressures", "pressure_c_bar", "there is no field 'pressure_c_bar', only"),
        ("/joint_states", "position[waist]", "the message names articulation"),
        ("/joint_states", "name", "is no number"),
    ):
        mapping_file(path).write_text(f'[columns.x]\ntopic = "{topic}"\nfield = "{field}"\n')
        with pytest.raises(ValueError, match=said):
            columns_of(path)


@pytest.mark.parametrize("kept", [0, 100, 0.5, 0.98])
def test_a_broken_bag_is_refused_or_read(bag, tmp_path, kept):
    """A file that ends early: an error of one line, or, where its index is all that is missing, what it holds."""
    content = bag[0].read_bytes()
    path = tmp_path / "turn.mcap"
    path.write_bytes(content[: kept if kept > 1 else int(kept * len(content))])
    with pytest.raises(ValueError, match=r"turn\.mcap"):
        columns_of(path)


def test_wrong_bytes_are_an_error_of_one_line_or_go_unnoticed(bag, tmp_path):
    rng, content = np.random.default_rng(8), bag[0].read_bytes()
    path, refused = tmp_path / "turn.mcap", 0
    for _ in range(15):
        damaged = np.frombuffer(content, dtype=np.uint8).copy()
        damaged[rng.integers(len(damaged), size=10)] = rng.integers(256, size=10)
        path.write_bytes(damaged.tobytes())
        try:
            columns_of(path)
        except ValueError as error:
            refused += 1
            assert not isinstance(error, UnicodeDecodeError)
            assert str(path) in str(error) and "\n" not in str(error)
    assert refused >= 8


def test_fields_are_found_by_paths():
    types = STORE.types
    vector = types["geometry_msgs/msg/Vector3"](1.0, 2.0, 3.0)
    twist = types["geometry_msgs/msg/Twist"](linear=vector, angular=vector)
    assert numbers_of(twist) == [f"{part}.{axis}" for part in ("linear", "angular") for axis in "xyz"]
    assert number_in(twist, "angular.z") == 3.0
    with pytest.raises(ValueError, match=r"write a\.b"):
        number_in(twist, "angular..z")


def test_commands_hold_and_signals_are_straight_lines():
    assert Mapped("steering_signal", "", "").is_held and Mapped("drive_signal", "", "").is_held
    assert not Mapped("joint_angle", "", "").is_held


def test_topics_are_listed(bag):
    found = topics_of(bag[0])
    assert found["/pressures"] == ("aoro_msgs/msg/Pressures", ["pressure_a_bar", "pressure_b_bar", "pump_pressure_bar"])
    assert found["/tf"][1] == []
