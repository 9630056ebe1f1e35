"""What sensors and loggers make of exact signals, on the device, drawn anew for every batch.

In this order: what no simulated law has (random filters across channels, the same on all days of a machine), deviations of
signals that the catalogue lacks, the angle's gain, lag and delay, the clock, noise, quantisers, smoothing. Delay, lag
and smoothing act in the frequency domain on the differences between samples, which begin and end at rest.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import torch
from torch import Tensor

from aoro_gym.diagnosis.simulation import outsiders
from aoro_gym.diagnosis.simulation.logs import UNITS
from aoro_gym.diagnosis.simulation.manoeuvres import TICK
from aoro_gym.diagnosis.simulation.prior import SensorPrior
from aoro_gym.effects.signals import SMOOTHING_ORDER

LINES = ((5.3, 6.9, 1.0), (5.3, 6.9, 1.0), (5.3, 6.9, 1.0), (5.3, 6.9, 1.0), (14.0, 16.0, 0.4), (26.0, 33.5, 0.2))
"""Bands [Hz] of the angle's spectral lines, and their heights in units of :data:`LINE`."""
MIXED, MIXED_TIME = (0.03, 0.4), 0.6
"""Size of mixed signals as a share of each channel's range, and their longest time constant [s] (E)."""
WAVES = 5
"""Of a wandering signal."""
LINE = 1e-3
"""[rad] of the published lines near 6 Hz."""


class Draw:
    """Random numbers on the device."""

    def __init__(self, generator: torch.Generator):
        self.generator = generator
        self.device = generator.device

    def even(self, low: float, high: float, *shape: int) -> Tensor:
        return low + (high - low) * torch.rand(shape, generator=self.generator, device=self.device)

    def log_even(self, ends: tuple[float, float], *shape: int) -> Tensor:
        return torch.exp(self.even(math.log(ends[0]), math.log(ends[1]), *shape))

    def normal(self, *shape: int) -> Tensor:
        return torch.randn(shape, generator=self.generator, device=self.device)

    def one_of(self, count: int, *shape: int) -> Tensor:
        return torch.randint(count, shape, generator=self.generator, device=self.device)


def sensed(samples: Tensor, chain: Tensor, outsider: Tensor, prior: SensorPrior, draw: Draw) -> Tensor:
    """Signals [SI] (B, D, J, channels, T) as loggers have them.

    Args:
        samples: Exact ones, int16 in :data:`UNITS`, (B, D, J, channels, T): B machines, D days, J manoeuvres.
        chain: Magnitudes of delay, lag, gain error and smoothing (B, D, 4).
        outsider: Number of a deviation that the catalogue lacks (B, D), −1 for none.
        prior: What sensors add.
        draw: Random numbers.
    """
    unit = torch.tensor(UNITS, device=samples.device)[:, None]
    values = samples.to(torch.float32) * unit
    values = with_law_error(values, prior, draw)
    values = _with_deviations(values, outsider - outsiders.ALL.index(outsiders.SIGNAL[0]), draw)
    batch, days, each = values.shape[:3]
    clock = draw.even(-prior.clock, prior.clock, batch, days, each, 1)
    delay = draw.even(0.0, prior.delay, batch, 1) + chain[..., 0]
    lag = draw.even(0.0, prior.lag, batch, 1) + chain[..., 1]
    angle = torch.zeros(values.shape[3], device=values.device)
    angle[0] = 1.0
    gain = 1.0 + prior.pressure_gain * draw.normal(batch, days, 1, values.shape[3], 1) * (1.0 - angle)[:, None]
    gain = gain + (chain[..., 2][..., None, None, None] * angle[:, None])
    smoothing, late, lagging = _forms_of_chain(chain[..., 3], prior, draw)
    values = gain * _filtered(
        values, clock + late + delay[..., None, None] * angle, lag[..., None, None] * angle, lagging
    )
    values = _noisy(values, prior, draw)
    smooth = draw.even(0.0, prior.smoothing, batch, 1) * (draw.even(0.0, 1.0, batch, 1) < prior.smooth)
    return _smoothed(values, torch.maximum(smooth.expand(batch, days), smoothing))


