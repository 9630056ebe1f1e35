"""The command ``view``."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from .calling import check_refused

ROOT = Path(__file__).resolve().parents[2]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ("view --terrain nothing.ply", "nothing.ply"),
        ("view --lidar os9", "--lidar is 'os9'; choose one of"),
        ("view --camera mono", "--camera is 'mono'; choose one of: stereo, stereo-"),
        (
            "view --camera stereo --policy preview",
            "--camera is on a live twin or on the machine of a LOG; drop --policy",
        ),
        ("view --lidar vlp-16 --policy preview", "--lidar is on a live twin or on the machine of a LOG; drop --policy"),
        ("view --port 70000", "port is 70000, but must be"),
        ("view --path a.gpx --start 0 0 0", "--path and --start both say where to start"),
        ("view --ground grid", "ground is 'grid'; choose one of: raster, mesh"),
        ("view --set joint.nothing=1", "joint.nothing"),
        ("view --world nowhere", "nowhere"),
        ("view --world forest --terrain scan.ply", "--world forest has its own ground"),
        ("view --policy nobody", "'nobody' is no policy for AORO/PathTracking-v0"),
        ("view --policy preview --start 0 0 0", "drop --start"),
        ("view --policy preview --machine aoro --machine aoro", "policies drive one"),
        ("view --policy preview a.csv", "drop one of them"),
        (
            "view --env AORO/Turning-v0",
            "--env AORO/Turning-v0 has episodes that policies drive; name one with --policy",
        ),
        ("view --track 2", "--track 2 is one of a path's tracks; give its file with --path"),
        ("view --policy preview --track 2", "--track 2 is one of a path's tracks; give its file with --path"),
        ("view a.csv --start 0 0 0", "--start is a live twin's, but a LOG is shown again"),
        ("view --gamepad nothing", "--gamepad nothing does not exist; there are: "),
        ("view --gamepad nothing --policy preview", "--gamepad drives a live twin, but episodes are shown"),
    ],
)
def test_what_is_wrong_is_said_in_one_line(arguments, message, tmp_path, monkeypatch):
    pytest.importorskip("viser", reason="[view] is not installed")
    monkeypatch.chdir(tmp_path)
    check_refused(arguments, message)


def test_without_viser_the_fix_is_named(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "viser", None)
    monkeypatch.chdir(tmp_path)
    check_refused("view", "the view needs viser: pip install 'aoro-gym[view]'")


@pytest.mark.slow
def test_it_serves_a_page_until_it_is_interrupted():
    pytest.importorskip("viser", reason="[view] is not installed")
    command = [sys.executable, "-m", "aoro_gym", "view", "--no-browser", "--port", "0"]
    process = subprocess.Popen(command, cwd=ROOT, stderr=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    assert process.stderr is not None
    lines = []
    while not lines or not lines[-1].startswith("view: http://127.0.0.1:"):
        lines.append(process.stderr.readline())
        assert lines[-1], lines
    os.kill(process.pid, signal.SIGINT)
    shown, rest = process.communicate(timeout=60.0)
    assert process.returncode == 130 and shown == ""
    assert rest == "interrupted: the page is closed; the same command begins anew\n"
