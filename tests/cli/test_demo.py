"""The command ``demo``."""

import json
import re

import pytest

from tests.cli.calling import call, check_refused


@pytest.mark.slow
def test_demo(tmp_path):
    shown = call("demo", "--out", tmp_path / "demo")
    assert shown.exit_code == 0, shown.output
    page = (tmp_path / "demo" / "index.html").read_text(encoding="utf-8")
    assert "Full turn left" in page
    assert "Straight drive" in page
    assert str(tmp_path / "demo" / "index.html") in shown.stdout
    assert "of 25 figures of the published machine itself are met, and" in page
    assert "of 7. Farthest from the machine: the first peak at 50 % signal, +" in page
    assert "AORO/Turning-v0" in page
    assert len(page) < 4_000_000
    assert len(re.findall("data:image/(?:avif|webp);base64,", page)) == 4  # a film and three drawings
    assert page.count("data:video/mp4;base64,") == 1
    assert "bridged over gaps" in page
    assert "They ended so: end of path reached; end of path reached." in page
    assert "policy paths-dagger of AORO/PathTracking-v0" in page and "pure-pursuit on the same path" in page
    pictures = ("left_turn.png", "straight_drive.png", "drive/drive.mp4", "drive/plan_1.png")
    for name in (*pictures, "drive/scan.ply", "validation/index.html"):
        assert (tmp_path / "demo" / name).exists()
    assert json.loads((tmp_path / "demo" / "validation" / "validation.json").read_text())["uncalibrated"]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ("demo --out good.csv", "--out good.csv is a file; name a folder"),
    ],
)
def test_wrong_input_is_one_line_before_anything_runs(files, arguments, message):
    check_refused(arguments, message)
