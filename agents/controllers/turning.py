"""Reference controllers for ``AORO/Turning-v0``, and the protocol that they share with learned policies.

A controller sees what a policy sees, the observation, and nothing of the twin. Its gains are numbers, or arrays of
shape (N,) that give every sub-environment its own. The defaults come from :mod:`aoro_gym.agents.training.tuning`;
BangBang keeps those of an earlier machine, as what is tuned on today's ``aoro`` alone settles on few others: in 19 % of 350
episodes on perturbed ones.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from aoro_gym.agents.policies.policy import Actions, Observations


@dataclass(frozen=True)
class BangBang:
    """Full signal toward the target until the joint would coast into it, then none.

    u = ±1 if |e − T ω| > ``threshold`` and 0 else, with the error e, the measured rate ω and the time T =
    ``lead_time`` that stands for delay, spool and oil column: the way in which the real machine is steered at full speed.

    Raises ValueError if the observation lacks a term that the controller needs.
    """

    layout: Mapping[str, slice]
    """``env.unwrapped.observation_layout``"""
    threshold: ArrayLike = 0.0316
    """[rad]"""
    lead_time: ArrayLike = 0.0249
    """[s]"""

    def __post_init__(self) -> None:
        require_terms(self.layout, "error", "joint_rate")

    def __call__(self, observations: Observations) -> Actions:
        left = _predicted_error(self.layout, observations, self.lead_time)
        return _actions(np.where(np.abs(left) > self.threshold, np.sign(left), 0.0))

    def reset(self, mask: NDArray[np.bool_] | None = None) -> None:
        """Nothing to forget."""


@dataclass(frozen=True)
class ProportionalDerivative:
    """Signal in proportion to the error that will be left, lifted over the valve's dead band.

    v = K (e − T ω); u = sign(v) (d + (1 − d) |v|) with the dead band d of the side, and 0 where |e − T ω| is within
    ``rest_error``. T brakes before the target as a derivative term does.

    Raises ValueError if the observation lacks a term that the controller needs.
    """

    layout: Mapping[str, slice]
    """``env.unwrapped.observation_layout``"""
    gain: ArrayLike = 7.08
    """K: signal per error [1/rad]."""
    lead_time: ArrayLike = 0.00989
    """T [s]"""
    dead_band_left: ArrayLike = 0.0986
    """Signal [-] that is skipped to the left; the machine's own dead band is ``steering.valve.dead_band_left`` / 2 V."""
    dead_band_right: ArrayLike = 0.193
    """The same to the right."""
    rest_error: ArrayLike = 0.0037
    """[rad]"""

    def __post_init__(self) -> None:
        require_terms(self.layout, "error", "joint_rate")

    def __call__(self, observations: Observations) -> Actions:
        left = _predicted_error(self.layout, observations, self.lead_time)
        signal = dead_band_compensated(np.asarray(self.gain) * left, self.dead_band_left, self.dead_band_right)
        return _actions(np.where(np.abs(left) > self.rest_error, signal, 0.0))

    def reset(self, mask: NDArray[np.bool_] | None = None) -> None:
        """Nothing to forget."""


def dead_band_compensated(demand: NDArray[Any], dead_band_left: ArrayLike, dead_band_right: ArrayLike) -> NDArray[Any]:
    """Signal (N,) for a demand (N,), clipped at ±1: what is not 0 is lifted over the dead band of its side."""
    demand = np.clip(demand, -1.0, 1.0)
    skipped = np.where(demand > 0.0, dead_band_left, dead_band_right)
    return np.sign(demand) * (skipped + (1.0 - skipped) * np.abs(demand))


def _predicted_error(layout: Mapping[str, slice], observations: Observations, lead_time: ArrayLike) -> NDArray[Any]:
    """Error [rad] (N,) after ``lead_time`` [s] at the present rate."""
    error = np.asarray(observations)[:, layout["error"]][:, 0]
    rate = np.asarray(observations)[:, layout["joint_rate"]][:, 0]
    return error - np.asarray(lead_time) * rate


def _actions(signal: NDArray[Any]) -> Actions:
    return signal.astype(np.float32)[:, None]


def require_terms(layout: Mapping[str, slice], *names: str) -> None:
    """Raises ValueError that says which of the observation terms ``names`` is missing."""
    for name in names:
        if name not in layout:
            raise ValueError(
                f"the controller needs the observation term {name!r}, but the environment observes {', '.join(layout)}; do "
                "not leave it out in observation_terms"
            )
