"""The command ``diagnose``: what it refuses."""

import pytest

from tests.cli.calling import call


@pytest.mark.parametrize(
    ("content", "said"),
    [
        ("time_s,steering_signal\n" + "".join(f"{k / 100},0\n" for k in range(200)), "joint_angle_rad"),
        ("time_s,steering_signal,joint_angle_rad\n" + "".join(f"{k},0,0.1\n" for k in range(12)), "samples a second"),
        ("time_s,steering_signal,joint_angle_rad\n" + "".join(f"{k / 100},0,0.1\n" for k in range(60)), "needs"),
        ("a,b\n1,2\n", "time_s"),
    ],
    ids=["no angle", "1 Hz", "short", "other columns"],
)
def test_logs_that_cannot_be_used_are_refused_in_a_line(content, said, tmp_path):
    log = tmp_path / "log.csv"
    log.write_text(content)
    result = call("diagnose", log, "--out", tmp_path / "out")
    assert result.exit_code == 2
    assert said in " ".join(result.output.split())
    assert not (tmp_path / "out").exists()


HEAD = "signal_percent,source,turn_time_s,first_peak_L_per_min"


@pytest.mark.parametrize(
    ("content", "options", "said"),
    [
        ("", [], "no rows"),
        ("source,turn_time_s\nm,2\n", [], "no column signal_percent"),
        ("signal_percent,source\n100,m\n", [], "one at least of turn_time_s"),
        (f"{HEAD},notes\n100,m,2,90,x\n", [], "unknown column 'notes'"),
        (f"{HEAD}\n100,m,2\n", [], "line 2: 3 values where the header names 4 columns"),
        (f"{HEAD}\n100,m,two,90\n", [], "turn_time_s is 'two', but must be a number"),
        (f"{HEAD}\n100,m,nan,90\n", [], "turn_time_s is 'nan', but must be a number"),
        (f"{HEAD}\n0.75,m,2,90\n", [], "signal_percent is 0.75, a share; did you mean 75?"),
        (f"{HEAD}\n0,m,2,90\n", [], "signal_percent is 0, but must be above 0"),
        (f"{HEAD}\n100,m,,\n", [], "no figure is known"),
        (f"{HEAD}\n100,m,2,90\n100,m,2.1,91\n", [], "twice"),
        (f"{HEAD}\n100,m,2,90\n100,n,2,90\n", [], "--source is needed; choose one of m, n"),
        (f"{HEAD}\n100,m,2,90\n", ["--source", "q"], "no row of source 'q'; choose one of m"),
        (f"{HEAD}\n100,m,2,90\n", ["--fit", "signal=75"], "no row has signal=75; choose of 100"),
        (f"{HEAD}\n100,m,2,90\n", ["--fit", "left"], "write --fit signal=100"),
        (f"{HEAD}\n100,m,2,90\n", ["--holdout", "signal=100"], "leaves no row"),
        (f"{HEAD}\n100,m,2,90\n", ["--healthy", "logs"], "--healthy takes logs; with --metrics give --healthy-source NAME"),
        (f"{HEAD}\n100,m,2,90\n", ["--healthy-source", "m"], "--healthy-source m is the --source itself"),
        (f"{HEAD}\n100,m,2,90\n", ["--healthy-source", "q"], "no row of source 'q'; choose one of m"),
        (
            f"{HEAD}\n100,m,2,90\n75,n,2,90\n",
            ["--source", "m", "--healthy-source", "n"],
            "no healthy row has a turn of left, 100 %; there are left, 75 %",
        ),
        ("signal_percent,source,turn_time_s,mean_flow_L_per_min\n100,m,2000,70.6\n", [], "at most 1000"),
        ("signal_percent,source,turn_time_s,mean_flow_L_per_min\n100,m,2,1.2\n", [], "check the units"),
    ],
)  # fmt: skip
def test_tables_that_cannot_be_used_are_refused_in_a_line(content, options, said, tmp_path):
    table = tmp_path / "table.csv"
    table.write_text(content)
    result = call("diagnose", "--metrics", table, *options, "--out", tmp_path / "out")
    assert result.exit_code == 2
    assert said in " ".join(result.output.split())
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ([], "give LOGs or --metrics"),
        (["log.csv", "--metrics", "t.csv"], "not both"),
        (["--metrics", "no.csv"], "no.csv"),
        (["log.csv", "--healthy-source", "m"], "--healthy-source m belongs to --metrics TABLE"),
    ],
)
def test_logs_or_a_table_are_needed(options, said):
    result = call("diagnose", *options)
    assert result.exit_code == 2
    assert said in " ".join(result.output.split())
