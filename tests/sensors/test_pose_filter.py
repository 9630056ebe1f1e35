"""The pose filter agrees with one that is written apart, is as sure as it should be, and drifts less than dead reckoning."""

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest
from scipy.stats import chi2

from aoro_gym.sensors import Antennas, FixLoss, Gps, GpsNoise, GpsReading, Imu, ImuNoise, Localisation
from aoro_gym.sensors.attitude import in_world, wrapped
from aoro_gym.sensors.noise import Drift
from aoro_gym.sensors.pose_filter import (
    EXACT_HEADING,
    EXACT_POSITION,
    PoseFilter,
    PoseFilterSettings,
    creep,
    heading_rate,
)
from tests.oracles.pose_filter import OracleFilter

STEP, PLACE, LATENCY = 0.05, np.array([1.7, 0.0, 0.0]), 0.2
NO_SLIP = PoseFilterSettings(longitudinal_creep=0.0, lateral_creep=0.0, mean_slip=0.0)
NEVER = FixLoss()
ALWAYS_LOST = FixLoss(interval=1e-3, none_duration=1e6, none_share=1.0)


def test_it_agrees_with_a_filter_that_is_written_apart():
    """Random measurements of ten seconds, fixed, float and without satellites. Differences of fourth order at 1e-3 leave
    1e-12 of a slope of order 1 and 1e-13 of rounding; some hundred steps add up."""
    rng = np.random.default_rng(3)
    antennas = Antennas(main=(1.0, 0.6, 2.2), auxiliary=(0.8, -0.7, 2.3))
    noise, settings = (GpsNoise.typical(), ImuNoise.typical()), PoseFilterSettings()
    ours = PoseFilter(
        1, settings=settings, antennas=antennas, gps_noise=noise[0], imu_noise=noise[1], latency=LATENCY, step=STEP
    )
    floors = EXACT_POSITION, EXACT_HEADING
    theirs = OracleFilter(settings, *noise, antennas, step=STEP, floors=floors)
    attitude, rates = rng.normal(0.0, 0.2, (201, 2)), rng.normal(0.0, 0.3, (201, 3))
    first = GpsReading(*(np.array([each]) for each in ([3.0, -2.0, 2.0], 0.4, 2, 0.0, True)))
    roll, pitch = attitude.T[:, :, None]
    ours.begin(first, roll[0], pitch[0], PLACE, rates=rates[:1], indices=[0])
    theirs.begin(ours.state[0], ours.covariance[0], rates[0], *attitude[0])
    for k in range(1, 201):
        speed, age, quality = rng.uniform(-0.5, 2.0), rng.uniform(LATENCY, LATENCY + STEP), k // 40 % 3
        fresh = quality > 0 and k % 2 == 0
        near = [*(theirs.state[:2] + rng.normal(0.0, 0.3, 2)), 2.0]
        heading = wrapped(theirs.state[2] + rng.normal(0.0, 0.1))
        reading = GpsReading(*(np.array([each]) for each in (near, heading, quality, age, fresh)))
        ours.update(reading, roll[k], pitch[k], PLACE, speed=[speed], rates=rates[k : k + 1])
        way = theirs.move(speed, rates[k], *attitude[k])
        if fresh:
            theirs.take(np.array(near[:2]), float(heading), quality, age, PLACE, way / STEP * age)
        np.testing.assert_allclose(ours.state[0], theirs.state, atol=1e-9)
        np.testing.assert_allclose(ours.covariance[0], theirs.covariance, atol=1e-9)
    np.testing.assert_allclose(ours.position[0], theirs.state[:2], atol=1e-9)
    np.testing.assert_allclose(wrapped(ours.heading[0] - theirs.state[2]), 0.0, atol=1e-9)


@dataclass(frozen=True)
class Drive:
    """T steps of N machines on a slope, in a bend, as a plane curve with a tilted frame; the true motion."""

    pose: Any
    """x, y [m] and heading [rad] of the reference point (T, N, 3)."""
    hinge: Any
    """[m] (T, N, 3)"""
    attitude: Any
    """Roll and pitch [rad] (T, N, 2)."""
    rates: Any
    """[rad/s] in the frame's axes (T, N, 3)."""
    speed: Any
    """By the wheels [m/s] (T, N)."""


