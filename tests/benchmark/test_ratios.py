"""Ratios by hand."""

import pytest

from aoro_gym.benchmark.ratios import ratios


def case(twins, rate, threads=None, what="twin", core=None):
    device = "cuda:0" if threads is None else "cpu"
    row = {"what": what, "device": device, "twins": twins, "threads": threads, "steps_per_s": rate}
    return row | ({} if core is None else {"steps_per_core_s": core})


def peer(what, rate, *, core=None, finite=1):
    row = {"what": what, "worlds": 1, "finite": finite, "dropped": [], "steps_per_s": rate}
    return row | ({} if core is None else {"steps_per_core_s": core})


def test_on_the_cpu():
    cases = [
        case(1, 90.0, 1, core=91.0),
        case(64, 150.0, 1, core=151.0),
        case(64, 285.0, 2, core=148.0),
        case(64, 3.0, 1, "env"),
        case(64, 4.5, 2, "env"),
    ]
    found = ratios(cases, [peer("mujoco", 50.0, core=50.0), peer("mujoco", 999.0, core=999.0, finite=0)])
    assert found == pytest.approx(
        {
            "twin_over_mujoco_per_core_second": 151.0 / 50.0,
            "twin_2_threads_over_1_at_64": 1.9,
            "env_2_threads_over_1_at_64": 1.5,
        }
    )


def test_on_a_gpu():
    cases = [case(64, 1.0), case(4096, 50.0), case(16384, 95.0), case(65536, 100.0), case(64, 0.5, what="env")]
    found = ratios(cases, [peer("mujoco_warp", 4.0), peer("mujoco_warp", 5.0)])
    assert found == pytest.approx({"twin_over_mujoco_warp": 20.0, "twin_cost_of_one_at_65536_over_16384": 0.95})


def test_nothing_to_compare():
    assert ratios([case(64, 1.0)], [peer("mujoco", 5.0, core=5.0)]) == {}
