"""Making a data set: which forests, places and lights its pictures are of, and their files, picture by picture.

A picture's own JSON file is written last, so a run that was interrupted goes on with the picture that has none. What is
drawn for a picture depends on the seed and the picture's number alone.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from aoro_gym.execution.files import read_json, write_json, write_text, written_whole
from aoro_gym.sensors.camera import CAMERA_MOUNTING, Appearance, Picture, StereoCamera, daylight
from aoro_gym.sensors.dataset.card import card
from aoro_gym.sensors.dataset.figures import draw_sheet
from aoro_gym.sensors.dataset.formats import Frame, described, name_of, write_coco, write_kitti, write_yolo
from aoro_gym.sensors.dataset.labels import Shapes, labels
from aoro_gym.sensors.dataset.settings import DatasetSettings
from aoro_gym.sensors.height_map import HeightMapSensor
from aoro_gym.sensors.lidar import CLEAR, Motion, Mounting, Weather
from aoro_gym.sensors.raytrace import Scene
from aoro_gym.terrains.generate.stand import STANDS
from aoro_gym.terrains.generate.world import world
from aoro_gym.terrains.world.objects import Object, matrix
from aoro_gym.terrains.world.places import free_place
from aoro_gym.terrains.world.world import World

HELD_OUT = 0.2
"""Share of the forests for ``val`` and for ``test`` each, one at least; the rest is ``train``."""
DEPTH_STEPS = 256.0
"""Steps a metre of a depth in its PNG, 0 where it is not known: KITTI's."""
AWAY = (4.5, 11.0)
"""Distances [m] from a machine's hinge to the object that its camera is put before."""
BRIGHTNESS, TINT = 0.25, 0.06
"""Standard deviations of the logarithms of a class's albedo, and of its red, green and blue, between pictures. (E)"""
ATTEMPTS = 20
"""Places that are drawn for a picture whose camera would be in a stem."""
SHEET = 12
"""Pictures of the sheet."""


def make(
    folder: Path, settings: DatasetSettings, *, device: str = "cpu", progress: Callable[[float], None] | None = None
) -> list[Path]:
    """Make a data set, or go on with one; returns the files that tell of all of it.

    Args:
        folder: Where to.
        settings: What of.
        device: Where rays are cast.
        progress: Told the share that is done.

    Raises:
        ValueError: the folder holds a data set of other settings, or the format cannot hold the camera's lens.
    """
    told = {**asdict(settings), "formats": list(settings.formats), "fixed": list(settings.fixed)}
    file = folder / "settings.json"
    if file.exists() and read_json(file) != told:
        raise ValueError(f"{folder} holds a data set of other settings, see {file}; name another folder")
    if "kitti" in settings.formats:
        write_kitti(folder, [], settings.camera)  # refuses a lens before anything is made
    write_json(file, told)
    frames: list[Frame] = []
    forest: _Forest | None = None
    for number in range(settings.frames):
        index = number * settings.worlds // settings.frames
        path = folder / "frames" / f"{number:06d}.json"
        if not path.exists():
            if forest is None or forest.index != index:
                forest = _Forest(settings, index, device)
            write_json(path, _taken(folder, settings, forest, number))
        frames.append(json.loads(path.read_text(encoding="utf-8")))
        if progress is not None:
            progress((number + 1) / settings.frames)
    return _assembled(folder, settings, frames)


