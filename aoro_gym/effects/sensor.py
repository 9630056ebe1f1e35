"""Effects of the measuring chain: delay, lag and gain of the joint-angle sensor, smoothing of a whole log."""

from __future__ import annotations

import numpy as np

from aoro_gym.effects.effect import ChainEffect, Effect, Magnitude, Operational
from aoro_gym.effects.magnitudes import given
from aoro_gym.effects.signals import delayed, lagged, smoothed

_SECONDS_OF_SENSOR = "E: longer than any of the sensors in question; S34: 0.2 to 5 ms"

EFFECTS: tuple[Effect, ...] = (
    ChainEffect(
        id="sensor_delay",
        component="sensor",
        physics="The joint angle is logged late by a pure delay.",
        sign="+: older",
        magnitudes=(Magnitude("delay", "s", 0.0, 0.05, _SECONDS_OF_SENSOR),),
        operational=(Operational("age of the measured joint angle", "s", given),),
        change=delayed,
    ),
    ChainEffect(
        id="sensor_filter",
        component="sensor",
        physics="The joint-angle sensor has a first-order lag before its sampler.",
        sign="+: slower",
        magnitudes=(Magnitude("time_constant", "s", 0.0, 0.05, _SECONDS_OF_SENSOR),),
        operational=(Operational("time constant of the measured joint angle", "s", given),),
        change=lagged,
    ),
    ChainEffect(
        id="sensor_gain",
        component="sensor",
        physics="The joint-angle sensor reads a wrong multiple of the angle.",
        sign="+: reads too much",
        magnitudes=(Magnitude("error", "1", -0.05, 0.05, "E; S34: linearity of 0.5 %, a wrong scale is worse"),),
        operational=(Operational("measured over true joint angle, less one", "1", given),),
        change=lambda values, rate, error: np.asarray(values) * (1.0 + np.asarray(error)),
    ),
    ChainEffect(
        id="measuring_chain",
        component="sensor",
        physics="The log went through a zero-phase low-pass that nobody mentioned, all signals alike.",
        sign="+: smoother",
        magnitudes=(Magnitude("smoothing", "s", 0.0, 0.05, "P: 7 Hz is 0.023 s; E"),),
        operational=(Operational("1/(2π f) of the frequency f of half gain of a zero-phase low-pass", "s", given),),
        change=smoothed,
        signals=None,
    ),
)
