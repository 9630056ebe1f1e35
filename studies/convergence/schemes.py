"""Other steps of the steering circuit beside the twin's own: as near with fewer substeps?

    python -m studies.convergence.schemes --json studies/convergence/schemes.json

Each is an edit of the twin's sources, built in float64 (:mod:`studies.convergence.precision`) and held against the twin's
own step at 1 µs, for the shipped machine, with free gas, with mounts and play, and with stiff hoses. The command's delay is
a whole number of main steps, since what one between them is off would hide the oil's part.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from aoro_gym.execution.files import write_json
from aoro_gym.machine import Machine
from studies.convergence.precision import Edit, build
from studies.convergence.run import WHOLE_DELAY, deviation, turns

SUBSTEPS = (10, 15, 20, 30)
FINEST = (1.25e-4, 125)
"""Main step [s] and substeps of the references: hydraulic steps of 1 µs."""

MACHINES: Mapping[str, Mapping[str, float]] = {
    "shipped": {},
    "1 % gas": {"oil.gas_fraction": 0.01},
    "5 % gas": {"oil.gas_fraction": 0.05},
    "mounts": {"joint.compliance": 5e-8, "joint.backlash": 2e-3},
    "stiff hoses": {"steering.hose_bulk_modulus": 2e9},
}
"""Values in SI."""


def exchanged(*pairs: tuple[str, str]) -> Edit:
    """Every first text by the second; the source must have it once."""

    def edit(source: str) -> str:
        for old, new in pairs:
            if source.count(old) != 1:
                raise ValueError(f"the source has {source.count(old)} times, not once: {old}")
            source = source.replace(old, new)
        return source

    return edit


STATE = "steering_circuit.py"
PORTS = "    out.port_a = fill_port(m, oil, gas.port_a, s.port_a, q_a, dt, g.volume_a)\n"
TANK = "    out.tank_line = fill(oil, gas.tank_line, s.tank_line, q_tank, dt, m.tank_line_volume, m.tank_line_compliance)\n"
SUPPLY = "    out.supply = fill(oil, gas.supply, s.supply, q_supply, dt, m.pump_line_volume, m.pump_line_compliance)\n"
HELD = """    walls = m.hose_compliance
    q_a = q_a / (1.0 + dt * out.slope_a * volume_stiffness(oil, gas.port_a, s.port_a, g.volume_a, walls))
    q_b = q_b / (1.0 + dt * out.slope_b * volume_stiffness(oil, gas.port_b, s.port_b, g.volume_b, walls))
"""
SLOPES = """    edges = q.edges
    left = edges.left
    p_s = q.p_s
    p_a = q.p_a
    p_b = q.p_b
    p_t = q.p_t
    entering = edges.flow_in / wp.max(edges.available, 1.0) * wp.where(edges.available > lam, 0.5, 1.0)
    emptied = wp.where(left, p_b, p_a) - p_t
    leaving = edges.flow_out / wp.where(wp.abs(emptied) > 1.0, emptied, 1.0) * wp.where(wp.abs(emptied) > lam, 0.5, 1.0)
    leaving = wp.max(leaving, 0.0)
    held = m.valve_leakage + 2.0 * m.cylinder_leakage
    relief = m.valve_shock_flow / m.valve_shock_ramp
    suction = m.valve_cv_anticavitation * inverse_root(lam)
    out.slope_a = held + wp.where(left, entering, leaving) + wp.where(p_a - p_t > m.valve_shock_pressure, relief, 0.0)
    out.slope_a += wp.where(p_t - p_a > m.valve_anticavitation_crack, suction, 0.0)
    out.slope_b = held + wp.where(left, leaving, entering) + wp.where(p_b - p_t > m.valve_shock_pressure, relief, 0.0)
    out.slope_b += wp.where(p_t - p_b > m.valve_anticavitation_crack, suction, 0.0)
    slope_s = m.pump_leakage + entering + wp.where(
        p_s > m.pump_relief_pressure, m.pump_relief_flow / m.pump_relief_ramp, 0.0
    )
    slope_t = leaving + wp.where(
        p_t > m.tank_line_back_pressure, m.tank_line_back_flow / m.tank_line_back_pressure_ramp, 0.0
    )
"""
LINES = """    q_supply = q_supply / (
        1.0 + dt * slope_s * volume_stiffness(oil, gas.supply, s.supply, m.pump_line_volume, m.pump_line_compliance)
    )
    q_tank = q_tank / (
        1.0 + dt * slope_t * volume_stiffness(oil, gas.tank_line, s.tank_line, m.tank_line_volume, m.tank_line_compliance)
    )
"""
BEGIN = "    out = ports_step(\n        m, oil, gas, g, metered_a"
IMPLICIT = (
    (PORTS, HELD + PORTS),
    (SUPPLY, LINES + SUPPLY),
    (BEGIN, SLOPES + BEGIN),
    ("import warp as wp\n", "import warp as wp\n\nfrom aoro_gym.twin.physics.fluid import volume_stiffness\n"),
)
LATE = (TANK, TANK + "    out.swash = swash_step(m, s.swash, out.supply, out.ls_pressure, dt)\n")
MEAN = "0.5 * (q.p_s + out.supply), 0.5 * (s.ls_pressure + out.ls_pressure)"
BETWEEN = (TANK, TANK + f"    out.swash = swash_step(m, s.swash, {MEAN}, dt)\n")
LINE = "    tank_line: float  # [Pa] content of the return line\n"
FIELDS = exchanged((LINE, LINE + "    slope_a: float\n    slope_b: float\n"))
SCHEMES: Mapping[str, Mapping[str, Edit]] = {
    "explicit": {},
    "implicit in each volume's own slope": {
        "physics/steering.py": exchanged(*IMPLICIT),
        f"physics/{STATE}": FIELDS,
    },
    "swash after the pressures": {"physics/steering.py": exchanged(LATE)},
    "swash by mean pressures": {"physics/steering.py": exchanged(BETWEEN)},
}
"""The explicit step is the twin's own."""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--json", type=Path, help="where to write all numbers")
    parser.add_argument("--only", help="of the machines")
    args = parser.parse_args()
    kinds: dict[str, Any] = {
        name: build(f"aoro_scheme_{i}", wide=True, edits=edits).Twin for i, (name, edits) in enumerate(SCHEMES.items())
    }
    rows = []
    for name, values in MACHINES.items():
        if args.only not in (None, name):
            continue
        delayed = {"steering.valve.command_delay": WHOLE_DELAY}
        machine = Machine.load("aoro").set(delayed | dict(values), si=True, check_ranges=False)
        reference = turns(kinds["explicit"], machine, *FINEST)
        for scheme, kind in kinds.items():
            for substeps in SUBSTEPS:
                row: dict[str, Any] = {"machine": name, "scheme": scheme, "substeps": substeps}
                try:
                    row |= deviation(turns(kind, machine, 1e-3, substeps), reference, machine)
                except RuntimeError:
                    row["diverged"] = True
                rows.append(row)
                text = "  ".join(f"{key} {value:.3g}" for key, value in row.items() if isinstance(value, float))
                print(f"{name}, {scheme}, {substeps}: {text}", file=sys.stderr)
    if args.json:
        write_json(args.json, {"rows": rows})


if __name__ == "__main__":
    main()
