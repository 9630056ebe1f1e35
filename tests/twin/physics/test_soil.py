"""Pressure, sinkage, resistance and shear of soil against closed forms and SciPy's quadrature in float64."""

# pyright: reportInvalidTypeForm=false, reportGeneralTypeIssues=false, reportArgumentType=false, reportCallIssue=false
from dataclasses import replace

import numpy as np
import pytest
import warp as wp
from scipy.integrate import quad
from scipy.optimize import brentq
from scipy.special import beta

from aoro_gym.terrains.soil import PRESETS, Soil
from aoro_gym.twin.physics.soil import (
    FIRM,
    Patch,
    Reaction,
    remembered,
    rut_depth,
    shear_step,
    sinkage_step,
    soil_pressure,
    wheel_reaction,
)
from aoro_gym.twin.physics.soil import Soil as DeviceSoil
from aoro_gym.twin.soil_ruts import device_records, remaining_depth
from tests.oracles.soil import Contact, series_bound
from tests.twin.physics.launch import ROUNDOFF, changed, launch, record

WIDTH, RADIUS = 0.53, 0.6
LOOSE = Soil.preset("sand")


@wp.struct
class RutBehind:
    """A rut that ends below the axle."""

    axle: float  # [m] x
    deepest: float  # [m] behind it


@wp.func
def remembered(memory: RutBehind, twin: int, x: float, y: float):  # noqa: F811 (an overload)
    return wp.where(x < memory.axle, memory.deepest, 0.0)


@wp.kernel(enable_backward=False)
def pressure_kernel(soil: wp.array(dtype=DeviceSoil), size: wp.array(dtype=wp.vec2), sinkage: wp.array(dtype=float),
                    deepest: wp.array(dtype=float), pressure: wp.array(dtype=float), slope: wp.array(dtype=float),
                    rut: wp.array(dtype=float)):  # fmt: skip
    i = wp.tid()
    p, s = soil_pressure(soil[i], size[i][0], size[i][1], 1.0, sinkage[i], deepest[i])
    pressure[i] = p
    slope[i] = s
    rut[i] = rut_depth(soil[i], size[i][0], size[i][1], 1.0, deepest[i])


@wp.kernel(enable_backward=False)
def wheel_kernel(soil: wp.array(dtype=DeviceSoil), memory: wp.array(dtype=RutBehind), patch: wp.array(dtype=Patch),
                 out: wp.array(dtype=Reaction)):  # fmt: skip
    i = wp.tid()
    out[i] = wheel_reaction(soil[i], memory[i], 0, patch[i])


@wp.kernel(enable_backward=False)
def sink_kernel(soil: wp.array(dtype=DeviceSoil), memory: wp.array(dtype=RutBehind), patch: wp.array(dtype=Patch),
                stiffness: wp.array(dtype=float), sinkage: wp.array(dtype=float)):  # fmt: skip
    i = wp.tid()
    w = patch[i]
    steps = 600
    for _ in range(steps):
        w.sinkage = sinkage_step(stiffness[i], w, wheel_reaction(soil[i], memory[i], 0, w))
    sinkage[i] = w.sinkage


@wp.kernel(enable_backward=False)
def shear_kernel(slip: wp.array(dtype=wp.vec2), roll: wp.array(dtype=float), way: wp.array(dtype=float),
                 length: wp.array(dtype=float), steps: wp.array(dtype=int), shear: wp.array(dtype=float)):  # fmt: skip
    i = wp.tid()
    j = float(0.0)
    for _ in range(steps[i]):
        j = shear_step(j, slip[i][0], slip[i][1], roll[i], way[i], length[i], 0.53, 1.0e-3)
    shear[i] = j


def soils(*names):
    return np.concatenate([device_records(Soil.preset(name)) for name in names])


