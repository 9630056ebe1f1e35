"""How far the twin's steps and its single precision are from the continuous laws: key figures, port pressures, flows.

Left turns at 100, 75 and 50 % signal are run with many steps in float32, as the twin is, and in float64
(:mod:`studies.convergence.precision`). What is off in float64 is discretisation, the rest is rounding. The reference is the
float64 build at hydraulic steps of 0.5 µs. Beside it stand the continuous equations, written apart and integrated by SciPy
(:mod:`tests.oracles.machine`; ``--solver``, minutes a turn), also with a command's delay that is a whole number of steps.

    python -m studies.convergence.run --json studies/convergence/steps.json
    python -m studies.convergence.run --solver 1e-6 --json studies/convergence/solver.json
"""

from __future__ import annotations

import argparse
import sys
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from aoro_gym.execution.files import write_json
from aoro_gym.machine import Machine
from aoro_gym.sensors.chain import sample
from aoro_gym.simulation.key_figures import FIGURES, key_figures_batch
from aoro_gym.twin import Twin
from aoro_gym.validation.published import published_rows
from aoro_gym.validation.study import TARGETS
from studies.convergence.precision import build
from tests.twin.test_against_reference import reset_state, run_reference

LEVELS = (1.0, 0.75, 0.5)
REST, DURATION = 0.6, 8.0
"""Time [s] of the signal's step, and of the whole record: the slowest turn and its rest."""
SAMPLE = 1e-3
"""Interval [s] of a record, or the main step if that is longer."""
BEFORE_TOUCH = 5e-3
"""Time [s] before the joint touches its stop, up to which signals are compared closely: the stop's bounces amplify."""
FINEST = (1.25e-4, 250)
"""Main step [s] and substeps of the reference: hydraulic steps of 0.5 µs."""
DEFAULT = (1e-3, 30)
SUBSTEPS = (10, 15, 20, 30, 60, 120, 240)
MAIN_STEPS = ((2e-3, 60), (1e-3, 30), (5e-4, 15), (2e-3, 600), (1e-3, 300), (5e-4, 150), (2.5e-4, 75))
"""Main steps with hydraulic ones of 33 µs, and of 3.3 µs, where the main step's own error shows."""
HALVED = ((2e-3, 30), (1e-3, 30), (5e-4, 30), (2.5e-4, 30), (1.25e-4, 30))
"""Both steps halved from line to line."""
WHOLE_DELAY = 0.012
"""Delay [s] of the command that is a whole number of every main step: one that is not spreads a step over two of them."""
CHANNELS = ("joint_angle", "joint_flow", "pressure_a", "pressure_b", "pump_pressure")
BAR, LITRE_PER_MINUTE = 1e5, 1.0 / 6e4


@dataclass(frozen=True, eq=False)
class Turns:
    """The three turns: instants [s] (F,), and channels (F, 3), SI."""

    time: NDArray[np.float64]
    channels: dict[str, NDArray[np.float64]]
    figures: NDArray[np.float64]  # (7, 3), read between samples

    def __getitem__(self, channel: str) -> NDArray[np.float64]:
        return self.channels[channel]


def figures(machine: Machine, time: NDArray[Any], angle: NDArray[Any], *, interpolate: bool = True) -> NDArray[Any]:
    """Key figures (7, 3) through the measuring chain."""
    ticks, sampled = sample(time, angle)
    read = key_figures_batch(ticks, sampled, machine, interpolate=interpolate)
    return np.array([read[name] for name in FIGURES])


def turns(kind: Any, machine: Machine, main_step: float, substeps: int) -> Turns:
    """Three left turns from rest at the right stop, in the twin of class ``kind``."""
    twin = kind(len(LEVELS), machine=machine, main_step=main_step, substeps=substeps, check_step=False)
    twin.reset(joint_angle=-np.asarray(machine.joint.range))
    every = max(main_step, SAMPLE)
    parts = [twin.step(duration=REST, sample_every=every)]
    parts.append(twin.step({"steering_signal": np.array(LEVELS)}, DURATION - REST, sample_every=every))
    if twin.diverged:
        raise RuntimeError(f"{substeps} substeps of {main_step} s: {twin.diverged}")
    time = np.concatenate([part.time for part in parts])
    channels = {name: np.concatenate([part[name] for part in parts]).astype(np.float64) for name in CHANNELS}
    return Turns(time, channels, figures(machine, time, channels["joint_angle"]))


