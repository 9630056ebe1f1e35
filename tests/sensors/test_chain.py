"""The measuring chain against closed forms."""

import math

import numpy as np
import pytest
from scipy.integrate import cumulative_trapezoid
from scipy.signal import butter, freqz, sosfreqz

from aoro_gym.sensors.chain import (
    CHAINS,
    PUBLISHED,
    MeasuringChain,
    low_pass,
    low_pass_gain,
    measured_flow,
    port_volume,
    sample,
    sampling_rate,
    turn_flow,
)

VOLUME = math.pi / 4 * (2 * 0.08**2 - 0.04**2) * 0.265  # [m³] of a full turn: bore and annulus times the stroke
RATE = 100.0


def test_gain_is_the_squared_response_of_the_published_filter():
    frequency = np.linspace(0.0, 49.0, 300)
    _, response = sosfreqz(butter(4, 7.0, fs=RATE, output="sos"), frequency, fs=RATE)
    np.testing.assert_allclose(low_pass_gain(frequency), np.abs(response) ** 2, atol=1e-9)
    assert low_pass_gain(7.0) == pytest.approx(0.5)


@pytest.mark.parametrize("frequency", [0.5, 3.0, 6.0, 7.0, 9.0, 15.0])
def test_filter_scales_a_sine_and_does_not_move_it(frequency):
    time = np.arange(0.0, 20.0, 1 / RATE)
    wave = np.sin(2 * np.pi * frequency * time + 0.3)
    # the slowest pole decays by e^(-2π 7 sin(π/8) t): 10^-14 in two seconds
    inside = slice(400, -400)
    np.testing.assert_allclose(low_pass(wave)[inside], (low_pass_gain(frequency) * wave)[inside], atol=1e-9)


def test_filter_keeps_lines_and_columns_apart():
    time = np.arange(0.0, 3.0, 1 / RATE)
    columns = np.stack([np.full_like(time, 0.7), 0.2 - 0.1 * time, np.random.default_rng(0).normal(size=time.size)], 1)
    filtered = low_pass(columns)
    np.testing.assert_allclose(filtered[:, 0], columns[:, 0], atol=1e-12)
    inside = slice(100, -100)  # a second from the ends of the line, the ringing has decayed by e^-17
    np.testing.assert_allclose(filtered[inside, 1], columns[inside, 1], atol=1e-10)
    np.testing.assert_array_equal(filtered[:, 2], low_pass(columns[:, 2]))


def test_cutoff_above_half_the_rate_is_refused():
    with pytest.raises(ValueError, match=r"cutoff is 7 Hz, but must be in \(0, 5\) Hz at 10 samples"):
        low_pass(np.zeros(99), rate=10.0)


@pytest.mark.parametrize("direction", [1, -1])
def test_a_full_turn_takes_both_full_strokes(machine, direction):
    cylinder = machine.steering.cylinder
    stop = direction * cylinder.half_range
    # the linkage closes to the rounding of its solution
    assert port_volume(cylinder, -stop, direction) == pytest.approx(0.0, abs=1e-15)
    assert port_volume(cylinder, stop, direction) == pytest.approx(VOLUME, rel=1e-12)


def test_flow_is_the_rate_of_the_volume(machine):
    cylinder = machine.steering.cylinder
    angle, step = np.linspace(-0.65, 0.65, 41), 1e-5
    for direction in (1, -1):
        change = port_volume(cylinder, angle + step, direction) - port_volume(cylinder, angle - step, direction)
        # central difference: step²/6 of the third derivative, below 1e-9 of the flow; rounding: 1e-16 × 2e-3 / 2e-5
        np.testing.assert_allclose(turn_flow(cylinder, angle, 0.7, direction), change / (2 * step) * 0.7, rtol=1e-8)
    np.testing.assert_allclose(turn_flow(cylinder, angle, 0.7, 1), turn_flow(cylinder, -angle, -0.7, -1), rtol=1e-14)


@pytest.mark.parametrize("direction", [1, -1])
def test_measured_flow_of_a_constant_rate(machine, direction):
    cylinder = machine.steering.cylinder
    duration = 4.0
    rate = direction * 2 * cylinder.half_range / duration
    time = np.arange(-1.0, duration + 1.0, 1 / RATE)
    angle = np.clip(rate * (time - duration / 2), -cylinder.half_range, cylinder.half_range)
    flow = measured_flow(cylinder, angle, direction)
    inside = (time > 0.8) & (time < duration - 0.8)  # 0.8 s from the kinks the filter's ringing is below 1e-6
    exact = turn_flow(cylinder, angle, rate, direction)
    # a central difference misses by h²/6 of the third derivative; the lever over 80° is nearly a parabola of height 0.03 m,
    # so that Q'' = rate² × 2 × 0.03/0.70² × rate × area, against Q = 0.19 × rate × area: a share of 0.65 rate²
    share = (1 / RATE) ** 2 / 6 * 0.65 * rate**2
    np.testing.assert_allclose(flow[inside], exact[inside], rtol=2 * share + 1e-6)
    drawn = cumulative_trapezoid(flow, time, initial=0.0)[-1]
    assert drawn == pytest.approx(VOLUME, rel=1e-6)


