"""The plants' oil and engine: load-sensing steering circuit, closed driveline loop, diesel engine. What they are made of.

The equations of the published twin's kind; :mod:`~aoro_gym.diagnosis_benchmark.plants.hydraulics` has them.
"""

# pyright: reportGeneralTypeIssues=false, reportInvalidTypeForm=false
from typing import Any

import numpy as np
import warp as wp

from aoro_gym.diagnosis_benchmark.plants.fluid import Oil, density, oil_of, viscosity
from aoro_gym.diagnosis_benchmark.plants.joint import Joint, joint_of
from aoro_gym.diagnosis_benchmark.plants.linkage import displacement
from aoro_gym.diagnosis_benchmark.plants.records import (
    Array,
    Constants,
    evaluate,
    f64,
    packed,
    record,
    vec2,
    vec4,
    vec11,
)

SUPPLY, PORT_A, PORT_B, RETURN, FORWARD, BACK, CHARGE, WHEEL_LINE = (wp.constant(i) for i in range(8))
LS, SPOOL, COMPENSATOR, SWASH, ENGINE, GOVERNOR, TORQUE, DRIVE_SWASH = (wp.constant(i) for i in range(11, 19))
PIN_ANGLE, PIN_RATE, NODES, COLUMNS = (wp.constant(i) for i in (19, 20, 21, 25))
WALLS, LEGS = wp.constant(23), wp.constant(25)
"""Rows of the state, 29 in all. The first eleven are pressures [Pa] of volumes, four wheels' lines among them. Pins move by
themselves where a joint is elastic; nodes (valve A, valve B, middle A, middle B) and columns of oil (valve to middle A, B,
middle to cylinder A, B) where hoses are distributed (level 2); nodes at the valve, what their walls have stretched slowly
[m³], and one column (leg) of oil a side, where hoses are in two halves (level 3)."""

OPERATING = 1e-3
"""Flow [m³/s], 60 L/min, at which resistances are stated."""

HOSE_BORE = 12.7e-3
"""[m] of each of the two legs that a joint hose divides into."""

UNSTEADY = 8.0
"""Unsteady over steady laminar friction of a joint hose at its own frequencies (Zielke's weighting at ω r²/ν ≈ 2000)."""

SPEEDS = np.array([0.0, 300.0, 900.0, 1200.0, 1400.0, 1600.0, 1800.0, 2000.0, 2200.0, 2400.0, 2600.0]) * np.pi / 30.0
"""Of the full-load curve [rad/s]."""

Valve = record(
    "Valve",
    "compensator setting droop compensator_rate spool_pace spool_rate shift shock_gain suction crack cross_orifice laminar",
    inlet=vec2, outlet=vec2, left=vec4, right=vec4, shock_setting=vec2, port_leak=vec2,
)  # fmt: skip
"""Conductances [m³/s/√Pa] of compensator, edges (left, right), suction valves and a cross port; the opening's curve to
either side: start [V] and three slopes [1/V]; pressures [Pa], paces [1/s], gain and leaks [m³/s/Pa] (A, B)."""

Lines = record(
    "Lines",
    "pump_size pump_leak bleed supply_setting supply_gain margin cutoff swash_gain swash_up swash_down ls_pace "
    "back_pressure back_slope throttle suction least cylinder_leak pocket hose_volume hose_wall hose_void column "
    "column_decay",
    volume=vec11, wall=vec11, empty=vec11, cells=wp.int32,
)  # fmt: skip
"""Steering pump, return line and volumes: sizes [m³/rad], conductances, gains, paces; volumes [m³] of oil (chambers apart)
and compliances [m³/Pa] of walls and of empty volumes; of a hose in parts (``cells`` beside its end at the cylinders) each
part's, with the inertance [Pa s²/m³] and the decay [1/s] of the oil's columns."""

Drive = record(
    "Drive",
    "size leak cross pace stroke charge_size charge_setting charge_gain charge_check charge_crack shift_pressure "
    "flush_setting flush_gain cross_setting cross_gain traction motor_size motor_leak efficiency charge_efficiency",
)
"""Closed loop: pump 1, charge pump and its valves, flush, cross-over relief valves, traction orifices, wheel motors."""

