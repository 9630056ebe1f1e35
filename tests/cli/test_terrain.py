"""The command ``terrain``: its files, what is doubtful reaches the terminal, and its options reach the file."""

import json
import math

import numpy as np
import pytest
import rasterio
from typer.testing import CliRunner

from aoro_gym.cli import app
from tests.cli.calling import call, check_refused


def test_terrain(tmp_path):
    slope = np.add.outer(np.zeros(41), 0.1 * np.arange(51.0))
    slope[20:30, 20:30] = np.nan
    np.save(tmp_path / "ground.npy", slope)
    shown = call(
        "terrain", tmp_path / "ground.npy", "--cell", 1, "--hole-limit", 4, "--out", tmp_path / "made" / "fine.ply"
    )
    assert shown.exit_code == 0, shown.output
    assert "median 5.7°" in shown.stdout
    assert "1 place without ground, 1 of them inside" in shown.stdout
    report = json.loads((tmp_path / "made" / "fine.json").read_text())
    assert report["slope_max_deg"] == pytest.approx(math.degrees(math.atan(0.1)))
    assert report["extent_m"] == pytest.approx([50.0, 40.0, 5.0])
    assert [hole["at_edge"] for hole in report["holes"]] == [False]
    for suffix in (".ply", ".png"):
        assert (tmp_path / "made" / f"fine{suffix}").stat().st_size > 1000


N = 40


def write(path, bands, dtype="float32"):
    with rasterio.open(
        path,
        "w",
        driver="GTiff",
        height=N,
        width=N,
        count=len(bands),
        dtype=dtype,
        crs="EPSG:32635",
        transform=rasterio.Affine(1.0, 0.0, 5e5, 0.0, -1.0, 6.65e6),
    ) as data:
        for number, band in enumerate(bands, 1):
            data.write(band.astype(dtype), number)
    return path


def ground():
    i, j = np.mgrid[0:N, 0:N]
    return 150.0 + 4.0 * np.sin(j / 5.0) + 3.0 * np.cos(i / 6.0)


@pytest.fixture
def run(tmp_path, monkeypatch):
    """Exit status, words on the terminal with single spaces, and the report."""
    monkeypatch.chdir(tmp_path)

    def command(*arguments: str):
        done = CliRunner().invoke(app, ["terrain", *arguments, "--out", "x.ply"])
        beside = tmp_path / "x.json"
        report = json.loads(beside.read_text()) if done.exit_code == 0 else None
        return done.exit_code, " ".join(done.output.split()), report

    return command


def test_units_are_asked_for_and_told(run, tmp_path):
    write(tmp_path / "dm.tif", [np.rint(10.0 * ground())], "int16")
    status, text, _ = run("dm.tif")
    assert status == 2
    assert "dm.tif: nothing is said of the unit of its heights" in text
    assert "--z-units" in text
    assert "Traceback" not in text
    status, _, report = run("dm.tif", "--z-units", "dm")
    assert status == 0
    assert report["extent_m"][2] == pytest.approx(np.ptp(ground()), abs=0.1)


def test_marks_of_unknown(run, tmp_path):
    z = ground()
    z[10:20, 10:20] = 0.0
    write(tmp_path / "[x] zero.tif", [z])
    status, text, report = run("[x] zero.tif")
    assert status == 0
    assert "100 heights of exactly 0 taken as unknown" in text
    assert "100 pixels are exactly 0" in text
    assert "--nodata 0" in text
    status, text, report = run("[x] zero.tif", "--nodata", "-7", "--nodata", "0")
    assert (status, report["extent_m"][2] < 20.0) == (0, True)
    assert "--nodata" not in text
    status, _, report = run("[x] zero.tif", "--nodata", "none")
    assert (status, report["extent_m"][2] > 100.0) == (0, True)
    for wrong in ("x", "1_0"):
        status, text, _ = run("[x] zero.tif", "--nodata", wrong)
        assert status == 2
        assert f"--nodata {wrong} is no number" in text


def test_bands(run, tmp_path):
    write(tmp_path / "two.tif", [ground(), 2.0 + 0.1 * ground()])
    status, text, _ = run("two.tif")
    assert status == 2
    assert "--band" in text
    status, text, report = run("two.tif", "--band", "2")
    assert status == 0
    assert report["extent_m"][2] == pytest.approx(0.1 * np.ptp(ground()), abs=1e-3)
    assert "band 2 taken as asked" in text


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ("terrain none.tif", "none.tif: No such file or directory"),
        ("terrain good.csv", "good.csv: its columns are named time_s, steering_signal, which are not x, y and z"),
        ("terrain bad.toml", "bad.toml: terrains end in one of"),
        ("terrain good.csv --out fine.stl", "--out fine.stl must end in .ply"),
        ("terrain good.csv --units yards", "error: --units is 'yards'; choose one of:"),
        ("terrain good.csv --crs nonsense", "error: --crs is 'nonsense', which is unknown; give a code such as"),
        ("terrain good.csv --crs EPSG:5773", "error: --crs is 'EPSG:5773' (EGM96 height), which is neither"),
    ],
)
def test_wrong_input_is_one_line_before_anything_runs(files, arguments, message):
    check_refused(arguments, message)
