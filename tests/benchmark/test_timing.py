"""What is counted is what was done, and nothing else is timed."""

import time

import pytest

from aoro_gym.benchmark import timing
from aoro_gym.benchmark.scene import EPISODE
from aoro_gym.benchmark.timing import RUNS, Subject, computer, measure


class Clock:
    """A wall clock that runs twice as fast as the processor's, and subjects that take a known time."""

    def __init__(self, monkeypatch):
        self.now = 0.0
        self.calls: list[tuple[str, int]] = []
        monkeypatch.setattr(time, "perf_counter", lambda: self.now)
        monkeypatch.setattr(time, "process_time", lambda: 0.5 * self.now)

    def subject(self, name: str, a_step: float, device: str = "cpu") -> Subject:
        def restart() -> None:
            self.now += 100.0  # must not be seen
            self.calls.append((name, 0))

        def advance(steps: int) -> None:
            self.now += steps * a_step
            self.calls.append((name, steps))

        description = {"what": name, "device": device}
        return Subject(description, 8, 20, 1e-3, restart, advance, lambda: {"sound": True})


@pytest.fixture
def clock(monkeypatch) -> Clock:
    return Clock(monkeypatch)


def test_rates(clock):
    slow, fast = measure([clock.subject("slow", 0.05), clock.subject("fast", 0.001, "cuda:0")], seconds=10.0)
    assert slow["steps_per_s"] == slow["min"] == slow["max"] == pytest.approx(8 * 20 / 0.05)
    assert slow["steps_per_core_s"] == pytest.approx(2.0 * slow["steps_per_s"])
    assert slow["real_time_factor"] == pytest.approx(20 * 1e-3 / 0.05)
    assert fast["steps_per_s"] == pytest.approx(8 * 20 / 0.001)
    assert "steps_per_core_s" not in fast
    assert slow["sound"] and fast["sound"]
    for row, a_step in ((slow, 0.05), (fast, 0.001)):
        assert row["steps_per_run"] / row["steps_per_s"] == pytest.approx(10.0 / RUNS, abs=a_step)


def test_rounds_over_all(clock):
    seen = []
    measure(
        [clock.subject("a", 0.1), clock.subject("b", 0.1)],
        seconds=5.0,
        progress=lambda what, share: seen.append((what, share)),
    )
    last = [name for name, steps in clock.calls if steps][-2 * RUNS :]
    assert last == ["a", "b"] * RUNS
    assert [share for _, share in seen] == pytest.approx([i / len(seen) for i in range(1, len(seen) + 1)])
    assert seen[-1] == ("8 x b", 1.0)


def test_an_interrupted_run_keeps_what_it_has(clock):
    kept = []

    def save(rows):
        kept.append([(row["what"], row["runs"]) for row in rows])
        if len(kept) == 4:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        measure([clock.subject(name, 0.1) for name in "abc"], seconds=5.0, save=save)
    assert kept == [[("a", 1)], [("a", 1), ("b", 1)], [("a", 1), ("b", 1), ("c", 1)], [("a", 2), ("b", 1), ("c", 1)]]


def test_nobody_drives_longer_than_an_episode(clock):
    timing.measure([clock.subject("a", 0.001)], seconds=10.0)
    assert max(steps for _, steps in clock.calls) == EPISODE
    for before, after in zip(clock.calls[::2], clock.calls[1::2], strict=True):
        assert before[1] == 0 < after[1]  # each stretch begins with a restart


def test_the_computer_is_named():
    on = computer("cpu")
    assert on["cores"] >= 1
    assert on["device"] == on["cpu"] != ""
