"""Twins on soft ground: sinkage, resistance, traction, ruts, energy, and what is refused."""

import pickle
from typing import Any

import numpy as np
import pytest
from scipy.integrate import quad, trapezoid

from aoro_gym.machine import Machine
from aoro_gym.terrains.generate.world import world
from aoro_gym.terrains.plane import Plane
from aoro_gym.terrains.soil import BOUNDS, PRESETS, Soil
from aoro_gym.terrains.terrain import Terrain
from aoro_gym.twin import Twin
from aoro_gym.twin.kernels.soil import SHEAR, WHEEL_ROWS
from aoro_gym.twin.physics.soil import EDGE
from aoro_gym.twin.records import CHANNELS, RUTS_FULL, SOIL_OUTPUT_UNITS, WHEELS
from aoro_gym.units import GRAVITY
from tests.oracles.bodies import BodyModel
from tests.oracles.soil import Contact

SLOPES = (0.0, 4.0, 8.0, 12.0)
LOAM = Soil.preset("sandy_loam")
ROCK = Soil(k_c=0.0, k_phi=1e12, exponent=1.0, cohesion=1e9, friction_angle_deg=60.0, shear_modulus=1e-6)
"""As hard as a soil can be: 1 μm under a tire."""


def wheels(trace, channel):
    """(frames, 4, twins) of a channel of every wheel."""
    return np.stack([trace[f"{channel}_{wheel}"] for wheel in WHEELS], axis=1).astype(float)


def contact(machine, sinkage, load, *, ahead=0.0):
    """A tire of ``machine`` that rolls in LOAM: the arc behind is its own rut."""
    width = 2.0 * (float(machine.tire.disc_offset_outer) + float(EDGE))
    bent = load / float(machine.tire.stiffness)
    return Contact(LOAM, float(machine.tire.radius), width, sinkage + bent, sinkage, ahead, sinkage)


def work(machine, sinkage):
    """Work [J/m²] that stays in soil pressed to ``sinkage``: that of pressing it but for what comes back."""
    one = contact(machine, sinkage, 2e4)
    pressure = float(one.virgin(sinkage))
    return quad(lambda z: float(one.virgin(z)), 0.0, sinkage)[0] - 0.5 * pressure**2 / one.unloading(sinkage)


def wheels_over(ruts):
    """Passes (rows, columns) of a raster that has them."""
    assert ruts.passes is not None
    return ruts.passes


@pytest.fixture(scope="module")
def bundled():
    return Machine.load("aoro")


@pytest.fixture(scope="module")
def uphill(bundled):
    """Four machines that climb slopes of sandy loam: the twin, and the last 8 s of 18 s."""
    twin = Twin(len(SLOPES), machine=bundled, terrain=Plane(slope_deg=np.array(SLOPES)), soil=LOAM)
    twin.reset()
    twin.step({"drive_signal": 0.4}, 10.0)  # rear wheels are in the ruts of the front ones by then
    return twin, twin.step({}, 8.0, sample_every=0.02)


def test_a_machine_stands_sunk_from_the_start(bundled):
    """A reset leaves it on springs as bent as on hard ground: it sinks by no more than a twentieth of its rut yet, its
    wheels bear its weight, and what moves at the start (the plane fits four sinkages with three numbers) is slow."""
    names = [name for name in PRESETS if name != "clay"]  # which bears it at once
    soils = [Soil.preset(name) for name in names]
    values: dict[str, Any] = {key: np.array([getattr(soil, key) for soil in soils]) for key in BOUNDS}
    mixed = Soil(**values)
    twin = Twin(len(names), machine=bundled, soil=mixed)
    twin.reset()
    trace = twin.step({"parking_brake": 1.0}, 3.0, sample_every=0.05)
    assert trace is not None
    sinkage = wheels(trace, "sinkage")
    assert (sinkage[0] > 0.005).all()
    assert (np.ptp(sinkage, axis=0) < 0.05 * sinkage[-1]).all()
    assert np.abs(trace["speed"]).max() < 0.02
    weight = GRAVITY * sum(one.mass for one in BodyModel(bundled).bodies)
    np.testing.assert_allclose(wheels(trace, "wheel_load")[-1].sum(axis=0), weight, rtol=2e-3)
    assert twin.channels == (*CHANNELS, *SOIL_OUTPUT_UNITS)


def states(machine, trace, twin):
    """Of each wheel in a drive: its contact by the means, and those between which its sinkage and that of the rut ahead of
    it vary, which the raster of 0.1 m stirs."""
    z, load = wheels(trace, "sinkage")[:, :, twin], wheels(trace, "wheel_load")[:, :, twin].mean(axis=0)
    for wheel in range(4):
        mine, rut = z[:, wheel], np.zeros(1) if wheel < 2 else z[:, wheel - 2]
        ends = [
            contact(machine, a, load[wheel], ahead=b) for a, b in ((mine.min(), rut.max()), (mine.max(), rut.min()))
        ]
        yield wheel, contact(machine, mine.mean(), load[wheel], ahead=rut.mean()), ends


