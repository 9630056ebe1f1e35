"""Features of what changed between two logs: the slow course of every channel, from shortly before the command.

A channel's mean under a raised cosine of 0.8 s has the bandwidth of a Gaussian of 0.15 s: it passes what an effect does to
a turn and stops the sway of the joint on its oil (about 6 Hz), which other laws shape otherwise. Means every 0.4 s, at
most :data:`MOST` a log, hold what that window passes.

At its stop the joint stands and the pump runs into its limit: pressures are read before a log's own arrival only, and a
mean that has lost half of its window there, in either log, compares nothing (difference 0). Joint angles are read to the
end, so a later arrival shows.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.floating[Any]]

CHANNELS = ("joint_angle", "pressure_a", "pressure_b", "pump_pressure")
CHANNEL_SETS: Mapping[str, tuple[int, ...]] = {"pressures": (0, 1, 2, 3), "ports": (0, 1, 2), "angle": (0,)}
"""Places of the channels in :data:`CHANNELS` by channel set."""

PERIOD = 0.01
"""[s] between samples."""
WINDOW, SPACING = 0.8, 0.4
"""[s] length of a raised cosine, and least distance between two."""
MOST = 9
"""Means of a log and channel."""
LEAST = 0.5
"""Share of its window that a mean of pressures must have before the arrival."""
AT_STOP = 0.62
"""[rad] from which a joint that stands counts as being at its stop; stops lie at 0.69 to 0.71 rad."""
NEAR, BEFORE = 0.02, 0.1
"""Angle [rad] and time [s] before the arrival from which pressures are not read."""


@dataclass(frozen=True)
class Means:
    """Means of logs of one manoeuvre.

    Attributes:
        values: (..., channels, means), SI.
        share: Of its window that a mean of pressures has before the arrival, (..., means).
    """

    values: Floats
    share: Floats

    def __getitem__(self, index: object) -> Means:
        return Means(self.values[index], self.share[index])  # pyright: ignore[reportArgumentType, reportCallIssue]


def windows(steering: Floats, drive: Floats | None = None) -> Floats:
    """Weights (means, samples) for logs under a command (samples,): a rest, then a mean every 0.4 s or longer until shortly
    after the command has ended; each row sums to 1."""
    active = np.flatnonzero(steering if drive is None else np.abs(steering) + np.abs(drive))
    if not len(active):
        raise ValueError("the command is nought throughout, but must move the machine")
    first, last = active[0] * PERIOD, (active[-1] + 1) * PERIOD
    span = last - first + SPACING / 2
    count = min(MOST - 1, max(1, int(span / SPACING)))
    centres = np.concatenate([[first - WINDOW / 2], first + SPACING / 2 + span * np.arange(count) / count])
    away = np.abs(PERIOD * np.arange(len(steering)) - centres[:, None])
    weights = np.where(away < WINDOW / 2, 1.0 + np.cos(2.0 * np.pi * away / WINDOW), 0.0)
    if not np.all(weights.sum(axis=1) > 0.0):
        raise ValueError(f"the log needs a rest of {WINDOW / 2:g} s before its command")
    return weights / weights.sum(axis=1, keepdims=True)


def before_arrival(angle: Floats) -> NDArray[np.bool_]:
    """Whether a sample (..., samples) of the joint angle [rad] lies before the arrival at a stop."""
    final = np.median(angle[..., -30:], axis=-1, keepdims=True)
    near = (np.abs(angle - final) < NEAR) & (np.abs(final) > AT_STOP)
    arrived = np.where(near.any(axis=-1), near.argmax(axis=-1), angle.shape[-1] + round(BEFORE / PERIOD))
    return np.arange(angle.shape[-1]) < arrived[..., None] - round(BEFORE / PERIOD)


def means(logs: Sequence[Mapping[str, Floats]], weights: Floats) -> Means:
    """Means of logs with the columns :data:`CHANNELS`, each (samples,), under :func:`windows`."""
    samples = weights.shape[1]
    values = np.stack([[log[channel][:samples] for channel in CHANNELS] for log in logs])
    moving = before_arrival(values[:, 0])
    share = moving @ weights.T
    cut = np.einsum("ncs,ns,ms->ncm", values[:, 1:], moving, weights, optimize=True)
    pressures = cut / np.maximum(share, 1e-9)[:, None]
    return Means(np.concatenate([(values[:, 0] @ weights.T)[:, None], pressures], axis=1), share)


def paired(later: Means, healthy: Means) -> Floats:
    """Differences (..., channels, means) of two logs of one manoeuvre."""
    difference = later.values - healthy.values
    compared = np.minimum(later.share, healthy.share)[..., None, :] >= LEAST
    difference[..., 1:, :] *= compared
    return difference


def features(differences: Sequence[Floats], channels: Sequence[int]) -> Floats:
    """Features (..., features) of the differences of some manoeuvres, of these channels."""
    chosen = [one[..., list(channels), :] for one in differences]
    return np.concatenate([one.reshape(*one.shape[:-2], -1) for one in chosen], axis=-1)