def driven(count: int, steps: int, settings: PoseFilterSettings, seed: int) -> Drive:
    """Slip and sideslip wander as ``settings`` say; a path that winds, over ground that heaves."""
    rng = np.random.default_rng(seed)
    slips = Drift(
        [settings.slip_spread, settings.sideslip_spread], time=[settings.slip_time, settings.sideslip_time],
        rate=1.0 / STEP, num_twins=count,
    )  # fmt: skip
    slips.reset(np.arange(count), rng.integers(0, 2**62, (2, count)))
    phase, time = rng.uniform(0.0, 6.0, (3, count)), STEP * np.arange(steps)[:, None]
    roll, pitch = (0.15 * np.sin(f * time + phase[k]) for k, f in enumerate((0.7, 0.5)))
    roll_rate, pitch_rate = (0.15 * f * np.cos(f * time + phase[k]) for k, f in enumerate((0.7, 0.5)))
    turning, speed = 0.2 * np.sin(0.3 * time + phase[2]), 1.5 * np.clip(time / 2.0, 0.0, 1.0) + 0.0 * phase[2]
    pose, heading, xy = [], np.zeros(count), np.zeros((count, 2))
    for k in range(steps):
        if k:
            turn = 0.5 * STEP * (turning[k - 1] + turning[k])
            tilt = 0.5 * (roll[k - 1] + roll[k]), 0.5 * (pitch[k - 1] + pitch[k])
            slip, across = slips.at(slice(None), np.full(count, k)) + np.stack(creep(*tilt, settings, np))
            walked = rng.normal(size=(2, count)) * [[settings.slip_walk], [settings.sideslip_walk]] / math.sqrt(STEP)
            way, middle = STEP * speed[k] * np.cos(tilt[1]), heading + 0.5 * turn
            move = way * (1.0 + settings.mean_slip + slip + walked[0]), way * (across + walked[1])
            xy = xy + np.stack(
                [
                    move[0] * np.cos(middle) - move[1] * np.sin(middle),
                    move[0] * np.sin(middle) + move[1] * np.cos(middle),
                ],
                axis=1,
            )
            heading = heading + turn
        pose.append(np.column_stack([xy, heading]))
    true = np.array(pose)
    # ω in the frame's axes of R_z(ψ) R_y(θ) R_x(φ)
    rates = np.stack(
        [
            roll_rate - turning * np.sin(pitch),
            pitch_rate * np.cos(roll) + turning * np.sin(roll) * np.cos(pitch),
            turning * np.cos(roll) * np.cos(pitch) - pitch_rate * np.sin(roll),
        ],
        axis=-1,
    )
    hinge = np.concatenate([true[..., :2], np.zeros((steps, count, 1))], axis=-1)
    hinge = hinge - in_world(roll, pitch, true[..., 2], PLACE)
    return Drive(true, hinge, np.stack([roll, pitch], axis=-1), rates, speed)


def estimated(
    drive: Drive, settings: PoseFilterSettings, gps_noise: GpsNoise, imu_noise: ImuNoise, latency: float
) -> Any:
    """Poses by the filter, their covariances, and poses by dead reckoning that is pulled by constant gains."""
    steps, count = drive.speed.shape
    gps, imu = Gps(count, gps_noise, latency=latency), Imu(count, imu_noise, accelerometers=False)
    for number, sensor in enumerate((gps, imu)):
        sensor.reset(np.arange(count), np.random.default_rng(number + 1).spawn(count))
    here, there = (
        PoseFilter(count, settings=settings, gps_noise=gps_noise, imu_noise=imu_noise, latency=latency, step=STEP),
        Localisation(count),
    )
    rows, found = np.arange(count), []
    for k in range(steps):
        roll, pitch = drive.attitude[k].T
        shown = imu.measure(drive.rates[k], None, roll, pitch, k * STEP)
        fix = gps.measure(drive.hinge[k], roll, pitch, drive.pose[k, :, 2], k * STEP)
        seen = fix, shown.roll, shown.pitch, PLACE
        if k == 0:
            here.begin(*seen, rates=shown.rates, indices=rows)
            there.begin(*seen, rows)
        else:
            here.update(*seen, speed=drive.speed[k], rates=shown.rates)
            there.update(*seen, speed=drive.speed[k], yaw_rate=shown.rates[:, 2], step=STEP)
        found.append((here.state[:, :3], here.covariance[:, :3, :3], np.column_stack([there.position, there.heading])))
    return tuple(np.array(one) for one in zip(*found, strict=True))


