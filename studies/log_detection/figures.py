"""Curves of the study, pictures with what the best detector tells, and five of its failures."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from aoro_gym.execution.files import read_json, written_whole
from aoro_gym.reporting.style import AMBER, BLUE, GREEN, INK, PLOT_STYLE, PURPLE, RED, SOFT
from studies.log_detection.detector import Detector, detect
from studies.log_detection.drawing import drawn, enlarged, sheet
from studies.log_detection.pictures import CLASSES, Pictures
from studies.log_detection.scale import Scale
from studies.log_detection.study import ABLATIONS, forests

LINES = {"mean": INK, "trunk": AMBER, "log": RED, "log_end": PURPLE, "stump": BLUE}
TITLES = {
    "train": "all drawn anew",
    "light": "light fixed",
    "weather": "weather fixed",
    "texture": "albedos fixed",
    "season": "season fixed",
    "fixed": "all fixed",
}
FAILURES = (("log", False), ("log_end", False), ("stump", False), ("log", True), ("trunk", True))
"""Class, and whether it is the largest object that was missed (or the surest box where nothing is)."""
SURE = 0.1
"""Least score of a box that counts as having found something."""
FOUND = 0.5
"""Overlap from which a box has found an object, and below half of which with all there is nothing near it."""

Score = dict[str, Any]


def scores(results: Path, kind: str, data: str, tested: str) -> dict[int, list[Score]]:
    """AP50 by pictures that were learnt from, of each seed."""
    found: dict[int, list[Score]] = {}
    for file in sorted(results.glob(f"{kind}_{data}_*.json")):
        one = read_json(file)
        found.setdefault(one["pictures"], []).append(one["scores"][tested]["ap50"])
    return dict(sorted(found.items()))


def middle(rows: Sequence[Score], name: str) -> NDArray[np.float64]:
    """Value and ends of the interval of a class, the means over seeds."""
    return np.mean([row[name] for row in rows], axis=0)


def differences(results: Path, tested: str, name: str) -> dict[str, list[float]]:
    """AP50 of a class, or the mean, that sets in which something is fixed lose beside the one in which all is drawn anew:
    value and interval of 95 % over forests, of the mean over the seeds that both have."""
    drawn: dict[str, dict[int, NDArray[np.float64]]] = {}
    for data in TITLES:
        for file in results.glob(f"ablation_{data}_*.json"):
            one = read_json(file)
            of_set = one["scores"][tested]
            values = [of_set["ap50"][name][0], *map(float, of_set["resampled"][name].split())]
            drawn.setdefault(data, {})[one["seed"]] = np.array(values)
    found = {}
    for data, seeds in drawn.items():
        both = sorted(seeds.keys() & drawn.get("train", {}).keys())
        if data != "train" and both:
            apart = np.mean([drawn["train"][seed] - seeds[seed] for seed in both], axis=0)
            found[data] = [float(apart[0]), *map(float, np.quantile(apart[1:], [0.025, 0.975]))]
    return found


def _line(
    axes: Any, found: Mapping[int, Sequence[Score]], name: str, at: Sequence[float], colour: str, text: str
) -> None:
    values = np.array([middle(rows, name) for rows in found.values()])
    axes.plot(at, values[:, 0], marker="o", markersize=3.5, color=colour, label=text)
    axes.fill_between(at, values[:, 1], values[:, 2], color=colour, alpha=0.12, linewidth=0)


def curves(results: Path, scale: Scale) -> Any:
    """By number of pictures, by what is not drawn anew, and by pictures of the other renderer."""
    import matplotlib
    from matplotlib.figure import Figure

    with matplotlib.rc_context(PLOT_STYLE):
        figure = Figure(figsize=(12.0, 3.9), layout="constrained")
        sizes, ablations, transfer = figure.subplots(1, 3)
        found = scores(results, "size", "train", "test")
        for name, colour in LINES.items():
            _line(sizes, found, name, list(found), colour, name.replace("_", " "))
        sizes.set(
            xscale="log", xlabel="pictures of made forests", ylabel="AP50, other forests", title="Number of pictures"
        )
        sizes.set_xticks(scale.sizes, [str(count) for count in scale.sizes])
        sizes.minorticks_off()
        for number, name in enumerate(("train", *ABLATIONS)):
            rows = scores(results, "ablation", name, "test")[scale.ablated]
            for offset, part, colour in ((-0.15, "mean", INK), (0.15, "log", RED)):
                value, low, high = middle(rows, part)
                ablations.errorbar(
                    value, number + offset, xerr=[[value - low], [high - value]], fmt="o", color=colour, markersize=4,
                    label=part if number == 0 else None,
                )  # fmt: skip
        ablations.set_yticks(range(len(TITLES)), [TITLES[name] for name in ("train", *ABLATIONS)])
        ablations.invert_yaxis()
        ablations.set(xlabel="AP50, all drawn anew", title=f"What is not drawn anew, {scale.ablated} pictures")
        places = {count: number for number, count in enumerate(scale.shots)}
        for kind, colour, text in (("tuned", GREEN, "after made forests"), ("scratch", SOFT, "from scratch")):
            found = scores(results, kind, "other", "other_test")
            _line(transfer, found, "mean", [places[count] for count in found], colour, f"mean, {text}")
        transfer.set_xticks(range(len(scale.shots)), [str(count) for count in scale.shots])
        transfer.set(xlabel="pictures of the other renderer", ylabel="AP50, other woods", title="Another renderer")
        for axes in (sizes, ablations, transfer):
            axes.grid(True)
            axes.set_axisbelow(True)
            axes.spines[["top", "right"]].set_visible(False)
            axes.legend(frameon=False, fontsize=8.5, loc="lower left" if axes is ablations else "upper left")
        for axes in (sizes, transfer):
            axes.set_ylim(bottom=0.0)
    return figure


def overlaps(one: NDArray[Any], other: NDArray[Any]) -> NDArray[np.float64]:
    """(K, L) intersections over unions of boxes (K, 4) and (L, 4)."""
    low = np.maximum(one[:, None, :2], other[None, :, :2])
    high = np.minimum(one[:, None, 2:4], other[None, :, 2:4])
    both = np.clip(high - low, 0.0, None).prod(axis=2)
    areas = [(part[:, 2:4] - part[:, :2]).prod(axis=1) for part in (one, other)]
    return both / np.maximum(areas[0][:, None] + areas[1][None, :] - both, 1e-9)


def failure(
    pictures: Pictures, found: Sequence[NDArray[np.float32]], kind: int, missed: bool, seen: set[int]
) -> tuple[int, NDArray[Any]] | None:
    """Number of a picture and the box of the worst failure of a class in a picture that is not ``seen`` yet.

    Args:
        pictures: With what is there.
        found: What was told of each.
        kind: Place of the class.
        missed: Whether it is the largest object that no box found, or the surest box that is on nothing.
        seen: Numbers of pictures that are left out.
    """
    best: tuple[float, int, NDArray[Any]] | None = None
    for number, told in enumerate(found):
        there = pictures.boxes[number][pictures.labels[number] == kind]
        boxes = told[(told[:, 5] == kind) & (told[:, 4] >= SURE)]
        between = overlaps(there, boxes)
        if missed:
            chosen = there[between.max(axis=1, initial=0.0) < FOUND]
            sizes = (chosen[:, 2:] - chosen[:, :2]).prod(axis=1)
        else:
            chosen = boxes[between.max(axis=0, initial=0.0) < 0.5 * FOUND]
            sizes = chosen[:, 4]
        if number not in seen and len(chosen) and (best is None or sizes.max() > best[0]):
            best = float(sizes.max()), number, chosen[int(sizes.argmax())][:4]
    return None if best is None else best[1:]


def failures(pictures: Pictures, found: Sequence[NDArray[np.float32]]) -> tuple[Any, list[str]]:
    """A PIL image of five failures, left what is there, right what is told, the failure in white; and what each is."""
    from PIL import Image, ImageDraw

    times = enlarged(pictures.canvas)
    height, width = (times * edge for edge in pictures.canvas)
    out, texts, seen = Image.new("RGB", (2 * width + 8, len(FAILURES) * (height + 8) - 8), "white"), [], set()
    for row, (name, missed) in enumerate(FAILURES):
        worst = failure(pictures, found, CLASSES.index(name), missed, seen)
        if worst is None:
            continue
        number, box = worst
        seen.add(number)
        told = found[number][found[number][:, 4] >= SURE]
        true = drawn(pictures.pixels[number], pictures.boxes[number], pictures.labels[number])
        right = drawn(pictures.pixels[number], told[:, :4], told[:, 5], told[:, 4])
        for place, picture in enumerate((true, right)):
            x0, y0, x1, y1 = (times * float(edge) for edge in box)
            ImageDraw.Draw(picture).rectangle((x0 - 2, y0 - 2, x1 + 1, y1 + 1), outline="white", width=2)
            out.paste(picture, (place * (width + 8), row * (height + 8)))
        texts.append(f"picture {pictures.ids[number]}: {'missed' if missed else 'false'} {name}")
    return out, texts


def draw(data: Path, results: Path, out: Path, scale: Scale) -> None:
    """All three, into a folder; prints what is lost where something is fixed, and what the failures are."""
    for tested, name in product(("test", "other_test"), ("log", "mean")):
        for data_set, values in differences(results, tested, name).items():
            print(f"{tested}, {name}, {TITLES[data_set]}: " + "{:.3f} [{:.3f}, {:.3f}] below all".format(*values))
    with written_whole(out / "log_detection.png") as temporary:
        curves(results, scale).savefig(temporary, format="png", dpi=110)
    pictures = forests(data / "test", scale.canvas)
    best = Detector.load(data / "detectors" / f"long_train_{max(scale.sizes)}_0.safetensors")
    found = detect(best, pictures.pixels)
    shown = sheet(pictures, found, range(7, len(pictures), 17)[:6])
    image, texts = failures(pictures, found)
    for name, picture in (("log_detection_found", shown), ("log_detection_failures", image)):
        with written_whole(out / f"{name}.jpg") as temporary:
            picture.save(temporary, format="JPEG", quality=82, optimize=True)
    print("\n".join(texts))
