"""Key figures against turns whose figures are known by construction."""

import numpy as np
import pytest
from scipy.integrate import cumulative_trapezoid

from aoro_gym.sensors.chain import CHAINS, low_pass_gain, measured_flow, port_volume, sample, turn_flow
from aoro_gym.sensors.joint_angle import JointAngleNoise, JointAngleSensor
from aoro_gym.simulation.key_figures import (
    FIGURES,
    TOLERANCE,
    key_figures,
    key_figures_batch,
    recording_figures,
    steady_swing_batch,
    turn_span,
    turn_start,
)
from aoro_gym.simulation.manoeuvres import STANDSTILL, Trajectory

LITRE_PER_MINUTE = 1e-3 / 60
STOP = np.radians(40.0)
REST = 0.6
RISE = 0.01


@pytest.fixture(scope="module")
def cylinder(machine):
    """One of the two steering cylinders."""
    return machine.steering.cylinder


def made_turn(direction=1, duration=2.0, step=1e-3, longest=None):
    """Time, angle and a flow with known extremes, of a turn whose joint moves at a constant rate."""
    time = np.arange(0.0, REST + (longest or duration) + 1.0, step)
    since = time - REST
    angle = direction * np.clip(-STOP + 2 * STOP * since / duration, -STOP, STOP)
    knots = [-1.0, 0.0, 0.1, 0.4, 0.7, 0.9, duration, duration + RISE, 99.0]
    flow = np.interp(since, knots, [0, 0, 100, 50, 90, 70, 70, 0, 0]) * LITRE_PER_MINUTE
    return time, angle, flow


def poured_turn(cylinder, since, flow, direction=1):
    """Angle of a turn that takes up ``flow`` [m³/s] from t = 0 of ``since`` on, until its stop."""
    angles = np.linspace(-cylinder.half_range, cylinder.half_range, 20001)
    volume = port_volume(cylinder, angles, 1)
    drawn = np.concatenate([[0.0], np.cumsum(0.5 * (flow[1:] + flow[:-1]) * np.diff(since))])
    return direction * np.interp(np.clip(drawn, 0.0, volume[-1]), volume, angles)


def known(figures: dict[str, float | None]) -> dict[str, float]:
    """The figures, none of which is missing."""
    values = {name: value for name, value in figures.items() if value is not None}
    assert len(values) == len(figures)
    return values


@pytest.mark.parametrize("direction", [1, -1])
def test_figures_of_a_made_turn(machine, direction):
    duration = 2.0
    time, angle, flow = made_turn(direction, duration)
    figures = known(key_figures(time, angle, machine, flow=flow))
    late = TOLERANCE / (2 * STOP / duration)  # the clock starts 0.1° after the start, and ends 0.1° before the stop
    step = 1.001e-3  # each end of a period is found to a sample
    assert figures["turn_time_s"] == pytest.approx(duration - 2 * late, abs=2 * step)
    assert figures["mean_flow_L_per_min"] == pytest.approx(2.33106 * 60 / figures["turn_time_s"], rel=1e-5)
    assert figures["first_peak_L_per_min"] == pytest.approx(100.0)
    assert figures["first_peak_time_s"] == pytest.approx(0.1 - late, abs=step)
    assert figures["lowest_undershoot_L_per_min"] == pytest.approx(50.0)
    assert figures["second_peak_L_per_min"] == pytest.approx(90.0)
    assert figures["steady_flow_L_per_min"] == pytest.approx(70.0)


def test_a_wave_of_the_steady_flow_is_told_from_its_drift(cylinder):
    """Flows that drift by 10 % a second, one with a wave of 5 % and 3 Hz that is even about the middle of the period and has
    eight of its own there: a line does not take it for a drift, and the chain leaves of it what its gain says."""
    frequency, waves = 3.0, (0.0, 0.05)
    duration = 8.0 / frequency / 0.44
    time = np.arange(0.0, duration + 3.0, 1e-3)
    later = time - 1.0 - 0.7 * duration  # than the middle of the steady period
    shares = [1.0 + 0.1 * later + wave * np.cos(2 * np.pi * frequency * later) for wave in waves]
    volume = port_volume(cylinder, np.array([cylinder.half_range]), 1)[0]
    mean = volume / (duration - 0.02 * duration**2)  # so that the turn ends when it is said to
    angles = [poured_turn(cylinder, time, np.where(time > 1.0, mean * share, 0.0)) for share in shares]
    ticks, angle = sample(time, np.stack(angles, axis=1))
    for swing in steady_swing_batch(ticks, angle, cylinder).values():
        assert swing[0] < 1e-3
        assert swing[1] == pytest.approx(0.05 * low_pass_gain(frequency), rel=0.05)
    still = steady_swing_batch(ticks, np.full_like(angle, -cylinder.half_range), cylinder)
    assert all(np.isnan(swing).all() for swing in still.values())


