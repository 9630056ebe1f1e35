"""Making a data set: which forests, places and lights its pictures are of, and their files, picture by picture.

A picture's own JSON file is written last, so a run that was interrupted goes on with the pictures that have none. What is
drawn for a picture depends on the seed and the picture's number alone, whichever process takes it.
"""

from __future__ import annotations

import hashlib
import json
from collections import defaultdict
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from aoro_gym.checks import check_integer
from aoro_gym.execution.devices import several
from aoro_gym.execution.digest import digest
from aoro_gym.execution.files import read_json, write_json, write_text, written_whole
from aoro_gym.execution.locking import locked
from aoro_gym.execution.workers import Failure, spread
from aoro_gym.sensors.camera.figures import calibration
from aoro_gym.sensors.dataset.card import card
from aoro_gym.sensors.dataset.drives import Drive, Driver
from aoro_gym.sensors.dataset.figures import draw_points, draw_sheet
from aoro_gym.sensors.dataset.formats import Frame, write_coco, write_kitti, write_yolo
from aoro_gym.sensors.dataset.settings import DatasetSettings
from aoro_gym.sensors.dataset.sites import Forest, Site
from aoro_gym.sensors.dataset.taking import Taken, Wanted, finish, set_up, take
from aoro_gym.terrains import Path as Line
from aoro_gym.terrains.world.world import World

SHEET = 12
"""Pictures of the sheet."""
SETTING_UP, DRIVING = 1500, 6000
"""Work that a forest's triangles are, and a drive through it; a core does about a thousand a second. (E)"""
ANYWHERE, A_PIXEL, A_RAY = 250, 0.007, 0.012
"""Work of a picture that any device leaves to the core (labels, files); and that of each pixel's truth and of each of its
samples, on a CPU. (E: by pictures of 192 and 384 pixels of width on two cores)"""
OUTLINES = 90
"""Work of a picture's polygons, which come last. (E)"""
JOBS, LEAST_JOB = 3, 4
"""Jobs of a process, so that none is alone at work for long at the end; and the fewest pictures of one."""
TOGETHER = {"cpu": 300_000, "cuda": 2_000_000}
"""Pixels of pictures that are taken together, by kind of device: a GPU runs a quarter of a million threads at once; on a CPU
that is four pictures, so that what is interrupted costs little. A pixel takes 130 bytes."""
SITES = 8
"""Most forests of pictures that are taken together: each has its triangles on the device."""
FINISHERS = 3
"""Threads that label and write pictures while others are rendered: one at work, others waiting for the disk."""
RENDERING = 0.8
"""Share of a picture's work that is done when it is rendered. (E)"""

Part = tuple[int, list[int]]
"""A forest and some of its pictures, by their numbers."""
Tell = Callable[[int], Any]
"""Takes an amount of work that was done."""


