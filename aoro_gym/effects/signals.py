"""What a measuring chain does to sampled signals: delay, lag, zero-phase smoothing.

Signals are evenly spaced samples of shape (F, N), one column a run, at rest in the first sample; every parameter is one
number or shape (N,), one a run. Zero leaves a column as it is, to the bit.
"""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.fft import irfft, next_fast_len, rfft

from aoro_gym.machine.quantities import Quantity

SMOOTHING_ORDER = 4
"""Order of one pass of the Butterworth low-pass that :func:`smoothed` runs forward and backward."""


def delayed(values: NDArray, rate: float, delay: Quantity) -> NDArray[np.float64]:
    """``values`` (F, N) as they were ``delay`` [s] ago, at ``rate`` [Hz]: straight lines between samples."""
    last = len(values) - 1
    row = np.clip(np.arange(last + 1)[:, None] - np.broadcast_to(delay, values.shape[1]) * rate, 0.0, last)
    whole = row.astype(np.int64)
    run = np.arange(values.shape[1])
    older, newer = values[whole, run], values[np.minimum(whole + 1, last), run]
    return older + (row - whole) * (newer - older)


def lagged(values: NDArray, rate: float, time_constant: Quantity) -> NDArray[np.float64]:
    """``values`` (F, N) behind τ ẏ = u − y, exact for inputs that are straight lines between samples."""
    ratio = np.full(values.shape[1], math.inf)  # of the sampling interval to the time constant
    np.divide(1.0 / rate, time_constant, out=ratio, where=np.greater(time_constant, 0.0))
    decay = np.exp(-ratio)
    lag = (1.0 - decay) / ratio
    from scipy.signal import lfilter  # half a second to import

    out = np.empty(values.shape)
    for run, start in enumerate(values[0].astype(np.float64)):
        weights = [1.0 - lag[run], lag[run] - decay[run]], [1.0, -decay[run]]
        out[:, run] = lfilter(*weights, values[:, run].astype(np.float64), zi=[lag[run] * start])[0]
    return out


def smoothed(values: NDArray, rate: float, smoothing: Quantity) -> NDArray[np.floating]:
    """``values`` (F, N) behind a Butterworth low-pass forward and backward whose gain is one half at 1/(2π ``smoothing``).

    In the frequency domain, so that every run has its own corner: gain 1 / (1 + (tan(πf/rate) / tan(πf½/rate))^(2·order)),
    between odd reflections at both ends; in the precision of the ``values``. A corner at or above half the ``rate`` [Hz]
    leaves the signal as it is.
    """
    count = len(values)
    size: Any = next_fast_len(3 * count - 2, real=True)  # SciPy's transforms have no types
    end = 2.0 * values[-1:] - values[-2::-1]
    filling = np.repeat(end[-1:], size - 3 * count + 2, axis=0)  # as far from the signal as the ends are
    padded = np.concatenate([2.0 * values[:1] - values[:0:-1], values, end, filling])
    corner = np.full(values.shape[1], math.inf)
    np.divide(1.0, 2.0 * math.pi * np.asarray(smoothing), out=corner, where=np.greater(smoothing, 0.0))
    acts = corner < 0.5 * rate
    frequency = np.fft.rfftfreq(size, 1.0 / rate)[:, None]
    edge = np.tan(np.pi * np.where(acts, corner, 0.25 * rate) / rate)
    # the tangent is huge but finite at half the rate, and its high power still a float
    gain = 1.0 / (1.0 + (np.tan(np.pi * frequency / rate) / edge) ** (2 * SMOOTHING_ORDER))
    spectrum: Any = rfft(padded, axis=0, overwrite_x=True)
    spectrum *= gain
    filtered: Any = irfft(spectrum, size, axis=0, overwrite_x=True)[count - 1 : 2 * count - 1]
    return np.where(acts, filtered, values)