def test_periods_end_where_they_are_said_to(machine):
    """A flow that falls all the time shows the ends of the periods."""
    time, angle, _ = made_turn(1, 4.0, step=0.01)
    start = turn_span(time, angle[:, None], STOP).began[0]
    since = time - start
    figures = known(key_figures(time, angle, machine, flow=(100.0 - 10.0 * since) * LITRE_PER_MINUTE))
    turn_time = figures["turn_time_s"]
    assert figures["first_peak_L_per_min"] == pytest.approx(100.0)
    assert figures["first_peak_time_s"] == pytest.approx(0.0, abs=1e-9)
    assert figures["lowest_undershoot_L_per_min"] == pytest.approx(93.0)  # 0.7 s belongs to it
    assert figures["second_peak_L_per_min"] == pytest.approx(94.5)  # 0.55 s, too
    inside = (since >= 0.48 * turn_time - 1e-9) & (since <= 0.92 * turn_time + 1e-9)
    assert figures["steady_flow_L_per_min"] == pytest.approx(100.0 - 10.0 * since[inside].mean())
    rising = key_figures(time, angle, machine, flow=(50.0 + 10.0 * since) * LITRE_PER_MINUTE)
    assert rising["first_peak_time_s"] == pytest.approx(0.29)  # 0.3 s does not
    assert rising["second_peak_L_per_min"] == pytest.approx(58.5)


@pytest.mark.parametrize("direction", [1, -1])
def test_measuring_chain_against_an_independent_one(machine, cylinder, direction):
    """Angle filtered in the frequency domain, strokes by the law of cosines written out."""
    step, frames = 0.01, 2**10
    time = np.arange(frames) * step
    fine = np.arange(0.0, frames * step, 1e-4)
    since = fine - REST
    flow = np.interp(since, [-1, 0, 0.12, 0.35, 0.7, 1.0, 9], [0, 0, 110, 50, 85, 68, 68]) * LITRE_PER_MINUTE
    angle = poured_turn(cylinder, since, flow, direction)[:: round(step / 1e-4)]

    ramp = np.linspace(angle[0], angle[-1], frames)  # without it the record is periodic
    frequency = np.fft.rfftfreq(frames, step)
    smooth = np.fft.irfft(np.fft.rfft(angle - ramp) * low_pass_gain(frequency), frames) + ramp
    a, b, g0 = cylinder.linkage.a, cylinder.linkage.b, cylinder.linkage.g0
    extending = np.sqrt(a * a + b * b - 2 * a * b * np.cos(g0 + direction * smooth))
    retracting = np.sqrt(a * a + b * b - 2 * a * b * np.cos(g0 - direction * smooth))
    oil = np.pi / 4 * (0.08**2 * extending - (0.08**2 - 0.04**2) * retracting)
    other = np.gradient(oil, step)

    mine, reference = known(key_figures(time, angle, machine)), known(key_figures(time, angle, machine, flow=other))
    # the periodic continuation bends the ends of the record, 0.5 s away from the turn; there its ringing is e^-8
    for name in FIGURES:
        assert mine[name] == pytest.approx(reference[name], rel=1e-4), name
    assert mine["first_peak_L_per_min"] < 108.0  # and the filter has cut the corner of 110 L/min
    assert mine["steady_flow_L_per_min"] == pytest.approx(68.0, rel=2e-3)


def test_many_turns_at_once_are_the_single_ones(machine):
    durations, directions = [1.5, 2.0, 3.0, 6.0], [1, -1, -1, 1]
    several = machine.set({"steering.cylinder.mount_ratio": np.array([0.7, 0.766, 0.8, 0.9])})
    angles = [
        made_turn(direction, duration, 0.01, 6.0)[1] for direction, duration in zip(directions, durations, strict=True)
    ]
    time = made_turn(1, 6.0, 0.01)[0]
    for interpolate in (False, True):
        together = key_figures_batch(time, np.stack(angles, 1), several, interpolate=interpolate)
        assert list(together) == list(FIGURES)
        for index, angle in enumerate(angles):
            alone = key_figures_batch(time, angle, several.variant(index), interpolate=interpolate)
            for name in FIGURES:
                assert together[name].shape == (4,)
                assert together[name][index] == pytest.approx(alone[name][0], rel=1e-12), name


