"""Jobs shared by places: all are done once, in order, at once, and end together."""

import threading

import pytest

from aoro_gym.execution.sharing import shared_out


def nothing(what, share):
    pass


@pytest.mark.parametrize("places", [["a"], ["a", "b", "c"]])
def test_results_are_in_the_order_of_the_jobs(places):
    assert shared_out(lambda place, job, tell: job * job, places, range(7), nothing) == [k * k for k in range(7)]


def test_places_work_at_once():
    """Each waits until the other has begun."""
    met = threading.Barrier(2, timeout=20.0)

    def work(place, job, tell):
        met.wait()
        return place

    assert sorted(shared_out(work, ["a", "b"], [0, 1], nothing)) == ["a", "b"]


def test_shares_add_up():
    told: list[tuple[str, float]] = []

    def work(place, job, tell):
        tell(f"{job}", 0.5)
        tell(f"{job}", 1.0)

    shared_out(work, ["a", "b"], range(4), lambda what, share: told.append((what, share)))
    shares = [share for _, share in told]
    assert shares == sorted(shares) and shares[-1] == 1.0 and {what for what, _ in told} == set("0123")


@pytest.mark.parametrize("fault", [ValueError, KeyboardInterrupt])
def test_a_fault_ends_the_others_with_what_they_tell_next(fault):
    begun = threading.Event()

    def work(place, job, tell):
        if job == 0:
            begun.wait(20.0)
            raise fault("job 0")
        begun.set()
        while True:  # until it tells in vain
            tell("1", 0.5)

    with pytest.raises(fault, match="job 0"):
        shared_out(work, ["a", "b"], [0, 1], nothing)
