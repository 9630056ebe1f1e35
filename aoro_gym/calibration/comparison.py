"""Machines beside recordings: what parts them, sample by sample."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from aoro_gym.calibration.ensemble import posterior_factor
from aoro_gym.calibration.fit import Residuals
from aoro_gym.calibration.progress import Work
from aoro_gym.calibration.published import IDENTIFIABLE
from aoro_gym.calibration.recordings import CHANNELS, EVERY, FilteredLog, whitened
from aoro_gym.calibration.replay import repeat
from aoro_gym.calibration.space import PRIOR_STD, Space
from aoro_gym.machine import Machine
from aoro_gym.recording.logs import TICK

Parts = Mapping[int, Mapping[str, NDArray[np.float64]]]
"""Misses (S, N) [SI] by number of the recording and channel."""

Masks = Sequence[NDArray[np.bool_]]
"""Of each recording, which of its samples count, (S,)."""


@dataclass(frozen=True)
class Comparison:
    """Machines beside recordings, all samples of them or some."""

    recordings: Sequence[FilteredLog]
    device: str
    work: Work
    masks: Masks = field(default=())
    """Samples that count; by default all."""

    def repeated(self, machine: Machine) -> Iterator[tuple[FilteredLog, dict[str, NDArray[np.float64]]]]:
        """Each recording that has samples that count, and what the variants of ``machine`` do under its commands."""
        seconds = sum((recording.count - 1) * TICK for recording in self.recordings)
        for number, recording in enumerate(self.recordings):
            if self._counts(number):
                yield (
                    recording,
                    repeat(machine, recording, device=self.device, progress=lambda done: self.work.did(done / seconds)),
                )

    def parts(self, machine: Machine) -> Parts:
        """Misses (S, N), SI, by number of the recording and channel, all samples of each."""
        numbers = filter(self._counts, range(len(self.recordings)))
        return {
            number: {name: (found[name] - value[:, None])[::EVERY] for name, value in recording.channels.items()}
            for number, (recording, found) in zip(numbers, self.repeated(machine), strict=True)
        }

    def rows(self, parts: Parts) -> dict[int, list[NDArray[np.float64]]]:
        """Of the samples that count, misses in standard deviations of noise: by recording, (S, N) a channel."""
        out = {}
        for number in filter(self._counts, parts):
            which = self.masks[number] if self.masks else slice(None)
            std = self.recordings[number].std
            out[number] = [whitened(miss[which], std[c], CHANNELS[c].zero) for c, miss in parts[number].items()]
        return out

    def misses(self, machine: Machine) -> NDArray[np.float64]:
        """What parts the variants of ``machine`` from the samples that count, in standard deviations of noise (R, N)."""
        return joined(self.rows(self.parts(machine)))

    def _counts(self, number: int) -> bool:
        return not self.masks or bool(np.any(self.masks[number]))

    def residuals(self, space: Space) -> Residuals:
        """The misses of points."""
        return lambda points: self.misses(space.population(points))

    def identifiable(self, space: Space) -> NDArray[np.bool_]:
        """Which parameters of ``space`` the recordings feel."""
        self.work.begin("sensitivity", "which parameters the logs feel")
        _, jacobian = posterior_factor(self.residuals(space), space.point(), PRIOR_STD)
        return PRIOR_STD * np.linalg.norm(jacobian, axis=0) > IDENTIFIABLE


def joined(rows: Mapping[int, Sequence[NDArray[np.float64]]]) -> NDArray[np.float64]:
    """Misses (R, N) of all channels of all recordings below each other."""
    return np.concatenate([row for each in rows.values() for row in each])
