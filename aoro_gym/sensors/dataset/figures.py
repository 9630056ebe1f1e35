"""Sheets of pictures with their boxes, and with the points of a lidar."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from aoro_gym.sensors.camera import Intrinsics
from aoro_gym.sensors.dataset.formats import Frame, name_of
from aoro_gym.sensors.dataset.labels import CATEGORIES
from aoro_gym.sensors.dataset.sweeps import CLASSES, read_sweep

COLOURS = ("#ff9f1c", "#2ec4b6", "#e71d36", "#ffee00", "#b388ff", "#4da3ff", "#ffffff")
"""Of the categories, in their order."""
POINT_COLOURS = ("#888888", *COLOURS, "#7cb342", "#00e000", "#aaaaff")
"""Of the points' classes, in their order."""
COLUMNS = 3
NEAREST = 0.5
"""Depth [m] from which points are drawn."""


def draw_sheet(folder: Path, frames: Sequence[Frame]) -> Any:
    """A PIL image: three pictures a row, boxes of all but crowns by category."""
    from PIL import ImageDraw

    drawn = []
    for frame in frames:
        shown = _picture(folder, frame)
        draw = ImageDraw.Draw(shown)
        for label in frame["labels"]:
            if label["category"] != "crown":
                x0, y0, x1, y1 = label["box"]
                draw.rectangle((x0, y0, x1 - 1, y1 - 1), outline=COLOURS[CATEGORIES.index(label["category"])])
        drawn.append(shown)
    return _sheet(drawn)


def draw_points(folder: Path, frames: Sequence[Frame], lens: Intrinsics) -> Any:
    """A PIL image: three pictures a row, twice as large, with the points of their sweeps by class."""
    from PIL import ImageColor

    colours = np.array([ImageColor.getrgb(colour) for colour in POINT_COLOURS], dtype=np.uint8)
    assert len(colours) == len(CLASSES)
    drawn = []
    for frame in frames:
        picture = _picture(folder, frame)
        shown = np.array(picture.resize((2 * picture.width, 2 * picture.height)))
        rows, label = read_sweep(folder / "velodyne" / frame["split"] / f"{name_of(frame)}.bin")
        to_camera = np.linalg.inv(np.array(frame["camera_to_machine"])) @ np.array(frame["lidar_to_machine"])
        own = rows[:, :3] @ to_camera[:3, :3].T + to_camera[:3, 3]
        ahead = own[:, 2] > NEAREST
        column, row = np.rint(2.0 * (lens.project(own[ahead]) + 0.5)).astype(int).T
        inside = (row >= 0) & (row < shown.shape[0]) & (column >= 0) & (column < shown.shape[1] - 1)
        for aside in (0, 1):
            shown[row[inside], column[inside] + aside] = colours[label[ahead][inside] & 0xFFFF]
        drawn.append(shown)
    return _sheet(drawn)


def _picture(folder: Path, frame: Frame) -> Any:
    from PIL import Image

    with Image.open(folder / "images" / frame["split"] / f"{name_of(frame)}.png") as picture:
        return picture.convert("RGB")


def _sheet(pictures: Sequence[Any]) -> Any:
    """Pictures of one size, three a row."""
    from PIL import Image

    height, width = np.array(pictures[0]).shape[:2]
    rows = -(-len(pictures) // COLUMNS)
    sheet = Image.new("RGB", (COLUMNS * width, rows * height), "white")
    for place, picture in enumerate(pictures):
        sheet.paste(Image.fromarray(np.asarray(picture)), (place % COLUMNS * width, place // COLUMNS * height))
    return sheet
