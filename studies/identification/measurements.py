"""Which measurement would decide between structures that fit the published figures of the machine.

    python -m studies.identification.measurements studies/identification/results

Every structure's fits to all three levels of the machine, one a seed, do a few manoeuvres. Of each measurable signal it is
said how far machines of *different* structures are from each other, and how far fits of *one* structure are: root mean
squares over the manoeuvre, in standard deviations of what the sensor leaves behind the 7 Hz low-pass, medians over all
pairs. A signal decides where the first is well above one and above the second.
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from itertools import combinations
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from aoro_gym.calibration.space import Space
from aoro_gym.sensors.chain import low_pass, measured_flow
from aoro_gym.twin import Twin
from aoro_gym.units import BAR, LITRE_PER_MINUTE
from aoro_gym.validation.turns import stacked
from studies.identification.structures import machine_of
from studies.identification.table import results, table

Plan = Sequence[tuple[float, float]]
MANOEUVRES: Mapping[str, Plan] = {
    "full left turn, 100 %": ((0.0, 0.6), (1.0, 2.6)),
    "left turn, 100 %, stopped after 1 s": ((0.0, 0.6), (1.0, 1.0), (0.0, 1.2)),
    "left turn, 60 %": ((0.0, 0.6), (0.6, 2.5)),
    "left and right, 40 %, 0.5 s each": ((0.0, 0.6), (0.4, 0.5), (-0.4, 0.5), (0.4, 0.5), (-0.4, 0.5), (0.0, 0.6)),
}
"""Steering signals and how long [s] each holds; all begin at the right stop."""
NOISE = {
    "joint flow": 3.0 * LITRE_PER_MINUTE,
    "pressure_a": 0.5 * BAR,
    "pressure_b": 0.5 * BAR,
    "pump_pressure": 0.5 * BAR,
}
"""Standard deviations behind the low-pass: a quarter of the published swing of the flow of 12.1 L/min peak to peak, and what
is usual of pressure sensors of 400 bar (E)."""
RATE = 100.0
"""Samples a second."""

Floats = NDArray[np.float64]


def signals(folder: Path, plan: Plan, device: str = "cpu") -> tuple[list[str], dict[str, Floats]]:
    """Structures of the N fits, and each signal (F, N) of a manoeuvre in standard deviations of its noise."""
    names, machines = [], []
    for result in results(folder):
        split = result["splits"].get("physical-nothing")
        for point in split["points"] if split else ():
            space = Space(machine_of(result["structure"]), result["searched"])
            machines.append(space.population(np.array([point])).levelled())
            names.append(result["structure"])
    machine = stacked(machines)
    twin = Twin(len(names), machine=machine, device=device, check_step=False)
    twin.reset(joint_angle=-np.broadcast_to(machine.joint.range, len(names)))
    traces = [twin.step({"steering_signal": signal}, duration, sample_every=1.0 / RATE) for signal, duration in plan]
    found: dict[str, Floats] = {}
    for name in ("joint_angle", *list(NOISE)[1:]):
        found[name] = np.concatenate([trace[name] for trace in traces if trace is not None]).astype(np.float64)
    angle = found.pop("joint_angle")
    flow = measured_flow(machine.steering.cylinder, angle, np.ones(len(names)), rate=RATE)
    pressures = {name: low_pass(values, rate=RATE, cutoff=7.0) for name, values in found.items()}
    whole = {"joint flow": flow, **pressures}
    begin = round(plan[0][1] * RATE)
    return names, {name: values[begin:] / NOISE[name] for name, values in whole.items()}


def distances(names: Sequence[str], values: Floats) -> tuple[float, float]:
    """Medians of the distances between fits of different structures, and between those of one."""
    between, within = [], []
    for i, j in combinations(range(len(names)), 2):
        distance = float(np.sqrt(np.mean(np.square(values[:, i] - values[:, j]))))
        (within if names[i] == names[j] else between).append(distance)
    return float(np.nanmedian(between)), float(np.nanmedian(within))


def markdown(folder: Path, device: str = "cpu") -> str:
    """A table of manoeuvres and signals."""
    rows = []
    for title, plan in MANOEUVRES.items():
        names, found = signals(folder, plan, device)
        cells = (distances(names, values) for values in found.values())
        rows.append([title, *(f"{between:.1f} ({within:.1f})" for between, within in cells)])
    head = ["manoeuvre", "joint flow", "pressure, port A", "pressure, port B", "pump's pressure"]
    return table(head, rows) + "\n"


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("results", type=Path, help="folder of the study's results")
    parser.add_argument("--device", default="cpu", help="cpu, cpu:simd or cuda:N")
    given = parser.parse_args()
    print(markdown(given.results, given.device))


if __name__ == "__main__":
    main()
