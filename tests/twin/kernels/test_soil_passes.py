"""Wheels that go over one place again and again, on the device's raster: how deep each pass goes, what counts as one, and
what it costs."""

# pyright: reportInvalidTypeForm=false, reportGeneralTypeIssues=false, reportArgumentType=false, reportCallIssue=false
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import warp as wp
from scipy.integrate import quad
from scipy.optimize import brentq

from aoro_gym.terrains.plane import Plane
from aoro_gym.terrains.soil import Soil, preset_table
from aoro_gym.twin.grounds import Grounds
from aoro_gym.twin.kernels.soil import MOST_PASSES, RUT, SINKAGE, WHEEL_ROWS, PassRuts, leave_trace
from aoro_gym.twin.kernels.soil_start import begin_legs, forget
from aoro_gym.twin.physics.soil import Patch, Reaction, pass_sinkage_factor, sinkage_step, soil_pressure, wheel_reaction
from aoro_gym.twin.physics.soil import Soil as DeviceSoil
from aoro_gym.twin.soil_ruts import Ruts, device_records
from tests.oracles.soil import Contact
from tests.twin.physics.launch import launch

RADIUS, WIDTH, LOAD, STIFFNESS = (wp.constant(value) for value in (0.6258, 0.53, 24.5e3, 3.44e5))
BENT = LOAD / STIFFNESS
NEWTON = wp.constant(3)
STEP = 4e-3
"""Way [m] of a step: traces are 3 cm apart, as at the twin's highest speed."""
WAY = np.arange(0.0, 6.5, STEP)
FROM, TO = 2.5, 4.0
"""Where a wheel on the WAY has settled, and its whole contact with it."""


@wp.kernel(enable_backward=False)
def plate_kernel(soil: wp.array(dtype=DeviceSoil), passes: wp.array(dtype=int), sinkage: wp.array(dtype=float),
                 pressure: wp.array(dtype=float)):  # fmt: skip
    i = wp.tid()
    p, _ = soil_pressure(soil[i], WIDTH, WIDTH, pass_sinkage_factor(soil[i], passes[i]), sinkage[i], 0.0)
    pressure[i] = p


@wp.kernel(enable_backward=False)
def roll_kernel(soils: wp.array(dtype=DeviceSoil), ruts: PassRuts, number: wp.array(dtype=int),
                way: wp.array(dtype=float), resistance: wp.array(dtype=float)):  # fmt: skip
    """Wheels of a ``number`` each, under the same load at places of a ``way`` [m], one after the other."""
    steps = way.shape[0]
    for i in range(steps):
        first = WHEEL_ROWS * number[i]
        w = Patch()
        w.radius = RADIUS
        w.width = WIDTH
        w.roll = 1.0
        w.east = 1.0
        w.x = way[i]
        w.sinkage = ruts.wheels[first + SINKAGE, 0]
        r = Reaction()
        newton = int(NEWTON)
        for _ in range(newton):
            w.depth = w.sinkage + LOAD / STIFFNESS
            r = wheel_reaction(soils[0], ruts, 0, w)
            w.sinkage = sinkage_step(STIFFNESS, w, r)
        ruts.wheels[first + SINKAGE, 0] = w.sinkage
        leave_trace(ruts, soils[0], 0, first, w, r.length)
        resistance[i] = r.resistance


