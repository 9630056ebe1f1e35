"""What each effect does to the key figures of full left turns: the twin against theory in the same laws.

``python -m studies.sensitivities [--machine FILE ...] [--laws FAMILY ...] [--options] [--limits] [--out FOLDER]`` (two
minutes on one core for each machine; ``--options`` as much again for each of 29).

With ``--options`` twin and theory are also compared for each option of a law that the machines obey, on its own beside the
default ones: a disagreement of a machine that an option has, too, and the default laws have not, is that option's.
"""

from __future__ import annotations

import argparse
import json
from collections import Counter
from collections.abc import Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from aoro_gym import Machine, Twin
from aoro_gym.execution.files import write_text
from aoro_gym.machine.laws import OPTIONS
from aoro_gym.simulation.key_figures import SECOND_PEAK, TOLERANCE
from aoro_gym.validation.theory.circuit import Array, load_sensing_loop
from aoro_gym.validation.theory.planar import Planar, oil_mode
from aoro_gym.validation.theory.sensitivities import (
    FIGURES,
    LEVELS,
    RATE,
    SILENT,
    Cases,
    cases,
    predicted_angles,
)
from aoro_gym.validation.theory.states import LIMITS
from aoro_gym.validation.turns import LONGEST_TURN, REST_AFTER, REST_BEFORE

NEAR = 0.15
"""Relative error of a sensitivity that counts as agreement."""
FLOOR = 2e-4
"""Relative change of a figure below which single precision and the time step are not told from an effect."""
SCATTERS = 2.0
"""Standard deviations over the clock's phase that a change has to pass to be resolved."""
APART = 0.04
"""Time [s] by which instants of an extreme differ that are not the same extreme."""
EDGE = 0.015
"""Time [s] from a window's end within which an extreme is the window's, not the curve's."""
CARRIES = 0.5
"""Share of a sensitivity that vanishes or comes without a law, from which on the law is said to carry it."""
TRANSIENT_FIGURES = FIGURES[1:4]
"""Figures that the first second decides."""
ONSET = 1.0
"""Time [s] from the command on in which they are read."""
MIDDLE = np.radians(-25.0)
"""Joint angle [rad] at which the circuit is linearised: where it is half a second after the start."""


def twin_angles(turns: Cases, machine: Machine, device: str = "cpu") -> tuple[Array, Array]:
    """Instants [s] (F,) and joint angles [rad] (F, L) of twins: rest, turn, rest at the stop."""
    reach = np.broadcast_to(np.asarray(machine.joint.range), turns.level.shape)
    twin = Twin(len(turns.level), machine=machine, terrain=turns.plane, device=device, check_step=False)
    twin.reset(joint_angle=-reach)
    rested, signal, duration, angles = 0.0, np.zeros(len(turns.level)), REST_BEFORE, []
    while rested < REST_AFTER and len(angles) * 0.5 < LONGEST_TURN:
        trace = twin.step({"steering_signal": signal}, duration, sample_every=1.0 / RATE)
        assert trace is not None
        angles.append(trace["joint_angle"].astype(np.float64))
        rested += np.count_nonzero((reach - angles[-1] <= TOLERANCE).all(axis=1)) / RATE
        signal, duration = turns.level, 0.5
    angle = np.concatenate(angles)
    return np.arange(1, len(angle) + 1) / RATE, angle


def verdict(theory: float, twin: float, resolved: float) -> str:
    """Agreement of two sensitivities, of which less than ``resolved`` cannot be told from none."""
    if not np.isfinite(theory + twin):
        return "no turn"
    if abs(theory) <= resolved and abs(twin) <= resolved:
        return "none"
    if abs(twin - theory) <= max(NEAR * abs(theory), resolved):
        return "near"
    if abs(theory) <= resolved:
        return "not predicted"
    if abs(twin) <= resolved:
        return "not seen"
    return "sign" if theory * twin > 0.0 else "opposed"


def limits_that_carry(turns: Cases, theory: Array) -> Array:
    """Number of the limit (levels, changes, figures) without which theory's sensitivity of a transient figure is another by
    half of it or more, -1 where there is none."""
    shifts = []
    for name in LIMITS:
        angles = predicted_angles(turns, [[name]] * len(turns.level), ONSET)
        shifts.append(np.nan_to_num(np.abs(turns.sensitivities(turns.figures(*angles))[0] - theory), nan=np.inf))
    shift = np.stack(shifts)
    carries = shift.max(axis=0) > np.maximum(CARRIES * np.abs(theory), FLOOR)
    carries[:, :, [figure not in TRANSIENT_FIGURES for figure in FIGURES]] = False
    return np.where(carries, np.argmax(shift, axis=0), -1)


