"""A data set from the command line: readers of others read it, it goes on after an interruption, splits share no forest."""

import hashlib
import json
from typing import Any

import numpy as np
import pytest
from PIL import Image
from pycocotools.coco import COCO
from pycocotools.cocoeval import COCOeval

from tests.cli.calling import call

pytestmark = pytest.mark.filterwarnings(
    "ignore:__array__ implementation:DeprecationWarning"
)  # pycocotools with numpy 2

WORDS = ("dataset", "--frames", "3", "--worlds", "3", "--width", "96", "--samples", "1", "--quiet")
FORMATS = ("--format", "coco", "--format", "yolo", "--format", "kitti")


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    folder = tmp_path_factory.mktemp("dataset") / "set"
    shown = call(*WORDS, *FORMATS, "--seed", "4", "--out", str(folder), "--json", "-")
    assert shown.exit_code == 0, shown.output
    return folder, json.loads(shown.stdout)


def test_pycocotools_reads_it_and_truth_scores_one(made, capsys):
    folder, found = made
    assert set(found) == {"train", "val", "test"}
    truth = COCO(str(folder / "annotations/instances_train.json"))
    annotations = truth.loadAnns(truth.getAnnIds())
    assert len(annotations) == sum(n for name, n in found["train"].items() if name != "pictures") > 3
    told: Any = [
        {**{key: one[key] for key in ("image_id", "category_id", "bbox")}, "score": 1.0} for one in annotations
    ]
    scored = COCOeval(truth, truth.loadRes(told), "bbox")
    scored.evaluate()
    scored.accumulate()
    scored.summarize()
    assert scored.stats[0] == pytest.approx(1.0)
    for one in annotations:
        assert truth.annToMask(one).sum() == one["area"]
    capsys.readouterr()


def test_yolo_and_kitti_files_say_the_same(made):
    folder, _ = made
    for path in sorted((folder / "frames").glob("*.json")):
        frame = json.loads(path.read_text())
        yolo = np.loadtxt(folder / "labels" / frame["split"] / f"{path.stem}.txt", ndmin=2).reshape(-1, 5)
        kitti = [
            line.split()
            for line in (folder / "kitti" / frame["split"] / "label_2" / f"{path.stem}.txt").read_text().splitlines()
        ]
        assert len(yolo) == len(kitti) == len(frame["labels"])
        size = np.array([frame["width"], frame["height"]])
        for label, (_, *shares), words in zip(frame["labels"], yolo, kitti, strict=True):
            middle, whole = np.array(shares[:2]) * size, np.array(shares[2:]) * size
            box = np.concatenate([middle - 0.5 * whole, middle + 0.5 * whole])
            np.testing.assert_allclose(box, label["box"], atol=1e-3)
            assert len(words) == 15
            np.testing.assert_allclose([float(word) for word in words[4:8]], label["box"], atol=0.01)
            np.testing.assert_allclose([float(word) for word in words[11:14]], label["location_m"], atol=0.01)
        assert (folder / "images" / frame["split"] / f"{path.stem}.png").exists()


def test_depth_and_hashes(made):
    folder, _ = made
    with Image.open(next((folder / "depth").rglob("*.png"))) as picture:
        depth = np.array(picture) / 256.0
    assert depth.shape == (72, 96) and 1.0 < np.median(depth[depth > 0]) < 60.0
    hashes = json.loads((folder / "manifest.json").read_text())["sha256"]
    assert len(hashes) > 20
    for name, digest in hashes.items():
        assert hashlib.sha256((folder / name).read_bytes()).hexdigest() == digest
    card = (folder / "README.md").read_text()
    assert "| trunk |" in card and "seed 4" in card


def test_splits_have_forests_of_their_own(made):
    folder, _ = made
    frames = frames_of(folder)
    seeds = {split: {f["world_seed"] for f in frames if f["split"] == split} for split in ("train", "val", "test")}
    assert sum(map(len, seeds.values())) == len(set().union(*seeds.values())) == 3


def frames_of(folder):
    return [json.loads(path.read_text()) for path in sorted((folder / "frames").glob("*.json"))]


def test_what_is_fixed_stays_and_the_rest_is_drawn_as_before(made, tmp_path):
    words = (
        *WORDS[:-3],
        "--samples",
        "1",
        "--quiet",
        "--width",
        "32",
        "--seed",
        "4",
        "--fix",
        "light",
        "--fix",
        "season",
    )
    assert call(*words, "--out", str(tmp_path)).exit_code == 0
    for free, held in zip(frames_of(made[0]), frames_of(tmp_path), strict=True):
        assert held["season"] == "summer" and held["drawn"]["hour"] == 10.0
        assert held["stand"] == free["stand"]
        for name in ("weather", "angles_deg", "position", "albedo_seed"):
            assert held["drawn"][name] == free["drawn"][name]
    assert len({frame["drawn"]["albedo_seed"] for frame in frames_of(tmp_path)}) == 3
    assert "The same in all pictures: light, season." in (tmp_path / "README.md").read_text()


def test_cameras_near_logs_see_logs(tmp_path):
    """Elsewhere one of four pictures has a log."""
    words = ("dataset", "--frames", "6", "--worlds", "3", "--width", "64", "--samples", "1", "--quiet")
    assert call(*words, "--near", "log", "--left-only", "--out", str(tmp_path)).exit_code == 0
    shown = [any(label["category"] == "log" for label in frame["labels"]) for frame in frames_of(tmp_path)]
    assert sum(shown) >= 4
    assert (tmp_path / "images").exists() and not (tmp_path / "right").exists()


def test_what_was_interrupted_goes_on_to_the_same(made):
    """The picture that has no JSON file is taken again, as it was."""
    folder, _ = made
    before = (folder / "manifest.json").read_text()
    (folder / "frames/000001.json").unlink()
    assert call(*WORDS, *FORMATS, "--seed", "4", "--out", str(folder)).exit_code == 0
    assert (folder / "manifest.json").read_text() == before


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--frames", "4"], "holds a data set of other settings"),
        (["--worlds", "2"], "--worlds is 2"),
        (["--format", "voc"], "is 'voc'; choose one of: coco"),
        (
            ["--format", "kitti", "--model", "stereo-wide", "--out", "new"],
            "has a distortion, which KITTI's files cannot",
        ),
        (["--model", "x"], "is 'x'; choose one of: stereo"),
        (["--fix", "x"], "--fix is 'x'; choose one of: light"),
        (["--near", "x"], "--near is 'x'; choose one of: log"),
    ],
)
def test_wrong_input(made, monkeypatch, tmp_path, words, message):
    monkeypatch.chdir(tmp_path)
    shown = call(*WORDS, "--seed", "4", "--out", str(made[0]), *words)
    assert shown.exit_code == 2
    assert message in " ".join(shown.stderr.split())