def test_resistance_is_the_integral_of_the_pressure(uphill, bundled):
    """Front wheels meet virgin soil, rear ones their ruts, which they deepen; soil that comes up behind gives some back.

    Allowed is what four Gauss points an arc may lack (:meth:`Contact.truncation`), and what the resistance varies by while
    sinkages do, with a raster that remembers the least of four nodes."""
    _, trace = uphill
    resistance = wheels(trace, "soil_resistance").mean(axis=0)
    for twin in range(len(SLOPES)):
        for wheel, mean, ends in states(bundled, trace, twin):
            low, high = sorted(end.exact.resistance for end in ends)
            left = mean.truncation().resistance
            assert low - left < resistance[wheel, twin] < high + left
            assert left < (0.02 if wheel < 2 else 0.3) * mean.exact.resistance
    assert (resistance[2:, 0] < resistance[:2, 0] / 2.0).all()
    sinkage = wheels(trace, "sinkage").mean(axis=0)
    assert (sinkage[2:] > sinkage[:2]).all()


def test_pull_against_slip_is_janosis_integral(uphill, bundled):
    """On a slope the wheels pull the weight's part along it, what the soil resists and what the machine gains of speed. At
    the shear displacements that they have, Janosi's integral over their contacts gives as much.

    Allowed is, of each wheel, what the quadrature may lack; what the most sheared end of the base lacks of friction where
    it is above the deepest sinkage that the raster remembers, k_u times the way between the two; and the standard deviation
    of the grip while the shear varies, as a tire sticks before it slips."""
    twin, _ = uphill
    mass = sum(one.mass for one in BodyModel(bundled).bodies)
    still = pickle.loads(pickle.dumps(twin))
    start, names = still.output("speed").astype(float), ("sinkage", "wheel_load", "soil_resistance")
    rows, shears = [], []
    for _ in range(80):
        still.step({}, 0.05)
        rows.append([[still.output(f"{name}_{wheel}") for wheel in WHEELS] for name in names])
        shears.append(still._grounds.ruts.standing()["ruts_wheels"][int(SHEAR) :: int(WHEEL_ROWS)])
    sinkage, load, resistance = np.moveaxis(np.array(rows, dtype=float), 1, 0)
    shear = np.array(shears, dtype=float)
    gained = mass * (still.output("speed") - start) / (80 * 0.05)
    for number, slope in enumerate(SLOPES):
        pulled = (
            mass * GRAVITY * np.sin(np.radians(slope)) + resistance[:, :, number].mean(axis=0).sum() + gained[number]
        )
        borne, allowed = 0.0, 0.0
        for wheel in range(4):
            z, j = sinkage[:, wheel, number], shear[:, wheel, number]
            ahead = sinkage[:, wheel - 2, number].mean() if wheel > 1 else 0.0
            one = contact(bundled, z.mean(), load[:, wheel, number].mean(), ahead=ahead)
            grips = []
            for one.shear in np.linspace(j.min(), j.max(), 5):
                grips.append(one.exact.grip)
            grip = np.interp(j, np.linspace(j.min(), j.max(), 5), grips)
            one.shear = float(j.mean())
            short = one.unloading(z.mean()) * (z.max() - z.mean()) * LOAM.tan_phi * one.width * 2.0 * one.flat
            sheared = 1.0 - np.exp(-one.shear / float(np.asarray(LOAM.shear_modulus)))
            allowed += one.truncation().grip + grip.std() + short * sheared
            borne += grip.mean()
        assert borne == pytest.approx(pulled, abs=allowed)
        assert allowed < 0.06 * pulled
    assert (np.diff(shear.mean(axis=(0, 1))) > 0.0).all()


