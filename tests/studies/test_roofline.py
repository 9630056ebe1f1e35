"""The roofline counts what it says it counts: closed examples, and the whole step against the device's own result."""

# pyright: reportGeneralTypeIssues=false

import json
from typing import Any

import numpy as np
import pytest
import warp as wp

from aoro_gym import Twin
from aoro_gym.twin.physics.fluid import Oil, fill_chamber, free_gas, orifice
from aoro_gym.twin.records import Command, Output, State, pack
from studies import roofline
from studies.counting import (
    Matrix,
    Quaternion,
    Tally,
    Vector,
    advance,
    cost,
    cross,
    dot,
    inverse,
    plain,
    rotation,
)


@wp.func
def decide(x: float, y: float):
    out = 2.0 * 3.0 * x
    if x > y and y > 0.0:
        out = wp.where(x > 2.0, wp.clamp(y, 0.0, 1.0), out)
    return out


@wp.func
def again(x: float, y: float):
    return x * y + y * x


def kinds(tally: Tally, *, distinct: bool = True) -> dict[str, int]:
    found = tally.distinct if distinct else tally.written
    return {kind: n for (_, kind), n in found.items()}


def numbers(tally: Tally, values) -> list:
    return [tally.number(float(v)) for v in values]


def test_a_scalar_product():
    tally = Tally()
    out = dot(Vector(*numbers(tally, (1, 2, 3))), Vector(*numbers(tally, (4, 5, 6))))
    assert out.value == 32.0
    assert kinds(tally) == {"multiply": 3, "add": 2}
    # (ab + cd) + ef: the first sum takes up one product, the second another; the other product waits for the first sum
    assert tally.fused == 2
    assert out.ready == 3.0


def test_matrices_against_numpy():
    rng = np.random.default_rng(0)
    a, b = rng.normal(size=(2, 3, 3))
    tally = Tally()
    x, y = (Matrix(*numbers(tally, m.ravel())) for m in (a, b))
    product = x * y
    assert kinds(tally) == {"multiply": 27, "add": 18}
    for counted, known in ((product, a @ b), (inverse(x), np.linalg.inv(a))):
        assert np.allclose([[plain(v) for v in row] for row in counted.rows], known, rtol=1e-12)
    u, v = a[0], b[0]
    assert np.allclose(
        [plain(c) for c in cross(Vector(*numbers(tally, u)), Vector(*numbers(tally, v)))], np.cross(u, v)
    )


def test_quaternions_against_warp():
    rng = np.random.default_rng(1)
    p, q = (v / np.linalg.norm(v) for v in rng.normal(size=(2, 4)))
    tally = Tally()
    one, other = (Quaternion(*numbers(tally, v)) for v in (p, q))
    # Warp computes in float32
    assert np.allclose([v.value for v in one * other], list(wp.quat(*p) * wp.quat(*q)), atol=1e-6)
    turn: Any = wp.quat(*p)
    known = np.array(wp.quat_to_matrix(turn)).reshape(3, 3)
    assert np.allclose([[v.value for v in row] for row in rotation(one).rows], known, atol=1e-6)


def test_repeats_are_counted_once():
    tally = Tally()
    law = tally.of(again)
    x, y = numbers(tally, (3, 5))
    assert law(x, y).value == 30.0
    assert kinds(tally, distinct=False) == {"multiply": 2, "add": 1}
    assert kinds(tally) == {"multiply": 1, "add": 1}
    law(x, y)
    assert kinds(tally, distinct=False) == {"multiply": 4, "add": 2}
    assert kinds(tally) == {"multiply": 1, "add": 1}


@pytest.mark.parametrize(
    ("x", "y", "result", "counts"),
    [
        (1.0, 2.0, 6.0, {"multiply": 1, "compare": 1, "branch": 1}),
        (3.0, 2.0, 1.0, {"multiply": 1, "compare": 3 + 2 + 1, "branch": 2}),
    ],
)
def test_decisions(x, y, result, counts):
    tally = Tally()
    assert tally.of(decide)(*numbers(tally, (x, y))).value == result
    assert kinds(tally) == counts


@pytest.mark.parametrize(
    ("gpu", "inverse_root", "chain"), [(True, {"root": 1}, 3.0), (False, {"root": 1, "division": 1}, 4.0)]
)
def test_an_orifice(gpu, inverse_root, chain):
    tally = Tally(gpu=gpu)
    coefficient, drop, laminar = numbers(tally, (1e-6, -4e6, 1e5))
    flow = tally.of(orifice)(coefficient, drop, laminar)
    assert flow.value == pytest.approx(-1e-6 * 2000.0, rel=1e-12)
    assert kinds(tally) == {"compare": 1, "multiply": 2} | inverse_root
    assert flow.ready == chain  # maximum, inverse root, product: the other product is ready before


def test_invariants_of_a_volume_are_counted_once(machine):
    """Two fills of one volume: β_0/V is the same."""
    tally = Tally()
    oil = tally.leaf(pack(machine)["oil"][0], Oil)
    content, flow, volume, walls = numbers(tally, (5e6, 1e-4, 1e-3, 1e-13))
    law = tally.of(fill_chamber)
    gas = tally.of(free_gas)(oil, content)
    content = law(oil, gas, content, flow, 1e-5, volume, walls, volume)
    first = kinds(tally)["division"]
    law(oil, gas, content, flow, 1e-5, volume, walls, volume)
    assert kinds(tally)["division"] == 2 * first - 1


