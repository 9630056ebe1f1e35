"""Command that makes data sets of pictures."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

from aoro_gym.cli import options
from aoro_gym.cli.options import option
from aoro_gym.cli.outcome import checking_input, conclude, resumable, running
from aoro_gym.reporting import terminal

OutOption = Annotated[Path, option("--out -o", "FOLDER", "Folder to write to; one that was interrupted goes on.")]
FramesOption = Annotated[int, option("--frames", "N", "Pairs of pictures.")]
WorldsOption = Annotated[int, option("--worlds", "N", "Forests that they are of, 3 at least.")]
FormatOption = Annotated[
    list[str] | None, option("--format", "NAME", "coco, yolo or kitti. Repeatable. Default: coco.")
]
ModelOption = Annotated[str, option("--model", "NAME", "stereo, stereo-wide, stereo-rolling or stereo-hd.")]
WidthOption = Annotated[int, option("--width", "PIXELS", "Of a picture.")]
SamplesOption = Annotated[int, option("--samples", "N", "Rays a pixel.")]
LeftOnlyOption = Annotated[bool, option("--left-only", None, "No right pictures: little more than half the time.")]
FixedOption = Annotated[
    bool,
    option("--fixed", None, "Nothing is drawn but forest and place: one light, season, weather and so on for all."),
]
FixOption = Annotated[
    list[str] | None,
    option("--fix", "NAME", "light, weather, season, stand, clutter, texture or pose stays the same. Repeatable."),
]
NearOption = Annotated[
    str | None, option("--near", "NAME", "Put every camera before a log, stump or boulder; they are rare elsewhere.")
]


def dataset(
    out: OutOption = Path("dataset"),
    frames: FramesOption = 30,
    worlds: WorldsOption = 5,
    formats: FormatOption = None,
    model: ModelOption = "stereo",
    width: WidthOption = 320,
    samples: SamplesOption = 4,
    left_only: LeftOnlyOption = False,
    fixed: FixedOption = False,
    fix: FixOption = None,
    near: NearOption = None,
    seed: options.SeedOption = 0,
    device: options.DeviceOption = "cpu",
    json_to: options.JsonOption = None,
    quiet: options.QuietOption = False,
) -> None:
    """Make pictures of forests with boxes, masks, depth and poses, to train detectors on.

    Forests are made by seeds from --seed on, a fifth of them to validate, a fifth to test, the rest to train. A camera
    stands at free places in them, or --near objects; light, weather, season, stand, clutter, texture and its pose are drawn
    anew, but what --fix names.

    Writes into FOLDER pictures (images, right), depth and instances, what was drawn and labelled of each (frames), the files
    of the formats, a sheet to look at (sheet.png), a card (README.md) and hashes (manifest.json).

    [bold]Examples[/]

      aoro-gym dataset --frames 20
      aoro-gym dataset --frames 500 --worlds 50 --format coco --format yolo --out logs
      aoro-gym dataset --frames 200 --worlds 40 --near log --fix weather --out no_rain
      aoro-gym dataset --format kitti --width 640 --device cuda:0 --out kitti
    """
    with checking_input():
        from aoro_gym.checks import check_choice
        from aoro_gym.sensors.dataset import FACTORS, DatasetSettings, make

        options.check_seed(seed)
        options.check_device(device, simd=False)
        options.check_folder(out, "settings.json")
        for name in fix or ():
            check_choice("--fix", name, FACTORS)
        settings = DatasetSettings(
            frames=frames,
            worlds=worlds,
            seed=seed,
            model=model,
            width=width,
            samples=samples,
            formats=tuple(dict.fromkeys(formats or ["coco"])),
            left_only=left_only,
            fixed=FACTORS if fixed else tuple(name for name in FACTORS if name in (fix or ())),
            near=near,
        )
        with running(), resumable():
            doing = "rendering"
            with terminal.progress(doing) as tell:
                written = make(out, settings, device=device, progress=lambda share: tell(doing, share))
    found = _summary(out)
    conclude(found, [_line(found)], written, json_to=json_to, highlight=False)


def _summary(out: Path) -> dict[str, Any]:
    """Pictures and labels by split."""
    import json
    from collections import Counter

    frames = [json.loads(path.read_text(encoding="utf-8")) for path in sorted((out / "frames").glob("*.json"))]
    return {
        split: {
            "pictures": sum(frame["split"] == split for frame in frames),
            **Counter(label["category"] for frame in frames if frame["split"] == split for label in frame["labels"]),
        }
        for split in dict.fromkeys(frame["split"] for frame in frames)
    }


def _line(found: dict[str, Any]) -> str:
    return "\n".join(
        f"{split}: " + ", ".join(f"{n} {name}" for name, n in each.items()) for split, each in found.items()
    )