class _Forest:
    """A forest with its scene."""

    def __init__(self, settings: DatasetSettings, index: int, device: str):
        self.index = index
        held_out = max(round(HELD_OUT * settings.worlds), 1)
        left = settings.worlds - 1 - index
        self.split = "test" if left < held_out else "val" if left < 2 * held_out else "train"
        rng = np.random.default_rng([settings.seed, index, 1])
        season, stand = str(rng.choice(["spring", "summer", "autumn", "winter"])), str(rng.choice(sorted(STANDS)))
        clutter = {"piles": float(rng.uniform(6.0, 25.0)), "stumps": float(rng.uniform(150.0, 600.0))}
        self.season = "summer" if "season" in settings.fixed else season
        self.stand = "mixed" if "stand" in settings.fixed else stand
        changes: dict[str, Any] = {} if "clutter" in settings.fixed else clutter
        size = (settings.size, settings.size)
        self.world: World = world(
            settings.seed + index, stand=self.stand, size=size, snow=self.season == "winter", **changes
        )
        self.scene = Scene.of_world(self.world, fine=True, device=device)
        self.shapes = Shapes(self.world)

    def appearance(self, drawn: dict[str, Any]) -> Appearance:
        """Its textures, of other albedos in each picture."""
        wet = 1.0 if drawn["weather"][0] == "rain" else 0.0
        made = Appearance.of_world(self.world, self.season, wetness=wet)
        if drawn["albedo_seed"] is None:
            return made
        rng = np.random.default_rng(drawn["albedo_seed"])
        brighter, tinted = rng.normal(0.0, BRIGHTNESS, (len(made.albedo), 1)), rng.normal(0.0, TINT, made.albedo.shape)
        return replace(made, albedo=np.clip(made.albedo * np.exp(brighter + tinted), 0.0, 1.0))

    def objects(self, near: str) -> list[Object]:
        """Those of a kind; ``ValueError`` where there is none."""
        found = [one for one in self.world.objects if one.kind.name.lower() == near]
        if not found:
            raise ValueError(f"{self.world.name} has no {near}; take larger forests, or no --near {near}")
        return found


def _taken(folder: Path, settings: DatasetSettings, forest: _Forest, number: int) -> Frame:
    """Take a picture and write its files; what is left for its JSON file."""
    for attempt in range(ATTEMPTS):
        drawn = _draw(settings, forest, number, attempt)
        camera, motion = _put(settings, forest, number, drawn)
        try:
            camera.check_outside(motion)
            break
        except ValueError:  # in a stem
            if attempt == ATTEMPTS - 1:
                raise
    pictures: Sequence[Picture] = camera.take_left(motion) if settings.left_only else camera.take(motion)[0]
    left = pictures[0]
    pose = pose_of(camera, motion)
    found = labels(left, forest.shapes, settings.camera.intrinsics, pose)
    frame: Frame = {
        "number": number,
        "split": forest.split,
        "width": left.depth.shape[1],
        "height": left.depth.shape[0],
        "world_seed": settings.seed + forest.index,
        "season": forest.season,
        "stand": forest.stand,
        "drawn": drawn,
        "camera_to_world": pose.tolist(),
        "labels": [described(label) for label in found],
    }
    _write_images(folder, frame, pictures)
    return frame


def _put(settings: DatasetSettings, forest: _Forest, number: int, drawn: dict[str, Any]) -> tuple[StereoCamera, Motion]:
    """The camera and where it stands."""
    kind, amount = drawn["weather"]
    camera = StereoCamera(
        forest.scene,
        forest.appearance(drawn),
        daylight(forest.season, hour=drawn["hour"], cloud=drawn["cloud"]),
        settings.camera,
        mounting=Mounting(position=drawn["position"], angles_deg=drawn["angles_deg"]),
        samples=settings.samples,
        weather=CLEAR if kind == "clear" else Weather.named(kind, amount, wavelength_nm=550.0),
        seed=settings.seed + number,
    )
    return camera, _standing(forest, drawn["at"], drawn["heading"])


def _draw(settings: DatasetSettings, forest: _Forest, number: int, attempt: int) -> dict[str, Any]:
    """Place, light and pose of a picture."""
    rng = np.random.default_rng([settings.seed, number, 2, attempt])
    out = _place(settings, forest, rng)
    hour, cloud = float(rng.uniform(9.0, 15.5)), float(rng.choice([0.0, 0.3, 1.0]))
    kind = str(rng.choice(["clear", "fog", "rain"], p=[0.7, 0.15, 0.15]))
    weather = [kind, {"clear": 0.0, "fog": float(rng.uniform(40.0, 300.0)), "rain": 10.0}[kind]]
    position = [float(x) for x in np.add(CAMERA_MOUNTING.position, rng.uniform(-0.2, 0.2, 3))]
    angles = [float(rng.uniform(-2.0, 2.0)), float(rng.uniform(2.0, 18.0)), float(rng.uniform(-5.0, 5.0))]
    albedo_seed = int(rng.integers(2**31))
    fixed = settings.fixed
    out |= {"hour": 10.0, "cloud": 0.0} if "light" in fixed else {"hour": hour, "cloud": cloud}
    out["weather"] = ["clear", 0.0] if "weather" in fixed else weather
    if out["weather"][0] != "clear":
        out["cloud"] = 1.0
    mounting = list(CAMERA_MOUNTING.position), list(CAMERA_MOUNTING.angles_deg)
    out["position"], out["angles_deg"] = mounting if "pose" in fixed else (position, angles)
    out["albedo_seed"] = None if "texture" in fixed else albedo_seed
    return out


