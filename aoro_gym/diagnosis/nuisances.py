"""Parameters that may lie elsewhere without anything being wrong, each with a normal prior around the given machine.

How far they may lie depends on what is known of the machine:

- :data:`SPREADS` ``day``: it was commissioned, and this is another day;
- ``commissioning``: its file was calibrated, on this machine or on its kind;
- ``recalibration``: it was, but much may have moved since;
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
from aoro_gym.machine.parameters import DEFAULT_PRIORS

SPREADS: Mapping[str, float] = {"day": 0.02, "commissioning": 0.10, "recalibration": 0.25, "range": 0.5}
"""Half of what holds 95 % of a parameter, as a share of its range."""

NORMAL95 = 1.96
FARTHEST = 2.5
"""Standard deviations within which a parameter stays that effects move, too, once the machine was commissioned: 99 % do, and
what has moved farther is an effect."""


class Nuisances:
    """Uncertain parameters of a machine.

    Args:
        machine: Centre of the prior.
        spread: One of :data:`SPREADS`. Of a commissioned machine (``day``, ``recalibration``), parameters that effects
            move, too, stay as its file's ``commissioned`` says.
        uncertain: Covariance (d, d) in the unit cube of the machine itself, which adds to the spread: what its healthy logs
            left open.

    Raises:
        ValueError: the spread is unknown.
    """

    def __init__(self, machine: Machine, spread: str, uncertain: Floats | None = None):
        check_choice("spread", spread, SPREADS)
        entries = [entry for entry in machine.entries.values() if entry.role in ("nuisance", "both")]
        self.machine = machine
        self.space = Space(machine, [entry.key for entry in entries])

        def stays(entry: Parameter) -> bool:
            return entry.role == "both" and spread in ("day", "recalibration")

        def reach(entry: Parameter) -> float:
            if stays(entry):
                return float(entry.commissioned[1] - entry.commissioned[0]) / 2.0
            # nobody has calibrated what files do not say
            wide = spread == "commissioning" and entry.key in DEFAULT_PRIORS
            return SPREADS["range" if wide else spread] * (entry.range[1] - entry.range[0])

        half = np.array([reach(entry) for entry in entries])
        values = np.array([float(entry.value) for entry in entries])
        low, high = np.array([entry.range for entry in entries]).T
        self.place: Floats = self.space.point()
        """Of the machine in the unit cube (d,)."""
        ends = self.space.places(np.clip([values - half, values + half], low, high))
        below, above = np.abs(ends - self.place)
        own = np.maximum(np.maximum(below, above), 1e-6) / NORMAL95
        self.uncertain: Floats = np.zeros((len(own), len(own))) if uncertain is None else uncertain
        covariance = np.diag(own**2) + self.uncertain
        self.std: Floats = np.sqrt(np.diag(covariance))
        """Prior standard deviations (d,) in the unit cube."""
        self.correlation: Floats = covariance / np.outer(self.std, self.std)
        """Of the prior (d, d)."""
        far = np.where([stays(entry) for entry in entries], FARTHEST * self.std, 1.0)
        self.ends: tuple[Floats, Floats] = np.maximum(self.place - far, 0.0), np.minimum(self.place + far, 1.0)
        """Places (d,) in the unit cube that they stay between."""

    @property
    def keys(self) -> tuple[str, ...]:
        return self.space.keys

    def wider(self, spread: str) -> Nuisances:
        """Of the same machine, as uncertain, with another ``spread``."""
        return Nuisances(self.machine, spread, self.uncertain)

    def machines(self, deviations: Floats) -> Machine:
        """Machine with one variant for each row of ``deviations`` (N, d), in prior standard deviations from the centre;
        what would leave a range stays at its end."""
        moved = np.flatnonzero(np.any(deviations != 0.0, axis=0))
        values = self.space.values(np.clip(self.place + self.std * deviations, 0.0, 1.0))
        return self.machine.set(
            {self.keys[i]: values[:, i] if len(values) > 1 else float(values[0, i]) for i in moved}, check_ranges=False
        )
