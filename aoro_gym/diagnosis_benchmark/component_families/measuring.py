"""What becomes of a command before the valve and of signals before the log: delays, filters, gains, noise. SI units.

Signals lie on a grid of 1 ms and hold their first value before it.
"""

import math
from collections.abc import Callable, Mapping

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from scipy.signal import lfilter
from scipy.special import erf

from . import vehicle

Floats = np.ndarray
Made = Mapping[str, float]

GRID = 1e-3
"""Step of the fine grid [s]."""
ORDERS = {
    "elm": ((1.0, 1.0), (4.0, 0.5)),
    "fir": ((0.5, 0.7), (2.0, 1.0), (4.32, 0.6)),
    "hazel": ((1.0, 0.5), (3.985, 1.0), (6.0, 0.4)),
    "maple": ((0.5, 0.5), (2.0, 0.6), (3.0, 0.8)),
    "oak": ((1.5, 0.4), (2.0, 0.9), (5.0, 0.5)),
    "larch": ((1.0, 0.3), (3.0, 1.0), (4.0, 0.4)),
    "aspen": ((1.0, 0.7), (2.0, 0.8), (6.0, 0.3)),
    "pine": ((0.5, 0.3), (2.0, 0.5), (4.5, 0.5)),
    "yew": ((0.5, 0.9), (1.0, 0.8), (2.0, 1.2), (4.0, 0.5)),
}
"""Engine orders on the joint angle by the family of its sensor, and their share of :data:`WAVE`."""
WAVE = 3e-4
"""Amplitude of an engine order on the joint angle [rad] (E)."""
SPEED_STEP = {"elm": 0.013, "fir": 0.026, "hazel": 0.052, "maple": 0.1, "oak": 0.02, "larch": 0.0065,
              "aspen": 0.08, "pine": 0.01, "yew": 0.13}  # fmt: skip
"""Resolution of the engine's speed [rad/s] by the family of the chain."""
SCAN = (2, 3, 4, 5, 0, 1, 6)
"""How many channels a multiplexer samples after each of joint angle, pressures a, b, pump, drive and engine speed."""


def delayed(values: Floats, delay: float) -> Floats:
    """Values (K,) a ``delay`` [s] later, between samples by straight lines."""
    times = np.arange(len(values)) * GRID
    return np.interp(times - delay, times, values)


def averaged(values: Floats, window: float) -> Floats:
    """Mean (K,) over the last ``window`` [s]."""
    times = np.arange(len(values)) * GRID
    area = np.concatenate([[0.0], np.cumsum(0.5 * (values[1:] + values[:-1]) * GRID)])
    before = np.interp(times - window, times, area)
    before = before + values[0] * np.minimum(times - window, 0.0)
    return (area - before) / window


def lagged(values: Floats, lag: float) -> Floats:
    """Values (K,) behind a low-pass of first order, exact for straight lines between samples."""
    pole = math.exp(-GRID / lag)
    new = 1.0 - (1.0 - pole) * lag / GRID
    old = (1.0 - pole) * lag / GRID - pole
    return lfilter([new, old], [1.0, -pole], values - values[0]) + values[0]


def butterworth(values: Floats, lag: float) -> Floats:
    """Values (K,) behind a Butterworth low-pass of second order with √2/ω = ``lag`` [s]; bilinear."""
    w = math.sqrt(2.0) / lag
    k = 2.0 / GRID
    a = (k * k + math.sqrt(2.0) * w * k + w * w, 2 * (w * w - k * k), k * k - math.sqrt(2.0) * w * k + w * w)
    b = w * w * np.array([1.0, 2.0, 1.0])
    return lfilter(b, a, values - values[0]) + values[0]


def ladder(values: Floats, lag: float) -> Floats:
    """Values (K,) behind two resistors and capacitors in a row, each RC = ``lag`` [s]: 1/(1 + 3 RC s + (RC s)²)."""
    slow = 0.5 * (3.0 + math.sqrt(5.0)) * lag
    return lagged(lagged(values, slow), lag * lag / slow)


def bessel(values: Floats, lag: float) -> Floats:
    """Values (K,) behind a Bessel low-pass of second order, 3/((s T)² + 3 s T + 3), of delay T = ``lag`` [s]; bilinear."""
    k = 2.0 / GRID * lag
    a = (k * k + 3.0 * k + 3.0, 6.0 - 2.0 * k * k, k * k - 3.0 * k + 3.0)
    return lfilter([3.0, 6.0, 3.0], a, values - values[0]) + values[0]