def patches(depth, sinkage, shear=0.0, roll=1.0):
    return record(Patch, radius=RADIUS, width=WIDTH, depth=depth, sinkage=sinkage, shear=shear, roll=roll,
                  x=0.0, y=0.0, east=1.0, north=0.0)  # fmt: skip


def virgin(soil, z, length=1e9):
    """p [Pa] at first sinkage under a plate of the wheel's width, by the equation."""
    mat = 2.0 * soil.mat * (WIDTH + length) / (WIDTH * length)
    return (soil.k_c / WIDTH + soil.k_phi) * z**soil.exponent + mat * z * z + FIRM * max(z - soil.layer, 0.0)


@pytest.mark.parametrize("name", PRESETS)
def test_a_plate_sinks_by_bekkers_law_and_comes_up_by_wongs(name):
    """Pressure at a first sinkage, below it after deeper ones, and the rut that stays. pow and what cancels on unloading are
    good to some units of the last place of p_u: 1e-5."""
    soil = Soil.preset(name)
    z_u = np.geomspace(0.005, 0.35, 7)
    share = np.array([0.0, 0.5, 0.9, 0.95, 0.98, 1.0, 1.5])
    deepest, sinkage = (grid.ravel() for grid in np.meshgrid(z_u, share))
    sinkage = sinkage * deepest
    length = 0.7
    pressure, slope, rut = launch(
        pressure_kernel, soils(*[name] * len(deepest)), np.full((len(deepest), 2), (WIDTH, length)), sinkage, deepest,
    )  # fmt: skip
    for i, (z, most) in enumerate(zip(sinkage, deepest, strict=True)):
        p_u = virgin(soil, max(most, 1e-6), length)
        k_u = max(soil.k_0 + soil.a_u * most, 2.0 * p_u / most)
        assert rut[i] == pytest.approx(max(most - p_u / k_u, 0.0), abs=1e-5 * most)
        if z >= most:
            assert pressure[i] == pytest.approx(virgin(soil, z, length), rel=1e-5)
        else:
            assert pressure[i] == pytest.approx(max(p_u - k_u * (most - z), 0.0), abs=1e-5 * (p_u + k_u * most))
        assert slope[i] >= 0.0
    square = launch(pressure_kernel, soils(name), np.full((1, 2), WIDTH), np.zeros(1), np.full(1, 0.2))[2]
    assert remaining_depth(soils(name)[0], WIDTH, np.array([0.2]))[0] == pytest.approx(square[0], rel=1e-4)


def contact(soil, depth, sinkage, **others):
    return Contact(soil, RADIUS, WIDTH, depth, sinkage, **others)


@pytest.mark.parametrize("name", ["peat", "moraine", "sand", "sandy_loam", "loam"])
@pytest.mark.parametrize("bent", [0.03, 0.07])
def test_a_rolling_wheel_bears_and_resists_as_the_integral_of_its_pressure(name, bent):
    """Virgin soil ahead, its own rut behind: load and ∫ b p dz, within what :meth:`Contact.truncation` says of four Gauss
    points, less than 5 % of the resistance, and what :meth:`Contact.rounding` says of float32.

    Soil that comes up behind presses forwards: it is left out by a rut too deep to touch. In a rut that bore a little less
    before, soil reloads within some mm ahead: points that did not know where it begins met twice the resistance."""
    soil = Soil.preset(name)
    for sinkage, before in ((0.02, 0.0), (0.06, 0.0), (0.15, 0.0), (0.06, 0.055), (0.15, 0.14)):
        depth = sinkage + bent
        exact = contact(soil, depth, sinkage, ahead=before, behind=before or 1.0)
        memory = record(RutBehind, axle=9.0 if before else -exact.flat, deepest=before or 1.0)
        out = launch(wheel_kernel, soils(name), memory, patches([depth], [sinkage]))
        allowed, rounding = exact.truncation(), exact.rounding()
        assert allowed.load < 0.04 * exact.exact.load
        assert before or allowed.resistance < 0.05 * exact.exact.resistance
        for key in ("load", "resistance"):
            found = float(np.ravel(getattr(out, key))[0])
            left = getattr(rounding, key)
            assert found == pytest.approx(getattr(exact.rule(), key), abs=left)
            assert found == pytest.approx(getattr(exact.exact, key), abs=getattr(allowed, key) + left)
        if soil.mat == 0.0 and not before:
            k, n = soil.k_c / WIDTH + soil.k_phi, soil.exponent
            assert exact.exact.resistance == pytest.approx(WIDTH * k * sinkage ** (n + 1) / (n + 1), rel=1e-6)


