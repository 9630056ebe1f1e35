"""Boundaries: noise and errors in closed form, and an oracle that puts an effect into one part of a noisy twin."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import cholesky

from aoro_gym.diagnosis.boundaries import (
    LEAST_ERROR,
    PARTS,
    Balance,
    Followed,
    boundaries,
    catmull_rom,
    faulty_component,
    ports_of,
    relative_error,
    response,
)
from aoro_gym.diagnosis.diagnose import ERROR
from aoro_gym.diagnosis.noise import merged, noise_of
from aoro_gym.diagnosis.nuisances import Nuisances
from aoro_gym.diagnosis.problem import Problem
from aoro_gym.diagnosis.recording import TICK, Recording
from aoro_gym.diagnosis.replay import Variants
from aoro_gym.diagnosis.result import Boundary
from aoro_gym.effects.catalogue import EFFECTS
from aoro_gym.effects.effect import COMPONENTS
from aoro_gym.machine import Machine
from tests.diagnosis.manoeuvres import FULL, blank, record, turn

MACHINE = Machine.load("aoro")
BLANKS = [blank("left", turn(0.9, 3.0), -0.6), blank("right", turn(-0.6, 3.0), 0.6)]
UNCERTAIN = ("steering.pump.margin", "steering.cylinder.seal_preload", "oil.bulk_modulus")
"""Nuisances that are left, one a part, so that a test takes seconds."""
COUNT = 200
RNG = np.random.default_rng(5)


# ---- the machine between its sensors ----


def test_the_cubic_goes_through_its_samples():
    assert [catmull_rom(x) for x in (-2.0, -1.0, 0.0, 1.0, 2.0)] == [0.0, 0.0, 1.0, 0.0, 0.0]
    for x in (0.1, 0.5, 0.8):  # and through parabolas, exactly
        around = np.arange(-1, 3)
        weights = np.array([catmull_rom(x - k) for k in around])
        np.testing.assert_allclose([weights.sum(), weights @ around, weights @ around**2], [1.0, x, x**2], atol=1e-12)


def test_the_leash_feels_accelerations_alone():
    """A ramp of the angle gives its rate and no acceleration, a parabola, in the end, its acceleration."""
    acceleration, rate = response(COUNT)
    time = TICK * np.arange(COUNT)
    inside = slice(150, COUNT - 2)  # the start forgotten, the end not yet felt
    np.testing.assert_allclose((acceleration @ np.ones(COUNT))[inside], 0.0, atol=1e-4)
    np.testing.assert_allclose((rate @ np.ones(COUNT))[inside], 0.0, atol=1e-6)
    np.testing.assert_allclose((acceleration @ time)[inside], 0.0, atol=1e-4)
    np.testing.assert_allclose((rate @ time)[inside], 1.0, atol=1e-5)
    np.testing.assert_allclose((acceleration @ (0.5 * time**2))[inside], 1.0, atol=1e-3)


def test_oil_of_the_ports_is_that_of_the_cylinders():
    """Displacement is the change of volume by the angle; over the whole range, it is the full turn's volume."""
    reach = float(MACHINE.joint.range)
    angle = np.linspace(-reach, reach, 2001)
    channels = {"joint_angle": angle, "pressure_a": np.full(2001, 100e5), "pressure_b": np.zeros(2001)}
    ports = ports_of(MACHINE, Recording("log", np.zeros((2000, 2)), channels, 60, -reach))
    whole = float(np.asarray(MACHINE.steering.full_turn_volume))
    np.testing.assert_allclose(np.trapezoid(ports.displacement, angle, axis=1), [whole, -whole], rtol=1e-5)
    for side, pressure in enumerate((100e5, 0.0)):
        modulus = float(np.asarray(MACHINE.oil.effective_modulus(pressure)))
        change = np.gradient(ports.compliance[side], angle)[1:-1]
        np.testing.assert_allclose(change, ports.displacement[side, 1:-1] / modulus, rtol=1e-4)


# ---- statistics ----


