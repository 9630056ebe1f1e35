"""Ground and trunks in a lidar's sweeps: how well geometry alone tells them, on made forests and on a scan of your own.

    python -m studies.lidar_segmentation [--seeds 900,901] [--json FILE] [--picture FILE]
    python -m studies.lidar_segmentation --scan FILE.laz [--picture FILE]

The settings of :mod:`aoro_gym.sensors.lidar.segmentation` were chosen on seeds 100 to 103; the default ones here were looked
at once, for the scores that the documentation gives. A machine drives 0.75 m through each of the four stands while an OS1-64
turns five times of nine. In a scan, class 2 of the LAS standard is the ground by whoever classified it, who may have thinned
it: what counts there is the error of the ground's surface, against the triangles between the surveyor's points.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import LinearNDInterpolator

from aoro_gym.reporting.style import INK, SOFT
from aoro_gym.sensors.lidar import Lidar, Motion
from aoro_gym.sensors.lidar.segmentation import Label, height_over_ground, segment
from aoro_gym.sensors.raytrace import Scene
from aoro_gym.terrains.extras import import_extra
from aoro_gym.terrains.generate.stand import STANDS
from aoro_gym.terrains.generate.world import world
from aoro_gym.terrains.world.materials import Surface
from aoro_gym.terrains.world.objects import Kind

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SIZE, SPEED, TURNS = (60.0, 60.0), 0.75, (0, 2, 4, 6, 8)
"""Sides of a forest [m], speed [m/s], and which turns of a second are kept."""
BARK = (Surface.PINE_BARK, Surface.PINE_BARK_UPPER, Surface.SPRUCE_BARK, Surface.BIRCH_BARK)
SURVEYED_GROUND = 2
"""Class of the LAS standard."""
SCAN_TOLERANCE = 0.3
"""Height [m] over its surface up to which a scan's points count as ground: an aerial scanner's, not a vehicle's. E."""


def seen_points(seed: int, stand: str, turns: Sequence[int] = TURNS) -> tuple[NDArray[np.float32], NDArray[np.uint8]]:
    """Points (N, 3) [m] in the world's axes, and the :class:`Label` (N,) that each truly has, of some turns of a second."""
    made = world(seed, size=SIZE, stand=stand)
    scene = Scene.of_world(made)
    lidar = Lidar(scene, "os1-64", subrays=3, seed=seed)
    rng = np.random.default_rng(seed)
    while True:
        x, y = rng.uniform(-15.0, 15.0, 2)
        z = float(made.terrain.vertices[np.argmin(np.hypot(*(made.terrain.vertices[:, :2] - [x, y]).T)), 2])
        motion = Motion(np.array([0.0, 1.0]), np.array([[x, y, z], [x + SPEED, y, z]]), *np.zeros((3, 2)))
        try:
            sweeps = [lidar.sweep(motion, start=0.1 * turn, number=turn)[0] for turn in turns]
        except ValueError:  # within a trunk or a crown: elsewhere, then
            continue
        break
    points, instance, surface = (
        np.concatenate([getattr(sweep, name) for sweep in sweeps]) for name in ("world", "instance", "class_id")
    )
    kinds = made.scene().instance_kind[np.maximum(instance, 0)]
    truth = np.full(len(points), Label.OTHER, dtype=np.uint8)
    truth[instance == 0] = Label.GROUND
    truth[(instance > 0) & (kinds == Kind.TREE) & np.isin(surface, BARK)] = Label.TRUNK
    return points, truth


def score(found: NDArray[Any], truth: NDArray[Any]) -> dict[str, float]:
    """Precision, recall and intersection over union of two masks (N,)."""
    both, either = float((found & truth).sum()), float((found | truth).sum())
    return {
        "precision": both / max(float(found.sum()), 1.0),
        "recall": both / max(float(truth.sum()), 1.0),
        "iou": both / max(either, 1.0),
    }


def scores(points: NDArray[Any], truth: NDArray[Any]) -> dict[str, dict[str, float]]:
    """Of ground and trunks."""
    found = segment(points)
    return {label.name.lower(): score(found == label, truth == label) for label in (Label.GROUND, Label.TRUNK)}


def mean(rows: Sequence[Mapping[str, Any]]) -> dict[str, dict[str, float]]:
    """Of the scores of several forests."""
    return {
        label: {name: float(np.mean([row[label][name] for row in rows])) for name in rows[0][label]}
        for label in ("ground", "trunk")
    }


