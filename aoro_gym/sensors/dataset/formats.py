"""Labels in the files that others read: COCO, YOLO and KITTI."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from aoro_gym.execution.files import write_bytes, write_text
from aoro_gym.sensors.camera import CameraModel
from aoro_gym.sensors.dataset.labels import CATEGORIES, Label
from aoro_gym.sensors.dataset.polygons import polygons

FORMATS = ("coco", "yolo", "kitti")
COPIES = (("image_2", "images", ".png"), ("image_3", "right", ".png"), ("velodyne", "velodyne", ".bin"))
"""What KITTI's folders have of others, where there is such a thing: folder, where from, suffix."""
Frame = dict[str, Any]
"""What a picture's own JSON file holds: ``number``, ``split``, ``width``, ``height``, ``drawn``, ``labels``."""


def run_lengths(mask: NDArray[np.bool_]) -> list[int]:
    """Lengths of runs of zeros and ones by turns, zeros first, column by column: COCO's uncompressed encoding.

    >>> run_lengths(np.array([[False, True], [True, True]]))
    [1, 3]
    """
    flat = mask.ravel(order="F")
    changes = np.flatnonzero(flat[1:] != flat[:-1]) + 1
    bounds = [0, *([0] if flat[0] else []), *changes.tolist(), flat.size]
    return np.diff(bounds).tolist()


def mask_of(runs: Sequence[int], height: int, width: int) -> NDArray[np.bool_]:
    """(H, W) mask of what :func:`run_lengths` made of it."""
    flat = np.repeat(np.arange(len(runs)) % 2 == 1, runs)
    return flat.reshape(width, height).T


def described(label: Label) -> dict[str, Any]:
    """A label as JSON."""
    return {
        "instance": label.instance,
        "category": label.category,
        "box": label.box,
        "full_box": label.full_box,
        "truncation": label.truncation,
        "occlusion": label.occlusion,
        "size_m": label.size,
        "location_m": label.location,
        "rotation_y": label.turn,
        "camera_size_m": label.camera_size,
        "camera_location_m": label.camera_location,
        "area": int(label.mask.sum()),
        "runs": run_lengths(label.mask),
    }


def name_of(frame: Frame) -> str:
    """Of a picture's files, without suffix."""
    return f"{frame['number']:06d}"


def write_coco(folder: Path, frames: Sequence[Frame]) -> list[Path]:
    """``annotations/instances_SPLIT.json`` with run lengths, and ``polygons_SPLIT.json``, the same with polygons; boxes are
    of what is seen, the full ones are a field more."""
    written = []
    for split in sorted({frame["split"] for frame in frames}):
        content = coco([frame for frame in frames if frame["split"] == split])
        written.append(folder / "annotations" / f"instances_{split}.json")
        _write_compact(written[-1], content)
        for annotation in content["annotations"]:
            rle = annotation["segmentation"]
            annotation["segmentation"] = polygons(mask_of(rle["counts"], *rle["size"]))
        written.append(folder / "annotations" / f"polygons_{split}.json")
        _write_compact(written[-1], content)
    return written


def coco(frames: Sequence[Frame]) -> dict[str, Any]:
    """Content of a COCO file of pictures, their masks as run lengths; ``world_seed`` says which are of one forest."""
    images = [
        {
            "id": frame["number"],
            "file_name": f"{frame['split']}/{name_of(frame)}.png",
            "height": frame["height"],
            "width": frame["width"],
            "world_seed": frame["world_seed"],
        }
        for frame in frames
    ]
    labels = [(frame, label) for frame in frames for label in frame["labels"]]
    annotations = [_annotation(number, *one) for number, one in enumerate(labels, start=1)]
    categories = [{"id": number, "name": name} for number, name in enumerate(CATEGORIES, start=1)]
    return {"images": images, "annotations": annotations, "categories": categories}


def _annotation(number: int, frame: Frame, label: dict[str, Any]) -> dict[str, Any]:
    """A label in COCO's words."""
    (x0, y0, x1, y1), (u0, v0, u1, v1) = label["box"], label["full_box"]
    return {
        "id": number,
        "image_id": frame["number"],
        "category_id": CATEGORIES.index(label["category"]) + 1,
        "bbox": [x0, y0, x1 - x0, y1 - y0],
        "full_bbox": [u0, v0, u1 - u0, v1 - v0],
        "area": label["area"],
        "iscrowd": 0,
        "segmentation": {"size": [frame["height"], frame["width"]], "counts": label["runs"]},
        "truncation": label["truncation"],
        "occlusion": label["occlusion"],
        "instance": label["instance"],
    }


def _write_compact(file: Path, content: dict[str, Any]) -> None:
    """JSON without spaces: most of it are lists of numbers."""
    write_text(file, json.dumps(content, separators=(",", ":"), allow_nan=False) + "\n")


