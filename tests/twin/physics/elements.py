"""Hydraulic elements in float64, written from their definitions: what the circuits' oracles are made of."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np

from aoro_gym.twin.physics.cylinders import Linkage
from aoro_gym.twin.physics.fluid import Oil
from tests.twin.physics.launch import record

BAR = 1.0e5
LITRE_A_MINUTE = 1.0e-3 / 60.0
SUBSTEP = 1.0e-3 / 30.0

OIL = record(
    Oil,
    bulk_modulus=1.4e9,
    bulk_modulus_slope=10.0,
    gas_fraction=0.0,
    polytropic_exponent=1.4,
    solution_pressure=30.0 * BAR,
    laminar_pressure=BAR,
    void_pressure=-0.95 * BAR,
)
VOID = float(OIL["void_pressure"])


def cv(flow: float, drop: float) -> float:
    """Orifice coefficient [m³/s/√Pa] from a flow [L/min] at a drop [bar]."""
    return flow * LITRE_A_MINUTE / np.sqrt(drop * BAR)


def orifice(coefficient: Any, drop: Any) -> Any:
    """Turbulent flow from 1 bar on, laminar below."""
    return coefficient * np.where(np.abs(drop) < BAR, drop / np.sqrt(BAR), np.sign(drop) * np.sqrt(np.abs(drop)))


def check_valve(coefficient: Any, drop: Any, crack: Any) -> Any:
    """Orifice in one direction only, beyond its crack."""
    return orifice(coefficient, np.maximum(drop - crack, 0.0))


def relief(drop: Any, setting: Any, ramp: Any, flow: Any) -> Any:
    """Line from ``setting`` that reaches ``flow`` a ``ramp`` later."""
    return flow * np.maximum(drop - setting, 0.0) / ramp


def through_filter(drop: Any, setting: Any, ramp: Any, flow: Any, throttle: Any) -> Any:
    """Root of Δp = setting + ramp Q/flow + throttle Q² by Newton's method from the clean filter's flow, which lies above it:
    the parabola is convex, and every step stays above."""
    over = np.maximum(drop - setting, 0.0)
    q = relief(drop, setting, ramp, flow)
    for _ in range(60):
        q = q - (ramp / flow * q + throttle * q * q - over) / (ramp / flow + 2.0 * throttle * q)
    return q


def compliance(oil: Any, content: Any, volume: Any, hose: Any) -> Any:
    """C of a rigid oil volume without gas [m³/Pa], by its modulus at its pressure."""
    return volume / (oil.bulk_modulus + oil.bulk_modulus_slope * np.maximum(content, 0.0)) + hose


def chamber_compliance(oil: Any, content: Any, volume: Any, hose: Any, nominal: Any) -> Any:
    """C of an oil volume behind a piston [m³/Pa]: as :func:`compliance`, but a void by its nominal volume."""
    void = content < oil.void_pressure
    return np.where(void, nominal / oil.bulk_modulus, compliance(oil, content, volume, hose))


def pin_distance(linkage: Any, angle: Any) -> Any:
    """Distance between the pins of a cylinder, from their coordinates about the hinge."""
    gamma = linkage.g0 + angle
    return np.hypot(linkage.b * np.cos(gamma) - linkage.a, linkage.b * np.sin(gamma))


def closed_linkage(a: float, b: float, g0: float, half_range: float) -> Any:
    """Linkage with its pins ``a`` and ``b`` [m] from the hinge that closes at −``half_range`` [rad]; the stroke follows."""
    shape = SimpleNamespace(a=a, b=b, g0=g0)
    closed, opened = (pin_distance(shape, side * half_range) for side in (-1.0, 1.0))
    return record(Linkage, a=a, b=b, g0=g0, dead_length=closed, stroke=opened - closed)


def uncrossed(before: Any, after: Any) -> Any:
    """Whether a step stays on one side of the void pressure, so that one compliance holds throughout."""
    return (before < VOID) == (after < VOID)