@dataclass(frozen=True, eq=False)
class Compared:
    """Sensitivities (levels, changes, figures) of one machine by theory and by the twin."""

    machine: Machine  # one variant
    theory: Array
    twin: Array
    resolved: Array
    """Below which neither is told from none."""
    verdicts: Array
    figures: tuple[Array, Array]
    """Key figures (phases, levels, lanes, figures) by theory and by the twin."""
    places: tuple[Array, Array]
    carried: Array
    """Number of the limit that carries it, -1 without."""

    @property
    def apart(self) -> Array:
        """Where twin and theory disagree."""
        return ~np.isin(self.verdicts, ("none", "near"))


def compared(machine: Machine, *, limits: bool = False, device: str = "cpu") -> Compared:
    """Sensitivities of ``machine`` (one variant), theory and twin with its laws."""
    turns = cases(machine)
    predicted, seen = predicted_angles(turns), twin_angles(turns, turns.machine, device)
    figures = (turns.figures(*predicted), turns.figures(*seen))
    (theory, scatter), (twin, noise) = (turns.sensitivities(values) for values in figures)
    resolved = np.maximum(FLOOR, SCATTERS * np.maximum(scatter, noise))
    said = [verdict(*cell) for cell in zip(theory.flat, twin.flat, resolved.flat, strict=True)]
    carried = limits_that_carry(turns, theory) if limits else np.full(theory.shape, -1)
    return Compared(
        machine, theory, twin, resolved, np.array(said).reshape(theory.shape), figures,
        (turns.places(*predicted), turns.places(*seen)), carried,
    )  # fmt: skip


def laws_apart(own: Compared, alone: Mapping[tuple[str, str], Compared]) -> Array:
    """Text (levels, changes, figures) of the law in which ``own`` twin and theory are apart, "" where they are not.

    Of the options in which they are apart alone, too, and the default laws are not, the one with the largest difference.

    Args:
        own: A machine with its laws.
        alone: Each option of a law on its own beside the default ones; under ("", "") those alone.
    """
    default, largest = alone["", ""].apart, np.zeros(own.theory.shape)
    out = np.where(own.apart, np.where(default, "default laws", "several laws"), "").astype(object)
    for law, option in own.machine.laws.names.items():
        if option != OPTIONS[law][0]:
            one = alone[law, str(option)]
            off = np.where(own.apart & ~default & one.apart, np.abs(one.twin - one.theory), 0.0)
            out[off > largest] = f"{law}: {option}"
            largest = np.maximum(largest, off)
    return out


def place_remarks(theory: Array, twin: Array) -> list[dict[str, str]]:
    """Why extremes are not comparable, by figure and level: from their instants (levels, 2) since t = 0."""
    out = []
    for at_theory, at_twin in zip(theory, twin, strict=True):
        remarks = {}
        if abs(at_theory[0] - at_twin[0]) > APART:
            remarks[FIGURES[2]] = (
                f"another minimum is the lowest: at {at_theory[0]:.2f} s by theory, {at_twin[0]:.2f} s"
            )
        if min(abs(at_twin[1] - edge) for edge in SECOND_PEAK) < EDGE:
            remarks[FIGURES[3]] = f"read at the end of its window, {at_twin[1]:.2f} s: it moves with the curve's slope"
        elif abs(at_theory[1] - at_twin[1]) > APART:
            remarks[FIGURES[3]] = (
                f"another maximum is the highest: at {at_theory[1]:.2f} s by theory, {at_twin[1]:.2f} s"
            )
        out.append(remarks)
    return out


def linear_part(turns: Cases) -> list[dict[str, Any]]:
    """What each change does to the oil's mode and to the pump's pressure loop, by level."""
    planar = Planar(turns.machine, turns.level)
    frequency, damping = oil_mode(planar, MIDDLE)
    crossover, _ = load_sensing_loop(turns.machine, planar.steady(MIDDLE)[1])
    values = np.stack([np.broadcast_to(x, turns.level.shape) for x in (frequency, damping, crossover)])
    values = values.reshape(3, len(LEVELS), turns.count)
    names = ["none"] + [change.name for change in turns.changes for _ in change.sizes]
    rows, seen = [], set()
    for lane, name in enumerate(names):
        if name in seen:
            continue
        seen.add(name)
        for level, signal in enumerate(LEVELS):
            own, base = values[:, level, lane], values[:, level, 0]
            rows.append(
                {
                    "effect": name,
                    "signal_percent": 100.0 * signal,
                    "natural_frequency_rad_per_s": own[0],
                    "natural_frequency_change": own[0] / base[0] - 1.0,
                    "damping_ratio": own[1],
                    "damping_change": own[1] - base[1],
                    "load_sensing_crossover_change": own[2] / base[2] - 1.0,
                }
            )
    return rows