def decimated(values: Floats, length: float) -> Floats:
    """Values (K,) behind a decimator of three moving means in a row (Hogenauer 1981), together ``length`` [s] long.

    Each is exact for straight lines between samples.
    """
    window = length / 3.0
    cells = (np.arange(len(values)) * GRID - window) / GRID
    low = np.floor(np.maximum(cells, 0.0)).astype(int)
    share = np.maximum(cells, 0.0) - low
    for _ in range(3):
        area = np.concatenate([[0.0], np.cumsum(0.5 * (values[1:] + values[:-1]) * GRID)])
        first, last = values[low], values[np.minimum(low + 1, len(values) - 1)]
        before = area[low] + GRID * share * (first + 0.5 * share * (last - first))
        values = (area - before - values[0] * np.minimum(cells, 0.0) * GRID) / window
    return values


def rounded(values: Floats, cycle: float) -> Floats:
    """Values (K,) whose times are rounded to multiples of a ``cycle`` [s]."""
    times = np.arange(len(values)) * GRID
    return np.interp(np.floor(times / cycle + 0.5) * cycle, times, values)


def queued(values: Floats, wait: float) -> Floats:
    """Values (K,) out of a queue whose waits lie evenly between a half and one and a half of ``wait`` [s]: their mean."""
    return averaged(delayed(values, 0.5 * wait), wait)


def cycled(values: Floats, cycle: float, lag: float) -> Floats:
    """Values (K,) of an exponential filter that a control unit computes every ``cycle`` [s], held between; ``lag`` [s]."""
    times = np.arange(len(values)) * GRID
    taken = np.interp(np.arange(math.floor(times[-1] / cycle + 1e-9) + 1) * cycle, times, values)
    pole = math.exp(-cycle / lag)
    smooth = lfilter([1.0 - pole], [1.0, -pole], taken - taken[0]) + taken[0]
    return smooth[np.floor(times / cycle + 1e-9).astype(int)]


def held(values: Floats, period: float) -> Floats:
    """Values (K,) sampled every ``period`` [s] and held."""
    times = np.arange(len(values)) * GRID
    return np.interp(np.floor(times / period + 1e-9) * period, times, values)


def updated(values: Floats, period: float) -> Floats:
    """Values (K,) sampled every ``period`` [s], joined by straight lines that end when the next sample is there."""
    times = np.arange(len(values)) * GRID
    cells = times / period
    low = np.floor(cells + 1e-9)
    share = cells - low
    first, last = (np.interp((low + shift) * period, times, values) for shift in (-1, 0))
    return (1.0 - share) * first + share * last


def convolved(values: Floats, length: float, twice: Callable[[Floats], Floats]) -> Floats:
    """Values (K,) behind a kernel, exact for straight lines between samples.

    Args:
        values: Samples (K,).
        length: Of the kernel [s].
        twice: Its second integral over time [s].
    """
    times = np.arange(-1, math.ceil(length / GRID) + 2) * GRID
    return lfilter(np.diff(twice(times), 2) / GRID, [1.0], values - values[0]) + values[0]


def tent(values: Floats, window: float) -> Floats:
    """Values (K,) behind a triangular kernel (Bartlett 1950), twice a ``window`` [s] long: two moving means in a row."""

    def twice(times: Floats) -> Floats:
        cubes = [np.maximum(times - shift * window, 0.0) ** 3 for shift in (0, 1, 2)]
        return (cubes[0] - 2.0 * cubes[1] + cubes[2]) / (6.0 * window**2)

    return convolved(values, 2.0 * window, twice)


def hann(values: Floats, length: float) -> Floats:
    """Values (K,) behind a kernel of a raised cosine (Blackman, Tukey 1958), ``length`` [s] long."""

    def twice(times: Floats) -> Floats:
        inside = np.clip(times, 0.0, length)
        wave = length / (4 * math.pi**2) * (np.cos(2 * math.pi * inside / length) - 1.0)
        return inside**2 / (2 * length) + wave + np.maximum(times - length, 0.0)

    return convolved(values, length, twice)


