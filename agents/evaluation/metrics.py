"""What is measured of an episode: which is better, over what, and how it is shown."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping, Sequence

from aoro_gym.agents.evaluation.statistics import Interval

SUCCESS = "success_rate"
RATES = (SUCCESS,)
"""Metrics that count episodes."""
OVER: Mapping[str, str] = {
    **dict.fromkeys(
        ("cross_track_rms_m", "cross_track_mean_m", "cross_track_p95_m", "speed_m_per_s", "energy_kJ", "duration_s"),
        "successful episodes",
    ),
    **dict.fromkeys(
        ("rise_time_s", "overshoot_deg", "worst_overshoot_deg", "flow_overshoot_share"), "targets that were reached"
    ),
}
"""What a metric is over, where it is not over everything that was driven; NaN of an episode that has nothing of it."""
BOUNDED: Mapping[str, str] = {"settling_time_s": "settled_share", "worst_tilt_deg": SUCCESS}
"""Metrics that are lower bounds in an episode whose share, of the other name, is below 1: of a target that was not settled
the time that it stood counts, and of a path that was not driven to its end the part that was."""
MORE_IS_BETTER = (
    SUCCESS,
    "speed_m_per_s",
    "return",
    "settled_share",
    "driven_m",
    "success_by_length_share",
    "placed_share",
)
UNITS = {
    "m_per_s": "m/s", "kJ_per_m": "kJ/m", "m_per_m": "m/m", "kJ": "kJ", "kNs": "kN s", "kN": "kN", "deg": "°", "m": "m",
    "s": "s", "rate": "%",
    "share": "%",
}  # fmt: skip
"""By the last words of a metric's name."""
SHORT = {"successful episodes": "of successes", "targets that were reached": "of targets reached"}
"""What metrics are over, in a table."""
LOWER_BOUND = "≥: a lower bound, as not all targets were settled or paths driven."
FEWER_EPISODES = "(n): over n episodes, as the others have none."


def ranked(metrics: Mapping[str, Mapping[str, Interval]], decisive: str) -> list[str]:
    """Policies from the best to the worst by their metrics: success first, then ``decisive``; who has none of it is last."""
    sign = -1.0 if decisive in MORE_IS_BETTER else 1.0

    def rank(policy: str) -> tuple[float, float]:
        value = sign * metrics[policy][decisive].mean
        return -metrics[policy][SUCCESS].mean, value if math.isfinite(value) else math.inf

    return sorted(metrics, key=rank)


def describe(name: str) -> tuple[str, str]:
    """Words and unit of a metric: ``cross_track_rms_m`` is ('cross track rms', 'm')."""
    for end, unit in UNITS.items():
        if name.endswith(f"_{end}"):
            words = name if unit == "%" else name.removesuffix(f"_{end}")
            return words.replace("_", " "), unit
    return name.replace("_", " "), ""


def display_factor(unit: str) -> float:
    """Factor from a metric to what is shown of it."""
    return 100.0 if unit == "%" else 1.0


def named(name: str) -> tuple[str, str]:
    """The same, with what the metric is over where that is not everything: ('cross track rms, of successes', 'm')."""
    words, unit = describe(name)
    return (f"{words}, {SHORT[OVER[name]]}", unit) if name in OVER else (words, unit)


def titled(name: str) -> str:
    """Words and unit of a metric, and whether more or less of it is better."""
    words, unit = describe(name)
    return f"{words} [{unit}], {'more' if name in MORE_IS_BETTER else 'less'} is better"


def verdict(name: str, difference: Interval) -> str:
    """ "better" or "worse" of a difference whose interval leaves out 0; else nothing."""
    low, high = difference.low95, difference.high95
    if not (low > 0.0 or high < 0.0):  # NaN, too
        return ""
    return "better" if (low > 0.0) == (name in MORE_IS_BETTER) else "worse"


def shown(value: Interval, unit: str, *, finer: int = 0, total: int | None = None) -> str:
    """``mean [low, high]`` to three digits of the mean and ``finer`` ones; shares in per cent. After ``≥`` where it is a
    lower bound, before ``(n)`` where it is over n episodes of the ``total`` only."""
    if not math.isfinite(value.mean):
        return "-"
    scale = display_factor(unit)
    size = abs(scale * value.mean)
    digits = 0 if unit == "%" or size >= 100.0 else 1 if size >= 10.0 else 2 if size >= 1.0 else 3
    mean, low, high = (f"{scale * number:.{digits + finer}f}" for number in value[:3])
    text = mean if not math.isfinite(value.low95) else f"{mean} [{low}, {high}]"
    if value.bounds:
        text = f"≥ {text}"
    return text if value.episodes is None or total in (None, value.episodes) else f"{text} ({value.episodes})"


def explained(rows: Iterable[Sequence[str]]) -> str:
    """What the marks of :func:`shown` in a table's cells mean; empty where there are none."""
    cells = [cell for row in rows for cell in row[1:]]
    found = {
        LOWER_BOUND: any(cell.startswith("≥") for cell in cells),
        FEWER_EPISODES: any(re.search(r"\(\d+\)$", cell) for cell in cells),
    }
    return " ".join(meaning for meaning, there in found.items() if there)
