"""Guards pass and fail by the ratio of two rates, and say what they compared."""

from functools import partial
from inspect import signature
from types import SimpleNamespace
from typing import Any

import pytest

from aoro_gym.benchmark import guards
from aoro_gym.benchmark.environments import environments
from aoro_gym.benchmark.guards import Guard, check
from aoro_gym.benchmark.report import guard_table
from aoro_gym.benchmark.timing import Subject, measure
from aoro_gym.benchmark.twins import twins
from aoro_gym.execution.device_names import ALL_GPUS
from aoro_gym.machine import Machine
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
    found = {"machine": {"device": "a core", "cores": 2}, "guards": [row], "left_out": []}
    monkeypatch.setattr(guards, "check", lambda *arguments, **others: found)
    shown = call("bench", "--check")
    assert shown.exit_code == 1 and "fast over slow" in shown.stdout and "fails" in shown.stdout
    row |= {"ratio": 2.5, "passes": True}
    assert call("bench", "--check").exit_code == 0


def test_one_that_cannot_be_measured_stops_no_other(clock, monkeypatch, machine):
    def full(machine):
        raise RuntimeError("out of\n memory")

    pace = partial(paced, 0.01, clock)
    known = [
        Guard("too large over slow", full, pace, 2.0),
        Guard("fast over slow", pace, pace, 1.0),
        Guard("of another engine", pace, pace, 1.0, "engine (pip install engine)"),
    ]
    monkeypatch.setattr(guards, "guards", lambda device: known)
    found = check("cpu", machine, seconds=1.0)
    failed, measured = found["guards"]
    assert failed["error"] == "out of memory" and failed["ratio"] is None and not failed["passes"]
    assert measured["passes"] and "error" not in measured
    assert found["left_out"] == [{"name": "of another engine", "lacks": "engine (pip install engine)"}]
    table = guard_table(found)
    assert table.row_count == 2
    assert table.note.splitlines() == [
        "too large over slow: out of memory",
        "left out: of another engine, which takes engine (pip install engine)",
    ]


def test_what_cannot_be_measured_is_left_out(monkeypatch):
    def missing():
        raise ValueError

    monkeypatch.setattr(guards, "cpp_compiler", missing)
    monkeypatch.setattr(guards, "find_spec", lambda name: None)
    assert [one.lacks for one in guards.guards("cpu")] == [
        "",
        "a C++ compiler (g++ or clang++)",
        "mujoco (pip install 'aoro-gym[bench]')",
    ]


# ---- those of a GPU, rehearsed on a CPU -----------------------------------------------------------------------------


@pytest.fixture
def gpus(monkeypatch):
    """As many H200 as its list has names."""
    names = ["cuda:0", "cuda:1"]
    monkeypatch.setattr(guards.devices, "find", lambda name: SimpleNamespace(sm_count=132, name="H200"))
    monkeypatch.setattr(guards.devices, "several", lambda name: names)
    monkeypatch.setattr(guards, "calculates_on_gpus", lambda: True)
    monkeypatch.setattr(guards, "find_spec", lambda name: name)
    return names


def rehearsed(make: Any, machine: Machine) -> Subject:
    """What a guard of a GPU makes, of two on the CPU: all arguments but those of the device and the size."""
    here = {"worlds": 2} if "worlds" in make.keywords else {}
    device = "cpu,cpu" if make.keywords["device"] == ALL_GPUS else "cpu"
    options = {key: value for key, value in make.keywords.items() if key != "roles"} | here | {"device": device}
    return make.func(*(2 for _ in make.args), **options, machine=machine)


def test_those_of_a_gpu_measure_on_a_cpu(gpus, machine, monkeypatch):
    """Each by the calls that it makes on a GPU; the engines that are not here by their parameters."""
    known = guards.guards("cuda:0")
    monkeypatch.undo()
    for guard in known:
        assert guard.lacks == ""
        for make in (guard.fast, guard.slow):
            assert signature(make).bind(machine=machine)
            if make.func in (twins, environments):
                (row,) = measure([rehearsed(make, machine)], seconds=0.01)
                assert row["steps_per_s"] > 0.0, guard.name


def test_those_of_a_gpu_know_its_size_and_what_is_missing(gpus, monkeypatch):
    large = guards.guards("cuda:0")
    assert [(one.name.split()[0], one.least) for one in (large[0], large[-1])] == [("32,768", 50.0), ("131,072", 1.8)]
    monkeypatch.setattr(guards.devices, "find", lambda name: SimpleNamespace(sm_count=66))
    monkeypatch.setattr(guards, "find_spec", lambda name: None)
    monkeypatch.setattr(guards, "calculates_on_gpus", lambda: False)
    del gpus[1]
    small = guards.guards("cuda:0")
    assert small[0].name == "16,384 twins over 64" and small[0].least == 25.0
    assert small[1].name.startswith("2,048 twins by roles")
    assert [one.lacks.split(" (")[0] for one in small] == [
        "",
        "",
        *2 * ["a torch that knows this GPU, and array-api-compat"],
        "mujoco_warp",
        "mujoco_warp",
        "a second GPU",
    ]
