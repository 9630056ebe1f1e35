"""The command ``simulate``."""

import json
import tomllib
from pathlib import Path

import numpy as np
import pytest

from aoro_gym.machine import Machine
from aoro_gym.recording.tables import read_table
from aoro_gym.terrains.generate.world import world
from aoro_gym.terrains.terrain import Terrain
from aoro_gym.terrains.world.files import save_world
from aoro_gym.terrains.world.objects import Log, Tree, along, upright
from aoro_gym.terrains.world.world import World
from aoro_gym.twin import Twin
from tests.cli.calling import call, check_refused


def test_simulate_writes_log_manifest_figures_and_plots(turn):
    path, shown = turn
    assert shown.exit_code == 0
    for suffix in (".csv", ".toml", ".json", ".png", ".html"):
        assert path.with_suffix(suffix).stat().st_size > 0
        assert f"wrote {path.with_suffix(suffix)}" in shown.stdout
    table = read_table(path)
    np.testing.assert_allclose(table["time_s"], np.arange(1, 161) / 100)
    noise = table["joint_angle_rad"] - np.radians(table["true_joint_angle_deg"])
    assert 0.0 < np.abs(noise).max() < np.radians(1.0)
    assert np.any(table["pressure_a_bar"] != table["true_pressure_a_bar"])
    np.testing.assert_array_equal(table["engine_speed_rpm"], table["true_engine_speed_rpm"])
    assert np.all(table["steering_signal_V"][table["time_s"] > 0.605] == 0.5)
    manifest = tomllib.loads(path.with_suffix(".toml").read_text())
    assert manifest["machine"]["scale"] == ["steering.valve.spool_time_constant=2"]
    assert manifest["sensors"].startswith("joint angle: published kind of noise")
    assert manifest["simulation"]["seed"] == 0
    figures = json.loads(path.with_suffix(".json").read_text())["figures"]
    assert figures["turn_time_s"] is None
    assert figures["highest_pressure_a_bar"] > 50


def test_simulate_says_that_the_turn_was_cut(turn):
    assert "did not reach its stop" in turn[1].stdout


def test_simulate_is_repeatable(turn, tmp_path):
    slow = "steering.valve.spool_time_constant=2"
    again = tmp_path / "again.csv"
    call("simulate", "--manoeuvre", "left", "--duration", "1.6", "--scale", slow, "--out", again)
    assert again.read_bytes() == turn[0].read_bytes()


@pytest.mark.slow
def test_simulate_takes_laws(tmp_path):
    (tmp_path / "turn.csv").write_text("time_s,steering_signal\n0,0\n0.1,1\n0.4,0\n")

    def angle(*laws):
        out = tmp_path / f"log{'_'.join(laws)}.csv"
        shown = call("simulate", "-m", tmp_path / "turn.csv", *laws, "--ideal-sensors", "--out", out)
        assert shown.exit_code == 0, shown.output
        manifest = tomllib.loads(out.with_suffix(".toml").read_text())
        return read_table(out)["true_joint_angle_deg"], manifest["machine"].get("laws")

    by_file, none = angle()
    default, named = angle("--laws", "default")
    library, also = angle("--laws", "library")
    assert (none, named, also) == (None, "default", "library")
    np.testing.assert_array_equal(by_file, default)
    machine = Machine.load("aoro").with_laws("library")
    twin = Twin(machine=machine)
    twin.step({"steering_signal": 0.0}, duration=0.1)
    trace = twin.step({"steering_signal": 1.0}, duration=0.3, sample_every=0.01)
    assert trace is not None
    at = round(0.4 / 0.01) - 1
    assert library[at] == pytest.approx(np.degrees(trace["joint_angle"][-1, 0]), abs=1e-6)
    assert abs(library[at] - default[at]) > 1e-3


def test_simulate_a_file_on_a_slope(tmp_path):
    commands = tmp_path / "commands.csv"
    commands.write_text("time_s,drive_signal,steering_signal\n0,0,0\n0.2,0.4,-0.5\n0.6,0,0\n")
    out = tmp_path / "log.parquet"
    options = [
        "--ideal-sensors",
        "--start-angle",
        "10",
        "--terrain-slope",
        "6",
        "--terrain-direction",
        "90",
        "--terrain-friction",
        "0.8",
    ]
    shown = call("simulate", "-m", commands, "--out", out, *options)
    assert shown.exit_code == 0, shown.output
    table = read_table(out)
    angle = np.degrees(table["joint_angle_rad"])
    np.testing.assert_allclose(angle, table["true_joint_angle_deg"], rtol=1e-12)
    assert angle[0] == pytest.approx(10.0, abs=0.1)
    assert angle[-1] < 10.0
    assert tomllib.loads(out.with_suffix(".toml").read_text())["sensors"] == "ideal"
    assert tomllib.loads(out.with_suffix(".toml").read_text())["ground"]["slope_deg"] == 6.0


