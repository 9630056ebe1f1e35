"""Labels in the files that others read: COCO, YOLO and KITTI."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from aoro_gym.execution.files import write_bytes, write_json, write_text
from aoro_gym.sensors.camera import CameraModel
from aoro_gym.sensors.dataset.labels import CATEGORIES, Label

FORMATS = ("coco", "yolo", "kitti")
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
        "area": int(label.mask.sum()),
        "runs": run_lengths(label.mask),
    }


def name_of(frame: Frame) -> str:
    """Of a picture's files, without suffix."""
    return f"{frame['number']:06d}"


def write_coco(folder: Path, frames: Sequence[Frame]) -> list[Path]:
    """``annotations/instances_SPLIT.json``; boxes are of what is seen, the full ones are a field more."""
    written = []
    for split in sorted({frame["split"] for frame in frames}):
        chosen = [frame for frame in frames if frame["split"] == split]
        images, annotations = [], []
        for frame in chosen:
            size = [frame["height"], frame["width"]]
            file = f"{split}/{name_of(frame)}.png"
            images.append({"id": frame["number"], "file_name": file, "height": size[0], "width": size[1]})
            for label in frame["labels"]:
                (x0, y0, x1, y1), (u0, v0, u1, v1) = label["box"], label["full_box"]
                annotations.append(
                    {
                        "id": len(annotations) + 1,
                        "image_id": frame["number"],
                        "category_id": CATEGORIES.index(label["category"]) + 1,
                        "bbox": [x0, y0, x1 - x0, y1 - y0],
                        "full_bbox": [u0, v0, u1 - u0, v1 - v0],
                        "area": label["area"],
                        "iscrowd": 0,
                        "segmentation": {"size": size, "counts": label["runs"]},
                        "truncation": label["truncation"],
                        "occlusion": label["occlusion"],
                        "instance": label["instance"],
                    }
                )
        categories = [{"id": number, "name": name} for number, name in enumerate(CATEGORIES, start=1)]
        written.append(folder / "annotations" / f"instances_{split}.json")
        write_json(written[-1], {"images": images, "annotations": annotations, "categories": categories})
    return written


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
    """``kitti/SPLIT/label_2``, ``calib`` and ``image_2``, as the object benchmark has them; lenses without distortion."""
    if any(model.intrinsics.distortion):
        raise ValueError(
            f"camera model {model.name} has a distortion, which KITTI's files cannot hold; take another one"
        )
    camera = np.column_stack([model.intrinsics.matrix, np.zeros(3)])
    right = camera.copy()
    right[0, 3] = -model.intrinsics.focal[0] * model.baseline
    written = []
    for frame in frames:
        base = folder / "kitti" / frame["split"]
        lines = [_kitti_line(label) for label in frame["labels"]]
        written += [base / kind / f"{name_of(frame)}.txt" for kind in ("label_2", "calib")]
        write_text(written[-2], "".join(line + "\n" for line in lines))
        numbers = {"P0": camera, "P1": right, "P2": camera, "P3": right, "R0_rect": np.eye(3)}
        numbers |= {"Tr_velo_to_cam": np.eye(3, 4), "Tr_imu_to_velo": np.eye(3, 4)}
        text = "".join(f"{name}: {' '.join(f'{x:.12e}' for x in np.ravel(each))}\n" for name, each in numbers.items())
        write_text(written[-1], text)
        written.append(base / "image_2" / f"{name_of(frame)}.png")
        write_bytes(written[-1], (folder / "images" / frame["split"] / f"{name_of(frame)}.png").read_bytes())
    return written


def _kitti_line(label: dict[str, Any]) -> str:
    """Type, truncation, occlusion in classes, alpha, box, height, width, length, location, rotation_y."""
    x, y, z = label["location_m"]
    length, width, height = label["size_m"]
    turn = label["rotation_y"]
    alpha = math.remainder(turn - math.atan2(x, z), 2.0 * math.pi)
    hidden = 0 if label["occlusion"] < 0.1 else 1 if label["occlusion"] < 0.5 else 2
    numbers = [alpha, *label["box"], height, width, length, x, y, z, turn]
    name = label["category"].title().replace("_", "")
    return " ".join([name, f"{label['truncation']:.2f}", str(hidden), *(f"{number:.2f}" for number in numbers)])
