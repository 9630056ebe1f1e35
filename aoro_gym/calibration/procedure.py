"""The published procedure, step by step (Lehto et al., Machines 2026, 14, 128).

1. Mean flows of full turns at several levels are the nominal flow and the opening curve of each port.
2. The dead band lies between the largest signal that moves nothing and the smallest that moves the joint: here the data
   sheet's, from a machine's own ramps :mod:`.procedure_logs` reads it.
3. The pressure drop of each port's edge is found by iteration: until a full turn at full signal takes the measured time.
4. The disc brake is found by iteration: until driving at 0.75 m/s needs the measured pressure over the motors.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np
from numpy.typing import NDArray

from aoro_gym.calibration.turns import population_figures
from aoro_gym.machine import Machine
from aoro_gym.simulation.key_figures import FIGURES
from aoro_gym.units import BAR, GRAVITY
from aoro_gym.validation.published import published, published_rows, valve_flow
from aoro_gym.validation.turns import Turn, motor_pressure_at

SIDES = ("left", "right")

GRID = 9
"""Machines a launch in a search along one parameter."""

FLOW_ACCURACY = 0.035
"""Half range, relative, that a measured mean flow leaves to the steady flow which the valve's curve describes: in the
published turns both differ by up to 2.5 %, and the smallest flow is given to 0.1 of 12.5 L/min."""

CURVE_SOURCE = "P: mean flows of full turns"
"""Of the valve's curve in a machine file."""

ROUNDS = 3
"""Refinements of such a search: each narrows the bracket to a quarter."""


def measured_curve(machine: Machine) -> Machine:
    """``machine`` with the measured flows as its valve curve: mean flow at full signal, and its share at 1.0 and 1.5 V."""
    table = valve_flow()
    volts = table["signal_V"]
    values: dict[str, float] = {}
    for side in SIDES:
        flow = dict(zip(volts, table[f"{side}_L_per_min"], strict=True))
        values[f"steering.valve.nominal_flow_{side}"] = flow[2.0]
        values[f"steering.valve.opening_{side}_1V0"] = flow[1.0] / flow[2.0]
        values[f"steering.valve.opening_{side}_1V5"] = flow[1.5] / flow[2.0]
    ranges = {key: (value * (1.0 - FLOW_ACCURACY), value * (1.0 + FLOW_ACCURACY)) for key, value in values.items()}
    return machine.set(values, source=CURVE_SOURCE, ranges=ranges)


def crossing(values: NDArray[np.float64], found: NDArray[np.float64], target: float) -> tuple[float, float] | None:
    """Bracket of neighbouring ``values`` between which ``found`` passes ``target``; None if it never does."""
    above = np.sign(found - target)
    for i in range(len(values) - 1):
        if np.isfinite(above[i : i + 2]).all() and above[i] != above[i + 1]:
            return values[i], values[i + 1]
    return None


def solve(machine: Machine, key: str, target: float, measure: Callable[[Machine], NDArray[np.float64]]) -> Machine:
    """``machine`` with ``key`` changed within its range so that ``measure`` gives ``target``.

    A population spans the range and then the bracket, :data:`ROUNDS` times; the last step is a straight line.

    Raises:
        ValueError: no value within the range reaches the target; names the nearest.
    """
    low, high = machine.entries[key].range
    for _ in range(ROUNDS):
        values = np.linspace(low, high, GRID)
        found = measure(machine.set({key: values}))
        bracket = crossing(values, found, target)
        if bracket is None and not np.isfinite(found).any():
            raise ValueError(
                f"no {key} within its range [{low:.4g}, {high:.4g}] {machine.entries[key].unit} reaches {target:.4g}: with "
                "none of those tried was there anything to measure, such as a turn that ends in time"
            )
        if bracket is None:
            nearest = int(np.nanargmin(np.abs(found - target)))
            raise ValueError(
                f"no {key} within its range [{low:.4g}, {high:.4g}] {machine.entries[key].unit} reaches {target:.4g}: "
                f"the nearest, {values[nearest]:.4g}, gives {found[nearest]:.4g}; widen its range in the machine file"
            )
        low, high = bracket
    ends = np.interp([low, high], values, found)
    value = low + (high - low) * (target - ends[0]) / (ends[1] - ends[0])
    return machine.set({key: float(value)}, source=f"C: {target:.4g} reached by iteration")


def turn_time(direction: str, device: str = "cpu") -> Callable[[Machine], NDArray[np.float64]]:
    """Measure of :func:`solve`: time [s] of a full turn at full signal."""

    def measure(machine: Machine) -> NDArray[np.float64]:
        return population_figures(machine, [Turn(direction, 100.0)], device=device)[0, FIGURES.index("turn_time_s")]

    return measure


def motor_pressure(machine: Machine, device: str = "cpu") -> NDArray[np.float64]:
    """Measure of :func:`solve`: pressure difference [bar] over the motors at the published speed on level ground."""
    return motor_pressure_at(published("drive_speed"), machine, device=device) / BAR


def rolling_pressure(machine: Machine, *, brake: bool = True) -> NDArray[np.float64]:
    """Pressure difference [bar] over the motors (N,) that steady driving on level ground takes, in closed form.

    Each motor gives D Δp and loses (1 − η) D Δp in itself; what is left turns against the disc brake and a quarter of
    the rolling resistance c W r. Leakage and valves do not enter: it is the motors' own difference.
    """
    load = 0.25 * GRAVITY * np.asarray(machine.mass) * machine.tire.rolling_resistance * machine.tire.radius
    torque = load + (np.asarray(machine.driveline.brake.disc_torque) if brake else 0.0)
    motor = machine.driveline.motor
    return np.atleast_1d(torque / (motor.mechanical_efficiency * motor.displacement)) / BAR


def meet_times_and_pressure(
    machine: Machine,
    sides: tuple[str, ...] = SIDES,
    progress: Callable[[str, float], None] = lambda s, x: None,
    device: str = "cpu",
) -> Machine:
    """Steps 3 and 4: ``machine`` with the edges of ``sides`` and the disc brake set so that the measured times of full
    turns and the measured driving pressure are met."""
    for i, side in enumerate(sides):
        progress(f"pressure drop of the {side} edge", i / (len(sides) + 1))
        key = f"steering.valve.nominal_drop_in_{side}"
        machine = solve(machine, key, published_turn_time(side), turn_time(side, device))
    progress("disc brake", len(sides) / (len(sides) + 1))
    pressure = partial(motor_pressure, device=device)
    return solve(machine, "driveline.brake.disc_torque", published("motor_pressure"), pressure)


def published_procedure(
    machine: Machine, progress: Callable[[str, float], None] = lambda s, x: None, device: str = "cpu"
) -> Machine:
    """``machine`` after all four steps; its other parameters stay."""
    progress("valve curve from the measured flows", 0.0)
    return meet_times_and_pressure(measured_curve(machine), progress=progress, device=device)


def published_turn_time(side: str) -> float:
    """Time [s] of the machine's full turn at full signal to ``side``."""
    for row in published_rows():
        time = row["turn_time_s"]
        if (row["direction"], row["signal_percent"], row["source"]) == (side, 100.0, "physical") and time is not None:
            return float(time)
    raise KeyError(side)