def _forms_of_chain(time: Tensor, prior: SensorPrior, draw: Draw) -> tuple[Tensor, Tensor, Tensor]:
    """Smoothing (B, D), delay and lag (B, D, 1, 1) [s] of whole logs, of which each has its ``time`` (B, D) in one form."""
    at, ends = draw.even(0.0, 1.0, *time.shape), np.cumsum(prior.chain_forms)
    smoothing, lag = time * (at < ends[0]), time * ((at >= ends[0]) & (at < ends[1]))
    late = time - smoothing - lag
    return smoothing, late[..., None, None], lag[..., None, None]


def _spectrum(values: Tensor) -> tuple[Tensor, Tensor, int]:
    """Transform of the differences between samples, its frequencies [Hz], and its length."""
    size = 2 * values.shape[-1]
    steps = torch.diff(values, dim=-1)
    return torch.fft.rfft(steps, n=size), torch.fft.rfftfreq(size, TICK, device=values.device), size


def _from_steps(spectrum: Tensor, size: int, first: Tensor) -> Tensor:
    """Signals whose differences have a ``spectrum``, from their ``first`` samples (..., 1) on."""
    count = size // 2
    steps = torch.fft.irfft(spectrum, n=size)
    early = steps[..., -count // 2 :].sum(
        dim=-1, keepdim=True
    )  # what a filter without phase shows before the beginning
    return torch.cat([first + early, first + early + torch.cumsum(steps[..., : count - 1], dim=-1)], dim=-1)


def _filtered(values: Tensor, delay: Tensor, *lags: Tensor) -> Tensor:
    """``values`` (..., T) behind delays and first-order lags [s] (...)."""
    spectrum, frequency, size = _spectrum(values)
    omega = 2.0 * math.pi * frequency
    response = torch.exp(-1j * omega * delay[..., None])
    for lag in lags:
        response = response / (1.0 + 1j * omega * lag[..., None])
    return _from_steps(spectrum * response, size, values[..., :1])


def _smoothed(values: Tensor, smoothing: Tensor) -> Tensor:
    """``values`` (B, D, J, C, T) behind a low-pass without phase, half its gain at 1/(2π ``smoothing``) Hz (B, D)."""
    spectrum, frequency, size = _spectrum(values)
    rate = 1.0 / TICK
    corner = 1.0 / (2.0 * math.pi * smoothing.clamp(min=1e-4))
    acts = corner < 0.49 * rate
    edge = torch.tan(math.pi * torch.where(acts, corner, 0.25 * rate) / rate)
    ratio = torch.tan(math.pi * frequency.clamp(max=0.499 * rate) / rate) / edge[..., None]
    gain = torch.where(acts[..., None], 1.0 / (1.0 + ratio ** (2 * SMOOTHING_ORDER)), torch.ones_like(ratio))
    return _from_steps(spectrum * gain[:, :, None, None], size, values[..., :1])


def with_law_error(values: Tensor, prior: SensorPrior, draw: Draw) -> Tensor:
    """Adds what laws that were not simulated might do, to all days alike and to what parts the others from the first."""
    values = values + _mix(values, prior.law_error, prior.law_error_time, draw)
    if values.shape[1] == 1:
        return values
    error = _mix(values[:, 1:] - values[:, :1], prior.change_error, prior.law_error_time, draw)
    return torch.cat([values[:, :1], values[:, 1:] + error], dim=1)


def _mix(values: Tensor, ends: tuple[float, float], longest: float, draw: Draw) -> Tensor:
    """A filtered, mildly nonlinear mix of all channels of ``values`` (B, D, J, C, T), one filter a machine.

    Its size is a share of each channel's range, logarithmically even between ``ends``, and its time constants reach to
    ``longest`` [s].
    """
    batch, _, _, channels, _ = values.shape
    size = draw.log_even(ends, batch, 1, 1, 1, 1)
    start = values[..., :1]
    span = (values - start).abs().amax(dim=(1, 2, 4), keepdim=True).clamp(min=1e-3)
    shape = (values - start) / span
    bend = draw.even(0.0, 1.0, batch, 1, 1, channels, 1)
    shape = (1.0 - bend) * shape + bend * torch.tanh(3.0 * shape)
    weight = draw.normal(batch, channels, channels) / math.sqrt(channels)
    mixed = torch.einsum("bck,bdjkt->bdjct", weight, shape)
    spectrum, frequency, count = _spectrum(mixed)
    omega = 2.0 * math.pi * frequency
    lag = draw.log_even((0.01, longest), batch, 1, 1, channels, 1)
    lead = lag * draw.even(0.0, 3.0, batch, 1, 1, channels, 1)
    response = (1.0 + 1j * omega * lead) / (1.0 + 1j * omega * lag) ** 2
    return size * span * _from_steps(spectrum * response, count, mixed[..., :1])


