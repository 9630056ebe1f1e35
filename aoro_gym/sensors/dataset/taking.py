"""Taking pictures: where the cameras are, in what light, and the pictures' files."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from aoro_gym.execution.files import written_whole
from aoro_gym.recording.commands import JOINTS
from aoro_gym.sensors.camera import CAMERA_MOUNTING, Picture, Request, StereoCamera, daylight, take_together
from aoro_gym.sensors.dataset.carrier import carrier
from aoro_gym.sensors.dataset.formats import Frame, described, name_of
from aoro_gym.sensors.dataset.labels import labels
from aoro_gym.sensors.dataset.machines import footprint
from aoro_gym.sensors.dataset.sites import Site
from aoro_gym.sensors.dataset.sweeps import write_sweep
from aoro_gym.sensors.height_map import HeightMapSensor
from aoro_gym.sensors.lidar import CLEAR, Lidar, Motion, Mounting, Points, Weather
from aoro_gym.sensors.lidar import MODELS as LIDARS
from aoro_gym.sensors.raytrace import Scene
from aoro_gym.terrains.world.places import free_place, stands_free

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
LIDAR_MOUNTING = Mounting()
"""Of the lidar beside the camera."""
AWAY, AWAY_FROM_MACHINE = (4.5, 11.0), (7.0, 18.0)
"""Distances [m] from a machine's hinge to the object that its camera is put before."""


@dataclass(frozen=True, eq=False)
class Wanted:
    """A picture that is to be taken."""

    site: Site
    number: int
    due: float | None = None
    """Time [s] of the site's drive; None: the machine stands at a free place."""


@dataclass(frozen=True, eq=False)
class Setup:
    """A picture whose camera has its place and its light."""

    site: Site
    number: int
    drawn: dict[str, Any]
    camera: StereoCamera
    motion: Motion
    start: float
    """Time [s] of the motion at which it is taken."""


@dataclass(frozen=True, eq=False)
class Taken:
    """A picture, or a pair, whose files are not written yet."""

    setup: Setup
    pictures: Sequence[Picture]
    points: Points | None
    """Of the lidar's sweep."""


def set_up(wanted: Sequence[Wanted]) -> list[Setup]:
    """Draw place and light of pictures; where a camera would lie in a stem, or in a machine, anew.

    Raises ``ValueError`` where there is no place outside of stems.
    """
    found: dict[int, Setup] = {}
    for attempt in range(ATTEMPTS):
        waiting = [k for k in range(len(wanted)) if k not in found]
        for site in dict.fromkeys(wanted[k].site for k in waiting):
            own = [k for k in waiting if wanted[k].site is site]
            tried = _tried(site, [wanted[k] for k in own], attempt)
            places = np.concatenate([one.camera.places(one.motion, one.start)[0] for one in tried])
            inside = site.scene.lie_inside(places)[0].reshape(-1, 2)
            for k, one, in_stem in zip(own, tried, inside, strict=True):
                if not in_stem.any() and _is_apart(one):
                    found[k] = one
                elif attempt == ATTEMPTS - 1:
                    one.camera.check_outside(one.motion, one.start)
                    raise ValueError(
                        f"picture {one.number} has no place {NEAR_MACHINE:g} m from all machines; take fewer"
                    )
        if len(found) == len(wanted):
            break
    return [found[k] for k in range(len(wanted))]


def _tried(site: Site, wanted: Sequence[Wanted], attempt: int) -> list[Setup]:
    """Pictures of a site as they are drawn for the n-th time."""
    drawn = [_draw(site, one.number, attempt) for one in wanted]
    if site.drive is None:
        moved = [(motion, 0.0) for motion in _standing(site.scene, drawn)]
    else:
        instants = [min((one.due or 0.0) + attempt * LATER, site.drive.last) for one in wanted]
        moved = [(site.drive.around(instant), instant) for instant in instants]
    return [
        Setup(site, one.number, own, _camera(site, one.number, own), motion, start)
        for one, own, (motion, start) in zip(wanted, drawn, moved, strict=True)
    ]


def take(setups: Sequence[Setup], progress: Callable[[float], Any] = lambda share: None) -> list[Taken]:
    """Take pictures, of any sites, together, and the sweeps beside them.

    Args:
        setups: Of one data set.
        progress: Told the share that is done.
    """
    settings = setups[0].site.settings
    worlds = _carried(setups)
    requests = [Request(one.camera, one.motion, one.start, lit=lit) for one, lit in zip(setups, worlds, strict=True)]
    found = take_together(requests, left_only=settings.left_only, check=False, progress=progress)
    return [
        Taken(one, [camera[0] for camera in of_cameras], _swept(one) if "lidar" in settings.sensors else None)
        for one, of_cameras in zip(setups, found, strict=True)
    ]


