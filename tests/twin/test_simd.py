"""Twins on several lanes of a CPU core: as one after the other, to rounding."""

import shutil
from typing import Any

import numpy as np
import pytest

from aoro_gym.benchmark.scene import signals, starts, terrain
from aoro_gym.benchmark.twins import randomised
from aoro_gym.execution.lanes import library as lanes
from aoro_gym.machine import Machine
from aoro_gym.terrains.generate.world import world
from aoro_gym.twin import Twin
from aoro_gym.twin.records import NON_FINITE, State

pytestmark = pytest.mark.skipif(shutil.which("g++") is None, reason="g++ is missing")

STEPS = 20
TOLERANCE = 5e-5
"""Of what a state reaches: float32 rounds by 6e-8, and oil of 1.6e9 Pa makes 100 Pa of a volume's rounding."""
FLOOR = {"rate": 0.1, "length": 1e-3, "pressure": 2e6, "acceleration": 10.0}
"""What counts as much of a quantity that hardly is there [rad/s or m/s, m or rad, Pa, m/s² or rad/s²]."""


@pytest.fixture(autouse=True)
def _quick(monkeypatch):
    """Compiled in ten seconds instead of fifty: not as fast, and the same."""
    monkeypatch.setattr(lanes, "FLAGS", ("-O1", *(flag for flag in lanes.FLAGS if flag != "-O3")))
    monkeypatch.setattr(lanes, "INLINED", ())


def floor_of(state: Any) -> float:
    name = state.name
    if "ACCELERATION" in name or (name.startswith("A") and len(name) == 3):
        return FLOOR["acceleration"]
    if "RATE" in name or "SPIN" in name or (name[0] in "VW" and len(name) == 2):
        return FLOOR["rate"]
    pressures = ("SUPPLY", "PORT", "TANK", "LS_", "BORE", "ROD", "FORWARD", "BACK", "HOSE", "CHARGE", "SHOCK")
    return FLOOR["pressure"] if any(one in name for one in pressures) else FLOOR["length"]


def states(twin: Twin) -> np.ndarray:
    """States (rows, twins), positions with what float32 rounds off them."""
    found = twin.state.numpy().astype(np.float64)
    for axis in "XYZ":
        found[State[axis]] += found[State[f"REST_{axis}"]]
        found[State[f"REST_{axis}"]] = 0.0
    return found


def largest_difference(one: Twin, other: Twin) -> float:
    """Over what the state reaches in any twin."""
    a, b = states(one), states(other)
    floors = np.array([floor_of(state) for state in State])
    difference = a - b
    wheels = slice(State.WHEEL_FL, State.WHEEL_FL + 4)
    difference[wheels] = (difference[wheels] + np.pi) % (2.0 * np.pi) - np.pi  # they are kept below a turn
    return float(np.max(np.abs(difference).max(axis=1) / np.maximum(np.abs(a).max(axis=1), floors)))


def pair(count: int, machine: Machine | None = None, ground: str = "plane", **options) -> tuple[Twin, Twin]:
    """Twins with machines of their own, one after the other and on lanes, at the same places."""
    machine = randomised(Machine.load(), count, 3) if machine is None else machine
    options |= {} if ground == "plane" else {"terrain": terrain(), "ground": ground}
    alone, together = (Twin(count, machine=machine, device=device, **options) for device in ("cpu", "cpu:simd"))
    position, heading = starts(count, 3)
    for twin in (alone, together):
        twin.reset(position=position, heading=heading)
    return alone, together


def drive(twins, count: int, times: int = 1) -> None:
    steering, driven = signals(count, 3)[0]
    for twin in twins:
        for _ in range(times):
            twin.step({"steering_signal": steering, "drive_signal": driven}, duration=1e-3 * STEPS)


