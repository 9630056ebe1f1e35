"""A reset of one twin, and a measurement of some, leave the others' memory as it is: delays, low-passes, clocks."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from aoro_gym.sensors import (
    FixLoss,
    Gps,
    GpsNoise,
    Imu,
    JointAngleSensor,
    PressureSensor,
    WheelSpeedSensor,
)

N, STEP = 3, 0.05
Ask = Callable[[Any, Any, Any, Any], np.ndarray]


def gps(sensor, motion, time, rows):
    zero = np.zeros(len(motion))
    position = np.stack([motion, zero, zero], axis=1)
    reading = sensor.measure(position, 0.1 * motion, 0.0 * motion, motion, time, rows)
    return np.column_stack([reading.position, reading.heading, reading.quality, reading.age])


def imu(sensor, motion, time, rows):
    three = np.repeat(motion[:, None], 3, axis=1)
    reading = sensor.measure(three, three, motion, motion, time, rows)
    return np.column_stack([reading.rates, reading.force, reading.roll, reading.pitch])


SENSORS: dict[str, tuple[Callable[[], Any], Ask]] = {
    "joint angle": (
        lambda: JointAngleSensor(N, delay=0.08, cutoff=2.0, interval=STEP),
        lambda s, m, t, rows: s.measure(m, t, rows)[:, None],
    ),
    "pressure": (lambda: PressureSensor(N), lambda s, m, t, rows: s.measure(1e7 * m, t, rows)[:, None]),
    "gps": (lambda: Gps(N, GpsNoise.typical(FixLoss(interval=0.5))), gps),
    "imu": (lambda: Imu(N), imu),
    "wheel speed": (
        lambda: WheelSpeedSensor(N),
        lambda s, m, t, rows: s.measure(np.repeat(m[:, None], 4, axis=1), t, rows),
    ),
}


@pytest.mark.parametrize("name", SENSORS)
def test_neighbours_notice_nothing(name):
    make, ask = SENSORS[name]
    motion = np.sin(np.arange(80)[:, None] * STEP * np.array([1.0, 2.0, 3.0]))

    def run(disturbed):
        sensor = make()
        sensor.reset(np.arange(N), np.random.default_rng(4).spawn(N))
        shown = []
        for k, values in enumerate(motion):
            times = np.full(N, k * STEP)
            if disturbed and k >= 40:
                times[1] -= 40 * STEP
            if disturbed and k == 40:
                sensor.reset([1], [np.random.default_rng(99)])
                ask(sensor, values[[1]], 0.0, np.array([1]))  # the first measurement of the new episode
            elif disturbed and k > 40 and k % 2:
                ask(sensor, values[[1]], times[[1]], np.array([1]))
            shown.append(ask(sensor, values, times, None))
        return np.array(shown)

    alone, beside = run(False), run(True)
    np.testing.assert_array_equal(beside[:, [0, 2]], alone[:, [0, 2]])
    np.testing.assert_array_equal(beside[:40, 1], alone[:40, 1])
    assert np.any(beside[41:, 1] != alone[41:, 1])


@pytest.mark.parametrize("name", SENSORS)
def test_a_new_run_begins_as_a_new_sensor_does(name):
    make, ask = SENSORS[name]

    def run(sensor):
        sensor.reset([2], [np.random.default_rng(7)])
        return np.array([ask(sensor, np.array([0.3 * k]), k * STEP, np.array([2])) for k in range(30)])

    used = make()
    for k in range(50):
        ask(used, np.full(N, 5.0 - k), k * STEP, None)
    np.testing.assert_array_equal(run(used), run(make()))


@pytest.mark.parametrize("name", SENSORS)
def test_rows_together_are_rows_alone(name):
    make, ask = SENSORS[name]
    generators = np.random.default_rng(3).spawn(N)
    together, alone = make(), make()
    together.reset(np.arange(N), np.random.default_rng(3).spawn(N))
    alone.reset([1], generators[1:2])
    for k in range(40):
        values = 0.1 * k * np.array([1.0, -1.0, 0.5])
        one = ask(alone, values[[1]], k * STEP, np.array([1]))
        np.testing.assert_array_equal(ask(together, values, k * STEP, None)[[1]], one)


@pytest.mark.parametrize("name", SENSORS)
def test_wrong_rows_are_named(name):
    make, ask = SENSORS[name]
    sensor = make()
    with pytest.raises(ValueError, match=r"indices\[0\] is 3, but must be in \[0, 2\]"):
        ask(sensor, np.zeros(1), 0.0, np.array([3]))
    with pytest.raises(ValueError, match="name twin 1 twice"):
        ask(sensor, np.zeros(2), 0.0, np.array([1, 1]))
    with pytest.raises(ValueError, match="2 generators for 1 twins"):
        sensor.reset([0], np.random.default_rng(0).spawn(2))
