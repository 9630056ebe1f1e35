"""How two data sets of the same settings differ that were made on two devices.

    aoro-gym dataset --frames 12 --drive --machines 2 --sensor stereo,lidar --format coco,kitti --out host
    aoro-gym dataset --frames 12 --drive --machines 2 --sensor stereo,lidar --format coco,kitti --device cuda:0 --out device
    python -m studies.dataset_devices host device

Forests, places, lights and drives come from the seed on the host, so that they are the same; rays are cast and added up on
the device, whose float32 rounds otherwise.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from aoro_gym.execution.files import write_json
from aoro_gym.sensors.dataset.formats import name_of
from aoro_gym.sensors.dataset.sweeps import read_sweep
from aoro_gym.sensors.dataset.taking import DEPTH_STEPS

DRAWN = ("drawn", "season", "stand", "camera_to_world", "time_s", "way_m")
"""What a picture's own file says that no ray has a part in."""
NEAR = 0.01
"""[m] within which two points of a sweep are the same."""


def compare(one: Path, other: Path) -> dict[str, Any]:
    """Differences of two folders, of all pictures together. ``ValueError`` where they hold other pictures."""
    files = [sorted((folder / "frames").glob("*.json")) for folder in (one, other)]
    if [file.name for file in files[0]] != [file.name for file in files[1]] or not files[0]:
        raise ValueError(f"{one} and {other} do not hold the same pictures")
    hashes = [json.loads((folder / "manifest.json").read_text(encoding="utf-8"))["sha256"] for folder in (one, other)]
    alike = Counter(name.split("/")[0] for name, digest in hashes[0].items() if hashes[1].get(name) == digest)
    every = Counter(name.split("/")[0] for name in hashes[0])
    rows = []
    for pair in zip(*files, strict=True):
        frames = [json.loads(file.read_text(encoding="utf-8")) for file in pair]
        rows.append({**_pixels(one, other, frames[0]), **_labels(*frames), **_points(one, other, frames[0])})
    names = [name for name in rows[0] if name.endswith("_most")]
    whole = {name: float(np.mean([row[name] for row in rows])) for name in rows[0] if name not in names}
    whole |= {name: float(np.max([row[name] for row in rows])) for name in names}
    return {"pictures": len(rows), "same_files": {name: [alike[name], every[name]] for name in every}, **whole}


def _pixels(one: Path, other: Path, frame: dict[str, Any]) -> dict[str, float]:
    """Shares of pixels, and how far they differ."""

    def read(folder: Path, kind: str) -> NDArray[np.int64]:
        with Image.open(folder / kind / frame["split"] / f"{name_of(frame)}.png") as opened:
            return np.asarray(opened).astype(np.int64)

    out: dict[str, float] = {}
    for kind in ("images", "right"):
        if (one / kind).exists():
            apart = np.abs(read(one, kind) - read(other, kind)).max(axis=-1)
            out[f"{kind}_pixels_off_by_over_1"] = float((apart > 1).mean())
            out[f"{kind}_pixels_off_by_over_8"] = float((apart > 8).mean())
    instances = read(one, "instances") != read(other, "instances")
    out["instance_pixels_other"] = float(instances.mean())
    depths = [read(folder, "depth") / DEPTH_STEPS for folder in (one, other)]
    known = (depths[0] > 0.0) & (depths[1] > 0.0) & ~instances
    apart = np.abs(depths[0] - depths[1])[known] / depths[0][known]
    out["depth_relative_median"] = float(np.median(apart))
    out["depth_pixels_off_by_over_1_percent"] = float((apart > 0.01).mean())
    return out


def _labels(one: dict[str, Any], other: dict[str, Any]) -> dict[str, float]:
    """Whether what was drawn is the same, labels that only one has, and how far boxes of both are apart [pixels]."""
    found = [
        {(label["instance"], label["category"]): label["box"] for label in frame["labels"]} for frame in (one, other)
    ]
    both = sorted(found[0].keys() & found[1].keys())
    apart = [np.abs(np.subtract(found[0][key], found[1][key])).max() for key in both]
    return {
        "drawn_alike": float(all(one.get(name) == other.get(name) for name in DRAWN)),
        "labels": float(len(found[0])),
        "labels_of_one_alone": float(len(found[0].keys() ^ found[1].keys())),
        "boxes_other": float(np.mean(np.array(apart) > 0.0)) if both else 0.0,
        "boxes_px_most": float(max(apart, default=0.0)),
    }


def _points(one: Path, other: Path, frame: dict[str, Any]) -> dict[str, float]:
    """Of sweeps: points, and the share that the other sweep has, of the same label."""
    if "points" not in frame:
        return {}
    from scipy.spatial import KDTree

    files = [folder / "velodyne" / frame["split"] / f"{name_of(frame)}.bin" for folder in (one, other)]
    (points, labels), (others, their_labels) = (read_sweep(file) for file in files)
    apart, nearest = KDTree(others[:, :3]).query(points[:, :3])
    return {
        "points": float(len(points)),
        "points_fewer_or_more": float(abs(len(points) - len(others))),
        "points_apart_over_1_cm": float((apart > NEAR).mean()),
        "point_labels_other": float((labels != their_labels[nearest])[apart <= NEAR].mean()),
    }


def main() -> int:
    """Print, or write, the comparison."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("one", type=Path, metavar="FOLDER")
    parser.add_argument("other", type=Path, metavar="FOLDER")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write it there, too")
    asked = parser.parse_args()
    try:
        found = compare(asked.one, asked.other)
    except (OSError, ValueError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    print(json.dumps(found, indent=2))
    if asked.json is not None:
        write_json(asked.json, found)
    return 0


if __name__ == "__main__":
    sys.exit(main())