@pytest.mark.parametrize("name", ["sandy_loam", "loam"])
def test_gauss_points_converge_as_their_theory_says(name):
    """Of ∫ (1 − s)ⁿ … an N-point rule lacks c (N + ½)^(−2 n − 2) (1 + O(N⁻²)) (Verlinden, 1997, R): twice as many points
    find the exponent, four times as many find it nearer."""
    soil = Soil.preset(name)
    one = contact(soil, 0.12, 0.06, behind=1.0)
    left = np.array([abs(one.rule(n).load - one.exact.load) for n in (4, 8, 16)])
    expected = (np.array([8.5, 16.5]) / np.array([4.5, 8.5])) ** (2.0 * soil.exponent + 2.0)
    off = np.abs(left[:-1] / left[1:] / expected - 1.0)
    assert off[1] < 0.5 * off[0] < 0.15  # by a quarter in theory


def test_a_rigid_wheel_sinks_by_bekkers_closed_form():
    """W = b k √D z₀^(n + ½) ½ B(n + 1, ½) of a shallow parabola; Bekker's first terms have (3 − n)/3 for ½ B, 6 % more at
    n = ½ and the same at 1. The circle's arc is shorter than the parabola's by 3 h/(4 R) at a height h over its lowest
    point, of the load by 3 z₀/(4 R (2 n + 3)); what is left is (z₀/R)²."""
    for exponent in (0.5, 0.8, 1.0):
        soil = Soil(k_c=0.0, k_phi=2e6, exponent=exponent, cohesion=0.0, friction_angle_deg=30.0, shear_modulus=0.02)
        z = 0.02
        memory = record(RutBehind, axle=0.0, deepest=1.0)
        out = launch(wheel_kernel, device_records(soil), memory, patches([z], [z]))
        shape = WIDTH * 2e6 * np.sqrt(2.0 * RADIUS) * z ** (exponent + 0.5)
        parabola = shape * 0.5 * beta(exponent + 1.0, 0.5)
        circle = parabola * (1.0 - 3.0 * z / (4.0 * RADIUS * (2.0 * exponent + 3.0)))
        one = contact(soil, z, z, behind=1.0)
        allowed = one.truncation().load + one.rounding().load + (z / RADIUS) ** 2 * parabola
        assert np.ravel(out.load)[0] == pytest.approx(circle, abs=allowed)
        assert allowed < 0.02 * parabola
        assert shape * (3.0 - exponent) / 3.0 == pytest.approx(parabola, rel=0.07)


def test_a_standing_wheel_is_pushed_neither_way():
    memory = record(RutBehind, axle=0.0, deepest=0.0)
    out = launch(wheel_kernel, soils("peat"), memory, patches([0.2], [0.15]))
    assert abs(np.ravel(out.resistance)[0]) <= 20.0 * ROUNDOFF * np.ravel(out.load)[0]


