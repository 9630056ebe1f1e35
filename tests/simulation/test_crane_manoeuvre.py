"""A manoeuvre with a crane: columns of its log, driven again, in a bag, read by what has no use for it; in a terminal."""

import json
import tomllib
from pathlib import Path

import numpy as np
import pytest

from aoro_gym.recording.bag_writing import own_column, own_place
from aoro_gym.recording.commands import CRANE_COMMAND_BOUNDS, JOINTS
from aoro_gym.recording.logs import read_log
from aoro_gym.recording.tables import read_table
from aoro_gym.simulation.manoeuvres import crane_work, from_file, holding
from aoro_gym.twin.records import CRANE_OUTPUT_UNITS
from tests.cli.calling import call

POSE = ("--crane-pose", "10", "35", "-100", "0.2")
COMMANDS = """time_s,steering_signal,crane_lift,crane_slew,crane_held_mass_kg,crane_held_transverse_kg_m2
0,0,0,0,0,0
0.3,0,0.6,0.3,0,0
1.0,0,0,0,180,240
5.0,0,0,0,180,240
"""


@pytest.fixture(scope="module")
def log(tmp_path_factory) -> Path:
    """The log of a crane that lifts and slews, and then holds a log."""
    folder = tmp_path_factory.mktemp("crane")
    (folder / "commands.csv").write_text(COMMANDS)
    out = folder / "log.csv"
    shown = call("simulate", "-m", folder / "commands.csv", *POSE, "--out", out)
    assert shown.exit_code == 0, shown.output
    assert "largest tip load" in shown.stdout
    return out


def test_a_log_has_what_the_crane_was_told_what_its_sensors_show_and_what_it_did(log):
    table = read_table(log)
    for joint in JOINTS:
        unit = "m" if joint == "telescope" else "rad"
        true = table[f"true_crane_joint_{joint}_{'m' if unit == 'm' else 'deg'}"] * (
            1.0 if unit == "m" else np.pi / 180.0
        )
        off = table[f"crane_joint_{joint}_{unit}"] - true
        assert 0.0 < np.abs(off).max() < (0.02 if unit == "m" else 0.005)
        for side in ("bore", "annulus"):
            name = f"crane_pressure_{side}_{joint}_bar"
            assert np.abs(table[name] - table[f"true_{name}"]).max() < 6.0
    rate = table["crane_rate_slew_rad_per_s"] - np.radians(table["true_crane_rate_slew_deg_per_s"])
    assert np.sqrt(np.mean(rate**2)) < 0.05
    held = table["crane_held_mass_kg"] > 0.0
    assert held.sum() == 401 and table["time_s"][held][0] == pytest.approx(1.0)
    load = table["crane_tip_load_kN"]
    # the machine still rocks: the mean of two seconds, five times that
    assert load[held][-200:].mean() - load[:20].mean() == pytest.approx(9.81 * 0.18, rel=0.1)
    begins = tomllib.loads(log.with_suffix(".toml").read_text())["crane"]
    assert begins["slew_deg"] == pytest.approx(10.0) and begins["telescope_m"] == pytest.approx(0.2)
    figures = json.loads(log.with_suffix(".json").read_text())["figures"]
    assert figures["crane_lift_travel_deg"] > 2.0
    assert {f"true_{name}" for name in CRANE_OUTPUT_UNITS} <= {
        name.rsplit("_deg", 1)[0].rsplit("_bar", 1)[0].rsplit("_L_per", 1)[0].rsplit("_kN", 1)[0].removesuffix("_m")
        .removesuffix("_m_per_s")
        for name in table.names
    }  # fmt: skip


def test_a_log_is_driven_again(log, tmp_path):
    """But for the first 10 ms, of which it has no row; joints within the rounding of its nine digits."""
    again = tmp_path / "again.csv"
    assert call("simulate", "-m", log, *POSE, "--ideal-sensors", "--out", again).exit_code == 0
    first, second = read_table(log), read_table(again)
    for name in ("true_crane_joint_lift_deg", "true_crane_joint_slew_deg", "true_roll_deg"):
        np.testing.assert_allclose(second[name], first[name], atol=2e-3)


def test_who_has_no_use_for_a_crane_says_so(log):
    limitations = " ".join(read_log(log, purpose="a calibration").limitations) if _steers(log) else ""
    assert "crane_lift commands the machine, too; a calibration does not replay it" in limitations
    assert "unknown columns" not in limitations


def _steers(path: Path) -> bool:
    """Makes the log one that is replayed: it steers at its end."""
    text = path.read_text().splitlines()
    names = text[0].split(",")
    place, volts = names.index("steering_signal"), names.index("steering_signal_V")
    for k in range(100, len(text)):
        row = text[k].split(",")
        row[place], row[volts] = "0.5", "1.5"
        text[k] = ",".join(row)
    path.write_text("\n".join(text) + "\n")
    return True


def test_columns_have_a_place_in_bags(log):
    table = read_table(log)
    for name in table.names:
        if name.startswith("crane_"):
            topic, field = own_place(name)
            assert own_column(topic, field) == name
            assert topic == ("/pressures" if "pressure" in name else "/commands" if _is_command(name) else "/crane")


def _is_command(name: str) -> bool:
    return any(name == command or name.startswith(f"{command}_k") for command in CRANE_COMMAND_BOUNDS)


def test_manoeuvres_of_a_crane(tmp_path):
    plan = crane_work(0.5)
    assert plan.moves_crane and plan.duration == pytest.approx(11.6)
    assert plan.segments[1].commands == {"crane_lift": 0.5}
    held = holding(plan, 180.0, 4.0, 0.26).segments[0].commands
    # a cylinder's moments: m r²/2 and m (r²/4 + l²/12)
    assert held["crane_held_axial"] == pytest.approx(180.0 * 0.13**2 / 2.0)
    assert held["crane_held_transverse"] == pytest.approx(180.0 * (0.13**2 / 4.0 + 16.0 / 12.0))
    (tmp_path / "logs.csv").write_text(COMMANDS)
    with pytest.raises(ValueError, match="so does crane_held_mass of logs; drop one"):
        holding(from_file(tmp_path / "logs.csv"), 180.0, 4.0, 0.26)
    (tmp_path / "plain.csv").write_text("time_s,drive_signal\n0,0\n1,0.5\n")
    assert not from_file(tmp_path / "plain.csv").moves_crane


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ("-m crane --device cpu:simd", "--device is cpu:simd, where twins have no crane; take cpu"),
        ("-m left --crane-pose 0 95 0 0", "--crane-pose: lift is 95 deg"),
        ("-m crane --held 180 0 0.2", "--held LENGTH is 0 m, but must be above 0"),
        ("-m crane --held 2e4 4 0.2", "--held MASS is 20000 kg"),
        # a folded crane's tip is 0.77 m high, the log hangs 1.1 m below
        ("-m drive --held 180 4 0.26", "--held: a log 0.26 m thick would begin 0.46 m in the ground"),
        ("-m crane --duration 3", "--duration is 3 s, but crane takes as long as its steps do; leave it out"),
        ("-m crane --signal 120", "--signal is 120 %"),
    ],
)
def test_what_is_wrong_is_told_in_a_line(options, words, tmp_path):
    shown = call("simulate", *options.split(), "--out", tmp_path / "log.csv")
    assert shown.exit_code == 2
    assert words in shown.output
