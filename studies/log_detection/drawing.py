"""Sheets of pictures with boxes: what is there, and what a detector tells."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from aoro_gym.reporting.style import AMBER, BLUE, GREEN, RED
from studies.log_detection.pictures import Pictures

COLOURS = (AMBER, RED, "#ffee00", BLUE, GREEN)
"""Of the classes, in their order."""
SHOWN = 0.3
"""Least score of a box that is drawn."""
DRAWN = 384
"""Width [pixels] of a picture of a sheet, or twice that of a canvas that is half as wide."""


def enlarged(canvas: tuple[int, int]) -> int:
    """Pixels of a sheet for one of a canvas."""
    return max(DRAWN // canvas[1], 1)


def drawn(
    pixels: NDArray[np.uint8], boxes: NDArray[Any], labels: NDArray[Any], scores: NDArray[Any] | None = None
) -> Any:
    """A PIL image of a picture (H, W, 3) with boxes (K, 4) of classes (K,), with their scores (K,) if there are any."""
    from PIL import Image, ImageDraw

    times = enlarged(pixels.shape[:2])
    out = Image.fromarray(pixels).resize((times * pixels.shape[1], times * pixels.shape[0]), Image.Resampling.NEAREST)
    draw = ImageDraw.Draw(out)
    for number, (box, label) in enumerate(zip(boxes.tolist(), labels.tolist(), strict=True)):
        x0, y0, x1, y1 = (times * edge for edge in box)
        colour = COLOURS[int(label) % len(COLOURS)]
        draw.rectangle((x0, y0, max(x1 - 1.0, x0), max(y1 - 1.0, y0)), outline=colour)
        if scores is not None:
            draw.text((x0 + 1.0, max(y0 - 10.0, 0.0)), f"{scores[number]:.2f}".lstrip("0"), fill=colour)
    return out


def sheet(pictures: Pictures, found: Sequence[NDArray[np.float32]], chosen: Sequence[int], columns: int = 3) -> Any:
    """A PIL image: of each chosen picture, above what is there, below what a detector told (:func:`.detector.detect`)."""
    from PIL import Image

    height, width = (enlarged(pictures.canvas) * edge for edge in pictures.canvas)
    rows = -(-len(chosen) // columns)
    out = Image.new("RGB", (columns * width, rows * (2 * height + 8)), "white")
    for place, number in enumerate(chosen):
        told = found[number][found[number][:, 4] >= SHOWN]
        x, y = place % columns * width, place // columns * (2 * height + 8)
        out.paste(drawn(pictures.pixels[number], pictures.boxes[number], pictures.labels[number]), (x, y))
        out.paste(drawn(pictures.pixels[number], told[:, :4], told[:, 5], told[:, 4]), (x, y + height))
    return out
