"""Whether a calibrated machine does what the logs say, or no machine of this kind does."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from aoro_gym.calibration.recordings import CHANNELS, EVERY, FilteredLog, whitened

LARGEST_STD = 3.0
"""Standard deviations of noise that are taken as noise. A machine with the twin's own laws leaves 0.1 to 1; beats of the
engine's orders, which half a second of standstill does not show, make up to three times as much."""

DIVERGED_COST = 1e6
"""What is said of a machine whose simulation diverges, in place of infinity."""

LARGEST_SHARE: Mapping[str, float] = {"joint_angle": 0.03}
OTHER_SHARE = 0.5
"""Share of its movement that a twin of the right machine may leave of the joint's angle, and of any other channel. Fitted
to machines of other laws it leaves 0.3 % of the joint's rate, 1 % of a pressure and 6 % of its swing, and before any fit 3 %
and 50 % (``ModelError`` of the diagnosis, from independent plants), which are the bounds. Calibrated to four plants of other
laws, one with a hidden effect, it left 0.2 to 0.3 % of the angle and 2 to 28 % of pressures; one that does something else
leaves about all."""

LEAST_MOVEMENT: Mapping[str, float] = {"joint_angle": 0.02, "engine_speed": 5.0}
LEAST_PRESSURE = 10e5
"""Movement [SI], root mean square, that counts at least: shares of less say nothing of the machine."""


CONTROL_SHARE = 0.01
"""Share of the joint's movement that may be left of its angle for a twin that a controller of the joint is tuned on: of 80°
less than the 1° within which a target of turning counts as reached (E)."""


@dataclass(frozen=True)
class Match:
    """How well one channel is met, over all logs."""

    residual_std: float
    """Root mean square of what parts machine and logs, in standard deviations of the noise."""
    unexplained_share: float
    """The same as a share of the channel's own movement from standstill, less a zero error that its sensor may have."""
    largest_share: float
    """Share that a twin of the right machine may leave."""
    fits: bool


@dataclass(frozen=True)
class Verdict:
    """What a calibration's residuals say."""

    fits: bool
    sentence: str
    residual_std: float
    """Root mean square over all channels, in standard deviations of the noise."""
    channels: dict[str, Match]
    on_a_bound: int
    parameters: int
    fit_for: dict[str, bool]
    """Whether the twin may serve ``control``, ``training`` and ``diagnosis``."""
    serves: str
    """The same in a sentence, with what stands against it."""


def judge(
    repeated: Iterable[tuple[FilteredLog, Mapping[str, NDArray[np.float64]]]], on_a_bound: int, parameters: int
) -> Verdict:
    """The verdict on a machine.

    A channel is met if what is left of it is noise, or no more of its movement than the laws of a twin leave of a machine
    that is built as it says. A machine fits if every channel is met.

    Args:
        repeated: Each recording, and what the machine did under its commands, (F, 1) a channel.
        on_a_bound: How many of its parameters lean on a bound of their range.
        parameters: How many were searched.
    """
    parts: dict[str, list[tuple[NDArray[np.float64], ...]]] = {}
    for recording, found in repeated:
        for name, measured in recording.channels.items():
            miss = (found[name][:, :1] - measured[:, None])[::EVERY]
            residual = whitened(miss, recording.std[name], CHANNELS[name].zero)[:, 0]
            travel = (measured - np.mean(measured[: recording.rest]))[::EVERY]
            parts.setdefault(name, []).append((residual, residual * recording.std[name], travel))
    matches = {name: _match(name, *map(np.concatenate, zip(*each, strict=True))) for name, each in parts.items()}
    total = _rms(np.concatenate([residual for each in parts.values() for residual, _, _ in each]))
    fits = all(match.fits for match in matches.values())
    against = _against(matches)
    serves = "; ".join(f"{use}: {'no, ' + why if why else 'yes'}" for use, why in against.items())
    return Verdict(
        fits, _sentence(fits, total, matches, on_a_bound, parameters), total, matches, on_a_bound, parameters,
        {use: not why for use, why in against.items()}, f"fit for {serves}",
    )  # fmt: skip


def _against(matches: Mapping[str, Match]) -> dict[str, str]:
    """What stands against each use; nothing where it may be.

    Control of the joint needs its angle. A policy meets all that is measured, so training needs every channel within its
    bound. A diagnosis takes whatever is left for a fault, so it needs noise alone, in both ports' pressures, too.
    """
    angle = matches["joint_angle"].unexplained_share
    missed = [name for name, match in matches.items() if not match.fits]
    loud = [f"{_words(n)} by {m.residual_std:.2g}" for n, m in matches.items() if m.residual_std > LARGEST_STD]
    ports = [_words(name) for name in ("pressure_a", "pressure_b") if name not in matches]
    noisy = f"beyond {LARGEST_STD:g} standard deviations of noise: {', '.join(loud)}" if loud else ""
    return {
        "control": f"{100 * angle:.2g} % of the joint's movement are left, where {100 * CONTROL_SHARE:g} % may be"
        if angle > CONTROL_SHARE
        else "",
        "training": f"beyond their bounds: {', '.join(map(_words, missed))}" if missed else "",
        "diagnosis": f"no log of {' and '.join(ports)}" if ports else noisy,
    }


def _words(channel: str) -> str:
    return channel.replace("_", " ")


def _match(name: str, residual: NDArray[np.float64], miss: NDArray[np.float64], travel: NDArray[np.float64]) -> Match:
    std, share = _rms(residual), _rms(miss) / max(_rms(travel), LEAST_MOVEMENT.get(name, LEAST_PRESSURE))
    largest = LARGEST_SHARE.get(name, OTHER_SHARE)
    return Match(std, share, largest, bool(std <= LARGEST_STD or share <= largest))


def _sentence(fits: bool, total: float, matches: Mapping[str, Match], on_a_bound: int, parameters: int) -> str:
    shares = ", ".join(
        f"{_words(name)} {match.unexplained_share:.2g}" + ("" if match.fits else f" > {match.largest_share:g}")
        for name, match in matches.items()
    )
    sentence = (
        f"{'fits' if fits else 'does not fit'}: {total:.3g} standard deviations where 1 is noise; shares of the movement"
        f" left unexplained: {shares}; {on_a_bound} of {parameters} parameters on a bound of their range"
    )
    return sentence if fits else f"{sentence}; no machine of this kind does what the logs say"


def _rms(values: NDArray[np.float64]) -> float:
    """Root mean square; :data:`DIVERGED_COST` where a value is none."""
    found = float(np.sqrt(np.mean(np.square(values))))
    return found if np.isfinite(found) else DIVERGED_COST
