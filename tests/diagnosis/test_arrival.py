"""Arrival at a stop: found in known traces, and fronts of pressures read on another one's clock."""

import numpy as np
import pytest

from aoro_gym.diagnosis.arrival import AFTER, AHEAD, BEFORE_END, NEAR, NEVER, TRAVEL, arrivals, bounce, on_clock

COUNT = 400
BEGIN, END = 60, 340
"""First and last commanded tick."""
TIME = np.arange(COUNT)
STOP = 0.5
RATE = 0.004
"""Of the joint [rad a sample]."""


def command(*pieces: tuple[int, int, float]) -> np.ndarray:
    """Signals (COUNT − 1,) by their first and last tick."""
    steering = np.zeros(COUNT - 1)
    for first, last, level in pieces:
        steering[first : last + 1] = level
    return steering


LEFT = command((BEGIN, END, 1.0))


def ramp(reaches: int, bounce: float = 0.0) -> np.ndarray:
    """A joint that comes to its stop at the sample ``reaches`` at :data:`RATE`, and bounces off by ``bounce`` [rad]."""
    since = TIME - reaches
    back = bounce * np.exp(-since.clip(0) / 15.0) * np.abs(np.sin(np.pi * since.clip(0) / 20.0))
    return STOP + RATE * np.minimum(since, 0).clip(BEGIN - reaches) - back


@pytest.mark.parametrize("bounce", [0.0, np.radians(3.0)])
def test_a_joint_arrives_when_it_first_is_near_its_stop(bounce):
    """NEAR before the stop on its way, whether it bounces off again or not."""
    reaches = np.array([150, 200, 260])
    found = arrivals(np.stack([ramp(r, bounce) for r in reaches], axis=1), LEFT)
    left = bounce * np.exp(-(END - max(reaches)) / 15.0) / RATE  # of the bounce where the angle counts as final
    np.testing.assert_allclose(found, reaches - NEAR / RATE, atol=1e-9 + left)


def test_the_instant_moves_with_the_joint_between_samples():
    """A slope that is taken by moving a parameter a little would else be zero, or of a whole sample."""
    late = np.array([0.0, 0.3, 0.5, 0.9])
    angle = STOP + RATE * np.minimum(TIME[:, None] - 200.0 - late, 0.0).clip(BEGIN - 200)
    np.testing.assert_allclose(arrivals(angle, LEFT) - arrivals(angle[:, :1], LEFT), late, atol=0.05)


def test_either_side():
    np.testing.assert_array_equal(arrivals(-ramp(200)[:, None], -LEFT), arrivals(ramp(200)[:, None], LEFT))


def test_a_joint_that_its_command_alone_stops_arrives_nowhere():
    """On its way when the command ends, and a little later still, or at rest at once; one that comes to its stop well
    before does arrive."""
    coasts, stops = (RATE * (TIME - BEGIN).clip(0, END + after - BEGIN) for after in (15, 0))
    early = ramp(END - BEFORE_END - 2)
    found = arrivals(np.stack([coasts, stops, early], axis=1), LEFT)
    np.testing.assert_array_equal(found == NEVER, [True, True, False])


@pytest.mark.parametrize(
    ("angle", "steering"),
    [
        (ramp(200), command()),
        (ramp(200), command((BEGIN, BEGIN + BEFORE_END, 1.0))),
        (np.where(TIME > 150, 0.9 * TRAVEL, 0.0), LEFT),
    ],
    ids=["no command", "short command", "little travel"],
)
def test_what_is_no_arrival(angle, steering):
    assert arrivals(angle[:, None], steering)[0] == NEVER


def test_the_last_piece_of_a_command_counts():
    """To the left stop, then back without reaching any; and to the stop in two steps, within the second."""
    there_and_back = ramp(150) - RATE * (TIME - 230).clip(0, END + 15 - 230)
    steering = command((BEGIN, 220, 1.0), (221, END, -1.0))
    assert arrivals(there_and_back[:, None], steering)[0] == NEVER
    steps = command((BEGIN, 140, 0.5), (141, END, 1.0))
    assert arrivals(ramp(200)[:, None], steps)[0] == pytest.approx(200 - NEAR / RATE)
    assert arrivals(ramp(120)[:, None], steps)[0] == NEVER  # arrived in the first


def front(arrival: int) -> np.ndarray:
    """A pressure: steady on the way, a jump with ripples that die out on arrival, then steady."""
    since = TIME - arrival
    ripple = np.where((since >= 0) & (since < AFTER), 3.0 * np.sin(0.7 * since) * (1.0 - since / AFTER), 0.0)
    return np.where(since < 0, 10.0, 20.0 + ripple)


