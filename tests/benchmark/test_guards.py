"""Guards pass and fail by the ratio of two rates, and say what they compared."""

from functools import partial

import pytest

from aoro_gym.benchmark import guards
from aoro_gym.benchmark.guards import Guard, check
from aoro_gym.benchmark.timing import Subject
from tests.cli.calling import call


def paced(a_step: float, clock: list[float], machine) -> Subject:
    def advance(steps: int) -> None:
        clock[0] += a_step * steps

    return Subject({"what": "twin", "device": "cpu"}, 1, 1, 1e-3, lambda: None, advance, dict)


@pytest.fixture
def clock(monkeypatch):
    now = [0.0]
    for name in ("perf_counter", "process_time"):
        monkeypatch.setattr(f"time.{name}", lambda: now[0])
    return now


@pytest.mark.parametrize(("least", "passes"), [(2.9, True), (3.1, False)])
def test_a_ratio_is_held_against_its_least(clock, monkeypatch, machine, least, passes):
    one = Guard("fast over slow", partial(paced, 0.01, clock), partial(paced, 0.03, clock), least)
    monkeypatch.setattr(guards, "guards", lambda device: [one])
    told: list[float] = []
    (row,) = check("cpu", machine, seconds=1.0, progress=lambda _, share: told.append(share))["guards"]
    assert row == {"name": "fast over slow", "ratio": pytest.approx(3.0), "least": least, "passes": passes}
    assert told == sorted(told) and told[-1] == 1.0


def test_the_command_fails_with_its_guards(monkeypatch):
    row = {"name": "fast over slow", "ratio": 1.5, "least": 2.0, "passes": False}
    found = {"machine": {"device": "a core", "cores": 2}, "guards": [row]}
    monkeypatch.setattr(guards, "check", lambda *arguments, **others: found)
    shown = call("bench", "--check")
    assert shown.exit_code == 1 and "fast over slow" in shown.stdout and "fails" in shown.stdout
    row |= {"ratio": 2.5, "passes": True}
    assert call("bench", "--check").exit_code == 0


def test_what_cannot_be_measured_is_left_out(monkeypatch):
    monkeypatch.setattr(guards, "_compiles", lambda: False)
    monkeypatch.setattr(guards, "find_spec", lambda name: None)
    assert [one.name for one in guards.guards("cpu")] == ["a step of an environment in kernels over array operations"]
