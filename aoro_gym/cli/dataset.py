"""Command that makes data sets of pictures."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from aoro_gym.cli import options
from aoro_gym.cli.options import option
from aoro_gym.cli.outcome import checking_input, conclude, resumable, running
from aoro_gym.cli.place import TrackOption, check_one_ground, check_track, load_ground, load_line
from aoro_gym.reporting import terminal

if TYPE_CHECKING:
    from aoro_gym.sensors.dataset import DatasetSettings
    from aoro_gym.terrains import Path as Line
    from aoro_gym.terrains.world.world import World

OutOption = Annotated[Path, option("--out -o", "FOLDER", "Folder to write to; one that was interrupted goes on.")]
FramesOption = Annotated[int, option("--frames", "N", "Pairs of pictures.")]
WorldsOption = Annotated[
    int | None, option("--worlds", "N", "Made forests that they are of, 3 at least. Default: 5.", show_default=False)
]
TerrainOption = Annotated[
    Path | None, option("--terrain", "FILE", "Bare ground of 'aoro-gym terrain' instead of made forests.")
]
WorldOption = Annotated[Path | None, option("--world", "FOLDER", "World of 'aoro-gym world' instead of made forests.")]
PathOption = Annotated[
    Path | None, option("--path", "FILE", "Path over --terrain or --world, along which the machine drives.")
]
DriveOption = Annotated[
    bool, option("--drive", None, "The machine drives, without --path along one that is planned in each world.")
]
SplitOption = Annotated[str, option("--split", "NAME", "Of --terrain or --world: train, val or test.")]
SensorOption = Annotated[
    list[str] | None, option("--sensor", "NAME", "stereo, or stereo,lidar. Repeatable. Default: stereo.")
]
LidarOption = Annotated[str, option("--lidar", "NAME", "Model: os1-64, os1-128, vlp-16 or mid-360.")]
MachinesOption = Annotated[int, option("--machines", "N", "Other machines that stand in each world.")]
CranesOption = Annotated[
    bool, option("--cranes", None, "Their cranes are unfolded, every other one with a log in its grapple.")
]
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
    str | None,
    option("--near", "NAME", "Put every camera before a log, stump, boulder or machine; they are rare elsewhere."),
]
ProcessesOption = Annotated[
    int | None,
    option(
        "--processes",
        "N",
        "That take pictures at once; the result is the same. Default: one a device.",
        show_default=False,
    ),
]


def dataset(
    out: OutOption = Path("dataset"),
    frames: FramesOption = 30,
    worlds: WorldsOption = None,
    terrain: TerrainOption = None,
    world: WorldOption = None,
    path: PathOption = None,
    track: TrackOption = None,
    drive: DriveOption = False,
    split: SplitOption = "train",
    sensor: SensorOption = None,
    lidar: LidarOption = "os1-64",
    machines: MachinesOption = 0,
    cranes: CranesOption = False,
    formats: FormatOption = None,
    model: ModelOption = "stereo",
    width: WidthOption = 320,
    samples: SamplesOption = 4,
    left_only: LeftOnlyOption = False,
    fixed: FixedOption = False,
    fix: FixOption = None,
    near: NearOption = None,
    seed: options.SeedOption = 0,
    processes: ProcessesOption = None,
    device: options.DevicesOption = "cpu",
    json_to: options.JsonOption = None,
    quiet: options.QuietOption = False,
) -> None:
    """Make pictures of forests with boxes, masks, depth and poses, to train detectors on.

    Forests are made by seeds from --seed on, a fifth of them to validate, a fifth to test, the rest to train; or there is
    one --world or --terrain. A camera stands at free places, or --near objects, or looks from a machine that drives
    (--drive, --path), the twin steered by pure pursuit. Light, weather, season, stand, clutter, texture and the camera's
    pose are drawn anew, but what --fix names.

    Writes into FOLDER pictures (images, right), depth and instances, sweeps of a lidar (velodyne), what was drawn and
    labelled of each (frames), the files of the formats, a sheet to look at (sheet.png), a card (README.md) and hashes
    (manifest.json).

    [bold]Examples[/]

      aoro-gym dataset --frames 20
      aoro-gym dataset --frames 500 --worlds 50 --format coco --format yolo --processes 4 --out logs
      aoro-gym dataset --frames 200 --worlds 40 --near log --fix weather --out no_rain
      aoro-gym dataset --drive --sensor stereo,lidar --format kitti --machines 2 --out drive
      aoro-gym dataset --machines 3 --cranes --near machine --out cranes
      aoro-gym dataset --world forest --path track.csv --format kitti --width 640 --device cuda:0 --out kitti
      aoro-gym dataset --frames 5000 --worlds 100 --device cuda:all --processes 8 --out many
    """
    with checking_input():
        from aoro_gym.sensors.dataset import DatasetSettings

        options.check_seed(seed)
        options.check_device(device, simd=False, several=True)
        options.check_folder(out, "settings.json")
        _check_place(terrain, world, path, track, worlds)
        settings = DatasetSettings(
            frames=frames, worlds=5 if worlds is None else worlds, seed=seed, model=model, width=width, samples=samples,
            formats=_listed(formats or ["coco"]), left_only=left_only, fixed=_fixed(fixed, _listed(fix or [])), near=near,
            sensors=_listed(sensor or ["stereo"]), lidar=lidar, machines=machines, cranes=cranes, split=split,
        )  # fmt: skip
        place = _place(terrain, world, path, track)
        drives = drive or path is not None
        with running(), resumable():
            written = _make(out, settings, place, drives=drives, device=device, processes=processes)
    found = _summary(out)
    conclude(found, [_line(found)], written, json_to=json_to, highlight=False)


def _make(
    out: Path,
    settings: DatasetSettings,
    place: tuple[World | None, Line | None],
    *,
    drives: bool,
    device: str,
    processes: int | None,
) -> list[Path]:
    """Make it under a progress bar."""
    from aoro_gym.agents.evaluation.pictured_drives import drive_along
    from aoro_gym.sensors.dataset import make

    doing = "driving and rendering" if drives else "rendering"
    with terminal.progress(doing) as tell:
        return make(
            out,
            settings,
            ground=place[0],
            path=place[1],
            driver=drive_along if drives else None,
            device=device,
            processes=processes,
            progress=lambda share: tell(doing, share),
        )


def _fixed(everything: bool, names: tuple[str, ...]) -> tuple[str, ...]:
    """What --fixed or --fix say, in its own order."""
    from aoro_gym.checks import check_choice
    from aoro_gym.sensors.dataset import FACTORS

    for name in names:
        check_choice("--fix", name, FACTORS)
    return FACTORS if everything else tuple(name for name in FACTORS if name in names)


def _listed(values: list[str]) -> tuple[str, ...]:
    """Values of an option that is repeatable and takes several with commas between, each once."""
    return tuple(dict.fromkeys(name for value in values for name in value.split(",")))


def _check_place(
    terrain: Path | None, world: Path | None, path: Path | None, track: str | None, worlds: int | None
) -> None:
    """ValueError for options of places that contradict each other."""
    check_one_ground(terrain, world)
    check_track(path, track)
    given = terrain or world
    if given is None and path is not None:
        raise ValueError(
            f"--path {path} leads over a ground; give it by --world or --terrain, or drop --path for --drive"
        )
    if given is not None and worlds is not None:
        raise ValueError(f"--worlds {worlds} makes forests, but {given} is the ground; drop one of them")


def _place(
    terrain: Path | None, folder: Path | None, path: Path | None, track: str | None
) -> tuple[World | None, Line | None]:
    """The ground that is given, and the path over it."""
    from aoro_gym.terrains import Terrain
    from aoro_gym.terrains.world.world import World

    if terrain is None and folder is None:
        return None, None
    loaded = load_ground(terrain, folder)
    ground = World(loaded, name=loaded.name) if isinstance(loaded, Terrain) else loaded
    assert isinstance(ground, World)
    return ground, None if path is None else load_line(path, track, ground.terrain)


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