@pytest.fixture(scope="module")
def clearing(tmp_path_factory) -> Path:
    """The folder of a small flat world with a pine 6 m ahead of its middle and a log behind it."""
    field = Terrain.from_heights(np.zeros((31, 31)), cell=1.0, corner=(-15.0, -15.0))
    pine = Tree((6.0, 0.0, 0.0), upright(), "pine", 0.3, 15.0, 8.0, 1.5, 1)
    log = Log((-6.0, -2.0, 0.15), along((0.0, 1.0, 0.0)), "pine", 4.0, 0.15, 0.15, 0.3, 0)
    folder = tmp_path_factory.mktemp("clearing")
    save_world(World(field, (pine, log)), folder)
    return folder


def test_simulate_in_a_world_logs_and_tells_what_it_touches(clearing, tmp_path):
    out = tmp_path / "log.csv"
    options = ("--start", "2", "0", "0", "--signal", "50", "--duration", "5", "--terrain-friction", "0.9")
    shown = call("simulate", "-m", "drive", "--world", clearing, *options, "--out", out)
    assert shown.exit_code == 0, shown.output
    assert "front chassis" in shown.stdout and "tree 1" in shown.stdout
    table = read_table(out)
    touching = table["true_touched_object_front"] == 1
    assert touching[-50:].all() and not touching[:150].any()
    assert table["true_object_force_x_front_kN"][-1] < -20.0
    manifest = tomllib.loads(out.with_suffix(".toml").read_text())
    assert "ground" not in manifest
    assert manifest["world"] | {"name": ""} == {"name": "", "objects": 2, "x_m": 2.0, "y_m": 0.0, "heading_deg": 0.0}
    contacts = json.loads(out.with_suffix(".json").read_text())["contacts"]
    assert [(row["part"], row["object"], row["kind"]) for row in contacts] == [("front chassis", 1, "tree")]
    assert contacts[0]["largest_force_kN"] > 20.0 and contacts[0]["duration_s"] > 0.5


def test_the_example_of_the_page_on_worlds_is_stopped_by_a_tree(tmp_path):
    save_world(world(3), tmp_path / "forest")
    out = tmp_path / "stopped.csv"
    options = ("--start", "-10", "14", "223", "--signal", "50", "--duration", "20", "--out", out)
    assert call("simulate", "-m", "drive", "--world", tmp_path / "forest", *options).exit_code == 0
    contacts = {
        (row["part"], row["object"]): row for row in json.loads(out.with_suffix(".json").read_text())["contacts"]
    }
    over, against = contacts["front right wheel", 741], contacts["front chassis", 256]
    assert (over["kind"], against["kind"]) == ("stump", "tree")
    # as the page says; a contact takes what a compiler rounds otherwise some per cent up or down (E)
    assert over["largest_force_kN"] == pytest.approx(16.6, abs=3.0)
    assert against["largest_force_kN"] == pytest.approx(82.1, abs=5.0)


def test_simulate_in_a_world_starts_where_it_is_free(clearing, tmp_path):
    out = tmp_path / "log.csv"
    assert call("simulate", "-m", "drive", "--world", clearing, "--duration", "1", "--out", out).exit_code == 0
    world = tomllib.loads(out.with_suffix(".toml").read_text())["world"]
    assert np.hypot(world["x_m"], world["y_m"]) < 4.0
    assert json.loads(out.with_suffix(".json").read_text())["contacts"] == []


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ("--terrain-slope 3", "--terrain-slope 3 is that of a plane, but --world"),
        ("--start 90 0 0", "--start x is 90 m, but must be in [-15, 15] m, on the ground"),
        ("--start 5 0 0", "twin 0 would stand in an object: the front chassis"),
    ],
)
def test_simulate_in_a_world_refuses(clearing, options, message, tmp_path):
    check_refused(f"simulate -m drive --world {clearing} {options} --out {tmp_path / 'log.csv'}", message)


def test_simulate_on_soil_logs_and_draws_the_ruts(tmp_path):
    out = tmp_path / "mire.csv"
    shown = call("simulate", "-m", "drive", "--soil", "peat", "--duration", "2", "--out", out)
    assert shown.exit_code == 0 and "Ruts" in shown.stdout
    table = read_table(out)
    assert 0.1 < table["true_sinkage_fl_m"].max() < 0.3
    assert table["true_rut_depth_fl_m"][-1] < table["true_sinkage_fl_m"][-1]
    assert table["true_soil_resistance_fl_kN"][-1] > 0.5
    ruts = json.loads(out.with_suffix(".json").read_text())["ruts"]
    assert 0.1 < ruts["rut_depth_mean_m"] < ruts["rut_depth_max_m"] < 0.3
    assert ruts["rut_volume_m3"] == pytest.approx(ruts["rut_depth_mean_m"] * ruts["rut_area_m2"], rel=0.02)
    assert tomllib.loads(out.with_suffix(".toml").read_text())["soil"]["name"] == "peat"
    assert (tmp_path / "mire_ruts.png").stat().st_size > 10_000


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ("--soil mud", "--soil is 'mud'; choose one of: peat"),
        ("--soil clay:0.5", "--soil moisture is 0.5, but must be in [0.25, 0.4] for clay"),
        ("--soil peat:0.5", "--soil moisture is 0.5, but peat was measured at one only"),
        ("--soil clay:wet", "its moisture 'wet' must be a number, as in clay:0.3"),
        ("--soil peat --world forest", "--soil peat is without solid objects, but --world forest has some"),
        ("--soil peat --device cpu:simd", "--device cpu:simd cannot run twins on --soil peat; take cpu"),
    ],
)
def test_simulate_on_soil_refuses(options, message, tmp_path):
    check_refused(f"simulate -m drive {options} --out {tmp_path / 'log.csv'}", message)


