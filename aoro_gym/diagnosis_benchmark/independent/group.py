"""Groups of families of machines: one catalogue of effects, one list of deviations, one way of measuring for all."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from functools import cache
from typing import Any, Protocol

import numpy as np
import warp as wp
from scipy.optimize import brentq

from . import constants
from .laws.advance import build
from .outside import Outside

Made = Mapping[str, float]


class Sampled(Protocol):
    """What measuring needs to know of a run: its machine, and times [s] of the logger's samples and of what they show."""

    machine: dict[str, float]
    times: np.ndarray
    other_times: np.ndarray


class Group(ABC):
    """Families of machines that share effects, deviations and a measuring chain.

    Attributes:
        families: Their names.
        effects: By id.
        outside: Deviations outside of the catalogue by name.
        settle: Rest [s] before a log.
        period: Between signals that measuring reads [s].
        logged: Signals that it reads, behind the joint angle in the order of ``laws.layout.SIGNALS``.
        reach: Largest logarithm by which an effect changes a constant.
    """

    families: tuple[str, ...]
    effects: Mapping[str, Any]
    outside: Mapping[str, Outside]
    settle: float
    period: float
    logged: tuple[int, ...]
    reach: float

    @abstractmethod
    def family_of(self, name: str) -> Any:
        """Constants and formulas of a family: ``TABLE``, ``derived`` and what its effects measure.

        Raises:
            ValueError: There is no such family.
        """

    @abstractmethod
    def laws(self, family: str, kind: Any) -> Any:
        """Device code of a family for a Warp struct of its constants, as :func:`.laws.advance.build` takes it."""

    @abstractmethod
    def turned(self, effect: str, family: str, machine: Made, knob: float) -> dict[str, float]:
        """A machine with the knob of an effect turned."""

    @abstractmethod
    def known_knob(self, effect: str, size: float, off: Callable[[float], float]) -> float | None:
        """Knob at which the magnitude is what is asked (``off(knob)`` is nought), of effects that need no search."""

    @abstractmethod
    def sampling(self, machine: Made, times: np.ndarray, length: float, period: float) -> tuple[np.ndarray, np.ndarray]:
        """Times [s] at which the joint angle and all other signals are read.

        Args:
            machine: Constants with effects and deviations.
            times: Of the logger's samples [s].
            length: Of the log [s].
            period: Between signals that are asked for [s].
        """

    def command(self, family: str, values: np.ndarray, machine: Made) -> np.ndarray:
        """Command (K,) on a grid of 1 ms as it reaches the valve, but for pure delays."""
        return values

    @abstractmethod
    def measured(
        self,
        family: str,
        signals: np.ndarray,
        runs: Sequence[Sampled],
        rngs: Sequence[np.random.Generator],
        noise: bool,
    ) -> list[dict[str, np.ndarray]]:
        """Columns of logs.

        Args:
            family: Of all runs.
            signals: Joint angle and :attr:`logged` ones (runs, K, signals).
            runs: What was simulated.
            rngs: A generator a run for phases and noise.
            noise: False leaves out engine orders, noise and quantisation.
        """

    def nominal(self, family: str) -> dict[str, float]:
        """Machine in the middle of every range of a family."""
        return constants.nominal(self.family_of(family).TABLE)

    def machine(self, family: str, rng: np.random.Generator) -> dict[str, float]:
        """Constants of a healthy machine of a family, drawn around the published vehicle."""
        return constants.draw(self.family_of(family).TABLE, rng)

    def another_day(self, family: str, healthy: Made, rng: np.random.Generator) -> dict[str, float]:
        """The same machine on another day: oil, air, seals, ground, tires and zeros are a little different."""
        return constants.vary(self.family_of(family).TABLE, healthy, rng)

    @cache  # noqa: B019  (groups live as long as the process)
    def structure(self, family: str) -> Any:
        """Warp struct of a family's constants."""
        fields = sorted(self.family_of(family).derived(self.nominal(family)))
        name = family.title().replace("_", "")
        annotations = dict.fromkeys(fields, wp.float64)
        body = {"__annotations__": annotations, "__module__": type(self).__module__, "__qualname__": name}
        return wp.struct(type(name, (), body))

    @cache  # noqa: B019
    def kernel(self, family: str) -> Any:
        """Kernel of a family: its laws in the integrator."""
        kind = self.structure(family)
        return build(self.laws(family, kind), kind)

    def pack(self, family: str, machines: Sequence[Made]) -> np.ndarray:
        """Structured array of machines for the kernel."""
        made = [self.family_of(family).derived(one) for one in machines]
        packed: Any = np.zeros(len(made), dtype=self.structure(family).numpy_dtype())
        for name in packed.dtype.names or ():
            packed[name] = [one[name] for one in made]
        return packed

    def measure(self, effect: str, family: str, machine: Made) -> float:
        """Operational magnitude of an effect on a machine."""
        module = self.family_of(family)
        return self.effects[effect].measure(module, module.derived(machine))

    def magnitudes(self, family: str, machine: Made) -> dict[str, float]:
        """Magnitudes of all effects on a machine."""
        return {effect: self.measure(effect, family, machine) for effect in self.effects}

    def apply(self, effect: str, family: str, machine: Made, size: float) -> dict[str, float]:
        """A machine with an effect of a signed size.

        Args:
            effect: Id of the effect.
            family: Family of the machine.
            machine: Constants of the healthy machine.
            size: Change of the effect's magnitude, in its unit.

        Raises:
            ValueError: If no setting of the machine has that magnitude.
        """
        self._check([effect])
        if size == 0.0:
            return dict(machine)
        healthy = self.measure(effect, family, machine)
        goal = healthy * (1.0 + size) if self.effects[effect].relative else healthy + size

        def off(knob: float) -> float:
            return self.measure(effect, family, self.turned(effect, family, machine, knob)) - goal

        knob = self.known_knob(effect, size, off)
        if knob is None:
            knob = self._searched(
                off, f"{effect} of {size} {self.effects[effect].unit} is out of what family {family} can be"
            )
        return self.turned(effect, family, machine, knob)

    def _searched(self, off: Callable[[float], float], message: str) -> float:
        """Root of ``off`` within :attr:`reach`; ValueError with ``message`` where there is none."""
        start, reach = off(0.0), 0.25
        while off(reach) * start > 0.0 and off(-reach) * start > 0.0:
            reach *= 1.5
            if reach > self.reach:
                raise ValueError(message)
        end = reach if off(reach) * start <= 0.0 else -reach
        return float(brentq(off, min(0.0, end), max(0.0, end), xtol=1e-13))  # pyright: ignore[reportArgumentType]

    def apply_all(self, family: str, machine: Made, effects: Mapping[str, float]) -> dict[str, float]:
        """A machine with several effects, one after the other in the order of the catalogue."""
        self._check(effects)
        made = dict(machine)
        for effect in self.effects:
            if effects.get(effect):
                made = self.apply(effect, family, made, effects[effect])
        return made

    def _check(self, effects: Sequence[str] | Mapping[str, float]) -> None:
        """ValueError for what is no effect."""
        unknown = sorted(set(effects) - set(self.effects))
        if unknown:
            raise ValueError(f"no effect {unknown[0]!r}; there are {', '.join(self.effects)}")
