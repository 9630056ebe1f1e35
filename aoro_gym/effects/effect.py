"""What an effect is: a deviation of a machine from its twin, off by default.

An effect is a deviation from the commissioned machine with one or two magnitudes. At the magnitudes ``none`` it leaves
everything as it is, to the bit. It acts in one of three places, and each effect has all three methods, so that a caller
need not know which:

- :meth:`Effect.apply`: on the machine's parameters;
- :meth:`Effect.tilt`: on the plane under it;
- :meth:`Effect.record`: on the signals that were sampled, after the simulation.

Magnitudes are numbers, or arrays (N,) with one value a twin::

    machine = EFFECTS["seal_friction"].apply(Machine.load("aoro"), np.linspace(0.0, 4000.0, 64))

What can be measured on any machine, whatever its laws, is the effect's operational magnitude Q (:meth:`Effect.measured`);
how large an effect is, is said by Q with it less Q without.

A new effect is one more entry. Where parameters of the machine file can bring it about, that is all::

    weak_relief = MachineEffect(
        id="weak_relief", component="valve", physics="The ports' shock valves open early.", sign="+: lower setting",
        magnitudes=(Magnitude("drop", "Pa", 0.0, 1e7, "E"),),
        operational=(
            Operational("opening pressure of a shock valve", "Pa", lambda m, drop: m.steering.valve.shock_pressure),
        ),
        change=lambda machine, drop: {"steering.valve.shock_pressure": -drop},
    )
    effects = {**EFFECTS, weak_relief.id: weak_relief}

Where it needs a law of its own, write a ``wp.func`` in ``twin/physics`` with a parameter that switches it off, give the
parameter a place in ``sections.py`` and the machine files (role ``effect``), and let the effect move it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from aoro_gym.checks import check_choice, check_range
from aoro_gym.machine.parameters import Machine
from aoro_gym.machine.quantities import UNITS, Quantity, as_quantity
from aoro_gym.terrains.plane import Plane

COMPONENTS = (
    "sensor", "pump", "valve", "oil_and_hoses", "cylinders", "joint", "wheels_and_ground", "mass", "engine", "driveline",
)  # fmt: skip
"""Parts of the machine that an effect can lie in."""

ANGLE = "joint_angle"
"""Signal of the joint's sensor, named as the twin's output."""


@dataclass(frozen=True)
class Magnitude:
    """One magnitude of an effect: a number that an optimiser can work on between ``low`` and ``high`` (about 95 %)."""

    name: str
    unit: str
    low: float
    high: float
    source: str
    none: float = 0.0  # the value at which the effect is absent
    scale: str = "linear"  # or "log": what is searched is its logarithm
    least: float | None = None  # from which on it counts as a cause, where that is not at once; ``none`` is then below

    def __post_init__(self) -> None:
        of = f"of magnitude {self.name}"
        check_choice(f"scale {of}", self.scale, ("linear", "log"))
        check_range(f"low {of}", self.low, self.unit, lt=self.high, note=", which is high")
        check_range(f"none {of}", self.none, self.unit, ge=self.low, le=self.high)
        if self.least is not None:
            check_range(f"least {of}", self.least, self.unit, gt=self.none, lt=self.high)
        if self.scale == "log":
            check_range(f"low {of}", self.low, self.unit, gt=0.0, note=" on a log scale")


@dataclass(frozen=True)
class Operational:
    """What can be measured on any machine: ``measure(machine, *magnitudes)`` gives it for the machine that already has
    the effect, in SI."""

    quantity: str
    unit: str
    measure: Callable[..., Quantity]


@dataclass(frozen=True, kw_only=True)
class Effect:
    """What all effects have in common; see the module."""

    id: str
    component: str
    physics: str
    sign: str
    magnitudes: tuple[Magnitude, ...]
    operational: tuple[Operational, ...]
    hidden: str = ""
    """Where it does not show; empty if standing turns tell."""

    def __post_init__(self) -> None:
        check_choice(f"component of effect {self.id}", self.component, COMPONENTS)
        if len(self.magnitudes) not in (1, 2):
            raise ValueError(f"effect {self.id} has {len(self.magnitudes)} magnitudes, but must have one or two")

    @property
    def none(self) -> tuple[float, ...]:
        """Magnitudes at which the effect is absent."""
        return tuple(magnitude.none for magnitude in self.magnitudes)

    def apply(self, machine: Machine, *magnitude: ArrayLike) -> Machine:
        """``machine`` with the effect; one variant a value where a magnitude is an array (N,)."""
        self._checked(magnitude)
        return machine

    def tilt(self, plane: Plane, *magnitude: ArrayLike) -> Plane:
        """The ``plane`` that the machine stands on, with the effect."""
        self._checked(magnitude)
        return plane

    def record(
        self, signals: Mapping[str, NDArray[Any]], rate: float, *magnitude: ArrayLike
    ) -> Mapping[str, NDArray[Any]]:
        """Sampled ``signals`` (F, N), by the twin's output names, as the machine's logger has them.

        Args:
            signals: Evenly spaced samples, at rest in the first; best denser than the log, whose samples are then taken.
            rate: Samples a second [Hz].
            magnitude: Numbers, or shape (N,).
        """
        self._checked(magnitude)
        return signals

    def measured(self, machine: Machine, *magnitude: ArrayLike) -> tuple[Quantity, ...]:
        """Operational magnitudes [SI] of ``machine`` once it has the effect."""
        values = self._checked(magnitude)
        affected = self.apply(machine, *values)
        return tuple(as_quantity(one.measure(affected, *values)) for one in self.operational)

    def describe(self, machine: Machine) -> dict[str, Any]:
        """The entry as plain values, for JSON, with the operational magnitudes of one ``machine`` without the effect and at
        the ends of the magnitudes' ranges."""
        low, high = (tuple(getattr(one, end) for one in self.magnitudes) for end in ("low", "high"))
        without, least, most = (self.measured(machine, *magnitude) for magnitude in (self.none, low, high))
        return {
            "id": self.id,
            "component": self.component,
            "physics": self.physics,
            "sign": self.sign,
            "magnitudes": [
                {
                    "name": one.name, "unit": one.unit, "range": [one.low, one.high], "none": one.none, "scale": one.scale,
                    "least": one.least, "source": one.source,
                }
                for one in self.magnitudes
            ],
            "operational": [
                {
                    "quantity": one.quantity, "unit": one.unit, "none": float(without[i]), "low": float(least[i]),
                    "high": float(most[i]),
                }
                for i, one in enumerate(self.operational)
            ],
            "hidden": self.hidden,
        }  # fmt: skip

    def _checked(self, magnitude: tuple[ArrayLike, ...]) -> tuple[Quantity, ...]:
        if len(magnitude) != len(self.magnitudes):
            names = ", ".join(one.name for one in self.magnitudes)
            raise ValueError(f"effect {self.id} has {len(magnitude)} magnitudes, but takes {names}")
        for one, value in zip(self.magnitudes, magnitude, strict=True):
            array = np.asarray(value, dtype=np.float64)
            if array.ndim > 1 or array.size == 0 or not np.all(np.isfinite(array)):
                raise ValueError(
                    f"effect {self.id}: {one.name} is {value!r}, but must be a finite number, or one a twin"
                )
        return tuple(as_quantity(value) for value in magnitude)


