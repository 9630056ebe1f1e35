"""The study's pictures: data sets of made forests that differ in what is drawn anew, and those of the other renderer."""

from __future__ import annotations

import os
from pathlib import Path

from aoro_gym.reporting import terminal
from aoro_gym.sensors.dataset import FACTORS, DatasetSettings, make
from studies.log_detection.pictures import CANVAS
from studies.log_detection.study import ABLATED, ABLATIONS, OTHERS, SIZES, TESTED

A_FOREST = 5
"""Pictures of a forest."""
TEST_SEED = 1000
"""Of the first forest and the first wood to score on; those to learn from begin at 0."""


def forest_sets() -> dict[str, DatasetSettings]:
    """Settings by folder. Sets of one seed stand at the same places of the same forests, but for what is fixed."""

    def settings(frames: int, seed: int, fixed: tuple[str, ...] = ()) -> DatasetSettings:
        return DatasetSettings(
            frames=frames,
            worlds=frames // A_FOREST,
            seed=seed,
            width=CANVAS[1],
            samples=1,
            left_only=True,
            near="log",
            fixed=fixed,
        )

    sets = {"train": settings(max(SIZES), 0), "test": settings(TESTED, TEST_SEED)}
    sets |= {name: settings(ABLATED, 0, FACTORS if name == "fixed" else (name,)) for name in ABLATIONS}
    return sets


def make_all(folder: Path, *, device: str = "cpu", processes: int = 1) -> None:
    """Make all sets that are not there yet; those of forests on a device, by so many processes."""
    os.environ.setdefault("MUJOCO_GL", "egl")  # before MuJoCo is imported
    from studies.log_detection import other_renderer

    sets = forest_sets()
    with terminal.progress("rendering") as tell:
        whole = len(sets) + 2
        for number, (name, settings) in enumerate(sets.items()):
            if not (folder / name / "manifest.json").exists():
                make(
                    folder / name,
                    settings,
                    device=device,
                    processes=processes,
                    progress=lambda share, at=number, what=name: tell("rendering", (at + share) / whole, what),
                )
        for number, (name, count, seed) in enumerate((("other", OTHERS[0], 0), ("other_test", OTHERS[1], TEST_SEED))):
            other_renderer.make(
                folder / name,
                count,
                seed,
                progress=lambda share, at=number, what=name: tell("rendering", (len(sets) + at + share) / whole, what),
            )
