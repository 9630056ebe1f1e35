"""Twins on a test rig: phases of commands, the log of what happened, and the oil that a log accounts for."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from aoro_gym.twin.records import WHEELS, State
from aoro_gym.twin.twin import Twin
from tests.oracles.hydraulics import Oil, check_valve, orifice, relief_valve

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Log:
    """Outputs of all twins: ``log[channel]`` is (frames, num_twins), SI, float64; ``time`` [s] is (frames,)."""

    time: Array
    values: NDArray[np.float32]  # (frames, channels, num_twins)
    rows: Mapping[str, int]

    def __getitem__(self, channel: str) -> Array:
        return self.values[:, self.rows[channel]].astype(float)

    def wheels(self, prefix: str) -> Array:
        """The four channels ``prefix_fl`` ... ``prefix_rr`` as (frames, 4, num_twins)."""
        return np.stack([self[f"{prefix}_{wheel}"] for wheel in WHEELS], axis=1)

    def after(self, time: float) -> Log:
        """The frames later than ``time`` [s]."""
        kept = self.time > time - 1e-9
        return Log(self.time[kept], self.values[kept], self.rows)


def drive(twin: Twin, *phases: tuple[float, Mapping[str, Any]], sample_every: float) -> Log:
    """Log of ``twin`` over ``phases`` (duration [s], commands); a command that is not named keeps its value."""
    traces = [twin.step(commands, duration, sample_every=sample_every) for duration, commands in phases]
    rows = {name: row for row, name in enumerate(traces[0].channels)}
    return Log(np.concatenate([t.time for t in traces]), np.concatenate([t.values for t in traces]), rows)


def all_wheels(prefix: str, value: Any) -> dict[str, Any]:
    """One command for all four wheels or arms."""
    return {f"{prefix}_{wheel}": value for wheel in WHEELS}


def states(twin: Twin) -> Array:
    """Copy of all states (rows, num_twins) in float64."""
    return twin.state.numpy().astype(float)


def integral(values: Array, time: Array) -> Array:
    """Running trapezoidal integral along the first axis, zero at the first sample."""
    step = np.diff(time).reshape(-1, *[1] * (values.ndim - 1))
    pieces = 0.5 * step * (values[1:] + values[:-1])
    return np.concatenate([np.zeros_like(values[:1]), np.cumsum(pieces, axis=0)])


def squeezed(machine, pressure: Array, volume: Array, hose_volume: float, hose_modulus: float) -> Array:
    """Oil [m³] that a chamber took or gave up beyond its change in ``volume``, since the first sample.

    ∫ (V/β(p) + V_hose/β_hose) dp along the log; a void neither takes nor gives any.
    """
    oil = Oil(machine.oil)
    compliance = volume * oil.compressibility(pressure) + hose_volume / hose_modulus
    pieces = 0.5 * (compliance[1:] + compliance[:-1]) * np.diff(pressure, axis=0)
    return np.concatenate([np.zeros_like(pieces[:1]), np.cumsum(pieces, axis=0)])


class SteeringLedger:
    """Flows [m³/s] of the steering circuit that follow from logged pressures alone."""

    def __init__(self, machine, log: Log):
        valve, self.machine = machine.steering.valve, machine
        laminar = machine.oil.laminar_pressure
        self.log = log
        tank = log["return_pressure"]
        self.a, self.b = log["pressure_a"], log["pressure_b"]
        self.across = 2.0 * machine.steering.cylinder.leakage * (self.a - self.b)

        def to_tank(port: Array) -> Array:
            shock = relief_valve(port - tank, valve.shock_pressure, valve.shock_ramp, valve.shock_flow)
            suction = check_valve(valve.cv_anticavitation, tank - port, valve.anticavitation_crack, laminar)
            return shock - suction + valve.leakage * (port - tank)

        self.from_a = to_tank(self.a) + self.across
        """Leaks and valves out of side A, the metering edges apart."""
        self.from_b = to_tank(self.b) - self.across

    def chambers(self) -> tuple[Array, Array]:
        """Volumes [m³] of sides A and B along the log."""
        steering = self.machine.steering
        cylinder, linkage = steering.cylinder, steering.cylinder.linkage
        angle = self.log["joint_angle"]

        def extension(sign: float) -> Array:
            a, b = linkage.a, linkage.b
            squares = a**2 + b**2 - 2.0 * a * b * np.cos(linkage.g0 + sign * angle)
            return np.sqrt(squares) - cylinder.dead_length

        right, left = extension(1.0), extension(-1.0)
        fixed = steering.hose_volume + 2.0 * cylinder.dead_volume
        bore, annulus = cylinder.bore_area, cylinder.annulus_area
        return (
            fixed + bore * right + annulus * (cylinder.stroke - left),
            fixed + bore * left + annulus * (cylinder.stroke - right),
        )

    def squeezed(self, port: Array, volume: Array) -> Array:
        """See :func:`squeezed`, with the hose of one side."""
        steering = self.machine.steering
        return squeezed(self.machine, port, volume, steering.hose_volume, steering.hose_bulk_modulus)


class LoopLedger:
    """Oil that enters, leaves and lies in the closed loop of the driveline."""

    def __init__(self, machine, log: Log):
        line = machine.driveline
        self.machine = machine
        forward, back, charge = (log[c] for c in ("drive_pressure_forward", "drive_pressure_return", "charge_pressure"))
        self.charged = line.charge.displacement * log["engine_speed"]
        self.charge_relief = relief_valve(
            charge, line.charge.relief_pressure, line.charge.relief_ramp, line.charge.relief_flow
        )
        shift = np.clip(np.abs(forward - back) / line.flush.shift_pressure - 1.0, 0.0, 1.0)
        low = np.minimum(forward, back)
        self.flush = shift * relief_valve(low, line.flush.pressure, line.flush.ramp, line.flush.flow)
        self.case = line.pump.leakage * (forward + back)

    @property
    def net(self) -> Array:
        """Flow into the loop less flow out of it [m³/s]."""
        return self.charged - self.charge_relief - self.flush - self.case

    def content(self, state: Array) -> Array:
        """Oil [m³] in the loop above that at 0 Pa, less its voids; from the states (rows, num_twins)."""
        line = self.machine.driveline
        oil = Oil(self.machine.oil)
        volumes = {"FORWARD": line.main_volume, "BACK": line.main_volume, "CHARGE": line.charge.volume}
        volumes |= {f"HOSE_{wheel.upper()}": line.wheel_hose_volume for wheel in WHEELS}
        total = np.zeros(state.shape[1])
        for name, volume in volumes.items():
            x = state[State[name]]
            p = np.maximum(x, oil.void)
            # ∫ dp/(β₀ + s p) for p > 0, p/β₀ below
            liquid = np.log1p(oil.slope * np.maximum(p, 0.0) / oil.bulk_modulus) / oil.slope
            liquid += np.minimum(p, 0.0) / oil.bulk_modulus
            total += volume * (liquid + p / line.hose_bulk_modulus)
            total -= volume * np.maximum(oil.void - x, 0.0) / oil.bulk_modulus
        return total


__all__ = ["Log", "LoopLedger", "SteeringLedger", "all_wheels", "drive", "integral", "orifice", "squeezed", "states"]