def test_measured_flow_of_many_machines_at_once(machine):
    ratios = np.array([0.7, 0.766, 0.9])
    several = machine.set({"steering.cylinder.mount_ratio": ratios})
    angle = np.linspace(-0.6, 0.6, 200)[:, None] * np.array([1.0, -1.0, 0.8])
    direction = np.array([1, -1, 1])
    together = measured_flow(several.steering.cylinder, angle, direction)
    for index in range(3):
        alone = measured_flow(several.variant(index).steering.cylinder, angle[:, index], direction[index])
        np.testing.assert_allclose(together[:, index], alone, rtol=1e-12)


def test_samples_stand_on_the_clock():
    time = np.arange(1, 101) * 1e-3
    ticks, values = sample(time, time)
    np.testing.assert_allclose(ticks, np.arange(1, 11) * 0.01)
    np.testing.assert_allclose(values, ticks, atol=1e-12)
    ticks, values = sample(time, np.stack([time, -time], 1), offset=0.0034)
    np.testing.assert_allclose(ticks, 0.0034 + np.arange(10) * 0.01)
    np.testing.assert_allclose(values[:, 0], ticks - 0.0004, atol=1e-12)  # the last value before the tick
    assert values.shape == (10, 2)


def test_sampler_folds_high_frequencies():
    time = np.arange(0, 2000) * 1e-3
    ticks, values = sample(time, np.sin(2 * np.pi * 106.0 * time))
    np.testing.assert_allclose(values, np.sin(2 * np.pi * 6.0 * ticks), atol=1e-9)


def test_uneven_or_missing_samples_are_named():
    assert sampling_rate(np.arange(50) * 0.01) == pytest.approx(100.0)
    with pytest.raises(ValueError, match=r"samples are 0\.01 to 0\.03 s apart"):
        sampling_rate([0.0, 0.01, 0.02, 0.05, 0.06])
    with pytest.raises(ValueError, match=r"must be \(F,\) with at least two"):
        sampling_rate([0.0])
    with pytest.raises(ValueError, match="hold no sample at 100 Hz"):
        sample([0.001, 0.009], [0.0, 0.0])


def transfer(chain: MeasuringChain, frequency: float) -> complex:
    """Of a chain's filter, by SciPy."""
    if chain.filter == "none":
        return 1.0 + 0.0j
    if chain.filter == "moving_average":
        count = 9 if chain.rate == RATE else 5
        taps = np.full(count, 1.0 / count)
        response = np.asarray(freqz(taps, worN=np.array([frequency]), fs=chain.rate)[1]).item()  # pyright: ignore[reportArgumentType]
        return response * np.exp(1j * np.pi * frequency * (count - 1) / chain.rate) if chain.zero_phase else response
    sections = butter(chain.order, chain.cutoff, fs=chain.rate, output="sos")
    response = np.asarray(sosfreqz(sections, [frequency], fs=chain.rate)[1]).item()
    return abs(response) ** 2 if chain.zero_phase else response


def test_the_published_chain_is_the_first_and_the_default(machine):
    assert next(iter(CHAINS.items())) == ("published", PUBLISHED)
    angle = 0.5 * np.tanh(np.linspace(-6.0, 6.0, 400))
    np.testing.assert_array_equal(PUBLISHED.filtered(angle), low_pass(angle))
    cylinder = machine.steering.cylinder
    expected = np.gradient(port_volume(cylinder, low_pass(angle), 1), 0.01)
    np.testing.assert_array_equal(measured_flow(cylinder, angle, 1), expected)


@pytest.mark.parametrize("frequency", [0.5, 3.0, 7.0])
@pytest.mark.parametrize("name", CHAINS)
def test_every_filter_does_to_a_sine_what_its_transfer_function_says(name, frequency):
    chain = CHAINS[name]
    time = np.arange(0.0, 20.0, 1.0 / chain.rate)
    wave = np.exp(1j * (2.0 * np.pi * frequency * time + 0.3))
    filtered = chain.filtered(wave.real) + 1j * chain.filtered(wave.imag)
    inside = (time > 4.0) & (time < 16.0)  # the slowest pole, of order 6, decays by e^(-2π 7 sin(π/12) 4) = 10^-19
    np.testing.assert_allclose(filtered[inside], transfer(chain, frequency) * wave[inside], atol=1e-9)