def balance_of(rng, *, noise=None, error=0.0, own=None):
    """A balance that lacks a draw of its noise, of an ``error`` and of its ``own`` nuisances."""
    time = TICK * np.arange(COUNT)
    size = 1.0 + np.sin(3.0 * time) ** 2
    covariance = np.diag(0.02**2 * np.ones(COUNT)) if noise is None else noise
    lag = np.abs(np.subtract.outer(time, time))
    wander = error**2 * size[:, None] * np.exp(-lag / 0.15) * size
    own = np.zeros((COUNT, 0)) if own is None else own
    drawn = cholesky(covariance + wander + 1e-12 * np.eye(COUNT), lower=True) @ rng.standard_normal(COUNT)
    missing = drawn + own @ rng.standard_normal(own.shape[1])
    counts = np.ones(COUNT, dtype=bool)
    return Balance(missing, np.zeros((COUNT, 0)), own, merged(merged(covariance).T), size, counts)


def test_what_is_shown_is_white():
    """Whatever the noise, here one that is differentiated, its shown part has the covariance one."""
    difference = np.eye(COUNT) - np.eye(COUNT, k=-1)
    noise = 0.1**2 * difference @ difference.T + 0.02**2 * np.eye(COUNT)
    balance = balance_of(RNG, noise=noise)
    shown = balance.whitened(np.eye(COUNT))
    assert 5 < len(shown) < COUNT // 2
    np.testing.assert_allclose(shown @ noise @ shown.T, np.eye(len(shown)), atol=1e-3)


def test_what_is_missing_comes_back():
    """A slow error ten times the noise, to 10 % of itself."""
    time = TICK * np.arange(COUNT)
    balance = balance_of(RNG)
    slow = 0.2 * np.sin(2.0 * np.pi * time)
    found = balance.estimated(balance.whitened(slow))
    assert np.sqrt(np.mean((found - slow[::2]) ** 2)) < 0.1 * np.sqrt(np.mean(slow**2))


@pytest.mark.parametrize("error", [0.03, 0.2])
def test_the_error_of_a_healthy_part_is_found(error):
    """Of six recordings with zeros of their own. Of m independent amounts beyond the noise, the logarithm of their size is
    known to 1/√(2 m): within three of them."""
    rng = np.random.default_rng(6)
    zero = 0.3 * np.ones((COUNT, 1))
    healthy = [Followed(b"", {"torque": balance_of(rng, error=error, own=zero)}) for _ in range(6)]
    count = sum(int(np.sum(one.balances["torque"].power * error**2 > 1.0)) for one in healthy)
    assert np.log(relative_error(healthy, ("torque",)) / error) == pytest.approx(0.0, abs=3.0 / np.sqrt(2.0 * count))


def test_a_part_without_error_has_the_least():
    quiet = [Followed(b"", {"torque": balance_of(np.random.default_rng(7))}) for _ in range(4)]
    assert relative_error(quiet, ("torque",)) < 2.0 * LEAST_ERROR


# ---- the oracle ----


def problem_of(recordings, healthy):
    longest = max(one.ticks + 1 for one in recordings)
    noise = {name: noise_of([*recordings, *healthy], name, longest) for name in FULL}
    around = Nuisances(MACHINE, "day")
    problem = Problem(recordings, around, {}, error=ERROR, noise=noise)
    problem.felt = np.array([around.keys.index(key) for key in UNCERTAIN])
    problem.centre = np.zeros(len(UNCERTAIN) + len(problem.centre) - len(around.keys))
    return problem


@pytest.fixture(scope="module")
def healthy():
    return record(Variants(MACHINE), BLANKS, np.random.default_rng(8))


def parts_with(healthy, seed, *effects):
    recordings = record(Variants.of(MACHINE, effects, 1), BLANKS, np.random.default_rng(seed))
    return {one.part: one for one in boundaries(problem_of(recordings, healthy), healthy)}


@pytest.mark.parametrize("seed", [11, 12, 13])
def test_no_part_of_a_healthy_machine_contradicts_its_boundary(healthy, seed):
    found = parts_with(healthy, seed)
    assert set(found) == set(PARTS)
    for one in found.values():
        assert not one.contradicts
        assert one.share == 0.0


