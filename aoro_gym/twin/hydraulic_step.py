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
"""

from __future__ import annotations

import warnings

import numpy as np
from numpy.typing import NDArray

from aoro_gym.machine.parameters import Machine
from aoro_gym.machine.quantities import Quantity


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

TANK = -1
"""In place of a node: the other end of a restrictor."""


def largest_hydraulic_step(machine: Machine) -> NDArray[np.float64]:
    """Largest stable step [s] of each variant of ``machine`` (num_variants,)."""
    circuits = (_driveline(machine), _steering(machine, "left"), _steering(machine, "right"), *_arm(machine))
    fastest = np.max([_fastest(machine.num_variants, *circuit) for circuit in circuits], axis=0)
    lags = [machine.steering.valve.spool_time_constant, machine.steering.pump.ls_time_constant]
    shortest_lag = np.min([np.broadcast_to(lag, fastest.shape) for lag in lags], axis=0)
    bound: NDArray[np.float64] = np.minimum(2.0 / fastest, 2.0 * shortest_lag)
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


def _stiffness(machine: Machine, volume: Quantity, walls: Quantity, pressure: Quantity) -> Quantity:
    """dp/dV [Pa/m³] of oil without gas at ``pressure`` [Pa] between compliant ``walls`` [m³/Pa]."""
    modulus = machine.oil.bulk_modulus + machine.oil.bulk_modulus_slope * np.asarray(pressure)
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
    supply, load, other, back = range(4)
    smallest = circuit.hose_volume + 2.0 * cylinder.dead_volume
    port = _stiffness(machine, smallest, circuit.hose_compliance, valve.shock_pressure)
    pump = _stiffness(machine, circuit.pump.line_volume, circuit.pump.line_compliance, circuit.pump.cutoff)
    edge = getattr(valve, f"cv_in_{side}")
    metered = edge / np.sqrt(1.0 + (edge / valve.cv_compensator) ** 2)  # behind the open compensator
    cross = 2.0 * cylinder.leakage + valve.cv_cross_port / np.sqrt(lam)
    return [pump, port, port, _stiffness(machine, tank.volume, tank.compliance, tank.back_pressure)], [
        (supply, load, metered / np.sqrt(lam)),
        (supply, TANK, circuit.pump.leakage),
        (load, other, cross),
        (load, back, valve.leakage),
        (other, back, getattr(valve, f"cv_out_{side}") / np.sqrt(lam) + valve.leakage),
        (back, TANK, tank.back_flow / tank.back_pressure_ramp),
    ]


def _arm(machine: Machine) -> list[Circuit]:
    """An arm's chamber behind its open valve."""
    arm, lam = machine.arm, machine.oil.laminar_pressure
    smallest = arm.hose_volume + arm.cylinder.dead_volume
    chamber = _stiffness(machine, smallest, arm.hose_compliance, arm.valve.port_relief)
    return [([chamber], [(0, TANK, arm.valve.cv / np.sqrt(lam))])]
