"""What a machine touched in a world: objects by part, from a recording."""

from __future__ import annotations

from typing import Any

import numpy as np

from aoro_gym.reporting.terminal import Comparison
from aoro_gym.simulation.manoeuvres import Trajectory
from aoro_gym.terrains.world.world import World
from aoro_gym.twin.records import OBJECT_PARTS

PART_NAMES = dict(
    zip(
        OBJECT_PARTS,
        (
            *("front left wheel", "front right wheel", "rear left wheel", "rear right wheel"),
            *("front chassis", "rear chassis"),
        ),
        strict=True,
    )
)
MOST_ROWS = 30
"""Of the table; the rest is in the JSON."""


def contacts(recording: Trajectory, world: World) -> list[dict[str, Any]]:
    """A row for each object that each part touched, by time: when first, how long [s], and the largest force [kN] on the
    part meanwhile."""
    period = float(np.median(np.diff(recording.time)))
    rows = []
    for part in OBJECT_PARTS:
        numbers = recording[f"touched_object_{part}"].astype(np.int64)
        force = np.sqrt(sum(recording[f"object_force_{axis}_{part}"] ** 2 for axis in "xyz"))
        for number in np.unique(numbers[numbers > 0]).tolist():
            touching = numbers == number
            rows.append(
                {
                    "part": PART_NAMES[part],
                    "object": number,
                    "kind": world.objects[number - 1].kind.name.lower(),
                    "first_s": round(float(recording.time[np.argmax(touching)]), 3),
                    "duration_s": round(float(touching.sum()) * period, 3),
                    "largest_force_kN": float(force[touching].max()) / 1e3,
                }
            )
    return sorted(rows, key=lambda row: row["first_s"])


def contact_table(rows: list[dict[str, Any]]) -> Comparison | str:
    """The table of :func:`contacts`, or a sentence where there is none."""
    if not rows:
        return "It touched no solid object."
    shown = [
        [
            row["part"], f"{row['kind']} {row['object']}", f"{row['first_s']:.2f} s", f"{row['duration_s']:.2f} s",
            f"{row['largest_force_kN']:.1f} kN",
        ]
        for row in rows[:MOST_ROWS]
    ]  # fmt: skip
    more = len(rows) - len(shown)
    head = ("part", "object", "first at", "for", "largest force")
    return Comparison("Objects touched", head, shown, lead=2, note=f"and {more} more in the JSON" if more else "")
