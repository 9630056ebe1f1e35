"""Average precision by pycocotools, with what other pictures of the same kind would give."""

from __future__ import annotations

import contextlib
import io
import warnings
from collections import Counter
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pycocotools.coco import COCO
from pycocotools.cocoeval import COCOeval

from studies.log_detection.detector import Detector, detect
from studies.log_detection.pictures import Pictures

RESAMPLES = 300
"""Of the bootstrap over forests: pictures of one forest are alike. Where a file does not say which are (``world_seed``),
each picture has one of its own."""
LEVEL = 0.95
OVERLAP = 0.5
"""Intersection over union from which a box counts as found: AP50."""


def told(detector: Detector, pictures: Pictures, device: str = "cpu") -> list[dict[str, Any]]:
    """Boxes that a detector tells, as COCO's results, in the pixels of the files."""
    found = []
    for number, boxes in enumerate(detect(detector, pictures.pixels, device)):
        for x0, y0, x1, y1, score, kind in (boxes / ([*[pictures.scales[number]] * 4, 1.0, 1.0])).tolist():
            box = [x0, y0, x1 - x0, y1 - y0]
            one = {"image_id": pictures.ids[number], "category_id": int(kind) + 1, "bbox": box, "score": score}
            found.append(one)
    return found


def score(
    detector: Detector, pictures: Pictures, *, resamples: int = RESAMPLES, seed: int = 0, device: str = "cpu"
) -> dict[str, Any]:
    """AP50 of each class and their mean, each ``[value, low, high]`` with the ends of its interval of 95 % over forests.

    A class of which the pictures have none is null. The mean is over the classes that there are. ``resampled`` has the
    values of logs and of the mean, with spaces between, for the forests as they were drawn: the same ones for each detector
    on these pictures, so that differences of two detectors have narrower intervals than each has.
    """
    values = _average_precision(told(detector, pictures, device), pictures, resamples, seed)
    names = [one["name"] for one in pictures.truth["categories"]]
    out: dict[str, Any] = {name: _interval(values[:, place]) for place, name in enumerate(names)}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # mean of nothing
        mean = np.nanmean(values, axis=1)
    out["mean"] = _interval(mean)
    logs = {"log": values[1:, names.index("log")]} if "log" in names else {}
    resampled = {name: " ".join(f"{x:.4f}" for x in drawn) for name, drawn in {**logs, "mean": mean[1:]}.items()}
    of_class = Counter(one["category_id"] for one in pictures.truth["annotations"] if not one.get("iscrowd"))
    counts = {one["name"]: of_class[one["id"]] for one in pictures.truth["categories"]}
    return {"ap50": out, "pictures": len(pictures), "boxes": counts, "resampled": resampled}


def _interval(values: NDArray[np.float64]) -> list[float] | None:
    """The first value, and quantiles of the others that are known."""
    rest = values[1:][np.isfinite(values[1:])]
    if not np.isfinite(values[0]):
        return None
    if not len(rest):
        return [float(values[0])] * 3
    low, high = np.quantile(rest, [0.5 - 0.5 * LEVEL, 0.5 + 0.5 * LEVEL])
    return [float(values[0]), float(low), float(high)]


def _average_precision(found: list[dict[str, Any]], pictures: Pictures, resamples: int, seed: int) -> Any:
    """(1 + resamples, C) AP50 of all pictures, then of as many forests drawn of them with replacement; NaN: no box."""
    count = len(pictures.truth["categories"])
    with contextlib.redirect_stdout(io.StringIO()), warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)  # pycocotools with numpy 2
        truth: Any = COCO()
        numbered = [{"iscrowd": 0, **one, "id": at} for at, one in enumerate(pictures.truth["annotations"], start=1)]
        for one in numbered:
            one.setdefault("area", one["bbox"][2] * one["bbox"][3])
        truth.dataset = {**pictures.truth, "annotations": numbered}
        truth.createIndex()
        if not found:
            present = {one["category_id"] for one in numbered if not one["iscrowd"]}
            row = [0.0 if one["id"] in present else np.nan for one in pictures.truth["categories"]]
            return np.tile(np.array(row), (1 + resamples, 1))
        run: Any = COCOeval(truth, truth.loadRes(found), "bbox")
        run.params.iouThrs, run.params.areaRng, run.params.areaRngLbl = np.array([OVERLAP]), [[0.0, 1e10]], ["all"]
        run.params.maxDets = [100]
        run.evaluate()
    each = np.array(run.evalImgs, dtype=object).reshape(count, -1)  # of classes and pictures
    forests = _forests(pictures)
    rng = np.random.default_rng(seed)
    drawn = rng.multinomial(forests.max() + 1, np.full(forests.max() + 1, 1.0 / (forests.max() + 1)), resamples)
    times = np.concatenate([np.ones((1, len(forests)), dtype=np.int64), drawn[:, forests]])
    return np.column_stack([_of_class(list(row), times, run.params.recThrs) for row in each])


def _of_class(evaluated: list[Any], times: NDArray[np.int64], recalls: NDArray[np.float64]) -> NDArray[np.float64]:
    """(R,) average precision of a class by what pycocotools has matched in each picture, where each counts so many times.

    Args:
        evaluated: Of each picture, None where there is nothing of the class.
        times: (R, P) that each picture counts.
        recalls: At which precision is read, as COCO has it.
    """
    known = [(place, one) for place, one in enumerate(evaluated) if one is not None]
    boxes = np.zeros(times.shape[1])
    boxes[[place for place, _ in known]] = [np.sum(np.asarray(one["gtIgnore"]) == 0) for _, one in known]
    scores = np.concatenate([np.zeros(0), *(one["dtScores"] for _, one in known)])
    found = np.concatenate([np.zeros(0, bool), *(np.asarray(one["dtMatches"])[0] > 0 for _, one in known)])
    counts = np.concatenate([np.zeros(0, bool), *(~np.asarray(one["dtIgnore"], bool)[0] for _, one in known)])
    pictures = np.concatenate([np.zeros(0, int), *(np.full(len(one["dtScores"]), place) for place, one in known)])
    order = np.argsort(-scores, kind="stable")
    order = order[counts[order]]
    found, pictures = found[order], pictures[order]
    out = np.full(len(times), np.nan)
    for number, row in enumerate(times):
        whole, weights = float(boxes @ row), row[pictures]
        if whole == 0.0:
            continue
        right, every = np.cumsum(found * weights), np.cumsum(weights)
        precision = np.maximum.accumulate((right / np.maximum(every, 1))[::-1])[::-1]
        at = np.searchsorted(right / whole, recalls - 1e-12, side="left")
        out[number] = np.append(precision, 0.0)[np.minimum(at, len(precision))].mean()
    return out


def _forests(pictures: Pictures) -> NDArray[np.int64]:
    """(P,) number of the forest that each picture is of."""
    names = [str(one.get("world_seed", f"picture {place}")) for place, one in enumerate(pictures.truth["images"])]
    return np.unique(names, return_inverse=True)[1]
