"""A contact sheet of what a stereo camera saw and what is true of it, and arrays and calibrations as files."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from aoro_gym.reporting.style import INK, SOFT
from aoro_gym.sensors.camera.models import CameraModel
from aoro_gym.sensors.camera.picture import LAYERS, NOTHING, UNDERGROWTH, Picture, Stereo

if TYPE_CHECKING:
    from matplotlib.figure import Figure

FAR = 40.0
"""Depth [m] at which its colours end."""
STILL = 0.5
"""Flow [pixels] that is drawn in full colour at least, so that what a still camera's float32 leaves is white."""


def draw_outputs(pair: Stereo, *, title: str) -> Figure:
    """Nine panels: both pictures, and of the left one all that is true; ``savefig`` writes it."""
    from matplotlib.figure import Figure

    left = pair.left
    height, width = left.depth.shape
    figure = Figure(figsize=(12.0, 3.0 * 4.0 * height / width + 0.9), layout="constrained")
    figure.suptitle(title, color=INK, fontsize=11)
    shown = {
        "left": left.rgb,
        "right": pair.right.rgb,
        "sun or shadow": np.where(left.sunlit, 255, np.where(left.instance == NOTHING, 160, 60)).astype(np.uint8),
        f"depth, to {FAR:.0f} m": np.minimum(left.depth, FAR),
        "disparity": np.minimum(left.disparity, np.quantile(left.disparity, 0.98)),
        "normals": np.where(left.normals.any(axis=-1, keepdims=True), 0.5 - 0.5 * left.normals, 1.0),
        "instance": coloured(left.instance),
        "class": coloured(left.class_id.astype(np.int64)),
        "flow, by direction and size": drawn_flow(left.flow),
    }
    for axes, (name, image) in zip(figure.subplots(3, 3).ravel(), shown.items(), strict=True):
        colours = "viridis_r" if name.startswith("depth") else "gray" if image.dtype == np.uint8 else "viridis"
        axes.imshow(image, cmap=colours, interpolation="nearest")
        axes.set_title(name, loc="left", fontsize=9, color=SOFT)
        axes.set_axis_off()
    return figure


def coloured(labels: NDArray[Any]) -> NDArray[np.float64]:
    """(H, W, 3) colours of whole numbers, the same for the same number: hues by the golden ratio."""
    from matplotlib.colors import hsv_to_rgb

    number = labels.astype(np.int64)
    hue = (number * 0.61803399) % 1.0
    value = 0.55 + 0.4 * ((number * 0.41421356) % 1.0)
    colours = hsv_to_rgb(np.stack([hue, np.full(hue.shape, 0.65), value], axis=-1))
    colours[number == 0] = 0.35
    colours[(number == NOTHING) | (number == 255)] = 1.0
    colours[number == UNDERGROWTH] = (0.2, 0.45, 0.2)
    return colours


def drawn_flow(flow: NDArray[Any]) -> NDArray[np.float64]:
    """(H, W, 3) hue by direction, saturation by size; white where there is none."""
    from matplotlib.colors import hsv_to_rgb

    size = np.linalg.norm(flow, axis=-1)
    known = np.isfinite(size)
    most = float(np.quantile(size[known], 0.98)) if known.any() else 0.0
    hue = np.where(known, np.arctan2(flow[..., 1], flow[..., 0]) / (2.0 * np.pi) % 1.0, 0.0)
    share = np.where(known, np.clip(size / max(most, STILL), 0.0, 1.0), 0.0)
    return hsv_to_rgb(np.stack([hue, share, np.where(known, 0.95, 1.0)], axis=-1))


def save_picture(picture: Picture, path: Path) -> Path:
    """The colours as PNG at ``path``, and all else beside it as ``.npz``, which is returned."""
    from PIL import Image

    Image.fromarray(picture.rgb).save(path)
    arrays = path.with_suffix(".npz")
    layers = {name: getattr(picture, name) for name in (*LAYERS, "numbers")}
    np.savez_compressed(arrays, exposure=picture.exposure, time=picture.time, **layers)
    return arrays


def calibration(model: CameraModel) -> dict[str, Any]:
    """Intrinsics of both cameras and the pose of the right one, as OpenCV's functions take them."""
    lens = model.intrinsics
    return {
        "width": lens.width,
        "height": lens.height,
        "matrix": lens.matrix.tolist(),
        "distortion": list(lens.distortion),
        "baseline_m": model.baseline,
        "right_from_left": {"rotation": np.eye(3).tolist(), "translation_m": [-model.baseline, 0.0, 0.0]},
        "line_time_s": model.line_time,
        "pictures_per_s": model.rate,
    }
