"""Deadlines, and how late steps were."""

import os
import random
import time

import numpy as np
import pytest

from aoro_gym.cosimulation import realtime
from aoro_gym.cosimulation.realtime import Lateness, NotPermitted, Schedule, request_realtime


def test_percentiles_are_those_of_the_values():
    rng = random.Random(0)
    values = [rng.expovariate(1.0 / 2e-3) for _ in range(5000)]
    lateness = Lateness()
    for value in values:
        lateness.add(value)
    for percent in (50.0, 90.0, 99.0, 99.9):
        exact = float(np.percentile(values, percent, method="inverted_cdf"))
        assert exact <= 1.000001 * lateness.percentile(percent) <= 1.000001**2 * realtime.GROWTH * exact
    assert lateness.worst == max(values) == lateness.percentile(100.0)


def test_early_and_very_late_ones_count():
    lateness = Lateness()
    for value in (-1.0, 70.0):
        lateness.add(value)
    assert lateness.percentile(50.0) <= realtime.LEAST and lateness.percentile(99.0) == 70.0
    assert Lateness().percentile(50.0) == 0.0


@pytest.mark.parametrize("spin", [False, True])
def test_deadlines_are_absolute(spin):
    """A step that took long is made up for: the twentieth release comes when it was due, or later by one wake-up."""
    schedule = Schedule(0.01, spin=spin)
    began = time.monotonic()
    for number in range(20):
        now = schedule.wait()
        assert now - began >= 0.01 * (number + 1) - 1e-3
        if number == 5:
            time.sleep(0.035)
        schedule.done()
    late = schedule.starts.worst
    assert time.monotonic() - began <= 0.2 + 2.0 * late + 0.05
    assert (schedule.missed >= 3 and schedule.resynchronised == 0) or late > 0.9
    found = schedule.to_json()
    assert found["steps"] == 20 and found["missed_share"] == schedule.missed / 20


def test_after_a_long_stop_the_clock_is_set_anew(monkeypatch):
    monkeypatch.setattr(realtime, "RESYNCHRONISE", 0.05)
    schedule = Schedule(0.001)
    schedule.wait()
    time.sleep(0.1)
    schedule.wait()
    assert schedule.resynchronised == 1


def test_what_is_not_permitted_says_what_to_do(monkeypatch):
    def refused(*_):
        raise PermissionError(1, "Operation not permitted")

    monkeypatch.setattr(os, "sched_setscheduler", refused)
    monkeypatch.setattr(
        realtime.ctypes,
        "CDLL",
        lambda *_, **__: type("C", (), {"mlockall": lambda *_: 0, "munlockall": lambda *_: 0})(),
    )
    with pytest.raises(NotPermitted, match=r"FIFO priority 50 is refused.*CAP_SYS_NICE"):
        request_realtime(50)
    monkeypatch.setattr(realtime.ctypes, "CDLL", lambda *_, **__: type("C", (), {"mlockall": lambda *_: -1})())
    with pytest.raises(NotPermitted, match=r"memory cannot be locked.*ulimit -l"):
        request_realtime(50)
    with pytest.raises(ValueError, match="priority is 100"):
        request_realtime(100)
