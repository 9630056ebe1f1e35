"""All trainings of the study and their scores, one JSON file each; what is there is not trained again.

Every training sees the same number of batches and the same seed of first weights as those that it is compared with. Loss
and network were changed twice after scores on the test pictures had been seen, before the first of these trainings.
"""

from __future__ import annotations

import json
import time
from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import torch
from filelock import FileLock, Timeout

from aoro_gym.execution.files import read_json, write_json
from aoro_gym.reporting import terminal
from aoro_gym.sensors.dataset.formats import coco
from studies.log_detection.detector import Detector, train
from studies.log_detection.keeping import Keeping
from studies.log_detection.pictures import CLASSES, Pictures, load, of_coco
from studies.log_detection.scale import Scale
from studies.log_detection.scoring import score

ABLATIONS = ("light", "weather", "texture", "season", "fixed")
"""Sets by what stays the same; ``fixed`` is all of it."""
PARTLY = 50
"""Drawings of forests for the intervals of a training that is not done."""


@dataclass(frozen=True)
class Training:
    """One training and its scores."""

    kind: str
    """``long``, ``size``, ``ablation``, ``scratch`` or ``tuned``."""
    data: str
    """Folder that it learns from."""
    pictures: int
    seed: int
    steps: int
    """Batches."""
    start: str | None = None
    """Name of the training that it goes on from."""

    @property
    def name(self) -> str:
        """Of its files."""
        return f"{self.kind}_{self.data}_{self.pictures}_{self.seed}"

    @property
    def tested(self) -> tuple[str, ...]:
        """Sets that it is scored on."""
        return ("other_test",) if self.data == "other" else ("test", "other_test")

    @property
    def told(self) -> dict[str, Any]:
        """What its files say of it."""
        names = ("kind", "data", "pictures", "seed", "steps")
        return {name: getattr(self, name) for name in names}


def trainings(seeds: int, scale: Scale) -> Iterator[Training]:
    """All of them, those first that others go on from."""
    most = max(scale.sizes)
    for seed in range(seeds):
        yield Training("long", "train", most, seed, scale.long_steps)
        for count in sorted(scale.sizes, reverse=True):
            yield Training("size", "train", count, seed, scale.steps)
        for data in ("train", *ABLATIONS):
            yield Training("ablation", data, scale.ablated, seed, scale.steps)
        for count in scale.shots:
            yield Training("tuned", "other", count, seed, scale.fine_steps, f"long_train_{most}_{seed}")
            if count:
                yield Training("scratch", "other", count, seed, scale.fine_steps)


def forests(folder: Path, canvas: tuple[int, int], kept: Path | None = None) -> Pictures:
    """All pictures of a data set of ``aoro-gym dataset`` on a canvas, in order and without masks; splits are of no effect.
    ``kept`` is as of :func:`~studies.log_detection.pictures.of_coco`.

    Raises ``ValueError`` where there are none.
    """
    frames = []
    for file in sorted((folder / "frames").glob("*.json")):
        frame = json.loads(file.read_text(encoding="utf-8"))
        frames.append({**frame, "labels": [{**label, "runs": []} for label in frame["labels"]]})
    if not frames:
        raise ValueError(f"{folder} has no pictures: make them with `python -m studies.log_detection pictures`")
    told = coco(frames)
    numbers = {one["name"]: one["id"] for one in told["categories"]}
    found = {numbers[name]: place for place, name in enumerate(CLASSES)}
    return of_coco(told, folder / "images", found, CLASSES, canvas, kept)


def run(data: Path, results: Path, scale: Scale, *, seeds: int = 1, device: str = "cpu") -> None:
    """Train and score what is not there yet; several processes with the same folders share the trainings.

    Args:
        data: Folder of the pictures; detectors are written into it, too.
        results: Folder of the scores.
        scale: Of the study.
        seeds: Trainings of each kind.
        device: Of the trainings.
    """
    torch.set_num_threads(1)
    left = list(trainings(seeds, scale))
    work = _Work(left, results)
    sets = _Sets(data, scale.canvas)
    with terminal.progress("training") as tell:
        while left := [one for one in left if not _is_there(one, results)]:
            for one in left:
                if one.start is not None and not _weights(data, one.start).exists():
                    continue
                try:
                    with FileLock(data / "detectors" / f"{one.name}.lock", timeout=0):
                        if not _is_there(one, results):
                            _trained(one, results, sets, scale.batch, device, work, tell)
                            break  # from the first on: what waited may be possible now
                except Timeout:  # another process trains it
                    continue
            else:
                tell("training", work.share(), "waiting for other processes")
                time.sleep(1.0)