def test_tire_and_soil_bear_the_same_load():
    """Newton's steps end where k (D − z₀) = F(z₀): the root by SciPy, but for what the quadrature lacks of F over the sum of
    both slopes."""
    soil = Soil.preset("peat")
    memory = record(RutBehind, axle=0.0, deepest=0.0)
    stiffness, depth = 3.4e5, 0.2
    sinkage = launch(sink_kernel, soils("peat"), memory, patches([depth], [0.0]), np.array([stiffness]))

    def excess(z):
        return contact(soil, depth, z).exact.load - stiffness * (depth - z)

    root = brentq(excess, 1e-3, depth - 1e-3)
    slope = (excess(root + 1e-4) - excess(root - 1e-4)) / 2e-4
    one = contact(soil, depth, root)
    assert sinkage[0] == pytest.approx(root, abs=(one.truncation().load + one.rounding().load) / slope + 2 * ROUNDOFF)


def test_shear_strength_over_a_contact_is_janosis_integral():
    """Under a long plate of uniform pressure T = (A c + W tan φ) (1 − K/(iℓ) (1 − exp(−iℓ/K))), but for what its arcs bear,
    and over a rolling wheel the integral of its pressure, as far as its points know it."""
    soil = Soil.preset("sandy_loam", k_0=0.0)
    k = soil.shear_modulus
    depth, sinkage = 0.12, 0.06
    for slip in (0.02, 0.1, 0.3, 1.0):
        one = contact(soil, depth, sinkage, behind=1.0)  # the arc behind bears nothing
        one.shear = slip * one.length
        out = launch(wheel_kernel, soils("sandy_loam"), record(RutBehind, axle=-one.flat, deepest=1.0),
                     patches([depth], [sinkage], one.shear))  # fmt: skip
        found, left = float(np.ravel(out.grip)[0]), one.rounding().grip
        assert found == pytest.approx(one.rule().grip, abs=left)
        assert found == pytest.approx(one.exact.grip, abs=left + one.truncation().grip)
        assert one.truncation().grip < 0.05 * one.exact.grip
    plate = Soil.preset("sandy_loam", layer=0.01, cohesion=2e5, friction_angle_deg=0.0)
    depth, sinkage = 0.3, 0.0105
    memory = record(RutBehind, axle=0.0, deepest=0.0)
    out = launch(wheel_kernel, device_records(plate), memory, patches([depth], [sinkage], 0.04))
    one = contact(plate, depth, sinkage)
    closed = WIDTH * 2.0 * one.flat * 2e5 * (1.0 - k / 0.04 * (1.0 - np.exp(-0.04 / k)))
    arcs = WIDTH * 2.0 * (one.end - one.flat) * 2e5
    assert np.ravel(out.grip)[0] == pytest.approx(closed, abs=arcs) and arcs < 0.05 * closed


@pytest.mark.parametrize("part", [0.0, 0.4, 1.0])
def test_a_wheel_that_slips_digs_itself_in_as_lyasko_says(part):
    """Pressure at z is that at z/κ, κ = (1 + c s)/(1 − c s/2): without a mat and a layer that of a soil whose moduli are
    κⁿ times less, whose integrals are known; the tire that bears its load there sinks as SciPy says. Without slip
    sinkage the slip changes neither load nor resistance by a bit."""
    soil = Soil.preset("sandy_loam", slip_sinkage=part)
    depth, sinkage = 0.12, 0.05
    virgin_soil = record(RutBehind, axle=0.0, deepest=0.0)
    still = launch(wheel_kernel, device_records(soil), virgin_soil, patches([depth], [sinkage], 0.0))
    for slip in (0.05, 0.2, 0.6):
        kappa = (1.0 + part * slip) / (1.0 - 0.5 * part * slip)
        n = soil.exponent
        weaker = replace(soil, k_c=soil.k_c / kappa**n, k_phi=soil.k_phi / kappa**n)
        one = contact(weaker, depth, sinkage)
        one.shear = slip * one.length
        out = launch(wheel_kernel, device_records(soil), virgin_soil, patches([depth], [sinkage], one.shear))
        for key in ("load", "grip"):
            found = float(np.ravel(getattr(out, key))[0])
            assert found == pytest.approx(getattr(one.rule(), key), abs=2.0 * getattr(one.rounding(), key))
        if part == 0.0:
            assert out.load == still.load and out.resistance == still.resistance
        stiffness = 3.4e5

        def excess(z, weaker=weaker):
            return contact(weaker, depth, z).exact.load - stiffness * (depth - z)

        root = brentq(excess, 1e-3, depth - 1e-3)
        one = contact(weaker, depth, root)
        patch = patches([depth], [0.0], slip * one.length)
        found = launch(sink_kernel, device_records(soil), virgin_soil, patch, np.array([stiffness]))
        # the patch's shear is that of the contact at the root; dF/dz is more than the tire's stiffness
        assert found[0] == pytest.approx(root, abs=(one.truncation().load + one.rounding().load) / stiffness + 1e-6)


