"""Ctrl-C in a terminal ends a command with one line that says how to go on."""

import pytest

from tests.cli.terminal.running import TURNING, in_terminal


@pytest.mark.slow
@pytest.mark.parametrize(
    ("arguments", "goes_on"),
    [
        (("calibrate", "--logs", "log.csv", "--out", "c.toml"), "the same command goes on from where it stopped"),
        (("diagnose", "log.csv", "--out", "d"), "the same command begins anew"),
        (("evaluate", *TURNING, "--episodes", 64, "--out", "e"), "the same command goes on from where it stopped"),
        (("leaderboard", *TURNING, "--episodes", 64, "--out", "l"), "the same command goes on from where it stopped"),
        (("blind", "seal", "--workers", 2, "--seed", 1, "suite"), "the same command goes on from where it stopped"),
        (("train", "--steps", 100_000, "--n-envs", 2, "--out", "t"), "aoro-gym train --resume t goes on"),
        (("validate", "--out", "v"), "the same command begins anew"),
        (("bench", "--twins", 1), "the same command begins anew"),
        (("laboratory", "-m", "kerb"), "the same command begins anew"),
    ],
)
@pytest.mark.parametrize("after", [0.0, 4.0])
def test_ctrl_c_ends_with_one_line(arguments, goes_on, after, inputs):
    if arguments[0] == "train":
        pytest.importorskip("stable_baselines3")
    shown = in_terminal(*arguments, folder=inputs, interrupt="%", after=after)
    if shown.code == 0:
        pytest.skip("it was done before")
    assert shown.code == 130, shown.text
    assert "Traceback" not in shown.text and "Error" not in shown.text, shown.text
    assert [line for line in shown.lines if line.strip()][-1] == f"interrupted: {goes_on}"


def test_ctrl_c_ends_a_server(tmp_path):
    shown = in_terminal("serve", "--udp-port", 0, "--tcp-port", 0, folder=tmp_path, interrupt="serving", after=0.5)
    assert shown.code == 130, shown.text
    assert "Traceback" not in shown.text
    last = [line for line in shown.lines if line.strip()][-1]
    assert last == "interrupted: the twin stands still; the same command begins anew"
