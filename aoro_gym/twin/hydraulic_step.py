"""The largest hydraulic step that a machine's circuits bear.

Every volume i of a circuit obeys ṗ_i = K_i Σ_j G_ij (p_j − p_i), with K = dp/dV its stiffness [Pa/m³] and G = dQ/dΔp the
slopes [m³/s/Pa] of the restrictors between volumes, or between a volume and the tank. With the circuit's weighted Laplacian
L this is ṗ = −K L p, and K L is similar to the symmetric K^½ L K^½: its eigenvalues λ are real and not negative, and the
explicit Euler steps of :func:`aoro_gym.twin.physics.steering.steering_step` damp every mode if dt λ_max < 2 (Hairer and
Wanner, *Solving Ordinary Differential Equations II*, 1996, section IV.2). Beyond, the fastest mode rings from one step to
the next until restrictors turn turbulent and lose slope, so by more the larger the step.

A restrictor is steepest while it is laminar, G = C/√p_lam; a relief valve beyond its setting has G = Q_nom/ramp. What can
be open together over some time counts together: all of the driveline with one charge check and its relief (the checks of
both mains are open together only at rest, where leakage passes them, and close before they ring by more than its pressure
drop); one side of the steering valve with the return filter; an arm's valve. Volumes are the smallest, at the end of a
stroke, and oil the stiffest: free of gas, at the setting of the circuit's relief valve. First-order lags ẋ = (u − x)/τ need
dt < 2 τ; the compensator, the mount and dry friction are implicit.

Other laws move the bound (:mod:`aoro_gym.machine.laws`). Walls that stiffen count at the setting of the relief valve, walls
that creep by what gives at once. A load-sensing line with a volume is one more node on the loaded port. Of two segments the
valve's end is the port; with the oil between them it swings at ω² = (K₁ + K₂)/L, stepped flow first, so that a mode with
both is damped if dt λ/2 + (dt ω/2)² < 1 (Jury's criterion). Masses, ẍ = −ω² x − 2 ζ ω ẋ implicit in ζ, need
dt < 2 (ζ + √(1 + ζ²))/ω; the compensator's spring is stiffened by its edge's drop, the more the less its spool is open. The
lag of a shock valve and of pump 2's control valve are implicit, and a static compensator passes less than an open one.
"""

from __future__ import annotations

import warnings

import numpy as np
from numpy.typing import NDArray

from aoro_gym.machine.laws import OPTIONS
from aoro_gym.machine.parameters import Machine
from aoro_gym.machine.quantities import Quantity
from aoro_gym.twin.records import MIDDLE_PRESSURE


class FineStepWarning(UserWarning):
    """A hydraulic step is so fine that rounding outweighs what it gains."""


FINEST = 4e-6
"""Hydraulic step [s] below which results get worse, not better: states change by less in a step than float32 resolves of
them. Down to there the twin is as near to the continuous laws as in float64; at half of it port pressures are off by 1 bar
(``studies/convergence``)."""

TOLERATED = 4.0
"""Of many machines side by side, such as are drawn within their ranges, each is refused only so many times beyond its own
bound: up to there its fastest mode rings, by bars at most, where restrictors are laminar, and does not diverge. Of 300
machines drawn within half their ranges a tenth are stiffer than the default step bears, the stiffest by a factor of 1.9."""

SMALL_OPENING = 0.01
"""Of the edge that a spring-mass compensator bears without ringing under the full pressure of the pump; what passes less is
too little to be seen."""

TANK = -1
"""In place of a node: the other end of a restrictor."""


def largest_hydraulic_step(machine: Machine) -> NDArray[np.float64]:
    """Largest stable step [s] of each variant of ``machine`` (num_variants,)."""
    fastest = np.max([_fastest(machine.num_variants, *circuit) for circuit in circuits(machine)], axis=0)
    swing = swing_frequency(machine)
    bounds = [4.0 / (fastest + np.sqrt(np.square(fastest) + 4.0 * np.square(swing))), *actuator_steps(machine)]
    bound: NDArray[np.float64] = np.min([np.broadcast_to(one, fastest.shape) for one in bounds], axis=0)
    return bound


def check_hydraulic_step(
    machine: Machine, main_step: float, substeps: int, numbers: NDArray[np.integer] | None = None
) -> None:
    """Raise ValueError, naming the bound and the fix, if the hydraulic step is unstable; of several machines, if it is
    :data:`TOLERATED` times as large as one of them bears.

    Args:
        machine: One machine, or N variants.
        main_step: [s].
        substeps: Hydraulic ones within it.
        numbers: (N,) twins that the variants are for; by default they count from 0.
    """
    largest = largest_hydraulic_step(machine)
    worst = int(np.argmin(largest))
    tolerated = 1.0 if machine.num_variants == 1 and numbers is None else TOLERATED
    if main_step / substeps <= tolerated * largest[worst]:
        return
    which = f" of twin {worst if numbers is None else numbers[worst]}" if machine.num_variants > 1 else ""
    raise ValueError(
        f"substeps is {substeps}, a hydraulic step of {1e6 * main_step / substeps:.3g} µs, but the circuits of machine "
        f"{machine.name!r}{which} are stable only up to {1e6 * largest[worst]:.3g} µs: take substeps of at least "
        f"{int(np.ceil(main_step / largest[worst]))}, or a shorter main_step"
    )