def test_traction_pays_for_the_ruts(uphill, bundled):
    """The work of the soil's resistance over a drive is what its new ruts have taken, node by node: no free energy.

    Nodes 0.1 m apart count 0.5 or 0.6 m of a tire of 0.53 m, as they lie. Allowed is the way times what the quadrature may
    lack of each wheel's resistance; one column of nodes, where the drive ends between two; and what rear wheels meet of the
    least of four nodes, where the sum has each node's own: b p times the range of the rut's depth.
    """
    twin, trace = uphill
    before = pickle.loads(pickle.dumps(twin))
    last = before.step({}, 8.0, sample_every=0.02)
    width = contact(bundled, 0.04, 2e4).width
    for number in (0, 3):
        old, new = twin.rut_raster(number), before.rut_raster(number)
        pressed = [
            sum(work(bundled, z) for z in ruts.deepest[ruts.deepest > 1e-4].astype(float)) * ruts.cell**2
            for ruts in (old, new)
        ]
        across = np.count_nonzero(new.deepest[:, new.deepest.shape[1] // 2] > 1e-4) / 2  # nodes below a tire
        taken = (pressed[1] - pressed[0]) * width / (across * new.cell)
        force = wheels(last, "soil_resistance")[:, :, number].sum(axis=1)
        spent = trapezoid(force * last["speed"][:, number], dx=0.02)
        way = trapezoid(last["speed"][:, number], dx=0.02)
        allowed = 0.0
        for wheel, mean, _ in states(bundled, last, number):
            allowed += way * mean.truncation().resistance + new.cell * width * work(bundled, mean.sinkage) / 2.0
            if wheel > 1:
                stirred = np.ptp(wheels(last, "sinkage")[:, wheel - 2, number])
                allowed += way * width * float(mean.virgin(mean.sinkage)) * stirred
        assert spent == pytest.approx(taken, abs=allowed) and allowed < 0.2 * taken
    assert trace["motor_pressure_fl"].min() > 0.0


def test_each_pass_sinks_less_than_the_one_before(bundled):
    """Out and back three times in the same ruts: each time adds less, and the last two not a tenth of the first."""
    twin = Twin(machine=bundled, soil=LOAM)
    twin.reset()
    deepest = []
    for direction in (1.0, -1.0) * 3:
        twin.step({"drive_signal": 0.4 * direction}, 7.0)
        twin.step({"drive_signal": 0.0}, 2.0)
        ruts = twin.rut_raster()
        inside = ruts.deepest[:, ruts.deepest.shape[1] // 2]  # a row of nodes across the ruts
        deepest.append(float(inside.max()))
    assert (np.diff(deepest) >= 0.0).all()
    gains = np.diff(deepest[1::2], prepend=0.0)
    assert (np.diff(gains) < 0.0).all() and gains[1:].sum() < 0.1 * gains[0]


def test_the_hardest_soil_is_hard_ground(bundled):
    """It gives way by some μm, against 7 cm of the tires: tracks agree to 1e-3 of their length."""
    twins = [Twin(machine=bundled, soil=ROCK), Twin(machine=bundled)]
    ends = []
    for twin in twins:
        twin.reset(joint_angle=0.2)
        twin.step({"drive_signal": 0.5}, 6.0)
        ends.append([float(twin.output(name)[0]) for name in ("position_x", "position_y", "yaw", "joint_angle")])
    assert twins[0].output("sinkage_fl")[0] < 1e-5 and np.hypot(*ends[1][:2]) > 2.0
    np.testing.assert_allclose(ends[0], ends[1], atol=1e-3 * np.hypot(*ends[1][:2]))


def test_left_and_right_are_mirrored(bundled):
    """Nodes lie on the line of symmetry; what differs is rounding, to 1e-3 m after 4 m."""
    twin = Twin(2, machine=bundled, soil=Soil.preset("peat"))
    twin.reset(joint_angle=np.array([0.3, -0.3]))
    trace = twin.step({"drive_signal": 0.5}, 8.0, sample_every=0.1)
    assert trace is not None
    np.testing.assert_allclose(trace["position_x"][:, 0], trace["position_x"][:, 1], atol=2e-3)
    np.testing.assert_allclose(trace["position_y"][:, 0], -trace["position_y"][:, 1], atol=2e-3)
    np.testing.assert_allclose(trace["sinkage_rl"][:, 0], trace["sinkage_rr"][:, 1], atol=2e-3)


def test_each_twin_has_ruts_of_its_own_and_a_reset_forgets_them(bundled):
    twin = Twin(3, machine=bundled, soil=LOAM)
    twin.reset()
    twin.step({"drive_signal": np.array([0.0, 0.5, 0.5])}, 4.0)
    areas = [int((twin.rut_raster(number).deepest > 0.0).sum()) for number in range(3)]
    assert areas[0] < areas[1] == areas[2]
    twin.reset(np.array([False, True, False]))
    assert twin.rut_raster(1).deepest.size == 0 and int((twin.rut_raster(2).deepest > 0.0).sum()) == areas[2]
    copied = pickle.loads(pickle.dumps(twin))
    for one in (twin, copied):
        one.step({"drive_signal": 0.5}, 1.0)
    np.testing.assert_array_equal(twin.outputs.numpy(), copied.outputs.numpy())
    assert twin.rut_raster(2).volume == copied.rut_raster(2).volume > 0.0


def test_a_twin_without_room_for_its_ruts_is_frozen_and_says_why(bundled):
    twin = Twin(2, machine=bundled, soil=Soil.preset("sandy_loam", tiles=64))
    twin.reset()
    twin.step({"drive_signal": np.array([0.0, 1.0])}, 16.0)
    ((number, reason),) = twin.diverged
    assert number == 1
    assert "memory of ruts is full: 48 tiles of 0.8 m x 0.8 m, about 9 m" in reason and "tiles=128, or reset" in reason
    assert twin.status.tolist() == [0, RUTS_FULL] and twin.status_reasons[RUTS_FULL] == reason
    twin.state.assign(np.full(twin.state.shape, np.nan, dtype=np.float32))
    twin.step({}, 0.01)  # which is another reason
    assert twin.diverged[0] == (0, "non-finite state") and twin.diverged[1] == (1, reason)
    twin.reset()
    twin.step({}, 0.1)
    assert not twin.diverged


def test_what_soil_does_not_go_with_is_refused(bundled):
    forest = world(seed=0, size=(30.0, 30.0))
    cases: list[tuple[dict[str, Any], str]] = [
        ({"soil": "mud"}, "soil"),
        ({"soil": LOAM, "terrain": forest}, "solid objects"),
        ({"soil": LOAM, "device": "cpu:simd"}, "lanes cannot run twins on soil"),
        ({"soil": Soil.preset("sand", cohesion=[1.0, 2.0])}, "2 variants"),
    ]
    for arguments, message in cases:
        with pytest.raises(ValueError, match=message):
            Twin(machine=bundled, **arguments)
    with pytest.raises(ValueError, match="hard"):
        Twin(machine=bundled).rut_raster()


@pytest.mark.slow
def test_passes_of_a_machine_deepen_its_ruts(bundled):
    """Out and back in the same ruts: as many wheels as the raster counts come to n^(1/a) times what a rear wheel, the heavy
    one, sinks in first, within 6 %, as all of them slip; a machine that stood there has one pass below each wheel and its
    rut as before; copies go on to the bit, and a reset forgets all."""
    twin = Twin(machine=bundled, soil="sandy_loam+passes")
    twin.reset()
    twin.step({"parking_brake": 1.0}, 3.0)
    stood = twin.rut_raster()
    assert wheels_over(stood).max() == 1
    heavier = float(twin.output("sinkage_rl")[0] / twin.output("sinkage_fl")[0])
    plain = Twin(machine=bundled, soil="sandy_loam")
    plain.reset()
    plain.step({"parking_brake": 1.0}, 3.0)
    np.testing.assert_array_equal(stood.deepest, plain.rut_raster().deepest)
    twin.reset()
    assert wheels_over(twin.rut_raster()).size == 0
    first, counts = 0.0, []
    for direction in (1.0, -1.0) * 2:
        trace = twin.step({"drive_signal": 0.5 * direction}, 11.0, sample_every=0.1)
        twin.step({"drive_signal": 0.0}, 2.0)
        first = first or float(trace["sinkage_fl"][-40:].mean())
        ruts = twin.rut_raster()
        column = round((3.5 - ruts.corner[0]) / ruts.cell)
        row = int(ruts.deepest[:, column].argmax())
        counts.append(int(wheels_over(ruts)[row, column]))
        assert ruts.deepest[row, column] / first == pytest.approx(heavier * counts[-1] ** (1.0 / 3.5), rel=0.06)
    assert counts[0] == 2 and (np.diff(counts) > 0).all() and counts[-1] > 5
    copied = pickle.loads(pickle.dumps(twin))
    for one in (twin, copied):
        one.step({"drive_signal": 0.5}, 1.0)
    np.testing.assert_array_equal(wheels_over(twin.rut_raster()), wheels_over(copied.rut_raster()))
    np.testing.assert_array_equal(twin.outputs.numpy(), copied.outputs.numpy())


@pytest.mark.slow
@pytest.mark.parametrize("ground", ["raster", "mesh"])
def test_terrains_are_soft_too(bundled, ground):
    """A slope as a terrain of soil is the same as a plane: rasters and triangles reproduce planes."""
    x = np.linspace(-20.0, 20.0, 81)
    slope = Terrain.from_heights(np.tile(np.tan(np.radians(5.0)) * x, (81, 1)), cell=0.5, corner=(-20.0, -20.0))
    ends = []
    for terrain in (slope, Plane(slope_deg=5.0)):
        twin = Twin(machine=bundled, terrain=terrain, ground=ground, soil="peat")
        twin.reset(position=(-8.0, 1.0))
        twin.step({"drive_signal": 0.4}, 6.0)
        ends.append([float(twin.output(name)[0]) for name in ("position_x", "position_z", "sinkage_fl", "sinkage_rr")])
    np.testing.assert_allclose(*ends, atol=5e-3)
