"""Tables of leave-one-level-out fits."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from aoro_gym.execution.files import read_json
from aoro_gym.simulation.key_figures import FIGURES
from aoro_gym.validation.published import published_rows

TRANSIENT = FIGURES[3:]
"""First peak and its time, lowest undershoot, second peak."""
LEVELS = (100.0, 75.0, 50.0)
"""Signal [%] of the left turns."""
NAMES = {"mevea": "published twin", "physical": "real machine"}


def published_twin_errors() -> dict[float, float]:
    """Mean relative error of the published twin's transient figures against the real machine's, by level [%]."""
    rows = {(row["source"], row["signal_percent"]): row for row in published_rows() if row["direction"] == "left"}
    out = {}
    for level in LEVELS:
        twin, machine = (
            np.array([rows[source, level][name] for name in TRANSIENT], dtype=np.float64) for source in NAMES
        )
        out[level] = float(np.mean(np.abs(twin / machine - 1.0)))
    return out


def results(folder: Path) -> list[dict[str, Any]]:
    """Results of the families in a folder, in the order of their names; fits may be missing."""
    return [read_json(path) for path in sorted(folder.glob("*.json")) if not path.name.startswith(".")]


def markdown(folder: Path) -> str:
    """A table a reference: what each family predicts of the level left out, and how well it fits the others."""
    own = published_twin_errors()
    found = results(folder)
    parts = []
    for reference, name in NAMES.items():
        rows = []
        for result in found:
            splits = [result["splits"].get(f"{reference}-{level:g}") for level in LEVELS]
            scores = [split["score"] for split in splits if split is not None and split["score"] is not None]
            unfitted = result.get("not_fitted", {}).get(reference, {})
            whole = len(scores) == len(LEVELS)
            rows.append(
                [
                    result["family"],
                    *(_percent(split and split["score"]) for split in splits),
                    _percent(float(np.mean(scores)) if whole else None),
                    _joined(splits, lambda split: f"{split['rms_miss_tolerances']:.2f}"),
                    _joined(splits, lambda split: str(len(split["at_bounds"]))),
                    str(len(result.get("searched", []))),
                    ", ".join(_percent(level["transient_error"]) for level in unfitted.values()) or "-",
                ]
            )
        if reference == "physical":
            half = [0.5 * own[level] for level in LEVELS]
            bounds = [*map(_percent, half), _percent(float(np.mean(half)))]
            rows.append(["half of the published twin's own error", *bounds, "", "", "", ""])
        head = ["family", *(f"{level:g} % left out" for level in LEVELS), "mean"]
        head += ["fit, tolerances", "at a bound", "searched", "not fitted"]
        lines = [head, ["---"] * len(head), *rows]
        parts.append(f"Figures of the {name}:\n\n" + "\n".join(f"| {' | '.join(line)} |" for line in lines))
    return "\n\n".join(parts) + "\n"


def _joined(splits: list[Any], shown: Any) -> str:
    return ", ".join("-" if split is None else shown(split) for split in splits)


def _percent(share: float | None) -> str:
    return "-" if share is None else f"{100.0 * share:.1f} %"