Engine = record(
    "Engine",
    "set_speed friction_0 friction_1 proportional integral torque_pace smoke inertia droop steering_efficiency",
    torques=vec11,
)
"""Governor, friction and full-load torques [N m] at :data:`SPEEDS`; ``droop``: relative fall of the speed at full load."""

Circuit = record("Circuit", "", oil=Oil, joint=Joint, valve=Valve, lines=Lines, drive=Drive, engine=Engine)


def circuit_of(p: Constants, level: int) -> dict[str, Any]:
    """Fields of :data:`Circuit` (R,)."""
    joint = joint_of(p, level)
    lines = _lines(p, level, joint)
    parts = {"valve": _valve(p), "lines": lines, "drive": _drive(p), "engine": _engine(p)}
    return {"oil": oil_of(p, level), "joint": joint, **parts}


def _valve(p: Constants) -> dict[str, Any]:
    part = "steering.valve."
    q = {key.removeprefix(part): value for key, value in p.items() if key.startswith(part)}
    edge = 1.0 + q["edge_gain"]
    edges = {
        (way, side): edge * q[f"nominal_flow_{side}"] / np.sqrt(q[f"nominal_drop_{way}_{side}"])
        for way in ("in", "out")
        for side in ("left", "right")
    }
    curve = {}
    for side in ("left", "right"):
        start, low, middle = q[f"dead_band_{side}"], q[f"opening_{side}_1V0"], q[f"opening_{side}_1V5"]
        curve[side] = np.stack([start, low / (1.0 - start), 2.0 * (middle - low), 2.0 * (1.0 - middle)])
    # kink: Δp/Q² [Pa s²/m⁶] in series with port B's outlet
    kinked = (edges["out", "left"] ** -2 + q["kink_b"]) ** -0.5
    most = np.maximum(q["nominal_flow_left"], q["nominal_flow_right"])
    return {
        "inlet": np.stack([edges["in", "left"], edges["in", "right"]]),
        "outlet": np.stack([kinked, edges["out", "right"]]), **curve,
        "compensator": most / np.sqrt(q["compensator_open_drop"]), "setting": q["compensator_pressure"],
        "droop": q["compensator_droop"],
        "compensator_rate": 1.0 / (q["compensator_pressure"] * q["compensator_time_constant"]),
        "spool_pace": 1.0 / q["spool_time_constant"], "spool_rate": q["spool_rate_limit"], "shift": q["curve_shift"],
        "shock_setting": np.stack([q["shock_pressure"] - q["shock_drop_a"], q["shock_pressure"]]),
        "shock_gain": q["shock_flow"] / q["shock_ramp"],
        "suction": q["anticavitation_flow"] / np.sqrt(q["anticavitation_drop"]), "crack": q["anticavitation_crack"],
        "port_leak": np.stack([q["leakage"] + q["leak_a"], q["leakage"]]), "cross_orifice": q["cross_orifice"],
        "laminar": p["oil.laminar_pressure"],
    }  # fmt: skip