def warn_of_fine_step(main_step: float, substeps: int, *, stacklevel: int) -> None:
    """Warn (:class:`FineStepWarning`) of a hydraulic step below :data:`FINEST`."""
    if main_step / substeps < FINEST * (1.0 - 1e-6):
        warnings.warn(
            f"substeps is {substeps}: a hydraulic step of {1e6 * main_step / substeps:.3g} µs is finer than "
            f"{1e6 * FINEST:g} µs, below which single precision makes pressures worse, not better; take substeps of at most "
            f"{max(int(main_step / FINEST * (1.0 + 1e-6)), 1)}",
            FineStepWarning,
            stacklevel=stacklevel,
        )


Circuit = tuple[list[Quantity], list[tuple[int, int, Quantity]]]
"""Stiffnesses K of the volumes, and restrictors between two of them: their slopes G."""


def circuits(machine: Machine) -> list[Circuit]:
    """The circuits that bound the step."""
    return [_driveline(machine), _steering(machine, "left"), _steering(machine, "right"), *_arm(machine)]


def swing_frequency(machine: Machine) -> Quantity:
    """Natural frequency [rad/s] of the oil between two segments of a hose; 0 by laws without."""
    return np.where(_chosen(machine, "hose", "two_segments"), _hose_frequency(machine), 0.0)


def _fastest(
    count: int, stiffness: list[Quantity], restrictors: list[tuple[int, int, Quantity]]
) -> NDArray[np.float64]:
    """Largest eigenvalue [1/s] of the circuit in each of ``count`` variants."""
    root = np.sqrt([np.broadcast_to(one, count) for one in stiffness])  # (nodes, count)
    matrix = np.zeros((count, len(root), len(root)))
    for first, second, slope in restrictors:
        ends = [node for node in (first, second) if node != TANK]
        for node in ends:
            matrix[:, node, node] += slope * root[node] ** 2
        if len(ends) == 2:
            matrix[:, first, second] -= slope * root[first] * root[second]
            matrix[:, second, first] -= slope * root[first] * root[second]
    fastest: NDArray[np.float64] = np.linalg.eigvalsh(matrix)[:, -1].astype(np.float64)
    return fastest


def _chosen(machine: Machine, law: str, option: str) -> NDArray[np.bool_]:
    """Whether each variant obeys the ``option`` of a ``law``."""
    return np.asarray(np.equal(machine.laws.choices[law], OPTIONS[law].index(option)))


def actuator_steps(machine: Machine) -> tuple[Quantity, ...]:
    """Largest stable steps [s] of spool, load-sensing lag and compensator."""
    valve = machine.steering.valve
    spool = np.where(
        _chosen(machine, "spool", "second_order"),
        _largest_step_of_mass(valve.spool_frequency, valve.spool_damping),
        2.0 * valve.spool_time_constant,
    )
    lag = np.where(
        _chosen(machine, "load_sensing_line", "volume"), np.inf, 2.0 * machine.steering.pump.ls_time_constant
    )
    # d/dy of y²/(y² + ρ²) is √27/(8 ρ) at most
    ratio = SMALL_OPENING * np.minimum(valve.cv_in_left, valve.cv_in_right) / valve.cv_compensator
    drop = machine.steering.pump.cutoff / valve.compensator_pressure
    stiffened = np.sqrt(valve.compensator_droop + np.sqrt(27.0) / 8.0 * drop / ratio)
    mass = _largest_step_of_mass(valve.compensator_frequency * stiffened, valve.compensator_damping / stiffened)
    return spool, lag, np.where(_chosen(machine, "compensator", "spring_mass"), mass, np.inf)


def _largest_step_of_mass(frequency: Quantity, damping: Quantity) -> Quantity:
    """Of ẍ = −ω² x − 2 ζ ω ẋ, rate first and implicit in ζ."""
    return 2.0 * (damping + np.sqrt(1.0 + np.square(damping))) / frequency


