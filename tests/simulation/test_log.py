"""Logs: names, units and sampling of the columns, and reading back what was written."""

import math
import re
import tomllib
from pathlib import Path

import numpy as np
import pytest

from aoro_gym.machine import Machine
from aoro_gym.recording.logs import signal_from_voltage
from aoro_gym.recording.tables import read_table
from aoro_gym.simulation import log
from aoro_gym.simulation.manoeuvres import from_file, run
from aoro_gym.twin import Twin
from aoro_gym.twin.records import COMMAND_BOUNDS, CRANE_OUTPUT_UNITS, OUTPUT_UNITS

SI_OF_FIELD_UNIT = {
    "bar": "Pa",
    "L_per_min": "m^3/s",
    "rpm": "rad/s",
    "N_m": "N m",
    "rad_per_s": "rad/s",
    "deg_per_s": "rad/s",
    "deg": "rad",
    "m": "m",
    "m_per_s": "m/s",
    "kN": "N",
    "": "1",
}


@pytest.mark.parametrize(("channel", "unit"), (OUTPUT_UNITS | CRANE_OUTPUT_UNITS).items())
def test_every_output_has_a_field_unit_of_its_kind(channel, unit):
    assert SI_OF_FIELD_UNIT[log.field_unit(channel)[0]] == unit


def test_steering_voltage():
    np.testing.assert_allclose(log.voltage_from_signal([1.0, 0.0, -1.0]), [0.5, 2.5, 4.5])
    np.testing.assert_allclose(signal_from_voltage(np.array([0.5, 2.5, 4.5])), [1.0, 0.0, -1.0])


def test_columns_are_sampled_at_100_hz_in_field_units():
    time = np.arange(1, 1001) * 1e-3
    channels = {
        "steering_signal": np.where(time > 0.5, 1.0, 0.0),
        "joint_angle": time,
        "joint_flow": np.full(1000, 1e-3),
        "pressure_a": np.full(1000, 2e5),
        "engine_speed": np.full(1000, 10.0 * math.pi),
        "wheel_rate_fl": -time,
        "spool": time,
    }
    columns = log.log_columns(time, channels)
    np.testing.assert_allclose(columns["time_s"], np.arange(1, 101) / 100)
    np.testing.assert_allclose(columns["joint_angle_rad"], columns["time_s"])
    # the signal steps at 0.5 s: the row of that time has the new one, which holds from there on
    np.testing.assert_allclose(columns["steering_signal_V"], np.where(columns["time_s"] > 0.495, 0.5, 2.5))
    np.testing.assert_allclose(columns["pressure_a_bar"], 2.0)
    np.testing.assert_allclose(columns["engine_speed_rpm"], 300.0)
    np.testing.assert_allclose(columns["wheel_speed_fl_rad_per_s"], -columns["time_s"])
    np.testing.assert_allclose(columns["true_joint_flow_L_per_min"], 60.0)
    np.testing.assert_allclose(columns["true_spool"], columns["time_s"])
    measured = [name for name in columns if not name.startswith("true_")]
    assert list(columns)[: len(measured)] == measured
    assert not any(name.startswith("true_steering_signal") for name in columns)


def test_sensors_measure_joint_angle_and_pressures_only():
    time = np.arange(1, 20001) * 1e-3
    still = {"joint_angle": 0.3, "pressure_a": 100e5, "engine_speed": 160.0, "wheel_rate_fl": 1.0}
    channels = {name: np.full(20000, value) for name, value in still.items()}
    exact = log.log_columns(time, channels)
    first, again, other = (log.log_columns(time, channels, rng=np.random.default_rng(seed)) for seed in (1, 1, 2))
    for name, values in first.items():
        np.testing.assert_array_equal(values, again[name])
        if name in ("joint_angle_rad", "pressure_a_bar"):
            assert np.any(values != other[name])
        else:
            np.testing.assert_array_equal(values, exact[name])
    # published kind of noise: 4 lines of 0.0565 degrees, others less, 12 bits a turn; the pressure's zero error is 1 bar rms
    noise = np.degrees(first["joint_angle_rad"] - 0.3)
    assert 0.05 < np.std(noise) < 0.25
    assert 0.1 < np.std(first["pressure_a_bar"]) < 0.4
    assert abs(np.mean(first["pressure_a_bar"]) - 100.0) < 4.0