def _lines(p: Constants, level: int, joint: dict[str, Any]) -> dict[str, Any]:
    pump, tank = "steering.pump.", "steering.tank_line."
    cells = {2: 2, 3: 1}.get(level, 0)  # of a hose, beside its end at the cylinders
    hose = p["steering.hose_volume"]
    wall = hose / p["steering.hose_bulk_modulus"] + p["steering.hose_wall"]
    fixed = hose + 2.0 * p["steering.cylinder.dead_volume"]
    main, wheel, charge = (p[f"driveline.{n}"] for n in ("main_volume", "wheel_hose_volume", "charge.volume"))
    supply, back = p[pump + "line_volume"], p[tank + "volume"]
    drive = [main, main, charge, wheel, wheel, wheel, wheel]
    volume = np.stack([supply, fixed, fixed, back, *drive])
    walls = np.stack([supply / p[pump + "hose_bulk_modulus"], wall, wall, back / p[tank + "hose_bulk_modulus"]])
    walls = np.concatenate([walls, np.stack(drive) / p["driveline.hose_bulk_modulus"]])
    runs = len(hose)
    # an empty volume collects its void: it yields as its oil does, the chambers in the middle of the range
    void = volume.copy()
    at_middle = evaluate(_middle_volume, packed(Joint, joint, runs), Joint, np.zeros(runs))
    void[[PORT_A, PORT_B]] += at_middle
    # two volumes a side or three, the last joined to the cylinders; columns of oil between them
    part, area = hose / (cells + 1), 2.0 * 0.25 * np.pi * HOSE_BORE**2
    volume[[PORT_A, PORT_B]] -= cells * part
    walls[[PORT_A, PORT_B]] -= cells * wall / (cells + 1)
    return {
        "pump_size": p[pump + "displacement"], "pump_leak": p[pump + "leakage"],
        "bleed": p[pump + "bleed_flow"] / np.sqrt(p[pump + "bleed_drop"]),
        "supply_setting": p[pump + "relief_pressure"], "supply_gain": p[pump + "relief_flow"] / p[pump + "relief_ramp"],
        "margin": p[pump + "margin"], "cutoff": p[pump + "cutoff"],
        "swash_gain": 1.0 / (p[pump + "control_band"] * p[pump + "stroke_up_time"]),
        "swash_up": 1.0 / p[pump + "stroke_up_time"], "swash_down": -1.0 / p[pump + "stroke_down_time"],
        "ls_pace": 1.0 / p[pump + "ls_time_constant"], "back_pressure": p[tank + "back_pressure"],
        "back_slope": p[tank + "back_pressure_ramp"] / p[tank + "back_flow"], "throttle": p[tank + "throttle"],
        "suction": p[tank + "suction_flow"] / np.sqrt(p[tank + "suction_drop"]), "least": p["oil.void_pressure"],
        "cylinder_leak": 2.0 * p["steering.cylinder.leakage"], "pocket": p["steering.pocket_a"],
        "hose_volume": part, "hose_wall": wall / (cells + 1), "hose_void": part / p["oil.bulk_modulus"],
        "column": density(p["oil.celsius"]) * hose / area / max(cells, 1) / area,
        "column_decay": UNSTEADY * 8.0 * viscosity(p["oil.celsius"]) / (0.25 * HOSE_BORE**2),
        "volume": volume, "wall": walls, "empty": void / p["oil.bulk_modulus"], "cells": cells,
    }  # fmt: skip


@wp.func
def _middle_volume(j: Joint, angle: f64):
    at = displacement(j.cylinders, angle)
    return at.volume_a


def _drive(p: Constants) -> dict[str, Array]:
    part = "driveline."
    q = {key.removeprefix(part): value for key, value in p.items() if key.startswith(part)}
    return {
        "size": q["pump.displacement"], "leak": q["pump.leakage"], "cross": q["pump.cross_leakage"],
        "pace": 1.0 / q["pump.time_constant"], "stroke": 1.0 / q["pump.stroke_time"],
        "charge_size": q["charge.displacement"], "charge_setting": q["charge.relief_pressure"],
        "charge_gain": q["charge.relief_flow"] / q["charge.relief_ramp"],
        "charge_check": q["charge.check_flow"] / np.sqrt(q["charge.check_drop"]), "charge_crack": q["charge.check_crack"],
        "shift_pressure": q["flush.shift_pressure"], "flush_setting": q["flush.pressure"],
        "flush_gain": q["flush.flow"] / q["flush.ramp"], "cross_setting": q["relief.pressure"],
        "cross_gain": q["relief.flow"] / q["relief.ramp"],
        "traction": q["traction.nominal_flow"] / np.sqrt(q["traction.pressure_drop"]),
        "motor_size": q["motor.displacement"], "motor_leak": q["motor.leakage"],
        "efficiency": q["pump.mechanical_efficiency"], "charge_efficiency": q["charge.mechanical_efficiency"],
    }  # fmt: skip


def _engine(p: Constants) -> dict[str, Array]:
    zero = np.zeros_like(p["engine.set_speed"])
    torques = [p[f"engine.torque.rpm_{n}"] for n in (900, 1200, 1400, 1600, 1800, 2000, 2200, 2400)]
    return {
        "set_speed": p["engine.set_speed"], "friction_0": p["engine.friction_0"], "friction_1": p["engine.friction_1"],
        "proportional": p["engine.governor_proportional"], "integral": p["engine.governor_integral"],
        "torque_pace": 1.0 / p["engine.torque_time_constant"], "smoke": p["engine.smoke_rate"],
        "inertia": p["engine.inertia"], "droop": p["engine.droop"],
        "steering_efficiency": p["steering.pump.mechanical_efficiency"],
        "torques": np.stack([zero, zero, *torques, zero]),
    }  # fmt: skip