def test_seed_draws_the_noise(turn, tmp_path):
    slow = "steering.valve.spool_time_constant=2"
    other = tmp_path / "other.csv"
    call("simulate", "-m", "left", "--duration", "1.6", "--scale", slow, "--seed", "1", "--out", other)
    first, second = read_table(turn[0]), read_table(other)
    assert np.any(first["joint_angle_rad"] != second["joint_angle_rad"])
    np.testing.assert_array_equal(first["true_joint_angle_deg"], second["true_joint_angle_deg"])


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ("simulate -m up", "--manoeuvre is 'up'; choose one of: left, right, drive, crane"),
        ("simulate -m none.csv", "file none.csv does not exist"),
        ("simulate -m bad.csv", "bad.csv, line 3: steering_signal is 2, but must be in [-1, 1]"),
        ("simulate -m good.csv --out good.csv", "would overwrite the commands in good.csv"),
        ("simulate -m good.csv --out good.parquet", "would overwrite the commands in good.csv"),
        ("simulate -m good.csv --signal 50", "--signal is 50 %, but serves left, right, drive, crane"),
        (
            "simulate -m good.csv --machine aoro_datasheet --start-angle 41",
            "--start-angle is 41 deg, but must be in [-40, 40] deg",
        ),
        ("simulate -m good.csv --start-angle nan", "--start-angle is nan deg, but"),
        ("simulate -m left --start-angle 5", "--start-angle serves a command file only"),
        ("simulate -m left --signal nan", "--signal is nan %, but must be in (0, 100] %"),
        (
            "simulate -m left --signal 0.75",
            "--signal is 0.75 %, which would move nothing; did you mean 75?",
        ),
        ("simulate -m drive --signal 0.5", "did you mean 50?"),
        ("simulate -m right --signal -50", "--signal is -50 %, but must be in (0, 100] %"),
        ("simulate -m left --duration 0.2", "--duration is 0.2 s, but must be in [0.61, 3600] s"),
        ("simulate -m left --out log.xlsx", "log log.xlsx must end in .csv, .parquet, .mcap or .rosbag2"),
        ("simulate -m left --device tpu", "--device 'tpu' is not available here; choose one of: cpu"),
        ("simulate -m left --device cpu,cpu", "--device 'cpu,cpu' is several devices, of which one is wanted here"),
        ("evaluate --device cpu,tpu", "--device 'tpu' is not available here; choose one of: cpu"),
        (
            "dataset --device cpu,cpu --processes 1",
            "processes is 1, but must be an integer of at least 2, one for each device",
        ),
        ("simulate -m drive --world nowhere", "nowhere: No such file"),
        ("simulate -m drive --start 0 nan 0", "--start[1] is nan, but must be finite"),
        ("simulate -m left --seed -1", "--seed is -1, but must be an integer of at least 0"),
        ("simulate -m left --machine tractor", "no bundled machine 'tractor'"),
        ("simulate -m left --machine none.toml", "no machine file none.toml"),
        ("simulate -m left --machine bad.toml", "bad.toml"),
        ("simulate -m left --set joint.range", "--set 'joint.range' is not KEY=NUMBER"),
        ("simulate -m left --set joint.rang=1", "unknown parameter 'joint.rang': did you mean 'joint.range'?"),
        ("simulate -m left --set joint.range=wide", "--set joint.range=wide: 'wide' is not a finite number"),
        ("simulate -m left --set joint.range=1 --set joint.range=2", "--set names joint.range twice"),
        ("simulate -m left --set joint.range=1 --scale joint.range=2", "given to both --set and --scale"),
        ("simulate -m left --machine aoro_datasheet --scale wheel.mass=-1", "wheel.mass = -220 kg"),
        ("simulate -m left --terrain-slope 60", "--terrain-slope is 60 deg, but must be in [-45, 45] deg"),
        (
            "simulate -m left --terrain-rolling 60",
            "--terrain-rolling is 60 x asphalt, but must be in [0, 50] x asphalt",
        ),
    ],
)
def test_wrong_input_is_one_line_before_anything_runs(files, arguments, message):
    check_refused(arguments, message)
