"""Pictures with boxes from files of COCO, all on one canvas."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from aoro_gym.execution.files import written_whole

CANVAS = (144, 192)
"""Height and width [pixels] that pictures are shrunk into where nothing else is said: a camera's 3 to 4."""
GREY = 114
"""What fills the canvas beside a picture of another shape."""
CLASSES = ("trunk", "log", "log_end", "stump")
"""What the study's detectors look for; crowns and boulders are background."""
LEAST_AREA, MOST_HIDDEN = 30.0 / (144 * 192), 0.8
"""An object that is seen in a smaller share of the canvas, or of which a larger share is hidden (where the file says so), is
learnt, but counts neither way in a score: who labels by hand leaves such out."""


@dataclass(frozen=True, eq=False)
class Pictures:
    """Pictures of one COCO file."""

    pixels: NDArray[np.uint8]
    """(N, H, W, 3) on the canvas."""
    boxes: list[NDArray[np.float32]]
    """Of each (K, 4) left, upper, right and lower edges [pixels of the canvas]."""
    labels: list[NDArray[np.int64]]
    """Of each (K,) places of the classes in ``classes``."""
    scales: NDArray[np.float64]
    """(N,) pixels of the canvas over those of the file."""
    ids: list[int]
    """Of the pictures in the file."""
    truth: dict[str, Any]
    """What the file holds, but only of these classes and pictures, numbered as in ``classes`` from 1; what does not count is
    ``iscrowd``, as COCO has it."""
    classes: tuple[str, ...] = CLASSES

    def __len__(self) -> int:
        return len(self.pixels)

    @property
    def canvas(self) -> tuple[int, int]:
        """Height and width [pixels]."""
        return self.pixels.shape[1], self.pixels.shape[2]

    def first(self, count: int) -> Pictures:
        """The first of them."""
        kept = set(self.ids[:count])
        truth = dict(self.truth)
        truth["images"] = [one for one in truth["images"] if one["id"] in kept]
        truth["annotations"] = [one for one in truth["annotations"] if one["image_id"] in kept]
        return Pictures(
            self.pixels[:count],
            self.boxes[:count],
            self.labels[:count],
            self.scales[:count],
            self.ids[:count],
            truth,
            self.classes,
        )


def load(
    annotations: Path,
    images: Path,
    classes: Sequence[str] = CLASSES,
    *,
    renamed: Mapping[str, str] | None = None,
    canvas: tuple[int, int] = CANVAS,
    kept: Path | None = None,
) -> Pictures:
    """Pictures of a COCO file in the order of their numbers.

    Args:
        annotations: The file, .json.
        images: Folder that its ``file_name`` are in.
        classes: To look for, by name; other ones are left out.
        renamed: Name in the file by name of a class, where they differ.
        canvas: Height and width [pixels].
        kept: As of :func:`of_coco`.

    Raises:
        ValueError: The file lacks a class, a picture is not there, or the file holds no COCO.
    """
    told = json.loads(annotations.read_text(encoding="utf-8"))
    if not all(isinstance(told, dict) and name in told for name in ("images", "annotations", "categories")):
        raise ValueError(f"{annotations} has no images, annotations and categories: it is no file of COCO")
    numbers = {one["name"]: one["id"] for one in told["categories"]}
    wanted = {name: (renamed or {}).get(name, name) for name in classes}
    found = {numbers[theirs]: place for place, theirs in enumerate(wanted.values()) if theirs in numbers}
    if not found:
        raise ValueError(
            f"{annotations} has none of the classes {', '.join(wanted.values())}, but {', '.join(numbers)};"
            " give --name log=NAME for the names that differ"
        )
    return of_coco(told, images, found, classes, canvas, kept)


