"""Taking a picture: where the camera is, in what light, and the picture's files."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from aoro_gym.execution.files import written_whole
from aoro_gym.recording.commands import JOINTS
from aoro_gym.sensors.camera import CAMERA_MOUNTING, Picture, StereoCamera, daylight
from aoro_gym.sensors.dataset.formats import Frame, described, name_of
from aoro_gym.sensors.dataset.labels import labels
from aoro_gym.sensors.dataset.sites import Site
from aoro_gym.sensors.dataset.sweeps import write_sweep
from aoro_gym.sensors.height_map import HeightMapSensor
from aoro_gym.sensors.lidar import CLEAR, Lidar, Motion, Mounting, Weather
from aoro_gym.sensors.lidar import MODELS as LIDARS
from aoro_gym.sensors.raytrace import Scene
from aoro_gym.terrains.world.places import free_place

Array = NDArray[np.float64]
DEPTH_STEPS = 256.0
"""Steps a metre of a depth in its PNG, 0 where it is not known: KITTI's."""
ATTEMPTS = 20
"""Places that are drawn for a picture whose camera would be in a stem."""
LATER = 0.1
"""[s] by which a picture of a drive is taken later instead."""
VISIBLE_NM = 550.0
"""Wavelength at which weather is a camera's."""
NEAR_MACHINE = 5.0
"""Least distance [m] of the camera's machine from one that stands."""
AWAY, AWAY_FROM_MACHINE = (4.5, 11.0), (7.0, 18.0)
"""Distances [m] from a machine's hinge to the object that its camera is put before."""


def take(
    folder: Path, site: Site, number: int, due: float | None, progress: Callable[[float], Any] = lambda share: None
) -> Frame:
    """Take a picture and write its files; what is left for its JSON file.

    Args:
        folder: Of the data set.
        site: Where.
        number: Of the picture.
        due: Time [s] of the site's drive; None: it stands at a free place.
        progress: Told the share that is done.

    Raises ``ValueError`` where there is no place outside of stems.
    """
    settings = site.settings
    for attempt in range(ATTEMPTS):
        drawn = _draw(site, number, attempt)
        camera = _camera(site, number, drawn)
        motion, start = _motion(site, drawn, None if due is None else due + attempt * LATER)
        try:
            _check_apart(site, motion, start)
            camera.check_outside(motion, start)
            break
        except ValueError:  # in a stem
            if attempt == ATTEMPTS - 1:
                raise
    tell = partial(_within, progress)
    pictures: Sequence[Picture] = (
        camera.take_left(motion, start=start, progress=tell)
        if settings.left_only
        else camera.take(motion, start=start, progress=tell)[0]
    )
    left = pictures[0]
    middle = start + 0.5 * (left.exposure + camera.model.line_time * camera.model.intrinsics.height)
    pose = pose_of(camera, motion, middle)
    found = labels(left, site.shapes, settings.camera.intrinsics, pose)
    frame: Frame = {
        "number": number,
        "split": site.split,
        "width": left.depth.shape[1],
        "height": left.depth.shape[0],
        "world_seed": settings.seed + site.index,
        "season": site.season,
        "stand": site.stand,
        "drawn": drawn,
        "camera_to_world": pose.tolist(),
        "camera_to_machine": matrix_of(camera.pose()).tolist(),
        "labels": [described(label) for label in found],
    }
    if site.machines:
        frame["machines"] = [_described_machine(site, number) for number in range(len(site.machines))]
    if site.drive is not None:
        frame["time_s"] = start
        frame["way_m"] = float(np.interp(start, site.drive.motion.time, site.drive.way))
    if "lidar" in settings.sensors:
        _sweep(folder, site, frame, motion, start, middle)
    _write_images(folder, frame, pictures)
    return frame


def _described_machine(site: Site, number: int) -> dict[str, Any]:
    """What a frame says of a machine that stands there: its instance and pose, and those of its crane and what it holds."""
    machine = site.machines[number]
    told: dict[str, Any] = {
        "instance": len(site.world.objects) + 1 + number,
        "position": [float(one) for one in machine.position],
        "wxyz": [float(one) for one in machine.pose.wxyz],
        "joint_angle": machine.pose.joint,
    }
    crane = machine.pose.crane
    if crane is not None:
        told["crane"] = {
            **dict(zip(JOINTS, crane.joints, strict=True)),
            "grapple_yaw": crane.yaw,
            "tip": [float(one) for one in machine.crane_in_world()["crane_grapple"][0]],
            "holds": site.held.get(number),
        }
    return told


def _camera(site: Site, number: int, drawn: dict[str, Any]) -> StereoCamera:
    kind, amount = drawn["weather"]
    return StereoCamera(
        site.scene,
        site.appearance(drawn),
        daylight(site.season, hour=drawn["hour"], cloud=drawn["cloud"]),
        site.settings.camera,
        mounting=Mounting(position=drawn["position"], angles_deg=drawn["angles_deg"]),
        samples=site.settings.samples,
        weather=CLEAR if kind == "clear" else Weather.named(kind, amount, wavelength_nm=VISIBLE_NM),
        seed=site.settings.seed + number,
    )


def _motion(site: Site, drawn: dict[str, Any], due: float | None) -> tuple[Motion, float]:
    """Motion of the machine around a picture, and when [s] in it the picture is taken."""
    if site.drive is None or due is None:
        return _standing(site.scene, drawn["at"], drawn["heading"]), 0.0
    instant = min(due, site.drive.last)
    return site.drive.around(instant), instant


