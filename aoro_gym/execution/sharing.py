"""Jobs that several devices of one process share, a thread each.

While a device computes, or the host waits for it, Python runs the other threads; so devices work at once as long as a job is
more of theirs than of Python's.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import FIRST_EXCEPTION, ThreadPoolExecutor, wait
from threading import Event, Lock
from typing import Any, TypeVar

Place = TypeVar("Place")
Job = TypeVar("Job")
Result = TypeVar("Result")
Tell = Callable[[str, float], Any]
"""Takes what is done and the share of it that is done."""


class _Stopped(Exception):
    """Another job has failed, or the user has ended all."""


def shared_out(
    work: Callable[[Place, Job, Tell], Result], places: Sequence[Place], jobs: Sequence[Job], tell: Tell
) -> list[Result]:
    """What ``work(place, job, tell)`` gives for each of ``jobs``, in their order.

    Each place does one job at a time, in a thread of its own, and takes the next one that waits. One place does them here.

    Args:
        work: Does a job. It ends where ``tell`` raises, as it does once another job has failed.
        places: Such as devices, with what they keep.
        jobs: Of about equal size.
        tell: Called by one thread at a time, with what a job tells and the share of all jobs that is done.
    """
    shares, lock, ended = [0.0] * len(jobs), Lock(), Event()

    def telling(number: int) -> Tell:
        def told(what: str, share: float) -> None:
            with lock:
                if ended.is_set():
                    raise _Stopped
                shares[number] = share
                tell(what, sum(shares) / len(jobs))

        return told

    if len(places) == 1:
        return [work(places[0], job, telling(number)) for number, job in enumerate(jobs)]
    results: list[Any] = [None] * len(jobs)
    waiting = iter(enumerate(jobs))

    def serve(place: Place) -> None:
        while not ended.is_set():
            with lock:
                number, job = next(waiting, (None, None))
            if number is None or job is None:
                return
            results[number] = work(place, job, telling(number))

    with ThreadPoolExecutor(len(places), thread_name_prefix="device") as pool:
        serving = [pool.submit(serve, place) for place in places]
        try:
            wait(serving, return_when=FIRST_EXCEPTION)
        finally:  # Ctrl-C, too, ends the others with what they tell next
            ended.set()
    for fault in (one.exception() for one in serving):
        if fault is not None and not isinstance(fault, _Stopped):
            raise fault
    return results