@dataclass(frozen=True, kw_only=True)
class MachineEffect(Effect):
    """An effect on the machine's parameters: ``change(machine, *magnitudes)`` gives what is added to each key [SI]."""

    change: Callable[..., Mapping[str, Quantity]]

    def apply(self, machine: Machine, *magnitude: ArrayLike) -> Machine:
        """See :meth:`Effect.apply`; raises ValueError where the machine would have no physical meaning."""
        changes = self.change(machine, *self._checked(magnitude))
        entries = machine.entries
        values = {key: entries[key].value + added / UNITS[entries[key].unit][1] for key, added in changes.items()}
        return machine.set(values, source=f"effect {self.id}", check_ranges=False)


@dataclass(frozen=True, kw_only=True)
class GroundEffect(Effect):
    """An effect on the ground: ``change(plane, *magnitudes)`` gives the plane."""

    change: Callable[..., Plane]

    def tilt(self, plane: Plane, *magnitude: ArrayLike) -> Plane:
        """See :meth:`Effect.tilt`."""
        return self.change(plane, *self._checked(magnitude))


@dataclass(frozen=True, kw_only=True)
class ChainEffect(Effect):
    """An effect of the measuring chain: ``change(values, rate, *magnitudes)`` of each of the ``signals`` that it touches,
    of all of them if None."""

    change: Callable[..., NDArray[np.floating]]
    signals: tuple[str, ...] | None = (ANGLE,)

    def record(
        self, signals: Mapping[str, NDArray[Any]], rate: float, *magnitude: ArrayLike
    ) -> Mapping[str, NDArray[Any]]:
        """See :meth:`Effect.record`."""
        values = self._checked(magnitude)
        touched = signals if self.signals is None else [name for name in self.signals if name in signals]
        return {**signals, **{name: self.change(signals[name], rate, *values) for name in touched}}
