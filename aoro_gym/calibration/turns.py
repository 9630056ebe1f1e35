"""Full turns of a population of machines: every machine turns at every level, one launch a level."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from aoro_gym.machine import Machine
from aoro_gym.simulation.key_figures import FIGURES, SWING, key_figures_batch, steady_swing_batch
from aoro_gym.twin import Twin
from aoro_gym.validation.turns import Turn

STANDSTILL = 0.6
"""Rest [s] before the signal, and after the slowest turn: the filter needs half a second on both sides."""

SAMPLING = 0.01
"""Sampling interval [s] of the joint angle sensor."""

PATIENCE = 1.4
"""A turn that takes this many times as long as the published machine's counts as failed."""

CHUNK = 1.0
"""Simulated time [s] after which it is told how far the turns are."""

_SIGNAL_PERCENT = (50.0, 75.0, 100.0)
_EXPECTED = {"left": (6.9, 2.6, 2.0), "right": (11.2, 3.3, 2.2)}  # [s] of the published machine, at least


def longest(turn: Turn) -> float:
    """Time [s] that a turn is given."""
    return round(PATIENCE * float(np.interp(turn.signal_percent, _SIGNAL_PERCENT, _EXPECTED[turn.direction])), 1)


def population_figures(
    machine: Machine,
    turns: Sequence[Turn],
    *,
    device: str = "cpu",
    substeps: int = 30,
    swing: bool = False,
    progress: Callable[[float], None] = lambda machines: None,
) -> NDArray[np.float64]:
    """Key figures, interpolated between samples, of all variants: (turns, figures, N); NaN where a turn failed.

    Args:
        machine: N variants.
        turns: What each of them does.
        device: Where the twins run.
        substeps: Hydraulic substeps a main step.
        swing: Whether those of :data:`~aoro_gym.simulation.key_figures.SWING` follow the others.
        progress: Called with the number of machines, whole and parts, that have done all turns since the last call.
    """
    count = machine.num_variants
    names = (*FIGURES, *SWING) if swing else FIGURES
    out = np.empty((len(turns), len(names), count))
    whole = sum(STANDSTILL + round(longest(turn) + STANDSTILL, 2) for turn in turns)
    for i, turn in enumerate(turns):
        twin = Twin(count, machine=machine, device=device, substeps=substeps, check_step=False)
        twin.reset(joint_angle=-turn.sign * np.asarray(machine.joint.range))
        signal = turn.sign * turn.signal_percent / 100.0
        parts = []
        for commands, duration in (({}, STANDSTILL), ({"steering_signal": signal}, longest(turn) + STANDSTILL)):
            left = round(duration, 2)
            while left > 0.0:
                trace = twin.step(commands, min(left, CHUNK), sample_every=SAMPLING)
                assert trace is not None
                parts.append(trace["joint_angle"])
                progress(min(left, CHUNK) / whole * count)
                left = round(left - CHUNK, 2)
        angle = np.concatenate(parts).astype(np.float64)
        time = SAMPLING * np.arange(len(angle))
        figures = key_figures_batch(time, angle, machine, interpolate=True)
        if swing:
            figures |= steady_swing_batch(time, angle, machine)
        out[i] = [figures[name] for name in names]
        out[i][:, twin.status != 0] = np.nan
    return out
