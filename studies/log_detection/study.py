"""All trainings of the study and their scores, one JSON file each; what is there is not trained again.

Every training sees the same number of batches and the same seed of first weights as those that it is compared with. Loss
and network were changed twice after scores on the test pictures had been seen, before the first of these trainings.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch
from filelock import FileLock, Timeout

from aoro_gym.execution.files import read_json, write_json
from aoro_gym.reporting import terminal
from studies.log_detection.detector import Detector, train
from studies.log_detection.pictures import Pictures, joined, load
from studies.log_detection.scoring import score

SIZES = (20, 40, 80, 160, 320)
"""Pictures of made forests that detectors learn from."""
TESTED = 100
"""Pictures of forests of other seeds that detectors are scored on."""
ABLATED = 100
"""Pictures of each set in which something is not drawn anew."""
ABLATIONS = ("light", "weather", "texture", "season", "fixed")
"""Sets by what stays the same; ``fixed`` is all of it."""
SHOTS = (0, 5, 10, 20, 40, 80)
"""Pictures of the other renderer that detectors learn from, after made forests or from scratch."""
OTHERS = (120, 100)
"""Of the other renderer: to learn from, and to score on, of woods of their own."""
LONG_STEPS, STEPS, FINE_STEPS = 2400, 800, 250
"""Batches of the training that others go on from, of the others on made forests, and of those on the other renderer's
pictures, whether from scratch or not."""


@dataclass(frozen=True)
class Training:
    """One training and its scores."""

    kind: str
    """``long``, ``size``, ``ablation``, ``scratch`` or ``tuned``."""
    data: str
    """Folder that it learns from."""
    pictures: int
    seed: int
    start: str | None = None
    """Name of the training that it goes on from."""

    @property
    def name(self) -> str:
        """Of its files."""
        return f"{self.kind}_{self.data}_{self.pictures}_{self.seed}"

    @property
    def steps(self) -> int:
        """Batches."""
        return {"long": LONG_STEPS, "scratch": FINE_STEPS, "tuned": FINE_STEPS}.get(self.kind, STEPS)


def trainings(seeds: int) -> Iterator[Training]:
    """All of them, those first that others go on from."""
    for seed in range(seeds):
        yield Training("long", "train", max(SIZES), seed)
        for count in sorted(SIZES, reverse=True):
            yield Training("size", "train", count, seed)
        for data in ("train", *ABLATIONS):
            yield Training("ablation", data, ABLATED, seed)
        for count in SHOTS:
            yield Training("tuned", "other", count, seed, f"long_train_{max(SIZES)}_{seed}")
            if count:
                yield Training("scratch", "other", count, seed)


def forests(folder: Path) -> Pictures:
    """All pictures of a data set of ``aoro-gym dataset``, in their order: splits are of no effect."""
    parts = [load(file, folder / "images") for file in sorted((folder / "annotations").glob("instances_*.json"))]
    if not parts:
        raise ValueError(f"{folder} has no annotations: make them with `python -m studies.log_detection pictures`")
    whole = joined(parts)
    order = sorted(range(len(whole)), key=lambda at: whole.ids[at])
    truth = dict(whole.truth)
    for name in ("images", "annotations"):
        truth[name] = [one for part in parts for one in part.truth[name]]
    return Pictures(
        whole.pixels[order],
        [whole.boxes[at] for at in order],
        [whole.labels[at] for at in order],
        whole.scales[order],
        [whole.ids[at] for at in order],
        truth,
        whole.classes,
    )


def run(data: Path, results: Path, *, seeds: int = 1, device: str = "cpu") -> None:
    """Train and score what is not there yet; several processes with the same folders share the trainings.

    Args:
        data: Folder of the pictures; detectors are written into it, too.
        results: Folder of the scores.
        seeds: Trainings of each kind.
        device: Of the trainings.
    """
    torch.set_num_threads(1)
    whole = list(trainings(seeds))
    sets: dict[str, Pictures] = {}
    with terminal.progress("training") as tell:
        left = whole
        while left := [one for one in left if not _is_there(one, results)]:
            done = len(whole) - len(left)
            for one in left:
                tell("training", done / len(whole), one.name)
                try:
                    with FileLock(data / "detectors" / f"{one.name}.lock", timeout=0):
                        if not _is_there(one, results) and (one.start is None or _weights(data, one.start).exists()):
                            _trained(one, data, results, sets, device)
                            done += 1
                except Timeout:  # another process trains it
                    continue
            time.sleep(1.0)


def _weights(data: Path, name: str) -> Path:
    return data / "detectors" / f"{name}.safetensors"


def _is_there(one: Training, results: Path) -> bool:
    file = results / f"{one.name}.json"
    return file.exists() and read_json(file)["steps"] == one.steps


def _pictures(name: str, data: Path, sets: dict[str, Pictures]) -> Pictures:
    """A set, read once."""
    if name not in sets:
        folder = data / name
        other = name.startswith("other")
        sets[name] = load(folder / "annotations.json", folder / "images") if other else forests(folder)
    return sets[name]


def _trained(one: Training, data: Path, results: Path, sets: dict[str, Pictures], device: str) -> None:
    """Train and score one."""
    start = None if one.start is None else Detector.load(_weights(data, one.start))
    began = time.process_time()
    if start is not None and one.pictures == 0:
        made = start
    else:
        learnt = _pictures(one.data, data, sets).first(one.pictures)
        made = train(learnt, steps=one.steps, seed=one.seed, start=start, device=device)
    taken = time.process_time() - began
    made.save(_weights(data, one.name), {"training": one.name})
    tested = ("other_test",) if one.data == "other" else ("test", "other_test")
    scores: dict[str, Any] = {name: score(made, _pictures(name, data, sets)) for name in tested}
    told = {"kind": one.kind, "data": one.data, "pictures": one.pictures, "seed": one.seed, "steps": one.steps}
    told["device"] = device
    write_json(results / f"{one.name}.json", {**told, "cpu_s": round(taken, 1), "scores": scores})