def table_of(own: Compared, alone: Mapping[tuple[str, str], Compared]) -> dict[str, Any]:
    """Table of sensitivities: theory beside the twin, and the laws in which they are apart, if ``alone`` is known."""
    turns = cases(own.machine)
    places = place_remarks(*own.places)
    laws = laws_apart(own, alone) if alone else np.full(own.theory.shape, "", dtype=object)
    rows = []
    for level, at, figure in np.ndindex(own.theory.shape):
        here = level, at, figure
        change, expected, found = turns.changes[at], float(own.theory[here]), float(own.twin[here])
        remarks = [SILENT[change.effect]] if change.effect in SILENT else []
        if own.apart[here]:
            remarks += [places[level][FIGURES[figure]]] if FIGURES[figure] in places[level] else []
        rows.append(
            {
                "effect": change.name,
                "size": list(change.sizes[0]),
                "signal_percent": 100.0 * LEVELS[level],
                "figure": FIGURES[figure],
                "theory": expected,
                "twin": found,
                "ratio": found / expected if abs(expected) > own.resolved[here] else None,
                "resolved": float(own.resolved[here]),
                "verdict": str(own.verdicts[here]),
                "limit": list(LIMITS)[own.carried[here]] if own.carried[here] >= 0 else None,
                "laws": laws[here] or None,
                "remark": "; ".join(remarks),
            }
        )
    rows.sort(key=lambda row: (row["effect"], -row["signal_percent"]))
    nominal = [values[:, :, 0].mean(axis=0).tolist() for values in own.figures]
    return {
        "machine": own.machine.name,
        "laws": own.machine.laws.names,
        "figures": list(FIGURES),
        "nominal": {"theory": nominal[0], "twin": nominal[1]},
        "counts": counts(rows),
        "laws_apart": dict(Counter(row["laws"] for row in rows if row["laws"]).most_common()),
        "linear": linear_part(turns),
        "rows": rows,
    }


def counts(rows: Sequence[Mapping[str, Any]]) -> dict[str, dict[str, int]]:
    """Number of rows of each verdict: of all, and of each figure and level."""
    out = {"all": Counter(row["verdict"] for row in rows)}
    for row in rows:
        for key in (row["figure"], f"{row['signal_percent']:g} %"):
            out.setdefault(key, Counter())[row["verdict"]] += 1
    return {key: dict(sorted(count.items())) for key, count in out.items()}


def rounded(value: Any) -> Any:
    """``value`` with floats of four digits, None for those that are not finite."""
    if isinstance(value, dict):
        return {key: rounded(one) for key, one in value.items()}
    if isinstance(value, list):
        return [rounded(one) for one in value]
    if isinstance(value, float):
        return float(f"{value:.4g}") if np.isfinite(value) else None
    return value


def json_of(result: Mapping[str, Any]) -> str:
    """JSON, a line for each row of a table."""
    parts = []
    for key, value in rounded(dict(result)).items():
        text = json.dumps(value, ensure_ascii=False, allow_nan=False)
        if isinstance(value, list) and value and isinstance(value[0], dict):
            text = "[\n" + ",\n".join(json.dumps(row, ensure_ascii=False, allow_nan=False) for row in value) + "\n]"
        parts.append(f"{json.dumps(key)}: {text}")
    return "{\n" + ",\n".join(parts) + "\n}\n"