def write_yolo(folder: Path, frames: Sequence[Frame]) -> list[Path]:
    """``labels/SPLIT/NUMBER.txt`` beside ``images/``, and ``data.yaml``: class, middle and size as shares of the picture."""
    written = []
    for frame in frames:
        lines = []
        for label in frame["labels"]:
            x0, y0, x1, y1 = label["box"]
            shares = (
                0.5 * (x0 + x1) / frame["width"],
                0.5 * (y0 + y1) / frame["height"],
                (x1 - x0) / frame["width"],
                (y1 - y0) / frame["height"],
            )
            lines.append(" ".join([str(CATEGORIES.index(label["category"])), *(f"{share:.6f}" for share in shares)]))
        written.append(folder / "labels" / frame["split"] / f"{name_of(frame)}.txt")
        write_text(written[-1], "".join(line + "\n" for line in lines))
    splits = sorted({frame["split"] for frame in frames})
    names = "".join(f"  {number}: {name}\n" for number, name in enumerate(CATEGORIES))
    written.append(folder / "data.yaml")
    write_text(written[-1], "path: .\n" + "".join(f"{one}: images/{one}\n" for one in splits) + f"names:\n{names}")
    return written


def write_kitti(folder: Path, frames: Sequence[Frame], model: CameraModel) -> list[Path]:
    """``kitti/SPLIT`` with ``label_2``, ``calib``, ``image_2`` and ``image_3``, as the object benchmark has them, with
    ``velodyne`` where there is a lidar, and ``poses.txt`` as the odometry benchmark; lenses without distortion."""
    if any(model.intrinsics.distortion):
        raise ValueError(
            f"camera model {model.name} has a distortion, which KITTI's files cannot hold; take another one"
        )
    camera = np.column_stack([model.intrinsics.matrix, np.zeros(3)])
    right = camera.copy()
    right[0, 3] = -model.intrinsics.focal[0] * model.baseline
    written = []
    for frame in frames:
        base, name = folder / "kitti" / frame["split"], name_of(frame)
        lines = [kitti_line(label) for label in frame["labels"]]
        written += [base / kind / f"{name}.txt" for kind in ("label_2", "calib")]
        write_text(written[-2], "".join(line + "\n" for line in lines))
        numbers = {"P0": camera, "P1": right, "P2": camera, "P3": right, "R0_rect": np.eye(3)} | _transforms(frame)
        text = "".join(f"{key}: {_numbers(each)}\n" for key, each in numbers.items())
        write_text(written[-1], text)
        for kind, source, suffix in COPIES:
            file = folder / source / frame["split"] / f"{name}{suffix}"
            if file.exists():
                written.append(base / kind / file.name)
                write_bytes(written[-1], file.read_bytes())
    for split in sorted({frame["split"] for frame in frames}):
        written += _write_poses(folder / "kitti" / split, [frame for frame in frames if frame["split"] == split])
    return written


def _transforms(frame: Frame) -> dict[str, NDArray[np.float64]]:
    """From the lidar's axes to the camera's, and from the front frame's to the lidar's; the same axes without a lidar."""
    if "points" not in frame:
        return {"Tr_velo_to_cam": np.eye(3, 4), "Tr_imu_to_velo": np.eye(3, 4)}
    camera, lidar = np.array(frame["camera_to_machine"]), np.array(frame["lidar_to_machine"])
    return {"Tr_velo_to_cam": (np.linalg.inv(camera) @ lidar)[:3], "Tr_imu_to_velo": np.linalg.inv(lidar)[:3]}


def _write_poses(base: Path, frames: Sequence[Frame]) -> list[Path]:
    """Poses (3, 4) of the left camera, a row a picture, in the axes of its world's first picture; instants of drives."""
    first: dict[int, NDArray[np.float64]] = {}
    rows = []
    for frame in frames:
        pose = np.array(frame["camera_to_world"])
        begin = first.setdefault(frame["world_seed"], np.linalg.inv(pose))
        rows.append(_numbers((begin @ pose)[:3]))
    written = [base / "poses.txt"]
    write_text(written[0], "".join(row + "\n" for row in rows))
    if all("time_s" in frame for frame in frames):
        written.append(base / "times.txt")
        write_text(written[1], "".join(f"{frame['time_s']:.6e}\n" for frame in frames))
    return written


def _numbers(array: NDArray[np.float64]) -> str:
    return " ".join(f"{x:.12e}" for x in np.ravel(array))


def kitti_line(label: dict[str, Any]) -> str:
    """Type, truncation, occlusion in classes, alpha, box, height, width, length, location, rotation_y."""
    x, y, z = label["camera_location_m"]
    length, width, height = label["camera_size_m"]
    turn = label["rotation_y"]
    alpha = math.remainder(turn - math.atan2(x, z), 2.0 * math.pi)
    hidden = 0 if label["occlusion"] < 0.1 else 1 if label["occlusion"] < 0.5 else 2
    numbers = [alpha, *label["box"], height, width, length, x, y, z, turn]
    name = label["category"].title().replace("_", "")
    return " ".join([name, f"{label['truncation']:.2f}", str(hidden), *(f"{number:.2f}" for number in numbers)])