def touches(reference: Turns, machine: Machine) -> NDArray[np.float64]:
    """When [s] each turn (3,) first reaches its stop."""
    return reference.time[np.argmax(reference["joint_angle"] > machine.joint.range, axis=0)]


def deviation(one: Turns, other: Turns, machine: Machine) -> dict[str, Any]:
    """How far two records are apart: figures relative, pressures of the ports [bar], joint flow [L/min]; up to the stop,
    and at all times."""
    off = np.abs(one.figures / other.figures - 1.0)
    figure, level = np.unravel_index(np.argmax(off), off.shape)
    every = round((one.time[1] - one.time[0]) / (other.time[1] - other.time[0]))
    free = one.time[:, None] < touches(other, machine) - BEFORE_TOUCH

    def apart(name: str) -> NDArray[np.float64]:
        return np.abs(one[name] - other[name][every - 1 :: every])

    ports = np.maximum(apart("pressure_a"), apart("pressure_b")) / BAR
    flow = apart("joint_flow") / LITRE_PER_MINUTE
    return {
        "figure": float(off.max()),
        "which": f"{FIGURES[figure]} at {100.0 * LEVELS[level]:g} %",
        "port_bar_peak": float(ports[free].max()),
        "port_bar_rms": float(np.sqrt(np.mean(ports[free] ** 2))),
        "port_bar_peak_with_stop": float(ports.max()),
        "flow_L_per_min_peak": float(flow[free].max()),
        "flow_L_per_min_rms": float(np.sqrt(np.mean(flow[free] ** 2))),
        "flow_L_per_min_peak_with_stop": float(flow.max()),
    }


def reached(one: Turns, machine: Machine) -> int:
    """How many of the 21 published figures are within their bounds, as they are published: read from samples."""
    read = figures(machine, one.time, one["joint_angle"], interpolate=False)
    rows = {row["signal_percent"]: row for row in published_rows() if row["source"] == "mevea"}
    count = 0
    for i, name in enumerate(FIGURES):
        kind, bound = TARGETS[name]
        known = np.array([float(rows[100.0 * level][name] or np.nan) for level in LEVELS])
        miss = read[i] - known if kind == "difference" else read[i] / known - 1.0
        count += int(np.count_nonzero(np.abs(miss) <= bound + 1e-6))
    return count


def compare(kinds: dict[str, Any], machine: Machine, steps: tuple[float, int], reference: Turns) -> dict[str, Any]:
    """One line of a table: both precisions against the ``reference``, and against each other."""
    runs = {name: turns(kind, machine, *steps) for name, kind in kinds.items()}
    main_step, substeps = steps
    return {
        "main_step_ms": 1e3 * main_step,
        "substeps": substeps,
        "hydraulic_step_us": 1e6 * main_step / substeps,
        **{name: deviation(run, reference, machine) | {"reached": reached(run, machine)} for name, run in runs.items()},
        "rounding": deviation(runs["float32"], runs["float64"], machine),
    }


def each_figure(kinds: dict[str, Any], machine: Machine, reference: Turns) -> list[dict[str, Any]]:
    """The 21 figures at the default steps: value, discretisation and rounding, relative."""
    narrow, wide = (turns(kinds[name], machine, *DEFAULT).figures for name in ("float32", "float64"))
    return [
        {
            "signal_percent": 100.0 * level,
            "figure": name,
            "reference": float(reference.figures[i, j]),
            "discretisation": float(wide[i, j] / reference.figures[i, j] - 1.0),
            "rounding": float(narrow[i, j] / wide[i, j] - 1.0),
        }
        for j, level in enumerate(LEVELS)
        for i, name in enumerate(FIGURES)
    ]