def third(values: Floats, lag: float) -> Floats:
    """Values (K,) behind a Butterworth low-pass of third order with 2/ω = ``lag`` [s]; its pair of poles bilinear."""
    once = lagged(values, 0.5 * lag)
    w, k = 2.0 / lag, 2.0 / GRID
    a = (k * k + w * k + w * w, 2.0 * (w * w - k * k), k * k - w * k + w * w)
    return lfilter(w * w * np.array([1.0, 2.0, 1.0]), a, once - once[0]) + once[0]


def pulsed(values: Floats, period: float) -> Floats:
    """Values (K,) whose mean over each pulse ``period`` [s] sets the width of the next pulse: what a driver's current
    follows (Holmes, Lipo: Pulse Width Modulation, 2003, regularly sampled)."""
    return held(averaged(values, period), period)


def middle(values: Floats, window: float) -> Floats:
    """Median (K,) of the last ``window`` [s] (Tukey 1977)."""
    half = math.floor(0.5 * window / GRID + 1e-9)
    padded = np.concatenate([np.full(2 * half, values[0]), values])
    return delayed(np.median(sliding_window_view(padded, 2 * half + 1), axis=1), 0.5 * window - half * GRID)


def beating(values: Floats, delay: float) -> Floats:
    """Values (K,) late by a ``delay`` [s] that climbs from a half to one and a half and falls back: of two clocks that run
    apart by a cycle in 0.23 s."""
    times = np.arange(len(values)) * GRID
    return np.interp(times - delay * (0.5 + times / 0.23 % 1.0), times, values)


def twinned(values: Floats, delay: float) -> Floats:
    """Mean (K,) of two redundant sensors, of which one is late by twice the ``delay`` [s]."""
    return 0.5 * (values + delayed(values, 2.0 * delay))


def packed(values: Floats, wait: float) -> Floats:
    """Values (K,) in packets of 10 ms, each with a wait of its own between a half and one and a half of ``wait`` [s], spread
    evenly by the golden ratio (Weyl 1916)."""
    times = np.arange(len(values)) * GRID
    number = np.floor(times / 0.01 + 1e-9)
    return np.interp(times - wait * (0.5 + number * 0.5 * (math.sqrt(5.0) - 1.0) % 1.0), times, values)


def by_rod(angle: Floats, m: Made) -> Floats:
    """Joint angle (K,) out of the stroke of the right cylinder, as a magnetostrictive rod reads it.

    Its speed of sound is wrong by ``rod_error``, so strokes from the middle are too large by as much.
    """
    table = np.linspace(-1.05, 1.05, 4201)
    shape = vehicle.geometry(m)

    def stroke(at: Floats) -> Floats:
        turned = shape["mount_across"] * np.cos(at) - shape["mount_along"] * np.sin(at)
        return np.sqrt(shape["mount_squares"] - 2.0 * turned)

    straight = float(stroke(np.zeros(1))[0])
    return np.interp((1.0 + m["rod_error"]) * (stroke(angle) - straight), stroke(table) - straight, table)


def by_slide(angle: Floats, m: Made) -> Floats:
    """Joint angle (K,) by a slide that a pin pushes along a tangent: a share ``slide_error`` of it is not straightened."""
    return angle + m["slide_error"] * (np.tan(angle) - angle)


def by_track(angle: Floats, m: Made) -> Floats:
    """Joint angle (K,) by a resistive track that is worn about its middle, 0.25 rad wide, where a radian has more ohms."""
    return angle + m["track_wear"] * 0.125 * math.sqrt(math.pi) * erf(angle / 0.25)


def command(family: str, values: Floats, m: Made) -> Floats:
    """Command (K,) as it leaves the bus or the driver of a family; pure delays act in the integrator."""
    if family == "fir":
        return held(values, m["bus_cycle"])
    if family == "hazel":
        return averaged(values, m["driver_window"])
    if family == "maple":
        return lagged(lagged(lagged(values, m["remote_lag"]), m["remote_lag"]), m["remote_lag"])
    if family == "oak":
        return bessel(values, m["input_lag"])
    if family == "larch":
        return cycled(values, m["filter_cycle"], m["filter_lag"])
    if family == "aspen":
        return pulsed(values, m["pulse_period"])
    if family == "pine":
        return third(values, m["third_lag"])
    if family == "yew":
        return middle(values, m["median_window"])
    return values