def of_coco(
    told: Mapping[str, Any],
    images: Path,
    found: Mapping[int, int],
    classes: Sequence[str] = CLASSES,
    canvas: tuple[int, int] = CANVAS,
    kept: Path | None = None,
) -> Pictures:
    """Pictures of the content of a COCO file.

    Args:
        told: The content.
        images: Folder that its ``file_name`` are in.
        found: Places of classes by their number in the file.
        classes: By name.
        canvas: Height and width [pixels].
        kept: A file, ``.npy``, to write the pixels to, and to read them from as long as no picture is newer: processes that
            read it share its memory. None: pictures are read each time.
    """
    listed = sorted(told["images"], key=lambda one: one["id"])
    of_image: dict[int, list[dict[str, Any]]] = {one["id"]: [] for one in listed}
    for one in told["annotations"]:
        if one["category_id"] in found and one["image_id"] in of_image:
            of_image[one["image_id"]].append({**one, "category_id": found[one["category_id"]] + 1})
    files = [images / one["file_name"] for one in listed]
    scales = [_scale(one, canvas) for one in files]
    pixels = _stacked(files, canvas) if kept is None else shared(files, canvas, kept)
    least = LEAST_AREA * canvas[0] * canvas[1]
    boxes, labels = [], []
    for one, scale in zip(listed, scales, strict=True):
        solid = [each for each in of_image[one["id"]] if not each.get("iscrowd")]
        for each in solid:
            area = each.get("area", each["bbox"][2] * each["bbox"][3]) * scale**2
            each["iscrowd"] = int(area < least or each.get("occlusion", 0.0) > MOST_HIDDEN)
        corners = np.array([each["bbox"] for each in solid], dtype=np.float32).reshape(-1, 4) * scale
        corners[:, 2:] += corners[:, :2]
        boxes.append(corners)
        labels.append(np.array([each["category_id"] - 1 for each in solid], dtype=np.int64))
    truth = {
        "images": listed,
        "annotations": [each for one in listed for each in of_image[one["id"]]],
        "categories": [
            {"id": place + 1, "name": name} for place, name in enumerate(classes) if place in found.values()
        ],
    }
    ids = [one["id"] for one in listed]
    return Pictures(pixels, boxes, labels, np.array(scales), ids, truth, tuple(classes))


def shared(files: Sequence[Path], canvas: tuple[int, int], kept: Path) -> NDArray[np.uint8]:
    """(N, H, W, 3) pictures on the canvas from the file ``kept``, which is written anew where a picture is newer."""
    newest = max(file.stat().st_mtime_ns for file in files)
    if not kept.exists() or kept.stat().st_mtime_ns < newest or len(np.load(kept, mmap_mode="r")) != len(files):
        with written_whole(kept) as temporary:
            np.save(temporary, _stacked(files, canvas))
    return np.load(kept, mmap_mode="c")  # writable, as torch wants it: what is not written is shared


def _stacked(files: Sequence[Path], canvas: tuple[int, int]) -> NDArray[np.uint8]:
    with ThreadPoolExecutor(4) as pool:
        return np.stack(list(pool.map(lambda file: _read(file, canvas), files)))


def _scale(path: Path, canvas: tuple[int, int]) -> float:
    """Pixels of the canvas over those of a picture."""
    from PIL import Image

    if not path.exists():
        raise ValueError(f"there is no picture {path}; give the folder of the pictures as --images")
    with Image.open(path) as opened:
        return min(canvas[1] / opened.width, canvas[0] / opened.height)


def _read(path: Path, canvas: tuple[int, int]) -> NDArray[np.uint8]:
    """A picture on the canvas."""
    from PIL import Image

    height, width = canvas
    with Image.open(path) as opened:
        picture = opened.convert("RGB")
    scale = min(width / picture.width, height / picture.height)
    size = max(round(picture.width * scale), 1), max(round(picture.height * scale), 1)
    out = np.full((height, width, 3), GREY, dtype=np.uint8)
    out[: size[1], : size[0]] = np.asarray(picture if scale == 1.0 else picture.resize(size, Image.Resampling.BOX))
    return out


def joined(parts: Sequence[Pictures]) -> Pictures:
    """Pictures of several files, numbered anew from 0 on, in their order."""
    images: list[dict[str, Any]] = []
    annotations: list[dict[str, Any]] = []
    for part in parts:
        numbers = {number: len(images) + at for at, number in enumerate(part.ids)}
        images += [{**one, "id": numbers[one["id"]]} for one in part.truth["images"]]
        annotations += [{**one, "image_id": numbers[one["image_id"]]} for one in part.truth["annotations"]]
    return Pictures(
        np.concatenate([part.pixels for part in parts]),
        [box for part in parts for box in part.boxes],
        [label for part in parts for label in part.labels],
        np.concatenate([part.scales for part in parts]),
        list(range(len(images))),
        {**parts[0].truth, "images": images, "annotations": annotations},
        parts[0].classes,
    )