def test_interpolated_figures_do_not_depend_on_the_clock(machine, cylinder):
    """Shift a turn by parts of a sample: times and peaks stay, to what straight lines and parabolas miss."""
    fine = np.arange(0.0, 4.5, 1e-4)
    bump = 70 + 40 * np.exp(-(((fine - REST - 0.15) / 0.06) ** 2))
    flow = np.where(fine < REST, 0.0, bump * np.clip((fine - REST) / 0.05, 0, 1)) * LITRE_PER_MINUTE
    angle = poured_turn(cylinder, fine - REST, flow)
    shifted, read = (
        [
            key_figures_batch(fine[k::100][:430], angle[k::100][:430], machine, interpolate=interpolate)
            for k in range(0, 100, 10)
        ]
        for interpolate in (True, False)
    )

    def spread(figures, name):
        values = np.array([figure[name][0] for figure in figures])
        return np.ptp(values)

    # the joint begins with 15 rad/s² and has 0.1° behind it after 15 ms, in a chord of at least 0.15 rad/s: a straight
    # line misses that by up to 15 h²/8 / 0.15; without it, samples jump by whole ones
    assert spread(shifted, "turn_time_s") < 15 * 0.01**2 / 8 / 0.15
    assert spread(read, "turn_time_s") > 5e-3
    assert spread(shifted, "first_peak_time_s") < 4e-3
    # a parabola through a peak of width 0.06 s: fourth order, (h/0.06)⁴/24 of 40 L/min
    assert spread(shifted, "first_peak_L_per_min") < 0.02


def test_turns_without_figures(machine):
    time, angle, _ = made_turn(step=0.01)
    nothing = dict.fromkeys(FIGURES)
    assert key_figures(time[: 60 + 150], angle[: 60 + 150], machine) == nothing  # does not arrive
    assert key_figures(time, np.full_like(time, -STOP), machine) == nothing  # does not leave
    for missing in (20, 40, 55, 100):  # of 0.6 s of rest
        assert key_figures(time[missing:], angle[missing:], machine) == nothing
    assert key_figures(time, np.full_like(time, np.nan), machine) == nothing
    early = key_figures(time[: 60 + 240], angle[: 60 + 240], machine)  # 0.4 s after the stop
    assert early["turn_time_s"] is not None
    assert early["mean_flow_L_per_min"] is not None
    assert [early[name] for name in FIGURES[2:]] == [None] * 5
    whole = key_figures(time[: 60 + 252], angle[: 60 + 252], machine)
    assert None not in whole.values()
    lost = np.stack([angle, np.where(time > 1.0, np.nan, angle)], 1)
    both = key_figures_batch(time, lost, machine)
    assert np.isfinite(both["turn_time_s"]).tolist() == [True, False]


def test_beyond_the_stop_has_arrived(machine):
    time, angle, flow = made_turn()
    pressed = np.where(angle >= STOP - TOLERANCE, STOP + 2 * TOLERANCE, angle)  # springs past the window in one sample
    assert key_figures(time, pressed, machine, flow=flow) == key_figures(time, angle, machine, flow=flow)


def test_a_stop_that_is_not_the_machines(machine):
    time, angle, _ = made_turn(step=0.01)
    short = np.minimum(angle, STOP - np.radians(3.0))
    assert np.isnan(key_figures_batch(time, short, machine)["turn_time_s"][0])
    found = key_figures_batch(time, short, machine, stop=short[-50:].mean())["turn_time_s"][0]
    # 77 of 80 degrees, less a tenth at either end
    assert found == pytest.approx(2.0 * (77 - 0.2) / 80, abs=0.0201)


def test_noise_does_not_start_the_clock(machine):
    """At rest the noise passes 0.1° all the time; the turn's begin moves by no more than the noise is worth."""
    time, angle, _ = made_turn(step=0.01)
    noise = JointAngleNoise.published()
    _, measured = JointAngleSensor(noise=noise).record(
        np.repeat(angle[:, None], 300, 1), time, np.random.default_rng(0)
    )
    assert np.mean(np.abs(measured[:50] - angle[0]).max(axis=0) > TOLERANCE) > 0.5
    exact, noisy = turn_span(time, angle[:, None], STOP), turn_span(time, measured, STOP)
    largest = sum(line.amplitude for line in noise.lines) + 4.5 * noise.white + 0.5 * noise.resolution
    samples = largest / (2 * STOP / 2.0 * 0.01)  # of a joint that turns 80° in 2 s
    assert np.abs(noisy.first - exact.first).max() <= np.ceil(2 * samples)  # the start's mean is noisy, too
    assert noisy.complete.all()


def test_left_for_good_is_the_first_sample_beyond_without_noise(left_turn):
    angle = left_turn["joint_angle"]
    span = turn_span(left_turn.time, angle[:, None], np.radians(40.0))
    # settling by 0.004° before the turn is worth less than a millisecond of it
    assert abs(span.first[0] - np.argmax(np.abs(angle - angle[0]) > TOLERANCE)) <= 1
    assert span.last[0] == np.argmax(np.radians(40.0) - angle <= TOLERANCE)