def drawn(result: Mapping[str, Any], path: Path) -> None:
    """Twin over theory, one panel a figure, symmetric logarithmic axes; agreement lies in the band."""
    import matplotlib.pyplot as plt

    fig, axes = plt.subplots(1, len(FIGURES), figsize=(17, 3.9), constrained_layout=True)
    line = np.concatenate([-np.logspace(1.5, -2.5, 80), np.logspace(-2.5, 1.5, 80)])
    for ax, figure in zip(axes, FIGURES, strict=True):
        ax.fill_between(line, (1.0 - NEAR) * line, (1.0 + NEAR) * line, color="0.85", zorder=0)
        for level, colour in zip(LEVELS, ("#1b6ca8", "#e08e0b", "#7a9e3b"), strict=True):
            own = [r for r in result["rows"] if r["figure"] == figure and r["signal_percent"] == 100.0 * level]
            own = [r for r in own if r["verdict"] != "none"]
            x, y = (np.array([100.0 * r[key] for r in own]) for key in ("theory", "twin"))
            ax.plot(x, y, "o", ms=4, color=colour, label=f"{100.0 * level:g} %")
        ax.axhline(0.0, color="0.7", lw=0.5)
        ax.axvline(0.0, color="0.7", lw=0.5)
        ax.set_xscale("symlog", linthresh=0.1, linscale=0.5)
        ax.set_yscale("symlog", linthresh=0.1, linscale=0.5)
        ticks = [-10, -1, -0.1, 0, 0.1, 1, 10]
        ax.set(xlim=(-30, 30), ylim=(-30, 30), xticks=ticks, yticks=ticks)
        ax.set_xticklabels([f"{tick:g}" for tick in ticks])
        ax.set_yticklabels([f"{tick:g}" for tick in ticks])
        ax.set_title(figure.replace("_L_per_min", "").replace("_s", "").replace("_", " "))
        ax.set_xlabel("by theory [%]")
    axes[0].set_ylabel("by the twin [%]")
    axes[0].legend(title="signal", loc="upper left")
    fig.savefig(path, dpi=110)
    plt.close(fig)


def table(result: Mapping[str, Any]) -> str:
    """Markdown: one row an effect and level, theory / twin in per cent of the figure."""
    short = ("turn time", "first peak", "undershoot", "second peak", "steady flow")
    lines = ["| effect | size | signal | " + " | ".join(short) + " | remark |", "|---" * (len(short) + 4) + "|"]
    grouped: dict[tuple[str, float], list[Mapping[str, Any]]] = {}
    for row in result["rows"]:
        grouped.setdefault((row["effect"], row["signal_percent"]), []).append(row)
    marks = {
        "none": "",
        "no turn": " ∅",
        "near": "",
        "sign": " ~",
        "opposed": " ✗",
        "not predicted": " ?",
        "not seen": " –",
    }
    for (effect, signal), rows in grouped.items():
        by = {row["figure"]: row for row in rows}
        cells = []
        for figure in FIGURES:
            row = by[figure]
            text = "0" if row["verdict"] == "none" else f"{100 * row['theory']:+.2f} / {100 * row['twin']:+.2f}"
            cells.append(text + marks[row["verdict"]])
        size = ", ".join(f"{value:g}" for value in rows[0]["size"])
        limits = sorted({row["limit"] for row in rows if row["limit"] and row["verdict"] != "none"})
        said = [row[key] for row in rows for key in ("remark", "laws") if row[key]]
        remark = "; ".join(dict.fromkeys(said + limits))
        lines.append(f"| {effect} | {size} | {signal:g} % | " + " | ".join(cells) + f" | {remark} |")
    return "\n".join(lines) + "\n"


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--machine", nargs="+", default=["aoro"], help="names of bundled machines, or machine files")
    parser.add_argument("--laws", nargs="+", help="families of laws, instead of the machines' own")
    parser.add_argument("--options", action="store_true", help="also find the laws in which twin and theory are apart")
    parser.add_argument("--limits", action="store_true", help="also find the limit that carries each sensitivity")
    parser.add_argument("--device", default="cpu")
    parser.add_argument("--processes", type=int, default=1)
    parser.add_argument("--out", type=Path, default=Path("results/sensitivities"))
    asked = parser.parse_args()
    asked.out.mkdir(parents=True, exist_ok=True)
    machines = {
        family or Path(name).stem: Machine.load(name).with_laws(family) if family else Machine.load(name)
        for name in asked.machine
        for family in asked.laws or [None]
    }
    chosen = {(law, str(o)) for one in machines.values() for law, o in one.laws.names.items() if o != OPTIONS[law][0]}
    options = [("", ""), *sorted(chosen)] if asked.options else []
    plain = Machine.load("aoro").with_laws("default")
    single = [plain.with_laws(**{law: option}) if law else plain for law, option in options]
    with ProcessPoolExecutor(asked.processes) as pool:
        work = partial(compared, limits=asked.limits, device=asked.device)
        found = list(pool.map(work, [*machines.values(), *single]))
    alone = dict(zip(options, found[len(machines) :], strict=True))
    for name, own in zip(machines, found, strict=False):
        result = table_of(own, alone)
        write_text(asked.out / f"{name}.json", json_of(result))
        write_text(asked.out / f"{name}.md", table(result))
        drawn(result, asked.out / f"{name}.png")
        print(name, result["counts"]["all"], result["laws_apart"])


if __name__ == "__main__":
    main()
