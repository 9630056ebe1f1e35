"""The steering circuit's static laws in a left turn, its flow balance, and what linearisation gives in closed form.

Port A is loaded, port B returns. Pressures are gauge [Pa], flows [m³/s]; every quantity is a float or has shape (N,), one
value a variant of the machine. Each component obeys the law that the machine chooses for it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from aoro_gym.machine import Machine
from aoro_gym.machine.laws import OPTIONS, Laws
from aoro_gym.units import ATMOSPHERIC_PRESSURE

Array = NDArray[Any]

LEAST_ABSOLUTE = 5000.0
"""Absolute pressure [Pa] below which free gas is not followed."""
MIDDLE_PRESSURE = 50e5
"""Pressure [Pa] at which oil of a constant modulus is as stiff as the oil that stiffens."""
ADIABATIC = 1.4
"""Exponent of air that exchanges no heat."""


def obeys(machine: Machine, law: str, option: str) -> Array:
    """Whether a component obeys the ``option`` of a ``law``: one truth value, or one a variant."""
    return _obeys(machine.laws, law, option)


@lru_cache(maxsize=256)
def _obeys(laws: Laws, law: str, option: str) -> Array:
    return np.asarray(np.equal(laws.choices[law], OPTIONS[law].index(option)))


def either(which: Array, other: Callable[[], ArrayLike], usual: Callable[[], ArrayLike]) -> Array:
    """``other()`` where ``which`` is true, elsewhere ``usual()``; what no variant needs is not worked out."""
    if which.ndim == 0:
        return np.asarray(other() if which else usual())
    return np.where(which, other(), usual())


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


def edge_flow(machine: Machine, coefficient: ArrayLike, drop: ArrayLike) -> Array:
    """Flow [m³/s] past an edge of the valve: an orifice's, or C Δp/(Δp² + p_lam²)^¼, which has no kink."""
    laminar, drop = machine.oil.laminar_pressure, np.asarray(drop)
    return either(
        obeys(machine, "orifice", "smooth"),
        lambda: coefficient * drop / np.sqrt(np.hypot(drop, laminar)),
        lambda: turbulent(coefficient, drop, laminar),
    )


def edge_drop(machine: Machine, coefficient: ArrayLike, flow: ArrayLike) -> Array:
    """Drop [Pa] by which a ``flow`` ≥ 0 passes an edge: inverse of :func:`edge_flow`; with r = (Q/C)², turbulent r, laminar
    √(r p_lam), without a kink Δp² = r²/2 + √(r⁴/4 + r² p_lam²)."""
    laminar = machine.oil.laminar_pressure
    r = np.square(np.asarray(flow) / coefficient)
    return either(
        obeys(machine, "orifice", "smooth"),
        lambda: np.sqrt(0.5 * r**2 + r * np.sqrt(0.25 * r**2 + np.square(laminar))),
        lambda: np.where(r > laminar, r, np.sqrt(r * laminar)),
    )


def modulus(machine: Machine, pressure: ArrayLike) -> Array:
    """Tangent bulk modulus [Pa] of oil with free air (Merritt 1967, 1.4): volumes of liquid and gas in series.

    Air is compressed with an exponent n, and, where it dissolves, vanishes as 1 − 3x² + 2x³ over x = p/p_solution.
    """
    oil, p = machine.oil, np.asarray(pressure, dtype=np.float64)
    absolute = np.maximum(p + ATMOSPHERIC_PRESSURE, LEAST_ABSOLUTE)
    exponent = either(obeys(machine, "gas", "isothermal"), lambda: 1.0, lambda: oil.polytropic_exponent)
    exponent = either(obeys(machine, "gas", "adiabatic"), lambda: ADIABATIC, lambda: exponent)
    gas = oil.gas_fraction * (ATMOSPHERIC_PRESSURE / absolute) ** (1.0 / exponent)
    given = gas / (exponent * absolute)
    dissolves = obeys(machine, "gas", "dissolving")
    if dissolves.any():
        x = np.clip(p / oil.solution_pressure, 0.0, 1.0)
        free, falls = 1.0 - x**2 * (3.0 - 2.0 * x), 6.0 * x * (1.0 - x) / oil.solution_pressure
        given = np.where(dissolves, given * free + gas * falls, given)
        gas = np.where(dissolves, gas * free, gas)
    liquid = 1.0 - np.asarray(oil.gas_fraction)
    felt = either(obeys(machine, "liquid", "constant"), lambda: MIDDLE_PRESSURE, lambda: np.maximum(p, 0.0))
    return (liquid + gas) / (liquid / (oil.bulk_modulus + oil.bulk_modulus_slope * felt) + given)


