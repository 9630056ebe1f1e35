"""Full turns of a population of machines: every machine turns at every level, one launch a level."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from aoro_gym.twin import Machine, Twin
from aoro_gym.validation.key_figures import FIGURES, key_figures_batch

STANDSTILL = 0.6
"""Rest [s] before the signal, and after the slowest turn: the filter needs half a second on both sides."""

SAMPLING = 0.01
"""Sampling interval [s] of the joint angle sensor."""


@dataclass(frozen=True)
class Turn:
    """A full turn from stop to stop at a share of the full signal; positive turns left."""

    signal: float
    longest: float
    """Time [s] after which a turn that has not ended counts as failed."""


def turn(signal: float) -> Turn:
    """The turn at ``signal``, given 1.5 times the time that the published machine needs."""
    expected = np.interp(abs(signal), [0.25, 0.5, 0.75, 1.0], [30.0, 7.5, 2.8, 2.1])
    if signal < 0:
        expected = np.interp(abs(signal), [0.25, 0.5, 0.75, 1.0], [40.0, 11.2, 3.3, 2.2])
    return Turn(signal, round(1.4 * float(expected), 1))


def turn_figures(
    machine: Machine, turns: list[Turn], *, device: str = "cpu", substeps: int = 30
) -> NDArray[np.float64]:
    """Key figures, interpolated between samples, of all variants: (turns, figures, N); NaN where a turn failed."""
    count = machine.num_variants
    out = np.empty((len(turns), len(FIGURES), count))
    for i, one in enumerate(turns):
        twin = Twin(count, machine=machine, device=device, substeps=substeps)
        twin.reset(joint_angle=-np.sign(one.signal) * np.asarray(machine.joint.range))
        rest = twin.step({}, STANDSTILL, sample_every=SAMPLING)
        move = twin.step({"steering_signal": one.signal}, one.longest + STANDSTILL, sample_every=SAMPLING)
        assert rest is not None and move is not None
        angle = np.concatenate([rest["joint_angle"], move["joint_angle"]]).astype(np.float64)
        figures = key_figures_batch(SAMPLING * np.arange(len(angle)), angle, machine, interpolate=True)
        out[i] = [figures[name] for name in FIGURES]
        out[i][:, twin.status != 0] = np.nan
    return out