def _noisy(values: Tensor, prior: SensorPrior, draw: Draw) -> Tensor:
    """Zeros of the day, spectral lines, white noise, quantisers."""
    batch, days, each, channels, count = values.shape
    time = TICK * torch.arange(count, device=values.device)
    noise = torch.zeros((batch, days, each, count), device=values.device)
    scale = draw.log_even(prior.line_scale, batch, 1, 1, 1)
    for low, high, height in LINES:
        frequency = draw.even(low, high, batch, days, each, 1)
        phase = draw.even(0.0, 2.0 * math.pi, batch, days, each, 1)
        noise += LINE * height * scale * torch.sin(2.0 * math.pi * frequency * time + phase)
    white, step = draw.log_even(prior.angle_white, batch, 1, 1, 1), draw.log_even(prior.angle_step, batch, 1, 1, 1)
    zero = prior.angle_zero * draw.normal(batch, days, 1, 1)
    angle = values[:, :, :, 0] + noise + zero + white * draw.normal(batch, days, each, count)
    angle = torch.round(angle / step) * step
    shape = (batch, 1, 1, channels - 1, 1)
    white, step = draw.log_even(prior.pressure_white, *shape), draw.log_even(prior.pressure_step, *shape)
    zero = prior.pressure_zero * draw.normal(batch, days, 1, channels - 1, 1)
    pressure = values[:, :, :, 1:] + zero + white * draw.normal(batch, days, each, channels - 1, count)
    pressure = torch.round(pressure / step) * step
    return torch.cat([angle[:, :, :, None], pressure], dim=3)


def _with_deviations(values: Tensor, kind: Tensor, draw: Draw) -> Tensor:
    """Signals of days whose outsider is the ``kind``-th of :data:`outsiders.SIGNAL` (B, D)."""
    values = values.clone()
    for number, name in enumerate(outsiders.SIGNAL):
        b, d = torch.nonzero(kind == number, as_tuple=True)
        if len(b):
            values[b, d] = DEVIATIONS[name](values[b, d], draw)
    return values


def _side(draw: Draw, count: int) -> Tensor:
    return 2.0 * draw.one_of(2, count, 1, 1).float() - 1.0


def _drifting_angle(values: Tensor, draw: Draw) -> Tensor:
    """A zero that runs away with time."""
    ramp = torch.linspace(0.0, 1.0, values.shape[-1], device=values.device)
    values[:, :, 0] += _side(draw, len(values)) * draw.log_even((0.01, 0.06), len(values), 1, 1) * ramp
    return values


def _spiking_angle(values: Tensor, draw: Draw) -> Tensor:
    """Single samples that lie elsewhere."""
    hit = torch.rand(values[:, :, 0].shape, generator=draw.generator, device=values.device) < 0.03
    values[:, :, 0] += hit * draw.log_even((0.02, 0.2), len(values), 1, 1) * torch.sign(draw.normal(*hit.shape))
    return values


def _wobbling_angle(values: Tensor, draw: Draw) -> Tensor:
    """An eccentric magnet: an error with one or more periods a turn."""
    periods = draw.even(3.0, 30.0, len(values), 1, 1)
    values[:, :, 0] += draw.log_even((0.003, 0.02), len(values), 1, 1) * torch.sin(periods * values[:, :, 0])
    return values


def _kinked_angle(values: Tensor, draw: Draw) -> Tensor:
    """A gain that differs to either side."""
    wrong = 1.0 + _side(draw, len(values)) * draw.log_even((0.02, 0.1), len(values), 1, 1)
    values[:, :, 0] = torch.where(values[:, :, 0] > 0.0, values[:, :, 0] * wrong, values[:, :, 0])
    return values


def _coarse_angle(values: Tensor, draw: Draw) -> Tensor:
    """A quantiser that lost its low bits."""
    step = draw.log_even((0.01, 0.04), len(values), 1, 1)
    values[:, :, 0] = torch.round(values[:, :, 0] / step) * step
    return values


