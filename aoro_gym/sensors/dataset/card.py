"""The card of a data set: what it holds, how it was made, and what it is not good for."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

from aoro_gym.sensors.dataset.formats import Frame
from aoro_gym.sensors.dataset.labels import CATEGORIES
from aoro_gym.sensors.dataset.settings import FACTORS, DatasetSettings
from aoro_gym.sensors.dataset.sweeps import CLASSES
from aoro_gym.version import VERSION


def card(settings: DatasetSettings, frames: Sequence[Frame]) -> str:
    """Markdown."""
    splits = sorted({frame["split"] for frame in frames})
    counts = {
        split: Counter(label["category"] for frame in frames if frame["split"] == split for label in frame["labels"])
        for split in splits
    }
    pictures = Counter(frame["split"] for frame in frames)
    seeds = {split: sorted({f["world_seed"] for f in frames if f["split"] == split}) for split in splits}
    rows = [f"| {name} | " + " | ".join(str(counts[split][name]) for split in splits) + " |" for name in CATEGORIES]
    left = "pictures", "`images/`: pictures."
    both = (
        "pairs of pictures",
        "`images/`, `right/`: pictures of the left and the right camera. Labels are the left one's.",
    )
    things, folders = left if settings.left_only else both
    return f"""# Pictures of made forests that annotate themselves

Made by aoro-gym {VERSION}: {len(frames)} {things}, {settings.width} pixels wide, camera `{settings.model}`,
seed {settings.seed}. No photograph is in it, and nothing in it was labelled by hand.

| | {" | ".join(splits)} |
|---|{"---|" * len(splits)}
| pictures | {" | ".join(str(pictures[split]) for split in splits)} |
| seeds of forests | {" | ".join(", ".join(map(str, seeds[split])) for split in splits)} |
{chr(10).join(rows)}

{_drawn(settings, frames)}

- {folders}
- `depth/`: metres times 256 along the camera's axis, 16 bits, 0 where it is not known. `instances/`: numbers of objects.
- `frames/`: of each picture what was drawn, the camera's pose, and labels with masks, boxes of what is seen and of all,
  boxes in space, truncation and occlusion.
{_lidar(settings)}- `calibration.json`: intrinsics. `manifest.json`: SHA-256 of all files.

A mask is the pixels through whose middles a ray meets the object. Occlusion of crowns is rough. What the pictures lack
beside photographs is listed on the page of cameras: a detector that does well here may do worse in a forest.
"""


def _drawn(settings: DatasetSettings, frames: Sequence[Frame]) -> str:
    """What differs from picture to picture, and where the camera was."""
    drawn = [name for name in FACTORS if name not in settings.fixed]
    lines = [f"Drawn anew from picture to picture, or from forest to forest: {', '.join(drawn)}."] if drawn else []
    if settings.fixed:
        lines.append(f"The same in all pictures: {', '.join(settings.fixed)}.")
    if settings.near:
        lines.append(f"Every camera was put before a {settings.near}.")
    if frames and "time_s" in frames[0]:
        lines += [
            "A machine drove, steered along paths. Pictures are at equal distances of its way; those of a drive have one",
            "light, one weather and one pose of the camera on the machine, which is not in its own pictures.",
        ]
    else:
        lines.append("The camera stood still, as on a machine that stands.")
    if settings.machines:
        lines.append(f"Up to {settings.machines} other machines stand in each world.")
    if settings.cranes:
        lines.append(
            "Their cranes are unfolded where there is room; every other one holds a log, which is labelled as one."
        )
    return "\n".join([*lines, "No forest is in two splits."])


def _lidar(settings: DatasetSettings) -> str:
    if "lidar" not in settings.sensors:
        return ""
    classes = ", ".join(f"{number} {name}" for name, number in CLASSES.items())
    return f"""- `velodyne/`: a sweep of the lidar `{settings.lidar}` a picture: x, y, z [m] in its axes as the picture is
  taken, and reflectance, float32. `velodyne_labels/`: classes in the lower 16 bits of uint32, instances in the upper ones.
  Classes: {classes}.
"""
