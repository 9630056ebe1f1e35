"""Command files in every dialect and unit give the same manoeuvre."""

import re

import numpy as np
import pytest

from aoro_gym.recording.command_files import read_commands
from aoro_gym.simulation.manoeuvres import from_file

PLAIN = "time_s,steering_signal,gear\n0.1,0,1\n0.2,-0.5,1\n0.5,0.25,2\n"


@pytest.mark.parametrize(
    "text",
    [
        PLAIN,
        PLAIN.replace(",", ";").replace(".", ","),
        PLAIN.replace(",", "\t"),
        "time_ms,steering_signal [%],gear\n100,0,1\n200,-50,1\n500,25,2\n",
        "t/s,Steering signal (‰),Gear\n0.1,0,1\n0.2,-500,1\n0.5,250,2\n",
        "time,steering_signal_V,gear\ns,V,1\n0.1,2.5,1\n0.2,3.5,1\n0.5,2.0,2\n",
        "time,steering_signal_mV,gear,\n0.1,2500,1,\n0.2,3500,1,\n0.5,2000,2,\n",
        PLAIN.replace("gear\n", "gear,remark,pressure_a_bar,true_spool\n").replace("1\n", "1,x,,nan\n").replace("2\n", "2,,,\n"),  # noqa: E501
    ],
)  # fmt: skip
def test_dialects_and_units(tmp_path, text):
    path = tmp_path / "commands.csv"
    path.write_text(text, encoding="utf-8")
    file = read_commands(path)
    np.testing.assert_allclose(file.time, [0.1, 0.2, 0.5], atol=1e-15)
    np.testing.assert_allclose(file.commands["steering_signal"], [0.0, -0.5, 0.25], atol=1e-15)
    np.testing.assert_array_equal(file.commands["gear"], [1.0, 1.0, 2.0])
    plan = from_file(path)
    assert [segment.steps for segment in plan.segments] == [100, 100, 300]
    assert plan.unread == (("remark",) if "remark" in text else ())


def test_a_clock_since_1970_begins_with_its_first_row(tmp_path):
    path = tmp_path / "commands.csv"
    path.write_text("stamp,drive_signal\n" + "".join(f"{1777881600 * 10**9 + k * 10**8},0.{k}\n" for k in range(3)))
    np.testing.assert_allclose(read_commands(path).time, [0.0, 0.1, 0.2])
    assert [segment.steps for segment in from_file(path).segments] == [100, 100]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("time_s,stering_signal\n0,0\n1,1\n", "unknown column 'stering_signal'; did you mean 'steering_signal'?"),
        ("time_s,steering_signal [furlong]\n0,0\n1,1\n", "is in 'furlong', which is no unit"),
        ("time_s,drive_signal_percent\n0,0\n1,120\n", "line 3: drive_signal_percent is 1.2, but must be in [-1, 1]"),
        ("time_s,drive_signal\n0,0\n1,1_0\n", "line 3: drive_signal = '1_0' is not a finite number"),
        ("time_s,drive_signal\n0,0\n1,\n", "line 3: drive_signal = '' is not a finite number: it is blank in 1 of 2"),
        ("time_s,drive_signal\n0,0\n1777881600000000000,1\n", "these are nanoseconds since 1970"),
        ("time_ms,time_us,drive_signal\n0,0,0\n1,1,1\n", "time_ms, time_us name the same quantity; leave one"),
        ("drive_signal,steering_signal\n0,0\n1,1\n", "no column time_s, only drive_signal, steering_signal"),
        ("time_s,joint_angle_deg\n0,0\n1,1\n", "no command column"),
        ("time_s,drive_signal\n0,0\n1,1.2\n", "line 3: drive_signal is 1.2, but must be in [-1, 1]"),
        ("time_s,gear\n0,1\n1,1.5\n", "line 3: gear is 1.5, but must be one of 1, 2, 3"),
        ("time_s,steering_signal_V\n0,5\n1,2.5\n", "line 2: steering_signal_V is 5 V, but must be in [0.5, 4.5] V"),
        ("time_s,drive_signal\n-1,0\n1,1\n", "line 2: time_s is -1 s, but must be in [0, 3600] s"),
        ("time_s,drive_signal\n1,0\n0.5,1\n", "line 3: time_s is 0.5 s, but must follow 1 s by at least 0.001 s"),
        ("time_s,drive_signal\n0,0\n0.0001,1\n", "line 3: time_s is 0.0001 s, but must follow 0 s"),
        ("time_s,drive_signal\n0,0\n", "ends at 0 s, before 0.01 s; add a row, or give --duration"),
    ],
)
def test_a_broken_file_is_named_with_its_line(tmp_path, text, message):
    path = tmp_path / "commands.csv"
    path.write_text(text)
    with pytest.raises(ValueError, match=re.escape(message)):
        from_file(path)
