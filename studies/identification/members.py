"""Machine files of fitted structures, and how near they are to what was published.

    python -m studies.identification.members studies/identification/results aoro_gym/machines/structures --device cpu:simd

A fit sees left turns. What is left is set as the published procedure does: the edges' pressure drops by the times of full
turns, the disc brake by the driving pressure; and the right side's openings by its mean flows at 75 and 50 % signal.
``members.json`` in the folder of the results has what each machine meets.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from aoro_gym.calibration.procedure import meet_times_and_pressure, solve
from aoro_gym.calibration.space import Space
from aoro_gym.calibration.turns import population_figures
from aoro_gym.execution.files import read_json, write_json
from aoro_gym.machine import Machine
from aoro_gym.simulation.key_figures import FIGURES
from aoro_gym.validation import validate
from aoro_gym.validation.published import published_rows
from aoro_gym.validation.study import RIGHT_FLOW_TARGET
from aoro_gym.validation.turns import Turn
from studies.identification.figures import REFERENCES
from studies.identification.structures import machine_of

SHIPPED = ("default_materials", "library", "library_materials", "valve_maker", "valve_maker_materials", "vehicle")
"""Structures whose fits to the published twin are shipped."""
SOURCES = {
    "mevea": "C: fitted with these laws to the published twin's left turns",
    "physical": "C: fitted with these laws to the machine's published left turns",
}
RIGHT = {75.0: "steering.valve.opening_right_1V5", 50.0: "steering.valve.opening_right_1V0"}
"""Opening of the right side that a level's mean flow is met by."""


def member(result: dict[str, Any], reference: str, device: str = "cpu") -> Machine:
    """The machine of a structure's fit to all rows of a reference, finished.

    Raises:
        ValueError: a step of the procedure has no value within its range.
    """
    structure, split = result["structure"], result["splits"][f"{reference}-nothing"]
    machine = machine_of(structure)
    space = Space(machine, result["searched"])
    values = {}
    for key, value in zip(space.keys, space.values(np.array(split["point"])), strict=True):
        low, high = machine.entries[key].range
        values[key] = min(max(float(f"{value:.6g}"), low), high)
    machine = machine.set(values, source=SOURCES[reference]).levelled()
    out = float(machine.entries["steering.valve.nominal_drop_out_left"].value)
    machine = machine.set(
        {"steering.valve.nominal_drop_out_right": out},
        source="C: taken to be made like the left edge",
        check_ranges=False,
    )
    machine = meet_times_and_pressure(machine, ("left", "right"), device=device)
    for level, key in RIGHT.items():
        turn = Turn("right", level)

        def flow(machine: Machine, turn: Turn = turn) -> NDArray[np.float64]:
            return population_figures(machine, [turn], device=device)[0, FIGURES.index("mean_flow_L_per_min")]

        machine = _met(machine, key, _published_flow(turn), flow)
    return machine


def _met(machine: Machine, key: str, target: float, measure: Callable[[Machine], NDArray[np.float64]]) -> Machine:
    """``machine`` with ``key`` at ``target``, or on the end of its range that is nearest, where that is near enough."""
    ends = np.array(machine.entries[key].range)
    found = measure(machine.set({key: ends}))
    if np.min(found) <= target <= np.max(found):
        return solve(machine, key, target, measure)
    nearest = int(np.argmin(np.abs(found - target)))
    if abs(found[nearest] / target - 1.0) > RIGHT_FLOW_TARGET:
        raise ValueError(
            f"{key} at {ends[nearest]:.4g}, an end of its range, gives {found[nearest]:.4g}, not {target:.4g}"
        )
    return machine.set({key: float(ends[nearest])}, source="C: the end of its range that is nearest to the mean flow")


def figures_of(machine: Machine, result: dict[str, Any], device: str = "cpu") -> dict[str, Any]:
    """What a machine meets: figures of the published twin and of the machine, of the shape, single ones, and parameters on a
    bound of their range where the data sheet is not."""
    found = validate(machine, noise_runs=0, device=device)
    sheet = Space(machine_of(result["structure"]), result["searched"])
    bounds = set(sheet.at_bounds(sheet.point(machine))) - set(sheet.at_bounds(sheet.point()))
    errors = {
        reference: {
            f"{item['direction']} {item['signal_percent']:g}": {
                name: None if error is None else float(f"{error:.4g}") for name, error in item["relative"].items()
            }
            for item in found.errors
            if item["source"] == "twin" and item["reference"] == reference
        }
        for reference in REFERENCES
    }
    return {
        "structure": result["structure"],
        "of_the_published_twin": list(found.reached("twin")),
        "of_the_machine": [
            sum(one.in_bounds <= 1.0 for one in found.misses("physical")),
            len(found.misses("physical")),
        ],
        "of_the_shape": [found.shape_reached, len(found.shape)],
        "missed": [check["what"] for check in found.checks if not check["reached"]],
        "at_bounds": dict(sorted(bounds)),
        "misfit_in_bounds": found.misfit(),
        "errors": errors,
    }


def _published_flow(turn: Turn) -> float:
    """Mean flow [L/min] of the machine."""
    for row in published_rows():
        flow = row["mean_flow_L_per_min"]
        if (row["direction"], row["signal_percent"], row["source"]) == (
            turn.direction,
            turn.signal_percent,
            "physical",
        ):
            assert isinstance(flow, float)
            return flow
    raise KeyError(turn)


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("results", type=Path, help="folder of the study's results")
    parser.add_argument("out", type=Path, help="folder of the machine files")
    parser.add_argument("--structures", nargs="+", default=list(SHIPPED), help="structures whose files are made")
    parser.add_argument("--reference", default="mevea", choices=list(SOURCES), help="rows that they were fitted to")
    parser.add_argument("--device", default="cpu", help="cpu, cpu:simd or cuda:N")
    given = parser.parse_args()
    kept = given.results / "members.json"
    members: dict[str, Any] = read_json(kept) if kept.exists() else {}
    for name in given.structures:
        result = read_json(given.results / f"{name}.json")
        try:
            found = member(result, given.reference, given.device)
        except ValueError as error:
            print(f"{name}: no machine: {error}", flush=True)
            continue
        given.out.mkdir(parents=True, exist_ok=True)
        found.save(given.out / f"{name}.toml", base="aoro_datasheet")
        saved = Machine.load(given.out / f"{name}.toml")
        members[f"{given.reference}-{name}"] = figures_of(saved, result, given.device)
        write_json(kept, members)
        print(f"{name}: {given.out / f'{name}.toml'}", flush=True)


if __name__ == "__main__":
    main()
