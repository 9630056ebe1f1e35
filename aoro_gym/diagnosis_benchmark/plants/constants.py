"""What a plant is made of: a machine file's values, and constants of laws that an unaltered machine does not need."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from aoro_gym.diagnosis_benchmark.plants.records import Array
from aoro_gym.machine.machine_file import Parameter

COMMISSIONED_CELSIUS = 35.0
"""Oil temperature [°C] at which the machine file holds."""

OFF: Mapping[str, float] = {
    # sensors
    "sensor.delay": 0.0,  # [s]
    "sensor.lag": 0.0,  # [s]
    "sensor.gain_error": 0.0,  # [1]
    "sensor.smoothing": 0.0,  # [s]
    "sensor.wobble": 0.0,  # [rad]
    # engine, valve, lines
    "engine.droop": 0.0,  # [1]
    "steering.valve.curve_shift": 0.0,  # [V]
    "steering.valve.edge_gain": 0.0,  # [1]
    "steering.valve.cross_orifice": 0.0,  # [m³/s/√Pa]
    "steering.valve.leak_a": 0.0,  # [m³/s/Pa]
    "steering.valve.kink_b": 0.0,  # [Pa s²/m⁶]
    "steering.valve.shock_drop_a": 0.0,  # [Pa]
    "steering.tank_line.throttle": 0.0,  # [Pa s²/m⁶]
    "steering.hose_wall": 0.0,  # [m³/Pa]
    "steering.pocket_a": 0.0,  # [m³] of air at atmospheric pressure
    "oil.celsius": COMMISSIONED_CELSIUS,
    # joint, bodies, wheels, ground
    "joint.play": 0.0,  # [rad]
    "joint.compliance": 0.0,  # [rad/(N m)]
    "joint.bump": 0.0,  # [N m]
    "payload.mass": 0.0,  # [kg]
    "driveline.brake.drag_fl": 0.0,  # [N m]
    "tire.scrub_torque": 0.0,  # [N m] at 24.5 kN
    "tire.patch_gain": 0.0,  # [1]
    "ground.rut": 0.0,  # [1]
    "ground.slope_ahead": 0.0,  # [rad]
    "ground.slope_left": 0.0,  # [rad]
}
"""Constants of the plants' own laws by key, with the values that switch them off."""


def constants_of(machines: Sequence[Mapping[str, Parameter]]) -> dict[str, Array]:
    """Constants (R,) by dotted key, SI, of R machines: entries by key, as a machine file holds them."""
    if not machines:
        raise ValueError("no machine: give at least one")
    values = {key: np.array([float(machine[key].si) for machine in machines]) for key in machines[0]}
    values |= {key: np.full(len(machines), value) for key, value in OFF.items()}
    values["tire.design_stiffness"] = values["tire.stiffness"].copy()  # the pose at rest was designed for
    return values
