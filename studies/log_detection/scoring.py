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
"""Of the bootstrap over pictures."""
LEVEL = 0.95
OVERLAP = 0.5
"""Intersection over union from which a box counts as found: AP50."""


def told(detector: Detector, pictures: Pictures) -> list[dict[str, Any]]:
    """Boxes that a detector tells, as COCO's results, in the pixels of the files."""
    found = []
    for number, boxes in enumerate(detect(detector, pictures.pixels)):
        for x0, y0, x1, y1, score, kind in (boxes / ([*[pictures.scales[number]] * 4, 1.0, 1.0])).tolist():
            box = [x0, y0, x1 - x0, y1 - y0]
            one = {"image_id": pictures.ids[number], "category_id": int(kind) + 1, "bbox": box, "score": score}
            found.append(one)
    return found


def score(detector: Detector, pictures: Pictures, *, resamples: int = RESAMPLES, seed: int = 0) -> dict[str, Any]:
    """AP50 of each class and their mean, each ``[value, low, high]`` with the ends of its interval of 95 % over pictures.

    A class of which the pictures have none is null. The mean is over the classes that there are.
    """
    values = _average_precision(told(detector, pictures), pictures, resamples, seed)
    names = [one["name"] for one in pictures.truth["categories"]]
    out: dict[str, Any] = {name: _interval(values[:, place]) for place, name in enumerate(names)}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # mean of nothing
        out["mean"] = _interval(np.nanmean(values, axis=1))
    of_class = Counter(one["category_id"] for one in pictures.truth["annotations"] if not one.get("iscrowd"))
    counts = {one["name"]: of_class[one["id"]] for one in pictures.truth["categories"]}
    return {"ap50": out, "pictures": len(pictures), "boxes": counts}


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
    """(1 + resamples, C) AP50 of all pictures, then of as many that are drawn of them with replacement; NaN: no box."""
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
        pictures_there = each.shape[1]
        rng = np.random.default_rng(seed)
        rows = []
        for number in range(1 + resamples):
            chosen = np.arange(pictures_there) if number == 0 else rng.integers(pictures_there, size=pictures_there)
            run.evalImgs = each[:, chosen].ravel().tolist()
            run.params.imgIds = run._paramsEval.imgIds = list(range(pictures_there))
            run.accumulate()
            precision = run.eval["precision"][0, :, :, 0, 0]  # of recalls and classes
            rows.append(np.where((precision > -1.0).any(axis=0), precision.mean(axis=0), np.nan))
        return np.array(rows)
