"""A sheet of pictures with their boxes."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from aoro_gym.sensors.dataset.formats import Frame, name_of
from aoro_gym.sensors.dataset.labels import CATEGORIES

COLOURS = ("#ff9f1c", "#2ec4b6", "#e71d36", "#ffee00", "#b388ff", "#4da3ff")
"""Of the categories, in their order."""
COLUMNS = 3


def draw_sheet(folder: Path, frames: Sequence[Frame]) -> Any:
    """A PIL image: three pictures a row, boxes of all but crowns by category."""
    from PIL import Image, ImageDraw

    width, height = frames[0]["width"], frames[0]["height"]
    rows = -(-len(frames) // COLUMNS)
    sheet = Image.new("RGB", (COLUMNS * width, rows * height), "white")
    for place, frame in enumerate(frames):
        with Image.open(folder / "images" / frame["split"] / f"{name_of(frame)}.png") as picture:
            shown = picture.convert("RGB")
        draw = ImageDraw.Draw(shown)
        for label in frame["labels"]:
            if label["category"] != "crown":
                x0, y0, x1, y1 = label["box"]
                draw.rectangle((x0, y0, x1 - 1, y1 - 1), outline=COLOURS[CATEGORIES.index(label["category"])])
        sheet.paste(shown, (place % COLUMNS * width, place // COLUMNS * height))
    return sheet