def walls(machine: Machine, pressure: ArrayLike) -> Array:
    """Compliance [m³/Pa] of one side's hose walls at once: C, C/(1 + p/p_s) of a braid that locks, the part (1 − s) C of
    walls that creep, half of C at either end of two segments."""
    steering = machine.steering
    share = either(
        obeys(machine, "hose", "stiffening"),
        lambda: 1.0 / (1.0 + np.maximum(pressure, 0.0) / steering.hose_stiffening_pressure),
        lambda: np.where(obeys(machine, "hose", "two_segments"), 0.5, 1.0),
    )
    share = np.where(obeys(machine, "hose", "viscoelastic"), 1.0 - np.asarray(steering.hose_delayed_share), share)
    return np.asarray(steering.hose_compliance * share)


def opening(machine: Machine, spool: ArrayLike) -> Array:
    """Share [0, 1] of the open edges at ``spool`` (of the full 2 V): straight lines between the measured points, or monotone
    cubics with slopes of Fritsch and Butland (1984), none at the end of the dead band and the last line's at 2 V."""
    valve = machine.steering.valve
    volts = 2.0 * np.asarray(spool, dtype=np.float64) - valve.overlap
    knots = (np.asarray(valve.dead_band_left), 1.0, 1.5, 2.0)
    rises = (
        np.asarray(valve.opening_left_1V0),
        np.asarray(valve.opening_left_1V5) - valve.opening_left_1V0,
        1.0 - np.asarray(valve.opening_left_1V5),
    )
    widths = [knots[i + 1] - knots[i] for i in range(3)]
    shares = [np.clip((volts - knots[i]) / widths[i], 0.0, 1.0) for i in range(3)]

    def smooth() -> Array:
        secants = [rise / width for rise, width in zip(rises, widths, strict=True)]
        slopes = [0.0, _joined(widths, secants, 0), _joined(widths, secants, 1), secants[2]]
        total = np.asarray(0.0)
        for i, (s, rise, width) in enumerate(zip(shares, rises, widths, strict=True)):
            bulge = width * s * (1.0 - s) * ((1.0 - s) * slopes[i] - s * slopes[i + 1])
            total = total + s**2 * (3.0 - 2.0 * s) * rise + bulge
        return total

    return either(
        obeys(machine, "opening", "smooth"),
        smooth,
        lambda: sum((s * rise for s, rise in zip(shares, rises, strict=True)), np.asarray(0.0)),
    )


def _joined(widths: list[Any], secants: list[Any], i: int) -> Array:
    """Slope between intervals i and i + 1: weighted harmonic mean of both secants."""
    first, second = widths[i] + 2.0 * widths[i + 1], 2.0 * widths[i] + widths[i + 1]
    return np.asarray((first + second) / (first / secants[i] + second / secants[i + 1]))


def return_pressure(machine: Machine, flow: ArrayLike) -> Array:
    """Pressure [Pa] of the return line at a ``flow`` ≥ 0: through its filter Δp = p₀ + r Q + a Q², through an orifice that
    drops as much at the nominal flow (Q/C)²."""
    line, q = machine.steering.tank_line, np.asarray(flow, dtype=np.float64)
    filtered = line.back_pressure + line.back_pressure_ramp * q / line.back_flow + line.throttle * q**2
    free = np.square(q / return_coefficient(machine))
    free = np.where(free > machine.oil.laminar_pressure, free, np.sqrt(free * machine.oil.laminar_pressure))
    return np.where(obeys(machine, "return_line", "orifice"), free, filtered)


