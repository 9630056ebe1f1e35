"""What two data sets differ in is what was changed in one of them."""

from __future__ import annotations

import json
import shutil

import numpy as np
import pytest
from PIL import Image

from aoro_gym.sensors.dataset import DatasetSettings, make
from studies.dataset_devices import compare


def test_what_was_changed_is_told(tmp_path) -> None:
    one, other = tmp_path / "one", tmp_path / "other"
    sensors = "stereo", "lidar"
    make(one, DatasetSettings(3, 3, seed=4, width=96, samples=1, size=30.0, left_only=True, sensors=sensors))
    shutil.copytree(one, other)
    alike = compare(one, other)
    assert all(same == whole for same, whole in alike["same_files"].values())
    assert alike["labels"] > 1 and alike["points"] > 1000 and alike["drawn_alike"] == 1.0
    assert not any(value for name, value in alike.items() if "off" in name or "other" in name or "apart" in name)
    frames = {file: len(json.loads(file.read_text())["labels"]) for file in (other / "frames").glob("*.json")}
    frame = max(frames, key=lambda file: frames[file])
    [picture] = (other / "images").rglob(f"{frame.stem}.png")
    with Image.open(picture) as opened:
        pixels = np.array(opened)
    height, width = pixels.shape[:2]
    pixels[0, :10] ^= 128
    Image.fromarray(pixels).save(picture)
    told = json.loads(frame.read_text())
    gone = told["labels"].pop()
    told["labels"][0]["box"][0] -= 2.0
    frame.write_text(json.dumps(told))
    [sweep] = (other / "velodyne").rglob(f"{picture.stem}.bin")
    points = np.fromfile(sweep, dtype="<f4").reshape(-1, 4)
    points[:100, 2] += 500.0
    points.tofile(sweep)
    found = compare(one, other)
    assert found["images_pixels_off_by_over_8"] == pytest.approx(10 / (height * width) / 3)
    assert found["labels_of_one_alone"] == pytest.approx(1 / 3) and gone
    assert found["boxes_px_most"] == 2.0
    assert found["points_apart_over_1_cm"] == pytest.approx(100 / len(points) / 3, rel=0.05)
    shutil.rmtree(other / "frames")
    with pytest.raises(ValueError, match="do not hold the same pictures"):
        compare(one, other)
