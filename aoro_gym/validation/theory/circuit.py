"""The steering circuit's static laws in a left turn, its flow balance, and what linearisation gives in closed form.

Port A is loaded, port B returns. Pressures are gauge [Pa], flows [m³/s]; every quantity is a float or has shape (N,), one
value a variant of the machine.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from aoro_gym.machine import Machine
from aoro_gym.units import ATMOSPHERIC_PRESSURE

Array = NDArray[Any]

LEAST_ABSOLUTE = 5000.0
"""Absolute pressure [Pa] below which free gas is not followed."""


@dataclass(frozen=True, eq=False)
class Chambers:
    """Both ports at one joint angle."""

    volume_a: Array  # [m³] of oil
    volume_b: Array
    displacement_a: Array  # [m³/rad] that port A takes in a left turn
    displacement_b: Array  # [m³/rad] that port B gives
    lever_sum: Array  # [m] of both cylinders
    lever_squares: Array  # [m²]


def chambers(machine: Machine, angle: ArrayLike) -> Chambers:
    """Both ports at joint ``angle`` [rad]: the right cylinder extends with it, the left one retracts, cross-connected."""
    steering, cylinder = machine.steering, machine.steering.cylinder
    theta = np.asarray(angle, dtype=np.float64)
    right, left = cylinder.linkage.lever(theta), cylinder.linkage.lever(-theta)
    out, back = cylinder.linkage.extension(theta), cylinder.linkage.extension(-theta)
    fixed = steering.hose_volume + 2.0 * cylinder.dead_volume
    bore, annulus = cylinder.bore_area, cylinder.annulus_area
    values = (
        fixed + bore * out + annulus * (cylinder.stroke - back),
        fixed + bore * back + annulus * (cylinder.stroke - out),
        bore * right + annulus * left,
        bore * left + annulus * right,
        right + left,
        right**2 + left**2,
    )
    return Chambers(*(np.asarray(value) for value in values))


def turbulent(coefficient: ArrayLike, drop: ArrayLike, laminar: ArrayLike) -> Array:
    """Flow [m³/s] through an orifice, C √Δp, linear below the ``laminar`` drop [Pa] (Merritt 1967, 3.3)."""
    return np.asarray(coefficient * np.asarray(drop) / np.sqrt(np.maximum(np.abs(drop), laminar)))


def modulus(machine: Machine, pressure: ArrayLike) -> Array:
    """Tangent bulk modulus [Pa] of oil with free air (Merritt 1967, 1.4): volumes of liquid and polytropic gas in series."""
    oil, p = machine.oil, np.asarray(pressure, dtype=np.float64)
    absolute = np.maximum(p + ATMOSPHERIC_PRESSURE, LEAST_ABSOLUTE)
    gas = oil.gas_fraction * (ATMOSPHERIC_PRESSURE / absolute) ** (1.0 / np.asarray(oil.polytropic_exponent))
    liquid = 1.0 - np.asarray(oil.gas_fraction)
    liquid_modulus = oil.bulk_modulus + oil.bulk_modulus_slope * np.maximum(p, 0.0)
    return (liquid + gas) / (liquid / liquid_modulus + gas / (oil.polytropic_exponent * absolute))


def opening(machine: Machine, spool: ArrayLike) -> Array:
    """Share [0, 1] of the open edges at ``spool`` (of the full 2 V): straight lines between the measured points."""
    valve = machine.steering.valve
    volts = 2.0 * np.asarray(spool, dtype=np.float64) - valve.overlap
    knots = (valve.dead_band_left, 1.0, 1.5, 2.0)
    heights = (0.0, valve.opening_left_1V0, valve.opening_left_1V5, 1.0)
    total = np.zeros(np.broadcast(volts, heights[1]).shape)
    for i in range(3):
        share = np.clip((volts - knots[i]) / (knots[i + 1] - knots[i]), 0.0, 1.0)
        total = total + share * (heights[i + 1] - heights[i])
    return total


def return_pressure(machine: Machine, flow: ArrayLike) -> Array:
    """Pressure [Pa] of the return line at a ``flow`` ≥ 0 through its filter: Δp = p₀ + r Q + a Q²."""
    line, q = machine.steering.tank_line, np.asarray(flow, dtype=np.float64)
    return np.asarray(line.back_pressure + line.back_pressure_ramp * q / line.back_flow + line.throttle * q**2)


def dry_friction(machine: Machine, ports: Chambers, pressures: ArrayLike, rate: ArrayLike) -> Array:
    """Friction torque [N m] of the sliding joint: its bearing, and both cylinders' seals with their Stribeck rise.

    Args:
        machine: The machine.
        ports: Chambers at the joint's angle.
        pressures: Sum of both ports' pressures [Pa].
        rate: Joint rate [rad/s].
    """
    cylinder = machine.steering.cylinder
    speed = 0.5 * ports.lever_sum * np.asarray(rate) / cylinder.seal_stribeck_velocity
    rise = 1.0 + (cylinder.seal_static_ratio - 1.0) * np.exp(-(speed**2))
    seals = cylinder.seal_preload + cylinder.seal_pressure_coefficient * np.maximum(pressures, 0.0)
    return np.asarray(machine.joint.friction_torque + ports.lever_sum * seals * rise)


@dataclass(frozen=True, eq=False)
class SteadyTurn:
    """Equilibrium of the circuit while the joint turns at constant flow."""

    opening: Array  # [-] of both edges
    compensator: Array  # [-] opening
    metered: Array  # [m³/s] into port A
    flow: Array  # [m³/s] of the joint
    pressure_a: Array  # [Pa]
    pressure_b: Array
    return_pressure: Array
    supply: Array
    swash: Array  # [-] of pump 2


def metered_flow(machine: Machine, edge: Array, available: ArrayLike) -> tuple[Array, Array]:
    """Metered flow [m³/s] and compensator opening in balance, ``available`` drop Δp [Pa] over both.

    Edge and compensator in series share the drop as y²/(y² + ρ²), ρ = edge over open compensator; the compensator's spring
    holds the edge's share at p_ref (1 + κ (½ − y)). Bisection in y: the balance falls monotonically.
    """
    valve, available = machine.steering.valve, np.asarray(available, dtype=np.float64)
    ratio = edge * valve.cv_in_left / valve.cv_compensator
    low, high = np.zeros(np.shape(ratio)), np.ones(np.shape(ratio))
    for _ in range(60):
        y = 0.5 * (low + high)
        held = valve.compensator_pressure * (1.0 + valve.compensator_droop * (0.5 - y))
        opens = held > available * y**2 / (y**2 + ratio**2)
        low, high = np.where(opens, y, low), np.where(opens, high, y)
    y = 0.5 * (low + high)
    share = available * y**2 / (y**2 + ratio**2)
    return turbulent(edge * valve.cv_in_left, share, machine.oil.laminar_pressure), y


def steady_turn(machine: Machine, level: ArrayLike, angle: ArrayLike, load: ArrayLike = 0.0) -> SteadyTurn:
    """Static flow balance of a left turn (Merritt 1967, 6.1; Krus 1988, 2.2).

    Load sensing holds the pump at p_A + margin, as its swash integrates the error; so compensator and edge share the
    margin, whatever the load. Joint flow is the metered flow less what leaks from port A. Port B stands above the return
    line by the meter-out edge's drop, port A balances port B, friction and the ground's ``load`` [N m].

    Args:
        machine: The machine.
        level: Steering signal, 0 to 1.
        angle: Joint angle [rad].
        load: Torque [N m] by which wheels and ground resist the joint.
    """
    valve, pump, cylinder = machine.steering.valve, machine.steering.pump, machine.steering.cylinder
    laminar = machine.oil.laminar_pressure
    ports = chambers(machine, angle)
    edge = opening(machine, np.asarray(level) + 0.0 * ports.volume_a)
    metered, y = metered_flow(machine, edge, pump.margin)
    flow = metered
    for _ in range(20):  # leaks are small against the flow: each round gains two digits or more
        out = flow * ports.displacement_b / ports.displacement_a
        p_t = return_pressure(machine, out)
        p_b = p_t + (out / (np.maximum(edge, 1e-12) * valve.cv_out_left)) ** 2
        rate = flow / ports.displacement_a
        drag = cylinder.seal_viscous * ports.lever_squares * rate
        p_a = p_b
        for _ in range(5):
            friction = dry_friction(machine, ports, p_a + p_b, rate)
            p_a = (p_b * ports.displacement_b + friction + drag + np.asarray(load)) / ports.displacement_a
        leak = 2.0 * cylinder.leakage * (p_a - p_b) + valve.leakage * (p_a - p_t)
        leak = leak + turbulent(valve.cv_cross_port, p_a - p_b, laminar)
        flow = metered - leak
    supply = p_a + pump.margin
    drawn = metered + pump.leakage * supply + turbulent(pump.cv_bleed, p_a, laminar)
    swash = drawn / (pump.displacement * machine.engine.set_speed)
    return SteadyTurn(edge, y, metered, flow, p_a, p_b, p_t, np.asarray(supply), np.asarray(swash))


def hydraulic_frequency(ports: Chambers, compliance_a: ArrayLike, compliance_b: ArrayLike, inertia: ArrayLike) -> Array:
    """Natural frequency ω_n [rad/s] of an inertia [kg m²] between two shut oil columns of ``compliance`` [m³/Pa]:
    ω_n² = (D_A²/C_A + D_B²/C_B)/J (Merritt 1967, 6.2)."""
    spring = ports.displacement_a**2 / np.asarray(compliance_a) + ports.displacement_b**2 / np.asarray(compliance_b)
    return np.sqrt(spring / np.asarray(inertia))


def load_sensing_loop(machine: Machine, turn: SteadyTurn) -> tuple[Array, Array]:
    """Crossover ω_c [rad/s] and damping ratio ζ of the pump's pressure loop at a held load (Krus 1988, 3.2).

    The swash integrates the margin's error, ε̇ = e/(Δp_band t_up), and the line integrates the flow, C_s ṗ = D n ε − G p with
    the valve's flow gain G = ∂Q/∂Δp = Q/(2 Δp_margin) and the pump's leakage: s² + (G/C_s) s + D n/(C_s Δp_band t_up) = 0.
    """
    pump = machine.steering.pump
    line = pump.line_volume / modulus(machine, turn.supply) + pump.line_compliance
    gain = pump.displacement * machine.engine.set_speed / (pump.control_band * pump.stroke_up_time * line)
    conductance = turn.metered / (2.0 * pump.margin) + pump.leakage
    crossover = np.sqrt(gain)
    return crossover, conductance / line / (2.0 * crossover)