class _Work:
    """Share of all batches that are done, by all processes.

    Args:
        whole: All trainings.
        results: Folder of the scores.
    """

    EVERY = 2.0
    """Time [s] after which files of other processes are looked for again."""

    def __init__(self, whole: list[Training], results: Path):
        self._left, self._results = list(whole), results
        self._total, self._done, self._looked = sum(one.steps for one in whole), 0, -self.EVERY

    def share(self, own: float = 0.0) -> float:
        """Of the whole, where this process has done ``own`` batches of a training that has no file yet."""
        if time.monotonic() - self._looked >= self.EVERY:
            there = [one for one in self._left if _is_there(one, self._results)]
            self._left = [one for one in self._left if one not in there]
            self._done += sum(one.steps for one in there)
            self._looked = time.monotonic()
        return (self._done + own) / self._total


def _weights(data: Path, name: str) -> Path:
    return data / "detectors" / f"{name}.safetensors"


def _is_there(one: Training, results: Path) -> bool:
    file = results / f"{one.name}.json"
    return file.exists() and read_json(file)["steps"] == one.steps


class _Sets:
    """Sets of pictures, each read once.

    Args:
        data: Folder of all of them.
        canvas: Height and width [pixels].
    """

    def __init__(self, data: Path, canvas: tuple[int, int]):
        self.data, self._canvas = data, canvas
        self._known: dict[str, Pictures] = {}

    def __getitem__(self, name: str) -> Pictures:
        if name not in self._known:
            folder = self.data / name
            file = folder / f".canvas_{self._canvas[0]}_{self._canvas[1]}.npy"
            if name.startswith("other"):
                made = load(folder / "annotations.json", folder / "images", canvas=self._canvas, kept=file)
            else:
                made = forests(folder, self._canvas, kept=file)
            self._known[name] = made
        return self._known[name]


def _trained(
    one: Training,
    results: Path,
    sets: _Sets,
    batch: int,
    device: str,
    work: _Work,
    tell: terminal.Tell,
) -> None:
    """Train and score one.

    Args:
        one: The training.
        results: Folder of the scores.
        sets: Of the pictures.
        batch: Pictures of one.
        device: Of the training.
        work: Of all trainings.
        tell: Told the share of it that is done.
    """
    tell("training", work.share(), one.name)
    start = None if one.start is None else Detector.load(_weights(sets.data, one.start))
    began = time.process_time()

    def progress(share: float, text: str) -> None:
        tell("training", work.share(share * one.steps), f"{one.name}, {text}")

    if start is not None and one.pictures == 0:
        made = start
    else:
        keeping = Keeping(
            sets.data / "detectors" / f"{one.name}.kept", told=partial(_tell_partly, one, results, sets, device)
        )
        made = train(
            sets[one.data].first(one.pictures), steps=one.steps, batch=batch, seed=one.seed, start=start, device=device,
            progress=progress, keeping=keeping,
        )  # fmt: skip
    taken = time.process_time() - began
    made.save(_weights(sets.data, one.name), {"training": one.name})
    scores: dict[str, Any] = {name: score(made, sets[name], device=device) for name in one.tested}
    if one.kind != "ablation":  # these alone are compared in pairs
        for each in scores.values():
            del each["resampled"]
    write_json(results / f"{one.name}.json", {**one.told, "device": device, "cpu_s": round(taken, 1), "scores": scores})
    for left in (sets.data / "detectors" / f"{one.name}.kept", _partly(one, results)):
        left.unlink(missing_ok=True)


def _partly(one: Training, results: Path) -> Path:
    """File of the scores of a training that is not done."""
    return results / "partial" / f"{one.name}.json"


def _tell_partly(one: Training, results: Path, sets: _Sets, device: str, done: int, detector: Detector) -> None:
    """Score a training that is not done on the first of its tests.

    Args:
        one: The training.
        results: Folder of the scores.
        sets: Of the pictures.
        device: Of the training.
        done: Batches.
        detector: As it is then.
    """
    scored = score(detector, sets[one.tested[0]], resamples=PARTLY, device=device)
    del scored["resampled"]
    write_json(_partly(one, results), {**one.told, "device": device, "done": done, "scores": {one.tested[0]: scored}})
