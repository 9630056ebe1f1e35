"""A data set from the command line: readers of others read it, it goes on after an interruption, splits share no forest;
and one of a machine that drives."""

import hashlib
import json
import random
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image
from pycocotools.coco import COCO
from pycocotools.cocoeval import COCOeval

from aoro_gym.sensors.dataset import CATEGORIES
from aoro_gym.sensors.dataset.sweeps import CLASSES, read_sweep
from aoro_gym.terrains.world.files import save_world
from tests.cli.calling import call
from tests.sensors.dataset.scenes import lying

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
    outlined = COCO(str(folder / "annotations/polygons_train.json"))
    for one in annotations:
        mask = truth.annToMask(one)
        assert mask.sum() == one["area"]
        polygons = outlined.anns[one["id"]]
        np.testing.assert_array_equal(outlined.annToMask(polygons), mask)
        assert all(polygons[key] == one[key] for key in polygons if key != "segmentation")
    assert [one["name"] for one in truth.dataset["categories"]] == list(CATEGORIES)
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
            np.testing.assert_allclose([float(word) for word in words[11:14]], label["camera_location_m"], atol=0.01)
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


def frames_of(folder: Path) -> list[dict[str, Any]]:
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


DRIVE = (
    "dataset", "--frames", "4", "--width", "96", "--samples", "1", "--sensor", "stereo,lidar", "--machines", "1",
    "--format", "coco,kitti", "--split", "val", "--seed", "3", "--quiet",
)  # fmt: skip


@pytest.fixture(scope="module")
def world(tmp_path_factory):
    """A folder with a small world on level ground, and a path over it."""
    folder = tmp_path_factory.mktemp("world")
    save_world(lying(), folder / "world")
    way = np.column_stack([np.linspace(-14.0, -4.0, 41), np.zeros(41)])
    np.savetxt(folder / "path.csv", way, delimiter=",", header="x,y", comments="")
    return ["--world", str(folder / "world"), "--path", str(folder / "path.csv")]


@pytest.fixture(scope="module")
def driven(world, tmp_path_factory):
    folder = tmp_path_factory.mktemp("driven") / "set"
    shown = call(*DRIVE, *world, "--out", folder)
    assert shown.exit_code == 0, shown.output
    return folder


def test_the_machine_drives_along_its_path(driven):
    """Pictures lie on the path, at equal distances of its way. Cross-track errors of the controller stay below 0.3 m, the
    camera's own place on the machine moves by up to 0.2 m, as drawn, and 2 m ahead of the hinge 7 degrees are 0.25 m."""
    frames = frames_of(driven)
    places = np.array([np.array(frame["camera_to_world"])[:3, 3] for frame in frames])
    assert np.abs(places[:, 1]).max() < 0.06 + 0.2 + 0.3 + 0.25
    ways = np.array([frame["way_m"] for frame in frames])
    np.testing.assert_allclose(np.diff(ways), np.diff(ways)[0], atol=0.01)
    np.testing.assert_allclose(np.linalg.norm(np.diff(places, axis=0), axis=1), np.diff(ways), atol=0.1)
    assert ways[-1] > 4.0 and np.diff([frame["time_s"] for frame in frames]).min() > 0.5
    mounts = [frame["camera_to_machine"] for frame in frames]
    assert mounts == [mounts[0]] * 4 and {frame["split"] for frame in frames} == {"val"}