def _gathered(values: Tensor, place: Tensor) -> Tensor:
    """Signals (n, J, C, T) at other samples (n, J, T), whole numbers."""
    place = place.clamp(0, values.shape[-1] - 1).long()[:, :, None].expand(values.shape)
    return torch.gather(values, 3, place)


def _dropped_samples(values: Tensor, draw: Draw) -> Tensor:
    """A logger that repeats itself for a while, again and again."""
    count = values.shape[-1]
    index = torch.arange(count, device=values.device).expand(len(values), values.shape[1], count)
    period, length = draw.even(40.0, 120.0, len(values), 1, 1), draw.even(8.0, 30.0, len(values), 1, 1)
    phase = torch.remainder(index + draw.even(0.0, 120.0, len(values), values.shape[1], 1), period)
    return _gathered(values, torch.where(phase < length, index - phase, index.float()))


def _stretched_clock(values: Tensor, draw: Draw) -> Tensor:
    """A clock that runs too fast or too slow."""
    index = torch.arange(values.shape[-1], device=values.device).expand(len(values), values.shape[1], values.shape[-1])
    rate = 1.0 + _side(draw, len(values)) * draw.log_even((0.02, 0.08), len(values), 1, 1)
    return _gathered(values, torch.round(50.0 + (index - 50.0) * rate))


def _one_pressure(values: Tensor, draw: Draw) -> tuple[Tensor, Tensor]:
    rows = torch.arange(len(values), device=values.device)
    return rows, 1 + draw.one_of(values.shape[2] - 1, len(values))


def _pressure_gain(values: Tensor, draw: Draw) -> Tensor:
    """One pressure sensor of another range."""
    rows, channel = _one_pressure(values, draw)
    values[rows, :, channel] *= 1.0 + _side(draw, len(values)) * draw.log_even((0.06, 0.5), len(values), 1, 1)
    return values


def _drifting_pressure(values: Tensor, draw: Draw) -> Tensor:
    """One pressure sensor whose zero runs away."""
    rows, channel = _one_pressure(values, draw)
    ramp = torch.linspace(0.0, 1.0, values.shape[-1], device=values.device)
    values[rows, :, channel] += _side(draw, len(values)) * draw.log_even((3e5, 30e5), len(values), 1, 1) * ramp
    return values


def _slow_pressure(values: Tensor, draw: Draw) -> Tensor:
    """One pressure sensor behind a clogged line."""
    rows, channel = _one_pressure(values, draw)
    lag = draw.log_even((0.03, 0.3), len(values), 1).expand(len(values), values.shape[1])
    values[rows, :, channel] = _filtered(values[rows, :, channel], torch.zeros_like(lag), lag)
    return values


def _cross_talk(values: Tensor, draw: Draw) -> Tensor:
    """One pressure that leaks into another's wire."""
    rows, channel = _one_pressure(values, draw)
    other = 1 + torch.remainder(channel, values.shape[2] - 1)
    values[rows, :, channel] += draw.log_even((0.08, 0.4), len(values), 1, 1) * values[rows, :, other]
    return values


def _resonant_pressure(values: Tensor, draw: Draw) -> Tensor:
    """One pressure behind a line that rings."""
    rows, channel = _one_pressure(values, draw)
    spectrum, frequency, size = _spectrum(values[rows, :, channel])
    natural = 2.0 * math.pi * draw.even(4.0, 15.0, len(values), 1, 1)
    damping = draw.even(0.05, 0.3, len(values), 1, 1)
    omega = 2.0 * math.pi * frequency
    response = natural**2 / (natural**2 - omega**2 + 2j * damping * natural * omega)
    values[rows, :, channel] = _from_steps(spectrum * response, size, values[rows, :, channel, :1])
    return values


def _clipped_pressure(values: Tensor, draw: Draw) -> Tensor:
    """One pressure sensor that ends early."""
    rows, channel = _one_pressure(values, draw)
    most = values[rows, :, channel].amax(dim=(1, 2))[:, None, None] * draw.even(0.25, 0.7, len(values), 1, 1)
    values[rows, :, channel] = torch.minimum(values[rows, :, channel], most)
    return values


def _humming_pressure(values: Tensor, draw: Draw) -> Tensor:
    """One pressure with an oscillation of its own."""
    rows, channel = _one_pressure(values, draw)
    time = TICK * torch.arange(values.shape[-1], device=values.device)
    phase = draw.even(0.0, 6.3, len(values), values.shape[1], 1)
    wave = torch.sin(2.0 * math.pi * draw.even(1.0, 20.0, len(values), 1, 1) * time + phase)
    values[rows, :, channel] += draw.log_even((2e5, 15e5), len(values), 1, 1) * wave
    return values


