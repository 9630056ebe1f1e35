"""The share that is done only grows, and ends at one."""

import pytest

from aoro_gym.calibration.progress import Work


def test_the_share_is_that_of_the_expected_work():
    told = []
    work = Work(lambda sentence, share: told.append((sentence, share)), {"a": 10.0, "b": 30.0})
    work.begin("a", "first")
    for _ in range(4):
        work.did(2.0)
    assert told[-1] == ("first", pytest.approx(0.25 * 0.8))
    work.begin("b", "second")
    work.did(6.0)
    assert told[-1] == ("second", pytest.approx(0.2 + 0.8 * 6.0 / 30.0))
    work.end()
    assert told[-1] == ("done", 1.0)


def test_more_work_than_expected_slows_the_share_and_less_makes_it_jump_never_fall():
    shares = []
    work = Work(lambda sentence, share: shares.append(share), {"a": 1.0, "b": 1.0, "c": 1.0, "d": 1.0})
    work.begin("a", "ten times as long as expected")
    for _ in range(100):
        work.did(0.1)
    assert 0.24 < shares[-1] <= 0.25
    work.begin("c", "b was done before")
    assert shares[-1] <= 0.25
    work.expect({"d": 9.0})
    work.did(0.8)
    work.begin("d", "most of it")
    work.did(4.5)
    work.begin("unannounced", "takes no share")
    work.did(5.0)
    work.end()
    assert shares == sorted(shares) and shares[-1] == 1.0