def test_shear_grows_to_slip_times_length_in_rolling_and_by_the_way_in_standing():
    """Driven i = 1 − V/(Ω r), braked i = 1 − Ω r/V, a locked wheel at most its length; one that stands by the way
    slipped."""
    roll, way = np.array([1.0, 0.6, 0.0, 0.0]), np.array([0.8, 1.0, 1.0, 0.0])
    slip = np.stack([np.array([-0.2, 0.4, 1.0, 0.01]), np.zeros(4)], axis=1)
    steps = np.array([20000, 20000, 20000, 1000])
    shear = launch(shear_kernel, slip, roll, way, np.full(4, 0.5), steps)
    np.testing.assert_allclose(shear, [0.1, 0.2, 0.5, 0.01], rtol=1e-4)


def test_passes_over_one_rut_sink_ever_less_and_come_to_the_pressure_of_the_flat_base():
    """The arc ahead bears a virgin soil's pressure in the first pass and almost none later, so the base must bear it. Each
    pass sinks as the balance of the integrals says, by SciPy, in the rut of the one before; of depths, what the quadrature
    lacks of the load over the slope of the load. The limit bears k δ on the base and on the strips that reload."""
    soil = Soil.preset("sandy_loam")
    stiffness, load = 3.4e5, 25e3
    bent = load / stiffness
    before, found = 0.0, 0.0
    depths = []
    for _ in range(4):

        def excess(z, before=before):
            return contact(soil, bent + z, z, ahead=before, behind=before).exact.load - load

        low = max(before, 1e-3)
        exact = before if excess(low) >= 0.0 else brentq(excess, low, 0.3)
        one = contact(soil, bent + exact, exact, ahead=before, behind=before)
        allowed = (one.truncation().load + one.rounding().load) / (
            WIDTH * 2.0 * one.flat * 1e6
        )  # dp/dz is more than that
        memory = record(RutBehind, axle=9.0, deepest=found)
        found = _settled(memory, stiffness, bent, found)
        assert found == pytest.approx(exact, abs=allowed + 1e-6 + abs(before - found if before > found else 0.0))
        before = exact
        depths.append(exact)
    gains = np.diff(depths)
    assert (gains[1:] < 0.5 * gains[:-1]).all() and 0.0 <= gains[-1] < 0.01 * depths[-1]


def _settled(memory, stiffness, bent, start):
    """Sinkage at which the device's tire, bent by its load, and soil bear the same: by bisection over D."""
    low, high = bent, 0.55
    z = np.zeros(1)
    for _ in range(25):
        depth = 0.5 * (low + high)
        z = launch(
            sink_kernel, soils("sandy_loam"), memory, patches([depth], [max(start - 0.02, 0.0)]), np.array([stiffness])
        )
        low, high = (low, depth) if depth - z[0] > bent else (depth, high)
    return float(z[0])


@pytest.mark.parametrize(("name", "dry", "wet"), [("sandy_loam", 0.11, 0.32), ("clay", 0.25, 0.4)])
def test_soil_that_is_wet_carries_less(name, dry, wet):
    """Between measured states, too, at a sinkage of 10 cm; at the ends it is what was measured."""
    pressures = [virgin(Soil.preset(name, moisture=float(m)), 0.1) for m in np.linspace(dry, wet, 9)]
    assert np.all(np.diff(pressures) < 0.0)
    assert pressures[0] == pytest.approx(virgin(Soil.preset(name), 0.1), rel=1e-12)


