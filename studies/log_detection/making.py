"""The study's pictures: data sets of made forests that differ in what is drawn anew, and those of the other renderer."""

from __future__ import annotations

import os
from pathlib import Path

from aoro_gym.reporting import terminal
from aoro_gym.sensors.dataset import FACTORS, DatasetSettings, make
from studies.log_detection.scale import Scale
from studies.log_detection.study import ABLATIONS

OF_TEST_FOREST = 5
"""Pictures of a forest to score on."""
TEST_SEED = 1000
"""Of the first forest and the first wood to score on; those to learn from begin at 0."""


def forest_sets(scale: Scale) -> dict[str, DatasetSettings]:
    """Settings by folder. Sets of one seed stand at the same places of the same forests, but for what is fixed."""

    def settings(frames: int, seed: int, of_forest: int, fixed: tuple[str, ...] = ()) -> DatasetSettings:
        return DatasetSettings(
            frames=frames,
            worlds=frames // of_forest,
            seed=seed,
            width=scale.canvas[1],
            samples=1,
            formats=(),
            left_only=True,
            near="log",
            fixed=fixed,
        )

    of_forest = scale.of_forest
    sets = {"train": settings(max(scale.sizes), 0, of_forest)}
    sets["test"] = settings(scale.tested, TEST_SEED, OF_TEST_FOREST)
    for name in ABLATIONS:
        sets[name] = settings(scale.ablated, 0, of_forest, FACTORS if name == "fixed" else (name,))
    return sets


def make_all(folder: Path, scale: Scale, *, device: str = "cpu", processes: int = 1) -> None:
    """Make all sets that are not there yet; those of forests on a device, by so many processes.

    Args:
        folder: Of the sets.
        scale: Of the study.
        device: Where rays are cast.
        processes: That take pictures at once.
    """
    os.environ.setdefault("MUJOCO_GL", "egl")  # before MuJoCo is imported
    from studies.log_detection import other_renderer

    sets = {name: each for name, each in forest_sets(scale).items() if not (folder / name / "manifest.json").exists()}
    others = {"other": (scale.others[0], 0), "other_test": (scale.others[1], TEST_SEED)}
    counts = {name: each.frames for name, each in sets.items()} | {name: count for name, (count, _) in others.items()}
    whole, done = sum(counts.values()), 0
    with terminal.progress("rendering") as show:

        def tell(name: str, share: float) -> None:
            show("rendering", (done + share * counts[name]) / whole, name)

        for name, settings in sets.items():
            make(
                folder / name,
                settings,
                device=device,
                processes=processes,
                progress=lambda share, what=name: tell(what, share),
            )
            done += counts[name]
        for name, (count, seed) in others.items():
            other_renderer.make(
                folder / name, count, seed, size=scale.canvas, progress=lambda share, what=name: tell(what, share)
            )
            done += count