def _angle(family: str, angle: Floats, m: Made) -> Floats:
    """Joint angle (K,) as the sensor of a family gives it."""
    if family == "elm":
        return m["angle_gain"] * lagged(delayed(angle, m["angle_delay"]), m["angle_lag"])
    if family == "fir":
        bent = m["angle_gain"] * angle * (1.0 + m["loading"] * (angle / m["stop_angle"]) ** 2)
        return held(butterworth(bent, m["angle_lag"]), m["sample_hold"])
    if family == "maple":
        rails = m["angle_gain"] * angle * (1.0 + m["rail_error"] * (1.0 + 0.2 * np.sign(angle)))
        return delayed(held(ladder(rails, m["angle_ladder"]), m["poll_period"]), m["bus_queue"])
    if family == "oak":
        bent = m["angle_gain"] * np.arctan2((1.0 + m["imbalance"]) * np.sin(angle), np.cos(angle))
        return rounded(delayed(bessel(bent, m["angle_lag"]), m["angle_delay"]), m["stamp_cycle"])
    if family == "larch":
        bent = m["angle_gain"] * np.arcsin(np.clip((1.0 + m["linkage"]) * np.sin(angle), -1.0, 1.0))
        return queued(lagged(lagged(bent, m["damper_lag"]), m["damper_lag"]), m["queue_time"])
    if family == "aspen":
        return beating(tent(m["angle_gain"] * by_rod(angle, m), m["tent_window"]), m["beat_delay"])
    if family == "pine":
        cube = m["angle_gain"] * by_slide(angle, m)
        for _ in range(3):
            cube = lagged(cube, m["angle_cube"])
        return twinned(cube, m["twin_delay"])
    if family == "yew":
        return packed(hann(m["angle_gain"] * by_track(angle, m), m["hann_window"]), m["packet_wait"])
    bent = m["angle_gain"] * angle + m["eccentricity"] * np.sin(angle)
    return updated(averaged(bent, m["angle_window"]), m["update_period"])


def _chain(family: str, values: Floats, m: Made, place: int) -> Floats:
    """A channel (K,) through the logger's chain of a family, by its place in the log."""
    if family == "elm":
        return averaged(values, m["chain_window"])
    if family == "fir":
        return delayed(values, m["chain_delay"])
    if family == "maple":
        return delayed(lagged(values, m["chain_lag"]), SCAN[place] * m["dwell"])
    if family == "oak":
        return decimated(values, m["decimation"])
    if family == "larch":
        return updated(values, m["resample_period"])
    if family == "aspen":
        return butterworth(values, m["chain_lag"])
    if family == "pine":
        return hann(values, m["raised_window"])
    if family == "yew":
        return lagged(lagged(values, m["chain_lag"]), m["chain_lag"])
    return lagged(values, m["chain_lag"])


def measured(
    parts: Mapping[str, str], fine: Floats, times: Floats, m: Made, rng: np.random.Generator, noise: bool
) -> dict[str, Floats]:
    """Columns of a log.

    Args:
        parts: Families of the machine's ``angle`` sensor and ``chain``.
        fine: Joint angle [rad], pressures a, b, pump, drive forward and return [Pa], engine speed [rad/s], (K, 7) on the
            fine grid.
        times: Of the samples [s].
        m: Constants of the machine.
        rng: For phases and noise.
        noise: False leaves out engine orders, noise and quantisation.
    """
    grid = np.arange(len(fine)) * GRID
    angle = _angle(parts["angle"], fine[:, 0], m) + m["angle_offset"]
    channels = [_chain(parts["chain"], one, m, place) for place, one in enumerate((angle, *fine[:, 1:].T))]
    angle, *others = (np.interp(times, grid, one) for one in channels)
    for place, port in enumerate(("a", "b", "pump")):
        others[place] = others[place] + m[f"pressure_offset_{port}"]
    if noise:
        for order, share in ORDERS[parts["angle"]]:
            angle = angle + WAVE * share * np.sin(order * m["engine_speed"] * times + rng.uniform(0.0, 2 * math.pi))
        angle = angle + m["angle_noise"] * rng.standard_normal(len(times))
        angle = np.round(angle / m["angle_step"]) * m["angle_step"]
        for place in range(5):
            others[place] = others[place] + m["pressure_noise"] * rng.standard_normal(len(times))
        step = SPEED_STEP[parts["chain"]]
        others[5] = np.round(others[5] / step) * step
    names = ("pressure_a", "pressure_b", "pump_pressure", "drive_forward", "drive_return", "engine_speed")
    return {"joint_angle": angle, **dict(zip(names, others, strict=True))}