def test_a_text_names_preset_moisture_and_laws():
    """Passes and slip sinkage are off unless they are named; exponents lie between those of measured states."""
    plain, all_of_it = Soil.named("sandy_loam:0.2"), Soil.named("sandy_loam:0.2+passes+slip_sinkage")
    assert (plain.pass_exponent, plain.slip_sinkage, plain.has_passes) == (0.0, 0.0, False)
    dry, wet = (Soil.named(f"sandy_loam:{water}+passes").pass_exponent for water in (0.11, 0.26))
    assert wet < all_of_it.pass_exponent < dry and all_of_it.slip_sinkage == 1.0 and all_of_it.has_passes
    assert all_of_it.k_phi == plain.k_phi and all_of_it.bytes_per_twin - plain.bytes_per_twin == 1024 * 64 * 4
    assert Soil.preset("snow", pass_exponent=[0.0, 0.2]).has_passes  # of one's own, in one twin of two


def test_a_sunk_flank_is_held_by_passive_earth_pressure():
    """∫ 2 c z √N_φ + ½ γ z² N_φ over the length that is sunk; on arcs within the bound of a function that goes to 0 as
    1 − s, and float32."""
    soil = Soil.preset("sandy_loam")
    passive = np.tan(np.radians(45.0 + 0.5 * soil.friction_angle_deg))
    for depth, sinkage in ((0.2, 0.2), (0.2, 0.13), (0.12, 0.05)):
        flat, end = (np.sqrt(h * (2.0 * RADIUS - h)) for h in (depth - sinkage, depth))

        def borne(x, depth=depth, sinkage=sinkage):
            z = np.clip(depth - RADIUS + np.sqrt(RADIUS**2 - x**2), 0.0, sinkage)
            return 2.0 * soil.cohesion * z * passive + 0.5 * soil.unit_weight * z**2 * passive**2

        memory = record(RutBehind, axle=0.0, deepest=0.0)
        out = launch(wheel_kernel, device_records(soil), memory, patches([depth], [sinkage]))
        exact = quad(borne, -end, end, points=[-flat, flat])[0]
        arc = 2.0 * (end - flat)
        allowed = 2.0 * series_bound(lambda s: arc * s * borne(flat + 0.5 * arc * s * s), 1.0) + 1e-4 * exact
        assert np.ravel(out.flank)[0] == pytest.approx(exact, abs=allowed) and allowed < 0.002 * exact


def test_bad_soils_are_named():
    for arguments, message in (
        ({"name": "mud"}, "soil"),
        ({"name": "peat", "moisture": 0.5}, "moisture is 0.5, but peat"),
        ({"name": "clay", "moisture": 0.5}, "moisture"),
        ({"name": "peat", "tiles": 1000}, "tiles is 1000, but must be a power of two"),
        ({"name": "peat", "cohesion": -1.0}, "cohesion"),
        ({"name": "peat", "stickiness": 1.0}, "stickiness"),
        ({"name": "snow", "passes": True}, "snow has no known pass_exponent"),
        ({"name": "peat", "pass_exponent": 1.5}, "pass_exponent"),
        ({"name": "peat", "cohesion": [1.0, 2.0], "k_phi": [1e6] * 3}, "differ in length"),
    ):
        with pytest.raises(ValueError, match=message):
            Soil.preset(**arguments)
    for text, message in (
        ("peat+mud", "soil law is .mud."),
        ("clay:wet", "moisture 'wet'"),
        ("snow+passes", "no known"),
    ):
        with pytest.raises(ValueError, match=message):
            Soil.named(text)
    assert changed(device_records(LOOSE), k_c=1.0)["k_c"] == 1.0
