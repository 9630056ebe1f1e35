"""A lidar's sweep beside each picture, in KITTI's layout and SemanticKITTI's labels.

Points are in the lidar's axes at the middle of the picture's exposure, as if the machine had stood still since: by the true
motion, so that ``Tr_velo_to_cam`` leads every point to where the picture shows it, up to what lies between both sensors.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from aoro_gym.execution.files import write_bytes
from aoro_gym.sensors.dataset.labels import CATEGORIES, Shapes, part_categories
from aoro_gym.sensors.lidar import Points
from aoro_gym.sensors.lidar.device import PRECIPITATION, UNDERGROWTH

CLASSES: Mapping[str, int] = {
    "none": 0,
    **{name: number for number, name in enumerate(CATEGORIES, start=1)},
    "ground": len(CATEGORIES) + 1,
    "undergrowth": len(CATEGORIES) + 2,
    "precipitation": len(CATEGORIES) + 3,
}
"""Of points, in the lower half of a label; the upper one is the instance."""


def write_sweep(folder: Path, split: str, name: str, points: Points, pose: NDArray[np.float64], shapes: Shapes) -> None:
    """``velodyne/SPLIT/NAME.bin`` (K, 4) float32 x, y, z [m], reflectance; ``velodyne_labels/SPLIT/NAME.label`` (K,) uint32.

    Args:
        folder: Of the data set.
        split: Of the picture.
        name: Of its files.
        points: As they were swept.
        pose: (4, 4) from the lidar's axes to the world's in the middle of the picture's exposure.
        shapes: Of what stands in the world.
    """
    own = (points.world.astype(np.float64) - pose[:3, 3]) @ pose[:3, :3]
    rows = np.column_stack([own, np.clip(points.reflectance, 0.0, 1.0)]).astype("<f4")
    write_bytes(folder / "velodyne" / split / f"{name}.bin", rows.tobytes())
    label = point_classes(points, shapes).astype(np.uint32) | (np.maximum(points.instance, 0).astype(np.uint32) << 16)
    write_bytes(folder / "velodyne_labels" / split / f"{name}.label", label.astype("<u4").tobytes())


def point_classes(points: Points, shapes: Shapes) -> NDArray[np.int64]:
    """(K,) number in :data:`CLASSES` of every point."""
    out = 1 + part_categories(points.instance, points.class_id, points.world.astype(np.float64), shapes)
    for name, instance in (("ground", 0), ("undergrowth", UNDERGROWTH), ("precipitation", PRECIPITATION)):
        out[points.instance == instance] = CLASSES[name]
    return out


def read_sweep(file: Path) -> tuple[NDArray[np.float32], NDArray[np.uint32]]:
    """Points (K, 4) of a ``.bin``, and their labels (K,) of the ``.label`` that belongs to it."""
    label: Any = file.parents[2] / "velodyne_labels" / file.parent.name / f"{file.stem}.label"
    return np.fromfile(file, dtype="<f4").reshape(-1, 4), np.fromfile(label, dtype="<u4")