def _mixed_signals(values: Tensor, draw: Draw) -> Tensor:
    """A law that is another one: a filtered mix of all signals on top of each."""
    return values + _mix(values[:, None], MIXED, MIXED_TIME, draw)[:, 0]


def _one_channel(values: Tensor, draw: Draw) -> tuple[Tensor, Tensor, Tensor]:
    """A channel of each day: which, its signals (n, J, T), and their span (n, 1, 1)."""
    rows = torch.arange(len(values), device=values.device)
    channel = draw.one_of(values.shape[2], len(values))
    own = values[rows, :, channel]
    return channel, own, (own.amax(dim=(1, 2)) - own.amin(dim=(1, 2)))[:, None, None].clamp(min=1e-3)


def _with_channel(values: Tensor, channel: Tensor, own: Tensor) -> Tensor:
    values[torch.arange(len(values), device=values.device), :, channel] = own
    return values


def _bent_signal(values: Tensor, draw: Draw) -> Tensor:
    """A sensor that is not linear."""
    channel, own, span = _one_channel(values, draw)
    periods, phase = draw.even(0.4, 2.0, len(values), 1, 1), draw.even(0.0, 6.3, len(values), 1, 1)
    bend = torch.sin(6.3 * periods * own / span + phase) - torch.sin(6.3 * periods * own[..., :1] / span + phase)
    return _with_channel(values, channel, own + draw.log_even((0.02, 0.2), len(values), 1, 1) * span * bend)


def _filtered_signal(values: Tensor, draw: Draw) -> Tensor:
    """A signal behind a filter of second order, damped or not."""
    channel, own, _ = _one_channel(values, draw)
    spectrum, frequency, size = _spectrum(own)
    natural, damping = 6.3 * draw.log_even((0.7, 8.0), len(values), 1, 1), draw.log_even((0.05, 1.5), len(values), 1, 1)
    omega = 2.0 * math.pi * frequency
    response = natural**2 / (natural**2 - omega**2 + 2j * damping * natural * omega)
    return _with_channel(values, channel, _from_steps(spectrum * response, size, own[..., :1]))


def _wandering_signal(values: Tensor, draw: Draw) -> Tensor:
    """A signal with slow waves of its own."""
    channel, own, span = _one_channel(values, draw)
    time = TICK * torch.arange(values.shape[-1], device=values.device)
    wave = torch.zeros_like(own)
    for _ in range(WAVES):
        frequency = draw.log_even((0.1, 3.0), len(values), own.shape[1], 1)
        wave += torch.sin(6.3 * frequency * time + draw.even(0.0, 6.3, len(values), own.shape[1], 1))
    return _with_channel(values, channel, own + draw.log_even((0.01, 0.12), len(values), 1, 1) * span * wave)


def _warped_time(values: Tensor, draw: Draw) -> Tensor:
    """A machine, or a clock, that is now ahead and now behind."""
    index = torch.arange(values.shape[-1], device=values.device).expand(len(values), values.shape[1], values.shape[-1])
    frequency = draw.log_even((0.15, 1.5), len(values), 1, 1)
    depth = draw.log_even((0.02, 0.3), len(values), 1, 1) / TICK
    wave = torch.sin(6.3 * frequency * TICK * index + draw.even(0.0, 6.3, len(values), values.shape[1], 1))
    return _gathered(values, torch.round(index + depth * wave))


def _late_pressure(values: Tensor, draw: Draw) -> Tensor:
    """One pressure that is logged late."""
    rows, channel = _one_pressure(values, draw)
    late = draw.log_even((0.03, 0.4), len(values), 1).expand(len(values), values.shape[1])
    values[rows, :, channel] = _filtered(values[rows, :, channel], late, torch.zeros_like(late))
    return values


def _swapped_ports(values: Tensor, draw: Draw) -> Tensor:
    """Two sensors whose wires were exchanged."""
    return values[:, :, [0, 2, 1, 3]]


DEVIATIONS: dict[str, Any] = {name: globals()[f"_{name}"] for name in outsiders.SIGNAL}
"""Deviations (n, J, channels, T) by kind."""