class Lane:
    """A straight lane of soil with passes, along x."""

    def __init__(self, soil: Soil, machines: wp.array):
        self.soil, self.machines = soil, machines
        self.site: Any = Grounds(Plane(), num_twins=1, soil=soil).ruts
        ruts, mask = self.site.device_struct.ruts, wp.ones(1, dtype=wp.bool, device="cpu")
        wp.launch(forget, 1, [ruts.keys, ruts.count, ruts.full, ruts.wheels, mask], device="cpu")
        wp.launch(begin_legs, 1, [ruts.legs, mask], device="cpu")

    def roll(self, way: np.ndarray, number: Any = 0) -> np.ndarray:
        """Resistance [N] of wheels of a ``number`` each at the places of a ``way`` [m]."""
        numbers = np.broadcast_to(number, len(way)).astype(np.int32)
        resistance = wp.zeros(len(way), dtype=float, device="cpu")
        site = self.site.device_struct
        inputs = [site.soils, site.ruts, *(wp.array(one, device="cpu") for one in (numbers, way.astype(np.float32)))]
        wp.launch(roll_kernel, 1, inputs, [resistance], device="cpu")
        return resistance.numpy().astype(float)

    @property
    def ruts(self) -> Ruts:
        return self.site.raster(self.machines, 0)

    def middle(self, nodes: np.ndarray, span: tuple[float, float] = (FROM, TO)) -> np.ndarray:
        """``nodes`` of a raster on the line of the wheels in a ``span`` of x [m]."""
        x, y = self.ruts.corner
        first, last = (round((one - x) / self.soil.cell) for one in span)
        return nodes[round(-y / self.soil.cell), first:last]


@pytest.fixture(scope="module")
def machines(machine):
    from aoro_gym.twin.records import MachineRecord, pack

    return wp.array(pack(machine), dtype=MachineRecord, device="cpu")


def kneaded(soil: Soil, n: int) -> Any:
    """A soil without passes that bears as ``soil`` does under its n-th wheel: p(z/κ) has moduli of κ^-n and κ^-2."""
    exponent, mat, m = (float(np.asarray(one)) for one in (soil.exponent, soil.mat, soil.pass_exponent))
    moduli = {name: getattr(soil, name) / n ** (m * exponent) for name in ("k_c", "k_phi")}
    return replace(soil, **moduli, mat=mat / n ** (2.0 * m), pass_exponent=0.0)


def stays(one: Contact, before: float, after: float) -> float:
    """Work [J/m²] that stays in soil which is pressed from ``before`` to ``after`` [m] and left."""
    elastic = [0.0 if z <= 0.0 else 0.5 * float(one.virgin(z)) ** 2 / one.unloading(z) for z in (before, after)]
    return elastic[0] + quad(lambda z: float(one.virgin(z)), before, after)[0] - elastic[1]


@pytest.mark.parametrize("name", ["peat", "moraine", "sandy_loam:0.2", "clay:0.4"])
def test_a_plate_sinks_as_the_power_of_its_passes(name):
    """z_n = z_1 n^m under the same pressure, n of 1 to 10, as powers in float32 are: some units of the last place."""
    soil = Soil.named(f"{name}+passes")
    n = np.arange(1, 11)
    deep = 0.05 * n ** float(np.asarray(soil.pass_exponent))
    pressure = launch(plate_kernel, device_records(soil), n, deep)
    np.testing.assert_allclose(pressure, pressure[0], rtol=1e-5)


@pytest.mark.parametrize(("name", "last"), [("sandy_loam", 10), ("peat", 5)])  # in peat the tire is in then by 38 cm
def test_each_wheel_in_turn_sinks_and_resists_as_the_integrals_say(machines, name, last):
    """Soil of n^m times the sinkage, in the rut that the raster has of the wheels before: depth by SciPy's root of the
    load, to what the quadrature and float32 lack of it over its slope; resistance likewise. What the integral says is the
    work that stays in the soil, so that no pass is for nothing. Depths that stay are those of the unloading."""
    soil = Soil.preset(name, passes=True)
    lane = Lane(soil, machines)
    depths, before = [], 0.0
    for n in range(1, last + 1):
        resistance = lane.roll(WAY)[(WAY > FROM) & (WAY < TO)].mean()
        ruts, bearing = lane.ruts, kneaded(soil, n)

        def contact(z, bearing=bearing, before=before):
            return Contact(bearing, RADIUS, WIDTH, z + BENT, z, before, max(z, before))

        def excess(z, contact=contact):
            return contact(z).exact.load - LOAD

        root: Any = brentq(excess, max(0.9 * before, 1e-3), 0.5)
        one = contact(root)
        slope = (excess(root + 1e-4) - excess(root - 1e-4)) / 2e-4
        allowed = (one.truncation().load + one.rounding().load) / slope + 1e-5  # and what three of Newton's steps leave
        found = lane.middle(ruts.deepest)
        assert (
            np.ptp(found) < 1e-4 * root and found.mean() == pytest.approx(root, abs=allowed) and allowed < 0.04 * root
        )
        assert (lane.middle(ruts.passes) == n).all()
        left = one.truncation().resistance + one.rounding().resistance
        assert resistance == pytest.approx(one.exact.resistance, abs=left)
        assert one.exact.resistance == pytest.approx(WIDTH * stays(one, before, root), rel=1e-5)
        before = float(found.mean())
        below = float(lane.middle(ruts.deepest, (6.4, 6.6)).min())  # the shallowest node around the wheel at the end
        stayed = lane.site.standing()["ruts_wheels"][int(RUT), 0]
        if name == "sandy_loam":  # which has no mat, whose pressure depends on the length of the contact
            kept = contact(below).kept(below)
            assert stayed == pytest.approx(kept, rel=1e-4)
            assert lane.middle(ruts.depth, (6.4, 6.6)).min() == pytest.approx(kept, rel=1e-4)
        depths.append(before)
    (a,) = (one["states"][0]["a"] for one in preset_table() if one["name"] == name)
    np.testing.assert_allclose(np.array(depths) / depths[0], np.arange(1, last + 1) ** (1.0 / a), rtol=0.02)