@pytest.mark.parametrize(
    ("effect", "magnitude", "part"),
    [
        ("joint_friction", 1500.0, "mechanics"),
        ("seal_friction", 3000.0, "mechanics"),
        ("tire_scrub", 0.1, "mechanics"),
        ("payload", 1500.0, "mechanics"),
        ("valve_gain", 0.9, "circuit"),
        ("cross_port_leakage", 8e-5, "circuit"),
        ("pump_response", 2.0, "pump"),
        ("pump_limit", 0.7, "pump"),
    ],
)
def test_the_faulty_part_lacks_and_the_healthy_do_not(healthy, effect, magnitude, part):
    found = parts_with(healthy, 21, (EFFECTS[effect], (magnitude,)))
    assert EFFECTS[effect].component in found[part].components
    assert [name for name, one in found.items() if one.contradicts] == [part]
    assert found[part].share == 1.0
    assert found[part].p < 1e-3 * min(one.p for name, one in found.items() if name != part)


def test_two_parts_may_lack(healthy):
    found = parts_with(healthy, 22, (EFFECTS["joint_friction"], (1500.0,)), (EFFECTS["valve_gain"], (0.9,)))
    assert [name for name, one in sorted(found.items()) if one.contradicts] == ["circuit", "mechanics"]
    assert sum(one.share for one in found.values()) == pytest.approx(1.0)


def test_a_wrong_angle_contradicts_torque_and_flow(healthy):
    """What cannot be isolated, as the module says."""
    found = parts_with(healthy, 23, (EFFECTS["sensor_gain"], (0.05,)))
    assert found["mechanics"].contradicts and found["circuit"].contradicts


def test_without_ports_pressures_nothing_is_said(healthy):
    only = [
        replace(one, channels={name: one.channels[name] for name in ("joint_angle", "pressure_a")}) for one in healthy
    ]
    longest = max(one.ticks + 1 for one in only)
    noise = {name: noise_of(only, name, longest) for name in only[0].channels}
    assert boundaries(Problem(only, Nuisances(MACHINE, "day"), {}, error=ERROR, noise=noise)) == ()


def test_without_a_pump_pressure_there_is_no_pump(healthy):
    less = [
        replace(one, channels={name: v for name, v in one.channels.items() if name != "pump_pressure"})
        for one in record(Variants(MACHINE), BLANKS, np.random.default_rng(24))
    ]
    without_pump = [
        replace(one, channels={n: v for n, v in one.channels.items() if n != "pump_pressure"}) for one in healthy
    ]
    problem = problem_of(record(Variants(MACHINE), BLANKS, np.random.default_rng(24)), healthy)
    other = problem.of(less)
    other.signals = tuple(name for name in FULL if name != "pump_pressure")
    found = boundaries(other, without_pump)
    assert sorted(one.part for one in found) == ["circuit", "mechanics"]
    assert not any(one.contradicts for one in found)


# ---- whom it blames ----


def part(name, p):
    return Boundary(name, PARTS[name], 100.0, 50, p, 1.0, 10.0, "N*m", 0.01, 1.0)


def test_components_of_the_parts_are_known():
    assert {component for of in PARTS.values() for component in of} | {"sensor"} == set(COMPONENTS)


def test_blame():
    likely = {"valve": 0.6, "joint": 0.3, "pump": 0.1}
    assert faulty_component((), likely) == "valve"
    assert faulty_component((part("mechanics", 0.02),), likely) == "valve"  # which is no contradiction
    assert faulty_component((part("mechanics", 1e-9), part("circuit", 0.02)), likely) == "joint"
    assert faulty_component((part("mechanics", 1e-9), part("circuit", 1e-6)), likely) == "valve"
    assert faulty_component((part("mechanics", 1e-9),), {"valve": 0.6}) == "valve"
    assert faulty_component((part("mechanics", 1e-9),), {"valve": 0.9, "joint": 0.001}) == "valve"  # outweighed
    unknown = {"valve": 0.002, "joint": 0.001}
    assert faulty_component((part("mechanics", 1e-9),), unknown) == "joint"
    assert faulty_component((part("mechanics", 1e-9),), {"sensor": 0.6, "joint": 0.4}) == "sensor"
    assert faulty_component((part("mechanics", 1e-9),), {}) == ""