def test_kittis_calibration_leads_points_into_the_picture(driven):
    """A small reader of KITTI's files: points of one object land within the box around all of it. A lidar's noise of 15 mm
    and its beam of 0.13 degrees, 1 cm at 5 m, are less than a pixel of 96 from 75 degrees, 8 cm at 5 m; so 1.5 pixels."""
    base, frames, compared = driven / "kitti/val", frames_of(driven), 0
    for frame in frames:
        name = f"{frame['number']:06d}"
        lines = [line.split(":") for line in (base / "calib" / f"{name}.txt").read_text().splitlines()]
        calibration = {key: np.array(values.split(), dtype=float) for key, values in lines}
        to_camera, projection = calibration["Tr_velo_to_cam"].reshape(3, 4), calibration["P2"].reshape(3, 4)
        rows, label = read_sweep(driven / "velodyne/val" / f"{name}.bin")
        np.testing.assert_array_equal(np.fromfile(base / "velodyne" / f"{name}.bin", "<f4").reshape(-1, 4), rows)
        own = rows[:, :3] @ to_camera[:, :3].T + to_camera[:, 3]
        drawn = own @ projection[:, :3].T + projection[:, 3]
        pixels = drawn[:, :2] / drawn[:, 2:] + 0.5
        for one in frame["labels"]:
            kind = 1 + CATEGORIES.index(one["category"])
            chosen = pixels[(label == kind + (one["instance"] << 16)) & (own[:, 2] > 1.0)]
            low, high = np.array(one["full_box"][:2]) - 1.5, np.array(one["full_box"][2:]) + 1.5
            assert ((chosen >= low) & (chosen <= high)).all(), one["category"]
            compared += len(chosen)
        assert set(np.unique(label & 0xFFFF)) <= set(CLASSES.values())
    assert compared > 100
    poses = np.loadtxt(base / "poses.txt").reshape(-1, 3, 4)
    np.testing.assert_allclose(poses[0], np.eye(3, 4), atol=1e-9)
    first = np.linalg.inv(np.array(frames[0]["camera_to_world"]))
    np.testing.assert_allclose(poses[3], (first @ np.array(frames[3]["camera_to_world"]))[:3], atol=1e-9)
    assert len(np.loadtxt(base / "times.txt")) == 4


def test_the_other_machine_is_seen_and_the_card_tells(driven):
    frames = frames_of(driven)
    files = [driven / "velodyne/val" / f"{frame['number']:06d}.bin" for frame in frames]
    assert any((read_sweep(file)[1] & 0xFFFF == CLASSES["machine"]).any() for file in files)
    card = (driven / "README.md").read_text()
    assert "A machine drove" in card and "other machines" in card and "velodyne" in card


def test_several_processes_and_devices_make_the_same_to_the_bit(driven, world, tmp_path):
    assert call(*DRIVE, *world, "--out", tmp_path / "set", "--device", "cpu,cpu").exit_code == 0  # two processes
    assert (tmp_path / "set/manifest.json").read_text() == (driven / "manifest.json").read_text()


@pytest.mark.slow
def test_killed_at_random_moments_it_makes_the_same_to_the_bit(driven, world, tmp_path):
    """Killed so early that it has not begun, and so late that it is all but done."""
    command = [sys.executable, "-m", "aoro_gym", *DRIVE, *world, "--out", str(tmp_path / "set"), "--processes", "2"]
    draw, killed = random.Random(1), 0
    for _ in range(12):
        process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        time.sleep(draw.uniform(1.0, 12.0))
        if process.poll() is None:
            process.send_signal(draw.choice([signal.SIGKILL, signal.SIGINT]))
            killed += 1
        process.wait()
    assert killed > 2
    assert subprocess.run(command, capture_output=True).returncode == 0
    assert (tmp_path / "set/manifest.json").read_text() == (driven / "manifest.json").read_text()


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
        (["--near", "machine"], "machines is 0; let some stand there"),
        (["--near", "log", "--drive"], "a machine that drives looks ahead; drop one of them"),
        (["--sensor", "lidar"], "give stereo, too: --sensor stereo,lidar"),
        (["--path", "path.csv"], "leads over a ground; give it by --world or --terrain"),
        (["--world", "forest", "--worlds", "4"], "--worlds 4 makes forests, but forest is the ground"),
    ],
)
def test_wrong_input(made, monkeypatch, tmp_path, words, message):
    monkeypatch.chdir(tmp_path)
    shown = call(*WORDS, "--seed", "4", "--out", str(made[0]), *words)
    assert shown.exit_code == 2
    assert message in " ".join(shown.stderr.split())
