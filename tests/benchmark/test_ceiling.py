"""The ceiling is what the device does at best, and a step takes what the kernel's code says."""

# pyright: reportGeneralTypeIssues=false

import pytest
import warp as wp

from aoro_gym import Twin
from aoro_gym.benchmark.ceiling import Ceiling, beside, counted, measure_ceiling
from aoro_gym.benchmark.probes import Factors, bandwidth, factors, multiply_add, probe_time
from aoro_gym.benchmark.run import Plan, run
from aoro_gym.benchmark.scene import CONTROL_STEP, signals, starts, terrain
from studies import roofline
from studies.counting import cost


@pytest.mark.slow
def test_counts_are_of_the_laws_as_they_are():
    """To the last operation: laws select rather than branch, so that rounding decides nothing."""
    assert counted() == roofline.operations(), "count again: python -m studies.roofline --write"


def test_a_step_of_the_benchmark_takes_as_much(machine):
    """Another ground and another moment."""
    twin = Twin(machine=machine, terrain=terrain(), ground="raster")
    position, heading = starts(1, seed=3)
    twin.reset(position=position, heading=heading)
    for steering, drive in signals(1, seed=3):
        twin.step({"steering_signal": steering, "drive_signal": drive}, duration=CONTROL_STEP)
    assert not twin.diverged
    assert roofline.executed(cost(twin, gpu=True)) == counted()["raster"]["cuda"]


def row(device, **rates):
    return {"device": device, "ground": "raster", "main_step_s": 1e-3, "control_step_s": 0.01, **rates}


@pytest.fixture
def small(monkeypatch):
    """A step of 100 operations on a CPU, 80 on CUDA, and 40 bytes, 20 of them its share of a launch of ten."""
    counts = {
        "cpu": {"add": 60, "root": 40},
        "cuda": {"multiply_add": 50, "root": 30},
        "bytes": {"step": 20, "launch": 200},
    }
    monkeypatch.setattr("aoro_gym.benchmark.ceiling.counted", lambda: {"raster": counts})


def test_a_core_is_beside_its_core_seconds(small):
    found = beside(
        row("cpu", steps_per_s=9.0, steps_per_core_s=4.0), Ceiling(operations_per_s=1000.0, bytes_per_s=8000.0)
    )
    assert found == {
        "operations_per_step": 100,
        "bytes_per_step": 40.0,
        "ceiling_steps_per_s": {"arithmetic": 10.0, "memory": 200.0},
        "share_of_ceiling": 0.4,
    }


def test_the_lower_ceiling_counts(small):
    found = beside(row("cuda:0", steps_per_s=4.0), Ceiling(operations_per_s=8000.0, bytes_per_s=200.0))
    assert found["operations_per_step"] == 80
    assert found["ceiling_steps_per_s"] == {"arithmetic": 100.0, "memory": 5.0}
    assert found["share_of_ceiling"] == 0.8


def test_the_ceiling_is_that_of_the_probes(monkeypatch):
    """Eight chains of a multiplication and an addition in 2 ns, on one core: 8 G operations a second."""

    def takes(operation, operands, width, threads):
        assert (operation, width, threads) == (multiply_add, 8, 1)
        return 2e-9

    monkeypatch.setattr("aoro_gym.benchmark.ceiling.probe_time", takes)
    monkeypatch.setattr("aoro_gym.benchmark.ceiling.bandwidth", lambda device: 5e9)
    found = measure_ceiling("cpu")
    assert found.operations_per_s == pytest.approx(8e9)
    assert found.bytes_per_s == 5e9


def test_probes_see_what_a_core_does():
    """Bounds that no clock of a shared machine moves: one chain waits for each result and eight overlap, four times as
    fast at least on any core with two units, so twice as fast beside other work; a core does between 1e8 and 1e12
    operations and moves between 1e8 and 1e12 bytes a second."""
    chain, together = (probe_time(multiply_add, factors("cpu"), width, 1) / width for width in (1, 8))
    assert chain > 2.0 * together
    assert 1e8 < 2.0 / together < 1e12
    assert 1e8 < bandwidth(wp.get_device("cpu")) < 1e12


def test_on_a_gpu(machine):
    if not wp.is_cuda_available():
        pytest.skip("no CUDA device")
    on, (case,) = (run(Plan(twins=(4096,), device="cuda:0", seconds=0.5), machine)[key] for key in ("machine", "cases"))
    assert 0.0 < case["share_of_ceiling"] < 1.0
    a_processor = on["ceiling"]["operations_per_s"] / wp.get_device("cuda:0").sm_count
    assert 64 * 1e9 < a_processor < 128 * 3e9  # 64 or 128 lanes, each an instruction a cycle, at 1 to 3 GHz


@wp.func
def halve(x: float, p: Factors):
    return 0.5 * x


def test_a_probe_whose_chains_leave_is_refused():
    with pytest.raises(RuntimeError, match="must stay near 1"):
        probe_time(halve, factors("cpu"), 1, 1)