@pytest.mark.parametrize("count", [4, 16, 37])
def test_lanes_do_as_threads_do(count):
    """Fewer twins than lanes, as many, and some left over."""
    twins = pair(count, threads=1)
    drive(twins, count)
    assert largest_difference(*twins) < TOLERANCE
    np.testing.assert_allclose(*(twin.outputs.numpy()[-1, 0] for twin in twins), atol=1e-5)


def test_lanes_are_used():
    """Results on lanes are not those of the other kernel to the bit: else nothing would have been tested."""
    twins = pair(16, threads=1)
    drive(twins, 16, times=5)
    assert largest_difference(*twins) > 0.0


def test_many_steps_stay_together():
    """A second of driving: rounding grows, but nothing is forgotten between launches."""
    twins = pair(16, threads=1)
    drive(twins, 16, times=50)
    np.testing.assert_allclose(states(twins[0])[:6], states(twins[1])[:6], atol=2e-3)


def test_twins_are_shared_by_threads_in_whole_groups():
    twins = pair(64, threads=2)
    drive(twins, 64)
    assert largest_difference(*twins) < TOLERANCE


def test_one_that_diverges_leaves_the_others_alone():
    """A twin with a state that is no number stays as it was, and is said; its neighbours drive on."""
    twins = pair(16, threads=1)
    for twin in twins:
        state = twin.state.numpy()
        state[State.SUPPLY, 5] = np.nan
        twin.state.assign(state)
    drive(twins, 16)
    for twin in twins:
        assert [index for index, _ in twin.diverged] == [5]
        assert twin._status.numpy()[5] == NON_FINITE
    kept = [*range(5), *range(6, 16)]
    np.testing.assert_allclose(states(twins[0])[:6, kept], states(twins[1])[:6, kept], atol=1e-6)


def test_some_begin_anew():
    twins = pair(16, threads=1)
    drive(twins, 16)
    for twin in twins:
        twin.reset(np.isin(np.arange(16), [3, 9]), position=(5.0, 1.0), heading=1.0)
    drive(twins, 16)
    assert largest_difference(*twins) < TOLERANCE


@pytest.mark.slow
@pytest.mark.parametrize(("key", "value"), [("oil.gas_fraction", 0.01), ("joint.compliance", 5e-7)])
def test_branches_that_some_twins_take(key, value):
    """Half of the twins have gas in the oil, or a mount: both branches are run, each for its own."""
    count = 16
    values = np.where(np.arange(count) % 2 == 0, value, 0.0)
    machine = randomised(Machine.load(), count, 3).set({key: values}, check_ranges=False)
    twins = pair(count, machine, threads=1)
    drive(twins, count)
    assert largest_difference(*twins) < TOLERANCE


@pytest.mark.slow
def test_a_raster_is_felt():
    twins = pair(37, ground="raster", threads=1)
    drive(twins, 37)
    assert largest_difference(*twins) < 2.0 * TOLERANCE  # wheels meet edges of cells


@pytest.mark.slow
def test_laws_of_their_own():
    twins = pair(16, Machine.load().sample(16, laws="any", seed=4), threads=1)
    drive(twins, 16)
    assert largest_difference(*twins) < 3.0 * TOLERANCE  # of laws that are stiffer


def test_what_lanes_cannot_do_is_refused():
    with pytest.raises(
        ValueError, match=r"cpu:simd.*cannot run advance: lanes have no .*mesh_query.*take device='cpu'"
    ):
        Twin(4, terrain=terrain(), ground="mesh", device="cpu:simd")
    with pytest.raises(ValueError, match=r"cannot run advance: a loop may run unlike"):
        Twin(4, terrain=world(3, size=(30.0, 30.0)), device="cpu:simd")


def test_a_missing_compiler_is_named(monkeypatch):
    monkeypatch.setenv("CXX", "no-such-compiler")
    lanes.cpp_compiler.cache_clear()
    with pytest.raises(ValueError, match=r"needs a C\+\+ compiler.*no-such-compiler"):
        Twin(4, device="cpu:simd")
    lanes.cpp_compiler.cache_clear()