MEASURED = 200


@pytest.mark.parametrize("own", [MEASURED - 40, MEASURED - 1, MEASURED, MEASURED + 1, MEASURED + 40])
def test_a_front_that_comes_at_another_time_is_the_same_front(own):
    found = on_clock(front(own)[:, None], np.array([own]), MEASURED, LEFT)[:, 0]
    np.testing.assert_array_equal(found, front(MEASURED))


def test_the_way_to_the_stop_is_read_as_it_is():
    """Up to the measured arrival by the log's clock; one that arrives early is held at its last value before."""
    own = np.array([MEASURED - 40, MEASURED + 40])
    found = on_clock(np.stack([TIME, TIME], axis=1).astype(float), own, MEASURED, LEFT)
    until = MEASURED - AHEAD
    np.testing.assert_array_equal(found[:until, 0], np.minimum(TIME[:until], own[0] - AHEAD))
    np.testing.assert_array_equal(found[:until, 1], TIME[:until])


def test_commands_act_by_the_clock_of_the_log():
    """What the end of the command does is seen when it ends, whenever the joint arrived."""
    drop = np.where(TIME > END, -5.0, 0.0)
    for own in (MEASURED - 40, MEASURED + 40):
        found = on_clock((front(own) + drop)[:, None], np.array([own]), MEASURED, LEFT)[:, 0]
        np.testing.assert_array_equal(found, front(MEASURED) + drop)


def test_what_comes_shortly_before_the_command_ends_is_read_until_then():
    """The bounce is cut off by the end of the command, which acts at its own time."""
    measured, own = END - 20, END - 30
    drop = np.where(TIME > END, -5.0, 0.0)
    found = on_clock((front(own) + drop)[:, None], np.array([own]), measured, LEFT)[:, 0]
    until = END - AHEAD
    np.testing.assert_array_equal(found[:until], front(measured)[:until])
    assert np.all(found[END + 1 :] < 20.0) and np.all(found[until : END + 1] > 16.0)


def test_who_does_not_arrive_is_held():
    """A prediction where only the measurement arrives, from there on; one that arrives alone, from its own arrival on."""
    values = np.stack([TIME, TIME], axis=1).astype(float)
    found = on_clock(values, np.array([NEVER, MEASURED]), MEASURED, LEFT)
    np.testing.assert_array_equal(found[:, 0], np.minimum(TIME, MEASURED - AHEAD))
    np.testing.assert_array_equal(found[:, 1], TIME)
    alone = on_clock(values, np.array([NEVER, 150]), NEVER, LEFT)
    np.testing.assert_array_equal(alone[:, 0], TIME)
    np.testing.assert_array_equal(alone[:, 1], np.minimum(TIME, 150 - AHEAD))


def test_a_joint_that_arrives_early_goes_on_as_it_came():
    """Until the measured arrival, or the end of the command where there is none, at the rate that it came with; what
    arrives late or nowhere is as it is."""
    angles = np.stack([ramp(150), ramp(240), np.minimum(ramp(200), 0.3)], axis=1)
    own = arrivals(angles, LEFT) * [1, 1, 0] + [0, 0, NEVER]
    found = on_clock(angles, own, MEASURED, LEFT, goes_on=True)
    until = MEASURED - AHEAD
    free = STOP + RATE * (np.maximum(TIME, BEGIN) - 150)
    np.testing.assert_allclose(found[:until, 0], free[:until], atol=1e-12)
    np.testing.assert_array_equal(found[:until, 1], angles[:until, 1])
    np.testing.assert_array_equal(found[until:], on_clock(angles, own, MEASURED, LEFT)[until:])
    alone = on_clock(angles, own, NEVER, LEFT, goes_on=True)
    np.testing.assert_allclose(alone[:, 0], np.minimum(free, free[END]), atol=1e-12)
    np.testing.assert_array_equal(alone[:, 2], angles[:, 2])


@pytest.mark.parametrize(
    ("arrival", "first", "last"), [(100, 100 - AHEAD, 100 + AFTER - 1), (1, 0, AFTER), (NEVER, None, None)]
)
def test_the_bounce_begins_ahead_of_the_stop(arrival, first, last):
    """From the first sample on at the earliest; of a joint that never arrives there is none."""
    found = np.arange(200)[bounce(arrival)]
    assert (found[0], found[-1]) == (first, last) if found.size else first is None