def orders(rows: list[dict[str, Any]], what: str) -> list[float]:
    """Order of the float64 error from each row to the next, whose steps are half as long."""
    errors = [row["float64"][what] for row in rows]
    return [float(np.log2(coarse / fine)) for coarse, fine in pairwise(errors)]


def solver(wide: Any, machine: Machine, reference: Turns, tolerance: float) -> list[dict[str, Any]]:
    """The ``reference`` against the continuous equations, a turn each, from the same state at rest.

    Args:
        wide: Class of the float64 twin, whose reset gives that state.
        machine: What turns.
        reference: What is held against the equations.
        tolerance: Relative and absolute one of SciPy's BDF.
    """
    twin = wide(1, machine=machine)
    twin.reset(joint_angle=-np.asarray(machine.joint.range))
    start = reset_state(twin)
    rows = []
    for j, (level, touch) in enumerate(zip(LEVELS, touches(reference, machine), strict=True)):
        duration = round(touch + REST, 1)
        time, signals = run_reference(machine, [(REST, {"steering_signal": level})], duration, start, tolerance)
        angle = signals["joint_angle"].reshape(-1, 1)
        there = Turns(time, {name: signals[name].reshape(-1, 1) for name in CHANNELS}, figures(machine, time, angle))
        ours = {name: reference[name][: len(time), j : j + 1] for name in CHANNELS}
        here = Turns(time, ours, reference.figures[:, j : j + 1])
        row = {"signal_percent": 100.0 * level, "tolerance": tolerance} | deviation(here, there, machine)
        del row["which"]
        print(row, file=sys.stderr)
        rows.append(row)
    return rows


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--json", type=Path, help="where to write all numbers")
    parser.add_argument("--machine", default="aoro")
    parser.add_argument("--solver", type=float, help="tolerance: hold the reference against SciPy's solver, instead")
    args = parser.parse_args()
    machine = Machine.load(args.machine)
    kinds = {"float32": Twin, "float64": build("aoro_float64", wide=True).Twin}
    reference = turns(kinds["float64"], machine, *FINEST)
    whole = machine.set({"steering.valve.command_delay": WHOLE_DELAY}, si=True)
    if args.solver:
        found = {"turns": solver(kinds["float64"], machine, reference, args.solver)}
        reference = turns(kinds["float64"], whole, *FINEST)
        found["turns_whole_delay"] = solver(kinds["float64"], whole, reference, args.solver)
        if args.json:
            write_json(args.json, {"machine": args.machine} | found)
        return
    coarser = turns(kinds["float64"], machine, FINEST[0], FINEST[1] // 2)
    result: dict[str, Any] = {
        "machine": args.machine,
        # of first order: what is left of the reference's own error is as much as twice the step changes
        "reference": deviation(coarser, reference, machine),
        "figures": each_figure(kinds, machine, reference),
    }
    tables = {
        "substeps": (machine, [(1e-3, n) for n in SUBSTEPS]),
        "main_step": (machine, MAIN_STEPS),
        "both_halved": (machine, HALVED),
        "both_halved_whole_delay": (whole, HALVED),
    }
    for name, (one, steps) in tables.items():
        result[name] = []
        finest = reference if one is machine else turns(kinds["float64"], one, *FINEST)
        for pair in steps:
            row = compare(kinds, one, pair, finest)
            result[name].append(row)
            print(f"{name}: {row['main_step_ms']:g} ms, {row['substeps']} substeps", file=sys.stderr)
            for kind in (*kinds, "rounding"):
                text = "  ".join(f"{key} {value:.3g}" for key, value in row[kind].items() if key != "which")
                print(f"  {kind:9} {text}  ({row[kind]['which']})", file=sys.stderr)
    result["orders"] = {
        what: orders(result["both_halved_whole_delay"], what) for what in ("figure", "port_bar_peak", "port_bar_rms")
    }
    print(result["reference"], result["orders"], file=sys.stderr)
    if args.json:
        write_json(args.json, result)


if __name__ == "__main__":
    main()
