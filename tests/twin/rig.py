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

    def then(self, later: Log) -> Log:
        """``later`` with the last frame of this log in front."""
        time = np.concatenate([self.time[-1:], later.time])
        return Log(time, np.concatenate([self.values[-1:], later.values]), self.rows)


def drive(twin: Twin, *phases: tuple[float, Mapping[str, Any]], sample_every: float) -> Log:
    """Log of ``twin`` over ``phases`` (duration [s], commands); a command that is not named keeps its value."""
    stepped = [twin.step(commands, duration, sample_every=sample_every) for duration, commands in phases]
    traces = [trace for trace in stepped if trace is not None]
    rows = {name: row for row, name in enumerate(traces[0].channels)}
    return Log(np.concatenate([t.time for t in traces]), np.concatenate([t.samples for t in traces]), rows)


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
    """Flows [m³/s] that enter and leave the driveline's closed loop, from a log, and the oil in it, from states."""

    def __init__(self, machine, log: Log):
        line, self.machine = machine.driveline, machine
        laminar = machine.oil.laminar_pressure
        names = ("drive_pressure_forward", "drive_pressure_return", "charge_pressure")
        forward, back, charge = (log[name] for name in names)
        supplied = line.charge.displacement * log["engine_speed"]
        relief = relief_valve(charge, line.charge.relief_pressure, line.charge.relief_ramp, line.charge.relief_flow)
        shift = np.clip(np.abs(forward - back) / line.flush.shift_pressure - 1.0, 0.0, 1.0)
        flush = relief_valve(np.minimum(forward, back), line.flush.pressure, line.flush.ramp, line.flush.flow)
        flush = shift * flush
        self.net = supplied - relief - flush - line.pump.leakage * (forward + back)
        """Into the whole loop."""

        drop = log.wheels("motor_pressure")
        share = np.stack([log["shift_front"]] * 2 + [log["shift_rear"]] * 2, axis=1)
        self.swept = share * line.motor.displacement * log.wheels("wheel_rate")
        """By each motor (frames, 4, twins)."""
        check = check_valve(line.charge.cv_check, charge - forward, line.charge.check_crack, laminar)
        pumped = log["drive_swash"] * line.pump.displacement * log["engine_speed"]
        self.net_forward = (
            pumped
            + check
            - np.where(forward < back, flush, 0.0)
            - line.pump.leakage * forward
            - line.pump.cross_leakage * (forward - back)
            - (self.swept + line.motor.leakage * drop).sum(axis=1)
        )
        """Into the forward main and the motors' hoses."""

    def content(self, state: Array, parts: tuple[str, ...] = ("forward", "back", "charge")) -> Array:
        """Oil [m³] above that at 0 Pa, less the voids, in mains and charge line; the motors' hoses hang on ``forward``."""
        line = self.machine.driveline
        volumes = {"forward": line.main_volume, "back": line.main_volume, "charge": line.charge.volume}
        volumes = {name.upper(): volume for name, volume in volumes.items() if name in parts}
        if "forward" in parts:
            volumes |= {f"HOSE_{wheel.upper()}": line.wheel_hose_volume for wheel in WHEELS}
        oil = Oil(self.machine.oil)
        total = np.zeros(state.shape[1])
        for name, volume in volumes.items():
            p = np.maximum(state[State[name]], oil.void)
            # ∫ dp/(β₀ + s p) for p > 0, p/β₀ below
            liquid = np.log1p(oil.slope * np.maximum(p, 0.0) / oil.bulk_modulus) / oil.slope
            liquid += np.minimum(p, 0.0) / oil.bulk_modulus
            total += volume * (liquid + p / line.hose_bulk_modulus)
            total -= volume * np.maximum(oil.void - state[State[name]], 0.0) / oil.bulk_modulus
        return total


__all__ = ["Log", "LoopLedger", "SteeringLedger", "all_wheels", "drive", "integral", "orifice", "squeezed", "states"]