def test_noise_of_a_column_does_not_depend_on_the_others():
    time = np.arange(1, 1001) * 1e-3
    pressure = {"pressure_b": np.full(1000, 5e5)}
    alone = log.log_columns(time, pressure, rng=np.random.default_rng(3))
    both = log.log_columns(time, {"joint_angle": np.zeros(1000), **pressure}, rng=np.random.default_rng(3))
    np.testing.assert_array_equal(alone["pressure_b_bar"], both["pressure_b_bar"])


def test_a_sample_is_the_last_state_at_or_before_its_time():
    time = np.array([0.004, 0.012, 0.02])
    columns = log.log_columns(time, {"spool": np.array([1.0, 2.0, 3.0])})
    np.testing.assert_allclose(columns["time_s"], [0.01, 0.02])
    np.testing.assert_allclose(columns["true_spool"], [1.0, 3.0])


def test_every_command_of_a_manoeuvre_is_logged_and_drives_the_same_again(tmp_path):
    """A log driven again commands at every instant from its first row on what the manoeuvre did."""
    commands = tmp_path / "commands.csv"
    commands.write_text("time_s,drive_signal,arm_fl,gear,traction_rr\n0,0,0,2,1\n0.1,0.5,-0.3,2,0\n0.3,0.2,0,2,1\n")
    twin = Twin(1, machine=Machine.load("aoro"))
    plan = from_file(commands, duration=0.4)
    path = tmp_path / "drive.csv"
    recording = run(twin, plan)
    log.write_log(path, log.log_columns(recording.time, recording.channels))
    again = from_file(path)
    for time in (0.015, 0.095, 0.105, 0.295, 0.305, 0.385):
        assert _held(again, time) == pytest.approx(_held(plan, time) | {"steering_signal": 0.0}), time


def _held(plan, time):
    """Commands of a manoeuvre at a time [s], the ones at rest where it names none."""
    begin, held = 0.0, {name: COMMAND_BOUNDS[name][2] for name in ("drive_signal", "arm_fl", "gear", "traction_rr")}
    for segment in plan.segments:
        if begin <= time:
            held |= segment.commands
        begin += segment.steps * plan.main_step
    return held


def test_too_short_for_a_sample():
    with pytest.raises(ValueError, match="hold no sample at 100 Hz"):
        log.log_columns(np.array([0.001, 0.002]), {"spool": np.zeros(2)})


@pytest.mark.parametrize("suffix", [".csv", ".parquet"])
def test_reads_back_what_it_wrote(tmp_path, suffix):
    columns = {"time_s": np.array([0.01, 0.02]), "joint_angle_deg": np.array([-12.3456789, 1e-7])}
    manifest = {
        "manoeuvre": 'a "name"',
        "filters": [],
        "on": True,
        "ground": {"slope_deg": 1.5},
        "machine": {"set": ["a=1"]},
    }
    path = tmp_path / "new" / f"turn{suffix}"
    written = log.write_log(path, columns, manifest)
    assert [item.name for item in written] == [path.name, "turn.toml"]
    table = read_table(path)
    assert list(table.names) == list(columns)
    for name, values in columns.items():
        np.testing.assert_allclose(table[name], values, rtol=1e-8)
    assert tomllib.loads(written[1].read_text()) == manifest


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("log.txt", "must end in .csv, .parquet, .mcap or .rosbag2"),
        ("folder.csv", "is a folder"),
        ("file/log.csv", "is a file, not a folder"),
    ],
)
def test_refuses_to_write(tmp_path, name, message):
    (tmp_path / "folder.csv").mkdir()
    (tmp_path / "file").touch()
    with pytest.raises(ValueError, match=re.escape(message)):
        log.check_log_path(tmp_path / name)


def test_a_relative_path_in_a_new_folder_can_be_written(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    log.check_log_path(Path("a/b/log.csv"))