def return_coefficient(machine: Machine) -> Array:
    """C [m³/s/√Pa] of a return line that is an orifice."""
    line = machine.steering.tank_line
    nominal = line.back_pressure + line.back_pressure_ramp + line.throttle * np.square(line.back_flow)
    return np.asarray(line.back_flow / np.sqrt(nominal))


def return_flow(machine: Machine, pressure: ArrayLike) -> Array:
    """Flow [m³/s] from the return line at ``pressure`` [Pa] to the tank: inverse of :func:`return_pressure`."""
    line = machine.steering.tank_line
    over = np.maximum(np.asarray(pressure) - line.back_pressure, 0.0)
    linear = line.back_pressure_ramp / line.back_flow
    return either(
        obeys(machine, "return_line", "orifice"),
        lambda: turbulent(return_coefficient(machine), np.maximum(pressure, 0.0), machine.oil.laminar_pressure),
        lambda: 2.0 * over / (linear + np.sqrt(linear**2 + 4.0 * line.throttle * over)),
    )


def dry_friction(machine: Machine, ports: Chambers, pressures: ArrayLike, rate: ArrayLike) -> Array:
    """Friction torque [N m] of the sliding joint: its bearing, and both cylinders' seals with their Stribeck rise, where the
    law has one.

    Args:
        machine: The machine.
        ports: Chambers at the joint's angle.
        pressures: Sum of both ports' pressures [Pa].
        rate: Joint rate [rad/s].
    """
    cylinder = machine.steering.cylinder
    speed = 0.5 * ports.lever_sum * np.asarray(rate) / cylinder.seal_stribeck_velocity
    rise = either(
        obeys(machine, "friction", "coulomb_viscous"),
        lambda: 1.0,
        lambda: 1.0 + (cylinder.seal_static_ratio - 1.0) * np.exp(-(speed**2)),
    )
    seals = cylinder.seal_preload + cylinder.seal_pressure_coefficient * np.maximum(pressures, 0.0)
    return np.asarray(machine.joint.friction_torque + ports.lever_sum * seals * rise)


@dataclass(frozen=True, eq=False)
class SteadyTurn:
    """Equilibrium of the circuit while the joint turns at constant flow."""

    spool: Array  # [-] of the full signal
    opening: Array  # [-] of both edges
    compensator: Array  # [-] opening
    metered: Array  # [m³/s] into port A
    flow: Array  # [m³/s] of the joint
    pressure_a: Array  # [Pa]
    pressure_b: Array
    return_pressure: Array
    load_sensing: Array  # [Pa]
    supply: Array
    swash: Array  # [-] of pump 2
    cylinder_a: Array  # [Pa] at the cylinders' end of the hoses
    cylinder_b: Array


def metered_flow(
    machine: Machine, edge: Array, available: ArrayLike, bias: ArrayLike = 0.0
) -> tuple[Array, Array, Array]:
    """Metered flow [m³/s], compensator opening and the edge's drop [Pa] in balance, ``available`` drop Δp [Pa] over both.

    Edge and compensator in series share the drop as y²/(y² + ρ²), ρ = edge over open compensator; the compensator's spring
    holds the edge's share and the ``bias`` [Pa] that it feels beyond at p_ref (1 + κ (½ − y)). Bisection in y: the balance
    falls monotonically.
    """
    valve, bias = machine.steering.valve, np.asarray(bias)
    available = np.asarray(available, dtype=np.float64)
    ratio = edge * valve.cv_in_left / valve.cv_compensator
    low, high = np.zeros(np.broadcast(ratio, available).shape), np.ones(np.broadcast(ratio, available).shape)
    for _ in range(60):
        y = 0.5 * (low + high)
        held = valve.compensator_pressure * (1.0 + valve.compensator_droop * (0.5 - y)) - bias
        opens = held > available * y**2 / (y**2 + ratio**2)
        low, high = np.where(opens, y, low), np.where(opens, high, y)
    y = 0.5 * (low + high)
    share = available * y**2 / (y**2 + ratio**2)
    series = edge * valve.cv_in_left * y / np.sqrt(y**2 + ratio**2)
    return edge_flow(machine, series, available), y, share