def test_flow_of_the_twin_and_of_the_chain_agree_where_the_filter_has_nothing_to_do(left_turn, cylinder):
    angle, time = left_turn["joint_angle"][9::10], left_turn.time[9::10]
    chain = measured_flow(cylinder, angle, 1)
    exact = turn_flow(cylinder, left_turn["joint_angle"], left_turn["joint_rate"], 1)[9::10]
    span = turn_span(left_turn.time, left_turn["joint_angle"][:, None], np.radians(40.0))
    inside = (time > span.began[0]) & (time < span.ended[0])
    # the turn is made of the same oil, whatever blurs it
    assert chain.sum() == pytest.approx(exact[inside].sum(), rel=0.01)


def test_wrong_shapes_are_named(machine):
    with pytest.raises(ValueError, match=r"angle has shape \(4,\), but must be \(5,\) or \(5, N\)"):
        key_figures(np.arange(5) * 0.01, np.zeros(4), machine)
    with pytest.raises(ValueError, match="evenly spaced"):
        key_figures([0.0, 0.01, 0.05], np.zeros(3), machine)


def test_a_turn_has_the_key_figures(left_turn, machine):
    figures = known(recording_figures(left_turn, machine.steering.cylinder))
    ticks, angle = sample(left_turn.time, left_turn["joint_angle"])
    assert {name: figures[name] for name in FIGURES} == key_figures(ticks, angle, machine)
    # sampled ten times as fast, and unfiltered: an extreme can only grow
    assert figures["raw_first_peak_L_per_min"] > figures["first_peak_L_per_min"]
    assert figures["raw_lowest_undershoot_L_per_min"] < figures["lowest_undershoot_L_per_min"]
    assert figures["raw_steady_flow_L_per_min"] == pytest.approx(figures["steady_flow_L_per_min"], rel=0.01)


def test_a_turn_that_does_not_arrive_has_no_figures_of_a_turn(left_turn, machine):
    cut = left_turn.time < STANDSTILL + 1.0
    channels = {name: values[cut] for name, values in left_turn.channels.items()}
    figures = recording_figures(
        Trajectory(left_turn.manoeuvre, left_turn.time[cut], channels), machine.steering.cylinder
    )
    assert {figures[name] for name in FIGURES} == {None}
    assert figures["highest_pressure_a_bar"] is not None


def test_a_turn_starts_after_its_signal(left_turn, drive):
    start = turn_start(left_turn)
    assert start is not None
    assert STANDSTILL < start < STANDSTILL + 0.2
    assert turn_start(drive) is None


@pytest.mark.parametrize("turn", ["left_turn", "right_turn"])
def test_the_twins_turn_closes_its_oil_balance(turn, machine, request):
    recording = request.getfixturevalue(turn)
    figures = known(recording_figures(recording, machine.steering.cylinder))
    drawn = cumulative_trapezoid(recording["joint_flow"], recording.time, initial=0.0).max()
    # the joint springs back from its stop by less than a degree of its 80
    assert drawn == pytest.approx(2.331e-3, rel=1 / 80)
    assert figures["raw_first_peak_L_per_min"] > figures["mean_flow_L_per_min"]
    high = "a" if turn == "left_turn" else "b"
    low = "b" if turn == "left_turn" else "a"
    assert figures[f"highest_pressure_{high}_bar"] > 5 * figures[f"highest_pressure_{low}_bar"]


def test_figures_of_a_drive(drive, machine):
    figures = recording_figures(drive, machine.steering.cylinder)
    assert figures["distance_m"] == pytest.approx(np.hypot(drive["position_x"][-1], drive["position_y"][-1]), rel=0.01)
    assert figures["final_speed_m_per_s"] == pytest.approx(drive["speed"][-1], rel=0.1)
    assert "highest_pressure_a_bar" not in figures


def test_a_chain_blurs_the_turn_that_it_measures(left_turn, machine):
    cylinder = machine.steering.cylinder
    found = {name: known(recording_figures(left_turn, cylinder, chain)) for name, chain in CHAINS.items()}
    published, bare = found["published"], found["unfiltered"]
    assert published == known(recording_figures(left_turn, cylinder))
    peak = "first_peak_L_per_min"
    # half the gain squared at 7 Hz, then (1 + r^12) against (1 + r^8) and (1 + r^4), r < 1 where the first peak's power is
    assert found["second_order"][peak] < published[peak] < bare[peak]
    # 58 ms for slow motion; its samples are 10 ms apart, and the first peak is faster than that
    later = found["causal"]["first_peak_time_s"] - published["first_peak_time_s"]
    assert 0.04 < later < 0.08
    # what counts from the angle's own start does not know how old the angle is: 20 ms are two samples;
    # the filter's ends begin at another sample of the joint's creep at rest, 1e-5 of the turn, and ring by e^-8 to its start
    assert found["late"] == pytest.approx(published, rel=1e-8)
    assert abs(found["half_rate"]["turn_time_s"] - published["turn_time_s"]) <= 0.02 + 1e-9