@pytest.mark.parametrize(("gpu", "powers"), [(True, 3), (False, 1)])
def test_a_volume_with_gas_takes_one_power_on_a_cpu(machine, gpu, powers):
    """A first fill at the pressure at which the gas is known, two more nearby."""
    tally = Tally(gpu=gpu)
    oil = tally.leaf(pack(machine.set({"oil.gas_fraction": 0.01}))["oil"][0], Oil)
    content, flow, volume, walls = numbers(tally, (5e6, 1e-4, 1e-3, 1e-13))
    gas = tally.of(free_gas)(oil, content)
    for _ in range(3):
        content = tally.of(fill_chamber)(oil, gas, content, flow, 1e-4, volume, walls, volume)
    assert kinds(tally)["transcendental"] == powers


@pytest.fixture(scope="module")
def turning(machine) -> Twin:
    """A loaded turn in the middle."""
    twin = Twin(machine=machine)
    twin.step({"steering_signal": 1.0, "drive_signal": 0.5}, duration=0.4)
    return twin


@pytest.fixture(scope="module")
def step(turning):
    return cost(turning)


def test_the_counted_step_is_the_twins(machine, turning):
    """Both end two steps in the same state, but for float32: half a unit in the last place for every operation of the
    longest chain, on the scale of each row."""
    tally = Tally()
    counted = advance(turning, 2, tally)[:, 0]
    before = turning.state.numpy()[:, 0]
    other = Twin(machine=machine)
    other.step({"steering_signal": 1.0, "drive_signal": 0.5}, duration=0.4)
    assert np.array_equal(other.state.numpy()[:, 0], before)
    other.step(duration=0.002)
    after = other.state.numpy()[:, 0]
    rows = [
        State[name]
        for name in (
            *("JOINT", "JOINT_RATE", "VX", "SUPPLY", "PORT_A", "PORT_B", "TANK_LINE", "LS_PRESSURE", "SPOOL", "SWASH"),
            *("FORWARD", "BACK", "CHARGE", "ARM_BORE_FL", "ARM_ROD_RR", "ENGINE_SPEED", "BRISTLE_X_FL", "QZ", "QW"),
        )
    ]
    bound = 2.0**-24 * tally.longest
    assert bound < 1e-4
    assert np.all(np.abs(counted - after)[rows] <= bound * np.abs(after)[rows])
    assert np.max(np.abs(after - before)[rows] / np.abs(after)[rows]) > 10.0 * bound  # it did move


def test_bytes(machine, step):
    assert step.launch_bytes["state"] == 2 * 4 * State.SPOOL_RATE  # the rows behind are of other laws
    assert step.launch_bytes["machines"] == pack(machine).dtype.itemsize
    assert step.launch_bytes["commands"] == 4 * len(Command)
    assert step.launch_bytes["outputs"] == 4 * len(Output)
    assert dict(step.step_bytes) == {"history": 3 * 4}  # one written, two read for the delay


def test_the_step_costs_no_less_than_its_orifices(step):
    """Each substep has ten orifices whose pressures move: four traction valves, two charge checks, the meter-out edge, the
    bleed, two anti-cavitation checks."""
    distinct = roofline.by_class(step.distinct)
    assert distinct["root"] >= 30 * 10
    assert sum(step.written.values()) > sum(step.distinct.values()) > 30 * 10 * 4
    for (part, kind), n in step.distinct.items():
        assert 0 < n <= step.written[part, kind], (part, kind)
    # the first substep's chain at least: every volume's next content needs its last
    assert 30 < step.chain < sum(step.distinct.values())


def test_bounds_follow_from_ceilings(step):
    """Every operation 1 ns: the bounds are the counts."""
    probe = dict.fromkeys(("latency", "resident", "full"), 1e-9)
    limits = {"probes": dict.fromkeys(roofline.PROBES, probe), "resident_twins": 7, "bytes_per_s": 1e9}
    found = roofline.bounds(limits, step, gpu=True)
    classes = roofline.by_class(step.distinct)
    special = classes["division"] + classes["root"] + classes["transcendental"]
    assert found["divisions, roots, transcendentals"] == pytest.approx(1e9 / special)
    total = sum(classes.values()) - step.fused
    assert found["all instructions at that rate"] == pytest.approx(1e9 / total)
    assert found["the laws' mixture, full"] == pytest.approx(1e9 * roofline.mixture_instructions(gpu=True) / total)
    assert found["longest chain, resident"] == pytest.approx(7.0 / step.chain)
    per_step = sum(step.step_bytes.values()) + sum(step.launch_bytes.values()) / roofline.LAUNCH
    assert found["memory"] == pytest.approx(1e9 / per_step)


def test_the_report_takes_every_computer(tmp_path, monkeypatch, step):
    results = [json.loads(file.read_text(encoding="utf-8")) for file in sorted(roofline.RESULTS.glob("*.json"))]
    assert results
    report = tmp_path / "report.md"
    report.write_text("a\n<!-- counts -->\nold\n<!-- /counts -->\nb\n<!-- computers -->\n<!-- /computers -->\nc\n")
    monkeypatch.setattr(roofline, "REPORT", report)
    monkeypatch.setattr(roofline, "mean_cost", lambda latency, gpu: step)
    roofline.write([results[0], results[0]])
    text = report.read_text(encoding="utf-8")
    step_s = 30.0 * results[0]["spans_s"]["substep"] + results[0]["spans_s"]["rest"]
    assert "old" not in text
    assert "steering" in text
    assert text.count(f"| **kernel, on a raster** | **{1.0 / step_s:.3g}** | **{1.0 / step_s:.3g}** |") == 1
    assert [line for line in text.splitlines() if line in list("abc")] == ["a", "b", "c"]
    report.write_text("nothing")
    with pytest.raises(SystemExit, match="has no marks"):
        roofline.write(results)


def test_what_is_not_counted_yet_is_named():
    with pytest.raises(AttributeError, match=r"wp\.erf is not counted yet"):
        Tally().of(unknown)(1.0)


@wp.func
def unknown(x: float):
    return wp.erf(x)