def surface_error(points: NDArray[Any], height: NDArray[Any], ground: NDArray[np.bool_]) -> dict[str, float]:
    """Error [m] of the ground's surface, by the ``height`` (N,) that points are found to have over it."""
    true = points[:, 2] - LinearNDInterpolator(points[ground, :2], points[ground, 2])(points[:, :2])
    error = (height - true)[np.isfinite(true)]
    return {
        "rms_m": float(np.sqrt(np.mean(error**2))),
        "median_m": float(np.median(error)),
        "share_beyond_0.3_m": float(np.mean(np.abs(error) > SCAN_TOLERANCE)),
    }


def scan(file: Path) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Points (N, 3) [m] of a classified cloud from its lowest corner, and which its surveyor calls ground."""
    laspy = import_extra("laspy", f"the point cloud {file.name}")
    cloud = laspy.read(str(file))
    points = np.asarray(cloud.xyz, dtype=np.float64)
    return points - points.min(axis=0), np.asarray(cloud.classification) == SURVEYED_GROUND


def picture(points: NDArray[Any], found: NDArray[Any], truth: NDArray[Any], title: str) -> Figure:
    """A slice 3 m thick from the side, as it is and as it was told, and the whole from above."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(10.0, 9.0), layout="constrained")
    plan, told, true = figure.subplot_mosaic([["a"], ["b"], ["c"]], height_ratios=[3.0, 1.0, 1.0]).values()  # type: ignore[misc]
    figure.suptitle(title, color=INK, fontsize=11)
    middle = np.median(points[:, 1])
    within = np.abs(points[:, 1] - middle) < 1.5
    colours = np.array(["#9fb79f", "#b08a5b", "#c22f2f"])
    for axes, labels, text in ((told, found, "told"), (true, truth, "true")):
        x, z = points[within][:, 0], points[within][:, 2]
        axes.scatter(x, z, c=colours[labels[within]], s=1.0, linewidths=0)
        axes.set(aspect="equal", ylabel=f"{text}: height [m]")
    for label in Label:
        here = found == label
        plan.scatter(*points[here, :2].T, c=colours[label], s=0.5, linewidths=0, label=label.name.lower())
    plan.axhspan(middle - 1.5, middle + 1.5, color=SOFT, alpha=0.15, linewidth=0)
    plan.set(aspect="equal", ylabel="north [m]")
    plan.legend(markerscale=10.0, loc="upper right")
    true.set_xlabel("east [m]")
    return figure


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", default="900,901", help="of made forests, by commas")
    parser.add_argument("--scan", type=Path, help="a classified cloud, .las or .laz, instead of made forests")
    parser.add_argument("--json", type=Path, help="file for the scores")
    parser.add_argument("--picture", type=Path, help="file for a picture of the last cloud, .png")
    asked = parser.parse_args()
    rows: list[dict[str, Any]] = []
    points, found, truth, title = np.zeros((0, 3)), np.zeros(0), np.zeros(0), ""
    if asked.scan is not None:
        points, ground = scan(asked.scan)
        title = asked.scan.name
        height = height_over_ground(points)
        found, truth = (np.abs(height) <= SCAN_TOLERANCE).astype(np.uint8), ground.astype(np.uint8)
        recall = score(found == 1, ground)["recall"]
        rows.append({"scan": title, "points": len(points), "recall": recall, **surface_error(points, height, ground)})
        print(json.dumps(rows[-1]))
    for seed in map(int, asked.seeds.split(",")) if asked.scan is None else ():
        for stand in STANDS:
            points, truth = seen_points(seed, stand)
            title = f"{STANDS[stand].text}, seed {seed}"
            rows.append({"seed": seed, "stand": stand, "points": len(points), **scores(points, truth)})
            print(json.dumps(rows[-1]), flush=True)
            found = segment(points)
    if asked.scan is None:
        rows.append({"mean": mean(rows)})
        print(json.dumps(rows[-1]))
    if asked.json is not None:
        asked.json.write_text(json.dumps(rows, indent=1) + "\n", encoding="utf-8")
    if asked.picture is not None:
        picture(points, found.astype(int), truth.astype(int), title).savefig(asked.picture, dpi=110)


if __name__ == "__main__":
    main()