def _check_apart(site: Site, motion: Motion, start: float) -> None:
    """ValueError where the camera's machine stands in another one."""
    here = np.array([np.interp(start, motion.time, motion.position[:, 0, axis]) for axis in (0, 1)])
    for machine in site.machines:
        if site.drive is None and np.linalg.norm(machine.position[:2] - here) < NEAR_MACHINE:
            raise ValueError(
                f"there is a machine within {NEAR_MACHINE:g} m of x = {here[0]:.1f} m, y = {here[1]:.1f} m"
            )


def _draw(site: Site, number: int, attempt: int) -> dict[str, Any]:
    """Place, light and pose of a picture; on a drive all of its pictures have the same."""
    settings, driven = site.settings, site.drive is not None
    rng = np.random.default_rng([settings.seed, site.index, 3] if driven else [settings.seed, number, 2, attempt])
    out: dict[str, Any] = {} if driven else _place(site, rng)
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


def _place(site: Site, rng: np.random.Generator) -> dict[str, Any]:
    """Where the machine stands, and where it heads for: anywhere and free ahead, or before an object."""
    low, high = (bound[:2] for bound in site.world.terrain.extent)
    near = site.settings.near
    if near is None:
        place = free_place(site.world, tuple(rng.uniform(low + 6.0, high - 6.0)), ahead=2.0)
        return {"at": [place.x, place.y], "heading": place.heading + float(rng.uniform(-0.5, 0.5))}
    found = site.middles(near)
    middle = found[int(rng.integers(len(found)))]
    towards = float(rng.uniform(-np.pi, np.pi))
    away = float(rng.uniform(*(AWAY_FROM_MACHINE if near == "machine" else AWAY)))
    wanted = middle - away * np.array([np.cos(towards), np.sin(towards)])
    place = free_place(site.world, tuple(np.clip(wanted, low + 4.0, high - 4.0)))
    ahead = middle - [place.x, place.y]
    heading = float(np.arctan2(ahead[1], ahead[0]) + rng.uniform(-0.4, 0.4))
    return {"at": [place.x, place.y], "heading": heading}


def _standing(scene: Scene, at: Sequence[float], heading: float) -> Motion:
    """A machine that stands upright on the ground."""
    top = float(scene.extent[1][2])
    below = HeightMapSensor(scene, forward=(0.0, 0.0), left=(0.0, 0.0), above=1.0)
    height = top + float(below.measure([[*at, top]], [0.0])[0, 0, 0])
    return Motion.still([*at, height], yaw=heading)


def pose_of(camera: StereoCamera, motion: Motion, instant: float = 0.0) -> Array:
    """(4, 4) from the left camera's axes to the world's at an instant [s] of the motion of the first world."""
    return machine_at(motion, instant) @ matrix_of(camera.pose())


def machine_at(motion: Motion, instant: float) -> Array:
    """(4, 4) from the front frame's axes to the world's, between samples as device code has it: positions by straight lines,
    rotations by normalised means."""
    poses = motion.poses[:, 0].astype(np.float64)
    last = int(np.clip(np.searchsorted(motion.time, instant, side="right"), 1, max(len(poses) - 1, 1)))
    a, b = poses[last - 1], poses[min(last, len(poses) - 1)]
    span = float(motion.time[min(last, len(poses) - 1)] - motion.time[last - 1])
    share = 0.0 if span == 0.0 else float(np.clip((instant - motion.time[last - 1]) / span, 0.0, 1.0))
    turned = (1.0 - share) * a[3:] + share * (b[3:] if a[3:] @ b[3:] >= 0.0 else -b[3:])
    place = (1.0 - share) * a[:3] + share * b[:3]
    return matrix_of(wp.transform(*map(float, place), *map(float, turned / np.linalg.norm(turned))))


def matrix_of(pose: Any) -> Array:
    """(4, 4) of a ``wp.transform``."""
    out = np.eye(4)
    out[:3, :3] = np.array(wp.quat_to_matrix(wp.transform_get_rotation(pose)), dtype=np.float64).reshape(3, 3)
    out[:3, 3] = list(pose)[:3]
    return out


def _sweep(folder: Path, site: Site, frame: Frame, motion: Motion, start: float, middle: float) -> None:
    """A sweep whose middle is the picture's, and its files."""
    settings, (kind, amount) = site.settings, frame["drawn"]["weather"]
    model = LIDARS[settings.lidar]
    air = CLEAR if kind == "clear" else Weather.named(kind, amount, wavelength_nm=model.wavelength_nm)
    sensor = Lidar(site.scene, model, weather=air, seed=settings.seed + frame["number"])
    begin = None if site.drive is None else start - 0.5 / model.rate
    [points] = sensor.sweep(motion, start=begin, number=frame["number"])
    mounted = matrix_of(sensor.mounting.transform())
    write_sweep(folder, frame["split"], name_of(frame), points, machine_at(motion, middle) @ mounted, site.shapes)
    frame["lidar_to_machine"] = mounted.tolist()
    frame["points"] = len(points)


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


def _within(progress: Callable[[float], Any], share: float) -> None:
    """Rendering is about four fifths of a picture's work. (E)"""
    progress(0.8 * share)
