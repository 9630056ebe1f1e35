"""What is published of the machine and of its first twin: the only place where these numbers live.

Lehto et al., Machines 2026, 14, 128. The tables stand in ``data/``, each with its source.
"""

from __future__ import annotations

import csv
from functools import cache
from importlib.resources import files

from aoro_gym.simulation.key_figures import FIGURES

Row = dict[str, str | float | None]
"""A row of key figures: ``direction``, ``signal_percent``, ``source``, and every name of ``FIGURES`` (None: unknown)."""


def published_rows() -> list[Row]:
    """Key figures of full turns: ``physical`` and ``mevea`` to the left, what is known of ``physical`` to the right."""
    rows: list[Row] = [
        {"direction": "left", "signal_percent": float(line["signal_percent"]), "source": line["source"]}
        | {name: float(line[name]) for name in FIGURES}
        for line in _table("left_turn_metrics.csv")
    ]
    full = published("full_signal")
    for line in reversed(_table("valve_flow.csv")):
        signal, flow = float(line["signal_V"]) / full, float(line["right_L_per_min"])
        if flow > 0.0:
            known: Row = dict.fromkeys(FIGURES) | {"mean_flow_L_per_min": flow}
            if signal == 1.0:
                known["turn_time_s"] = published("turn_time_right")
            rows.append({"direction": "right", "signal_percent": 100.0 * signal, "source": "physical"} | known)
    return rows


def valve_flow() -> dict[str, list[float]]:
    """Mean flow [L/min] of full turns by steering voltage away from the middle [V]; columns of the published table."""
    lines = _table("valve_flow.csv")
    return {name: [float(line[name]) for line in lines] for name in lines[0]}


def published(name: str) -> float:
    """A figure that stands alone, in the unit of ``data/single_figures.csv``."""
    for line in _table("single_figures.csv"):
        if line["name"] == name:
            return float(line["value"])
    raise KeyError(name)


@cache
def _table(name: str) -> list[dict[str, str]]:
    text = files("aoro_gym").joinpath("validation", "data", name).read_text(encoding="utf-8")
    return list(csv.DictReader(line for line in text.splitlines() if not line.startswith("#")))
