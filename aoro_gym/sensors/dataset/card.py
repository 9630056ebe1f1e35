"""The card of a data set: what it holds, how it was made, and what it is not good for."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

from aoro_gym.sensors.dataset.formats import Frame
from aoro_gym.sensors.dataset.labels import CATEGORIES
from aoro_gym.sensors.dataset.settings import FACTORS, DatasetSettings
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
    drawn = [name for name in FACTORS if name not in settings.fixed]
    anew = f"Drawn anew from picture to picture, or from forest to forest: {', '.join(drawn)}." if drawn else ""
    before = f"Every camera was put before a {settings.near}." if settings.near else ""
    still = f"The same in all pictures: {', '.join(settings.fixed)}." if settings.fixed else ""
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

{chr(10).join(filter(None, [anew, still, before]))}
No forest is in two splits.

- {folders}
- `depth/`: metres times 256 along the camera's axis, 16 bits, 0 where it is not known. `instances/`: numbers of objects.
- `frames/`: of each picture what was drawn, the camera's pose, and labels with masks, boxes of what is seen and of all,
  boxes in space, truncation and occlusion.
- `manifest.json`: SHA-256 of all files.

A mask is the pixels through whose middles a ray meets the object. Occlusion of crowns is rough. What the pictures lack
beside photographs is listed on the page of cameras: a detector that does well here may do worse in a forest.
"""
