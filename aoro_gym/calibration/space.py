"""The free parameters of a calibration, mapped onto the unit cube by their ranges."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from aoro_gym.machine.parameters import Machine

PRIOR_STD = 0.25
"""Standard deviation that a range, read as 95 %, gives a parameter in the unit cube."""

LOG_SPAN = 3.5
"""A range whose ends differ by more than this factor is searched on a logarithmic scale."""


@dataclass(frozen=True)
class Space:
    """Parameters of ``machine`` under ``keys``, within the ranges of the machine file.

    A point is an array (d,) in [0, 1]: 0 is the low end of a range, 1 the high one.
    """

    machine: Machine
    keys: tuple[str, ...]

    def __init__(self, machine: Machine, keys: Sequence[str]):
        if machine.num_variants != 1:
            raise ValueError(f"a calibration starts from one machine, but this one has {machine.num_variants} variants")
        object.__setattr__(self, "machine", machine)
        object.__setattr__(self, "keys", tuple(keys))
        entries = machine.entries
        unknown = [key for key in keys if key not in entries]
        if unknown:
            raise ValueError(
                f"'{unknown[0]}' is no parameter of machine '{machine.name}'; 'aoro-gym parameters' lists them"
            )
        ends = np.array([entries[key].range for key in keys], dtype=np.float64)
        log = (ends[:, 0] > 0.0) & (ends[:, 1] > LOG_SPAN * np.maximum(ends[:, 0], 1e-300))
        object.__setattr__(self, "_log", log)
        object.__setattr__(self, "_low", np.where(log, np.log(np.where(log, ends[:, 0], 1.0)), ends[:, 0]))
        object.__setattr__(self, "_high", np.where(log, np.log(np.where(log, ends[:, 1], 1.0)), ends[:, 1]))

    def describe(self) -> str:
        """Every parameter of the machine with its value and range, and which are free: what a search depends on."""
        entries = self.machine.entries.values()
        return repr([(e.key, float(e.value), e.range, e.key in self.keys) for e in entries])

    def values(self, points: ArrayLike) -> NDArray[np.float64]:
        """Parameter values in the file's units, shape (..., d), of points (..., d)."""
        inner = self._low + (self._high - self._low) * np.asarray(points, dtype=np.float64)  # type: ignore[attr-defined]
        return np.where(self._log, np.exp(np.where(self._log, inner, 0.0)), inner)  # type: ignore[attr-defined]

    def point(self, machine: Machine | None = None) -> NDArray[np.float64]:
        """Point (d,) of ``machine`` (by default the one that the space was made from), clipped to the cube."""
        entries = (machine or self.machine).entries
        return self.places(np.array([entries[key].value for key in self.keys], dtype=np.float64))

    def places(self, values: ArrayLike) -> NDArray[np.float64]:
        """Points (..., d) of parameter values in the file's units, shape (..., d), clipped to the cube."""
        given = np.asarray(values, dtype=np.float64)
        inner = np.where(self._log, np.log(np.where(self._log, np.maximum(given, 1e-300), 1.0)), given)  # type: ignore[attr-defined]
        return np.clip((inner - self._low) / (self._high - self._low), 0.0, 1.0)  # type: ignore[attr-defined]

    def rounded(self, point: ArrayLike) -> dict[str, float]:
        """Parameter values by key of a point (d,), in six digits and within their ranges."""
        entries, values = self.machine.entries, {}
        for key, value in zip(self.keys, self.values(point), strict=True):
            low, high = entries[key].range
            values[key] = min(max(float(f"{value:.6g}"), low), high)
        return values

    def population(self, points: ArrayLike) -> Machine:
        """Machine with one variant a point, (N, d); one point (d,) or (1, d) gives a plain machine."""
        values = np.atleast_2d(self.values(points))
        if len(values) == 1:
            return self.machine.set({key: float(values[0, i]) for i, key in enumerate(self.keys)}, check_ranges=False)
        return self.machine.set({key: values[:, i] for i, key in enumerate(self.keys)}, check_ranges=False)

    def at_bounds(self, point: ArrayLike, margin: float = 0.01) -> list[tuple[str, str]]:
        """Parameters that lean on an end of their range: (key, "low" or "high")."""
        return [
            (key, "low" if u < 0.5 else "high")
            for key, u in zip(self.keys, np.asarray(point), strict=True)
            if min(u, 1.0 - u) < margin
        ]