def _port(machine: Machine) -> tuple[Quantity, Quantity]:
    """Stiffnesses [Pa/m³] of a steering port at the end of a stroke by the law of hoses: on the valve's end, and of two
    segments that on the cylinders' end."""
    circuit, pressure = machine.steering, machine.steering.valve.shock_pressure
    walls = circuit.hose_compliance
    walls = np.where(
        _chosen(machine, "hose", "stiffening"), walls / (1.0 + pressure / circuit.hose_stiffening_pressure), walls
    )
    walls = np.where(_chosen(machine, "hose", "viscoelastic"), walls * (1.0 - circuit.hose_delayed_share), walls)
    ends = 2.0 * circuit.cylinder.dead_volume
    half = 0.5 * circuit.hose_volume
    two = _chosen(machine, "hose", "two_segments")
    walls = np.where(two, 0.5 * walls, walls)
    volume = np.where(two, half, circuit.hose_volume + ends)
    return _stiffness(machine, volume, walls, pressure), _stiffness(machine, half + ends, walls, pressure)


def _hose_frequency(machine: Machine) -> Quantity:
    """Natural frequency [rad/s] of the oil between a hose's two segments."""
    first, second = _port(machine)
    return np.sqrt((first + second) / machine.steering.hose_inertance)


def _stiffness(machine: Machine, volume: Quantity, walls: Quantity, pressure: Quantity) -> Quantity:
    """dp/dV [Pa/m³] of oil without gas at ``pressure`` [Pa] between compliant ``walls`` [m³/Pa]."""
    felt = np.where(_chosen(machine, "liquid", "constant"), MIDDLE_PRESSURE, pressure)
    modulus = machine.oil.bulk_modulus + machine.oil.bulk_modulus_slope * felt
    return modulus / (volume + walls * modulus)


def _driveline(machine: Machine) -> Circuit:
    """Mains, the motors' four hoses with open traction valves, the charge line with its relief and one open check."""
    line, lam = machine.driveline, machine.oil.laminar_pressure
    forward, back, charge, hoses = 0, 1, 2, range(3, 7)
    main = _stiffness(machine, line.main_volume, line.main_compliance, line.relief.pressure)
    hose = _stiffness(machine, line.wheel_hose_volume, line.wheel_hose_compliance, line.relief.pressure)
    charged = _stiffness(machine, line.charge.volume, line.charge_compliance, line.charge.relief_pressure)
    return [main, main, charged, *[hose] * 4], [
        (charge, back, line.charge.cv_check / np.sqrt(lam)),
        (charge, TANK, line.charge.relief_flow / line.charge.relief_ramp),
        (back, TANK, line.flush.flow / line.flush.ramp + line.pump.leakage),
        (forward, TANK, line.pump.leakage),
        (forward, back, line.pump.cross_leakage),
        *((forward, one, line.traction.cv / np.sqrt(lam)) for one in hoses),
        *((one, back, line.motor.leakage) for one in hoses),
    ]


def _steering(machine: Machine, side: str) -> Circuit:
    """Pump line, ports and return line while the valve is fully open to one ``side``."""
    circuit, lam = machine.steering, machine.oil.laminar_pressure
    valve, cylinder, tank = circuit.valve, circuit.cylinder, circuit.tank_line
    supply, load, other, back, sensed = range(5)
    port, _ = _port(machine)
    sensing = _chosen(machine, "load_sensing_line", "volume")
    sensed_oil = _stiffness(machine, circuit.pump.ls_volume, 0.0, circuit.pump.cutoff)
    nominal = tank.back_pressure + tank.back_pressure_ramp + tank.throttle * np.square(tank.back_flow)
    to_tank = np.where(
        _chosen(machine, "return_line", "orifice"),
        tank.back_flow / np.sqrt(nominal * lam),
        tank.back_flow / tank.back_pressure_ramp,
    )
    pump = _stiffness(machine, circuit.pump.line_volume, circuit.pump.line_compliance, circuit.pump.cutoff)
    edge = getattr(valve, f"cv_in_{side}")
    metered = edge / np.sqrt(1.0 + (edge / valve.cv_compensator) ** 2)  # behind the open compensator
    cross = 2.0 * cylinder.leakage + valve.cv_cross_port / np.sqrt(lam)
    return [pump, port, port, _stiffness(machine, tank.volume, tank.compliance, tank.back_pressure), sensed_oil], [
        (supply, load, metered / np.sqrt(lam)),
        (supply, TANK, circuit.pump.leakage),
        (load, other, cross),
        (load, back, valve.leakage),
        (other, back, getattr(valve, f"cv_out_{side}") / np.sqrt(lam) + valve.leakage),
        (back, TANK, to_tank),
        (load, sensed, sensing * circuit.pump.cv_ls / np.sqrt(lam)),
        (sensed, TANK, sensing * circuit.pump.cv_bleed / np.sqrt(lam)),
    ]


def _arm(machine: Machine) -> list[Circuit]:
    """An arm's chamber behind its open valve."""
    arm, lam = machine.arm, machine.oil.laminar_pressure
    smallest = arm.hose_volume + arm.cylinder.dead_volume
    chamber = _stiffness(machine, smallest, arm.hose_compliance, arm.valve.port_relief)
    return [([chamber], [(0, TANK, arm.valve.cv / np.sqrt(lam))])]
