"""How magnitudes move parameters of the machine, and how operational magnitudes are measured."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from aoro_gym.effects.effect import Magnitude
from aoro_gym.machine.parameters import Machine
from aoro_gym.machine.quantities import Quantity

REFERENCE_FLOW = 1e-3
"""Flow [m³/s] at which pressure drops are measured: 60 L/min."""


REFERENCE_PRESSURE = 100e5
"""Pressure [Pa] at which leakages and moduli are measured."""


def factor(low: float, high: float, source: str) -> Magnitude:
    """A magnitude that multiplies."""
    return Magnitude("factor", "1", low, high, source, none=1.0, scale="log")


def added(key: str) -> Callable[..., Mapping[str, Quantity]]:
    """A magnitude that is added to ``key`` [SI]."""
    return lambda machine, amount: {key: amount}


def scaled(*keys: str) -> Callable[..., Mapping[str, Quantity]]:
    """A factor on ``keys``."""
    return lambda machine, factor: {key: machine.value(key) * (factor - 1.0) for key in keys}


def parameter(key: str, factor: float = 1.0) -> Callable[..., Quantity]:
    """A parameter [SI] times ``factor``."""
    return lambda machine, *magnitude: factor * np.asarray(machine.value(key))


def given(machine: Machine, *magnitude: Quantity) -> Quantity:
    """The magnitude itself, which is measured as such."""
    return magnitude[0]
