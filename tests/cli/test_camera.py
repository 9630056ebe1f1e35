"""Pictures from the command line: files, calibration, JSON, and what is wrong input."""

import json

import numpy as np
import pytest
from PIL import Image

from tests.cli.calling import call


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """One that holds a small world."""
    made = tmp_path_factory.mktemp("camera")
    shown = call("world", "--size", "30", "30", "--stand", "pine", "--out", str(made / "heath"), "--quiet")
    assert shown.exit_code == 0, shown.output
    return made


@pytest.fixture
def heath(folder, monkeypatch):
    """Words for small pictures of the world in the current folder."""
    monkeypatch.chdir(folder)
    return ("camera", "--world", "heath", "--width", "64", "--samples", "1")


def test_pictures_truth_and_calibration(heath, folder):
    shown = call(*heath, "--speed", "1", "--frames", "2", "--out", "seen", "--json", "-")
    assert shown.exit_code == 0, shown.output
    found = json.loads(shown.stdout)
    assert found["objects"] >= 1 and 0.1 < found["share_of_ground"] < 1.0
    told = json.loads((folder / "seen/calibration.json").read_text())
    assert (told["width"], told["height"]) == (64, 48)
    for frame in ("0000", "0001"):
        for eye in ("left", "right"):
            with np.load(folder / f"seen/{eye}_{frame}.npz") as arrays:
                assert arrays["depth"].shape == (48, 64) and arrays["flow"].shape == (48, 64, 2)
                seen = np.isfinite(arrays["depth"])
                fx, baseline = told["matrix"][0][0], told["baseline_m"]
                np.testing.assert_allclose(arrays["disparity"][seen], fx * baseline / arrays["depth"][seen], rtol=1e-5)
            with Image.open(folder / f"seen/{eye}_{frame}.png") as picture:
                assert picture.size == (64, 48)
    assert (folder / "seen/sheet.png").stat().st_size > 20_000


def test_a_table_and_its_files(heath):
    shown = call(*heath, "--weather", "rain=10", "--season", "autumn", "--exposure", "2")
    assert shown.exit_code == 0, shown.output
    assert "2 ms" in shown.stdout and "median depth" in shown.stdout
    assert "wrote camera/sheet.png" in shown.stdout


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--model", "x"], "--model is 'x'; choose one of: stereo"),
        (["--hour", "1"], "hour is 1 h, when the sun stands at"),
        (["--season", "monsoon"], "season is 'monsoon'; choose one of"),
        (["--weather", "fog"], "--weather is 'fog', but must be KIND=AMOUNT"),
        (["--at", "500", "0"], "there is no ground at x = 500.0 m"),
        (["--frames", "0"], "--frames is 0"),
        (["--width", "4"], "--width is 4"),
        (["--exposure", "-1"], "exposure is -0.001 s"),
        (["--cloud", "2"], "cloud is 2"),
        (["--terrain", "a.ply"], "drop one of them"),
    ],
)
def test_wrong_input(heath, words, message):
    shown = call(*heath, *words)
    assert shown.exit_code == 2
    assert message in " ".join(shown.stderr.split())
