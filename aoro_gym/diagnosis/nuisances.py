"""Parameters that may lie elsewhere without anything being wrong, each with a normal prior around the given machine.

How far they may lie depends on what is known of the machine:

- :data:`SPREADS` ``day``: it was commissioned, and this is another day;
- ``range``: all that is known is the ranges of its file.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from aoro_gym.calibration.space import Space
from aoro_gym.checks import check_choice
from aoro_gym.diagnosis.noise import Floats
from aoro_gym.machine import Machine
from aoro_gym.machine.machine_file import Parameter

SPREADS: Mapping[str, float] = {"day": 0.02, "range": 0.5}
"""Half of what holds 95 % of a parameter, as a share of its range."""
NORMAL95 = 1.96
STEP = 0.5
"""Finite-difference step, in prior standard deviations ..."""
LARGEST_STEP = 0.02
"""... and at most, as a share of the range: where priors are wide, slopes are those at the centre."""


class Nuisances:
    """Uncertain parameters of a machine.

    Args:
        machine: Centre of the prior.
        spread: One of :data:`SPREADS`. Of a commissioned machine (``day``), parameters that effects move, too, stay as its
            file's ``commissioned`` says.

    Raises:
        ValueError: the spread is unknown.
    """

    def __init__(self, machine: Machine, spread: str):
        check_choice("spread", spread, SPREADS)
        entries = [entry for entry in machine.entries.values() if entry.role in ("nuisance", "both")]
        self.machine = machine
        self.space = Space(machine, [entry.key for entry in entries])

        def reach(entry: Parameter) -> float:
            if entry.role == "both" and spread == "day":
                return float(entry.commissioned[1] - entry.commissioned[0]) / 2.0
            return SPREADS[spread] * (entry.range[1] - entry.range[0])

        half = np.array([reach(entry) for entry in entries])
        values = np.array([float(entry.value) for entry in entries])
        low, high = np.array([entry.range for entry in entries]).T
        self.place: Floats = self.space.point()
        """Of the machine in the unit cube (d,)."""
        ends = self.space.places(np.clip([values - half, values + half], low, high))
        below, above = np.abs(ends - self.place)
        self.std: Floats = np.maximum(np.maximum(below, above), 1e-6) / NORMAL95
        """Prior standard deviations (d,) in the unit cube."""

    @property
    def keys(self) -> tuple[str, ...]:
        return self.space.keys

    @property
    def steps(self) -> Floats:
        """A step (d,) along each parameter, in prior standard deviations, that stays within its range."""
        size = np.minimum(STEP, LARGEST_STEP / self.std)
        return np.where(self.place + size * self.std <= 1.0, size, -size)

    def machines(self, deviations: Floats) -> Machine:
        """Machine with one variant for each row of ``deviations`` (N, d), in prior standard deviations from the centre;
        what would leave a range stays at its end."""
        moved = np.flatnonzero(np.any(deviations != 0.0, axis=0))
        values = self.space.values(np.clip(self.place + self.std * deviations, 0.0, 1.0))
        return self.machine.set(
            {self.keys[i]: values[:, i] if len(values) > 1 else float(values[0, i]) for i in moved}, check_ranges=False
        )
