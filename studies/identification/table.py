"""Tables of fits and of what they predict."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from aoro_gym.calibration.space import Space
from aoro_gym.execution.files import read_json
from aoro_gym.simulation.key_figures import FIGURES
from aoro_gym.validation.published import published_rows
from studies.identification.profiles import left_open
from studies.identification.structures import machine_of

TRANSIENT = FIGURES[3:]
"""First peak and its time, lowest undershoot, second peak."""
LEVELS = (100.0, 75.0, 50.0)
"""Signal [%] of the left turns."""
NAMES = {"mevea": "published twin", "physical": "real machine"}
MEMBERS = "members.json"
"""What machine files of structures meet."""
KINDS = ("steady", "first_peak", "undershoot", "second_peak", "shape")


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
    """Results of the structures in a folder, in the order of their names; fits may be missing."""
    paths = [path for path in sorted(folder.glob("*.json")) if not path.name.startswith(".") and path.name != MEMBERS]
    return [read_json(path) for path in paths]


def markdown(folder: Path) -> str:
    """Tables a reference: what each structure predicts of the level left out, then of figures of one kind left out."""
    found = results(folder)
    parts = []
    for reference, name in NAMES.items():
        parts.append(f"Figures of the {name}, a level left out:\n\n{_levels(found, reference)}")
    for reference, name in NAMES.items():
        if any(f"{reference}-{kind}" in result["splits"] for result in found for kind in KINDS):
            parts.append(f"Figures of the {name}, figures of one kind left out:\n\n{_kinds(found, reference)}")
    return "\n\n".join(parts) + "\n"


def profiles(folder: Path, structure: str, split: str) -> str:
    """A table of what the figures leave of each profiled parameter's range, those that they determine most first."""
    found = {result["structure"]: result for result in results(folder)}[structure]["profiles"][split]
    machine, grid, rows = machine_of(structure), np.array(found["grid"]), []
    for key, costs in found["costs"].items():
        values = np.array(costs)
        ends = left_open(values, grid)
        space, entry = Space(machine, [key]), machine.entries[key]
        (low, *_), (high, *_) = space.values(np.array(ends)[:, None])
        left = "-" if ends == (0.0, 1.0) else f"{low:.3g} to {high:.3g}"
        rows.append([
            f"`{key}`", "" if entry.unit == "1" else entry.unit, f"{entry.range[0]:.3g} to {entry.range[1]:.3g}", left,
            f"{100.0 * (ends[1] - ends[0]):.0f} %", f"{found['std_of_prior'][key]:.2f}",
            ", ".join(f"{cost:.1f}" for cost in values - np.min(values)),
        ])  # fmt: skip
    head = ["parameter", "unit", "range", "left by the figures, 95 %", "of the range", "spread left, to first order"]
    shares = ", ".join(f"{100.0 * share:.0f}" for share in grid)
    return table([*head, f"rise of the cost at {shares} %"], rows)


def _levels(found: Sequence[dict[str, Any]], reference: str) -> str:
    own = published_twin_errors()
    rows = []
    for result in found:
        splits = [result["splits"].get(f"{reference}-{level:g}") for level in LEVELS]
        scores = [split["score"] for split in splits if split is not None and split["score"] is not None]
        unfitted = result.get("not_fitted", {}).get(reference, {})
        rows.append([
            result["structure"],
            *(_with_range(split) for split in splits),
            _percent(float(np.mean(scores)) if len(scores) == len(LEVELS) else None),
            _joined(splits, lambda split: f"{split['rms_miss_tolerances']:.2f}"),
            _joined(splits, lambda split: str(len(split["at_bounds"]))),
            str(len(result.get("searched", []))),
            ", ".join(map(_percent, unfitted.values())) or "-",
        ])  # fmt: skip
    if reference == "physical":
        half = [0.5 * own[level] for level in LEVELS]
        bounds = [*map(_percent, half), _percent(float(np.mean(half)))]
        rows.append(["half of the published twin's own error", *bounds, "", "", "", ""])
    head = ["structure", *(f"{level:g} % left out" for level in LEVELS), "mean"]
    return table([*head, "fit, tolerances", "at a bound", "searched", "not fitted"], rows)


def _kinds(found: Sequence[dict[str, Any]], reference: str) -> str:
    rows = []
    for result in found:
        splits = [result["splits"].get(f"{reference}-{kind}") for kind in KINDS]
        shown = [_with_range(split) for split in splits[:-1]]
        shape = splits[-1]
        if reference == "mevea":
            shown.append("-" if shape is None or shape["score"] is None else f"{shape['score']:.1f}")
        rows.append([result["structure"], *shown])
    head = ["structure", "turn time, mean and steady flow", "first peak and its time", "undershoot", "second peak"]
    return table([*head, "shape, tolerances"] if reference == "mevea" else head, rows)


def table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A table of Markdown."""
    return "\n".join(f"| {' | '.join(line)} |" for line in (head, ["---"] * len(head), *rows))


def _with_range(split: dict[str, Any] | None) -> str:
    """Score of the fit of least cost, and the range of all seeds'."""
    if split is None:
        return "-"
    scores = [score for score in split.get("scores", []) if score is not None]
    if len(scores) < 2:
        return _percent(split["score"])
    return f"{_percent(split['score'])} ({100.0 * min(scores):.1f}–{100.0 * max(scores):.1f})"


def _joined(splits: Sequence[Any], shown: Callable[[Any], str]) -> str:
    return ", ".join("-" if split is None else shown(split) for split in splits)


def _percent(share: float | None) -> str:
    return "-" if share is None else f"{100.0 * share:.1f} %"