def _place(settings: DatasetSettings, forest: _Forest, rng: np.random.Generator) -> dict[str, Any]:
    """Where the machine stands, and where it heads for: anywhere and free ahead, or before an object."""
    low, high = (bound[:2] for bound in forest.world.terrain.extent)
    if settings.near is None:
        place = free_place(forest.world, tuple(rng.uniform(low + 6.0, high - 6.0)), ahead=2.0)
        return {"at": [place.x, place.y], "heading": place.heading + float(rng.uniform(-0.5, 0.5))}
    found = forest.objects(settings.near)
    one = found[int(rng.integers(len(found)))]
    middle = np.add(one.position, 0.5 * getattr(one, "length", 0.0) * matrix(one.rotation)[:, 2])[:2]
    towards = float(rng.uniform(-np.pi, np.pi))
    wanted = middle - float(rng.uniform(*AWAY)) * np.array([np.cos(towards), np.sin(towards)])
    place = free_place(forest.world, tuple(np.clip(wanted, low + 4.0, high - 4.0)))
    ahead = middle - [place.x, place.y]
    heading = float(np.arctan2(ahead[1], ahead[0]) + rng.uniform(-0.4, 0.4))
    return {"at": [place.x, place.y], "heading": heading}


def _standing(forest: _Forest, at: Sequence[float], heading: float) -> Motion:
    """A machine that stands upright on the ground."""
    top = float(forest.scene.extent[1][2])
    below = HeightMapSensor(forest.scene, forward=(0.0, 0.0), left=(0.0, 0.0), above=1.0)
    height = top + float(below.measure([[*at, top]], [0.0])[0, 0, 0])
    return Motion.still([*at, height], yaw=heading)


def pose_of(camera: StereoCamera, motion: Motion) -> NDArray[np.float64]:
    """(4, 4) from the left camera's axes to the world's, of a motion that stands still."""
    pose: Any = wp.transform(*map(float, motion.poses[0, 0])) * camera.pose()
    out = np.eye(4)
    out[:3, :3] = np.array(wp.quat_to_matrix(wp.transform_get_rotation(pose)), dtype=np.float64).reshape(3, 3)
    out[:3, 3] = list(pose)[:3]
    return out


def _write_images(folder: Path, frame: Frame, pictures: Sequence[Picture]) -> None:
    """The picture, or both, depth and instances, the latter two as PNG of 16 bits."""
    from PIL import Image

    left = pictures[0]
    known = np.isfinite(left.depth) & (left.depth * DEPTH_STEPS < 65535.0)
    depth = np.where(known, np.rint(np.where(known, left.depth, 0.0) * DEPTH_STEPS), 0.0).astype(np.uint16)
    images = {
        **{name: picture.rgb for name, picture in zip(("images", "right"), pictures, strict=False)},
        "depth": depth,
        "instances": np.where(left.instance < 0, 0, left.instance).astype(np.uint16),
    }
    for name, pixels in images.items():
        with written_whole(folder / name / frame["split"] / f"{name_of(frame)}.png") as temporary:
            Image.fromarray(pixels).save(temporary)


def _assembled(folder: Path, settings: DatasetSettings, frames: Sequence[Frame]) -> list[Path]:
    """Files of the formats, sheet, card, and the manifest of all files."""
    written: list[Path] = []
    if "coco" in settings.formats:
        written += write_coco(folder, frames)
    if "yolo" in settings.formats:
        write_yolo(folder, frames)
        written.append(folder / "data.yaml")
    if "kitti" in settings.formats:
        write_kitti(folder, frames, settings.camera)
        written.append(folder / "kitti")
    with written_whole(folder / "sheet.png") as temporary:
        draw_sheet(folder, frames[:: max(len(frames) // SHEET, 1)][:SHEET]).save(temporary)
    write_text(folder / "README.md", card(settings, frames))
    files = sorted(path for path in folder.rglob("*") if path.is_file() and path.name != "manifest.json")
    hashes = {str(path.relative_to(folder)): hashlib.sha256(path.read_bytes()).hexdigest() for path in files}
    write_json(folder / "manifest.json", {"sha256": hashes})
    return [*written, *(folder / name for name in ("sheet.png", "README.md", "manifest.json"))]
