"""A plan is checked before anything runs, and says what runs."""

import json
import os

import pytest

from aoro_gym.benchmark import peers, startup
from aoro_gym.benchmark import run as running
from aoro_gym.benchmark.report import tables
from aoro_gym.benchmark.run import Plan, run
from aoro_gym.benchmark.timing import RUNS
from aoro_gym.twin.recorded import cores


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"what": ("twins",)}, "what is 'twins'; choose one of: twin, env, train"),
        ({"trainers": ("rllib",)}, "trainers is 'rllib'; choose one of: sb3, resident"),
        ({"env": "AORO/Flying-v0"}, "env is 'AORO/Flying-v0'; choose one of: AORO/Turning-v0, "),
        (
            {"what": ("env",), "env": "AORO/Turning-v0", "ground": "mesh"},
            "ground is 'mesh', but AORO/Turning-v0 is timed",
        ),
        ({"ground": "mud"}, "ground is 'mud'; choose one of: plane, raster, mesh"),
        ({"output": "jax"}, "output is 'jax'; choose one of: numpy, torch"),
        ({"twins": (2_000_000,)}, "twins is 2000000, but must be an integer in \\[1, 1000000\\]"),
        ({"twins": ()}, "there is nothing to time"),
        ({"threads": (cores() + 1,)}, f"threads is {cores() + 1}, but must be an integer in .1, {cores()}"),
        ({"threads": (1,), "device": "cuda:0"}, r"threads is \(1,\), but cuda:0 needs none"),
        ({"seconds": float("nan")}, r"seconds is nan s, but must be in \(0, 600\] s"),
        ({"seconds": 601.0}, "seconds is 601 s, but"),
        ({"peers": ("bullet",)}, "peers is 'bullet'; choose one of: mujoco, mujoco_warp, newton"),
    ],
)
def test_bad_plans_are_named(options, message):
    with pytest.raises(ValueError, match=message):
        Plan(**options)


@pytest.mark.parametrize("peer", ["mujoco_warp", "newton"])
def test_some_peers_want_a_gpu(monkeypatch, peer):
    needed = []
    monkeypatch.setattr(running.peers, "package", needed.append)
    monkeypatch.setattr(running.peers, "find_spec", lambda name: name)
    with pytest.raises(ValueError, match=f"peer {peer} is timed on a GPU, but the device is cpu:simd; take cuda:0"):
        Plan(peers=(peer,), device="cpu:simd")
    plan = Plan(peers=(peer,), device="cuda:0")
    assert plan.thread_counts == (None,) and plan.skipped == {}
    assert needed == list(dict.fromkeys(("mujoco", "mujoco_warp", peer)))
    made = running._others(plan)
    assert [(make.__name__, options["worlds"]) for make, options in made] == [(peer, n) for n in peers.WORLDS[peer]]


def test_newton_is_left_out_where_it_is_not_installed(machine, monkeypatch):
    """The rest is timed, and what is written says how to get it."""
    monkeypatch.setattr(running.peers, "find_spec", lambda name: None)
    plan = Plan(peers=("newton",), device="cuda:0")
    reason = {"newton": "not installed: pip install newton==1.8.0"}
    assert plan.skipped == reason and running._others(plan) == []
    monkeypatch.setattr(Plan, "skipped", reason)
    result = run(Plan(twins=(1,), threads=(1,), seconds=0.02), machine)
    assert result["skipped"] == reason
    assert tables(result)[1].note == "newton is not installed: pip install newton==1.8.0"


def test_all_of_it(machine):
    plan = Plan(
        twins=(1, 2), what=("twin", "env"), threads=(1,), peers=("mujoco",), worlds=(2,), seconds=0.02, randomise=True
    )
    seen, kept = [], []
    result = run(plan, machine, lambda what, share: seen.append(share), kept.append)
    assert seen[-1] == 1.0 and seen == sorted(seen) and seen.index(0.2) < 0.5 * len(seen)
    assert len(kept) == 5 * RUNS
    assert (len(kept[0]["cases"]), len(kept[3]["cases"]), len(kept[4]["peers"])) == (1, 4, 1)
    assert kept[-1] == result
    made = [(what, count) for count in (1, 2) for what in ("twin", "env")]
    assert [(case["what"], case["twins"]) for case in result["cases"]] == made
    for row in (*result["cases"], *result["peers"]):
        assert 0.0 < row["min"] <= row["steps_per_s"] <= row["max"]
        # simulated time of all copies
        step = row["control_step_s"] if row["what"] == "env" else 1e-3
        copies = row.get("twins", row.get("worlds"))
        assert row["real_time_factor"] * copies == pytest.approx(row["steps_per_s"] * step)
        assert ("share_of_ceiling" in row) == (row["what"] == "twin")
        assert 0.0 < row.get("share_of_ceiling", 0.5) < 1.0
    (peer,) = result["peers"]
    assert (peer["what"], peer["worlds"], peer["threads"], peer["finite"]) == ("mujoco", 2, 1, 2)
    assert set(result["ratios"]) >= {"twin_over_mujoco_per_core_second"}
    assert json.loads(json.dumps(result)) == result
    assert [table.row_count for table in tables(result)] == [4, 1, len(result["ratios"])]


def test_triangles_have_no_ceiling(machine):
    result = run(Plan(twins=(1,), threads=(1,), ground="mesh", seconds=0.02), machine)
    assert "ceiling" not in result["machine"]
    assert "share_of_ceiling" not in result["cases"][0]
    assert tables(result)[0].row_count == 1


def test_start_up_is_kept(machine, monkeypatch):
    monkeypatch.setattr(running, "time_startup", lambda *asked: {"warm_s": 1.0})
    kept = []
    result = run(Plan(twins=(1,), threads=(1,), seconds=0.02, startup=True), machine, save=kept.append)
    assert kept[-1] == result and "startup" in result


def test_startup_tells_cold_from_warm(monkeypatch):
    asked = []

    def pretend(device, ground, environment):
        asked.append(environment.get("WARP_CACHE_PATH") != os.environ.get("WARP_CACHE_PATH"))
        time = 40.0 if asked[-1] else 1.0 + len(asked)
        return {"import_s": 0.5, "first_twin_s": time, "process_s": time + 1.0}

    monkeypatch.setattr(startup, "_first_step", pretend)
    found = startup.time_startup("cpu", "plane")
    assert asked == [False] * 4 + [True]
    assert (found["first_twin_s"], found["warm_s"]) == (4.0, 5.0)  # of 3, 4 and 5: the first only fills the cache
    assert (found["cold_first_twin_s"], found["cold_s"]) == (40.0, 41.0)


@pytest.mark.parametrize("ground", ["plane", pytest.param("raster", marks=pytest.mark.slow)])
def test_a_fresh_process_steps_a_twin(ground):
    times = startup._first_step("cpu", ground, os.environ)
    assert 0.0 < times["import_s"] + times["first_twin_s"] < times["process_s"]
    with pytest.raises(RuntimeError, match="ended with 1: "):
        startup._first_step("cuda:77", ground, os.environ)