def steady_turn(machine: Machine, level: ArrayLike, angle: ArrayLike, load: ArrayLike = 0.0) -> SteadyTurn:
    """Static flow balance of a left turn (Merritt 1967, 6.1; Krus 1988, 2.2).

    Load sensing holds the pump at its line's pressure + margin, as its swash integrates the error; so compensator and edge
    share the margin, whatever the load, less what a damped line has lost. Joint flow is the metered flow less what leaks
    from port A. Port B stands above the return line by the meter-out edge's drop, port A balances port B, friction and the
    ground's ``load`` [N m]. The flow's force has moved the spool back.

    Args:
        machine: The machine.
        level: Steering signal, 0 to 1.
        angle: Joint angle [rad].
        load: Torque [N m] by which wheels and ground resist the joint.
    """
    valve, pump, cylinder = machine.steering.valve, machine.steering.pump, machine.steering.cylinder
    laminar = machine.oil.laminar_pressure
    ports = chambers(machine, angle)
    damped = obeys(machine, "load_sensing_line", "volume")
    sensed_there = obeys(machine, "compensator_sensing", "load_sensing_line")
    pipe = np.where(obeys(machine, "hose", "two_segments"), machine.steering.hose_resistance, 0.0)
    pushed = np.where(obeys(machine, "flow_force", "steady"), valve.flow_force_share, 0.0)
    commanded = spool = np.asarray(level) + 0.0 * ports.volume_a
    edge, lost, drop = opening(machine, spool), np.asarray(0.0), np.asarray(0.0)
    flow = p_a = np.zeros(spool.shape)
    for _ in range(20):  # leaks, lost pressure and moved spool are small: each round gains two digits or more
        spool = commanded - pushed * edge * drop / valve.compensator_pressure
        edge = opening(machine, spool)
        metered, y, drop = metered_flow(machine, edge, pump.margin - lost, np.where(sensed_there, lost, 0.0))
        out = flow * ports.displacement_b / ports.displacement_a
        p_t = return_pressure(machine, out)
        p_b = p_t + edge_drop(machine, np.maximum(edge, 1e-12) * valve.cv_out_left, out)
        end_b = p_b + pipe * out
        end_a = _bearing(machine, ports, end_b, flow / ports.displacement_a, np.asarray(load))
        p_a = end_a + pipe * flow
        bled = turbulent(pump.cv_bleed, p_a - lost, laminar)
        through = np.square(bled / pump.cv_ls)
        lost = np.where(damped, np.where(through > laminar, through, np.sqrt(through * laminar)), 0.0)
        leak = 2.0 * cylinder.leakage * (end_a - end_b) + valve.leakage * (p_a - p_t)
        leak = leak + turbulent(valve.cv_cross_port, p_a - p_b, laminar) + np.where(damped, bled, 0.0)
        flow = metered - leak
    supply = p_a - lost + pump.margin
    drawn = metered + pump.leakage * supply + np.where(damped, 0.0, bled)
    swash = drawn / (pump.displacement * machine.engine.set_speed)
    return SteadyTurn(
        spool, edge, y, metered, flow, p_a, p_b, p_t, np.asarray(p_a - lost), np.asarray(supply), swash, end_a, end_b
    )


def _bearing(machine: Machine, ports: Chambers, pressure_b: Array, rate: Array, load: Array) -> Array:
    """Pressure [Pa] of side A that bears side B, friction and a ``load`` [N m] at a joint ``rate`` [rad/s]."""
    drag, pressure_a = machine.steering.cylinder.seal_viscous * ports.lever_squares * rate, pressure_b
    for _ in range(5):
        friction = dry_friction(machine, ports, pressure_a + pressure_b, rate)
        pressure_a = (pressure_b * ports.displacement_b + friction + drag + load) / ports.displacement_a
    return pressure_a


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
    conductance = turn.metered / (2.0 * (turn.supply - turn.pressure_a)) + pump.leakage
    crossover = np.sqrt(gain)
    return crossover, conductance / line / (2.0 * crossover)