def test_corners_delays_and_nulls_are_where_the_closed_forms_have_them():
    for order in (2, 4, 6):
        causal = MeasuringChain(order=order, zero_phase=False)
        assert abs(transfer(causal, 7.0)) == pytest.approx(math.sqrt(0.5), rel=1e-9)  # -3 dB
        ramp = np.arange(0.0, 20.0, 0.01)
        late = (ramp - causal.filtered(ramp))[-1]
        assert late == pytest.approx(
            1.0 / (200.0 * math.tan(0.07 * math.pi) * math.sin(math.pi / (2 * order))), rel=1e-9
        )
    # the phase at 3 Hz of the two second-order sections, ζ = sin(π/8) and sin(3π/8), at the bilinear transform's frequency
    w = math.tan(0.03 * math.pi) / math.tan(0.07 * math.pi)
    phase = sum(math.atan(2.0 * math.sin(k * math.pi / 8.0) * w / (1.0 - w * w)) for k in (1, 3))
    assert -np.angle(transfer(CHAINS["causal"], 3.0)) == pytest.approx(phase, rel=1e-9)
    assert phase / (6.0 * math.pi) == pytest.approx(0.0603, abs=5e-5)
    time = np.arange(0.0, 3.0, 1.0 / RATE)
    for name in ("moving_average", "trailing_average"):
        null = CHAINS[name].filtered(np.sin(2.0 * np.pi * RATE / 9.0 * time))[9:-9]
        np.testing.assert_allclose(null, 0.0, atol=1e-12)
    late = time - CHAINS["trailing_average"].filtered(time)
    np.testing.assert_allclose(late[9:], 0.04, rtol=1e-9)


@pytest.mark.parametrize("name", CHAINS)
def test_filters_keep_rest_and_columns_apart(name):
    chain = CHAINS[name]
    rest = np.full(200, 0.7)
    columns = np.stack([rest, np.random.default_rng(0).normal(size=200)], 1)
    filtered = chain.filtered(columns)
    np.testing.assert_allclose(filtered[:, 0], rest, rtol=1e-12)
    np.testing.assert_allclose(filtered[:, 1], chain.filtered(columns[:, 1]), rtol=1e-12, atol=1e-15)


@pytest.mark.parametrize("name", CHAINS)
def test_a_turn_takes_the_same_oil_by_every_chain(machine, name):
    cylinder, chain = machine.steering.cylinder, CHAINS[name]
    clock = np.arange(0.0, 6.0, 0.001)
    angle = cylinder.half_range * np.clip((clock - 3.0) / 1.2, -1.0, 1.0)
    ticks, taken = chain.sampled(clock, angle)
    drawn = cumulative_trapezoid(measured_flow(cylinder, taken, 1, chain=chain), ticks, initial=0.0)[-1]
    # trapezia over central differences are the volume's end less its start, but for half a sample at rest;
    # 1.8 s from the kinks the slowest ringing is e^(-2π 7 sin(π/12) 1.8) = 10^-9
    assert drawn == pytest.approx(VOLUME, rel=1e-8)


def test_a_sampler_shows_what_was_a_latency_ago_at_its_own_rate():
    time = np.arange(0, 2001) * 1e-3
    wave = np.sin(2.0 * np.pi * 3.0 * time)
    for chain in (MeasuringChain(latency=0.02), MeasuringChain(rate=50.0, latency=0.007)):
        ticks, values = chain.sampled(time, np.stack([wave, -wave], 1))
        np.testing.assert_allclose(np.diff(ticks), 1.0 / chain.rate, rtol=1e-9)
        assert ticks[-1] == pytest.approx(2.0)
        shown = np.sin(2.0 * np.pi * 3.0 * np.maximum(ticks - chain.latency, 0.0))
        np.testing.assert_allclose(values, np.stack([shown, -shown], 1), atol=1e-9)
    for latency in (0.0, 0.02):
        np.testing.assert_array_equal(MeasuringChain(latency=latency).sampled(time, wave)[0], sample(time, wave)[0])
    np.testing.assert_array_equal(PUBLISHED.sampled(time, wave)[1], sample(time, wave)[1])


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"filter": "bessel"}, "filter is 'bessel'; choose one of: butterworth, moving_average, none"),
        ({"order": 0}, "order is 0, but must be a positive integer"),
        ({"cutoff": 0.0}, "cutoff is 0 Hz, but must be finite and above 0"),
        ({"window": math.nan}, "window is nan"),
        ({"rate": -1.0}, "rate is -1 Hz"),
        ({"latency": -0.01}, "latency is -0.01 s, but must be finite and at least 0 s"),
    ],
)
def test_what_no_chain_can_be_is_named(fields, message):
    with pytest.raises(ValueError, match=message):
        MeasuringChain(**fields)