def test_each_wheel_of_a_machine_is_a_pass(machines):
    """A front and a rear wheel, 3 m apart, forward and back: two passes each way where both have been."""
    lane = Lane(Soil.preset("sandy_loam", passes=True), machines)
    there = np.arange(-4.0, 10.0, STEP)
    for expected, way in ((2, there), (4, there[::-1]), (6, there)):
        both = np.stack([way, way - 3.0], axis=1).ravel()
        lane.roll(both, np.tile([0, 2], len(way)))
        assert (lane.middle(lane.ruts.passes) == expected).all()


@pytest.mark.parametrize(
    ("what", "rest", "passes"),
    [
        ("stands", np.full(1500, 2.0), 1),
        ("shakes", 2.0 + 0.02 * np.sin(np.arange(3000) / 2.0), 1),
        ("rocks", 2.0 + 0.62 * np.sin(np.arange(8000) / 160.0), 1),  # by 1.24 m, its diameter is 1.25 m
        ("goes to and fro", 2.0 + 2.5 * np.sin(np.arange(16000) / 640.0), 6),
    ],
)
def test_a_wheel_that_does_not_leave_deepens_nothing(machines, what, rest, passes):
    """What stands or rocks on the spot is one pass: its rut is that of soil without passes, to the bit. One that goes away
    and comes back is another each time."""
    soil = Soil.preset("sandy_loam", passes=True)
    arriving = np.arange(0.0, 2.0, STEP)
    lanes = [Lane(one, machines) for one in (soil, replace(soil, pass_exponent=1e-12))]
    for lane in lanes:
        lane.roll(np.concatenate([arriving, rest]))
    deepest, plain = (lane.ruts.deepest for lane in lanes)
    counted = lanes[0].ruts.passes
    assert counted is not None and counted.max() <= int(MOST_PASSES)
    assert (counted.max() == 1) == (passes == 1) and counted.max() >= passes, what
    assert np.array_equal(deepest, plain) == (passes == 1)


def test_a_reset_forgets_passes_and_legs(machines):
    """Twice the same lane comes to the same, to the bit, whatever was driven before."""
    lane = Lane(Soil.preset("sandy_loam", passes=True), machines)
    results = []
    for _ in range(2):
        ruts, mask = lane.site.device_struct.ruts, wp.ones(1, dtype=wp.bool, device="cpu")
        wp.launch(forget, 1, [ruts.keys, ruts.count, ruts.full, ruts.wheels, mask], device="cpu")
        wp.launch(begin_legs, 1, [ruts.legs, mask], device="cpu")
        lane.roll(WAY[:700])
        lane.roll(WAY[:700])
        results.append(lane.ruts)
    for key in ("deepest", "depth", "passes"):
        np.testing.assert_array_equal(getattr(results[0], key), getattr(results[1], key))