@dataclass(frozen=True)
class Plan:
    """All that a process needs to take any picture of a data set."""

    folder: Path
    settings: DatasetSettings
    ground: World | None = None
    path: Line | None = None
    driver: Driver | None = None
    device: str = "cpu"

    @property
    def forests(self) -> int:
        """How many, or 1 where the world is given."""
        return self.settings.worlds if self.ground is None else 1

    def numbers(self, index: int) -> list[int]:
        """Of the pictures of a forest."""
        frames = self.settings.frames
        return [number for number in range(frames) if number * self.forests // frames == index]

    def told(self) -> dict[str, Any]:
        """What ``settings.json`` says, by which a folder knows its data set."""
        lists = {
            name: list(value) if isinstance(value, tuple) else value for name, value in asdict(self.settings).items()
        }
        ground = None if self.ground is None else digest(self.ground)
        path = None if self.path is None else digest(self.path)
        return {**lists, "drive": self.driver is not None, "ground": ground, "path": path}

    @property
    def picture(self) -> int:
        """Work of a picture."""
        if not self.device.startswith("cpu"):
            return ANYWHERE
        lens, eyes = self.settings.camera.intrinsics, 1 if self.settings.left_only else 2
        return int(ANYWHERE + eyes * lens.width * lens.height * (A_PIXEL + A_RAY * self.settings.samples))

    @property
    def together(self) -> int:
        """Most pictures, or pairs, that are taken together."""
        lens, eyes = self.settings.camera.intrinsics, 1 if self.settings.left_only else 2
        return max(TOGETHER["cpu" if self.device.startswith("cpu") else "cuda"] // (eyes * lens.width * lens.height), 1)

    def frame_file(self, number: int) -> Path:
        """Of a picture, written when all of it is."""
        return self.folder / "frames" / f"{number:06d}.json"

    def drive_file(self, index: int) -> Path:
        """Of the drive through a forest."""
        return self.folder / "drives" / f"{index:06d}.npz"


def make(
    folder: Path,
    settings: DatasetSettings,
    *,
    ground: World | None = None,
    path: Line | None = None,
    driver: Driver | None = None,
    device: str = "cpu",
    processes: int | None = None,
    progress: Callable[[float], None] | None = None,
) -> list[Path]:
    """Make a data set, or go on with one; returns the files that tell of all of it.

    Args:
        folder: Where to.
        settings: What of.
        ground: The only world; None: forests are made.
        path: That the machine drives along; None: ``driver`` plans one in each world.
        driver: Drives through a world; None: the camera stands at free places. With several processes a module's function.
        device: Where rays are cast; several with commas between them, or ``"cuda:all"``, take pictures in turn.
        processes: That take pictures at once, one a device at least, which is the default; the result is the same.
        progress: Told the share that is done.

    Raises:
        ValueError: the folder holds a data set of other settings, the format cannot hold the camera's lens, or there is no
            room for a picture or a path.
        FolderInUse: another process makes it.
    """
    names = several(device)
    processes = len(names) if processes is None else processes
    check_integer("processes", processes, ge=len(names), note=", one for each device" if len(names) > 1 else "")
    if path is not None and (ground is None or driver is None):
        raise ValueError("path is given without a ground and a driver; give both, or drop it")
    if driver is not None and settings.near is not None:
        raise ValueError(f"near is {settings.near}, but a machine that drives looks ahead; drop one of them")
    if "kitti" in settings.formats:
        write_kitti(folder, [], settings.camera)  # refuses a lens before anything is made
    plan = Plan(folder, settings, ground, path, driver, device)
    with locked(folder):
        _check_same(plan)
        _take_all(plan, names, processes, progress)
        frames = [json.loads(plan.frame_file(number).read_text(encoding="utf-8")) for number in range(settings.frames)]
        return _assembled(plan, frames)


def _check_same(plan: Plan) -> None:
    file, told = plan.folder / "settings.json", plan.told()
    if file.exists() and read_json(file) != told:
        raise ValueError(f"{plan.folder} holds a data set of other settings, see {file}; name another folder")
    write_json(file, told)


def _take_all(plan: Plan, names: Sequence[str], processes: int, progress: Callable[[float], None] | None) -> None:
    """Drive through all forests and take all pictures that are not there yet."""
    waiting: dict[int, list[int]] = defaultdict(list)
    for index in range(plan.forests):
        for number in plan.numbers(index):
            if not plan.frame_file(number).exists():
                waiting[index].append(number)
    drives = [index for index in waiting if plan.driver is not None and not plan.drive_file(index).exists()]
    parts = [(index, part) for index, numbers in waiting.items() for part in _parted(numbers, processes, len(waiting))]
    jobs = _joined(parts, -(-len(parts) // (JOBS * processes)), plan.together)
    done = plan.picture * (plan.settings.frames - sum(map(len, waiting.values())))
    total = plan.picture * plan.settings.frames + SETTING_UP * len(parts) + DRIVING * len(drives)
    total += OUTLINES * plan.settings.frames if "coco" in plan.settings.formats else 0

    def tell(amount: int) -> None:
        nonlocal done
        done += amount
        if progress is not None:
            progress(done / total)

    tell(0)
    _spread(_drive, [(plan, index) for index in drives], processes, tell)
    plans = [replace(plan, device=name) for name in names]
    taken = [(plans[number % len(names)], job) for number, job in enumerate(jobs)]
    _spread(_take, taken, processes, tell)


def _parted(numbers: list[int], processes: int, forests: int) -> list[list[int]]:
    """Numbers of a forest in as many parts as keep all processes at work; one where there is one process."""
    wanted = 1 if processes == 1 else -(-JOBS * processes // forests)
    parts = max(min(wanted, len(numbers) // LEAST_JOB), min(-(-processes // forests), len(numbers)))
    return [numbers[len(numbers) * k // parts : len(numbers) * (k + 1) // parts] for k in range(parts)]


def _joined(parts: list[Part], most: int, pictures: int) -> list[list[Part]]:
    """Jobs of up to ``most`` parts, as long as they have no more than so many pictures, or one part."""
    jobs: list[list[Part]] = []
    for part in parts:
        fits = jobs and len(jobs[-1]) < most and sum(len(each) for _, each in jobs[-1]) + len(part[1]) <= pictures
        jobs[-1:] = [[*jobs[-1], part]] if fits else [*jobs[-1:], [part]]
    return jobs


def _spread(work: Callable[..., None], jobs: Sequence[tuple[Any, ...]], processes: int, tell: Tell) -> None:
    """Do all jobs, here where there is one process."""
    if processes == 1 or len(jobs) <= 1:
        for arguments in jobs:
            work(tell, *arguments)
        return
    named = {f"{number}": arguments for number, arguments in enumerate(jobs)}
    for _, failure in spread(work, named, workers=min(processes, len(jobs)), tell=tell):
        if isinstance(failure, Failure):
            raise ValueError(failure.reason.removeprefix("ValueError: "))


def _drive(tell: Tell, plan: Plan, index: int) -> None:
    """Drive through a forest, and keep that."""
    assert plan.driver is not None
    forest = Forest(plan.settings, index, plan.ground)
    counted = _Counted(tell, DRIVING)
    plan.driver(forest.world, plan.path, plan.settings.seed + index, counted.share).save(plan.drive_file(index))
    counted.share(1.0)


def _take(tell: Tell, plan: Plan, parts: list[Part]) -> None:
    """Take some pictures of some forests: while some are rendered, those before are labelled and written."""
    pool, before = ThreadPoolExecutor(FINISHERS), list[Future[None]]()
    try:
        for wanted in _chunks(tell, plan, parts):
            counted = _Counted(tell, int(RENDERING * plan.picture * len(wanted)))
            taken = take(set_up(wanted), counted.share)
            counted.share(1.0)
            for one in before:
                one.result()
                tell(plan.picture - int(RENDERING * plan.picture))
            before = [pool.submit(_finish, plan, one) for one in taken]
        for one in before:
            one.result()
            tell(plan.picture - int(RENDERING * plan.picture))
    finally:
        pool.shutdown(cancel_futures=True)


def _finish(plan: Plan, taken: Taken) -> None:
    """Label a picture and write all of it; its own file last."""
    write_json(plan.frame_file(taken.setup.number), finish(plan.folder, taken))


def _chunks(tell: Tell, plan: Plan, parts: list[Part]) -> Iterator[list[Wanted]]:
    """Pictures that are taken together."""
    chunk: list[Wanted] = []
    for index, numbers in parts:
        drive = None if plan.driver is None else Drive.load(plan.drive_file(index))
        every = plan.numbers(index)
        site = Site(plan.settings, index, plan.ground, drive, plan.device, min(plan.together, len(every)))
        tell(SETTING_UP)
        instants = None if drive is None else drive.instants(len(every))
        for number in numbers:
            due = None if instants is None else float(instants[every.index(number)])
            chunk.append(Wanted(site, number, due))
            if len(chunk) == plan.together:
                yield chunk
                chunk = []
        if chunk and len({id(one.site) for one in chunk}) == SITES:
            yield chunk
            chunk = []
    if chunk:
        yield chunk


class _Counted:
    """Tells of shares as amounts of a whole."""

    def __init__(self, tell: Tell, whole: int):
        self._tell, self._whole, self._told = tell, whole, 0

    def share(self, share: float) -> None:
        """What is done of it, from 0 to 1."""
        now = int(self._whole * min(share, 1.0))
        if now > self._told:
            self._tell(now - self._told)
            self._told = now


def _assembled(plan: Plan, frames: Sequence[Frame]) -> list[Path]:
    """Files of the formats, sheet, card, and the manifest of all files."""
    folder, settings, written = plan.folder, plan.settings, list[Path]()
    if "coco" in settings.formats:
        written += write_coco(folder, frames)
    if "yolo" in settings.formats:
        write_yolo(folder, frames)
        written.append(folder / "data.yaml")
    if "kitti" in settings.formats:
        write_kitti(folder, frames, settings.camera)
        written.append(folder / "kitti")
    shown = frames[:: max(len(frames) // SHEET, 1)][:SHEET]
    with written_whole(folder / "sheet.png") as temporary:
        draw_sheet(folder, shown).save(temporary)
    if "lidar" in settings.sensors:
        with written_whole(folder / "sheet_lidar.png") as temporary:
            draw_points(folder, shown, settings.camera.intrinsics).save(temporary)
    write_json(folder / "calibration.json", calibration(settings.camera))
    write_text(folder / "README.md", card(settings, frames))
    files = sorted(path for path in folder.rglob("*") if path.is_file() and path.name != "manifest.json")
    visible = [path for path in files if not path.name.startswith(".")]
    hashes = {str(path.relative_to(folder)): hashlib.sha256(path.read_bytes()).hexdigest() for path in visible}
    write_json(folder / "manifest.json", {"sha256": hashes})
    return [*written, *(folder / name for name in ("sheet.png", "README.md", "manifest.json"))]