def _carried(setups: Sequence[Setup]) -> list[int]:
    """Put the machines that carry the cameras where they are as the pictures begin: within an exposure they stay; the rays'
    world in which light meets each."""
    out: dict[int, int] = {}
    for site in dict.fromkeys(one.site for one in setups):
        own = [k for k in range(len(setups)) if setups[k].site is site]
        fronts = [machine_at(setups[k].motion, setups[k].start) for k in own]
        drive = site.drive
        postures = [carrier().rest if drive is None else drive.posture_at(setups[k].start) for k in own]
        out |= zip(own, site.carry(fronts, postures), strict=True)
    return [out[k] for k in range(len(setups))]


def finish(folder: Path, taken: Taken) -> Frame:
    """Label a picture and write its files; what is left for its JSON file."""
    one, left = taken.setup, taken.pictures[0]
    site, camera, settings = one.site, one.camera, one.site.settings
    middle = one.start + 0.5 * (left.exposure + camera.model.line_time * camera.model.intrinsics.height)
    pose = pose_of(camera, one.motion, middle)
    found = labels(left, site.shapes, settings.camera.intrinsics, pose)
    frame: Frame = {
        "number": one.number,
        "split": site.split,
        "width": left.depth.shape[1],
        "height": left.depth.shape[0],
        "world_seed": settings.seed + site.index,
        "season": site.season,
        "stand": site.stand,
        "drawn": one.drawn,
        "camera_to_world": pose.tolist(),
        "camera_to_machine": matrix_of(camera.pose()).tolist(),
        "labels": [described(label) for label in found],
    }
    if site.machines:
        frame["machines"] = [_described_machine(site, number) for number in range(len(site.machines))]
    if site.drive is not None:
        frame["time_s"] = one.start
        frame["way_m"] = float(np.interp(one.start, site.drive.motion.time, site.drive.way))
    if taken.points is not None:
        _write_points(folder, frame, taken.points, one, middle)
    _write_images(folder, frame, taken.pictures)
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


def _is_apart(one: Setup) -> bool:
    """Whether a camera's machine, where it stands, stands in no other one."""
    here = one.motion.position[0, 0, :2]
    if one.site.drive is not None:
        return True
    apart = all(np.linalg.norm(machine.position[:2] - here) >= NEAR_MACHINE for machine in one.site.machines)
    circles = [footprint(np.array([*at.position[:2], at.heading, at.pose.joint])) for at in one.site.machines]
    heading = one.motion.yaw[0, 0]
    return apart and all(stands_free(each, here[None], heading[None], np.zeros(1)).all() for each in circles)


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


def _standing(scene: Scene, drawn: Sequence[dict[str, Any]]) -> list[Motion]:
    """Machines that stand upright on the ground where they are drawn."""
    top = float(scene.extent[1][2])
    below = HeightMapSensor(scene, forward=(0.0, 0.0), left=(0.0, 0.0), above=1.0)
    heights = below.measure([[*one["at"], top] for one in drawn], np.zeros(len(drawn)))[:, 0, 0]
    return [
        Motion.still([*one["at"], top + float(height)], yaw=one["heading"])
        for one, height in zip(drawn, heights, strict=True)
    ]


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


def _lidar(one: Setup) -> Lidar:
    """The lidar beside a camera."""
    kind, amount = one.drawn["weather"]
    model, settings = LIDARS[one.site.settings.lidar], one.site.settings
    air = CLEAR if kind == "clear" else Weather.named(kind, amount, wavelength_nm=model.wavelength_nm)
    return Lidar(one.site.scene, model, mounting=LIDAR_MOUNTING, weather=air, seed=settings.seed + one.number)


def _swept(one: Setup) -> Points:
    """A sweep whose middle is the picture's."""
    sensor = _lidar(one)
    begin = None if one.site.drive is None else one.start - 0.5 / sensor.model.rate
    [points] = sensor.sweep(one.motion, start=begin, number=one.number)
    return points


def _write_points(folder: Path, frame: Frame, points: Points, one: Setup, middle: float) -> None:
    """A sweep's files, in the lidar's axes at the middle of the picture's exposure."""
    mounted = matrix_of(LIDAR_MOUNTING.transform())
    pose = machine_at(one.motion, middle) @ mounted
    write_sweep(folder, frame["split"], name_of(frame), points, pose, one.site.shapes)
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