def test_exact_sensors_on_a_slope_give_the_exact_pose():
    """Also of the heading, which the line between the antennas does not show where the frame is tilted both ways."""
    exact = replace(NO_SLIP, slip_spread=0.0, sideslip_spread=0.0, slip_walk=0.0, sideslip_walk=0.0)
    drive = driven(2, 200, exact, seed=1)
    found, _, other = estimated(drive, exact, GpsNoise(), ImuNoise(), latency=LATENCY)
    off, off_other = found - drive.pose, other - drive.pose
    chord = (
        1.5 * STEP**2 / 8.0 * 0.2 * 10.0
    )  # of straight lines between steps, by the receiver's clock and the reckoning
    assert np.abs(off[..., :2]).max() < 2.0 * chord
    assert np.abs(wrapped(off[..., 2])).max() < 2e-3
    assert np.abs(wrapped(off_other[..., 2])).max() > math.atan(math.sin(0.1) * math.tan(0.1))


def test_it_is_as_sure_as_it_should_be():
    """Over independent drives the squared errors in units of the covariance are chi-squared: of 100 drives their mean lies
    within the 99.9 % interval, fixed and after five seconds without satellites, but for what linearising and the latency
    leave, 10 %."""
    settings, count = replace(PoseFilterSettings(), heading_walk=0.0), 100
    drive = driven(count, 161, settings, seed=5)
    for loss, instants in ((NEVER, (80, 160)), (ALWAYS_LOST, (40, 100))):
        found, covariance, _ = estimated(drive, settings, GpsNoise.typical(loss), ImuNoise.typical(), latency=LATENCY)
        for k in instants:
            off = found[k] - drive.pose[k]
            off[:, 2] = wrapped(off[:, 2])
            squared = np.einsum("ni,ni->n", off, np.linalg.solve(covariance[k], off[..., None])[..., 0])
            low, high = chi2.ppf([0.0005, 0.9995], 3 * count) / count
            assert 0.9 * low < squared.mean() < 1.1 * high, (loss, k)


def test_without_satellites_it_drifts_by_less_than_half():
    """Some nine seconds in a winding bend on a slope that heaves."""
    drive = driven(50, 200, PoseFilterSettings(), seed=9)
    noise = GpsNoise.typical(FixLoss(interval=0.5, none_duration=1e6, none_share=1.0))
    found, _, other = estimated(drive, PoseFilterSettings(), noise, ImuNoise.typical(), latency=LATENCY)
    rms = [np.sqrt(np.mean(np.sum((each[-1] - drive.pose[-1])[:, :2] ** 2, axis=1))) for each in (found, other)]
    assert rms[0] < 0.5 * rms[1]


def test_the_heading_turns_by_euler_kinematics():
    """Against the difference of angles that turn at constant rates."""
    roll, pitch, rates = 0.3, -0.2, np.array([[0.1, -0.4, 0.5]])
    short = 1e-6
    x = in_world([roll], [pitch], [0.0], np.array([1.0, 0.0, 0.0]))[0]
    omega = in_world([roll], [pitch], [0.0], rates[0])[0]
    turned = x + short * np.cross(omega, x)
    angle = (math.atan2(turned[1], turned[0]) - math.atan2(x[1], x[0])) / short
    assert heading_rate(rates, np.array([roll]), np.array([pitch]))[0, 0] == pytest.approx(angle, rel=1e-5)


def test_tires_creep_the_more_the_less_friction_is_left():
    settings = PoseFilterSettings(longitudinal_creep=0.1, lateral_creep=0.05, friction=0.5)
    slip, sideslip = creep(np.zeros(3), np.arctan([-0.1, 0.25, 5.0]), settings, np)
    np.testing.assert_allclose(slip, [-0.1 * 0.1 / 0.8, 0.1 * 0.25 / 0.5, 0.1 * 5.0 / 0.2])
    np.testing.assert_array_equal(sideslip, 0.0)
    assert creep(np.arctan([0.1]), np.zeros(1), settings, np)[1] == pytest.approx(-0.05 * 0.1 / 0.8)


def test_wrong_values_are_named():
    for name, value in (("friction", 0.0), ("slip_time", 0.0), ("lateral_creep", -0.1), ("mean_slip", 0.9)):
        with pytest.raises(ValueError, match=name):
            PoseFilterSettings(**{name: value})
    with pytest.raises(ValueError, match=r"step is 0\.5 s"):
        PoseFilter(step=0.5)
    with pytest.raises(ValueError, match="latency is -1"):
        PoseFilter(latency=-1.0)
