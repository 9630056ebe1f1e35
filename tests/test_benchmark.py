"""The benchmark counts what it says it counts."""

from itertools import pairwise

import pytest

from aoro_gym import Twin, benchmark


def test_a_case(machine, monkeypatch):
    counted = []
    step = Twin.step

    def counting(twin, commands=None, duration=0.02, **options):
        counted.append((id(commands), duration))
        return step(twin, commands, duration, **options)

    monkeypatch.setattr(Twin, "step", counting)
    seen = []
    case = benchmark.time_twin(3, machine=machine, seconds=0.05, progress=seen.append)
    assert case["twins"] == 3
    assert case["min"] <= case["steps_per_s"] <= case["max"]
    assert case["real_time_factor"] == pytest.approx(case["steps_per_s"] * 1e-3 / 3)
    assert seen == [0.2, 0.4, 0.6, 0.8, 1.0]
    per_run = case["steps_per_run"] // (3 * 20)
    timed = counted[-per_run * benchmark.RUNS :]
    assert {duration for _, duration in timed} == {benchmark.CONTROL_STEP}
    if per_run > 1:
        assert all(first[0] != second[0] for first, second in pairwise(timed[:per_run]))


def test_the_computer_is_named():
    on = benchmark.computer("cpu")
    assert on["cores"] >= 1
    assert on["device"] == on["cpu"] != ""
