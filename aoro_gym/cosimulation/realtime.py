"""Steps at absolute deadlines of the monotonic clock, and how late they were.

An ordinary scheduler promises nothing: on a loaded machine it wakes a process milliseconds late. :func:`request_realtime`
asks for what Linux has against that. What it brings here and now is measured, never promised.
"""

from __future__ import annotations

import ctypes
import gc
import math
import os
import time
from dataclasses import dataclass, field
from typing import Any

from aoro_gym.checks import check_integer, check_range

LEAST, GROWTH, BINS = 1e-6, 1.01, 1650
"""Of the histogram of lateness: end of the first bin [s]; each of the others is so many times as long as the one before, so
that percentiles are exact to 1 %; their number, which reaches to 13 s."""
PERCENTILES = (50.0, 90.0, 99.0, 99.9, 99.99)
SPIN = 300e-6
"""Time [s] before a deadline from which a spinning wait spins. Not all of the step: Linux takes 5 % of the time from a
thread of FIFO priority that never sleeps (``sched_rt_runtime_us``), in one piece."""
RESYNCHRONISE = 1.0
"""Lateness [s] from which the clock is set anew rather than caught up with: the process was stopped, or the computer
slept."""
TIMER_SLACK = 1
"""[ns] by which the kernel may round wake-ups; 50 µs is its default."""
_GROWTH = math.log(GROWTH)
_PR_SET_TIMERSLACK, _MCL_CURRENT, _MCL_FUTURE = 29, 1, 2


@dataclass
class Lateness:
    """Distribution of times after deadlines, in memory of a fixed size."""

    counts: list[int] = field(default_factory=lambda: [0] * BINS)
    """By bins."""
    total: int = 0
    worst: float = 0.0
    """[s]"""

    def add(self, seconds: float) -> None:
        """One more; what is before its deadline counts as 0."""
        place = 0 if seconds <= LEAST else min(math.ceil(math.log(seconds / LEAST) / _GROWTH), BINS - 1)
        self.counts[place] += 1
        self.total += 1
        self.worst = max(self.worst, seconds)

    def percentile(self, percent: float) -> float:
        """Lateness [s] that ``percent`` of all do not exceed, up to the end of its bin; at most the worst."""
        wanted, seen = percent / 100.0 * self.total, 0
        for place, count in enumerate(self.counts[:-1]):
            seen += count
            if seen >= wanted and seen:
                return min(LEAST * GROWTH**place, self.worst)
        return self.worst

    def to_json(self) -> dict[str, float]:
        """Percentiles in microseconds, and the worst."""
        return {
            **{f"p{percent:g}_us": round(1e6 * self.percentile(percent), 1) for percent in PERCENTILES},
            "worst_us": round(1e6 * self.worst, 1),
        }


class Schedule:
    """Deadlines ``step`` [s] apart, by the monotonic clock.

    Args:
        step: Time between two releases [s].
        spin: Wait for a release with the processor running, for the last ``SPIN``.
    """

    def __init__(self, step: float, *, spin: bool = False):
        check_range("step", step, "s", gt=0.0, le=1.0)
        self.spin = spin
        self._step = round(step * 1e9)
        self.starts, self.ends = Lateness(), Lateness()
        """How long after its release a step began; how long after the next one it ended."""
        self.missed = 0
        """Steps that were not done at the next release."""
        self.resynchronised = 0
        """Times that the clock was set anew."""
        self.worst_since = 0.0
        """Latest end of a step since this was set to 0 [s]."""
        self._release = time.monotonic_ns()

    def wait(self) -> float:
        """Wait for the next release; time [s] of the monotonic clock."""
        self._release += self._step
        now = time.monotonic_ns()
        if now - self._release > RESYNCHRONISE * 1e9:
            self._release, self.resynchronised = now, self.resynchronised + 1
        left = self._release - now - (int(SPIN * 1e9) if self.spin else 0)
        if left > 0:
            time.sleep(left * 1e-9)  # to an absolute time, by CPython
        now = time.monotonic_ns()
        while self.spin and now < self._release:
            now = time.monotonic_ns()
        self.starts.add((now - self._release) * 1e-9)
        return now * 1e-9

    def done(self) -> None:
        """The step is done."""
        late = (time.monotonic_ns() - self._release - self._step) * 1e-9
        self.ends.add(late)
        self.missed += late > 0.0
        self.worst_since = max(self.worst_since, late)

    def to_json(self) -> dict[str, Any]:
        """What was measured."""
        total = max(self.ends.total, 1)
        return {
            "step_us": self._step * 1e-3,
            "steps": self.ends.total,
            "missed_deadlines": self.missed,
            "missed_share": self.missed / total,
            "start_lateness": self.starts.to_json(),
            "end_lateness": self.ends.to_json(),
            "resynchronised": self.resynchronised,
        }


class NotPermitted(ValueError):
    """The system does not grant what was asked for."""


def request_realtime(priority: int) -> None:
    """First-in-first-out scheduling at ``priority`` (1 to 99) and locked memory for this process.

    Raises :class:`NotPermitted` with what to do if the system refuses.
    """
    check_integer("priority", priority, ge=1, le=99)
    if not hasattr(os, "sched_setscheduler"):
        raise NotPermitted("FIFO priority needs Linux")
    library = ctypes.CDLL(None, use_errno=True)
    if library.mlockall(_MCL_CURRENT | _MCL_FUTURE):
        raise NotPermitted(
            f"memory cannot be locked ({os.strerror(ctypes.get_errno())}): raise `ulimit -l`, or grant the capability"
            " CAP_IPC_LOCK; or do without FIFO priority"
        )
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(priority))
    except OSError as error:
        library.munlockall()
        raise NotPermitted(
            f"FIFO priority {priority} is refused ({error.strerror}): raise `ulimit -r`, or grant the capability"
            " CAP_SYS_NICE; or do without FIFO priority"
        ) from None


def settle() -> None:
    """Before a loop of steps: let timers be exact, and the garbage collector not look again at what is there."""
    if hasattr(os, "sched_setscheduler"):
        ctypes.CDLL(None).prctl(_PR_SET_TIMERSLACK, TIMER_SLACK, 0, 0, 0)
    gc.collect()
    gc.freeze()


def resident_memory() -> int:
    """Bytes of memory of this process that are resident; 0 where the system does not tell."""
    try:
        with open("/proc/self/statm", encoding="ascii") as file:
            return int(file.read().split()[1]) * os.sysconf("SC_PAGE_SIZE")
    except OSError:
        return 0
